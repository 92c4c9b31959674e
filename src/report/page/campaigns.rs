//! What the page says of every campaign: its figures, its fits and which of them the data prefer.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{Drawn, FigureView, views};
use crate::config::GaitInput;
use crate::motion::{FromRest, Model, MotionStatus};
use crate::report::ReportInput;
use crate::report::figures;
use crate::report::numbers::{NONE, fixed, significant};
use crate::report::parameters::FittedParameter;
use crate::report::tables::Tables;
use crate::robot::Parameter;
use crate::store::{ComparisonRow, FitRow, FitStatus, PredictionSource};

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
    comparison: Vec<ComparisonView>,
    /// Fits with the other gait input, and which that is.
    otherwise: Option<Otherwise>,
    notes: Vec<String>,
}

#[derive(Serialize)]
struct FitView<'p> {
    model: Model,
    j: String,
    skid: Vec<ParameterView>,
    roll: Vec<ParameterView>,
    joint: Vec<ParameterView>,
    starts: i64,
    solves: i64,
    status: &'p FitStatus,
}

#[derive(Serialize)]
struct ComparisonView {
    model: Model,
    j: String,
    /// Of d, v, sigma, alpha.
    parts: [String; 4],
    left_out: String,
    free: i64,
    criterion: String,
    wins: String,
}

#[derive(Serialize)]
struct Otherwise {
    gait_input: GaitInput,
    rows: Vec<OtherwiseRow>,
}

#[derive(Serialize)]
struct OtherwiseRow {
    model: Model,
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
            passive: fits.iter().any(|fit| fit.parameters[Parameter::Damping].is_finite()),
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
    let mut counts: BTreeMap<(Model, FromRest), usize> = BTreeMap::new();
    for row in tables.predictions.iter().filter(|row| row.campaign == campaign) {
        if let Some(from_rest) = row.from_rest {
            *counts.entry((row.model, from_rest)).or_default() += 1;
        }
    }
    remarks.extend(counts.iter().filter_map(|((model, from_rest), count)| {
        let goes = match from_rest {
            FromRest::Reached => return None,
            FromRest::Another => "gets into another motion than the one that is shown",
            FromRest::Unsettled => "does not settle",
        };
        let at = if *count == 1 { "frequency" } else { "frequencies" };
        Some(format!(
            "{model}: at {count} {at} of the trials the robot that starts from rest {goes}."
        ))
    }));
    remarks
}

/// Predictions that the figures leave out, by model and reason.
fn not_drawn(tables: &Tables, campaign: &str) -> Vec<String> {
    let mut counts: BTreeMap<(Model, PredictionSource, MotionStatus), usize> = BTreeMap::new();
    for row in tables.predictions.iter().filter(|row| row.campaign == campaign) {
        *counts.entry((row.model, row.source, row.status)).or_default() += 1;
    }
    let total = |model: Model, source: PredictionSource| -> usize {
        let of = counts.iter().filter(|(key, _)| key.0 == model && key.1 == source);
        of.map(|(_, count)| count).sum()
    };
    counts
        .iter()
        .filter(|((.., status), _)| *status != MotionStatus::Stable)
        .map(|((model, source, status), count)| {
            let total = total(*model, *source);
            let at = match source {
                PredictionSource::Trial => "the trials' frequencies",
                PredictionSource::Curve => "the curve",
            };
            format!("{model}: {count} of {total} points of {at} are not drawn, status {status}.")
        })
        .collect()
}

fn fit_view(fit: &FitRow) -> FitView<'_> {
    let view = |parameter: &Parameter| {
        let fitted = FittedParameter::of(fit, *parameter);
        ParameterView {
            value: fitted.text(),
            free: fitted.free,
            interval: fitted.interval(),
            marks: fitted.marks(),
        }
    };
    let views = |parameters: &[Parameter]| parameters.iter().map(view).collect();
    FitView {
        model: fit.model,
        j: significant(fit.j, 4),
        skid: views(&Parameter::SKID),
        roll: views(&Parameter::ROLL),
        joint: views(&[Parameter::Stiffness, Parameter::Damping]),
        starts: fit.starts,
        solves: fit.solves,
        status: &fit.status,
    }
}

fn comparison_view(row: &ComparisonRow) -> ComparisonView {
    let wins = fixed(100.0 * row.wins, 1);
    ComparisonView {
        model: row.model,
        j: significant(row.j, 4),
        parts: [row.j_d, row.j_v, row.j_sigma, row.j_alpha].map(|part| significant(part, 3)),
        left_out: significant(row.j_left_out, 4),
        free: row.free,
        criterion: fixed(row.criterion, 1),
        wins: if wins == NONE { wins } else { format!("{wins} %") },
    }
}

/// What the other gait input than the configured one gives.
fn otherwise(rows: &[&ComparisonRow]) -> Option<Otherwise> {
    let with = |row: &&&ComparisonRow| row.other_gait_j.is_finite();
    let gait_input = rows.iter().find(with)?.other_gait_input?;
    let view = |row: &&ComparisonRow| OtherwiseRow {
        model: row.model,
        j: significant(row.j, 4),
        other_j: significant(row.other_gait_j, 4),
        skid: Parameter::SKID.map(|skid| significant(row.other_gait_parameters[skid], 4)),
    };
    Some(Otherwise { gait_input, rows: rows.iter().filter(with).map(view).collect() })
}
