//! Steady-state motion and stability of the paper's kinematic robot with viscous skid and rolling resistance.
//!
//! For each actuation frequency omega this example solves for the periodic orbit and prints the displacement
//! per cycle d and the mean speed v (eq. 17), the modulus of the largest Floquet multiplier, by which a
//! perturbation is multiplied each cycle (stable below 1), and d with a tenth of and ten times the skid
//! coefficients.
//!
//! ```sh
//! cargo run -p trilink-mechanics --example floquet
//! cargo run -p trilink-mechanics --example floquet -- 2 3.9 8    # other frequencies, rad/s
//! ```

use std::process::ExitCode;

use trilink_mechanics::{Laws, MotionError, Problem, REFERENCE_ACCURACY, SteadyMotion};
use trilink_robot::{Gait, Robot};

const OMEGAS_RAD_S: [f64; 6] = [1.0, 2.0, 3.0, 3.9, 5.0, 6.0];

/// Solves for the steady-state motion of the kinematic robot with all skid coefficients multiplied by
/// `skid_factor`.
fn steady_motion(omega_rad_s: f64, skid_factor: f64) -> Result<SteadyMotion, MotionError> {
    let mut robot = Robot::kinematic();
    robot.skid_kg_s = robot.skid_kg_s.map(|skid_kg_s| skid_factor * skid_kg_s);
    let problem = Problem::new(robot, Gait::symmetric(), Laws::SKID_ROLL, omega_rad_s);
    problem.solve(REFERENCE_ACCURACY)
}

fn print_row(omega_rad_s: f64) -> Result<(), MotionError> {
    let motion = steady_motion(omega_rad_s, 1.0)?;
    let [d_m, v_m_s] = [motion.metrics.d_m, motion.metrics.v_m_s];
    let slippery_d_m = steady_motion(omega_rad_s, 0.1)?.metrics.d_m;
    let sticky_d_m = steady_motion(omega_rad_s, 10.0)?.metrics.d_m;
    // Only a motion without dynamic states has no multipliers; wheels that skid have states.
    let modulus = motion.floquet.unwrap_or(f64::NAN);
    let status = motion.status();
    print!("{omega_rad_s:7.2} {d_m:11.6} {v_m_s:9.6} {modulus:12.2e} {status:>9}");
    println!(" {slippery_d_m:11.6} {sticky_d_m:11.6}");
    Ok(())
}

fn main() -> ExitCode {
    let given: Result<Vec<f64>, _> = std::env::args().skip(1).map(|text| text.parse()).collect();
    let omegas_rad_s = match given {
        Ok(given) if given.is_empty() => OMEGAS_RAD_S.to_vec(),
        Ok(given) if given.iter().all(|omega| omega.is_finite() && *omega > 0.0) => given,
        _ => return failed("each argument must be a frequency above 0, in rad/s"),
    };
    println!("  omega           d         v |multiplier|    motion  d, skid/10  d, skid*10");
    println!("  rad/s     m/cycle       m/s                           m/cycle     m/cycle");
    omegas_rad_s.into_iter().try_for_each(print_row).map_or_else(failed, |()| ExitCode::SUCCESS)
}

fn failed(why: impl std::fmt::Display) -> ExitCode {
    eprintln!("floquet: {why}");
    ExitCode::FAILURE
}
