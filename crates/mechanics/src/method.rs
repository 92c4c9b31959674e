//! How steady motions are found: one trait for both methods, and collocation's side of it.

use std::f64::consts::TAU;

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{LANES, Lanes, Number, Parameter};

use super::Result;
use super::attractor::{MOST_CYCLES, find_attractor};
use super::element::Element;
use super::forces::contact_forces;
use super::mesh::Mesh;
use super::orbit::{Effort, PeriodicOrbit, Start};
use super::path::Path;
use super::radau::{RADAU, STAGES};
use super::reduced::{Derivatives, Reduced};
use super::sensitivity::{Room, differentiate, differentiate_distance};
use super::trajectory::{self, Sample};
use super::transient::{self, Frames, Integrator};

/// Cycles after which a robot that started from rest is near its steady motion.
const TRANSIENT_CYCLES: f64 = 40.0;
const TRANSIENT_TOLERANCE: f64 = 1e-4;
/// Most cycles in which a motion that has lost its symmetry is looked for at every solve of a search; more,
/// and a robot of tonnes, which does not settle, costs minutes.
const SEARCHED_CYCLES: usize = 100;

/// Finds the steady motion of one problem; what is asked of it later is of that solution, and what
/// [`Solver`](super::Solver)'s and [`Problem`](super::Problem)'s functions of these names give. A
/// motion that eq. 3 gives has no states and so nothing to settle.
pub(super) trait Method {
    /// Solves for the steady motion, from the last solution where `is_warm`.
    fn solve(&mut self, is_warm: bool, accuracy: f64) -> Result<(GaitMetrics, Effort)>;

    /// The same from the last solution, or at once from rest; the last solution stays where both fail.
    fn solve_near(&mut self, accuracy: f64) -> Result<(GaitMetrics, Effort)> {
        self.solve(true, accuracy)
    }

    fn floquet(&mut self) -> Result<Option<f64>> {
        Ok(None)
    }

    /// Whether the solution is one of two that are each other's mirror image half a period later.
    fn is_symmetry_broken(&self) -> bool {
        false
    }

    /// With respect to the parameters that are `wanted`, or to everything.
    fn derivatives(&mut self, wanted: Option<&[Parameter]>) -> Result<Derivatives>;

    fn work_and_loss_j(&self) -> Result<[f64; 2]>;

    /// What friction takes over a cycle alone, J.
    fn loss_j(&mut self) -> Result<f64>;

    /// Those of d, m, and of the work, J.
    fn distance_and_work_derivatives(&mut self) -> Result<[Derivatives<f64>; 2]>;

    fn polish(&mut self) -> Result<f64> {
        Ok(0.0)
    }

    /// Replaces the solution, the metrics of which are `first`, by the attractor of the robot from
    /// rest: its metrics, the cycles until then, and whether it is the same.
    fn attractor(
        &mut self,
        first: Result<GaitMetrics>,
        _: f64,
    ) -> Result<(GaitMetrics, usize, bool)> {
        Ok((first?, 0, true))
    }

    fn cycle(&self, samples: usize) -> Result<Vec<Sample>>;

    fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<Sample>>;

    fn transient(&self, frames: &Frames, tolerance: f64) -> Result<Vec<[f64; 5]>>;
}

/// For motions that are solutions of differential equations.
pub(super) struct Collocation<'o, const N: usize, R: Reduced<N>> {
    pub model: R,
    pub orbit: &'o mut PeriodicOrbit<N, R>,
}

impl<const N: usize, R: Reduced<N>> Collocation<'_, N, R> {
    /// Solves from the last solution alone.
    fn follow(&mut self, accuracy: f64) -> Result<()> {
        let Self { model, orbit } = self;
        let was_broken = orbit.is_symmetry_broken;
        orbit.solve(model, Start::Last, accuracy)?;
        // It may have become its own mirror image.
        if was_broken && !(orbit.is_symmetry_broken && orbit.is_stable(model)) {
            return Err(orbit.not_converged());
        }
        Ok(())
    }

    /// The metrics of the solution, or of the one that is not its own mirror image where it has become unstable to
    /// that.
    fn measure(&mut self, accuracy: f64) -> (GaitMetrics, Effort) {
        let Self { model, orbit } = self;
        if orbit.breaks_symmetry() {
            let mirrored = orbit.clone();
            if find_attractor(model, orbit, true, accuracy, SEARCHED_CYCLES).is_err() {
                **orbit = mirrored;
            }
        }
        (orbit.measure(model).metrics, orbit.effort)
    }
}

