//! What the page of a trial shows: its path, and what its links and wheels did all the time.

use super::common::{DEG, dense_series, links, links_at_start, map, series, time_course, travel};
use crate::motion::Pose;
use crate::report::ReportInput;
use crate::report::drawing::{Figure, Layer, Layout, Look, style};
use crate::report::looks;
use crate::report::recording::Recording;
use crate::store::TrialRow;
use crate::trial::TrialKind;

const WHEELS: [&str; 3] = ["wheel 0", "wheel 1", "wheel 2"];
/// Parts of a trial of which the greatest residuals are shown.
const PARTS: usize = 100;
const LINKS: [&str; 3] = ["link 0", "link 1", "link 2"];

/// The figures of a trial; those without anything to show are left out.
pub fn figures(trial: &TrialRow, recording: &Recording, config: &ReportInput) -> Vec<Figure> {
    let unused = unused_cycles(trial, recording);
    let panel = |title: &str, y_label: &str, layers: Vec<Layer>| {
        time_course(title, y_label, unused.iter().cloned().chain(layers).collect())
    };
    let three = |names: [&str; 3], values: &[Vec<f64>; 3], factor: f64| -> Vec<Layer> {
        let line = |i: usize| dense_series(i, names[i], &over_time(recording, &values[i], factor));
        (0..3).map(line).collect()
    };
    let joints = [0, 1].map(|i| {
        dense_series(i, ["φ₁", "φ₂"][i], &over_time(recording, &recording.phi_rad[i], DEG))
    });
    let motion = Figure {
        caption: format!(
            "Smoothed by a moving average over {} samples.{}",
            trial.smoothing_window,
            if unused.is_empty() { "" } else { " Shaded: outside of the cycles in use." }
        ),
        layout: Layout::Stack,
        ..Figure::new(
            "motion",
            "Joints and wheels".to_owned(),
            &[],
            vec![
                panel("Joint angles", "Angle (deg)", joints.into()),
                panel("Roll velocities", "Roll (mm/s)", three(WHEELS, &recording.roll_m_s, 1e3)),
                panel("Skid velocities", "Skid (mm/s)", three(WHEELS, &recording.skid_m_s, 1e3)),
            ],
        )
    };
    let residuals = (0..3).map(|link| {
        let points = greatest(&over_time(recording, &recording.residual_mm[link], 1.0));
        series(link, LINKS[link], points)
    });
    let reconstruction = Figure {
        caption: format!(
            "Residual of the markers against their link, the greatest in each {PARTS}th of the \
             trial. Gaps: frames of a link that come from its other markers, from interpolation, \
             or are missing."
        ),
        layout: Layout::Stack,
        ..Figure::new(
            "reconstruction",
            "Residuals and gaps".to_owned(),
            &[],
            vec![
                panel("Residuals", "Residual (mm)", residuals.collect()),
                time_course("Gaps", "Link", gaps(recording)),
            ],
        )
    };
    let all = [path(trial, recording, config), motion, reconstruction];
    all.into_iter().filter(|figure| !figure.is_empty()).collect()
}

fn over_time(recording: &Recording, values: &[f64], factor: f64) -> Vec<(f64, f64)> {
    recording.time_s.iter().copied().zip(values.iter().map(|value| factor * value)).collect()
}

/// The greatest value in each of [`PARTS`] parts of a line.
fn greatest(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let parts = points.chunks(points.len().div_ceil(PARTS).max(1));
    let of_part = |part: &[(f64, f64)]| {
        let seen = part.iter().filter(|(_, y)| y.is_finite());
        seen.max_by(|a, b| a.1.total_cmp(&b.1)).copied().unwrap_or((f64::NAN, f64::NAN))
    };
    parts.map(of_part).collect()
}

fn path(trial: &TrialRow, recording: &Recording, config: &ReportInput) -> Figure {
    let all: Vec<(f64, f64)> =
        recording.x_m.iter().copied().zip(recording.y_m.iter().copied()).collect();
    let seen: Vec<(f64, f64)> = all.iter().copied().filter(|(x, y)| (x + y).is_finite()).collect();
    let mut layers = Vec::new();
    let first = (0..all.len()).find(|i| {
        let angles = [&recording.theta_rad, &recording.phi_rad[0], &recording.phi_rad[1]];
        let values = angles.map(|values| values[*i]).into_iter().chain([all[*i].0, all[*i].1]);
        values.sum::<f64>().is_finite()
    });
    let robot = config.campaign_setup(&trial.campaign).map(|(robot, _)| robot);
    if let (Some(i), Some(robot)) = (first, robot) {
        let pose = Pose { x_m: all[i].0, y_m: all[i].1, theta_rad: recording.theta_rad[i] };
        let phi_rad = [recording.phi_rad[0][i], recording.phi_rad[1][i]];
        layers.push(links_at_start(links(&robot, pose, phi_rad)));
        layers.push(travel(&seen));
    }
    layers.push(Layer::new("measured", all, looks::RECORDED));
    let caption = match trial.kind {
        TrialKind::Gait => "Thick: the robot's links at the start; arrow: direction of travel.",
        _ => "",
    };
    Figure {
        caption: caption.to_owned(),
        layout: Layout::Stack,
        ..Figure::new("path", "Path".to_owned(), &[], vec![map("Path of the middle link", layers)])
    }
}

