//! Search for steady-state motions by collocation.

use std::f64::consts::TAU;

use trilink_robot::Lanes;

use super::Result;
use super::attractor::{MAX_CYCLES, find_attractor};
use super::cycle::Cycle;
use super::mesh::Mesh;
use super::orbit::{Effort, PeriodicOrbit, Start, sum_of_lanes};
use super::path::Path;
use super::radau::{RADAU, STAGES};
use super::reduced::Reduced;
use super::transient::Integrator;

/// Number of cycles that are integrated from rest to come near the steady-state motion.
const TRANSIENT_CYCLES: f64 = 40.0;
/// Relative error tolerance per time step of the transient.
const TRANSIENT_TOLERANCE: f64 = 1e-4;
/// Maximum number of cycles for which the motion from rest is integrated when a solve looks for a motion without
/// half-period symmetry. With more cycles, each such solve would take minutes for a robot that does not settle, for
/// example one of several tonnes.
const SEARCHED_CYCLES: usize = 100;

/// Search for the steady-state motion of one model.
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
    fn measure(&mut self, accuracy: f64) -> Cycle {
        let (model, orbit) = (self.model, &mut *self.orbit);
        if orbit.breaks_symmetry() {
            let symmetric = orbit.clone();
            if find_attractor(model, orbit, true, accuracy, SEARCHED_CYCLES).is_err() {
                *orbit = symmetric;
            }
        }
        orbit.measure(model)
    }

    /// Solves for the steady-state motion to a relative `accuracy` of its metrics. If `is_warm`, the search starts from
    /// the last solution; otherwise, or if that fails, from the model's initial guess and, if that fails, from the
    /// transient from rest.
    pub(super) fn find(&mut self, is_warm: bool, accuracy: f64) -> Result<Cycle> {
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

    /// Solves for the steady-state motion, starting from the last solution or, if that fails, from the
    /// model's initial guess; the last solution is retained if both fail.
    pub(super) fn find_near(&mut self, accuracy: f64) -> Result<Cycle> {
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

    /// Replaces the present solution by the attractor reached from rest. If `is_solved`, the present solution is tried first
    /// as the attractor. Returns the attractor's measurements, the number of cycles to settle, and whether the attractor is the
    /// solution that it would have replaced.
    pub(super) fn reach(&mut self, is_solved: bool, accuracy: f64) -> Result<(Cycle, usize, bool)> {
        let (model, orbit) = (self.model, &mut *self.orbit);
        let (cycles, is_first) = find_attractor(model, orbit, is_solved, accuracy, MAX_CYCLES)?;
        Ok((orbit.measure(model), cycles, is_first))
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
