//! Tests of steady-state motions against an independent derivation.

use std::f64::consts::PI;

use trilink_mechanics::{
    FIT_ACCURACY, FORCES_ACCURACY, Laws, MotionError, MotionStatus, Problem, REFERENCE_ACCURACY,
    Sample, Solver,
};
use trilink_robot::metrics::{GaitMetrics, padded};
use trilink_robot::{Gait, JointCommand, Parameter, Quantity, Robot, SecondHarmonic};

use crate::{Derivatives, displacements};

/// Row of the reference table `periodic.csv`.
struct Row {
    problem: Problem,
    metrics: GaitMetrics,
    name: String,
}

fn rows() -> Vec<Row> {
    let text = include_str!("../fixtures/periodic.csv");
    text.lines().skip(1).map(row).collect()
}

fn row(line: &str) -> Row {
    // The third field may be quoted and contain commas.
    let mut fields = Vec::new();
    let mut quoted = false;
    let mut field = String::new();
    for character in line.chars().chain([',']) {
        match character {
            '"' => quoted = !quoted,
            ',' if !quoted => fields.push(std::mem::take(&mut field)),
            other => field.push(other),
        }
    }
    let number = |i: usize| fields[i].parse::<f64>().unwrap();
    let (mut robot, gait) = match fields[0].as_str() {
        "kinematic-symmetric" => (Robot::kinematic(), Gait::symmetric()),
        "kinematic-skewed" => (Robot::kinematic(), Gait::skewed()),
        "semi-passive-symmetric" => (Robot::semi_passive(), Gait::passive_symmetric()),
        other => panic!("unknown campaign {other}"),
    };
    for setting in fields[2].split_whitespace() {
        let (key, value) = setting.split_once('=').unwrap();
        let values: Vec<f64> = value.split(',').map(|x| x.parse().unwrap()).collect();
        match key {
            "skid_kg_s" => robot.skid_kg_s = [values[0], values[1], values[2]],
            "stiffness_nm_rad" => robot.stiffness_nm_rad = values[0],
            "damping_nm_s_rad" => robot.damping_nm_s_rad = values[0],
            other => panic!("unknown key {other}"),
        }
    }
    let laws = crate::laws(&fields[1]);
    let alpha1_rad = match fields[9].as_str() {
        "" => gait.joints[0].unwrap().amplitude_rad,
        _ => number(9).to_radians(),
    };
    Row {
        problem: Problem::new(robot, gait, laws, number(3)),
        metrics: GaitMetrics {
            d_m: number(4),
            v_m_s: number(5),
            sigma: padded(&[number(6), number(7), number(8)]),
            alpha_rad: padded(&[alpha1_rad]),
            dtheta_rad: fields[10].parse().unwrap(),
        },
        name: format!("{} {} at {}", fields[0], fields[1], fields[3]),
    }
}

#[test]
fn reference_motions_agree_to_1e_8() {
    for row in rows() {
        let motion = row.problem.solve(REFERENCE_ACCURACY).unwrap();
        let found = motion.metrics.to_array();
        let known = row.metrics.to_array();
        for (found, known) in found.iter().zip(&known).take(6) {
            assert!((found - known).abs() <= 1e-8 * known.abs(), "{}: {found} {known}", row.name);
        }
        assert!((found[6] - known[6]).abs() < 1e-9, "{}: dtheta {}", row.name, found[6]);
        assert_eq!(motion.status(), MotionStatus::Stable, "{}", row.name);
    }
}

#[test]
fn the_accuracy_of_fits_is_1e_6() {
    for row in rows() {
        let motion = row.problem.solve(FIT_ACCURACY).unwrap();
        let found = motion.metrics.to_array();
        let known = row.metrics.to_array();
        for (found, known) in found.iter().zip(&known).take(6) {
            assert!((found - known).abs() <= 1e-6 * known.abs(), "{}: {found} {known}", row.name);
        }
    }
}

