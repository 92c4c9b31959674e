//! Tests of motions under dry friction: against an independent derivation, under scaling, and in limiting
//! cases.

use trilink_mechanics::{Attractor, Laws, MotionStatus, Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::metrics::FromRest;
use trilink_robot::{Gait, Robot, RollLaw, SkidLaw};

use crate::{Derivatives, three_links};

/// Returns the semi-passive robot of Table II of the paper, but with the stiffness and damping of the reference motions
/// in `friction.csv`.
fn semi_passive() -> Robot {
    Robot { stiffness_nm_rad: 0.137, damping_nm_s_rad: 0.006, ..Robot::semi_passive() }
}

/// Returns the problems of the paper's three campaigns under dry friction.
fn campaigns() -> [Problem; 3] {
    [
        (Robot::kinematic(), Gait::symmetric()),
        (Robot::kinematic(), Gait::skewed()),
        (semi_passive(), Gait::passive_symmetric()),
    ]
    .map(|(robot, gait)| Problem::new(robot, gait, Laws::COULOMB, 3.9))
}

fn assert_near(found: f64, known: f64, relative: f64, absolute: f64, what: &str) {
    assert!((found - known).abs() <= relative * known.abs() + absolute, "{what}: {found}, {known}");
}

#[test]
fn reference_motions_agree_to_1e_6_and_are_reached_from_rest() {
    for line in include_str!("../fixtures/friction.csv").lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |i: usize| fields[i].parse().unwrap_or(0.0);
        let three = |first: usize| [number(first), number(first + 1), number(first + 2)];
        let (robot, gait) = match fields[2] {
            "symmetric" => (Robot::kinematic(), Gait::symmetric()),
            "skewed" => (Robot::kinematic(), Gait::skewed()),
            _ => (semi_passive(), Gait::passive_symmetric()),
        };
        let robot = Robot {
            skid_dry_n: three(5),
            skid_static_n: three(8),
            stribeck_m_s: number(11),
            transition_m_s: number(12),
            skid_kg_s: three(13),
            ..robot
        };
        let skid = match (fields[4], robot.skid_kg_s[0] > 0.0) {
            ("coulomb", false) => SkidLaw::Coulomb,
            ("stribeck", true) => SkidLaw::StribeckViscous,
            other => panic!("{other:?}"),
        };
        let laws = Laws { skid, ..Laws::COULOMB };
        let problem = Problem::new(robot, gait, laws, number(3));
        let mut solver = Solver::default();
        let metrics = solver.solve(&problem, REFERENCE_ACCURACY).unwrap();
        assert_near(metrics.d_m, number(16), 1e-6, 0.0, line);
        assert_near(metrics.v_m_s, number(17), 1e-6, 0.0, line);
        for wheel in 0..3 {
            assert_near(metrics.sigma[wheel], number(18 + wheel), 1e-6, 0.0, line);
        }
        if !fields[21].is_empty() {
            assert_near(metrics.alpha_rad[0], number(21), 1e-6, 0.0, line);
        }
        assert_near(metrics.dtheta_rad, number(22), 1e-6, 1e-12, line);
        let attractor = solver.attractor(&problem, Ok(metrics), REFERENCE_ACCURACY);
        assert_eq!(Attractor::from_rest(&attractor), FromRest::Reached, "{line}");
        assert_eq!(attractor.unwrap().motion.status(), MotionStatus::Stable, "{line}");
    }
}

#[test]
fn all_frequencies_of_the_reference_agree_to_1e_6() {
    let mut solver = Solver::default();
    for line in include_str!("../fixtures/friction_sweep.csv").lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |i: usize| fields[i].parse::<f64>().unwrap();
        let gait = match fields[0] {
            "kinematic-symmetric" => Gait::symmetric(),
            _ => Gait::skewed(),
        };
        let problem = Problem::new(Robot::kinematic(), gait, Laws::COULOMB, number(1));
        let metrics = solver.solve(&problem, REFERENCE_ACCURACY).unwrap();
        assert_near(metrics.d_m, number(2), 1e-6, 1e-9, line);
        assert_near(metrics.v_m_s, number(3), 1e-6, 1e-9, line);
        for wheel in 0..3 {
            assert_near(metrics.sigma[wheel], number(4 + wheel), 1e-6, 1e-9, line);
        }
        assert_near(metrics.dtheta_rad, number(7), 1e-6, 1e-9, line);
    }
}

