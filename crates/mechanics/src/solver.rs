//! Steady motions one after the other, each from the last and in the same workspace.

use std::f64::consts::TAU;

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Dry, Friction, Parameter, Viscous};

use super::method::{Collocation, Method};
use super::orbit::{Effort, PeriodicOrbit};
use super::quadrature::{Known, Quadrature};
use super::reduced::{Derivatives, PassiveNoSkid, Skid};
use super::trajectory::Sample;
use super::{FromRest, MotionError, MotionStatus, Problem, Result, SteadyMotion};

/// Solves for steady motions. A solution starts from the last one if that was of the same
/// kind of motion (the same passive joint, skidding or not, dry or not), else from rest.
#[derive(Debug, Clone, Default)]
pub struct Solver {
    last: Option<Problem>,
    /// That of the solution which the next one starts from: the last one, or where that was not found nearby the one
    /// before.
    start: Option<Problem>,
    /// The last problem whose motion eq. 3 gives, its metrics, and how accurate they are.
    last_quadrature: Option<(Problem, GaitMetrics, f64)>,
    /// What its quadrature has found out.
    known_of_quadrature: Known,
    viscous: Orbits<Viscous>,
    dry: Orbits<Dry>,
    effort: Effort,
}

/// The last steady motion of each kind that is a solution of differential equations.
#[derive(Debug, Clone)]
struct Orbits<F: Friction> {
    kinematic_skid: PeriodicOrbit<3, Skid<3, F>>,
    passive_skid: PeriodicOrbit<5, Skid<5, F>>,
    passive_no_skid: PeriodicOrbit<2, PassiveNoSkid<F>>,
}

impl<F: Friction> Default for Orbits<F> {
    fn default() -> Self {
        let (kinematic_skid, passive_skid, passive_no_skid) = Default::default();
        Self { kinematic_skid, passive_skid, passive_no_skid }
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

    /// Does `task` with the method for the kind of motion of a problem, joint `passive` of which
    /// may be on its spring.
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
                task(&mut Collocation { model, orbit: kinematic_skid })
            }
            (Some(passive), true) => {
                let model = Skid::new(problem, passive);
                task(&mut Collocation { model, orbit: passive_skid })
            }
            (Some(passive), false) => {
                let model = PassiveNoSkid::new(problem, passive);
                task(&mut Collocation { model, orbit: passive_no_skid })
            }
        }
    }
}

/// The steady motion in which the robot from rest ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attractor {
    pub motion: SteadyMotion,
    /// Cycles after which the state at the end of every cycle stays within 1 % of the steady
    /// one.
    pub cycles: usize,
    /// Whether it is the solution that [`Solver::solve`] finds.
    pub is_found_first: bool,
}

impl Attractor {
    /// Where the robot from rest ends.
    pub fn from_rest(attractor: &Result<Self>) -> FromRest {
        match attractor {
            Ok(attractor) if attractor.is_found_first => FromRest::Reached,
            Ok(_) => FromRest::Another,
            Err(_) => FromRest::Unsettled,
        }
    }
}

impl Solver {
    /// Solves for the steady periodic motion to a relative `accuracy` of its metrics. Under commands
    /// that are their own mirror image half a period later the motion is, too; where that has become
    /// unstable to a pair of motions that are each other's, it is the one that is reached from rest.
    ///
    /// # Errors
    /// There is no such motion, or it could not be found or resolved.
    pub fn solve(&mut self, problem: &Problem, accuracy: f64) -> Result<GaitMetrics> {
        let is_warm = self.start.take().is_some_and(|start| is_alike(&start, problem));
        self.found(problem, accuracy, |method| method.solve(is_warm, accuracy))
    }

    /// The same where there is a solution of this kind of motion nearby, as on a search's way: where Newton's method
    /// finds the motion neither from there nor at once, the transient is not integrated, and the next solution starts
    /// from the one before.
    ///
    /// # Errors
    /// There is no such motion, or it is too far away.
    pub fn solve_near(&mut self, problem: &Problem, accuracy: f64) -> Result<GaitMetrics> {
        if !self.start.as_ref().is_some_and(|start| is_alike(start, problem)) {
            return self.solve(problem, accuracy);
        }
        self.found(problem, accuracy, |method| method.solve_near(accuracy))
    }

