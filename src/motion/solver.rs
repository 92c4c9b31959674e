//! Steady motions one after the other, each from the last and in the same room.

use std::f64::consts::TAU;

use super::element::rate;
use super::forces::actions;
use super::kinematic;
use super::radau::{RADAU, STAGES};
use super::reduced::{Driven, KinematicSkid, Parameter, PassiveNoSkid, PassiveSkid, Reduced};
use super::ring::{Ring, Start};
use super::sensitivity::differentiate;
use super::settle::settle;
use super::trajectory::{self, Sample};
use super::transient::{self, Follower, Transient};
use super::{MotionError, Problem, SteadyMotion};
use crate::metrics::GaitMetrics;
use crate::robot::JointCommand;

/// Derivatives of the metrics by every [`Parameter`], in the order of [`Parameter::ALL`].
pub type Derivatives = [GaitMetrics; Parameter::ALL.len()];

/// Solves for steady motions. A solution starts from the last one if that was of the same
/// kind of motion (the same passive joint, skidding or not), else from rest.
#[derive(Debug, Clone, Default)]
pub struct Solver {
    last: Option<Problem>,
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
        match settled {
            Ok(settled) if settled.is_found_first => "reached",
            Ok(_) => "another",
            Err(_) => "unsettled",
        }
    }
}

/// Cycles after which a robot that started from rest is near its steady motion.
const SETTLING_CYCLES: f64 = 40.0;
const SETTLING_TOLERANCE: f64 = 1e-4;

impl Solver {
    /// Solves for the steady periodic motion to a relative `accuracy` of its metrics.
    ///
    /// # Errors
    /// There is no such motion, or it could not be found or resolved.
    pub fn solve(&mut self, problem: &Problem, accuracy: f64) -> Result<GaitMetrics, MotionError> {
        let goes_on = self.last.take().is_some_and(|last| is_alike(&last, problem));
        let start = if goes_on { Goes::On } else { Goes::FromRest };
        let metrics = self.dispatch(problem, Solve { start, accuracy })?;
        self.last = Some(problem.clone());
        Ok(metrics)
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
        let problem = self.last.clone().ok_or(MotionError::NotDriven)?;
        self.dispatch(&problem, Floquet)
    }

    /// Derivatives of the last solution's metrics, per unit of each parameter; those by
    /// parameters that the model does not know are zero.
    ///
    /// # Errors
    /// As [`Solver::floquet`].
    pub fn derivatives(&mut self) -> Result<Derivatives, MotionError> {
        let problem = self.last.clone().ok_or(MotionError::NotDriven)?;
        self.dispatch(&problem, Differentiate)
    }

    /// Work of the actuators and what friction takes over a cycle of the last solution, J; equal,
    /// up to the accuracy of the solution.
    ///
    /// # Errors
    /// There is no last solution.
    pub fn work_and_loss_j(&mut self) -> Result<[f64; 2], MotionError> {
        let problem = self.last.clone().ok_or(MotionError::NotDriven)?;
        self.dispatch(&problem, WorkAndLoss)
    }

    /// Takes one more Newton step, with a fresh Jacobian, from the last solution; gives its size
    /// relative to the states, which tells what was left. 0 for a motion without states.
    ///
    /// # Errors
    /// As [`Solver::floquet`].
    pub fn polish(&mut self) -> Result<f64, MotionError> {
        let problem = self.last.clone().ok_or(MotionError::NotDriven)?;
        self.dispatch(&problem, Polish)
    }

    /// Follows the motion from rest and solves for the steady motion in which it ends. The
    /// next solution starts from that one.
    ///
    /// # Errors
    /// The motion cannot be followed or does not settle.
    pub fn settle(&mut self, problem: &Problem, accuracy: f64) -> Result<Settled, MotionError> {
        let is_solved = self.solve(problem, accuracy).is_ok();
        let (metrics, cycles, is_found_first) =
            self.dispatch(problem, Settle { is_solved, accuracy })?;
        self.last = Some(problem.clone());
        Ok(Settled { motion: self.motion(metrics)?, cycles, is_found_first })
    }