#[test]
fn under_dry_friction_alone_the_path_does_not_depend_on_the_time_scale() {
    for problem in &campaigns()[..2] {
        let laws = Laws { skid: SkidLaw::Coulomb, roll: RollLaw::Coulomb };
        let given = Robot { roll_dry_n: [0.1, 0.05, 0.04], ..three_links(problem).clone() };
        let problem = Problem { robot: given.clone().into(), laws, ..problem.clone() };
        let known = problem.solve(1e-12).unwrap().metrics;
        for faster in [0.3, 2.5] {
            let mut robot = given.clone();
            for force in robot.skid_dry_n.iter_mut().chain(&mut robot.roll_dry_n) {
                *force *= faster * faster;
            }
            robot.transition_m_s *= faster;
            let omega_rad_s = faster * problem.omega_rad_s;
            let scaled = Problem { robot: robot.into(), omega_rad_s, ..problem.clone() };
            let found = scaled.solve(1e-12).unwrap().metrics;
            assert_near(found.d_m, known.d_m, 1e-9, 0.0, "d");
            assert_near(found.v_m_s, faster * known.v_m_s, 1e-9, 0.0, "v");
            for wheel in 0..3 {
                assert_near(found.sigma[wheel], known.sigma[wheel], 1e-9, 0.0, "sigma");
            }
        }
    }
}

#[test]
fn dry_friction_below_the_transition_speed_is_viscous() {
    const TRANSITION_M_S: f64 = 1e4;
    for problem in campaigns() {
        let viscous = Problem { laws: Laws::SKID_ROLL, ..problem.clone() };
        let robot = Robot {
            skid_dry_n: three_links(&problem).skid_kg_s.map(|c_kg_s| c_kg_s * TRANSITION_M_S),
            transition_m_s: TRANSITION_M_S,
            ..three_links(&problem).clone()
        };
        let wide = Problem { robot: robot.into(), ..problem };
        let [known, found] =
            [viscous, wide].map(|problem| problem.solve(1e-11).unwrap().metrics.to_array());
        for (found, known) in found.into_iter().zip(known) {
            assert_near(found, known, 1e-8, 1e-14, "a metric");
        }
    }
}

#[test]
fn wheels_under_large_dry_friction_do_not_skid() {
    // The gaits avoid shapes at which no-skid wheels leave the motion undetermined.
    let [_, skewed, passive] = campaigns();
    for (problem, constrained) in [(skewed, Laws::NO_SKID), (passive, Laws::NO_SKID_ROLL)] {
        let known = Problem { laws: constrained, ..problem.clone() };
        let known = known.solve(1e-11).unwrap().metrics.d_m;
        let [large, larger] = [1e3, 1e4].map(|force_n| {
            let robot = Robot { skid_dry_n: [force_n; 3], ..three_links(&problem).clone() };
            Problem { robot: robot.into(), ..problem.clone() }.solve(1e-13).unwrap().metrics.d_m
        });
        assert_near(larger, known, 1e-5, 0.0, "d");
        // The remaining error is inversely proportional to the force.
        assert_near((10.0 * larger - large) / 9.0, known, 1e-8, 0.0, "the limit of d");
    }
}

