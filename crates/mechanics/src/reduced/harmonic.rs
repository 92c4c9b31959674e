//! Small-angle motion of a robot with one passive joint, by harmonic balance with one harmonic: the initial
//! guess for Newton's method.

use nalgebra::Complex;

use crate::Problem;
use crate::radau::bisect;

/// Steady-state motion of a robot with one passive joint on no-skid wheels, to first order in the joint
/// angles. The robot travels in the direction in which the passive link trails behind the others.
pub(super) struct HarmonicMotion {
    pub speed_m_s: f64,
    omega_rad_s: f64,
    /// Phasor of the passive joint's angle relative to its rest angle.
    phi_rad: Complex<f64>,
    /// Phasor of the turning rate of link 0.
    turning_rad_s: Complex<f64>,
}

/// Returns 1 for joint 1 (index 0) and -1 for joint 2 (index 1): the sign with which the joint's rate enters
/// the no-skid constraint of its side link.
pub(super) fn joint_sign(joint: usize) -> f64 {
    if joint == 0 { 1.0 } else { -1.0 }
}

impl HarmonicMotion {
    /// Finds the steady-state motion by a search for the speed at which the mean force returned by
    /// [`HarmonicMotion::at_speed`] vanishes; `passive` is the index of the passive joint. Returns `None` if no such
    /// speed is found.
    pub(super) fn find(problem: &Problem, passive: usize) -> Option<Self> {
        const DOUBLINGS: usize = 8;
        const BISECTIONS: usize = 10;
        let Problem { robot, gait, omega_rad_s, .. } = problem;
        let command = gait.joints[1 - passive]?;
        let wave = Complex::from_polar(command.amplitude_rad, command.phase_rad);
        let force = |speed_m_s| Self::at_speed(problem, passive, wave, speed_m_s).1;
        let is_forward = force(0.0) > 0.0;
        let mut speed_m_s = -joint_sign(passive) * omega_rad_s * robot.l_m[passive];
        for _ in 0..DOUBLINGS {
            if (force(speed_m_s) > 0.0) != is_forward {
                let speed_m_s = bisect(force, 0.0, speed_m_s, BISECTIONS);
                return Some(Self::at_speed(problem, passive, wave, speed_m_s).0);
            }
            speed_m_s *= 2.0;
        }
        None
    }

    /// Returns the motion at a given speed, and a mean force over a cycle (N) that vanishes in the steady state: the
    /// projection of the equations of motion (eq. 7 of the paper) on the motion that the no-skid constraints allow, to
    /// second order in the angles. `p` is the passive joint's index, `wave` the phasor of the other joint's angle.
    fn at_speed(problem: &Problem, p: usize, wave: Complex<f64>, speed_m_s: f64) -> (Self, f64) {
        let Problem { robot, omega_rad_s, .. } = problem;
        let a = 1 - p;
        let l = robot.l_m;
        let reach_m = robot.reach_m();
        let rate = Complex::new(0.0, *omega_rad_s);
        let mean = |x: Complex<f64>, y: Complex<f64>| 0.5 * (x * y.conj()).re;
        // No-skid constraints of the side links' wheels.
        let trailing = joint_sign(p) * speed_m_s;
        let mut phi = [wave; 2];
        let of_passive = wave * (reach_m[p] / reach_m[a]);
        phi[p] = of_passive * (rate * l[a] + trailing) / (-rate * l[p] + trailing);
        let turning = wave * (rate * (joint_sign(a) * l[a]) - speed_m_s) / reach_m[a];
        let dturning = rate * turning;

        let mut along = robot.roll_kg_s.iter().sum::<f64>() * speed_m_s;
        let mut torque = dturning * robot.inertia_kg_m2[0];
        let mut joint_torque = phi[p] * (rate * robot.damping_nm_s_rad + robot.stiffness_nm_rad);
        for joint in 0..2 {
            let sign = joint_sign(joint);
            let mass = robot.mass_kg[1 + joint];
            let h = robot.h_m[joint];
            let b = robot.b_m[joint];
            let link_turning = turning - rate * phi[joint] * sign;
            let dlink_turning = rate * link_turning;
            let spin = dlink_turning * robot.inertia_kg_m2[1 + joint];
            let across = (turning * speed_m_s + (dturning * h + dlink_turning * b) * sign) * mass;
            let centripetal = h * mean(turning, turning) + b * mean(link_turning, link_turning);
            along += mass * (b * mean(dlink_turning, phi[joint]) - sign * centripetal);
            torque += across * (sign * (h + b)) + spin;
            if joint == p {
                joint_torque -= across * b + spin * sign;
            }
        }
        let null = (phi[p] - of_passive) * (joint_sign(p) / l[p]);
        let force = along - mean(wave, torque) / reach_m[a] + mean(null, joint_torque);
        let omega_rad_s = *omega_rad_s;
        let phi_rad = phi[p];
        let turning_rad_s = turning;
        (Self { speed_m_s, omega_rad_s, phi_rad, turning_rad_s }, force)
    }

    /// Returns the passive joint's angle relative to its rest angle (rad), its rate (rad/s) and the turning
    /// rate of link 0 (rad/s) at a phase.
    pub(super) fn at(&self, phase_rad: f64) -> [f64; 3] {
        let wave = Complex::cis(phase_rad);
        let [phi, turning] = [self.phi_rad, self.turning_rad_s].map(|phasor| phasor * wave);
        [phi.re, -self.omega_rad_s * phi.im, turning.re]
    }
}
