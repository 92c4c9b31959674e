//! Symmetries that every model's motion must have, over random robots and gaits.

#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;

use proptest::prelude::*;
use trilink::motion::{Model, Problem, REFERENCE_ACCURACY, Solver};
use trilink::robot::{Gait, JointCommand, Robot};

const DYNAMIC: [Model; 3] = [Model::Skid, Model::SkidRoll, Model::NoSkidRoll];

fn robots() -> impl Strategy<Value = Robot> {
    let sizes = (0.05..0.3, 0.05..0.3, 0.2..0.9, 0.3..3.0, 0.05..0.5, 0.05..0.5);
    let losses = ([0.1..2.0, 0.1..2.0, 0.1..2.0], [5.0..500.0, 5.0..500.0, 5.0..500.0]);
    let joint = (0.05..0.5, 0.004..0.05);
    (sizes, losses, joint).prop_map(|((h, l, b, m0, m1, m2), (roll, skid), (k, c))| Robot {
        h_m: h,
        l_m: l,
        b_m: b * l,
        mass_kg: [m0, m1, m2],
        inertia_kg_m2: [m0 * h * h / 3.0, m1 * l * l / 6.0, m2 * l * l / 6.0],
        roll_kg_s: roll,
        skid_kg_s: skid,
        stiffness_nm_rad: k,
        damping_nm_s_rad: c,
        rest_angle_rad: 0.0,
    })
}

fn joints() -> impl Strategy<Value = JointCommand> {
    (-0.6..0.6, 0.1..0.6, -PI..PI).prop_map(|(offset_rad, amplitude_rad, phase_rad)| JointCommand {
        offset_rad,
        amplitude_rad,
        phase_rad,
    })
}

fn problems() -> impl Strategy<Value = Problem> {
    let gaits = (joints(), joints(), 0..3_usize).prop_map(|(joint1, joint2, passive)| Gait {
        joints: [(passive != 1).then_some(joint1), (passive != 2).then_some(joint2)],
    });
    (robots(), gaits, prop::sample::select(&DYNAMIC[..]), 0.5..6.0)
        .prop_map(|(robot, gait, model, omega_rad_s)| Problem { robot, gait, model, omega_rad_s })
        .prop_filter("eq. 3 is tested by its own numbers", |problem| {
            problem.model.skids() || problem.gait.passive_joint().is_some()
        })
}

fn close(a: f64, b: f64, size: f64) -> bool {
    (a - b).abs() <= 1e-7 * size.abs().max(1e-6)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..Default::default() })]

    #[test]
    fn the_mirrored_gait_gives_the_mirrored_motion(problem in problems()) {
        let mut mirrored = problem.clone();
        for joint in mirrored.gait.joints.iter_mut().flatten() {
            joint.offset_rad = -joint.offset_rad;
            joint.phase_rad += PI;
        }
        if let (Ok(one), Ok(other)) =
            (problem.solve(REFERENCE_ACCURACY), mirrored.solve(REFERENCE_ACCURACY))
        {
            // Light damping allows several motions; only stable ones are compared.
            prop_assume!(one.floquet.unwrap() < 0.9 && other.floquet.unwrap() < 0.9);
            let (one, other) = (one.metrics, other.metrics);
            prop_assert!(close(one.d_m, other.d_m, one.d_m), "{one:?} {other:?}");
            prop_assert!(close(one.dtheta_rad, -other.dtheta_rad, 1.0), "{one:?} {other:?}");
            for (a, b) in one.sigma.iter().zip(other.sigma) {
                prop_assert!(close(*a, b, *a), "{one:?} {other:?}");
            }
        }
    }

    #[test]
    fn the_actuators_work_is_what_friction_takes(problem in problems()) {
        let mut solver = Solver::default();
        if solver.solve(&problem, REFERENCE_ACCURACY).is_ok() {
            let [work_j, loss_j] = solver.work_and_loss_j().unwrap();
            prop_assert!(loss_j > 0.0);
            prop_assert!((work_j - loss_j).abs() < 1e-8 * loss_j, "{work_j} {loss_j}");
        }
    }

    #[test]
    fn where_the_cycle_starts_matters_through_the_rotation_only(
        problem in problems(),
        shift in 0.0..6.0,
    ) {
        let mut shifted = problem.clone();
        shifted.gait.joints.iter_mut().flatten().for_each(|joint| joint.phase_rad += shift);
        if let (Ok(one), Ok(other)) =
            (problem.solve(REFERENCE_ACCURACY), shifted.solve(REFERENCE_ACCURACY))
        {
            prop_assume!(one.floquet.unwrap() < 0.9 && other.floquet.unwrap() < 0.9);
            let (one, other) = (one.metrics, other.metrics);
            prop_assert!(close(one.dtheta_rad, other.dtheta_rad, 1.0), "{one:?} {other:?}");
            prop_assert!(close(one.alpha1_rad, other.alpha1_rad, 1.0), "{one:?} {other:?}");
            for (a, b) in one.sigma.iter().zip(other.sigma) {
                prop_assert!(close(*a, b, *a), "{one:?} {other:?}");
            }
            if one.dtheta_rad.abs() < 1e-9 {
                prop_assert!(close(one.d_m, other.d_m, one.d_m), "{one:?} {other:?}");
            }
        }
    }

    #[test]
    fn the_steady_motion_is_where_the_robot_settles(problem in problems()) {
        let Ok(steady) = problem.solve(REFERENCE_ACCURACY) else { return Ok(()) };
        prop_assume!(steady.floquet.unwrap() < 0.3);
        let period_s = 2.0 * PI / problem.omega_rad_s;
        let path = problem.follow(21.0 * period_s, 1e-9).unwrap();
        let [from, to] = [20.0, 21.0].map(|cycles| path.at(cycles * period_s));
        let d_m = (to[0] - from[0]).hypot(to[1] - from[1]);
        prop_assert!((d_m - steady.metrics.d_m).abs() < 1e-5 * steady.metrics.d_m.max(1e-3));
    }
}
