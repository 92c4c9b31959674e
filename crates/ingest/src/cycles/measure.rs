//! Metrics of every whole cycle (eq. 17 and 20).

use std::f64::consts::TAU;
use std::ops::Range;

use trilink_robot::JointCommand;
use trilink_robot::metrics::{GaitMetrics, padded};
use trilink_statistics::{mean, seen};
use trilink_tables::{Columns as _, Coordinates, JointCycle, WheelVelocities};

use crate::geometry::Geometry;
use crate::phase::{GAIT_HARMONICS, GaitPhase, Harmonics};
use crate::poses::Tracked;
use crate::smoothing::SmoothedMotion;

/// Maximum RMS deviation of a commanded joint from its mean gait, relative to the amplitude of its first two harmonics. A
/// cycle that exceeds it contains a start, a stop or a pause.
const MAX_DEVIATION: f64 = 0.2;

/// Number of frames by which a cycle may extend beyond either end of the recording, so that noise in the phase does not
/// decide whether a cycle at the very start of the recording is included.
const END_TOLERANCE: f64 = 0.4;

/// Cycle: one actuation period, from one zero of the command's phase to the next.
#[derive(Debug, Clone)]
pub(crate) struct Cycle {
    /// Start of the cycle, in frames from the first frame of the recording.
    pub start: f64,
    /// End of the cycle, in frames from the first frame of the recording.
    pub end: f64,
    /// Metrics of the cycle; all NaN if it overlaps a gap or a jump.
    pub metrics: GaitMetrics,
    /// First harmonics of the joint angles as recorded, without smoothing.
    pub gait: Vec<JointCycle>,
    /// Offset and harmonics of the wheels' unsmoothed skid velocities, m/s, scaled so that their squares sum to the
    /// mean square. Empty if the cycle overlaps a gap.
    pub skid_m_s: Vec<Vec<f64>>,
    /// Whether the commanded joints moved as in the other cycles.
    pub is_gait: bool,
}

impl Cycle {
    /// Returns whether the cycle is free of gaps and jumps.
    pub(crate) fn is_whole(&self) -> bool {
        !self.metrics.d_m.is_nan()
    }
}

/// Trajectories, command and settings from which cycles are measured.
pub(crate) struct CycleData<'a> {
    pub geometry: &'a Geometry,
    /// Commands of the joints from front to rear; `None` for a joint that is not commanded.
    pub joints: &'a [Option<JointCommand>],
    pub driven: &'a GaitPhase,
    /// Unsmoothed trajectories.
    pub tracked: &'a Tracked,
    /// Wheel velocities derived from the unsmoothed trajectories.
    pub raw_wheels: &'a WheelVelocities,
    pub rate_hz: f64,
    pub motion: &'a SmoothedMotion,
}