impl<const N: usize, R: Reduced<N>> Method for Collocation<'_, N, R> {
    fn solve(&mut self, is_warm: bool, accuracy: f64) -> Result<(GaitMetrics, Effort)> {
        self.orbit.effort = Effort::default();
        let is_solved = is_warm && self.follow(accuracy).is_ok();
        let Self { model, orbit } = self;
        if !is_solved && let Err(error) = orbit.solve(model, Start::Guess, accuracy) {
            let mut transient = Integrator::new(model, TRANSIENT_TOLERANCE);
            let duration_s = TRANSIENT_CYCLES * TAU / model.problem().omega_rad_s;
            let integrated = transient.advance_to(duration_s, &mut orbit.workspace, |_| {});
            integrated.map_err(|_| error)?;
            match orbit.solve(model, Start::State(transient.state), accuracy) {
                Err(_) if model.half_period_signs().is_some() => {
                    orbit.solve(model, Start::WholePeriod(transient.state), accuracy)
                }
                solved => solved,
            }?;
        }
        Ok(self.measure(accuracy))
    }

    fn solve_near(&mut self, accuracy: f64) -> Result<(GaitMetrics, Effort)> {
        self.orbit.effort = Effort::default();
        let last = self.orbit.keep();
        if self.follow(accuracy).is_err()
            && let Err(error) = self.orbit.solve(&self.model, Start::Guess, accuracy)
        {
            self.orbit.restore(last);
            return Err(error);
        }
        Ok(self.measure(accuracy))
    }

    fn floquet(&mut self) -> Result<Option<f64>> {
        self.orbit.floquet(&self.model).map(Some)
    }

    fn is_symmetry_broken(&self) -> bool {
        self.orbit.is_symmetry_broken
    }

    fn derivatives(&mut self, wanted: Option<&[Parameter]>) -> Result<Derivatives> {
        let Self { model, orbit } = self;
        let cycle = orbit.measure(model);
        let PeriodicOrbit { mesh, path, linearisation, workspace, adjoints, .. } = &mut **orbit;
        let room = Room { linearisation, workspace, adjoints };
        let found = differentiate(model, mesh, (path, &cycle), room, wanted);
        found.ok_or(orbit.not_converged())
    }

    fn work_and_loss_j(&self) -> Result<[f64; 2]> {
        let (model, mesh) = (&self.model, &self.orbit.mesh);
        let weights = RADAU.integrate[STAGES - 1];
        let (mut work, mut loss) = (0.0, 0.0);
        for k in 0..mesh.count {
            let (nodes, start) = (mesh.nodes_of(model, k), mesh.states.start_of(k));
            let stages = mesh.states.stages_of(k);
            let duration_s = mesh.duration_s(k);
            let element = Element { nodes: &nodes, start: &start, stages: &stages, duration_s };
            let states = element.kinematics(model);
            for j in 0..STAGES {
                let (node, y) = (&nodes[j], &stages[j]);
                let acceleration = model.acceleration(node, y, &element.rate(j));
                let forces = contact_forces(model.problem(), &states[j], &acceleration);
                let weight = mesh.spans() as f64 * duration_s * weights[j];
                work += weight * forces.power_w;
                loss += weight * forces.loss_w;
            }
        }
        Ok([work, loss])
    }

    fn loss_j(&mut self) -> Result<f64> {
        let Self { model, orbit } = self;
        orbit.measure(model);
        Ok(loss_j(model, &orbit.mesh, &orbit.path))
    }

    fn distance_and_work_derivatives(&mut self) -> Result<[Derivatives<f64>; 2]> {
        let Self { model, orbit } = self;
        let cycle = orbit.measure(model);
        let PeriodicOrbit { mesh, path, linearisation, workspace, adjoints, .. } = &mut **orbit;
        let loss_j = loss_j(model, mesh, path);
        let room = Room { linearisation, workspace, adjoints };
        let found = differentiate_distance(model, mesh, (path, &cycle), room, loss_j);
        found.ok_or(orbit.not_converged())
    }

    fn polish(&mut self) -> Result<f64> {
        self.orbit.polish(&self.model)
    }

    fn attractor(
        &mut self,
        first: Result<GaitMetrics>,
        accuracy: f64,
    ) -> Result<(GaitMetrics, usize, bool)> {
        let Self { model, orbit } = self;
        let (cycles, is_first) =
            find_attractor(model, orbit, first.is_ok(), accuracy, MOST_CYCLES)?;
        Ok((orbit.measure(model).metrics, cycles, is_first))
    }

    fn cycle(&self, samples: usize) -> Result<Vec<Sample>> {
        trajectory::cycle(&self.model, &self.orbit.mesh, samples)
    }

    fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<Sample>> {
        trajectory::from_rest(&self.model, cycles, samples)
    }

    fn transient(&self, frames: &Frames, tolerance: f64) -> Result<Vec<[f64; 5]>> {
        transient::from_rest(&self.model, frames, tolerance)
    }
}

/// What friction takes over a cycle that goes this way, J.
fn loss_j<const N: usize, R: Reduced<N>>(model: &R, mesh: &Mesh<N, R>, path: &Path) -> f64 {
    let weights = RADAU.integrate[STAGES - 1];
    let mut sum = Lanes::default();
    for (pack, leg) in path.legs.iter().enumerate() {
        let [_, duration_s] = mesh.weights(pack);
        for j in 0..STAGES {
            let power = model.friction_power(&leg.states[j], &leg.trig[j]);
            sum += Lanes::splat(weights[j]) * duration_s * power;
        }
    }
    let span_j: f64 = (0..LANES).map(|lane| sum.lane(lane)).sum();
    mesh.spans() as f64 * span_j
}
