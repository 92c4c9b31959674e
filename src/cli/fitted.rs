//! What is said of fits beside answers.

use trilink_fit::simulate::{KnownFits, Setup, campaign_of, starting_values};
use trilink_mechanics::Problem;
use trilink_robot::Model;
use trilink_tables::config::Config;

use super::Failure;
use super::output::note;

/// Says what is to be known of the fit that a setup's coefficients are from.
pub(super) fn note_caution(campaign: &str, setup: &Setup) {
    let Some(fit) = setup.fit() else { return };
    let caution = fit.caution();
    if !caution.is_empty() {
        note!("warning: {campaign} {}: {caution}", setup.model);
    }
}

/// Says which of some motions are beyond the trials that a setup's coefficients were fitted to.
pub(super) fn note_extrapolation(
    campaign: &str,
    setup: &Setup,
    problems: impl ExactSizeIterator<Item = Problem>,
) {
    let (model, all) = (setup.model, problems.len());
    match setup.measured_range() {
        Some(Ok(range)) => {
            if let Some((count, beyond)) = range.summary(problems) {
                note!(
                    "warning: {campaign} {model}: extrapolated beyond the trials of the fit, {count} of {all} \
                     motions: {beyond}"
                );
            }
        }
        Some(Err(why)) => {
            note!(
                "warning: {campaign} {model}: what the trials of the fit cover is not known: {why}"
            );
        }
        None => {}
    }
}

/// Says of which setups without fitted coefficients there are fits.
pub(super) fn note_starting_values(config: &Config, campaign: &str, setups: &[Setup]) {
    for (model, said) in starting_values(config, campaign, setups) {
        note!("note: {campaign} {model}: {said}");
    }
}

/// The model that the comparison of a campaign's fits prefers, which is said.
pub(super) fn preferred(
    config: &Config,
    fits: &KnownFits,
    campaign: &str,
) -> Result<Model, Failure> {
    campaign_of(config, campaign)?;
    let model = fits.preferred(campaign)?;
    note!("{campaign}: {model}, which the comparison of the fits prefers");
    Ok(model)
}
