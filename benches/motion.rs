//! Steady motions: cold, and warm from the neighbouring frequency.

use criterion::{Criterion, criterion_group, criterion_main};
use trilink::motion::{Accuracy, Model, Problem, SteadyMotion};
use trilink::robot::{Gait, Robot};

/// The paper's frequencies, rad/s.
const OMEGAS_RAD_S: [f64; 12] = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 3.9, 4.5, 5.0, 5.5, 6.0];

/// A sweep of one model over the paper's frequencies.
fn sweep(robot: Robot, gait: Gait, model: Model) -> Vec<Problem> {
    OMEGAS_RAD_S
        .map(|omega_rad_s| Problem { robot: robot.clone(), gait, model, omega_rad_s })
        .into()
}

/// The paper's three campaigns with its fitted coefficients.
fn campaigns(model: Model) -> [(&'static str, Vec<Problem>); 3] {
    let symmetric = Robot { skid_kg_s: [104.0, 34.0, 45.0], ..Robot::kinematic() };
    let skewed = Robot { skid_kg_s: [74.5, 91.0, 95.0], ..Robot::kinematic() };
    let passive = Robot {
        skid_kg_s: [420.0, 200.0, 70.0],
        stiffness_nm_rad: 0.137,
        damping_nm_s_rad: 0.006,
        ..Robot::semi_passive()
    };
    [
        ("kinematic-symmetric", sweep(symmetric, Gait::symmetric(), model)),
        ("kinematic-skewed", sweep(skewed, Gait::skewed(), model)),
        ("semi-passive-symmetric", sweep(passive, Gait::passive_symmetric(), model)),
    ]
}

fn solve_all(problems: &[Problem], guesses: Option<&[SteadyMotion]>) -> Vec<SteadyMotion> {
    problems
        .iter()
        .enumerate()
        .map(|(i, problem)| {
            let guess = guesses.map(|guesses| &guesses[i]);
            problem.solve(guess, Accuracy::Fit).expect("the paper's motions exist")
        })
        .collect()
}

/// Times are of whole sweeps of 12 frequencies, 36 for all campaigns.
fn steady_motions(criterion: &mut Criterion) {
    let campaigns = campaigns(Model::SkidRoll);
    for (name, problems) in &campaigns {
        criterion.bench_function(&format!("12 cold, {name}"), |bencher| {
            bencher.iter(|| solve_all(problems, None));
        });
    }
    // The neighbour of a frequency is the one before it.
    let all: Vec<Problem> = campaigns.iter().flat_map(|(_, problems)| problems.clone()).collect();
    let solved = solve_all(&all, None);
    let neighbours: Vec<SteadyMotion> =
        (0..all.len()).map(|i| solved[if i % 12 == 0 { i + 1 } else { i - 1 }].clone()).collect();
    criterion.bench_function("36 warm, all campaigns", |bencher| {
        bencher.iter(|| solve_all(&all, Some(&neighbours)));
    });
}

criterion_group!(benches, steady_motions);
criterion_main!(benches);
