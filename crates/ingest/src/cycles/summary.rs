//! One row for a trial: its means, its gait and its checks.

use std::f64::consts::TAU;
use std::ops::Range;

use trilink_robot::Gait;
use trilink_robot::metrics::{GaitMetrics, Metric};
use trilink_statistics::{self, Estimate, wrap};
use trilink_tables::trial::Trial;
use trilink_tables::{Columns as _, CycleRow, JointCycle, JointGait, TrialRow, TrialStatus};

use super::joints::joint_errors;
use super::means::{mean_change, mean_of, rms_without_noise};
use super::measure::{Cycle, CycleData, first_harmonic};
use super::noise::{SkidNoise, end_variances};
use super::outlying::outlying_cycle;
use super::steady::Steady;
use crate::checks::{Check, Finding};
use crate::diagnosis::check_gait;
use crate::phase::{GAIT_HARMONICS, Harmonics, LinearPhase};
use crate::signals::response;

/// A row in which nothing is known but what is in the list of trials.
pub(crate) fn blank_row(trial: &Trial) -> TrialRow {
    TrialRow {
        trial: trial.id.clone(),
        id: trial.id.clone(),
        file: trial.file.clone(),
        campaign: trial.campaign.clone().unwrap_or_default(),
        kind: trial.kind,
        omega_commanded_rad_s: trial.omega_rad_s.unwrap_or(f64::NAN),
        status: TrialStatus::Failed,
        ..TrialRow::blank()
    }
}

/// Adds to a row the means over the steady cycles and the measured gait.
pub(crate) fn describe_gait(
    row: &mut TrialRow,
    data: &CycleData,
    cycles: &[Cycle],
    steady: &Steady,
) {
    let driven = data.driven;
    row.omega_rad_s = driven.omega_rad_s;
    row.omega_rad_s_se = driven.omega_se_rad_s;
    row.cycles = steady.used.len() as i64;
    let used: Vec<&Cycle> = steady.used.iter().map(|&i| &cycles[i]).collect();
    let frames = steady.frames(cycles).unwrap_or(0..0);
    let common = joint_errors(data, &frames);
    let of =
        |metric: Metric| -> Vec<f64> { used.iter().map(|cycle| cycle.metrics[metric]).collect() };
    let [position, heading] = end_variances(data, row.smoothing_window as usize);
    let d = mean_change(&of(Metric::D), &steady.used, position, 0.0);
    let per_turn = driven.omega_rad_s / TAU;
    let dtheta = mean_change(&of(Metric::Dtheta), &steady.used, heading, 0.0);
    let alpha1 = mean_of(&of(Metric::Alpha1));
    let scale = data.robot.l_m * driven.omega_rad_s;
    let sigma = Metric::SIGMA.map(|metric| mean_of(&of(metric)));
    row.metrics = GaitMetrics {
        d_m: d.value,
        v_m_s: d.value * per_turn,
        sigma: sigma.map(|sigma| sigma.value),
        alpha1_rad: alpha1.value,
        dtheta_rad: dtheta.value,
    };
    row.sigma_debiased = [0, 1, 2].map(|wheel| {
        let skid: Vec<&[f64]> = used.iter().map(|cycle| &cycle.skid_m_s[wheel][..]).collect();
        let noise = SkidNoise::new(data, &used, wheel);
        let skid = rms_without_noise(&skid, &steady.used, noise, common.skid_square[wheel]);
        Estimate::new(skid.value / scale, skid.se / scale)
    });
    row.metrics_se = GaitMetrics {
        d_m: d.se,
        v_m_s: d.se * per_turn,
        sigma: [0, 1, 2].map(|wheel| {
            let Estimate { value, se } = sigma[wheel];
            se.hypot(common.skid_square[wheel] / (2.0 * value * scale * scale))
        }),
        alpha1_rad: alpha1.se.hypot(common.gait_rad[0][1]),
        dtheta_rad: dtheta.se,
    };
    row.gait = joint_gaits(&data.tracked.seen.phi_rad, &frames, &driven.phase);
    for (joint, gait) in row.gait.iter_mut().enumerate() {
        let phase_rad = gait.phase_rad;
        let error = |of: &dyn Fn(&JointCycle) -> f64| {
            mean_of(&used.iter().map(|cycle| of(&cycle.gait[joint])).collect::<Vec<_>>()).se
        };
        let common = common.gait_rad[joint];
        gait.offset_rad_se = error(&|cycle| cycle.offset_rad).hypot(common[0]);
        gait.amplitude_rad_se = error(&|cycle| cycle.amplitude_rad).hypot(common[1]);
        gait.phase_rad_se = error(&|cycle| wrap(cycle.phase_rad - phase_rad)).hypot(common[2]);
    }
    let left = |k: f64| response(row.smoothing_window as usize, k * driven.phase.step_rad);
    [row.smoothing_left1, row.smoothing_left2, row.smoothing_left3] = [1.0, 2.0, 3.0].map(left);
}

/// What both joints do in some frames; blank where too few show it.
pub(crate) fn joint_gaits(
    phi_rad: &[Vec<f64>; 2],
    frames: &Range<usize>,
    phase: &LinearPhase,
) -> [JointGait; 2] {
    let gait = |phi_rad: &Vec<f64>| joint_gait(phi_rad, frames.clone(), phase);
    phi_rad.each_ref().map(|phi_rad| gait(phi_rad).unwrap_or_else(JointGait::blank))
}