    /// Solves by a method, and remembers that.
    fn found(
        &mut self,
        problem: &Problem,
        accuracy: f64,
        solve: impl FnOnce(&mut dyn Method) -> Result<(GaitMetrics, Effort)>,
    ) -> Result<GaitMetrics> {
        (self.last, self.effort) = (None, Effort::default());
        let metrics;
        (metrics, self.effort) = match self.known_by_eq_3(problem, accuracy) {
            Some(known) => (known, Effort::default()),
            None => self.with(problem, solve)?,
        };
        if problem.is_determined() && self.effort.elements > 0 {
            self.last_quadrature = Some((problem.clone(), metrics, accuracy));
        }
        self.hold(problem);
        Ok(metrics)
    }

    /// The metrics of a motion that eq. 3 gives, from another of the same robot and gait: the
    /// frequency changes nothing but the speed.
    fn known_by_eq_3(&self, problem: &Problem, accuracy: f64) -> Option<GaitMetrics> {
        let (known, metrics, known_accuracy) = self.last_quadrature.as_ref()?;
        let Problem { robot, gait, laws, omega_rad_s } = problem;
        let is_same = known.robot == *robot && known.gait == *gait && known.laws == *laws;
        let is_same = is_same && *known_accuracy <= accuracy;
        is_same.then(|| GaitMetrics { v_m_s: metrics.d_m * omega_rad_s / TAU, ..*metrics })
    }

    /// The solution at hand is that of this problem.
    fn hold(&mut self, problem: &Problem) {
        (self.last, self.start) = (Some(problem.clone()), Some(problem.clone()));
    }

    /// Another solver whose next solution starts where this one's would; of its last solution it has nothing else.
    pub fn successor(&self) -> Self {
        Self {
            last: None,
            start: self.start.clone(),
            last_quadrature: self.last_quadrature.clone(),
            known_of_quadrature: self.known_of_quadrature,
            viscous: self.viscous.successor(),
            dry: self.dry.successor(),
            effort: Effort::default(),
        }
    }

    /// Makes the next solution start from rest; the workspace stays.
    pub fn forget(&mut self) {
        (self.last, self.start, self.last_quadrature) = (None, None, None);
    }

    /// Modulus of the largest Floquet multiplier of the last solution; `None` where the motion
    /// has no states of its own.
    ///
    /// # Errors
    /// There is no last solution, or its linearisation is singular.
    pub fn floquet(&mut self) -> Result<Option<f64>> {
        self.with_last(|method| method.floquet())
    }

    /// Whether the last solution is one of two that are each other's mirror image half a period later,
    /// though the commands are their own.
    ///
    /// # Errors
    /// There is no last solution.
    pub fn is_symmetry_broken(&mut self) -> Result<bool> {
        self.with_last(|method| Ok(method.is_symmetry_broken()))
    }

    /// Whether the last solution is stable, and one of two that are each other's mirror image.
    ///
    /// # Errors
    /// As [`Solver::floquet`].
    pub fn status(&mut self) -> Result<MotionStatus> {
        Ok(MotionStatus::new(self.floquet()?, self.is_symmetry_broken()?))
    }

    /// Derivatives of the last solution's metrics.
    ///
    /// # Errors
    /// As [`Solver::floquet`].
    pub fn derivatives(&mut self) -> Result<Derivatives> {
        self.with_last(|method| method.derivatives(None))
    }

    /// The same, where only those with respect to the parameters that are `wanted` need be there.
    ///
    /// # Errors
    /// As [`Solver::floquet`].
    pub fn derivatives_of(&mut self, wanted: &[Parameter]) -> Result<Derivatives> {
        self.with_last(|method| method.derivatives(Some(wanted)))
    }

    /// Work of the actuators and what friction takes over a cycle of the last solution, J; equal,
    /// up to the accuracy of the solution.
    ///
    /// # Errors
    /// There is no last solution.
    pub fn work_and_loss_j(&mut self) -> Result<[f64; 2]> {
        self.with_last(|method| method.work_and_loss_j())
    }

    /// The latter alone, J.
    ///
    /// # Errors
    /// There is no last solution.
    pub fn loss_j(&mut self) -> Result<f64> {
        self.with_last(|method| method.loss_j())
    }

