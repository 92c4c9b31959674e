//! Figs. 10, 13 and 15 to 20: measurements and models against the frequency.

use std::collections::BTreeSet;

use minijinja::context;
use minijinja::value::Serde;
use trilink_base::csv::field as csv_field;
use trilink_mechanics::Model;
use trilink_plot::{Figure, Layout, Panel, Point, Range, Scale};
use trilink_robot::metrics::Metric;
use trilink_tables::config::SigmaKind;

use super::common::FREQUENCY;
use super::texts::texts;
use crate::series::{DISPLACEMENT, Quantity, SPEED, Series, Source};

pub(crate) const BARS: &str = "Markers: means over the cycles of each trial, of flagged ones in orange, of many \
                    those that do not cover each other; bars: 95 % (1.96 standard errors), where \
                    longer than the marker.";
/// A model further above the measurements than this would flatten them.
const FARTHEST_MODEL: f64 = 1.5;

/// One quantity against the frequency.
pub(crate) type Plot = (Quantity, Vec<Series>);

/// Figs. 10, 13 and 15: what was measured of displacement and speed.
pub(crate) fn measured(stem: &str, campaign: &str, source: Source<'_>) -> Figure {
    let texts = texts("measured", context! { campaign, bars => BARS });
    let plots = [DISPLACEMENT, SPEED]
        .map(|quantity| -> Plot { (quantity, source.measured(campaign, &quantity, 0)) });
    figure(stem, texts, &[campaign], &plots)
}

/// Displacement alone, measured and by one model, for the first screen.
pub(crate) fn overview(campaign: &str, model: Option<Model>, source: Source<'_>) -> Figure {
    let model = model.and_then(|model| source.model(campaign, model, &DISPLACEMENT, 0));
    let series = source.measured(campaign, &DISPLACEMENT, 0).into_iter().chain(model).collect();
    let title = format!("Displacement d of campaign {campaign}");
    figure("overview", [title, String::new()], &[campaign], &[(DISPLACEMENT, series)])
}

/// Figs. 16, 17 and 18: displacement and speed, measured and by all models of the campaign.
pub(crate) fn models(stem: &str, campaign: &str, source: Source<'_>) -> Figure {
    let models = source.models(campaign);
    let plots = [DISPLACEMENT, SPEED].map(|quantity| -> Plot {
        let model = |model: &Model| source.model(campaign, *model, &quantity, 0);
        let measured = source.measured(campaign, &quantity, 0);
        (quantity, measured.into_iter().chain(models.iter().filter_map(model)).collect())
    });
    let (input, of_trials) = drivers(&plots, source);
    let values = context! { campaign, bars => BARS, input, of_trials };
    figure(stem, texts("models", values), &[campaign], &plots)
}

/// What drives the models of plots: the gait in words, empty without a line, and the names of those
/// that each trial's own gait drives, whatever `[fit]` says.
pub(crate) fn drivers(plots: &[Plot], source: Source<'_>) -> (String, Vec<&'static str>) {
    let series = plots.iter().flat_map(|(_, series)| series);
    let drawn = series.filter_map(|of| Some((of.campaign.as_str(), of.model?)));
    let drawn: BTreeSet<(&str, Model)> = drawn.collect();
    let of_trials = drawn.iter().map(|(_, model)| *model).filter(|of| source.is_of_trials(*of));
    let of_trials: BTreeSet<&str> = of_trials.map(Model::name).collect();
    (source.gait_input(drawn), of_trials.into_iter().collect())
}

/// Figs. 19 and 20: the wheels' skid ratios of campaigns, measured and by the preferred model of
/// each, or of a single campaign by all its models that skid.
pub(crate) fn skid(stem: &str, campaigns: &[&str], source: Source<'_>) -> Figure {
    let has_several = campaigns.len() > 1;
    let models = |campaign: &str| -> Vec<Model> {
        match has_several {
            true => source.preferred_with_skid(campaign).into_iter().collect(),
            false => source.models(campaign).into_iter().filter(|of| source.skids(*of)).collect(),
        }
    };
    let models: Vec<Vec<Model>> = campaigns.iter().map(|campaign| models(campaign)).collect();
    let plots = Metric::SIGMA.map(Quantity::new).map(|quantity| -> Plot {
        let of_campaign = |(nth, campaign): (usize, &&str)| {
            let measured = source.measured(campaign, &quantity, nth).into_iter();
            let model = |model: &Model| source.model(campaign, *model, &quantity, nth);
            measured.chain(models[nth].iter().filter_map(model)).collect::<Vec<_>>()
        };
        let mut series: Vec<Series> = campaigns.iter().enumerate().flat_map(of_campaign).collect();
        for Series { campaign, layer, .. } in series.iter_mut().filter(|_| has_several) {
            layer.name = format!("{campaign}, {}", layer.name);
        }
        (quantity, series)
    });
    let (input, of_trials) = drivers(&plots, source);
    let values = context! {
        campaigns => Serde(campaigns),
        bars => BARS,
        debiased => source.sigma == SigmaKind::Debiased,
        input,
        of_trials,
    };
    figure(stem, texts("skid", values), campaigns, &plots)
}

