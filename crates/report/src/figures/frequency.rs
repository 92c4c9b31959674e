//! Figures of measurements and models against frequency (Figs. 10, 13 and 15 to 20 of the paper).

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

/// Explanation of the markers and error bars, for captions.
pub(crate) const BARS: &str = "Markers: means over the used cycles of each trial, open for flagged \
                               trials; repeats at one frequency are drawn beside each other (if there are \
                               many trials, overlapping markers are omitted); bars: 95 % intervals \
                               (1.96 standard errors), if longer than the marker.";
/// Upper limit of a panel's linear vertical axis, as a multiple of the highest measurement. If a model curve rises
/// higher, the axis is logarithmic, because the curve would flatten the measurements.
const MAX_HEIGHT: f64 = 2.2;
/// Limits of a panel's logarithmic vertical axis, as multiples of the lowest and of the highest measurement.
const LOGARITHMIC: [f64; 2] = [0.5, 30.0];

/// Quantity with its measured and predicted series against frequency.
pub(crate) type Plot = (Quantity, Vec<Series>);

/// Returns the figure of a campaign's measured displacement and speed (Figs. 10, 13 and 15 of the paper).
pub(crate) fn measured(stem: &str, campaign: &str, source: Source<'_>) -> Figure {
    let texts = texts("measured", context! { campaign, bars => BARS });
    let plots = [DISPLACEMENT, SPEED]
        .map(|quantity| -> Plot { (quantity, source.measured(campaign, &quantity, 0)) });
    figure(stem, texts, &[campaign], &plots)
}

/// Returns the figure that compares a campaign's measured displacement with the prediction by `model` (if given), for
/// the top of the report page.
pub(crate) fn overview(campaign: &str, model: Option<Model>, source: Source<'_>) -> Figure {
    let model = model.and_then(|model| source.model(campaign, model, &DISPLACEMENT, 0));
    let series = source.measured(campaign, &DISPLACEMENT, 0).into_iter().chain(model).collect();
    let title = format!("Displacement d of campaign {campaign}");
    figure("overview", [title, String::new()], &[campaign], &[(DISPLACEMENT, series)])
}

/// Returns the figure that compares a campaign's measured displacement and speed with the predictions by all models
/// (Figs. 16 to 18 of the paper).
pub(crate) fn models(stem: &str, campaign: &str, source: Source<'_>) -> Figure {
    let models = source.models(campaign);
    let plots = [DISPLACEMENT, SPEED].map(|quantity| -> Plot {
        let measured = source.measured(campaign, &quantity, 0);
        (
            quantity,
            measured
                .into_iter()
                .chain(
                    models.iter().filter_map(|model| source.model(campaign, *model, &quantity, 0)),
                )
                .collect(),
        )
    });
    let (input, of_trials) = drivers(&plots, source);
    let values = context! { campaign, bars => BARS, input, of_trials };
    figure(stem, texts("models", values), &[campaign], &plots)
}

/// Returns the gait input of the plotted models in words (such as `measured gait`), and the names of the models that
/// always use the measured gait of each trial, whatever gait input is configured. The words are empty if no other model
/// has a prediction curve.
pub(crate) fn drivers(plots: &[Plot], source: Source<'_>) -> (String, Vec<&'static str>) {
    let series = plots.iter().flat_map(|(_, series)| series);
    let drawn = series.filter_map(|of| Some((of.campaign.as_str(), of.model?)));
    let drawn: BTreeSet<(&str, Model)> = drawn.collect();
    let of_trials = drawn.iter().map(|(_, model)| *model).filter(|of| source.is_of_trials(*of));
    let of_trials: BTreeSet<&str> = of_trials.map(Model::name).collect();
    (source.gait_input(drawn), of_trials.into_iter().collect())
}

