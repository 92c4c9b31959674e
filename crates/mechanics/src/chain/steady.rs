//! Equations of motion of chains with any number of free joints, and their last solution, behind one interface.

use std::fmt::Debug;

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{ChainNumber, Friction};

use super::derivative::{Slopes, slopes};
use super::model::Model;
use super::{ChainProblem, metrics_of};
use crate::branch::{Branch, Sweep, trace_all};
use crate::method::{Collocation, loss_j, work_and_loss_j};
use crate::orbit::{Effort, PeriodicOrbit};
use crate::transient::{self, Frames, Posture};
use crate::{Result, Sample, trajectory};

/// Equations of motion with a given number of free joints, and the last solution.
pub(crate) trait Steady: Debug + Send + Sync {
    fn free_joints(&self) -> usize;

    /// Replaces the problem by another one with as many free joints, whose unused coefficients are zero.
    fn set_problem(&mut self, problem: ChainProblem) -> Result<()>;

    /// Solves for the steady-state motion. If `is_warm`, the search starts from the last solution; otherwise, or if that
    /// fails, from the model's initial guess and, if that fails, from the transient from rest.
    fn solve(&mut self, is_warm: bool, accuracy: f64) -> Result<GaitMetrics>;

    /// Solves for the steady-state motion, starting from the last solution or, if that fails, from the model's initial
    /// guess. If both fail, the last solution is kept.
    fn solve_near(&mut self, accuracy: f64) -> Result<GaitMetrics>;

    /// Replaces the present solution by the attractor reached from rest. If `is_solved`, the present solution is tried first
    /// as the attractor. Returns the attractor's metrics, the number of cycles to settle, and whether the attractor is the
    /// solution that it would have replaced.
    fn reach(&mut self, is_solved: bool, accuracy: f64) -> Result<(GaitMetrics, usize, bool)>;

    /// Returns the computational effort of the last solution.
    fn effort(&self) -> Effort;

    /// Returns the modulus of the largest Floquet multiplier; `None` if the motion has no dynamic states.
    fn floquet(&mut self) -> Result<Option<f64>>;

    fn is_symmetry_broken(&self) -> bool;

    /// Returns the metrics of the last solution.
    fn metrics(&mut self) -> GaitMetrics;

    /// Returns the work of the actuators and the energy dissipated over a cycle, J.
    fn work_and_loss_j(&self) -> [f64; 2];

    /// Returns the energy dissipated over a cycle, J.
    fn loss_j(&mut self) -> f64;

    /// Takes one more Newton step and returns its size relative to the states.
    fn polish(&mut self) -> Result<f64>;

    /// Returns the derivatives of the metrics and, if wanted, of the work (J) with respect to numbers of the chain.
    fn slopes(
        &mut self,
        numbers: &[ChainNumber],
        wanted: Slopes,
    ) -> Result<Vec<(GaitMetrics, f64)>>;

    fn cycle(&self, samples: usize) -> Result<Vec<Sample>>;

    fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<Sample>>;

    fn transient(&self, frames: &Frames, tolerance: f64) -> Result<Vec<Posture>>;

    fn branches(
        &self,
        problem_at: &dyn Fn(f64) -> ChainProblem,
        sweep: &Sweep,
    ) -> Result<Vec<Branch>>;

    fn copy(&self) -> Box<dyn Steady>;

    /// Returns equations whose next solution can start from the same motion, but with no solution to query.
    fn successor(&self) -> Box<dyn Steady>;
}

impl Clone for Box<dyn Steady> {
    fn clone(&self) -> Self {
        self.as_ref().copy()
    }
}

/// Equations of motion with their last solution.
#[derive(Debug, Clone)]
pub(super) struct Kept<const N: usize, const C: usize, const D: usize, F: Friction> {
    model: Model<N, C, D, F>,
    orbit: PeriodicOrbit<N, Model<N, C, D, F>>,
}

impl<const N: usize, const C: usize, const D: usize, F: Friction> Kept<N, C, D, F> {
    pub(super) fn boxed(problem: ChainProblem) -> Result<Box<dyn Steady>> {
        Ok(Box::new(Self { model: Model::new(problem)?, orbit: PeriodicOrbit::default() }))
    }

    fn method(&mut self) -> Collocation<'_, N, Model<N, C, D, F>> {
        Collocation { model: &self.model, orbit: &mut self.orbit }
    }
}

impl<const N: usize, const C: usize, const D: usize, F: Friction> Steady for Kept<N, C, D, F> {
    fn free_joints(&self) -> usize {
        C - 1
    }

    fn set_problem(&mut self, problem: ChainProblem) -> Result<()> {
        self.model = self.model.renewed(problem)?;
        Ok(())
    }

    fn solve(&mut self, is_warm: bool, accuracy: f64) -> Result<GaitMetrics> {
        let cycle = self.method().find(is_warm, accuracy)?;
        Ok(metrics_of(&self.model, &cycle))
    }

    fn solve_near(&mut self, accuracy: f64) -> Result<GaitMetrics> {
        let cycle = self.method().find_near(accuracy)?;
        Ok(metrics_of(&self.model, &cycle))
    }

    fn reach(&mut self, is_solved: bool, accuracy: f64) -> Result<(GaitMetrics, usize, bool)> {
        let (cycle, cycles, is_first) = self.method().reach(is_solved, accuracy)?;
        Ok((metrics_of(&self.model, &cycle), cycles, is_first))
    }

    fn effort(&self) -> Effort {
        self.orbit.effort
    }

    fn floquet(&mut self) -> Result<Option<f64>> {
        if self.model.problem.is_determined() {
            return Ok(None);
        }
        self.orbit.floquet(&self.model).map(Some)
    }

    fn is_symmetry_broken(&self) -> bool {
        self.orbit.is_symmetry_broken
    }

    fn metrics(&mut self) -> GaitMetrics {
        metrics_of(&self.model, &self.orbit.measure(&self.model))
    }

    fn work_and_loss_j(&self) -> [f64; 2] {
        work_and_loss_j(&self.model, &self.orbit.mesh)
    }

    fn loss_j(&mut self) -> f64 {
        self.orbit.measure(&self.model);
        loss_j(&self.model, &self.orbit.mesh, &self.orbit.path)
    }

    fn polish(&mut self) -> Result<f64> {
        self.orbit.polish(&self.model)
    }

    fn slopes(
        &mut self,
        numbers: &[ChainNumber],
        wanted: Slopes,
    ) -> Result<Vec<(GaitMetrics, f64)>> {
        slopes(&self.model, &mut self.orbit, numbers, wanted)
    }

    fn cycle(&self, samples: usize) -> Result<Vec<Sample>> {
        trajectory::cycle(&self.model, &self.orbit.mesh, samples)
    }

    fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<Sample>> {
        trajectory::from_rest(&self.model, cycles, samples)
    }

    fn transient(&self, frames: &Frames, tolerance: f64) -> Result<Vec<Posture>> {
        transient::from_rest(&self.model, frames, tolerance)
    }

    fn branches(
        &self,
        problem_at: &dyn Fn(f64) -> ChainProblem,
        sweep: &Sweep,
    ) -> Result<Vec<Branch>> {
        trace_all(&|value| self.model.with_problem(problem_at(value)), sweep)
    }

    fn copy(&self) -> Box<dyn Steady> {
        Box::new(self.clone())
    }

    fn successor(&self) -> Box<dyn Steady> {
        Box::new(Self { model: self.model.clone(), orbit: self.orbit.successor() })
    }
}
