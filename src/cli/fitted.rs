//! What `--fitted` says beside its answers.

use super::output::note;
use crate::simulate::Setup;

/// Says what is to be known of the fit that a setup's coefficients are from.
pub(super) fn note_caution(campaign: &str, setup: &Setup) {
    let Some(fit) = setup.fit() else { return };
    let caution = fit.caution();
    if !caution.is_empty() {
        note!("warning: {campaign} {}: {caution}", setup.model);
    }
}
