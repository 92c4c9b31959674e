//! Smooths the coordinates of the robot by state-space models.
//!
//! In the steady state the joint angles and the velocity of the robot in its own frame repeat in every cycle. The
//! heading is therefore a trend plus harmonics of the gait, and the position, as a complex number, a trend plus
//! harmonics that turn with the trend of the heading.

use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::Complex;
use trilink_robot::rotated;
use trilink_tables::Coordinates;

use super::kalman::{Regressors, Scalar, Smoothed, fit, smooth};
use crate::geometry::{MAX_VELOCITIES, Row};
use crate::phase::{GaitPhase, LinearPhase};
use crate::poses::Tracked;

/// Maximum half-amplitude frequency of the smoother, Hz. Motion that is not periodic is slower, and links vibrate faster on
/// their suspensions.
const MAX_CUTOFF_HZ: f64 = 5.0;
/// Maximum number of harmonics. Dry friction changes the acceleration abruptly, so that the harmonics decay slowly.
const MAX_HARMONICS: usize = 20;
/// Minimum number of frames per period of a harmonic.
const MIN_FRAMES: f64 = 6.0;

/// Harmonics of the gait in an angle.
struct AngleHarmonics {
    phase: LinearPhase,
    harmonics: Vec<usize>,
}

impl AngleHarmonics {
    /// Creates the regressors: the cosine and the sine of each of `count` harmonics.
    fn new(phase: LinearPhase, count: usize) -> Self {
        Self { phase, harmonics: (1..=count).rev().flat_map(|k| [k, k]).collect() }
    }
}

impl Regressors<f64> for AngleHarmonics {
    fn harmonics(&self) -> &[usize] {
        &self.harmonics
    }

    fn at(&self, frame: usize, values: &mut [f64], rates: &mut [f64]) {
        let step = Complex::cis(self.phase.at(frame as f64));
        let mut harmonic = Complex::new(1.0, 0.0);
        let pairs = values.chunks_exact_mut(2).zip(rates.chunks_exact_mut(2)).rev();
        for ((values, rates), k) in pairs.zip(1..) {
            harmonic *= step;
            let rate = f64::from(k) * self.phase.step_rad;
            values.copy_from_slice(&[harmonic.re, harmonic.im]);
            rates.copy_from_slice(&[-rate * harmonic.im, rate * harmonic.re]);
        }
    }
}

/// Harmonics of the gait in the position, which turn with the trend of the heading.
struct PathHarmonics<'a> {
    phase: LinearPhase,
    /// Trend of the heading and its change per frame.
    heading: &'a [[f64; 2]],
    harmonics: Vec<usize>,
}

impl<'a> PathHarmonics<'a> {
    /// Creates the regressors: both senses of rotation of each of `count` harmonics, and a constant in the turning
    /// frame.
    fn new(phase: LinearPhase, heading: &'a [[f64; 2]], count: usize) -> Self {
        let mut harmonics: Vec<usize> = (1..=count).rev().flat_map(|k| [k, k]).collect();
        if count > 0 {
            harmonics.push(0);
        }
        Self { phase, heading, harmonics }
    }
}

impl Regressors<Complex<f64>> for PathHarmonics<'_> {
    fn harmonics(&self) -> &[usize] {
        &self.harmonics
    }

    fn at(&self, frame: usize, values: &mut [Complex<f64>], rates: &mut [Complex<f64>]) {
        let ([pairs @ .., constant], [pair_rates @ .., constant_rate]) = (values, rates) else {
            return;
        };
        let [heading, turn] = self.heading[frame];
        let along = Complex::cis(heading);
        *constant = along;
        *constant_rate = Complex::new(0.0, turn) * along;
        let step = Complex::cis(self.phase.at(frame as f64));
        let mut harmonic = Complex::new(1.0, 0.0);
        let pairs = pairs.chunks_exact_mut(2).zip(pair_rates.chunks_exact_mut(2)).rev();
        for ((values, rates), k) in pairs.zip(1..) {
            harmonic *= step;
            let rate = f64::from(k) * self.phase.step_rad;
            values.copy_from_slice(&[along * harmonic, along * harmonic.conj()]);
            rates.copy_from_slice(&[
                Complex::new(0.0, turn + rate) * values[0],
                Complex::new(0.0, turn - rate) * values[1],
            ]);
        }
    }
}

