//! Motions of chains of two to eight links.
//!
//! In reading order: `plane`, vectors and moving points; `wave`, commands; `cluster`, the links between which all joints
//! are driven; `balance`, the equations of motion; `constraint` and `determined`, wheels that cannot skid; `model`, the states;
//! `response`, their initial guess; `links` and `power`, forces on the single links; `forces`; `derivative`; `steady`, the
//! equations behind one interface for all numbers of states.

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
mod steady;
mod wave;

use std::f64::consts::TAU;

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{
    Chain, ChainError, Dry, Friction, Joint, Laws, MAX_JOINTS, MAX_LINKS, WheelFriction,
};

pub(crate) use self::derivative::Slopes;
pub(crate) use self::steady::Steady;

use self::model::Model;
use self::steady::Kept;
use crate::cycle::Cycle;
use crate::{MotionError, Result};

/// Chain, with the commands of its joints, and friction laws at one frequency.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ChainProblem {
    pub chain: Chain,
    pub laws: Laws,
    pub omega_rad_s: f64,
}

/// Returns the metrics of a motion, given its measurements.
fn metrics_of<const N: usize, const C: usize, const D: usize, F: Friction>(
    model: &Model<N, C, D, F>,
    cycle: &Cycle,
) -> GaitMetrics {
    let ChainProblem { chain, omega_rad_s, .. } = &model.problem;
    let mut alpha_rad = [f64::NAN; MAX_JOINTS];
    for (alpha_rad, joint) in alpha_rad.iter_mut().zip(&chain.joints) {
        if let Joint::Driven(command) = joint {
            *alpha_rad = command.half_range_rad();
        }
    }
    for (cluster, measured) in model.system.clusters.all[1..].iter().zip(&cycle.alpha_rad) {
        alpha_rad[cluster.joint] = *measured;
    }
    GaitMetrics {
        d_m: cycle.d_m,
        v_m_s: cycle.d_m * omega_rad_s / TAU,
        sigma: in_link_order(model, &cycle.sigma),
        alpha_rad,
        dtheta_rad: cycle.dtheta_rad,
    }
}

/// Returns values of the wheels, which are given from front to rear, by the numbers of their links
/// ([`Chain::numbering`]); NaN for a link without a wheel.
fn in_link_order<const N: usize, const C: usize, const D: usize, F: Friction>(
    model: &Model<N, C, D, F>,
    of_wheels: &[f64],
) -> [f64; MAX_LINKS] {
    let mut values = [f64::NAN; MAX_LINKS];
    for ((_, link, _), value) in model.system.wheels.iter().zip(of_wheels) {
        values[number_of(&model.problem.chain, *link)] = *value;
    }
    values
}

/// Returns the number of a link ([`Chain::numbering`]), given its index from front to rear.
fn number_of(chain: &Chain, link: usize) -> usize {
    match link.cmp(&chain.reference) {
        std::cmp::Ordering::Less => link + 1,
        std::cmp::Ordering::Equal => 0,
        std::cmp::Ordering::Greater => link,
    }
}

impl ChainProblem {
    /// Returns whether constraints and commands alone determine the motion: it has no state of its own.
    pub(crate) fn is_determined(&self) -> bool {
        !self.laws.skids() && self.chain.free_joints() == 0 && self.chain.wheels() >= 3
    }

    /// Returns the problem with changed friction coefficients of the wheels.
    fn with_friction(mut self, change: impl Fn(WheelFriction) -> WheelFriction) -> Self {
        for wheel in self.chain.links.iter_mut().filter_map(|link| link.wheel.as_mut()) {
            wheel.friction = change(wheel.friction);
        }
        self
    }

    pub(crate) fn with_transition_scaled(&self, factor: f64) -> Self {
        self.clone().with_friction(|wheel| WheelFriction {
            transition_m_s: factor * wheel.transition_m_s,
            ..wheel
        })
    }

    fn with_friction_scaled(&self, factor: f64) -> Self {
        self.clone().with_friction(|wheel| wheel.scaled(factor))
    }

    /// Returns the problem with the coefficients that its friction laws do not use set to zero.
    pub(crate) fn effective(self) -> Self {
        let laws = self.laws;
        self.with_friction(|wheel| wheel.effective(laws))
    }

    /// Returns the problem with the coefficients that its friction laws do not use set to zero, if it can have a
    /// steady-state motion.
    pub(crate) fn checked(self) -> Result<Self> {
        self.chain.check()?;
        if !(self.omega_rad_s > 0.0 && self.omega_rad_s.is_finite()) {
            return Err(ChainError::Frequency(self.omega_rad_s.to_string()).into());
        }
        if !self.chain.is_driven() {
            return Err(MotionError::NotDriven);
        }
        let problem = self.effective();
        if problem.laws.skids() && !problem.chain.is_resisted() {
            return Err(MotionError::NotResisted);
        }
        let free = problem.chain.free_joints();
        let wheels = problem.chain.wheels();
        if !problem.laws.skids() && wheels > 3 + free {
            return Err(MotionError::Overconstrained { wheels, velocities: 3 + free });
        }
        Ok(problem)
    }

    /// Returns the equations of motion under the friction laws of the problem; see [`ChainProblem::steady_with`].
    pub(crate) fn steady(self) -> Result<Box<dyn Steady>> {
        self.steady_with::<Dry>()
    }

    /// Returns the equations of motion for the number of free joints, under the friction law `F`.
    pub(crate) fn steady_with<F: Friction>(self) -> Result<Box<dyn Steady>> {
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

#[cfg(test)]
mod tests;
