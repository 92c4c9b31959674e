//! `[robot.NAME]`: a robot of three links in the short form, or a chain described link by link.

use std::fmt;
use std::sync::LazyLock;

use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use trilink_robot::{AnyGait, AnyRobot, Chain, Quantity};

use super::three_links::{Key as ThreeLinkKey, Reader};
use super::{ChainRobot, GaitConfig, ThreeLinkRobot};
use crate::trial::TrialKind;

/// Robot in the configuration.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum RobotConfig {
    /// Short form for three links, by `h_m`, `l_m` and `b_m`.
    ThreeLinks(ThreeLinkRobot),
    /// Chain described link by link, in `links`.
    Chain(ChainRobot),
}

impl RobotConfig {
    /// Names of the links of a robot of three links by their numbers.
    pub const THREE_LINKS: [&str; 3] = ["middle", "front", "rear"];

    /// Returns the robot of three links; `None` for a chain.
    pub fn three_links(&self) -> Option<&ThreeLinkRobot> {
        match self {
            Self::ThreeLinks(robot) => Some(robot),
            Self::Chain(_) => None,
        }
    }

    /// Returns mutable access to the robot of three links; `None` for a chain.
    pub fn three_links_mut(&mut self) -> Option<&mut ThreeLinkRobot> {
        match self {
            Self::ThreeLinks(robot) => Some(robot),
            Self::Chain(_) => None,
        }
    }

    /// Returns the chain; `None` for a robot of three links.
    pub fn chain(&self) -> Option<&ChainRobot> {
        match self {
            Self::ThreeLinks(_) => None,
            Self::Chain(chain) => Some(chain),
        }
    }

    /// Returns mutable access to the chain; `None` for a robot of three links.
    pub fn chain_mut(&mut self) -> Option<&mut ChainRobot> {
        match self {
            Self::ThreeLinks(_) => None,
            Self::Chain(chain) => Some(chain),
        }
    }

    /// Converts the robot to SI units; a chain has the commands of its gait. A driven joint or rotor of a chain without a
    /// command stands still, as in trials without a gait.
    pub fn to_robot(&self, gait: &GaitConfig) -> AnyRobot {
        match self {
            Self::ThreeLinks(robot) => robot.to_robot().into(),
            Self::Chain(chain) => chain.to_chain(gait).into(),
        }
    }

    /// Returns the robot and its gait in SI units.
    pub fn setup(&self, gait: &GaitConfig) -> (AnyRobot, AnyGait) {
        let robot = self.to_robot(gait);
        let gait = robot.as_chain().map_or_else(|| gait.to_gait().into(), Chain::gait);
        (robot, gait)
    }

    /// Returns the robot without the names of its wheels, which matter only to fits of several robots.
    #[must_use]
    pub fn without_wheel_names(mut self) -> Self {
        let links = self.chain_mut().into_iter().flat_map(|chain| &mut chain.links);
        links.for_each(|link| link.wheel = None);
        self
    }

    /// Returns the robot with exact values: without standard deviations, which only fits read.
    #[must_use]
    pub fn without_deviations(mut self) -> Self {
        match &mut self {
            Self::ThreeLinks(robot) => robot.clear_deviations(),
            Self::Chain(ChainRobot { links, joints, .. }) => {
                let of_links =
                    links.iter_mut().map(|of| (&mut of.standard_deviation, &mut of.same));
                let of_joints =
                    joints.iter_mut().map(|of| (&mut of.standard_deviation, &mut of.same));
                for (deviations, same) in of_links.chain(of_joints) {
                    deviations.clear();
                    same.clear();
                }
            }
        }
        self
    }

    /// Returns a copy whose values are off by their errors: `draw` returns the next error in standard deviations.
    #[must_use]
    pub fn with_errors(&self, draw: impl FnMut() -> f64) -> Self {
        match self {
            Self::ThreeLinks(robot) => Self::ThreeLinks(robot.with_errors(draw)),
            Self::Chain(chain) => Self::Chain(chain.with_errors(draw)),
        }
    }

