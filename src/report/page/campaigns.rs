//! What the page says of every campaign: its figures, its fits and which of them the data prefer.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{Drawn, FigureView, views};
use crate::report::ReportInput;
use crate::report::drawing::style;
use crate::report::figures;
use crate::report::numbers::{NONE, fixed, significant};
use crate::report::parameters::{self, Parameter};
use crate::report::tables::Tables;
use crate::store::{ComparisonRow, FitRow};

#[derive(Serialize)]
pub struct CampaignSection<'p> {
    name: &'p str,
    robot: Option<&'p str>,
    gait: Option<&'p str>,
    trials: usize,
    figures: Vec<FigureView<'p>>,
    fits: Vec<FitView<'p>>,
    /// Whether a model of it has a passive joint.
    passive: bool,
    /// Which model the measurements prefer.
    best: Option<&'p str>,
    comparison: Vec<ComparisonView<'p>>,
    /// Fits with the other gait input, and which that is.
    otherwise: Option<Otherwise<'p>>,
    notes: Vec<String>,
}

#[derive(Serialize)]
struct FitView<'p> {
    model: &'p str,
    j: String,
    skid: Vec<ParameterView>,
    roll: Vec<ParameterView>,
    joint: Vec<ParameterView>,
    starts: i64,
    solves: i64,
    status: &'p str,
}

#[derive(Serialize)]
struct ComparisonView<'p> {
    model: &'p str,
    j: String,
    /// Of d, v, sigma, alpha.
    parts: [String; 4],
    left_out: String,
    free: i64,
    criterion: String,
    wins: String,
}

#[derive(Serialize)]
struct Otherwise<'p> {
    gait_input: &'p str,
    rows: Vec<OtherwiseRow<'p>>,
}

#[derive(Serialize)]
struct OtherwiseRow<'p> {
    model: &'p str,
    j: String,
    other_j: String,
    /// Of the wheels; as the other input gives them.
    skid: [String; 3],
}

#[derive(Serialize)]
struct ParameterView {
    value: String,
    free: bool,
    /// 95 % confidence interval.
    interval: String,
    marks: Vec<&'static str>,
}

/// Sections in the paper's order, then by name; without those that have nothing to say.
pub fn sections<'p>(
    config: &'p ReportInput,
    tables: &'p Tables,
    drawn: &'p [Drawn<'_>],
) -> Vec<CampaignSection<'p>> {
    let mut names: Vec<&str> = tables.campaigns(config).into_iter().collect();
    names.sort_by_key(|name| figures::rank(name));
    let section = |name: &'p str| {
        let fits: Vec<&FitRow> = tables.fits.iter().filter(|fit| fit.campaign == name).collect();
        let setup = config.campaign.get(name);
        let of_campaign = tables.comparison.iter().filter(|row| row.campaign == name);
        let compared: Vec<&ComparisonRow> = of_campaign.collect();
        CampaignSection {
            name,
            robot: setup.map(|campaign| campaign.robot.as_str()),
            gait: setup.map(|campaign| campaign.gait.as_str()),
            trials: tables.trials.iter().filter(|row| row.campaign == name).count(),
            figures: views(drawn, |figure| {
                figure.campaigns == [name] && figure.stem != figures::TRUTH
            }),
            passive: fits.iter().any(|fit| fit.damping_nm_s_rad.is_finite()),
            best: compared.first().map(|row| row.sentence.as_str()),
            comparison: compared.iter().map(|row| comparison_view(row)).collect(),
            otherwise: otherwise(&compared),
            notes: remarks(tables, name),
            fits: fits.into_iter().map(fit_view).collect(),
        }
    };
    let sections = names.into_iter().map(section);
    sections.filter(|s| s.trials > 0 || !s.fits.is_empty() || !s.figures.is_empty()).collect()
}

