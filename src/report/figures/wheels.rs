//! Fig. 12: how the wheels rolled and skidded.

use crate::report::chart::{Axes, Chart, Layer, Layout};
use crate::report::figure::Figure;
use crate::report::recording::Recording;
use crate::report::style;
use crate::store::TrialRow;

/// Cycles that are shown.
const CYCLES: usize = 4;
const WHEELS: [&str; 3] = ["wheel 0 (middle)", "wheel 1 (front)", "wheel 2 (rear)"];

/// The figure; `None` without a used cycle.
pub fn figure(stem: &str, trial: &TrialRow, recording: &Recording) -> Option<Figure> {
    let (start_s, cycles) = recording.used_cycles(CYCLES)?;
    let end_s = start_s + cycles as f64 * std::f64::consts::TAU / trial.omega_rad_s;
    let shown = recording.between(start_s, end_s);
    let panel = |title: String, y_label: &str, values: &[f64]| Chart {
        title,
        x_label: "Time (s)".to_owned(),
        y_label: y_label.to_owned(),
        layers: vec![Layer::Curve {
            name: "measured".to_owned(),
            points: shown
                .clone()
                .map(|i| (recording.time_s[i] - start_s, 1e3 * values[i]))
                .collect(),
            look: style::RECORDED,
        }],
        axes: Axes::Linear,
        ..Chart::default()
    };
    let charts = (0..3).flat_map(|i| {
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
        ..Figure::of_charts(
            stem,
            format!(
                "Roll and skid velocities of the wheels, campaign {}, {:.1} rad/s",
                trial.campaign, trial.omega_rad_s
            ),
            &[&trial.campaign],
            charts.collect(),
        )
    })
}
