//! The motion of a model by name, without trials: what `trilink simulate` answers, and the Python module.

mod answer;
mod fitted;
mod sensitivity;
mod settings;
mod trajectory;

use std::path::Path;

use rayon::prelude::*;
use serde_json::{Map, Value};
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_mechanics::{MotionError, Problem};
use trilink_robot::{Gait, Laws, Model, Robot};
use trilink_tables::config::{Config, ConfigError, GaitConfig, RobotConfig, one_of};
use trilink_tables::{
    Columns as _, Extrapolation, NoInterval, NoIntervalReason, SensitivityRow, TrajectoryRow,
};

use crate::bands::without_resample;
use crate::{Alternatives, MeasuredRange, PredictionBands};

pub use answer::{Answer, Interval, SimulationRow};
use fitted::FittedSetup;
pub use fitted::starting_values;
pub use fitted::{FitSummary, KnownFits};
use sensitivity::Uncertain;
use settings::with_settings;
pub use settings::{campaign_of, number_names, with_number};

/// Why something cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SetupError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// No such campaign, model or parameter.
    #[error("{0}")]
    Name(String),
}

impl From<String> for SetupError {
    fn from(message: String) -> Self {
        Self::Name(message)
    }
}

/// Sensitivities of the motions of a [`Setup`].
#[derive(Debug)]
pub struct Sensitivities {
    /// Of each frequency, or why there are none.
    pub motions: Vec<(f64, Result<Vec<SensitivityRow>, MotionError>)>,
    /// Why nothing is known of how far the fitted coefficients may be off.
    pub unknown: Option<NoInterval>,
}

/// A campaign's robot and gait under the laws of a model.
#[derive(Debug, Clone)]
pub struct Setup {
    pub robot: Robot,
    pub gait: Gait,
    pub laws: Laws,
    pub model: Model,
    /// The keys of both, and how the answers show them.
    pub robot_config: RobotConfig,
    pub gait_config: GaitConfig,
    parameters: Map<String, Value>,
    commands: Map<String, Value>,
    /// What the configuration says of how well the robot is known.
    uncertain: Uncertain,
    /// Where its coefficients are fitted ones.
    fitted: Option<FittedSetup>,
}

impl Setup {
    /// Of a campaign of `config`, whose robot and gait have what the `settings` say: each a `key=value`
    /// as `trilink simulate --set` takes it.
    ///
    /// # Errors
    /// There is no such campaign, model or parameter, or the robot lacks what the model needs.
    pub fn new(
        config: Config,
        campaign: &str,
        model: &str,
        settings: &[String],
    ) -> Result<Self, SetupError> {
        Self::of(with_settings(config, campaign, settings)?, campaign, model)
    }

    /// The same with the coefficients that were fitted; settings go first.
    ///
    /// # Errors
    /// As [`Setup::new`], or there is no such fit.
    pub fn fitted(
        config: Config,
        campaign: &str,
        model: &str,
        settings: &[String],
        fits: &KnownFits,
    ) -> Result<Self, SetupError> {
        // Names that are wrong have their own errors.
        let known = Self::of(with_settings(config.clone(), campaign, &[])?, campaign, model)?;
        let fitted = FittedSetup::new(&config, campaign, known.model, fits)?;
        let config = with_settings(fitted.configured(config, campaign)?, campaign, settings)?;
        Ok(Self { fitted: Some(fitted), ..Self::of(config, campaign, model)? })
    }

    fn of(config: Config, campaign: &str, model: &str) -> Result<Self, SetupError> {
        let setup = config.campaign_setup(campaign);
        let (robot, gait) = setup.ok_or_else(|| "no such campaign".to_owned())?;
        let laws = laws_of(&config, campaign, model)?;
        let of = &config.campaign[campaign];
        let uncertain = Uncertain::configured(&config.robot[&of.robot], laws, &gait);
        let (robot_config, gait_config) =
            (config.robot[&of.robot].clone(), config.gait[&of.gait].clone());
        Ok(Self {
            robot,
            gait,
            laws,
            model: Model::new(model),
            parameters: keys_of(&robot_config)?,
            commands: keys_of(&gait_config)?,
            robot_config,
            gait_config,
            uncertain,
            fitted: None,
        })
    }

    /// Its problem at a frequency.
    pub fn problem(&self, omega_rad_s: f64) -> Problem {
        Problem { robot: self.robot.clone(), gait: self.gait, laws: self.laws, omega_rad_s }
    }

