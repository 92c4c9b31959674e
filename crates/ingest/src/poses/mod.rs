//! From the links' own poses to the robot's coordinates over time (eq. 1): tilt of the floor, of
//! the links and of their suspension is undone, the joints are closed, short gaps are filled.

mod checks;
mod continuity;
mod multibody;
mod suspension;
mod tilt;
mod track;

pub(crate) use checks::{describe_tracking, header_check, tilt_check, tracking_checks};
pub(crate) use multibody::{JointPosition, Linkage, PARTS};
pub use track::frame_grid;
pub(crate) use track::{Constant, JointShift, Tracked, solve};
