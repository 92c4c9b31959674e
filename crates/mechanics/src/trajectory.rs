//! What the robot does and what acts on it over time.
//!
//! Inside an element the collocation polynomial has fewer digits than at its end, so every
//! sample is made the end of a shorter element from the same start.

use std::f64::consts::TAU;

use nalgebra::{SMatrix, SVector};
use trilink_robot::{ContactForces, Pose, Trig, dot, roll_rows, rotated, skid_rows};

use super::element::{Element, Linearisation, Stages, integrate_poses, interpolate, solve_element};
use super::forces::contact_forces;
use super::mesh::Mesh;
use super::radau::{RADAU, STAGES};
use super::reduced::{KinematicState, Reduced};
use super::transient::{Integrator, Step};
use super::{MotionError, Problem, Result};

/// The robot at one time.
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
    pub forces: ContactForces,
}

impl Sample {
    /// Of a state and the time derivatives of its velocities.
    pub(super) fn new(
        problem: &Problem,
        time_s: f64,
        pose: Pose,
        state: &KinematicState,
        acceleration: &[f64; 5],
    ) -> Self {
        let trig = Trig::new(state.phi_rad);
        let [u, v, turning, w1, w2] = state.velocity;
        let [x_rate, y_rate] = rotated(pose.theta_rad, [u, v]);
        let along = |rows: [[f64; 5]; 3]| rows.map(|row| dot(&row, &state.velocity));
        Self {
            time_s,
            pose,
            phi_rad: state.phi_rad,
            rates: [x_rate, y_rate, turning, w1, w2],
            roll_m_s: along(roll_rows(&problem.robot, &trig)),
            skid_m_s: along(skid_rows(&problem.robot, &trig)),
            forces: contact_forces(problem, state, acceleration),
        }
    }
}

/// Relative error of an element of the transient from rest.
const TOLERANCE: f64 = 1e-9;

/// Samples of one steady cycle at `count + 1` times, the first at phase 0, the last a period
/// later.
pub(super) fn cycle<const N: usize, R: Reduced<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    count: usize,
) -> Result<Vec<Sample>> {
    let mut sampler = Sampler::new(model, count);
    let mut pose = Pose::default();
    let spans = [[1.0; N], mesh.signs].into_iter().take(mesh.spans());
    for (span, signs) in spans.enumerate() {
        for k in 0..mesh.count {
            let signed = |state: [f64; N]| std::array::from_fn(|i| signs[i] * state[i]);
            let start = signed(mesh.states.start_of(k));
            let stages = mesh.states.stages_of(k).map(signed);
            let time_s = mesh.span_s * (span as f64 + mesh.bounds[k]);
            let known =
                Known { time_s, duration_s: mesh.duration_s(k), start: &start, stages: &stages };
            pose = sampler.element(&known, pose)?;
        }
    }
    sampler.push(TAU / model.problem().omega_rad_s, &mesh.states.start, pose);
    Ok(sampler.samples)
}

/// Samples of the first `cycles` cycles from rest, `count` a cycle and one at the end.
pub(super) fn from_rest<const N: usize, R: Reduced<N>>(
    model: &R,
    cycles: usize,
    count: usize,
) -> Result<Vec<Sample>> {
    let mut sampler = Sampler::new(model, count);
    let mut transient = Integrator::new(model, TOLERANCE);
    let end_s = cycles as f64 * TAU / model.problem().omega_rad_s;
    let mut result = Ok(());
    transient.advance_to(end_s, &mut Linearisation::default(), |step| {
        if result.is_ok() {
            let Step { time_s, duration_s, start, stages, .. } = *step;
            let known = Known { time_s, duration_s, start, stages };
            result = sampler.element(&known, step.pose).map(|_| ());
        }
    })?;
    result?;
    sampler.push(end_s, &transient.state, transient.pose);
    Ok(sampler.samples)
}

/// An element that has been solved for.
#[derive(Clone, Copy)]
struct Known<'a, const N: usize> {
    time_s: f64,
    duration_s: f64,
    start: &'a [f64; N],
    stages: &'a Stages<N>,
}

/// Collects samples at regular times.
struct Sampler<'a, const N: usize, R: Reduced<N>> {
    model: &'a R,
    omega_rad_s: f64,
    interval_s: f64,
    workspace: Linearisation,
    samples: Vec<Sample>,
}

impl<'a, const N: usize, R: Reduced<N>> Sampler<'a, N, R> {
    /// Takes `count` samples a cycle.
    fn new(model: &'a R, count: usize) -> Self {
        let omega_rad_s = model.problem().omega_rad_s;
        let interval_s = TAU / omega_rad_s / count as f64;
        let (workspace, samples) = Default::default();
        Self { model, omega_rad_s, interval_s, workspace, samples }
    }

    /// Samples an element; gives the pose at its end.
    fn element(&mut self, known: &Known<N>, pose: Pose) -> Result<Pose> {
        // A sample at the very end belongs to the next element.
        let just_before = 1.0 - 1e-9;
        loop {
            let sample_s = self.interval_s * self.samples.len() as f64;
            let fraction = (sample_s - known.time_s) / known.duration_s;
            if fraction >= just_before {
                return Ok(self.at(known, 1.0, pose)?.1);
            }
            let (state, sample_pose) = match fraction {
                ..=0.0 => (*known.start, pose),
                _ => self.at(known, fraction, pose)?,
            };
            self.push(sample_s, &state, sample_pose);
        }
    }

    /// State and pose after a part of an element, by an element of that length.
    fn at(&mut self, known: &Known<N>, part: f64, pose: Pose) -> Result<([f64; N], Pose)> {
        let (model, Known { time_s, start, .. }) = (self.model, *known);
        let duration_s = part * known.duration_s;
        let phase_rad = |part: f64| self.omega_rad_s * (time_s + part * duration_s);
        let nodes = RADAU.nodes.map(|part| model.node(phase_rad(part)));
        self.workspace.resize::<N, R>(1);
        let stages = RADAU.nodes.map(|node| interpolate(start, known.stages, part * node));
        let guess = Element { nodes: &nodes, start, stages: &stages, duration_s };
        let stages = solve_element(model, &guess, 1e-12, &mut self.workspace)
            .ok_or(MotionError::Stuck { time_s })?;
        let element = Element { stages: &stages, ..guess };
        let [.., end] = integrate_poses(pose, &element.kinematics(model), duration_s);
        Ok((stages[STAGES - 1], end))
    }

    /// Adds the sample of a state.
    fn push(&mut self, time_s: f64, state: &[f64; N], pose: Pose) {
        let node = self.model.node(self.omega_rad_s * time_s);
        let rates = rates(self.model, &node, state);
        let acceleration = self.model.acceleration(&node, state, &rates);
        let state = self.model.kinematics(&node, state);
        self.samples.push(Sample::new(self.model.problem(), time_s, pose, &state, &acceleration));
    }
}

/// Time derivatives of the states by the equations of motion, which are linear in them.
fn rates<const N: usize, R: Reduced<N>>(
    model: &R,
    node: &R::Node<f64>,
    state: &[f64; N],
) -> [f64; N] {
    let residual = model.residual(node, state, &[0.0; N]);
    let mut matrix = SMatrix::<f64, N, N>::from_fn(|i, j| residual.rate_jacobian[i][j]);
    let mut right = SVector::<f64, N>::from_fn(|i, _| -residual.value[i]);
    if R::INTEGRATED {
        matrix[(N - 1, N - 1)] = 1.0;
        right[N - 1] = state[N - 2];
    }
    matrix.try_inverse().map_or([f64::NAN; N], |inverse| (inverse * right).into())
}
