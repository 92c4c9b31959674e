//! Warm-started solver of steady-state motions.

use std::f64::consts::TAU;
use std::fmt::Debug;

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Dry, Friction, Parameter, Viscous};

use super::method::{Collocation, Method};
use super::orbit::{Effort, PeriodicOrbit};
use super::quadrature::{GaitAnalysis, Quadrature};
use super::reduced::{Derivatives, PassiveNoSkid, Skid};
use super::trajectory::Sample;
use super::{FromRest, MotionError, MotionStatus, Problem, Result, SteadyMotion};

/// Warm-started solver of steady-state motions, which reuses its workspace. A solution starts from the last one if both
/// motions are of the same kind: with the same passive joint (or none), with or without skid, and with or without dry
/// friction. Otherwise it starts from the model's initial guess.
#[derive(Debug, Clone, Default)]
pub struct Solver {
    /// Problem of the last solution.
    last: Option<Problem>,
    /// Problem of the solution from which the next one starts; `None` if the next one starts from the model's initial
    /// guess. After a failed [`Solver::solve_near`], the last solution that was found can still be the start.
    start: Option<Problem>,
    /// Last problem whose motion the no-skid constraints alone determine (eq. 3 of the paper), the metrics of
    /// that motion, and their relative accuracy.
    last_quadrature: Option<(Problem, GaitMetrics, f64)>,
    /// Analysis of the gait in the problem of `last_quadrature`.
    gait_analysis: GaitAnalysis,
    viscous: Orbits<Viscous>,
    dry: Orbits<Dry>,
    /// Motions under the friction law of [`Solver::with_friction`]; `None` if the solver uses the friction laws in the
    /// problems.
    custom: Option<Box<dyn CustomFriction>>,
    effort: Effort,
}

/// Steady-state motions under a friction law from outside this crate; implemented by [`Orbits`].
trait CustomFriction: Debug + Send + Sync {
    /// Runs `task` with the solution method for the problem. `known` keeps the analysis of the gait from one
    /// call to the next.
    fn with(
        &mut self,
        problem: &Problem,
        known: &mut GaitAnalysis,
        task: &mut dyn FnMut(&mut dyn Method) -> Result<()>,
    ) -> Result<()>;

    fn successor(&self) -> Box<dyn CustomFriction>;

    fn copy(&self) -> Box<dyn CustomFriction>;
}

impl Clone for Box<dyn CustomFriction> {
    fn clone(&self) -> Self {
        self.as_ref().copy()
    }
}

impl<F: Friction> CustomFriction for Orbits<F> {
    fn with(
        &mut self,
        problem: &Problem,
        known: &mut GaitAnalysis,
        task: &mut dyn FnMut(&mut dyn Method) -> Result<()>,
    ) -> Result<()> {
        match problem.gait.joints {
            [Some(joint1), Some(joint2)] if !problem.laws.skids() => {
                task(&mut Quadrature::<F>::new(problem, [joint1, joint2], known))
            }
            _ => Orbits::with(self, problem.clone(), problem.gait.passive_joint(), task),
        }
    }

    fn successor(&self) -> Box<dyn CustomFriction> {
        Box::new(Orbits::successor(self))
    }

    fn copy(&self) -> Box<dyn CustomFriction> {
        Box::new(self.clone())
    }
}

/// Last steady-state motion of each kind that is governed by differential equations: all kinds but that of a robot with
/// both joints commanded and no-skid wheels.
#[derive(Debug, Clone)]
struct Orbits<F: Friction> {
    kinematic_skid: PeriodicOrbit<3, Skid<3, F>>,
    passive_skid: PeriodicOrbit<5, Skid<5, F>>,
    passive_no_skid: PeriodicOrbit<2, PassiveNoSkid<F>>,
}

impl<F: Friction> Default for Orbits<F> {
    fn default() -> Self {
        Self {
            kinematic_skid: PeriodicOrbit::default(),
            passive_skid: PeriodicOrbit::default(),
            passive_no_skid: PeriodicOrbit::default(),
        }
    }
}

impl<F: Friction> Orbits<F> {
    fn successor(&self) -> Self {
        let Self { kinematic_skid, passive_skid, passive_no_skid } = self;
        Self {
            kinematic_skid: kinematic_skid.successor(),
            passive_skid: passive_skid.successor(),
            passive_no_skid: passive_no_skid.successor(),
        }
    }

