//! Symmetries that every model's motion must have, over random robots and gaits.

use std::f64::consts::PI;

use proptest::prelude::*;
use trilink_mechanics::{
    Attractor, FORCES_ACCURACY, Laws, Problem, REFERENCE_ACCURACY, Sample, Solver, SteadyMotion,
};
use trilink_robot::{Gait, JointCommand, Robot};

/// Every model that is an equation of motion of its own; the others are these under another
/// gait or with other damping.
const ALL_LAWS: [Laws; 4] = [Laws::SKID, Laws::SKID_ROLL, Laws::NO_SKID, Laws::NO_SKID_ROLL];

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
        ..Robot::kinematic()
    })
}

fn joints() -> impl Strategy<Value = JointCommand> {
    (-0.6..0.6, 0.1..0.6, -PI..PI).prop_map(|(offset_rad, amplitude_rad, phase_rad)| {
        JointCommand::new(offset_rad, amplitude_rad, phase_rad)
    })
}

fn problems() -> impl Strategy<Value = Problem> {
    let gaits = (joints(), joints(), 0..3_usize).prop_map(|(joint1, joint2, passive)| Gait {
        joints: [(passive != 1).then_some(joint1), (passive != 2).then_some(joint2)],
    });
    (robots(), gaits, prop::sample::select(&ALL_LAWS[..]), 0.5..6.0)
        .prop_map(|(robot, gait, laws, omega_rad_s)| Problem { robot, gait, laws, omega_rad_s })
}

/// Whether the motion has states of its own and forgets where it began.
fn forgets(motion: &SteadyMotion, by: f64) -> bool {
    motion.floquet.is_none_or(|modulus| modulus < by)
}

/// Samples of a cycle: enough for differences of eighth order.
const SAMPLES: usize = 720;

/// A sample of a motion that was moved and turned as a whole.
fn in_the_world(sample: &Sample, (x, y, angle): (f64, f64, f64)) -> Sample {
    let (sin, cos) = angle.sin_cos();
    let turn = |x: f64, y: f64| (cos * x - sin * y, sin * x + cos * y);
    let mut moved = *sample;
    let at = turn(sample.pose.x_m, sample.pose.y_m);
    (moved.pose.x_m, moved.pose.y_m) = (x + at.0, y + at.1);
    moved.pose.theta_rad += angle;
    (moved.rates[0], moved.rates[1]) = turn(sample.rates[0], sample.rates[1]);
    moved
}

