//! Quantities within a cycle of a steady-state motion: forces, crossings of `phi1 = phi2`, phases.

use minijinja::Error;
use trilink_mechanics::{FORCES_ACCURACY, Problem, Sample, Solver};
use trilink_robot::Quantity;
use trilink_statistics::wrap;

use super::missing::{NO_MOTION, missing, unknown};

/// Number of fine samples per cycle. The times at which `phi1 = phi2` in the symmetric gait (1/8 and 5/8 of the period)
/// lie halfway between two fine samples, and also halfway between two coarse samples (every [`REFINEMENT`]-th fine
/// sample).
const FINE: usize = 1100;
/// Number of fine samples per coarse sample.
const REFINEMENT: usize = 11;
/// Number of samples per cycle for finding crossings and phases.
const SAMPLES: usize = 180;

/// Returns the value of a quantity of one steady-state cycle; `quantity` is its name in the formulas of claims.
///
/// # Errors
/// Returns an error if the motion does not exist, `phi1` and `phi2` never cross, or no quantity has this name.
pub(super) fn find(problem: &Problem, quantity: &str) -> Result<f64, Error> {
    let found = match quantity {
        // Number of crossings of `phi1 = phi2` per cycle.
        "crossings" => crossings(problem).map(|rates| rates.len() as f64),
        // Largest ratio of `|phi1' + phi2'|` to `|phi1'| + |phi2'|` at the crossings (eq. 6 of the paper).
        "crossing_rates" => crossings(problem).and_then(|rates| {
            rates
                .into_iter()
                .map(|[w1, w2]| (w1 + w2).abs() / (w1.abs() + w2.abs()))
                .max_by(f64::total_cmp)
        }),
        "lag_deg" => lag_deg(problem),
        // Growth of the largest lateral force on any wheel under refinement.
        "force_growth" => {
            growth(problem, |sample| std::array::from_fn(|wheel| sample.lateral_n[wheel]))
        }
        // Growth of the largest of `x'`, `y'` and `h theta'` under refinement.
        "velocity_growth" => growth(problem, |sample| {
            let [x, y, turning] = sample.pose_rates;
            [x, y, problem.robot.value(Quantity::H.parameter(0)) * turning]
        }),
        _ => return Err(unknown(quantity)),
    };
    found.ok_or_else(|| missing(NO_MOTION))
}

/// Solves for the steady-state motion and returns samples of one cycle; `None` if there is no motion.
fn cycle(problem: &Problem, samples: usize) -> Option<Vec<Sample>> {
    let mut solver = Solver::default();
    solver.solve(problem, FORCES_ACCURACY).ok()?;
    solver.cycle(samples).ok()
}

/// Returns the ratio of the largest absolute value in all samples of a cycle to that in every [`REFINEMENT`]-th sample:
/// 1 for a bounded and resolved quantity, [`REFINEMENT`] for a quantity with a pole. `None` if there is no motion.
fn growth(problem: &Problem, values: impl Fn(&Sample) -> [f64; 3]) -> Option<f64> {
    let samples = cycle(problem, FINE)?;
    let largest = |step: usize| {
        let values = samples.iter().step_by(step).flat_map(&values);
        // A NaN value stands for an unbounded one.
        let sizes = values.map(|value| if value.is_nan() { f64::INFINITY } else { value.abs() });
        sizes.fold(0.0, f64::max)
    };
    Some(largest(1) / largest(REFINEMENT))
}

/// Returns the joint rates (rad/s) at each crossing of `phi1 = phi2` in a cycle; `None` if there is no motion.
fn crossings(problem: &Problem) -> Option<Vec<[f64; 2]>> {
    let apart = |sample: &Sample| sample.phi_rad[0] - sample.phi_rad[1];
    Some(
        cycle(problem, SAMPLES)?
            .windows(2)
            .filter_map(|pair| {
                let from = apart(&pair[0]);
                let to = apart(&pair[1]);
                let fraction = from / (from - to);
                (from == 0.0 || from * to < 0.0).then(|| {
                    std::array::from_fn(|joint| {
                        let [from, to] = [0, 1].map(|i: usize| pair[i].phi_rate_rad_s[joint]);
                        from + fraction * (to - from)
                    })
                })
            })
            .collect(),
    )
}

/// Returns the phase (-180 to 180 degrees) by which the first harmonic of phi2 lags that of phi1; `None` if there is no
/// motion.
fn lag_deg(problem: &Problem) -> Option<f64> {
    let samples = cycle(problem, SAMPLES)?;
    let phase = |joint: usize| {
        let mut cosine = 0.0;
        let mut sine = 0.0;
        for sample in &samples[..SAMPLES] {
            let (sin, cos) = (problem.omega_rad_s * sample.time_s).sin_cos();
            cosine += sample.phi_rad[joint] * cos;
            sine += sample.phi_rad[joint] * sin;
        }
        sine.atan2(cosine)
    };
    Some(wrap(phase(1) - phase(0)).to_degrees())
}
