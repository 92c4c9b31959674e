//! Property tests of the symmetries and of the balances of energy and momentum of viscous friction and of no skid, with
//! random robots and gaits.

use std::f64::consts::{PI, TAU};

use proptest::prelude::*;
use trilink_mechanics::{
    Attractor, FORCES_ACCURACY, Laws, Problem, REFERENCE_ACCURACY, Sample, Solver, SteadyMotion,
};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Gait, JointCommand, Robot};

use crate::three_links;

/// Friction laws with distinct equations of motion; models with the same laws differ only in the gait or the
/// damping.
const ALL_LAWS: [Laws; 4] = [Laws::SKID, Laws::SKID_ROLL, Laws::NO_SKID, Laws::NO_SKID_ROLL];

fn robots() -> impl Strategy<Value = Robot> {
    let sizes = (0.05..0.3, 0.05..0.3, 0.2..0.9, 0.3..3.0, 0.05..0.5, 0.05..0.5);
    let losses = ([0.1..2.0, 0.1..2.0, 0.1..2.0], [5.0..500.0, 5.0..500.0, 5.0..500.0]);
    let joint = (0.05..0.5, 0.004..0.05);
    (sizes, losses, joint).prop_map(|((h, l, b, m0, m1, m2), (roll, skid), (k, c))| Robot {
        h_m: [h, 1.2 * h],
        l_m: [l, 0.8 * l],
        b_m: [b * l, 0.5 * b * l],
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
        .prop_map(|(robot, gait, laws, omega_rad_s)| Problem::new(robot, gait, laws, omega_rad_s))
}

/// Returns whether perturbations of the motion decay by more than this factor per cycle: whether the modulus of its
/// largest Floquet multiplier is below `by`. True for a motion without dynamic states.
fn forgets(motion: &SteadyMotion, by: f64) -> bool {
    motion.floquet.is_none_or(|modulus| modulus < by)
}

/// Numbers of samples per cycle for finite differences of eighth order, in the order in which they are tried: the
/// velocities of a robot that cannot skid change within a fraction of a degree of phase near a singular shape.
const SAMPLES: [usize; 4] = [720, 2880, 11520, 46080];
/// Largest difference between finite differences of eighth and sixth order, relative to the largest rate of change, at
/// which those of eighth order count as resolved.
const RESOLVED: f64 = 1e-6;

/// Number of steps in which the commands of a motion that is followed are shifted.
const SHIFTS: u32 = 32;

/// Returns a sample of the motion after the motion is translated and rotated as a whole.
fn in_the_world(sample: &Sample, (x, y, angle): (f64, f64, f64)) -> Sample {
    let (sin, cos) = angle.sin_cos();
    let turn = |x: f64, y: f64| (cos * x - sin * y, sin * x + cos * y);
    let mut moved = sample.clone();
    let at = turn(sample.pose.x_m, sample.pose.y_m);
    (moved.pose.x_m, moved.pose.y_m) = (x + at.0, y + at.1);
    moved.pose.theta_rad += angle;
    (moved.pose_rates[0], moved.pose_rates[1]) = turn(sample.pose_rates[0], sample.pose_rates[1]);
    moved
}

/// Returns the largest difference between the rate of change of the robot's momentum (linear, and angular about the
/// origin) and the forces and moments on the wheels, relative to the largest force or moment; `None` if the samples do
/// not resolve the rate of change. The computation uses only the Newton-Euler equations and the kinematics of the links
/// (eq. 1 of the paper) in the world frame.
fn momentum_residual(robot: &Robot, samples: &[Sample]) -> Option<f64> {
    let mut momenta = Vec::new();
    let mut supplied = Vec::new();
    for sample in samples {
        let theta = sample.pose.theta_rad;
        let [dx, dy, turning] = sample.pose_rates;
        let [w1, w2] = [sample.phi_rate_rad_s[0], sample.phi_rate_rad_s[1]];
        let links = [
            (theta, turning, 0.0, 0.0),
            (theta - sample.phi_rad[0], turning - w1, robot.h_m[0], 1.0),
            (theta + sample.phi_rad[1], turning + w2, -robot.h_m[1], -1.0),
        ];
        let mut momentum = [0.0; 3];
        let mut force = [0.0; 3];
        for (i, (angle, spin, joint, side)) in links.into_iter().enumerate() {
            // Position and velocity of a point at a distance along the link from its joint.
            let point = |along: f64| {
                let along = side * along;
                [
                    sample.pose.x_m + joint * theta.cos() + along * angle.cos(),
                    sample.pose.y_m + joint * theta.sin() + along * angle.sin(),
                    dx - joint * turning * theta.sin() - along * spin * angle.sin(),
                    dy + joint * turning * theta.cos() + along * spin * angle.cos(),
                ]
            };
            let b = robot.b_m[i.saturating_sub(1)];
            let l = robot.l_m[i.saturating_sub(1)];
            let [x, y, vx, vy] = point(b);
            let mass = robot.mass_kg[i];
            let about = mass * (x * vy - y * vx) + robot.inertia_kg_m2[i] * spin;
            let own = [mass * vx, mass * vy, about];
            let [x, y, ..] = point(l);
            let roll = sample.roll_n[i];
            let lateral = sample.lateral_n[i];
            let fx = roll * angle.cos() - lateral * angle.sin();
            let fy = roll * angle.sin() + lateral * angle.cos();
            for k in 0..3 {
                momentum[k] += own[k];
                force[k] += [fx, fy, x * fy - y * fx][k];
            }
        }
        assert!(momentum.iter().all(|part| part.is_finite()), "{momentum:?}");
        momenta.push(momentum);
        supplied.push(force);
    }
    let step_s = samples[1].time_s - samples[0].time_s;
    let eighth = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];
    let sixth = [3.0 / 4.0, -3.0 / 20.0, 1.0 / 60.0, 0.0];
    let mut missed = [0.0_f64; 3];
    let mut unresolved = [0.0_f64; 3];
    let mut largest = [0.0_f64; 3];
    for i in 4..samples.len() - 4 {
        for k in 0..3 {
            let [rate, rougher] = [eighth, sixth].map(|weights: [f64; 4]| -> f64 {
                let step = |n: usize| (momenta[i + n][k] - momenta[i - n][k]) / step_s;
                (1..=4).map(|n| weights[n - 1] * step(n)).sum()
            });
            // NaN where the constraint forces are unbounded.
            if supplied[i][k].is_finite() {
                missed[k] = missed[k].max((rate - supplied[i][k]).abs());
                unresolved[k] = unresolved[k].max((rate - rougher).abs());
                largest[k] = largest[k].max(supplied[i][k].abs());
            }
        }
    }
    let linear = largest[0].max(largest[1]);
    let relative = |sizes: [f64; 3]| (sizes[0].max(sizes[1]) / linear).max(sizes[2] / largest[2]);
    (relative(unresolved) < RESOLVED).then(|| relative(missed))
}

/// Returns the rejection of a case without a solution, of which proptest accepts a limited number.
fn unsolved() -> TestCaseError {
    TestCaseError::reject("not solved")
}

/// Returns whether two values differ by at most 1e-7 of a size, but not less than 1e-13.
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
        let (Ok(one), Ok(other)) =
            (problem.solve(REFERENCE_ACCURACY), mirrored.solve(REFERENCE_ACCURACY))
        else {
            return Err(unsolved());
        };
        // With light damping, several motions exist, which is unlikely among strongly stable ones.
        prop_assume!(forgets(&one, 0.9) && forgets(&other, 0.9));
        let one = one.metrics;
        let other = other.metrics;
        prop_assert!(close(one.d_m, other.d_m, one.d_m), "{one:?} {other:?}");
        prop_assert!(close(one.dtheta_rad, -other.dtheta_rad, 1.0), "{one:?} {other:?}");
        for (a, b) in one.sigma.iter().zip(other.sigma).take(3) {
            prop_assert!(close(*a, b, *a), "{one:?} {other:?}");
        }
    }

    #[test]
    fn the_work_of_the_actuators_is_dissipated_by_friction(problem in problems()) {
        let mut solver = Solver::default();
        solver.solve(&problem, REFERENCE_ACCURACY).map_err(|_| unsolved())?;
        let [work_j, loss_j] = solver.work_and_loss_j().unwrap();
        let is_free = problem.laws == Laws::NO_SKID && Gait::from(problem.gait).passive_joint().is_none();
        prop_assert!((loss_j > 0.0) != is_free, "{loss_j}");
        // The actuators recover the part of their work that is not dissipated, with little resistance almost all, so
        // that rounding errors are relative to the energy exchanged.
        let exchanged_j = solver.cycle(SAMPLES[0]).unwrap().windows(2).map(|pair| {
            pair[0].power_w.abs() * (pair[1].time_s - pair[0].time_s)
        }).sum::<f64>();
        prop_assert!((work_j - loss_j).abs() < 1e-8 * exchanged_j, "{work_j} {loss_j} {exchanged_j}");
    }

    #[test]
    fn only_contact_forces_change_the_momentum(
        problem in problems(),
        place in (-5.0..5.0, -5.0..5.0, -PI..PI),
    ) {
        let mut solver = Solver::default();
        solver.solve(&problem, FORCES_ACCURACY).map_err(|_| unsolved())?;
        let missed = SAMPLES.into_iter().find_map(|count| {
            let samples = solver.cycle(count).unwrap();
            assert_eq!(samples.len(), count + 1);
            let moved: Vec<_> = samples.iter().map(|one| in_the_world(one, place)).collect();
            momentum_residual(three_links(&problem), &moved)
        });
        prop_assume!(missed.is_some());
        prop_assert!(missed.unwrap() < 1e-5, "{missed:?}");
    }

    #[test]
    fn the_start_of_the_cycle_matters_only_through_the_rotation(
        problem in problems(),
        shift in 0.0..TAU,
    ) {
        let shifted = |by: f64| {
            let mut shifted = problem.clone();
            shifted.gait.joints.iter_mut().flatten().for_each(|joint| joint.phase_rad += by);
            shifted
        };
        let (Ok(one), Ok(other)) =
            (problem.solve(REFERENCE_ACCURACY), shifted(shift).solve(REFERENCE_ACCURACY))
        else {
            return Err(unsolved());
        };
        prop_assume!(forgets(&one, 0.9) && forgets(&other, 0.9));
        let [one, other] = [one.metrics, other.metrics];
        let agrees = |other: &GaitMetrics| {
            let mut sigma = one.sigma.iter().zip(other.sigma).take(3);
            close(one.dtheta_rad, other.dtheta_rad, 1.0)
                && close(one.alpha_rad[0], other.alpha_rad[0], 1.0)
                && sigma.all(|(a, b)| close(*a, b, *a))
                && (one.dtheta_rad.abs() >= 1e-9 || close(one.d_m, other.d_m, one.d_m))
        };
        // If several stable motions exist, the first one is followed through small shifts.
        let mut solver = Solver::default();
        let steps = (0..=SHIFTS).map(|i| shift * f64::from(i) / f64::from(SHIFTS));
        let follow = || steps.map(|by| solver.solve(&shifted(by), REFERENCE_ACCURACY)).last();
        prop_assert!(
            agrees(&other) || follow().is_some_and(|last| last.is_ok_and(|last| agrees(&last))),
            "{one:?} {other:?}"
        );
    }

    #[test]
    fn the_transient_from_rest_agrees_with_the_attractor(problem in problems()) {
        let settled = Solver::default().settle(&problem, REFERENCE_ACCURACY);
        let Ok(Attractor { motion, cycles, .. }) = settled else { return Err(unsolved()) };
        prop_assume!(motion.floquet.is_some() && forgets(&motion, 0.3));
        let end = cycles + 20;
        let [d_m, _] = crate::displacements(&problem, end, 1e-9).unwrap()[end - 1];
        prop_assert!((d_m - motion.metrics.d_m).abs() < 1e-5 * motion.metrics.d_m.max(1e-3));
    }
}
