//! Checks of markers and poses, common to trials of all kinds.

use std::collections::BTreeMap;
use std::ops::Range;

use trilink_base::body;
use trilink_mocap::Recording;
use trilink_statistics::{mean, seen};
use trilink_tables::TrialRow;

use super::continuity::Jump;
use super::tilt::Tilt;
use super::track::Tracked;
use crate::checks::{Check, Finding};
use crate::input::IngestSettings;
use crate::markers::labels::Outlier;
use crate::markers::layout::{Layout, LinkMarker};

/// Sets in a trial's row the marker coverage, the mean residual, and whether the marker noise is white.
pub(crate) fn describe_tracking(row: &mut TrialRow, tracked: &Tracked) {
    let all = 0..tracked.frames();
    row.coverage = tracked.coverage(&all);
    row.residual_mm = residual_mm(tracked, &all);
    let ratio = tracked.slow_noise_ratio;
    row.noise_white = (!ratio.is_nan()).then_some(ratio <= Check::Filtered.limit());
}

/// Returns the mean residual of all links in a range of frames, mm.
fn residual_mm(tracked: &Tracked, frames: &Range<usize>) -> f64 {
    mean(tracked.residual_mm.iter().flat_map(|residuals| seen(&residuals[frames.clone()])))
}

/// Counts those of the frames `rising`, which must be in ascending order, that lie in a range.
fn count_within(rising: &[usize], frames: &Range<usize>) -> usize {
    let [before_start, before_end] =
        [frames.start, frames.end].map(|end| rising.partition_point(|&frame| frame < end));
    before_end - before_start
}

/// Runs the checks that apply to every trial, within the frames in use: outside them the robot may be put down or taken
/// away.
pub(crate) fn tracking_checks(
    tracked: &Tracked,
    file: &Recording,
    layout: &Layout,
    settings: &IngestSettings,
    frames: &Range<usize>,
) -> Vec<Finding> {
    let assumed_hz = settings.vicon.rate_hz;
    let rate = match file.rate_hz {
        Some(rate_hz) => format!("the file states a frame rate of {rate_hz} Hz"),
        None => {
            format!("the file states no frame rate; {assumed_hz} Hz is assumed (vicon.rate_hz)")
        }
    };
    let rate_hz = file.rate_hz.unwrap_or(f64::NAN);
    let recorded = &tracked.recorded_frames;
    let missing = (frames.len() - count_within(recorded, frames)) as f64;
    let has_missing = recorded.len() < tracked.frames();
    let unnumbered = file.rows_without_frame as f64;
    let missing_message = format!("{missing} frames are missing from the file");
    let coverage = tracked.coverage(frames);
    let coverage_message =
        format!("{:.1} % of the marker positions were recorded", 100.0 * coverage);
    let residual_mm = residual_mm(tracked, frames);
    let residual_message =
        format!("the markers deviate from the layout by {residual_mm:.2} mm on average");
    let unnumbered_message = format!("{unnumbered} rows without a frame number are left out");
    let max_mm = settings.ingest.max_residual_mm;
    let mut findings = vec![
        Finding::new(Check::Rate, file.rate_hz.is_some(), rate_hz, assumed_hz, rate),
        Finding::at_most(Check::FrameContinuity, missing, missing_message).notable(has_missing),
        Finding::at_least(Check::Coverage, coverage, coverage_message),
        Finding::new(Check::Residual, residual_mm <= max_mm, residual_mm, max_mm, residual_message),
        Finding::at_most(Check::RowsWithoutFrame, unnumbered, unnumbered_message),
    ];
    if file.rows_too_long > 0 {
        let rows = file.rows_too_long as f64;
        let found = if rows == 1.0 { "1 row has".to_owned() } else { format!("{rows} rows have") };
        let long = format!(
            "{found} more cells than the header has columns: perhaps numbers are in the wrong columns"
        );
        findings.push(Finding::at_most(Check::LongRows, rows, long));
    }
    findings.extend(incomplete_check(file, layout));
    findings.extend(header_check(file));
    findings.extend(label_checks(tracked, file, layout, frames));
    findings.push(tilt_check(&tracked.constant.tilt));
    findings.push(repeats_check(tracked, frames));
    findings.push(jumps_check(tracked, file.rate_hz.unwrap_or(assumed_hz), frames));
    findings.push(noise_check(tracked.slow_noise_ratio));
    findings
}

