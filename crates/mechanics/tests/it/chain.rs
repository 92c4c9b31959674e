//! Motions of chains against an independent derivation, the three-link robot, and conservation of energy.

use std::collections::BTreeMap;

use serde_json::Value;
use trilink_mechanics::{ChainProblem, Problem, REFERENCE_ACCURACY};
use trilink_robot::{
    Chain, Drag, FreeJoint, Gait, Joint, JointCommand, Laws, Link, Robot, TorqueCommand, Wheel,
    WheelFriction,
};

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or(0.0)
}

/// Returns the chain that an entry of the fixture describes.
fn chain(case: &Value) -> Chain {
    let links = case["links"].as_array().unwrap().iter().map(|link| Link {
        name: String::new(),
        front_joint_m: number(link, "front_joint_m"),
        rear_joint_m: number(link, "rear_joint_m"),
        com_m: number(link, "com_m"),
        mass_kg: number(link, "mass_kg"),
        inertia_kg_m2: number(link, "inertia_kg_m2"),
        wheel: link["wheel"].as_object().map(|_| Wheel {
            place_m: number(&link["wheel"], "place_m"),
            steer_rad: number(&link["wheel"], "steer_rad"),
            friction: WheelFriction {
                skid_kg_s: number(&link["wheel"], "skid_kg_s"),
                roll_kg_s: number(&link["wheel"], "roll_kg_s"),
                ..Robot::kinematic().wheel_friction(0)
            },
        }),
        drag: Drag::default(),
        rotor: None,
    });
    let joints = case["joints"].as_array().unwrap().iter().map(|joint| {
        let command = JointCommand::new(
            number(joint, "offset_rad"),
            number(joint, "amplitude_rad"),
            number(joint, "phase_rad"),
        );
        let free = |target| {
            Joint::Free(FreeJoint {
                stiffness_nm_rad: number(joint, "stiffness_nm_rad"),
                damping_nm_s_rad: number(joint, "damping_nm_s_rad"),
                target,
                torque: TorqueCommand::default(),
            })
        };
        match joint["kind"].as_str().unwrap() {
            "driven" => Joint::Driven(command),
            "elastic" => free(command),
            _ => free(JointCommand::new(number(joint, "rest_rad"), 0.0, 0.0)),
        }
    });
    Chain {
        links: links.collect(),
        joints: joints.collect(),
        reference: case["reference"].as_u64().unwrap() as usize,
        skid_length_m: 0.11,
    }
}

#[test]
fn reference_motions_of_chains_agree_to_1e_6() {
    let text = include_str!("../fixtures/chains.json");
    let cases: BTreeMap<String, Value> = serde_json::from_str(text).unwrap();
    for (name, case) in &cases {
        let laws = if case["can_skid"] == true { Laws::SKID_ROLL } else { Laws::NO_SKID_ROLL };
        for known in case["motions"].as_array().unwrap() {
            let omega_rad_s = number(known, "omega_rad_s");
            let problem = ChainProblem { chain: chain(case), laws, omega_rad_s };
            let found = problem
                .solve(REFERENCE_ACCURACY)
                .unwrap_or_else(|e| panic!("{name} {omega_rad_s}: {e}"));
            let near = |what: &str, found: f64, known: f64, absolute: f64| {
                let error = (found - known).abs();
                assert!(
                    error <= absolute.max(1e-6 * known.abs()),
                    "{name} at {omega_rad_s} rad/s: {what} = {found}, not {known}"
                );
            };
            near("d", found.d_m, number(known, "d_m"), 1e-8);
            near("dtheta", found.dtheta_rad, number(known, "dtheta_rad"), 1e-8);
            for (link, sigma) in known["sigma"].as_array().unwrap().iter().enumerate() {
                match sigma.as_f64() {
                    Some(known) => near("sigma", found.sigma[link], known, 1e-8),
                    None => assert!(found.sigma[link].is_nan()),
                }
            }
            // The extremes of the derivation are those of some hundred samples, so that they fall short.
            for (joint, alpha) in known["alpha_rad"].as_array().unwrap().iter().enumerate() {
                let excess = found.alpha_rad[joint] / alpha.as_f64().unwrap() - 1.0;
                assert!((-1e-6..1e-4).contains(&excess), "{name} at {omega_rad_s} rad/s: {excess}");
            }
            assert!(found.floquet.is_none_or(|modulus| modulus < 1.0));
            assert!((found.work_j / found.loss_j - 1.0).abs() < 1e-9, "{found:?}");
        }
    }
}

#[test]
fn the_three_link_robot_is_a_chain() {
    let gaits = [Gait::symmetric(), Gait::skewed(), Gait::passive_symmetric()];
    for (gait, robot) in
        gaits.into_iter().zip([Robot::kinematic(), Robot::kinematic(), Robot::semi_passive()])
    {
        for laws in [Laws::SKID_ROLL, Laws::COULOMB, Laws::NO_SKID_ROLL] {
            let problem = Problem { robot: robot.clone(), gait, laws, omega_rad_s: 3.9 };
            let Ok(known) = problem.solve(REFERENCE_ACCURACY) else { continue };
            let chain = robot.chain(&gait);
            let found =
                ChainProblem { chain, laws, omega_rad_s: 3.9 }.solve(REFERENCE_ACCURACY).unwrap();
            let [middle, front, rear] = known.metrics.sigma;
            let pairs = [
                (found.d_m, known.metrics.d_m),
                (found.dtheta_rad, known.metrics.dtheta_rad),
                (found.sigma[0], front),
                (found.sigma[1], middle),
                (found.sigma[2], rear),
                (found.alpha_rad[0], known.metrics.alpha1_rad),
                (found.work_j, known.work_j),
                (found.floquet.unwrap_or(0.0), known.floquet.unwrap_or(0.0)),
            ];
            for (found, known) in pairs {
                let error = (found - known).abs();
                assert!(error < 1e-9 * (1.0 + known.abs()), "{laws:?} {gait:?}: {pairs:?}");
            }
        }
    }
}
