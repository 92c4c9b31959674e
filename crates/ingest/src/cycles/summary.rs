//! Summarises a trial in one row of means and measured gait, and runs the checks of its cycles.

use std::f64::consts::TAU;
use std::ops::Range;

use trilink_robot::JointCommand;
use trilink_robot::metrics::{GaitMetrics, Metric, padded};
use trilink_statistics::{Estimate, mean, wrap};
use trilink_tables::trial::Trial;
use trilink_tables::{
    Columns as _, CycleRow, JointCycle, JointGait, Numbered, TrialRow, TrialStatus,
};

use super::common::common_errors;
use super::means::{independent_mean, mean_of_changes, rms_without_noise};
use super::measure::{Cycle, CycleData, first_harmonic};
use super::noise::{SkidNoise, end_variances};
use super::outlying::outlying_cycle;
use super::steady::CycleSelection;
use crate::checks::{Check, Finding};
use crate::diagnosis::check_gait;
use crate::phase::{GAIT_HARMONICS, Harmonics, LinearPhase};
use crate::signals::response;

/// Creates the row of a trial that has not been processed, with only the values of its entry in the trial list.
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

/// Adds the means over the used cycles and the measured gait to a row.
pub(crate) fn describe_gait(
    row: &mut TrialRow,
    data: &CycleData,
    cycles: &[Cycle],
    steady: &CycleSelection,
) {
    let driven = data.driven;
    row.omega_rad_s = driven.omega_rad_s;
    row.omega_rad_s_se = driven.omega_se_rad_s;
    row.cycles = steady.used.len() as i64;
    let used: Vec<&Cycle> = steady.used.iter().map(|&i| &cycles[i]).collect();
    let frames = steady.frames(cycles).unwrap_or(0..0);
    let common = common_errors(data, &frames);
    let of =
        |metric: Metric| -> Vec<f64> { used.iter().map(|cycle| cycle.metrics[metric]).collect() };
    let [position, heading] = end_variances(data, row.smoothing_window as usize);
    let d = mean_of_changes(&of(Metric::D), &steady.used, position, 0.0);
    let per_turn = driven.omega_rad_s / TAU;
    let dtheta = mean_of_changes(&of(Metric::Dtheta), &steady.used, heading, 0.0);
    let alpha = Metric::ALPHA.map(|metric| independent_mean(&of(metric)));
    let scale = data.geometry.skid_length_m * driven.omega_rad_s;
    let links = data.geometry.links.len();
    let sigma = Metric::SIGMA.map(|metric| independent_mean(&of(metric)));
    row.metrics = GaitMetrics {
        d_m: d.value,
        v_m_s: d.value * per_turn,
        sigma: sigma.map(|sigma| sigma.value),
        alpha_rad: alpha.map(|alpha| alpha.value),
        dtheta_rad: dtheta.value,
    };
    let debiased = |link: usize| {
        if data.geometry.links.get(link).is_none_or(|link| link.wheel.is_none()) {
            return Estimate::MISSING;
        }
        let skid: Vec<&[f64]> = used.iter().map(|cycle| &cycle.skid_m_s[link][..]).collect();
        let noise = SkidNoise::new(data, &used, link);
        let skid = rms_without_noise(&skid, &steady.used, noise, common.skid_square_se[link]);
        Estimate::new(skid.value / scale, skid.se / scale)
    };
    row.sigma_debiased = [0, 1, 2].map(debiased);
    row.more_sigma_debiased = (3..links).map(debiased).collect();
    let sigma_se = |link: usize, Estimate { value, se }: Estimate| {
        let skid_square_se = common.skid_square_se.get(link).copied().unwrap_or(f64::NAN);
        se.hypot(skid_square_se / (2.0 * value * scale * scale))
    };
    let alpha_se = |joint: usize| {
        let common_rad = common.gait_se_rad.get(joint).map_or(f64::NAN, |common_rad| common_rad[1]);
        alpha[joint].se.hypot(common_rad)
    };
    row.metrics_se = GaitMetrics {
        d_m: d.se,
        v_m_s: d.se * per_turn,
        sigma: std::array::from_fn(|link| sigma_se(link, sigma[link])),
        alpha_rad: std::array::from_fn(alpha_se),
        dtheta_rad: dtheta.se,
    };
    set_gait(row, joint_gaits(&data.tracked.seen.phi_rad, &frames, &driven.phase));
    row.heading_rad = data.motion.coordinates.direction_rad(frames.clone());
    let gaits = row.gait.iter_mut().chain(row.more_gait.iter_mut());
    for (joint, (gait, common)) in gaits.zip(&common.gait_se_rad).enumerate() {
        let phase_rad = gait.phase_rad;
        gait.offset_rad_se =
            standard_error(&used, joint, |cycle| cycle.offset_rad).hypot(common[0]);
        gait.amplitude_rad_se =
            standard_error(&used, joint, |cycle| cycle.amplitude_rad).hypot(common[1]);
        gait.phase_rad_se = standard_error(&used, joint, |cycle| wrap(cycle.phase_rad - phase_rad))
            .hypot(common[2]);
    }
    if row.smoothing_window > 0 {
        let left = |k: f64| response(row.smoothing_window as usize, k * driven.phase.step_rad);
        [row.smoothing_left1, row.smoothing_left2, row.smoothing_left3] = [1.0, 2.0, 3.0].map(left);
    }
    if row.noise_white == Some(false) {
        // A filter attenuates what is faster than its unknown cut-off. What a cycle adds up is unaffected by it.
        let unknown = f64::NAN;
        row.metrics_se =
            GaitMetrics { sigma: padded(&[]), alpha_rad: padded(&[]), ..row.metrics_se };
        let debiased = row.sigma_debiased.iter_mut().chain(row.more_sigma_debiased.iter_mut());
        debiased.for_each(|estimate| estimate.se = unknown);
        let gaits = row.gait.iter_mut().chain(row.more_gait.iter_mut());
        gaits.for_each(|gait| gait.amplitude_rad_se = unknown);
    }
}

