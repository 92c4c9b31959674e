//! What `--fitted` says beside its answers.

use super::Failure;
use super::output::note;
use crate::config::Config;
use crate::robot::Model;
use crate::simulate::{KnownFits, Setup, campaign_of};

/// Says what is to be known of the fit that a setup's coefficients are from.
pub(super) fn note_caution(campaign: &str, setup: &Setup) {
    let Some(fit) = setup.fit() else { return };
    let caution = fit.caution();
    if !caution.is_empty() {
        note!("warning: {campaign} {}: {caution}", setup.model);
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
