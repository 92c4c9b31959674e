//! What trials without a gait tell of the robot's parameters.

pub mod coast;
mod curve;
pub mod release;