#[test]
fn derivatives_agree_with_central_differences() {
    let [symmetric, skewed, passive] = campaigns();
    let dry = |problem: Problem, skid, roll| {
        let robot = Robot {
            roll_dry_n: [0.1, 0.04, 0.05],
            skid_static_n: [2.2, 1.2, 1.1],
            ..three_links(&problem).clone()
        };
        Problem { robot: robot.into(), laws: Laws { skid, roll }, ..problem }
    };
    for problem in [
        dry(symmetric, SkidLaw::StribeckViscous, RollLaw::CoulombViscous),
        dry(skewed, SkidLaw::Coulomb, RollLaw::Viscous),
        dry(passive.clone(), SkidLaw::CoulombViscous, RollLaw::Coulomb),
        dry(passive, SkidLaw::Constrained, RollLaw::CoulombViscous),
    ] {
        let mut solver = Solver::default();
        let metrics = solver.solve(&problem, 1e-12).unwrap();
        let metrics = solver.steady_motion(metrics).unwrap().to_array();
        let derivatives = Derivatives::of(&mut solver, &problem).unwrap();
        let by_parameter = derivatives.parameters.iter().map(|(of, found)| (Some(of), *found));
        for (variable, found) in by_parameter.chain([(None, derivatives.omega)]) {
            let value = match variable {
                Some(parameter) => problem.robot.value(parameter),
                None => problem.omega_rad_s,
            };
            // Richardson extrapolation of central differences.
            let difference = |step: f64| -> [f64; 8] {
                let [low, high] = [-step, step].map(|step| {
                    let mut problem = problem.clone();
                    match variable {
                        Some(parameter) => problem.robot.set(parameter, value + step),
                        None => problem.omega_rad_s += step,
                    }
                    problem.solve(1e-13).unwrap().to_array()
                });
                std::array::from_fn(|i| (high[i] - low[i]) / (2.0 * step))
            };
            let step = 4e-4 * if value == 0.0 { 0.1 } else { value };
            let coarse = difference(step);
            let fine = difference(0.5 * step);
            let found = found.metrics.to_array().into_iter().chain([found.work_j]);
            for (i, found) in found.enumerate() {
                let known = (4.0 * fine[i] - coarse[i]) / 3.0;
                // Error relative to the derivative, or to the change caused by the whole value.
                let size = known.abs().max(1e-2 * metrics[i].abs() / value.abs().max(1e-3));
                let what = format!("{:?} {variable:?} metric {i}", problem.laws);
                assert_near(found, known, 0.0, 1e-6 * size + 1e-11, &what);
            }
        }
    }
}

#[test]
fn the_sharp_limit_agrees_with_a_much_sharper_transition() {
    for problem in campaigns() {
        let limit = problem.sharp_limit(REFERENCE_ACCURACY).unwrap().unwrap();
        let at = |transition_m_s: f64| {
            let robot = Robot { transition_m_s, ..three_links(&problem).clone() };
            Problem { robot: robot.into(), ..problem.clone() }.solve(1e-8).unwrap().metrics.d_m
        };
        let present = at(0.005);
        let sharper = at(0.001);
        let limit_m = limit.metrics.d_m;
        let remaining = (limit_m - present).abs();
        assert!((sharper - limit_m).abs() < 0.35 * remaining, "{present} {sharper} {limit:?}");
        assert!(limit.uncertainty.d_m < 0.2 * remaining, "{present} {limit:?}");
        assert_eq!(Problem { laws: Laws::SKID, ..problem }.sharp_limit(1e-8), Ok(None));
    }
}

#[test]
fn the_work_of_the_actuators_is_dissipated_by_dry_friction() {
    for problem in campaigns() {
        let robot = Robot {
            roll_dry_n: [0.1, 0.05, 0.04],
            skid_static_n: three_links(&problem).skid_dry_n.map(|force_n| 1.2 * force_n),
            ..three_links(&problem).clone()
        };
        for roll in [RollLaw::Coulomb, RollLaw::CoulombViscous] {
            for skid in [SkidLaw::Coulomb, SkidLaw::CoulombViscous, SkidLaw::Stribeck] {
                let laws = Laws { skid, roll };
                let problem = Problem { robot: robot.clone().into(), laws, ..problem };
                let mut solver = Solver::default();
                solver.solve(&problem, 1e-11).unwrap();
                let [work_j, loss_j] = solver.work_and_loss_j().unwrap();
                assert!(loss_j > 0.0, "{laws:?}");
                assert_near(work_j, loss_j, 1e-7, 0.0, &format!("{laws:?}"));
            }
        }
    }
}

#[test]
fn cycles_and_transients_are_sampled_where_wheels_reverse() {
    let mut solver = Solver::default();
    for (problem, omega_rad_s) in
        campaigns().iter().flat_map(|problem| [1.0, 2.0, 3.9].map(|omega| (problem, omega)))
    {
        let problem = Problem { omega_rad_s, ..problem.clone() };
        let metrics = solver.solve(&problem, REFERENCE_ACCURACY).unwrap();
        let what = format!("{:?} {omega_rad_s}", problem.gait);
        for samples in [solver.cycle(50).unwrap(), problem.cycles_from_rest(1, 50).unwrap()] {
            assert_eq!(samples.len(), 51, "{what}");
        }
        let cycle = solver.cycle(50).unwrap();
        let [first, .., last] = &cycle[..] else { panic!("{what}") };
        assert_near(last.pose.x_m.hypot(last.pose.y_m), metrics.d_m, 1e-8, 0.0, &what);
        assert_near(last.skid_m_s[1], first.skid_m_s[1], 1e-7, 1e-10, &what);
    }
}
