//! Tests of runs that are killed at any moment: no table is unreadable, and the next run gives the same results as an
//! undisturbed run.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use trilink_tables::Table;

use crate::common::{Small, assert_same, text, trilink, was_up_to_date};

/// Kinds of runs that are killed: name, and arguments of the program.
const RUNS: [(&str, &[&str]); 3] =
    [("the first", &["run"]), ("a changed trial's", &["run"]), ("a forced", &["run", "--force"])];

fn folder(kind: usize) -> Small {
    match kind {
        0 => Small::raw(),
        1 => {
            let folder = Small::done();
            // One trial now has another recording, and one is removed.
            let name = "raw/kinematic-symmetric-5.00-r1.csv";
            let recorded = text(&folder.read(name));
            let cut = recorded.lines().take(900).collect::<Vec<_>>().join("\r\n") + "\r\n";
            folder.write(name, cut);
            let list = text(&folder.read("raw/trials.toml"));
            let kept = list.split("[[trial]]").filter(|entry| !entry.contains("skewed-6.00"));
            folder.write("raw/trials.toml", kept.collect::<Vec<_>>().join("[[trial]]"));
            folder
        }
        _ => Small::done(),
    }
}

fn assert_tables_are_whole(folder: &Path) {
    let mut open = vec![folder.to_owned()];
    while let Some(inner) = open.pop() {
        for entry in std::fs::read_dir(&inner).into_iter().flatten() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|extension| extension == "parquet") {
                Table::read(&path).unwrap();
            }
        }
    }
}

/// Kills `number` runs at random moments.
fn kill(number: usize, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let undisturbed = [0, 1, 2].map(|kind| folder(kind).scratch());
    let lasts = [0, 1, 2].map(|kind| {
        let folder = folder(kind);
        let begin = Instant::now();
        trilink(folder.path(), RUNS[kind].1);
        begin.elapsed()
    });
    let mut killed = 0;
    for shot in 0..number {
        let kind = shot % RUNS.len();
        let (name, arguments) = RUNS[kind];
        let folder = folder(kind);
        let moment = lasts[kind].mul_f64(random.random_range(0.0..1.0));
        // Sometimes two runs are killed in succession, so that the second one finds what the first one has left.
        for _ in 0..1 + shot % 2 {
            let mut run = Command::new(env!("CARGO_BIN_EXE_trilink"))
                .args(arguments)
                .current_dir(folder.path())
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            std::thread::sleep(moment);
            killed += usize::from(run.try_wait().unwrap().is_none());
            run.kill().unwrap();
            run.wait().unwrap();
            assert_tables_are_whole(&folder.place("derived"));
        }
        let output = trilink(folder.path(), &["run"]);
        let what = format!("{name} run, killed after {moment:?}");
        assert!(output.status.code() < Some(2), "{what}: {}", text(&output.stderr));
        assert_same(&folder.results(), &undisturbed[kind], &what);
        let again = trilink(folder.path(), &["run"]);
        assert!(was_up_to_date(&again), "{what}");
    }
    assert!(killed * 2 > number, "{killed} of {number} were still running");
}

#[test]
fn a_killed_run_is_completed_by_the_next_one() {
    kill(6, 1);
}

#[test]
#[ignore = "takes minutes"]
fn a_hundred_killed_runs_are_completed_by_the_next_ones() {
    kill(100, 2);
}