/// Time outside of the cycles in use; nothing for trials without cycles.
fn unused_cycles(trial: &TrialRow, recording: &Recording) -> Vec<Layer> {
    let period_s = std::f64::consts::TAU / trial.omega_rad_s;
    let used = recording.cycles.iter().filter(|cycle| cycle.used);
    let spans: Vec<(f64, f64)> =
        used.map(|cycle| (cycle.start_s, cycle.start_s + period_s)).collect();
    let Some((_, mut end_s)) = spans.first().copied() else { return Vec::new() };
    let band =
        |from_s, to_s| Layer::new("not in use", [(from_s, f64::NAN), (to_s, f64::NAN)], Look::Band);
    let mut bands = vec![band(f64::NAN, spans[0].0)];
    for (from_s, to_s) in &spans[1..] {
        // Cycles that follow one another meet but for rounding.
        if *from_s > end_s + 1e-3 * period_s {
            bands.push(band(end_s, *from_s));
        }
        end_s = *to_s;
    }
    let last_s = recording.time_s.last().copied().unwrap_or(end_s);
    bands.extend((last_s > end_s).then(|| band(end_s, f64::NAN)));
    bands
}

/// Bars `(from, to, height)`, with room for a unit of height.
fn bars(name: &str, spans: &[(f64, f64, f64)], look: Look) -> Layer {
    let ends = spans.iter().flat_map(|(from, to, y)| [(*from, *y, 0.5), (*to, *y, 0.5)]);
    Layer::with_errors(name, ends, look)
}

/// Where the frames of each link were not measured.
fn gaps(recording: &Recording) -> Vec<Layer> {
    const KINDS: [(&str, &str); 3] =
        [("rigid", "other markers"), ("interpolated", "interpolated"), ("missing", "missing")];
    let (Some(first_s), Some(last_s)) = (recording.time_s.first(), recording.time_s.last()) else {
        return Vec::new();
    };
    let spans = |(nth, (fill, name)): (usize, (&str, &str))| {
        let mut spans = Vec::new();
        for (link, fills) in recording.fill.iter().enumerate() {
            let mut i = 0;
            for run in fills.chunk_by(|a, b| a == b) {
                let (from_s, to_s) = (recording.time_s[i], recording.time_s[i + run.len() - 1]);
                i += run.len();
                if run[0] == fill {
                    spans.push((from_s, to_s, link as f64));
                }
            }
        }
        bars(name, &spans, looks::gap(nth))
    };
    let recorded = [0.0, 1.0, 2.0].map(|link| (*first_s, *last_s, link));
    let recorded = bars("", &recorded, Look::Spans(style::BAND));
    [recorded].into_iter().chain(KINDS.into_iter().enumerate().map(spans)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Columns as _, CycleRow};

    #[test]
    fn time_outside_of_the_used_cycles_is_shaded() {
        let cycle = |start_s: f64, used| CycleRow { start_s, used, ..CycleRow::blank() };
        let recording = Recording {
            time_s: (0..100).map(f64::from).collect(),
            cycles: vec![
                cycle(10.0, false),
                cycle(20.0, true),
                cycle(30.0, true),
                cycle(40.0, false),
                cycle(50.0, true),
            ],
            ..Recording::default()
        };
        let trial = TrialRow { omega_rad_s: std::f64::consts::TAU / 10.0, ..TrialRow::blank() };
        let bands: Vec<_> = unused_cycles(&trial, &recording)
            .into_iter()
            .map(|layer| [layer.points[0].x, layer.points[1].x])
            .collect();
        assert!(bands[0][0].is_nan() && bands[0][1] == 20.0);
        assert_eq!(bands[1][1].round(), 50.0);
        assert!((bands[1][0] - 40.0).abs() < 1e-9);
        assert!(bands.len() == 3 && bands[2][1].is_nan());
    }
}
