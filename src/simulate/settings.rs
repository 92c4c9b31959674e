//! Settings of a campaign's robot and gait, as `--set` has them.

use std::path::Path;

use super::SetupError;
use crate::config::{
    Config, ConfigError, GaitConfig, JointConfig, RobotConfig, did_you_mean, nearest, parse_toml,
};
use crate::robot::Parameter;

/// The configuration with `key=value` settings in the campaign's robot and gait.
pub(crate) fn with_settings(
    mut config: Config,
    campaign: &str,
    settings: &[String],
) -> Result<Config, SetupError> {
    let found = campaign_of(&config, campaign)?;
    let robot = config.robot.get_mut(&found.robot).ok_or_else(|| "no such robot".to_owned())?;
    let gait = config.gait.get_mut(&found.gait).ok_or_else(|| "no such gait".to_owned())?;
    for setting in settings.iter().flat_map(|setting| setting.split_whitespace()) {
        let (key, value) = setting
            .split_once('=')
            .ok_or_else(|| format!("--set: found `{setting}`, needed KEY=VALUE"))?;
        let is_set = set_gait(gait, key, value)
            .map_err(|needed| format!("--set {setting}: {needed} in gait `{}`", found.gait))?;
        if !is_set {
            *robot = with_robot_setting(robot, key, value)
                .map_err(|error| of_setting(setting, key, gait, error))?;
        }
    }
    config.check_setup(Path::new("--set"), campaign)?;
    Ok(config)
}

/// A campaign of a configuration.
pub(crate) fn campaign_of(
    config: &Config,
    campaign: &str,
) -> Result<crate::config::Campaign, SetupError> {
    config.campaign.get(campaign).cloned().ok_or_else(|| {
        let names: Vec<&str> = config.campaign.keys().map(String::as_str).collect();
        let hint = did_you_mean(campaign, names.iter().copied());
        let known = names.join("`, `");
        format!("campaign `{campaign}`: needed one of `{known}`{hint}").into()
    })
}

type JointNumber = (&'static str, fn(&mut JointConfig) -> &mut f64);

/// The numbers of a joint's command.
const JOINT_NUMBERS: [JointNumber; 5] = [
    ("offset", |joint| &mut joint.offset_deg),
    ("amplitude", |joint| &mut joint.amplitude_deg),
    ("phase", |joint| &mut joint.phase_deg),
    ("second_amplitude", |joint| joint.amplitude2_deg.get_or_insert(0.0)),
    ("second_phase", |joint| joint.phase2_deg.get_or_insert(0.0)),
];

/// Gives a joint's number, such as `offset1_deg`, its value; whether there is such a key.
fn set_gait(gait: &mut GaitConfig, key: &str, value: &str) -> Result<bool, String> {
    for (joint, command) in [(1, &mut gait.joint1), (2, &mut gait.joint2)] {
        for (name, number) in JOINT_NUMBERS {
            if key != format!("{name}{joint}_deg") {
                continue;
            }
            let command = command.as_mut().ok_or_else(|| {
                format!("found a number of joint {joint}, which is passive and has no command")
            })?;
            let parsed = value.parse();
            *number(command) =
                parsed.map_err(|_| format!("found `{value}`, needed a number of degrees"))?;
            return Ok(true);
        }
    }
    Ok(false)
}

/// The keys of a gait's commanded joints.
fn gait_keys(gait: &GaitConfig) -> Vec<String> {
    let joints = [(1, &gait.joint1), (2, &gait.joint2)];
    let commanded = joints.into_iter().filter(|(_, command)| command.is_some());
    commanded
        .flat_map(|(joint, _)| JOINT_NUMBERS.map(|(name, _)| format!("{name}{joint}_deg")))
        .collect()
}

fn with_robot_setting(
    robot: &RobotConfig,
    key: &str,
    value: &str,
) -> Result<RobotConfig, ConfigError> {
    let place = Path::new("--set");
    let mut keys = toml::Table::try_from(robot).expect("a configuration is plain data");
    let (key, value) =
        of_wheel(key, value, &keys).unwrap_or_else(|| (key.to_owned(), value.to_owned()));
    let value = if value.contains(',') { format!("[{value}]") } else { value };
    keys.extend(parse_toml::<toml::Table>(place, &format!("{key} = {value}\n"))?);
    parse_toml(place, &keys.to_string())
}

/// The robot's key that has a parameter, and its value: `skid_dry0=2` is the first of `skid_dry_n`
/// among these keys.
fn of_wheel(name: &str, value: &str, robot: &toml::Table) -> Option<(String, String)> {
    let known = Parameter::ALL.into_iter().find(|of| [of.key(), of.name()].contains(&name))?;
    let Some((before, after)) = known.name().split_once(|c: char| c.is_ascii_digit()) else {
        return Some((known.name().to_owned(), value.to_owned()));
    };
    let wheel: usize = known.name()[before.len()..].chars().next()?.to_digit(10)? as usize;
    let key = format!("{before}{after}");
    let mut values: Vec<String> =
        robot.get(&key)?.as_array()?.iter().map(toml::Value::to_string).collect();
    *values.get_mut(wheel)? = value.to_owned();
    Some((key, values.join(",")))
}

/// What is wrong with a setting, which has no lines.
fn of_setting(setting: &str, key: &str, gait: &GaitConfig, error: ConfigError) -> String {
    match error {
        ConfigError::Syntax { message, suggestion, .. } if message.starts_with("unknown ") => {
            let of_gait = gait_keys(gait);
            let names = suggestion.iter().chain(&of_gait).map(String::as_str);
            let hint = nearest(key, names)
                .map_or(String::new(), |name| format!("; did you mean `{name}`?"));
            format!("--set {setting}: {message}, or of the gait `{}`{hint}", of_gait.join("`, `"))
        }
        ConfigError::Syntax { message, suggestion, .. } => {
            let hint = suggestion.map_or(String::new(), |name| format!("; did you mean `{name}`?"));
            format!("--set {setting}: {message}{hint}")
        }
        other => other.to_string(),
    }
}
