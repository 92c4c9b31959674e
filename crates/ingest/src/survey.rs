//! Surveys a marker file that has no entry in `trials.toml`: its content, and problems that would prevent its ingest.

use std::path::{Path, PathBuf};

use serde::Serialize;
use trilink_base::body;
use trilink_mocap::{Recording, Section};
use trilink_statistics::median_high;

use super::error::Problem;
use super::input::IngestSettings;
use super::markers::layout::{self, Layout};
use super::poses::{self, header_check, tracking_checks};

/// Overview of a marker file.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct FileSurvey {
    pub file: PathBuf,
    /// Whether the file could be opened.
    pub readable: bool,
    /// All tables in the file, including those that the ingest does not read.
    pub sections: Vec<Section>,
    /// Content of the marker table; `None` if it cannot be read.
    pub recording: Option<RecordingSurvey>,
    /// Problems that would prevent the ingest of the file.
    pub stops: Vec<String>,
    /// Warnings that the ingest of the file would raise.
    pub warnings: Vec<String>,
}

/// Content of the marker table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RecordingSurvey {
    /// Frame rate that the file states, Hz; `None` if it states none.
    pub rate_hz: Option<f64>,
    pub first_frame: i64,
    pub last_frame: i64,
    /// Number of rows with a frame number.
    pub rows: usize,
    /// Number of frames missing between the first and the last row.
    pub frames_left_out: i64,
    pub rows_without_frame: usize,
    /// Fraction of marker positions that were recorded.
    pub coverage: f64,
    pub markers: Vec<MarkerCoverage>,
    pub gaps: Gaps,
}

/// Coverage of one marker or rigid body in a file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MarkerCoverage {
    pub label: String,
    /// Link to which the marker layout assigns the marker; `None` if the layout does not have it.
    pub link: Option<usize>,
    /// Whether `vicon.ignore` matches the marker, which excludes it from all other statistics.
    pub ignored: bool,
    /// Fraction of frames in which the marker was visible.
    pub coverage: f64,
    /// Number of gaps between frames in which the marker was visible.
    pub gaps: usize,
}

/// Gaps of all markers, each between two frames in which the marker was visible. Median and maximum are `None` if there
/// are no gaps, and times are `None` if the frame rate is unknown.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Gaps {
    pub count: usize,
    /// Median length, frames; the upper of the two central values if the number of gaps is even; `None` if there are no
    /// gaps.
    pub median_frames: Option<i64>,
    pub longest_frames: Option<i64>,
    pub median_s: Option<f64>,
    pub longest_s: Option<f64>,
}

/// Reads a marker file and lists its content and problems.
pub fn survey(path: &Path, settings: &IngestSettings) -> FileSurvey {
    let mut survey = FileSurvey { file: path.to_owned(), ..FileSurvey::default() };
    let read = trilink_mocap::read_file(path).map_err(|error| survey.stops.push(error.to_string()));
    let Ok((bytes, _)) = read else { return survey };
    survey.readable = true;
    // An error in the sections is also reported as an error in the markers.
    survey.sections = trilink_mocap::sections(path, &bytes).unwrap_or_default();
    match trilink_mocap::parse_markers(path, &bytes, settings.vicon.unit) {
        Ok(file) => survey.add_markers(path, &file, settings),
        Err(error) => survey.stops.push(error.to_string()),
    }
    survey
}

impl FileSurvey {
    fn add_markers(&mut self, path: &Path, file: &Recording, settings: &IngestSettings) {
        self.warnings.extend(header_check(file).map(|finding| finding.to_string()));
        let ignore = &settings.vicon.ignore;
        let whole = file;
        let file = &whole.clone().without(ignore);
        let mut stop = |problem: Problem| self.stops.push(problem.in_file(path).to_string());
        let rate_hz = settings.frame_rate(file).map_err(&mut stop).ok();
        let (layout, problems) = layout::locate_all(&settings.markers, file);
        self.recording =
            Some(RecordingSurvey::new(whole, ignore, &layout, whole.rate_hz.or(rate_hz)));
        if !problems.is_empty() {
            return problems.into_iter().for_each(stop);
        }
        let rate_hz = rate_hz.unwrap_or(settings.vicon.rate_hz);
        let poses = settings.ingest.poses;
        let max_gap = settings.max_gap_frames(rate_hz);
        let tracked = poses::solve(file, &layout, None, poses, rate_hz, 0..file.frames.len())
            .and_then(|poses| poses.over_time(&file.frames, &layout, max_gap))
            .map_err(stop);
        let Ok(tracked) = tracked else { return };
        let findings = tracking_checks(&tracked, file, &layout, settings, &(0..tracked.frames()));
        let wrong = findings.into_iter().filter(|finding| !finding.holds());
        // The check of the file header is one of these findings.
        self.warnings = wrong.map(|finding| finding.to_string()).collect();
    }
}

