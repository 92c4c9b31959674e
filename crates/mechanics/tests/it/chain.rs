//! Motions of chains against an independent derivation, finite differences, and conservation of energy.

use std::collections::BTreeMap;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::Value;
use trilink_mechanics::{FORCES_ACCURACY, MotionError, Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::{
    Chain, ChainNumber, Drag, FreeJoint, Gait, Joint, JointCommand, Laws, Link, Robot, RollLaw,
    Rotor, SkidLaw, TorqueCommand, Wheel, WheelFriction,
};

/// Returns a problem in which the driven joints of a chain have their own commands.
fn problem(chain: Chain, laws: Laws, omega_rad_s: f64) -> Problem {
    let gait = chain.gait();
    Problem::new(chain, gait, laws, omega_rad_s)
}

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
            let chain = chain(case);
            let numbers = chain.numbering();
            let problem = problem(chain, laws, omega_rad_s);
            let mut solver = Solver::default();
            let metrics = solver
                .solve(&problem, REFERENCE_ACCURACY)
                .unwrap_or_else(|e| panic!("{name} {omega_rad_s}: {e}"));
            let near = |what: &str, found: f64, known: f64, absolute: f64| {
                let error = (found - known).abs();
                assert!(
                    error <= absolute.max(1e-6 * known.abs()),
                    "{name} at {omega_rad_s} rad/s: {what} = {found}, not {known}"
                );
            };
            near("d", metrics.d_m, number(known, "d_m"), 1e-8);
            near("dtheta", metrics.dtheta_rad, number(known, "dtheta_rad"), 1e-8);
            for (number, link) in numbers.into_iter().enumerate() {
                match known["sigma"][link].as_f64() {
                    Some(known) => near("sigma", metrics.sigma[number], known, 1e-8),
                    None => assert!(metrics.sigma[number].is_nan()),
                }
            }
            // The extremes of the derivation are those of some hundred samples, so that they fall short.
            for (joint, alpha) in known["alpha_rad"].as_array().unwrap().iter().enumerate() {
                let excess = metrics.alpha_rad[joint] / alpha.as_f64().unwrap() - 1.0;
                assert!((-1e-6..1e-4).contains(&excess), "{name} at {omega_rad_s} rad/s: {excess}");
            }
            assert!(solver.floquet().unwrap().is_none_or(|modulus| modulus < 1.0));
            let [work_j, loss_j] = solver.work_and_loss_j().unwrap();
            assert!((work_j / loss_j - 1.0).abs() < 1e-9, "{name}: {work_j} {loss_j}");
        }
    }
}

/// The transient from rest settles into the steady motion, and both are sampled alike.
#[test]
fn transients_of_chains_settle_into_the_steady_motion() {
    let text = include_str!("../fixtures/chains.json");
    let cases: BTreeMap<String, Value> = serde_json::from_str(text).unwrap();
    for name in ["four-one-spring", "four-no-skid-two-springs", "three-elastic"] {
        let case = &cases[name];
        let laws = if case["can_skid"] == true { Laws::SKID_ROLL } else { Laws::NO_SKID_ROLL };
        let problem = problem(chain(case), laws, 3.9);
        let steady = problem.cycle(REFERENCE_ACCURACY, 24).unwrap();
        let reached = problem.cycles_from_rest(40, 24).unwrap();
        for (steady, reached) in steady.iter().zip(&reached[39 * 24..]) {
            let pairs = [
                (steady.roll_m_s[0], reached.roll_m_s[0]),
                (steady.phi_rad[1], reached.phi_rad[1]),
                (steady.torque_nm[0], reached.torque_nm[0]),
                (steady.power_w, reached.power_w),
            ];
            for (steady, reached) in pairs {
                assert!((steady - reached).abs() < 1e-5, "{name}: {pairs:?}");
            }
        }
    }
}

