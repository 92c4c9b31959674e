//! What the page says of every campaign: its figures, its fits and which of them the data prefer.

use std::collections::BTreeMap;

use minijinja::context;
use minijinja::value::{Serde, Value};
use trilink_mechanics::{FromRest, MotionStatus};
use trilink_plot::Figure;
use trilink_robot::{Parameter, Quantity};
use trilink_tables::config::RobotConfig;
use trilink_tables::{FitRow, PredictionSource};

use super::{Drawn, image, images, optima};
use crate::figures::frequency;
use crate::parameters::{FittedParameter, HELD};
use crate::series::Source;
use crate::tables::Tables;
use crate::truth::Truth;
use crate::{ReportError, ReportInput, figures};

/// Sections in the paper's order, then by name; without those that have nothing to say.
pub(super) fn sections(
    input: &ReportInput,
    (tables, truth): (&Tables, Option<&Truth>),
    drawn: &[Drawn<'_>],
) -> Result<Vec<Value>, ReportError> {
    let mut names: Vec<&str> = tables.campaigns(input).into_iter().collect();
    names.sort_by_key(|name| figures::rank(name));
    let section = |name: &str| {
        let both = || tables.fits.iter().chain(&tables.alternative_fits);
        let in_a_model = |parameter: &Parameter| {
            both().any(|fit| fit.campaign == name && fit.parameters[*parameter].is_finite())
        };
        // A sum says nothing that its parts do not.
        let shown = Parameter::ALL.into_iter().filter(|of| !of.is_sum() && in_a_model(of));
        let shown: Vec<Parameter> = shown.collect();
        let fits = |fits: &[FitRow]| -> Vec<Value> {
            let fits = fits.iter().filter(|fit| fit.campaign == name);
            fits.map(|fit| {
                let parameters = shown.iter().map(|of| FittedParameter::of(fit, *of));
                let parameters: Vec<FittedParameter> = parameters.collect();
                context! { fit => Serde(fit), parameters => Serde(parameters) }
            })
            .collect()
        };
        let heads = shown.iter().map(|of| context! { label => of.label(), unit => of.unit() });
        let setup = input.campaigns().get(name);
        let comparison = tables.comparison.iter().filter(|row| row.campaign == name);
        let trials = tables.trials.iter().filter(|row| row.campaign == name).count();
        let own = |figure: &Figure| figure.campaigns == [name] && figure.stem != figures::TRUTH;
        let (own_figures, own_fits) = (images(drawn, own), fits(&tables.fits));
        let of_campaign = tables.fits.iter().filter(|fit| fit.campaign == name);
        let fitted = of_campaign.map(|fit| (name, fit.model));
        if trials == 0 && own_fits.is_empty() && own_figures.is_empty() {
            return Ok(None);
        }
        Ok(Some(context! {
                name => name,
                robot => setup.map(|campaign| &campaign.robot),
                gait => setup.map(|campaign| &campaign.gait),
                trials => trials,
                driven_by => tables.source(input).gait_input(fitted),
                figures => own_figures,
                parameters => heads.collect::<Vec<_>>(),
                fits => own_fits,
                exact => taken_as_exact(input, tables, name),
                // With the other gait than the configured one.
                alternatives => fits(&tables.alternative_fits),
                comparison => Serde(comparison.collect::<Vec<_>>()),
                compared => tables.compared(name).map(|compared| compared.to_string()),
                optima => optima::section(tables, name),
                notes => remarks(tables, name),
                answer => answer(name, (tables, truth), tables.source(input))?,
        }))
    };
    names.into_iter().filter_map(|name| section(name).transpose()).collect()
}

/// Keys of the robot's numbers that intervals take as exact: those of all robots, and those that a model with
/// intervals knows and does not fit.
fn taken_as_exact(input: &ReportInput, tables: &Tables, name: &str) -> Vec<&'static str> {
    let has_intervals =
        |fit: &&FitRow| fit.campaign == name && !fit.free.is_empty() && fit.no_interval.is_none();
    let fits: Vec<&FitRow> = tables.fits.iter().filter(has_intervals).collect();
    let is_held = |quantity: &Quantity| {
        let mut held = fits.iter().flat_map(|fit| {
            let numbers = quantity.parameters().filter(|of| !of.is_sum());
            numbers.map(|of| FittedParameter::of(fit, of).marks[0] == Some(HELD))
        });
        !quantity.definition().is_fitted || held.any(|is_held| is_held)
    };
    let robot = input.configured_robot(name).filter(|_| !fits.is_empty());
    let exact = robot.into_iter().flat_map(RobotConfig::exact);
    exact.filter(is_held).map(Quantity::name).collect()
}

/// What the first screen says of a campaign: what the measurements say, and of the model that they
/// prefer the coefficients and the curve.
fn answer(
    name: &str,
    (tables, truth): (&Tables, Option<&Truth>),
    source: Source<'_>,
) -> Result<Value, ReportError> {
    let fit = tables.preferred(name);
    let coefficient = |parameter: &Parameter| {
        let of_fit = fit.map(|fit| FittedParameter::of(fit, *parameter));
        context! { label => parameter.label(), unit => parameter.unit(), of_fit => Serde(of_fit) }
    };
    let free = fit.map_or(&[][..], |fit| &fit.free);
    let mut curve = frequency::overview(name, fit.map(|fit| fit.model), source);
    curve.is_synthetic =
        truth.is_some_and(|truth| truth.is_synthetic_in(&[name.to_owned()], tables));
    let curve = (!curve.is_empty()).then(|| image(&curve)).transpose()?;
    Ok(context! {
        fit => Serde(fit),
        // Whether it fits stands beside it; the whole sentence is with the campaign.
        sentence => tables.compared(name).map(|compared| compared.answer()),
        coefficients => free.iter().map(coefficient).collect::<Vec<_>>(),
        curve,
    })
}

/// How often each key stands there.
fn counted<K: Ord>(keys: impl Iterator<Item = K>) -> BTreeMap<K, usize> {
    let mut counts = BTreeMap::new();
    keys.for_each(|key| *counts.entry(key).or_default() += 1);
    counts
}

/// What is to be said of a campaign's predictions: those that the figures leave out, those that have
/// lost their symmetry, those that the robot does not get into from rest, and laws that are not told
/// from others.
fn remarks(tables: &Tables, campaign: &str) -> Vec<String> {
    let rows = || tables.predictions.iter().filter(|row| row.campaign == campaign);
    let of_source = counted(rows().map(|row| (row.model, row.source)));
    let of_status = counted(rows().map(|row| (row.model, row.source, row.status)));
    let from_rest = counted(rows().filter_map(|row| Some((row.model, row.from_rest?))));
    let worth_telling =
        of_status.iter().filter(|((.., status), _)| *status != MotionStatus::Stable);
    let of_status = worth_telling.map(|((model, source, status), count)| {
        let total = of_source[&(*model, *source)];
        let at = match source {
            PredictionSource::Trial => "the trials' frequencies",
            PredictionSource::Curve => "the curve",
        };
        let are = match status {
            MotionStatus::SymmetryBroken => {
                "of one of two motions that are each other's mirror image"
            }
            _ => "not drawn",
        };
        format!("{model}: {count} of {total} points of {at} are {are}, status {status}.")
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
    let fits = tables.fits.iter().filter(|fit| fit.campaign == campaign);
    let alike = fits.filter_map(|fit| Some((fit.model, fit.law_is_like.as_ref()?)));
    let alike = alike.map(|(model, law)| format!("{model} is like {law}."));
    of_status.chain(from_rest).chain(alike).collect()
}
