//! The motion of a model by name, without trials: what `trilink simulate` answers, and the Python module.

mod answer;
mod trajectory;

use std::path::Path;

use serde_json::{Map, Value};

use crate::config::{Config, ConfigError, did_you_mean, one_of, parse_toml};
use crate::motion::{MotionError, Problem};
use crate::robot::{Gait, Laws, Model, Parameter, Robot};
use crate::store::TrajectoryRow;

pub use answer::Answer;

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
    /// The robot's, as the answers show them.
    parameters: Map<String, Value>,
}

impl Setup {
    /// Of a campaign of `config`, whose robot has what the `settings` say: each a `key=value` as
    /// `trilink simulate --set` takes it.
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
        let parameters = serde_json::to_value(&config.robot[&config.campaign[campaign].robot]);
        let Ok(Value::Object(parameters)) = parameters else {
            return Err("no parameters".to_owned().into());
        };
        Ok(Self { robot, gait, laws, parameters })
    }

    /// Its problem at a frequency.
    pub fn problem(&self, omega_rad_s: f64) -> Problem {
        Problem { robot: self.robot.clone(), gait: self.gait, laws: self.laws, omega_rad_s }
    }

    /// Its motion at a frequency; with `from_rest` the one in which the robot from rest ends.
    pub fn answer(&self, omega_rad_s: f64, from_rest: bool) -> Answer<'_> {
        Answer::new(&self.problem(omega_rad_s), from_rest, &self.parameters)
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
        trajectory::of(&self.problem(answer.omega_rad_s), answer, from_rest, samples)
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

/// The configuration with `key=value` settings in the campaign's robot.
pub(crate) fn with_settings(
    mut config: Config,
    campaign: &str,
    settings: &[String],
) -> Result<Config, SetupError> {
    let Some(found) = config.campaign.get(campaign) else {
        let names: Vec<&str> = config.campaign.keys().map(String::as_str).collect();
        let hint = did_you_mean(campaign, names.iter().copied());
        let known = names.join("`, `");
        return Err(format!("campaign `{campaign}`: needed one of `{known}`{hint}").into());
    };
    let robot = config.robot.get_mut(&found.robot).ok_or_else(|| "no such robot".to_owned())?;
    let mut lines = toml::to_string(robot).map_err(|error| error.to_string())?;
    for setting in settings.iter().flat_map(|setting| setting.split_whitespace()) {
        let (key, value) = setting
            .split_once('=')
            .ok_or_else(|| format!("--set: found `{setting}`, needed KEY=VALUE"))?;
        let (key, value) =
            of_wheel(key, value, &lines).unwrap_or_else(|| (key.to_owned(), value.to_owned()));
        let value = if value.contains(',') { format!("[{value}]") } else { value };
        let kept = lines.lines().filter(|line| !line.starts_with(&format!("{key} ")));
        lines = kept.map(|line| format!("{line}\n")).collect();
        lines += &format!("{key} = {value}\n");
        *robot =
            parse_toml(Path::new("--set"), &lines).map_err(|error| of_setting(setting, error))?;
    }
    config.check_setup(Path::new("--set"), campaign)?;
    Ok(config)
}

/// The robot's key that has a parameter, and its value: `skid_dry0=2` is the first of `skid_dry_n`
/// among these lines.
fn of_wheel(name: &str, value: &str, lines: &str) -> Option<(String, String)> {
    let known = Parameter::ALL.into_iter().find(|of| [of.key(), of.name()].contains(&name))?;
    let Some((before, after)) = known.name().split_once(|c: char| c.is_ascii_digit()) else {
        return Some((known.name().to_owned(), value.to_owned()));
    };
    let wheel: usize = known.name()[before.len()..].chars().next()?.to_digit(10)? as usize;
    let (key, robot) = (format!("{before}{after}"), lines.parse::<toml::Table>().ok()?);
    let mut values: Vec<String> =
        robot.get(&key)?.as_array()?.iter().map(toml::Value::to_string).collect();
    *values.get_mut(wheel)? = value.to_owned();
    Some((key, values.join(",")))
}

/// What is wrong with a setting, which has no lines.
fn of_setting(setting: &str, error: ConfigError) -> String {
    match error {
        ConfigError::Syntax { message, suggestion, .. } => {
            let hint = suggestion.map_or(String::new(), |name| format!("; did you mean `{name}`?"));
            format!("--set {setting}: {message}{hint}")
        }
        other => other.to_string(),
    }
}
