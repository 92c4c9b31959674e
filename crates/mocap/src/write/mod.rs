//! Writes marker files in the formats that are read.

mod c3d;
mod csv;
mod motive;
mod qualisys;
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
        /// Qualisys Track Manager TSV.
        Qualisys = "qualisys",
    }
}

impl Format {
    /// Returns the extension of the file name, without a dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Csv | Self::Motive => "csv",
            Self::C3d => "c3d",
            Self::Trc => "trc",
            Self::Qualisys => "tsv",
        }
    }

    /// Encodes the recording of a trial.
    pub fn encode(self, trial: &str, recording: &Recording) -> Vec<u8> {
        match self {
            Self::Csv => csv_bytes(recording),
            Self::C3d => c3d_bytes(recording),
            Self::Motive => motive::bytes(trial, recording),
            Self::Trc => trc_bytes(trial, recording),
            Self::Qualisys => qualisys::bytes(recording),
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
    use super::*;
    use crate::{LengthUnit, parse_markers};

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
        for format in Format::ALL {
            let file = format!("trial.{}", format.extension());
            let bytes = format.encode("trial", &written);
            let read = parse_markers(file.as_ref(), &bytes, LengthUnit::Mm).unwrap();
            assert_eq!((read.rate_hz, &read.frames), (Some(120.0), &written.frames), "{format}");
            assert_eq!((&read.labels, &read.doubts[..]), (&written.labels, &[][..]), "{format}");
            let pairs = read.positions_mm.as_flattened().iter();
            for (read, written) in pairs.zip(written.positions_mm.as_flattened()) {
                let is_same = (read - written).abs() < 6e-4 || read.is_nan() && written.is_nan();
                assert!(is_same, "{format}: {read} {written}");
            }
        }
    }
}
