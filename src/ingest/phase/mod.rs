//! When the robot is driven, at which frequency, and which phase of the command each frame has.

mod estimate;
mod harmonics;

pub use estimate::{CommandedGait, GaitPhase};
pub use harmonics::{GAIT_HARMONICS, Harmonics, LinearPhase};
