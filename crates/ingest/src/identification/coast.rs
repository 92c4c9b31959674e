//! Identifies the roll resistance (eq. 14) from a coast-down: a straight robot is pushed and then rolls freely.
//!
//! All wheels roll at the robot's speed v and none skids, so that `sum(m) v' = -sum(c^R) v - sum(F^R)` with viscous
//! resistance, dry friction, or both ([`Coast`]). The path length is fitted rather than the speed, because the path
//! length is measured and its noise is white. The masses are taken from the configuration, and the sum of the viscous
//! coefficients is divided among the wheels in the configured proportions: the motion of a straight robot determines
//! only sums. A sloping floor has the same effect as dry friction; [`super::floor`] tells the two apart.

use std::ops::Range;

use nalgebra::SVector;
use trilink_robot::decay::{Coast, DecayLaw, RELEASED, coasting};
use trilink_robot::{AnyRobot, Quantity};
use trilink_statistics::Estimate;
use trilink_statistics::{mean, seen};
use trilink_tables::{Columns as _, Coordinates, DecayFit, RobotParameterRow, SlopeStatus};

use super::laws::{self, Laws, Words};
use super::{Curve, Law};
use crate::checks::{Check, Finding};
use crate::error::Problem;

/// Minimum speed of a robot that is considered to have been pushed, m/s.
const MIN_SPEED_M_S: f64 = 0.05;
/// Fraction of the maximum speed to which the speed must fall for the decay to be visible.
const MIN_FALL: f64 = 0.6;
/// Minimum number of batches into which the residuals are divided.
const MIN_BATCHES: f64 = 20.0;
/// Ratio of the standard error of the decay parameters to that for independent noise. The tilt of the links is
/// corrected using marker heights averaged over a second. Over such a time the noise of the heights contributes as much
/// to the path as all other noise, and varies too slowly for the batches to show it.
const UPRIGHT_ERROR: f64 = 1.25;
/// Minimum noise that is assumed in a recording, m, because its coordinates have a limited number of digits.
const MIN_NOISE_M: f64 = 1e-6;
/// Parameter index of the viscous term of a [`Coast`].
const VISCOUS: usize = 2;
/// Parameter index of the dry term of a [`Coast`].
const DRY: usize = 3;
pub(super) const WORDS: Words = Words {
    laws: ["viscous rolling", "dry rolling", "rolling with viscous resistance and dry friction"],
    motion: "a coast-down",
    rms: |fit| format!("{:.2} mm", 1e3 * fit.misfit_m),
};

/// Identifies the robot's parameters from a trial of kind `coast-down` and checks the trial. `speed_m_s` is the
/// smoothed roll velocity of a wheel.
///
/// # Errors
/// Returns an error if the robot was not pushed or its speed does not decay.
pub(crate) fn measure(
    robot: &AnyRobot,
    coordinates: &Coordinates,
    speed_m_s: &[f64],
    rate_hz: f64,
) -> Result<(RobotParameterRow, Vec<Finding>), Problem> {
    let max_m_s = speed_m_s.iter().fold(0.0, |max: f64, v| max.max(v.abs()));
    if max_m_s < MIN_SPEED_M_S {
        return Err(Problem::NotPushed { found_m_s: max_m_s, needed_m_s: MIN_SPEED_M_S });
    }
    let Range { start, end } = coasting(speed_m_s, robot.value(Quantity::Transition.one()));
    let start = start.min(speed_m_s.len() - 1);
    let Some(fall) = first_below(speed_m_s, start, MIN_FALL * max_m_s) else {
        return Err(no_decay(&speed_m_s[start..], max_m_s));
    };
    // A robot that is pushed backwards travels against its heading.
    let direction = speed_m_s[start].signum();
    let samples = path_length(coordinates, start..end, direction, rate_hz);
    let fallen_s = (fall - start).max(1) as f64 / rate_hz;
    let batch_s = (end - start) as f64 / rate_hz / MIN_BATCHES;
    let laws = fit(&samples, RELEASED * max_m_s, fallen_s, batch_s);
    if DecayLaw::ALL.iter().all(|law| laws.curve(*law).is_none()) {
        return Err(no_decay(&speed_m_s[start..], max_m_s));
    }

    let mut checks = vec![straight_check(coordinates, start..end)];
    let row = RobotParameterRow {
        heading_rad: coordinates.direction_rad(start..end),
        slope_status: Some(SlopeStatus::OneDirection),
        pooled_trials: 1,
        ..parameters(robot, &laws)
    };
    checks.extend(laws::checks(&row, &WORDS, configured_law(&row)));
    Ok((row, checks))
}