#[test]
fn a_warm_start_finds_the_same_motion_with_fewer_jacobians() {
    for row in rows() {
        let mut solver = Solver::default();
        let cold = solver.solve(&row.problem, REFERENCE_ACCURACY).unwrap();
        let cold_jacobians = solver.effort().factorisations;
        let near = Problem { omega_rad_s: 1.02 * row.problem.omega_rad_s, ..row.problem.clone() };
        solver.solve(&near, REFERENCE_ACCURACY).unwrap();
        let warm = solver.solve(&row.problem, REFERENCE_ACCURACY).unwrap();
        let d = (warm.d_m - cold.d_m).abs();
        assert!(d < 1e-9 * cold.d_m, "{}: {d}", row.name);
        assert!(solver.effort().factorisations < cold_jacobians, "{}", row.name);
    }
}

#[test]
fn after_a_failed_nearby_search_the_next_starts_from_the_previous_solution() {
    let problem =
        Problem::new(Robot::semi_passive(), Gait::passive_symmetric(), Laws::SKID_ROLL, 3.0);
    let mut none = problem.clone();
    none.gait.joints[1].as_mut().unwrap().amplitude_rad = f64::NAN;
    let next = Problem { omega_rad_s: 3.02, ..problem.clone() };
    let mut solver = Solver::default();
    let here = solver.solve_near(&problem, 1e-9).unwrap();
    assert_eq!(here, problem.solve(1e-9).unwrap().metrics);
    assert!(solver.solve_near(&none, 1e-9).is_err());
    // A failed solution cannot be queried.
    assert!(solver.floquet().is_err());
    let there = solver.solve_near(&next, 1e-9).unwrap();
    let steps = solver.effort().newton_steps;
    let known = solver.solve(&next, 1e-9).unwrap();
    assert!((there.d_m / known.d_m - 1.0).abs() < 1e-8, "{there:?} {known:?}");
    let mut anew = Solver::default();
    anew.solve(&next, 1e-9).unwrap();
    assert!(steps < anew.effort().newton_steps, "{steps} {:?}", anew.effort());
}

#[test]
fn the_path_of_the_kinematic_robot_without_skid_does_not_depend_on_frequency() {
    for (gait, d_m) in [(Gait::symmetric(), 0.663466), (Gait::skewed(), 0.122405)] {
        for omega_rad_s in [0.5, 1.0, 2.0, 3.9, 6.0] {
            let problem = Problem::new(Robot::kinematic(), gait, Laws::NO_SKID, omega_rad_s);
            let found = problem.solve(REFERENCE_ACCURACY).unwrap().metrics;
            // The reference values have six digits.
            assert!((found.d_m - d_m).abs() < 0.5e-6 + 1e-6 * d_m, "{}", found.d_m);
            let speed = found.d_m * omega_rad_s / std::f64::consts::TAU;
            assert!((found.v_m_s - speed).abs() < 1e-12);
        }
    }
}

#[test]
fn a_gait_through_a_singular_shape_that_violates_condition_5_has_no_motion() {
    let mut gait = Gait::symmetric();
    gait.joints[0].as_mut().unwrap().amplitude_rad *= 1.05;
    let problem = Problem::new(Robot::kinematic(), gait, Laws::NO_SKID, 3.9);
    let error = problem.solve(REFERENCE_ACCURACY).unwrap_err();
    assert_eq!(error.status(), MotionStatus::Singular, "{error}");
}

#[test]
fn the_transient_from_rest_settles_into_the_steady_motion() {
    for row in rows().into_iter().filter(|row| row.problem.laws.skids()) {
        let steady = row.problem.solve(REFERENCE_ACCURACY).unwrap().metrics;
        let [d_m, turn_rad] = displacements(&row.problem, 30, 1e-9).unwrap()[29];
        assert!((d_m - steady.d_m).abs() < 1e-6 * steady.d_m, "{}: {d_m} {}", row.name, steady.d_m);
        assert!((turn_rad - steady.dtheta_rad).abs() < 1e-6, "{}", row.name);
    }
}

