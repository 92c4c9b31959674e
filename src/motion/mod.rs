//! stub
use serde::{Deserialize, Serialize};
/// Which forces resist the wheels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    NoSkid,
    NoSkidMeasured,
    NoSkidDamped,
    NoSkidRoll,
    Skid,
    SkidRoll,
}
