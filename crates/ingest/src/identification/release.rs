//! Identifies stiffness, damping (eq. 11) and dry friction of the passive joint, released from rest (Fig. 8b).
//!
//! The robot is lifted so that no wheel touches the floor, its reference link (of three links the middle one) and all
//! other joints are held, and a passive joint is turned away from its rest angle and released. The links beyond the joint
//! then swing about it:
//! `J phi'' + c_tau phi' + T sign(phi') + k_tau (phi - gamma) = 0`
//! with their moment of inertia about the joint, `J = I + m b^2` for a single link, and damping, dry friction, or both
//! ([`Swing`]). (With its wheel on the floor a link would not swing, because the wheel would have to skid.) The standard
//! errors reflect the noise of the recording; J is taken from the configuration.

use std::f64::consts::PI;
use std::ops::Range;

use nalgebra::SVector;
use trilink_robot::decay::{DecayLaw, Swing};
use trilink_robot::{AnyRobot, Joint, Quantity};
use trilink_statistics::{Estimate, extremes, mean, median_high, seen};
use trilink_tables::{Columns as _, Coordinates, DecayFit, RobotParameterRow};

use super::laws::{self, Laws, Words};
use super::{Curve, Law};
use crate::checks::{Check, Finding};
use crate::error::Problem;
use crate::signals::{moving_average, noise};

/// Minimum deflection of a joint that is considered to have been released, rad.
const MIN_SWING_RAD: f64 = 0.05;
/// Fraction of the largest angle that the joint must have reached before its release is looked for.
const HELD: f64 = 0.95;
/// Fraction of the largest angle below which nobody holds the joint any more: the fit starts when the angle first falls
/// below it.
const RELEASED: f64 = 0.8;
/// Minimum amplitude of a swing, in standard deviations of the noise.
const NOISE_DEVIATIONS: f64 = 6.0;
/// Ratio of the duration of the fit to the time in which swings exceed the noise.
const FIT_DURATION: f64 = 1.5;
/// Minimum number of half-swings for a logarithmic decrement.
const MIN_SWINGS: usize = 3;
/// Width of the moving average applied before the peaks of the swings are measured, samples. It attenuates all peaks by
/// the same factor.
const PEAK_WINDOW: usize = 5;
/// Number of residual batches per period.
const BATCHES: f64 = 8.0;
/// Parameter index of the viscous term of a [`Swing`].
const VISCOUS: usize = 3;
/// Parameter index of the dry term of a [`Swing`].
const DRY: usize = 5;
const WORDS: Words = Words {
    laws: [
        "a linear spring and damper",
        "a linear spring with dry friction",
        "a linear spring and damper with dry friction",
    ],
    motion: "a swing",
    rms: |fit| format!("{:.2} degrees", fit.misfit_rad.to_degrees()),
};
/// Lower bound on the noise of an angle, rad, set by the limited accuracy of the cameras.
const MIN_NOISE_RAD: f64 = 1e-4;

/// Identifies the robot's parameters from a trial of kind `joint-release` and checks the trial.
///
/// # Errors
/// Returns an error if no joint was released or if the released joint swings too few times.
pub(crate) fn measure(
    robot: &AnyRobot,
    coordinates: &Coordinates,
    rate_hz: f64,
) -> Result<(RobotParameterRow, Vec<Finding>), Problem> {
    let phi_rad = &coordinates.phi_rad;
    let ranges = phi_rad.iter().map(|phi| extremes(seen(phi))).map(|[low, high]| high - low);
    // The joints that move less are held.
    let farther =
        |one: (usize, f64), other: (usize, f64)| if other.1 > one.1 { other } else { one };
    let joint = ranges.enumerate().reduce(farther).map_or(0, |(joint, _)| joint);
    if let AnyRobot::Chain(chain) = robot
        && let Some(Joint::Driven(_)) = chain.joints.get(joint)
    {
        return Err(Problem::ReleasedDriven { joint: joint + 1 });
    }
    let release = Release::new(&phi_rad[joint], rate_hz)?;
    let held_rad: Vec<f64> =
        phi_rad.iter().map(|phi| mean(seen(&phi[release.frames.clone()]))).collect();
    let inertia_kg_m2 = robot.inertia_about_joint_kg_m2(joint, &held_rad);
    let configured = |quantity| robot.value(robot.of_free_joint(quantity, joint));
    let mut checks = vec![held_check(coordinates, joint, &release)];
    let row = RobotParameterRow {
        joint: joint as i64 + 1,
        inertia_kg_m2,
        rest_angle_configured_rad: robot.rest_angle_rad(joint),
        stiffness_configured_nm_rad: configured(Quantity::Stiffness),
        damping_configured_nm_s_rad: configured(Quantity::Damping),
        ..release.parameters(inertia_kg_m2)
    };
    checks.extend(laws::checks(&row, &WORDS, DecayLaw::Viscous));
    Ok((row, checks))
}

