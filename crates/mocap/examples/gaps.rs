//! Prints the coverage of every marker in a motion-capture file: frames visible, number of gaps, longest gap.
//!
//! A gap is a run of frames without the marker between two frames in which it is visible; frame numbers missing from
//! the file count as occluded. CSV and C3D files are read, plain or gzipped.
//!
//! ```sh
//! cargo run -p trilink-mocap --example gaps                    # the fixture nexus.c3d
//! cargo run -p trilink-mocap --example gaps -- trial07.csv.gz
//! ```

use std::path::PathBuf;
use std::process::ExitCode;

use trilink_mocap::{LengthUnit, Recording, read_markers};

const FIXTURE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/nexus.c3d");

/// Returns the lengths of a marker's gaps, in frames, given the numbers of the frames in which the marker is visible.
fn gaps(seen: &[i64]) -> Vec<u64> {
    seen.windows(2).map(|pair| pair[1].abs_diff(pair[0]) - 1).filter(|&gap| gap > 0).collect()
}

/// Formats a duration in ms, or in frames if the file does not state its rate.
fn duration(frames: u64, rate_hz: Option<f64>) -> String {
    match rate_hz {
        Some(rate_hz) => format!("{:.1} ms", 1000.0 * frames as f64 / rate_hz),
        None => format!("{frames} frames"),
    }
}

fn print(file: &Recording) {
    // A file that can be read has at least one frame.
    let frames = file.frames[file.frames.len() - 1].abs_diff(file.frames[0]) as f64 + 1.0;
    println!("{:<24} {:>8} {:>6} {:>14}", "marker", "seen", "gaps", "longest gap");
    for (marker, label) in file.labels.iter().enumerate() {
        let rows = file.frames.iter().enumerate();
        let seen: Vec<i64> = rows
            .filter(|(row, _)| !file.position_mm(*row, marker)[0].is_nan())
            .map(|(_, frame)| *frame)
            .collect();
        let gaps = gaps(&seen);
        let longest = gaps.iter().max().map_or("-".into(), |&gap| duration(gap, file.rate_hz));
        let percent = 100.0 * seen.len() as f64 / frames;
        println!("{label:<24} {percent:>6.1} % {:>6} {longest:>14}", gaps.len());
    }
}

fn main() -> ExitCode {
    let path = std::env::args_os().nth(1).map_or_else(|| FIXTURE.into(), PathBuf::from);
    // The unit applies only if the file does not state one; Vicon's default is mm.
    match read_markers(&path, LengthUnit::Mm) {
        Ok(file) => {
            print(&file);
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("gaps: {error}");
            ExitCode::FAILURE
        }
    }
}