/// Returns the figure of the wheels' skid ratios (Figs. 19 and 20 of the paper). For a single campaign, all its models
/// with skid are shown; for several campaigns, each is shown with its preferred model with skid.
pub(crate) fn skid(stem: &str, campaigns: &[&str], source: Source<'_>) -> Figure {
    let has_several = campaigns.len() > 1;
    let models = |campaign: &str| -> Vec<Model> {
        if has_several {
            source.preferred_with_skid(campaign).into_iter().collect()
        } else {
            source.models(campaign).into_iter().filter(|of| source.skids(*of)).collect()
        }
    };
    let models: Vec<Vec<Model>> = campaigns.iter().map(|campaign| models(campaign)).collect();
    let links = campaigns.first().map_or(Vec::new(), |campaign| source.links(campaign));
    let quantities = Metric::SIGMA.map(|metric| Quantity::of_links(metric, &links)).into_iter();
    let plots = quantities.map(|quantity| -> Plot {
        let mut series: Vec<Series> = campaigns
            .iter()
            .enumerate()
            .flat_map(|(nth, campaign)| {
                let measured = source.measured(campaign, &quantity, nth).into_iter();
                measured
                    .chain(
                        models[nth]
                            .iter()
                            .filter_map(|model| source.model(campaign, *model, &quantity, nth)),
                    )
                    .collect::<Vec<_>>()
            })
            .collect();
        for Series { campaign, layer, .. } in series.iter_mut().filter(|_| has_several) {
            layer.name = format!("{campaign}, {}", layer.name);
        }
        (quantity, series)
    });
    let has_points = |series: &[Series]| series.iter().any(|of| of.points().next().is_some());
    let plots: Vec<Plot> = plots
        .enumerate()
        .filter(|(wheel, (_, series))| {
            let is_always_shown = *wheel < links.len().min(3)
                && campaigns.iter().any(|campaign| source.input.has_wheel(campaign, *wheel));
            is_always_shown || has_points(series)
        })
        .map(|(_, plot)| plot)
        .collect();
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

/// Returns a figure with one panel per quantity. `texts` are the title and the caption.
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

/// Returns the panel for a quantity. The range of the vertical axis is limited so that the measurements remain
/// readable.
fn panel((quantity, series): &Plot) -> Panel {
    // Measurements are drawn on top of models.
    let (measured, modelled): (Vec<&Series>, Vec<_>) =
        series.iter().partition(|series| series.model.is_none());
    let bars = measured.iter().flat_map(|series| series.points());
    let bars = bars.flat_map(|point| [-1.0, 1.0].map(|side| point.y + side * point.error.max(0.0)));
    let range = Range::enclosing(bars).filter(|range| range.high > 0.0);
    let lowest = range.map(|range| range.low).filter(|lowest| *lowest > 0.0);
    let curves = modelled.iter().flat_map(|series| series.points());
    let is_flattened = Range::enclosing(curves.map(|point| point.y))
        .zip(range)
        .is_some_and(|(curves, range)| curves.high > MAX_HEIGHT * range.high);
    let shown = match (range, lowest.filter(|_| is_flattened)) {
        (Some(Range { high, .. }), Some(low)) => {
            Some(Range { low: LOGARITHMIC[0] * low, high: LOGARITHMIC[1] * high })
        }
        (Some(Range { high, .. }), None) => {
            Some(Range { low: f64::NEG_INFINITY, high: MAX_HEIGHT * high })
        }
        (None, _) => None,
    };
    let ceiling = shown.map(|shown| shown.high);
    // Note that a series extends above the panel.
    let beyond = |series: &&Series| {
        let above = series.points().map(|point| point.y).filter(|value| Some(*value) > ceiling);
        let highest = ceiling.and(above.reduce(f64::max))?;
        let digits = usize::from(highest < 100.0) + 2 * usize::from(highest < 1.0);
        let name = &series.layer.name;
        let unit = quantity.after_number();
        Some(format!(
            "{name} off the scale, up to {}{unit}",
            trilink_base::numbers::fixed(highest, digits)
        ))
    };
    let beyond: Vec<String> = modelled.iter().filter_map(beyond).collect();
    let layers = modelled.into_iter().chain(measured).map(|series| series.layer.clone());
    Panel {
        y_scale: match quantity.metric {
            _ if is_flattened && lowest.is_some() => Scale::Decades,
            Metric::D => Scale::Linear,
            _ => Scale::FromZero,
        },
        shown,
        beyond: match beyond.as_slice() {
            [] => String::new(),
            [one] => one.clone(),
            several => format!("{} models off the scale", several.len()),
        },
        ..Panel::new(quantity.title, FREQUENCY, quantity.axis_label(), layers.collect())
    }
}

/// Describes the range of a series for the text alternative (`alt` text) of the figure.
fn extent(quantity: &Quantity, series: &Series) -> String {
    let Range { low, high } = Range::enclosing(series.points().map(|point| point.y))
        .unwrap_or(Range { low: f64::NAN, high: f64::NAN });
    let digits = if quantity.is_skid() { 4 } else { 1 };
    let trials = match series.model {
        None => format!(" ({} trials)", series.points().count()),
        Some(_) => String::new(),
    };
    let name = &series.layer.name;
    let unit = quantity.after_number();
    format!("{name}{trials} ranges from {low:.digits$} to {high:.digits$}{unit}")
}

/// Writes the CSV rows of a series; `before` and `after` are the empty columns of the quantities that precede and
/// follow that of the series.
fn write_csv(csv: &mut String, letter: char, series: &Series, [before, after]: [&str; 2]) {
    let kind = if series.model.is_some() { "model" } else { "measured" };
    let campaign = csv_field(&series.campaign);
    let name = series.name();
    for (point, trial, [low, high]) in series.points_with_limits() {
        let (Point { x, y, error }, trial) = (*point, csv_field(trial));
        let [x, y, error, low, high] = [x, y, error, low, high].map(trilink_plot::number);
        csv.push_str(&format!(
            "{letter},{campaign},{name},{kind},{trial},{x},{before}{y},{error},{low},{high}{after}\n"
        ));
    }
}