#[test]
fn the_motion_converges_to_that_without_skid() {
    let setups = [
        (Robot::kinematic(), Gait::symmetric(), Laws::SKID, Laws::NO_SKID),
        (Robot::kinematic(), Gait::skewed(), Laws::SKID, Laws::NO_SKID),
        (Robot::kinematic(), Gait::skewed(), Laws::SKID_ROLL, Laws::NO_SKID_ROLL),
        (Robot::semi_passive(), Gait::passive_symmetric(), Laws::SKID_ROLL, Laws::NO_SKID_ROLL),
    ];
    for (robot, gait, skids, cannot) in setups {
        let problem = Problem::new(robot.clone(), gait, cannot, 3.9);
        let limit = problem.solve(REFERENCE_ACCURACY).unwrap().metrics;
        let mut last: Option<(f64, [f64; 3])> = None;
        for skid_kg_s in [1e2, 1e3, 1e4, 1e5, 1e6] {
            let robot = Robot { skid_kg_s: [skid_kg_s; 3], ..robot.clone() };
            let problem = Problem::new(robot, gait, skids, 3.9);
            let found = problem.solve(REFERENCE_ACCURACY).unwrap().metrics;
            let off = (found.d_m - limit.d_m).abs() / limit.d_m;
            if let Some((last_off, last_sigma)) = last {
                // The forces approach the constraint forces, so the skid velocities are proportional to 1 /
                // c.
                assert!(off < 0.3 * last_off, "{skids:?} {skid_kg_s}: {off} after {last_off}");
                for (sigma, last) in found.sigma.iter().zip(last_sigma).take(3) {
                    assert!(*sigma < 0.2 * last, "{skids:?} {skid_kg_s}: {sigma} after {last}");
                }
            }
            last = Some((off, [0, 1, 2].map(|wheel| found.sigma[wheel])));
        }
        let (off, sigma) = last.unwrap();
        assert!(
            off < 1e-4 && sigma.iter().all(|sigma| *sigma < 1e-4),
            "{skids:?}: {off} {sigma:?}"
        );
    }
}

#[test]
fn a_passive_rear_joint_mirrors_a_passive_front_joint() {
    // Exchanging the side links and reversing the direction of travel gives the same robot.
    let front =
        Problem::new(Robot::semi_passive(), Gait::passive_symmetric(), Laws::SKID_ROLL, 3.0);
    let mut rear = front.clone();
    rear.gait.joints.swap(0, 1);
    for laws in [Laws::SKID_ROLL, Laws::SKID, Laws::NO_SKID_ROLL] {
        let [front, rear] = [&front, &rear].map(|problem| {
            let problem = Problem { laws, ..problem.clone() };
            problem.solve(REFERENCE_ACCURACY).unwrap().metrics
        });
        assert!((front.d_m - rear.d_m).abs() < 1e-9 * front.d_m, "{laws:?}: {front:?} {rear:?}");
        assert!((front.sigma[1] - rear.sigma[2]).abs() < 1e-9, "{laws:?}");
    }
}

/// Returns problems of every kind whose commands have second harmonics; in some problems the second harmonics have zero
/// amplitude.
fn with_second_harmonics() -> Vec<Problem> {
    let command = |offset_rad: f64, phase_rad: f64, [amplitude2_rad, phase2_rad]: [f64; 2]| {
        let second = Some(SecondHarmonic::new(amplitude2_rad, phase2_rad));
        JointCommand { second, ..JointCommand::new(offset_rad, 0.5, phase_rad) }
    };
    let front = command(0.3, 0.4, [0.15, 2.0]);
    let rear = command(-0.2, -1.3, [0.2, -1.0]);
    // The joint angles never coincide, so the no-skid constraint has a solution.
    let apart = [command(0.9, 0.0, [0.1, 2.0]), command(-0.9, -1.6, [0.15, -1.0])];
    let nothing = command(0.0, 0.2, [0.0, 0.0]);
    let kinds = [
        (Robot::kinematic(), [Some(front), Some(rear)], Laws::SKID_ROLL),
        (Robot::kinematic(), apart.map(Some), Laws::NO_SKID_ROLL),
        (Robot::kinematic(), [Some(nothing), Some(JointCommand::new(0.0, 0.4, -1.2))], Laws::SKID),
        (Robot::semi_passive(), [None, Some(rear)], Laws::SKID_ROLL),
        (Robot::semi_passive(), [Some(front), None], Laws::NO_SKID_ROLL),
        (Robot::semi_passive(), [None, Some(nothing)], Laws::NO_SKID),
    ];
    let problem = |(robot, joints, laws)| Problem::new(robot, Gait { joints }, laws, 3.0);
    kinds.into_iter().map(problem).collect()
}

