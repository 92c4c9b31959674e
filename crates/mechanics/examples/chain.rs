//! Motions of a snake of six links whose joints are all driven by a travelling wave, and of one of four links whose
//! last joint follows on a spring: displacement per cycle, and the time that a solution takes.

use std::time::Instant;

use trilink_mechanics::{Laws, MotionError, Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::{
    Chain, Drag, FreeJoint, Joint, JointCommand, Link, Robot, TorqueCommand, Wheel,
};

/// Number of frequencies, from 0.5 to 6 rad/s.
const FREQUENCIES: u32 = 12;

fn link() -> Link {
    Link {
        name: String::new(),
        front_joint_m: 0.11,
        rear_joint_m: 0.11,
        com_m: 0.0,
        mass_kg: 0.4,
        inertia_kg_m2: 2e-3,
        wheel: Some(Wheel {
            place_m: 0.0,
            steer_rad: 0.0,
            friction: Robot::kinematic().wheel_friction(1),
        }),
        drag: Drag::default(),
        rotor: None,
    }
}

fn snake(links: usize, joints: Vec<Joint>) -> Chain {
    let links = vec![link(); links];
    let skid_length_m = Chain::outer_length_m(&links);
    Chain { reference: (links.len() - 1) / 2, links, joints, skid_length_m }
}

fn main() -> Result<(), MotionError> {
    let wave = |joint: usize| Joint::Driven(JointCommand::new(0.0, 0.4, -1.2 * joint as f64));
    let spring = Joint::Free(FreeJoint {
        stiffness_nm_rad: 0.2,
        damping_nm_s_rad: 0.01,
        target: JointCommand::default(),
        torque: TorqueCommand::default(),
    });
    let chains = [
        ("six links, driven", snake(6, (0..5).map(wave).collect())),
        ("four links, one spring", snake(4, vec![wave(0), wave(1), spring])),
    ];
    for (name, chain) in chains {
        let start = Instant::now();
        for i in 1..=FREQUENCIES {
            let omega_rad_s = 0.5 * f64::from(i);
            let problem = Problem::new(chain.clone(), chain.gait(), Laws::SKID_ROLL, omega_rad_s);
            let metrics = Solver::default().solve(&problem, REFERENCE_ACCURACY)?;
            println!("{name}, {omega_rad_s} rad/s: d = {:.1} mm", 1e3 * metrics.d_m);
        }
        println!("{name}: {:?} a motion", start.elapsed() / FREQUENCIES);
    }
    Ok(())
}