    /// The last solution at `samples + 1` moments of a cycle, the first at phase 0.
    ///
    /// # Errors
    /// There is no last solution, or an element of it cannot be followed.
    pub fn cycle(&mut self, samples: usize) -> Result<Vec<Sample>, MotionError> {
        let problem = self.last.clone().ok_or(MotionError::NotDriven)?;
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

/// Something to do with a motion, of whatever kind it is.
pub(super) trait Task {
    type Output;

    /// For motions that are solutions of differential equations.
    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<Self::Output, MotionError>;

    /// For motions that eq. 3 gives.
    fn quadrature(
        self,
        driven: &Driven,
        joints: [JointCommand; 2],
    ) -> Result<Self::Output, MotionError>;
}

#[derive(Clone, Copy, PartialEq)]
enum Goes {
    On,
    FromRest,
}

struct Solve {
    start: Goes,
    accuracy: f64,
}

impl Task for Solve {
    type Output = GaitMetrics;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<GaitMetrics, MotionError> {
        let (omega_rad_s, accuracy) = (driven.omega_rad_s, self.accuracy);
        let near = match self.start {
            Goes::On => ring.solve(model, omega_rad_s, Start::Last, accuracy).is_ok(),
            Goes::FromRest => false,
        };
        if !near && let Err(error) = ring.solve(model, omega_rad_s, Start::Rest, accuracy) {
            let mut room = ring.take_room();
            let mut follower = Follower::new(model, driven, SETTLING_TOLERANCE);
            let duration_s = SETTLING_CYCLES * TAU / omega_rad_s;
            let followed = follower.advance_to(duration_s, &mut room, |_| {});
            ring.give_room(room);
            followed.map_err(|_| error)?;
            ring.solve(model, omega_rad_s, Start::State(follower.state), accuracy)?;
        }
        Ok(ring.measure(model, driven).metrics)
    }

    fn quadrature(
        self,
        driven: &Driven,
        joints: [JointCommand; 2],
    ) -> Result<GaitMetrics, MotionError> {
        kinematic::solve(&driven.robot, joints, driven.omega_rad_s)
    }
}

struct Floquet;

impl Task for Floquet {
    type Output = Option<f64>;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        _driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<Option<f64>, MotionError> {
        ring.floquet(model).map(Some)
    }

    fn quadrature(
        self,
        _driven: &Driven,
        _joints: [JointCommand; 2],
    ) -> Result<Option<f64>, MotionError> {
        Ok(None)
    }
}

struct Differentiate;

impl Task for Differentiate {
    type Output = Derivatives;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<Derivatives, MotionError> {
        let cycle = ring.measure(model, driven);
        let mut room = ring.take_room();
        let derivatives = differentiate(model, driven, ring, &cycle, &mut room);
        ring.give_room(room);
        derivatives
    }

    fn quadrature(
        self,
        driven: &Driven,
        joints: [JointCommand; 2],
    ) -> Result<Derivatives, MotionError> {
        let mut derivatives = [GaitMetrics::NONE; Parameter::ALL.len()];
        for (derivative, parameter) in derivatives.iter_mut().zip(Parameter::ALL) {
            if let Parameter::Amplitude(joint) = parameter {
                *derivative =
                    kinematic::by_amplitude(&driven.robot, joints, driven.omega_rad_s, joint)?;
            }
        }
        Ok(derivatives)
    }
}

struct WorkAndLoss;

impl Task for WorkAndLoss {
    type Output = [f64; 2];

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<[f64; 2], MotionError> {
        let weights = RADAU.integrate[STAGES - 1];
        let turns = if ring.is_half() { 2.0 } else { 1.0 };
        let (mut work, mut loss) = (0.0, 0.0);
        for k in 0..ring.len() {
            let (nodes, start, stages) = ring.element(k);
            for j in 0..STAGES {
                let dy = rate(&RADAU, start, stages, j, 1.0 / ring.element_s());
                let moment = model.moment(&nodes[j], &stages[j]);
                let acceleration = model.acceleration(&nodes[j], &stages[j], &dy);
                let actions = actions(driven, &moment, &acceleration);
                let weight = turns * ring.element_s() * weights[j];
                work += weight * actions.power_w;
                loss += weight * actions.loss_w;
            }
        }
        Ok([work, loss])
    }

    fn quadrature(
        self,
        driven: &Driven,
        joints: [JointCommand; 2],
    ) -> Result<[f64; 2], MotionError> {
        kinematic::work_and_loss_j(driven, joints)
    }
}

struct Polish;

impl Task for Polish {
    type Output = f64;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        _driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<f64, MotionError> {
        ring.polish(model)
    }

    fn quadrature(self, _driven: &Driven, _joints: [JointCommand; 2]) -> Result<f64, MotionError> {
        Ok(0.0)
    }
}

/// Gives the metrics, the cycles that it took, and whether it is the ring's solution.
struct Settle {
    /// Whether the ring holds a solution.
    is_solved: bool,
    accuracy: f64,
}

impl Task for Settle {
    type Output = (GaitMetrics, usize, bool);

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<Self::Output, MotionError> {
        let mut room = ring.take_room();
        let arrival = settle(model, driven, ring, self.is_solved, self.accuracy, &mut room);
        ring.give_room(room);
        let arrival = arrival?;
        let start = Start::State(arrival.state);
        ring.solve(model, driven.omega_rad_s, start, self.accuracy)?;
        let metrics = ring.measure(model, driven).metrics;
        Ok((metrics, arrival.cycles, arrival.is_known))
    }

    fn quadrature(
        self,
        driven: &Driven,
        joints: [JointCommand; 2],
    ) -> Result<Self::Output, MotionError> {
        Ok((kinematic::solve(&driven.robot, joints, driven.omega_rad_s)?, 0, true))
    }
}

struct SampleCycle {
    samples: usize,
}

impl Task for SampleCycle {
    type Output = Vec<Sample>;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<Vec<Sample>, MotionError> {
        trajectory::cycle(model, driven, ring, self.samples)
    }

    fn quadrature(
        self,
        driven: &Driven,
        joints: [JointCommand; 2],
    ) -> Result<Vec<Sample>, MotionError> {
        kinematic::samples(driven, joints, 1, self.samples)
    }
}

/// Samples from rest, see [`Problem::from_rest`].
pub(super) struct SampleFromRest {
    pub cycles: usize,
    pub samples: usize,
}

impl Task for SampleFromRest {
    type Output = Vec<Sample>;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        _ring: &mut Ring<N, R>,
    ) -> Result<Vec<Sample>, MotionError> {
        trajectory::from_rest(model, driven, self.cycles, self.samples)
    }

    fn quadrature(
        self,
        driven: &Driven,
        joints: [JointCommand; 2],
    ) -> Result<Vec<Sample>, MotionError> {
        kinematic::samples(driven, joints, self.cycles, self.samples)
    }
}

/// The path from rest, see [`Problem::follow`].
pub(super) struct Follow {
    pub duration_s: f64,
    pub tolerance: f64,
}

impl Task for Follow {
    type Output = Transient;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        _ring: &mut Ring<N, R>,
    ) -> Result<Transient, MotionError> {
        transient::follow(model, driven, self.duration_s, self.tolerance)
    }

    fn quadrature(
        self,
        _driven: &Driven,
        _joints: [JointCommand; 2],
    ) -> Result<Transient, MotionError> {
        Err(MotionError::NotDriven)
    }
}