/// Returns the first frame, from `from` on, in which the speed is below a limit; `None` if there is none.
fn first_below(speed_m_s: &[f64], from: usize, limit_m_s: f64) -> Option<usize> {
    speed_m_s[from..].iter().position(|v| v.abs() < limit_m_s).map(|i| from + i)
}

fn no_decay(speed_m_s: &[f64], max_m_s: f64) -> Problem {
    let lowest_m_s = speed_m_s.iter().fold(max_m_s, |low, v| low.min(v.abs()));
    Problem::NoDecay { found: lowest_m_s / max_m_s, needed: MIN_FALL }
}

/// Returns the row of robot parameters that follow from the fitted laws.
fn parameters(robot: &AnyRobot, laws: &Laws<4>) -> RobotParameterRow {
    let mass_kg = robot.mass_kg();
    let fits = DecayLaw::ALL.map(|law| {
        laws.fit(law, |curve| DecayFit {
            misfit_m: curve.misfit,
            roll_sum_kg_s: scaled_parameter(laws, law, VISCOUS, mass_kg),
            roll_dry_sum_n: scaled_parameter(laws, law, DRY, mass_kg),
            ..DecayFit::blank()
        })
    });
    let correlation = laws.curve(DecayLaw::CoulombViscous).map_or(f64::NAN, |both| {
        let [viscous, dry] = [VISCOUS, DRY].map(|index| both.covariance[(index, index)]);
        both.covariance[(VISCOUS, DRY)] / (viscous * dry).sqrt()
    });
    let mut row = RobotParameterRow {
        mass_kg,
        roll_sum_configured_kg_s: robot.value(Quantity::Roll.sum()),
        roll_dry_sum_configured_n: robot.value(Quantity::RollDry.sum()),
        roll_correlation: correlation,
        ..laws.row(fits)
    };
    let [viscous, dry] = own_resistance(&row);
    set_resistance(&mut row, &robot.roll_kg_s(), viscous, dry);
    row
}

/// Returns the sums of the viscous coefficients, kg/s, and of the dry friction, N, under the law of the row, from this
/// recording alone; missing if there is no law or the law has no such term.
pub(super) fn own_resistance(row: &RobotParameterRow) -> [Estimate; 2] {
    row.law.map_or([Estimate::MISSING; 2], |law| {
        let fit = row.laws()[law as usize].1;
        [fit.roll_sum_kg_s, fit.roll_dry_sum_n]
    })
}

/// Sets the sums of the viscous coefficients, kg/s, and of the dry friction, N, and what follows from them. The viscous
/// sum is divided among the wheels in proportion to `roll_kg_s`, by link, NaN for a link without a wheel.
pub(super) fn set_resistance(
    row: &mut RobotParameterRow,
    roll_kg_s: &[f64],
    viscous: Estimate,
    dry: Estimate,
) {
    let times = |factor: f64| Estimate::new(viscous.value * factor, viscous.se * factor);
    // NaN if the configured sum is zero.
    let configured: f64 = seen(roll_kg_s).sum();
    row.roll_sum_kg_s = viscous;
    row.decay_1_s = times(1.0 / row.mass_kg);
    let share = |link: usize| {
        roll_kg_s.get(link).map_or(Estimate::MISSING, |of_wheel| times(of_wheel / configured))
    };
    row.roll_kg_s = [0, 1, 2].map(share);
    row.more_roll_kg_s = (3..roll_kg_s.len()).map(share).collect();
    row.roll_dry_sum_n = dry;
}

/// Returns the viscous or dry parameter of a law multiplied by `factor`; missing if the law has no such parameter.
fn scaled_parameter(laws: &Laws<4>, law: DecayLaw, index: usize, factor: f64) -> Estimate {
    let slopes = SVector::from_fn(|i, _| if i == index { factor } else { 0.0 });
    let is_free = law != [DecayLaw::Coulomb, DecayLaw::Viscous][index - VISCOUS];
    let curve = laws.curve(law).filter(|_| is_free);
    curve.map_or(Estimate::MISSING, |curve| {
        laws.estimate(curve, factor * curve.parameters[index], slopes)
    })
}

