//! Steady motions: cold, and warm from the neighbouring frequency.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use trilink::motion::{FIT_ACCURACY, Model, Problem, Solver};
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

/// Times are of whole sweeps of 12 frequencies.
fn steady_motions(criterion: &mut Criterion) {
    let skid_roll = campaigns(Model::SkidRoll);
    let no_skid_roll = campaigns(Model::NoSkidRoll);
    let sweeps = skid_roll.iter().map(|sweep| ("skid-roll", sweep));
    for (model, (campaign, problems)) in sweeps.chain([("no-skid-roll", &no_skid_roll[2])]) {
        criterion.bench_function(&format!("12 cold, {campaign}, {model}"), |bencher| {
            let mut solver = Solver::default();
            bencher.iter(|| {
                for problem in problems {
                    solver.forget();
                    black_box(solver.solve(problem, FIT_ACCURACY).expect("the motion exists"));
                }
            });
        });
        criterion.bench_function(&format!("12 warm, {campaign}, {model}"), |bencher| {
            // Each frequency from its neighbour, up and down again.
            let mut solver = Solver::default();
            let mut up = true;
            bencher.iter(|| {
                for i in 0..problems.len() {
                    let i = if up { i } else { problems.len() - 1 - i };
                    black_box(solver.solve(&problems[i], FIT_ACCURACY).expect("it exists"));
                }
                up = !up;
            });
        });
        criterion.bench_function(&format!("12 with derivatives, {campaign}, {model}"), |bencher| {
            let mut solver = Solver::default();
            bencher.iter(|| {
                for problem in problems {
                    solver.forget();
                    solver.solve(problem, FIT_ACCURACY).expect("the motion exists");
                    black_box(solver.derivatives().expect("and has derivatives"));
                }
            });
        });
    }
}

criterion_group!(benches, steady_motions);
criterion_main!(benches);
