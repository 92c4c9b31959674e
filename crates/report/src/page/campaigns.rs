//! Report-page sections on individual campaigns: figures, fits, model comparison and remarks.

use std::collections::BTreeMap;

use minijinja::context;
use minijinja::value::{Serde, Value};
use trilink_mechanics::{FromRest, MotionStatus};
use trilink_plot::Scale;
use trilink_robot::metrics::Metric;
use trilink_robot::{Parameter, Quantity};
use trilink_tables::config::{RobotConfig, ThreeLinkRobot};
use trilink_tables::{FitRow, PredictionSource, Reason, Sharing};

use super::{Drawn, image, images, optima};
use crate::figures::frequency;
use crate::parameters::{FittedParameter, HELD};
use crate::series::Source;
use crate::tables::Tables;
use crate::truth::Truth;
use crate::{ReportError, ReportInput, figures};

/// Returns the template values of the sections on campaigns: first the campaigns of the paper, in the paper's order,
/// then the others, sorted by name. Campaigns without trials, fits and figures are left out.
pub(super) fn sections(
    input: &ReportInput,
    (tables, truth): (&Tables, Option<&Truth>),
    drawn: &[Drawn<'_>],
) -> Result<Vec<Value>, ReportError> {
    let mut names: Vec<&str> = tables.campaigns(input).into_iter().collect();
    names.sort_by_key(|name| figures::rank(name));
    let sections = names.into_iter().map(|name| section(name, input, (tables, truth), drawn));
    sections.filter_map(Result::transpose).collect()
}

/// Returns the template values of the section on a campaign; `None` if the campaign has neither trials nor fits nor
/// figures.
fn section(
    name: &str,
    input: &ReportInput,
    (tables, truth): (&Tables, Option<&Truth>),
    drawn: &[Drawn<'_>],
) -> Result<Option<Value>, ReportError> {
    let of_kinds = |kinds: &[&str]| {
        images(drawn, |figure| {
            figure.campaigns == [name] && kinds.contains(&figures::kind(&figure.stem))
        })
    };
    let own = |fits: &'_ [FitRow]| -> Vec<FitRow> {
        fits.iter().filter(|fit| fit.campaign == name).cloned().collect()
    };
    let fits = own(&tables.fits);
    let alternatives = own(&tables.alternative_fits);
    let trials = tables.trials.iter().filter(|row| row.campaign == name).count();
    if trials == 0 && fits.is_empty() && !drawn.iter().any(|(figure, _)| figure.campaigns == [name])
    {
        return Ok(None);
    }
    let setup = input.names(name);
    let comparison = tables.comparison.iter().filter(|row| row.campaign == name);
    let fitted = fits.iter().map(|fit| (name, fit.model));
    let exact = taken_as_exact(input, tables, name);
    let links = input.links(name);
    Ok(Some(context! {
        name => name,
        robot => setup.map(|(robot, _)| robot),
        gait => setup.map(|(_, gait)| gait),
        alpha => if input.is_chain(name) { "α" } else { "α₁" },
        trials => trials,
        driven_by => tables.source(input).gait_input(fitted),
        shown => of_kinds(&["models", "residuals"]),
        metrics => of_kinds(&["sigma", "alpha"]),
        motions => images(drawn, |figure| {
            let is_of_motion = ["simulated", "from-rest", "sweep", "gait"]
                .contains(&figures::kind(&figure.stem));
            // With several campaigns, the figure is among the comparisons.
            let is_own_work = figure.stem == figures::WORK && input.is_chain(name);
            figure.campaigns == [name] && (is_of_motion || is_own_work)
        }),
        // The page of the trial and the figure of the models show the same.
        linked => of_kinds(&["wheels", "d-v"]),
        starts => of_kinds(&["starts"]),
        profiles => of_kinds(&["profiles"]),
        replicates => of_kinds(&["replicates"]),
        maps => of_kinds(&["optima"]),
        fits => fit_values(&fits, tables.preferred(name), &links),
        starts_agree => starts_agree(&fits),
        is_exact => is_exact(input, tables, name),
        exact => exact,
        alternatives => fit_values(&alternatives, None, &links),
        comparison => Serde(comparison.collect::<Vec<_>>()),
        compared => tables.compared(name).map(|compared| compared.to_string()),
        precision => precision(tables, name),
        optima => optima::section(tables, name),
        notes => remarks(tables, name),
        answer => answer(name, (tables, truth), tables.source(input))?,
    }))
}

/// Returns the template values of the precision of the metrics that a campaign's trials have.
fn precision(tables: &Tables, name: &str) -> Vec<Value> {
    let rows = tables.precision.iter().filter(|row| row.campaign == name && row.trials > 0);
    let values = rows.filter_map(|row| {
        let metric = Metric::ALL.into_iter().find(|metric| metric.column() == row.metric)?;
        let why = [row.no_repeatability, row.no_reproducibility];
        let why = why.map(|reason| reason.map_or("", Reason::sentence));
        Some(context! { label => metric.definition().symbol, row => Serde(row), why })
    });
    values.collect()
}

/// Returns the template values of the fits, each with the parameters of its model; the fit `first` comes first.
fn fit_values(fits: &[FitRow], first: Option<&FitRow>, links: &[String]) -> Vec<Value> {
    let mut fits: Vec<&FitRow> = fits.iter().collect();
    fits.sort_by_key(|fit| first.is_none_or(|first| fit.model != first.model));
    let values = fits.into_iter().map(|fit| {
        // The sum is omitted where the coefficients of the individual wheels already give it.
        let shown = Parameter::OF_ANY_ROBOT.into_iter().filter(|of| !of.is_sum());
        let parameters =
            shown.map(|parameter| FittedParameter::new(fit, parameter).of_links(links));
        let parameters: Vec<_> = parameters.filter(|of| of.value.is_finite()).collect();
        context! { fit => Serde(fit), parameters => Serde(parameters) }
    });
    values.collect()
}

/// Returns a clause on how many starts of each fit found its lowest objective, without a full stop; empty if no model
/// was fitted.
fn starts_agree(fits: &[FitRow]) -> String {
    let searched = fits.iter().filter(|fit| !fit.free.is_empty() && fit.starts > 0);
    let of_fit = |fit: &FitRow| format!("{} of {} starts agree", fit.starts_reached, fit.starts);
    let mut counts: Vec<(String, Vec<&str>)> = Vec::new();
    for fit in searched {
        let count = of_fit(fit);
        match counts.iter_mut().find(|(known, _)| *known == count) {
            Some((_, models)) => models.push(fit.model.name()),
            None => counts.push((count, vec![fit.model.name()])),
        }
    }
    match counts.as_slice() {
        [(count, _)] => count.clone(),
        several => {
            let clauses = several.iter();
            let clauses = clauses.map(|(count, models)| format!("{}: {count}", models.join(", ")));
            clauses.collect::<Vec<_>>().join("; ")
        }
    }
}

/// Returns the fits of a campaign that have confidence intervals.
fn fits_with_intervals<'t>(tables: &'t Tables, name: &str) -> impl Iterator<Item = &'t FitRow> {
    let fits = tables.fits.iter().filter(move |fit| fit.campaign == name);
    fits.filter(|fit| !fit.free.is_empty() && fit.no_interval.is_none())
}

