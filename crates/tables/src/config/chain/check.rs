//! Checks of the chains in a configuration.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use toml::{Table, Value};
use trilink_robot::{Chain, Laws, MAX_LINKS, Model, Per, Quantity};

use super::super::check::{Checker, NAME, is_valid_name};
use super::super::marker_layout::link_table;
use super::super::{Config, ConfigError, LinkMarkers, toml_key};
use super::{ChainCampaign, ChainGait, ChainJoint, ChainRobot, CommandConfig, JointKind};

/// Keys of a link for the friction of its wheel.
const FRICTION: [&str; 7] = [
    "skid_kg_s",
    "roll_kg_s",
    "skid_dry_n",
    "skid_static_n",
    "skid_power_n",
    "skid_exponent",
    "roll_dry_n",
];
/// Keys of a robot for the friction of all its wheels.
const FRICTION_OF_ROBOT: [&str; 2] = ["transition_m_s", "stribeck_m_s"];
/// Keys of a command that only angles have.
const ANGLE: [&str; 4] = ["offset_deg", "amplitude_deg", "amplitude2_deg", "phase2_deg"];

impl JointKind {
    /// Returns the keys that a joint of this kind can have.
    pub(super) fn keys(self) -> &'static [&'static str] {
        match self {
            Self::Driven => &[],
            Self::Elastic => &["stiffness_nm_rad", "damping_nm_s_rad"],
            Self::Spring | Self::Torque => &["stiffness_nm_rad", "damping_nm_s_rad", "rest_deg"],
        }
    }
}

pub(super) fn table_of(value: &impl Serialize) -> Table {
    Table::try_from(value).expect("the parts of a chain are tables")
}

/// Returns the table of a link or joint without its standard deviations.
pub(super) fn plain_table_of(part: &impl Serialize) -> Table {
    let mut table = table_of(part);
    ["standard_deviation", "same"].iter().for_each(|key| drop(table.remove(*key)));
    table
}

impl Config {
    /// Checks all chains with their gaits and campaigns.
    pub(in super::super) fn check_chains(&self, check: &Checker) -> Result<(), ConfigError> {
        self.chains.robot.iter().try_for_each(|(name, robot)| robot.check(check, name))?;
        self.check_same_wheels(check)?;
        self.chains.gait.iter().try_for_each(|(name, gait)| gait.check(check, name))?;
        for (name, campaign) in &self.chains.campaign {
            let ChainCampaign { robot, gait, models, weights, free } = campaign;
            let key = |field: &str| format!("campaign.{name}.{field}");
            if self.chain_gait(gait).is_none() {
                let own = self.gait.keys().chain(self.chains.gait.keys());
                let known: BTreeMap<&String, ()> = own.map(|name| (name, ())).collect();
                check.entry(&known, &gait, &key("gait"))?;
            }
            self.check_commands(check, name)?;
            for model in models {
                check.entry(&self.model, model, &key("models"))?;
                self.check_chain_laws(check.path, robot, *model)?;
            }
            if let Some(weights) = weights {
                check.numbers(&key("weights"), &Value::Table(table_of(weights)))?;
            }
            let setup = self.setup(name);
            for (model, free) in free {
                let key = key(&format!("free.{model}"));
                check.entry(&self.model, model, &key)?;
                check.free(&key, *model, &self.model[model], &free.0, setup.as_ref())?;
            }
        }
        Ok(())
    }

