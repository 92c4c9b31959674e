//! Tests of the equations of motion against an independent derivation for a robot of three links in the world frame
//! (eq. 1 and 7 of the paper), against the forces on the single links, and against finite differences.

#![allow(clippy::unwrap_used)]

mod claims;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::Value;
use trilink_robot::{
    Chain, Drag, Dry, FreeJoint, Gait, Joint, JointCommand, Laws, MAX_JOINTS, MAX_LINKS, Robot,
    Rotor, rotated,
};

use super::balance::{Balance, Node, Posture, System};
use super::cluster::Clusters;
use super::links::Motion;
use super::power::{EvaluatedMotion, Power, Resistance, Virtual};
use super::wave::Wave;

const OMEGA_RAD_S: f64 = 3.0;

/// Returns the robot as a chain whose wheels have the friction of the given laws.
fn chain(robot: &Robot, gait: &Gait, laws: Laws) -> Chain {
    let mut chain = robot.chain(gait);
    let wheels = chain.links.iter_mut().filter_map(|link| link.wheel.as_mut());
    wheels.for_each(|wheel| wheel.friction = wheel.friction.effective(laws));
    chain
}

/// Returns the equations of motion of a chain, and its commands and posture at a phase, given the velocities of the
/// reference link and of the free joints, and the angles of the latter.
fn at<const C: usize, const D: usize>(
    chain: &Chain,
    is_linear: bool,
    phase_rad: f64,
    velocity: [f64; D],
    free_rad: &[f64],
) -> (System, Node<f64, C>, Posture<f64, C>) {
    let system = System::new(Clusters::new(chain, OMEGA_RAD_S, is_linear));
    let node = system.node::<f64, C>(phase_rad);
    let [u, v, r] = [0, 1, 2].map(|i| velocity[i]);
    let of_joint =
        |values: &[f64]| std::array::from_fn(|c| if c == 0 { 0.0 } else { values[c - 1] });
    let posture =
        system.posture(&node.clusters, [u, v, r], of_joint(free_rad), of_joint(&velocity[3..]));
    (system, node, posture)
}

fn balance<const C: usize, const D: usize>(
    chain: &Chain,
    is_linear: bool,
    phase_rad: f64,
    [velocity, acceleration]: [[f64; D]; 2],
    free_rad: &[f64],
) -> Balance<f64, C, D> {
    let (system, node, posture) = at::<C, D>(chain, is_linear, phase_rad, velocity, free_rad);
    system.balance::<f64, Dry, C, D, true>(&node, &posture, &acceleration)
}

/// State of a robot of three links in the world frame, with the matrices that belong to it.
struct State {
    chain: Chain,
    theta_rad: f64,
    phi_rad: [f64; 2],
    rates: [f64; 5],
    case: Value,
}

fn vector(value: &Value) -> [f64; 5] {
    std::array::from_fn(|i| value[i].as_f64().unwrap())
}

/// Returns the states of the reference, as chains whose joints are all free, and which nothing resists.
fn states() -> Vec<State> {
    let text = include_str!("../../tests/fixtures/mechanics.json");
    let cases: Vec<Value> = serde_json::from_str(text).unwrap();
    let state = |case: Value| {
        let robot = match case["robot"].as_str().unwrap() {
            "kinematic" => Robot::kinematic(),
            _ => Robot::semi_passive(),
        };
        let mut chain = chain(&robot, &Gait::symmetric(), Laws::NO_SKID);
        chain.joints.fill(Joint::Free(FreeJoint::default()));
        let [_, _, theta_rad, phi1, phi2] = vector(&case["q"]);
        State { chain, theta_rad, phi_rad: [phi1, phi2], rates: vector(&case["qdot"]), case }
    };
    cases.into_iter().map(state).collect()
}

/// Rotates the part along and across the reference link of a row of coefficients of the velocities to another frame.
fn turned(angle_rad: f64, row: [f64; 5]) -> [f64; 5] {
    let [x, y] = rotated(angle_rad, [row[0], row[1]]);
    [x, y, row[2], row[3], row[4]]
}

