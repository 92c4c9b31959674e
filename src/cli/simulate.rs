//! `trilink simulate`.

mod answer;
mod trajectory;

use std::path::PathBuf;

use rayon::prelude::*;

use super::omegas::{Omegas, parse_omegas};
use super::output::write_data;
use super::{Context, Failure, Outcome};
use crate::config::{Config, ConfigError, did_you_mean, one_of};
use crate::motion::Problem;
use crate::report::{SimulationError, simulation_page};
use crate::robot::{Laws, Model, Parameter};
use crate::store::write_if_changed;
use answer::Answer;

#[derive(clap::Args)]
pub(super) struct Simulate {
    /// Name of a `[campaign.*]`.
    campaign: String,
    /// Name of a `[model.*]`: no-skid, no-skid-damped, no-skid-roll, skid, skid-roll, coulomb, coulomb-viscous or your own.
    #[arg(long)]
    model: String,
    /// Frequencies, rad/s: `3.9,4`, or `0.5..6/12` for twelve from 0.5 to 6. May be given again.
    #[arg(long, required = true, allow_hyphen_values = true, value_parser = parse_omegas)]
    omega: Vec<Omegas>,
    /// Parameters of the robot: `skid_kg_s=104,34,45`, or of a wheel `skid_dry0=1.8`, one or several.
    #[arg(long, num_args = 1.., value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Answer with the motion in which the robot ends that starts from rest.
    #[arg(long)]
    from_rest: bool,
    /// Write one steady cycle, or with `--from-rest` the way there, as Parquet.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// Moments of a cycle that `--trajectory` writes.
    #[arg(long, default_value_t = 240, value_parser = clap::value_parser!(u32).range(8..=100_000))]
    samples: u32,
    /// Write a page that plays the motion from rest, with the forces at the wheels, at one frequency.
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Simulate {
    pub fn run(self, context: Context) -> Result<Outcome, Failure> {
        let config = with_settings(context.config, &self.campaign, &self.set)?;
        let (robot, gait) = config.campaign_setup(&self.campaign).ok_or("no such campaign")?;
        let laws = laws_of(&config, &self.campaign, &self.model)?;
        // As the answers show them.
        let parameters =
            serde_json::to_value(&config.robot[&config.campaign[&self.campaign].robot])?;
        let parameters = parameters.as_object().ok_or("no parameters")?;
        let omegas: Vec<f64> = self.omega.concat();
        if self.page.is_some() && omegas.len() != 1 {
            return Err(format!("--page: found {} frequencies, needed one", omegas.len()).into());
        }
        let problem = |omega_rad_s| Problem { robot: robot.clone(), gait, laws, omega_rad_s };
        let stage = context.progress.stage("simulate", omegas.len());
        let answers: Vec<Answer> = omegas
            .par_iter()
            .with_max_len(1)
            .map(|&omega_rad_s| {
                let answer = Answer::new(&problem(omega_rad_s), self.from_rest, parameters);
                stage.tick();
                stage.stop_if_asked("frequencies");
                answer
            })
            .collect();
        drop(stage);
        if let Some(path) = &self.trajectory {
            let problems = answers.iter().map(|answer| (problem(answer.omega_rad_s), answer));
            let samples = self.samples as usize;
            let message = trajectory::write(path, problems, self.from_rest, samples)?;
            context.progress.say(&message);
        }
        if let (Some(path), [answer]) = (&self.page, &answers[..]) {
            let problem = problem(answer.omega_rad_s);
            let names = (self.campaign.as_str(), &*self.model);
            let page = simulation_page(names, &problem, answer.cycles_to_settle, answer);
            let message = match page {
                Ok(page) => {
                    write_if_changed(path, page.as_bytes()).map(|_| path.display().to_string())?
                }
                Err(SimulationError::Motion(error)) => {
                    format!("{}: not written: {error}", path.display())
                }
                Err(error) => return Err(error.into()),
            };
            context.progress.say(&message);
        }
        if self.json {
            write_data(&serde_json::to_string_pretty(&answers)?);
        } else {
            answer::print_table(&answers);
        }
        let all_exist = answers.iter().all(|answer| answer.metrics.d_m.is_finite());
        Ok(if all_exist { Outcome::Well } else { Outcome::NeedsAttention })
    }
}

/// The laws of a model that does not need trials, of which a campaign's robot has what they need.
pub(super) fn laws_of(config: &Config, campaign: &str, name: &str) -> Result<Laws, Failure> {
    let model = Model::new(name);
    match config.model.get(&model) {
        Some(found) if found.is_of_trials() => Err(format!(
            "--model: {name} is driven by the measured gaits of trials; fit it with `trilink fit`"
        )
        .into()),
        Some(found) => {
            let robot = &config.campaign[campaign].robot;
            config.check_laws(std::path::Path::new("--model"), robot, model)?;
            Ok(found.laws())
        }
        None => {
            let needed = one_of(name, &config.model, "");
            Err(format!("--model: found `{name}`, needed {needed}").into())
        }
    }
}

/// The configuration with `key=value` settings in the campaign's robot.
pub(super) fn with_settings(
    mut config: Config,
    campaign: &str,
    settings: &[String],
) -> Result<Config, Failure> {
    let Some(found) = config.campaign.get(campaign) else {
        let names: Vec<&str> = config.campaign.keys().map(String::as_str).collect();
        let hint = did_you_mean(campaign, names.iter().copied());
        let known = names.join("`, `");
        return Err(format!("campaign `{campaign}`: needed one of `{known}`{hint}").into());
    };
    let robot = config.robot.get_mut(&found.robot).ok_or("no such robot")?;
    let mut lines = toml::to_string(robot)?;
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
        *robot = crate::config::parse_toml(std::path::Path::new("--set"), &lines)
            .map_err(|error| of_setting(setting, error))?;
    }
    config.check(std::path::Path::new("--set"))?;
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
