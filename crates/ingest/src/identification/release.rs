//! The passive joint let go from rest (Fig. 8b): its stiffness and damping (eq. 11), its dry friction.
//!
//! The robot is lifted so that no wheel touches the floor, its middle link and its actuated
//! joint are held, and the passive joint is turned from its rest and let go. Its link then
//! swings about the joint alone: `J phi'' + c_tau phi' + T sign(phi') + k_tau (phi - gamma) = 0` with
//! the link's moment of inertia about the joint, `J = I + m b^2`, and damping, dry friction, or both
//! ([`Swing`]). (On its wheel the link would not swing: the wheel would have to skid.) The errors are
//! those of the recording; J is taken as configured.

use std::f64::consts::PI;

use nalgebra::SVector;
use trilink_robot::Robot;
use trilink_robot::decay::{DecayLaw, Swing};
use trilink_statistics::{Estimate, extremes, mean, median_high, seen};
use trilink_tables::{Columns as _, Coordinates, DecayFit, FitStatus, RobotParameterRow};

use super::laws::{Laws, Words};
use super::{Curve, Law};
use crate::checks::{Check, Finding};
use crate::error::Problem;
use crate::signals::{moving_average, noise};

/// A joint that moves less than this was not let go, rad.
const LEAST_SWING_RAD: f64 = 0.05;
/// The joint is let go when it was this near its largest angle and is this far from it now, as
/// parts of that angle: then no hand is at it.
const HELD: f64 = 0.95;
const FREE: f64 = 0.8;
/// Swings below this many standard deviations of the noise are not counted, and the fit goes on
/// for this much longer than they are seen.
const NOISE_DEVIATIONS: f64 = 6.0;
const LONGER: f64 = 1.5;
/// Swings to one side or the other that a logarithmic decrement is taken from.
const LEAST_SWINGS: usize = 3;
/// Smoothing of the swings before their peaks are taken, samples. It lowers all by one factor.
const PEAK_WINDOW: usize = 5;
/// The recording is judged in so many parts of a period.
const BATCHES: f64 = 8.0;
/// Of a swing's parameters, those of its viscous and of its dry part.
const VISCOUS: usize = 3;
const DRY: usize = 5;
const WORDS: Words = Words {
    laws: [
        "a linear spring and damper",
        "a linear spring with dry friction",
        "a linear spring and damper with dry friction",
    ],
    motion: "a swing",
    off: |misfit_rad| format!("{:.2} degrees", misfit_rad.to_degrees()),
};
/// No cameras see an angle better than this, rad.
const LEAST_NOISE_RAD: f64 = 1e-4;

