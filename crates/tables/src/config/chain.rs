//! Robots that are chains of two to eight links: `[robot.NAME]` with the key `links`.

mod check;
mod deviation;
mod group;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use trilink_base::named;
use trilink_robot::{
    Chain, Drag, FreeJoint, Joint, JointCommand, Link, Quantity, Rotor, TorqueCommand, Wheel,
    WheelFriction,
};

pub(super) use deviation::spread;
pub use group::{GroupNumbers, RobotGroup};

use super::three_links::Deviation;
use super::{CommandConfig, GaitConfig};
use crate::trial::TrialKind;

/// Robot whose links form a chain.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChainRobot {
    /// Links from front to rear.
    pub links: Vec<LinkConfig>,
    /// Joints from front to rear, one fewer than links.
    pub joints: Vec<ChainJoint>,
    /// Name of the link whose motion is that of the robot; by default the middle one, of an even number of links the
    /// one ahead of the middle.
    pub reference: Option<String>,
    /// Length that normalises skid velocities, m; by default [`Chain::outer_length_m`].
    pub skid_length_m: Option<f64>,
    pub transition_m_s: Option<f64>,
    pub stribeck_m_s: Option<f64>,
}

/// Link of a [`ChainRobot`]; see [`Link`] for the meanings of the keys.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct LinkConfig {
    pub name: Option<String>,
    pub front_joint_m: Option<f64>,
    pub rear_joint_m: Option<f64>,
    pub com_m: Option<f64>,
    pub mass_kg: f64,
    pub inertia_kg_m2: f64,
    /// Place of the wheel, m; `None` if the link has no wheel.
    pub wheel_m: Option<f64>,
    /// Name of the wheel. Wheels with the same name, on several robots, have the same coefficients.
    pub wheel: Option<String>,
    pub steer_deg: Option<f64>,
    pub skid_kg_s: Option<f64>,
    pub roll_kg_s: Option<f64>,
    pub skid_dry_n: Option<f64>,
    pub skid_static_n: Option<f64>,
    pub skid_power_n: Option<f64>,
    pub skid_exponent: Option<f64>,
    pub roll_dry_n: Option<f64>,
    /// Load on the wheel, N; if it is given, dry friction is given as coefficients of friction.
    pub load_n: Option<f64>,
    pub drag_along_kg_s: Option<f64>,
    pub drag_across_kg_s: Option<f64>,
    pub drag_turning_nm_s_rad: Option<f64>,
    /// Moment of inertia of the rotor, kg m^2; `None` if the link has no rotor.
    pub rotor_inertia_kg_m2: Option<f64>,
    /// Standard deviations of values by their keys; a value without one is exact.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub standard_deviation: BTreeMap<String, Deviation>,
    /// Names of the common errors, such as that of a ruler, with which values were measured, by the keys of the values.
    /// The errors of all values of the robot with the same name are fully correlated.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub same: BTreeMap<String, String>,
}

/// Joint of a [`ChainRobot`].
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ChainJoint {
    pub kind: JointKind,
    pub stiffness_nm_rad: Option<f64>,
    pub damping_nm_s_rad: Option<f64>,
    pub rest_deg: Option<f64>,
    /// Standard deviations of values by their keys; a value without one is exact.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub standard_deviation: BTreeMap<String, Deviation>,
    /// Names of the common errors, such as that of a ruler, with which values were measured, by the keys of the values.
    /// The errors of all values of the robot with the same name are fully correlated.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub same: BTreeMap<String, String>,
}

named! {
    /// Kind of joint.
    pub enum JointKind {
        /// The angle is commanded.
        Driven = "driven",
        /// Spring and damper.
        Spring = "spring",
        /// Spring and damper whose angle of rest is commanded.
        Elastic = "elastic",
        /// The torque is commanded, in addition to that of a spring and a damper.
        Torque = "torque",
    }
}

