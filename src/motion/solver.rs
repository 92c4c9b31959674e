//! Steady motions one after the other, each from the last and in the same room.

use std::f64::consts::TAU;

use super::reduced::{Derivatives, KinematicSkid, PassiveNoSkid, PassiveSkid};
use super::ring::Ring;
use super::task::{Differentiate, Floquet, Polish, SampleCycle, Settle, Solve, Task, WorkAndLoss};
use super::trajectory::Sample;
use super::{MotionError, Problem, SteadyMotion};
use crate::metrics::GaitMetrics;
use crate::robot::Parameter;

/// Solves for steady motions. A solution starts from the last one if that was of the same
/// kind of motion (the same passive joint, skidding or not), else from rest.
#[derive(Debug, Clone, Default)]
pub struct Solver {
    last: Option<Problem>,
    /// What the last motion that eq. 3 gives was driven by, and its metrics.
    by_eq_3: Option<(Problem, GaitMetrics)>,
    kinematic_skid: Ring<3, KinematicSkid>,
    passive_skid: Ring<5, PassiveSkid>,
    passive_no_skid: Ring<2, PassiveNoSkid>,
    newton_steps: usize,
}

/// The steady motion in which the robot from rest ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settled {
    pub motion: SteadyMotion,
    /// Cycles after which the state at the end of every cycle stays within 1 % of the steady
    /// one.
    pub cycles: usize,
    /// Whether it is the solution that [`Solver::solve`] finds.
    pub is_found_first: bool,
}

impl Settled {
    /// Where the robot from rest ends, seen from the solution that [`Solver::solve`] finds:
    /// `reached`, `another` or `unsettled`.
    pub fn from_rest(settled: &Result<Self, MotionError>) -> &'static str {
        from_rest(settled.as_ref().ok().map(|settled| settled.is_found_first))
    }
}

/// The words of [`Settled::from_rest`], where nothing is known of a robot that does not settle.
fn from_rest(is_found_first: Option<bool>) -> &'static str {
    match is_found_first {
        Some(true) => "reached",
        Some(false) => "another",
        None => "unsettled",
    }
}

impl Solver {
    /// Solves for the steady periodic motion to a relative `accuracy` of its metrics.
    ///
    /// # Errors
    /// There is no such motion, or it could not be found or resolved.
    pub fn solve(&mut self, problem: &Problem, accuracy: f64) -> Result<GaitMetrics, MotionError> {
        let goes_on = self.last.take().is_some_and(|last| is_alike(&last, problem));
        let metrics = match self.known_by_eq_3(problem) {
            Some(metrics) => metrics,
            None => self.dispatch(problem, Solve { goes_on, accuracy })?,
        };
        if problem.is_determined() {
            self.by_eq_3 = Some((problem.clone(), metrics));
        }
        self.last = Some(problem.clone());
        Ok(metrics)
    }

    /// The metrics of a motion that eq. 3 gives, from another of the same robot and gait: the
    /// frequency changes nothing but the speed.
    fn known_by_eq_3(&self, problem: &Problem) -> Option<GaitMetrics> {
        let (known, metrics) = self.by_eq_3.as_ref()?;
        let Problem { robot, gait, model, omega_rad_s } = problem;
        let is_same = known.robot == *robot && known.gait == *gait && known.model == *model;
        is_same.then(|| GaitMetrics { v_m_s: metrics.d_m * omega_rad_s / TAU, ..*metrics })
    }

    /// Makes the next solution start from rest; the room stays.
    pub fn forget(&mut self) {
        self.last = None;
    }

    /// Modulus of the largest Floquet multiplier of the last solution; `None` where the motion
    /// has no states of its own.
    ///
    /// # Errors
    /// There is no last solution, or its linearisation is singular.
    pub fn floquet(&mut self) -> Result<Option<f64>, MotionError> {
        let problem = self.last.clone().ok_or(MotionError::Unsolved)?;
        self.dispatch(&problem, Floquet)
    }

    /// Derivatives of the last solution's metrics.
    ///
    /// # Errors
    /// As [`Solver::floquet`].
    pub fn derivatives(&mut self) -> Result<Derivatives, MotionError> {
        let problem = self.last.clone().ok_or(MotionError::Unsolved)?;
        self.dispatch(&problem, Differentiate { wanted: None })
    }

    /// The same, where only the derivatives by the parameters that are `wanted` need be there.
    ///
    /// # Errors
    /// As [`Solver::floquet`].
    pub fn derivatives_by(&mut self, wanted: &[Parameter]) -> Result<Derivatives, MotionError> {
        let problem = self.last.clone().ok_or(MotionError::Unsolved)?;
        self.dispatch(&problem, Differentiate { wanted: Some(wanted) })
    }

