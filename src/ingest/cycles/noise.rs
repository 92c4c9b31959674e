//! What the markers' noise makes of a cycle's skid.
//!
//! Noise is what differs where nothing can. Above the motion's frequencies everything is noise, and
//! its level there is that of white noise of the positions. Noise that is slower than that, such as
//! what is left of the links' tilt, is seen where the links' own poses leave a joint apart: it is
//! above the white noise of the same poses by a factor, which is taken to be that of the skid.
//! What differs between cycles is no measure: the skid itself may.

use super::measure::{Cycle, CycleData};
use crate::ingest::signals::{WEIGHTS, noise};
use crate::stats::mean;

/// How far the slow noise may be above the white one.
const LARGEST_EXCESS: f64 = 10.0;

/// Variance of a smoothed position at one end of a cycle, m^2, and of the heading, rad^2.
pub fn end_variances(data: &CycleData, window: usize) -> [f64; 2] {
    let filled = &data.tracked.filled;
    let [x, y, theta] = [&filled.x_m, &filled.y_m, &filled.theta_rad].map(|series| noise(series));
    [0.5 * (x * x + y * y), theta * theta].map(|variance| variance / window as f64)
}

/// Mean square of the skid velocities of wheels 0, 1, 2 that noise makes in the harmonics of a
/// cycle, m^2/s^2.
pub fn skid_noise(data: &CycleData, cycles: &[&Cycle]) -> [f64; 3] {
    let (count, step) = (data.driven.shape_harmonics, data.driven.phase.step_rad);
    let frames = mean(cycles.iter().map(|cycle| cycle.end - cycle.start));
    // Of differentiated white noise of unit variance, in all harmonics.
    let gain = |k: usize| {
        let (sin, sin2) = ((k as f64 * step).sin(), (2.0 * k as f64 * step).sin());
        ((8.0 * sin - sin2) / 6.0 * data.rate_hz).powi(2)
    };
    let white = 2.0 / frames * (1..=count).map(gain).sum::<f64>();
    let excess = slow_excess(data, cycles, frames);
    data.raw_wheels.skid_m_s.each_ref().map(|skid_m_s| {
        let position_m = noise(skid_m_s) * DIFFERENCES_GAIN.sqrt() / (third_gain() * data.rate_hz);
        excess * white * position_m.powi(2)
    })
}

/// By how much the noise in the harmonics of a cycle is above white noise, weighted as in velocities.
fn slow_excess(data: &CycleData, cycles: &[&Cycle], frames: f64) -> f64 {
    let (mut found, mut white) = (0.0, 0.0);
    for apart_mm in data.tracked.apart_mm.iter().flatten() {
        let shape = |cycle: &&Cycle| data.shape(apart_mm, cycle.start, cycle.end);
        let rates: Vec<Vec<f64>> =
            cycles.iter().filter_map(shape).map(|shape| shape.slope().components()).collect();
        if rates.len() < 3 {
            continue;
        }
        let n = rates.len() as f64;
        for i in 0..rates[0].len() {
            // What all cycles have in common is not noise: a layout that is a little off.
            let middle = mean(rates.iter().map(|rates| rates[i]));
            found += rates.iter().map(|rates| (rates[i] - middle).powi(2)).sum::<f64>() / (n - 1.0);
        }
        let squares: usize = (1..=data.driven.shape_harmonics).map(|k| k * k).sum();
        white += 2.0 / frames * noise(apart_mm).powi(2) * squares as f64;
    }
    if white > 0.0 { (found / white).clamp(1.0, LARGEST_EXCESS) } else { 1.0 }
}

/// Variance of the third differences of white noise.
const DIFFERENCES_GAIN: f64 = 20.0;

/// Standard deviation of the third differences of differentiated white noise.
fn third_gain() -> f64 {
    const THIRD: [f64; 4] = [-1.0, 3.0, -3.0, 1.0];
    let mut both = [0.0; WEIGHTS.len() + THIRD.len() - 1];
    for (i, a) in WEIGHTS.iter().enumerate() {
        for (j, b) in THIRD.iter().enumerate() {
            both[i + j] += a * b;
        }
    }
    both.iter().map(|weight| weight * weight).sum::<f64>().sqrt()
}
