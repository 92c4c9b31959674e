//! What the solutions take is pinned beside what they are: a solver that needs more steps for the
//! same result fails here. After a wanted change, `INSTA_UPDATE=always cargo test --test effort`
//! writes the new numbers.

use std::fmt::Write as _;

use trilink::motion::{Effort, FIT_ACCURACY, Model, MotionError, Problem, Solver};
use trilink::robot::{Gait, Robot};
use trilink::synth::OMEGAS_RAD_S;

/// A line for each kind of work, with a number for each frequency.
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
    let line = |name: &str, of: fn(&Effort) -> usize| {
        let numbers: String = efforts.iter().map(|effort| format!(" {:3}", of(effort))).collect();
        if efforts.iter().all(|effort| of(effort) == 0) {
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
fn every_model_takes_the_steps_that_it_took() {
    let mut text = String::new();
    let robots = [("kinematic", Robot::kinematic()), ("semi-passive", Robot::semi_passive())];
    let gaits = [
        ("symmetric", Gait::symmetric()),
        ("skewed", Gait::skewed()),
        ("passive-symmetric", Gait::passive_symmetric()),
    ];
    for (robot_name, robot) in &robots {
        for (gait_name, gait) in gaits {
            for model in Model::ALL {
                for (start, is_warm) in [("cold", false), ("warm", true)] {
                    let problem = |omega_rad_s| {
                        let (robot, gait) = (robot.clone(), gait);
                        Problem { robot, gait, model, omega_rad_s }
                    };
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
