//! Reconstructs the robot's coordinates over time (eq. 1) from the link poses: corrects the tilt of the floor, the
//! links and their suspensions, closes the joints and fills short gaps.

mod checks;
mod continuity;
mod multibody;
mod shift;
mod suspension;
mod tilt;
mod track;

pub(crate) use checks::{describe_tracking, header_check, tilt_check, tracking_checks};
pub(crate) use multibody::{JointPosition, Linkage, PARTS};
pub(crate) use shift::{JointShift, PoseShift};
pub use track::frame_grid;
pub(crate) use track::{Constant, LinkPoses, Tracked, solve};
