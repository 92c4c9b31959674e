//! Forces on a chain: wheel forces, joint torques and power.

use nalgebra::{DMatrix, DVector};
use trilink_robot::{Chain, Dry, FreeJoint, Friction, Joint, MAX_JOINTS, MAX_LINKS, Number, Pose};

use super::ChainProblem;
use super::balance::{System, WheelState};
use super::cluster::{Cluster, Clusters};
use super::wave::{Wave, prescribed};

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
pub(super) struct Motion<T> {
    pub phase_rad: T,
    /// Velocities of the reference link along and across itself and its turning rate, and their time derivatives.
    pub body: [T; 3],
    pub dbody: [T; 3],
    /// Angle, rate and acceleration of each joint from front to rear, followed by zeros.
    pub joints: [[T; 3]; MAX_JOINTS],
}

/// Maximum number of velocities: three of the reference link, and one for each joint.
const MAX_ROWS: usize = 3 + MAX_JOINTS;

/// Chain whose links all are clusters, so that the left-hand sides of its equations of motion are the torques at all
/// joints.
#[derive(Debug, Clone)]
pub(super) struct Loose {
    system: System,
    /// Commands of the joints from front to rear, or the angles at which their springs are relaxed.
    commands: Vec<Wave>,
    /// For each cluster, the moment of inertia of its link's rotor, kg m^2, and the rotor's angle.
    rotors: Vec<Option<(f64, Wave)>>,
}

/// Forces on a chain, by row of its equations of motion and by wheel from front to rear.
struct Forces<T> {
    /// Left-hand sides of the equations of motion.
    supplied: [T; MAX_ROWS],
    /// Torques of the springs, dampers and prescribed torques.
    own_torques: [T; MAX_ROWS],
    is_driven: [bool; MAX_ROWS],
    wheels: [WheelForces<T>; MAX_LINKS],
    power_w: T,
    loss_w: T,
}

#[derive(Clone, Copy)]
struct WheelForces<T> {
    /// Product with the velocities that is the skid velocity.
    skid_row: [T; MAX_ROWS],
    roll_m_s: T,
    skid_m_s: T,
    roll_n: T,
    skid_n: T,
}

impl Loose {
    pub(super) fn new(problem: &ChainProblem) -> Self {
        let ChainProblem { chain, laws, omega_rad_s } = problem;
        let joints = vec![Joint::Free(FreeJoint::default()); chain.joints.len()];
        let loose = Chain { joints, ..chain.clone() };
        let system = System::new(Clusters::new(&loose, *omega_rad_s, laws.are_linear()));
        let commands = chain.joints.iter().map(|joint| Wave::new(joint.command())).collect();
        let rotors = system.clusters.all.iter().map(Cluster::rotor).collect();
        Self { system, commands, rotors }
    }

    /// Returns the angle, rate and acceleration of a joint's command, or of that at which its spring is relaxed, given
    /// the sine and cosine of the phase.
    #[inline(always)]
    pub(super) fn command<T: Number>(&self, joint: usize, phase: [T; 2]) -> [T; 3] {
        self.commands[joint].at(phase, self.system.clusters.omega_rad_s)
    }

    /// Returns the power of the actuators and the power dissipated, W.
    pub(super) fn power_and_loss_w<T: Number>(
        &self,
        problem: &ChainProblem,
        motion: &Motion<T>,
    ) -> [T; 2] {
        let Forces { power_w, loss_w, .. } = self.forces(problem, motion, false);
        [power_w, loss_w]
    }

    /// Returns the forces; those on the wheels only if `with_wheels`.
    fn forces<T: Number>(
        &self,
        problem: &ChainProblem,
        motion: &Motion<T>,
        with_wheels: bool,
    ) -> Forces<T> {
        match problem.chain.links.len() {
            2 => self.forces_of::<T, 2, 4>(problem, motion, with_wheels),
            3 => self.forces_of::<T, 3, 5>(problem, motion, with_wheels),
            4 => self.forces_of::<T, 4, 6>(problem, motion, with_wheels),
            5 => self.forces_of::<T, 5, 7>(problem, motion, with_wheels),
            6 => self.forces_of::<T, 6, 8>(problem, motion, with_wheels),
            7 => self.forces_of::<T, 7, 9>(problem, motion, with_wheels),
            _ => self.forces_of::<T, 8, 10>(problem, motion, with_wheels),
        }
    }