/// Checks that the robot is straight while it coasts, from the mean joint angles.
fn straight_check(coordinates: &Coordinates, frames: Range<usize>) -> Finding {
    let angles_deg =
        coordinates.phi_rad.iter().map(|phi| mean(seen(&phi[frames.clone()])).abs().to_degrees());
    let bent_deg = angles_deg.fold(0.0, f64::max);
    let question = if bent_deg > Check::Straight.limit() {
        ": is `kind` correct in trials.toml, or are the positions in one of the [markers] tables rotated?"
    } else {
        ""
    };
    let message = format!(
        "the largest mean joint angle while the robot coasts is {bent_deg:.1} degrees{question}"
    );
    Finding::at_most(Check::Straight, bent_deg, message)
}

/// Returns the decay law that corresponds to the robot's configured roll resistance.
pub(super) fn configured_law(row: &RobotParameterRow) -> DecayLaw {
    match (row.roll_sum_configured_kg_s > 0.0, row.roll_dry_sum_configured_n > 0.0) {
        (true, true) => DecayLaw::CoulombViscous,
        (false, true) => DecayLaw::Coulomb,
        (_, false) => DecayLaw::Viscous,
    }
}

/// Fits each law to samples of time, s, and path length, m. The initial guess is a motion that starts at `speed_m_s`
/// and slows to [`MIN_FALL`] of the maximum speed in `fallen_s`; `batch_s` is the maximum duration of a batch of
/// residuals, s.
fn fit(samples: &[(f64, f64)], speed_m_s: f64, fallen_s: f64, batch_s: f64) -> Laws<4> {
    let viscous_1_s = -(MIN_FALL / RELEASED).ln() / fallen_s;
    let dry_m_s2 = (1.0 - MIN_FALL / RELEASED) * speed_m_s / fallen_s;
    let law = Law {
        value: |p: &SVector<f64, 4>, t: f64| Coast::from(<[f64; 4]>::from(*p)).path_m(t),
        batch_s: |_: &_| batch_s,
        min_noise: MIN_NOISE_M,
    };
    let begin = SVector::from([0.0, speed_m_s, viscous_1_s, 0.0]);
    let viscous = Curve::fit(samples, begin, [0, 1, VISCOUS], law);
    let begin = SVector::from([0.0, speed_m_s, 0.0, dry_m_s2]);
    let dry = Curve::fit(samples, begin, [0, 1, DRY], law);
    let both = [viscous, dry]
        .map(|begin| Curve::fit(samples, begin?.parameters, [0, 1, VISCOUS, DRY], law));
    let both = Curve::smallest(both);
    let curves = [viscous, dry, both];
    Laws { curves, terms: [VISCOUS, DRY], widening: UPRIGHT_ERROR, min_noise: MIN_NOISE_M }
}

/// Returns the time, s, and the path length along the heading, m, for the frames in which link 0 is visible.
/// `direction` is 1 if the robot travels along its heading and -1 if against it.
fn path_length(
    seen: &Coordinates,
    frames: Range<usize>,
    direction: f64,
    rate_hz: f64,
) -> Vec<(f64, f64)> {
    let mut samples: Vec<(f64, f64)> = Vec::with_capacity(frames.len());
    let mut last: Option<[f64; 3]> = None;
    let start = frames.start;
    for i in frames {
        let [x, y, theta] = [seen.x_m[i], seen.y_m[i], seen.theta_rad[i]];
        if x.is_nan() || theta.is_nan() {
            continue;
        }
        let step = last.map_or(0.0, |last: [f64; 3]| {
            let (sin, cos) = (0.5 * (theta + last[2])).sin_cos();
            direction * ((x - last[0]) * cos + (y - last[1]) * sin)
        });
        let before = samples.last().map_or(0.0, |(_, length)| *length);
        samples.push(((i - start) as f64 / rate_hz, before + step));
        last = Some([x, y, theta]);
    }
    samples
}