/// Returns whether confidence intervals of a campaign take all parameters of its robot as exact.
fn is_exact(input: &ReportInput, tables: &Tables, name: &str) -> bool {
    fits_with_intervals(tables, name).next().is_some()
        && input.configured_robot(name).is_some_and(RobotConfig::is_exact)
}

/// Returns the configuration keys of those quantities of a campaign's robot that have no stated uncertainty, so that
/// the confidence intervals treat them as exact.
///
/// A quantity that can be fitted is listed only if a fit with confidence intervals holds it fixed.
fn taken_as_exact(input: &ReportInput, tables: &Tables, name: &str) -> Vec<&'static str> {
    let fits: Vec<&FitRow> = fits_with_intervals(tables, name).collect();
    let robot = input.configured_robot(name).and_then(RobotConfig::three_links);
    let exact = robot.filter(|_| !fits.is_empty()).into_iter().flat_map(ThreeLinkRobot::exact);
    exact
        .filter(|quantity| {
            let mut held = fits.iter().flat_map(|fit| {
                let numbers = quantity.parameters().filter(|of| !of.is_sum());
                numbers.map(|of| FittedParameter::new(fit, of).marks[0] == Some(HELD))
            });
            !quantity.definition().is_fitted || held.any(|is_held| is_held)
        })
        .map(Quantity::name)
        .collect()
}

