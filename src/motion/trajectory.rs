//! What the robot does and what acts on it from moment to moment.
//!
//! Inside an element the collocation polynomial has fewer digits than at its end, so every
//! sample is made the end of a shorter element from the same start.

use std::f64::consts::TAU;

use nalgebra::{SMatrix, SVector};

use super::MotionError;
use super::element::{Linearised, Stages, follow_element};
use super::forces::{Actions, actions};
use super::path::advance;
use super::radau::{RADAU, STAGES};
use super::reduced::{Driven, Moment, Reduced};
use super::ring::Ring;
use super::transient::Follower;
use crate::robot::{Pose, Trig, dot, roll_rows, rotated, skid_rows};

/// The robot at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    pub time_s: f64,
    /// Position and heading of link 0; the motion starts at the origin, heading along x.
    pub pose: Pose,
    /// Joint angles, rad.
    pub phi_rad: [f64; 2],
    /// `(x', y', theta', phi1', phi2')`, m/s and rad/s.
    pub rates: [f64; 5],
    /// Roll velocities of the wheels, m/s.
    pub roll_m_s: [f64; 3],
    /// Skid velocities of the wheels, m/s.
    pub skid_m_s: [f64; 3],
    pub actions: Actions,
}

impl Sample {
    /// What is to be known of a moment.
    pub(super) fn new(
        driven: &Driven,
        time_s: f64,
        pose: Pose,
        moment: &Moment,
        acceleration: &[f64; 5],
    ) -> Self {
        let trig = Trig::new(moment.phi_rad);
        let [u, v, turning, w1, w2] = moment.velocity;
        let [x_rate, y_rate] = rotated(pose.theta_rad, [u, v]);
        let along = |rows: [[f64; 5]; 3]| rows.map(|row| dot(&row, &moment.velocity));
        Self {
            time_s,
            pose,
            phi_rad: moment.phi_rad,
            rates: [x_rate, y_rate, turning, w1, w2],
            roll_m_s: along(roll_rows(&driven.robot, &trig)),
            skid_m_s: along(skid_rows(&driven.robot, &trig)),
            actions: actions(driven, moment, acceleration),
        }
    }
}

/// Relative error of an element that is followed from rest.
const TOLERANCE: f64 = 1e-9;

/// Samples of one steady cycle at `count + 1` moments, the first at phase 0, the last a period
/// later.
pub(super) fn cycle<const N: usize, R: Reduced<N>>(
    model: &R,
    driven: &Driven,
    ring: &Ring<N, R>,
    count: usize,
) -> Result<Vec<Sample>, MotionError> {
    let mut sampler = Sampler::new(model, driven, count);
    let mut pose = Pose::default();
    let turns: &[bool] = if ring.is_half() { &[false, true] } else { &[false] };
    let mut elements = 0;
    for is_mirrored in turns {
        for k in 0..ring.len() {
            let (_, start, _) = ring.element(k);
            let signs = if *is_mirrored { *ring.signs() } else { [1.0; N] };
            let start = std::array::from_fn(|i| signs[i] * start[i]);
            let time_s = ring.element_s() * elements as f64;
            pose = sampler.element(time_s, ring.element_s(), &start, pose)?;
            elements += 1;
        }
    }
    let start = ring.element(0).1;
    sampler.push(TAU / driven.omega_rad_s, start, pose);
    Ok(sampler.samples)
}

/// Samples of the first `cycles` cycles from rest, `count` a cycle and one at the end.
pub(super) fn from_rest<const N: usize, R: Reduced<N>>(
    model: &R,
    driven: &Driven,
    cycles: usize,
    count: usize,
) -> Result<Vec<Sample>, MotionError> {
    let mut sampler = Sampler::new(model, driven, count);
    let mut follower = Follower::new(model, driven, TOLERANCE);
    let end_s = cycles as f64 * TAU / driven.omega_rad_s;
    let mut result = Ok(());
    follower.advance_to(end_s, &mut Linearised::default(), |step| {
        if result.is_ok() {
            let element = sampler.element(step.time_s, step.duration_s, step.start, step.pose);
            result = element.map(|_| ());
        }
    })?;
    result?;
    sampler.push(end_s, &follower.state, follower.pose);
    Ok(sampler.samples)
}

