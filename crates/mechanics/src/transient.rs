//! The transient from rest, by the same collocation, one element after the other.
//!
//! Radau IIA is L-stable: the wheels' time constants, down to 0.2 ms, need not be resolved
//! once their transients are over.

use std::f64::consts::TAU;
use std::iter;

use trilink_robot::Pose;

use super::element::{
    Element, Linearisation, Stages, integrate_poses, interpolate, solve_element, weighted,
};
use super::radau::{RADAU, STAGES};
use super::reduced::{KinematicState, Reduced};
use super::{MotionError, Result};

/// Integrates a motion that is at rest at phase 0.
#[derive(Debug)]
pub(super) struct Integrator<'a, const N: usize, R> {
    model: &'a R,
    omega_rad_s: f64,
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

/// One element of the transient.
pub(super) struct Step<'a, const N: usize> {
    pub time_s: f64,
    pub duration_s: f64,
    /// Where the next element starts.
    pub end_s: f64,
    /// State and pose where the element starts.
    pub start: &'a [f64; N],
    pub stages: &'a Stages<N>,
    pub pose: Pose,
    pub states: &'a [KinematicState; STAGES],
    pub poses: &'a [Pose; STAGES],
}

/// Longest element as a part of a period.
const LONGEST_PART: f64 = 1.0 / 8.0;
/// Shortest element as a part of a period; a motion that needs less cannot be integrated.
const SHORTEST_PART: f64 = 1e-9;
/// Most elements of a period.
const MOST_ELEMENTS: usize = 20_000;
/// How far an element's polynomial is of use beyond its end, as a part of its length.
const FARTHEST: f64 = 1.5;
/// States smaller than this part of the largest are judged by the largest.
const SMALL: f64 = 1e-3;

impl<'a, const N: usize, R: Reduced<N>> Integrator<'a, N, R> {
    /// A robot at rest; the motion's relative error per element is near `tolerance`.
    pub(crate) fn new(model: &'a R, tolerance: f64) -> Self {
        let (state, omega_rad_s) = (model.at_rest(), model.problem().omega_rad_s);
        Self {
            model,
            omega_rad_s,
            tolerance,
            time_s: 0.0,
            state,
            pose: Pose::default(),
            elements: 0,
            sizes: state.map(f64::abs),
            length_s: 1e-4 * TAU / omega_rad_s,
            last: None,
        }
    }