/// Returns the standard error of the mean, over cycles, of a joint quantity.
fn standard_error(cycles: &[&Cycle], joint: usize, value: impl Fn(&JointCycle) -> f64) -> f64 {
    independent_mean(&cycles.iter().map(|cycle| value(&cycle.gait[joint])).collect::<Vec<_>>()).se
}

/// Fits the gaits of the joints in a range of frames; blank for a joint that is visible in too few frames.
pub(crate) fn joint_gaits(
    phi_rad: &[Vec<f64>],
    frames: &Range<usize>,
    phase: &LinearPhase,
) -> Vec<JointGait> {
    phi_rad
        .iter()
        .map(|phi_rad| joint_gait(phi_rad, frames.clone(), phase).unwrap_or_else(JointGait::blank))
        .collect()
}

/// Sets the gaits of all joints in a row.
pub(crate) fn set_gait(row: &mut TrialRow, mut gaits: Vec<JointGait>) {
    row.more_gait = Numbered(gaits.split_off(gaits.len().min(2)));
    row.gait = Numbered::<_, 1>(gaits).into_array_or(JointGait::blank());
}

/// Returns the measured motion of `count` joints.
pub(crate) fn measured_joints(row: &TrialRow, count: usize) -> Vec<JointCommand> {
    let gaits = row.gait.iter().chain(row.more_gait.iter());
    gaits.take(count).map(JointGait::command).collect()
}

/// Fits the offset, amplitude and phase of an angle's first harmonic, rad, and the RMS of its higher harmonics, rad;
/// `None` if the angle is known in too few frames. The angle must not be smoothed, because smoothing would reduce its
/// amplitude.
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

/// Builds the rows of `cycles/<trial>.parquet`.
pub(crate) fn cycle_rows(
    trial: &Trial,
    cycles: &[Cycle],
    steady: &CycleSelection,
    rate_hz: f64,
) -> Vec<CycleRow> {
    let cycles = cycles.iter().enumerate();
    cycles
        .map(|(i, cycle)| CycleRow {
            trial: trial.id.clone(),
            cycle: i as i64,
            start_s: cycle.start / rate_hz,
            metrics: cycle.metrics,
            gait: std::array::from_fn(|joint| {
                cycle.gait.get(joint).copied().unwrap_or_else(JointCycle::blank)
            }),
            more_gait: cycle.gait.iter().skip(2).copied().collect(),
            used: steady.used.binary_search(&i).is_ok(),
            reason: steady.reason(i, cycle),
        })
        .collect()
}

/// Runs the checks of a trial with a commanded gait.
pub(crate) fn gait_checks(
    row: &TrialRow,
    data: &CycleData,
    cycles: &[Cycle],
    steady: &CycleSelection,
) -> Vec<Finding> {
    let omega = row.omega_rad_s;
    let commanded = row.omega_commanded_rad_s;
    let used = steady.used.len();
    let off_command = (omega / commanded - 1.0).abs();
    let measured = format!("measured {omega:.4} rad/s, commanded {commanded} rad/s");
    let off_gait = match steady.off_gait {
        0 => String::new(),
        off_gait => format!("; cycles in which the joints did not follow the gait: {off_gait}"),
    };
    let after_last = steady.used.last().map_or(&[][..], |last| &cycles[last + 1..]);
    let after_last = match after_last.iter().filter(|cycle| !cycle.is_whole()).count() {
        0 => String::new(),
        several => format!("; with gaps after the last used cycle: {several}"),
    };
    let counted = format!(
        "{used} of {} cycles used; the first {} were still settling{off_gait}{after_last}",
        cycles.len(),
        steady.skipped
    );
    let part_gapped = steady.gapped as f64 / (used + steady.gapped).max(1) as f64;
    let gapped = match steady.gapped {
        1 => "1 cycle with gaps is left out".to_owned(),
        several => format!("{several} cycles with gaps are left out"),
    };
    let drift = drift_of_d(cycles, steady);
    let drifted = format!("d changes by {:.2} % over the used cycles", 100.0 * drift);
    let mut findings = vec![
        Finding::at_most(Check::Frequency, off_command, measured),
        Finding::at_least(Check::SteadyState, used as f64, counted),
        Finding::at_most(Check::LongGaps, part_gapped, gapped).notable(steady.gapped > 0),
    ];
    let is_commanded = data.joints.iter().any(Option::is_some);
    if is_commanded {
        let measured = measured_joints(row, data.joints.len());
        findings.push(check_gait(&measured, data.joints, data.geometry.is_of_paper));
    }
    findings.push(Finding::at_most(Check::Drift, drift, drifted));
    if let Some(frames) = steady.frames(cycles).filter(|_| is_commanded) {
        let phi_rad = &data.tracked.seen.phi_rad;
        findings.push(clipping_check(data.joints, phi_rad, &frames, &data.driven.phase));
    }
    findings.push(outlying_cycle(cycles, steady, data.rate_hz));
    findings
}

