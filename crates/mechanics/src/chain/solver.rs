//! Solver that keeps the last motion of a chain.

use std::fmt::Debug;

use trilink_robot::{ChainNumber, Dry, Friction};

use super::derivative::{ChainSlopes, slopes};
use super::model::Model;
use super::{
    ChainAttractor, ChainMetrics, ChainMotion, ChainProblem, ChainSample, metrics_of, motion_of,
};
use crate::branch::{Branch, Sweep, trace_all};
use crate::method::{Collocation, loss_j};
use crate::orbit::PeriodicOrbit;
use crate::transient::{self, Frames, Posture};
use crate::{MotionError, Result, trajectory};

/// Warm-started solver of steady-state motions of chains, which reuses its workspace. A solution starts from the last
/// one if both motions are of the same kind: with as many free joints, with or without skid, and with or without dry
/// friction. Otherwise it starts from the model's initial guess.
#[derive(Debug, Clone)]
pub(crate) struct ChainSolver {
    /// Creates the equations of motion of a problem under the solver's friction law.
    steady: fn(ChainProblem) -> Result<Box<dyn Steady>>,
    kept: Option<Box<dyn Steady>>,
    /// Kind of the motion from which the next solution starts; `None` if it starts from the initial guess.
    start: Option<StartKind>,
    /// Problem of the last solution.
    last: Option<ChainProblem>,
}

/// What two motions must have in common for one to be the start of the search for the other.
#[derive(Debug, Clone, Copy, PartialEq)]
struct StartKind {
    free_joints: usize,
    skids: bool,
    is_linear: bool,
}

impl StartKind {
    fn of(problem: &ChainProblem) -> Self {
        Self {
            free_joints: problem.chain.free_joints(),
            skids: problem.laws.skids(),
            is_linear: problem.laws.are_linear(),
        }
    }
}

/// Equations of motion with a given number of free joints, and the last solution.
pub(super) trait Steady: Debug + Send + Sync {
    fn free_joints(&self) -> usize;

    /// Replaces the problem by another one with as many free joints, whose unused coefficients are zero.
    fn set_problem(&mut self, problem: ChainProblem) -> Result<()>;

    /// Solves for the steady-state motion. If `is_warm`, the search starts from the last solution; otherwise, or if that
    /// fails, from the model's initial guess and, if that fails, from the transient from rest.
    fn solve(&mut self, is_warm: bool, accuracy: f64) -> Result<ChainMetrics>;

    /// Solves for the steady-state motion, starting from the last solution or, if that fails, from the model's initial
    /// guess; the last solution is retained if both fail.
    fn solve_near(&mut self, accuracy: f64) -> Result<ChainMetrics>;

    /// Returns the last solution.
    fn motion(&mut self) -> Result<ChainMotion>;

    /// Returns the energy dissipated over a cycle of the last solution, J.
    fn loss_j(&mut self) -> f64;

    /// Finds the attractor reached from rest, which becomes the solution; if `is_solved`, the present solution is the
    /// first candidate.
    fn reach(&mut self, is_solved: bool, accuracy: f64) -> Result<ChainAttractor>;

    fn cycle(&self, samples: usize) -> Result<Vec<ChainSample>>;

    fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<ChainSample>>;

    fn transient(&self, frames: &Frames, tolerance: f64) -> Result<Vec<Posture>>;

