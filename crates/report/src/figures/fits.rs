//! How the searches ended, how the objective depends on each coefficient, and how the
//! coefficients of the bootstrap's replicates go together.

use minijinja::context;
use trilink_plot::{Figure, Layer, Layout, Look, Panel, Range, Scale};
use trilink_robot::{ByParameter, Parameter};
use trilink_tables::{BootstrapRow, FitRow, ProfileRow, StartRow};

use super::common::scaled;
use super::texts::texts;
use crate::looks::{self, ModelLook};
use crate::parameters::FittedParameter;
use crate::series::Source;
use crate::tables::Tables;

/// The figures of a campaign's fits.
pub(super) fn figures(
    [starts, profiles, replicates]: [String; 3],
    campaign: &str,
    tables: &Tables,
    source: Source,
) -> [Figure; 3] {
    let of_campaign = tables.fits.iter().filter(|fit| fit.campaign == campaign);
    let fits = || of_campaign.clone().filter(|fit| !fit.free.is_empty());
    let figure = |stem: &str, kind: &str, panels: Vec<Panel>| {
        Figure::new(stem, texts(kind, context! { campaign }), &[campaign], Layout::Grid, panels)
    };
    let look = |fit: &FitRow| source.look(fit.model);
    [
        figure(
            &starts,
            "starts",
            fits().filter_map(|fit| waterfall(fit, tables, look(fit))).collect(),
        ),
        figure(
            &profiles,
            "profiles",
            fits().flat_map(|fit| self::profiles(fit, tables, look(fit))).collect(),
        ),
        figure(
            &replicates,
            "replicates",
            fits().flat_map(|fit| self::replicates(fit, tables, look(fit))).collect(),
        ),
    ]
}

fn waterfall(fit: &FitRow, tables: &Tables, look: ModelLook) -> Option<Panel> {
    let of_fit = |row: &&StartRow| row.campaign == fit.campaign && row.model == fit.model;
    let ends = tables.starts.iter().filter(of_fit).map(|row| row.j);
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

fn profiles(fit: &FitRow, tables: &Tables, look: ModelLook) -> Vec<Panel> {
    let of_fit = |row: &&ProfileRow| row.campaign == fit.campaign && row.model == fit.model;
    let rows: Vec<&ProfileRow> = tables.profiles.iter().filter(of_fit).collect();
    let panel = |held: &Parameter| {
        let of_parameter = rows.iter().filter(|row| row.parameter == *held);
        let percent = |j: f64| 100.0 * (j - fit.j) / fit.j;
        let points = of_parameter.clone().map(|row| (row.value, percent(row.j)));
        let limit_j = of_parameter.clone().next()?.limit_j;
        let parameter = FittedParameter::of(fit, *held);
        let rise = percent(limit_j);
        let band = |name, [from, to]: [f64; 2], colour| {
            Layer::new(name, [(from, f64::NAN), (to, f64::NAN)], Look::Band(colour))
        };
        let (value, scatter) = (parameter.value, fit.scatter[*held]);
        let mut layers = Vec::new();
        if fit.no_interval.is_none() {
            layers.push(band("95 % interval", parameter.limits, looks::BAND));
        }
        if scatter > 0.0 {
            let part = [value - scatter, value + scatter];
            layers.push(band("scatter", part, looks::INNER_BAND));
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

fn replicates(fit: &FitRow, tables: &Tables, look: ModelLook) -> Vec<Panel> {
    let of_fit = |row: &&BootstrapRow| row.campaign == fit.campaign && row.model == fit.model;
    let rows: Vec<&BootstrapRow> = tables.bootstrap.iter().filter(of_fit).collect();
    let mut free = fit.free.clone();
    free.sort();
    let panel = |(x, y): (Parameter, Parameter)| {
        let point = |of: &ByParameter<f64>| (of[x], of[y]);
        let points = rows.iter().map(|row| point(&row.parameters));
        let layers = vec![
            Layer::new("replicates", points, look.dots(false)),
            Layer::new("fit", [point(&fit.parameters)], Look::Rings),
        ];
        scaled(Scale::Decades, Panel::new(fit.model.name(), &label(x), label(y), layers))
    };
    let pairs = free.iter().enumerate().flat_map(|(n, x)| free[n + 1..].iter().map(|y| (*x, *y)));
    pairs.filter(|_| !rows.is_empty()).map(panel).collect()
}

fn label(parameter: Parameter) -> String {
    format!("{} ({})", parameter.label(), parameter.unit())
}
