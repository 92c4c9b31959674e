//! From coordinates and phase to cycles: the wheels' velocities, the metrics of every cycle, which
//! cycles are steady, and what is said of the trial by their means.

pub mod clipping;
mod means;
mod measure;
pub mod steady;
pub mod summary;
mod velocity;

pub use means::Estimate;
pub use measure::CycleData;
pub use velocity::{WheelVelocities, wheel_velocities};
