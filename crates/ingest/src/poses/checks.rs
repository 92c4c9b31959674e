//! What is found from the markers alone, whatever was recorded.

use std::collections::BTreeMap;
use std::ops::Range;

use trilink_mocap::Recording;
use trilink_statistics::{mean, seen};
use trilink_tables::TrialRow;

use super::continuity::Jump;
use super::tilt::{Tilt, Turn};
use super::track::Tracked;
use crate::checks::{Check, Finding};
use crate::input::IngestSettings;
use crate::markers::labels::Outlier;
use crate::markers::layout::Layout;

/// Adds coverage, residual and whether the noise is white to a row.
pub(crate) fn describe_tracking(row: &mut TrialRow, tracked: &Tracked) {
    let all = 0..tracked.frames();
    row.coverage = tracked.coverage(&all);
    row.residual_mm = residual_mm(tracked, &all);
    let ratio = tracked.slow_noise_ratio;
    row.noise_white = (!ratio.is_nan()).then_some(ratio <= Check::Filtered.limit());
}

fn residual_mm(tracked: &Tracked, frames: &Range<usize>) -> f64 {
    mean(tracked.residual_mm.iter().flat_map(|residuals| seen(&residuals[frames.clone()])))
}

/// How many of some rising frames are in a range.
fn count_within(rising: &[usize], frames: &Range<usize>) -> usize {
    let before = |end: usize| rising.partition_point(|&frame| frame < end);
    before(frames.end) - before(frames.start)
}

/// Checks that every trial has to pass, within the frames in use: before and after them the robot
/// may be put down and taken away.
pub(crate) fn tracking_checks(
    tracked: &Tracked,
    file: &Recording,
    layout: &Layout,
    settings: &IngestSettings,
    frames: &Range<usize>,
) -> Vec<Finding> {
    let assumed_hz = settings.vicon.rate_hz;
    let rate = match file.rate_hz {
        Some(rate_hz) => format!("the file says {rate_hz} Hz"),
        None => {
            format!("the file does not say its rate; {assumed_hz} Hz is assumed (vicon.rate_hz)")
        }
    };
    let rate_hz = file.rate_hz.unwrap_or(f64::NAN);
    let missing = |frames: &Range<usize>| {
        (frames.len() - count_within(&tracked.recorded_frames, frames)) as f64
    };
    let (inserted, inserted_anywhere) = (missing(frames), missing(&(0..tracked.frames())));
    let unnumbered = file.rows_without_frame as f64;
    let left_out = format!("{inserted} frames are left out of the file");
    let (coverage, residual_mm) = (tracked.coverage(frames), residual_mm(tracked, frames));
    let covered = format!("{:.1} % of all markers' frames were seen", 100.0 * coverage);
    let off = format!("markers are {residual_mm:.2} mm off the layout on average");
    let numbered = format!("{unnumbered} rows without a frame number are left out");
    let most_mm = settings.ingest.max_residual_mm;
    let mut findings = vec![
        Finding::new(Check::Rate, file.rate_hz.is_some(), rate_hz, assumed_hz, rate),
        Finding::at_most(Check::FrameContinuity, inserted, left_out)
            .notable(inserted_anywhere > 0.0),
        Finding::at_least(Check::Coverage, coverage, covered),
        Finding::new(Check::Residual, residual_mm <= most_mm, residual_mm, most_mm, off),
        Finding::at_most(Check::RowsWithoutFrame, unnumbered, numbered),
    ];
    if file.rows_too_long > 0 {
        let rows = file.rows_too_long as f64;
        let found = if rows == 1.0 { "1 row has".to_owned() } else { format!("{rows} rows have") };
        let long = format!(
            "{found} more cells than the header has columns: numbers may stand in wrong columns"
        );
        findings.push(Finding::at_most(Check::LongRows, rows, long));
    }
    findings.extend(header_check(file));
    findings.extend(label_checks(tracked, file, layout, frames));
    findings.push(tilt_check(&tracked.constant.tilt));
    findings.push(repeats_check(tracked, frames));
    findings.push(jumps_check(tracked, file.rate_hz.unwrap_or(assumed_hz), frames));
    findings.push(noise_check(tracked.slow_noise_ratio));
    findings
}

/// Whether the markers' noise is white: a file tells it as a whole.
fn noise_check(ratio: f64) -> Finding {
    let limit = Check::Filtered.limit();
    let message = if ratio > limit {
        format!(
            "the markers' noise over a tenth of a second is {ratio:.1} times what neighbouring frames show: the \
             coordinates were low-pass filtered or smoothed, so that standard errors are too small; export unfiltered"
        )
    } else if ratio.is_nan() {
        "too little noise to test whether it is white".to_owned()
    } else {
        "the markers' noise is white".to_owned()
    };
    // What is not known is no fault.
    let is_white = ratio.is_nan() || ratio <= limit;
    Finding::new(Check::Filtered, is_white, ratio, limit, message)
}

/// Metadata that the file lacks or that contradict each other; `None` if there are none.
pub(crate) fn header_check(file: &Recording) -> Option<Finding> {
    let doubts = &file.doubts;
    let count = doubts.len() as f64;
    let check = || Finding::at_most(Check::FileHeader, count, doubts.join("; "));
    (!doubts.is_empty()).then(check)
}

