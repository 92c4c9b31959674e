//! One row for a trial: its means, its gait and its checks.

use std::ops::Range;

use super::clipping;
use super::means::{common_skid, mean};
use super::measure::{Cycle, CycleData};
use super::steady::Steady;
use crate::ingest::checks::{
    Check, D_DRIFT, FREQUENCY_TOLERANCE, Finding, GAIT_TOLERANCE_DEG, LEAST_CYCLES, MOST_GAPPED,
};
use crate::ingest::phase::{GAIT_HARMONICS, Harmonics, LinearPhase};
use crate::ingest::signals::response;
use crate::robot::Gait;
use crate::stats::{self, Estimate, wrap};
use crate::store::{CycleRow, Rows as _, TrialRow};
use crate::trial::Trial;

/// A row in which nothing is known but what is in the list of trials.
pub fn blank_row(trial: &Trial) -> TrialRow {
    TrialRow {
        trial: trial.id.clone(),
        campaign: trial.campaign.clone().unwrap_or_default(),
        kind: trial.kind.name().to_owned(),
        omega_commanded_rad_s: trial.omega_rad_s.unwrap_or(f64::NAN),
        status: "failed".to_owned(),
        ..TrialRow::blank()
    }
}

/// Adds to a row the means over the steady cycles and the measured gait.
pub fn describe_gait(row: &mut TrialRow, data: &CycleData, cycles: &[Cycle], steady: &Steady) {
    let driven = data.driven;
    row.omega_rad_s = driven.omega_rad_s;
    row.omega_rad_s_se = driven.omega_se_rad_s;
    row.cycles = steady.used.len() as i64;
    let used: Vec<&Cycle> = steady.used.iter().map(|&i| &cycles[i]).collect();
    let mean_of = |value: &dyn Fn(&Cycle) -> f64| {
        let values: Vec<f64> = used.iter().map(|cycle| value(cycle)).collect();
        mean(&values, &steady.used)
    };
    let set = |cells: [&mut f64; 2], estimate: Estimate| {
        let [value, se] = cells;
        (*value, *se) = (estimate.value, estimate.se);
    };
    set([&mut row.d_m, &mut row.d_m_se], mean_of(&|cycle| cycle.metrics.d_m));
    set([&mut row.v_m_s, &mut row.v_m_s_se], mean_of(&|cycle| cycle.metrics.v_m_s));
    let alpha1 = mean_of(&|cycle| cycle.metrics.alpha1_rad);
    set([&mut row.alpha1_rad, &mut row.alpha1_rad_se], alpha1);
    let dtheta = mean_of(&|cycle| cycle.metrics.dtheta_rad);
    set([&mut row.dtheta_rad, &mut row.dtheta_rad_se], dtheta);
    let sigma = |wheel: usize| mean_of(&|cycle| cycle.metrics.sigma[wheel]);
    set([&mut row.sigma0, &mut row.sigma0_se], sigma(0));
    set([&mut row.sigma1, &mut row.sigma1_se], sigma(1));
    set([&mut row.sigma2, &mut row.sigma2_se], sigma(2));
    let debiased = |wheel: usize| {
        let skid = common_skid(&used, wheel);
        let scale = data.robot.l_m * driven.omega_rad_s;
        Estimate { value: skid.value / scale, se: skid.se / scale }
    };
    set([&mut row.sigma0_debiased, &mut row.sigma0_debiased_se], debiased(0));
    set([&mut row.sigma1_debiased, &mut row.sigma1_debiased_se], debiased(1));
    set([&mut row.sigma2_debiased, &mut row.sigma2_debiased_se], debiased(2));
    let frames = steady.frames(cycles);
    let [first, second] =
        data.phi_rad.each_ref().map(|phi_rad| joint_gait(phi_rad, frames.clone(), &driven.phase));
    [row.phi1_offset_rad, row.phi1_amplitude_rad, row.phi1_phase_rad, row.phi1_harmonics_rad] =
        first;
    [row.phi2_offset_rad, row.phi2_amplitude_rad, row.phi2_phase_rad, row.phi2_harmonics_rad] =
        second;
    let left = |k: f64| response(row.smoothing_window as usize, k * driven.phase.step_rad);
    [row.smoothing_left1, row.smoothing_left2, row.smoothing_left3] = [1.0, 2.0, 3.0].map(left);
}

