//! The motion of a model by name, without trials: what `trilink simulate` answers, and the Python module.

mod answer;
mod settings;
mod trajectory;

use std::path::Path;

use serde_json::{Map, Value};

use crate::config::{Config, ConfigError, one_of};
use crate::motion::{MotionError, Problem};
use crate::robot::{Gait, Laws, Model, Robot};
use crate::store::TrajectoryRow;

pub use answer::{Answer, SimulationRow};
pub(crate) use settings::with_settings;

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

/// A campaign's robot and gait under the laws of a model.
#[derive(Debug, Clone)]
pub struct Setup {
    pub robot: Robot,
    pub gait: Gait,
    pub laws: Laws,
    pub model: Model,
    /// The robot's keys and the gait's, as the answers show them.
    parameters: Map<String, Value>,
    commands: Map<String, Value>,
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
        let config = with_settings(config, campaign, settings)?;
        let setup = config.campaign_setup(campaign);
        let (robot, gait) = setup.ok_or_else(|| "no such campaign".to_owned())?;
        let laws = laws_of(&config, campaign, model)?;
        let of = &config.campaign[campaign];
        let parameters = keys_of(&config.robot[&of.robot])?;
        let commands = keys_of(&config.gait[&of.gait])?;
        Ok(Self { robot, gait, laws, model: Model::new(model), parameters, commands })
    }

    /// Its problem at a frequency.
    pub fn problem(&self, omega_rad_s: f64) -> Problem {
        Problem { robot: self.robot.clone(), gait: self.gait, laws: self.laws, omega_rad_s }
    }

    /// Its motion at a frequency; with `from_rest` the one in which the robot from rest ends.
    pub fn answer(&self, omega_rad_s: f64, from_rest: bool) -> Answer<'_> {
        Answer::new(self, &self.problem(omega_rad_s), from_rest)
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
