//! How the searches ended, how the objective depends on each coefficient, and how the
//! coefficients of the bootstrap's replicates go together.

use crate::report::axis::Range;
use crate::report::chart::{Axes, Chart, Layer, Layout};
use crate::report::figure::Figure;
use crate::report::parameters;
use crate::report::style;
use crate::report::tables::Tables;
use crate::robot::Parameter;
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
    let figure = |kind: &str, title: &str, caption: &str, charts: Vec<Chart>| Figure {
        stem: format!("{stem}-{kind}"),
        number: String::new(),
        title: format!("{title} of campaign {campaign}"),
        caption: caption.to_owned(),
        campaigns: vec![campaign.to_owned()],
        panels: Vec::new(),
        charts,
        layout: Layout::Grid,
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

fn waterfall(fit: &FitRow, tables: &Tables) -> Option<Chart> {
    let of_fit = |row: &&crate::store::StartRow| {
        row.campaign == fit.campaign && row.model == fit.model && row.j.is_finite()
    };
    let mut ends: Vec<f64> = tables.starts.iter().filter(of_fit).map(|row| row.j).collect();
    ends.sort_by(f64::total_cmp);
    let points: Vec<(f64, f64)> =
        ends.into_iter().enumerate().map(|(i, j)| ((i + 1) as f64, j)).collect();
    (points.len() > 1).then(|| Chart {
        title: fit.model.clone(),
        x_label: "Start, by rank".to_owned(),
        y_label: "J".to_owned(),
        layers: vec![Layer::Line { name: "starts".to_owned(), points, colour: colour(fit) }],
        axes: Axes::LinearAcross,
        ..Chart::default()
    })
}

fn profiles(fit: &FitRow, tables: &Tables) -> Vec<Chart> {
    let of_fit = |row: &&ProfileRow| row.campaign == fit.campaign && row.model == fit.model;
    let rows: Vec<&ProfileRow> = tables.profiles.iter().filter(of_fit).collect();
    let chart = |name: &String| {
        let of_parameter = rows.iter().filter(|row| row.parameter == *name);
        let points: Vec<(f64, f64)> = of_parameter.clone().map(|row| (row.value, row.j)).collect();
        let limit_j = of_parameter.clone().next()?.limit_j;
        let known = Parameter::of_column(name)?;
        let parameter = parameters::of_fit(fit)[known as usize];
        let [from, to] = parameter.limits.map(|limit| Some(limit).filter(|x| x.is_finite()));
        let rise = limit_j - fit.j;
        Some(Chart {
            title: fit.model.clone(),
            x_label: label(known),
            y_label: "J".to_owned(),
            layers: vec![
                Layer::Band { name: "95 % interval".to_owned(), from, to },
                Layer::Line { name: "profile".to_owned(), points, colour: colour(fit) },
                Layer::Level { name: "limit".to_owned(), y: limit_j },
                Layer::Mark { name: "fit".to_owned(), point: (parameter.value, fit.j) },
            ],
            shown: Some(Range { low: f64::NEG_INFINITY, high: fit.j + 2.5 * rise }),
            ..Chart::default()
        })
    };
    fit.free.iter().filter_map(chart).collect()
}

fn replicates(fit: &FitRow, tables: &Tables) -> Vec<Chart> {
    let of_fit = |row: &&BootstrapRow| row.campaign == fit.campaign && row.model == fit.model;
    let rows: Vec<[f64; 9]> =
        tables.bootstrap.iter().filter(of_fit).map(|row| row.parameters()).collect();
    let free: Vec<Parameter> = Parameter::ALL
        .into_iter()
        .filter(|parameter| fit.free.iter().any(|name| name == parameter.column()))
        .collect();
    let mut charts = Vec::new();
    for (n, &x) in free.iter().enumerate() {
        for &y in &free[n + 1..] {
            let points: Vec<(f64, f64)> =
                rows.iter().map(|row| (row[x as usize], row[y as usize])).collect();
            if points.is_empty() {
                continue;
            }
            let fitted = fit.parameters();
            charts.push(Chart {
                title: fit.model.clone(),
                x_label: label(x),
                y_label: label(y),
                layers: vec![
                    Layer::Dots { name: "replicates".to_owned(), points, colour: colour(fit) },
                    Layer::Mark {
                        name: "fit".to_owned(),
                        point: (fitted[x as usize], fitted[y as usize]),
                    },
                ],
                ..Chart::default()
            });
        }
    }
    charts
}

fn colour(fit: &FitRow) -> plotters::style::RGBColor {
    style::model(&fit.model).colour()
}

/// A parameter as an axis names it.
fn label(parameter: Parameter) -> String {
    format!("{} ({})", parameter.label(), parameter.unit())
}