#[test]
fn a_zero_second_harmonic_leaves_results_bit_identical() {
    let nothing = |mut problem: Problem| {
        for command in problem.gait.joints.iter_mut().flatten() {
            command.second = Some(SecondHarmonic::default());
        }
        problem
    };
    let gaits = [Gait::symmetric(), Gait::skewed(), Gait::passive_symmetric()];
    for gait in gaits {
        for laws in [Laws::SKID_ROLL, Laws::NO_SKID_ROLL] {
            let problem = Problem::new(Robot::semi_passive(), gait, laws, 3.0);
            let solved = |problem: &Problem| -> Result<_, MotionError> {
                let mut solver = Solver::default();
                let metrics = solver.solve(problem, FIT_ACCURACY)?;
                let steady = solver.steady_motion(metrics)?.to_array();
                let Derivatives { parameters, omega, gait, second } =
                    Derivatives::of(&mut solver, problem)?;
                Ok((format!("{steady:?} {:?}", (parameters, omega, gait)), second))
            };
            match (solved(&problem), solved(&nothing(problem.clone()))) {
                (Ok((without, second)), Ok((with, _))) => {
                    assert_eq!(without, with, "{laws:?} {gait:?}");
                    let second = second.as_flattened().iter();
                    assert!(second.map(|of| of.metrics).all(|of| of == GaitMetrics::NONE));
                }
                (without, with) => {
                    assert_eq!(without.unwrap_err().to_string(), with.unwrap_err().to_string());
                }
            }
        }
    }
}

/// Mirroring a motion reverses the signs of its angles. A time shift changes only the displacement of a robot that
/// rotates, because the displacement is then measured between other poses.
#[test]
fn metrics_are_invariant_to_mirroring_and_time_shift_of_second_harmonics() {
    for problem in with_second_harmonics() {
        let known = problem.solve(REFERENCE_ACCURACY).unwrap().metrics;
        let moved = |of: &dyn Fn(JointCommand) -> JointCommand| {
            let mut problem = problem.clone();
            problem.gait.joints = problem.gait.joints.map(|joint| joint.map(of));
            problem.solve(REFERENCE_ACCURACY).unwrap().metrics
        };
        let is_one = |one: GaitMetrics, other: GaitMetrics| {
            let both = one.to_array().into_iter().zip(other.to_array());
            both.into_iter().for_each(|(one, other)| {
                assert!((one - other).abs() < 1e-8 * (other.abs() + 1e-2), "{problem:?}");
            });
        };
        let later = moved(&|of| of.advanced(0.8));
        is_one(GaitMetrics { d_m: known.d_m, v_m_s: known.v_m_s, ..later }, known);
        let mirrored = moved(&|of| {
            let second = of.second.map(|of| {
                let in_phase_rad = -of.in_phase_rad;
                let quadrature_rad = -of.quadrature_rad;
                SecondHarmonic { in_phase_rad, quadrature_rad }
            });
            let phase_rad = of.phase_rad + PI;
            JointCommand { offset_rad: -of.offset_rad, phase_rad, second, ..of }
        });
        is_one(GaitMetrics { dtheta_rad: -mirrored.dtheta_rad, ..mirrored }, known);
    }
}

