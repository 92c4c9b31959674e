//! Tests of eq. 1 (kinematics) and eq. 7 (dynamics) against an independent derivation in the world frame, and
//! of statements in the paper's sections II.A to II.C about particular shapes of the robot.

#![allow(clippy::unwrap_used)]

use nalgebra::{DMatrix, Matrix3, SMatrix, Vector3};
use serde_json::Value;
use trilink_robot::{
    Gait, Robot, Trig, Velocity, Viscous, det_wb, dforce_dphi, dot, force_balance, mass_matrix,
    roll_rows, rotated, skid_rows,
};

struct State {
    robot: Robot,
    theta: f64,
    phi: [f64; 2],
    qdot: [f64; 5],
    case: Value,
}

fn states() -> Vec<State> {
    let text = include_str!("fixtures/mechanics.json");
    let cases: Vec<Value> = serde_json::from_str(text).unwrap();
    cases
        .into_iter()
        .map(|case| {
            let q = vector(&case["q"]);
            let robot = match case["robot"].as_str().unwrap() {
                "kinematic" => Robot::kinematic(),
                _ => Robot::semi_passive(),
            };
            State { robot, theta: q[2], phi: [q[3], q[4]], qdot: vector(&case["qdot"]), case }
        })
        .collect()
}

fn vector(value: &Value) -> [f64; 5] {
    std::array::from_fn(|i| value[i].as_f64().unwrap())
}

/// Transforms a row of coefficients of the robot's five velocities from the frame of link 0 to the world
/// frame by rotating its first two entries, those of the translation, by the heading `theta` (rad).
fn to_world(theta: f64, row: [f64; 5]) -> [f64; 5] {
    let [x, y] = rotated(theta, [row[0], row[1]]);
    [x, y, row[2], row[3], row[4]]
}

fn to_body(theta: f64, row: [f64; 5]) -> Velocity {
    to_world(-theta, row)
}

/// Returns the velocity-dependent terms `B` of the equations of motion (eq. 7 of the paper): the forces that
/// remain without friction, springs and accelerations.
fn velocity_terms(robot: &Robot, phi: [f64; 2], velocity: &Velocity) -> [f64; 5] {
    let robot = Robot { skid_kg_s: [0.0; 3], roll_kg_s: [0.0; 3], ..robot.clone() };
    force_balance::<_, Viscous>(&robot, None, phi, &Trig::new(phi), velocity, &[0.0; 5]).force
}

#[track_caller]
fn assert_near(found: f64, known: f64) {
    assert!((found - known).abs() <= 1e-12 * known.abs().max(1.0), "{found} against {known}");
}

#[test]
fn wheel_rows_agree_with_eq_1() {
    for state in states() {
        let trig = Trig::new(state.phi);
        let rows = [skid_rows(&state.robot, &trig), roll_rows(&state.robot, &trig)];
        for (rows, name) in rows.into_iter().zip(["W", "T"]) {
            for (i, row) in rows.into_iter().enumerate() {
                let known = vector(&state.case[name][i]);
                for (found, known) in to_world(state.theta, row).into_iter().zip(known) {
                    assert_near(found, known);
                }
            }
        }
        assert_near(det_wb(&state.robot, &trig), state.case["det_Wb"].as_f64().unwrap());
    }
}

#[test]
fn the_mass_matrix_and_the_energy_agree_with_lagranges_equations() {
    for state in states() {
        let trig = Trig::new(state.phi);
        let body = mass_matrix(&state.robot, &trig);
        // In the world frame, the mass matrix M is rotated on both sides.
        let half: Vec<[f64; 5]> = body.iter().map(|row| to_world(state.theta, *row)).collect();
        for j in 0..5 {
            let column: [f64; 5] = std::array::from_fn(|i| half[i][j]);
            for (i, found) in to_world(state.theta, column).into_iter().enumerate() {
                assert_near(found, state.case["mass_matrix"][i][j].as_f64().unwrap());
            }
        }
        let velocity = to_body(state.theta, state.qdot);
        let momenta = body.map(|row| dot(&row, &velocity));
        let energy = 0.5 * dot(&momenta, &velocity);
        assert_near(energy, state.case["kinetic_energy"].as_f64().unwrap());
    }
}

#[test]
fn the_velocity_terms_agree_with_lagranges_equations() {
    for state in states() {
        let trig = Trig::new(state.phi);
        let velocity = to_body(state.theta, state.qdot);
        let mut terms = velocity_terms(&state.robot, state.phi, &velocity);
        // In the world frame, the velocity terms B do not include the rotation of link 0's frame: (u', v') =
        // r (v, -u) is the rate of a velocity that is constant in the world frame.
        let [u, v, r, ..] = velocity;
        let mass = mass_matrix(&state.robot, &trig);
        for (term, row) in terms.iter_mut().zip(&mass) {
            *term += dot(row, &[r * v, -r * u, 0.0, 0.0, 0.0]);
        }
        let known = vector(&state.case["velocity_terms"]);
        for (found, known) in to_world(state.theta, terms).into_iter().zip(known) {
            assert_near(found, known);
        }
    }
}

