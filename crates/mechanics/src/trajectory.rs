//! Trajectories: motion of the robot and forces on it over time.
//!
//! The collocation polynomial is less accurate inside an element than at its end. Each sample is therefore
//! computed as the end of a shorter element with the same start.

use std::f64::consts::TAU;

use trilink_robot::Pose;

use super::element::{Element, Linearisation, Stages, integrate_poses, interpolate, solve_element};
use super::mesh::Mesh;
use super::radau::{RADAU, STAGES};
use super::reduced::Reduced;
use super::transient::{Integrator, Step};
use super::{MotionError, Result, Sample};

/// Relative error tolerance per time step of the transient from rest.
const TOLERANCE: f64 = 1e-9;

/// Samples one steady-state cycle at `count + 1` times, the first at phase 0, the last one period later.
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
            let solved = SolvedElement {
                time_s,
                duration_s: mesh.duration_s(k),
                start: &start,
                stages: &stages,
            };
            pose = sampler.sample_element(&solved, pose)?;
        }
    }
    sampler.push(TAU / model.omega_rad_s(), &mesh.states.start, pose);
    Ok(sampler.samples)
}

/// Samples the first `cycles` cycles from rest at `count` times per cycle and once at the end.
pub(super) fn from_rest<const N: usize, R: Reduced<N>>(
    model: &R,
    cycles: usize,
    count: usize,
) -> Result<Vec<Sample>> {
    let mut sampler = Sampler::new(model, count);
    let mut transient = Integrator::new(model, TOLERANCE);
    let end_s = cycles as f64 * TAU / model.omega_rad_s();
    let mut result = Ok(());
    transient.advance_to(end_s, &mut Linearisation::default(), |step| {
        if result.is_ok() {
            let Step { time_s, duration_s, start, stages, .. } = *step;
            let solved = SolvedElement { time_s, duration_s, start, stages };
            result = sampler.sample_element(&solved, step.pose).map(|_| ());
        }
    })?;
    result?;
    sampler.push(end_s, &transient.state, transient.pose);
    Ok(sampler.samples)
}

/// Collocation element whose states are known.
#[derive(Clone, Copy)]
struct SolvedElement<'a, const N: usize> {
    time_s: f64,
    duration_s: f64,
    start: &'a [f64; N],
    stages: &'a Stages<N>,
}

/// Sampler that evaluates a motion at regular times.
struct Sampler<'a, const N: usize, R: Reduced<N>> {
    model: &'a R,
    omega_rad_s: f64,
    interval_s: f64,
    workspace: Linearisation,
    samples: Vec<Sample>,
}

impl<'a, const N: usize, R: Reduced<N>> Sampler<'a, N, R> {
    /// Creates a sampler with `count` samples per cycle.
    fn new(model: &'a R, count: usize) -> Self {
        let omega_rad_s = model.omega_rad_s();
        let interval_s = TAU / omega_rad_s / count as f64;
        let workspace = Linearisation::default();
        Self { model, omega_rad_s, interval_s, workspace, samples: Vec::new() }
    }

    /// Samples an element, at whose start the robot has the given pose, and returns the pose at its end.
    fn sample_element(&mut self, solved: &SolvedElement<N>, pose: Pose) -> Result<Pose> {
        // A sample at the end of the element belongs to the next element.
        let just_before = 1.0 - 1e-9;
        loop {
            let sample_s = self.interval_s * self.samples.len() as f64;
            let fraction = (sample_s - solved.time_s) / solved.duration_s;
            if fraction >= just_before {
                return Ok(self.at(solved, 1.0, pose)?.1);
            }
            let (state, sample_pose) = match fraction {
                ..=0.0 => (*solved.start, pose),
                _ => self.at(solved, fraction, pose)?,
            };
            self.push(sample_s, &state, sample_pose);
        }
    }

    /// Returns the state and the pose after a fraction of an element, computed as the end of a shorter
    /// element of that length; `pose` is the pose at the element's start.
    fn at(
        &mut self,
        solved: &SolvedElement<N>,
        fraction: f64,
        pose: Pose,
    ) -> Result<([f64; N], Pose)> {
        let model = self.model;
        let SolvedElement { time_s, start, .. } = *solved;
        let duration_s = fraction * solved.duration_s;
        let nodes =
            RADAU.nodes.map(|node| model.node(self.omega_rad_s * (time_s + node * duration_s)));
        self.workspace.resize::<N, R>(1);
        let stages = RADAU.nodes.map(|node| interpolate(start, solved.stages, fraction * node));
        let guess = Element { nodes: &nodes, start, stages: &stages, duration_s };
        let stages = solve_element(model, &guess, 1e-12, &mut self.workspace)
            .ok_or(MotionError::Stuck { time_s })?;
        let element = Element { stages: &stages, ..guess };
        let [.., end] =
            integrate_poses(pose, &element.kinematics(model).each_ref().map(R::body), duration_s);
        Ok((stages[STAGES - 1], end))
    }

    /// Appends the sample for the given time, state and pose.
    fn push(&mut self, time_s: f64, state: &[f64; N], pose: Pose) {
        let node = self.model.node(self.omega_rad_s * time_s);
        let rates = self.model.rates(self.omega_rad_s * time_s, &node, state);
        self.samples.push(self.model.sample(time_s, pose, state, &rates));
    }
}
