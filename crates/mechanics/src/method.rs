//! Solution methods for steady-state motions: the trait that both methods share, and its implementation by
//! collocation.

use std::f64::consts::TAU;

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Lanes, Parameter};

use super::Result;
use super::attractor::{MAX_CYCLES, find_attractor};
use super::cycle::Cycle;
use super::mesh::Mesh;
use super::orbit::{Effort, PeriodicOrbit, Start, sum_of_lanes};
use super::path::Path;
use super::radau::{RADAU, STAGES};
use super::reduced::{Derivatives, Reduced, ThreeLink};
use super::sensitivity::{Workspaces, differentiate, differentiate_distance};
use super::trajectory::{self, Sample};
use super::transient::{self, Frames, Integrator, Posture};

/// Number of cycles that are integrated from rest to come near the steady-state motion.
const TRANSIENT_CYCLES: f64 = 40.0;
/// Relative error tolerance per time step of the transient.
const TRANSIENT_TOLERANCE: f64 = 1e-4;
/// Maximum number of cycles for which the motion from rest is integrated when a solve looks for a motion without
/// half-period symmetry. With more cycles, each such solve would take minutes for a robot that does not settle, for
/// example one of several tonnes.
const SEARCHED_CYCLES: usize = 100;

/// Numerical method that finds the steady-state motion of one problem. The functions of this trait correspond to those
/// with the same names in [`Solver`](super::Solver) and [`Problem`](super::Problem). The default implementations are
/// those for motions without dynamic states, which the no-skid constraints alone determine (eq. 3 of the paper).
pub(super) trait Method {
    /// Solves for the steady-state motion to a relative `accuracy` of its metrics. If `is_warm`, the search starts from
    /// the last solution; otherwise, or if that fails, from the model's initial guess.
    fn solve(&mut self, is_warm: bool, accuracy: f64) -> Result<(GaitMetrics, Effort)>;

    /// Solves for the steady-state motion, starting from the last solution or, if that fails, from the
    /// model's initial guess; the last solution is retained if both fail.
    fn solve_near(&mut self, accuracy: f64) -> Result<(GaitMetrics, Effort)> {
        self.solve(true, accuracy)
    }

    fn floquet(&mut self) -> Result<Option<f64>> {
        Ok(None)
    }

    /// Returns whether the solution is one of two motions that mirror each other with a shift of half a
    /// period.
    fn is_symmetry_broken(&self) -> bool {
        false
    }

    /// Returns the derivatives of the metrics with respect to the `wanted` parameters or, if it is `None`, to
    /// all variables: parameters, frequency and gait.
    fn derivatives(&mut self, wanted: Option<&[Parameter]>) -> Result<Derivatives>;

    fn work_and_loss_j(&self) -> Result<[f64; 2]>;

    /// Returns the energy dissipated by friction over a cycle, J.
    fn loss_j(&mut self) -> Result<f64>;

    /// Returns the derivatives, with respect to all variables, of the displacement per cycle d (m) and of the work of
    /// the actuators over a cycle (J).
    fn distance_and_work_derivatives(&mut self) -> Result<[Derivatives<f64>; 2]>;

    fn polish(&mut self) -> Result<f64> {
        Ok(0.0)
    }

    /// Replaces the solution by the attractor reached from rest; `first` contains the metrics of the solution, or the
    /// error if none was found. Returns the attractor's metrics, the number of cycles to settle, and whether the
    /// attractor is the original solution.
    fn attractor(
        &mut self,
        first: Result<GaitMetrics>,
        _: f64,
    ) -> Result<(GaitMetrics, usize, bool)> {
        Ok((first?, 0, true))
    }

    fn cycle(&self, samples: usize) -> Result<Vec<Sample>>;

    fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<Sample>>;

    fn transient(&self, frames: &Frames, tolerance: f64) -> Result<Vec<Posture>>;
}

/// Solution method for motions that are governed by differential equations.
pub(super) struct Collocation<'o, const N: usize, R: Reduced<N>> {
    pub model: &'o R,
    pub orbit: &'o mut PeriodicOrbit<N, R>,
}