#[test]
fn the_balance_is_the_sum_of_its_terms_with_a_consistent_jacobian() {
    let acceleration = [0.3, -0.7, 1.1, -2.0, 0.9];
    for state in states() {
        let robot = Robot { rest_angle_rad: 0.1, ..Robot::semi_passive() };
        let velocity = to_body(state.theta, state.qdot);
        let value = |phi: [f64; 2], velocity: Velocity| {
            let trig = Trig::new(phi);
            force_balance::<_, Viscous>(&robot, Some(0), phi, &trig, &velocity, &acceleration)
        };
        let trig = Trig::new(state.phi);
        let balance = value(state.phi, velocity);
        let mass = mass_matrix(&robot, &trig);
        let terms = velocity_terms(&robot, state.phi, &velocity);
        let skid = skid_rows(&robot, &trig);
        let roll = roll_rows(&robot, &trig);
        for i in 0..5 {
            let mut sum = dot(&mass[i], &acceleration) + terms[i];
            for wheel in 0..3 {
                sum += robot.skid_kg_s[wheel] * skid[wheel][i] * dot(&skid[wheel], &velocity);
                sum += robot.roll_kg_s[wheel] * roll[wheel][i] * dot(&roll[wheel], &velocity);
            }
            if i == 3 {
                sum += robot.stiffness_nm_rad * (state.phi[0] - robot.rest_angle_rad)
                    + robot.damping_nm_s_rad * velocity[3];
            }
            assert!((balance.force[i] - sum).abs() < 1e-11 * sum.abs().max(1.0));
        }
        const STEP: f64 = 1e-6;
        for j in 0..5 {
            let [low, high] = [-STEP, STEP].map(|step| {
                let mut moved = velocity;
                moved[j] += step;
                value(state.phi, moved).force
            });
            for i in 0..5 {
                let slope = (high[i] - low[i]) / (2.0 * STEP);
                let found = balance.dforce_dvelocity[i][j];
                assert!((found - slope).abs() < 1e-7 * slope.abs().max(1.0), "{i} {j}");
            }
        }
        for j in 0..2 {
            let turned =
                dforce_dphi::<_, Viscous>(&robot, Some(0), j, &trig, &velocity, &acceleration);
            let [low, high] = [-STEP, STEP].map(|step| {
                let mut moved = state.phi;
                moved[j] += step;
                value(moved, velocity).force
            });
            for i in 0..5 {
                let slope = (high[i] - low[i]) / (2.0 * STEP);
                let found = turned[i];
                assert!((found - slope).abs() < 1e-7 * slope.abs().max(1.0), "phi {i} {j}");
            }
        }
    }
}

/// Returns shapes of the robot, given by their joint angles `[phi1, phi2]` (rad), in which the two angles
/// differ.
fn shapes() -> impl Iterator<Item = [f64; 2]> {
    const SHAPES_DEG: [[f64; 2]; 6] =
        [[20.0, -35.0], [-50.0, 10.0], [61.0, 40.0], [-15.0, -70.0], [5.0, 30.0], [75.0, -44.0]];
    SHAPES_DEG.into_iter().map(|phi| phi.map(f64::to_radians))
}

/// Returns joint angles `[phi1, phi2]` (rad) at which the robot is singular because they are equal (the first
/// type of singular shape in the paper).
fn equal_angles() -> impl Iterator<Item = [f64; 2]> {
    (-12..=12).map(|k| [f64::from(5 * k).to_radians(); 2])
}

/// Returns joint angles `[phi1, phi2]` (rad) of the paper's second type of singular shape, at which
/// `h cos((phi2 - phi1) / 2) = -l cos((phi1 + phi2) / 2)`.
fn opposed_angles(robot: &Robot) -> impl Iterator<Item = [f64; 2]> {
    let ratio = robot.l_m[0] / robot.h_m[0];
    (-8..=8).map(move |k| {
        let middle = f64::from(10 * k).to_radians();
        let half = (-ratio * middle.cos()).acos();
        [middle - half, middle + half]
    })
}

/// Returns the matrix `W` of the no-skid constraints as printed in eq. 1 of the paper, but with lengths h and
/// l that can differ between the joints.
fn printed_w(robot: &Robot, theta: f64, [phi1, phi2]: [f64; 2]) -> SMatrix<f64, 3, 5> {
    let [h1, h2] = robot.h_m;
    let [l1, l2] = robot.l_m;
    SMatrix::from([
        [-theta.sin(), (phi1 - theta).sin(), -(phi2 + theta).sin()],
        [theta.cos(), (phi1 - theta).cos(), (phi2 + theta).cos()],
        [0.0, l1 + h1 * phi1.cos(), -l2 - h2 * phi2.cos()],
        [0.0, -l1, 0.0],
        [0.0, 0.0, -l2],
    ])
}

