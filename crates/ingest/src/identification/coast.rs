//! The straight robot pushed and left to coast: its roll resistance (eq. 14).
//!
//! All wheels roll at the robot's speed v and none skids, so `sum(m) v' = -sum(c^R) v - sum(F^R)` with
//! viscous resistance, dry friction, or both ([`Coast`]). The path is fitted, not the speed: it is
//! measured, and its noise is white. The masses are taken as configured, and the viscous sum is split
//! by the configured proportions: a straight robot does not determine more. A floor that slopes acts
//! as dry friction does.

use nalgebra::SVector;
use trilink_robot::Robot;
use trilink_robot::decay::{Coast, DecayLaw};
use trilink_statistics::Estimate;
use trilink_statistics::{mean, seen};
use trilink_tables::{Columns as _, Coordinates, DecayFit, FitStatus, RobotParameterRow};

use super::laws::{Laws, Words};
use super::{Curve, Law};
use crate::checks::{Check, Finding};
use crate::error::Problem;

/// A robot that is slower than this was not pushed, m/s.
const LEAST_SPEED_M_S: f64 = 0.05;
/// The robot is free below this part of its top speed, and the fit ends below this one.
const FREE: f64 = 0.95;
const SLOW: f64 = 0.1;
/// Dry friction has its size above so many transition speeds of the wheels; below, it is as viscous
/// resistance is.
const TRANSITIONS: f64 = 4.0;
/// The speed must fall to this part of the top speed, or the decay is not seen.
const LEAST_FALL: f64 = 0.6;
/// The recording is judged in at least so many parts.
const LEAST_BATCHES: f64 = 20.0;
/// How much larger the decay's error is than independent noise makes it. The links are set upright by
/// heights over a second, and the noise of those is as large a part of the way's over such a time as
/// the rest: too slow for batches to show it.
const UPRIGHT_ERROR: f64 = 1.25;
/// A recording has at least the noise of its digits, m.
const LEAST_NOISE_M: f64 = 1e-6;
/// Of a coast's parameters, those of its viscous and of its dry part, and the others with one.
const VISCOUS: usize = 2;
const DRY: usize = 3;
const WORDS: Words = Words {
    laws: ["viscous rolling", "dry rolling", "rolling with viscous resistance and dry friction"],
    motion: "a roll",
    off: |misfit_m| format!("{:.2} mm", 1e3 * misfit_m),
};

