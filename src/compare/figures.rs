//! Curves of two runs over each other, where they differ.

use std::collections::BTreeSet;

use super::snapshot::{Cell, Records, Snapshot};
use super::{Compared, Difference, Verdict};
use crate::report::{Axes, Chart, Figure, Layer, colours};

const QUANTITIES: [(&str, &str); 7] = [
    ("d_m", "d (m)"),
    ("v_m_s", "v (m/s)"),
    ("sigma0", "sigma 0"),
    ("sigma1", "sigma 1"),
    ("sigma2", "sigma 2"),
    ("alpha1_rad", "alpha 1 (rad)"),
    ("dtheta_rad", "rotation (rad)"),
];
/// Quantities that a model's prediction is drawn by if one of its parameters differs.
const OF_MODELS: [&str; 4] = ["d_m", "sigma0", "sigma1", "sigma2"];

/// A figure for each campaign's trials, and for each model, that has something out of tolerance.
pub fn figures(compared: &Compared, baseline: &Snapshot, tonight: &Snapshot) -> Vec<Figure> {
    let mut figures = Vec::new();
    let trials = [baseline.records("trials"), tonight.records("trials")];
    let predictions = [baseline.records("predictions"), tonight.records("predictions")];
    for campaign in campaigns(trials) {
        let differs = |difference: &&Difference| {
            difference.table == "campaigns" && difference.of == campaign
                || difference.table == "trials"
                    && trials.iter().any(|records| is_of(records, &difference.of, &campaign, None))
        };
        let names = columns(compared, &differs);
        let charts = charts(&names, trials, &campaign, None, "omega_commanded_rad_s");
        figures.extend(figure(format!("Trials of {campaign}"), &campaign, charts));
        for model in models(predictions, &campaign) {
            let of_model = |difference: &&Difference| match difference.table {
                "fits" => difference.of == format!("{campaign} {model}"),
                "predictions" => predictions
                    .iter()
                    .any(|records| is_of(records, &difference.of, &campaign, Some(&model))),
                _ => false,
            };
            let mut names = columns(compared, &of_model);
            let has_fit = compared
                .out()
                .any(|difference| difference.table == "fits" && of_model(&difference));
            if has_fit {
                names.extend(OF_MODELS);
            }
            let charts = charts_of(&names, predictions, &campaign, &model);
            figures.extend(figure(format!("Model {model} of {campaign}"), &campaign, charts));
        }
    }
    figures
}

fn charts_of(
    names: &BTreeSet<&'static str>,
    runs: [&Records; 2],
    campaign: &str,
    model: &str,
) -> Vec<Chart> {
    charts(names, runs, campaign, Some(model), "omega_rad_s")
}

/// Quantities that are out of tolerance in one of some differences.
fn columns(compared: &Compared, of: &dyn Fn(&&Difference) -> bool) -> BTreeSet<&'static str> {
    let out = compared.differences.iter().filter(|d| d.verdict == Verdict::Out).filter(of);
    let names: BTreeSet<&str> =
        out.map(|difference| difference.column.trim_end_matches("_debiased")).collect();
    QUANTITIES.iter().map(|(name, _)| *name).filter(|name| names.contains(name)).collect()
}

fn charts(
    names: &BTreeSet<&'static str>,
    runs: [&Records; 2],
    campaign: &str,
    model: Option<&str>,
    omega: &str,
) -> Vec<Chart> {
    let chart = |(name, label): &(&'static str, &'static str)| {
        let curve = |records: &Records| {
            let of_model = records.values().filter(|record| {
                text(record.get("campaign")) == Some(campaign)
                    && (model.is_none() || text(record.get("model")) == model)
            });
            let point = |record: &super::Record| {
                Some((record.get(omega)?.number()?, record.get(*name)?.number()?))
            };
            let mut points: Vec<(f64, f64)> = of_model.filter_map(point).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            points
        };
        let [then, now] = runs.map(curve);
        Chart {
            title: (*label).to_owned(),
            x_label: "omega (rad/s)".to_owned(),
            y_label: (*label).to_owned(),
            layers: vec![
                Layer::Line {
                    name: "baseline".to_owned(),
                    points: then,
                    colour: colours::BASELINE,
                },
                Layer::Line { name: "tonight".to_owned(), points: now, colour: colours::TONIGHT },
            ],
            axes: Axes::LinearAcross,
            ..Chart::default()
        }
    };
    QUANTITIES.iter().filter(|(name, _)| names.contains(name)).map(chart).collect()
}

fn figure(title: String, campaign: &str, charts: Vec<Chart>) -> Option<Figure> {
    let figure = Figure {
        caption: "Grey: baseline. Orange: tonight.".to_owned(),
        ..Figure::of_charts("", title, &[campaign], charts)
    };
    (!figure.is_empty()).then_some(figure)
}

fn campaigns(runs: [&Records; 2]) -> BTreeSet<String> {
    let names = runs.into_iter().flat_map(|records| records.values());
    let names = names.filter_map(|record| text(record.get("campaign")).map(str::to_owned));
    names.filter(|name| !name.is_empty()).collect()
}

fn models(runs: [&Records; 2], campaign: &str) -> BTreeSet<String> {
    let records = runs.into_iter().flat_map(|records| records.values());
    let of_campaign = records.filter(|record| text(record.get("campaign")) == Some(campaign));
    of_campaign.filter_map(|record| text(record.get("model")).map(str::to_owned)).collect()
}

fn is_of(records: &Records, of: &str, campaign: &str, model: Option<&str>) -> bool {
    records.get(of).is_some_and(|record| {
        text(record.get("campaign")) == Some(campaign)
            && (model.is_none() || text(record.get("model")) == model)
    })
}

fn text(cell: Option<&Cell>) -> Option<&str> {
    match cell {
        Some(Cell::Text(text)) => Some(text),
        _ => None,
    }
}