    /// Runs `task` with the solution method for the problem; `passive` is the index of the passive joint, if
    /// there is one.
    fn with<T>(
        &mut self,
        problem: Problem,
        passive: Option<usize>,
        task: impl FnOnce(&mut dyn Method) -> Result<T>,
    ) -> Result<T> {
        let Self { kinematic_skid, passive_skid, passive_no_skid } = self;
        match (passive, problem.laws.skids()) {
            (None, _) => {
                let model = Skid::new(problem, 0);
                task(&mut Collocation { model: &model, orbit: kinematic_skid })
            }
            (Some(passive), true) => {
                let model = Skid::new(problem, passive);
                task(&mut Collocation { model: &model, orbit: passive_skid })
            }
            (Some(passive), false) => {
                let model = PassiveNoSkid::new(problem, passive);
                task(&mut Collocation { model: &model, orbit: passive_no_skid })
            }
        }
    }
}

/// Attractor reached from rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attractor {
    pub motion: SteadyMotion,
    /// Number of cycles after which the state at the end of each cycle stays within 1 % of its steady-state
    /// value.
    pub cycles: usize,
    /// Whether the attractor is the solution that [`Solver::solve`] finds.
    pub is_found_by_solve: bool,
}

impl Attractor {
    /// Classifies the result of the search for the attractor reached from rest.
    pub fn from_rest(attractor: &Result<Self>) -> FromRest {
        match attractor {
            Ok(attractor) if attractor.is_found_by_solve => FromRest::Reached,
            Ok(_) => FromRest::Another,
            Err(_) => FromRest::Unsettled,
        }
    }
}

impl Solver {
    /// Creates a solver that uses friction law `F` in place of the friction laws in the problems. The laws in
    /// a problem then determine only whether the wheels can skid, and with respect to which parameters
    /// derivatives are computed. The example `own_friction` defines such a law.
    pub fn with_friction<F: Friction>() -> Self {
        const {
            let count = F::SKID.len() + F::ROLL.len();
            assert!(
                count <= Dry::SKID.len() + Dry::ROLL.len(),
                "the friction law has more parameters than the solver supports"
            );
        }
        Self { custom: Some(Box::new(Orbits::<F>::default())), ..Self::default() }
    }

    /// Solves for the steady-state periodic motion to a relative `accuracy` of its metrics. Under commands
    /// with half-period symmetry, the motion has this symmetry, too; but if the symmetric motion is unstable
    /// to symmetry breaking, the solution is the motion reached from rest, one of a mirror-image pair.
    ///
    /// # Errors
    /// Returns an error if the problem has no steady-state motion, or if the motion could not be found or resolved.
    pub fn solve(&mut self, problem: &Problem, accuracy: f64) -> Result<GaitMetrics> {
        let is_warm = self.start.take().is_some_and(|start| is_alike(&start, problem));
        self.solve_by(problem, accuracy, |method| method.solve(is_warm, accuracy))
    }

    /// Solves as [`Solver::solve`] does, except if a solution of the same kind exists: then Newton's method starts only
    /// from that solution and from the model's initial guess, not from a transient, and after a failure the next
    /// solution starts from the existing one. Meant for searches, which solve many similar problems.
    ///
    /// # Errors
    /// Returns an error if the problem has no steady-state motion, or if the motion could not be found or resolved, for
    /// example because it is too far from the existing solution.
    pub fn solve_near(&mut self, problem: &Problem, accuracy: f64) -> Result<GaitMetrics> {
        if !self.start.as_ref().is_some_and(|start| is_alike(start, problem)) {
            return self.solve(problem, accuracy);
        }
        self.solve_by(problem, accuracy, |method| method.solve_near(accuracy))
    }

    /// Solves the problem by calling `solve` with the solution method for the problem, unless
    /// [`Solver::scaled_quadrature`] already has the metrics, and stores the problem as the last one solved.
    fn solve_by(
        &mut self,
        problem: &Problem,
        accuracy: f64,
        solve: impl FnOnce(&mut dyn Method) -> Result<(GaitMetrics, Effort)>,
    ) -> Result<GaitMetrics> {
        self.last = None;
        self.effort = Effort::default();
        let metrics;
        (metrics, self.effort) = match self.scaled_quadrature(problem, accuracy) {
            Some(known) => (known, Effort::default()),
            None => self.with(problem, solve)?,
        };
        if problem.is_determined() && self.effort.elements > 0 {
            self.last_quadrature = Some((problem.clone(), metrics, accuracy));
        }
        self.record(problem);
        Ok(metrics)
    }