    /// Continues to a later time; `visit` is given every element.
    ///
    /// # Errors
    /// An element would have to be too short.
    pub(crate) fn advance_to(
        &mut self,
        until_s: f64,
        workspace: &mut Linearisation,
        mut visit: impl FnMut(&Step<N>),
    ) -> Result<()> {
        let (model, tolerance) = (self.model, self.tolerance);
        let period_s = TAU / self.omega_rad_s;
        let stuck = |time_s| Err(MotionError::Stuck { time_s });
        workspace.resize::<N, R>(1);
        let most = MOST_ELEMENTS * (1 + ((until_s - self.time_s) / period_s) as usize);
        let mut elements = 0;
        while self.time_s < until_s {
            elements += 1;
            if self.length_s < SHORTEST_PART * period_s || elements > most {
                return stuck(self.time_s);
            }
            let wanted_s = self.length_s.min(LONGEST_PART * period_s);
            let is_last = wanted_s >= until_s - self.time_s;
            let duration_s = if is_last { until_s - self.time_s } else { wanted_s };
            let phase_rad = |part: f64| self.omega_rad_s * (self.time_s + part * duration_s);
            let nodes = RADAU.nodes.map(|part| model.node(phase_rad(part)));
            let (start, stages) = (&self.state, &self.guess(duration_s));
            let guess = Element { nodes: &nodes, start, stages, duration_s };
            let Some(stages) = solve_element(model, &guess, tolerance, workspace) else {
                self.length_s = 0.25 * duration_s;
                continue;
            };
            let sizes = grown(&self.sizes, &stages);
            let largest = sizes.iter().fold(0.0_f64, |largest, size| largest.max(*size));
            let tails = weighted(&RADAU.spectrum[2], &self.state, &stages).map(f64::abs);
            let error = (0..N)
                .map(|i| tails[i] / sizes[i].max(SMALL * largest).max(f64::MIN_POSITIVE))
                .fold(0.0, f64::max);
            let growth = (tolerance / error.max(1e-300)).powf(1.0 / (STAGES as f64 + 1.0));
            if error > 4.0 * tolerance {
                self.length_s = duration_s * (0.8 * growth).clamp(0.1, 0.8);
                continue;
            }
            let states = Element { stages: &stages, ..guess }.kinematics(model);
            let poses = integrate_poses(self.pose, &states, duration_s);
            let end_s = if is_last { until_s } else { self.time_s + duration_s };
            visit(&Step {
                time_s: self.time_s,
                duration_s,
                end_s,
                start: &self.state,
                stages: &stages,
                pose: self.pose,
                states: &states,
                poses: &poses,
            });
            self.elements += 1;
            self.sizes = sizes;
            self.last = Some((self.state, stages, duration_s));
            self.state = stages[STAGES - 1];
            self.pose = poses[STAGES - 1];
            self.time_s = end_s;
            let next_s = duration_s * (0.9 * growth).clamp(0.3, 4.0);
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
    pub(crate) fn distance(&self, a: &[f64; N], b: &[f64; N]) -> f64 {
        let largest = self.sizes.iter().fold(0.0_f64, |largest, size| largest.max(*size));
        let floor = (SMALL * largest).max(f64::MIN_POSITIVE);
        (0..N).map(|i| (a[i] - b[i]).abs() / self.sizes[i].max(floor)).fold(0.0, f64::max)
    }
}

fn grown<const N: usize>(sizes: &[f64; N], stages: &Stages<N>) -> [f64; N] {
    std::array::from_fn(|i| stages.iter().fold(sizes[i], |size, y| size.max(y[i].abs())))
}

/// At which times a transient is asked for, and under which friction.
pub(super) struct Frames<'a> {
    /// Of all wheels in each cycle, as a part of the robot's; 1 in cycles that have none.
    pub friction: &'a [f64],
    pub duration_s: f64,
    pub rate_hz: f64,
}

impl Frames<'_> {
    pub(crate) fn count(&self) -> usize {
        (self.duration_s * self.rate_hz) as usize
    }
}

/// Coordinates `(x, y, theta, phi1, phi2)`, m and rad, of the transient.
pub(super) fn from_rest<const N: usize, R: Reduced<N>>(
    model: &R,
    frames: &Frames,
    tolerance: f64,
) -> Result<Vec<[f64; 5]>> {
    let Frames { friction, duration_s, rate_hz } = *frames;
    let count = frames.count();
    let mut path = Vec::with_capacity(count);
    let mut integrator = Integrator::new(model, tolerance);
    let omega_rad_s = integrator.omega_rad_s;
    let mut visit = |step: &Step<N>| {
        let start = model.kinematics(&model.node(omega_rad_s * step.time_s), step.start);
        let mut coordinates = [[0.0; STAGES + 1]; 5];
        let points = iter::once((&step.pose, &start)).chain(step.poses.iter().zip(step.states));
        for (l, (pose, KinematicState { phi_rad: [phi1, phi2], .. })) in points.enumerate() {
            let values = [pose.x_m, pose.y_m, pose.theta_rad, *phi1, *phi2];
            (0..5).for_each(|i| coordinates[i][l] = values[i]);
        }
        let times = (path.len()..count).map(|frame| frame as f64 / rate_hz);
        path.extend(times.take_while(|time_s| *time_s < step.end_s).map(|time_s| {
            let part = ((time_s - step.time_s) / step.duration_s).min(1.0);
            coordinates.each_ref().map(|values| RADAU.interpolate(values, part))
        }));
    };
    let mut workspace = Linearisation::default();
    let varied: Vec<R> = friction.iter().map(|factor| model.resisted(*factor)).collect();
    for (cycle, varied) in (1..).zip(&varied) {
        integrator.model = varied;
        let end_s = (f64::from(cycle) * TAU / omega_rad_s).min(duration_s);
        integrator.advance_to(end_s, &mut workspace, &mut visit)?;
    }
    integrator.model = model;
    integrator.advance_to(duration_s, &mut workspace, &mut visit)?;
    Ok(path)
}
