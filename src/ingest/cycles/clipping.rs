//! A servo that saturates: its joint's angle has flat tops.
//!
//! A wave that is cut off at its peaks falls short of its own first harmonic there: a wave cut at
//! 0.9 of its amplitude has a first harmonic of 0.963 and stays 6.5 % below it. Distortions that
//! make the peaks sharper, and a servo that reaches less than its command as a whole, do not.

use std::ops::Range;

use crate::ingest::checks::{CLIPPING, Check, Finding};
use crate::ingest::phase::{GAIT_HARMONICS, Harmonics, LinearPhase};
use crate::robot::Gait;

/// Checks the commanded joints over some frames; angles as seen, unsmoothed, rad.
pub fn check(
    gait: &Gait,
    phi_rad: &[Vec<f64>; 2],
    frames: &Range<usize>,
    phase: &LinearPhase,
) -> Finding {
    let mut worst = (0.0, String::new());
    for joint in (0..2).filter(|&joint| gait.joints[joint].is_some()) {
        let phi_rad = &phi_rad[joint];
        let Some(fit) = Harmonics::fit(phi_rad, frames.clone(), phase, GAIT_HARMONICS) else {
            continue;
        };
        let [lowest, highest] = fit.extremes().map(|extreme| (extreme - fit.offset()).abs());
        for (peak, name) in [(highest, "largest"), (lowest, "smallest")] {
            // The part of its amplitude by which the first harmonic is larger.
            let short = 1.0 - peak / fit.amplitude(1);
            if short > worst.0 {
                worst = (short, format!("joint {}'s {name} angle", joint + 1));
            }
        }
    }
    let (value, what) = worst;
    let message = match value > 0.0 {
        true => format!("{what} stays {:.1} % short of its first harmonic", 100.0 * value),
        false => "no joint stays short of its first harmonic".to_owned(),
    };
    Finding::at_most(Check::GaitClipping, value, CLIPPING, message)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finding(wave: impl Fn(f64) -> f64) -> Finding {
        let phase = LinearPhase { step_rad: 0.0325, offset_rad: 0.4 };
        let phi = |frame: usize| {
            // A little of what noise does, the same at every run.
            wave(phase.at(frame as f64)) + 0.002 * (7.7 * frame as f64).sin()
        };
        let series: Vec<f64> = (0..1800).map(phi).collect();
        check(&Gait::symmetric(), &[series.clone(), series], &(100..1700), &phase)
    }

    #[test]
    fn a_servo_that_stops_short_of_its_peaks_is_found_on_either_side() {
        for (low, high) in [(-0.45, 0.45), (-0.45, 1.0), (-1.0, 0.45), (-0.475, 0.475)] {
            let found = finding(|phase| (0.5 * phase.cos()).clamp(low, high) + 0.1);
            assert!(!found.holds(), "{low} {high}: {}", found.value);
        }
        let cut = finding(|phase| (0.5 * phase.cos()).clamp(-0.45, 0.45));
        assert!((cut.value - 0.06).abs() < 0.01, "{}", cut.value);
        assert!(cut.message.contains("angle stays 5."), "{}", cut.message);
    }

    #[test]
    fn a_servo_that_is_late_small_or_uneven_without_flat_tops_passes() {
        let sharp = |phase: f64| 0.5 * phase.cos() + 0.02 * (3.0 * phase).cos();
        let skewed = |phase: f64| 0.5 * phase.cos() + 0.015 * (2.0 * phase).sin();
        assert!(finding(|phase| 0.2 * (phase - 0.3).cos()).holds());
        assert!(finding(sharp).holds() && finding(skewed).holds());
    }
}
