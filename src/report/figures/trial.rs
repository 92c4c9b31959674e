//! What the page of a trial shows: its path, and what its links and wheels did all the time.

use super::common::{DEG, dense, lines, links, links_at_start, map, time_course, travel};
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

/// The figures of a trial; those without anything to show are left out.
pub fn figures(trial: &TrialRow, recording: &Recording, config: &ReportInput) -> Vec<Figure> {
    let unused = unused_cycles(trial, recording);
    let panel = |title: &str, y_label: &str, layers: Vec<Layer>| {
        time_course(title, y_label, unused.iter().cloned().chain(layers).collect())
    };
    let over_time = |values: &[f64], factor: f64| -> Vec<(f64, f64)> {
        let values = values.iter().map(|value| factor * value);
        recording.time_s.iter().copied().zip(values).collect()
    };
    let angles = dense(["φ₁", "φ₂"], |i| over_time(&recording.phi_rad[i], DEG));
    let roll = dense(WHEELS, |i| over_time(&recording.roll_m_s[i], 1e3));
    let skid = dense(WHEELS, |i| over_time(&recording.skid_m_s[i], 1e3));
    let residuals = lines(["link 0", "link 1", "link 2"], |link| {
        greatest(&over_time(&recording.residual_mm[link], 1.0))
    });
    let motion = Figure::new(
        "motion",
        "Joints and wheels",
        format!(
            "Smoothed by a moving average over {} samples.{}",
            trial.smoothing_window,
            if unused.is_empty() { "" } else { " Shaded: outside of the cycles in use." }
        ),
        &[],
        Layout::Stack,
        vec![
            panel("Joint angles", "Angle (deg)", angles),
            panel("Roll velocities", "Roll (mm/s)", roll),
            panel("Skid velocities", "Skid (mm/s)", skid),
        ],
    );
    let reconstruction = Figure::new(
        "reconstruction",
        "Residuals and gaps",
        format!(
            "Residual of the markers against their link, the greatest in each {PARTS}th of the \
             trial. Gaps: frames of a link that come from its other markers, from interpolation, \
             or are missing."
        ),
        &[],
        Layout::Stack,
        vec![
            panel("Residuals", "Residual (mm)", residuals),
            time_course("Gaps", "Link", gaps(recording)),
        ],
    );
    let all = [path(trial, recording, config), motion, reconstruction];
    all.into_iter().filter(|figure| !figure.is_empty()).collect()
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
    if let (Some(i), Some((robot, _))) = (first, config.campaign_setup(&trial.campaign)) {
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
    let panels = vec![map("Path of the middle link", layers)];
    Figure::new("path", "Path", caption, &[], Layout::Stack, panels)
}

/// Time outside of the cycles in use; nothing for trials without cycles.
fn unused_cycles(trial: &TrialRow, recording: &Recording) -> Vec<Layer> {
    let period_s = std::f64::consts::TAU / trial.omega_rad_s;
    let used = recording.cycles.iter().filter(|cycle| cycle.used);
    let spans: Vec<(f64, f64)> =
        used.map(|cycle| (cycle.start_s, cycle.start_s + period_s)).collect();
    let Some((_, mut end_s)) = spans.first().copied() else { return Vec::new() };
    let band = |from_s, to_s| {
        Layer::new("not in use", [(from_s, f64::NAN), (to_s, f64::NAN)], Look::Band(style::BAND))
    };
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

/// Where the frames of each link were not measured.
fn gaps(recording: &Recording) -> Vec<Layer> {
    const KINDS: [(&str, &str); 3] =
        [("rigid", "other markers"), ("interpolated", "interpolated"), ("missing", "missing")];
    let (Some(first_s), Some(last_s)) = (recording.time_s.first(), recording.time_s.last()) else {
        return Vec::new();
    };
    // With room for a unit of height.
    let bar = |from_s, to_s, link| [(from_s, link, 0.5), (to_s, link, 0.5)];
    let recorded = [0.0, 1.0, 2.0].into_iter().flat_map(|link| bar(*first_s, *last_s, link));
    let mut layers = vec![Layer::with_errors("", recorded, Look::Spans(style::BAND))];
    for (nth, (fill, name)) in KINDS.into_iter().enumerate() {
        let mut bars = Vec::new();
        for (fills, link) in recording.fill.iter().zip([0.0, 1.0, 2.0]) {
            let mut i = 0;
            for run in fills.chunk_by(|a, b| a == b) {
                let (from_s, to_s) = (recording.time_s[i], recording.time_s[i + run.len() - 1]);
                i += run.len();
                bars.extend(bar(from_s, to_s, link).into_iter().filter(|_| run[0] == fill));
            }
        }
        layers.push(Layer::with_errors(name, bars, looks::gap(nth)));
    }
    layers
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