impl<const N: usize, R: Reduced<N>> Collocation<'_, N, R> {
    /// Solves for the steady-state motion, starting from the last solution.
    fn continue_last(&mut self, accuracy: f64) -> Result<()> {
        let (model, orbit) = (self.model, &mut *self.orbit);
        let was_broken = orbit.is_symmetry_broken;
        orbit.solve(model, Start::Last, accuracy)?;
        // The solution may have regained its half-period symmetry.
        if was_broken && !(orbit.is_symmetry_broken && orbit.is_stable(model)) {
            return Err(orbit.not_converged());
        }
        Ok(())
    }

    /// Returns the metrics of the solution and the computational effort. A solution with half-period symmetry that is
    /// unstable to symmetry breaking is first replaced by the attractor reached from rest, which lacks the symmetry, if
    /// that attractor can be found.
    fn measure(&mut self, accuracy: f64) -> (Cycle<N>, Effort) {
        let (model, orbit) = (self.model, &mut *self.orbit);
        if orbit.breaks_symmetry() {
            let symmetric = orbit.clone();
            if find_attractor(model, orbit, true, accuracy, SEARCHED_CYCLES).is_err() {
                *orbit = symmetric;
            }
        }
        (orbit.measure(model), orbit.effort)
    }

    /// Solves as [`Method::solve`] does.
    pub(super) fn find(&mut self, is_warm: bool, accuracy: f64) -> Result<(Cycle<N>, Effort)> {
        self.orbit.effort = Effort::default();
        let is_solved = is_warm && self.continue_last(accuracy).is_ok();
        let (model, orbit) = (self.model, &mut *self.orbit);
        if !is_solved && let Err(error) = orbit.solve(model, Start::Guess, accuracy) {
            let mut transient = Integrator::new(model, TRANSIENT_TOLERANCE);
            let duration_s = TRANSIENT_CYCLES * TAU / model.omega_rad_s();
            let integrated = transient.advance_to(duration_s, &mut orbit.workspace, |_| {});
            integrated.map_err(|_| error)?;
            let mut solved = orbit.solve(model, Start::State(transient.state), accuracy);
            if solved.is_err() && model.half_period_signs().is_some() {
                solved = orbit.solve(model, Start::WholePeriod(transient.state), accuracy);
            }
            solved?;
        }
        Ok(self.measure(accuracy))
    }

    /// Solves as [`Method::solve_near`] does.
    pub(super) fn find_near(&mut self, accuracy: f64) -> Result<(Cycle<N>, Effort)> {
        self.orbit.effort = Effort::default();
        let last = self.orbit.snapshot();
        if self.continue_last(accuracy).is_err()
            && let Err(error) = self.orbit.solve(self.model, Start::Guess, accuracy)
        {
            self.orbit.restore(last);
            return Err(error);
        }
        Ok(self.measure(accuracy))
    }

    /// Replaces the solution by the attractor as [`Method::attractor`] does.
    pub(super) fn reach(
        &mut self,
        is_solved: bool,
        accuracy: f64,
    ) -> Result<(Cycle<N>, usize, bool)> {
        let (model, orbit) = (self.model, &mut *self.orbit);
        let (cycles, is_first) = find_attractor(model, orbit, is_solved, accuracy, MAX_CYCLES)?;
        Ok((orbit.measure(model), cycles, is_first))
    }
}

