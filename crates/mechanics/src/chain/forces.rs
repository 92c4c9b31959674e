//! Forces on a chain: wheel forces, joint torques and power.

use nalgebra::{DMatrix, DVector};
use trilink_robot::{FreeJoint, Friction, Joint, MAX_JOINTS, MAX_LINKS, Number, Pose};

use super::ChainProblem;
use super::links::Motion;
use super::power::{Power, Resistance, Resisted, Virtual};
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

/// Number of rows of the equations of motion: three of the reference link, and one for each joint.
const MAX_ROWS: usize = 3 + MAX_JOINTS;

/// Loads on the actuators of a chain in motion.
struct Loads<T> {
    /// Resistances conjugate to the velocities of the reference link and to the rates of the joints from front to rear.
    supplied: [T; MAX_ROWS],
    /// Torques of the springs, dampers and prescribed torques at the joints; zero at a driven joint.
    own_torques: [T; MAX_JOINTS],
    power_w: T,
    loss_w: T,
}

impl<T: Number> Loads<T> {
    fn new(problem: &ChainProblem, at: &Resisted<T>) -> Self {
        let ChainProblem { chain, omega_rad_s, .. } = problem;
        let Motion { phase_rad, body, joints, .. } = at.motion();
        let zero = T::splat(0.0);
        let (sin, cos) = phase_rad.sin_cos();
        let rates: [T; MAX_ROWS] =
            std::array::from_fn(|row| if row < 3 { body[row] } else { joints[row - 3][1] });
        let work_of = |resistances: &[T; MAX_ROWS]| {
            (0..MAX_ROWS).fold(zero, |sum, row| sum + resistances[row] * rates[row])
        };
        let still = Virtual::none();
        let supplied = rows(at.power(&still, Resistance::All).resistances());
        let dissipating = rows(at.power(&still, Resistance::Dissipation).resistances());
        let mut loads = Self {
            supplied,
            own_torques: [zero; MAX_JOINTS],
            power_w: work_of(&supplied),
            loss_w: work_of(&dissipating),
        };
        // Constraints do no work, so the actuators supply what springs and dampers do not.
        for (j, joint) in chain.joints.iter().enumerate() {
            let Joint::Free(FreeJoint { stiffness_nm_rad, damping_nm_s_rad, target, torque }) =
                joint
            else {
                continue;
            };
            let [angle, rate, _] = joints[j];
            let [target_rad, target_rate, _] = Wave::new(target).at([sin, cos], *omega_rad_s);
            let spring_nm = T::splat(*stiffness_nm_rad) * (target_rad - angle);
            let damping_nm = T::splat(*damping_nm_s_rad) * rate;
            let prescribed_nm = prescribed(torque, *phase_rad);
            loads.own_torques[j] = spring_nm - damping_nm + prescribed_nm;
            loads.power_w += spring_nm * (target_rate - rate) + damping_nm * rate;
            loads.loss_w += damping_nm * rate;
        }
        for (i, link) in chain.links.iter().enumerate() {
            if let Some(rotor) = &link.rotor {
                let [_, rate, acceleration] = Wave::new(&rotor.angle).at([sin, cos], *omega_rad_s);
                let total = at.turning_acceleration(i) + acceleration;
                loads.power_w += T::splat(rotor.inertia_kg_m2) * total * rate;
            }
        }
        loads
    }
}

/// Returns the power of the actuators and the power dissipated, W.
pub(super) fn power_and_loss_w<T: Number, F: Friction>(problem: &ChainProblem, motion: &Motion<T>) -> [T; 2] {
    let at = resisted::<_, F>(problem, motion);
    let Loads { power_w, loss_w, .. } = Loads::new(problem, &at);
    [power_w, loss_w]
}

/// Returns the sample of a motion, without its time and pose.
pub(super) fn sample<F: Friction>(problem: &ChainProblem, motion: &Motion<f64>) -> ChainSample {
    let ChainProblem { chain, laws, .. } = problem;
    let at = resisted::<_, F>(problem, motion);
    let Loads { supplied, own_torques, power_w, loss_w } = Loads::new(problem, &at);
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
        torque_nm: own_torques[..joints.len()].to_vec(),
        power_w,
        loss_w,
    };
    let mut wheels = Vec::with_capacity(MAX_LINKS);
    for link in 0..chain.links.len() {
        let Some(contact) = at.contact(link) else { continue };
        wheels.push(link);
        sample.roll_m_s[link] = contact.roll_m_s;
        sample.skid_m_s[link] = contact.skid_m_s;
        sample.roll_n[link] = -contact.roll[0];
        sample.lateral_n[link] = -contact.skid[0];
    }
    // Torques that keep wheels from skidding, by row.
    let mut of_wheels = [0.0; MAX_ROWS];
    if !laws.skids() && !wheels.is_empty() {
        let skid_rows: Vec<[f64; MAX_ROWS]> =
            wheels.iter().map(|link| skid_row(&at, *link, joints.len())).collect();
        let mut columns = DMatrix::<f64>::zeros(MAX_ROWS, wheels.len());
        let mut right = DVector::<f64>::zeros(MAX_ROWS);
        // Rows without an actuator; the others stay zero.
        for row in 0..3 + joints.len() {
            let joint = row.checked_sub(3);
            if joint.is_some_and(|joint| matches!(chain.joints[joint], Joint::Driven(_))) {
                continue;
            }
            right[row] = supplied[row] - joint.map_or(0.0, |joint| own_torques[joint]);
            skid_rows.iter().enumerate().for_each(|(i, skid)| columns[(row, i)] = skid[row]);
        }
        let forces = crate::forces::least_squares(columns, &right);
        for (i, (link, skid)) in wheels.iter().zip(&skid_rows).enumerate() {
            let force = forces.as_ref().map_or(f64::NAN, |forces| forces[i]);
            sample.lateral_n[*link] = force;
            of_wheels.iter_mut().zip(skid).for_each(|(sum, entry)| *sum += entry * force);
        }
    }
    for (j, joint) in chain.joints.iter().enumerate() {
        if matches!(joint, Joint::Driven(_)) {
            sample.torque_nm[j] = supplied[3 + j] - of_wheels[3 + j];
        }
    }
    sample
}

fn resisted<'a, T: Number, F: Friction>(problem: &'a ChainProblem, motion: &'a Motion<T>) -> Resisted<'a, T> {
    let ChainProblem { chain, omega_rad_s, .. } = problem;
    Resisted::new::<F>(chain, motion, *omega_rad_s, [T::splat(0.0); MAX_LINKS])
}

/// Returns the row whose product with the velocities of the reference link and the rates of the joints is the skid
/// velocity of a link's wheel.
fn skid_row(at: &Resisted<f64>, link: usize, joints: usize) -> [f64; MAX_ROWS] {
    let mut along = Virtual::none();
    along.skid[link] = 1.0;
    let power: Power<f64> = at.power(&along, Resistance::All);
    let mut row = [0.0; MAX_ROWS];
    row[..3].copy_from_slice(&power.by_body());
    (0..joints).for_each(|joint| row[3 + joint] = power.by_joint(joint)[1]);
    row
}

fn rows<T: Number>((body, joints): ([T; 3], [T; MAX_JOINTS])) -> [T; MAX_ROWS] {
    std::array::from_fn(|row| if row < 3 { body[row] } else { joints[row - 3] })
}
