//! `[model.NAME]`: friction laws of the wheels, input gait and free parameters of a model.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use trilink_base::named;
use trilink_robot::{Laws, Model, Parameter, RollLaw, SkidLaw};

/// Configured models by name.
pub type Models = BTreeMap<Model, ModelConfig>;

/// Configuration of a model that is fitted to campaigns.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Law of the wheels' resistance to skidding.
    pub skid: SkidLaw,
    /// Law of the wheels' resistance to rolling.
    pub roll: RollLaw,
    /// Kind of gait that drives the model; `None` if the setting `gait_input` in `[fit]` applies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input: Option<GaitInput>,
    /// Parameters that are free in a fit unless the campaign specifies others; `None` for those parameters of the skid
    /// law that are free by default. Parameters of a passive joint are left out if the campaign's gait has no passive
    /// joint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free: Option<Free>,
}

impl ModelConfig {
    /// Returns the friction laws of the wheels.
    pub fn laws(&self) -> Laws {
        Laws { skid: self.skid, roll: self.roll }
    }

    /// Returns the parameters that are free in a fit unless the campaign specifies others, for as many wheels as a robot
    /// can have.
    pub fn free(&self) -> Vec<Parameter> {
        if let Some(Free(listed)) = &self.free {
            return listed.clone();
        }
        let mut free = Parameter::OF_ANY_ROBOT.to_vec();
        free.retain(|parameter| {
            let quantity = parameter.quantity();
            quantity.definition().is_free_by_default && self.laws().is_used(quantity)
        });
        free
    }

    /// Returns whether the model is driven only by the measured gaits of trials, so that it cannot be
    /// evaluated between the trials' frequencies.
    pub fn is_of_trials(&self) -> bool {
        self.input == Some(GaitInput::Measured)
    }
}

named! {
    /// Kind of gait that drives a model.
    pub enum GaitInput {
        /// The commanded gait of the campaign, as in the paper.
        Commanded = "commanded",
        /// Mean and first harmonic of the joint angles measured in each trial, which differ from the commands
        /// because servos do not follow these exactly.
        Measured = "measured",
    }
}

impl GaitInput {
    /// Returns `Measured` for `Commanded`, and vice versa.
    pub fn other(self) -> Self {
        match self {
            Self::Commanded => Self::Measured,
            Self::Measured => Self::Commanded,
        }
    }
}

/// Free parameters of a model. The configuration lists their names; `skid`, `skid_dry` and `skid_static` stand for the
/// coefficients of all wheels, as many as a robot can have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Free(pub Vec<Parameter>);

impl Serialize for Free {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let is_of_all = |parameter: &Parameter| {
            let mut of_each = parameter.quantity().of_any_wheel().peekable();
            of_each.peek().is_some() && of_each.all(|one| self.0.contains(&one))
        };
        let names = self.0.iter().filter_map(|parameter| match parameter.number() {
            Some(0) if is_of_all(parameter) => Some(parameter.quantity().stem()),
            Some(_) if is_of_all(parameter) => None,
            _ => Some(parameter.key()),
        });
        serializer.collect_seq(names)
    }
}

impl<'de> Deserialize<'de> for Free {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut parameters = Vec::new();
        for name in Vec::<String>::deserialize(deserializer)? {
            // A parameter may be named with or without its unit.
            let has_name = |one: &Parameter| [one.key(), one.name()].contains(&name.as_str());
            if let Some(parameter) = Parameter::OF_ANY_ROBOT.into_iter().find(has_name) {
                parameters.push(parameter);
                continue;
            }
            let mut of_all_wheels = Parameter::OF_ANY_ROBOT.to_vec();
            of_all_wheels.retain(|one| one.quantity().stem() == name);
            if of_all_wheels.is_empty() {
                let known = Parameter::ALL.map(Parameter::key).join("`, `");
                return Err(serde::de::Error::custom(format!(
                    "unknown variant `{name}`, expected one of `skid`, `skid_dry`, \
                     `skid_static`, `{known}`"
                )));
            }
            parameters.extend(of_all_wheels);
        }
        Ok(Self(parameters))
    }
}

#[cfg(test)]
mod tests {
    use trilink_robot::Quantity;

    use super::*;

    #[test]
    fn skid_coefficients_are_free_by_default() {
        let free = |text: &str| {
            let mut free = toml::from_str::<ModelConfig>(text).map(|model| model.free())?;
            free.retain(|one| one.is_of_three_links());
            Ok::<_, toml::de::Error>(free)
        };
        assert_eq!(
            free("skid = \"viscous\"\nroll = \"none\""),
            Ok(Quantity::Skid.of_each().into())
        );
        assert_eq!(
            free("skid = \"stribeck\"\nroll = \"coulomb\""),
            Ok(Quantity::SkidDry.of_each().into())
        );
        let both = [Quantity::Skid.of_each(), Quantity::SkidDry.of_each()].concat();
        assert_eq!(free("skid = \"coulomb-viscous\"\nroll = \"none\""), Ok(both));
        assert_eq!(free("skid = \"constrained\"\nroll = \"viscous\""), Ok(Vec::new()));
        // A list can name all wheels at once, a single wheel, or a sum.
        let listed =
            "skid = \"stribeck\"\nroll = \"coulomb\"\nfree = [\"skid_static\", \"roll_dry\"]";
        let names: Vec<&str> = free(listed).iter().flatten().map(|one| one.key()).collect();
        assert_eq!(names, ["skid_static0", "skid_static1", "skid_static2", "roll_dry"]);
        // Names with units, as in table columns, are also accepted.
        for parameter in Parameter::ALL {
            for name in [parameter.name(), parameter.key()] {
                let text = format!("skid = \"stribeck\"\nroll = \"coulomb\"\nfree = [\"{name}\"]");
                assert_eq!(free(&text), Ok(vec![parameter]));
            }
        }
    }
}
