//! Fig. 12: how the wheels rolled and skidded.

use super::common::time_course;
use crate::report::drawing::{Figure, Layer, Layout};
use crate::report::looks;
use crate::report::recording::{Recording, Shown};
use crate::store::TrialRow;

/// Cycles that are shown.
const CYCLES: usize = 4;
const WHEELS: [&str; 3] = ["wheel 0 (middle)", "wheel 1 (front)", "wheel 2 (rear)"];

/// The figure; `None` without a used cycle.
pub fn figure(stem: &str, trial: &TrialRow, recording: &Recording) -> Option<Figure> {
    let Shown { start_s, cycles, frames, .. } = recording.shown(trial.omega_rad_s, CYCLES)?;
    let panel = |title: String, y_label: &str, values: &[f64]| {
        let points = frames.clone().map(|i| (recording.time_s[i] - start_s, 1e3 * values[i]));
        time_course(&title, y_label, vec![Layer::new("measured", points, looks::RECORDED)])
    };
    let panels = WHEELS.iter().enumerate().flat_map(|(i, wheel)| {
        let [roll_m_s, skid_m_s] = [&recording.roll_m_s[i], &recording.skid_m_s[i]];
        [
            panel(format!("Roll velocity of {wheel}"), "Roll (mm/s)", roll_m_s),
            panel(format!("Skid velocity of {wheel}"), "Skid (mm/s)", skid_m_s),
        ]
    });
    let TrialRow { trial, campaign, omega_rad_s, smoothing_window, .. } = trial;
    Some(Figure::new(
        stem,
        format!(
            "Roll and skid velocities of the wheels, campaign {campaign}, {omega_rad_s:.1} rad/s"
        ),
        format!(
            "{cycles} cycles of trial {trial}, smoothed by a moving average over \
             {smoothing_window} samples."
        ),
        &[campaign],
        Layout::Pairs,
        panels.collect(),
    ))
}