#[test]
fn steady_motions_with_second_harmonics_are_reached_from_rest() {
    const CYCLES: usize = 20;
    let mut problems = with_second_harmonics();
    // Without rolling resistance the transient takes too long.
    problems.retain(|problem| problem.laws != Laws::NO_SKID);
    for problem in problems.into_iter().chain([dry_with_second_harmonics()]) {
        let GaitMetrics { d_m, dtheta_rad, .. } = problem.solve(1e-8).unwrap().metrics;
        let [found_m, turn_rad] = displacements(&problem, CYCLES, 1e-8).unwrap()[CYCLES - 1];
        assert!((found_m - d_m).abs() < 1e-5 * d_m, "{found_m} {d_m} {problem:?}");
        assert!((turn_rad - dtheta_rad).abs() < 1e-5, "{problem:?}");
    }
}

/// Returns a problem under dry friction that is smooth enough for finite differences.
fn dry_with_second_harmonics() -> Problem {
    let mut problem = with_second_harmonics().remove(0);
    problem.laws = Laws::COULOMB_VISCOUS;
    problem.robot.set(Quantity::Transition.one(), 0.05);
    problem
}

#[test]
fn derivatives_with_second_harmonics_under_dry_friction_agree_with_differences() {
    let problem = dry_with_second_harmonics();
    let mut solver = Solver::default();
    solver.solve(&problem, REFERENCE_ACCURACY).unwrap();
    let derivatives = Derivatives::of(&mut solver, &problem).unwrap();
    for (joint, part) in [(0, 0), (1, 1)] {
        let difference = |step: f64| -> [f64; 8] {
            let [low, high] = [-step, step].map(|step| {
                let mut problem = problem.clone();
                let second = problem.gait.joints[joint].as_mut().unwrap().second.as_mut().unwrap();
                *[&mut second.in_phase_rad, &mut second.quadrature_rad][part] += step;
                problem.solve(1e-12).unwrap().to_array()
            });
            std::array::from_fn(|i| (high[i] - low[i]) / (2.0 * step))
        };
        let coarse = difference(4e-4);
        let fine = difference(2e-4);
        let found = derivatives.second[joint][part];
        let found = found.metrics.to_array().into_iter().chain([found.work_j]);
        for (i, found) in found.enumerate() {
            let known = (4.0 * fine[i] - coarse[i]) / 3.0;
            let size = known.abs().max(1e-3);
            assert!((found - known).abs() < 1e-6 * size, "{joint} {part} {i}: {found} {known}");
        }
    }
}

/// Parameter of the robot (`Ok`), omega (`Err(None)`), or a joint and the index of a variable of its command
/// (`Err(Some)`).
type Variable = Result<Parameter, Option<(usize, usize)>>;

#[test]
fn derivatives_agree_with_central_differences() {
    let mut problems: Vec<Problem> = rows().into_iter().map(|row| row.problem).collect();
    let offset = |joint: usize| {
        let command = JointCommand::new(0.3, 0.5, 0.4);
        Gait { joints: [0, 1].map(|j| (j == joint).then_some(command)) }
    };
    let robot = Robot { rest_angle_rad: -0.1, ..Robot::semi_passive() };
    for laws in [Laws::NO_SKID, Laws::NO_SKID_ROLL, Laws::SKID, Laws::SKID_ROLL] {
        // Motions over whole periods, with a passive front or rear joint.
        for gait in [offset(0), offset(1)] {
            problems.push(Problem::new(robot.clone(), gait, laws, 3.0));
        }
        problems.push(Problem::new(Robot::kinematic(), Gait::skewed(), laws, 3.0));
    }
    problems
        .into_iter()
        .for_each(|problem| compare_with_differences(problem, Parameter::ALL.len()));
}

#[test]
fn derivatives_with_second_harmonics_agree_with_central_differences() {
    with_second_harmonics().into_iter().for_each(|problem| compare_with_differences(problem, 0));
}

