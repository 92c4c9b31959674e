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
    let panels = (0..3).flat_map(|i| {
        let wheel = WHEELS[i];
        [
            panel(format!("Roll velocity of {wheel}"), "Roll (mm/s)", &recording.roll_m_s[i]),
            panel(format!("Skid velocity of {wheel}"), "Skid (mm/s)", &recording.skid_m_s[i]),
        ]
    });
    Some(Figure {
        caption: format!(
            "{cycles} cycles of trial {}, smoothed by a moving average over {} samples.",
            trial.trial, trial.smoothing_window
        ),
        layout: Layout::Pairs,
        ..Figure::new(
            stem,
            format!(
                "Roll and skid velocities of the wheels, campaign {}, {:.1} rad/s",
                trial.campaign, trial.omega_rad_s
            ),
            &[&trial.campaign],
            panels.collect(),
        )
    })
}
