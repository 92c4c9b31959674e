//! The claims of `claims.toml`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::paper::{MotionSpec, Values};
use super::verdict::Criterion;

/// Everything in the file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Claims {
    /// Fitted values of Tables I and II by campaign.
    pub fitted: BTreeMap<String, Values>,
    /// Motions that claims are about, by name.
    pub motion: BTreeMap<String, MotionSpec>,
    /// In the order in which they are shown.
    pub claim: Vec<Claim>,
}

/// One number or claim of the paper.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Claim {
    /// Does not change: scripts name claims by it.
    pub id: String,
    /// Part of the paper under which it is listed.
    pub part: String,
    /// Section, table, figure or equation that prints it.
    pub place: String,
    pub claim: String,
    /// What the numbers are, where the claim does not say it itself.
    #[serde(default)]
    pub quantity: String,
    pub printed: Option<f64>,
    #[serde(default)]
    pub unit: String,
    /// When the claim counts as reproduced.
    pub criterion: Criterion,
    /// Which number the verdict is about.
    #[serde(default, skip_serializing)]
    pub judged: Judged,
    /// From the paper's own parameters, by a formula ([`super::formula`]).
    #[serde(skip_serializing)]
    pub computed: Option<String>,
    /// From the trials at hand.
    #[serde(skip_serializing)]
    pub measured: Option<String>,
    #[serde(default, skip_serializing)]
    pub remark: String,
    /// More numbers for the remark.
    #[serde(default, skip_serializing)]
    pub also: Vec<Also>,
}

/// The number that a verdict is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Judged {
    #[default]
    Computed,
    Measured,
}

/// A number in words; `{}` stands for it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Also {
    pub text: String,
    pub computed: String,
}

impl Claims {
    /// The claims that come with the program.
    ///
    /// # Errors
    /// The file does not fit the types here.
    pub(super) fn load() -> Result<Self, toml::de::Error> {
        toml::from_str(include_str!("claims.toml"))
    }
}
