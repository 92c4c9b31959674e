//! `trilink simulate`.

use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Map, Value};

use super::omegas::{Omegas, parse_omegas};
use super::output::say;
use super::{Context, Failure, Outcome};
use crate::config::{Config, RobotConfig, nearest};
use crate::motion::{Model, Problem, REFERENCE_ACCURACY};

#[derive(clap::Args)]
pub(super) struct Simulate {
    /// Name of a `[campaign.*]`.
    campaign: String,
    /// no-skid, no-skid-damped, no-skid-roll, skid or skid-roll.
    #[arg(long, value_parser = parse_model)]
    model: Model,
    /// Frequencies, rad/s: `3.9,4`, or `0.5..6/12` for twelve from 0.5 to 6. May be given again.
    #[arg(long, required = true, allow_hyphen_values = true, value_parser = parse_omegas)]
    omega: Vec<Omegas>,
    /// Parameters of the robot: `skid_kg_s=104,34,45`, one or several.
    #[arg(long, num_args = 1.., value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// One frequency's answer; a motion that does not exist has no numbers but a reason.
#[derive(Serialize)]
struct Answer<'a> {
    omega_rad_s: f64,
    d_m: Option<f64>,
    v_m_s: Option<f64>,
    sigma: [Option<f64>; 3],
    alpha1_rad: Option<f64>,
    dtheta_rad: Option<f64>,
    status: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
    floquet: Option<f64>,
    parameters: &'a Map<String, Value>,
}

impl Simulate {
    pub fn run(self, context: Context) -> Result<Outcome, Failure> {
        let config = with_settings(context.config, &self.campaign, &self.set)?;
        let (robot, gait) = config.campaign_setup(&self.campaign).ok_or("no such campaign")?;
        if self.model == Model::NoSkidMeasured {
            return Err("--model: no-skid-measured is driven by the measured gaits of trials; \
                        fit it with `trilink fit`"
                .into());
        }
        let parameters = parameters(&config.robot[&config.campaign[&self.campaign].robot]);
        let omegas: Vec<f64> = self.omega.into_iter().flat_map(|omegas| omegas.0).collect();
        let answers: Vec<Answer> = omegas
            .into_par_iter()
            .map(|omega_rad_s| {
                let problem =
                    Problem { robot: robot.clone(), gait, model: self.model, omega_rad_s };
                answer(&problem, &parameters)
            })
            .collect();
        if self.json {
            say!("{}", serde_json::to_string_pretty(&answers)?);
        } else {
            print_table(&answers);
        }
        let all_exist = answers.iter().all(|answer| answer.d_m.is_some());
        Ok(if all_exist { Outcome::Well } else { Outcome::NeedsAttention })
    }
}

fn answer<'a>(problem: &Problem, parameters: &'a Map<String, Value>) -> Answer<'a> {
    let omega_rad_s = problem.omega_rad_s;
    match problem.solve(REFERENCE_ACCURACY) {
        Ok(motion) => Answer {
            omega_rad_s,
            d_m: Some(motion.metrics.d_m),
            v_m_s: Some(motion.metrics.v_m_s),
            sigma: motion.metrics.sigma.map(Some),
            alpha1_rad: Some(motion.metrics.alpha1_rad),
            dtheta_rad: Some(motion.metrics.dtheta_rad),
            status: motion.status(),
            reason: None,
            floquet: motion.floquet,
            parameters,
        },
        Err(error) => Answer {
            omega_rad_s,
            d_m: None,
            v_m_s: None,
            sigma: [None; 3],
            alpha1_rad: None,
            dtheta_rad: None,
            status: error.status(),
            reason: Some(error.to_string()),
            floquet: None,
            parameters,
        },
    }
}

fn print_table(answers: &[Answer]) {
    say!(
        "{:>11} {:>13} {:>13} {:>12} {:>12} {:>12} {:>12} {:>13}  status",
        "omega rad/s",
        "d mm",
        "v mm/s",
        "sigma0",
        "sigma1",
        "sigma2",
        "alpha1 deg",
        "dtheta deg"
    );
    for answer in answers {
        let Some(((d_m, v_m_s), (alpha1, dtheta))) =
            answer.d_m.zip(answer.v_m_s).zip(answer.alpha1_rad.zip(answer.dtheta_rad))
        else {
            let reason = answer.reason.as_deref().unwrap_or_default();
            say!("{:>11} {}: {reason}", answer.omega_rad_s, answer.status);
            continue;
        };
        let [sigma0, sigma1, sigma2] = answer.sigma.map(Option::unwrap_or_default);
        say!(
            "{:>11} {:>13.7} {:>13.7} {sigma0:>12.9} {sigma1:>12.9} {sigma2:>12.9} {:>12.8} {:>13.8}  {}",
            answer.omega_rad_s,
            1e3 * d_m,
            1e3 * v_m_s,
            alpha1.to_degrees(),
            // No minus before a rotation of nothing.
            dtheta.to_degrees() + 0.0,
            answer.status,
        );
    }
}

fn parse_model(text: &str) -> Result<Model, String> {
    let names = || Model::ALL.into_iter().map(Model::name);
    Model::ALL.into_iter().find(|model| model.name() == text).ok_or_else(|| {
        let hint = nearest(text, names())
            .map_or(String::new(), |name| format!("; did you mean `{name}`?"));
        format!("needed one of {}{hint}", names().collect::<Vec<_>>().join(", "))
    })
}

/// The configuration with `key=value` settings in the campaign's robot.
fn with_settings(
    mut config: Config,
    campaign: &str,
    settings: &[String],
) -> Result<Config, Failure> {
    let Some(found) = config.campaign.get(campaign) else {
        let names: Vec<&str> = config.campaign.keys().map(String::as_str).collect();
        let hint = nearest(campaign, names.iter().copied())
            .map_or(String::new(), |name| format!("; did you mean `{name}`?"));
        let known = names.join("`, `");
        return Err(format!("campaign `{campaign}`: needed one of `{known}`{hint}").into());
    };
    let robot = config.robot.get_mut(&found.robot).ok_or("no such robot")?;
    let mut lines = toml::to_string(robot)?;
    for setting in settings.iter().flat_map(|setting| setting.split_whitespace()) {
        let (key, value) = setting
            .split_once('=')
            .ok_or_else(|| format!("--set: found `{setting}`, needed KEY=VALUE"))?;
        let value = if value.contains(',') { format!("[{value}]") } else { value.to_owned() };
        let kept = lines.lines().filter(|line| !line.starts_with(&format!("{key} ")));
        lines = kept.map(|line| format!("{line}\n")).collect();
        lines += &format!("{key} = {value}\n");
        *robot = crate::config::parse_toml(std::path::Path::new("--set"), &lines)?;
    }
    config.check(std::path::Path::new("--set"))?;
    Ok(config)
}

/// The robot's parameters as the answer shows them.
fn parameters(robot: &RobotConfig) -> Map<String, Value> {
    match serde_json::to_value(robot) {
        Ok(Value::Object(parameters)) => parameters,
        _ => Map::new(),
    }
}
