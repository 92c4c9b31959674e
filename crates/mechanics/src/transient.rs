//! Transient from rest by Radau IIA collocation, one element (time step) after the other.
//!
//! Radau IIA is L-stable: the time constants of the wheels, down to 0.2 ms, need not be resolved once their
//! transients have decayed.

use std::f64::consts::TAU;
use std::iter;

use trilink_robot::{MAX_JOINTS, Pose};

use super::element::{
    Element, Linearisation, Stages, integrate_poses, interpolate, solve_element, weighted,
};
use super::radau::{RADAU, STAGES};
use super::reduced::Reduced;
use super::{MotionError, Result};

/// Integrator of a motion that starts from rest at phase 0.
#[derive(Debug)]
pub(super) struct Integrator<'a, const N: usize, R> {
    model: &'a R,
    omega_rad_s: f64,
    tolerance: f64,
    pub time_s: f64,
    pub state: [f64; N],
    pub pose: Pose,
    /// Number of elements (time steps) so far.
    pub elements: usize,
    /// Largest magnitude of each state so far.
    sizes: [f64; N],
    /// Duration of the next time step, s.
    step_s: f64,
    /// State at the start, states at the stages, and duration (s) of the last time step; `None` before the first time
    /// step.
    last: Option<([f64; N], Stages<N>, f64)>,
}

/// One time step of the transient.
pub(super) struct Step<'a, const N: usize, R: Reduced<N>> {
    pub time_s: f64,
    pub duration_s: f64,
    /// Time at which the step ends, s.
    pub end_s: f64,
    /// State at the start of the step.
    pub start: &'a [f64; N],
    pub stages: &'a Stages<N>,
    /// Pose at the start of the step.
    pub pose: Pose,
    pub states: &'a [R::State<f64>; STAGES],
    pub poses: &'a [Pose; STAGES],
}

/// Maximum duration of a time step, as a fraction of a period.
const MAX_FRACTION: f64 = 1.0 / 8.0;
/// Minimum duration of a time step, as a fraction of a period; a motion that needs shorter steps cannot be
/// integrated.
const MIN_FRACTION: f64 = 1e-9;
/// Maximum number of time steps per period.
const MAX_ELEMENTS: usize = 20_000;
/// Maximum distance over which a time step's polynomial is extrapolated, as a fraction of the step's
/// duration.
const MAX_EXTRAPOLATION: f64 = 1.5;
/// Minimum magnitude by which the error of a state is divided, as a fraction of the largest state's magnitude.
const SMALL: f64 = 1e-3;

impl<'a, const N: usize, R: Reduced<N>> Integrator<'a, N, R> {
    /// Creates an integrator that starts from rest, with a relative error per time step near `tolerance`.
    pub(crate) fn new(model: &'a R, tolerance: f64) -> Self {
        let state = model.at_rest();
        let omega_rad_s = model.omega_rad_s();
        Self {
            model,
            omega_rad_s,
            tolerance,
            time_s: 0.0,
            state,
            pose: Pose::default(),
            elements: 0,
            sizes: state.map(f64::abs),
            step_s: 1e-4 * TAU / omega_rad_s,
            last: None,
        }
    }

    /// Integrates up to a later time and calls `visit` with every time step.
    ///
    /// # Errors
    /// Returns an error if the required time step is shorter than the minimum, or if too many time steps are
    /// needed.
    pub(crate) fn advance_to(
        &mut self,
        until_s: f64,
        workspace: &mut Linearisation,
        mut visit: impl FnMut(&Step<N, R>),
    ) -> Result<()> {
        let model = self.model;
        let tolerance = self.tolerance;
        let period_s = TAU / self.omega_rad_s;
        workspace.resize::<N, R>(1);
        let max_elements = MAX_ELEMENTS * (1 + ((until_s - self.time_s) / period_s) as usize);
        let mut elements = 0;
        while self.time_s < until_s {
            elements += 1;
            if self.step_s < MIN_FRACTION * period_s || elements > max_elements {
                return Err(MotionError::Stuck { time_s: self.time_s });
            }
            let wanted_s = self.step_s.min(MAX_FRACTION * period_s);
            let is_last = wanted_s >= until_s - self.time_s;
            let duration_s = if is_last { until_s - self.time_s } else { wanted_s };
            let nodes = RADAU
                .nodes
                .map(|part| model.node(self.omega_rad_s * (self.time_s + part * duration_s)));
            let start = &self.state;
            let stages = &self.guess(duration_s);
            let guess = Element { nodes: &nodes, start, stages, duration_s };
            let Some(stages) = solve_element(model, &guess, tolerance, workspace) else {
                self.step_s = 0.25 * duration_s;
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
                self.step_s = duration_s * (0.8 * growth).clamp(0.1, 0.8);
                continue;
            }
            let states = Element { stages: &stages, ..guess }.kinematics(model);
            let poses = integrate_poses(self.pose, &states.each_ref().map(R::body), duration_s);
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
            self.state = model.consistent(self.omega_rad_s * end_s, stages[STAGES - 1]);
            self.pose = poses[STAGES - 1];
            self.time_s = end_s;
            let next_s = duration_s * (0.9 * growth).clamp(0.3, 4.0);
            // A step that was cut short is no guide to the duration of the next one.
            self.step_s = if is_last { next_s.max(self.step_s) } else { next_s };
        }
        Ok(())
    }