impl RecordingSurvey {
    fn new(file: &Recording, ignore: &[String], layout: &Layout, rate_hz: Option<f64>) -> Self {
        let first_frame = file.frames[0];
        let last_frame = file.frames[file.frames.len() - 1];
        let frames = last_frame - first_frame + 1;
        let mut gaps = Vec::new();
        let mut markers: Vec<MarkerCoverage> = Vec::with_capacity(file.labels.len());
        let mut total_visible = 0;
        let mut kept = 0;
        for (i, label) in file.labels.iter().enumerate() {
            let seen: Vec<i64> = (0..file.frames.len())
                .filter(|&row| !file.position_mm(row, i)[0].is_nan())
                .map(|row| file.frames[row])
                .collect();
            let lengths: Vec<i64> =
                seen.windows(2).map(|pair| pair[1] - pair[0] - 1).filter(|gap| *gap > 0).collect();
            // The columns of the layout number only the markers that are not ignored.
            let ignored = file.is_named(i, ignore);
            if !ignored {
                total_visible += seen.len();
            }
            // The points of a rigid body count as one marker.
            if body::of_point(label).is_some_and(|(_, point)| point > 0) {
                kept += usize::from(!ignored);
                continue;
            }
            markers.push(MarkerCoverage {
                label: body::name(label).to_owned(),
                link: layout
                    .iter()
                    .position(|markers| markers.iter().any(|m| m.column == kept))
                    .filter(|_| !ignored),
                ignored,
                coverage: seen.len() as f64 / frames as f64,
                gaps: lengths.len(),
            });
            if !ignored {
                kept += 1;
                gaps.extend(lengths);
            }
        }
        Self {
            rate_hz: file.rate_hz,
            first_frame,
            last_frame,
            rows: file.frames.len(),
            frames_left_out: frames - file.frames.len() as i64,
            rows_without_frame: file.rows_without_frame,
            coverage: total_visible as f64 / (f64::from(kept.max(1) as u32) * frames as f64),
            markers,
            gaps: Gaps::from_lengths(&gaps, rate_hz),
        }
    }
}

impl Gaps {
    /// Summarises gaps, given their lengths in frames.
    fn from_lengths(gaps: &[i64], rate_hz: Option<f64>) -> Self {
        let longest_frames = gaps.iter().max().copied();
        let median_frames = longest_frames
            .map(|_| median_high(gaps.iter().map(|frames| *frames as f64).collect()) as i64);
        let seconds = |frames: Option<i64>| Some(frames? as f64 / rate_hz?);
        Self {
            count: gaps.len(),
            median_frames,
            longest_frames,
            median_s: seconds(median_frames),
            longest_s: seconds(longest_frames),
        }
    }
}

#[cfg(test)]
mod tests {
    use trilink_tables::config::Config;

    use super::*;

    fn fixture(name: &str) -> FileSurvey {
        survey(
            &Path::new("../mocap/tests/fixtures").join(name),
            &IngestSettings::new(&Config::default()),
        )
    }

    #[test]
    fn gaps_are_between_frames_in_which_a_marker_was_seen() {
        let recording = fixture("gaps.csv").recording.unwrap();
        assert_eq!((recording.first_frame, recording.last_frame, recording.rows), (1, 5, 5));
        let markers = recording.markers.iter().map(|m| (m.label.as_str(), m.coverage, m.gaps));
        assert_eq!(markers.collect::<Vec<_>>(), [("Snake:M1", 0.4, 1), ("Snake:M2", 0.6, 1)]);
        assert_eq!(recording.coverage, 0.5);
        let expected = Gaps {
            count: 2,
            median_frames: Some(2),
            longest_frames: Some(2),
            median_s: Some(2.0 / 120.0),
            longest_s: Some(2.0 / 120.0),
        };
        assert_eq!(recording.gaps, expected);
    }

    #[test]
    fn a_jump_of_the_frames_is_a_gap_of_every_marker() {
        let recording = fixture("frames.csv").recording.unwrap();
        assert_eq!(recording.frames_left_out, 62766);
        assert_eq!(recording.rows_without_frame, 2);
        assert_eq!((recording.gaps.count, recording.gaps.longest_frames), (2, Some(62766)));
    }

    #[test]
    fn all_problems_of_a_file_are_listed_and_not_only_the_first() {
        let path = Path::new("../mocap/tests/fixtures/nexus.csv");
        let mut config = Config::default();
        config.vicon.rate_hz = 100.0;
        config.markers.link0.retain(|label, _| label == "M1" || label == "M2");
        config.markers.link1.retain(|label, _| label == "F1");
        config.markers.link2.clear();
        let survey = survey(path, &IngestSettings::new(&config));
        assert_eq!(survey.stops.len(), 2, "{:?}", survey.stops);
        assert!(
            survey.stops[0]
                .contains("the file's frame rate is 120 Hz, but vicon.rate_hz is 100 Hz")
        );
        assert!(survey.stops[1].contains("the file has no marker `F1`"));
        assert!(survey.recording.is_some());
    }

    #[test]
    fn ignored_markers_are_listed_and_excluded_from_the_statistics() {
        let path = Path::new("../mocap/tests/fixtures/gaps.csv");
        let mut config = Config::default();
        config.vicon.ignore = vec!["*1".to_owned()];
        let recording = survey(path, &IngestSettings::new(&config)).recording.unwrap();
        let ignored = recording.markers.iter().map(|m| (m.label.as_str(), m.ignored));
        assert_eq!(ignored.collect::<Vec<_>>(), [("Snake:M1", true), ("Snake:M2", false)]);
        assert_eq!((recording.coverage, recording.gaps.count), (0.6, 1));
    }

    #[test]
    fn a_file_without_markers_has_its_sections_listed() {
        let survey = fixture("devices-only.csv");
        assert!(survey.readable);
        assert_eq!(survey.sections.len(), 1);
        assert_eq!(survey.recording, None);
        assert!(survey.stops[0].contains("found only the section `Devices`"));
        assert!(!fixture("absent.csv").readable);
    }
}
