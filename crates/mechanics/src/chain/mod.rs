//! Motions of chains of two to eight links.
//!
//! In reading order: `plane`, vectors and moving points; `wave`, commands; `cluster`, the links between which all joints
//! are driven; `balance`, the equations of motion; `constraint` and `determined`, wheels that cannot skid; `model`, the states;
//! `response`, their initial guess; `forces`; `derivative`; `solver`.

mod balance;
mod cluster;
mod constraint;
mod derivative;
mod determined;
mod forces;
mod links;
mod model;
mod plane;
mod power;
mod response;
mod solver;
mod wave;

use std::f64::consts::TAU;

use trilink_robot::metrics::{GaitMetrics, MotionStatus, padded};
use trilink_robot::{Chain, ChainError, ChainNumber, Dry, Friction, Joint, Laws, WheelFriction};

pub use derivative::ChainSlopes;
pub use forces::ChainSample;

pub(crate) use self::solver::ChainSolver;

use self::model::Model;
use self::solver::{Kept, Steady};
use crate::branch::{Branch, Sweep};
use crate::cycle::Cycle;
use crate::method::work_and_loss_j;
use crate::orbit::PeriodicOrbit;
use crate::transient::{Frames, Posture};
use crate::{MotionError, Result, SteadyMotion};

/// Chain with given friction laws at one frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainProblem {
    pub chain: Chain,
    pub laws: Laws,
    pub omega_rad_s: f64,
}

/// Metrics of a steady-state motion of a chain.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainMetrics {
    /// Displacement of the reference link per cycle, m.
    pub d_m: f64,
    /// Mean speed `d omega / (2 pi)`, m/s.
    pub v_m_s: f64,
    /// Rotation per cycle, rad.
    pub dtheta_rad: f64,
    /// Skid ratios (eq. 20 of the paper), by link from front to rear; NaN for a link without a wheel.
    pub sigma: Vec<f64>,
    /// Half the range of each joint's angle, from front to rear, rad.
    pub alpha_rad: Vec<f64>,
}

/// Steady-state periodic motion of a chain.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainMotion {
    pub metrics: ChainMetrics,
    /// Modulus of the largest Floquet multiplier; `None` if the constraints and commands alone determine the motion.
    pub floquet: Option<f64>,
    /// Work of the actuators of all joints and rotors over a cycle, J.
    pub work_j: f64,
    /// Energy dissipated over a cycle, J; equal to the work up to the accuracy of the solution.
    pub loss_j: f64,
    /// Whether the motion lacks the half-period symmetry of the commands and is therefore one of a mirror-image pair.
    pub is_symmetry_broken: bool,
}

impl ChainMetrics {
    /// Returns the metrics with the skid ratios by the numbers of the links ([`Chain::numbering`]).
    pub fn by_number(&self, chain: &Chain) -> GaitMetrics {
        let sigma: Vec<f64> = chain.numbering().into_iter().map(|link| self.sigma[link]).collect();
        GaitMetrics {
            d_m: self.d_m,
            v_m_s: self.v_m_s,
            sigma: padded(&sigma),
            alpha_rad: padded(&self.alpha_rad),
            dtheta_rad: self.dtheta_rad,
        }
    }
}

impl ChainMotion {
    /// Returns the motion with the skid ratios by the numbers of the links ([`Chain::numbering`]).
    pub fn by_number(&self, chain: &Chain) -> SteadyMotion {
        let Self { floquet, work_j, is_symmetry_broken, .. } = *self;
        let metrics = self.metrics.by_number(chain);
        SteadyMotion { metrics, floquet, work_j, is_symmetry_broken }
    }

    /// Returns whether the motion is stable, and whether it is one of a mirror-image pair.
    pub fn status(&self) -> MotionStatus {
        MotionStatus::new(self.floquet, self.is_symmetry_broken)
    }
}

/// Motion of a chain that is reached from rest.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainAttractor {
    pub motion: ChainMotion,
    /// Number of cycles after which the state at the end of each cycle stays within 1 % of its steady-state value.
    pub cycles: usize,
    /// Whether the attractor is the solution that [`ChainProblem::solve`] finds.
    pub is_found_by_solve: bool,
}

