//! The metrics of every whole cycle (eq. 17 and 20).

use std::f64::consts::TAU;
use std::ops::Range;

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Gait, Robot};
use trilink_statistics::{mean, seen};
use trilink_tables::{Columns as _, Coordinates, JointCycle, WheelVelocities};

use crate::phase::{GAIT_HARMONICS, GaitPhase, Harmonics};
use crate::poses::Tracked;

/// A cycle in which a commanded joint is off its gait by more than this part of the amplitude
/// (RMS) is not the gait: a start, a stop, a pause.
const LARGEST_DEVIATION: f64 = 0.2;

/// A cycle may begin or end this many frames outside the recording, so that noise in the phase
/// does not decide whether a cycle that begins with the recording is there.
const END_TOLERANCE: f64 = 0.4;

/// One actuation period, from one zero phase of the command to the next.
#[derive(Debug, Clone)]
pub(crate) struct Cycle {
    /// Start and end, in frames after the first.
    pub start: f64,
    pub end: f64,
    /// All missing if the cycle touches a gap or a jump.
    pub metrics: GaitMetrics,
    /// What the joints do, as seen, without smoothing.
    pub gait: [JointCycle; 2],
    /// Components of the wheels' skid velocities, m/s: offset and harmonics, of which nothing is
    /// smoothed away, such that their squares sum to the mean square. Empty if the cycle touches
    /// a gap.
    pub skid_m_s: [Vec<f64>; 3],
    /// Whether the commanded joints did what they did in the other cycles.
    pub is_gait: bool,
}

impl Cycle {
    pub(crate) fn is_whole(&self) -> bool {
        !self.metrics.d_m.is_nan()
    }
}

/// What cycles are measured on.
pub(crate) struct CycleData<'a> {
    pub robot: &'a Robot,
    pub gait: &'a Gait,
    pub driven: &'a GaitPhase,
    /// Not smoothed, and what follows from that.
    pub tracked: &'a Tracked,
    pub raw_wheels: &'a WheelVelocities,
    pub rate_hz: f64,
    /// Smoothed, and what follows from that.
    pub smooth: &'a Coordinates,
    pub wheels: &'a WheelVelocities,
}

impl CycleData<'_> {
    /// All whole cycles of the time in which the robot is driven.
    pub(crate) fn cycles(&self) -> Vec<Cycle> {
        let GaitPhase { phase, moving, .. } = self.driven;
        let first_frame = moving.start as f64 - END_TOLERANCE;
        let last_frame = moving.end as f64 - 1.0 + END_TOLERANCE;
        let first = (phase.at(first_frame) / TAU).ceil() as i64;
        let last = (phase.at(last_frame) / TAU).floor() as i64;
        // Squared distances of the commanded joints from what they do on the whole.
        let commanded = (0..2).filter(|&joint| self.gait.joints[joint].is_some());
        let off_gait = commanded.filter_map(|joint| {
            let phi = &self.tracked.seen.phi_rad[joint];
            let fit = Harmonics::fit(phi, moving.clone(), phase, GAIT_HARMONICS)?;
            let fitted = fit.over(0..phi.len(), phase);
            let squares = phi.iter().zip(fitted).map(|(phi, fitted)| (phi - fitted).powi(2));
            Some((squares.collect(), LARGEST_DEVIATION * fit.amplitude(1)))
        });
        let off_gait: Vec<(Vec<f64>, f64)> = off_gait.collect();
        (first..last)
            .map(|k| {
                let [start, end] = [k, k + 1].map(|k| phase.frame_of(TAU * k as f64));
                let is_gait = off_gait.iter().all(|(squares, largest)| {
                    let squares = seen(&squares[frames_within(start, end)]);
                    mean(squares).max(0.0).sqrt() <= *largest
                });
                let metrics = self.metrics(start, end);
                let components = |skid_m_s: &Vec<f64>| {
                    let shape = metrics.and_then(|_| self.shape(skid_m_s, start, end));
                    shape.map_or(Vec::new(), Harmonics::components)
                };
                let skid_m_s = self.raw_wheels.skid_m_s.each_ref().map(components);
                let metrics = metrics.unwrap_or(GaitMetrics::MISSING);
                let gait = self.tracked.seen.phi_rad.each_ref().map(|phi_rad| {
                    let frames = frames_within(start, end);
                    Harmonics::fit(phi_rad, frames, phase, GAIT_HARMONICS)
                        .map_or_else(JointCycle::blank, |fit| first_harmonic(&fit))
                });
                Cycle { start, end, metrics, gait, skid_m_s, is_gait }
            })
            .collect()
    }

    /// A series as it goes over a cycle.
    pub(crate) fn shape(&self, series: &[f64], start: f64, end: f64) -> Option<Harmonics> {
        let GaitPhase { phase, shape_harmonics, .. } = self.driven;
        Harmonics::fit(series, frames_within(start, end), phase, *shape_harmonics)
    }

    /// `None` if the cycle touches a gap.
    fn metrics(&self, start: f64, end: f64) -> Option<GaitMetrics> {
        let Coordinates { x_m, y_m, theta_rad, phi_rad } = self.smooth;
        let has_gap = [x_m, theta_rad, &phi_rad[0], &phi_rad[1]]
            .iter()
            .any(|series| series[frames_within(start, end)].iter().any(|x| x.is_nan()));
        if has_gap {
            return None;
        }
        // Not of the smoothed angle: that would take from its amplitude; nor the extremes of the
        // angle itself, which noise adds to.
        let phi1 = self.shape(&self.tracked.filled.phi_rad[0], start, end)?;
        let change = |series: &[f64]| interpolate(series, end) - interpolate(series, start);
        let d_m = change(x_m).hypot(change(y_m));
        let omega_rad_s = self.driven.omega_rad_s;
        let scale = self.robot.l_m * omega_rad_s;
        let metrics = GaitMetrics {
            d_m,
            v_m_s: d_m * omega_rad_s / TAU,
            sigma: [0, 1, 2]
                .map(|wheel| mean_square(&self.wheels.skid_m_s[wheel], start, end).sqrt() / scale),
            alpha1_rad: phi1.half_range(),
            dtheta_rad: change(theta_rad),
        };
        (!metrics.to_array().iter().any(|x| x.is_nan())).then_some(metrics)
    }
}

