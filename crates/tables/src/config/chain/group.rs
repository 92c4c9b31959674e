//! Robots with wheels of the same names, whose campaigns are fitted together.

use trilink_robot::{MAX_JOINTS, MAX_LINKS, Parameter, Per, Unit};

use super::super::{Config, GaitConfig};
use super::{ChainRobot, JointKind};

/// Robots whose campaigns are fitted together: a single one, or several that are connected by wheels of the same names.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotGroup {
    /// Names of the robots.
    pub robots: Vec<String>,
    /// Numbers of the parameters of each robot.
    pub numbers: Vec<GroupNumbers>,
    /// For several robots, the wheels that have each number, such as `twistcar front = racer handlebar`: first the links
    /// of the first robot by their own numbers, then the other wheels. Empty for a single robot.
    pub wheels: Vec<String>,
    /// For several robots, the joints that have the numbers from 1: first those of the first robot, then those of the
    /// others that are not driven. Empty for a single robot.
    pub joints: Vec<String>,
}

/// Numbers of a robot's parameters in fits to the campaigns of a group of robots. A wheel has one number on all robots
/// that it is on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroupNumbers {
    /// Numbers of the wheels in the group by their own numbers.
    wheels: [Option<usize>; MAX_LINKS],
    /// Ratios of the loads on the wheels to those on the first robot with the wheel, by their own numbers.
    load_ratios: [f64; MAX_LINKS],
    /// Numbers of the joints in the group, from front to rear.
    joints: [Option<usize>; MAX_JOINTS],
    /// Whether all robots of the group have the same wheels with the same loads, so that they have the same sums over the
    /// wheels.
    has_sums: bool,
}

impl GroupNumbers {
    const NONE: Self = Self {
        wheels: [None; MAX_LINKS],
        load_ratios: [1.0; MAX_LINKS],
        joints: [None; MAX_JOINTS],
        has_sums: false,
    };

    /// Returns the numbers of a robot that is not fitted together with others: its own.
    pub fn of_single_robot() -> Self {
        Self {
            wheels: std::array::from_fn(Some),
            joints: std::array::from_fn(|joint| Some(joint + 1)),
            has_sums: true,
            ..Self::NONE
        }
    }

    /// Returns the parameter of the robot that is a given parameter of the group, with the ratio of its value to that of
    /// the group's: wheels with loads have the same coefficients of dry friction, so that the forces are proportional to
    /// the loads. `None` if the robot does not have the parameter.
    pub fn own(&self, of_group: Parameter) -> Option<(Parameter, f64)> {
        let quantity = of_group.quantity();
        let definition = quantity.definition();
        match (definition.per, of_group.number()) {
            (Per::Wheel, Some(number)) => {
                let own = self.wheels.iter().position(|wheel| *wheel == Some(number))?;
                let is_force = definition.unit == Unit::Newton;
                let ratio = if is_force { self.load_ratios[own] } else { 1.0 };
                Some((quantity.parameter(own), ratio))
            }
            (Per::FreeJoint, Some(number)) => {
                let own = self.joints.iter().position(|joint| *joint == Some(number))?;
                Some((quantity.parameter(own + 1), 1.0))
            }
            _ => (self.has_sums || !of_group.is_sum()).then_some((of_group, 1.0)),
        }
    }

    /// Returns the parameter of the group that is a given parameter of the robot; `None` if it has no number, or if it is
    /// a sum over wheels that other robots of the group do not have.
    pub fn of_group(&self, own: Parameter) -> Option<Parameter> {
        let mut parameters = Parameter::OF_ANY_ROBOT.into_iter();
        parameters.find(|of_group| self.own(*of_group).is_some_and(|(of, _)| of == own))
    }
}

impl RobotGroup {
    fn single(robot: String) -> Self {
        let numbers = vec![GroupNumbers::of_single_robot()];
        Self { robots: vec![robot], numbers, wheels: Vec::new(), joints: Vec::new() }
    }