/// Returns the motion of the last solution, given its measurements.
fn motion_of<const N: usize, const C: usize, const D: usize, F: Friction>(
    model: &Model<N, C, D, F>,
    orbit: &mut PeriodicOrbit<N, Model<N, C, D, F>>,
    cycle: &Cycle<N>,
) -> Result<ChainMotion> {
    let [work_j, loss_j] = work_and_loss_j(model, &orbit.mesh);
    let floquet = if model.problem.is_determined() { None } else { Some(orbit.floquet(model)?) };
    let is_symmetry_broken = orbit.is_symmetry_broken;
    let metrics = metrics_of(model, cycle);
    Ok(ChainMotion { metrics, floquet, work_j, loss_j, is_symmetry_broken })
}

/// Returns the metrics of a motion, given its measurements.
fn metrics_of<const N: usize, const C: usize, const D: usize, F: Friction>(
    model: &Model<N, C, D, F>,
    cycle: &Cycle<N>,
) -> ChainMetrics {
    let ChainProblem { chain, omega_rad_s, .. } = &model.problem;
    let clusters = &model.system.clusters.all;
    let mut wheels = cycle.sigma.iter();
    let sigma = chain.links.iter().map(|link| match link.wheel {
        Some(_) => wheels.next().copied().unwrap_or(f64::NAN),
        None => f64::NAN,
    });
    let alpha_rad = chain.joints.iter().enumerate().map(|(j, joint)| match joint {
        Joint::Driven(command) => command.half_range_rad(),
        Joint::Free(_) => {
            let free = clusters[1..].iter().position(|cluster| cluster.joint == j);
            free.map_or(f64::NAN, |index| cycle.alpha_rad[index])
        }
    });
    ChainMetrics {
        d_m: cycle.d_m,
        v_m_s: cycle.d_m * omega_rad_s / TAU,
        dtheta_rad: cycle.dtheta_rad,
        sigma: sigma.collect(),
        alpha_rad: alpha_rad.collect(),
    }
}

impl ChainProblem {
    /// Solves for the steady-state periodic motion to a relative `accuracy` of its metrics, and for its stability.
    ///
    /// # Errors
    /// Returns an error if the description of the chain is wrong, if no such motion exists, or if it could not be found
    /// or resolved.
    pub fn solve(&self, accuracy: f64) -> Result<ChainMotion> {
        self.solved(accuracy)?.motion()
    }

    /// Integrates the transient from rest and solves for the steady-state motion that it reaches.
    ///
    /// # Errors
    /// Returns an error as [`ChainProblem::solve`] does, or if the transient does not settle.
    pub fn settle(&self, accuracy: f64) -> Result<ChainAttractor> {
        self.solve_and_settle(accuracy).1
    }

    /// Returns the results of [`ChainProblem::solve`] and [`ChainProblem::settle`], solving only once.
    pub fn solve_and_settle(&self, accuracy: f64) -> (Result<ChainMotion>, Result<ChainAttractor>) {
        let mut solver = ChainSolver::default();
        let first = solver.solve(self, accuracy).and_then(|_| solver.motion());
        let attractor = solver.attractor(self, first.is_ok(), accuracy);
        (first, attractor)
    }

    /// Samples one cycle of the steady-state motion at `samples + 1` equally spaced times, the first at phase 0.
    ///
    /// # Errors
    /// Returns an error as [`ChainProblem::solve`] does.
    pub fn cycle(&self, accuracy: f64, samples: usize) -> Result<Vec<ChainSample>> {
        self.solved(accuracy)?.cycle(samples)
    }

    /// Returns samples of the first `cycles` cycles from rest at phase 0: `samples` per cycle and one at the end.
    ///
    /// # Errors
    /// Returns an error if the description of the chain is wrong, or if the motion cannot be integrated.
    pub fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<ChainSample>> {
        self.checked()?.steady::<Dry>()?.cycles_from_rest(cycles, samples)
    }

    /// Returns the motion from rest as [`AnyProblem::varied_transient`](crate::AnyProblem::varied_transient) does.
    pub(crate) fn transient(&self, frames: &Frames, tolerance: f64) -> Result<Vec<Posture>> {
        self.checked()?.steady::<Dry>()?.transient(frames, tolerance)
    }

