//! Forces on a chain: wheel forces, joint torques and power.

use nalgebra::{DMatrix, DVector};
use trilink_robot::{FreeJoint, Friction, Joint, MAX_JOINTS, MAX_LINKS, Number, Pose, rotated};

use super::links::Motion;
use super::power::{EvaluatedMotion, Power, Resistance, Virtual};
use super::wave::{Wave, prescribed};
use super::{ChainProblem, number_of};
use crate::Sample;

/// Number of rows of the equations of motion: three of the reference link, and one for each joint.
const MAX_ROWS: usize = 3 + MAX_JOINTS;

/// Ratio of the smallest to the largest singular value below which the no-skid constraints count as
/// dependent.
const SINGULAR: f64 = 1e-6;
/// Maximum number of iterations of the singular value decomposition, which would not end for numbers that are not
/// finite.
const MAX_ITERATIONS: usize = 1000;

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
    fn new(problem: &ChainProblem, at: &EvaluatedMotion<T>) -> Self {
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
        let mut power = Power::new();
        let mut resistances = |resistance: Resistance| {
            power.evaluate(at, &still, resistance);
            rows(power.resistances(at))
        };
        let [supplied, dissipating] =
            [Resistance::All, Resistance::Dissipation].map(&mut resistances);
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
pub(super) fn power_and_loss_w<T: Number, F: Friction>(
    problem: &ChainProblem,
    motion: &Motion<T>,
) -> [T; 2] {
    let at = resisted::<_, F>(problem, motion);
    let Loads { power_w, loss_w, .. } = Loads::new(problem, &at);
    [power_w, loss_w]
}

/// Returns the sample of a motion at a time and pose of the reference link.
pub(super) fn sample<F: Friction>(
    problem: &ChainProblem,
    motion: &Motion<f64>,
    time_s: f64,
    pose: Pose,
) -> Sample {
    let ChainProblem { chain, laws, .. } = problem;
    let at = resisted::<_, F>(problem, motion);
    let Loads { supplied, own_torques, power_w, loss_w } = Loads::new(problem, &at);
    let joints = &motion.joints[..chain.joints.len()];
    let missing = vec![f64::NAN; chain.links.len()];
    let [u, v, turning_rad_s] = motion.body;
    let [x_rate_m_s, y_rate_m_s] = rotated(pose.theta_rad, [u, v]);
    let mut sample = Sample {
        time_s,
        pose,
        pose_rates: [x_rate_m_s, y_rate_m_s, turning_rad_s],
        phi_rad: joints.iter().map(|[angle, ..]| *angle).collect(),
        phi_rate_rad_s: joints.iter().map(|[_, rate, _]| *rate).collect(),
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
        let number = number_of(chain, link);
        sample.roll_m_s[number] = contact.roll_m_s;
        sample.skid_m_s[number] = contact.skid_m_s;
        sample.roll_n[number] = -contact.roll[0];
        sample.lateral_n[number] = -contact.skid[0];
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
        let forces = least_squares(columns, &right);
        for (i, (link, skid)) in wheels.iter().zip(&skid_rows).enumerate() {
            let force = forces.as_ref().map_or(f64::NAN, |forces| forces[i]);
            sample.lateral_n[number_of(chain, *link)] = force;
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

fn resisted<'a, T: Number, F: Friction>(
    problem: &'a ChainProblem,
    motion: &'a Motion<T>,
) -> EvaluatedMotion<'a, T> {
    let ChainProblem { chain, omega_rad_s, .. } = problem;
    EvaluatedMotion::new::<F>(chain, motion, *omega_rad_s, [T::splat(0.0); MAX_LINKS])
}

/// Returns the row whose product with the velocities of the reference link and the rates of the joints is the skid
/// velocity of a link's wheel.
fn skid_row(at: &EvaluatedMotion<f64>, link: usize, joints: usize) -> [f64; MAX_ROWS] {
    let mut virtual_motion = Virtual::none();
    virtual_motion.skid[link] = 1.0;
    let mut power = Power::new();
    power.evaluate(at, &virtual_motion, Resistance::All);
    let mut row = [0.0; MAX_ROWS];
    row[..3].copy_from_slice(&power.by_body(at));
    (0..joints).for_each(|joint| row[3 + joint] = power.by_joint(at, joint)[1]);
    row
}

fn rows<T: Number>((body, joints): ([T; 3], [T; MAX_JOINTS])) -> [T; MAX_ROWS] {
    std::array::from_fn(|row| if row < 3 { body[row] } else { joints[row - 3] })
}

/// Solves a linear system by least squares. `None` if its columns are dependent.
fn least_squares(columns: DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    let decomposed = columns.try_svd(true, true, 5.0 * f64::EPSILON, MAX_ITERATIONS)?;
    let singular = &decomposed.singular_values;
    if singular.min() <= SINGULAR * singular.max() {
        return None;
    }
    let solution = decomposed.solve(right, 0.0).ok()?;
    solution.iter().all(|force| force.is_finite()).then_some(solution)
}
