//! Tests of the attractor reached from rest.

use trilink_mechanics::{
    Attractor, Laws, MotionError, MotionStatus, Problem, REFERENCE_ACCURACY, Solver,
};
use trilink_robot::{Gait, JointCommand, Quantity, Robot};

use crate::Derivatives;
use crate::draws::Draw;

fn settle(problem: &Problem) -> Result<Attractor, MotionError> {
    Solver::default().settle(problem, REFERENCE_ACCURACY)
}

/// Returns the displacement d in the last of the first `cycles` cycles from rest, m.
fn followed_d_m(problem: &Problem, cycles: usize) -> f64 {
    crate::displacements(problem, cycles, 1e-9).unwrap()[cycles - 1][0]
}

/// Returns a problem with a lightly damped passive front joint under a gait with a large offset and
/// amplitude.
fn on_bent_joints(
    [stiffness_nm_rad, damping_nm_s_rad]: [f64; 2],
    [offset_rad, amplitude_rad]: [f64; 2],
    omega_rad_s: f64,
) -> Problem {
    let command = JointCommand::new(offset_rad, amplitude_rad, 0.0);
    let robot = Robot { stiffness_nm_rad, damping_nm_s_rad, ..Robot::semi_passive() };
    let gait = Gait { joints: [None, Some(command)] };
    Problem::new(robot, gait, Laws::NO_SKID, omega_rad_s)
}

fn with_two_stable_motions() -> Problem {
    Draw::new(2, 1073).problem()
}

fn with_an_unstable_motion() -> Problem {
    on_bent_joints([0.629, 0.0018], [1.089, 0.823], 5.2)
}

#[test]
fn the_papers_robots_reach_the_solution_of_the_solver() {
    let robots =
        [(Robot::kinematic(), Gait::skewed()), (Robot::semi_passive(), Gait::passive_symmetric())];
    for (robot, gait) in robots {
        for omega_rad_s in [0.5, 3.9, 6.0] {
            let problem = Problem::new(robot.clone(), gait, Laws::SKID_ROLL, omega_rad_s);
            let settled = settle(&problem).unwrap();
            assert!(settled.is_found_by_solve && (1..=5).contains(&settled.cycles), "{settled:?}");
            let d_m = settled.motion.metrics.d_m;
            let first_m = problem.solve(REFERENCE_ACCURACY).unwrap().metrics.d_m;
            assert!((d_m - first_m).abs() < 1e-9 * first_m, "{d_m} {first_m}");
        }
    }
}

#[test]
fn without_roll_resistance_the_semi_passive_robot_takes_many_cycles() {
    let problem =
        Problem::new(Robot::semi_passive(), Gait::passive_symmetric(), Laws::NO_SKID, 4.0);
    let settled = settle(&problem).unwrap();
    assert!(settled.is_found_by_solve && (10..100).contains(&settled.cycles), "{settled:?}");
    // After the reported number of cycles, the distance from the attractor is as stated.
    let d_m = settled.motion.metrics.d_m;
    let [then, earlier] =
        [settled.cycles + 1, settled.cycles / 2].map(|cycles| followed_d_m(&problem, cycles));
    assert!((then - d_m).abs() < 0.02 * d_m, "{then} {d_m}");
    assert!((earlier - d_m).abs() > 0.02 * d_m, "{earlier} {d_m}");
}

#[test]
fn of_two_stable_motions_the_one_reached_from_rest_is_reported() {
    let problem = with_two_stable_motions();
    let first = problem.solve(REFERENCE_ACCURACY).unwrap();
    let settled = settle(&problem).unwrap();
    assert_eq!(
        (first.status(), settled.motion.status()),
        (MotionStatus::Stable, MotionStatus::Stable)
    );
    let first_m = first.metrics.d_m;
    let settled_m = settled.motion.metrics.d_m;
    assert!(!settled.is_found_by_solve && settled_m > 2.0 * first_m, "{first_m} {settled_m}");
    let followed_m = followed_d_m(&problem, settled.cycles + 30);
    assert!((followed_m - settled_m).abs() < 1e-4 * settled_m, "{followed_m} {settled_m}");
}