    /// Solves for the steady-state motion as [`ChainProblem::solve`] does, and for its derivatives with respect to
    /// numbers of the chain, in SI units.
    ///
    /// # Errors
    /// Returns an error as [`ChainProblem::solve`] does, or if the chain does not have one of the numbers.
    pub fn derivatives(
        &self,
        accuracy: f64,
        numbers: &[ChainNumber],
    ) -> Result<(ChainMotion, Vec<ChainSlopes>)> {
        let mut solver = self.solved(accuracy)?;
        Ok((solver.motion()?, solver.slopes(numbers)?))
    }

    /// Traces branches as [`branches`](crate::branches) does. This problem is the one at the lower end of the parameter
    /// range; in the problems that `problem_at` returns, the coefficients that the friction laws do not use are zero.
    pub(crate) fn branches(
        &self,
        problem_at: &dyn Fn(f64) -> Self,
        sweep: &Sweep,
    ) -> Result<Vec<Branch>> {
        self.checked()?.steady::<Dry>()?.branches(problem_at, sweep)
    }

    fn solved(&self, accuracy: f64) -> Result<ChainSolver> {
        let mut solver = ChainSolver::default();
        solver.solve(self, accuracy)?;
        Ok(solver)
    }

    /// Returns whether constraints and commands alone determine the motion: it has no state of its own.
    pub(crate) fn is_determined(&self) -> bool {
        !self.laws.skids() && self.chain.free_joints() == 0 && self.chain.wheels() >= 3
    }

    /// Returns the problem with changed friction coefficients of the wheels.
    fn with_friction(&self, change: impl Fn(WheelFriction) -> WheelFriction) -> Self {
        let mut problem = self.clone();
        for wheel in problem.chain.links.iter_mut().filter_map(|link| link.wheel.as_mut()) {
            wheel.friction = change(wheel.friction);
        }
        problem
    }

    pub(crate) fn with_transition_scaled(&self, factor: f64) -> Self {
        self.with_friction(|wheel| WheelFriction {
            transition_m_s: factor * wheel.transition_m_s,
            ..wheel
        })
    }

    fn with_friction_scaled(&self, factor: f64) -> Self {
        self.with_friction(|wheel| wheel.scaled(factor))
    }

    /// Returns the problem with the coefficients that its friction laws do not use set to zero.
    pub(super) fn effective(&self) -> Self {
        self.with_friction(|wheel| wheel.effective(self.laws))
    }

    /// Returns the problem with the coefficients that its friction laws do not use set to zero, if it can have a
    /// steady-state motion.
    fn checked(&self) -> Result<Self> {
        self.chain.check()?;
        if !(self.omega_rad_s > 0.0 && self.omega_rad_s.is_finite()) {
            return Err(ChainError::Frequency(self.omega_rad_s.to_string()).into());
        }
        if !self.chain.is_driven() {
            return Err(MotionError::NotDriven);
        }
        let problem = self.effective();
        if self.laws.skids() && !problem.chain.is_resisted() {
            return Err(MotionError::NotResisted);
        }
        let free = problem.chain.free_joints();
        let wheels = problem.chain.wheels();
        if !self.laws.skids() && wheels > 3 + free {
            return Err(MotionError::Overconstrained { wheels, velocities: 3 + free });
        }
        Ok(problem)
    }

    /// Returns the equations of motion for the number of free joints, under the friction law `F`.
    fn steady<F: Friction>(self) -> Result<Box<dyn Steady>> {
        match self.chain.free_joints() {
            0 => Kept::<3, 1, 3, F>::boxed(self),
            1 => Kept::<5, 2, 4, F>::boxed(self),
            2 => Kept::<7, 3, 5, F>::boxed(self),
            3 => Kept::<9, 4, 6, F>::boxed(self),
            4 => Kept::<11, 5, 7, F>::boxed(self),
            5 => Kept::<13, 6, 8, F>::boxed(self),
            6 => Kept::<15, 7, 9, F>::boxed(self),
            _ => Kept::<17, 8, 10, F>::boxed(self),
        }
    }
}
