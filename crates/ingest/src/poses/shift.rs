//! Effects of errors that are constant over a trial on the poses of the links.

use trilink_robot::MAX_LINKS;

use super::multibody::PARTS;

/// Changes in a frame's poses if one part of the trial is left out when the joint positions are estimated, for each
/// part.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JointShift {
    pub frame: usize,
    pub without: [PoseShift; PARTS],
}

/// Change in a frame's poses.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PoseShift {
    /// Displacement of link 0 along and across its direction, m.
    pub moved_m: [f64; 2],
    /// Rotations of the links by number, rad.
    pub turned_rad: [f64; MAX_LINKS],
}
