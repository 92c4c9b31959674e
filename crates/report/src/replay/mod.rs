//! Replays: animations of the robot seen from above, with the values of the quantities in each frame.
//!
//! A page stores the motion as integers: lengths in units of 0.1 mm, angles in 0.1 mrad, times in 0.1 ms, velocities in
//! 0.1 mm/s. Each integer is stored as its difference from the last known value.

mod body;
mod drawing;
mod numbers;
mod simulation;
mod trial;

use trilink_mechanics::Pose;
use trilink_plot::RGBColor;
use trilink_robot::Chain;

use crate::recording::Coordinates;

pub(crate) use drawing::nice;
pub use simulation::{SimulationError, page as simulation_page};
pub(crate) use trial::of_trial;
#[cfg(test)]
pub(crate) use trial::repeated;

/// Maximum number of frames in a replay.
const MAX_FRAMES: usize = 300;

/// Animation of the robot. Vectors with one entry per frame have the length of `time_s`; unknown values are NaN or
/// `None`.
#[derive(Debug, Clone)]
pub(crate) struct Replay {
    pub robot: Chain,
    pub time_s: Vec<f64>,
    /// Main motion, followed by the motions that are overlaid on it.
    pub motions: Vec<Motion>,
    pub quantities: Vec<Quantity>,
    pub markers: Vec<Marker>,
    /// Ranges of frames with missing or corrected markers, sorted by first frame.
    pub marks: Vec<Mark>,
    pub cycles: Option<Cycles>,
    /// Sentences that form the caption.
    pub notes: Vec<String>,
}

/// Coordinates of the robot in every frame.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    pub name: String,
    /// Colour of the model if the motion is overlaid; `None` for the main motion.
    pub colour: Option<RGBColor>,
    pub poses: Vec<Option<Coordinates>>,
}

/// Quantity whose value is shown for each frame and, if the quantity has a direction at the wheels, as an arrow.
#[derive(Debug, Clone)]
pub(crate) struct Quantity {
    pub name: String,
    pub unit: &'static str,
    /// Number of display units per SI unit.
    pub units: f64,
    /// Number of decimal places shown.
    pub decimals: usize,
    /// Values in SI units by frame: one series for each wheel or joint, or a single series.
    pub values: Vec<Vec<f64>>,
    pub arrow: Option<Direction>,
    /// Value, in the SI unit, from which the length of the arrows follows; `None` if it follows from `values`.
    pub full_scale: Option<f64>,
}

/// Direction of an arrow at a wheel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Direction {
    /// Along the rolling direction, positive forward.
    Along,
    /// Across the rolling direction, positive to the left.
    Across,
}

/// Marker at its position on a link.
#[derive(Debug, Clone)]
pub(crate) struct Marker {
    pub link: usize,
    pub label: String,
    pub position_mm: [f64; 2],
}

/// Range of frames (first and last) in which a marker is missing or corrected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Mark {
    pub frames: [usize; 2],
    pub marker: usize,
    pub is_corrected: bool,
}

/// Times and numbers of the gait cycles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cycles {
    /// Number of the cycle that starts at `start_s`.
    pub number: i64,
    pub start_s: f64,
    pub period_s: f64,
}

impl Replay {
    /// Returns the poses of the links by number in a frame; `None` if they are unknown.
    fn links(&self, motion: &Motion, frame: usize) -> Option<Vec<Pose>> {
        let (pose, phi_rad) = motion.poses[frame]?;
        let [links, _] = self.robot.poses(pose, &phi_rad[..self.robot.joints.len()]);
        Some(links)
    }
}
