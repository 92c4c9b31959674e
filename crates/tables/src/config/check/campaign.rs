//! Checks of campaigns and of the gaits of their robots.

use std::collections::BTreeMap;
use std::path::Path;

use toml::Value;
use trilink_robot::{Laws, Model, Quantity, Robot};

use super::super::{
    Campaign, ChainRobot, CommandConfig, Config, ConfigError, GaitConfig, JointKind, RobotConfig,
    did_you_mean, toml_key,
};
use super::{Checker, table_of};

/// Keys of a command that only angles have.
const ANGLE: [&str; 4] = ["offset_deg", "amplitude_deg", "amplitude2_deg", "phase2_deg"];

impl Config {
    /// Checks the robot and the gait of a campaign alone; the rest of the configuration must be valid. `path` is the file
    /// named in errors.
    pub fn check_setup(&self, path: &Path, campaign: &str) -> Result<(), ConfigError> {
        let check = Checker { path };
        let entry = check.entry(&self.campaign, &campaign.to_owned(), "campaign")?;
        let (robot, gait) = (&self.robot[&entry.robot], &self.gait[&entry.gait]);
        match robot {
            RobotConfig::ThreeLinks(of) => {
                check.numbers(&format!("robot.{}", entry.robot), &table_of(of).into())?;
            }
            RobotConfig::Chain(chain) => chain.check(&check, &entry.robot)?,
        }
        check.numbers(&format!("gait.{}", entry.gait), &table_of(gait).into())?;
        gait.check(&check, &entry.gait)?;
        self.check_commands(&check, campaign, entry)
    }

    pub(in super::super) fn check_campaign(
        &self,
        check: &Checker,
        name: &str,
        campaign: &Campaign,
    ) -> Result<(), ConfigError> {
        let key = |field: &str| format!("campaign.{name}.{field}");
        let Campaign { robot, gait, models, weights, free } = campaign;
        check.entry(&self.robot, robot, &key("robot"))?;
        check.entry(&self.gait, gait, &key("gait"))?;
        self.check_commands(check, name, campaign)?;
        let repeated = (0..models.len()).find(|&i| models[..i].contains(&models[i]));
        let repeated = repeated.map(|i| models[i].name());
        check.that(repeated.is_none(), &key("models"), &repeated, "each model once")?;
        let has_weight =
            [weights.d, weights.v, weights.sigma, weights.alpha].iter().any(|w| *w > 0.0);
        check.that(has_weight, &key("weights"), weights, "at least one weight above 0")?;
        for model in models {
            check.entry(&self.model, model, &key("models"))?;
            self.check_laws(check.path, robot, *model)?;
        }
        let setup = self.setup(name);
        for (model, free) in free {
            let key = key(&format!("free.{model}"));
            let known: Vec<&str> = models.iter().map(|model| model.name()).collect();
            let hint = did_you_mean(model.name(), known.iter().copied());
            let needed = format!("one of the campaign's models `{}`{hint}", known.join("`, `"));
            check.that(models.contains(model), &key, &model.name(), &needed)?;
            check.free(&key, *model, &self.model[model], &free.0, setup.as_ref())?;
        }
        Ok(())
    }

