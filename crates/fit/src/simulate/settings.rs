//! Settings for a campaign's robot and gait from the option `--set`.

use std::collections::BTreeMap;
use std::path::Path;

use trilink_tables::config::{
    CommandConfig, Config, ConfigError, GaitConfig, RobotConfig, ThreeLinkRobot, did_you_mean,
    nearest, parse_toml,
};

use super::SetupError;

/// Returns the configuration with `key=value` settings applied to the robot and gait of a campaign.
pub(crate) fn with_settings(
    mut config: Config,
    campaign: &str,
    settings: &[String],
) -> Result<Config, SetupError> {
    let found = campaign_of(&config, campaign)?;
    let robot = config.robot.get_mut(&found.robot).and_then(RobotConfig::three_links_mut);
    let robot = robot.ok_or_else(|| "no such robot of three links".to_owned())?;
    let gait = config.gait.get_mut(&found.gait).ok_or_else(|| "no such gait".to_owned())?;
    for setting in settings.iter().flat_map(|setting| setting.split_whitespace()) {
        let (key, value) = setting
            .split_once('=')
            .ok_or_else(|| format!("--set: found `{setting}`, needed KEY=VALUE"))?;
        if key == "omega_rad_s" {
            return Err(format!(
                "--set {setting}: set the frequency with the option --omega instead"
            )
            .into());
        }
        let is_set = set_gait(gait, key, value)
            .map_err(|needed| format!("--set {setting}: {needed} (gait `{}`)", found.gait))?;
        if !is_set {
            *robot = with_robot_setting(robot, key, value)
                .map_err(|error| setting_error(setting, key, gait, error))?;
        }
    }
    config.check_setup(Path::new("--set"), campaign)?;
    Ok(config)
}

/// Returns the campaign with the given name.
///
/// # Errors
/// Returns an error that lists the known names if there is no such campaign.
pub fn campaign_of(
    config: &Config,
    campaign: &str,
) -> Result<trilink_tables::config::Campaign, SetupError> {
    config.campaign.get(campaign).cloned().ok_or_else(|| {
        let names: Vec<&str> = config.campaign.keys().map(String::as_str).collect();
        let hint = did_you_mean(campaign, names.iter().copied());
        let known = names.join("`, `");
        format!("found campaign `{campaign}`, needed one of `{known}`{hint}").into()
    })
}