/// Checks that the marker noise is white. `ratio` compares the slow noise in the whole file with that expected for
/// white noise.
fn noise_check(ratio: f64) -> Finding {
    let limit = Check::Filtered.limit();
    let message = if ratio > limit {
        format!(
            "the markers' noise over a tenth of a second is {ratio:.1} times that between neighbouring frames: the \
             coordinates were low-pass filtered or smoothed, so that the errors of sigma, alpha1 and the amplitudes of \
             the joints are not known; export unfiltered coordinates"
        )
    } else if ratio.is_nan() {
        "the markers' noise is too small to test whether it is white".to_owned()
    } else {
        "the markers' noise is white".to_owned()
    };
    // An undetermined ratio is not reported as a fault.
    let is_white = ratio.is_nan() || ratio <= limit;
    Finding::new(Check::Filtered, is_white, ratio, limit, message)
}

/// Checks for markers and bodies of which the file has only some cells; returns `None` if there are none.
fn incomplete_check(file: &Recording, layout: &Layout) -> Option<Finding> {
    let columns = layout.iter().flatten().map(|marker| marker.column);
    let columns: Vec<usize> = columns.filter(|&column| file.incomplete[column] > 0).collect();
    let count = columns.iter().map(|&column| file.incomplete[column]).sum::<usize>() as f64;
    let names: Vec<&str> = columns.iter().map(|&column| body::name(&file.labels[column])).collect();
    let found = match count {
        1.0 => "1 position is incomplete and counts".to_owned(),
        _ => format!("{count} positions are incomplete and count"),
    };
    let message = format!("{found} as occluded: `{}`", names.join("`, `"));
    (count > 0.0).then(|| Finding::at_most(Check::IncompletePositions, count, message))
}

/// Checks the file's metadata; returns `None` if they are complete and consistent.
pub(crate) fn header_check(file: &Recording) -> Option<Finding> {
    let doubts = &file.doubts;
    let count = doubts.len() as f64;
    (!doubts.is_empty()).then(|| Finding::at_most(Check::FileHeader, count, doubts.join("; ")))
}

/// Checks for frames that were held or duplicated in the recording.
fn repeats_check(tracked: &Tracked, frames: &Range<usize>) -> Finding {
    let repeated = count_within(&tracked.repeated_frames, frames);
    let fraction = repeated as f64 / count_within(&tracked.recorded_frames, frames) as f64;
    let message = match repeated {
        0 => "no row repeats the preceding one".to_owned(),
        _ => format!(
            "{:.1} % of the rows repeat the preceding row to the last digit although the robot moves: was the \
             recording resampled, or did the stream of frames stall?",
            100.0 * fraction
        ),
    };
    Finding::at_most(Check::RepeatedRows, fraction, message).notable(repeated > 0)
}

/// Checks for jumps within the frames in use and names the likely cause of the largest jump. If frames may be missing
/// from the recording, the times of all later frames are unknown, and the trial fails.
fn jumps_check(tracked: &Tracked, rate_hz: f64, frames: &Range<usize>) -> Finding {
    let within = frames.start + 1..frames.end;
    let jumps: Vec<&Jump> =
        tracked.jumps.iter().filter(|jump| within.contains(&jump.after)).collect();
    let with_missing_frames = jumps.iter().find(|jump| jump.missing_frames.is_some());
    let Some(&&worst) = with_missing_frames.or(jumps.first()) else {
        let message = match tracked.jumps.first() {
            None => "the robot moves smoothly from frame to frame".to_owned(),
            Some(&Jump { after, displacement_m, turn_rad, .. }) => format!(
                "the robot jumps by {:.1} mm and {:.1} degrees at frame {} ({:.1} s), before or after the cycles in \
                 use",
                1000.0 * displacement_m,
                turn_rad.to_degrees(),
                tracked.first_frame + after as i64,
                after as f64 / rate_hz
            ),
        };
        let found = Finding::at_most(Check::Jump, 0.0, message);
        return found.notable(!tracked.jumps.is_empty());
    };
    let Jump { after, displacement_m, turn_rad, missing_frames, .. } = worst;
    let times = match jumps.len() {
        1 => String::new(),
        count => format!("{count} times, at most "),
    };
    let cause = match missing_frames {
        Some(frames) => {
            let count = match frames.abs().round() {
                ..2.0 => "a frame".to_owned(),
                count => format!("about {count} frames"),
            };
            if frames > 0.0 {
                format!("{count} may be missing: were rows deleted and the others renumbered?")
            } else {
                format!("{count} may be repeated: were rows duplicated and the others renumbered?")
            }
        }
        None => "was the robot or a camera knocked? Cycles with a jump are not used".to_owned(),
    };
    let message = format!(
        "the robot jumps {times}by {:.1} mm and {:.1} degrees at frame {} ({:.1} s): {cause}",
        1000.0 * displacement_m,
        turn_rad.to_degrees(),
        tracked.first_frame + after as i64,
        after as f64 / rate_hz
    );
    let found = Finding::at_most(Check::Jump, jumps.len() as f64, message);
    if missing_frames.is_some() { found.failing() } else { found }
}