fn dot<const D: usize>(a: &[f64; D], b: &[f64; D]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[track_caller]
fn assert_near(found: f64, known: f64, bound: f64) {
    assert!((found - known).abs() <= bound * known.abs().max(1.0), "{found} against {known}");
}

#[test]
fn masses_and_velocity_terms_agree_with_lagranges_equations() {
    for State { chain, theta_rad, phi_rad, rates, case } in states() {
        let velocity = turned(-theta_rad, rates);
        // The rate of a velocity that is constant in the world frame.
        let [u, v, r, ..] = velocity;
        let acceleration = [r * v, -r * u, 0.0, 0.0, 0.0];
        let Balance { force, mass, .. } =
            balance::<3, 5>(&chain, true, 0.0, [velocity, acceleration], &phi_rad);
        let terms = turned(theta_rad, force);
        (0..5).for_each(|i| assert_near(terms[i], vector(&case["velocity_terms"])[i], 1e-12));
        let half = mass.map(|row| turned(theta_rad, row));
        for j in 0..5 {
            let column = turned(theta_rad, half.map(|row| row[j]));
            (0..5).for_each(|i| assert_near(column[i], vector(&case["mass_matrix"][i])[j], 1e-12));
        }
        let energy = 0.5 * dot(&mass.map(|row| dot(&row, &velocity)), &velocity);
        assert_near(energy, case["kinetic_energy"].as_f64().unwrap(), 1e-12);
    }
}

#[test]
fn the_velocities_of_the_wheels_agree_with_eq_1() {
    for State { chain, theta_rad, phi_rad, rates, case } in states() {
        let (system, node, posture) =
            at::<3, 5>(&chain, true, 0.0, turned(-theta_rad, rates), &phi_rad);
        for (number, link) in chain.numbering().into_iter().enumerate() {
            let (cluster, ..) = system.wheels[link];
            let wheel = system.wheel(&posture, &node.wheels[link], cluster);
            let row = turned(theta_rad, system.skid_row::<f64, 3, 5>(&posture, &wheel, cluster));
            let [skid, roll] = ["W", "T"].map(|name| vector(&case[name][number]));
            (0..5).for_each(|i| assert_near(row[i], skid[i], 1e-12));
            assert_near(wheel.skid_m_s, dot(&skid, &rates), 1e-12);
            assert_near(wheel.roll_m_s, dot(&roll, &rates), 1e-12);
        }
    }
}

/// Compares the balance of a chain at random states with the resistances of the single links, and its derivatives with
/// finite differences.
fn compare<const C: usize, const D: usize>(gait: Gait, laws: Laws) {
    const STEP: f64 = 1e-6;
    // The resistances of the links do not include springs and dampers.
    let robot = Robot { stiffness_nm_rad: 0.0, damping_nm_s_rad: 0.0, ..Robot::semi_passive() };
    let mut chain = chain(&robot, &gait, laws);
    for (link, side) in chain.links.iter_mut().zip([1.0, -2.0, 3.0]) {
        (link.com_m, link.wheel.as_mut().unwrap().steer_rad) = (0.01 * side, 0.1 * side);
        link.drag = Drag { along_kg_s: 0.1, across_kg_s: 0.7, turning_nm_s_rad: 0.003 };
    }
    let angle = JointCommand::new(0.0, 1.5, 0.4);
    chain.links[0].rotor = Some(Rotor { inertia_kg_m2: 2e-4, angle });
    let mut rng = ChaCha8Rng::seed_from_u64(61);
    let mut random = || (rng.next_u64() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0;
    for _ in 0..20 {
        let phase_rad = 3.0 * random();
        let [velocity, acceleration] =
            [0.1, 1.0].map(|size| std::array::from_fn(|_| size * random()));
        let free_rad: [f64; C] = std::array::from_fn(|_| random());
        let force = |velocity: [f64; D], free_rad: [f64; C]| {
            balance::<C, D>(
                &chain,
                laws.are_linear(),
                phase_rad,
                [velocity, acceleration],
                &free_rad,
            )
        };
        let found = force(velocity, free_rad);
        let mut joints = [[0.0; 3]; MAX_JOINTS];
        let mut free = Vec::new();
        let (sin, cos) = phase_rad.sin_cos();
        for (joint, kind) in chain.joints.iter().enumerate() {
            joints[joint] = match kind {
                Joint::Driven(command) => Wave::new(command).at([sin, cos], OMEGA_RAD_S),
                Joint::Free(_) => {
                    free.push(joint);
                    let i = free.len() - 1;
                    [free_rad[i], velocity[3 + i], acceleration[3 + i]]
                }
            };
        }
        let [body, dbody] = [velocity, acceleration].map(|all| [0, 1, 2].map(|i| all[i]));
        let motion = Motion { phase_rad, body, dbody, joints };
        let resisted = EvaluatedMotion::new::<Dry>(&chain, &motion, OMEGA_RAD_S, [0.0; MAX_LINKS]);
        let mut power = Power::new();
        power.evaluate(&resisted, &Virtual::none(), Resistance::All);
        let (of_body, of_joints) = power.resistances(&resisted);
        let of_free = free.iter().map(|joint| of_joints[*joint]);
        for (found, known) in found.force.into_iter().zip(of_body.into_iter().chain(of_free)) {
            assert_near(found, known, 1e-12);
        }
        for j in 0..D + C - 1 {
            let [low, high] = [-STEP, STEP].map(|step| {
                let (mut velocity, mut free_rad) = (velocity, free_rad);
                *velocity.iter_mut().chain(&mut free_rad).nth(j).unwrap() += step;
                force(velocity, free_rad).force
            });
            for i in 0..D {
                let slope = match j.checked_sub(D) {
                    None => found.dforce_dvelocity[i][j],
                    Some(free) => found.dforce_dphi[free + 1][i],
                };
                assert_near(slope, (high[i] - low[i]) / (2.0 * STEP), 1e-6);
            }
        }
    }
}

#[test]
fn the_balance_is_that_of_the_links_and_its_derivatives_agree_with_differences() {
    for laws in [Laws::SKID_ROLL, Laws::COULOMB_VISCOUS] {
        compare::<1, 3>(Gait::symmetric(), laws);
        compare::<2, 4>(Gait::passive_symmetric(), laws);
        compare::<3, 5>(Gait { joints: [None; 2] }, laws);
    }
}