    /// Derivatives of that work, J per unit of each variable.
    ///
    /// # Errors
    /// As [`Solver::floquet`].
    pub fn work_derivatives(&mut self) -> Result<Derivatives<f64>> {
        self.distance_and_work_derivatives().map(|[_, work]| work)
    }

    /// Derivatives of d alone, m per unit of each variable, and of the work over a cycle, J.
    ///
    /// # Errors
    /// As [`Solver::floquet`].
    pub fn distance_and_work_derivatives(&mut self) -> Result<[Derivatives<f64>; 2]> {
        self.with_last(|method| method.distance_and_work_derivatives())
    }

    /// Takes one more Newton step, with a fresh Jacobian, from the last solution; gives its size
    /// relative to the states, which tells what was left. 0 for a motion without states.
    ///
    /// # Errors
    /// As [`Solver::floquet`].
    pub fn polish(&mut self) -> Result<f64> {
        self.with_last(|method| method.polish())
    }

    /// The last solution at `samples + 1` times of a cycle, the first at phase 0.
    ///
    /// # Errors
    /// There is no last solution, or an element of it cannot be integrated.
    pub fn cycle(&mut self, samples: usize) -> Result<Vec<Sample>> {
        self.with_last(|method| method.cycle(samples))
    }

    /// Integrates the transient from rest and solves for the steady motion in which it ends. The
    /// next solution starts from that one.
    ///
    /// # Errors
    /// The transient cannot be integrated or does not settle.
    pub fn settle(&mut self, problem: &Problem, accuracy: f64) -> Result<Attractor> {
        let first = self.solve(problem, accuracy);
        self.attractor(problem, first, accuracy)
    }

    /// The same where `first` is what [`Solver::solve`] has just given for this problem.
    ///
    /// # Errors
    /// As [`Solver::settle`].
    pub fn attractor(
        &mut self,
        problem: &Problem,
        first: Result<GaitMetrics>,
        accuracy: f64,
    ) -> Result<Attractor> {
        (self.last, self.start) = (None, None);
        let (metrics, cycles, is_found_first) =
            self.with(problem, |method| method.attractor(first, accuracy))?;
        self.hold(problem);
        Ok(Attractor { motion: self.steady_motion(metrics)?, cycles, is_found_first })
    }

    /// All that is reported of the last solution, given its metrics.
    ///
    /// # Errors
    /// As [`Solver::floquet`].
    pub fn steady_motion(&mut self, metrics: GaitMetrics) -> Result<SteadyMotion> {
        let floquet = self.floquet()?;
        let [work_j, _] = self.work_and_loss_j()?;
        let is_symmetry_broken = self.is_symmetry_broken()?;
        Ok(SteadyMotion { metrics, floquet, work_j, is_symmetry_broken })
    }

    /// What the last [`Solver::solve`] took.
    pub fn effort(&self) -> Effort {
        self.effort
    }

    /// Does `task` with the last solution.
    fn with_last<T>(&mut self, task: impl FnOnce(&mut dyn Method) -> Result<T>) -> Result<T> {
        let problem = self.last.clone().ok_or(MotionError::Unsolved)?;
        self.with(&problem, task)
    }

    /// Does `task` with the method for the problem's kind of motion.
    pub(super) fn with<T>(
        &mut self,
        problem: &Problem,
        task: impl FnOnce(&mut dyn Method) -> Result<T>,
    ) -> Result<T> {
        let problem = problem.effective();
        let passive = problem.gait.passive_joint();
        match (problem.gait.joints, problem.laws) {
            ([None, None], _) => Err(MotionError::NotDriven),
            ([Some(joint1), Some(joint2)], laws) if !laws.skids() => {
                let known = &mut self.known_of_quadrature;
                task(&mut Quadrature { problem: &problem, joints: [joint1, joint2], known })
            }
            (_, laws) if !laws.are_linear() => self.dry.with(problem, passive, task),
            _ => self.viscous.with(problem, passive, task),
        }
    }
}

/// Whether a solution of one problem is a start for the other.
fn is_alike(last: &Problem, next: &Problem) -> bool {
    last.gait.passive_joint() == next.gait.passive_joint()
        && last.laws.skids() == next.laws.skids()
        && last.laws.are_linear() == next.laws.are_linear()
}