impl<const N: usize, R: ThreeLink<N>> Method for Collocation<'_, N, R> {
    fn solve(&mut self, is_warm: bool, accuracy: f64) -> Result<(GaitMetrics, Effort)> {
        let (cycle, effort) = self.find(is_warm, accuracy)?;
        Ok((self.model.gait_metrics(&cycle), effort))
    }

    fn solve_near(&mut self, accuracy: f64) -> Result<(GaitMetrics, Effort)> {
        let (cycle, effort) = self.find_near(accuracy)?;
        Ok((self.model.gait_metrics(&cycle), effort))
    }

    fn floquet(&mut self) -> Result<Option<f64>> {
        self.orbit.floquet(self.model).map(Some)
    }

    fn is_symmetry_broken(&self) -> bool {
        self.orbit.is_symmetry_broken
    }

    fn derivatives(&mut self, wanted: Option<&[Parameter]>) -> Result<Derivatives> {
        let (model, orbit) = (self.model, &mut *self.orbit);
        let cycle = orbit.measure(model);
        let PeriodicOrbit { mesh, path, linearisation, workspace, adjoints, .. } = orbit;
        let workspaces = Workspaces { linearisation, workspace, adjoints };
        let found = differentiate(model, mesh, (path, &cycle), workspaces, wanted);
        found.ok_or(orbit.not_converged())
    }

    fn work_and_loss_j(&self) -> Result<[f64; 2]> {
        Ok(work_and_loss_j(self.model, &self.orbit.mesh))
    }

    fn loss_j(&mut self) -> Result<f64> {
        let (model, orbit) = (self.model, &mut *self.orbit);
        orbit.measure(model);
        Ok(loss_j(model, &orbit.mesh, &orbit.path))
    }

    fn distance_and_work_derivatives(&mut self) -> Result<[Derivatives<f64>; 2]> {
        let (model, orbit) = (self.model, &mut *self.orbit);
        let cycle = orbit.measure(model);
        let PeriodicOrbit { mesh, path, linearisation, workspace, adjoints, .. } = orbit;
        let loss_j = loss_j(model, mesh, path);
        let workspaces = Workspaces { linearisation, workspace, adjoints };
        let found = differentiate_distance(model, mesh, (path, &cycle), workspaces, loss_j);
        found.ok_or(orbit.not_converged())
    }

    fn polish(&mut self) -> Result<f64> {
        self.orbit.polish(self.model)
    }

    fn attractor(
        &mut self,
        first: Result<GaitMetrics>,
        accuracy: f64,
    ) -> Result<(GaitMetrics, usize, bool)> {
        let (cycle, cycles, is_first) = self.reach(first.is_ok(), accuracy)?;
        Ok((self.model.gait_metrics(&cycle), cycles, is_first))
    }

    fn cycle(&self, samples: usize) -> Result<Vec<Sample>> {
        trajectory::cycle(self.model, &self.orbit.mesh, samples)
    }

    fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<Sample>> {
        trajectory::from_rest(self.model, cycles, samples)
    }

    fn transient(&self, frames: &Frames, tolerance: f64) -> Result<Vec<Posture>> {
        transient::from_rest(self.model, frames, tolerance)
    }
}

/// Returns the energy dissipated by friction over a cycle, J, along the given path.
pub(super) fn loss_j<const N: usize, R: Reduced<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    path: &Path<N, R>,
) -> f64 {
    let weights = RADAU.integrate[STAGES - 1];
    let mut sum = Lanes::default();
    for (pack, leg) in path.legs.iter().enumerate() {
        let [_, duration_s] = mesh.weights(pack);
        for j in 0..STAGES {
            let power = model.loss_w(&mesh.nodes(pack)[j], &leg.states[j]);
            sum += Lanes::splat(weights[j]) * duration_s * power;
        }
    }
    mesh.spans() as f64 * sum_of_lanes(sum)
}

/// Returns the work of the actuators and the energy dissipated over a cycle, J.
pub(super) fn work_and_loss_j<const N: usize, R: Reduced<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
) -> [f64; 2] {
    let weights = RADAU.integrate[STAGES - 1];
    let mut sums = [Lanes::default(); 2];
    for pack in 0..mesh.packs() {
        let starts = mesh.starts(pack);
        let element = mesh.pack(pack, &starts);
        let phases_rad = mesh.phases_rad(pack);
        let [_, duration_s] = mesh.weights(pack);
        for j in 0..STAGES {
            let rate = element.rate(j);
            let powers = model.power_and_loss_w(phases_rad[j], &element.stages[j], &rate);
            let weight = Lanes::splat(weights[j]) * duration_s;
            sums.iter_mut().zip(powers).for_each(|(sum, power)| *sum += weight * power);
        }
    }
    sums.map(|sum| mesh.spans() as f64 * sum_of_lanes(sum))
}
