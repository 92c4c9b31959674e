//! Figures of the fits: final objectives of the multi-start optimisation, profiles of the coefficients, and
//! coefficients of the bootstrap replicates.

use minijinja::context;
use trilink_plot::{Figure, Layer, Layout, Look, Panel, Range, Scale};
use trilink_robot::{ByParameter, Parameter};
use trilink_tables::{BootstrapRow, FitRow, ProfileRow};

use super::common::scaled;
use super::texts::texts;
use crate::looks::{self, ModelLook};
use crate::parameters::{self, FittedParameter};
use crate::series::Source;
use crate::tables::Tables;

/// Returns the figures of the optimisation starts, the profiles and the bootstrap replicates for a campaign's fits.
pub(super) fn figures(
    [starts, profiles, replicates]: [String; 3],
    campaign: &str,
    tables: &Tables,
    source: Source,
) -> [Figure; 3] {
    let links = source.links(campaign);
    let label = |parameter: Parameter| {
        let name = match source.input.is_chain(campaign) {
            true => parameters::label(parameter, &links),
            false => parameter.label().to_owned(),
        };
        format!("{name} ({})", parameter.unit())
    };
    let mut panels = [Vec::new(), Vec::new(), Vec::new()];
    for fit in tables.fits.iter().filter(|fit| fit.campaign == campaign && !fit.free.is_empty()) {
        let look = source.look(fit.model);
        panels[0].extend(waterfall(fit, tables, look));
        panels[1].extend(profile_panels(fit, tables, (look, &label)));
        panels[2].extend(replicate_panels(fit, tables, (look, &label)));
    }
    let [start_panels, profile_panels, replicate_panels] = panels;
    [
        (starts, "starts", start_panels),
        (profiles, "profiles", profile_panels),
        (replicates, "replicates", replicate_panels),
    ]
    .map(|(stem, kind, panels)| {
        Figure::new(&stem, texts(kind, context! { campaign }), &[campaign], Layout::Grid, panels)
    })
}

/// Returns the panel of the final objectives of all starts, relative to the lowest, sorted and plotted against rank;
/// `None` if fewer than two starts have a final objective, or if the lowest objective is not positive.
fn waterfall(fit: &FitRow, tables: &Tables, look: ModelLook) -> Option<Panel> {
    let ends = tables
        .starts
        .iter()
        .filter(|row| row.campaign == fit.campaign && row.model == fit.model)
        .map(|row| row.j);
    let mut ends: Vec<f64> = ends.filter(|j| j.is_finite()).collect();
    ends.sort_by(f64::total_cmp);
    let lowest = *ends.first().filter(|lowest| **lowest > 0.0)?;
    let points = (1..).map(f64::from).zip(ends.iter().map(|j| j / lowest));
    let layer = Layer::new("starts", points, look.dots(true));
    (ends.len() > 1).then(|| Panel {
        x_scale: Scale::Whole,
        y_scale: Scale::Decades,
        ..Panel::new(fit.model.name(), "Start, by rank", "J over the lowest", vec![layer])
    })
}

/// Returns the panels with the objective profiles, one for each free parameter. `label` returns the axis label of a
/// parameter.
fn profile_panels(
    fit: &FitRow,
    tables: &Tables,
    (look, label): (ModelLook, &dyn Fn(Parameter) -> String),
) -> Vec<Panel> {
    let rows: Vec<&ProfileRow> = tables
        .profiles
        .iter()
        .filter(|row| row.campaign == fit.campaign && row.model == fit.model)
        .collect();
    let panel = |held: &Parameter| {
        let of_parameter = rows.iter().filter(|row| row.parameter == *held);
        let percent = |j: f64| 100.0 * (j - fit.j) / fit.j;
        let points = of_parameter.clone().map(|row| (row.value, percent(row.j)));
        let limit_j = of_parameter.clone().next()?.limit_j;
        let parameter = FittedParameter::new(fit, *held);
        let rise = percent(limit_j);
        let band = |name, [from, to]: [f64; 2], colour| {
            Layer::new(name, [(from, f64::NAN), (to, f64::NAN)], Look::Band(colour))
        };
        let value = parameter.value;
        let scatter = fit.scatter[*held];
        let mut layers = Vec::new();
        if fit.no_interval.is_none() {
            layers.push(band("95 % interval", parameter.limits, looks::BAND));
        }
        if scatter > 0.0 {
            let interval = [value - scatter, value + scatter];
            layers.push(band("scatter", interval, looks::INNER_BAND));
        }
        layers.extend([
            Layer::new("profile", points, look.dots(true)),
            Layer::new("limit", [(f64::NAN, rise)], Look::Guides),
            Layer::new("fit", [(value, 0.0)], Look::Rings),
        ]);
        Some(Panel {
            shown: Some(Range { low: f64::NEG_INFINITY, high: 2.5 * rise }),
            x_scale: Scale::Decades,
            ..Panel::new(fit.model.name(), &label(*held), "ΔJ (% of J)", layers)
        })
    };
    fit.free.iter().filter_map(panel).collect()
}

/// Returns the panels with the bootstrap replicates, one for each pair of free parameters. `label` returns the axis
/// label of a parameter.
fn replicate_panels(
    fit: &FitRow,
    tables: &Tables,
    (look, label): (ModelLook, &dyn Fn(Parameter) -> String),
) -> Vec<Panel> {
    let rows: Vec<&BootstrapRow> = tables
        .bootstrap
        .iter()
        .filter(|row| row.campaign == fit.campaign && row.model == fit.model)
        .collect();
    let mut free = fit.free.clone();
    free.sort();
    let pairs = free.iter().enumerate().flat_map(|(n, x)| free[n + 1..].iter().map(|y| (*x, *y)));
    pairs
        .filter(|_| !rows.is_empty())
        .map(|(x, y)| {
            let point = |of: &ByParameter<f64>| (of[x], of[y]);
            let points = rows.iter().map(|row| point(&row.parameters));
            let layers = vec![
                Layer::new("replicates", points, look.dots(false)),
                Layer::new("fit", [point(&fit.parameters)], Look::Rings),
            ];
            scaled(Scale::Decades, Panel::new(fit.model.name(), &label(x), label(y), layers))
        })
        .collect()
}
