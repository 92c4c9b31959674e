//! Simulation of configured campaigns without trials, for `trilink simulate` and the Python module.

mod answer;
mod chain;
mod fitted;
mod sensitivity;
mod settings;
mod trajectory;

use std::path::Path;

use rayon::prelude::*;
use serde_json::{Map, Value};
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_mechanics::{MotionError, Problem, Sample};
use trilink_robot::{AnyGait, AnyRobot, Joint, Laws, Model};
use trilink_tables::config::{
    Config, ConfigError, GaitConfig, RobotConfig, ThreeLinkRobot, one_of,
};
use trilink_tables::{
    Columns as _, Extrapolation, NoInterval, NoIntervalReason, SENSITIVE_METRICS, SensitivityRow,
};

use crate::bands::without_resample;
use crate::{Alternatives, MeasuredRange, PredictionBands};

pub use answer::{Answer, Interval, SimulationRow};
use fitted::FittedSetup;
pub use fitted::starting_values;
pub use fitted::{FitSummary, KnownFits};
pub use sensitivity::Draws;
use sensitivity::{InputUncertainty, Motion};
pub use settings::campaign_of;
use settings::with_settings;
use settings::{number_names, with_number};
pub use trajectory::trajectories;

/// Reason why a campaign cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SetupError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A table of the fits is missing or cannot be read.
    #[error("{0}")]
    Table(String),
    /// Any other reason, such as an unknown name of a campaign, model or parameter, as a message.
    #[error("{0}")]
    Other(String),
}

impl From<String> for SetupError {
    fn from(message: String) -> Self {
        Self::Other(message)
    }
}

/// Sensitivities of the metrics of a [`Setup`].
#[derive(Debug)]
pub struct Sensitivities {
    /// Frequencies, rad/s, each with its sensitivities, or with the reason why the model has no periodic solution.
    pub motions: Vec<(f64, Result<Vec<SensitivityRow>, MotionError>)>,
    /// Reason why the uncertainty of the fitted coefficients is unknown; `None` if it is known or not applicable.
    pub unknown: Option<NoInterval>,
}

/// Robot and gait of a campaign with the friction laws of a model.
#[derive(Debug, Clone)]
pub struct Setup {
    pub robot: AnyRobot,
    pub gait: AnyGait,
    pub laws: Laws,
    pub model: Model,
    /// Configuration of the robot and the gait, if the robot has the short form for three links.
    short_form: Option<(ThreeLinkRobot, GaitConfig)>,
    /// Keys and values of the robot in the configuration, as shown in answers.
    parameters: Map<String, Value>,
    /// Keys and values of the gait in the configuration, as shown in answers.
    commands: Map<String, Value>,
    /// Uncertainty of the robot's parameters according to the configuration.
    uncertainty: InputUncertainty,
    /// Fit that provides the coefficients; `None` for configured coefficients.
    fitted: Option<FittedSetup>,
}

impl Setup {
    /// Sets up a campaign of `config`, with fitted coefficients if there are `fits`, and then with changes to its robot
    /// and gait: `settings` are `key=value` strings as for `trilink simulate --set`.
    ///
    /// # Errors
    /// Returns an error if the campaign, model or parameter does not exist, if the robot lacks a parameter that the model
    /// needs, or if the model has not been fitted to the campaign.
    pub fn new(
        config: Config,
        campaign: &str,
        model: &str,
        settings: &[String],
        fits: Option<&KnownFits>,
    ) -> Result<Self, SetupError> {
        if let Some(chain) = config.chain_setup(campaign) {
            return Self::of_chain(&config, (campaign, chain), model, settings, fits);
        }
        let Some(fits) = fits else {
            let config = with_settings(config, campaign, settings)?;
            return Self::of_three_links(&config, campaign, model);
        };
        // Build the configured setup first, because its errors about unknown names are more helpful.
        let configured = with_settings(config.clone(), campaign, &[])?;
        let configured = Self::of_three_links(&configured, campaign, model)?;
        let fitted = FittedSetup::new(&config, campaign, configured.model, fits)?;
        let config = with_settings(fitted.apply_to(config, campaign)?, campaign, settings)?;
        Ok(Self { fitted: Some(fitted), ..Self::of_three_links(&config, campaign, model)? })
    }