#[test]
fn the_robot_never_settles_in_an_unstable_motion() {
    let problem = with_an_unstable_motion();
    let first = problem.solve(REFERENCE_ACCURACY).unwrap();
    assert_eq!(first.status(), MotionStatus::Unstable);
    let settled = settle(&problem).unwrap();
    assert!(
        !settled.is_found_by_solve && settled.motion.status() == MotionStatus::Stable,
        "{settled:?}"
    );
    assert!(settled.motion.metrics.d_m > 100.0 * first.metrics.d_m);
}

#[test]
fn a_motion_that_does_not_settle_is_reported() {
    let robot = Robot { damping_nm_s_rad: 0.001, ..Robot::semi_passive() };
    let problem = Problem::new(robot, Gait::passive_symmetric(), Laws::NO_SKID, 0.2);
    let error = settle(&problem).unwrap_err();
    assert!(matches!(error, MotionError::Unsettled { cycles: 500, .. }), "{error}");
    assert_eq!(error.status(), MotionStatus::Diverged);
}

/// Returns the semi-passive robot of the paper's simulations with very little damping, above the frequency at
/// which the symmetric motion becomes unstable.
fn with_broken_symmetry() -> Problem {
    let robot = Robot { damping_nm_s_rad: 0.0005, ..Robot::semi_passive() };
    Problem::new(robot, Gait::passive_symmetric(), Laws::SKID_ROLL, 11.5)
}

#[test]
fn a_motion_without_half_period_symmetry_is_found() {
    let problem = with_broken_symmetry();
    let mut solver = Solver::default();
    let metrics = solver.solve(&problem, REFERENCE_ACCURACY).unwrap();
    assert_eq!(solver.status(), Ok(MotionStatus::SymmetryBroken));
    // Reference values from an independent integration from rest.
    assert!((metrics.d_m - 17.32122e-3).abs() < 1e-8, "{metrics:?}");
    assert!((metrics.dtheta_rad.abs() - 0.00206734).abs() < 1e-8, "{metrics:?}");
    let [work_j, loss_j] = solver.work_and_loss_j().unwrap();
    assert!((work_j - loss_j).abs() < 1e-8 * work_j, "{work_j} {loss_j}");
    // The sampled cycle ends with the reported metrics.
    let cycle = solver.cycle(48).unwrap();
    let end = cycle.last().unwrap().pose;
    assert!((end.x_m.hypot(end.y_m) - metrics.d_m).abs() < 1e-9, "{end:?}");
    assert!((end.theta_rad - metrics.dtheta_rad).abs() < 1e-9, "{end:?}");
    let settled = settle(&problem).unwrap();
    assert!(settled.is_found_by_solve && (10..30).contains(&settled.cycles), "{settled:?}");
    assert_eq!(settled.motion.metrics.d_m, metrics.d_m);
    let followed_m = followed_d_m(&problem, 800);
    assert!((followed_m - metrics.d_m).abs() < 1e-7, "{followed_m} {metrics:?}");
}

#[test]
fn the_opposite_phase_gives_the_mirror_image_of_a_motion_without_symmetry() {
    let problem = with_broken_symmetry();
    let mut opposite = problem.clone();
    opposite.gait.joints[1].as_mut().unwrap().phase_rad += std::f64::consts::PI;
    let [one, other] =
        [problem, opposite].map(|problem| problem.solve(REFERENCE_ACCURACY).unwrap().metrics);
    assert!((one.d_m - other.d_m).abs() < 1e-10, "{one:?} {other:?}");
    assert!((one.dtheta_rad + other.dtheta_rad).abs() < 1e-10, "{one:?} {other:?}");
}

