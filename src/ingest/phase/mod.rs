//! When the robot is driven, at which frequency, and which phase of the command each frame has.

mod estimate;
mod harmonics;

pub use estimate::{Command, Driven};
pub use harmonics::{Clock, GAIT_HARMONICS, Harmonics};
