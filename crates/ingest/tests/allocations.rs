//! Memory needed to process a long recording.

#![allow(clippy::unwrap_used)]

use std::fs;

use allocation_counter::measure;
use trilink_ingest::process_trial;
use trilink_synth::{Recipe, synthesise};
use trilink_tables::config::Config;
use trilink_tables::trial::TrialList;

#[test]
fn ten_hours_of_recording_need_hardly_more_than_a_gigabyte_in_addition_to_the_values() {
    // Each of the ten markers has three numbers, and each row a frame number.
    const VALUES_BYTES: u64 = 10 * 24 + 8;
    const FRAMES_OF_TEN_HOURS: u64 = 10 * 3600 * 120;
    const ROWS: usize = 30_000;
    const HEADER: usize = 5;
    let mut config = Config::default();
    config.campaign.retain(|name, _| name == "kinematic-symmetric");
    let folder = tempfile::tempdir().unwrap();
    let recipe = Recipe { omegas_rad_s: vec![0.2], ..Recipe::new(1) };
    synthesise(&config, folder.path(), &recipe, &|_| Ok(())).unwrap();
    let trial = TrialList::load(folder.path()).unwrap().trial.remove(0);
    let path = folder.path().join(&trial.file);
    let file = fs::read_to_string(&path).unwrap();
    let lines: Vec<&str> = file.lines().take(HEADER + ROWS).collect();
    assert_eq!(lines.len(), HEADER + ROWS);
    fs::write(&path, lines.join("\n") + "\n").unwrap();

    // Memory that polars allocates only once is allocated in the first call.
    drop(process_trial(folder.path(), &trial, &config).unwrap());
    let counted = measure(|| drop(process_trial(folder.path(), &trial, &config).unwrap()));
    let extra = counted.bytes_max / ROWS as u64 - VALUES_BYTES;
    let of_ten_hours = extra * FRAMES_OF_TEN_HOURS;
    assert!(of_ten_hours < (1 << 30) * 11 / 10, "{extra} bytes per row");
}