    /// Checks that wheels with the same name are on different robots and have the same coefficients.
    fn check_same_wheels(&self, check: &Checker) -> Result<(), ConfigError> {
        let mut known: BTreeMap<&String, (&String, &String, Table)> = BTreeMap::new();
        let robots = self.chains.robot.iter().map(|(name, robot)| (name, robot, robot.names()));
        let robots: Vec<_> = robots.collect();
        let links = robots.iter().flat_map(|(name, robot, names)| {
            names.iter().zip(&robot.links).map(move |(link, config)| (*name, *robot, link, config))
        });
        for (robot, config, link, own) in links {
            let Some(wheel) = &own.wheel else { continue };
            let key = link_key(robot, link, "wheel");
            check.that(is_valid_name(wheel), &key, wheel, NAME)?;
            let is_unique = config.wheels().filter(|other| *other == wheel).count() == 1;
            let needed = "a name that is unique within the robot, because each of its wheels has coefficients of its own";
            check.that(is_unique, &key, wheel, needed)?;
            let mut values = table_of(config);
            values.extend(plain_table_of(own));
            let Some((first, first_link, expected)) = known.get(wheel) else {
                known.insert(wheel, (robot, link, values));
                continue;
            };
            let same =
                format!("as on link `{first_link}` of robot `{first}`, which has the same wheel");
            let text = |value: Option<&Value>| value.map_or("nothing".to_owned(), Value::to_string);
            let of_link = FRICTION.map(|key| (key, link_key(robot, link, key)));
            let of_robot = FRICTION_OF_ROBOT.map(|key| (key, format!("robot.{robot}.{key}")));
            for (key, full) in of_link.into_iter().chain(of_robot) {
                let [found, expected] = [values.get(key), expected.get(key)];
                let needed = format!("{}, {same}", text(expected));
                check.that(found == expected, &full, &format_args!("{}", text(found)), &needed)?;
            }
            let [found, expected] = [&values, expected].map(|of| of.get("load_n"));
            let is_dry =
                FRICTION.iter().any(|key| key.ends_with("_n") && values.contains_key(*key));
            let is_right = found.is_some() == expected.is_some() || !is_dry;
            let full = link_key(robot, link, "load_n");
            let needed = format!(
                "a load either on both or on neither, {same}, because dry friction is given relative to it"
            );
            check.that(is_right, &full, &format_args!("{}", text(found)), &needed)?;
        }
        Ok(())
    }

    /// Checks the marker layouts of all chains.
    pub(in super::super) fn check_chain_markers(&self, check: &Checker) -> Result<(), ConfigError> {
        let robots = self.chains.robot.keys().chain(self.robot.keys());
        let known: BTreeMap<&String, ()> = robots.map(|name| (name, ())).collect();
        for (robot, layout) in &self.chains.layout {
            let table = format!("layout.{}", toml_key(robot));
            check.entry(&known, &robot, &table)?;
            let names = self.chains.robot[robot].names();
            let links: BTreeMap<&String, ()> = names.iter().map(|name| (name, ())).collect();
            layout.keys().try_for_each(|link| check.entry(&links, &link, &table).map(drop))?;
            let values = Value::try_from(layout).expect("a layout can be serialised");
            check.numbers(&table, &values)?;
            let none = LinkMarkers::default();
            let markers = names.iter().map(|name| &layout.get(name).unwrap_or(&none).0);
            let markers: Vec<&BTreeMap<String, [f64; 3]>> = markers.collect();
            let is_bare = |place: usize| {
                markers.get(place).is_none_or(|link: &&BTreeMap<_, _>| link.is_empty())
            };
            let mut with_markers = Vec::new();
            for (place, (name, link)) in names.iter().zip(&markers).enumerate() {
                let table = link_table(robot, name);
                if is_bare(place) {
                    let is_bridged = place > 0 && !is_bare(place - 1) && !is_bare(place + 1);
                    let needed = "2 to 64 markers, because only a link between two links with markers can have none";
                    check.that(is_bridged, &table, &format_args!("none"), needed)?;
                } else {
                    with_markers.push((table, *link));
                }
            }
            self.check_links(check, &with_markers)?;
        }
        Ok(())
    }

    /// Checks that the commands of the gait of a chain's campaign are those that the joints and rotors need.
    fn check_commands(&self, check: &Checker, campaign: &str) -> Result<(), ConfigError> {
        let ChainCampaign { robot: robot_name, gait: gait_name, .. } =
            &self.chains.campaign[campaign];
        let robot = &self.chains.robot[robot_name];
        let Some(gait) = self.chain_gait(gait_name) else { return Ok(()) };
        let of_robot = format!("of robot `{robot_name}` (campaign `{campaign}`)");
        for (number, command) in (1..).zip(gait.joints()) {
            let key = format!("gait.{gait_name}.joint{number}");
            let Some(joint) = robot.joints.get(number - 1) else {
                let needed = format!(
                    "no command, because the chain {of_robot} has {} joints",
                    robot.joints.len()
                );
                check.that(command.is_none(), &key, &format_args!("a command"), &needed)?;
                continue;
            };
            let kind = joint.kind;
            let (needed, is_right) = match joint.kind {
                JointKind::Spring => ("no command", command.is_none()),
                JointKind::Torque => {
                    ("a torque, { torque_nm = .. }", command.is_some_and(CommandConfig::is_torque))
                }
                JointKind::Driven | JointKind::Elastic => (
                    "an angle, { amplitude_deg = .. }",
                    command.is_some_and(|command| !command.is_torque()),
                ),
            };
            let found = match command {
                None => "nothing",
                Some(command) if command.is_torque() => "a torque",
                Some(_) => "an angle",
            };
            let needed =
                format!("{needed}, because joint {number} {of_robot} has the kind \"{kind}\"");
            check.that(is_right, &key, &format_args!("{found}"), &needed)?;
        }
        let rotors: BTreeMap<String, ()> = (robot.names().into_iter().zip(&robot.links))
            .filter(|(_, link)| link.rotor_inertia_kg_m2.is_some())
            .map(|(name, _)| (name, ()))
            .collect();
        for link in gait.rotor.keys() {
            let key = format!("gait.{gait_name}.rotor.{link}");
            let needed = format!("none, because no link {of_robot} has rotor_inertia_kg_m2");
            check.that(!rotors.is_empty(), &key, &format_args!("a command"), &needed)?;
            check.entry(&rotors, link, &format!("gait.{gait_name}.rotor"))?;
        }
        for link in rotors.keys() {
            let key = format!("gait.{gait_name}.rotor.{link}");
            let needed = format!(
                "an angle, {{ amplitude_deg = .. }}, because link `{link}` {of_robot} has a rotor"
            );
            check.that(gait.rotor.contains_key(link), &key, &format_args!("nothing"), &needed)?;
        }
        Ok(())
    }

