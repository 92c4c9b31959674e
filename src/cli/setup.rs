//! Setups (robot, gait and model) that commands solve, and warnings about the fits that the setups use.

use trilink_fit::MeasuredRange;
use trilink_fit::simulate::{FitSummary, KnownFits, Setup, campaign_of, starting_values};
use trilink_mechanics::Problem;
use trilink_robot::{AnyRobot, Model};
use trilink_tables::config::Config;

use super::output::{note, warn};
use super::{Context, Failure};
use crate::build::check_unconfigured_tables;

/// Default model of commands without `--fitted`.
pub(super) const MODEL: &str = "skid-roll";

/// Sources of the parameter values in a setup.
#[derive(clap::Args)]
pub(super) struct Numbers {
    /// Use the coefficients that `trilink fit` fitted to the campaign's trials instead of those in the configuration;
    /// the gait is the commanded one.
    #[arg(long)]
    pub fitted: bool,
    /// Set parameters of the robot (`skid_kg_s=104,34,45`), of one of its wheels, links or joints (`skid_dry0_n=1.8`,
    /// `mass0_kg=1.05`, with the names that `simulate --sensitivities` prints), or of the gait of a commanded joint
    /// (`offset1_deg=10`, `amplitude2_deg=25`, `phase2_deg=-80`).
    #[arg(long, num_args = 1.., value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

impl Numbers {
    /// Reads the fits if `--fitted` is given, and otherwise returns `None`. Also reads the tables from which
    /// uncertainties are computed if `is_uncertain` is set.
    pub(super) fn fits(
        &self,
        context: &Context,
        is_uncertain: bool,
    ) -> Result<Option<KnownFits>, Failure> {
        if !self.fitted {
            context.check_assumed(|_| Ok(()))?;
            return Ok(None);
        }
        context.check_assumed(check_unconfigured_tables)?;
        Ok(Some(KnownFits::read(&context.config, is_uncertain)?))
    }

    /// Returns the setup of a model with configured or fitted coefficients. The default model is the preferred model of
    /// the comparison or, without fits, [`MODEL`].
    pub(super) fn setup(
        &self,
        config: Config,
        campaign: &str,
        model: Option<&str>,
        fits: Option<&KnownFits>,
    ) -> Result<Setup, Failure> {
        let model = model_of(&config, campaign, model, fits)?;
        Ok(Setup::new(config, campaign, model.name(), &self.set, fits)?)
    }
}

/// Returns the named model, or the default: the preferred model of the comparison or, without fits, [`MODEL`].
fn model_of(
    config: &Config,
    campaign: &str,
    model: Option<&str>,
    fits: Option<&KnownFits>,
) -> Result<Model, Failure> {
    match (model, fits) {
        (Some(model), _) => Ok(Model::new(model)),
        (None, Some(fits)) => preferred(config, fits, campaign),
        (None, None) => Ok(Model::new(MODEL)),
    }
}

/// Prints the warnings about the fit that provided the coefficients of a model.
pub(super) fn note_caution(campaign: &str, model: Model, fit: Option<&FitSummary>) {
    let Some(fit) = fit else { return };
    let caution = fit.caution();
    if !caution.is_empty() {
        warn(&format!("{campaign} {model}: {caution}"));
    }
}

/// Warns if `problems` lie outside the range of the trials to which a model's coefficients were fitted.
pub(super) fn note_extrapolation(
    campaign: &str,
    model: Model,
    range: Option<Result<&MeasuredRange, &str>>,
    problems: impl ExactSizeIterator<Item = Problem>,
) {
    let Some(range) = range else { return };
    if let Some(caution) = MeasuredRange::caution(range, problems) {
        warn(&format!("{campaign} {model}: {caution}"));
    }
}

/// Prints a note for each model whose robot has starting values of coefficients although the model has been fitted.
pub(super) fn note_starting_values(config: &Config, campaign: &str, setups: &[(Model, AnyRobot)]) {
    for (model, sentence) in starting_values(config, campaign, setups) {
        note!("note: {campaign} {model}: {sentence}");
    }
}

/// Returns the preferred model from the comparison of a campaign's fits, and tells the user which it is.
pub(super) fn preferred(
    config: &Config,
    fits: &KnownFits,
    campaign: &str,
) -> Result<Model, Failure> {
    campaign_of(config, campaign)?;
    let model = fits.preferred(campaign)?;
    note!("{campaign}: {model}, the preferred model of the comparison");
    Ok(model)
}