    /// Returns whether no value has a standard deviation, so that all values are taken as exact.
    pub fn is_exact(&self) -> bool {
        match self {
            Self::ThreeLinks(robot) => robot.is_exact(),
            Self::Chain(chain) => chain.errors().is_empty(),
        }
    }

    /// Checks that trials of a kind are possible with the robot.
    ///
    /// # Errors
    /// Returns which robot is needed.
    pub fn check_kind(&self, kind: TrialKind) -> Result<(), &'static str> {
        self.chain().map_or(Ok(()), |chain| chain.check_kind(kind))
    }
}

/// Key of a robot.
enum Key {
    Links,
    Joints,
    Reference,
    SkidLength,
    OfThreeLinks(ThreeLinkKey),
}

/// Keys that only chains have.
const OF_CHAINS: [&str; 4] = ["links", "joints", "reference", "skid_length_m"];
/// Quantities of a robot of three links that chains have, too.
const OF_BOTH: [Quantity; 2] = [Quantity::Transition, Quantity::Stribeck];

static KEYS: LazyLock<Vec<&str>> =
    LazyLock::new(|| ThreeLinkKey::names().chain(OF_CHAINS).collect());

impl<'de> Deserialize<'de> for Key {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let key = String::deserialize(deserializer)?;
        match key.as_str() {
            "links" => Ok(Self::Links),
            "joints" => Ok(Self::Joints),
            "reference" => Ok(Self::Reference),
            "skid_length_m" => Ok(Self::SkidLength),
            _ => {
                let key_of_three = ThreeLinkKey::of_name(&key).map(Self::OfThreeLinks);
                key_of_three.ok_or_else(|| D::Error::unknown_field(&key, &KEYS))
            }
        }
    }
}

impl<'de> Deserialize<'de> for RobotConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_struct("Robot", &KEYS, RobotVisitor)
    }
}

struct RobotVisitor;

impl<'de> Visitor<'de> for RobotVisitor {
    type Value = RobotConfig;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a table with `h_m`, `l_m`, `b_m` and so on, or with `links` and `joints`")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut table: A) -> Result<RobotConfig, A::Error> {
        let mut of_three = Reader::default();
        let (mut links, mut joints, mut reference, mut skid_length_m) = (None, None, None, None);
        while let Some(key) = table.next_key()? {
            match key {
                Key::Links => links = Some(table.next_value()?),
                Key::Joints => joints = Some(table.next_value()?),
                Key::Reference => reference = Some(table.next_value()?),
                Key::SkidLength => skid_length_m = Some(table.next_value()?),
                Key::OfThreeLinks(key) => of_three.read(key, &mut table)?,
            }
        }
        let Some(links) = links else {
            let given = [
                ("joints", joints.is_some()),
                ("reference", reference.is_some()),
                ("skid_length_m", skid_length_m.is_some()),
            ];
            let chain_key = given.into_iter().find(|(_, is_given)| *is_given);
            if let Some((key, _)) = chain_key {
                return Err(A::Error::custom(format!(
                    "invalid key `{key}` without `links`: list the links of the chain in `links`, or remove this key \
                     for a robot described by h_m, l_m and b_m"
                )));
            }
            return of_three.finish().map(RobotConfig::ThreeLinks);
        };
        if let Some(quantity) = of_three.inline_deviation(&OF_BOTH) {
            let key = quantity.name();
            return Err(A::Error::custom(format!(
                "key `{key}`: found a standard deviation, needed a number alone, because the robot is a chain"
            )));
        }
        if let Some(key) = of_three.key_except(&OF_BOTH) {
            return Err(A::Error::custom(format!(
                "invalid key `{key}` beside `links`, which makes the robot a chain: give the values of each link in \
                 `links` and of each joint in `joints` and remove this key, or remove `links` for a robot described by \
                 h_m, l_m and b_m"
            )));
        }
        Ok(RobotConfig::Chain(ChainRobot {
            links,
            joints: joints.ok_or_else(|| A::Error::missing_field("joints"))?,
            reference,
            skid_length_m,
            transition_m_s: of_three.one(Quantity::Transition),
            stribeck_m_s: of_three.one(Quantity::Stribeck),
        }))
    }
}