    /// Checks that each wheel of a chain has the coefficients that a model's friction laws require. The chain and the
    /// model must exist in the configuration. `path` is the file named in errors.
    pub fn check_chain_laws(
        &self,
        path: &Path,
        robot: &str,
        model: Model,
    ) -> Result<(), ConfigError> {
        let laws = self.model[&model].laws();
        let Laws { skid, roll } = laws;
        let config = &self.chains.robot[robot];
        let used = Quantity::ALL
            .into_iter()
            .filter(|quantity| quantity.definition().is_resistance && laws.is_used(*quantity));
        for quantity in used {
            let key = quantity.name();
            let needed = format!(
                "{key}, which model `{model}` (skid = \"{skid}\", roll = \"{roll}\") requires"
            );
            let mut holders = vec![(format!("robot.{robot}.{key}"), table_of(config))];
            if quantity.definition().per == Per::Wheel {
                let links = config.names().into_iter().zip(&config.links);
                let wheels = links.filter(|(_, link)| link.wheel_m.is_some());
                let holder = |(name, link)| (link_key(robot, name, key), table_of(link));
                holders = wheels.map(holder).collect();
            }
            for (of, holder) in holders {
                let is_given = holder.contains_key(key);
                (Checker { path }).that(is_given, &of, &format_args!("nothing"), &needed)?;
            }
        }
        Ok(())
    }

    /// Returns the robot of a chain's campaign with its gait, in SI units; `None` if there is no such campaign.
    pub fn chain_setup(&self, campaign: &str) -> Option<Chain> {
        let campaign = self.chains.campaign.get(campaign)?;
        let robot = self.chains.robot.get(&campaign.robot)?;
        Some(robot.to_chain(&self.chain_gait(&campaign.gait)?))
    }
}

/// Returns the key of a value of a link, in which the link's name stands for its number.
fn link_key(robot: &str, link: impl AsRef<str>, key: &str) -> String {
    format!("robot.{robot}.links.{}.{key}", link.as_ref())
}

impl ChainRobot {
    fn check(&self, check: &Checker, robot: &str) -> Result<(), ConfigError> {
        let key = |key: &str| format!("robot.{robot}.{key}");
        let count = self.links.len();
        let needed = format!("2 to {MAX_LINKS} links");
        check.that((2..=MAX_LINKS).contains(&count), &key("links"), &count, &needed)?;
        let joints = self.joints.len();
        let needed = format!("{} joints, one fewer than links", count - 1);
        check.that(joints == count - 1, &key("joints"), &joints, &needed)?;
        let names = self.names();
        for number in 0..count {
            let name = &names[number];
            check.that(is_valid_name(name), &key("links"), name, NAME)?;
            let needed = "links with different names: set `name` of each";
            check.that(!names[..number].contains(name), &key("links"), name, needed)?;
            self.check_link(check, robot, name, number)?;
        }
        for (number, joint) in (1..).zip(&self.joints) {
            joint.check(check, &format!("robot.{robot}.joint{number}"))?;
        }
        self.check_all_deviations(check, robot)?;
        let moves = self.links.iter().any(|link| link.rotor_inertia_kg_m2.is_some())
            || self.joints.iter().any(|joint| joint.kind != JointKind::Spring);
        let needed =
            "a joint of the kind \"driven\", \"elastic\" or \"torque\", or a link with a rotor";
        check.that(moves, &key("joints"), &format_args!("springs alone"), needed)?;
        let known: BTreeMap<String, ()> = names.into_iter().map(|name| (name, ())).collect();
        if let Some(reference) = &self.reference {
            check.entry(&known, reference, &key("reference"))?;
        }
        let mut others = table_of(self);
        others.remove("links");
        others.remove("joints");
        check.numbers(&format!("robot.{robot}"), &others.into())?;
        let length_m = self.to_chain(&ChainGait::default()).skid_length_m;
        let needed = "a length above 0, because the outer wheels are at their joints";
        check.that(length_m > 0.0, &key("skid_length_m"), &format_args!("nothing"), needed)
    }

