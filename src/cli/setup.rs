//! The setups that commands solve, and what is said of their fits beside answers.

use trilink_fit::simulate::{KnownFits, Setup, campaign_of, starting_values};
use trilink_mechanics::Problem;
use trilink_robot::Model;
use trilink_tables::config::Config;

use super::Failure;
use super::output::note;

/// The model that is taken where none is named, without fits.
const MODEL: &str = "skid-roll";

/// Where the numbers of a setup come from.
#[derive(clap::Args)]
pub(super) struct Numbers {
    /// Take the coefficients that were fitted to the campaign's trials, by `trilink fit`, for those of the configuration; the gait is
    /// the commanded one.
    #[arg(long)]
    pub fitted: bool,
    /// Numbers of the robot, one or several: `skid_kg_s=104,34,45`, or of one wheel or link, as `simulate --sensitivities` names them,
    /// `skid_dry0_n=1.8`, `mass0_kg=1.05`; and of the gait, of a commanded joint: `offset1_deg=10`, `amplitude2_deg=25`,
    /// `phase2_deg=-80`.
    #[arg(long, num_args = 1.., value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

impl Numbers {
    /// The fits, if they are asked for, with what is known of their coefficients' uncertainty if `is_uncertain`.
    pub(super) fn fits(
        &self,
        config: &Config,
        is_uncertain: bool,
    ) -> Result<Option<KnownFits>, Failure> {
        Ok(self.fitted.then(|| KnownFits::read(config, is_uncertain)).transpose()?)
    }

    /// A model with configured or fitted coefficients; where none is named, the one that the comparison of the fits
    /// prefers.
    pub(super) fn setup(
        &self,
        config: Config,
        campaign: &str,
        model: Option<&str>,
        fits: Option<&KnownFits>,
    ) -> Result<Setup, Failure> {
        let model = match (model, fits) {
            (Some(model), _) => Model::new(model),
            (None, Some(fits)) => preferred(&config, fits, campaign)?,
            (None, None) => Model::new(MODEL),
        };
        let (model, set) = (model.name(), &self.set);
        Ok(match fits {
            Some(fits) => Setup::fitted(config, campaign, model, set, fits)?,
            None => Setup::new(config, campaign, model, set)?,
        })
    }
}

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

/// Says of which setups there are fits whose coefficients they do not have.
pub(super) fn note_starting_values(config: &Config, campaign: &str, setups: &[Setup]) {
    if setups.iter().all(|setup| setup.fit().is_none()) {
        for (model, said) in starting_values(config, campaign, setups) {
            note!("note: {campaign} {model}: {said}");
        }
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