#[test]
fn derivatives_of_a_motion_without_symmetry_agree_with_differences() {
    let mut problem = with_broken_symmetry();
    let mut solver = Solver::default();
    solver.solve(&problem, REFERENCE_ACCURACY).unwrap();
    let derivatives = Derivatives::of(&mut solver, &problem).unwrap();
    let mut differences = |set: &dyn Fn(&mut Problem, f64), step: f64| {
        let mut at = |by: f64| {
            let mut problem = problem.clone();
            set(&mut problem, by);
            // A warm start stays on the same motion of the pair.
            let metrics = solver.solve(&problem, 1e-12).unwrap();
            assert_eq!(solver.status(), Ok(MotionStatus::SymmetryBroken));
            metrics.to_array()
        };
        let above = at(step);
        let below = at(-step);
        std::array::from_fn::<f64, 7, _>(|i| (above[i] - below[i]) / (2.0 * step))
    };
    let same = |name: &str, known: [f64; 7], found: [f64; 7]| {
        for i in 0..7 {
            let size = found[i].abs().max(1e-3 * found.iter().fold(0.0_f64, |m, x| m.max(x.abs())));
            assert!((known[i] - found[i]).abs() < 1e-4 * size, "{name} {i}: {known:?} {found:?}");
        }
    };
    let omega = differences(&|problem, by| problem.omega_rad_s += by, 1e-4);
    same("omega", derivatives.omega.metrics.to_array(), omega);
    for parameter in [
        Quantity::Damping.one(),
        Quantity::Stiffness.one(),
        Quantity::Skid.parameter(1),
        Quantity::Roll.parameter(0),
    ] {
        let value = problem.robot.value(parameter);
        let set = |problem: &mut Problem, by: f64| problem.robot.set(parameter, value + by);
        let found = differences(&set, 1e-5 * value);
        same(parameter.name(), derivatives.parameters[parameter].metrics.to_array(), found);
    }
    problem.omega_rad_s = 9.0;
    // Where the symmetric motion is stable again, a warm-started solver returns to it.
    let metrics = solver.solve(&problem, REFERENCE_ACCURACY).unwrap();
    assert_eq!((solver.status(), metrics.dtheta_rad), (Ok(MotionStatus::Stable), 0.0));
}

#[test]
fn the_solver_continues_from_the_attractor() {
    let problem = with_two_stable_motions();
    let mut solver = Solver::default();
    let settled = solver.settle(&problem, REFERENCE_ACCURACY).unwrap();
    let near = Problem { omega_rad_s: 1.001 * problem.omega_rad_s, ..problem };
    let next = solver.solve(&near, REFERENCE_ACCURACY).unwrap();
    let settled_m = settled.motion.metrics.d_m;
    assert!((next.d_m - settled_m).abs() < 0.05 * settled_m, "{next:?} {settled:?}");
}

#[test]
fn a_motion_that_repeats_every_second_cycle_is_reported() {
    let offset = JointCommand::new(0.8137, 0.2838, 2.662);
    let robot = Robot {
        h_m: [0.1695; 2],
        l_m: [0.1551; 2],
        b_m: [0.02867; 2],
        mass_kg: [2.93, 0.196, 0.2922],
        inertia_kg_m2: [351e-4, 6e-4, 22.9e-4],
        roll_kg_s: [0.0; 3],
        skid_kg_s: [0.0; 3],
        stiffness_nm_rad: 0.4998,
        damping_nm_s_rad: 0.0643,
        rest_angle_rad: -0.1661,
        ..Robot::semi_passive()
    };
    let gait = Gait { joints: [Some(offset), None] };
    let problem = Problem::new(robot, gait, Laws::NO_SKID, 3.5473);
    // The motion that repeats itself every cycle is unstable.
    assert_eq!(problem.solve(REFERENCE_ACCURACY).unwrap().status(), MotionStatus::Unstable);
    let error = settle(&problem).unwrap_err();
    assert_eq!(error, MotionError::Unsettled { cycles: 500, repeats_after: Some(2) });
    assert!(error.to_string().ends_with("it repeats itself every 2 cycles"), "{error}");
}