/// Offset, amplitude and phase of an angle's first harmonic, and the RMS of its higher ones, rad.
/// The angle is not smoothed, so nothing of the amplitude is lost.
fn joint_gait(phi_rad: &[f64], frames: Range<usize>, phase: &LinearPhase) -> Option<JointGait> {
    let fit = Harmonics::fit(phi_rad, frames, phase, GAIT_HARMONICS)?;
    let squares = (2..=GAIT_HARMONICS).map(|k| 0.5 * fit.amplitude(k).powi(2)).sum::<f64>();
    let JointCycle { offset_rad, amplitude_rad, phase_rad } = first_harmonic(&fit);
    Some(JointGait {
        offset_rad,
        amplitude_rad,
        phase_rad,
        harmonics_rad: squares.sqrt(),
        ..JointGait::blank()
    })
}

/// `cycles/<trial>.parquet`.
pub(crate) fn cycle_rows(
    trial: &Trial,
    cycles: &[Cycle],
    steady: &Steady,
    rate_hz: f64,
) -> Vec<CycleRow> {
    let row = |(i, cycle): (usize, &Cycle)| CycleRow {
        trial: trial.id.clone(),
        cycle: i as i64,
        start_s: cycle.start / rate_hz,
        metrics: cycle.metrics,
        gait: cycle.gait,
        used: steady.used.binary_search(&i).is_ok(),
        reason: steady.reason(i, cycle),
    };
    cycles.iter().enumerate().map(row).collect()
}

/// Checks of a trial with a commanded gait.
pub(crate) fn gait_checks(
    row: &TrialRow,
    data: &CycleData,
    cycles: &[Cycle],
    steady: &Steady,
) -> Vec<Finding> {
    let (omega, commanded) = (row.omega_rad_s, row.omega_commanded_rad_s);
    let used = steady.used.len();
    let off_command = (omega / commanded - 1.0).abs();
    let measured = format!("{omega:.4} rad/s were measured, {commanded} rad/s commanded");
    let counted = format!(
        "{used} of {} whole cycles count, after {} of transient and without {} off the gait",
        cycles.len(),
        steady.skipped,
        steady.off_gait
    );
    let part_gapped = steady.gapped as f64 / (used + steady.gapped).max(1) as f64;
    let gapped = match steady.gapped {
        1 => "1 cycle with gaps is left out".to_owned(),
        several => format!("{several} cycles with gaps are left out"),
    };
    let drift = drift_of_d(cycles, steady);
    let drifted = format!("d changes by {:.2} % over the cycles used", 100.0 * drift);
    let mut findings = vec![
        Finding::at_most(Check::Frequency, off_command, measured),
        Finding::at_least(Check::SteadyState, used as f64, counted),
        Finding::at_most(Check::LongGaps, part_gapped, gapped).notable(steady.gapped > 0),
        check_gait(row.gait.map(|joint| joint.command()), data.gait),
        Finding::at_most(Check::Drift, drift, drifted),
    ];
    let (phi_rad, phase) = (&data.tracked.seen.phi_rad, &data.driven.phase);
    let clipping = |frames| clipping_check(data.gait, phi_rad, &frames, phase);
    findings.extend(steady.frames(cycles).map(clipping));
    findings.push(outlying_cycle(cycles, steady, data.rate_hz));
    findings
}

/// Relative change of d from the first half of the used cycles to the second.
fn drift_of_d(cycles: &[Cycle], steady: &Steady) -> f64 {
    let half = steady.used.len() / 2;
    let mean =
        |used: &[usize]| trilink_statistics::mean(used.iter().map(|&i| cycles[i].metrics.d_m));
    let early = mean(&steady.used[..half]);
    let late = mean(&steady.used[steady.used.len() - half..]);
    (late / early - 1.0).abs()
}

/// Whether a servo saturates, so that its joint's angle has flat tops; angles as seen, unsmoothed.
///
/// A wave that is cut off at its peaks falls short of its own first harmonic there: a wave cut at
/// 0.9 of its amplitude has a first harmonic of 0.963 and stays 6.5 % below it. Distortions that
/// make the peaks sharper, and a servo that reaches less than its command as a whole, do not. A command
/// with a second harmonic has peaks of its own, which count in place of the first harmonic's.
fn clipping_check(
    gait: &Gait,
    phi_rad: &[Vec<f64>; 2],
    frames: &Range<usize>,
    phase: &LinearPhase,
) -> Finding {
    let mut value = 0.0;
    let mut message = "no joint stays short of its first harmonic".to_owned();
    for (joint, command) in gait.joints.iter().enumerate() {
        let Some(command) = command else { continue };
        let fit = Harmonics::fit(&phi_rad[joint], frames.clone(), phase, GAIT_HARMONICS);
        let Some(fit) = fit else { continue };
        let [lowest, highest] = fit.extremes().map(|extreme| (extreme - fit.offset()).abs());
        let [commanded_highest, commanded_lowest] = command.range_rad();
        let sides = [
            (highest, commanded_highest - command.offset_rad, "largest"),
            (lowest, command.offset_rad - commanded_lowest, "smallest"),
        ];
        for (peak, commanded, name) in sides {
            let of_first = match command.second {
                Some(_) => commanded / command.amplitude_rad,
                None => 1.0,
            };
            // The part of its amplitude by which the first harmonic is larger.
            let short = of_first - peak / fit.amplitude(1);
            if short > value {
                let (joint, percent) = (joint + 1, 100.0 * short);
                message = format!(
                    "joint {joint}'s {name} angle stays {percent:.1} % short of its first harmonic"
                );
                value = short;
            }
        }
    }
    Finding::at_most(Check::GaitClipping, value, message)
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
        clipping_check(&Gait::symmetric(), &[series.clone(), series], &(100..1700), &phase)
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