    /// Checks the link with this name and index.
    fn check_link(
        &self,
        check: &Checker,
        robot: &str,
        name: &str,
        index: usize,
    ) -> Result<(), ConfigError> {
        let table = plain_table_of(&self.links[index]);
        check.numbers(&format!("robot.{robot}.links.{name}"), &table.clone().into())?;
        let found = |key: &str| table.get(key).map_or("nothing".to_owned(), Value::to_string);
        for (key, is_there, place) in [
            ("front_joint_m", index > 0, "first"),
            ("rear_joint_m", index + 1 < self.links.len(), "last"),
        ] {
            let needed = match is_there {
                true => "the distance of the joint from the link's origin, m".to_owned(),
                false => format!("no such key, because the link is the {place} one"),
            };
            let is_right = table.contains_key(key) == is_there;
            let found = found(key);
            check.that(is_right, &link_key(robot, name, key), &format_args!("{found}"), &needed)?;
        }
        let needed = "wheel_m as well, the place of the wheel (0 for the link's origin)";
        let has_wheel = table.contains_key("wheel_m");
        let of_wheel = ["wheel", "steer_deg"].into_iter().chain(FRICTION).chain(["load_n"]);
        of_wheel.filter(|_| !has_wheel).try_for_each(|key| {
            let is_right = !table.contains_key(key);
            let found = found(key);
            check.that(is_right, &link_key(robot, name, key), &format_args!("{found}"), needed)
        })
    }
}

impl ChainJoint {
    /// Checks a joint, whose key is `key`.
    fn check(&self, check: &Checker, key: &str) -> Result<(), ConfigError> {
        let (kind, stiffness_nm_rad) = (self.kind, self.stiffness_nm_rad);
        let mut table = plain_table_of(self);
        table.remove("kind");
        check.numbers(key, &table.clone().into())?;
        let known = match kind.keys() {
            [] => "none".to_owned(),
            keys => keys.join(", "),
        };
        let needed =
            format!("no such key, because the joint's kind is \"{kind}\", which has {known}");
        for (own, found) in &table {
            let is_right = kind.keys().contains(&own.as_str());
            check.that(is_right, &format!("{key}.{own}"), &format_args!("{found}"), &needed)?;
        }
        let is_stiff = stiffness_nm_rad.is_some_and(|stiffness| stiffness > 0.0);
        let is_right = kind != JointKind::Elastic || is_stiff;
        let found = stiffness_nm_rad.map_or("nothing".to_owned(), |k| k.to_string());
        let needed = "the stiffness of the elastic drive, above 0";
        check.that(is_right, &format!("{key}.stiffness_nm_rad"), &format_args!("{found}"), needed)
    }
}

impl ChainGait {
    fn check(&self, check: &Checker, gait: &str) -> Result<(), ConfigError> {
        check.numbers(&format!("gait.{gait}"), &table_of(self).into())?;
        let commands = (1..).zip(self.joints()).filter_map(|(number, command)| {
            Some((format!("gait.{gait}.joint{number}"), command?.clone()))
        });
        let rotors = self.rotor.iter().map(|(link, command)| {
            (format!("gait.{gait}.rotor.{link}"), CommandConfig::from(command))
        });
        for (key, command) in commands.chain(rotors) {
            let table = table_of(&command);
            if command.is_torque() {
                for angle in ANGLE {
                    let found = "a key of an angle beside a torque";
                    let needed = "either torque_nm, mean_nm and phase_deg, or the keys of an angle";
                    let is_right = !table.contains_key(angle);
                    let key = format!("{key}.{angle}");
                    check.that(is_right, &key, &format_args!("{found}"), needed)?;
                }
                continue;
            }
            for (present, own, needed) in [
                (true, "amplitude_deg", "the amplitude of the angle (or torque_nm)"),
                (command.phase2_deg.is_some(), "amplitude2_deg", "it beside phase2_deg"),
            ] {
                let is_right = !present || table.contains_key(own);
                let key = format!("{key}.{own}");
                check.that(is_right, &key, &format_args!("nothing"), needed)?;
            }
        }
        Ok(())
    }
}
