//! Benchmarks of steady-state motions: one evaluation of the equations, one Newton step, solutions from cold starts,
//! from warm starts at the neighbouring frequency and with derivatives, the cost of derivatives relative to a solution,
//! the transient from rest, and a sweep.
//!
//! Times vary with the machine; instruction counts do not:
//! `valgrind --tool=callgrind --toggle-collect='*Solver*solve*' BENCH --test NAME`, where `BENCH`
//! is the executable that `cargo bench --no-run` names.

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, criterion_group, criterion_main};
use rayon::prelude::*;
use trilink_mechanics::{
    FIT_ACCURACY, InputDerivatives, Laws, Problem, REFERENCE_ACCURACY, Solver,
};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Gait, Parameter, Robot};

/// The paper's frequencies, rad/s.
const OMEGAS_RAD_S: [f64; 12] = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 3.9, 4.5, 5.0, 5.5, 6.0];

/// Returns the steady-state problems of a sweep with one model over the paper's frequencies.
fn sweep(robot: Robot, gait: Gait, laws: Laws) -> Vec<Problem> {
    OMEGAS_RAD_S.map(|omega_rad_s| Problem::new(robot.clone(), gait, laws, omega_rad_s)).into()
}

/// Returns the paper's semi-passive robot (Table II of the paper) with the coefficients that the paper fits.
fn semi_passive() -> Robot {
    Robot {
        skid_kg_s: [420.0, 200.0, 70.0],
        stiffness_nm_rad: 0.137,
        damping_nm_s_rad: 0.006,
        ..Robot::semi_passive()
    }
}

/// Returns named sweeps of the paper's three campaigns: with the coefficients that the paper fits, and with wheels that
/// do not skid.
fn campaigns() -> [(&'static str, Vec<Problem>); 7] {
    let symmetric = Robot { skid_kg_s: [104.0, 34.0, 45.0], ..Robot::kinematic() };
    let skewed = Robot { skid_kg_s: [74.5, 91.0, 95.0], ..Robot::kinematic() };
    let passive = Gait::passive_symmetric();
    [
        (
            "kinematic-symmetric, skid-roll",
            sweep(symmetric.clone(), Gait::symmetric(), Laws::SKID_ROLL),
        ),
        ("kinematic-symmetric, no-skid", sweep(symmetric, Gait::symmetric(), Laws::NO_SKID)),
        ("kinematic-skewed, skid-roll", sweep(skewed.clone(), Gait::skewed(), Laws::SKID_ROLL)),
        ("kinematic-skewed, no-skid", sweep(skewed, Gait::skewed(), Laws::NO_SKID)),
        ("semi-passive-symmetric, skid-roll", sweep(semi_passive(), passive, Laws::SKID_ROLL)),
        (
            "semi-passive-symmetric, no-skid-roll",
            sweep(semi_passive(), passive, Laws::NO_SKID_ROLL),
        ),
        ("semi-passive-symmetric, no-skid", sweep(semi_passive(), passive, Laws::NO_SKID)),
    ]
}

/// Returns the derivatives of the last solution with respect to all parameters, the frequency and the gait.
fn derivatives(solver: &mut Solver) -> (Vec<GaitMetrics>, InputDerivatives) {
    let parameters = solver.derivatives_of(&Parameter::ALL).expect("the solution has derivatives");
    (parameters, solver.input_derivatives().expect("the solution has derivatives"))
}

/// Times whole sweeps of 12 frequencies: with cold starts, with warm starts, with derivatives, and from rest.
fn steady_motions(criterion: &mut Criterion) {
    for (name, problems) in &campaigns() {
        criterion.bench_function(&format!("12 cold, {name}"), |bencher| {
            let mut solver = Solver::default();
            bencher.iter(|| {
                for problem in problems {
                    solver.forget();
                    black_box(solver.solve(problem, FIT_ACCURACY).expect("the motion exists"));
                }
            });
        });
        criterion.bench_function(&format!("12 warm, {name}"), |bencher| {
            // Warm-start each frequency from its neighbour, upwards and downwards.
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
        criterion.bench_function(&format!("12 with derivatives, {name}"), |bencher| {
            let mut solver = Solver::default();
            bencher.iter(|| {
                for problem in problems {
                    solver.forget();
                    solver.solve(problem, FIT_ACCURACY).expect("the motion exists");
                    black_box(derivatives(&mut solver));
                }
            });
        });
        criterion.bench_function(&format!("12 from rest, {name}"), |bencher| {
            let mut solver = Solver::default();
            bencher.iter(|| {
                for problem in problems {
                    solver.forget();
                    black_box(solver.settle(problem, REFERENCE_ACCURACY).expect("it settles"));
                }
            });
        });
    }
}

/// Times solutions without and with all derivatives alternately. Takes the minimum over many sweeps of each, so that a
/// busy machine affects both alike.
fn derivatives_beside_solutions(_: &mut Criterion) {
    const SWEEPS: usize = 300;
    for (name, problems) in &campaigns() {
        let mut solver = Solver::default();
        let mut sweep = |with_derivatives: bool| {
            let start = Instant::now();
            for problem in problems {
                solver.forget();
                black_box(solver.solve(problem, FIT_ACCURACY).expect("the motion exists"));
                if with_derivatives {
                    black_box(derivatives(&mut solver));
                }
            }
            start.elapsed().as_secs_f64() * 1e6 / problems.len() as f64
        };
        let mut best = [f64::INFINITY; 2];
        for _ in 0..SWEEPS {
            best = [best[0].min(sweep(false)), best[1].min(sweep(true))];
        }
        let [cold, whole] = best;
        println!("{name}: {cold:.1} us, with derivatives {whole:.1} us ({:.2})", whole / cold);
    }
}

fn parts_of_a_solution(criterion: &mut Criterion) {
    for (name, problems) in &campaigns() {
        criterion.bench_function(&format!("Newton step, {name}"), |bencher| {
            let mut solver = Solver::default();
            solver.solve(&problems[7], FIT_ACCURACY).expect("the motion exists");
            bencher.iter(|| solver.polish().expect("the step exists"));
        });
    }
}

/// Times sweeps of 200 frequencies, each warm-started from its neighbour.
fn sweeps(criterion: &mut Criterion) {
    const RUN: usize = 25;
    let problems: Vec<Problem> = (0..200)
        .map(|i| {
            let omega_rad_s = 0.5 + 5.5 * f64::from(i) / 199.0;
            let gait = Gait::passive_symmetric();
            Problem::new(semi_passive(), gait, Laws::SKID_ROLL, omega_rad_s)
        })
        .collect();
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.expect("threads can be started");
        let name = format!("sweep of 200, semi-passive-symmetric, skid-roll, {threads} threads");
        criterion.bench_function(&name, |bencher| {
            bencher.iter(|| {
                pool.install(|| {
                    problems.par_chunks(RUN).for_each(|run| {
                        let mut solver = Solver::default();
                        for problem in run {
                            black_box(solver.solve(problem, FIT_ACCURACY).expect("it exists"));
                        }
                    });
                });
            });
        });
    }
}

criterion_group!(
    benches,
    derivatives_beside_solutions,
    parts_of_a_solution,
    steady_motions,
    sweeps
);
criterion_main!(benches);