/// Sets the stiffness, the damping and the dry friction of the joint, and the standard errors of its natural frequency
/// and damping ratio, which follow from those of stiffness and damping.
pub(super) fn set_parameters(
    row: &mut RobotParameterRow,
    [stiffness, damping, dry]: [Estimate; 3],
) {
    row.stiffness_nm_rad = stiffness;
    row.damping_nm_s_rad = damping;
    row.joint_dry_nm = dry;
    row.natural_rad_s.se = 0.5 * row.natural_rad_s.value * stiffness.se / stiffness.value;
    row.damping_ratio.se = row.damping_ratio.value * damping.se / damping.value;
}

/// Checks that the held links do not move while the joint swings.
fn held_check(coordinates: &Coordinates, joint: usize, release: &Release) -> Finding {
    let others = coordinates.phi_rad.iter().enumerate().filter(|(other, _)| *other != joint);
    let moved = std::iter::once(&coordinates.theta_rad)
        .chain(others.map(|(_, phi)| phi))
        .map(|series| deviation(&series[release.frames.clone()]))
        .fold(0.0, f64::max);
    let message = format!("the clamped links move by {:.2} degrees (RMS)", moved.to_degrees());
    Finding::at_most(Check::HeldLinks, moved / release.largest_rad, message)
}

/// Swing of a released joint and the laws fitted to it.
struct Release {
    rate_hz: f64,
    /// Approximate rest angle of the joint, rad, from which `swing` is measured.
    rest_rad: f64,
    swing: Vec<f64>,
    /// Smoothed swing in the frames of the fit.
    smooth: Vec<f64>,
    largest_rad: f64,
    /// Number of half-swings whose peaks exceed the noise.
    count: usize,
    /// Range of frames that is fitted.
    frames: Range<usize>,
    laws: Laws<6>,
    viscous: Curve<6>,
}

impl Release {
    fn new(phi: &[f64], rate_hz: f64) -> Result<Self, Problem> {
        // In the last fifth of the visible frames the joint is nearly at rest.
        let all: Vec<f64> = seen(phi).collect();
        let rest_rad = median_high(all[all.len() - all.len().div_ceil(5)..].to_vec());
        let swing: Vec<f64> = phi.iter().map(|phi| phi - rest_rad).collect();
        let largest_rad = swing.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
        if largest_rad < MIN_SWING_RAD {
            return Err(Problem::NotReleased {
                found_deg: largest_rad.to_degrees(),
                needed_deg: MIN_SWING_RAD.to_degrees(),
            });
        }
        let noise_rad = noise(phi);
        let (start, mut end) = free_frames(&swing, largest_rad, noise_rad);
        let smooth = moving_average(&swing, PEAK_WINDOW);
        let swings = swings(&smooth[start..end], noise_rad);
        if swings.len() < MIN_SWINGS {
            return Err(Problem::FewSwings { found: swings.len(), needed: MIN_SWINGS });
        }
        let heights = swings.iter().map(|(_, height)| *height);
        let first_guess = decrement((0..).map(f64::from).zip(heights), noise_rad);
        let half_s =
            (swings[swings.len() - 1].0 - swings[0].0) / (swings.len() - 1) as f64 / rate_hz;
        let guess =
            [0.0, RELEASED * largest_rad, 0.0, first_guess.value / half_s, PI / half_s, 0.0];
        let mut laws = fit(&samples(&swing, start..end, rate_hz), guess);
        // When friction is about to stop the joint, it creeps to rest below the transition speed.
        let held_s = laws.curve(DecayLaw::CoulombViscous).map(|both| swing_of(both).stops_s());
        let is_dry = laws.f(DecayLaw::Viscous) > laws.f_limit();
        if let Some(held_s) = held_s.filter(|_| is_dry) {
            let left_out_s = if held_s > MIN_SWINGS as f64 * 2.0 * half_s { half_s } else { 0.0 };
            end = end.min(start + ((held_s - left_out_s) * rate_hz) as usize + 1);
            laws = fit(&samples(&swing, start..end, rate_hz), guess);
        }
        let no_decay = Problem::FewSwings { found: 0, needed: MIN_SWINGS };
        let Some(&viscous) = laws.curve(DecayLaw::Viscous) else { return Err(no_decay) };
        let Swing { viscous_1_s, damped_rad_s, .. } = swing_of(&viscous);
        if viscous_1_s <= 0.0 || damped_rad_s <= 0.0 {
            return Err(no_decay);
        }
        Ok(Self {
            rate_hz,
            rest_rad,
            smooth: smooth[start..end].to_vec(),
            swing,
            largest_rad,
            count: swings.len(),
            frames: start..end,
            laws,
            viscous,
        })
    }

