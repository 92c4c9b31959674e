//! Model of servos with lag and compliance.

use std::f64::consts::TAU;

use nalgebra::Complex;
use serde::Serialize;
use trilink_mechanics::{MotionError, Problem, REFERENCE_ACCURACY, Sample, Solver};
use trilink_robot::{JointCommand, MAX_JOINTS, SecondHarmonic};

/// Servo with lag and compliance. The complex amplitude of the n-th harmonic of the joint angle is
///
/// ```text
/// phi_n = command_n / (1 + i n omega lag) - compliance torque_n
/// ```
///
/// and the mean angle is the mean command minus the compliance times the mean torque. If lag and compliance are zero,
/// the servo follows its command exactly.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Servo {
    /// Time constant of the first-order lag, s.
    pub lag_s: f64,
    /// Deflection per unit of the joint's torque in the steady-state motion, rad/(N m).
    pub compliance_rad_nm: f64,
}

/// Number of samples per cycle from which the mean and harmonics of a torque are computed.
const SAMPLES: usize = 240;
/// Number of fixed-point iterations between gait and torque; each reduces the error to a few hundredths of its size.
const ITERATIONS: usize = 8;

impl Servo {
    /// Returns the servo; `None` if it follows its command exactly (zero lag and compliance).
    pub(crate) fn if_any(self) -> Option<Self> {
        Some(self).filter(|servo| *servo != Self::default())
    }

    /// Returns a copy of `problem` in which the commanded gait is replaced by the gait that the servos perform in the
    /// resulting steady-state motion.
    ///
    /// # Errors
    /// Returns an error if the model has no periodic solution, or if the torque in the periodic solution is unbounded.
    pub(super) fn reached(&self, problem: &Problem) -> Result<Problem, MotionError> {
        let mut reached = problem.clone();
        if self.if_any().is_none() {
            return Ok(reached);
        }
        let mut solver = Solver::default();
        let iterations = if self.compliance_rad_nm > 0.0 { ITERATIONS } else { 0 };
        let mut torques = [Torque::default(); MAX_JOINTS];
        for iteration in 0..=iterations {
            if iteration > 0 {
                solver.solve(&reached, REFERENCE_ACCURACY)?;
                torques = Torque::of_joints(&solver.cycle(SAMPLES)?)?;
            }
            for (joint, torque) in torques.into_iter().enumerate() {
                let command = problem.gait.joints[joint];
                reached.gait.joints[joint] =
                    command.map(|command| self.response(command, problem.omega_rad_s, torque));
            }
        }
        Ok(reached)
    }

    /// Returns the motion of a joint whose servo receives `command` and is loaded by `torque`.
    fn response(&self, command: JointCommand, omega_rad_s: f64, torque: Torque) -> JointCommand {
        let lag = |harmonic: f64| Complex::new(1.0, harmonic * omega_rad_s * self.lag_s);
        let first = Complex::from_polar(command.amplitude_rad, command.phase_rad) / lag(1.0)
            - self.compliance_rad_nm * torque.first;
        let second = command.second.map(|second| {
            let second = Complex::new(second.in_phase_rad, second.quadrature_rad) / lag(2.0)
                - self.compliance_rad_nm * torque.second;
            SecondHarmonic { in_phase_rad: second.re, quadrature_rad: second.im }
        });
        JointCommand {
            offset_rad: command.offset_rad - self.compliance_rad_nm * torque.mean,
            amplitude_rad: first.norm(),
            phase_rad: first.arg(),
            second,
        }
    }
}

/// Mean and harmonics of a joint torque, N m.
#[derive(Debug, Clone, Copy, Default)]
struct Torque {
    mean: f64,
    first: Complex<f64>,
    second: Complex<f64>,
}

impl Torque {
    /// Computes the mean and harmonics of the torques of all joints from the [`SAMPLES`] samples of a cycle, each with
    /// the torques of the joints.
    fn of_joints(cycle: &[Sample]) -> Result<[Self; MAX_JOINTS], MotionError> {
        let mut torques = [Self::default(); MAX_JOINTS];
        for (i, sample) in cycle.iter().take(SAMPLES).enumerate() {
            let turn = Complex::cis(-TAU * i as f64 / SAMPLES as f64);
            for (torque, torque_nm) in torques.iter_mut().zip(&sample.torque_nm) {
                torque.mean += torque_nm / SAMPLES as f64;
                torque.first += turn * (2.0 * torque_nm / SAMPLES as f64);
                torque.second += turn * turn * (2.0 * torque_nm / SAMPLES as f64);
            }
        }
        if torques.iter().all(|torque| torque.mean.is_finite() && torque.first.is_finite()) {
            Ok(torques)
        } else {
            Err(MotionError::Unresolved { error: f64::INFINITY })
        }
    }
}