    fn of_three_links(config: &Config, campaign: &str, model: &str) -> Result<Self, SetupError> {
        let setup = config.campaign_setup(campaign);
        let (robot, gait) = setup.ok_or_else(|| "no such campaign".to_owned())?;
        let laws = laws_of(config, campaign, model)?;
        let names = &config.campaign[campaign];
        let robot_config = config.robot[&names.robot].three_links().cloned();
        let robot_config = robot_config.ok_or_else(|| "no robot of three links".to_owned())?;
        let mut gait_config = config.gait[&names.gait].clone();
        for command in gait_config.joints_mut().into_iter().flatten() {
            command.offset_deg.get_or_insert(0.0);
            command.phase_deg.get_or_insert(0.0);
        }
        Ok(Self {
            robot: robot.into(),
            gait: gait.into(),
            laws,
            model: Model::new(model),
            parameters: keys_of(&robot_config)?,
            commands: keys_of(&gait_config)?,
            uncertainty: InputUncertainty::configured(&robot_config, laws, &gait),
            short_form: Some((robot_config, gait_config)),
            fitted: None,
        })
    }

    /// Returns the names of all numbers of the robot and its gait that [`Setup::with_number`] can change: of three links,
    /// the quantities of `simulate --sensitivities` except the frequency.
    pub fn number_names(&self) -> Vec<String> {
        match (&self.short_form, &self.robot) {
            (Some((robot, gait)), _) => number_names(robot, gait),
            (None, robot) => robot.as_chain().map(chain::number_names).unwrap_or_default(),
        }
    }

    /// Returns the setup with a number set to a value in the unit of its name; `None` if the name is unknown. Its answers
    /// still show the keys and values of the configuration.
    pub fn with_number(&self, name: &str, value: f64) -> Option<Self> {
        let mut setup = self.clone();
        let Some((robot, gait)) = &self.short_form else {
            let AnyRobot::Chain(chain) = &mut setup.robot else { return None };
            chain::set_number(chain, name, value)?;
            setup.gait = chain.gait();
            return Some(setup);
        };
        let (robot, gait) = with_number(robot, gait, name, value)?;
        setup.robot = robot.to_robot().into();
        setup.gait = gait.to_gait().into();
        setup.short_form = Some((robot, gait));
        Some(setup)
    }

    /// Checks the robot and the gait of a campaign after a change by [`Setup::with_number`]; errors begin with the option
    /// that made the change.
    ///
    /// # Errors
    /// Returns an error if a value is not one that the robot or the gait can have.
    pub fn check(&self, config: &Config, campaign: &str, option: &str) -> Result<(), SetupError> {
        if let Some(chain) = self.robot.as_chain() {
            return Ok(chain.check().map_err(|error| format!("{option}: {error}"))?);
        }
        let (Some((robot, gait)), Some(names)) = (&self.short_form, config.campaign.get(campaign))
        else {
            return Ok(());
        };
        let mut config = config.clone();
        config.robot.insert(names.robot.clone(), RobotConfig::ThreeLinks(robot.clone()));
        config.gait.insert(names.gait.clone(), gait.clone());
        Ok(config.check(Path::new(option))?)
    }

    /// Returns the problem to solve at a frequency.
    pub fn problem(&self, omega_rad_s: f64) -> Problem {
        Problem::new(self.robot.clone(), self.gait, self.laws, omega_rad_s)
    }