    /// Returns the forces on a chain of `L` links.
    fn forces_of<T: Number, const L: usize, const D: usize>(
        &self,
        problem: &ChainProblem,
        motion: &Motion<T>,
        with_wheels: bool,
    ) -> Forces<T> {
        let ChainProblem { chain, laws, omega_rad_s } = problem;
        let Motion { phase_rad, body, dbody, joints } = motion;
        let (sin, cos) = phase_rad.sin_cos();
        let zero = T::splat(0.0);
        let system = &self.system;
        let node = system.node(*phase_rad);
        let joint_of = |c: usize| system.clusters.all[c].joint;
        let of_joints = |k: usize| -> [T; L] {
            std::array::from_fn(|c| if c == 0 { zero } else { joints[joint_of(c)][k] })
        };
        let posture = system.posture(&node.clusters, *body, of_joints(0), of_joints(1));
        let accelerations = of_joints(2);
        let acceleration: [T; D] =
            std::array::from_fn(|i| if i < 3 { dbody[i] } else { accelerations[i - 2] });
        let supplied = system.balance::<T, L, D, false>(&node, &posture, &acceleration).force;
        let no_wheel = WheelForces {
            skid_row: [zero; MAX_ROWS],
            roll_m_s: zero,
            skid_m_s: zero,
            roll_n: zero,
            skid_n: zero,
        };
        let mut forces = Forces {
            supplied: [zero; MAX_ROWS],
            own_torques: [zero; MAX_ROWS],
            is_driven: [false; MAX_ROWS],
            wheels: [no_wheel; MAX_LINKS],
            power_w: zero,
            loss_w: system.loss_w(&node, &posture),
        };
        forces.supplied[..D].copy_from_slice(&supplied);
        // Constraints do no work, so the driven joints supply what springs and torques do not.
        (0..3).for_each(|i| forces.power_w += supplied[i] * body[i]);
        for c in 1..L {
            let [angle, rate, _] = joints[joint_of(c)];
            let mut own_nm = zero;
            match &chain.joints[joint_of(c)] {
                Joint::Driven(_) => forces.is_driven[2 + c] = true,
                Joint::Free(FreeJoint { stiffness_nm_rad, damping_nm_s_rad, torque, .. }) => {
                    let [target_rad, target_rate, _] = self.command(joint_of(c), [sin, cos]);
                    let spring_nm = T::splat(*stiffness_nm_rad) * (target_rad - angle);
                    let prescribed_nm = prescribed(torque, *phase_rad);
                    let damping_nm = T::splat(*damping_nm_s_rad) * rate;
                    own_nm = spring_nm - damping_nm + prescribed_nm;
                    forces.power_w += spring_nm * target_rate + prescribed_nm * rate;
                    forces.loss_w += damping_nm * rate;
                }
            }
            forces.own_torques[2 + c] = own_nm;
            forces.power_w += (supplied[2 + c] - own_nm) * rate;
        }
        let wheels = if with_wheels { &system.wheels[..] } else { &[] };
        for (i, (cluster, _, friction)) in wheels.iter().enumerate() {
            let state = system.wheel(&posture, &node.wheels[i], *cluster);
            let own = &mut forces.wheels[i];
            let WheelState { roll_m_s, skid_m_s, .. } = state;
            let [roll_n, _] = Dry::roll(friction, roll_m_s);
            let [skid_n, _] = Dry::skid(friction, skid_m_s);
            *own = WheelForces { roll_m_s, skid_m_s, roll_n, skid_n, ..*own };
            if !laws.skids() {
                let row: [T; D] = system.skid_row(&posture, &state, *cluster);
                own.skid_row[..D].copy_from_slice(&row);
            }
        }
        for c in 0..L {
            if let Some((inertia_kg_m2, wave)) = &self.rotors[c] {
                let [_, rate, relative] = wave.at([sin, cos], *omega_rad_s);
                let mut acceleration = dbody[2] + relative;
                for b in (1..L).filter(|b| system.is_beyond(*b, c)) {
                    acceleration += T::splat(system.clusters.all[b].sign) * accelerations[b];
                }
                forces.power_w += T::splat(*inertia_kg_m2) * acceleration * rate;
            }
        }
        forces
    }

    /// Returns the sample of a motion, without its time and pose.
    pub(super) fn sample(&self, problem: &ChainProblem, motion: &Motion<f64>) -> ChainSample {
        let ChainProblem { chain, laws, .. } = problem;
        let Forces { supplied, own_torques, is_driven, wheels, power_w, loss_w } =
            self.forces(problem, motion, true);
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
