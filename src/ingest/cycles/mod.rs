//! From coordinates and phase to cycles: the wheels' velocities, the metrics of every cycle, which
//! cycles are steady, and the trial's means and checks.

mod clipping;
mod means;
mod measure;
pub mod steady;
pub mod summary;
mod velocity;

pub use measure::CycleData;
pub use velocity::{WheelVelocities, wheel_velocities};