    /// Solves for the steady-state motion at a frequency or, if `from_rest` or if Newton's method finds none, for the
    /// attractor reached from rest.
    pub fn answer(&self, omega_rad_s: f64, from_rest: bool) -> Answer<'_> {
        Answer::new(self, &self.problem(omega_rad_s), from_rest)
    }

    /// Returns the keys and values of the gait in the configuration.
    pub fn configured_gait(&self) -> &Map<String, Value> {
        &self.commands
    }

    /// Returns the summary of the fit that provides the coefficients; `None` for configured coefficients.
    pub fn fit(&self) -> Option<&FitSummary> {
        self.fitted.as_ref().map(|fitted| &fitted.summary)
    }

    /// Returns the range covered by the fitted trials, or the reason why it is unknown; `None` for configured
    /// coefficients.
    pub fn measured_range(&self) -> Option<Result<&MeasuredRange, &str>> {
        self.fitted.as_ref().map(FittedSetup::range)
    }

    /// Returns whether a problem lies outside the range of the fitted trials; blank for configured coefficients.
    pub fn extrapolation(&self, problem: &Problem) -> Extrapolation {
        let extrapolation = |fitted: &FittedSetup| fitted.extrapolation(problem);
        self.fitted.as_ref().map_or_else(Extrapolation::blank, extrapolation)
    }

    /// Adds confidence limits of the metrics, or the reason why there are none, to answers that this setup computed
    /// with the same `from_rest`; does nothing for configured coefficients. `fits` must come from [`KnownFits::read`]
    /// with `bands`.
    pub fn add_bands(&self, answers: &mut [Answer], from_rest: bool, fits: &KnownFits) {
        let Some(fitted) = &self.fitted else { return };
        let result = fitted.with_bands(&self.robot, &fits.data, |bands| {
            answers.par_iter_mut().for_each(|answer| {
                let interval = self.interval(answer.omega_rad_s, from_rest, bands);
                answer.interval = Some(interval);
            });
        });
        if let Err(reason) = result {
            for answer in answers {
                answer.interval = Some(Interval::unknown(reason.clone()));
            }
        }
    }

    /// Computes the sensitivities of the metrics to all quantities that influence them, and the uncertainty budgets.
    /// The budgets include fitted coefficients only if `fits` are given, which must come from [`KnownFits::read`] with
    /// `bands`. With `draws`, the uncertainties are also propagated by a Monte Carlo method.
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
        let first = self.problem(omegas_rad_s.first().copied().unwrap_or(1.0));
        let (uncertainty, unknown) = self.uncertainty_of(&first, fits);
        let metrics = self.sensitivity_metrics();
        let motions = omegas_rad_s.par_iter().with_max_len(1).map(|&omega_rad_s| {
            cancel.check()?;
            let problem = self.problem(omega_rad_s);
            let extrapolation = self.extrapolation(&problem);
            let motion =
                Motion { problem, model: self.model, metrics: metrics.clone(), extrapolation };
            let mut rows = motion.sensitivities(from_rest, &uncertainty);
            if let (Some(draws), Ok(rows)) = (draws, &mut rows)
                && let Ok((solver, _)) = answer::solve_motion(&motion.problem, from_rest)
            {
                let solve = |of: &Problem| motion.values_near(&solver, of);
                let of_motion = (&motion.problem, &motion.metrics[..]);
                sensitivity::add_monte_carlo(rows, of_motion, &solve, &uncertainty, draws, cancel)?;
            }
            Ok((omega_rad_s, rows))
        });
        Ok(Sensitivities { motions: motions.collect::<Result<_, Cancelled>>()?, unknown })
    }

    /// Returns the uncertainty of the quantities that influence the motions of a problem. With fitted coefficients it
    /// includes theirs; if that is unknown, returns the configured uncertainty and the reason.
    fn uncertainty_of(
        &self,
        problem: &Problem,
        fits: Option<&KnownFits>,
    ) -> (InputUncertainty, Option<NoInterval>) {
        let Some((fits, fitted)) = fits.zip(self.fitted.as_ref()) else {
            return (self.uncertainty.clone(), None);
        };
        let known = fitted.with_bands(&problem.robot, &fits.data, |bands| {
            InputUncertainty::fitted(bands, problem, fitted.measured())
        });
        match known {
            Ok(uncertainty) => (uncertainty, None),
            Err(reason) => (self.uncertainty.clone(), Some(reason)),
        }
    }

    fn interval(&self, omega_rad_s: f64, from_rest: bool, bands: &PredictionBands) -> Interval {
        let problem = self.problem(omega_rad_s);
        let limits = answer::solve_motion(&problem, from_rest)
            .and_then(|(solver, motion)| bands.limits(solver, &problem, motion.metrics));
        match limits {
            Ok([lower, upper]) => Interval { lower, upper, no_interval: None },
            Err(error) => Interval::unknown(without_resample(&error)),
        }
    }

    /// Returns the names of the columns of the metrics that sensitivities are given of, and of the work.
    fn sensitivity_metrics(&self) -> Vec<String> {
        let Some(chain) = self.robot.as_chain() else {
            return SENSITIVE_METRICS.map(str::to_owned).to_vec();
        };
        let mut names: Vec<String> = ["d_m", "v_m_s", "dtheta_rad"].map(str::to_owned).to_vec();
        for (number, link) in chain.numbering().into_iter().enumerate() {
            if self.laws.skids() && chain.links[link].wheel.is_some() {
                names.push(format!("sigma{number}"));
            }
        }
        for (i, joint) in chain.joints.iter().enumerate() {
            if matches!(joint, Joint::Free(_)) {
                names.push(format!("alpha{}_rad", i + 1));
            }
        }
        names.push("work_j".to_owned());
        names
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
        let fitted = self.fitted.as_ref().ok_or(NoIntervalReason::NotFitted)?;
        fitted.alternatives(&self.robot, &fits.data, max_replicates)
    }

    /// Samples one steady-state cycle of an answer at `samples + 1` times, or, if `from_rest`, all cycles from rest up
    /// to the steady state and one more; 50 cycles if that state is not reached.
    ///
    /// # Errors
    /// Returns an error if the model has no periodic solution or, if `from_rest`, no motion.
    pub fn trajectory(
        &self,
        answer: &Answer,
        from_rest: bool,
        samples: usize,
    ) -> Result<Vec<Sample>, MotionError> {
        let problem = self.problem(answer.omega_rad_s);
        trajectory::sample_motion(&problem, answer, from_rest, samples)
    }
}