/// The robot's parameters by a trial of kind `coast-down`, and its checks; `speed_m_s` is the
/// smoothed roll velocity of wheel 0.
pub(crate) fn measure(
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
    let slow = SLOW.max(TRANSITIONS * robot.transition_m_s / top);
    let end = below(start, slow).unwrap_or(speed_m_s.len());
    let no_decay = || {
        let lowest = speed_m_s[start..].iter().fold(top, |low, v| low.min(v.abs()));
        let found = lowest / top;
        Problem::NoDecay { found, needed: LEAST_FALL }
    };
    let fall = below(start, LEAST_FALL).ok_or_else(no_decay)?;
    let samples = path_length(coordinates, start, end, rate_hz);
    let fallen_s = (fall - start).max(1) as f64 / rate_hz;
    let batch_s = (end - start) as f64 / rate_hz / LEAST_BATCHES;
    let laws = fit(&samples, FREE * top, fallen_s, batch_s);
    if DecayLaw::ALL.iter().all(|law| laws.curve(*law).is_none()) {
        return Err(no_decay());
    }

    let mass_kg: f64 = robot.mass_kg.iter().sum();
    let of_part = |law: DecayLaw, part: usize, times: f64| {
        let slopes = SVector::from_fn(|i, _| if i == part { times } else { 0.0 });
        let has = law != [DecayLaw::Coulomb, DecayLaw::Viscous][part - VISCOUS];
        let curve = laws.curve(law).filter(|_| has);
        curve.map_or(Estimate::MISSING, |curve| {
            laws.estimate(curve, times * curve.parameters[part], slopes)
        })
    };
    let fit = |law| {
        laws.fit(law, |curve| DecayFit {
            misfit_m: curve.misfit,
            roll_sum_kg_s: of_part(law, VISCOUS, mass_kg),
            roll_dry_sum_n: of_part(law, DRY, mass_kg),
            ..DecayFit::blank()
        })
    };
    let [viscous, coulomb, coulomb_viscous] = DecayLaw::ALL.map(fit);
    let preferred = laws.preferred(&WORDS);
    let checks = laws.checks(&WORDS, &preferred, configured_law(robot));
    let (law, status) = FitStatus::split(preferred);
    let told = |part, times| law.map_or(Estimate::MISSING, |law| of_part(law, part, times));
    let configured: f64 = robot.roll_kg_s.iter().sum();
    let sum = told(VISCOUS, mass_kg);
    // Nothing of nothing is unknown.
    let roll =
        |of_wheel| Estimate::new(sum.value * of_wheel / configured, sum.se * of_wheel / configured);
    let row = RobotParameterRow {
        law,
        mass_kg,
        decay_1_s: told(VISCOUS, 1.0),
        roll_sum_kg_s: sum,
        roll_sum_configured_kg_s: configured,
        roll_kg_s: robot.roll_kg_s.map(roll),
        roll_dry_sum_n: told(DRY, mass_kg),
        roll_dry_sum_configured_n: robot.roll_dry_n.iter().sum(),
        viscous,
        coulomb,
        coulomb_viscous,
        misfit_over_noise_limit: laws.misfit_limit(),
        f_limit: laws.f_limit(),
        status,
        ..RobotParameterRow::blank()
    };
    let bent_deg = coordinates
        .phi_rad
        .iter()
        .map(|phi| mean(seen(&phi[start..end])).abs().to_degrees())
        .fold(0.0, f64::max);
    let asked = match bent_deg > Check::Straight.limit() {
        true => ": is kind right in trials.toml, and is no table of [markers] turned?",
        false => "",
    };
    let bent = format!("the robot is bent by {bent_deg:.1} degrees{asked}");
    let straight = Finding::at_most(Check::Straight, bent_deg, bent);
    Ok((row, std::iter::once(straight).chain(checks).collect()))
}

/// The law of rolling that the robot is configured with.
fn configured_law(robot: &Robot) -> DecayLaw {
    let [is_viscous, is_dry] =
        [robot.roll_kg_s, robot.roll_dry_n].map(|of| of.iter().any(|of_wheel| *of_wheel > 0.0));
    match (is_viscous, is_dry) {
        (true, true) => DecayLaw::CoulombViscous,
        (false, true) => DecayLaw::Coulomb,
        (_, false) => DecayLaw::Viscous,
    }
}

/// Fits each law to samples of time and path, from a speed that falls to [`LEAST_FALL`] in a time.
fn fit(samples: &[(f64, f64)], speed_m_s: f64, fallen_s: f64, batch_s: f64) -> Laws<4> {
    let path = |p: &SVector<f64, 4>, t: f64| Coast::from(<[f64; 4]>::from(*p)).path_m(t);
    let viscous_1_s = -(LEAST_FALL / FREE).ln() / fallen_s;
    let dry_m_s2 = (1.0 - LEAST_FALL / FREE) * speed_m_s / fallen_s;
    let law = Law { value: path, batch_s: |_: &_| batch_s, least_noise: LEAST_NOISE_M };
    let one = |free, begin: [f64; 4]| Curve::fit::<3>(samples, begin.into(), free, law);
    let viscous = one([0, 1, VISCOUS], [0.0, speed_m_s, viscous_1_s, 0.0]);
    let dry = one([0, 1, DRY], [0.0, speed_m_s, 0.0, dry_m_s2]);
    let both = [viscous, dry]
        .map(|begin| Curve::fit(samples, begin?.parameters, [0, 1, VISCOUS, DRY], law));
    let both = Curve::smallest(both);
    let (curves, widened) = ([viscous, dry, both], UPRIGHT_ERROR);
    Laws { curves, parts: [VISCOUS, DRY], widened, least_noise: LEAST_NOISE_M }
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
