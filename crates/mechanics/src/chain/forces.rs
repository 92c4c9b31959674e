//! Forces on a chain: wheel forces, joint torques and power.

use nalgebra::{DMatrix, DVector};
use trilink_robot::{Chain, Dry, FreeJoint, Friction, Joint, MAX_JOINTS, MAX_LINKS, Pose};

use super::ChainProblem;
use super::balance::{System, WheelState};
use super::cluster::{Clusters, waves};

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
    /// Angle, rate and acceleration of each joint from front to rear, followed by zeros.
    pub joints: [[f64; 3]; MAX_JOINTS],
}

/// Maximum number of velocities: three of the reference link, and one for each joint.
const MAX_ROWS: usize = 3 + MAX_JOINTS;

/// Chain whose links all are clusters, so that the left-hand sides of its equations of motion are the torques at all
/// joints.
#[derive(Debug, Clone)]
pub(super) struct Loose {
    system: System,
}

/// Forces on a chain, by row of its equations of motion and by wheel from front to rear.
struct Forces {
    /// Left-hand sides of the equations of motion.
    supplied: [f64; MAX_ROWS],
    /// Torques of the springs, dampers and prescribed torques.
    own_torques: [f64; MAX_ROWS],
    is_driven: [bool; MAX_ROWS],
    wheels: [WheelForces; MAX_LINKS],
    power_w: f64,
    loss_w: f64,
}

#[derive(Clone, Copy, Default)]
struct WheelForces {
    /// Product with the velocities that is the skid velocity.
    skid_row: [f64; MAX_ROWS],
    roll_m_s: f64,
    skid_m_s: f64,
    roll_n: f64,
    skid_n: f64,
}

impl Loose {
    pub(super) fn new(problem: &ChainProblem) -> Self {
        let ChainProblem { chain, omega_rad_s, .. } = problem;
        let joints = vec![Joint::Free(FreeJoint::default()); chain.joints.len()];
        let loose = Chain { joints, ..chain.clone() };
        Self { system: System::new(Clusters::new(&loose, *omega_rad_s, false)) }
    }

    /// Returns the power of the actuators and the power dissipated, W.
    pub(super) fn power_and_loss_w(&self, problem: &ChainProblem, motion: &Motion) -> [f64; 2] {
        let Forces { power_w, loss_w, .. } = self.forces(problem, motion);
        [power_w, loss_w]
    }

    fn forces(&self, problem: &ChainProblem, motion: &Motion) -> Forces {
        match problem.chain.links.len() {
            2 => self.forces_of::<2, 4>(problem, motion),
            3 => self.forces_of::<3, 5>(problem, motion),
            4 => self.forces_of::<4, 6>(problem, motion),
            5 => self.forces_of::<5, 7>(problem, motion),
            6 => self.forces_of::<6, 8>(problem, motion),
            7 => self.forces_of::<7, 9>(problem, motion),
            _ => self.forces_of::<8, 10>(problem, motion),
        }
    }