    /// Checks that the commands of a campaign's gait are those that the joints and rotors of its robot need.
    fn check_commands(
        &self,
        check: &Checker,
        campaign: &str,
        Campaign { robot: robot_name, gait: gait_name, .. }: &Campaign,
    ) -> Result<(), ConfigError> {
        let (robot, gait) = (&self.robot[robot_name], &self.gait[gait_name]);
        let of_campaign = format!("robot `{robot_name}` (campaign `{campaign}`)");
        // A joint of a robot of three links is driven or passive.
        let kinds: Vec<Option<JointKind>> = match robot {
            RobotConfig::ThreeLinks(_) => vec![None; Robot::JOINTS],
            RobotConfig::Chain(chain) => chain.joints.iter().map(|of| Some(of.kind)).collect(),
        };
        for (number, command) in (1..).zip(gait.joints()) {
            let key = format!("gait.{gait_name}.joint{number}");
            let Some(kind) = kinds.get(number - 1) else {
                let count = kinds.len();
                let needed = format!("no command, because {of_campaign} has {count} joints");
                check.that(command.is_none(), &key, &format_args!("a command"), &needed)?;
                continue;
            };
            let (needed, is_right) = match kind {
                None => (
                    "an angle, { amplitude_deg = .. }, or nothing for a passive joint",
                    !command.is_some_and(CommandConfig::is_torque),
                ),
                Some(JointKind::Spring) => ("no command", command.is_none()),
                Some(JointKind::Torque) => {
                    ("a torque, { torque_nm = .. }", command.is_some_and(CommandConfig::is_torque))
                }
                Some(JointKind::Driven | JointKind::Elastic) => (
                    "an angle, { amplitude_deg = .. }",
                    command.is_some_and(|command| !command.is_torque()),
                ),
            };
            let found = match command {
                None => "nothing",
                Some(command) if command.is_torque() => "a torque",
                Some(_) => "an angle",
            };
            let why = match kind {
                None => format!("{of_campaign} is described by h_m, l_m and b_m, not by links"),
                Some(kind) => format!("joint {number} of {of_campaign} has the kind \"{kind}\""),
            };
            let needed = format!("{needed}, because {why}");
            check.that(is_right, &key, &format_args!("{found}"), &needed)?;
        }
        if let Some(three_links) = robot.three_links()
            && gait.to_gait().passive_joint().is_some()
        {
            let needed = format!(
                "a value, because gait `{gait_name}` of campaign `{campaign}` leaves a joint passive"
            );
            for quantity in [Quantity::Stiffness, Quantity::Damping] {
                let key = format!("robot.{robot_name}.{}", quantity.name());
                let is_given = three_links.get(quantity).is_some();
                check.that(is_given, &key, &format_args!("nothing"), &needed)?;
            }
        }
        let rotors = robot.chain().map_or(BTreeMap::new(), ChainRobot::rotors);
        for link in gait.rotor.keys() {
            let key = format!("gait.{gait_name}.rotor.{}", toml_key(link));
            let needed = format!("none, because no link of {of_campaign} has rotor_inertia_kg_m2");
            check.that(!rotors.is_empty(), &key, &format_args!("a command"), &needed)?;
            check.entry(&rotors, link, &format!("gait.{gait_name}.rotor"))?;
        }
        for link in rotors.keys() {
            let key = format!("gait.{gait_name}.rotor.{}", toml_key(link));
            let needed = format!(
                "an angle, {{ amplitude_deg = .. }}, because link `{link}` of {of_campaign} has a rotor"
            );
            check.that(gait.rotor.contains_key(link), &key, &format_args!("nothing"), &needed)?;
        }
        Ok(())
    }

    /// Checks that a robot has the coefficients that a model's friction laws require. The robot and the model
    /// must exist in the configuration. `path` is the file named in errors.
    pub fn check_laws(&self, path: &Path, robot: &str, model: Model) -> Result<(), ConfigError> {
        let laws = self.model[&model].laws();
        let Laws { skid, roll } = laws;
        // By default a resistance is zero, which is not what a model with a law for that resistance means.
        let used = Quantity::ALL.into_iter();
        let used = used.filter(|of| of.definition().is_resistance && laws.is_used(*of));
        for quantity in used {
            let key = quantity.name();
            let needed = format!(
                "{key}, which model `{model}` (skid = \"{skid}\", roll = \"{roll}\") requires"
            );
            let missing = match &self.robot[robot] {
                RobotConfig::ThreeLinks(of) => {
                    of.get(quantity).is_none().then(|| format!("robot.{robot}.{key}"))
                }
                RobotConfig::Chain(chain) => chain.missing(robot, quantity),
            };
            if let Some(key) = missing {
                (Checker { path }).that(false, &key, &format_args!("nothing"), &needed)?;
            }
        }
        Ok(())
    }

