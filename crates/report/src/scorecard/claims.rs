//! Claims and printed values of the paper, read from `claims.toml`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::paper::{MotionSpec, Values};
use super::verdict::Criterion;

/// Contents of `claims.toml`: the claims of the paper, and the values and motions to which they refer.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Claims {
    /// Fitted values in Tables I and II of the paper, keyed by campaign.
    pub fitted: BTreeMap<String, Values>,
    /// Simulated motions to which the claims refer, keyed by name.
    pub motion: BTreeMap<String, MotionSpec>,
    /// Claims, in the order of the scorecard.
    pub claim: Vec<Claim>,
}

/// Claim of the paper: a printed value or a statement.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Claim {
    /// Stable identifier with which scripts refer to the claim.
    pub id: String,
    /// Heading in the scorecard under which the claim is listed.
    pub part: String,
    /// Section, table, figure or equation of the paper that contains the claim.
    pub place: String,
    pub claim: String,
    /// Quantity whose printed, computed and measured values are compared; empty if the text of the claim names it.
    #[serde(default)]
    pub quantity: String,
    pub printed: Option<f64>,
    #[serde(default)]
    pub unit: String,
    /// Criterion that the judged value must meet for the claim to count as reproduced.
    pub criterion: Criterion,
    /// Value to which the criterion is applied: the computed or the measured one.
    #[serde(default, skip_serializing)]
    pub judged: Judged,
    /// Formula ([`super::formula`]) for the value computed with the paper's own parameters; `None` if there is no such
    /// value.
    #[serde(skip_serializing)]
    pub computed: Option<String>,
    /// Formula for the value measured in the user's trials; `None` if there is no such value.
    #[serde(skip_serializing)]
    pub measured: Option<String>,
    #[serde(default, skip_serializing)]
    pub remark: String,
    /// Sentences with further values, which are added to the remark on the claim.
    #[serde(default, skip_serializing)]
    pub also: Vec<Also>,
}

/// Value to which the criterion of a claim is applied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Judged {
    #[default]
    Computed,
    Measured,
}

/// Sentence in which the value of the formula `computed` replaces `{}`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Also {
    pub text: String,
    pub computed: String,
}

impl Claims {
    /// Parses the built-in claims.
    ///
    /// # Errors
    /// Returns an error if `claims.toml` does not match the types in this module.
    pub(super) fn load() -> Result<Self, toml::de::Error> {
        toml::from_str(include_str!("claims.toml"))
    }
}