/// Collects samples at regular times.
struct Sampler<'a, R> {
    model: &'a R,
    driven: &'a Driven,
    interval_s: f64,
    room: Linearised,
    samples: Vec<Sample>,
}

impl<'a, R> Sampler<'a, R> {
    /// Takes `count` samples a cycle.
    fn new(model: &'a R, driven: &'a Driven, count: usize) -> Self {
        let interval_s = TAU / driven.omega_rad_s / count as f64;
        Self { model, driven, interval_s, room: Linearised::default(), samples: Vec::new() }
    }

    /// Samples an element; gives the pose at its end.
    fn element<const N: usize>(
        &mut self,
        time_s: f64,
        duration_s: f64,
        start: &[f64; N],
        pose: Pose,
    ) -> Result<Pose, MotionError>
    where
        R: Reduced<N>,
    {
        // A sample at the very end belongs to the next element.
        let just_before = 1.0 - 1e-9;
        loop {
            let sample_s = self.interval_s * self.samples.len() as f64;
            let part = (sample_s - time_s) / duration_s;
            if part >= just_before {
                return Ok(self.at(time_s, duration_s, start, pose)?.1);
            }
            let (state, sample_pose) = if part <= 0.0 {
                (*start, pose)
            } else {
                self.at(time_s, part * duration_s, start, pose)?
            };
            self.push(sample_s, &state, sample_pose);
        }
    }

    /// State and pose after `duration_s`, by one element.
    fn at<const N: usize>(
        &mut self,
        time_s: f64,
        duration_s: f64,
        start: &[f64; N],
        pose: Pose,
    ) -> Result<([f64; N], Pose), MotionError>
    where
        R: Reduced<N>,
    {
        let (model, omega_rad_s) = (self.model, self.driven.omega_rad_s);
        let nodes = RADAU.nodes.map(|part| model.node(omega_rad_s * (time_s + part * duration_s)));
        self.room.resize::<N, R>(1);
        let stages: Stages<N> = follow_element(
            model,
            &nodes,
            start,
            duration_s,
            &[*start; STAGES],
            1e-12,
            &mut self.room,
        )
        .ok_or(MotionError::Stuck { time_s })?;
        let moments = std::array::from_fn(|j| model.moment(&nodes[j], &stages[j]));
        let [.., end] = advance(pose, &moments, duration_s);
        Ok((stages[STAGES - 1], end))
    }

    /// Adds the sample of a state.
    fn push<const N: usize>(&mut self, time_s: f64, state: &[f64; N], pose: Pose)
    where
        R: Reduced<N>,
    {
        let node = self.model.node(self.driven.omega_rad_s * time_s);
        let moment = self.model.moment(&node, state);
        let rates = rates(self.model, &node, state);
        let acceleration = self.model.acceleration(&node, state, &rates);
        self.samples.push(Sample::new(self.driven, time_s, pose, &moment, &acceleration));
    }
}

/// Time derivatives of the states by the equations of motion, which are linear in them.
fn rates<const N: usize, R: Reduced<N>>(model: &R, node: &R::Node, state: &[f64; N]) -> [f64; N] {
    let residual = model.residual(node, state, &[0.0; N]);
    let mut matrix = SMatrix::<f64, N, N>::from_fn(|i, j| residual.by_rate[i][j]);
    let mut right = SVector::<f64, N>::from_fn(|i, _| -residual.value[i]);
    if R::INTEGRATED {
        matrix[(N - 1, N - 1)] = 1.0;
        right[N - 1] = state[N - 2];
    }
    matrix.try_inverse().map_or([f64::NAN; N], |inverse| (inverse * right).into())
}
