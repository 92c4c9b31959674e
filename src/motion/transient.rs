//! The motion from rest, by the same collocation, one element after the other.
//!
//! Radau IIA is L-stable: the wheels' time constants, down to 0.2 ms, need not be resolved
//! once their transients are over.

use std::f64::consts::TAU;

use super::MotionError;
use super::element::{Linearised, Stages, follow_element, interpolate, tail};
use super::path::advance;
use super::radau::{RADAU, STAGES};
use super::reduced::{Driven, Moment, Reduced};
use crate::robot::Pose;

/// A motion on its way, at first at rest at phase 0.
#[derive(Debug)]
pub(super) struct Follower<'a, const N: usize, R> {
    model: &'a R,
    driven: &'a Driven,
    tolerance: f64,
    pub time_s: f64,
    pub state: [f64; N],
    pub pose: Pose,
    /// Elements so far.
    pub elements: usize,
    /// Largest value of each state so far.
    sizes: [f64; N],
    /// Length that the next element should have.
    length_s: f64,
    /// Start, stages and length of the last element.
    last: Option<([f64; N], Stages<N>, f64)>,
}

/// One element of a followed motion.
pub(super) struct Step<'a, const N: usize> {
    pub time_s: f64,
    pub duration_s: f64,
    /// State and pose where the element starts.
    pub start: &'a [f64; N],
    pub pose: Pose,
    pub moments: &'a [Moment; STAGES],
    pub poses: &'a [Pose; STAGES],
}

/// Longest element as part of a period.
const LONGEST_PART: f64 = 1.0 / 8.0;
/// Shortest element as part of a period; one that needs less cannot be followed.
const SHORTEST_PART: f64 = 1e-9;
/// Most elements of a period.
const MOST_ELEMENTS: usize = 20_000;
/// How far an element's polynomial is of use beyond its end, as a part of its length.
const FARTHEST: f64 = 1.5;
/// States smaller than this part of the largest are judged by the largest.
const SMALL: f64 = 1e-3;

impl<'a, const N: usize, R: Reduced<N>> Follower<'a, N, R> {
    /// A robot at rest; the motion's relative error per element is near `tolerance`.
    pub fn new(model: &'a R, driven: &'a Driven, tolerance: f64) -> Self {
        let state = model.at_rest();
        Self {
            model,
            driven,
            tolerance,
            time_s: 0.0,
            state,
            pose: Pose::default(),
            elements: 0,
            sizes: state.map(f64::abs),
            length_s: 1e-4 * TAU / driven.omega_rad_s,
            last: None,
        }
    }