    /// Returns an initial guess for the stages of a time step of the given duration: values of the last
    /// step's polynomial or, if that would be extrapolated too far, the state at the end of the last step.
    fn guess(&self, step_s: f64) -> Stages<N> {
        match &self.last {
            Some((start, stages, last_s)) if step_s <= MAX_EXTRAPOLATION * last_s => {
                RADAU.nodes.map(|part| interpolate(start, stages, 1.0 + part * step_s / last_s))
            }
            _ => [self.state; STAGES],
        }
    }

    /// Returns the largest difference between two states, relative to the largest magnitude that each component has
    /// reached so far.
    pub(crate) fn distance(&self, a: &[f64; N], b: &[f64; N]) -> f64 {
        let largest = self.sizes.iter().fold(0.0_f64, |largest, size| largest.max(*size));
        let floor = (SMALL * largest).max(f64::MIN_POSITIVE);
        (0..N).map(|i| (a[i] - b[i]).abs() / self.sizes[i].max(floor)).fold(0.0, f64::max)
    }

    /// Returns the relative distance of the current state from a reference state; infinite if there is none.
    pub(crate) fn distance_from(&self, reference: Option<&[f64; N]>) -> f64 {
        reference.map_or(f64::INFINITY, |reference| self.distance(reference, &self.state))
    }
}

/// Returns the largest magnitudes of the states, updated with the stages of a time step.
fn grown<const N: usize>(sizes: &[f64; N], stages: &Stages<N>) -> [f64; N] {
    std::array::from_fn(|i| stages.iter().fold(sizes[i], |size, y| size.max(y[i].abs())))
}

/// Sampling times of a transient, and the friction scale in each of its cycles.
pub(super) struct Frames<'a> {
    /// Factor that multiplies the friction of all wheels in each cycle; 1 in cycles beyond the slice.
    pub friction: &'a [f64],
    pub duration_s: f64,
    pub rate_hz: f64,
}

impl Frames<'_> {
    pub(crate) fn count(&self) -> usize {
        (self.duration_s * self.rate_hz) as usize
    }
}

/// Pose of the reference link, and the angles of the joints, rad, followed by zeros.
pub type Posture = (Pose, [f64; MAX_JOINTS]);

/// Returns the motion at the sampling times of the transient.
pub(super) fn from_rest<const N: usize, R: Reduced<N>>(
    model: &R,
    frames: &Frames,
    tolerance: f64,
) -> Result<Vec<Posture>> {
    const COORDINATES: usize = 3 + MAX_JOINTS;
    let Frames { friction, duration_s, rate_hz } = *frames;
    let count = frames.count();
    let mut path = Vec::with_capacity(count);
    let mut integrator = Integrator::new(model, tolerance);
    let omega_rad_s = integrator.omega_rad_s;
    let mut visit = |step: &Step<N, R>| {
        let start = model.kinematics(&model.node(omega_rad_s * step.time_s), step.start);
        let mut coordinates = [[0.0; STAGES + 1]; COORDINATES];
        let points = iter::once((&step.pose, &start)).chain(step.poses.iter().zip(step.states));
        let parts = iter::once(0.0).chain(RADAU.nodes);
        for (l, ((pose, state), part)) in points.zip(parts).enumerate() {
            let phase_rad = omega_rad_s * (step.time_s + part * step.duration_s);
            let values = [pose.x_m, pose.y_m, pose.theta_rad].into_iter();
            let values = values.chain(model.joints_rad(phase_rad, state));
            coordinates.iter_mut().zip(values).for_each(|(of, value)| of[l] = value);
        }
        let times = (path.len()..count).map(|frame| frame as f64 / rate_hz);
        path.extend(times.take_while(|time_s| *time_s < step.end_s).map(|time_s| {
            let part = ((time_s - step.time_s) / step.duration_s).min(1.0);
            let [x_m, y_m, theta_rad, phi_rad @ ..] =
                coordinates.each_ref().map(|values| RADAU.interpolate(values, part));
            (Pose { x_m, y_m, theta_rad }, phi_rad)
        }));
    };
    let mut workspace = Linearisation::default();
    let varied: Vec<R> =
        friction.iter().map(|factor| model.with_friction_scaled(*factor)).collect();
    for (cycle, varied) in (1..).zip(&varied) {
        integrator.model = varied;
        let end_s = (f64::from(cycle) * TAU / omega_rad_s).min(duration_s);
        integrator.advance_to(end_s, &mut workspace, &mut visit)?;
    }
    integrator.model = model;
    integrator.advance_to(duration_s, &mut workspace, &mut visit)?;
    Ok(path)
}
