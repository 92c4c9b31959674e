//! What happens within a steady cycle: forces, crossings of `phi1 = phi2`, phases.

use minijinja::Error;
use trilink_mechanics::{FORCES_ACCURACY, Problem, Sample, Solver};
use trilink_statistics::wrap;

use super::missing::{NO_MOTION, missing, unknown};

/// Samples of a cycle, and how many of them there are to one of the coarse ones. Neither meets the
/// crossings of the symmetric gait at an eighth and five eighths of the period: both miss them by
/// half a step.
const FINE: usize = 1100;
const REFINED: usize = 11;
/// Samples in which crossings and phases are looked for.
const SAMPLES: usize = 180;

/// What is read off a cycle.
///
/// # Errors
/// There is no such motion, it crosses nothing, or there is no quantity of this name.
pub(super) fn find(problem: &Problem, quantity: &str) -> Result<f64, Error> {
    let found = match quantity {
        // How often a cycle crosses `phi1 = phi2`.
        "crossings" => crossings(problem).map(|rates| rates.len() as f64),
        // Largest `|phi1' + phi2'|` over `|phi1'| + |phi2'|` at the crossings (eq. 6).
        "crossing_rates" => crossings(problem).and_then(|rates| {
            let off = |[w1, w2]: [f64; 2]| (w1 + w2).abs() / (w1.abs() + w2.abs());
            rates.into_iter().map(off).max_by(f64::total_cmp)
        }),
        "lag_deg" => lag_deg(problem),
        // Of the ground's largest force on a wheel across it.
        "force_growth" => growth(problem, |sample| sample.forces.lateral_n),
        // Of the largest of `x'`, `y'` and `h theta'`.
        "velocity_growth" => growth(problem, |sample| {
            let [x, y, turning, ..] = sample.rates;
            [x, y, problem.robot.h_m * turning]
        }),
        _ => return Err(unknown(quantity)),
    };
    found.ok_or_else(|| missing(NO_MOTION))
}

fn cycle(problem: &Problem, samples: usize) -> Option<Vec<Sample>> {
    let mut solver = Solver::default();
    solver.solve(problem, FORCES_ACCURACY).ok()?;
    solver.cycle(samples).ok()
}

/// The largest value seen in all samples over that in every eleventh: 1 for what is bounded and
/// resolved, 11 for what has a pole.
fn growth(problem: &Problem, values: impl Fn(&Sample) -> [f64; 3]) -> Option<f64> {
    let samples = cycle(problem, FINE)?;
    let largest = |step: usize| {
        let values = samples.iter().step_by(step).flat_map(&values);
        // A force that is not a number is one that has no bound.
        let sizes = values.map(|value| if value.is_nan() { f64::INFINITY } else { value.abs() });
        sizes.fold(0.0, f64::max)
    };
    Some(largest(1) / largest(REFINED))
}

/// Joint rates where `phi1 = phi2` is crossed in a cycle.
fn crossings(problem: &Problem) -> Option<Vec<[f64; 2]>> {
    let apart = |sample: &Sample| sample.phi_rad[0] - sample.phi_rad[1];
    let rates = |pair: &[Sample]| {
        let (from, to) = (apart(&pair[0]), apart(&pair[1]));
        let part = from / (from - to);
        (from == 0.0 || from * to < 0.0).then(|| {
            std::array::from_fn(|joint| {
                let [from, to] = [pair[0].rates[3 + joint], pair[1].rates[3 + joint]];
                from + part * (to - from)
            })
        })
    };
    Some(cycle(problem, SAMPLES)?.windows(2).filter_map(rates).collect())
}

/// Phase of the first harmonic of phi1 after that of phi2, degrees from -180 to 180.
fn lag_deg(problem: &Problem) -> Option<f64> {
    let samples = cycle(problem, SAMPLES)?;
    let phase = |joint: usize| {
        let (mut cosine, mut sine) = (0.0, 0.0);
        for sample in &samples[..SAMPLES] {
            let (sin, cos) = (problem.omega_rad_s * sample.time_s).sin_cos();
            cosine += sample.phi_rad[joint] * cos;
            sine += sample.phi_rad[joint] * sin;
        }
        sine.atan2(cosine)
    };
    Some(wrap(phase(1) - phase(0)).to_degrees())
}
