//! Curves of two runs over each other, where they differ.

use std::collections::BTreeSet;

use trilink_plot::{Figure, Layer, Layout, Look, Panel, Scale};
use trilink_report::colours;
use trilink_robot::metrics::Metric;

use super::means::campaigns;
use super::snapshot::{Record, Records, Snapshot, number, text};
use super::{Compared, Difference};

/// Curves of both runs: of a campaign's trials, or of a model's predictions.
struct Curves<'s> {
    runs: [&'s Records; 2],
    campaign: &'s str,
    model: Option<&'s str>,
    /// Column of the frequency.
    omega: &'s str,
}

/// A figure for each campaign's trials, and for each model, that has something out of tolerance.
pub(super) fn figures(
    compared: &Compared,
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
            "campaigns" => difference.of == campaign,
            table => table == "trials" && curves.include(&difference.of),
        });
        figures.extend(curves.figure(format!("Trials of {campaign}"), &quantities));
        let records = predictions.into_iter().flat_map(Records::values);
        let of_campaign = records.filter(|record| text(record, "campaign") == campaign);
        let models: BTreeSet<&str> = of_campaign.map(|record| text(record, "model")).collect();
        for model in models {
            let omega = "omega_rad_s";
            let curves = Curves { runs: predictions, campaign, model: Some(model), omega };
            let mut quantities = columns(compared, |difference| {
                difference.table == "predictions" && curves.include(&difference.of)
            });
            let fit = format!("{campaign} {model}");
            if compared.out().any(|difference| difference.table == "fits" && difference.of == fit) {
                quantities.insert(Metric::D.column());
                quantities.extend(Metric::SIGMA.map(Metric::column));
            }
            figures.extend(curves.figure(format!("Model {model} of {campaign}"), &quantities));
        }
    }
    figures
}

/// Columns that are out of tolerance in some rows.
fn columns(compared: &Compared, is_of: impl Fn(&&Difference) -> bool) -> BTreeSet<&str> {
    let out = compared.out().filter(is_of);
    out.map(|difference| difference.column.trim_end_matches("_debiased")).collect()
}

impl Curves<'_> {
    fn holds(&self, record: &Record) -> bool {
        text(record, "campaign") == self.campaign
            && self.model.is_none_or(|model| text(record, "model") == model)
    }

    fn include(&self, name: &str) -> bool {
        self.runs.iter().any(|run| run.get(name).is_some_and(|record| self.holds(record)))
    }

    fn points(&self, records: &Records, column: &str) -> Vec<(f64, f64)> {
        let point = |record: &Record| Some((number(record, self.omega)?, number(record, column)?));
        let records = records.values().filter(|record| self.holds(record));
        let mut points: Vec<(f64, f64)> = records.filter_map(point).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    }

    /// A chart for each of the columns; `None` if there is nothing to draw.
    fn figure(&self, title: String, columns: &BTreeSet<&str>) -> Option<Figure> {
        let metrics = Metric::ALL.into_iter().map(Metric::definition);
        let panels = metrics.filter(|of| columns.contains(of.column)).map(|of| {
            let label = match of.dimension.units()[0] {
                "" => of.plain.to_owned(),
                unit => format!("{} ({unit})", of.plain),
            };
            let [baseline, candidate] = self.runs.map(|records| self.points(records, of.column));
            let dots = |colour| Look::Dots { colour, joined: true };
            let layers = vec![
                Layer::new("baseline", baseline, dots(colours::BASELINE)),
                Layer::new("tonight", candidate, dots(colours::CANDIDATE)),
            ];
            let panel = Panel::new(&*label, "omega (rad/s)", &*label, layers);
            Panel { y_scale: Scale::Decades, ..panel }
        });
        let texts = [title, "Grey: baseline. Orange: tonight.".to_owned()];
        let figure = Figure::new("", texts, &[self.campaign], Layout::Grid, panels.collect());
        (!figure.is_empty()).then_some(figure)
    }
}
