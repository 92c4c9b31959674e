//! Setups (robot, gait and model) that commands solve, and warnings about the fits that the setups use.

use trilink_fit::MeasuredRange;
use trilink_fit::simulate::{
    ChainSetup, FitSummary, KnownFits, Setup, campaign_of, starting_values,
};
use trilink_mechanics::AnyProblem;
use trilink_robot::Model;
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
        Ok(match fits {
            Some(fits) => Setup::fitted(config, campaign, model.name(), &self.set, fits)?,
            None => Setup::new(config, campaign, model.name(), &self.set)?,
        })
    }

    /// Returns the setup as [`Numbers::setup`] does if the campaign's robot is a chain.
    pub(super) fn chain_setup(
        &self,
        config: &Config,
        campaign: &str,
        model: Option<&str>,
        fits: Option<&KnownFits>,
    ) -> Result<Option<ChainSetup>, Failure> {
        if !config.chains.campaign.contains_key(campaign) {
            return Ok(None);
        }
        let model = model_of(config, campaign, model, fits)?;
        let Some(mut setup) = ChainSetup::new(config, campaign, model.name())? else {
            return Ok(None);
        };
        if let Some(fits) = fits {
            setup.use_fit(config, campaign, fits)?;
        }
        self.set.iter().try_for_each(|setting| setup.set(setting))?;
        Ok(Some(setup))
    }
}

/// Returns the model to use: by default the preferred model of the comparison or, without fits, [`MODEL`].
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

/// Prints the warnings about the fit that provided a setup's coefficients.
pub(super) fn note_caution(campaign: &str, model: Model, fit: Option<&FitSummary>) {
    let caution = fit.map(FitSummary::caution).unwrap_or_default();
    if !caution.is_empty() {
        warn(&format!("{campaign} {model}: {caution}"));
    }
}

/// Warns if `problems` lie outside the range of the trials to which a setup's coefficients were fitted.
pub(super) fn note_extrapolation(
    campaign: &str,
    model: Model,
    range: Option<Result<&MeasuredRange, &str>>,
    problems: impl ExactSizeIterator<Item = AnyProblem>,
) {
    let Some(range) = range else { return };
    if let Some(caution) = MeasuredRange::caution(range, problems) {
        warn(&format!("{campaign} {model}: {caution}"));
    }
}

/// Prints a note for each setup that uses starting values of coefficients although its model has been fitted.
pub(super) fn note_starting_values(config: &Config, campaign: &str, setups: &[Setup]) {
    if setups.iter().all(|setup| setup.fit().is_none()) {
        for (model, sentence) in starting_values(config, campaign, setups) {
            note!("note: {campaign} {model}: {sentence}");
        }
    }
}

/// Returns the preferred model from the comparison of a campaign's fits, and tells the user which it is.
pub(super) fn preferred(
    config: &Config,
    fits: &KnownFits,
    campaign: &str,
) -> Result<Model, Failure> {
    if !config.chains.campaign.contains_key(campaign) {
        campaign_of(config, campaign)?;
    }
    let model = fits.preferred(campaign)?;
    note!("{campaign}: {model}, the preferred model of the comparison");
    Ok(model)
}
