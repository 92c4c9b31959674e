//! The straight robot pushed and left to coast: its roll resistance (eq. 14).
//!
//! All wheels roll at the robot's speed u and none skids, so `sum(m) u' = -sum(c^R) u` and the
//! path length is `s = s0 + a (1 - exp(-lambda t))` with `sum(c^R) = lambda sum(m)`. The path is
//! fitted, not the speed: it is measured, and its noise is white. The masses are taken as
//! configured, and the sum is split by the configured proportions: a straight robot does not
//! determine more.

use nalgebra::SVector;

use super::Curve;
use crate::ingest::checks::{Check, Finding};
use crate::ingest::error::Problem;
use crate::ingest::poses::Coordinates;
use crate::metrics::Estimate;
use crate::robot::Robot;
use crate::stats::{mean, seen};
use crate::store::{Columns as _, RobotParameterRow};

/// A robot that is slower than this was not pushed, m/s.
const LEAST_SPEED_M_S: f64 = 0.05;
/// The robot is free below this part of its top speed, and the fit ends below this one.
const FREE: f64 = 0.95;
const SLOW: f64 = 0.1;
/// The speed must fall to this part of the top speed, or the decay is not seen.
const LEAST_FALL: f64 = 0.6;
/// The recording is judged in at least so many parts.
const LEAST_BATCHES: f64 = 20.0;
/// How much larger the decay's error is than independent noise makes it. The links are set upright by
/// heights over a second, and the noise of those is as large a part of the way's over such a time as
/// the rest: too slow for batches to show it.
const UPRIGHT_ERROR: f64 = 1.25;
/// How bent the robot may be, degrees.
const STRAIGHT_DEG: f64 = 5.0;

/// The robot's parameters by a trial of kind `coast-down`, and its checks; `speed_m_s` is the
/// smoothed roll velocity of wheel 0.
pub fn measure(
    robot: &Robot,
    coordinates: &Coordinates,
    speed_m_s: &[f64],
    rate_hz: f64,
) -> Result<(RobotParameterRow, Vec<Finding>), Problem> {
    let top = speed_m_s.iter().fold(0.0, |top: f64, v| top.max(v.abs()));
    if top < LEAST_SPEED_M_S {
        let (found_m_s, needed_m_s) = (top, LEAST_SPEED_M_S);
        return Err(Problem::NotPushed { found_m_s, needed_m_s });
    }
    let below = |from: usize, part: f64| {
        speed_m_s[from..].iter().position(|v| v.abs() < part * top).map(|i| from + i)
    };
    let fastest = speed_m_s.iter().position(|v| v.abs() >= top).unwrap_or(0);
    let start = below(fastest, FREE).unwrap_or(speed_m_s.len() - 1);
    let end = below(start, SLOW).unwrap_or(speed_m_s.len());
    let no_decay = || {
        let lowest = speed_m_s[start..].iter().fold(top, |low, v| low.min(v.abs()));
        let found = lowest / top;
        Problem::NoDecay { found, needed: LEAST_FALL }
    };
    let fall = below(start, LEAST_FALL).ok_or_else(no_decay)?;
    let samples = path_length(coordinates, start, end, rate_hz);
    let gone = samples.last().map_or(0.0, |(_, length)| *length);
    let guess_1_s = -(LEAST_FALL / FREE).ln() * rate_hz / (fall - start).max(1) as f64;
    let guess = SVector::from([0.0, gone / (1.0 - SLOW), guess_1_s]);
    let batch_s = (end - start) as f64 / rate_hz / LEAST_BATCHES;
    let curve = Curve::fit(&samples, guess, coasting, |_| batch_s).ok_or_else(no_decay)?;
    if curve.parameters[2] <= 0.0 {
        return Err(no_decay());
    }

    let law = curve.check("viscous rolling", &format!("{:.2} mm", 1e3 * curve.misfit));
    let decay = match law.holds() {
        true => {
            let se = UPRIGHT_ERROR * curve.se(SVector::from([0.0, 0.0, 1.0]));
            Estimate::new(curve.parameters[2], se)
        }
        false => Estimate::MISSING,
    };
    let mass_kg: f64 = robot.mass_kg.iter().sum();
    let configured: f64 = robot.roll_kg_s.iter().sum();
    let sum = Estimate::new(mass_kg * decay.value, mass_kg * decay.se);
    // Nothing of nothing is unknown.
    let roll =
        |of_wheel| Estimate::new(sum.value * of_wheel / configured, sum.se * of_wheel / configured);
    let row = RobotParameterRow {
        mass_kg,
        decay_1_s: decay,
        roll_sum_kg_s: sum,
        roll_sum_configured_kg_s: configured,
        roll_kg_s: robot.roll_kg_s.map(roll),
        status: law.status(),
        ..RobotParameterRow::blank()
    };
    let bent_deg = coordinates
        .phi_rad
        .iter()
        .map(|phi| mean(seen(&phi[start..end])).abs().to_degrees())
        .fold(0.0, f64::max);
    let asked = match bent_deg > STRAIGHT_DEG {
        true => ": is kind right in trials.toml, and is no table of [markers] turned?",
        false => "",
    };
    let bent = format!("the robot is bent by {bent_deg:.1} degrees{asked}");
    let findings = vec![Finding::at_most(Check::Straight, bent_deg, STRAIGHT_DEG, bent), law];
    Ok((row, findings))
}

/// `p0 + p1 (1 - exp(-p2 t))` with its derivatives.
fn coasting(p: &SVector<f64, 3>, t: f64) -> (f64, SVector<f64, 3>) {
    let left = (-p[2] * t).exp();
    (p[0] + p[1] * (1.0 - left), SVector::from([1.0, 1.0 - left, p[1] * t * left]))
}

/// Time (s) and path length along the heading (m) in the frames that were seen.
fn path_length(seen: &Coordinates, start: usize, end: usize, rate_hz: f64) -> Vec<(f64, f64)> {
    let mut samples: Vec<(f64, f64)> = Vec::with_capacity(end - start);
    let mut last: Option<[f64; 3]> = None;
    for i in start..end {
        let [x, y, theta] = [seen.x_m[i], seen.y_m[i], seen.theta_rad[i]];
        if x.is_nan() || theta.is_nan() {
            continue;
        }
        let step = last.map_or(0.0, |last: [f64; 3]| {
            let (sin, cos) = (0.5 * (theta + last[2])).sin_cos();
            (x - last[0]) * cos + (y - last[1]) * sin
        });
        let before = samples.last().map_or(0.0, |(_, length)| *length);
        samples.push(((i - start) as f64 / rate_hz, before + step));
        last = Some([x, y, theta]);
    }
    samples
}
