//! The motion of a robot with one joint on its spring where angles are small: harmonic balance in
//! one harmonic, from which Newton's method starts.

use nalgebra::Complex;

use crate::Problem;
use crate::radau::bisect;

/// A steady motion to first order in the angles, on wheels that do not skid. The passive link
/// trails behind the others.
pub(super) struct HarmonicMotion {
    pub speed_m_s: f64,
    omega_rad_s: f64,
    /// Phasors of the passive joint's angle and of the turning rate of link 0.
    phi_rad: Complex<f64>,
    turning_rad_s: Complex<f64>,
}

/// Sign with which a side link's wheel feels its joint.
pub(super) fn joint_sign(joint: usize) -> f64 {
    if joint == 0 { 1.0 } else { -1.0 }
}

impl HarmonicMotion {
    /// The motion whose speed nothing changes in the mean, with joint `passive` on its spring;
    /// `None` if there is none.
    pub(super) fn find(problem: &Problem, passive: usize) -> Option<Self> {
        const DOUBLINGS: usize = 8;
        const BISECTIONS: usize = 10;
        let Problem { robot, gait, omega_rad_s, .. } = problem;
        let command = gait.joints[1 - passive]?;
        let wave = Complex::from_polar(command.amplitude_rad, command.phase_rad);
        let force = |speed_m_s| Self::at_speed(problem, passive, wave, speed_m_s).1;
        let is_forward = force(0.0) > 0.0;
        let mut speed_m_s = -joint_sign(passive) * omega_rad_s * robot.l_m;
        for _ in 0..DOUBLINGS {
            if (force(speed_m_s) > 0.0) != is_forward {
                let speed_m_s = bisect(force, 0.0, speed_m_s, BISECTIONS);
                return Some(Self::at_speed(problem, passive, wave, speed_m_s).0);
            }
            speed_m_s *= 2.0;
        }
        None
    }

    /// The motion at a speed, driven by the other joint's `wave`, and the mean over a cycle of eq. 7
    /// along the motion that the wheels leave, to second order in the angles, N.
    fn at_speed(problem: &Problem, p: usize, wave: Complex<f64>, speed_m_s: f64) -> (Self, f64) {
        let Problem { robot, omega_rad_s, .. } = problem;
        let (a, h, l, b) = (1 - p, robot.h_m, robot.l_m, robot.b_m);
        let rate = Complex::new(0.0, *omega_rad_s);
        let mean = |x: Complex<f64>, y: Complex<f64>| 0.5 * (x * y.conj()).re;
        // The wheels of the side links.
        let trailing = joint_sign(p) * speed_m_s;
        let mut phi = [wave; 2];
        phi[p] *= (rate * l + trailing) / (-rate * l + trailing);
        let turning = wave * (rate * (joint_sign(a) * l) - speed_m_s) / (h + l);
        let dturning = rate * turning;

        let mut along = robot.roll_kg_s.iter().sum::<f64>() * speed_m_s;
        let mut torque = dturning * robot.inertia_kg_m2[0];
        let mut joint_torque = phi[p] * (rate * robot.damping_nm_s_rad + robot.stiffness_nm_rad);
        for joint in 0..2 {
            let (sign, mass) = (joint_sign(joint), robot.mass_kg[1 + joint]);
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
        let null = (phi[p] - wave) * (joint_sign(p) / l);
        let force = along - mean(wave, torque) / (h + l) + mean(null, joint_torque);
        let (omega_rad_s, phi_rad, turning_rad_s) = (*omega_rad_s, phi[p], turning);
        (Self { speed_m_s, omega_rad_s, phi_rad, turning_rad_s }, force)
    }

    /// Angle and rate of the passive joint and turning rate of link 0 at a phase.
    pub(super) fn at(&self, phase_rad: f64) -> [f64; 3] {
        let wave = Complex::cis(phase_rad);
        let [phi, turning] = [self.phi_rad, self.turning_rad_s].map(|phasor| phasor * wave);
        [phi.re, -self.omega_rad_s * phi.im, turning.re]
    }
}