    /// Work of the actuators and what friction takes over a cycle of the last solution, J; equal,
    /// up to the accuracy of the solution.
    ///
    /// # Errors
    /// There is no last solution.
    pub fn work_and_loss_j(&mut self) -> Result<[f64; 2], MotionError> {
        let problem = self.last.clone().ok_or(MotionError::Unsolved)?;
        self.dispatch(&problem, WorkAndLoss)
    }

    /// Takes one more Newton step, with a fresh Jacobian, from the last solution; gives its size
    /// relative to the states, which tells what was left. 0 for a motion without states.
    ///
    /// # Errors
    /// As [`Solver::floquet`].
    pub fn polish(&mut self) -> Result<f64, MotionError> {
        let problem = self.last.clone().ok_or(MotionError::Unsolved)?;
        self.dispatch(&problem, Polish)
    }

    /// Follows the motion from rest and solves for the steady motion in which it ends. The
    /// next solution starts from that one.
    ///
    /// # Errors
    /// The motion cannot be followed or does not settle.
    pub fn settle(&mut self, problem: &Problem, accuracy: f64) -> Result<Settled, MotionError> {
        let solved = self.solve(problem, accuracy);
        let (metrics, cycles, is_found_first) =
            self.dispatch(problem, Settle { solved, accuracy })?;
        self.last = Some(problem.clone());
        Ok(Settled { motion: self.motion(metrics)?, cycles, is_found_first })
    }

    /// Where the robot from rest ends, seen from the last solution, the metrics of which these
    /// are, in the words of [`Settled::from_rest`]. The next solution starts from there.
    pub fn from_rest(&mut self, metrics: GaitMetrics, accuracy: f64) -> &'static str {
        let arrived = self.last.take().and_then(|problem| {
            let task = Settle { solved: Ok(metrics), accuracy };
            let (_, _, is_found_first) = self.dispatch(&problem, task).ok()?;
            self.last = Some(problem);
            Some(is_found_first)
        });
        from_rest(arrived)
    }

    /// The last solution at `samples + 1` moments of a cycle, the first at phase 0.
    ///
    /// # Errors
    /// There is no last solution, or an element of it cannot be followed.
    pub fn cycle(&mut self, samples: usize) -> Result<Vec<Sample>, MotionError> {
        let problem = self.last.clone().ok_or(MotionError::Unsolved)?;
        self.dispatch(&problem, SampleCycle { samples })
    }

    /// All that is reported of the last solution, given its metrics.
    pub(super) fn motion(&mut self, metrics: GaitMetrics) -> Result<SteadyMotion, MotionError> {
        let floquet = self.floquet()?;
        let [work_j, _] = self.work_and_loss_j()?;
        Ok(SteadyMotion { metrics, floquet, work_j, newton_steps: self.newton_steps })
    }

    /// Newton steps of the last solution.
    pub fn newton_steps(&self) -> usize {
        self.newton_steps
    }

    /// Does `task` with the ring of the problem's kind.
    pub(super) fn dispatch<T: Task>(
        &mut self,
        problem: &Problem,
        task: T,
    ) -> Result<T::Output, MotionError> {
        let driven = problem.driven();
        match problem.gait.joints {
            [Some(joint1), Some(joint2)] if !driven.model_skids => {
                self.newton_steps = 0;
                task.quadrature(&driven, [joint1, joint2])
            }
            [Some(_), Some(_)] => {
                let model = KinematicSkid(driven.clone());
                let done = task.ring(&model, &driven, &mut self.kinematic_skid);
                self.newton_steps = self.kinematic_skid.steps();
                done
            }
            [None, None] => Err(MotionError::NotDriven),
            [first, _] => {
                let passive = if first.is_none() { 0 } else { 1 };
                if driven.model_skids {
                    let model = PassiveSkid { driven: driven.clone(), passive };
                    let done = task.ring(&model, &driven, &mut self.passive_skid);
                    self.newton_steps = self.passive_skid.steps();
                    return done;
                }
                let model = PassiveNoSkid { driven: driven.clone(), passive };
                let done = task.ring(&model, &driven, &mut self.passive_no_skid);
                self.newton_steps = self.passive_no_skid.steps();
                done
            }
        }
    }
}

/// Whether a solution of one problem is a start for the other.
fn is_alike(last: &Problem, next: &Problem) -> bool {
    last.gait.passive_joint() == next.gait.passive_joint()
        && last.model.skids() == next.model.skids()
}
