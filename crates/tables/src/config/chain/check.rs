//! Checks of the chains in a configuration.

use std::collections::BTreeMap;

use serde::Serialize;
use toml::{Table, Value};
use trilink_robot::{MAX_LINKS, Per, Quantity};

use super::super::check::{Checker, NAME, is_valid_name, table_of};
use super::super::{Config, ConfigError, GaitConfig, toml_key};
use super::{ChainJoint, ChainRobot, JointKind};

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

/// Returns the table of a link or joint without its standard deviations.
pub(super) fn plain_table_of(part: &impl Serialize) -> Table {
    let mut table = table_of(part);
    ["standard_deviation", "same"].iter().for_each(|key| drop(table.remove(*key)));
    table
}

/// Returns the key of a link, in which the link's name stands for its number.
pub(super) fn link_table(robot: &str, link: &str) -> String {
    format!("robot.{robot}.links.{}", toml_key(link))
}

/// Returns the key of a value of a link.
fn link_key(robot: &str, link: &str, key: &str) -> String {
    format!("{}.{key}", link_table(robot, link))
}

impl Config {
    /// Checks that wheels with the same name are on different robots and have the same coefficients.
    pub(in super::super) fn check_same_wheels(&self, check: &Checker) -> Result<(), ConfigError> {
        let mut known: BTreeMap<&String, (&String, &String, Table)> = BTreeMap::new();
        let robots = self.robot.iter().filter_map(|(name, robot)| Some((name, robot.chain()?)));
        let robots: Vec<_> = robots.map(|(name, robot)| (name, robot, robot.names())).collect();
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
}

impl ChainRobot {
    pub(in super::super) fn check(&self, check: &Checker, robot: &str) -> Result<(), ConfigError> {
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
        let length_m = self.to_chain(&GaitConfig::default()).skid_length_m;
        let needed = "a length above 0, because the outer wheels are at their joints";
        check.that(length_m > 0.0, &key("skid_length_m"), &format_args!("nothing"), needed)
    }

    /// Returns the names of the links that have a rotor.
    pub(in super::super) fn rotors(&self) -> BTreeMap<String, ()> {
        let links = self.names().into_iter().zip(&self.links);
        let with_rotor = links.filter(|(_, link)| link.rotor_inertia_kg_m2.is_some());
        with_rotor.map(|(name, _)| (name, ())).collect()
    }

    /// Returns the key, given the robot's name, of a resistance that is not configured: that of the first wheel without it
    /// or, for a value common to all wheels, that of the robot. `None` if nothing is missing.
    pub(in super::super) fn missing(&self, robot: &str, quantity: Quantity) -> Option<String> {
        let key = quantity.name();
        if quantity.definition().per != Per::Wheel {
            return (!table_of(self).contains_key(key)).then(|| format!("robot.{robot}.{key}"));
        }
        let links = self.names().into_iter().zip(&self.links);
        let mut wheels = links.filter(|(_, link)| link.wheel_m.is_some());
        let (name, _) = wheels.find(|(_, link)| !table_of(link).contains_key(key))?;
        Some(link_key(robot, &name, key))
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
        check.numbers(&link_table(robot, name), &table.clone().into())?;
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
