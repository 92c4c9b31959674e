//! How the searches ended, how the objective depends on each coefficient, and how the
//! coefficients of the bootstrap's replicates go together.

use crate::report::drawing::{Figure, Layer, Look, Panel, Range, Scale};
use crate::report::looks;
use crate::report::parameters::FittedParameter;
use crate::report::tables::Tables;
use crate::robot::{ByParameter, Parameter};
use crate::store::{BootstrapRow, FitRow, ProfileRow};

const KINDS: [&str; 3] = ["starts", "profiles", "replicates"];

/// Names that the files of the figures can have.
pub fn stems(stem: &str) -> [String; 3] {
    KINDS.map(|kind| format!("{stem}-{kind}"))
}

/// The figures of a campaign's fits; those without anything to show are left out.
pub fn figures(stem: &str, campaign: &str, tables: &Tables) -> Vec<Figure> {
    let fits: Vec<&FitRow> =
        tables.fits.iter().filter(|fit| fit.campaign == campaign && !fit.free.is_empty()).collect();
    let figure = |kind: &str, title: &str, caption: &str, panels: Vec<Panel>| Figure {
        caption: caption.to_owned(),
        ..Figure::new(
            &format!("{stem}-{kind}"),
            format!("{title} of campaign {campaign}"),
            &[campaign],
            panels,
        )
    };
    let starts = fits.iter().filter_map(|fit| waterfall(fit, tables)).collect();
    let profiles = fits.iter().flat_map(|fit| profiles(fit, tables)).collect();
    let replicates = fits.iter().flat_map(|fit| replicates(fit, tables)).collect();
    let all = [
        figure(
            KINDS[0],
            "Searches",
            "Objective J where each start of a fit ended, the lowest first.",
            starts,
        ),
        figure(
            KINDS[1],
            "Profiles",
            "Objective J with one coefficient held and the others fitted. Open circle: the fit. \
             Dashed: the limit that resampled measurements give. Shaded: the 95 % interval; where \
             it goes on to the panel's side it is open.",
            profiles,
        ),
        figure(
            KINDS[2],
            "Bootstrap",
            "Pairs of coefficients fitted to resampled measurements. Open circle: the fit.",
            replicates,
        ),
    ];
    all.into_iter().filter(|figure| !figure.is_empty()).collect()
}

fn waterfall(fit: &FitRow, tables: &Tables) -> Option<Panel> {
    let of_fit = |row: &&crate::store::StartRow| {
        row.campaign == fit.campaign && row.model == fit.model && row.j.is_finite()
    };
    let mut ends: Vec<f64> = tables.starts.iter().filter(of_fit).map(|row| row.j).collect();
    ends.sort_by(f64::total_cmp);
    let points = (1..).map(f64::from).zip(ends.iter().copied());
    let layer = Layer::new("starts", points, Look::Dotted(colour(fit)));
    (ends.len() > 1).then(|| Panel {
        y_scale: Scale::Decades,
        ..Panel::new(fit.model.name(), "Start, by rank", "J", vec![layer])
    })
}

fn profiles(fit: &FitRow, tables: &Tables) -> Vec<Panel> {
    let of_fit = |row: &&ProfileRow| row.campaign == fit.campaign && row.model == fit.model;
    let rows: Vec<&ProfileRow> = tables.profiles.iter().filter(of_fit).collect();
    let panel = |held: &Parameter| {
        let of_parameter = rows.iter().filter(|row| row.parameter == *held);
        let points = of_parameter.clone().map(|row| (row.value, row.j));
        let limit_j = of_parameter.clone().next()?.limit_j;
        let parameter = FittedParameter::of(fit, *held);
        let [from, to] = parameter.limits;
        let rise = limit_j - fit.j;
        let layers = vec![
            Layer::new("95 % interval", [(from, f64::NAN), (to, f64::NAN)], Look::Band),
            Layer::new("profile", points, Look::Dotted(colour(fit))),
            Layer::new("limit", [(f64::NAN, limit_j)], Look::Guides),
            Layer::new("fit", [(parameter.value, fit.j)], Look::Rings),
        ];
        Some(Panel {
            shown: Some(Range { low: f64::NEG_INFINITY, high: fit.j + 2.5 * rise }),
            ..decades(fit, &label(*held), "J", layers)
        })
    };
    fit.free.iter().filter_map(panel).collect()
}

fn replicates(fit: &FitRow, tables: &Tables) -> Vec<Panel> {
    let of_fit = |row: &&BootstrapRow| row.campaign == fit.campaign && row.model == fit.model;
    let rows: Vec<&BootstrapRow> = tables.bootstrap.iter().filter(of_fit).collect();
    let mut free = fit.free.clone();
    free.sort();
    let mut panels = Vec::new();
    for (n, &x) in free.iter().enumerate() {
        for &y in &free[n + 1..] {
            let point = |of: &ByParameter<f64>| (of[x], of[y]);
            let points: Vec<(f64, f64)> = rows.iter().map(|row| point(&row.parameters)).collect();
            if points.is_empty() {
                continue;
            }
            let layers = vec![
                Layer::new("replicates", points, Look::Dots(colour(fit))),
                Layer::new("fit", [point(&fit.parameters)], Look::Rings),
            ];
            panels.push(decades(fit, &label(x), label(y), layers));
        }
    }
    panels
}

fn decades(fit: &FitRow, x_label: &str, y_label: impl Into<String>, layers: Vec<Layer>) -> Panel {
    Panel {
        x_scale: Scale::Decades,
        y_scale: Scale::Decades,
        ..Panel::new(fit.model.name(), x_label, y_label, layers)
    }
}

fn colour(fit: &FitRow) -> plotters::style::RGBColor {
    looks::model(fit.model).colour()
}

/// A parameter as an axis names it.
fn label(parameter: Parameter) -> String {
    format!("{} ({})", parameter.label(), parameter.unit())
}