/// Smoothed coordinates with their derivatives and errors.
pub(super) struct SmoothCoordinates {
    pub values: Coordinates,
    /// Derivatives, per second.
    pub rates: Coordinates,
    /// Errors of x and y (each), theta and the joint angles in every frame.
    pub errors: Vec<Vec<CoordinateError>>,
    /// Correlations of the residuals of x and y (along and across link 0), theta and the joint angles.
    pub correlations: [Row; MAX_VELOCITIES],
}

/// Cholesky factor of the covariance of a smoothed coordinate and its derivative, in the coordinate's unit and per
/// second.
#[derive(Debug, Clone, Copy)]
pub(super) struct CoordinateError {
    /// Standard error of the coordinate.
    pub value: f64,
    /// Part of the derivative's error that is proportional to that of the coordinate.
    pub rate_along: f64,
    /// Remaining standard error of the derivative.
    pub rate_rest: f64,
}

impl CoordinateError {
    const MISSING: Self = Self { value: f64::NAN, rate_along: f64::NAN, rate_rest: f64::NAN };

    fn new([value, rate, covariance]: [f64; 3], rate_hz: f64) -> Self {
        let sd = value.max(0.0).sqrt();
        let along = if sd > 0.0 { covariance / sd } else { 0.0 };
        let rest = (rate - along * along).max(0.0).sqrt();
        Self { value: sd, rate_along: along * rate_hz, rate_rest: rest * rate_hz }
    }
}

/// Returns the parts of a recording between jumps, starts and stops, which are smoothed separately, and whether the
/// robot is driven in them.
fn parts(tracked: &Tracked, driven: Option<&GaitPhase>) -> Vec<(Range<usize>, bool)> {
    let moving = driven.map_or(0..0, |driven| driven.moving.clone());
    let mut ends = vec![0, moving.start, moving.end, tracked.frames()];
    ends.extend(tracked.jumps.iter().map(|jump| jump.after));
    ends.sort_unstable();
    ends.dedup();
    let is_driven = |part: &Range<usize>| moving.start <= part.start && part.end <= moving.end;
    let parts = ends.windows(2).map(|ends| ends[0]..ends[1]);
    parts.map(|part| (part.clone(), is_driven(&part))).collect()
}

