//! What the markers alone say of a trial, whatever was recorded.

use std::collections::BTreeMap;

use super::tilt::{MOST_DEG, Tilt, Turn};
use super::track::Tracked;
use crate::ingest::checks::{
    Check, Finding, JOINT_PLACE_MM, LEAST_COVERAGE, MOST_AMBIGUOUS, MOST_MISPLACED,
};
use crate::ingest::input::IngestSettings;
use crate::ingest::markers::labels::Outlier;
use crate::ingest::markers::layout::Layout;
use crate::store::TrialRow;
use crate::vicon::MarkerFile;

/// Adds to a row what the markers alone say.
pub fn describe_tracking(row: &mut TrialRow, tracked: &Tracked) {
    row.coverage = tracked.coverage;
    let fits = tracked.residual_mm.iter().flatten().filter(|residual| !residual.is_nan());
    let (count, sum) = fits.fold((0.0, 0.0), |(count, sum), x| (count + 1.0, sum + x));
    row.residual_mm = sum / count;
}

/// Checks that every trial has to pass.
pub fn tracking_checks(
    row: &TrialRow,
    tracked: &Tracked,
    file: &MarkerFile,
    layout: &Layout,
    settings: &IngestSettings,
) -> Vec<Finding> {
    let assumed_hz = settings.vicon.rate_hz;
    let rate = match file.rate_hz {
        Some(rate_hz) => format!("the file says {rate_hz} Hz"),
        None => {
            format!("the file does not say its rate; {assumed_hz} Hz is assumed (vicon.rate_hz)")
        }
    };
    let inserted = tracked.inserted_frames as f64;
    let unnumbered = file.rows_without_frame as f64;
    let mut findings = vec![
        Finding {
            check: Check::Rate,
            holds: file.rate_hz.is_some(),
            value: file.rate_hz.unwrap_or(f64::NAN),
            limit: assumed_hz,
            message: rate,
            is_notable: false,
        },
        Finding::at_most(
            Check::FrameContinuity,
            inserted,
            0.0,
            format!("{inserted} frames are left out of the file"),
        ),
        Finding::at_least(
            Check::Coverage,
            row.coverage,
            LEAST_COVERAGE,
            format!("{:.1} % of all markers' frames were seen", 100.0 * row.coverage),
        ),
        Finding::at_most(
            Check::Residual,
            row.residual_mm,
            settings.ingest.max_residual_mm,
            format!("markers are {:.2} mm off the layout on average", row.residual_mm),
        ),
        Finding::at_most(
            Check::RowsWithoutFrame,
            unnumbered,
            0.0,
            format!("{unnumbered} rows without a frame number are left out"),
        ),
    ];
    findings.extend(outlier_checks(tracked, file, layout));
    findings.push(tilt_check(&tracked.tilt));
    findings.extend(tracked.joint_places_mm.map(|mm| {
        let message = format!("a joint is {mm:.2} mm off where h_m and l_m of the robot put it");
        Finding::at_most(Check::JointPlaces, mm, JOINT_PLACE_MM, message)
    }));
    findings
}

/// What is tilted most, and what was done about all that is.
fn tilt_check(tilt: &Tilt) -> Finding {
    let names = ["the floor", "link 0", "link 1", "link 2"];
    let turns = [tilt.floor, tilt.links[0], tilt.links[1], tilt.links[2]];
    let said = |i: usize| {
        let (deg, se_deg) = (turns[i].size_deg(), turns[i].se_rad.to_degrees());
        let done = match (turns[i].is_large(), turns[i].is_corrected()) {
            (false, _) => "",
            (true, true) => " and was corrected",
            (true, false) => " and was left so: the layout's heights may be wrong",
        };
        format!("{} is tilted by {deg:.2} +- {se_deg:.2} degrees{done}", names[i])
    };
    let large: Vec<usize> = (0..4).filter(|&i| turns[i].is_large()).collect();
    let said: Vec<String> = large.iter().map(|&i| said(i)).collect();
    Finding {
        check: Check::Tilt,
        holds: large.is_empty(),
        value: turns.iter().map(Turn::certain_deg).fold(0.0, f64::max),
        limit: MOST_DEG,
        message: if said.is_empty() {
            "floor and links are level".to_owned()
        } else {
            said.join(", ")
        },
        is_notable: false,
    }
}

/// How many frames had a wrong marker, and which markers they were.
fn outlier_checks(tracked: &Tracked, file: &MarkerFile, layout: &Layout) -> [Finding; 3] {
    let label = |link: usize, marker: usize| &file.labels[layout[link][marker].column];
    [
        (Check::JumpedMarker, "have a marker that jumped and is left out"),
        (Check::SwappedLabels, "have two labels that are swapped, and swapped back"),
        (
            Check::AmbiguousMarkers,
            "have markers that contradict each other or the motion, and it \
          is not clear which of them; the link's pose is thrown out",
        ),
    ]
    .map(|(check, what)| {
        let name = |link: usize, outlier: Outlier| match (check, outlier) {
            (Check::JumpedMarker, Outlier::Jumped(marker)) => Some(label(link, marker).clone()),
            (Check::SwappedLabels, Outlier::Swapped(a, b)) => {
                Some(format!("{} and {}", label(link, a), label(link, b)))
            }
            (Check::AmbiguousMarkers, Outlier::Ambiguous) => Some(format!("link {link}")),
            _ => None,
        };
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        let mut frames = 0;
        for frame in 0..tracked.fill[0].len() {
            let mut is_concerned = false;
            for link in 0..3 {
                if let Some(name) = name(link, tracked.outlier[link][frame]) {
                    *counts.entry(name).or_default() += 1;
                    is_concerned = true;
                }
            }
            frames += usize::from(is_concerned);
        }
        let each: Vec<String> =
            counts.iter().map(|(name, count)| format!("{name} in {count}")).collect();
        let list = if each.is_empty() { String::new() } else { format!(": {}", each.join(", ")) };
        let part = frames as f64 / tracked.fill[0].len() as f64;
        let limit = match check {
            Check::AmbiguousMarkers => MOST_AMBIGUOUS,
            _ => MOST_MISPLACED,
        };
        Finding::at_most(check, part, limit, format!("{frames} frames {what}{list}"))
            .notable(frames > 0)
    })
}
