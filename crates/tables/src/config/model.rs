//! `[model.NAME]`: what resists the wheels, what drives the robot, and what a fit leaves free.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use trilink_base::named;
use trilink_robot::{Laws, Model, Parameter, RollLaw, SkidLaw};

/// Models by their names.
pub type Models = BTreeMap<Model, ModelConfig>;

/// A model that is fitted to campaigns.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// What resists skidding.
    pub skid: SkidLaw,
    /// What resists rolling.
    pub roll: RollLaw,
    /// What drives it, whatever `[fit] gait_input` says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input: Option<GaitInput>,
    /// What its fit leaves free where the campaign does not say; without it the coefficients of
    /// skidding. What the campaign's gait has no joint for is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free: Option<Free>,
}

impl ModelConfig {
    /// The laws of its wheels.
    pub fn laws(&self) -> Laws {
        Laws { skid: self.skid, roll: self.roll }
    }

    /// What its fit leaves free where the campaign does not say.
    pub fn free(&self) -> Vec<Parameter> {
        let is_free = |of: &Parameter| {
            let quantity = of.quantity();
            quantity.definition().is_free_by_default && self.laws().wheels_need(quantity)
        };
        let by_default = || Parameter::ALL.into_iter().filter(is_free).collect();
        self.free.as_ref().map_or_else(by_default, |Free(listed)| listed.clone())
    }

    /// Whether each trial's own gait drives it and no other: then it has no motion between the
    /// trials' frequencies.
    pub fn is_of_trials(&self) -> bool {
        self.input == Some(GaitInput::Measured)
    }
}

named! {
    /// The gait that drives a model.
    pub enum GaitInput {
        /// The campaign's command, as in the paper.
        Commanded = "commanded",
        /// Mean and first harmonic of each trial's measured joint angles: servos do not quite
        /// follow their commands.
        Measured = "measured",
    }
}

impl GaitInput {
    /// The other one.
    pub fn other(self) -> Self {
        match self {
            Self::Commanded => Self::Measured,
            Self::Measured => Self::Commanded,
        }
    }
}

/// What a model leaves free in its fit: a list of the parameters' names, where `skid`, `skid_dry` and
/// `skid_static` are short for the coefficients of all three wheels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Free(pub Vec<Parameter>);

impl Serialize for Free {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(|parameter| parameter.key()))
    }
}

impl<'de> Deserialize<'de> for Free {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut parameters = Vec::new();
        for name in Vec::<String>::deserialize(deserializer)? {
            let of_wheel = |of: &Parameter| of.quantity().stem() == name;
            // With the unit or without it.
            let is_own = |of: &Parameter| [of.key(), of.name()].contains(&name.as_str());
            match Parameter::ALL.into_iter().find(is_own) {
                Some(parameter) => parameters.push(parameter),
                None if Parameter::ALL.iter().any(of_wheel) => {
                    parameters.extend(Parameter::ALL.into_iter().filter(of_wheel));
                }
                None => {
                    let known = Parameter::ALL.map(Parameter::key).join("`, `");
                    return Err(serde::de::Error::custom(format!(
                        "unknown variant `{name}`, expected one of `skid`, `skid_dry`, \
                         `skid_static`, `{known}`"
                    )));
                }
            }
        }
        Ok(Self(parameters))
    }
}

#[cfg(test)]
mod tests {
    use trilink_robot::Quantity;

    use super::*;

    #[test]
    fn a_model_that_does_not_say_what_is_free_frees_how_it_skids() {
        let free = |text: &str| toml::from_str::<ModelConfig>(text).map(|model| model.free());
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
        // Lists name all wheels at once, or one, or sums.
        let listed =
            "skid = \"stribeck\"\nroll = \"coulomb\"\nfree = [\"skid_static\", \"roll_dry\"]";
        let names: Vec<&str> = free(listed).iter().flatten().map(|of| of.key()).collect();
        assert_eq!(names, ["skid_static0", "skid_static1", "skid_static2", "roll_dry"]);
        // As columns have them, too.
        for of in Parameter::ALL {
            let listed =
                |name| format!("skid = \"stribeck\"\nroll = \"coulomb\"\nfree = [\"{name}\"]");
            assert_eq!(free(&listed(of.name())), Ok(vec![of]));
            assert_eq!(free(&listed(of.key())), Ok(vec![of]));
        }
    }
}