/// Smooths the coordinates. Frames beside jumps and in gaps that are too long to be filled stay missing.
pub(super) fn smooth_coordinates(
    tracked: &Tracked,
    driven: Option<&GaitPhase>,
    rate_hz: f64,
) -> SmoothCoordinates {
    let Coordinates { x_m, y_m, theta_rad, phi_rad } = &tracked.seen;
    let missing = tracked.seen.map(|series| vec![f64::NAN; series.len()]);
    let (mut values, mut rates) = (missing.clone(), missing);
    let joints = phi_rad.len();
    let mut errors = vec![vec![CoordinateError::MISSING; tracked.frames()]; 2 + joints];
    let max_cutoff_rad = TAU * MAX_CUTOFF_HZ / rate_hz;
    for (part, is_driven) in parts(tracked, driven) {
        let phase = driven.map(|driven| driven.phase).filter(|_| is_driven);
        let count = phase.map_or(0, |phase| (TAU / (MIN_FRAMES * phase.step_rad)) as usize);
        let count = count.min(MAX_HARMONICS);
        let phase = phase.unwrap_or(LinearPhase { step_rad: 0.0, offset_rad: 0.0 });
        let phase = LinearPhase { offset_rad: phase.at(part.start as f64), ..phase };
        let angle = AngleHarmonics::new(phase, count);
        let mut store =
            |i: usize, smooth: &Smoothed<f64>, values: &mut [f64], rates: &mut [f64]| {
                values[part.clone()].copy_from_slice(&smooth.value);
                for (rate, smooth) in rates[part.clone()].iter_mut().zip(&smooth.rate) {
                    *rate = smooth * rate_hz;
                }
                for (error, variance) in errors[i][part.clone()].iter_mut().zip(&smooth.variance) {
                    *error = CoordinateError::new(*variance, rate_hz);
                }
            };
        for joint in 0..joints {
            if let Some(phi) = smoothed(&phi_rad[joint][part.clone()], &angle, max_cutoff_rad) {
                store(2 + joint, &phi, &mut values.phi_rad[joint], &mut rates.phi_rad[joint]);
            }
        }
        let Some(theta) = smoothed(&theta_rad[part.clone()], &angle, max_cutoff_rad) else {
            continue;
        };
        store(1, &theta, &mut values.theta_rad, &mut rates.theta_rad);
        let path: Vec<Complex<f64>> = part.clone().map(|i| Complex::new(x_m[i], y_m[i])).collect();
        let harmonics = PathHarmonics::new(phase, &theta.trend, count);
        let Some(path) = smoothed(&path, &harmonics, max_cutoff_rad) else { continue };
        for (i, frame) in part.enumerate() {
            let Complex { re, im } = path.value[i];
            (values.x_m[frame], values.y_m[frame]) = (re, im);
            let Complex { re, im } = path.rate[i].scale(rate_hz);
            (rates.x_m[frame], rates.y_m[frame]) = (re, im);
            errors[0][frame] = CoordinateError::new(path.variance[i], rate_hz);
        }
    }
    let correlations = correlations(&tracked.seen, &values);
    leave_out_missing(&mut values, &tracked.filled);
    leave_out_missing(&mut rates, &tracked.filled);
    let Coordinates { x_m, theta_rad, phi_rad, .. } = &values;
    for (errors, values) in errors.iter_mut().zip([x_m, theta_rad].into_iter().chain(&**phi_rad)) {
        for (error, _) in errors.iter_mut().zip(values).filter(|(_, value)| value.is_nan()) {
            *error = CoordinateError::MISSING;
        }
    }
    SmoothCoordinates { values, rates, errors, correlations }
}

fn smoothed<T: Scalar>(
    series: &[T],
    regressors: &impl Regressors<T>,
    max_cutoff_rad: f64,
) -> Option<Smoothed<T>> {
    Some(smooth(series, regressors, &fit(series, regressors, max_cutoff_rad)?))
}

/// Sets the coordinates to missing where `filled` is missing.
fn leave_out_missing(values: &mut Coordinates, filled: &Coordinates) {
    let Coordinates { x_m, y_m, theta_rad, phi_rad } = values;
    let all = [(x_m, &filled.x_m), (y_m, &filled.y_m), (theta_rad, &filled.theta_rad)];
    for (values, filled) in all.into_iter().chain(phi_rad.iter_mut().zip(filled.phi_rad.iter())) {
        for (value, _) in values.iter_mut().zip(filled).filter(|(_, filled)| filled.is_nan()) {
            *value = f64::NAN;
        }
    }
}

/// Returns the correlations of the residuals of x and y (along and across link 0), theta and the joint angles.
fn correlations(seen: &Coordinates, smooth: &Coordinates) -> [Row; MAX_VELOCITIES] {
    let mut products = [Row::default(); MAX_VELOCITIES];
    for i in 0..seen.frames() {
        let position = [seen.x_m[i] - smooth.x_m[i], seen.y_m[i] - smooth.y_m[i]];
        let [along, across] = rotated(-smooth.theta_rad[i], position);
        let mut residuals = Row::default();
        residuals[..3].copy_from_slice(&[along, across, seen.theta_rad[i] - smooth.theta_rad[i]]);
        let joints = seen.phi_rad.iter().zip(smooth.phi_rad.iter());
        for (residual, (seen, smooth)) in residuals[3..].iter_mut().zip(joints) {
            *residual = seen[i] - smooth[i];
        }
        if residuals.iter().all(|x| !x.is_nan()) {
            for (products, a) in products.iter_mut().zip(residuals) {
                products.iter_mut().zip(residuals).for_each(|(product, b)| *product += a * b);
            }
        }
    }
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let scale = (products[i][i] * products[j][j]).sqrt();
            match scale {
                _ if i == j => 1.0,
                0.0 => 0.0,
                _ => products[i][j] / scale,
            }
        })
    })
}