/// Returns the positions of the wheels (m) for the robot's coordinates `(x, y, theta, phi1, phi2)`, in m and
/// rad.
fn wheels(robot: &Robot, [x, y, theta, phi1, phi2]: [f64; 5]) -> [[f64; 2]; 3] {
    let [h1, h2] = robot.h_m;
    let [l1, l2] = robot.l_m;
    let along = |[x, y]: [f64; 2], angle: f64, length: f64| {
        [x + length * angle.cos(), y + length * angle.sin()]
    };
    let middle = [x, y];
    let front = along(along(middle, theta, h1), theta - phi1, l1);
    let rear = along(along(middle, theta, -h2), theta + phi2, -l2);
    [middle, front, rear]
}

#[test]
fn eq_1_gives_the_velocities_of_the_wheels_across_their_links() {
    const STEP: f64 = 1e-5;
    let robot = Robot::kinematic();
    for phi in shapes() {
        let theta = 0.4;
        let q = [0.3, -0.2, theta, phi[0], phi[1]];
        let w = printed_w(&robot, theta, phi);
        let links = [theta, theta - phi[0], theta + phi[1]];
        for j in 0..5 {
            let [low, high] = [-STEP, STEP].map(|step| {
                let mut moved = q;
                moved[j] += step;
                wheels(&robot, moved)
            });
            for i in 0..3 {
                let [vx, vy] = [0, 1].map(|k| (high[i][k] - low[i][k]) / (2.0 * STEP));
                let across = -links[i].sin() * vx + links[i].cos() * vy;
                assert!((across - w[(i, j)]).abs() < 1e-6, "{phi:?}: {across} {}", w[(i, j)]);
            }
        }
    }
}

/// The two inputs and the three no-skid constraints of the kinematic robot determine its motion; the
/// semi-passive robot has four unactuated coordinates, so that the constraints leave one degree of freedom to
/// the dynamics (sections I and II.C of the paper).
#[test]
fn only_the_semi_passive_robot_has_a_degree_of_freedom_left() {
    fn rank<const N: usize>(robot: &Robot, phi: [f64; 2]) -> usize {
        let rows = skid_rows(robot, &Trig::new(phi));
        DMatrix::from_fn(3, N, |i, j| rows[i][j]).rank(1e-9)
    }
    for phi in shapes() {
        assert_eq!(rank::<5>(&Robot::kinematic(), phi), 3, "{phi:?}");
        assert_eq!(rank::<4>(&Robot::semi_passive(), phi), 3, "{phi:?}");
    }
}

/// Only the zeros of det W_b matter, because they are the singular shapes of the robot; they are the same as
/// in eq. 4 of the paper.
#[test]
fn det_w_b_has_the_opposite_sign_of_eq_4() {
    let robot = Robot::kinematic();
    for phi in shapes() {
        let w = printed_w(&robot, 0.4, phi);
        let det = Matrix3::from_fn(|i, j| w[(i, j)]).determinant();
        let [phi1, phi2] = phi;
        let eq4 = robot.h_m[0] * (phi2 - phi1).sin() + robot.l_m[0] * (phi2.sin() - phi1.sin());
        assert!((det / eq4 + 1.0).abs() < 1e-9, "{phi:?}: {det} {eq4}");
        assert!((det_wb(&robot, &Trig::new(phi)) - det).abs() < 1e-12, "{phi:?}");
    }
}

#[test]
fn det_w_b_is_zero_on_singular_shapes_of_both_types() {
    let robot = Robot::kinematic();
    for phi in equal_angles().chain(opposed_angles(&robot)) {
        let det = det_wb(&robot, &Trig::new(phi));
        assert!(det.abs() < 1e-12, "{phi:?}: {det}");
    }
}

/// Returns the part of the wheels' skid velocities due to the joint rates that no velocity of the body can
/// cancel at a singular shape, as a fraction of all skid velocities due to the joint rates. Unless it is
/// zero, the body velocities that the no-skid constraints require are unbounded at that shape.
fn constraint_residual(robot: &Robot, phi: [f64; 2], rates: [f64; 2]) -> f64 {
    let rows = skid_rows(robot, &Trig::new(phi));
    let body = Matrix3::from_fn(|i, j| rows[i][j]);
    let driven = Vector3::from_fn(|i, _| rows[i][3] * rates[0] + rows[i][4] * rates[1]);
    let met = body.svd(true, true).solve(&driven, 1e-9).unwrap();
    (body * met - driven).norm() / driven.norm()
}