impl ChainJoint {
    fn to_joint(&self, command: &CommandConfig) -> Joint {
        let mut joint = FreeJoint {
            stiffness_nm_rad: self.stiffness_nm_rad.unwrap_or_default(),
            damping_nm_s_rad: self.damping_nm_s_rad.unwrap_or_default(),
            target: JointCommand::new(self.rest_deg.unwrap_or_default().to_radians(), 0.0, 0.0),
            torque: TorqueCommand::default(),
        };
        match self.kind {
            JointKind::Driven => return Joint::Driven(command.angle()),
            JointKind::Spring => {}
            JointKind::Elastic => joint.target = command.angle(),
            JointKind::Torque => joint.torque = command.torque(),
        }
        Joint::Free(joint)
    }
}

impl LinkConfig {
    fn to_link(&self, name: String, robot: &ChainRobot, rotor: Option<&CommandConfig>) -> Link {
        let default = |quantity: Quantity| quantity.definition().default.unwrap_or_default();
        // With a load, forces of dry friction are given relative to it.
        let force_n = |value: Option<f64>| value.unwrap_or_default() * self.load_n.unwrap_or(1.0);
        let wheel = self.wheel_m.map(|place_m| Wheel {
            place_m,
            steer_rad: self.steer_deg.unwrap_or_default().to_radians(),
            friction: WheelFriction {
                skid_kg_s: self.skid_kg_s.unwrap_or_default(),
                roll_kg_s: self.roll_kg_s.unwrap_or_default(),
                skid_dry_n: force_n(self.skid_dry_n),
                skid_static_n: force_n(self.skid_static_n),
                stribeck_m_s: robot.stribeck_m_s.unwrap_or(default(Quantity::Stribeck)),
                skid_power_n: force_n(self.skid_power_n),
                skid_exponent: self.skid_exponent.unwrap_or(default(Quantity::SkidExponent)),
                roll_dry_n: force_n(self.roll_dry_n),
                transition_m_s: robot.transition_m_s.unwrap_or(default(Quantity::Transition)),
            },
        });
        Link {
            name,
            front_joint_m: self.front_joint_m.unwrap_or_default(),
            rear_joint_m: self.rear_joint_m.unwrap_or_default(),
            com_m: self.com_m.unwrap_or_default(),
            mass_kg: self.mass_kg,
            inertia_kg_m2: self.inertia_kg_m2,
            wheel,
            drag: Drag {
                along_kg_s: self.drag_along_kg_s.unwrap_or_default(),
                across_kg_s: self.drag_across_kg_s.unwrap_or_default(),
                turning_nm_s_rad: self.drag_turning_nm_s_rad.unwrap_or_default(),
            },
            rotor: self.rotor_inertia_kg_m2.map(|inertia_kg_m2| Rotor {
                inertia_kg_m2,
                angle: rotor.map_or(JointCommand::new(0.0, 0.0, 0.0), CommandConfig::angle),
            }),
        }
    }
}

impl ChainRobot {
    /// Returns the names of the links from front to rear.
    pub fn names(&self) -> Vec<String> {
        let default = |number: usize| match (self.links.len(), number) {
            (_, 1) if self.links.len() <= 3 => "front".to_owned(),
            (3, 2) => "middle".to_owned(),
            (2, 2) | (3, 3) => "rear".to_owned(),
            _ => format!("link {number}"),
        };
        let links = (1..).zip(&self.links);
        links.map(|(number, link)| link.name.clone().unwrap_or_else(|| default(number))).collect()
    }