/// Returns the keys and values of a configuration table.
fn keys_of(table: &impl serde::Serialize) -> Result<Map<String, Value>, SetupError> {
    // As TOML, in which keys without a value are left out.
    match toml::Table::try_from(table).map(serde_json::to_value) {
        Ok(Ok(Value::Object(keys))) => Ok(keys),
        _ => Err("the configuration cannot be converted to keys and values".to_owned().into()),
    }
}

/// Returns the friction laws of a model after checking that the campaign's robot has all parameters of these laws.
pub(crate) fn laws_of(config: &Config, campaign: &str, name: &str) -> Result<Laws, SetupError> {
    let laws = known_laws(config, name)?;
    let robot = &config.campaign[campaign].robot;
    config.check_laws(Path::new("--model"), robot, Model::new(name))?;
    Ok(laws)
}

/// Returns the friction laws of a model after checking that it is not driven by the measured gaits of trials.
fn known_laws(config: &Config, name: &str) -> Result<Laws, SetupError> {
    match config.model.get(&Model::new(name)) {
        Some(found) if found.is_of_trials() => Err(format!(
            "--model: {name} is driven by the measured gaits of trials, so only `trilink fit` can use it"
        )
        .into()),
        Some(found) => Ok(found.laws()),
        None => Err(unknown_model(config, name)),
    }
}

/// Returns the error for a model that is not in the configuration.
pub(crate) fn unknown_model(config: &Config, name: &str) -> SetupError {
    let needed = one_of(name, &config.model, "");
    format!("--model: found `{name}`, needed {needed}").into()
}