/// At `phi1 = phi2 = 0`, all joint rates satisfy eq. 5 of the paper, `phi1' sin phi2 + phi2' sin phi1 = 0`,
/// and the body velocities are bounded only if eq. 6 holds: `phi1' = -phi2'`.
#[test]
fn velocities_are_bounded_where_eq_5_holds_and_on_equal_angles_where_eq_6_does() {
    let robot = Robot::kinematic();
    for phi in opposed_angles(&robot) {
        assert!(constraint_residual(&robot, phi, [phi[0].sin(), -phi[1].sin()]) < 1e-9, "{phi:?}");
        assert!(
            constraint_residual(&robot, phi, [phi[0].sin(), -2.0 * phi[1].sin()]) > 1e-3,
            "{phi:?}"
        );
    }
    for phi in equal_angles() {
        assert!(constraint_residual(&robot, phi, [1.0, -1.0]) < 1e-9, "{phi:?}");
        assert!(constraint_residual(&robot, phi, [1.0, 1.0]) > 1e-3, "{phi:?}");
    }
}

/// Returns the determinant of the matrix `A = [[M_pp, -W_p^T], [W_p, 0]]` of the constrained dynamics (eq. 10
/// of the paper), in which the first `P` coordinates are passive.
fn det_a<const P: usize>(robot: &Robot, phi: [f64; 2]) -> f64 {
    let trig = Trig::new(phi);
    let mass = mass_matrix(robot, &trig);
    let rows = skid_rows(robot, &trig);
    let mut matrix = DMatrix::zeros(P + 3, P + 3);
    for i in 0..P {
        for j in 0..P {
            matrix[(i, j)] = mass[i][j];
        }
        for wheel in 0..3 {
            matrix[(i, P + wheel)] = -rows[wheel][i];
            matrix[(P + wheel, i)] = rows[wheel][i];
        }
    }
    matrix.determinant()
}

/// The paper states `det A = -det(W_b)^2` below eq. 10, with the opposite sign; only the zeros of det A
/// matter, and they are the same.
#[test]
fn det_a_of_the_kinematic_robot_is_plus_the_square_of_det_w_b() {
    let robot = Robot::kinematic();
    for phi in shapes() {
        let square = det_wb(&robot, &Trig::new(phi)).powi(2);
        assert!((det_a::<3>(&robot, phi) / square - 1.0).abs() < 1e-9, "{phi:?}");
    }
}

#[test]
fn det_a_of_the_semi_passive_robot_is_far_from_zero_up_to_90_degrees() {
    let robot = Robot::semi_passive();
    let grid = || (-9..=9).map(|k| f64::from(10 * k).to_radians());
    let all = grid().flat_map(|phi1| grid().map(move |phi2| [phi1, phi2]));
    let found: Vec<f64> = all.map(|phi| det_a::<4>(&robot, phi)).collect();
    let low = found.iter().copied().fold(f64::INFINITY, f64::min);
    let high = found.iter().copied().fold(0.0, f64::max);
    assert!(low > 0.01 * high, "{low} {high}");
}

#[test]
fn the_symmetric_gait_crosses_equal_angles_and_the_skewed_one_does_not() {
    let crossings = |gait: Gait| {
        let apart = |i: i32| {
            let phi = gait.at(std::f64::consts::TAU * (f64::from(i) + 0.5) / 360.0, 1.0).phi_rad;
            phi[0] - phi[1]
        };
        (0..360).filter(|i| apart(*i) * apart(i + 1) < 0.0).count()
    };
    assert_eq!([crossings(Gait::symmetric()), crossings(Gait::skewed())], [2, 0]);
}

#[test]
fn table_2_has_heavier_identical_side_links() {
    let kinematic = Robot::kinematic();
    let passive = Robot::semi_passive();
    assert!(passive.mass_kg[1] > kinematic.mass_kg[1]);
    assert_eq!(passive.mass_kg[1], passive.mass_kg[2]);
    assert_eq!(passive.inertia_kg_m2[1], passive.inertia_kg_m2[2]);
}

#[test]
fn inertias_of_table_1_are_not_those_of_uniform_bars_between_the_joints() {
    let robot = Robot::kinematic();
    let bar = |mass_kg: f64, length_m: f64| mass_kg * length_m * length_m / 12.0;
    let bars = [(0, 2.0 * robot.h_m[0], 0.315), (1, 2.0 * robot.b_m[0], 0.173)];
    for (link, length_m, right_m) in bars {
        let printed = robot.inertia_kg_m2[link];
        // Tolerance: half of the last printed digit.
        assert!((bar(robot.mass_kg[link], length_m) - printed).abs() > 0.5e-4, "link {link}");
        assert!((bar(robot.mass_kg[link], right_m) - printed).abs() < 0.5e-4, "link {link}");
    }
}
