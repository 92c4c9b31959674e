//! The robot's parameters by trials without a gait.

pub mod coast;
mod curve;
pub mod release;
