//! What the page says of the campaigns of a robot that are fitted together.

use minijinja::context;
use minijinja::value::{Serde, Value};
use trilink_base::text::known;
use trilink_robot::Parameter;
use trilink_tables::{FitRow, SharedFitRow, Sharing};

use crate::parameters::FittedParameter;
use crate::tables::Tables;

/// A section for each robot, in order.
pub(super) fn sections(tables: &Tables) -> Vec<Value> {
    let robots = tables.shared_fits.chunk_by(|a, b| a.robot == b.robot);
    robots.map(|rows| section(rows, tables)).collect()
}

fn section(rows: &[SharedFitRow], tables: &Tables) -> Value {
    let models = rows.iter().map(|row| {
        let values = |fit: &FitRow| -> Vec<FittedParameter> {
            row.fit.free.iter().map(|of| FittedParameter::of(fit, *of)).collect()
        };
        let is_own =
            |fit: &&FitRow| fit.model == row.fit.model && row.campaigns.contains(&fit.campaign);
        let own = tables.fits.iter().filter(is_own);
        let own = own.map(|fit| context! { fit => Serde(fit), parameters => Serde(values(fit)) });
        let heads = row.fit.free.iter();
        let heads = heads.map(|of: &Parameter| context! { label => of.label(), unit => of.unit() });
        context! {
            row => Serde(row),
            heads => heads.collect::<Vec<_>>(),
            parameters => Serde(values(&row.fit)),
            own => own.collect::<Vec<_>>(),
            sentence => shared_fit_sentence(row),
        }
    });
    context! {
        robot => Serde(&rows[0].robot),
        campaigns => Serde(&rows[0].campaigns),
        sentence => sentence(rows),
        models => models.collect::<Vec<_>>(),
    }
}

/// What came out of fitting the campaigns of a robot together, in a sentence.
pub fn shared_fit_sentence(row: &SharedFitRow) -> String {
    let SharedFitRow { fit, j_separate, rise, rise_limit, p_value, not_tested, .. } = row;
    if !fit.status.is_ok() {
        return format!("one set of coefficients for all campaigns has no fit ({}).", fit.status);
    }
    let verdict = match fit.sharing {
        Some(Sharing::Kept) => "one set of coefficients describes all campaigns as well",
        Some(Sharing::Refused) => "one set of coefficients for all campaigns is refused",
        None => "whether all campaigns have the same coefficients is not known",
    };
    let reason = not_tested.as_ref().filter(|_| fit.sharing.is_none());
    let reason = reason.map_or(String::new(), |why| format!(", since {why}"));
    let j = known([fit.j, *j_separate], |[j, separate]| {
        format!(": J = {j:.4} against {separate:.4} of separate fits")
    });
    let tested = known([*rise, *rise_limit, *p_value], |[rise, limit, p]| {
        format!(", {rise:.4} more, of which up to {limit:.4} would be chance (p = {p:.3})")
    });
    let tested = if fit.sharing.is_some() && !j.is_empty() { tested } else { String::new() };
    format!("{verdict}{reason}{j}{tested}.")
}

/// The answer of all models of a robot.
fn sentence(rows: &[SharedFitRow]) -> String {
    let of = |sharing| -> Vec<&str> {
        let models = rows.iter().filter(|row| row.fit.sharing == sharing);
        models.map(|row| row.fit.model.name()).collect()
    };
    let [kept, refused, unknown] =
        [Some(Sharing::Kept), Some(Sharing::Refused), None].map(|sharing| of(sharing).join(", "));
    let parts = [
        ("one set of coefficients describes all campaigns as well as one for each", kept),
        ("each campaign needs coefficients of its own", refused),
        ("it is not known", unknown),
    ];
    let said = parts.into_iter().filter(|(_, models)| !models.is_empty());
    let said: Vec<String> = said.map(|(what, models)| format!("By {models} {what}")).collect();
    format!("{}.", said.join(". "))
}