/// What is to be said of a campaign's predictions: those that the figures leave out, and those
/// that the robot does not get into from rest.
fn remarks(tables: &Tables, campaign: &str) -> Vec<String> {
    let mut remarks = not_drawn(tables, campaign);
    let mut counts: BTreeMap<(usize, &str, &str), usize> = BTreeMap::new();
    for row in tables.predictions.iter().filter(|row| row.campaign == campaign) {
        if matches!(row.from_rest.as_str(), "another" | "unsettled") {
            let rank = style::model_rank(&row.model);
            *counts.entry((rank, &row.model, &row.from_rest)).or_default() += 1;
        }
    }
    remarks.extend(counts.iter().map(|((_, model, from_rest), count)| {
        let goes = match *from_rest {
            "another" => "gets into another motion than the one that is shown",
            _ => "does not settle",
        };
        let at = if *count == 1 { "frequency" } else { "frequencies" };
        format!("{model}: at {count} {at} of the trials the robot that starts from rest {goes}.")
    }));
    remarks
}

/// Predictions that the figures leave out, by model and reason.
fn not_drawn(tables: &Tables, campaign: &str) -> Vec<String> {
    let mut counts: BTreeMap<(usize, &str, &str, &str), usize> = BTreeMap::new();
    for row in tables.predictions.iter().filter(|row| row.campaign == campaign) {
        let rank = style::model_rank(&row.model);
        *counts.entry((rank, &row.model, &row.source, &row.status)).or_default() += 1;
    }
    let total = |model: &str, source: &str| -> usize {
        let of = counts.iter().filter(|(key, _)| key.1 == model && key.2 == source);
        of.map(|(_, count)| count).sum()
    };
    counts
        .iter()
        .filter(|((_, _, _, status), _)| *status != "stable")
        .map(|((_, model, source, status), count)| {
            let total = total(model, source);
            let at = if *source == "trial" { "the trials' frequencies" } else { "the curve" };
            format!("{model}: {count} of {total} points of {at} are not drawn, status {status}.")
        })
        .collect()
}

fn fit_view(fit: &FitRow) -> FitView<'_> {
    let view = |parameter: &Parameter| ParameterView {
        value: parameter.text(),
        free: parameter.free,
        interval: parameter.interval(),
        marks: parameter.marks(),
    };
    let parameters = parameters::of_fit(fit).map(|parameter| view(&parameter));
    let mut parameters = parameters.into_iter();
    FitView {
        model: &fit.model,
        j: significant(fit.j, 4),
        skid: parameters.by_ref().take(3).collect(),
        roll: parameters.by_ref().take(3).collect(),
        // The sum of the roll coefficients is not shown.
        joint: parameters.skip(1).collect(),
        starts: fit.starts,
        solves: fit.solves,
        status: &fit.status,
    }
}

fn comparison_view(row: &ComparisonRow) -> ComparisonView<'_> {
    let wins = fixed(100.0 * row.wins, 1);
    ComparisonView {
        model: &row.model,
        j: significant(row.j, 4),
        parts: [row.j_d, row.j_v, row.j_sigma, row.j_alpha].map(|part| significant(part, 3)),
        left_out: significant(row.j_left_out, 4),
        free: row.free,
        criterion: fixed(row.criterion, 1),
        wins: if wins == NONE { wins } else { format!("{wins} %") },
    }
}

/// What the other gait input than the configured one gives.
fn otherwise<'p>(rows: &[&'p ComparisonRow]) -> Option<Otherwise<'p>> {
    let with = |row: &&&ComparisonRow| row.other_gait_j.is_finite();
    let gait_input = rows.iter().find(with)?.other_gait_input.as_str();
    let view = |row: &&'p ComparisonRow| OtherwiseRow {
        model: &row.model,
        j: significant(row.j, 4),
        other_j: significant(row.other_gait_j, 4),
        skid: [row.other_gait_skid0_kg_s, row.other_gait_skid1_kg_s, row.other_gait_skid2_kg_s]
            .map(|skid| significant(skid, 4)),
    };
    Some(Otherwise { gait_input, rows: rows.iter().filter(with).map(view).collect() })
}