    /// Returns the derivatives of the last solution with respect to numbers of the chain of `problem`.
    fn slopes(
        &mut self,
        problem: &ChainProblem,
        numbers: &[ChainNumber],
    ) -> Result<Vec<ChainSlopes>>;

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
        self.model = Model::new(problem)?;
        Ok(())
    }

    fn solve(&mut self, is_warm: bool, accuracy: f64) -> Result<ChainMetrics> {
        let (cycle, _) = self.method().find(is_warm, accuracy)?;
        Ok(metrics_of(&self.model, &cycle))
    }

    fn solve_near(&mut self, accuracy: f64) -> Result<ChainMetrics> {
        let (cycle, _) = self.method().find_near(accuracy)?;
        Ok(metrics_of(&self.model, &cycle))
    }

    fn motion(&mut self) -> Result<ChainMotion> {
        let cycle = self.orbit.measure(&self.model);
        motion_of(&self.model, &mut self.orbit, &cycle)
    }

    fn loss_j(&mut self) -> f64 {
        self.orbit.measure(&self.model);
        loss_j(&self.model, &self.orbit.mesh, &self.orbit.path)
    }

    fn reach(&mut self, is_solved: bool, accuracy: f64) -> Result<ChainAttractor> {
        let (_, cycles, is_found_by_solve) = self.method().reach(is_solved, accuracy)?;
        Ok(ChainAttractor { motion: self.motion()?, cycles, is_found_by_solve })
    }

    fn cycle(&self, samples: usize) -> Result<Vec<ChainSample>> {
        trajectory::cycle(&self.model, &self.orbit.mesh, samples)
    }

    fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<ChainSample>> {
        trajectory::from_rest(&self.model, cycles, samples)
    }

    fn transient(&self, frames: &Frames, tolerance: f64) -> Result<Vec<Posture>> {
        transient::from_rest(&self.model, frames, tolerance)
    }

    fn slopes(
        &mut self,
        problem: &ChainProblem,
        numbers: &[ChainNumber],
    ) -> Result<Vec<ChainSlopes>> {
        slopes(problem, &self.model, &mut self.orbit, numbers)
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

impl Default for ChainSolver {
    fn default() -> Self {
        Self::with_friction::<Dry>()
    }
}

impl ChainSolver {
    /// Creates a solver with a friction law in place of those of the problems.
    pub(crate) fn with_friction<F: Friction>() -> Self {
        Self { steady: ChainProblem::steady::<F>, kept: None, start: None, last: None }
    }

    /// Solves for the metrics of the steady-state periodic motion to a relative `accuracy`.
    ///
    /// # Errors
    /// Returns an error if the description of the chain is wrong, if no such motion exists, or if it could not be found
    /// or resolved.
    pub(crate) fn solve(&mut self, problem: &ChainProblem, accuracy: f64) -> Result<ChainMetrics> {
        let kind = StartKind::of(problem);
        let is_warm = self.start.take() == Some(kind);
        let metrics = self.set_problem(problem)?.solve(is_warm, accuracy)?;
        (self.start, self.last) = (Some(kind), Some(problem.clone()));
        Ok(metrics)
    }

    /// Solves as [`ChainSolver::solve`] does, except if a solution of the same kind exists: then the search starts only from
    /// that solution and from the model's initial guess, not from a transient, and after a failure the next solution
    /// starts from the existing one.
    ///
    /// # Errors
    /// Returns an error as [`ChainSolver::solve`] does, or if the motion is too far from the existing solution.
    pub(crate) fn solve_near(
        &mut self,
        problem: &ChainProblem,
        accuracy: f64,
    ) -> Result<ChainMetrics> {
        if self.start != Some(StartKind::of(problem)) {
            return self.solve(problem, accuracy);
        }
        let metrics = self.set_problem(problem)?.solve_near(accuracy)?;
        self.last = Some(problem.clone());
        Ok(metrics)
    }

    /// Integrates the transient from rest and solves for the steady-state motion that it reaches, given whether
    /// [`ChainSolver::solve`] has solved the problem last. The attractor becomes the last solution.
    ///
    /// # Errors
    /// Returns an error as [`ChainSolver::solve`] does, or if the transient does not settle.
    pub(crate) fn attractor(
        &mut self,
        problem: &ChainProblem,
        is_solved: bool,
        accuracy: f64,
    ) -> Result<ChainAttractor> {
        self.start = None;
        let attractor = self.set_problem(problem)?.reach(is_solved, accuracy)?;
        (self.start, self.last) = (Some(StartKind::of(problem)), Some(problem.clone()));
        Ok(attractor)
    }

    /// Returns the last solution with its stability and energy.
    ///
    /// # Errors
    /// Returns an error if there is no last solution, or if its linearisation is singular.
    pub(crate) fn motion(&mut self) -> Result<ChainMotion> {
        self.solved()?.1.motion()
    }

    /// Returns the energy dissipated over a cycle of the last solution, J.
    ///
    /// # Errors
    /// Returns an error if there is no last solution.
    pub(crate) fn loss_j(&mut self) -> Result<f64> {
        Ok(self.solved()?.1.loss_j())
    }

    /// Returns the derivatives of the last solution with respect to numbers of the chain, in SI units.
    ///
    /// # Errors
    /// Returns an error as [`ChainSolver::motion`] does, or if the chain does not have one of the numbers.
    pub(crate) fn slopes(&mut self, numbers: &[ChainNumber]) -> Result<Vec<ChainSlopes>> {
        let (problem, kept) = self.solved()?;
        kept.slopes(problem, numbers)
    }

    /// Samples one cycle of the last solution at `samples + 1` equally spaced times, the first at phase 0.
    ///
    /// # Errors
    /// Returns an error if there is no last solution, or if its equations cannot be solved at a sample.
    pub(crate) fn cycle(&mut self, samples: usize) -> Result<Vec<ChainSample>> {
        self.solved()?.1.cycle(samples)
    }

    /// Returns the problem of the last solution.
    pub(crate) fn last(&self) -> Option<&ChainProblem> {
        self.last.as_ref()
    }

    /// Creates a solver whose next solution starts from the same motion as the next solution of this solver. The new
    /// solver has no last solution that could be queried.
    pub(crate) fn successor(&self) -> Self {
        let kept = self.kept.as_ref().map(|kept| kept.successor());
        Self { steady: self.steady, kept, start: self.start, last: None }
    }

    /// Discards the last solution: the next one starts from the model's initial guess. The workspace is retained.
    pub(crate) fn forget(&mut self) {
        (self.start, self.last) = (None, None);
    }

    fn solved(&mut self) -> Result<(&ChainProblem, &mut Box<dyn Steady>)> {
        self.last.as_ref().zip(self.kept.as_mut()).ok_or(MotionError::Unsolved)
    }

    fn set_problem(&mut self, problem: &ChainProblem) -> Result<&mut Box<dyn Steady>> {
        self.last = None;
        let problem = problem.checked()?;
        let free_joints = problem.chain.free_joints();
        // If the equations of a problem cannot be set up, the last solution remains the start of the next.
        match self.kept.take_if(|kept| kept.free_joints() == free_joints) {
            Some(mut kept) => {
                let result = kept.set_problem(problem);
                let kept = self.kept.insert(kept);
                result.map(|()| kept)
            }
            None => Ok(self.kept.insert((self.steady)(problem)?)),
        }
    }
}
