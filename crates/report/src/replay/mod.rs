//! Motions to look at: the robot from above, frame by frame, with what is known of each frame.
//!
//! A page has a motion in whole numbers: lengths in 0.1 mm, angles in 0.1 mrad, times in 0.1 ms,
//! velocities in 0.1 mm/s, each number as its difference to the last one that is known.

mod drawing;
mod numbers;
mod simulation;
mod trial;

use trilink_mechanics::Pose;
use trilink_plot::RGBColor;
use trilink_robot::Robot;

pub use simulation::{SimulationError, page as simulation_page};
pub(crate) use trial::of_trial;
#[cfg(test)]
pub(crate) use trial::repeated;

/// Frames of a replay at most.
const MOST_FRAMES: usize = 300;
/// A motion to look at. Vectors of frames are as long as `time_s`; what is not known is NaN or none.
#[derive(Debug, Clone)]
pub(crate) struct Replay {
    pub robot: Robot,
    pub time_s: Vec<f64>,
    /// What is shown, and what is shown over it.
    pub motions: Vec<Motion>,
    pub quantities: Vec<Quantity>,
    pub markers: Vec<Marker>,
    /// By rising first frame.
    pub marks: Vec<Mark>,
    pub cycles: Option<Cycles>,
    /// What a reader has to know, in sentences.
    pub notes: Vec<String>,
}

/// Pose of link 0 and joint angles.
pub(crate) type Coordinates = (Pose, [f64; 2]);

/// The robot's coordinates over time.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    pub name: String,
    /// That of a model.
    pub colour: Option<RGBColor>,
    pub poses: Vec<Option<Coordinates>>,
}

/// A quantity that is written beside the frame and, where it has a direction at the wheels, drawn.
#[derive(Debug, Clone)]
pub(crate) struct Quantity {
    pub name: &'static str,
    pub unit: &'static str,
    /// Units in an SI unit, and digits after the point.
    pub units: f64,
    pub decimals: usize,
    /// In SI units: of each wheel or joint, or a single one.
    pub values: Vec<Vec<f64>>,
    pub arrow: Option<Direction>,
}

/// Direction of an arrow at a wheel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Direction {
    /// Ahead, as the wheel rolls.
    Along,
    /// To the left, as the wheel skids.
    Across,
}

/// A marker at its place on a link.
#[derive(Debug, Clone)]
pub(crate) struct Marker {
    pub link: usize,
    pub label: String,
    pub position_mm: [f64; 2],
}

/// What is said of a marker from a frame to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Mark {
    pub frames: [usize; 2],
    pub marker: usize,
    pub is_corrected: bool,
}

/// When cycles begin.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cycles {
    /// Number and start of one of them, s.
    pub number: i64,
    pub start_s: f64,
    pub period_s: f64,
}

impl Replay {
    /// Poses of links 0, 1, 2 in a frame.
    fn links(&self, motion: &Motion, frame: usize) -> Option<[Pose; 3]> {
        motion.poses[frame].map(|(pose, phi_rad)| self.robot.link_poses(pose, phi_rad))
    }
}
