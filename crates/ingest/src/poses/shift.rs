//! Changes in the poses of the links due to errors that are constant over a trial.

use trilink_robot::MAX_LINKS;

use super::multibody::PARTS;

/// Changes in a frame's poses if the joint positions are estimated without one part of the trial, for each part (for the
/// delete-a-group jackknife).
#[derive(Debug, Clone, Copy)]
pub(crate) struct JointShift {
    pub frame: usize,
    pub without: [PoseShift; PARTS],
}

/// Change in a frame's poses.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PoseShift {
    /// Displacement of link 0's origin in the frame of link 0, m.
    pub moved_m: [f64; 2],
    /// Rotations of the links by number, rad.
    pub turned_rad: [f64; MAX_LINKS],
}