/// Compares the derivatives of the metrics with respect to the robot's parameters, omega and the gait with
/// finite differences; only the first `parameters` of the robot's parameters are compared.
fn compare_with_differences(problem: Problem, parameters: usize) {
    let changed = |problem: &Problem, variable: Variable, step: f64| {
        let mut problem = problem.clone();
        match variable {
            Ok(parameter) => {
                let value = problem.robot.value(parameter) + step;
                problem.robot.set(parameter, value);
            }
            Err(None) => problem.omega_rad_s += step,
            Err(Some((joint, number))) => {
                let command = problem.gait.joints[joint].as_mut().unwrap();
                match (number, command.second.as_mut()) {
                    (3, Some(second)) => second.in_phase_rad += step,
                    (_, Some(second)) if number > 3 => second.quadrature_rad += step,
                    _ => *command.numbers_mut()[number] += step,
                }
            }
        }
        problem.solve(1e-13).unwrap().to_array()
    };
    let mut solver = Solver::default();
    let metrics = solver.solve(&problem, REFERENCE_ACCURACY).unwrap();
    let metrics = solver.steady_motion(metrics).unwrap().to_array();
    let derivatives = Derivatives::of(&mut solver, &problem).unwrap();
    let [work_j, loss_j] = solver.work_and_loss_j().unwrap();
    assert!((solver.loss_j().unwrap() - loss_j).abs() <= 1e-12 * work_j.abs(), "{problem:?}");
    let by_parameter = derivatives.parameters.iter().take(parameters);
    let by_parameter = by_parameter.map(|(of, &found)| (Ok(of), found));
    let numbers = (0..2).flat_map(|joint| (0..5).map(move |number| (joint, number)));
    let by_gait = numbers.map(|(j, n)| {
        let found = if n < 3 { derivatives.gait[j][n] } else { derivatives.second[j][n - 3] };
        (Err(Some((j, n))), found)
    });
    let by_omega = [(Err(None), derivatives.omega)];
    for (variable, derivative) in by_parameter.chain(by_omega).chain(by_gait) {
        let value = match variable {
            Ok(parameter) => problem.robot.value(parameter),
            Err(None) => problem.omega_rad_s,
            Err(Some((joint, number))) => match problem.gait.joints[joint] {
                // The motion without skid does not exist for neighbouring gaits.
                Some(_) if derivative.metrics.d_m.is_nan() => continue,
                Some(of) if number < 3 => of.to_array()[number],
                Some(JointCommand { second: Some(second), .. }) => {
                    [second.in_phase_rad, second.quadrature_rad][number - 3]
                }
                _ => continue,
            },
        };
        if let Ok(parameter) = variable
            && !problem.robot.depends_on(parameter, problem.laws, &problem.gait)
        {
            // It may be zero, and then cannot be lowered.
            let slopes = derivative.metrics.to_array().into_iter().chain([derivative.work_j]);
            assert!(slopes.into_iter().all(|slope| slope == 0.0), "{variable:?} {problem:?}");
            continue;
        }
        // Richardson extrapolation of central differences.
        let difference = |step: f64| -> [f64; 8] {
            let low = changed(&problem, variable, -step);
            let high = changed(&problem, variable, step);
            std::array::from_fn(|i| (high[i] - low[i]) / (2.0 * step))
        };
        let step = 2e-3 * if value == 0.0 { 0.1 } else { value };
        let coarse = difference(step);
        let fine = difference(0.5 * step);
        let found = derivative.metrics.to_array().into_iter().chain([derivative.work_j]);
        for (i, found) in found.enumerate() {
            let known = (4.0 * fine[i] - coarse[i]) / 3.0;
            // Error relative to the derivative, or to the change caused by the whole value.
            let size = known.abs().max(1e-2 * metrics[i].abs() / value.abs().max(1e-3));
            assert!(
                (found - known).abs() <= 1e-6 * size + 1e-13 / step.abs(),
                "{:?} {variable:?} metric {i} at {}: {found} against {known}",
                problem.laws,
                problem.omega_rad_s,
            );
        }
    }
}

