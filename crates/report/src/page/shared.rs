//! Report-page sections on shared fits: to all campaigns of a robot, or of robots with common wheels.

use std::collections::{BTreeMap, BTreeSet};

use minijinja::context;
use minijinja::value::{Serde, Value};
use trilink_base::text::known;
use trilink_robot::Parameter;
use trilink_tables::{Columns as _, FitRow, SharedFitRow, Sharing};

use crate::ReportInput;
use crate::parameters::{FittedParameter, label};
use crate::tables::Tables;

/// Returns the template values of one section per robot, or group of robots, on the fits to all of its campaigns
/// together, in the order of the table `shared_fits`.
pub(super) fn sections(tables: &Tables, input: &ReportInput) -> Vec<Value> {
    let robots = tables.shared_fits.chunk_by(|a, b| a.robot == b.robot);
    robots.map(|rows| section(rows, tables, input)).collect()
}

/// Returns the robots whose campaigns were fitted only separately, each with these campaigns.
pub(super) fn not_tested<'t>(
    input: &'t ReportInput,
    tables: &'t Tables,
) -> BTreeMap<&'t str, BTreeSet<&'t str>> {
    let mut robots: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for fit in &tables.fits {
        if let Some(robot) = input.robot_name(&fit.campaign) {
            robots.entry(robot).or_default().insert(&fit.campaign);
        }
    }
    robots.retain(|robot, campaigns| {
        campaigns.len() > 1 && tables.shared_fits.iter().all(|row| row.robot != *robot)
    });
    robots
}

/// Returns the template values of the section on a robot or group of robots; `rows` are the fits of each model to all
/// its campaigns together.
fn section(rows: &[SharedFitRow], tables: &Tables, input: &ReportInput) -> Value {
    let links = rows[0].campaigns.first().map_or(Vec::new(), |campaign| input.links(campaign));
    let group = input.robot_group(&rows[0].robot);
    let own_parameter = |fit: &FitRow, of: Parameter| {
        if rows[0].wheels.is_empty() {
            return Some(FittedParameter::new(fit, of));
        }
        let numbers = group.as_ref()?.numbers_of(input.robot_name(&fit.campaign)?)?;
        let (own, ratio) = numbers.own(of)?;
        Some(FittedParameter::new(fit, own).over(ratio))
    };
    let missing = |of: Parameter| FittedParameter::new(&FitRow::blank(), of);
    let models = rows.iter().map(|row| {
        let own = tables
            .fits
            .iter()
            .filter(|fit| fit.model == row.fit.model && row.campaigns.contains(&fit.campaign));
        let own = own.map(|fit| {
            let free = row.fit.free.iter();
            let parameters = free.map(|of| own_parameter(fit, *of).unwrap_or_else(|| missing(*of)));
            let parameters: Vec<FittedParameter> = parameters.collect();
            context! { fit => Serde(fit), parameters => Serde(parameters) }
        });
        let heads = row.fit.free.iter();
        let is_chain = row.campaigns.first().is_some_and(|campaign| input.is_chain(campaign));
        let heads = heads.map(|of: &Parameter| {
            let label = match row.part(*of) {
                Some(part) => format!("{}, {part}", of.quantity().definition().label),
                None if is_chain => label(*of, &links),
                None => of.label().to_owned(),
            };
            context! { label, unit => of.unit() }
        });
        let free = row.fit.free.iter();
        let parameters = free.map(|of| FittedParameter::new(&row.fit, *of));
        context! {
            row => Serde(row),
            heads => heads.collect::<Vec<_>>(),
            parameters => Serde(parameters.collect::<Vec<_>>()),
            own => own.collect::<Vec<_>>(),
            sentence => shared_fit_sentence(row),
        }
    });
    context! {
        robot => Serde(&rows[0].robot),
        wheels => Serde(&rows[0].wheels),
        campaigns => Serde(&rows[0].campaigns),
        sentence => sentence(rows),
        models => models.collect::<Vec<_>>(),
    }
}

/// Returns a sentence on the result of fitting a model to all campaigns of one or several robots together.
pub fn shared_fit_sentence(row: &SharedFitRow) -> String {
    let SharedFitRow { fit, j_separate, rise, rise_limit, p_value, not_tested, .. } = row;
    if !fit.status.is_ok() {
        return format!(
            "no single set of coefficients could be fitted to all campaigns ({}).",
            fit.failure
        );
    }
    let verdict = match fit.sharing {
        Some(Sharing::Kept) => {
            "one set of coefficients for all campaigns fits them as well as a separate set for each does"
        }
        Some(Sharing::Refused) => "one set of coefficients for all campaigns is rejected",
        None => "it is not known whether all campaigns have the same coefficients",
    };
    let reason = not_tested.as_ref().filter(|_| fit.sharing.is_none());
    let reason = reason.map_or(String::new(), |why| format!(", because {why}"));
    let j = known([fit.j, *j_separate], |[j, separate]| {
        format!(": J = {j:.4}, compared with {separate:.4} in separate fits")
    });
    let tested = known([*rise, *rise_limit, *p_value], |[rise, limit, p]| {
        format!(
            "; chance alone can increase J by up to {limit:.4}, and J increases by {rise:.4} (p = {p:.3})"
        )
    });
    let tested = if fit.sharing.is_some() && !j.is_empty() { tested } else { String::new() };
    format!("{verdict}{reason}{j}{tested}.")
}

/// Returns sentences that summarise, for all models, the fits to all campaigns of one or several robots together.
fn sentence(rows: &[SharedFitRow]) -> String {
    let verdicts = [
        (
            Some(Sharing::Kept),
            "one set of coefficients for all campaigns fits them as well as a separate set for each does",
        ),
        (Some(Sharing::Refused), "each campaign needs separate coefficients"),
        (None, "it is not known whether one set of coefficients suffices"),
    ];
    let mut sentences = Vec::new();
    for (sharing, verdict) in verdicts {
        let of_verdict = rows.iter().filter(|row| row.fit.sharing == sharing);
        let models: Vec<&str> = of_verdict.map(|row| row.fit.model.name()).collect();
        if !models.is_empty() {
            sentences.push(format!("With {}, {verdict}.", models.join(", ")));
        }
    }
    sentences.join(" ")
}