    /// Returns the metrics of a motion that the no-skid constraints alone determine (eq. 3 of the paper),
    /// scaled from those at another frequency, which changes only the speed. Returns `None` unless the last
    /// motion of this kind had the same robot, gait and friction laws, and at least this accuracy.
    fn scaled_quadrature(&self, problem: &Problem, accuracy: f64) -> Option<GaitMetrics> {
        let (known, metrics, known_accuracy) = self.last_quadrature.as_ref()?;
        let Problem { robot, gait, laws, omega_rad_s } = problem;
        let is_same = known.robot == *robot && known.gait == *gait && known.laws == *laws;
        let is_same = is_same && *known_accuracy <= accuracy;
        is_same.then(|| GaitMetrics { v_m_s: metrics.d_m * omega_rad_s / TAU, ..*metrics })
    }

    /// Records the problem of the current solution.
    fn record(&mut self, problem: &Problem) {
        self.last = Some(problem.clone());
        self.start = Some(problem.clone());
    }

    /// Creates a solver whose next solution starts from the same motion as the next solution of this solver.
    /// The new solver has no last solution that could be queried.
    pub fn successor(&self) -> Self {
        Self {
            last: None,
            start: self.start.clone(),
            last_quadrature: self.last_quadrature.clone(),
            gait_analysis: self.gait_analysis,
            viscous: self.viscous.successor(),
            dry: self.dry.successor(),
            custom: self.custom.as_ref().map(|custom| custom.successor()),
            effort: Effort::default(),
        }
    }

    /// Makes the next solution start from the model's initial guess; the workspace is retained.
    pub fn forget(&mut self) {
        self.last = None;
        self.start = None;
        self.last_quadrature = None;
    }

    /// Returns the modulus of the last solution's largest Floquet multiplier; `None` if the motion has no
    /// dynamic states.
    ///
    /// # Errors
    /// Returns an error if there is no last solution, or if its linearisation is singular.
    pub fn floquet(&mut self) -> Result<Option<f64>> {
        self.with_last(|method| method.floquet())
    }

    /// Returns whether the last solution is one of two motions that mirror each other with a shift of half a
    /// period, although the commands have half-period symmetry.
    ///
    /// # Errors
    /// Returns an error if there is no last solution.
    pub fn is_symmetry_broken(&mut self) -> Result<bool> {
        self.with_last(|method| Ok(method.is_symmetry_broken()))
    }

    /// Returns whether the last solution is stable, and whether it is one of a mirror-image pair.
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does.
    pub fn status(&mut self) -> Result<MotionStatus> {
        Ok(MotionStatus::new(self.floquet()?, self.is_symmetry_broken()?))
    }

    /// Returns the derivatives of the last solution's metrics with respect to all variables.
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does.
    pub fn derivatives(&mut self) -> Result<Derivatives> {
        self.with_last(|method| method.derivatives(None))
    }

    /// Returns the derivatives of the last solution's metrics with respect to the `wanted` parameters; other
    /// derivatives may be zero.
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does.
    pub fn derivatives_of(&mut self, wanted: &[Parameter]) -> Result<Derivatives> {
        self.with_last(|method| method.derivatives(Some(wanted)))
    }

    /// Returns the work of the actuators and the energy dissipated by friction over a cycle of the last
    /// solution, J. The two are equal up to the accuracy of the solution.
    ///
    /// # Errors
    /// Returns an error if there is no last solution.
    pub fn work_and_loss_j(&mut self) -> Result<[f64; 2]> {
        self.with_last(|method| method.work_and_loss_j())
    }

    /// Returns the energy dissipated by friction over a cycle of the last solution, J.
    ///
    /// # Errors
    /// Returns an error if there is no last solution.
    pub fn loss_j(&mut self) -> Result<f64> {
        self.with_last(|method| method.loss_j())
    }

    /// Returns the derivatives of the last solution's work over a cycle, J per unit of each variable.
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does.
    pub fn work_derivatives(&mut self) -> Result<Derivatives<f64>> {
        self.distance_and_work_derivatives().map(|[_, work]| work)
    }