/// Offset, amplitude and phase of an angle's first harmonic over the cycles used, and the RMS of
/// its higher ones, rad. The angle is not smoothed, so nothing of the amplitude is lost.
fn joint_gait(phi_rad: &[f64], frames: Option<Range<usize>>, phase: &LinearPhase) -> [f64; 4] {
    let fit = frames.and_then(|frames| Harmonics::fit(phi_rad, frames, phase, GAIT_HARMONICS));
    fit.map_or([f64::NAN; 4], |fit| {
        let squares = (2..=GAIT_HARMONICS).map(|k| 0.5 * fit.amplitude(k).powi(2)).sum::<f64>();
        [fit.offset(), fit.amplitude(1), fit.phase_rad(), squares.sqrt()]
    })
}

/// `cycles/<trial>.parquet`.
pub fn cycle_rows(trial: &Trial, cycles: &[Cycle], steady: &Steady, rate_hz: f64) -> Vec<CycleRow> {
    let row = |(i, cycle): (usize, &Cycle)| CycleRow {
        trial: trial.id.clone(),
        cycle: i as i64,
        start_s: cycle.start / rate_hz,
        d_m: cycle.metrics.d_m,
        v_m_s: cycle.metrics.v_m_s,
        sigma0: cycle.metrics.sigma[0],
        sigma1: cycle.metrics.sigma[1],
        sigma2: cycle.metrics.sigma[2],
        alpha1_rad: cycle.metrics.alpha1_rad,
        dtheta_rad: cycle.metrics.dtheta_rad,
        used: steady.used.binary_search(&i).is_ok(),
    };
    cycles.iter().enumerate().map(row).collect()
}

/// Checks of a trial with a commanded gait.
pub fn gait_checks(
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
    let deviation_deg = gait_deviation_deg(row, data.gait);
    let deviation = format!("the joints are up to {deviation_deg:.1} degrees off the command");
    let drift = drift_of_d(cycles, steady);
    let drifted = format!("d changes by {:.2} % over the cycles used", 100.0 * drift);
    let mut findings = vec![
        Finding::at_most(Check::Frequency, off_command, FREQUENCY_TOLERANCE, measured),
        Finding::at_least(Check::SteadyState, used as f64, LEAST_CYCLES, counted),
        Finding::at_most(Check::LongGaps, part_gapped, MOST_GAPPED, gapped)
            .notable(steady.gapped > 0),
        Finding::at_most(Check::Gait, deviation_deg, GAIT_TOLERANCE_DEG, deviation),
        Finding::at_most(Check::Drift, drift, D_DRIFT, drifted),
    ];
    let clipping = |frames| clipping::check(data.gait, data.phi_rad, &frames, &data.driven.phase);
    findings.extend(steady.frames(cycles).map(clipping));
    findings
}

/// Relative change of d from the first half of the used cycles to the second.
fn drift_of_d(cycles: &[Cycle], steady: &Steady) -> f64 {
    let half = steady.used.len() / 2;
    let mean = |used: &[usize]| stats::mean(used.iter().map(|&i| cycles[i].metrics.d_m));
    let early = mean(&steady.used[..half]);
    let late = mean(&steady.used[steady.used.len() - half..]);
    (late / early - 1.0).abs()
}

/// Largest difference between the measured and the commanded gait; a difference in phase
/// counts by the angle that it makes.
fn gait_deviation_deg(row: &TrialRow, gait: &Gait) -> f64 {
    let measured = [
        [row.phi1_offset_rad, row.phi1_amplitude_rad, row.phi1_phase_rad],
        [row.phi2_offset_rad, row.phi2_amplitude_rad, row.phi2_phase_rad],
    ];
    let mut largest_rad = 0.0_f64;
    for (command, [offset, amplitude, phase]) in gait.joints.iter().zip(measured) {
        let Some(command) = command else { continue };
        let late = command.amplitude_rad * wrap(phase - command.phase_rad);
        for difference in [offset - command.offset_rad, amplitude - command.amplitude_rad, late] {
            largest_rad = largest_rad.max(difference.abs());
        }
    }
    largest_rad.to_degrees()
}
