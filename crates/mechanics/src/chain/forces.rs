//! Forces on a chain: wheel forces, joint torques and power.

use nalgebra::{DMatrix, DVector};
use trilink_robot::{Chain, Dry, FreeJoint, Friction, Joint, Pose};

use super::ChainProblem;
use super::balance::System;
use super::cluster::Clusters;

/// State of a chain and the forces on it at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainSample {
    pub time_s: f64,
    /// Pose of the reference link; the motion starts at the origin, heading along x.
    pub pose: Pose,
    /// Joint angles from front to rear, rad.
    pub phi_rad: Vec<f64>,
    /// Joint rates from front to rear, rad/s.
    pub phi_rate_rad_s: Vec<f64>,
    /// Velocities of the reference link along and across itself, m/s, and its turning rate, rad/s.
    pub body: [f64; 3],
    /// Roll velocities of the wheels, by link from front to rear, m/s; NaN for a link without a wheel.
    pub roll_m_s: Vec<f64>,
    /// Skid velocities of the wheels, by link from front to rear, m/s; NaN for a link without a wheel.
    pub skid_m_s: Vec<f64>,
    /// Lateral contact forces on the wheels, by link from front to rear, N: the constraint forces (eq. 8 of the paper)
    /// where the wheels cannot skid, otherwise friction. NaN for a link without a wheel or where they are unbounded.
    pub lateral_n: Vec<f64>,
    /// Rolling friction forces on the wheels, by link from front to rear, N; NaN for a link without a wheel.
    pub roll_n: Vec<f64>,
    /// Torques at the joints from front to rear, N m: of the actuator, or of the spring, the damper and the prescribed
    /// torque of a free joint.
    pub torque_nm: Vec<f64>,
    /// Power of the actuators of all joints and rotors, W.
    pub power_w: f64,
    /// Power dissipated at the wheels, by drag and in the joints, W.
    pub loss_w: f64,
}

/// Motion of a chain at one time.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    pub phase_rad: f64,
    /// Velocities of the reference link along and across itself and its turning rate, and their time derivatives.
    pub body: [f64; 3],
    pub dbody: [f64; 3],
    /// Angle, rate and acceleration of each joint from front to rear.
    pub joints: Vec<[f64; 3]>,
}

impl Motion {
    /// Returns the sample of the motion.
    pub(super) fn sample(&self, problem: &ChainProblem, time_s: f64, pose: Pose) -> ChainSample {
        let links = problem.chain.links.len();
        let mut sample = match links {
            2 => self.forces::<2, 4>(problem),
            3 => self.forces::<3, 5>(problem),
            4 => self.forces::<4, 6>(problem),
            5 => self.forces::<5, 7>(problem),
            6 => self.forces::<6, 8>(problem),
            7 => self.forces::<7, 9>(problem),
            _ => self.forces::<8, 10>(problem),
        };
        sample.time_s = time_s;
        sample.pose = pose;
        sample
    }

