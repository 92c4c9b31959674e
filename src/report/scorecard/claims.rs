//! The claims of `claims.toml`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::computed::Computed;
use super::measured::Measured;
use super::paper::{Fitted, MotionSpec};

/// Everything in the file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Claims {
    /// Fitted values of Tables I and II by campaign.
    pub fitted: BTreeMap<String, Fitted>,
    /// Motions that claims are about, by name.
    pub motion: BTreeMap<String, MotionSpec>,
    /// In the order in which they are shown.
    pub claim: Vec<Claim>,
}

/// One number or claim of the paper.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Claim {
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
    pub printed: Option<Printed>,
    #[serde(default)]
    pub unit: String,
    /// When the claim counts as reproduced.
    pub criterion: Option<Criterion>,
    /// Which number the verdict is about.
    #[serde(default)]
    pub judged: Judged,
    /// From the paper's own parameters.
    pub computed: Option<Computed>,
    /// From the trials at hand.
    pub measured: Option<Measured>,
    /// Why there is no verdict.
    pub not_testable: Option<String>,
    #[serde(default)]
    pub remark: String,
    /// More numbers for the remark.
    #[serde(default)]
    pub also: Vec<Also>,
}

/// A printed number, or several of them as text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Printed {
    Number(f64),
    Text(String),
}

/// When a number agrees with a claim.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Criterion {
    /// Not farther from the printed number than this.
    Within(f64),
    /// The same in per cent of the printed number.
    WithinPercent(f64),
    /// To nine digits.
    Equals(f64),
    AtLeast(f64),
    AtMost(f64),
    Between([f64; 2]),
    /// The printed number, give or take this, lies in the 95 % confidence interval of the fit.
    ConfidenceInterval(f64),
}

/// The number that a verdict is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Judged {
    #[default]
    Computed,
    Measured,
}

/// A number in words; `{}` stands for it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Also {
    pub text: String,
    pub computed: Computed,
}

impl Claims {
    /// The claims that come with the program.
    ///
    /// # Errors
    /// The file does not fit the types here.
    pub fn load() -> Result<Self, toml::de::Error> {
        toml::from_str(include_str!("claims.toml"))
    }
}

impl Printed {
    /// The number, where it is a single one.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Number(number) => Some(*number),
            Self::Text(_) => None,
        }
    }
}