/// Returns a random chain of the given number of links with joints, wheels, drags and rotors of every kind, whose
/// wheels, if they cannot skid, leave it one or two directions of motion.
fn random_chain(rng: &mut ChaCha8Rng, links: usize, can_skid: bool) -> Chain {
    let mut between = |low: f64, high: f64| {
        low + (high - low) * (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut made: Vec<Link> = (0..links)
        .map(|_| {
            let mass_kg = between(0.2, 1.0);
            Link {
                name: String::new(),
                front_joint_m: between(0.08, 0.14),
                rear_joint_m: between(0.08, 0.14),
                com_m: between(-0.03, 0.03),
                mass_kg,
                inertia_kg_m2: mass_kg * between(1e-3, 4e-3),
                wheel: Some(Wheel {
                    place_m: between(-0.02, 0.02),
                    steer_rad: between(-0.1, 0.1),
                    friction: WheelFriction {
                        skid_kg_s: between(40.0, 150.0),
                        roll_kg_s: between(0.2, 0.6),
                        skid_dry_n: between(0.5, 2.0),
                        skid_static_n: between(0.5, 2.0),
                        stribeck_m_s: 0.02,
                        skid_power_n: between(0.2, 1.0),
                        skid_exponent: between(0.6, 1.4),
                        roll_dry_n: between(0.01, 0.1),
                        transition_m_s: 0.01,
                    },
                }),
                drag: Drag {
                    along_kg_s: between(0.01, 0.2),
                    across_kg_s: between(0.01, 2.0),
                    turning_nm_s_rad: between(1e-4, 0.01),
                },
                rotor: (between(0.0, 1.0) < 0.15).then(|| Rotor {
                    inertia_kg_m2: 2e-4,
                    angle: JointCommand::new(0.0, between(0.5, 2.0), between(-3.0, 3.0)),
                }),
            }
        })
        .collect();
    let joints: Vec<Joint> = (1..links)
        .map(|joint| {
            let command =
                JointCommand::new(between(-0.2, 0.2), between(0.2, 0.5), between(-3.0, 3.0));
            let free = FreeJoint {
                stiffness_nm_rad: between(0.2, 0.6),
                damping_nm_s_rad: between(0.005, 0.02),
                target: JointCommand::new(between(-0.1, 0.1), 0.0, 0.0),
                torque: TorqueCommand::default(),
            };
            let torque = TorqueCommand {
                mean_nm: between(-0.01, 0.01),
                amplitude_nm: between(0.02, 0.08),
                phase_rad: between(-3.0, 3.0),
            };
            match (between(0.0, 4.0), joint) {
                (..1.0, 2..) => Joint::Free(free),
                (..2.0, 2..) => Joint::Free(FreeJoint { target: command, ..free }),
                (..3.0, 2..) => Joint::Free(FreeJoint { torque, ..free }),
                _ => Joint::Driven(command),
            }
        })
        .collect();
    let free = joints.iter().filter(|joint| matches!(joint, Joint::Free(_))).count();
    if !can_skid {
        // Wheels in a row of driven joints soon leave no motion.
        let removed = links.saturating_sub(1 + free);
        made.iter_mut().take(removed).for_each(|link| link.wheel = None);
    }
    Chain { links: made, joints, reference: (links - 1) / 2, skid_length_m: 0.11 }
}

const LAWS: [Laws; 6] = [
    Laws::SKID_ROLL,
    Laws::COULOMB,
    Laws::COULOMB_VISCOUS,
    Laws { skid: SkidLaw::StribeckViscous, roll: RollLaw::CoulombViscous },
    Laws { skid: SkidLaw::Power, roll: RollLaw::Viscous },
    Laws::NO_SKID_ROLL,
];

/// Returns a car of two links on wheels that cannot skid: a steering link, whose joint is `steer_m` behind its wheel,
/// and a body, whose joint is 0.3 m ahead of its wheel.
fn twistcar(steer_m: f64, com_m: f64, inertia_kg_m2: f64, joint: Joint) -> Chain {
    let wheel = Wheel {
        place_m: 0.0,
        steer_rad: 0.0,
        friction: WheelFriction { roll_kg_s: 0.3, ..Robot::kinematic().wheel_friction(0) },
    };
    let steering = Link {
        name: "steering".to_owned(),
        front_joint_m: 0.0,
        rear_joint_m: steer_m,
        com_m: 0.0,
        mass_kg: 0.3,
        inertia_kg_m2: 3e-4,
        wheel: Some(wheel),
        drag: Drag::default(),
        rotor: None,
    };
    let body = Link {
        name: "body".to_owned(),
        front_joint_m: 0.3,
        rear_joint_m: 0.0,
        com_m,
        mass_kg: 1.5,
        inertia_kg_m2,
        ..steering.clone()
    };
    Chain { links: vec![steering, body], joints: vec![joint], reference: 1, skid_length_m: 0.1 }
}

/// As R. Levy et al. found (arXiv 2506.19112, 2025) for a car whose steering is driven, with masses and lengths of our
/// own.
#[test]
fn the_twistcar_reverses_as_its_centre_of_mass_is_shifted() {
    let advance_m = |com_m: f64| {
        let joint = Joint::Driven(JointCommand::new(0.0, 0.5, 0.0));
        let chain = twistcar(0.1, com_m, 5e-4, joint);
        let problem = problem(chain, Laws::NO_SKID_ROLL, 4.0);
        problem.cycle(REFERENCE_ACCURACY, 8).unwrap().last().unwrap().pose.x_m
    };
    assert!(advance_m(-0.1) < -0.05);
    assert!(advance_m(0.05) > 0.005);
    assert!(advance_m(0.2) < -0.05);
}

/// As A. Zigelman et al. found (arXiv 2507.04846, 2025) for a car with a rotor on its body and a steering joint that is
/// free, with masses and lengths of our own: at low frequencies it moves straight, at higher ones in circles.
#[test]
fn a_rotor_breaks_the_symmetry_of_the_twistcar() {
    let reached = |omega_rad_s: f64| {
        let joint = Joint::Free(FreeJoint {
            stiffness_nm_rad: 0.05,
            damping_nm_s_rad: 0.002,
            ..FreeJoint::default()
        });
        let mut chain = twistcar(0.05, 0.1, 0.01, joint);
        chain.links[0].com_m = -0.05;
        let angle = JointCommand::new(0.0, 2.0, 0.0);
        chain.links[1].rotor = Some(Rotor { inertia_kg_m2: 0.01, angle });
        let problem = problem(chain, Laws::NO_SKID_ROLL, omega_rad_s);
        problem.settle(REFERENCE_ACCURACY).unwrap().motion
    };
    let slow = reached(5.0);
    assert!(!slow.is_symmetry_broken && slow.metrics.dtheta_rad.abs() < 1e-6, "{slow:?}");
    let fast = reached(8.0);
    assert!(fast.is_symmetry_broken && fast.metrics.dtheta_rad.abs() > 1.0, "{fast:?}");
    assert!([slow, fast].iter().all(|motion| motion.floquet.unwrap() < 1.0));
}

#[test]
fn the_work_of_two_hundred_random_chains_is_dissipated() {
    let mut rng = ChaCha8Rng::seed_from_u64(53);
    let mut solved = 0;
    for draw in 0..200 {
        let laws = LAWS[draw % LAWS.len()];
        let chain = random_chain(&mut rng, 2 + draw % 7, laws.skids());
        let problem = problem(chain, laws, 2.0 + 0.02 * draw as f64);
        let mut solver = Solver::default();
        let Ok(found) = solver.solve(&problem, FORCES_ACCURACY) else { continue };
        solved += 1;
        let [work_j, loss_j] = solver.work_and_loss_j().unwrap();
        let error = (work_j / loss_j - 1.0).abs();
        assert!(error < 1e-9, "{draw}: {error:e}\n{problem:?}\n{found:?}");
    }
    // Newton's method does not find every motion without skid.
    assert!(solved >= 195, "{solved}");
}

/// The step of the differences is so large that the errors of both motions do not matter.
#[test]
fn derivatives_by_every_number_agree_with_differences() {
    const ACCURACY: f64 = 1e-12;
    let mut rng = ChaCha8Rng::seed_from_u64(54);
    let mut compared = 0;
    for links in 2..=8 {
        for laws in [LAWS[links % 5], Laws::NO_SKID_ROLL] {
            let chain = random_chain(&mut rng, links, laws.skids());
            let numbers: Vec<ChainNumber> =
                chain.numbers().into_iter().skip(links).step_by(2 * links).collect();
            let last = chain.numbering().iter().position(|link| *link == links - 1).unwrap();
            let problem = problem(chain, laws, 3.0);
            let mut solver = Solver::default();
            let Ok(motion) = solver.solve(&problem, ACCURACY) else { continue };
            let slopes = solver.derivatives(&numbers).unwrap();
            for (number, slopes) in numbers.iter().zip(&slopes) {
                // Fewer sums over the links are evaluated if no other number needs them.
                let alone = solver.derivatives(&[*number]).unwrap()[0];
                let scale = slopes.metrics.d_m.abs().max(1e-3);
                let error = (alone.metrics.d_m - slopes.metrics.d_m).abs() / scale;
                assert!(error < 1e-9, "{links} links, {laws:?}, {number:?}: {error:e}");
                let value = problem.number(*number).unwrap();
                let step = 1e-4 * if value == 0.0 { 0.1 } else { value.abs() };
                let [low, high] = [-step, step].map(|step| {
                    let mut changed = problem.clone();
                    *changed.number_mut(*number).unwrap() = value + step;
                    let mut solver = Solver::default();
                    let metrics = solver.solve(&changed, ACCURACY)?;
                    Ok::<_, MotionError>((metrics, solver.loss_j()?))
                });
                let (Ok((low, low_j)), Ok((high, high_j))) = (low, high) else { continue };
                // Without skid, some of these chains have several motions, and either may be found.
                if (low.d_m - motion.d_m).abs().max((high.d_m - motion.d_m).abs()) > 0.01 {
                    continue;
                }
                let own = &slopes.metrics;
                let metrics = [
                    ("d", own.d_m, low.d_m, high.d_m),
                    ("dtheta", own.dtheta_rad, low.dtheta_rad, high.dtheta_rad),
                    ("sigma", own.sigma[last], low.sigma[last], high.sigma[last]),
                    ("alpha", own.alpha_rad[0], low.alpha_rad[0], high.alpha_rad[0]),
                    ("work", slopes.work_j, low_j, high_j),
                ];
                for (metric, found, low, high) in metrics {
                    let known = (high - low) / (2.0 * step);
                    let noise = 10.0 * ACCURACY * high.abs().max(0.1) / step;
                    let error = (found - known).abs();
                    assert!(
                        error <= 1e-6 * known.abs() + noise,
                        "{links} links, {laws:?}, {number:?}: d({metric}) = {found}, not {known}"
                    );
                    compared += 1;
                }
            }
        }
    }
    assert!(compared > 250, "{compared}");
}

#[test]
fn chains_without_a_steady_motion_are_named() {
    let driven = Joint::Driven(JointCommand::new(0.0, 0.4, 0.0));
    let car = twistcar(0.1, 0.1, 0.01, driven);
    let solve = |chain: Chain, laws: Laws| {
        let problem = problem(chain, laws, 3.0);
        problem.solve(REFERENCE_ACCURACY).map(|motion| motion.metrics.d_m)
    };
    let with = |change: &dyn Fn(&mut Chain)| {
        let mut chain = car.clone();
        change(&mut chain);
        chain
    };
    let no_wheels = with(&|chain| chain.links.iter_mut().for_each(|link| link.wheel = None));
    assert!(matches!(solve(no_wheels.clone(), Laws::SKID_ROLL), Err(MotionError::NotResisted)));
    // Without wheels there is nothing that cannot skid; drag alone resists.
    let mut dragged = no_wheels.clone();
    dragged.links[1].drag = Drag { along_kg_s: 0.1, across_kg_s: 2.0, turning_nm_s_rad: 0.01 };
    let [constrained, free] =
        [Laws::NO_SKID_ROLL, Laws::SKID_ROLL].map(|laws| solve(dragged.clone(), laws).unwrap());
    assert!((constrained - free).abs() < 1e-9, "{constrained} {free}");

    let still = with(&|chain| *chain.joints[0].command_mut() = JointCommand::default());
    assert!(matches!(solve(still, Laws::SKID_ROLL), Err(MotionError::NotDriven)));
    let heavy = with(&|chain| chain.links[0].mass_kg = f64::NAN);
    assert!(matches!(solve(heavy, Laws::SKID_ROLL), Err(MotionError::Chain(_))));

    // Each time the axles of three driven links meet in one point, velocities are unbounded unless the commands fit.
    let three = |offset_rad: f64| {
        let robot = Robot::kinematic().chain(&Gait::symmetric());
        let mut chain = robot.clone();
        chain.joints[0].command_mut().offset_rad = offset_rad;
        chain
    };
    assert!(solve(three(0.0), Laws::NO_SKID_ROLL).unwrap() > 0.1);
    assert!(matches!(solve(three(0.2), Laws::NO_SKID_ROLL), Err(MotionError::Singular { .. })));
    let mut five = three(0.0);
    five.links.extend([five.links[2].clone(), five.links[2].clone()]);
    five.joints.extend([driven, driven]);
    assert!(matches!(
        solve(five.clone(), Laws::NO_SKID_ROLL),
        Err(MotionError::Overconstrained { wheels: 5, velocities: 3 })
    ));
    // Wheels on driven joints alone have no motion, however many free links without wheels follow.
    let mut tail = five.links[2].clone();
    tail.wheel = None;
    five.links.extend([tail.clone(), tail]);
    let spring =
        FreeJoint { stiffness_nm_rad: 0.1, damping_nm_s_rad: 0.01, ..FreeJoint::default() };
    five.joints.extend([Joint::Free(spring), Joint::Free(spring)]);
    assert!(matches!(solve(five, Laws::NO_SKID_ROLL), Err(MotionError::Dependent)));
}