/// What a joint does, but for higher harmonics.
pub(super) fn first_harmonic(fit: &Harmonics) -> JointCycle {
    JointCycle {
        offset_rad: fit.offset(),
        amplitude_rad: fit.amplitude(1),
        phase_rad: fit.phase_rad(),
    }
}

/// The frames between two times given in frames.
pub(super) fn frames_within(start: f64, end: f64) -> Range<usize> {
    start.ceil() as usize..end.floor() as usize + 1
}

/// Mean square between two times given in frames: every sample stands for the time halfway to
/// its neighbours.
fn mean_square(series: &[f64], start: f64, end: f64) -> f64 {
    let first = (start - 0.5).ceil().max(0.0) as usize;
    let last = (end + 0.5).ceil().min(series.len() as f64) as usize;
    let part = |i: usize| (i as f64 + 0.5).min(end) - (i as f64 - 0.5).max(start);
    (first..last).map(|i| part(i) * series[i] * series[i]).sum::<f64>() / (end - start)
}

/// The cubic through the four samples about a time given in frames (the outermost four at the
/// ends); NaN if one of them is missing.
fn interpolate(series: &[f64], frame: f64) -> f64 {
    if series.len() < 4 {
        return f64::NAN;
    }
    let first = (frame.floor() as usize).saturating_sub(1).min(series.len() - 4);
    let t = frame - first as f64;
    let (t1, t2, t3) = (t - 1.0, t - 2.0, t - 3.0);
    let s = &series[first..first + 4];
    (s[3] * t * t1 * t2 - s[0] * t1 * t2 * t3) / 6.0 + (s[1] * t2 - s[2] * t1) * t * t3 / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_is_interpolated_exactly_to_the_ends() {
        let cubic = |t: f64| 1.0 - 2.0 * t + 0.3 * t * t - 0.05 * t.powi(3);
        let series: Vec<f64> = (0..10).map(|i| cubic(i.into())).collect();
        for i in 0..=90 {
            let frame = f64::from(i) / 10.0;
            assert!((interpolate(&series, frame) - cubic(frame)).abs() < 1e-12, "{frame}");
        }
        let mut gap = series;
        gap[4] = f64::NAN;
        assert!(interpolate(&gap, 3.5).is_nan() && !interpolate(&gap, 1.5).is_nan());
    }

    #[test]
    fn the_mean_square_of_a_sine_over_its_period_is_a_half() {
        let step = TAU / 123.4;
        let series: Vec<f64> = (0..400).map(|i| (step * f64::from(i)).sin()).collect();
        for start in [0.0, 17.3, 100.7] {
            let mean = mean_square(&series, start, start + 123.4);
            assert!((mean - 0.5).abs() < 2e-4, "{mean}");
        }
    }
}
