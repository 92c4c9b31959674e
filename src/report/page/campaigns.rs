//! What the page says of every campaign: its figures, its fits and which of them the data prefer.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{Drawn, Image, images};
use crate::motion::{FromRest, Model, MotionStatus};
use crate::report::ReportInput;
use crate::report::figures;
use crate::report::parameters::FittedParameter;
use crate::report::tables::Tables;
use crate::robot::Parameter;
use crate::store::{ComparisonRow, FitRow, PredictionSource};

#[derive(Serialize)]
pub struct CampaignSection<'p> {
    name: &'p str,
    robot: Option<&'p str>,
    gait: Option<&'p str>,
    trials: usize,
    figures: Vec<&'p Image>,
    fits: Vec<FitView<'p>>,
    /// With the other gait than the configured one.
    alternatives: Vec<FitView<'p>>,
    /// Whether a model of it has a passive joint.
    passive: bool,
    /// Its first sentence says which model the measurements prefer.
    comparison: Vec<&'p ComparisonRow>,
    notes: Vec<String>,
}

#[derive(Serialize)]
struct FitView<'p> {
    fit: &'p FitRow,
    /// All but the sum of the roll coefficients.
    parameters: Vec<FittedParameter>,
}

/// Sections in the paper's order, then by name; without those that have nothing to say.
pub fn sections<'p>(
    input: &'p ReportInput,
    tables: &'p Tables,
    drawn: &'p [Drawn<'_>],
) -> Vec<CampaignSection<'p>> {
    let mut names: Vec<&str> = tables.campaigns(input).into_iter().collect();
    names.sort_by_key(|name| figures::rank(name));
    let section = |name: &'p str| {
        let views = |fits: &'p [FitRow]| -> Vec<FitView<'p>> {
            let fits = fits.iter().filter(|fit| fit.campaign == name);
            fits.map(|fit| FitView { fit, parameters: parameters(fit) }).collect()
        };
        let fits = views(&tables.fits);
        let setup = input.campaign.get(name);
        let comparison = tables.comparison.iter().filter(|row| row.campaign == name);
        CampaignSection {
            name,
            robot: setup.map(|campaign| campaign.robot.as_str()),
            gait: setup.map(|campaign| campaign.gait.as_str()),
            trials: tables.trials.iter().filter(|row| row.campaign == name).count(),
            figures: images(drawn, |figure| {
                figure.campaigns == [name] && figure.stem != figures::TRUTH
            }),
            passive: fits.iter().any(|view| view.fit.parameters[Parameter::Damping].is_finite()),
            comparison: comparison.collect(),
            notes: remarks(tables, name),
            alternatives: views(&tables.alternative_fits),
            fits,
        }
    };
    let sections = names.into_iter().map(section);
    sections.filter(|s| s.trials > 0 || !s.fits.is_empty() || !s.figures.is_empty()).collect()
}

fn parameters(fit: &FitRow) -> Vec<FittedParameter> {
    let shown = Parameter::ALL.into_iter().filter(|parameter| *parameter != Parameter::RollSum);
    shown.map(|parameter| FittedParameter::of(fit, parameter)).collect()
}

/// What is to be said of a campaign's predictions: those that the figures leave out, and those
/// that the robot does not get into from rest.
fn remarks(tables: &Tables, campaign: &str) -> Vec<String> {
    let mut of_source: BTreeMap<(Model, PredictionSource), usize> = BTreeMap::new();
    let mut of_status: BTreeMap<(Model, PredictionSource, MotionStatus), usize> = BTreeMap::new();
    let mut from_rest: BTreeMap<(Model, FromRest), usize> = BTreeMap::new();
    for row in tables.predictions.iter().filter(|row| row.campaign == campaign) {
        *of_source.entry((row.model, row.source)).or_default() += 1;
        *of_status.entry((row.model, row.source, row.status)).or_default() += 1;
        if let Some(reached) = row.from_rest {
            *from_rest.entry((row.model, reached)).or_default() += 1;
        }
    }
    let not_drawn = of_status.iter().filter(|((.., status), _)| *status != MotionStatus::Stable);
    let not_drawn = not_drawn.map(|((model, source, status), count)| {
        let total = of_source[&(*model, *source)];
        let at = match source {
            PredictionSource::Trial => "the trials' frequencies",
            PredictionSource::Curve => "the curve",
        };
        format!("{model}: {count} of {total} points of {at} are not drawn, status {status}.")
    });
    let from_rest = from_rest.iter().filter_map(|((model, from_rest), count)| {
        let goes = match from_rest {
            FromRest::Reached => return None,
            FromRest::Another => "gets into another motion than the one that is shown",
            FromRest::Unsettled => "does not settle",
        };
        let at = if *count == 1 { "frequency" } else { "frequencies" };
        Some(format!(
            "{model}: at {count} {at} of the trials the robot that starts from rest {goes}."
        ))
    });
    not_drawn.chain(from_rest).collect()
}
