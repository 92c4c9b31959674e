//! Problem: a robot, a gait, friction laws and a frequency.

use trilink_robot::{AnyGait, AnyRobot, ChainNumber, JointCommand, Laws, metrics::GaitMetrics};

use super::chain::ChainProblem;
use super::transient::{Frames, Posture};
use super::{Attractor, Result, Sample, Solver, SteadyMotion};

/// Robot with given friction laws and a gait at one frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct Problem {
    pub robot: AnyRobot,
    /// Commands of the driven joints. A joint of a chain without one keeps the command of the chain.
    pub gait: AnyGait,
    pub laws: Laws,
    /// Frequency of the commands, rad/s; positive.
    pub omega_rad_s: f64,
}

impl Problem {
    pub fn new(
        robot: impl Into<AnyRobot>,
        gait: impl Into<AnyGait>,
        laws: Laws,
        omega_rad_s: f64,
    ) -> Self {
        Self { robot: robot.into(), gait: gait.into(), laws, omega_rad_s }
    }

    /// Returns the same problem with the robot as a chain.
    pub(crate) fn as_chain(&self) -> ChainProblem {
        let Self { robot, gait, laws, omega_rad_s } = self;
        ChainProblem { chain: robot.to_chain(gait), laws: *laws, omega_rad_s: *omega_rad_s }
    }

    /// Returns whether the equations have half-period symmetry: the mirror image of a motion, shifted by half a period,
    /// is also a motion.
    pub fn is_mirrored(&self) -> bool {
        self.as_chain().chain.is_mirrored()
    }

    /// Returns whether the no-skid constraints and the commands alone determine the motion (eq. 3 of the paper).
    pub(super) fn is_determined(&self) -> bool {
        self.as_chain().is_determined()
    }

    /// Solves for the steady-state periodic motion to a relative `accuracy` of its metrics, and for its stability. To
    /// solve many problems, use a [`Solver`], which reuses its workspace.
    ///
    /// # Errors
    /// Returns an error if no such motion exists, or if it could not be found or resolved.
    pub fn solve(&self, accuracy: f64) -> Result<SteadyMotion> {
        let mut solver = Solver::default();
        let metrics = solver.solve(self, accuracy)?;
        solver.steady_motion(metrics)
    }

    /// Integrates the transient from rest and solves for the steady-state motion that it reaches.
    ///
    /// # Errors
    /// Returns an error if the problem has no steady-state motion, or if the transient does not settle.
    pub fn settle(&self, accuracy: f64) -> Result<Attractor> {
        Solver::default().settle(self, accuracy)
    }

    /// Samples one cycle of the motion that [`Problem::solve`] finds at `samples + 1` equally spaced times, the first at
    /// phase 0.
    ///
    /// # Errors
    /// Returns an error as [`Problem::solve`] does.
    pub fn cycle(&self, accuracy: f64, samples: usize) -> Result<Vec<Sample>> {
        let mut solver = Solver::default();
        solver.solve(self, accuracy)?;
        solver.cycle(samples)
    }

    /// Returns the result of [`Problem::settle`], and one cycle of this motion as [`Problem::cycle`] samples it.
    ///
    /// # Errors
    /// Returns an error as [`Problem::settle`] does.
    pub fn settled_cycle(&self, accuracy: f64, samples: usize) -> Result<(Attractor, Vec<Sample>)> {
        let mut solver = Solver::default();
        let attractor = solver.settle(self, accuracy)?;
        Ok((attractor, solver.cycle(samples)?))
    }

    /// Returns samples of the first `cycles` cycles from rest at phase 0: `samples` per cycle and one at the end.
    ///
    /// # Errors
    /// Returns an error if the description of the robot is wrong, if the required time step is shorter than the minimum,
    /// or if no motion exists.
    pub fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<Sample>> {
        self.as_chain().checked()?.steady()?.cycles_from_rest(cycles, samples)
    }

    /// Returns the postures at the times `i / rate_hz` within `duration_s` (without its end) from rest at phase 0, with a
    /// relative error per time step near `tolerance`. All friction of the wheels in cycle i is scaled by `friction[i]`;
    /// cycles beyond the slice are unscaled.
    ///
    /// # Errors
    /// Returns an error as [`Problem::cycles_from_rest`] does.
    pub fn varied_transient(
        &self,
        friction: &[f64],
        duration_s: f64,
        rate_hz: f64,
        tolerance: f64,
    ) -> Result<Vec<Posture>> {
        let frames = Frames { friction, duration_s, rate_hz };
        self.as_chain().checked()?.steady()?.transient(&frames, tolerance)
    }

    /// Replaces by NaN the metrics that the robot does not report: for three links, all joint ranges except that of joint
    /// 1.
    pub(super) fn own_metrics(&self, mut metrics: GaitMetrics) -> GaitMetrics {
        if let AnyRobot::ThreeLinks(_) = self.robot {
            metrics.alpha_rad[1..].fill(f64::NAN);
        }
        metrics
    }

    /// Returns the command of a joint's angle, or that of the angle at which its spring is relaxed; `None` for the passive
    /// joint of a robot of three links.
    pub fn command(&self, joint: usize) -> Option<&JointCommand> {
        match (self.gait.joints.get(joint)?, &self.robot) {
            (Some(command), _) => Some(command),
            (None, AnyRobot::ThreeLinks(_)) => None,
            (None, AnyRobot::Chain(chain)) => Some(chain.joints.get(joint)?.command()),
        }
    }

    /// Returns access to the command of [`Problem::command`].
    pub fn command_mut(&mut self, joint: usize) -> Option<&mut JointCommand> {
        match (self.gait.joints.get_mut(joint)?, &mut self.robot) {
            (Some(command), _) => Some(command),
            (None, AnyRobot::ThreeLinks(_)) => None,
            (None, AnyRobot::Chain(chain)) => Some(chain.joints.get_mut(joint)?.command_mut()),
        }
    }

    /// Returns the value of a number of the gait or of a chain, in SI units; `None` if there is no such number.
    pub fn number(&self, number: ChainNumber) -> Option<f64> {
        match number {
            ChainNumber::Command(joint, number) => {
                number.of(&mut self.command(joint)?.clone()).copied()
            }
            _ => self.robot.as_chain()?.number(number),
        }
    }

    /// Returns access to a number of the gait or of a chain, in SI units; `None` if there is no such number.
    pub fn number_mut(&mut self, number: ChainNumber) -> Option<&mut f64> {
        if let ChainNumber::Command(joint, number) = number {
            return number.of(self.command_mut(joint)?);
        }
        match &mut self.robot {
            AnyRobot::ThreeLinks(_) => None,
            AnyRobot::Chain(chain) => chain.number_mut(number),
        }
    }
}
