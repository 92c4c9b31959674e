//! A solver that has solved once needs no more memory, and a long recording little beside itself.

#![allow(clippy::unwrap_used)]

use std::fs;

use allocation_counter::measure;
use trilink_ingest::process_trial;
use trilink_mechanics::{FIT_ACCURACY, Laws, Problem, Solver};
use trilink_robot::{Gait, Robot};
use trilink_synth::{Recipe, synthesise};
use trilink_tables::config::Config;
use trilink_tables::trial::TrialList;

fn problems(omega_rad_s: f64) -> Vec<Problem> {
    let kinds = [
        (Robot::kinematic(), Gait::symmetric(), Laws::SKID_ROLL),
        (Robot::kinematic(), Gait::skewed(), Laws::SKID),
        (Robot::kinematic(), Gait::skewed(), Laws::NO_SKID),
        (Robot::semi_passive(), Gait::passive_symmetric(), Laws::SKID_ROLL),
        (Robot::semi_passive(), Gait::passive_symmetric(), Laws::NO_SKID_ROLL),
    ];
    of(&kinds, omega_rad_s)
}

/// Under dry friction.
fn dry_problems(omega_rad_s: f64) -> Vec<Problem> {
    let kinds = [
        (Robot::kinematic(), Gait::symmetric(), Laws::COULOMB),
        (Robot::kinematic(), Gait::skewed(), Laws::COULOMB_VISCOUS),
        (Robot::semi_passive(), Gait::passive_symmetric(), Laws::COULOMB),
    ];
    of(&kinds, omega_rad_s)
}

fn of(kinds: &[(Robot, Gait, Laws)], omega_rad_s: f64) -> Vec<Problem> {
    let kinds = kinds.iter().cloned();
    kinds.map(|(robot, gait, laws)| Problem { robot, gait, laws, omega_rad_s }).collect()
}

#[test]
fn a_solution_after_the_first_allocates_nothing() {
    // The slowest needs the most elements, under dry friction none for sure.
    let viscous = problems(0.5).into_iter().zip(problems(3.9));
    let dry = dry_problems(3.9).into_iter().zip(dry_problems(3.9));
    for (first, next) in viscous.chain(dry) {
        let mut solver = Solver::default();
        let mut solve = |problem: &Problem| {
            let counted = measure(|| {
                solver.forget();
                solver.solve(problem, FIT_ACCURACY).unwrap();
                solver.solve(problem, FIT_ACCURACY).unwrap();
                solver.floquet().unwrap();
                solver.work_and_loss_j().unwrap();
                solver.polish().unwrap();
                solver.derivatives().unwrap();
            });
            counted.count_total
        };
        let at_first = solve(&first);
        assert!(at_first > 0 || !first.laws.skids(), "the counter does not count");
        assert_eq!(solve(&next), 0, "{:?} {:?}", next.laws, next.gait);
    }
}

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