    /// Returns the derivatives of the last solution's displacement d (m per unit of each variable) and work
    /// over a cycle (J per unit of each variable).
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does.
    pub fn distance_and_work_derivatives(&mut self) -> Result<[Derivatives<f64>; 2]> {
        self.with_last(|method| method.distance_and_work_derivatives())
    }

    /// Takes one more Newton step, with a fresh Jacobian, from the last solution. Returns the size of the
    /// step relative to the states, which estimates the remaining error; 0 for a motion without dynamic
    /// states.
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does.
    pub fn polish(&mut self) -> Result<f64> {
        self.with_last(|method| method.polish())
    }

    /// Samples one cycle of the last solution at `samples + 1` equally spaced times, the first at phase 0.
    ///
    /// # Errors
    /// Returns an error if there is no last solution, or if its equations cannot be solved at a sample.
    pub fn cycle(&mut self, samples: usize) -> Result<Vec<Sample>> {
        self.with_last(|method| method.cycle(samples))
    }

    /// Integrates the transient from rest and solves for the steady-state motion that it reaches. The next
    /// solution starts from that motion.
    ///
    /// # Errors
    /// Returns an error if the transient cannot be integrated or does not settle.
    pub fn settle(&mut self, problem: &Problem, accuracy: f64) -> Result<Attractor> {
        let first = self.solve(problem, accuracy);
        self.attractor(problem, first, accuracy)
    }

    /// Finds the attractor as [`Solver::settle`] does, given `first`, the result of [`Solver::solve`] for
    /// this problem.
    ///
    /// # Errors
    /// Returns an error as [`Solver::settle`] does.
    pub fn attractor(
        &mut self,
        problem: &Problem,
        first: Result<GaitMetrics>,
        accuracy: f64,
    ) -> Result<Attractor> {
        self.last = None;
        self.start = None;
        let (metrics, cycles, is_found_by_solve) =
            self.with(problem, |method| method.attractor(first, accuracy))?;
        self.record(problem);
        Ok(Attractor { motion: self.steady_motion(metrics)?, cycles, is_found_by_solve })
    }

    /// Returns the steady-state motion of the last solution, given its metrics.
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does.
    pub fn steady_motion(&mut self, metrics: GaitMetrics) -> Result<SteadyMotion> {
        let floquet = self.floquet()?;
        let [work_j, _] = self.work_and_loss_j()?;
        let is_symmetry_broken = self.is_symmetry_broken()?;
        Ok(SteadyMotion { metrics, floquet, work_j, is_symmetry_broken })
    }

    /// Returns the computational effort of the last [`Solver::solve`].
    pub fn effort(&self) -> Effort {
        self.effort
    }

    /// Runs `task` with the solution method that holds the last solution; returns an error if there is no last
    /// solution.
    fn with_last<T>(&mut self, task: impl FnOnce(&mut dyn Method) -> Result<T>) -> Result<T> {
        let problem = self.last.clone().ok_or(MotionError::Unsolved)?;
        self.with(&problem, task)
    }

    /// Runs `task` with the solution method for the problem.
    pub(super) fn with<T>(
        &mut self,
        problem: &Problem,
        task: impl FnOnce(&mut dyn Method) -> Result<T>,
    ) -> Result<T> {
        if problem.gait.joints == [None, None] {
            return Err(MotionError::NotDriven);
        }
        let problem = problem.effective();
        if let Some(custom) = &mut self.custom {
            let mut task = Some(task);
            let mut found = None;
            custom.with(&problem, &mut self.gait_analysis, &mut |method| {
                found = task.take().map(|task| task(method)).transpose()?;
                Ok(())
            })?;
            return found.ok_or(MotionError::Unsolved);
        }
        let passive = problem.gait.passive_joint();
        match (problem.gait.joints, problem.laws) {
            ([Some(joint1), Some(joint2)], laws) if !laws.skids() => {
                let known = &mut self.gait_analysis;
                task(&mut Quadrature::<Dry>::new(&problem, [joint1, joint2], known))
            }
            (_, laws) if !laws.are_linear() => self.dry.with(problem, passive, task),
            _ => self.viscous.with(problem, passive, task),
        }
    }
}

/// Returns whether the solution of `last` can be the starting point for that of `next`.
fn is_alike(last: &Problem, next: &Problem) -> bool {
    last.gait.passive_joint() == next.gait.passive_joint()
        && last.laws.skids() == next.laws.skids()
        && last.laws.are_linear() == next.laws.are_linear()
}