type JointNumber = (&'static str, fn(&mut CommandConfig) -> &mut f64);

/// Names of the parameters of a joint's command, with accessors for their values.
const JOINT_NUMBERS: [JointNumber; 5] = [
    ("offset", |joint| joint.offset_deg.get_or_insert(0.0)),
    ("amplitude", |joint| joint.amplitude_deg.get_or_insert(0.0)),
    ("phase", |joint| joint.phase_deg.get_or_insert(0.0)),
    ("second_amplitude", |joint| joint.amplitude2_deg.get_or_insert(0.0)),
    ("second_phase", |joint| joint.phase2_deg.get_or_insert(0.0)),
];

/// Sets a parameter of a joint's command, such as `offset1_deg`; returns whether the key names such a parameter.
fn set_gait(gait: &mut GaitConfig, key: &str, value: &str) -> Result<bool, String> {
    for (joint, command) in [(1, &mut gait.joint1), (2, &mut gait.joint2)] {
        for (name, number) in JOINT_NUMBERS {
            if key != format!("{name}{joint}_deg") {
                continue;
            }
            let command = command.as_mut().ok_or_else(|| {
                format!("found a value for joint {joint}, which is passive and has no command")
            })?;
            let parsed = value.parse();
            *number(command) =
                parsed.map_err(|_| format!("found `{value}`, needed a number (in degrees)"))?;
            return Ok(true);
        }
    }
    Ok(false)
}

/// Returns the keys for the parameters of a gait's commanded joints.
fn gait_keys(gait: &GaitConfig) -> Vec<String> {
    let joints = [(1, &gait.joint1), (2, &gait.joint2)];
    let commanded = joints.into_iter().filter(|(_, command)| command.is_some());
    commanded
        .flat_map(|(joint, _)| JOINT_NUMBERS.map(|(name, _)| format!("{name}{joint}_deg")))
        .collect()
}

/// Returns the robot with one parameter, or one key of its configuration, set to a value.
fn with_robot_setting(
    robot: &ThreeLinkRobot,
    key: &str,
    value: &str,
) -> Result<ThreeLinkRobot, ConfigError> {
    let source = Path::new("--set");
    let value = if value.contains(',') { format!("[{value}]") } else { value.to_owned() };
    if robot.with(key, 0.0).is_some() {
        let number: BTreeMap<String, f64> = parse_toml(source, &format!("{key} = {value}\n"))?;
        let changed = number.get(key).and_then(|number| robot.with(key, *number));
        return Ok(changed.unwrap_or_else(|| robot.clone()));
    }
    let mut keys = toml::Table::try_from(robot).expect("a configuration can be serialised");
    keys.extend(parse_toml::<toml::Table>(source, &format!("{key} = {value}\n"))?);
    let changed: RobotConfig = parse_toml(source, &keys.to_string())?;
    Ok(changed.three_links().unwrap_or(robot).clone())
}

/// Returns the names of all scalar quantities of a robot and a gait, which include the index of the link, wheel or
/// joint. These are the quantities of `simulate --sensitivities` except the frequency.
pub(super) fn number_names(robot: &ThreeLinkRobot, gait: &GaitConfig) -> Vec<String> {
    robot.names().into_iter().chain(gait_keys(gait)).collect()
}

/// Returns the robot and the gait with one of the quantities listed by [`number_names`] set to `value`; `None` if the
/// name is unknown.
pub(super) fn with_number(
    robot: &ThreeLinkRobot,
    gait: &GaitConfig,
    name: &str,
    value: f64,
) -> Option<(ThreeLinkRobot, GaitConfig)> {
    let mut changed = gait.clone();
    match set_gait(&mut changed, name, &value.to_string()) {
        Ok(true) => Some((robot.clone(), changed)),
        Ok(false) => Some((robot.with(name, value)?, changed)),
        Err(_) => None,
    }
}

/// Returns the error message for a setting, without the line number that refers to a configuration file.
fn setting_error(setting: &str, key: &str, gait: &GaitConfig, error: ConfigError) -> String {
    match error {
        ConfigError::Syntax { message, suggestion, .. } if message.starts_with("unknown ") => {
            let gait_keys = gait_keys(gait);
            let names = suggestion.iter().chain(&gait_keys).map(String::as_str);
            let hint = nearest(key, names)
                .map_or(String::new(), |name| format!("; did you mean `{name}`?"));
            format!(
                "--set {setting}: {message}, or one of the keys of the gait, `{}`{hint}",
                gait_keys.join("`, `")
            )
        }
        ConfigError::Syntax { message, suggestion, .. } => {
            let hint = suggestion.map_or(String::new(), |name| format!("; did you mean `{name}`?"));
            format!("--set {setting}: {message}{hint}")
        }
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use trilink_robot::{Gait, Quantity};

    use super::*;

    /// Returns the campaigns of the paper, with the optional parameters set for one robot and one gait.
    fn config() -> Config {
        let mut config = Config::default();
        let robot = config
            .robot
            .get_mut("kinematic")
            .and_then(RobotConfig::three_links_mut)
            .expect("the paper's");
        robot.set_load_n([8.0, 3.0, 7.0]);
        robot.set(Quantity::SkidStatic, [0.3, 0.2, 0.1]);
        robot.set(Quantity::Stribeck, [0.02]);
        robot.set(Quantity::RollDry, [0.01, 0.02, 0.03]);
        let gait = config.gait.get_mut("skewed").expect("the paper's");
        let joint = gait.joint2.as_mut().expect("commanded");
        joint.amplitude2_deg = Some(5.0);
        joint.phase2_deg = Some(20.0);
        config
    }

    #[test]
    fn every_number_of_a_robot_and_a_gait_can_be_changed_and_nothing_else() {
        let config = config();
        for campaign in config.campaign.values() {
            let robot = config.robot[&campaign.robot].three_links().expect("the paper's");
            let gait = &config.gait[&campaign.gait];
            let known = number_names(robot, gait);
            for name in
                ["h_m", "mass0_kg", "inertia2_kg_m2", "skid1_kg_s", "roll_sum_kg_s", "offset2_deg"]
            {
                assert!(known.iter().any(|known| known == name), "{name}: {known:?}");
            }
            for name in &known {
                let changed = with_number(robot, gait, name, 0.1234).expect(name);
                assert_ne!(changed, (robot.clone(), gait.clone()), "{name}");
                assert_eq!(with_number(robot, gait, name, 0.1234), Some(changed));
            }
            for name in ["skid_kg_s", "mass3_kg", "omega_rad_s", "standard_deviation", "offset_deg"]
            {
                assert_eq!(with_number(robot, gait, name, 1.0), None, "{name}");
            }
        }
        let robot = config.robot["semi-passive"].three_links().expect("the paper's");
        let gait = &config.gait["passive-symmetric"];
        assert_eq!(gait.to_gait(), Gait::passive_symmetric());
        assert_eq!(with_number(robot, gait, "offset1_deg", 1.0), None);
    }

    #[test]
    fn a_setting_is_in_the_unit_of_its_name() {
        let set = |setting: &str| {
            let settings = [setting.to_owned()];
            let config = with_settings(config(), "kinematic-symmetric", &settings).expect(setting);
            config.robot["kinematic"].three_links().expect("the paper's").clone()
        };
        let robot = |setting: &str| set(setting).to_robot();
        assert_eq!(robot("mass0_kg=1.05").mass_kg[0], 1.05);
        assert_eq!(robot("inertia2_kg_m2=6e-4").inertia_kg_m2[2], 6e-4);
        assert_eq!(robot("skid1=40").skid_kg_s, robot("skid1_kg_s=40").skid_kg_s);
        assert_eq!(robot("roll=2.4").roll_kg_s, [1.2, 0.6, 0.6]);
        assert_eq!(robot("roll_sum_kg_s=2.4").roll_kg_s, [1.2, 0.6, 0.6]);
        // In newtons, which is possible because the load is known; the other wheels keep their values.
        assert_eq!(robot("skid_dry1_n=1.5").skid_dry_n[1], 1.5);
        let known = config().robot["kinematic"].three_links().expect("the paper's").clone();
        let changed = set("skid_dry1_n=1.5");
        let others = |of: &ThreeLinkRobot| of.get(Quantity::SkidDry).map(|dry| [dry[0], dry[2]]);
        assert_eq!(others(&changed), others(&known));
        assert_eq!(changed.get(Quantity::RollDry), known.get(Quantity::RollDry));
        // The key for all wheels is relative to the load.
        let relative = set("skid_dry_n=0.1,0.2,0.3");
        assert_eq!(relative.get(Quantity::SkidDry), Some(&[0.1, 0.2, 0.3][..]));
    }

    #[test]
    fn a_list_for_a_number_and_the_frequency_are_refused() {
        for (setting, named) in [
            ("mass0_kg=1,2", "found a list of length 2, needed a number"),
            ("skid0_kg_s=1,2,3", "found a list of length 3, needed a number"),
            ("skid_kg_s=1,2,3,4", "found a list of length 4, needed a list of length 3"),
            ("mass3_kg=1", "mass3_kg"),
            ("mass0_kg=-1", "found -1"),
            ("omega_rad_s=3", "--omega"),
        ] {
            let settings = [setting.to_owned()];
            let found = with_settings(config(), "kinematic-symmetric", &settings);
            let message = found.expect_err(setting).to_string();
            assert!(message.contains(named) && message.contains("--set"), "{setting}: {message}");
        }
    }
}