/// Frames that were held or doubled.
fn repeats_check(tracked: &Tracked, frames: &Range<usize>) -> Finding {
    let repeated = count_within(&tracked.repeated_frames, frames);
    let part = repeated as f64 / count_within(&tracked.recorded_frames, frames) as f64;
    let message = match repeated {
        0 => "no row repeats the one before".to_owned(),
        _ => format!(
            "{:.1} % of the rows repeat the one before to the last digit although the robot moves: was the \
             recording resampled, or did the stream of frames halt?",
            100.0 * part
        ),
    };
    Finding::at_most(Check::RepeatedRows, part, message).notable(repeated > 0)
}

/// Number of jumps within the frames in use, and the likely cause of the farthest. Where frames may
/// be missing, the times of all later frames are unknown, and the trial fails.
fn jumps_check(tracked: &Tracked, rate_hz: f64, frames: &Range<usize>) -> Finding {
    let is_within = |jump: &&Jump| (frames.start + 1..frames.end).contains(&jump.after);
    let jumps: Vec<&Jump> = tracked.jumps.iter().filter(is_within).collect();
    let of_frames = jumps.iter().find(|jump| jump.missing_frames.is_some());
    let Some(&&worst) = of_frames.or(jumps.first()) else {
        let message = match tracked.jumps.first() {
            None => "the robot goes on smoothly from frame to frame".to_owned(),
            Some(&Jump { after, displacement_m, turn_rad, .. }) => format!(
                "the robot jumps by {:.1} mm and {:.1} degrees in one frame, {} ({:.1} s), before or after the \
                 cycles in use",
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
        count => format!("{count} times, here "),
    };
    let cause = match missing_frames {
        Some(frames) => {
            let (are, rows) = match frames > 0.0 {
                true => ("missing there", "deleted"),
                false => ("there twice", "doubled"),
            };
            let count = match frames.abs().round() {
                ..2.0 => "a frame was".to_owned(),
                count => format!("some {count} frames were"),
            };
            format!("as if {count} {are}: were rows {rows}, and the others numbered anew?")
        }
        None => {
            "was the robot or a camera knocked? Cycles in which it jumps do not count".to_owned()
        }
    };
    let message = format!(
        "the robot jumps {times}by {:.1} mm and {:.1} degrees in one frame, {} ({:.1} s): {cause}",
        1000.0 * displacement_m,
        turn_rad.to_degrees(),
        tracked.first_frame + after as i64,
        after as f64 / rate_hz
    );
    let found = Finding::at_most(Check::Jump, jumps.len() as f64, message);
    if missing_frames.is_some() { found.failing() } else { found }
}

/// Whether floor and links are level.
pub(crate) fn tilt_check(tilt: &Tilt) -> Finding {
    let [link0, link1, link2] = tilt.links;
    let turns =
        [("the floor", tilt.floor), ("link 0", link0), ("link 1", link1), ("link 2", link2)];
    let message = |(name, turn): &(&str, Turn)| {
        let (deg, se_deg) = (turn.size_deg(), turn.se_rad.to_degrees());
        let done = match turn.is_corrected() {
            true => "was corrected",
            false => "was left so: the layout's heights may be wrong",
        };
        format!("{name} is tilted by {deg:.2} +- {se_deg:.2} degrees and {done}")
    };
    let large: Vec<String> =
        turns.iter().filter(|(_, turn)| turn.is_large()).map(message).collect();
    let largest_deg = turns.iter().map(|(_, turn)| turn.certain_deg()).fold(0.0, f64::max);
    let message = match large.is_empty() {
        true => "floor and links are level".to_owned(),
        false => large.join(", "),
    };
    Finding::new(Check::Tilt, large.is_empty(), largest_deg, Check::Tilt.limit(), message)
}

/// How many frames had a wrong marker, and which markers they were.
fn label_checks(
    tracked: &Tracked,
    file: &Recording,
    layout: &Layout,
    frames: &Range<usize>,
) -> [Finding; 3] {
    let label =
        |link: usize, marker: u16| file.labels[layout[link][marker as usize].column].as_str();
    let named = |link: usize, outlier: Outlier| match outlier {
        Outlier::None => None,
        Outlier::Jumped(marker) => Some((Check::JumpedMarker, label(link, marker).to_owned())),
        Outlier::Swapped(a, b) => {
            Some((Check::SwappedLabels, format!("{} and {}", label(link, a), label(link, b))))
        }
        Outlier::Ambiguous => Some((Check::AmbiguousMarkers, format!("link {link}"))),
    };
    let jumped = "have a marker that jumped and is left out";
    let swapped = "have two labels that are swapped, and swapped back";
    let ambiguous = "have markers that contradict each other or the motion, and it \
         is not clear which of them; the link's pose is thrown out";
    [
        (Check::JumpedMarker, jumped),
        (Check::SwappedLabels, swapped),
        (Check::AmbiguousMarkers, ambiguous),
    ]
    .map(|(check, what)| {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        let mut count = |(_, name)| *counts.entry(name).or_default() += 1;
        let is_concerned = |frame: &usize| {
            let found = (0..3).filter_map(|link| named(link, tracked.outlier[link][*frame]));
            found.filter(|(of, _)| *of == check).map(&mut count).count() > 0
        };
        let concerned = frames.clone().filter(is_concerned).count();
        let each: Vec<String> =
            counts.iter().map(|(name, count)| format!("{name} in {count}")).collect();
        let list = if each.is_empty() { String::new() } else { format!(": {}", each.join(", ")) };
        let message = format!("{concerned} frames {what}{list}");
        let part = concerned as f64 / frames.len() as f64;
        Finding::at_most(check, part, message).notable(concerned > 0)
    })
}