/// The robot's parameters by a trial of kind `joint-release`, and its checks.
pub(crate) fn measure(
    robot: &Robot,
    coordinates: &Coordinates,
    rate_hz: f64,
) -> Result<(RobotParameterRow, Vec<Finding>), Problem> {
    let ranges = coordinates.phi_rad.each_ref().map(|phi| extremes(seen(phi)));
    // The other joint is held.
    let joint = usize::from(ranges[1][1] - ranges[1][0] > ranges[0][1] - ranges[0][0]);
    let phi = &coordinates.phi_rad[joint];
    // The last fifth of what was seen is about where the joint came to rest.
    let all: Vec<f64> = seen(phi).collect();
    let rest_rad = median_high(all[all.len() - all.len().div_ceil(5)..].to_vec());
    let swing: Vec<f64> = phi.iter().map(|phi| phi - rest_rad).collect();
    let largest = swing.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    if largest < LEAST_SWING_RAD {
        let (found_deg, needed_deg) = (largest.to_degrees(), LEAST_SWING_RAD.to_degrees());
        return Err(Problem::NotReleased { found_deg, needed_deg });
    }
    let noise_rad = noise(phi);
    let (start, mut end) = free_frames(&swing, largest, noise_rad);
    let smooth = moving_average(&swing, PEAK_WINDOW);
    let few = |found| Problem::FewSwings { found, needed: LEAST_SWINGS };
    let swings = swings(&smooth[start..end], noise_rad);
    if swings.len() < LEAST_SWINGS {
        return Err(few(swings.len()));
    }
    let heights = swings.iter().map(|(_, height)| *height);
    let first_guess = decrement((0..).map(f64::from).zip(heights), noise_rad);
    let half_s = (swings[swings.len() - 1].0 - swings[0].0) / (swings.len() - 1) as f64 / rate_hz;
    let seen_in = |end: usize| -> Vec<(f64, f64)> {
        let seen = (start..end).filter(|&i| !swing[i].is_nan());
        seen.map(|i| ((i - start) as f64 / rate_hz, swing[i])).collect()
    };
    let guess = [0.0, FREE * largest, 0.0, first_guess.value / half_s, PI / half_s, 0.0];
    let mut laws = fit(&seen_in(end), guess);
    // Where friction is about to hold the joint, it creeps to its rest below the transition speed.
    let held_s = laws.curve(DecayLaw::CoulombViscous).map(|both| swing_of(both).stops_s());
    let is_dry = laws.f(DecayLaw::Viscous) > laws.f_limit();
    if let Some(held_s) = held_s.filter(|_| is_dry) {
        let left_out_s = if held_s > LEAST_SWINGS as f64 * 2.0 * half_s { half_s } else { 0.0 };
        end = end.min(start + ((held_s - left_out_s) * rate_hz) as usize + 1);
        laws = fit(&seen_in(end), guess);
    }
    let viscous = laws.curve(DecayLaw::Viscous).ok_or_else(|| few(0))?;
    let [offset, cosine_rad, sine_rad, decay_1_s, damped_rad_s, _] = viscous.parameters.into();
    if decay_1_s <= 0.0 || damped_rad_s <= 0.0 {
        return Err(few(0));
    }

    // The heights of the swings where the fitted decay has its peaks: the largest ones there would
    // be those with the most noise.
    let (sin, cos) = (sine_rad, cosine_rad);
    let peak = (damped_rad_s * sin - decay_1_s * cos).atan2(damped_rad_s * cos + decay_1_s * sin);
    let height = |k: f64| {
        let frame = (peak.rem_euclid(PI) + k * PI) / damped_rad_s * rate_hz;
        smooth[start..end].get(frame.round() as usize).map(|x| (k, (x - offset).abs()))
    };
    let heights = (0..swings.len()).filter_map(|k| height(k as f64));
    let fitted = |i: usize| swing_of(viscous).angle_rad((i - start) as f64 / rate_hz).0;
    let residuals: Vec<f64> = (start..end).map(|i| swing[i] - fitted(i)).collect();
    let noise_of_height = deviation(&moving_average(&residuals, PEAK_WINDOW));
    let logarithmic = decrement(heights.filter(|(_, height)| *height > 0.0), noise_of_height);
    let ratio = |decrement: f64| decrement / decrement.hypot(PI);
    let ratio_by_decrement = Estimate::new(
        ratio(logarithmic.value),
        ratio(logarithmic.value + logarithmic.se) - ratio(logarithmic.value),
    );

    let link = joint + 1;
    let inertia_kg_m2 = robot.inertia_kg_m2[link] + robot.mass_kg[link] * robot.b_m.powi(2);
    let fits =
        DecayLaw::ALL.map(|law| laws.fit(law, |curve| given(&laws, law, curve, inertia_kg_m2)));
    let preferred = laws.preferred(&WORDS);
    let checks = laws.checks(&WORDS, &preferred, DecayLaw::Viscous);
    let (law, status) = FitStatus::split(preferred);
    let told = law.map_or_else(DecayFit::blank, |law| fits[law as usize]);
    let curve = law.and_then(|law| laws.curve(law));
    let of_curve = |value: &dyn Fn(&Swing) -> (f64, [f64; 6])| {
        curve.map_or(Estimate::MISSING, |curve| {
            let (value, slopes) = value(&swing_of(curve));
            laws.estimate(curve, value, slopes.into())
        })
    };
    // Of the angles' rates that of the swing, and the part of it that the viscous one is.
    let rates = |swing: &Swing| {
        let natural_rad_s = swing.damped_rad_s.hypot(swing.viscous_1_s);
        (natural_rad_s, swing.viscous_1_s / natural_rad_s, swing.damped_rad_s / natural_rad_s)
    };
    let is_damped = law.is_some_and(|law| law != DecayLaw::Coulomb);
    let drawn = swing_of(curve.unwrap_or(viscous));
    let [viscous, coulomb, coulomb_viscous] = fits;
    let row = RobotParameterRow {
        law,
        joint: link as i64,
        inertia_kg_m2,
        natural_rad_s: of_curve(&|swing| {
            let (natural_rad_s, decay, damped) = rates(swing);
            (natural_rad_s, [0.0, 0.0, 0.0, decay, damped, 0.0])
        }),
        damping_ratio: match is_damped {
            true => of_curve(&|swing| {
                let (natural_rad_s, decay, damped) = rates(swing);
                let by_decay = damped * damped / natural_rad_s;
                (decay, [0.0, 0.0, 0.0, by_decay, -decay * damped / natural_rad_s, 0.0])
            }),
            false => Estimate::MISSING,
        },
        damping_ratio_decrement: match law {
            Some(DecayLaw::Viscous) => ratio_by_decrement,
            _ => Estimate::MISSING,
        },
        rest_angle_rad: of_curve(&|swing| {
            (rest_rad + swing.rest_rad, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        }),
        rest_angle_configured_rad: robot.rest_angle_rad,
        released_s: start as f64 / rate_hz,
        decay_cosine_rad: drawn.cosine_rad,
        decay_sine_rad: drawn.sine_rad,
        stiffness_nm_rad: told.stiffness_nm_rad,
        stiffness_configured_nm_rad: robot.stiffness_nm_rad,
        damping_nm_s_rad: told.damping_nm_s_rad,
        damping_configured_nm_s_rad: robot.damping_nm_s_rad,
        joint_dry_nm: told.joint_dry_nm,
        viscous,
        coulomb,
        coulomb_viscous,
        misfit_over_noise_limit: laws.misfit_limit(),
        f_limit: laws.f_limit(),
        status,
        ..RobotParameterRow::blank()
    };
    let held = [&coordinates.theta_rad, &coordinates.phi_rad[1 - joint]];
    let moved =
        held.map(|series| &series[start..end]).map(deviation).into_iter().fold(0.0, f64::max);
    let moved_part = moved / largest;
    let moved = format!("the held links move by {:.2} degrees (RMS)", moved.to_degrees());
    let held = Finding::at_most(Check::HeldLinks, moved_part, moved);
    Ok((row, std::iter::once(held).chain(checks).collect()))
}

fn swing_of(curve: &Curve<6>) -> Swing {
    Swing::from(<[f64; 6]>::from(curve.parameters))
}

/// Fits each law to samples of time and angle.
fn fit(samples: &[(f64, f64)], guess: [f64; 6]) -> Laws<6> {
    let angle = |p: &SVector<f64, 6>, t: f64| Swing::from(<[f64; 6]>::from(*p)).angle_rad(t);
    let batch_s = |p: &SVector<f64, 6>| 2.0 * PI / p[4].abs() / BATCHES;
    let law = Law { value: angle, batch_s, least_noise: LEAST_NOISE_RAD };
    let viscous = Curve::fit(samples, guess.into(), [0, 1, 2, VISCOUS, 4], law);
    let begin = viscous.map_or(guess.into(), |curve| curve.parameters);
    // As much of the first swings as damping takes.
    let swing = Swing::from(<[f64; 6]>::from(begin));
    let lost_rad = swing.cosine_rad.hypot(swing.sine_rad) * (1.0 - swing.ratio());
    let dry = Curve::smallest([0.5, 0.25, 0.1].map(|part| {
        let mut begin = begin;
        (begin[VISCOUS], begin[DRY]) = (0.0, part * lost_rad);
        Curve::fit(samples, begin, [0, 1, 2, 4, DRY], law)
    }));
    let both = [viscous, dry]
        .map(|begin| Curve::fit(samples, begin?.parameters, [0, 1, 2, VISCOUS, 4, DRY], law));
    let curves = [viscous, dry, Curve::smallest(both)];
    Laws { curves, parts: [VISCOUS, DRY], widened: 1.0, least_noise: LEAST_NOISE_RAD }
}

/// What a law gives of the joint.
fn given(laws: &Laws<6>, law: DecayLaw, curve: &Curve<6>, inertia_kg_m2: f64) -> DecayFit {
    let Swing { viscous_1_s: decay, damped_rad_s: damped, dry_rad, .. } = swing_of(curve);
    let stiffness = inertia_kg_m2 * (decay * decay + damped * damped);
    let [by_decay, by_damped] = [decay, damped].map(|rate| 2.0 * inertia_kg_m2 * rate);
    let of = |has: bool, value, [by_decay, by_damped, by_dry]: [f64; 3]| match has {
        true => {
            let slopes = SVector::from([0.0, 0.0, 0.0, by_decay, by_damped, by_dry]);
            laws.estimate(curve, value, slopes)
        }
        false => Estimate::MISSING,
    };
    DecayFit {
        misfit_rad: curve.misfit,
        stiffness_nm_rad: of(true, stiffness, [by_decay, by_damped, 0.0]),
        damping_nm_s_rad: of(law != DecayLaw::Coulomb, by_decay, [2.0 * inertia_kg_m2, 0.0, 0.0]),
        joint_dry_nm: of(
            law != DecayLaw::Viscous,
            stiffness * dry_rad,
            [by_decay * dry_rad, by_damped * dry_rad, stiffness],
        ),
        ..DecayFit::blank()
    }
}

/// From where the joint is free to where it is at rest.
fn free_frames(swing: &[f64], largest: f64, noise_rad: f64) -> (usize, usize) {
    let held = swing.iter().position(|x| x.abs() >= HELD * largest).unwrap_or(0);
    let free = swing[held..].iter().position(|x| x.abs() < FREE * largest);
    let start = held + free.unwrap_or(0);
    let last = swing.iter().rposition(|x| x.abs() > NOISE_DEVIATIONS * noise_rad);
    let moving = last.unwrap_or(start).saturating_sub(start);
    (start, swing.len().min(start + (LONGER * moving as f64) as usize))
}

/// Frame and height of the peak of every swing to one side, after the first crossing of the
/// rest angle and while they stand out of the noise.
fn swings(swing: &[f64], noise_rad: f64) -> Vec<(f64, f64)> {
    let mut peaks: Vec<(f64, f64)> = Vec::new();
    let mut side = 0.0;
    for (i, x) in swing.iter().enumerate().filter(|(_, x)| !x.is_nan()) {
        if x.signum() != side && (side == 0.0 || x.abs() > noise_rad) {
            if side != 0.0 {
                peaks.push((i as f64, 0.0));
            }
            side = x.signum();
        }
        if let Some(peak) = peaks.last_mut()
            && x.abs() > peak.1
        {
            *peak = (i as f64, x.abs());
        }
    }
    let small = peaks.iter().position(|(_, height)| *height < NOISE_DEVIATIONS * noise_rad);
    peaks.truncate(small.unwrap_or(peaks.len()));
    peaks
}

/// Logarithmic decrement of half a period, by weighted regression on the numbers and heights of
/// swings, whose heights have this noise.
fn decrement(swings: impl Iterator<Item = (f64, f64)>, noise_rad: f64) -> Estimate {
    let swings: Vec<(f64, f64)> = swings.collect();
    let weighted = |value: &dyn Fn(f64, f64) -> f64| -> f64 {
        swings.iter().map(|(k, height)| height * height * value(*k, height.ln())).sum()
    };
    let weight = weighted(&|_, _| 1.0);
    let middle = weighted(&|k, _| k) / weight;
    let spread = weighted(&|k, _| (k - middle).powi(2));
    let value = -weighted(&|k, height| (k - middle) * height) / spread;
    // The logarithm of a height has the variance of the noise over the height's square.
    Estimate { value, se: noise_rad / spread.sqrt() }
}

/// Standard deviation of what was seen.
fn deviation(series: &[f64]) -> f64 {
    let middle = mean(seen(series));
    mean(seen(series).map(|x| (x - middle).powi(2))).sqrt()
}
