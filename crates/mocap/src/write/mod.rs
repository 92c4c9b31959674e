//! Writes marker files in the formats that are read.

mod c3d;
mod csv;
mod motive;
mod qualisys;
mod table;
mod tracker;
mod trc;

use trilink_base::named;

pub use c3d::c3d_bytes;
pub use csv::csv_bytes;
pub use trc::trc_bytes;

use crate::Recording;

named! {
    /// Format of a marker file.
    pub enum Format {
        /// Vicon Nexus CSV, the `Trajectories` section alone.
        Csv = "csv",
        /// C3D with floating-point numbers.
        C3d = "c3d",
        /// OptiTrack Motive CSV.
        Motive = "motive",
        /// TRC, the marker table of Cortex and OpenSim.
        Trc = "trc",
        /// Qualisys Track Manager TSV, 3D data.
        Qualisys = "qualisys",
        /// Vicon Tracker CSV, the `Objects` section: rigid bodies.
        Tracker = "tracker",
        /// OptiTrack Motive CSV, rigid bodies.
        MotiveBodies = "motive-bodies",
        /// Qualisys Track Manager TSV, 6D data: rigid bodies.
        Qualisys6d = "qualisys-6d",
        /// CSV table of markers, for any program.
        Table = "table",
        /// CSV table of rigid bodies, for any program.
        Poses = "poses",
        /// Parquet table of rigid bodies, for any program.
        PosesParquet = "poses-parquet",
    }
}

impl Format {
    /// Returns the extension of the file name, without a dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Csv
            | Self::Motive
            | Self::Tracker
            | Self::MotiveBodies
            | Self::Table
            | Self::Poses => "csv",
            Self::PosesParquet => "parquet",
            Self::C3d => "c3d",
            Self::Trc => "trc",
            Self::Qualisys | Self::Qualisys6d => "tsv",
        }
    }

    /// Returns whether the format contains poses of rigid bodies instead of markers.
    pub fn has_bodies(self) -> bool {
        matches!(
            self,
            Self::Tracker
                | Self::MotiveBodies
                | Self::Qualisys6d
                | Self::Poses
                | Self::PosesParquet
        )
    }

    /// Encodes the recording of a trial: its rigid bodies if the format [has them](Self::has_bodies), otherwise all
    /// markers.
    pub fn encode(self, trial: &str, recording: &Recording) -> Vec<u8> {
        match self {
            Self::Csv => csv_bytes(recording),
            Self::C3d => c3d_bytes(recording),
            Self::Motive => motive::bytes(trial, recording),
            Self::Trc => trc_bytes(trial, recording),
            Self::Qualisys => qualisys::bytes(recording),
            Self::Tracker => tracker::bytes(recording),
            Self::MotiveBodies => motive::body_bytes(trial, recording),
            Self::Qualisys6d => qualisys::body_bytes(recording),
            Self::Table | Self::Poses => table::csv_bytes(recording),
            Self::PosesParquet => table::parquet_bytes(recording),
        }
    }
}

/// Returns the time of a row since the first frame, s; NaN if the frame rate is unknown.
fn time_s(recording: &Recording, row: usize) -> f64 {
    let frames = &recording.frames;
    (frames[row] - frames[0]) as f64 / recording.rate_hz.unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use trilink_base::body;

    use super::*;
    use crate::{LengthUnit, parse_markers};

    /// Checks that a recording is read from its encoding as it was written, to `tolerance_mm`.
    #[track_caller]
    fn assert_read_back(format: Format, written: &Recording, tolerance_mm: f64) {
        let file = format!("trial.{}", format.extension());
        let bytes = format.encode("trial", written);
        let read = parse_markers(file.as_ref(), &bytes, LengthUnit::Mm).unwrap();
        assert_eq!((read.rate_hz, &read.frames), (Some(120.0), &written.frames), "{format}");
        assert_eq!((&read.labels, &read.doubts[..]), (&written.labels, &[][..]), "{format}");
        let pairs = read.positions_mm.as_flattened().iter();
        for (read, written) in pairs.zip(written.positions_mm.as_flattened()) {
            let is_same =
                (read - written).abs() < tolerance_mm || read.is_nan() && written.is_nan();
            assert!(is_same, "{format}: {read} {written}");
        }
    }

    #[test]
    fn every_format_is_read_back_as_written() {
        let frames: Vec<i64> = (7..107).collect();
        let labels = ["Snake:M1", "Snake:F1", "wand"].map(str::to_owned).to_vec();
        let positions = frames.iter().flat_map(|&frame| {
            let t = frame as f64 / 120.0;
            let moving = |x: f64| [x + 400.0 * t, -300.0 + 150.0 * (6.0 * t).sin(), 62.125];
            let hidden = if frame % 10 == 3 { [f64::NAN; 3] } else { moving(-90.5) };
            [moving(12.25), hidden, moving(0.0)]
        });
        let positions = positions.collect();
        let written = Recording::new(Some(120.0), frames, labels, positions);
        for format in Format::ALL.into_iter().filter(|format| !format.has_bodies()) {
            assert_read_back(format, &written, 6e-4);
        }
    }

    #[test]
    fn every_format_of_poses_is_read_back_as_written() {
        let frames: Vec<i64> = (7..107).collect();
        let names = ["Snake:middle", "Snake:front"];
        let labels = names.iter().flat_map(|name| (0..4).map(|i| body::point_label(name, i)));
        let labels: Vec<String> = labels.collect();
        let positions = frames.iter().flat_map(|&frame| {
            let t = frame as f64 / 120.0;
            let tilt = [0.02 * (3.0 * t).sin(), -0.01];
            let pose = |x: f64, yaw: f64| {
                let axes = body::turned([(2, yaw), (1, tilt[1]), (0, tilt[0])]);
                body::points([x + 400.0 * t, -300.0 + 150.0 * (6.0 * t).sin(), 62.125], &axes)
            };
            let hidden = frame % 10 == 3;
            let front = if hidden { [[f64::NAN; 3]; 4] } else { pose(150.0, -2.0 - 4.0 * t) };
            [pose(12.25, 3.0 * t), front].concat()
        });
        let written = Recording::new(Some(120.0), frames.clone(), labels, positions.collect());
        for format in Format::ALL.into_iter().filter(|format| format.has_bodies()) {
            assert_read_back(format, &written, 1.5e-3);
        }
    }
}
