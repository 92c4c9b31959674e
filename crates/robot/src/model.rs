//! Names of friction models.

use std::fmt;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use trilink_base::Named;
use trilink_base::text::interned;

/// Name of a friction model, which the configuration defines. Names are interned for the lifetime of the
/// program, so copying one into table rows costs nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Model(&'static str);

impl Model {
    /// No-skid constraint `W q' = 0`, with damping only in the passive joint.
    pub const NO_SKID: Self = Self("no-skid");
    /// No-skid model driven by the measured gait of each trial.
    pub const NO_SKID_MEASURED: Self = Self("no-skid-measured");
    /// No-skid model whose joint damping is a free parameter of the fit.
    pub const NO_SKID_DAMPED: Self = Self("no-skid-damped");
    /// No-skid model with rolling resistance.
    pub const NO_SKID_ROLL: Self = Self("no-skid-roll");
    /// Skid resistance in place of the no-skid constraint.
    pub const SKID: Self = Self("skid");
    /// Skid and rolling resistance.
    pub const SKID_ROLL: Self = Self("skid-roll");
    /// Models that the paper compares.
    pub const PAPER: [Self; 6] = [
        Self::NO_SKID,
        Self::NO_SKID_MEASURED,
        Self::NO_SKID_DAMPED,
        Self::NO_SKID_ROLL,
        Self::SKID,
        Self::SKID_ROLL,
    ];

    /// Returns the model with the given name.
    pub fn new(name: &str) -> Self {
        Self(interned(name))
    }

    /// Returns the model's name in files and on the command line.
    pub const fn name(self) -> &'static str {
        self.0
    }
}

impl Serialize for Model {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.0)
    }
}

impl<'de> Deserialize<'de> for Model {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer).map(|name| Self::new(&name))
    }
}

impl Named for Model {
    fn first() -> Self {
        Self("")
    }

    fn as_name(&self) -> &str {
        self.0
    }

    fn of_name(name: &str) -> Option<Self> {
        (!name.is_empty()).then(|| Self::new(name))
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.pad(self.0)
    }
}