/// Returns the relative change in d from the first half of the used cycles to the second half.
fn drift_of_d(cycles: &[Cycle], steady: &CycleSelection) -> f64 {
    let half = steady.used.len() / 2;
    let [early, late] = [&steady.used[..half], &steady.used[steady.used.len() - half..]]
        .map(|used| mean(used.iter().map(|&i| cycles[i].metrics.d_m)));
    (late / early - 1.0).abs()
}

/// Checks whether a servo saturates, which flattens the peaks of its joint's angle. The angles are used as recorded,
/// without smoothing.
///
/// The peaks of a clipped wave fall short of the wave's first harmonic: a wave clipped at 0.9 of its amplitude has a
/// first harmonic of 0.963, and its peaks are 6.5 % below that. Distortions that sharpen the peaks have no such effect,
/// nor has a servo that attenuates the whole command. If a command has a second harmonic, the peaks of the command are
/// used in place of those of the first harmonic.
fn clipping_check(
    joints: &[Option<JointCommand>],
    phi_rad: &[Vec<f64>],
    frames: &Range<usize>,
    phase: &LinearPhase,
) -> Finding {
    let mut value = 0.0;
    let mut message = "every joint angle reaches the peaks of its first harmonic".to_owned();
    for (joint, command) in joints.iter().enumerate() {
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
            let (expected, amplitude) = match command.second {
                Some(second) => (
                    commanded / command.amplitude_rad.hypot(second.amplitude_rad()),
                    fit.amplitude(1).hypot(fit.amplitude(2)),
                ),
                None => (1.0, fit.amplitude(1)),
            };
            // Shortfall of the peak relative to the amplitude of the first harmonic, or of both.
            let short = expected - peak / amplitude;
            if short > value {
                let joint = joint + 1;
                let percent = 100.0 * short;
                message = format!(
                    "the {name} angle of joint {joint} falls {percent:.1} % short of the peak of its first harmonic"
                );
                value = short;
            }
        }
    }
    Finding::at_most(Check::GaitClipping, value, message)
}

#[cfg(test)]
mod tests {
    use trilink_robot::Gait;

    use super::*;

    fn finding(wave: impl Fn(f64) -> f64) -> Finding {
        let phase = LinearPhase { step_rad: 0.0325, offset_rad: 0.4 };
        let frames = (0..1800).map(f64::from);
        // Deterministic noise.
        let series: Vec<f64> =
            frames.map(|frame| wave(phase.at(frame)) + 0.002 * (7.7 * frame).sin()).collect();
        clipping_check(&Gait::symmetric().joints, &[series.clone(), series], &(100..1700), &phase)
    }

    #[test]
    fn a_servo_that_stops_short_of_its_peaks_is_found_on_either_side() {
        for (low, high) in [(-0.45, 0.45), (-0.45, 1.0), (-1.0, 0.45), (-0.475, 0.475)] {
            let found = finding(|phase| (0.5 * phase.cos()).clamp(low, high) + 0.1);
            assert!(!found.holds(), "{low} {high}: {}", found.value);
        }
        let cut = finding(|phase| (0.5 * phase.cos()).clamp(-0.45, 0.45));
        assert!((cut.value - 0.06).abs() < 0.01, "{}", cut.value);
        assert!(cut.message.contains("of joint 1 falls 5."), "{}", cut.message);
    }

    #[test]
    fn a_late_attenuated_or_distorted_servo_without_flat_peaks_passes() {
        assert!(finding(|phase| 0.2 * (phase - 0.3).cos()).holds());
        assert!(finding(|phase| 0.5 * phase.cos() + 0.02 * (3.0 * phase).cos()).holds());
        assert!(finding(|phase| 0.5 * phase.cos() + 0.015 * (2.0 * phase).sin()).holds());
    }
}