    /// Checks, for each of `robots` and for each group that common wheels connect, that there are at least two campaigns
    /// and that all of them list a common model with a free parameter. The campaigns themselves must already have been
    /// checked.
    pub(in super::super) fn check_shared(
        &self,
        check: &Checker,
        robots: &[String],
    ) -> Result<(), ConfigError> {
        let key = "fit.shared.robot";
        check.that(!robots.is_empty(), key, &"an empty list", "at least one robot")?;
        let repeated = (0..robots.len()).any(|i| robots[..i].contains(&robots[i]));
        check.that(!repeated, key, &robots, "each robot once")?;
        for robot in robots {
            check.entry(&self.robot, robot, key)?;
        }
        let groups = self.connected(&robots.iter().collect::<Vec<_>>());
        for robot in robots {
            let is_grouped = groups.iter().any(|group| group.robots.contains(robot));
            let (campaigns, models) = self.common(std::slice::from_ref(robot));
            let found = match &campaigns[..] {
                [] => format!("{robot}, which has no campaign"),
                all => format!("{robot} with the campaigns {all:?}"),
            };
            let (least, needed) = match is_grouped {
                true => (1, "a robot with a campaign".to_owned()),
                false => (2, self.needed_to_share(robot, robots)),
            };
            check.that(campaigns.len() >= least, key, &found, &needed)?;
            let needed = "a robot whose campaigns all list the same model with a free parameter";
            check.that(!models.is_empty(), key, &found, needed)?;
        }
        for group in groups {
            let (campaigns, models) = self.common(&group.robots);
            let found =
                format!("{}, whose wheels connect the campaigns {campaigns:?}", group.name());
            let needed = "robots with common wheels whose campaigns all list the same model with a free parameter";
            check.that(!models.is_empty(), key, &found, needed)?;
        }
        Ok(())
    }

    /// Returns what a robot without a common wheel needs for a shared fit, with the name of a wheel of the other `robots`
    /// that may be meant.
    fn needed_to_share(&self, robot: &String, robots: &[String]) -> String {
        let chain = |robot| self.robot.get(robot).and_then(RobotConfig::chain);
        let wheels = |robot| chain(robot).into_iter().flat_map(ChainRobot::wheels);
        let others = robots.iter().filter(|other| *other != robot).flat_map(wheels);
        let others: Vec<&str> = others.map(String::as_str).collect();
        let mut hints = wheels(robot).map(|wheel| did_you_mean(wheel, others.iter().copied()));
        let hint = hints.find(|hint| !hint.is_empty()).unwrap_or_default();
        format!(
            "a robot with at least two campaigns, or with a wheel (`wheel` of a link) of the same name as one of another \
             robot in the list{hint}"
        )
    }
}

impl GaitConfig {
    pub(in super::super) fn check(&self, check: &Checker, gait: &str) -> Result<(), ConfigError> {
        let commands = (1..).zip(self.joints()).filter_map(|(number, command)| {
            Some((format!("gait.{gait}.joint{number}"), command?, true))
        });
        let rotors = self.rotor.iter();
        let rotors = rotors.map(|(link, command)| {
            (format!("gait.{gait}.rotor.{}", toml_key(link)), command, false)
        });
        let commands: Vec<_> = commands.chain(rotors).collect();
        let needed = "a command of at least one joint (joint1, joint2 and so on) or rotor";
        check.that(!commands.is_empty(), &format!("gait.{gait}"), &format_args!("none"), needed)?;
        for (key, command, may_be_torque) in &commands {
            let table = table_of(command);
            let found = |own: &str| table.get(own).map_or("nothing".to_owned(), Value::to_string);
            let that = |is_right, own: &str, needed| {
                check.that(
                    is_right,
                    &format!("{key}.{own}"),
                    &format_args!("{}", found(own)),
                    needed,
                )
            };
            if command.is_torque() && *may_be_torque {
                for angle in ANGLE {
                    let needed = "either torque_nm, mean_nm and phase_deg, or the keys of an angle";
                    that(!table.contains_key(angle), angle, needed)?;
                }
                continue;
            }
            for torque in ["torque_nm", "mean_nm"] {
                let needed = "no such key, because a rotor has an angle, not a torque";
                that(!table.contains_key(torque), torque, needed)?;
            }
            let needed = match *may_be_torque {
                true => "the amplitude of the angle (or torque_nm)",
                false => "the amplitude of the rotor's angle",
            };
            that(command.amplitude_deg.is_some(), "amplitude_deg", needed)?;
            let has_second = command.phase2_deg.is_none() || command.amplitude2_deg.is_some();
            that(has_second, "phase2_deg", "amplitude2_deg as well")?;
        }
        let varies = |(_, command, _): &(String, &CommandConfig, bool)| {
            !command.is_torque() || command.torque_nm.is_some_and(|torque_nm| torque_nm != 0.0)
        };
        let needed = "a commanded angle or a torque amplitude (torque_nm) other than 0, because a gait is periodic";
        let found = format_args!("constant torques alone");
        check.that(commands.iter().any(varies), &format!("gait.{gait}"), &found, needed)
    }
}