    /// Numbers the wheels and joints of several robots.
    fn of_chains(chains: &[(&String, &ChainRobot)]) -> Self {
        let robots: Vec<String> = chains.iter().map(|(robot, _)| robot.to_string()).collect();
        let mut all: Vec<Numbered> = Vec::new();
        let mut joints = Vec::new();
        let mut numbers = vec![GroupNumbers::NONE; robots.len()];
        for ((robot, chain), numbers) in chains.iter().zip(&mut numbers) {
            let is_first = **robot == robots[0];
            let names = chain.names();
            let order = chain.to_chain(&GaitConfig::default()).numbering();
            for (own, place) in order.into_iter().enumerate() {
                let link = &chain.links[place];
                if link.wheel_m.is_none() && !is_first {
                    continue;
                }
                let label = format!("{robot} {}", names[place]);
                let name = link.wheel.as_ref();
                let known = all.iter().position(|of| name.is_some() && of.wheel == name);
                let number = known.unwrap_or(all.len());
                match all.get_mut(number) {
                    Some(first) => {
                        first.label += &format!(" = {label}");
                        numbers.load_ratios[own] = link.load_n.unwrap_or(1.0) / first.load_n;
                    }
                    None => {
                        let load_n = link.load_n.unwrap_or(1.0);
                        all.push(Numbered { wheel: name, load_n, label });
                    }
                }
                let has_number = link.wheel_m.is_some() && number < MAX_LINKS;
                numbers.wheels[own] = has_number.then_some(number);
            }
            for (own, joint) in chain.joints.iter().enumerate() {
                if joint.kind != JointKind::Driven || is_first {
                    joints.push(format!("{robot} joint {}", own + 1));
                    let number = joints.len();
                    numbers.joints[own] = Some(number).filter(|number| *number <= MAX_JOINTS);
                }
            }
        }
        let has_all_wheels = |of: &GroupNumbers| {
            let sorted = |of: &GroupNumbers| {
                let mut wheels: Vec<usize> = of.wheels.into_iter().flatten().collect();
                wheels.sort_unstable();
                wheels
            };
            sorted(of) == sorted(&numbers[0]) && of.load_ratios.iter().all(|ratio| *ratio == 1.0)
        };
        let has_sums = numbers.iter().all(has_all_wheels);
        numbers.iter_mut().for_each(|of| of.has_sums = has_sums);
        let wheels = all.into_iter().map(|of| of.label).collect();
        Self { robots, numbers, wheels, joints }
    }

    /// Returns the names of the robots, joined.
    pub fn name(&self) -> String {
        self.robots.join(" and ")
    }

    /// Returns the numbers of the parameters of a robot of the group.
    pub fn numbers_of(&self, robot: &str) -> Option<&GroupNumbers> {
        let index = self.robots.iter().position(|own| own == robot)?;
        self.numbers.get(index)
    }

    /// Whether there are enough numbers for all wheels and joints.
    pub fn is_complete(&self) -> bool {
        self.wheels.len() <= MAX_LINKS && self.joints.len() <= MAX_JOINTS
    }
}

/// Wheel with a number in a group.
struct Numbered<'c> {
    wheel: Option<&'c String>,
    /// Load on the first robot with the wheel, N; 1 if none is given.
    load_n: f64,
    label: String,
}

impl ChainRobot {
    /// Returns the names of the robot's wheels.
    pub(in super::super) fn wheels(&self) -> impl Iterator<Item = &String> {
        self.links.iter().filter_map(|link| link.wheel.as_ref())
    }
}

impl Config {
    /// Returns the groups of robots whose campaigns the configuration asks to fit together: each robot with several
    /// campaigns, then all groups of robots that wheels of the same names connect.
    pub fn robot_groups(&self) -> Vec<RobotGroup> {
        let robots = self.fit.shared.iter().flat_map(|shared| &shared.robot.0);
        let robots: Vec<&String> = robots.collect();
        let singles = robots.iter().map(|robot| RobotGroup::single(robot.to_string()));
        let singles = singles.filter(|group| self.common(&group.robots).0.len() > 1);
        singles.chain(self.connected(&robots)).collect()
    }