/// Checks that floor and links are level.
pub(crate) fn tilt_check(tilt: &Tilt) -> Finding {
    let links = tilt.links.iter().enumerate().map(|(link, turn)| (format!("link {link}"), *turn));
    let turns: Vec<_> =
        std::iter::once(("the floor".to_owned(), tilt.floor)).chain(links).collect();
    let large = turns.iter().filter(|(_, turn)| turn.is_large());
    let messages: Vec<String> = large
        .map(|(name, turn)| {
            let deg = turn.size_deg();
            let se_deg = turn.se_rad.to_degrees();
            let outcome = if turn.is_corrected() {
                "the tilt was corrected"
            } else {
                "the tilt was not corrected: the heights in the marker layout may be wrong"
            };
            format!("{name} is tilted by {deg:.2} +- {se_deg:.2} degrees ({outcome})")
        })
        .collect();
    let largest_deg = turns.iter().map(|(_, turn)| turn.significant_deg()).fold(0.0, f64::max);
    let is_level = messages.is_empty();
    let message =
        if is_level { "floor and links are level".to_owned() } else { messages.join(", ") };
    Finding::new(Check::Tilt, is_level, largest_deg, Check::Tilt.limit(), message)
}

/// Returns the findings on jumped markers, swapped labels and ambiguous markers, each with the number of frames
/// affected.
fn label_checks(
    tracked: &Tracked,
    file: &Recording,
    layout: &Layout,
    frames: &Range<usize>,
) -> [Finding; 3] {
    let jumped = "have an outlying marker, which is left out";
    let swapped = "have two swapped labels, which are corrected";
    let ambiguous = "have markers that contradict each other or the motion, and it is ambiguous which marker is \
         wrong; the link's pose is rejected";
    [
        (Check::JumpedMarker, jumped),
        (Check::SwappedLabels, swapped),
        (Check::AmbiguousMarkers, ambiguous),
    ]
    .map(|(check, fault)| {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        let mut affected = 0;
        for frame in frames.clone() {
            let names: Vec<String> = (0..layout.len())
                .filter_map(|link| {
                    label_fault(file, &layout[link], link, tracked.outlier[link][frame])
                })
                .filter(|(found, _)| *found == check)
                .map(|(_, name)| name)
                .collect();
            affected += usize::from(!names.is_empty());
            for name in names {
                *counts.entry(name).or_default() += 1;
            }
        }
        let each: Vec<String> =
            counts.iter().map(|(name, count)| format!("{name} in {count}")).collect();
        let list = if each.is_empty() { String::new() } else { format!(": {}", each.join(", ")) };
        let message = format!("{affected} frames {fault}{list}");
        let fraction = affected as f64 / frames.len() as f64;
        Finding::at_most(check, fraction, message).notable(affected > 0)
    })
}

/// Returns the check that reports a label fault of a link, with the names of the affected markers or of the link;
/// `None` if there is no fault.
fn label_fault(
    file: &Recording,
    markers: &[LinkMarker],
    link: usize,
    outlier: Outlier,
) -> Option<(Check, String)> {
    let label = |marker: u16| file.labels[markers[marker as usize].column].as_str();
    match outlier {
        Outlier::None => None,
        Outlier::Jumped(marker) => Some((Check::JumpedMarker, label(marker).to_owned())),
        Outlier::Swapped(a, b) => {
            Some((Check::SwappedLabels, format!("{} and {}", label(a), label(b))))
        }
        Outlier::Ambiguous => Some((Check::AmbiguousMarkers, format!("link {link}"))),
    }
}