/// Returns the ratio of the largest value among all samples of a cycle to the largest among every eleventh sample: 1
/// for bounded and resolved values, 11 at a pole. In both sets of samples, the crossings of `phi1 = phi2` by the
/// symmetric gait are half a sampling interval from the nearest sample.
fn growth(laws: Laws, values: impl Fn(&Sample) -> [f64; 3]) -> f64 {
    let problem = Problem::new(Robot::kinematic(), Gait::symmetric(), laws, 4.0);
    let mut solver = Solver::default();
    solver.solve(&problem, FORCES_ACCURACY).unwrap();
    let samples = solver.cycle(1100).unwrap();
    let largest = |step: usize| {
        let sizes = samples.iter().step_by(step).flat_map(|sample| values(sample).map(f64::abs));
        sizes.fold(0.0, f64::max)
    };
    largest(1) / largest(11)
}

/// Sections II.A and II.B of the paper: under the circular gait, the velocities remain bounded where the
/// joint angles are equal, because the gait meets eq. 6 there. According to the paper, the constraint forces
/// are unbounded there with and without losses; but without losses, and with identical side links, the motion
/// is symmetric about the time at which the angles are equal, and the forces have a limit.
#[test]
fn forces_at_equal_angles_are_unbounded_only_with_losses() {
    let velocities = |sample: &Sample| {
        let [x, y, turning] = sample.pose_rates;
        [x, y, Robot::kinematic().h_m[0] * turning]
    };
    let forces = |sample: &Sample| [0, 1, 2].map(|wheel| sample.lateral_n[wheel]);
    assert!(growth(Laws::NO_SKID, velocities) < 1.05);
    assert!(growth(Laws::NO_SKID, forces) < 1.05);
    let with_roll = growth(Laws::NO_SKID_ROLL, forces);
    assert!((with_roll - 11.0).abs() < 0.1, "{with_roll}");
}

#[test]
fn a_successor_solves_bit_identically_to_its_solver() {
    for (robot, gait, laws) in [
        (Robot::kinematic(), Gait::symmetric(), Laws::SKID_ROLL),
        (Robot::kinematic(), Gait::skewed(), Laws::COULOMB),
        (Robot::kinematic(), Gait::skewed(), Laws::NO_SKID),
        (Robot::semi_passive(), Gait::passive_symmetric(), Laws::SKID_ROLL),
        (Robot::semi_passive(), Gait::passive_symmetric(), Laws::NO_SKID_ROLL),
    ] {
        let at = |omega_rad_s| Problem::new(robot.clone(), gait, laws, omega_rad_s);
        let mut solver = Solver::default();
        solver.solve(&at(3.9), FIT_ACCURACY).unwrap();
        let mut successor = solver.successor();
        assert!(matches!(successor.floquet(), Err(MotionError::Unsolved)), "{laws:?}");
        let next = |of: &mut Solver| {
            let metrics = of.solve(&at(4.0), FIT_ACCURACY).unwrap();
            (metrics, of.effort(), Derivatives::of(of, &at(4.0)).unwrap())
        };
        let here = next(&mut solver);
        let there = next(&mut successor);
        assert_eq!(format!("{here:?}"), format!("{there:?}"), "{laws:?}");
    }
}

/// The damping of the passive joint dissipates energy; its stiffness does not.
#[test]
fn six_coefficients_dissipate_in_the_kinematic_robot_and_seven_in_the_semi_passive_one() {
    let count = |robot: Robot, gait: Gait| {
        let problem = Problem::new(robot, gait, Laws::SKID_ROLL, 3.9);
        let mut solver = Solver::default();
        solver.solve(&problem, REFERENCE_ACCURACY).unwrap();
        let derivatives = Derivatives::of(&mut solver, &problem).unwrap().parameters;
        let dissipating = derivatives.iter().filter(|(parameter, derivative)| {
            ![Quantity::Roll.sum(), Quantity::Stiffness.one()].contains(parameter)
                && derivative.metrics.to_array().iter().any(|slope| *slope != 0.0)
        });
        dissipating.count()
    };
    assert_eq!(count(Robot::kinematic(), Gait::skewed()), 6);
    assert_eq!(count(Robot::semi_passive(), Gait::passive_symmetric()), 7);
}
