//! Snapshot of the computational effort of solutions; the test fails if the solver needs more steps for the
//! same result. After an intended change, `INSTA_UPDATE=always cargo test -p trilink-mechanics --test it
//! effort::` writes the new numbers.

use std::fmt::Write as _;
use std::hint::black_box;
use std::time::Instant;

use trilink_mechanics::{Effort, FIT_ACCURACY, Laws, Model, MotionError, Problem, Solver};
use trilink_robot::{Gait, Robot};

use crate::Derivatives;

/// Actuation frequencies of the paper, rad/s.
const OMEGAS_RAD_S: [f64; 13] = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 3.9, 4.0, 4.5, 5.0, 5.5, 6.0];

/// Solves the problem at every frequency and formats the effort: one line for each kind of work, such as
/// Newton steps, with one count per frequency. If `is_warm`, each solution starts from the preceding one.
fn efforts(problem: impl Fn(f64) -> Problem, is_warm: bool) -> Result<String, MotionError> {
    let mut solver = Solver::default();
    let mut efforts = Vec::new();
    for omega_rad_s in OMEGAS_RAD_S {
        if !is_warm {
            solver.forget();
        }
        solver.solve(&problem(omega_rad_s), FIT_ACCURACY)?;
        efforts.push(solver.effort());
    }
    let line = |name: &str, count: fn(&Effort) -> usize| {
        let numbers: String =
            efforts.iter().map(|effort| format!(" {:3}", count(effort))).collect();
        if efforts.iter().all(|effort| count(effort) == 0) {
            String::new()
        } else {
            format!("\n  {name:15}{numbers}")
        }
    };
    Ok([
        line("Newton steps", |effort| effort.newton_steps),
        line("factorisations", |effort| effort.factorisations),
        line("linear solves", |effort| effort.linear_solves),
        line("elements", |effort| effort.elements),
    ]
    .concat())
}

#[test]
fn the_effort_of_every_model_is_unchanged() {
    let mut text = String::new();
    let robots = [("kinematic", Robot::kinematic()), ("semi-passive", Robot::semi_passive())];
    let gaits = [
        ("symmetric", Gait::symmetric()),
        ("skewed", Gait::skewed()),
        ("passive-symmetric", Gait::passive_symmetric()),
    ];
    for (robot_name, robot) in &robots {
        for (gait_name, gait) in gaits {
            for model in Model::PAPER {
                let laws = crate::laws(model.name());
                for (start, is_warm) in [("cold", false), ("warm", true)] {
                    let problem =
                        |omega_rad_s| Problem::new(robot.clone(), gait, laws, omega_rad_s);
                    let efforts =
                        efforts(problem, is_warm).unwrap_or_else(|error| format!(" {error}"));
                    writeln!(text, "{robot_name} {gait_name} {model}, {start}:{efforts}")
                        .expect("memory");
                }
            }
        }
    }
    insta::assert_snapshot!(text);
}

/// Returns the time that a cold-started solution takes without derivatives and with all derivatives, in
/// microseconds: the mean over the paper's frequencies in the fastest of many sweeps.
fn times_us(robot: &Robot, gait: Gait, laws: Laws) -> [f64; 2] {
    let mut solver = Solver::default();
    let mut sweep = |with_derivatives: bool| {
        let start = Instant::now();
        for omega_rad_s in OMEGAS_RAD_S {
            solver.forget();
            let problem = Problem::new(robot.clone(), gait, laws, omega_rad_s);
            solver.solve(&problem, FIT_ACCURACY).expect("the motion exists");
            if with_derivatives {
                black_box(Derivatives::of(&mut solver, &problem).expect("and has derivatives"));
            }
        }
        start.elapsed().as_secs_f64() * 1e6 / OMEGAS_RAD_S.len() as f64
    };
    (0..300)
        .fold([f64::INFINITY; 2], |best, _| [best[0].min(sweep(false)), best[1].min(sweep(true))])
}

#[test]
#[ignore = "a timing; alone and with --release: cargo test --release -p trilink-mechanics --test it effort:: -- --ignored"]
fn a_solution_takes_no_longer_than_its_bound_and_derivatives_little_more() {
    let skewed = Robot { skid_kg_s: [74.5, 91.0, 95.0], ..Robot::kinematic() };
    let passive = Robot { stiffness_nm_rad: 0.137, ..Robot::semi_passive() };
    let cases = [
        (Robot::kinematic(), Gait::symmetric(), Laws::SKID_ROLL, 18.0),
        (skewed, Gait::skewed(), Laws::SKID_ROLL, 20.0),
        (passive.clone(), Gait::passive_symmetric(), Laws::SKID_ROLL, 90.0),
        (passive.clone(), Gait::passive_symmetric(), Laws::NO_SKID_ROLL, 30.0),
        (passive, Gait::passive_symmetric(), Laws::NO_SKID, 30.0),
        (Robot::kinematic(), Gait::symmetric(), Laws::NO_SKID, 30.0),
        (Robot::kinematic(), Gait::symmetric(), Laws::COULOMB, 500.0),
        (Robot::kinematic(), Gait::skewed(), Laws::COULOMB, 500.0),
        (Robot::semi_passive(), Gait::passive_symmetric(), Laws::COULOMB, 1500.0),
    ];
    for (robot, gait, laws, bound_us) in cases {
        let [cold_us, whole_us] = times_us(&robot, gait, laws);
        println!("{laws:?}: {cold_us:.1} us, with derivatives {whole_us:.1} us");
        assert!(cold_us < bound_us, "{laws:?}: {cold_us:.1} us instead of {bound_us}");
        let whole_bound_us = 1.6 * bound_us;
        assert!(
            whole_us < whole_bound_us,
            "{laws:?} with derivatives: {whole_us:.1} us instead of {whole_bound_us}"
        );
    }
}
