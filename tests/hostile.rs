//! What the fuzz targets do, in small: tables, settings and records with absurd content end in
//! results or an error, within seconds.

#![allow(clippy::unwrap_used)]

#[path = "common/fuzz.rs"]
mod fuzz;

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use fuzz::Project;

/// Bytes that look random, the same every time (Knuth's MMIX generator).
fn bytes(seed: u64, count: usize) -> Vec<u8> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 56) as u8
    };
    (0..count).map(|_| next()).collect()
}

/// There is one project, and a lot to do again after some damage.
#[track_caller]
fn within_seconds(what: &str, work: impl FnOnce()) {
    static PROJECT: Mutex<()> = Mutex::new(());
    let _one = PROJECT.lock().unwrap_or_else(PoisonError::into_inner);
    let begin = Instant::now();
    work();
    assert!(begin.elapsed() < Duration::from_secs(60), "{what}: {:?}", begin.elapsed());
}

/// The tables that stages read, by their paths inside of `derived/`.
fn tables() -> Vec<String> {
    let whole = ["trials", "fits", "predictions", "comparison", "robot_parameters"];
    let mut tables: Vec<String> = whole.map(|name| format!("{name}.parquet")).into();
    tables.extend(["poses", "wheels", "cycles"].map(Project::of_trial));
    tables
}

#[test]
#[ignore = "for long: TRILINK_HOSTILE=seconds cargo test --test hostile -- --ignored --nocapture"]
fn tables_with_absurd_content_end_so_however_often_they_are_tried() {
    let seconds = std::env::var("TRILINK_HOSTILE").unwrap().parse().unwrap();
    let (begin, mut seed) = (Instant::now(), 0);
    while begin.elapsed() < Duration::from_secs(seconds) {
        for name in &tables() {
            let data = bytes(seed, 6 + seed as usize % 60);
            println!("{name}, edits {seed}");
            within_seconds(&format!("{name}, edits {seed}"), || fuzz::table(name, &data));
            seed += 1;
        }
    }
    println!("{seed} tables in {:?}", begin.elapsed());
}

#[test]
fn tables_with_absurd_content_end_in_results_or_an_error() {
    within_seconds("a run", fuzz::begin);
    within_seconds("as it is", || fuzz::table(&tables()[0], &[]));
    for name in &tables() {
        for seed in 0..4 {
            let data = bytes(seed, 40);
            within_seconds(&format!("{name}, edits {seed}"), || fuzz::table(name, &data));
        }
    }
    for seed in 0..4 {
        within_seconds("history", || fuzz::history(&bytes(seed, 40)));
    }
}

#[test]
fn damaged_records_settings_and_markers_end_in_results_or_an_error() {
    let mut whole = Vec::new();
    within_seconds("a run", || whole = fuzz::recorded());
    for seed in 0..4 {
        let mut damaged = whole.clone();
        for at in bytes(seed, 30).chunks(2) {
            let place = (usize::from(at[0]) << 8 | usize::from(at[1])) % damaged.len();
            damaged[place] = at[0];
        }
        within_seconds("record", || fuzz::record(&damaged));
    }
    for seed in 0..100 {
        within_seconds("markers", || fuzz::markers("random.c3d", &bytes(seed, 2048)));
    }
    let settings = include_bytes!("../pipeline.toml");
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
