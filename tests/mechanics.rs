//! Eq. 1 and 7 against numbers from an independent derivation, in the world's frame.

#![allow(clippy::unwrap_used)]

use serde_json::Value;
use trilink::robot::{
    Robot, Trig, Velocity, det_wb, dot, force_balance, mass_matrix, roll_rows, rotated, skid_rows,
};

struct State {
    robot: Robot,
    theta: f64,
    phi: [f64; 2],
    qdot: [f64; 5],
    case: Value,
}

fn states() -> Vec<State> {
    let text = include_str!("fixtures/reference/mechanics.json");
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

/// A row in link 0's frame as a row in the world's: `(u, v)` turns with `theta`.
fn to_world(theta: f64, row: [f64; 5]) -> [f64; 5] {
    let [x, y] = rotated(theta, [row[0], row[1]]);
    [x, y, row[2], row[3], row[4]]
}

fn to_body(theta: f64, row: [f64; 5]) -> Velocity {
    to_world(-theta, row)
}

/// `B` of eq. 7: what is left of the balance without friction, springs and accelerations.
fn velocity_terms(robot: &Robot, phi: [f64; 2], velocity: &Velocity) -> [f64; 5] {
    let robot = Robot { skid_kg_s: [0.0; 3], roll_kg_s: [0.0; 3], ..robot.clone() };
    force_balance(&robot, None, phi, &Trig::new(phi), velocity, &[0.0; 5]).force
}

#[track_caller]
fn assert_near(found: f64, known: f64) {
    assert!((found - known).abs() <= 1e-12 * known.abs().max(1.0), "{found} against {known}");
}

#[test]
fn wheel_rows_are_those_of_eq_1() {
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
fn the_mass_matrix_and_the_energy_are_lagranges() {
    for state in states() {
        let trig = Trig::new(state.phi);
        let body = mass_matrix(&state.robot, &trig);
        // M in the world's frame turns on both sides.
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
fn the_velocity_terms_are_lagranges() {
    for state in states() {
        let trig = Trig::new(state.phi);
        let velocity = to_body(state.theta, state.qdot);
        let mut terms = velocity_terms(&state.robot, state.phi, &velocity);
        // B in the world's frame leaves out the turning of link 0's frame: (u', v') = r (v, -u)
        // is the rate of a velocity that does not change in the world.
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
fn the_balance_is_its_parts_and_its_jacobian_their_derivative() {
    let acceleration = [0.3, -0.7, 1.1, -2.0, 0.9];
    for state in states() {
        let robot = Robot { rest_angle_rad: 0.1, ..Robot::semi_passive() };
        let velocity = to_body(state.theta, state.qdot);
        let value = |phi: [f64; 2], velocity: Velocity| {
            let trig = Trig::new(phi);
            force_balance(&robot, Some(0), phi, &trig, &velocity, &acceleration)
        };
        let trig = Trig::new(state.phi);
        let balance = value(state.phi, velocity);
        let mass = mass_matrix(&robot, &trig);
        let terms = velocity_terms(&robot, state.phi, &velocity);
        let (skid, roll) = (skid_rows(&robot, &trig), roll_rows(&robot, &trig));
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
            let [low, high] = [-STEP, STEP].map(|step| {
                let mut moved = state.phi;
                moved[j] += step;
                value(moved, velocity).force
            });
            for i in 0..5 {
                let slope = (high[i] - low[i]) / (2.0 * STEP);
                let found = balance.dforce_dphi[j][i];
                assert!((found - slope).abs() < 1e-7 * slope.abs().max(1.0), "phi {i} {j}");
            }
        }
    }
}