/// Largest difference between the rate of the robot's momentum (linear, and angular about the
/// origin) and what the forces on the wheels supply, relative to the largest of these. By
/// Newton's laws and eq. 1 in the world's frame alone.
fn momentum_missed(robot: &Robot, samples: &[Sample]) -> f64 {
    let (h, l, b) = (robot.h_m, robot.l_m, robot.b_m);
    let mut momenta = Vec::new();
    let mut supplied = Vec::new();
    for sample in samples {
        let theta = sample.pose.theta_rad;
        let [dx, dy, turning, w1, w2] = sample.rates;
        let links = [
            (theta, turning, 0.0, 0.0),
            (theta - sample.phi_rad[0], turning - w1, h, 1.0),
            (theta + sample.phi_rad[1], turning + w2, -h, -1.0),
        ];
        let (mut momentum, mut force) = ([0.0; 3], [0.0; 3]);
        for (i, (angle, spin, joint, side)) in links.into_iter().enumerate() {
            // A point at a distance along the link from its joint: where it is, how it moves.
            let point = |along: f64| {
                let along = side * along;
                [
                    sample.pose.x_m + joint * theta.cos() + along * angle.cos(),
                    sample.pose.y_m + joint * theta.sin() + along * angle.sin(),
                    dx - joint * turning * theta.sin() - along * spin * angle.sin(),
                    dy + joint * turning * theta.cos() + along * spin * angle.cos(),
                ]
            };
            let ([x, y, vx, vy], mass) = (point(b), robot.mass_kg[i]);
            let about = mass * (x * vy - y * vx) + robot.inertia_kg_m2[i] * spin;
            let own = [mass * vx, mass * vy, about];
            let [x, y, ..] = point(l);
            let (roll, lateral) = (sample.forces.roll_n[i], sample.forces.lateral_n[i]);
            let fx = roll * angle.cos() - lateral * angle.sin();
            let fy = roll * angle.sin() + lateral * angle.cos();
            for k in 0..3 {
                momentum[k] += own[k];
                force[k] += [fx, fy, x * fy - y * fx][k];
            }
        }
        momenta.push(momentum);
        supplied.push(force);
    }
    let step_s = samples[1].time_s - samples[0].time_s;
    // Central differences of eighth and sixth order; where they differ they are not to be trusted.
    let eighth = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];
    let sixth = [3.0 / 4.0, -3.0 / 20.0, 1.0 / 60.0, 0.0];
    let (mut missed, mut largest) = ([0.0_f64; 3], [0.0_f64; 3]);
    for i in 4..samples.len() - 4 {
        for k in 0..3 {
            let [rate, rougher] = [eighth, sixth].map(|weights: [f64; 4]| -> f64 {
                let step = |n: usize| (momenta[i + n][k] - momenta[i - n][k]) / step_s;
                (1..=4).map(|n| weights[n - 1] * step(n)).sum()
            });
            // NaN where the constraint forces are unbounded.
            if supplied[i][k].is_finite() {
                let beyond = (rate - supplied[i][k]).abs() - (rate - rougher).abs();
                missed[k] = missed[k].max(beyond);
                largest[k] = largest[k].max(supplied[i][k].abs());
            }
        }
    }
    let linear = largest[0].max(largest[1]);
    (missed[0].max(missed[1]) / linear).max(missed[2] / largest[2])
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
            prop_assume!(forgets(&one, 0.9) && forgets(&other, 0.9));
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
            // Without resistance the actuators take back what they gave.
            let is_free = problem.laws == Laws::NO_SKID && problem.gait.passive_joint().is_none();
            prop_assert!((loss_j > 0.0) != is_free, "{loss_j}");
            let moved_j = problem.robot.mass_kg[0]
                * (problem.robot.l_m * problem.omega_rad_s).powi(2);
            let scale_j = if is_free { moved_j } else { loss_j };
            prop_assert!((work_j - loss_j).abs() < 1e-8 * scale_j, "{work_j} {loss_j}");
        }
    }

    #[test]
    fn the_ground_alone_changes_momentum_wherever_the_robot_is(
        problem in problems(),
        place in (-5.0..5.0, -5.0..5.0, -PI..PI),
    ) {
        let mut solver = Solver::default();
        if solver.solve(&problem, FORCES_ACCURACY).is_ok() {
            let samples = solver.cycle(SAMPLES).unwrap();
            prop_assert_eq!(samples.len(), SAMPLES + 1);
            let moved: Vec<_> = samples.iter().map(|sample| in_the_world(sample, place)).collect();
            let missed = momentum_missed(&problem.robot, &moved);
            prop_assert!(missed < 1e-5, "{missed}");
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
            prop_assume!(forgets(&one, 0.9) && forgets(&other, 0.9));
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
    fn the_robot_from_rest_does_what_settling_says(problem in problems()) {
        let settled = Solver::default().settle(&problem, REFERENCE_ACCURACY);
        let Ok(Attractor { motion, cycles, .. }) = settled else { return Ok(()) };
        prop_assume!(motion.floquet.is_some() && forgets(&motion, 0.3));
        let period_s = 2.0 * PI / problem.omega_rad_s;
        let end = cycles + 20;
        let path = problem.transient((end as f64 + 1.5) * period_s, 1.0 / period_s, 1e-9).unwrap();
        let [from, to] = [path[end - 1], path[end]];
        let d_m = (to[0] - from[0]).hypot(to[1] - from[1]);
        prop_assert!((d_m - motion.metrics.d_m).abs() < 1e-5 * motion.metrics.d_m.max(1e-3));
    }
}
