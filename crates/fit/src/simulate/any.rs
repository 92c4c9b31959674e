//! Setups of robots of either kind.

use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_mechanics::Problem;
use trilink_robot::{AnyRobot, Model};
use trilink_tables::config::Config;
use trilink_tables::{Columns as _, Extrapolation, NoInterval, NoIntervalReason};

use super::fitted::FittedSetup;
use super::{ChainSetup, Draws, FitSummary, KnownFits, Sensitivities, Setup, SetupError};
use crate::{Alternatives, MeasuredRange};

/// Robot and gait of a campaign with the friction laws of a model.
#[expect(clippy::large_enum_variant, reason = "a command has few setups")]
#[derive(Debug, Clone)]
pub enum AnySetup {
    ThreeLinks(Setup),
    Chain(ChainSetup),
}

impl AnySetup {
    /// Sets up a campaign of `config`, with fitted coefficients if there are `fits`, and then with `settings`, which are
    /// `key=value` strings as for `trilink simulate --set`.
    ///
    /// # Errors
    /// Returns an error as [`Setup::new`] and [`Setup::fitted`] do.
    pub fn new(
        config: Config,
        campaign: &str,
        model: &str,
        settings: &[String],
        fits: Option<&KnownFits>,
    ) -> Result<Self, SetupError> {
        let Some(mut chain) = ChainSetup::new(&config, campaign, model)? else {
            let setup = match fits {
                Some(fits) => Setup::fitted(config, campaign, model, settings, fits),
                None => Setup::new(config, campaign, model, settings),
            };
            return setup.map(Self::ThreeLinks);
        };
        if let Some(fits) = fits {
            chain.use_fit(&config, campaign, fits)?;
        }
        settings.iter().try_for_each(|setting| chain.set(setting))?;
        Ok(Self::Chain(chain))
    }

    pub fn model(&self) -> Model {
        match self {
            Self::ThreeLinks(setup) => setup.model,
            Self::Chain(setup) => setup.model,
        }
    }

    /// Returns the robot with its coefficients.
    pub fn robot(&self) -> AnyRobot {
        match self {
            Self::ThreeLinks(setup) => setup.robot.clone().into(),
            Self::Chain(setup) => setup.chain.clone().into(),
        }
    }

    /// Returns the problem to solve at a frequency.
    pub fn problem(&self, omega_rad_s: f64) -> Problem {
        match self {
            Self::ThreeLinks(setup) => setup.problem(omega_rad_s),
            Self::Chain(setup) => setup.problem(omega_rad_s),
        }
    }

    fn fitted(&self) -> Option<&FittedSetup> {
        match self {
            Self::ThreeLinks(setup) => setup.fitted.as_ref(),
            Self::Chain(setup) => setup.fitted.as_ref(),
        }
    }

    /// Returns the summary of the fit that provides the coefficients; `None` for configured coefficients.
    pub fn fit(&self) -> Option<&FitSummary> {
        self.fitted().map(|fitted| &fitted.summary)
    }

    /// Returns the range covered by the fitted trials, or the reason why it is unknown; `None` for configured
    /// coefficients.
    pub fn measured_range(&self) -> Option<Result<&MeasuredRange, &str>> {
        self.fitted().map(FittedSetup::range)
    }

    /// Returns whether a problem lies outside the range of the fitted trials; blank for configured coefficients.
    pub fn extrapolation(&self, problem: &Problem) -> Extrapolation {
        self.fitted().map_or_else(Extrapolation::blank, |fitted| fitted.extrapolation(problem))
    }

    /// Computes the sensitivities of the metrics, as [`Setup::sensitivities`] does.
    ///
    /// # Errors
    /// Returns an error if the computation is cancelled.
    pub fn sensitivities(
        &self,
        omegas_rad_s: &[f64],
        from_rest: bool,
        fits: Option<&KnownFits>,
        draws: Option<Draws>,
        cancel: &CancelToken,
    ) -> Result<Sensitivities, Cancelled> {
        match self {
            Self::ThreeLinks(setup) => {
                setup.sensitivities(omegas_rad_s, from_rest, fits, draws, cancel)
            }
            Self::Chain(setup) => setup.sensitivities(omegas_rad_s, from_rest, fits, draws, cancel),
        }
    }

    /// Returns copies of the robot with the coefficients of refits, including those of at most `max_replicates`
    /// bootstrap replicates. `fits` must come from [`KnownFits::read`] with `bands`.
    ///
    /// # Errors
    /// Returns the reason if the uncertainty of the coefficients is unknown.
    pub fn alternatives(
        &self,
        fits: &KnownFits,
        max_replicates: usize,
    ) -> Result<Alternatives, NoInterval> {
        let fitted = self.fitted().ok_or(NoIntervalReason::NotFitted)?;
        fitted.alternatives(&self.robot(), &fits.data, max_replicates)
    }
}