impl CycleData<'_> {
    /// Measures all cycles in the period in which the robot is driven.
    pub(crate) fn cycles(&self) -> Vec<Cycle> {
        let GaitPhase { phase, moving, .. } = self.driven;
        let first_frame = moving.start as f64 - END_TOLERANCE;
        let last_frame = moving.end as f64 - 1.0 + END_TOLERANCE;
        let first = (phase.at(first_frame) / TAU).ceil() as i64;
        let last = (phase.at(last_frame) / TAU).floor() as i64;
        let deviations = self.gait_deviations();
        (first..last)
            .map(|k| {
                let [start, end] = [k, k + 1].map(|k| phase.frame_at(TAU * k as f64));
                self.cycle(start, end, &deviations)
            })
            .collect()
    }

    /// Returns, for each commanded joint, the squared deviation of its angle from the mean gait in every frame, rad^2,
    /// and the largest RMS deviation over a cycle, rad, with which the cycle still counts as following the gait. If no
    /// joint is commanded, these are the joints that swing at least half as far as the one that swings farthest. Joints
    /// whose mean gait cannot be fitted are omitted.
    fn gait_deviations(&self) -> Vec<(Vec<f64>, f64)> {
        let GaitPhase { phase, moving, .. } = self.driven;
        let is_commanded = self.joints.iter().any(Option::is_some);
        let joints =
            (0..self.joints.len()).filter(|&joint| !is_commanded || self.joints[joint].is_some());
        let fits: Vec<(usize, Harmonics)> = joints
            .filter_map(|joint| {
                let phi = &self.tracked.seen.phi_rad[joint];
                let fit = Harmonics::fit(phi, moving.clone(), phase, GAIT_HARMONICS)?;
                Some((joint, fit))
            })
            .collect();
        let largest_rad = fits.iter().map(|(_, fit)| fit.amplitude(1)).fold(0.0, f64::max);
        fits.into_iter()
            .filter(|(_, fit)| is_commanded || fit.amplitude(1) >= 0.5 * largest_rad)
            .map(|(joint, fit)| {
                let phi = &self.tracked.seen.phi_rad[joint];
                let fitted = fit.over(0..phi.len(), phase);
                let squares = phi.iter().zip(fitted).map(|(phi, fitted)| (phi - fitted).powi(2));
                (squares.collect(), MAX_DEVIATION * fit.amplitude(1).hypot(fit.amplitude(2)))
            })
            .collect()
    }

    fn cycle(&self, start: f64, end: f64, deviations: &[(Vec<f64>, f64)]) -> Cycle {
        let frames = frames_within(start, end);
        let is_gait = deviations.iter().all(|(squares, max_deviation)| {
            mean(seen(&squares[frames.clone()])).max(0.0).sqrt() <= *max_deviation
        });
        let metrics = self.metrics(start, end).unwrap_or(GaitMetrics::MISSING);
        let is_whole = !metrics.d_m.is_nan();
        let skid_m_s = self.raw_wheels.skid_m_s.iter().map(|skid_m_s| {
            let shape = is_whole.then(|| self.shape(skid_m_s, start, end)).flatten();
            shape.map_or(Vec::new(), Harmonics::components)
        });
        let gait = self.tracked.seen.phi_rad.iter().map(|phi_rad| {
            Harmonics::fit(phi_rad, frames.clone(), &self.driven.phase, GAIT_HARMONICS)
                .map_or_else(JointCycle::blank, |fit| first_harmonic(&fit))
        });
        let (gait, skid_m_s) = (gait.collect(), skid_m_s.collect());
        Cycle { start, end, metrics, gait, skid_m_s, is_gait }
    }

    /// Fits the Fourier series of a time series over a cycle; `None` if too few samples are available.
    pub(crate) fn shape(&self, series: &[f64], start: f64, end: f64) -> Option<Harmonics> {
        let GaitPhase { phase, shape_harmonics, .. } = self.driven;
        Harmonics::fit(series, frames_within(start, end), phase, *shape_harmonics)
    }

    /// Computes the metrics; `None` if the cycle overlaps a gap. Of the joints of the paper's robot, only the first has an
    /// amplitude.
    fn metrics(&self, start: f64, end: f64) -> Option<GaitMetrics> {
        let Coordinates { x_m, y_m, theta_rad, phi_rad } = &self.motion.coordinates;
        let has_gap = [x_m, theta_rad]
            .into_iter()
            .chain(&**phi_rad)
            .any(|series| series[frames_within(start, end)].iter().any(|x| x.is_nan()));
        if has_gap {
            return None;
        }
        // The smoothed angle has a reduced amplitude, and noise widens the range of the recorded angle; so neither is
        // used.
        let alpha_rad = |joint: usize| {
            Some(self.shape(&self.tracked.filled.phi_rad[joint], start, end)?.half_range())
        };
        let d_m = change(x_m, start, end).hypot(change(y_m, start, end));
        let omega_rad_s = self.driven.omega_rad_s;
        let scale = self.geometry.skid_length_m * omega_rad_s;
        let sigma: Vec<f64> = self
            .motion
            .wheels
            .skid_m_s
            .iter()
            .map(|skid_m_s| mean_square(skid_m_s, start, end).sqrt() / scale)
            .collect();
        let joints = if self.geometry.is_of_paper { 1 } else { self.geometry.joints() };
        let alpha_rad: Vec<f64> = (0..joints).map(alpha_rad).collect::<Option<_>>()?;
        let dtheta_rad = change(theta_rad, start, end);
        let links = sigma.iter().zip(&self.geometry.links);
        let of_wheels = links.filter(|(_, link)| link.wheel.is_some()).map(|(sigma, _)| sigma);
        let is_whole =
            ![d_m, dtheta_rad].iter().chain(&alpha_rad).chain(of_wheels).any(|x| x.is_nan());
        is_whole.then(|| GaitMetrics {
            d_m,
            v_m_s: d_m * omega_rad_s / TAU,
            sigma: padded(&sigma),
            alpha_rad: padded(&alpha_rad),
            dtheta_rad,
        })
    }
}

/// Returns the offset, the amplitude and the phase of a joint's first harmonic.
pub(super) fn first_harmonic(fit: &Harmonics) -> JointCycle {
    JointCycle {
        offset_rad: fit.offset(),
        amplitude_rad: fit.amplitude(1),
        phase_rad: fit.phase_rad(),
    }
}

/// Returns the range of frames between two times given in frames.
pub(super) fn frames_within(start: f64, end: f64) -> Range<usize> {
    start.ceil() as usize..end.floor() as usize + 1
}

/// Returns the change in a series between two times given in frames.
fn change(series: &[f64], start: f64, end: f64) -> f64 {
    interpolate(series, end) - interpolate(series, start)
}

/// Returns the mean square of a series between two times given in frames. Each sample represents the interval that
/// extends halfway to each of its neighbours.
fn mean_square(series: &[f64], start: f64, end: f64) -> f64 {
    let first = (start - 0.5).ceil().max(0.0) as usize;
    let last = (end + 0.5).ceil().min(series.len() as f64) as usize;
    let squares = (first..last).map(|i| {
        let duration = (i as f64 + 0.5).min(end) - (i as f64 - 0.5).max(start);
        duration * series[i] * series[i]
    });
    squares.sum::<f64>() / (end - start)
}

/// Interpolates a series at a time given in frames with the cubic through the four surrounding samples (the four
/// outermost ones at the ends); NaN if one of them is missing.
fn interpolate(series: &[f64], frame: f64) -> f64 {
    if series.len() < 4 {
        return f64::NAN;
    }
    let first = (frame.floor() as usize).saturating_sub(1).min(series.len() - 4);
    let t = frame - first as f64;
    let t1 = t - 1.0;
    let t2 = t - 2.0;
    let t3 = t - 3.0;
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