    /// Returns the groups of two or more robots that wheels with common names connect, directly or through other robots.
    pub(in super::super) fn connected(&self, robots: &[&String]) -> Vec<RobotGroup> {
        let chains = robots.iter().filter_map(|name| {
            let (name, robot) = self.robot.get_key_value(*name)?;
            Some((name, robot.chain()?))
        });
        let chains: Vec<(&String, &ChainRobot)> = chains.collect();
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for (index, (_, chain)) in chains.iter().enumerate() {
            let has_wheel_of = |other: &usize| {
                chain.wheels().any(|wheel| chains[*other].1.wheels().any(|of| of == wheel))
            };
            let (near, far): (Vec<_>, Vec<_>) =
                groups.into_iter().partition(|group| group.iter().any(has_wheel_of));
            let mut group = near.concat();
            group.push(index);
            group.sort_unstable();
            groups = far;
            groups.push(group);
        }
        groups.sort();
        let groups = groups.iter().filter(|group| group.len() > 1);
        groups
            .map(|group| {
                let own: Vec<_> = group.iter().map(|index| chains[*index]).collect();
                RobotGroup::of_chains(&own)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use trilink_robot::Quantity;

    use super::*;

    const GALLERY: [&str; 2] = [
        include_str!("../../../../../docs/robots/twistcar.toml"),
        include_str!("../../../../../docs/robots/roller-racer.toml"),
    ];
    const PAIR: &str = "[fit.shared]\nrobot = [\"twistcar\", \"racer\"]\n";

    /// Returns the twistcar and the roller racer with these keys added to their first links.
    fn load_pair(of_twistcar: &str, of_racer: &str) -> Result<Config, String> {
        let link = "inertia_kg_m2 = 5e-4";
        let [twistcar, racer] = GALLERY;
        let twistcar = twistcar.replacen(link, &format!("{link}\n{of_twistcar}"), 1);
        let racer = racer.replacen(link, &format!("{link}\n{of_racer}"), 1);
        load(&format!("{twistcar}{racer}{PAIR}"))
    }

    fn load(text: &str) -> Result<Config, String> {
        let config = Config::parse(text).map_err(|error| error.to_string())?;
        let checked = config.check(Path::new("pipeline.toml"));
        checked.map(|()| config).map_err(|error| error.to_string())
    }

    const FRONT: &str = "wheel = \"front\"";

    #[test]
    fn a_common_wheel_has_one_number_on_all_robots() {
        let config = load_pair(FRONT, FRONT).unwrap();
        let [group] = &config.robot_groups()[..] else { panic!("one group") };
        assert_eq!(group.name(), "twistcar and racer");
        let numbers = ["twistcar", "racer"].map(|robot| group.numbers_of(robot).unwrap());
        let [skid0, skid1, skid2] = Quantity::Skid.of_each();
        let own = |of: Parameter| numbers.map(|numbers| numbers.own(of).map(|(own, _)| own));
        assert_eq!(own(skid0), [Some(skid0), Some(skid1)]);
        assert_eq!(own(skid1), [Some(skid1), None]);
        assert_eq!(own(skid2), [None, Some(skid0)]);
        let transition = Quantity::Transition.one();
        assert_eq!(own(transition), [Some(transition); 2]);
        assert_eq!(own(Quantity::Roll.sum()), [None; 2]);
        let of_group = [skid0, skid1, Quantity::Roll.sum()].map(|own| numbers[1].of_group(own));
        assert_eq!(of_group, [Some(skid2), Some(skid0), None]);
        assert!(group.is_complete());
    }

    #[test]
    fn wheels_and_joints_beyond_the_last_number_have_none() {
        let snake = include_str!("../../../../../docs/robots/driven-snake.toml");
        let config = Config::parse(snake).unwrap();
        let mut snake = config.robot["snake"].chain().unwrap().clone();
        snake.links[0].wheel = Some("head".to_owned());
        snake.joints.iter_mut().for_each(|joint| joint.kind = JointKind::Spring);
        let names = ["a", "b"].map(str::to_owned);
        let group = RobotGroup::of_chains(&[(&names[0], &snake), (&names[1], &snake)]);
        assert!(!group.is_complete());
        let last = (MAX_LINKS - snake.links.len()) + 1;
        let wheels = (0..snake.links.len()).map(|own| Quantity::Skid.parameter(own));
        let known = wheels.filter(|own| group.numbers[1].of_group(*own).is_some());
        assert_eq!(known.count(), last);
        let joints = (1..=snake.joints.len()).map(|own| Quantity::Stiffness.parameter(own));
        let known = joints.filter(|own| group.numbers[1].of_group(*own).is_some());
        assert_eq!(known.count(), MAX_JOINTS - snake.joints.len());
    }

    #[test]
    fn wheels_of_one_name_have_the_same_coefficients() {
        for (of_twistcar, of_racer, expected) in [
            (
                FRONT,
                "wheel = \"front\"\nskid_exponent = 0.5",
                "key `robot.twistcar.links.front.skid_exponent`: found nothing, needed 0.5, as on link `handlebar` of \
                 robot `racer`",
            ),
            (
                "wheel = \"front\"\nskid_dry_n = 0.3\nload_n = 3",
                "wheel = \"front\"\nskid_dry_n = 0.3",
                "key `robot.twistcar.links.front.load_n`: found 3.0, needed a load either on both or on neither",
            ),
            (
                FRONT,
                "",
                "found \"twistcar with the campaigns [\\\"twistcar\\\"]\", needed a robot with at least two campaigns, or",
            ),
            ("wheel = \"front\"", "wheel = \"frotn\"", "; did you mean `frotn`?"),
            (
                "wheel = \"\"",
                "",
                "key `robot.twistcar.links.front.wheel`: found \"\", needed 1 to 64",
            ),
        ] {
            let message = load_pair(of_twistcar, of_racer).expect_err(of_racer);
            assert!(message.contains(expected), "{message}");
        }
        let twice = GALLERY[0].replace("wheel_m = 0.0", "wheel_m = 0.0\nwheel = \"front\"");
        let once = GALLERY[1].replacen("wheel_m = -0.04", "wheel_m = -0.04\nwheel = \"front\"", 1);
        let message = load(&(twice + &once)).expect_err("two wheels");
        assert!(message.contains("needed a name that is unique within the robot"), "{message}");
        let none = GALLERY[0].replacen("wheel_m = 0.0", "wheel = \"front\"", 1);
        let message = load(&none).expect_err("no wheel");
        assert!(
            message.contains("links.front.wheel`: found \"front\", needed wheel_m as well"),
            "{message}"
        );
    }
}