    /// Returns the forces on a chain of `L` links.
    fn forces_of<const L: usize, const D: usize>(
        &self,
        problem: &ChainProblem,
        motion: &Motion,
    ) -> Forces {
        let ChainProblem { chain, laws, omega_rad_s } = problem;
        let Motion { phase_rad, body, dbody, joints } = motion;
        let system = &self.system;
        let node = system.node(*phase_rad);
        let joint_of = |c: usize| system.clusters.all[c].joint;
        let of_joints = |k: usize| -> [f64; L] {
            std::array::from_fn(|c| if c == 0 { 0.0 } else { joints[joint_of(c)][k] })
        };
        let posture = system.posture(&node.clusters, *body, of_joints(0), of_joints(1));
        let accelerations = of_joints(2);
        let acceleration: [f64; D] =
            std::array::from_fn(|i| if i < 3 { dbody[i] } else { accelerations[i - 2] });
        let supplied = system.balance::<f64, L, D, false>(&node, &posture, &acceleration).force;
        let mut forces = Forces {
            supplied: [0.0; MAX_ROWS],
            own_torques: [0.0; MAX_ROWS],
            is_driven: [false; MAX_ROWS],
            wheels: [WheelForces::default(); MAX_LINKS],
            power_w: 0.0,
            loss_w: system.loss_w(&node, &posture),
        };
        forces.supplied[..D].copy_from_slice(&supplied);
        // Constraints do no work, so the driven joints supply what springs and torques do not.
        forces.power_w = (0..3).map(|i| supplied[i] * body[i]).sum();
        for c in 1..L {
            let [angle, rate, _] = joints[joint_of(c)];
            let mut own_nm = 0.0;
            match &chain.joints[joint_of(c)] {
                Joint::Driven(_) => forces.is_driven[2 + c] = true,
                Joint::Free(FreeJoint { stiffness_nm_rad, damping_nm_s_rad, target, torque }) => {
                    let [target_rad, target_rate, _] = waves(target, *phase_rad, *omega_rad_s);
                    let spring_nm = stiffness_nm_rad * (target_rad - angle);
                    let prescribed_nm = torque.at(*phase_rad);
                    own_nm = spring_nm - damping_nm_s_rad * rate + prescribed_nm;
                    forces.power_w += spring_nm * target_rate + prescribed_nm * rate;
                    forces.loss_w += damping_nm_s_rad * rate * rate;
                }
            }
            forces.own_torques[2 + c] = own_nm;
            forces.power_w += (supplied[2 + c] - own_nm) * rate;
        }
        for (i, (cluster, _, friction)) in system.wheels.iter().enumerate() {
            let state = system.wheel(&posture, &node.wheels[i], *cluster);
            let own = &mut forces.wheels[i];
            let WheelState { roll_m_s, skid_m_s, .. } = state;
            let [roll_n, _] = Dry::roll(friction, roll_m_s);
            let [skid_n, _] = Dry::skid(friction, skid_m_s);
            *own = WheelForces { roll_m_s, skid_m_s, roll_n, skid_n, ..*own };
            if !laws.skids() {
                let row: [f64; D] = system.skid_row(&posture, &state, *cluster);
                own.skid_row[..D].copy_from_slice(&row);
            }
        }
        for c in 0..L {
            let link = &chain.links[system.clusters.all[c].root()];
            if let Some(rotor) = &link.rotor {
                let [_, rate, relative] = waves(&rotor.angle, *phase_rad, *omega_rad_s);
                let turning = (1..L)
                    .filter(|b| system.is_beyond(*b, c))
                    .map(|b| system.clusters.all[b].sign * accelerations[b])
                    .sum::<f64>();
                forces.power_w += rotor.inertia_kg_m2 * (dbody[2] + turning + relative) * rate;
            }
        }
        forces
    }

    /// Returns the sample of a motion, without its time and pose.
    pub(super) fn sample(&self, problem: &ChainProblem, motion: &Motion) -> ChainSample {
        let ChainProblem { chain, laws, .. } = problem;
        let Forces { supplied, own_torques, is_driven, wheels, power_w, loss_w } =
            self.forces(problem, motion);
        let wheels = &wheels[..self.system.wheels.len()];
        let rows = chain.joints.len() + 3;
        let mut lateral: Vec<f64> = wheels.iter().map(|wheel| -wheel.skid_n).collect();
        if !laws.skids() && !wheels.is_empty() {
            // Rows without an actuator; the others stay zero.
            let mut columns = DMatrix::<f64>::zeros(rows, wheels.len());
            let mut right = DVector::<f64>::zeros(rows);
            for row in (0..rows).filter(|row| !is_driven[*row]) {
                right[row] = supplied[row] - own_torques[row];
                for (i, wheel) in wheels.iter().enumerate() {
                    columns[(row, i)] = wheel.skid_row[row];
                }
            }
            lateral = crate::forces::least_squares(columns, &right)
                .map_or(vec![f64::NAN; wheels.len()], |forces| forces.as_slice().to_vec());
        }
        let mut torque_nm = vec![0.0; chain.joints.len()];
        for (c, cluster) in self.system.clusters.all.iter().enumerate().skip(1) {
            let row = 2 + c;
            torque_nm[cluster.joint] = if is_driven[row] && laws.skids() {
                supplied[row]
            } else if is_driven[row] {
                let of_wheels = wheels.iter().zip(&lateral);
                supplied[row] - of_wheels.map(|(one, force)| one.skid_row[row] * force).sum::<f64>()
            } else {
                own_torques[row]
            };
        }
        let joints = &motion.joints[..chain.joints.len()];
        let missing = vec![f64::NAN; chain.links.len()];
        let mut sample = ChainSample {
            time_s: 0.0,
            pose: Pose::default(),
            phi_rad: joints.iter().map(|[angle, ..]| *angle).collect(),
            phi_rate_rad_s: joints.iter().map(|[_, rate, _]| *rate).collect(),
            body: motion.body,
            roll_m_s: missing.clone(),
            skid_m_s: missing.clone(),
            lateral_n: missing.clone(),
            roll_n: missing,
            torque_nm,
            power_w,
            loss_w,
        };
        for (i, (wheel, (_, link, _))) in wheels.iter().zip(&self.system.wheels).enumerate() {
            sample.roll_m_s[*link] = wheel.roll_m_s;
            sample.skid_m_s[*link] = wheel.skid_m_s;
            sample.roll_n[*link] = -wheel.roll_n;
            sample.lateral_n[*link] = lateral[i];
        }
        sample
    }
}