    /// Goes on to a later time; `visit` is given every element.
    ///
    /// # Errors
    /// An element would have to be too short.
    pub fn advance_to(
        &mut self,
        until_s: f64,
        room: &mut Linearised,
        mut visit: impl FnMut(&Step<N>),
    ) -> Result<(), MotionError> {
        let (model, tolerance) = (self.model, self.tolerance);
        let period_s = TAU / self.driven.omega_rad_s;
        let stuck = |time_s| Err(MotionError::Stuck { time_s });
        room.resize::<N, R>(1);
        let most = MOST_ELEMENTS * (1 + ((until_s - self.time_s) / period_s) as usize);
        let mut elements = 0;
        while self.time_s < until_s {
            elements += 1;
            if self.length_s < SHORTEST_PART * period_s || elements > most {
                return stuck(self.time_s);
            }
            let wanted_s = self.length_s.min(LONGEST_PART * period_s);
            let is_last = wanted_s >= until_s - self.time_s;
            let length_s = if is_last { until_s - self.time_s } else { wanted_s };
            let nodes = RADAU
                .nodes
                .map(|part| model.node(self.driven.omega_rad_s * (self.time_s + part * length_s)));
            let (start, guess) = (&self.state, self.guess(length_s));
            let followed = follow_element(model, &nodes, start, length_s, &guess, tolerance, room);
            let Some(stages) = followed else {
                self.length_s = 0.25 * length_s;
                continue;
            };
            let sizes = grown(&self.sizes, &stages);
            let largest = sizes.iter().fold(0.0_f64, |largest, size| largest.max(*size));
            let tails = tail(&self.state, &stages);
            let error = (0..N)
                .map(|i| tails[i] / sizes[i].max(SMALL * largest).max(f64::MIN_POSITIVE))
                .fold(0.0, f64::max);
            let growth = (tolerance / error.max(1e-300)).powf(1.0 / (STAGES as f64 + 1.0));
            if error > 4.0 * tolerance {
                self.length_s = length_s * (0.8 * growth).clamp(0.1, 0.8);
                continue;
            }
            let moments = std::array::from_fn(|j| model.moment(&nodes[j], &stages[j]));
            let poses = advance(self.pose, &moments, length_s);
            visit(&Step {
                time_s: self.time_s,
                duration_s: length_s,
                start: &self.state,
                pose: self.pose,
                moments: &moments,
                poses: &poses,
            });
            self.elements += 1;
            self.sizes = sizes;
            self.last = Some((self.state, stages, length_s));
            self.state = stages[STAGES - 1];
            self.pose = poses[STAGES - 1];
            self.time_s = if is_last { until_s } else { self.time_s + length_s };
            let next_s = length_s * (0.9 * growth).clamp(0.3, 4.0);
            // An element that was cut short says little about the next.
            self.length_s = if is_last { next_s.max(self.length_s) } else { next_s };
        }
        Ok(())
    }

    /// Stages that an element of this length may have: those of the last element's polynomial,
    /// or, where that would be too far from it, the state at its end.
    fn guess(&self, length_s: f64) -> Stages<N> {
        match &self.last {
            Some((start, stages, last_s)) if length_s <= FARTHEST * last_s => {
                RADAU.nodes.map(|part| interpolate(start, stages, 1.0 + part * length_s / last_s))
            }
            _ => [self.state; STAGES],
        }
    }

    /// Largest difference of two states relative to what the states have been.
    pub fn distance(&self, a: &[f64; N], b: &[f64; N]) -> f64 {
        let largest = self.sizes.iter().fold(0.0_f64, |largest, size| largest.max(*size));
        let floor = (SMALL * largest).max(f64::MIN_POSITIVE);
        (0..N).map(|i| (a[i] - b[i]).abs() / self.sizes[i].max(floor)).fold(0.0, f64::max)
    }
}

fn grown<const N: usize>(sizes: &[f64; N], stages: &Stages<N>) -> [f64; N] {
    std::array::from_fn(|i| stages.iter().fold(sizes[i], |size, y| size.max(y[i].abs())))
}

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

/// Follows the motion from rest for `duration_s` with a relative error near `tolerance`.
pub(super) fn follow<const N: usize, R: Reduced<N>>(
    model: &R,
    driven: &Driven,
    duration_s: f64,
    tolerance: f64,
) -> Result<Transient, MotionError> {
    let mut transient = Transient::default();
    let mut follower = Follower::new(model, driven, tolerance);
    follower.advance_to(duration_s, &mut Linearised::default(), |step| {
        let node = model.node(driven.omega_rad_s * step.time_s);
        let start = model.moment(&node, step.start);
        let column = |of: &dyn Fn(&Pose, &Moment) -> f64| -> [f64; STAGES + 1] {
            std::array::from_fn(|l| match l {
                0 => of(&step.pose, &start),
                _ => of(&step.poses[l - 1], &step.moments[l - 1]),
            })
        };
        transient.elements.push(Element {
            start_s: step.time_s,
            duration_s: step.duration_s,
            coordinates: [
                column(&|pose, _| pose.x_m),
                column(&|pose, _| pose.y_m),
                column(&|pose, _| pose.theta_rad),
                column(&|_, moment| moment.phi_rad[0]),
                column(&|_, moment| moment.phi_rad[1]),
            ],
        });
    })?;
    Ok(transient)
}