    /// Estimates the damping ratio from the logarithmic decrement, which assumes viscous damping.
    fn damping_ratio_by_decrement(&self) -> Estimate {
        let Self { rate_hz, swing, smooth, .. } = self;
        let [offset, cos, sin, decay_1_s, damped_rad_s, _] = self.viscous.parameters.into();
        // Heights of the swings at the peaks of the fitted decay: the largest values near the peaks would be biased by
        // noise.
        let peak =
            (damped_rad_s * sin - decay_1_s * cos).atan2(damped_rad_s * cos + decay_1_s * sin);
        let heights = (0..self.count).filter_map(|k| {
            let k = k as f64;
            let frame = (peak.rem_euclid(PI) + k * PI) / damped_rad_s * rate_hz;
            smooth.get(frame.round() as usize).map(|x| (k, (x - offset).abs()))
        });
        let start = self.frames.start;
        let fitted = swing_of(&self.viscous);
        let residuals: Vec<f64> = self
            .frames
            .clone()
            .map(|i| swing[i] - fitted.angle_rad((i - start) as f64 / rate_hz).0)
            .collect();
        let noise_of_height = deviation(&moving_average(&residuals, PEAK_WINDOW));
        let Estimate { value, se } =
            decrement(heights.filter(|(_, height)| *height > 0.0), noise_of_height);
        Estimate::new(damping_ratio(value), damping_ratio(value + se) - damping_ratio(value))
    }

    /// Returns the row of robot parameters that follow from the fitted laws.
    fn parameters(&self, inertia_kg_m2: f64) -> RobotParameterRow {
        let laws = &self.laws;
        let fits = DecayLaw::ALL
            .map(|law| laws.fit(law, |curve| joint_parameters(laws, law, curve, inertia_kg_m2)));
        let row = laws.row(fits);
        let preferred = row.law.map_or_else(DecayFit::blank, |law| fits[law as usize]);
        let curve = row.law.and_then(|law| laws.curve(law));
        let drawn = swing_of(curve.unwrap_or(&self.viscous));
        let row = RobotParameterRow {
            released_s: self.frames.start as f64 / self.rate_hz,
            decay_cosine_rad: drawn.cosine_rad,
            decay_sine_rad: drawn.sine_rad,
            stiffness_nm_rad: preferred.stiffness_nm_rad,
            damping_nm_s_rad: preferred.damping_nm_s_rad,
            joint_dry_nm: preferred.joint_dry_nm,
            ..row
        };
        let (Some(law), Some(curve)) = (row.law, curve) else { return row };
        let Swing { rest_rad, viscous_1_s, damped_rad_s, .. } = swing_of(curve);
        let natural_rad_s = damped_rad_s.hypot(viscous_1_s);
        let decay = viscous_1_s / natural_rad_s;
        let damped = damped_rad_s / natural_rad_s;
        let ratio_slopes =
            [0.0, 0.0, 0.0, damped * damped / natural_rad_s, -decay * damped / natural_rad_s, 0.0];
        RobotParameterRow {
            natural_rad_s: laws.estimate(
                curve,
                natural_rad_s,
                [0.0, 0.0, 0.0, decay, damped, 0.0].into(),
            ),
            damping_ratio: if law == DecayLaw::Coulomb {
                Estimate::MISSING
            } else {
                laws.estimate(curve, decay, ratio_slopes.into())
            },
            damping_ratio_decrement: if law == DecayLaw::Viscous {
                self.damping_ratio_by_decrement()
            } else {
                Estimate::MISSING
            },
            rest_angle_rad: laws.estimate(
                curve,
                self.rest_rad + rest_rad,
                [1.0, 0.0, 0.0, 0.0, 0.0, 0.0].into(),
            ),
            ..row
        }
    }
}

/// Returns the damping ratio that corresponds to a logarithmic decrement per half-period.
fn damping_ratio(decrement: f64) -> f64 {
    decrement / decrement.hypot(PI)
}

/// Returns the time after the release, s, and the angle, rad, for the frames in which the joint is visible.
fn samples(swing: &[f64], frames: Range<usize>, rate_hz: f64) -> Vec<(f64, f64)> {
    let start = frames.start;
    frames
        .filter(|&i| !swing[i].is_nan())
        .map(|i| ((i - start) as f64 / rate_hz, swing[i]))
        .collect()
}

fn swing_of(curve: &Curve<6>) -> Swing {
    Swing::from(<[f64; 6]>::from(curve.parameters))
}