    /// Returns the sample of a chain of `L` links, without its time and pose. Every link is a cluster here, so that the
    /// left-hand sides of the equations of motion are the torques at all joints.
    fn forces<const L: usize, const D: usize>(&self, problem: &ChainProblem) -> ChainSample {
        let ChainProblem { chain, laws, omega_rad_s } = problem;
        let loose = Chain {
            joints: vec![Joint::Free(FreeJoint::default()); chain.joints.len()],
            ..chain.clone()
        };
        let system: System<L> = System::new(Clusters::new(loose, *omega_rad_s, false));
        let node = system.node(self.phase_rad);
        let joint_of = |c: usize| system.clusters.all[c].joint;
        let of_joints = |k: usize| -> [f64; L] {
            std::array::from_fn(|c| if c == 0 { 0.0 } else { self.joints[joint_of(c)][k] })
        };
        let posture = system.posture(&node.clusters, self.body, of_joints(0), of_joints(1));
        let accelerations = of_joints(2);
        let acceleration: [f64; D] =
            std::array::from_fn(|i| if i < 3 { self.dbody[i] } else { accelerations[i - 2] });
        let supplied = system.balance::<f64, D>(&node, &posture, &acceleration).force;

        let mut torque_nm = vec![0.0; chain.joints.len()];
        let mut power_w = 0.0;
        let mut loss_w = 0.0;
        // Torques of the springs, dampers and prescribed torques, by row.
        let mut own_torques = [0.0; D];
        let mut is_driven = [false; D];
        for c in 1..L {
            let joint = joint_of(c);
            let [angle, rate, _] = self.joints[joint];
            match chain.joints[joint] {
                Joint::Driven(_) => is_driven[2 + c] = true,
                Joint::Free(FreeJoint { stiffness_nm_rad, damping_nm_s_rad, target, torque }) => {
                    let stretched = target.derivative(0, self.phase_rad) - angle;
                    let spring_nm = stiffness_nm_rad * stretched;
                    let prescribed_nm = torque.at(self.phase_rad);
                    let torque = spring_nm - damping_nm_s_rad * rate + prescribed_nm;
                    let target_rate = omega_rad_s * target.derivative(1, self.phase_rad);
                    power_w += spring_nm * target_rate + prescribed_nm * rate;
                    loss_w += damping_nm_s_rad * rate * rate;
                    torque_nm[joint] = torque;
                    own_torques[2 + c] = torque;
                }
            }
        }
        let count = system.wheels.len();
        let states: Vec<_> = (system.wheels.iter().zip(&node.wheels))
            .map(|((cluster, _), wheel)| system.wheel(&posture, wheel, *cluster))
            .collect();
        let rows: Vec<[f64; D]> = (states.iter().zip(&system.wheels))
            .map(|(state, (cluster, _))| system.skid_row(&posture, state, *cluster))
            .collect();
        let mut lateral = vec![0.0; count];
        if !laws.skids() {
            // Rows without an actuator; the others stay zero.
            let free = (0..D).filter(|row| !is_driven[*row]);
            let mut columns = DMatrix::<f64>::zeros(D, count);
            let mut right = DVector::<f64>::zeros(D);
            for row in free {
                right[row] = supplied[row] - own_torques[row];
                (0..count).for_each(|i| columns[(row, i)] = rows[i][row]);
            }
            lateral = crate::forces::least_squares(columns, &right)
                .map_or(vec![f64::NAN; count], |forces| forces.as_slice().to_vec());
        }
        for c in (1..L).filter(|c| is_driven[2 + c]) {
            let constraints = (0..count).map(|i| rows[i][2 + c] * lateral[i]);
            torque_nm[joint_of(c)] = supplied[2 + c] - constraints.sum::<f64>();
        }
        // Constraints do no work, so the driven joints supply what is left, even where constraint forces are unbounded.
        let [u, v, turning] = self.body;
        let of_body = supplied[0] * u + supplied[1] * v + supplied[2] * turning;
        let of_joints = (1..L).map(|c| {
            let [_, rate, _] = self.joints[joint_of(c)];
            (supplied[2 + c] - own_torques[2 + c]) * rate
        });
        power_w += if lateral.iter().all(|force| force.is_finite()) {
            (1..L)
                .filter(|c| is_driven[2 + c])
                .map(|c| {
                    let joint = joint_of(c);
                    torque_nm[joint] * self.joints[joint][1]
                })
                .sum::<f64>()
        } else {
            of_body + of_joints.sum::<f64>()
        };
        let missing = vec![f64::NAN; chain.links.len()];
        let mut sample = ChainSample {
            time_s: 0.0,
            pose: Pose::default(),
            phi_rad: self.joints.iter().map(|[angle, ..]| *angle).collect(),
            phi_rate_rad_s: self.joints.iter().map(|[_, rate, _]| *rate).collect(),
            body: self.body,
            roll_m_s: missing.clone(),
            skid_m_s: missing.clone(),
            lateral_n: missing.clone(),
            roll_n: missing,
            torque_nm,
            power_w: 0.0,
            loss_w: 0.0,
        };
        for (i, state) in states.iter().enumerate() {
            let link = system.clusters.link_of_wheel(i);
            let (_, friction) = &system.wheels[i];
            let [skid_n, _] = Dry::skid(friction, state.skid_m_s);
            let [roll_n, _] = Dry::roll(friction, state.roll_m_s);
            sample.roll_m_s[link] = state.roll_m_s;
            sample.skid_m_s[link] = state.skid_m_s;
            sample.roll_n[link] = -roll_n;
            sample.lateral_n[link] = if laws.skids() { -skid_n } else { lateral[i] };
            loss_w += roll_n * state.roll_m_s + skid_n * state.skid_m_s;
        }
        for c in 0..L {
            let link = system.clusters.all[c].root();
            loss_w += system.drag_loss_w(c, &node, &posture);
            if let Some(rotor) = &chain.links[link].rotor {
                let rate = omega_rad_s * rotor.angle.derivative(1, self.phase_rad);
                let relative = omega_rad_s.powi(2) * rotor.angle.derivative(2, self.phase_rad);
                let turning = (1..L)
                    .filter(|joint| system.is_beyond(*joint, c))
                    .map(|joint| system.clusters.all[joint].sign * accelerations[joint])
                    .sum::<f64>();
                power_w += rotor.inertia_kg_m2 * (self.dbody[2] + turning + relative) * rate;
            }
        }
        sample.power_w = power_w;
        sample.loss_w = loss_w;
        sample
    }
}
