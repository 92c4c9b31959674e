//! Figures of curves that differ between the compared runs.

use std::collections::BTreeSet;

use trilink_plot::{Figure, Layer, Layout, Look, Panel, Scale};
use trilink_report::colours;
use trilink_robot::metrics::Metric;

use super::means::campaigns;
use super::snapshot::{Record, Records, Snapshot, number, text};
use super::{ComparisonResult, Difference};

/// Curves of the baseline run and the candidate run against frequency: metrics of a campaign's trials, or predictions
/// of a model.
struct Curves<'s> {
    runs: [&'s Records; 2],
    campaign: &'s str,
    /// Model of the predictions; `None` for curves of trials.
    model: Option<&'s str>,
    /// Name of the frequency column.
    omega: &'s str,
}

/// Draws a figure for each campaign and each model whose curves have values out of tolerance.
pub(super) fn figures(
    compared: &ComparisonResult,
    baseline: &Snapshot,
    candidate: &Snapshot,
) -> Vec<Figure> {
    let [trials, predictions] =
        ["trials", "predictions"].map(|table| [baseline.records(table), candidate.records(table)]);
    let mut figures = Vec::new();
    for campaign in trials.into_iter().flat_map(campaigns).collect::<BTreeSet<&str>>() {
        let omega = "omega_commanded_rad_s";
        let curves = Curves { runs: trials, campaign, model: None, omega };
        let quantities = columns(compared, |difference| match difference.table {
            "campaigns" => difference.row == campaign,
            table => table == "trials" && curves.include(&difference.row),
        });
        figures.extend(curves.figure(format!("Trials of {campaign}"), &quantities));
        let records = predictions.into_iter().flat_map(Records::values);
        let of_campaign = records.filter(|record| text(record, "campaign") == campaign);
        let models: BTreeSet<&str> = of_campaign.map(|record| text(record, "model")).collect();
        for model in models {
            let omega = "omega_rad_s";
            let curves = Curves { runs: predictions, campaign, model: Some(model), omega };
            let mut quantities = columns(compared, |difference| {
                difference.table == "predictions" && curves.include(&difference.row)
            });
            let fit = format!("{campaign} {model}");
            if compared.out().any(|difference| difference.table == "fits" && difference.row == fit)
            {
                quantities.insert(Metric::D.column());
                quantities.extend(Metric::SIGMA.map(Metric::column));
            }
            figures.extend(curves.figure(format!("Model {model} of {campaign}"), &quantities));
        }
    }
    figures
}

/// Returns the columns with values out of tolerance, among the differences that satisfy `is_selected`.
fn columns(
    compared: &ComparisonResult,
    is_selected: impl Fn(&&Difference) -> bool,
) -> BTreeSet<&str> {
    let out = compared.out().filter(is_selected);
    out.map(|difference| difference.column.trim_end_matches("_debiased")).collect()
}

impl Curves<'_> {
    /// Returns whether a record belongs to these curves.
    fn holds(&self, record: &Record) -> bool {
        text(record, "campaign") == self.campaign
            && self.model.is_none_or(|model| text(record, "model") == model)
    }

    /// Returns whether the table row `name` of the baseline run or of the candidate run belongs to these curves.
    fn include(&self, name: &str) -> bool {
        self.runs.iter().any(|run| run.get(name).is_some_and(|record| self.holds(record)))
    }

    fn points(&self, records: &Records, column: &str) -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> = records
            .values()
            .filter(|record| self.holds(record))
            .filter_map(|record| Some((number(record, self.omega)?, number(record, column)?)))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    }

    /// Draws a figure with a panel for each of the `columns`; returns `None` if there is nothing to draw.
    fn figure(&self, title: String, columns: &BTreeSet<&str>) -> Option<Figure> {
        let metrics = Metric::ALL.into_iter().map(Metric::definition);
        let panels = metrics.filter(|of| columns.contains(of.column)).map(|of| {
            let label = match of.dimension.units()[0] {
                "" => of.plain.to_owned(),
                unit => format!("{} ({unit})", of.plain),
            };
            let [baseline, candidate] = self.runs.map(|records| self.points(records, of.column));
            let runs = [
                ("baseline", baseline, colours::BASELINE),
                ("this run", candidate, colours::CANDIDATE),
            ];
            let layers = runs.map(|(name, points, colour)| {
                Layer::new(name, points, Look::Dots { colour, joined: true })
            });
            let layers = layers.into();
            let panel = Panel::new(&*label, "omega (rad/s)", &*label, layers);
            Panel { y_scale: Scale::Decades, ..panel }
        });
        let texts = [title, "Grey: baseline. Orange: this run.".to_owned()];
        let figure = Figure::new("", texts, &[self.campaign], Layout::Grid, panels.collect());
        (!figure.is_empty()).then_some(figure)
    }
}
