//! A long recording needs little memory beside itself.

#![allow(clippy::unwrap_used)]

use std::fs;

use allocation_counter::measure;
use trilink_ingest::process_trial;
use trilink_synth::{Recipe, synthesise};
use trilink_tables::config::Config;
use trilink_tables::trial::TrialList;

#[test]
fn ten_hours_of_a_recording_need_hardly_more_than_a_gigabyte_beside_its_values() {
    // Ten markers of three numbers each and the frame's own number.
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
    let place = folder.path().join(&trial.file);
    let file = fs::read_to_string(&place).unwrap();
    let lines: Vec<&str> = file.lines().take(HEADER + ROWS).collect();
    assert_eq!(lines.len(), HEADER + ROWS);
    fs::write(&place, lines.join("\n") + "\n").unwrap();

    let process = || drop(process_trial(folder.path(), &trial, &config).unwrap());
    // What polars has once for all columns is there after the first.
    process();
    let counted = measure(process);
    let beside = counted.bytes_max / ROWS as u64 - VALUES_BYTES;
    let of_ten_hours = beside * FRAMES_OF_TEN_HOURS;
    assert!(of_ten_hours < (1 << 30) * 11 / 10, "{beside} bytes of each row");
}