/// A panel for each quantity.
pub(crate) fn figure(stem: &str, texts: [String; 2], campaigns: &[&str], plots: &[Plot]) -> Figure {
    let columns = plots.iter().map(|(of, _)| {
        ["", "_error_95", "_lo", "_hi"].map(|end| format!(",{}{end}", of.csv_name)).concat()
    });
    let columns: String = columns.collect();
    let mut csv = format!("panel,campaign,series,kind,trial,omega_rad_s{columns}\n");
    let mut alternative = format!("{}, plotted against the actuation frequency.", texts[0]);
    for (nth, ((quantity, all), letter)) in plots.iter().zip('a'..).enumerate() {
        let mut extents = Vec::new();
        for series in all {
            let before = ",".repeat(4 * nth);
            let after = ",".repeat(4 * (plots.len() - 1 - nth));
            write_csv(&mut csv, letter, series, [&before, &after]);
            extents.push(extent(quantity, series));
        }
        alternative.push_str(&format!(" ({letter}) {}: {}.", quantity.title, extents.join("; ")));
    }
    let panels = plots.iter().map(panel).collect();
    let figure = Figure::new(stem, texts, campaigns, Layout::Stack, panels);
    Figure { csv: Some(csv), alternative: Some(alternative), ..figure }
}

/// All measurements, and the models as far as they leave these readable.
fn panel((quantity, series): &Plot) -> Panel {
    // Measurements lie on top.
    let (measured, modelled): (Vec<&Series>, Vec<_>) =
        series.iter().partition(|series| series.model.is_none());
    let tops = measured.iter().flat_map(|series| series.points());
    let most = Range::of(tops.map(|point| point.y + point.error.max(0.0)));
    let ceiling = most.map(|most| FARTHEST_MODEL * most.high).filter(|ceiling| *ceiling > 0.0);
    // How far a series goes above the panel, if it does.
    let beyond = |series: &&Series| {
        let above = series.points().map(|point| point.y).filter(|value| Some(*value) > ceiling);
        let highest = ceiling.and(above.reduce(f64::max))?;
        let digits = usize::from(highest < 100.0) + 2 * usize::from(highest < 1.0);
        let (name, unit) = (&series.layer.name, quantity.after_number());
        Some(format!("{name} above, up to {}{unit}", trilink_base::numbers::fixed(highest, digits)))
    };
    let beyond: Vec<String> = modelled.iter().filter_map(beyond).collect();
    let layers = modelled.into_iter().chain(measured).map(|series| series.layer.clone());
    Panel {
        y_scale: match quantity.metric {
            Metric::D => Scale::Linear,
            _ => Scale::FromZero,
        },
        shown: ceiling.map(|high| Range { low: f64::NEG_INFINITY, high }),
        beyond: match beyond.as_slice() {
            [] => String::new(),
            [one] => one.clone(),
            several => format!("{} models lie above", several.len()),
        },
        ..Panel::new(quantity.title, FREQUENCY, quantity.axis_label(), layers.collect())
    }
}

/// What a series shows for those who cannot see it.
fn extent(quantity: &Quantity, series: &Series) -> String {
    let Range { low, high } = Range::of(series.points().map(|point| point.y))
        .unwrap_or(Range { low: f64::NAN, high: f64::NAN });
    let digits = if quantity.is_skid() { 4 } else { 1 };
    let trials = match series.model {
        None => format!(" ({} trials)", series.points().count()),
        Some(_) => String::new(),
    };
    let (name, unit) = (&series.layer.name, quantity.after_number());
    format!("{name}{trials} from {low:.digits$} to {high:.digits$}{unit}")
}

/// Rows of a series; other quantities have their columns before and after its own.
fn write_csv(csv: &mut String, letter: char, series: &Series, [before, after]: [&str; 2]) {
    let kind = if series.model.is_some() { "model" } else { "measured" };
    let (campaign, name) = (csv_field(&series.campaign), series.name());
    for (point, trial, [low, high]) in series.points_with_limits() {
        let (Point { x, y, error }, trial) = (*point, csv_field(trial));
        let [x, y, error, low, high] = [x, y, error, low, high].map(trilink_plot::number);
        csv.push_str(&format!(
            "{letter},{campaign},{name},{kind},{trial},{x},{before}{y},{error},{low},{high}{after}\n"
        ));
    }
}