/// Returns the summary of a campaign for the top of the report page: the result of the model comparison, and the
/// coefficients and prediction curve of the preferred model.
fn answer(
    name: &str,
    (tables, truth): (&Tables, Option<&Truth>),
    source: Source<'_>,
) -> Result<Value, ReportError> {
    let fit = tables.preferred(name);
    let free = fit.map_or(&[][..], |fit| &fit.free);
    let links = source.links(name);
    let coefficients = free.iter().map(|parameter| {
        let of_fit = fit.map(|fit| FittedParameter::new(fit, *parameter).of_links(&links));
        context! { of_fit => Serde(of_fit) }
    });
    let mut curve = frequency::overview(name, fit.map(|fit| fit.model), source);
    curve.panels.iter_mut().for_each(|panel| panel.y_scale = Scale::FromZero);
    curve.is_synthetic =
        truth.is_some_and(|truth| truth.is_synthetic_in(&[name.to_owned()], tables));
    let curve = (!curve.is_empty()).then(|| image(&curve)).transpose()?;
    Ok(context! {
        fit => Serde(fit),
        // The campaign's own section contains the full sentence.
        sentences => tables.compared(name).map(|compared| compared.card()),
        shared => fit.and_then(|fit| shared_in_words(name, fit, tables)),
        coefficients => coefficients.collect::<Vec<_>>(),
        curve,
    })
}

/// Returns sentences that say whether the coefficients of a campaign's fit also describe the robot's other campaigns, and
/// those of robots with common wheels; `None` if this was not tested.
fn shared_in_words(name: &str, fit: &FitRow, tables: &Tables) -> Option<String> {
    let rows = tables.shared_fits.iter().filter(|row| {
        row.fit.model == fit.model && row.campaigns.iter().any(|campaign| campaign == name)
    });
    let sentences = rows.filter_map(|row| {
        let others = row.campaigns.iter().map(String::as_str).filter(|campaign| *campaign != name);
        let others = others.collect::<Vec<_>>().join(" and ");
        Some(match (row.fit.sharing?, row.wheels.is_empty()) {
            (Sharing::Kept, true) => format!("One set of coefficients serves {others} as well."),
            (Sharing::Refused, true) => format!("The coefficients differ from those of {others}."),
            (Sharing::Kept, false) => {
                format!("One set of coefficients of the common wheels serves {others} as well.")
            }
            (Sharing::Refused, false) => {
                format!("No set of coefficients of the common wheels serves {others} as well.")
            }
        })
    });
    let sentences: Vec<String> = sentences.collect();
    (!sentences.is_empty()).then(|| sentences.join(" "))
}

/// Counts the occurrences of each key.
fn counted<K: Ord>(keys: impl Iterator<Item = K>) -> BTreeMap<K, usize> {
    let mut counts = BTreeMap::new();
    keys.for_each(|key| *counts.entry(key).or_default() += 1);
    counts
}

/// Returns remarks on the predictions and friction laws of a campaign: points that figures omit, motions with broken
/// symmetry, motions that are not reached from rest, and friction laws that cannot be distinguished from others.
fn remarks(tables: &Tables, campaign: &str) -> Vec<String> {
    let rows = tables.predictions.iter().filter(|row| row.campaign == campaign);
    let of_source = counted(rows.clone().map(|row| (row.model, row.source)));
    let of_status = counted(rows.clone().map(|row| (row.model, row.source, row.status)));
    let from_rest = counted(rows.filter_map(|row| Some((row.model, row.from_rest?))));
    let not_stable = of_status.iter().filter(|((.., status), _)| *status != MotionStatus::Stable);
    let of_status = not_stable.map(|((model, source, status), count)| {
        let total = of_source[&(*model, *source)];
        let at = match source {
            PredictionSource::Trial => "at the trials' frequencies",
            PredictionSource::Curve => "on the curve",
        };
        let are = match status {
            MotionStatus::SymmetryBroken => {
                "show one of two motions that are mirror images of each other"
            }
            _ => "are not drawn",
        };
        format!("{model}: {count} of {total} points {at} {are} (status {status}).")
    });
    let from_rest = from_rest.iter().filter_map(|((model, from_rest), count)| {
        let goes = match from_rest {
            FromRest::Reached => return None,
            FromRest::Another => "reaches a motion other than the one shown",
            FromRest::Unsettled => "does not reach a steady motion",
        };
        let at = if *count == 1 { "frequency" } else { "frequencies" };
        Some(format!(
            "{model}: at {count} {at} of the trials, the robot {goes} when it starts from rest."
        ))
    });
    let fits = tables.fits.iter().filter(|fit| fit.campaign == campaign);
    let alike = fits.filter_map(|fit| Some((fit.model, fit.law_is_like.as_ref()?)));
    let alike = alike.map(|(model, law)| format!("{model} is effectively {law}."));
    let is_of_one_day = tables.fits.iter().any(|fit| fit.campaign == campaign && fit.single_day);
    let single_day = is_of_one_day.then(|| {
        "The confidence intervals hold for the floor of a single day: all trials are of one day, and fit.day_sd is 0."
            .to_owned()
    });
    of_status.chain(from_rest).chain(alike).chain(single_day).collect()
}