    /// Its motion at a frequency; with `from_rest` the one in which the robot from rest ends.
    pub fn answer(&self, omega_rad_s: f64, from_rest: bool) -> Answer<'_> {
        Answer::new(self, &self.problem(omega_rad_s), from_rest)
    }

    /// What there is to say of the fit that the coefficients are from.
    pub fn fit(&self) -> Option<&FitSummary> {
        self.fitted.as_ref().map(|fitted| &fitted.summary)
    }

    /// What the trials of that fit cover, or why that is not known; `None` where nothing is fitted.
    pub fn measured_range(&self) -> Option<Result<&MeasuredRange, &str>> {
        let range = &self.fitted.as_ref()?.range;
        Some(range.as_ref().map_err(String::as_str))
    }

    /// Whether a motion with its coefficients is beyond the trials that these were fitted to.
    pub fn extrapolation(&self, problem: &Problem) -> Extrapolation {
        match self.measured_range() {
            None => Extrapolation::blank(),
            Some(Ok(range)) => range.extrapolation(problem),
            Some(Err(why)) => {
                Extrapolation { extrapolated: None, beyond_trials: format!("not known: {why}") }
            }
        }
    }

    /// Adds to its answers how far their metrics may be off by what the coefficients may be, or why
    /// that is not known; `fits` were read with bands.
    pub fn add_bands(&self, answers: &mut [&mut Answer], from_rest: bool, fits: &KnownFits) {
        let Some(fitted) = &self.fitted else { return };
        let given = fitted.with_bands(self, &fits.data, |bands| {
            answers.par_iter_mut().for_each(|answer| {
                let interval = self.interval(answer.omega_rad_s, from_rest, bands);
                answer.interval = Some(interval);
            });
        });
        if let Err(why) = given {
            for answer in answers {
                answer.interval = Some(Interval::unknown(why.clone()));
            }
        }
    }

    /// The robots that may be the true one as well, by `most` replicates at most; `fits` were read
    /// with bands.
    ///
    /// # Errors
    /// They are not known.
    pub fn alternatives(&self, fits: &KnownFits, most: usize) -> Result<Alternatives, NoInterval> {
        let fitted = self.fitted.as_ref().ok_or(NoIntervalReason::NotFitted)?;
        fitted.with_bands(self, &fits.data, |bands| bands.alternatives(&self.robot, most))
    }

    /// How the metrics of its motions answer to every number that they depend on, and what the
    /// uncertainty of each contributes; that of fitted coefficients where `fits` were read with bands.
    ///
    /// # Errors
    /// The work was cancelled.
    pub fn sensitivities(
        &self,
        omegas_rad_s: &[f64],
        from_rest: bool,
        fits: Option<&KnownFits>,
        cancel: &CancelToken,
    ) -> Result<Sensitivities, Cancelled> {
        let known = fits.zip(self.fitted.as_ref()).map(|(fits, fitted)| {
            let problem = self.problem(omegas_rad_s.first().copied().unwrap_or(1.0));
            fitted.with_bands(self, &fits.data, |bands| {
                Uncertain::fitted(bands, &problem, fitted.measured())
            })
        });
        let (uncertain, unknown) = match known {
            Some(Ok(uncertain)) => (uncertain, None),
            Some(Err(why)) => (self.uncertain.clone(), Some(why)),
            None => (self.uncertain.clone(), None),
        };
        let of = |&omega_rad_s: &f64| {
            cancel.check()?;
            Ok((omega_rad_s, sensitivity::of(self, omega_rad_s, from_rest, &uncertain)))
        };
        let motions =
            omegas_rad_s.par_iter().with_max_len(1).map(of).collect::<Result<_, Cancelled>>()?;
        Ok(Sensitivities { motions, unknown })
    }

    fn interval(&self, omega_rad_s: f64, from_rest: bool, bands: &PredictionBands) -> Interval {
        let problem = self.problem(omega_rad_s);
        let limits = answer::solved(&problem, from_rest)
            .and_then(|(solver, motion)| bands.limits(solver, &problem, motion.metrics));
        match limits {
            Ok([lower, upper]) => Interval { lower, upper, no_interval: None },
            Err(error) => Interval::unknown(without_resample(&error)),
        }
    }

    /// One steady cycle of an answer's motion at `samples + 1` moments, or with `from_rest` the
    /// cycles from rest until it is settled and one more.
    ///
    /// # Errors
    /// There is no such motion.
    pub fn trajectory(
        &self,
        answer: &Answer,
        from_rest: bool,
        samples: usize,
    ) -> Result<Vec<TrajectoryRow>, MotionError> {
        let problem = self.problem(answer.omega_rad_s);
        trajectory::of(&problem, answer, from_rest, samples)
    }
}

/// What a table of the configuration says.
fn keys_of(table: &impl serde::Serialize) -> Result<Map<String, Value>, SetupError> {
    match serde_json::to_value(table) {
        Ok(Value::Object(keys)) => Ok(keys),
        _ => Err("no keys".to_owned().into()),
    }
}

/// The laws of a model that does not need trials, of which a campaign's robot has what they need.
pub(crate) fn laws_of(config: &Config, campaign: &str, name: &str) -> Result<Laws, SetupError> {
    let model = Model::new(name);
    match config.model.get(&model) {
        Some(found) if found.is_of_trials() => Err(format!(
            "--model: {name} is driven by the measured gaits of trials; fit it with `trilink fit`"
        )
        .into()),
        Some(found) => {
            let robot = &config.campaign[campaign].robot;
            config.check_laws(Path::new("--model"), robot, model)?;
            Ok(found.laws())
        }
        None => {
            let needed = one_of(name, &config.model, "");
            Err(format!("--model: found `{name}`, needed {needed}").into())
        }
    }
}
