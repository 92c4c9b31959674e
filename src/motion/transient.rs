//! The motion from rest, by the same collocation, one element after the other.
//!
//! Radau IIA is L-stable: the wheels' time constants, down to 0.2 ms, need not be resolved
//! once their transients are over.

use super::MotionError;
use super::element::{Linearised, follow_element, tail};
use super::path::{Pose, advance};
use super::radau::{RADAU, STAGES};
use super::reduced::{Driven, Moment, Reduced};

/// A motion followed from rest.
#[derive(Debug, Clone, Default)]
pub struct Transient {
    elements: Vec<Element>,
}

/// Coordinates at the start and the stages of one element.
#[derive(Debug, Clone)]
struct Element {
    start_s: f64,
    duration_s: f64,
    /// x, y, theta, phi1, phi2 (m and rad) at the start and the stages.
    coordinates: [[f64; STAGES + 1]; 5],
}

impl Transient {
    /// Coordinates `(x, y, theta, phi1, phi2)`, m and rad, at a time after the start, s; the
    /// end's beyond it.
    pub fn at(&self, time_s: f64) -> [f64; 5] {
        let after = self.elements.partition_point(|element| element.start_s <= time_s);
        let element = &self.elements[after.saturating_sub(1)];
        let part = ((time_s - element.start_s) / element.duration_s).clamp(0.0, 1.0);
        element.coordinates.map(|values| RADAU.interpolate(&values, part))
    }
}

/// Longest element as part of a period.
const LONGEST_PART: f64 = 1.0 / 8.0;
/// Shortest element as part of a period; one that needs less cannot be followed.
const SHORTEST_PART: f64 = 1e-9;

/// Follows the motion from rest for `duration_s` with a relative error near `tolerance`.
pub(super) fn follow<const N: usize, R: Reduced<N>>(
    model: &R,
    driven: &Driven,
    duration_s: f64,
    tolerance: f64,
) -> Result<(Transient, [f64; N]), MotionError> {
    let period_s = std::f64::consts::TAU / driven.omega_rad_s;
    let mut state = model.at_rest();
    let mut pose = Pose::default();
    let (mut time_s, mut length_s) = (0.0, 1e-4 * period_s);
    let mut sizes = state.map(f64::abs);
    let mut transient = Transient::default();
    let mut room = Linearised::default();
    room.resize::<N, R>(1);
    while time_s < duration_s {
        length_s = length_s.min(LONGEST_PART * period_s).min(duration_s - time_s);
        if length_s < SHORTEST_PART * period_s && time_s + length_s < duration_s {
            return Err(MotionError::Stuck { time_s });
        }
        let node = |part: f64| model.node(driven.omega_rad_s * (time_s + part * length_s));
        let nodes = RADAU.nodes.map(node);
        let Some(stages) = follow_element(model, &nodes, &state, length_s, tolerance, &mut room)
        else {
            length_s *= 0.25;
            continue;
        };
        let mut grown = sizes;
        for y in &stages {
            for i in 0..N {
                grown[i] = grown[i].max(y[i].abs());
            }
        }
        let largest = grown.iter().fold(0.0_f64, |largest, size| largest.max(*size));
        let tails = tail(&state, &stages);
        let error = (0..N)
            .map(|i| tails[i] / grown[i].max(1e-3 * largest).max(f64::MIN_POSITIVE))
            .fold(0.0, f64::max);
        let growth = (tolerance / error.max(1e-300)).powf(1.0 / (STAGES as f64 + 1.0));
        if error > 4.0 * tolerance {
            length_s *= (0.8 * growth).clamp(0.1, 0.8);
            continue;
        }
        let start = model.moment(&node(0.0), &state);
        let moments: [Moment; STAGES] =
            std::array::from_fn(|j| model.moment(&nodes[j], &stages[j]));
        let poses = advance(pose, &moments, length_s);
        transient.elements.push(record(time_s, length_s, pose, &start, &poses, &moments));
        sizes = grown;
        state = stages[STAGES - 1];
        pose = poses[STAGES - 1];
        time_s += length_s;
        length_s *= (0.9 * growth).clamp(0.3, 4.0);
    }
    Ok((transient, state))
}

fn record(
    start_s: f64,
    duration_s: f64,
    pose: Pose,
    start: &Moment,
    poses: &[Pose; STAGES],
    moments: &[Moment; STAGES],
) -> Element {
    let column = |of: &dyn Fn(&Pose, &Moment) -> f64| -> [f64; STAGES + 1] {
        std::array::from_fn(|l| match l {
            0 => of(&pose, start),
            _ => of(&poses[l - 1], &moments[l - 1]),
        })
    };
    Element {
        start_s,
        duration_s,
        coordinates: [
            column(&|pose, _| pose.x_m),
            column(&|pose, _| pose.y_m),
            column(&|pose, _| pose.theta_rad),
            column(&|_, moment| moment.phi_rad[0]),
            column(&|_, moment| moment.phi_rad[1]),
        ],
    }
}
