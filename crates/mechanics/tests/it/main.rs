//! Tests of steady-state motions, transients and branches against references, conservation laws and other
//! methods.

#![allow(clippy::unwrap_used, unreachable_pub)]

mod allocations;
mod chain;
mod draws;
mod effort;
mod friction;
mod motion;
mod motion_properties;
mod own_friction;
mod settling;

use std::f64::consts::TAU;

use trilink_mechanics::{MotionError, NumberDerivatives, Problem, Solver};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{ByParameter, ChainNumber, CommandNumber, Laws, Parameter, Robot};

/// Returns the friction laws of the model with the given name.
fn laws(model: &str) -> Laws {
    match model {
        "no-skid" | "no-skid-measured" | "no-skid-damped" => Laws::NO_SKID,
        "no-skid-roll" => Laws::NO_SKID_ROLL,
        "skid" => Laws::SKID,
        "skid-roll" => Laws::SKID_ROLL,
        "coulomb" => Laws::COULOMB,
        "coulomb-viscous" => Laws::COULOMB_VISCOUS,
        other => panic!("no model {other}"),
    }
}

/// Returns the robot of a problem of three links.
fn three_links(problem: &Problem) -> &Robot {
    problem.robot.three_links().unwrap()
}

/// Returns the displacement (m) and rotation (rad) in each of the first `cycles` cycles from rest.
fn displacements(
    problem: &Problem,
    cycles: usize,
    tolerance: f64,
) -> Result<Vec<[f64; 2]>, MotionError> {
    let period_s = TAU / problem.omega_rad_s;
    let duration_s = (cycles as f64 + 1.5) * period_s;
    let path = problem.varied_transient(&[], duration_s, 1.0 / period_s, tolerance)?;
    let pairs = path.windows(2).take(cycles).map(|pair| {
        let [(from, _), (to, _)] = [pair[0], pair[1]];
        [(to.x_m - from.x_m).hypot(to.y_m - from.y_m), to.theta_rad - from.theta_rad]
    });
    Ok(pairs.collect())
}

/// Derivatives of the motion of a robot of three links with respect to all variables; zero for those that the robot or
/// its gait does not have.
#[derive(Debug, Clone, PartialEq)]
struct Derivatives {
    parameters: ByParameter<NumberDerivatives, { Parameter::ALL.len() }>,
    omega: NumberDerivatives,
    /// With respect to offset, amplitude and phase of each joint's command.
    gait: [[NumberDerivatives; 3]; 2],
    /// With respect to the in-phase and quadrature components of each joint's second harmonic.
    second: [[NumberDerivatives; 2]; 2],
}

impl Derivatives {
    /// Returns the derivatives of the solver's last solution, that of `problem`.
    fn of(solver: &mut Solver, problem: &Problem) -> Result<Self, MotionError> {
        const COMMAND: [CommandNumber; 5] = [
            CommandNumber::Offset,
            CommandNumber::Amplitude,
            CommandNumber::Phase,
            CommandNumber::SecondInPhase,
            CommandNumber::SecondQuadrature,
        ];
        let none = NumberDerivatives { metrics: GaitMetrics::NONE, work_j: 0.0 };
        let of_parameters = solver.parameter_derivatives(&Parameter::ALL)?;
        let mut parameters = ByParameter::splat(none);
        parameters.iter_mut().zip(of_parameters).for_each(|(own, found)| *own = found);
        let numbers: Vec<(usize, usize)> = (0..2)
            .flat_map(|joint| (0..COMMAND.len()).map(move |number| (joint, number)))
            .filter(|(joint, number)| {
                let command = problem.gait.joints[*joint];
                command.is_some_and(|command| *number < 3 || command.second.is_some())
            })
            .collect();
        let wanted: Vec<ChainNumber> = numbers
            .iter()
            .map(|(joint, number)| ChainNumber::Command(*joint, COMMAND[*number]))
            .collect();
        let (omega, slopes) = solver.derivatives_with_omega(&wanted)?;
        let mut derivatives =
            Self { parameters, omega, gait: [[none; 3]; 2], second: [[none; 2]; 2] };
        for ((joint, number), slope) in numbers.into_iter().zip(slopes) {
            match number {
                0..3 => derivatives.gait[joint][number] = slope,
                _ => derivatives.second[joint][number - 3] = slope,
            }
        }
        Ok(derivatives)
    }
}
