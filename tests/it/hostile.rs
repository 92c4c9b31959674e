//! Small-scale version of the fuzz targets: tables, settings and records with absurd content lead to results or an
//! error within seconds.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::common::fuzz;

/// Runs the program in a separate process, so that it does not write to the tests' output.
fn apart(config: &Path, line: &str) -> i32 {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trilink"));
    command.args(["-q", "-c"]).arg(config).args(line.split(' '));
    let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status().unwrap();
    status.code().unwrap_or(-1)
}

/// Returns reproducible pseudo-random bytes (Knuth's MMIX generator).
fn bytes(seed: u64, count: usize) -> Vec<u8> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 56) as u8
    };
    (0..count).map(|_| next()).collect()
}

/// Runs all commands that read the table `name`, each after damaging the table by `data`.
fn damage(name: &str, data: &[u8]) {
    for reader in fuzz::readers(name) {
        fuzz::table(apart, name, reader, data);
    }
}

/// Asserts that `work`, in the project that the tests share, ends within a minute. A lock admits one test at a time;
/// the wait for it does not count.
#[track_caller]
fn within_seconds(what: &str, work: impl FnOnce()) {
    static PROJECT: Mutex<()> = Mutex::new(());
    let _one = PROJECT.lock().unwrap_or_else(PoisonError::into_inner);
    let begin = Instant::now();
    work();
    assert!(begin.elapsed() < Duration::from_secs(60), "{what}: {:?}", begin.elapsed());
}

#[test]
#[ignore = "for long: TRILINK_HOSTILE=seconds cargo test -p trilink --test it hostile:: -- --ignored --nocapture"]
fn many_tables_with_absurd_content_lead_to_results_or_an_error() {
    let seconds = std::env::var("TRILINK_HOSTILE").unwrap().parse().unwrap();
    let (begin, mut seed) = (Instant::now(), 0);
    while begin.elapsed() < Duration::from_secs(seconds) {
        for name in fuzz::tables() {
            let data = bytes(seed, 6 + seed as usize % 60);
            println!("{name}, edits {seed}");
            within_seconds(&format!("{name}, edits {seed}"), || damage(name, &data));
            seed += 1;
        }
    }
    println!("{seed} tables in {:?}", begin.elapsed());
}

#[test]
fn every_table_is_tested() {
    let tried = fuzz::tables();
    let mut there = Vec::new();
    within_seconds("a run", || there = fuzz::tables_there(apart));
    assert_eq!(there, tried);
}

#[test]
fn tables_with_absurd_content_end_in_results_or_an_error() {
    within_seconds("a run", || fuzz::begin(apart));
    within_seconds("as it is", || fuzz::undamaged(apart));
    for name in fuzz::tables() {
        for seed in 0..3 {
            let data = bytes(seed, 40);
            within_seconds(&format!("{name}, edits {seed}"), || damage(name, &data));
        }
    }
    for seed in 0..4 {
        within_seconds("history", || fuzz::history(apart, &bytes(seed, 40)));
    }
}

#[test]
fn damaged_records_settings_and_markers_end_in_results_or_an_error() {
    let mut whole = Vec::new();
    within_seconds("a run", || whole = fuzz::recorded(apart));
    for seed in 0..4 {
        let mut damaged = whole.clone();
        for at in bytes(seed, 30).chunks(2) {
            let place = (usize::from(at[0]) << 8 | usize::from(at[1])) % damaged.len();
            damaged[place] = at[0];
        }
        within_seconds("record", || fuzz::record(apart, &damaged));
    }
    for seed in 0..100 {
        within_seconds("markers", || fuzz::markers("random.c3d", &bytes(seed, 2048)));
    }
    let settings = include_bytes!("../../pipeline.toml");
    let numbers: Vec<usize> =
        (0..settings.len()).filter(|i| settings[*i].is_ascii_digit()).collect();
    for seed in 0..8 {
        let mut damaged = settings.to_vec();
        for at in bytes(seed, 4).chunks(2) {
            let place = numbers[(usize::from(at[0]) << 8 | usize::from(at[1])) % numbers.len()];
            damaged[place] = b"0123456789e-."[usize::from(at[1]) % 13];
        }
        within_seconds("settings", || fuzz::settings(&damaged));
    }
}
