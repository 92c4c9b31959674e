//! Tests of a user-defined friction law through the public interface alone.

use trilink_mechanics::{Laws, Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Dry, Gait, Quantity, Robot, RollLaw};

use crate::Derivatives;

#[allow(dead_code)]
#[path = "../../examples/own_friction.rs"]
mod example;
use example::Algebraic;

fn problem(gait: Gait, transition_m_s: f64) -> Problem {
    let robot =
        if gait.passive_joint().is_some() { Robot::semi_passive() } else { Robot::kinematic() };
    let robot = Robot { skid_dry_n: [0.5, 0.3, 0.3], transition_m_s, ..robot };
    let laws = Laws { roll: RollLaw::None, ..Laws::COULOMB };
    Problem::new(robot, gait, laws, 3.9)
}

fn solve(problem: &Problem) -> GaitMetrics {
    Solver::with_friction::<Algebraic>().solve(problem, REFERENCE_ACCURACY).unwrap()
}

#[test]
fn a_built_in_law_gives_the_same_motion_as_a_user_defined_one() {
    let problem = problem(Gait::symmetric(), 0.005);
    let known = Solver::default().solve(&problem, REFERENCE_ACCURACY).unwrap();
    let found = Solver::with_friction::<Dry>().solve(&problem, REFERENCE_ACCURACY).unwrap();
    assert_eq!(found, known);
}

#[test]
fn two_regularisations_have_the_same_sharp_limit() {
    for gait in [Gait::symmetric(), Gait::skewed(), Gait::passive_symmetric()] {
        let [wide, narrow] = [0.0005, 0.00005].map(|transition_m_s| {
            let problem = problem(gait, transition_m_s);
            let tanh = Solver::default().solve(&problem, REFERENCE_ACCURACY).unwrap();
            (solve(&problem).d_m / tanh.d_m - 1.0).abs()
        });
        assert!(wide > 1e-4, "{wide}");
        assert!(narrow < 0.4 * wide, "{narrow}, {wide}");
    }
}

#[test]
fn the_work_is_dissipated_and_derivatives_agree_with_differences() {
    let problem = problem(Gait::passive_symmetric(), 0.004);
    let mut solver = Solver::with_friction::<Algebraic>();
    solver.solve(&problem, REFERENCE_ACCURACY).unwrap();
    let [work_j, loss_j] = solver.work_and_loss_j().unwrap();
    assert!((work_j / loss_j - 1.0).abs() < 1e-8, "{work_j} {loss_j}");
    let derivatives = Derivatives::of(&mut solver, &problem).unwrap();
    let slope = |changed: &dyn Fn(f64) -> Problem| {
        let [high, low] = [1e-5, -1e-5].map(|part| solve(&changed(1.0 + part)).d_m);
        (high - low) / 2e-5
    };
    for parameter in [Quantity::SkidDry.parameter(1), Quantity::Transition.one()] {
        let value = problem.robot.value(parameter);
        let known = slope(&|factor| {
            let mut problem = problem.clone();
            problem.robot.set(parameter, factor * value);
            problem
        });
        let found = derivatives.parameters[parameter].metrics.d_m * value;
        assert!((found / known - 1.0).abs() < 1e-4, "{parameter}: {found} {known}");
    }
    let omega_rad_s = problem.omega_rad_s;
    let known = slope(&|factor| Problem { omega_rad_s: factor * omega_rad_s, ..problem.clone() });
    let found = derivatives.omega.metrics.d_m * omega_rad_s;
    assert!((found / known - 1.0).abs() < 1e-4, "omega: {found} {known}");
}