/// Fits each law to samples of time, s, and angle, rad, starting from `guess`.
fn fit(samples: &[(f64, f64)], guess: [f64; 6]) -> Laws<6> {
    let law = Law {
        value: |p: &SVector<f64, 6>, t: f64| Swing::from(<[f64; 6]>::from(*p)).angle_rad(t),
        batch_s: |p: &SVector<f64, 6>| 2.0 * PI / p[4].abs() / BATCHES,
        min_noise: MIN_NOISE_RAD,
    };
    let viscous = Curve::fit(samples, guess.into(), [0, 1, 2, VISCOUS, 4], law);
    let begin = viscous.map_or(guess.into(), |curve| curve.parameters);
    // Initial guess: dry friction dissipates a fraction of what damping dissipates in the first swings.
    let swing = Swing::from(<[f64; 6]>::from(begin));
    let lost_rad = swing.cosine_rad.hypot(swing.sine_rad) * (1.0 - swing.ratio());
    let dry = Curve::smallest([0.5, 0.25, 0.1].map(|fraction| {
        let mut begin = begin;
        begin[VISCOUS] = 0.0;
        begin[DRY] = fraction * lost_rad;
        Curve::fit(samples, begin, [0, 1, 2, 4, DRY], law)
    }));
    let both = [viscous, dry]
        .map(|begin| Curve::fit(samples, begin?.parameters, [0, 1, 2, VISCOUS, 4, DRY], law));
    let curves = [viscous, dry, Curve::smallest(both)];
    Laws { curves, terms: [VISCOUS, DRY], widening: 1.0, min_noise: MIN_NOISE_RAD }
}

/// Returns the parameters of the joint under one of the fitted laws.
fn joint_parameters(
    laws: &Laws<6>,
    law: DecayLaw,
    curve: &Curve<6>,
    inertia_kg_m2: f64,
) -> DecayFit {
    let Swing { viscous_1_s: decay, damped_rad_s: damped, dry_rad, .. } = swing_of(curve);
    let stiffness = inertia_kg_m2 * (decay * decay + damped * damped);
    let [by_decay, by_damped] = [decay, damped].map(|rate| 2.0 * inertia_kg_m2 * rate);
    let estimate = |value, [by_decay, by_damped, by_dry]: [f64; 3]| {
        laws.estimate(curve, value, SVector::from([0.0, 0.0, 0.0, by_decay, by_damped, by_dry]))
    };
    DecayFit {
        misfit_rad: curve.misfit,
        stiffness_nm_rad: estimate(stiffness, [by_decay, by_damped, 0.0]),
        damping_nm_s_rad: if law == DecayLaw::Coulomb {
            Estimate::MISSING
        } else {
            estimate(by_decay, [2.0 * inertia_kg_m2, 0.0, 0.0])
        },
        joint_dry_nm: if law == DecayLaw::Viscous {
            Estimate::MISSING
        } else {
            estimate(stiffness * dry_rad, [by_decay * dry_rad, by_damped * dry_rad, stiffness])
        },
        ..DecayFit::blank()
    }
}

/// Returns the start and the end of the frames that are fitted: from the release of the joint until some time after its
/// swings vanish in the noise.
fn free_frames(swing: &[f64], largest: f64, noise_rad: f64) -> (usize, usize) {
    let held = swing.iter().position(|x| x.abs() >= HELD * largest).unwrap_or(0);
    let free = swing[held..].iter().position(|x| x.abs() < RELEASED * largest);
    let start = held + free.unwrap_or(0);
    let last = swing.iter().rposition(|x| x.abs() > NOISE_DEVIATIONS * noise_rad);
    let moving = last.unwrap_or(start).saturating_sub(start);
    (start, swing.len().min(start + (FIT_DURATION * moving as f64) as usize))
}

/// Returns the frame and the height, rad, of the peak of every half-swing after the first crossing of the rest angle,
/// as long as the peaks exceed the noise.
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

/// Estimates the logarithmic decrement per half-period by a weighted regression of the logarithms of the heights of
/// half-swings on their numbers. `swings` has the number and the height, rad, of each half-swing; `noise_rad` is the
/// noise of the heights.
fn decrement(swings: impl Iterator<Item = (f64, f64)>, noise_rad: f64) -> Estimate {
    let swings: Vec<(f64, f64)> = swings.collect();
    let weighted = |value: &dyn Fn(f64, f64) -> f64| -> f64 {
        swings.iter().map(|(k, height)| height * height * value(*k, height.ln())).sum()
    };
    let weight = weighted(&|_, _| 1.0);
    let mean_k = weighted(&|k, _| k) / weight;
    let spread = weighted(&|k, _| (k - mean_k).powi(2));
    let value = -weighted(&|k, log_height| (k - mean_k) * log_height) / spread;
    // The logarithm of a height has a variance equal to that of the noise divided by the square of the height.
    Estimate { value, se: noise_rad / spread.sqrt() }
}

/// Returns the standard deviation of the visible samples of a series.
fn deviation(series: &[f64]) -> f64 {
    let middle = mean(seen(series));
    mean(seen(series).map(|x| (x - middle).powi(2))).sqrt()
}
