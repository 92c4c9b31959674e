//! Servos that lag and give way.

use std::f64::consts::TAU;

use nalgebra::Complex;
use serde::Serialize;
use trilink_mechanics::{MotionError, Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::{JointCommand, SecondHarmonic};

/// How servos follow their commands, each joint's angle being
///
/// ```text
/// phi = command / (1 + i omega lag) - compliance torque
/// ```
///
/// for its harmonics, and `command - compliance torque` for its mean. Both 0 is a servo that
/// follows.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Servo {
    /// Time constant of the first-order lag, s.
    pub lag_s: f64,
    /// Deflection by the joint's torque in the steady motion, rad/(N m).
    pub compliance_rad_nm: f64,
}

/// Samples of a cycle that tell a torque's mean and harmonics, and how often the torque is
/// computed under the gait that it leaves: each time leaves a few hundredths of the error.
const SAMPLES: usize = 240;
const TIMES: usize = 8;

impl Servo {
    /// The servo, unless it follows its command.
    pub(crate) fn if_any(self) -> Option<Self> {
        Some(self).filter(|servo| *servo != Self::default())
    }

    /// A problem with the gait that the servos reach in its steady motion.
    ///
    /// # Errors
    /// The robot has no such motion, or the torque in it is not bounded.
    pub(super) fn reached(&self, problem: &Problem) -> Result<Problem, MotionError> {
        let mut reached = problem.clone();
        if self.if_any().is_none() {
            return Ok(reached);
        }
        let (omega_rad_s, mut solver) = (problem.omega_rad_s, Solver::default());
        let lag = |times: f64| Complex::new(1.0, times * omega_rad_s * self.lag_s);
        let bent = |command: JointCommand, Torque { mean, first, second }: Torque| {
            let harmonic = Complex::from_polar(command.amplitude_rad, command.phase_rad) / lag(1.0)
                - self.compliance_rad_nm * first;
            let second = command.second.map(|of| {
                let of = Complex::new(of.in_phase_rad, of.quadrature_rad) / lag(2.0)
                    - self.compliance_rad_nm * second;
                SecondHarmonic { in_phase_rad: of.re, quadrature_rad: of.im }
            });
            JointCommand {
                offset_rad: command.offset_rad - self.compliance_rad_nm * mean,
                amplitude_rad: harmonic.norm(),
                phase_rad: harmonic.arg(),
                second,
            }
        };
        let times = if self.compliance_rad_nm > 0.0 { TIMES } else { 0 };
        let mut torques = [Torque::default(); 2];
        for time in 0..=times {
            if time > 0 {
                solver.solve(&reached, REFERENCE_ACCURACY)?;
                torques = harmonics(&mut solver)?;
            }
            for (joint, torque) in torques.into_iter().enumerate() {
                let command = problem.gait.joints[joint];
                reached.gait.joints[joint] = command.map(|command| bent(command, torque));
            }
        }
        Ok(reached)
    }
}

/// Mean and harmonics of a torque, N m.
#[derive(Debug, Clone, Copy, Default)]
struct Torque {
    mean: f64,
    first: Complex<f64>,
    second: Complex<f64>,
}

/// Those of both joints in the last solution.
fn harmonics(solver: &mut Solver) -> Result<[Torque; 2], MotionError> {
    let cycle = solver.cycle(SAMPLES)?;
    let mut torques = [Torque::default(); 2];
    for (i, sample) in cycle.iter().take(SAMPLES).enumerate() {
        let turn = Complex::cis(-TAU * i as f64 / SAMPLES as f64);
        for (of, torque_nm) in torques.iter_mut().zip(sample.forces.torque_nm) {
            of.mean += torque_nm / SAMPLES as f64;
            of.first += turn * (2.0 * torque_nm / SAMPLES as f64);
            of.second += turn * turn * (2.0 * torque_nm / SAMPLES as f64);
        }
    }
    match torques.iter().all(|of| of.mean.is_finite() && of.first.is_finite()) {
        true => Ok(torques),
        false => Err(MotionError::Unresolved { error: f64::INFINITY }),
    }
}
