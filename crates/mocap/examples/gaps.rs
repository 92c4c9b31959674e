//! Coverage of every marker in a motion-capture file: frames seen, number of gaps, longest gap.
//!
//! A gap is a run of frames without the marker between two frames that have it; frame numbers that
//! the file leaves out count as not seen. CSV and C3D files are read, also packed by gzip.
//!
//! ```sh
//! cargo run -p trilink-mocap --example gaps                    # the fixture nexus.c3d
//! cargo run -p trilink-mocap --example gaps -- trial07.csv.gz
//! ```

use std::path::PathBuf;
use std::process::ExitCode;

use trilink_mocap::{LengthUnit, Recording, read_markers};

const FIXTURE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/nexus.c3d");

/// Lengths of a marker's gaps, in frames.
fn gaps(seen: &[i64]) -> Vec<u64> {
    seen.windows(2).map(|pair| pair[1].abs_diff(pair[0]) - 1).filter(|&gap| gap > 0).collect()
}

/// A length of time in the rate of the file, which a trimmed file may not state.
fn duration(frames: u64, rate_hz: Option<f64>) -> String {
    match rate_hz {
        Some(rate_hz) => format!("{:.1} ms", 1000.0 * frames as f64 / rate_hz),
        None => format!("{frames} frames"),
    }
}

fn print(file: &Recording) {
    // A file that can be read has a frame at least.
    let frames = file.frames[file.frames.len() - 1].abs_diff(file.frames[0]) as f64 + 1.0;
    println!("{:<24} {:>8} {:>6} {:>14}", "marker", "seen", "gaps", "longest gap");
    for (marker, label) in file.labels.iter().enumerate() {
        let rows = file.frames.iter().enumerate();
        let is_seen = |row| !file.position_mm(row, marker)[0].is_nan();
        let seen: Vec<i64> = rows.filter(|(row, _)| is_seen(*row)).map(|(_, at)| *at).collect();
        let gaps = gaps(&seen);
        let longest = gaps.iter().max().map_or("-".into(), |&gap| duration(gap, file.rate_hz));
        let percent = 100.0 * seen.len() as f64 / frames;
        println!("{label:<24} {percent:>6.1} % {:>6} {longest:>14}", gaps.len());
    }
}

fn main() -> ExitCode {
    let path = std::env::args_os().nth(1).map_or_else(|| FIXTURE.into(), PathBuf::from);
    // The unit is that of a file which does not state its own; Vicon's default is mm.
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