    /// Checks that trials of a kind are possible with the robot.
    ///
    /// # Errors
    /// Returns which robot is needed.
    pub fn check_kind(&self, kind: TrialKind) -> Result<(), &'static str> {
        let is_not_zero = |value: Option<f64>| value.is_some_and(|value| value != 0.0);
        match kind {
            TrialKind::Gait => Ok(()),
            TrialKind::JointRelease
                if self.joints.iter().all(|of| of.kind == JointKind::Driven) =>
            {
                Err("a robot with a joint that is not driven, which can be released")
            }
            TrialKind::JointRelease => Ok(()),
            TrialKind::CoastDown if self.links.iter().all(|link| link.wheel_m.is_none()) => {
                Err("a robot with wheels, whose rolling resistance a coast-down measures")
            }
            TrialKind::CoastDown if self.links.iter().any(|link| is_not_zero(link.steer_deg)) => {
                Err(
                    "a robot without steered wheels (steer_deg), because all wheels must roll when it is straight",
                )
            }
            TrialKind::CoastDown if self.links.iter().any(|of| is_not_zero(of.drag_along_kg_s)) => {
                Err(
                    "a robot without drag along its links (drag_along_kg_s), which a coast-down does not \
                     distinguish from rolling resistance",
                )
            }
            TrialKind::CoastDown => Ok(()),
        }
    }

    /// Converts the robot and its gait to SI units. A joint or rotor without a command stands still.
    pub fn to_chain(&self, gait: &GaitConfig) -> Chain {
        let names = self.names();
        let named = |name: &String| names.iter().position(|other| other == name);
        let middle = self.links.len().saturating_sub(1) / 2;
        let reference = self.reference.as_ref().and_then(named).unwrap_or(middle);
        let links = names.iter().zip(&self.links);
        let links: Vec<Link> = links
            .map(|(name, link)| link.to_link(name.clone(), self, gait.rotor.get(name)))
            .collect();
        let none = CommandConfig::default();
        let joints = self.joints.iter().zip(gait.joints());
        Chain {
            joints: joints.map(|(joint, own)| joint.to_joint(own.unwrap_or(&none))).collect(),
            reference,
            skid_length_m: self.skid_length_m.unwrap_or(Chain::outer_length_m(&links)),
            links,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use trilink_robot::{ChainNumber, CommandNumber, LinkNumber};

    use super::super::{Config, ConfigError, RobotConfig};
    use super::*;

    /// Robot of four links, with a joint of each kind that needs no drive and a rotor.
    const SNAKE: &str = r#"
        [robot.snake]
        reference = "head"
        transition_m_s = 0.01
        joints = [
            { kind = "driven" },
            { kind = "torque", damping_nm_s_rad = 0.01 },
            { kind = "spring", stiffness_nm_rad = 0.2, rest_deg = -5 },
        ]
        [[robot.snake.links]]
        name = "head"
        rear_joint_m = 0.1
        mass_kg = 0.5
        inertia_kg_m2 = 1e-3
        wheel_m = 0
        steer_deg = 10
        skid_kg_s = 20.0
        skid_dry_n = 0.5
        load_n = 4
        [[robot.snake.links]]
        front_joint_m = 0.1
        rear_joint_m = 0.12
        mass_kg = 0.3
        inertia_kg_m2 = 1e-3
        drag_along_kg_s = 0.4
        [[robot.snake.links]]
        front_joint_m = 0.1
        rear_joint_m = 0.1
        mass_kg = 0.3
        inertia_kg_m2 = 1e-3
        rotor_inertia_kg_m2 = 1e-4
        [[robot.snake.links]]
        front_joint_m = 0.11
        mass_kg = 0.3
        inertia_kg_m2 = 1e-3
        wheel_m = -0.02
        skid_kg_s = 10.0
        [gait.swim]
        joint1 = { amplitude_deg = 30, phase_deg = 90 }
        joint2 = { torque_nm = 0.1, mean_nm = 0.01 }
        rotor."link 3" = { amplitude_deg = 400 }
        [campaign.swim]
        robot = "snake"
        gait = "swim"
    "#;

    fn load(text: &str) -> Result<Config, String> {
        let path = Path::new("p.toml");
        let config = Config::parse(text).map_err(|error| ConfigError::toml(path, text, &error));
        let checked = config.and_then(|config| config.check(path).map(|()| config));
        checked.map_err(|error| error.to_string())
    }

    #[test]
    fn a_chain_has_the_values_of_its_keys_in_si_units() {
        let config = load(SNAKE).unwrap();
        let chain = config.chain_setup("swim").unwrap();
        assert_eq!(chain.check(), Ok(()));
        let names: Vec<&str> = chain.links.iter().map(|link| link.name.as_str()).collect();
        assert_eq!(names, ["head", "link 2", "link 3", "link 4"]);
        assert_eq!((chain.reference, chain.wheels(), chain.free_joints()), (0, 2, 2));
        let wheel = chain.links[0].wheel.unwrap();
        assert_eq!(wheel.steer_rad, 10_f64.to_radians());
        // Dry friction is relative to the load.
        assert_eq!((wheel.friction.skid_kg_s, wheel.friction.skid_dry_n), (20.0, 2.0));
        assert_eq!((wheel.friction.transition_m_s, wheel.friction.skid_exponent), (0.01, 1.0));
        assert_eq!(chain.links[1].drag.along_kg_s, 0.4);
        assert_eq!(chain.links[2].rotor.unwrap().angle.amplitude_rad, 400_f64.to_radians());
        // The mean of the front wheel at 0.1 m and of the rear wheel at 0.13 m from their joints.
        assert!((chain.skid_length_m - 0.115).abs() < 1e-15);
        let Joint::Driven(command) = chain.joints[0] else { panic!("joint 1 is driven") };
        assert_eq!(command, JointCommand::new(0.0, 30_f64.to_radians(), 90_f64.to_radians()));
        let Joint::Free(torque) = chain.joints[1] else { panic!("joint 2 is free") };
        assert_eq!((torque.torque.mean_nm, torque.torque.amplitude_nm), (0.01, 0.1));
        let Joint::Free(spring) = chain.joints[2] else { panic!("joint 3 is free") };
        assert_eq!(spring.target.offset_rad, (-5_f64).to_radians());
    }

    #[test]
    fn chains_are_printed_as_written_and_leave_other_robots_alone() {
        let settings = Config::settings(SNAKE).unwrap();
        let find = |key: &str| settings.iter().find(|setting| setting.key == key).unwrap();
        assert_eq!(find("robot.snake.links").line, Some(10));
        assert_eq!(find("robot.snake.reference").value, "head".into());
        let written: String =
            settings.iter().map(|one| format!("{} = {}\n", one.key, one.value)).collect();
        assert_eq!(load(&written), load(SNAKE));

        let default = toml::to_string(&Config::default()).unwrap();
        let both = load(&format!("{default}{SNAKE}")).unwrap();
        assert_eq!(both.robot["snake"], load(SNAKE).unwrap().robot["snake"]);
        assert_eq!(load(&toml::to_string(&both).unwrap()), Ok(both.clone()));
        let mut others = both;
        others.robot.remove("snake");
        others.gait.remove("swim");
        others.campaign.remove("swim");
        assert_eq!(others, Config::default());
    }

    #[test]
    fn a_gait_of_two_joints_is_shared_by_chains_and_the_robot_of_three_links() {
        let default = toml::to_string(&Config::default()).unwrap();
        let three = "joints = [{ kind = \"driven\" }, { kind = \"driven\" }]\nlinks = [\
            { rear_joint_m = 0.1, mass_kg = 1, inertia_kg_m2 = 0.01, wheel_m = 0, skid_kg_s = 1 },\
            { front_joint_m = 0.1, rear_joint_m = 0.1, mass_kg = 1, inertia_kg_m2 = 0.01 },\
            { front_joint_m = 0.1, mass_kg = 1, inertia_kg_m2 = 0.01 }]\n";
        let campaign = "[campaign.three]\nrobot = \"three\"\ngait = \"symmetric\"\n";
        let config = load(&format!("{default}[robot.three]\n{three}{campaign}")).unwrap();
        let chain = config.chain_setup("three").unwrap();
        let gait = config.gait["symmetric"].to_gait();
        let commands = gait.joints.map(|command| Joint::Driven(command.unwrap()));
        assert_eq!(chain.joints, commands);
        let names: Vec<&str> = chain.links.iter().map(|link| link.name.as_str()).collect();
        assert_eq!((names, chain.reference), (vec!["front", "middle", "rear"], 1));
    }

    #[test]
    fn standard_deviations_stand_beside_the_values_or_in_a_table_of_their_own() {
        let beside = SNAKE
            .replacen(
                "mass_kg = 0.5",
                "mass_kg = { value = 0.5, sd = \"2 %\", same = \"scale\" }",
                1,
            )
            .replacen("mass_kg = 0.3", "mass_kg = { value = 0.3, sd = 0.002, same = \"scale\" }", 1)
            .replacen("rest_deg = -5", "rest_deg = { value = -5, sd = 0.5 }", 1);
        let apart = SNAKE
            .replacen(
                "mass_kg = 0.5",
                "mass_kg = 0.5\nstandard_deviation = { mass_kg = \"2 %\" }\nsame = { mass_kg = \"scale\" }",
                1,
            )
            .replacen(
                "mass_kg = 0.3",
                "mass_kg = 0.3\nstandard_deviation.mass_kg = 0.002\nsame.mass_kg = \"scale\"",
                1,
            )
            .replacen("rest_deg = -5", "rest_deg = -5, standard_deviation = { rest_deg = 0.5 }", 1);
        let [beside, apart] = [beside, apart].map(|text| load(&text).unwrap());
        assert_eq!(beside.robot, apart.robot);
        let snake = beside.robot["snake"].chain().unwrap();
        let [masses, rest] = &snake.errors()[..] else { panic!("two") };
        let mass = |link| ChainNumber::Link(link, LinkNumber::Mass);
        assert_errors(masses, &[(mass(0), 0.02 * 0.5), (mass(1), 0.002)]);
        let number = ChainNumber::Command(2, CommandNumber::Offset);
        assert_errors(rest, &[(number, 0.5_f64.to_radians())]);
        assert_eq!(beside.chain_setup("swim"), load(SNAKE).unwrap().chain_setup("swim"));
        // A configuration that is written is read again.
        let written = toml::to_string(&beside.robot["snake"]).unwrap();
        assert_eq!(toml::from_str::<RobotConfig>(&written).unwrap(), beside.robot["snake"]);
    }

    /// Asserts that numbers of a chain share an error with these standard deviations.
    fn assert_errors(found: &[(ChainNumber, f64)], known: &[(ChainNumber, f64)]) {
        assert_eq!(found.len(), known.len(), "{found:?}");
        for ((of, sd), (of_known, known)) in found.iter().zip(known) {
            assert!(of == of_known && (sd / known - 1.0).abs() < 1e-9, "{of:?}: {sd}");
        }
    }

    #[test]
    fn the_error_of_a_load_is_one_of_all_dry_friction_of_its_wheel() {
        let text = SNAKE
            .replacen("load_n = 4", "load_n = { value = 4, sd = 0.1 }\nroll_dry_n = 0.05", 1)
            .replacen("skid_dry_n = 0.5", "skid_dry_n = { value = 0.5, sd = \"4 %\" }", 1);
        let config = load(&text).unwrap();
        let robot = config.robot["snake"].chain().unwrap();
        let number = |number| ChainNumber::Link(0, number);
        let [load, coefficient] = &robot.errors()[..] else { panic!("two") };
        let of_load = [(LinkNumber::SkidDry, 0.5 * 0.1), (LinkNumber::RollDry, 0.05 * 0.1)];
        assert_errors(load, &of_load.map(|(of, sd)| (number(of), sd)));
        assert_errors(coefficient, &[(number(LinkNumber::SkidDry), 0.04 * 0.5 * 4.0)]);
        // Both values off by one standard deviation.
        let off = robot.with_errors(|| 1.0).to_chain(&GaitConfig::default());
        let force_n = off.number(number(LinkNumber::SkidDry)).unwrap();
        assert!((force_n - 0.52 * 4.1).abs() < 1e-12);
        assert!((off.number(number(LinkNumber::RollDry)).unwrap() - 0.05 * 4.1).abs() < 1e-12);
        assert_eq!(off.number(number(LinkNumber::Skid)), Some(20.0));
    }

    #[test]
    fn a_chain_has_markers_by_the_names_of_its_links() {
        const LAYOUT: &str = "[layout.snake]\nhead = { H1 = [1, 2, 3], H2 = [20, 2, 3] }\n\
                              \"link 3\" = { C1 = [1, 2, 3], C2 = [20, 2, 3] }\n\
                              \"link 4\" = { body = [20.5, -1.25, 55.0, 1.5, -2.0, 90.0] }\n";
        let config = load(&format!("{SNAKE}{LAYOUT}")).unwrap();
        let layout = config.marker_layout("snake").expect("a layout");
        let markers: Vec<usize> = layout.links().iter().map(|link| link.len()).collect();
        assert_eq!(markers, [2, 0, 2, 4]);
        assert_eq!((layout.name(2), &*layout.table_of(2)), ("link 3", "layout.snake.\"link 3\""));
        assert!(load(SNAKE).unwrap().marker_layout("snake").is_none());
        for (old, new, expected) in [
            (
                "head = ",
                "haed = ",
                "key `layout.snake`: found `haed`, needed one of `head`, `link 2`, `link 3`, `link 4` (did you mean \
                 `head`?)",
            ),
            (
                "[layout.snake]",
                "[layout.snaek]",
                "key `layout.snaek`: found `snaek`, needed one of `snake` (did you mean `snake`?)",
            ),
            ("H2 = [20, 2, 3]", "C2 = [20, 2, 3]", "needed labels that no other link has"),
            ("H2 = [20, 2, 3]", "H2 = [2, 2, 3]", "needed two markers at least 5 mm apart"),
            (", H2 = [20, 2, 3]", "", "key `layout.snake.head`: found 1, needed 2 to 64 markers"),
            (
                "H2 = [20, 2, 3]",
                "H2 = [20, 2]",
                "found a list of length 2, needed a list of length 3",
            ),
            (
                "H2 = [20, 2, 3]",
                "H2 = [2e5, 2, 3]",
                "key `layout.snake.head.H2`: found 200000.0, needed",
            ),
            (
                "\"link 3\" = { C1 = [1, 2, 3], C2 = [20, 2, 3] }\n",
                "",
                "key `layout.snake.\"link 2\"`: found none, needed 2 to 64 markers, because only a link between two \
                 links with markers can have none",
            ),
        ] {
            assert!(LAYOUT.contains(old), "{old}");
            let message = load(&format!("{SNAKE}{}", LAYOUT.replacen(old, new, 1))).expect_err(new);
            assert!(message.contains(expected), "{old} -> {new}: {message}");
        }
    }

    #[test]
    fn errors_name_the_table_the_key_and_the_remedy() {
        for (old, new, expected) in [
            ("reference = \"head\"", "h_m = 0.1", "line 2: invalid key `h_m` beside `links`"),
            (
                "reference = \"head\"",
                "reference = \"haed\"",
                "key `robot.snake.reference`: found `haed`, needed one of `head`, `link 2`, `link 3`, `link 4` (did you \
              mean `head`?)",
            ),
            (
                "transition_m_s = 0.01",
                "transition_m_s = { value = 0.01, sd = 0.001 }",
                "key `transition_m_s`: found a standard deviation, needed a number alone",
            ),
            ("mass_kg = 0.5", "mass_kgs = 0.5", "line 13: unknown field `mass_kgs`"),
            ("mass_kg = 0.5", "mass_kgs = 0.5", "did you mean `mass_kg`?"),
            ("mass_kg = 0.5", "", "missing field `mass_kg`"),
            (
                "mass_kg = 0.5",
                "mass_kg = { value = 0.5, sd = -1 }",
                "key `robot.snake.links.head.standard_deviation.mass_kg`: found -1.0, needed a number from 0",
            ),
            (
                "mass_kg = 0.5",
                "mass_kg = { value = 0.5, sd = 0.1, same = \"scale\" }",
                "key `robot.snake`: found same = \"scale\" for one value alone, needed a name that at least two",
            ),
            (
                "mass_kg = 0.5",
                "mass_kg = { value = 0.5, sd = 0.1 }\nstandard_deviation = { mass_kg = 0.2 }",
                "key `mass_kg`: found an entry both in `mass_kg` and in the table `standard_deviation`",
            ),
            (
                "mass_kg = 0.5",
                "mass_kg = 0.5\nstandard_deviation = { name = 1 }",
                "links.head.standard_deviation.name`: found `name`, needed the key of a value",
            ),
            (
                "load_n = 4",
                "load_n = { value = 4, sd = 5 }",
                "links.head.standard_deviation.load_n`: found 5.0, needed a number from 0 to 4, or a percentage",
            ),
            (
                "mass_kg = 0.3",
                "mass_kg = 0.3\nstandard_deviation = { wheel_m = 1 }",
                "links.\"link 2\".standard_deviation.wheel_m`: found a standard deviation, needed wheel_m as well",
            ),
            (
                "mass_kg = 0.5",
                "mass_kg = 0",
                "key `robot.snake.links.head.mass_kg`: found 0.0, needed",
            ),
            (
                "mass_kg = 0.5",
                "mass_kg = [0.5]",
                "key `robot.snake.links[0].mass_kg`: found a list of length 1, needed a number",
            ),
            (
                "rear_joint_m = 0.12",
                "",
                "key `robot.snake.links.\"link 2\".rear_joint_m`: found nothing, needed the distance",
            ),
            (
                "rear_joint_m = 0.1\n",
                "rear_joint_m = 0.1\nfront_joint_m = 0.1\n",
                "links.head.front_joint_m`: found 0.1, needed no such key, because the link is the first one",
            ),
            (
                "wheel_m = -0.02",
                "",
                "links.\"link 4\".skid_kg_s`: found 10.0, needed wheel_m as well",
            ),
            (
                "rotor_inertia_kg_m2 = 1e-4",
                "name = \"head\"",
                "key `robot.snake.links`: found \"head\", needed links with different names",
            ),
            ("{ kind = \"driven\" },", "", "key `robot.snake.joints`: found 2, needed 3 joints"),
            ("kind = \"driven\"", "kind = \"drive\"", "unknown variant `drive`"),
            ("kind = \"driven\"", "kind = \"drive\"", "did you mean `driven`?"),
            (
                "kind = \"driven\"",
                "kind = \"driven\", rest_deg = 1",
                "key `robot.snake.joint1.rest_deg`: found 1.0, needed no such key, because the joint's kind is \"driven\", \
              which has none",
            ),
            (
                "kind = \"driven\"",
                "kind = \"elastic\"",
                "key `robot.snake.joint1.stiffness_nm_rad`: found nothing, needed the stiffness",
            ),
            (
                "kind = \"driven\"",
                "kind = \"spring\"",
                "key `gait.swim.joint1`: found an angle, needed no command, because joint 1 of robot `snake` (campaign \
              `swim`) has the kind \"spring\"",
            ),
            (
                "joint1 = { amplitude_deg = 30, phase_deg = 90 }",
                "",
                "key `gait.swim.joint1`: found nothing, needed an angle, { amplitude_deg = .. }, because",
            ),
            (
                "joint1 = { amplitude_deg = 30, phase_deg = 90 }",
                "joint1 = { mean_nm = 1 }",
                "key `gait.swim.joint1`: found a torque, needed an angle",
            ),
            (
                "torque_nm = 0.1",
                "torque_nm = 0.1, amplitude_deg = 3",
                "key `gait.swim.joint2.amplitude_deg`: found 3.0, needed either torque_nm, mean_nm and phase_deg",
            ),
            ("torque_nm = 0.1", "torque_mn = 0.1", "did you mean `torque_nm`?"),
            (
                "joint1 = { amplitude_deg = 30, phase_deg = 90 }
        joint2 = { torque_nm = 0.1, mean_nm = 0.01 }
        rotor.\"link 3\" = { amplitude_deg = 400 }",
                "joint2 = { mean_nm = 0.01 }",
                "key `gait.swim`: found constant torques alone, needed a commanded angle or a torque amplitude",
            ),
            ("amplitude_deg = 30, ", "", "key `gait.swim.joint1.amplitude_deg`: found nothing"),
            (
                "amplitude_deg = 30",
                "amplitude_deg = 300",
                "key `gait.swim.joint1.amplitude_deg`: found 300.0",
            ),
            (
                "[campaign.swim]",
                "joint4 = { amplitude_deg = 9 }\n[campaign.swim]",
                "key `gait.swim.joint4`: found a command, needed no command, because robot `snake` (campaign \
              `swim`) has 3 joints",
            ),
            (
                "[campaign.swim]",
                "joint8 = { amplitude_deg = 9 }\n[campaign.swim]",
                "unknown field `joint8`",
            ),
            (
                "rotor.\"link 3\"",
                "rotor.\"link 2\"",
                "key `gait.swim.rotor`: found `link 2`, needed one of `link 3` (did you mean `link 3`?)",
            ),
            (
                "rotor.\"link 3\" = { amplitude_deg = 400 }",
                "",
                "key `gait.swim.rotor.\"link 3\"`: found nothing, needed an angle",
            ),
            (
                "rotor_inertia_kg_m2 = 1e-4",
                "",
                "key `gait.swim.rotor.\"link 3\"`: found a command, needed none, because no link of robot `snake`",
            ),
            (
                "gait = \"swim\"",
                "gait = \"swin\"",
                "key `campaign.swim.gait`: found `swin`, needed one of `swim` (did you mean `swim`?)",
            ),
            (
                "gait = \"swim\"",
                "gait = \"swim\"\nmodels = [\"coulomb\"]",
                "key `robot.snake.links.head.roll_kg_s`: found nothing, needed roll_kg_s, which model `coulomb`",
            ),
            (
                "gait = \"swim\"",
                "gait = \"swim\"\nmodels = [\"skit\"]",
                "key `campaign.swim.models`: found `skit`",
            ),
            (
                "gait = \"swim\"",
                "gait = \"swim\"\nmodels = [\"skid\"]\nfree.skid = [\"skid3\", \"skid1\"]",
                "key `campaign.swim.free.skid`: found \"skid1\", needed a parameter of model `skid` (skid = \"viscous\", roll = \
              \"none\") of this chain: skid0, skid3, stiffness2",
            ),
            (
                "[campaign.swim]",
                "[robot.a]\nh_m = 0.1\nl_m = 0.1\nb_m = 0.05\nmass_kg = [1, 0.2, 0.2]\n\
              inertia_kg_m2 = [0.01, 0.001, 0.001]\nroll_kg_s = [1, 1, 1]\nskid_kg_s = [1, 1, 1]\n[campaign.other]\nrobot = \"a\"\ngait = \
              \"swim\"\nmodels = [\"skid\"]\nweights = { d = 1, v = 1, sigma = 1, alpha = 0 }\n[campaign.swim]",
                "key `gait.swim.joint2`: found a torque, needed an angle, { amplitude_deg = .. }, or nothing for a passive \
              joint, because robot `a` (campaign `other`) is described by h_m, l_m and b_m",
            ),
        ] {
            assert!(SNAKE.contains(old), "{old}");
            let message = load(&SNAKE.replacen(old, new, 1)).expect_err(new);
            assert!(message.contains(expected), "{old} -> {new}: {message}");
        }
    }
}
