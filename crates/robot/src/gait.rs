//! What the joints are commanded to do (eq. 18 and 19).

use std::f64::consts::PI;

use serde::Serialize;

use super::Number;
use super::command::{JointCommand, SecondHarmonic};

/// The commands of both joints. A joint without a command is passive: its spring and
/// damper (eq. 11) govern it. At most one joint may be passive.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Gait {
    pub joints: [Option<JointCommand>; 2],
}

/// Angles, rates and accelerations of both joints at one time; the entries of a
/// passive joint are zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape<T = f64> {
    pub phi_rad: [T; 2],
    pub rate_rad_s: [T; 2],
    pub acceleration_rad_s2: [T; 2],
}

impl Gait {
    /// Both joints about straight, 30 degrees, a quarter period apart (eq. 19).
    pub fn symmetric() -> Self {
        Self::circular(0.0)
    }

    /// As [`Gait::symmetric`] about offsets of 45 and -45 degrees.
    pub fn skewed() -> Self {
        Self::circular(45_f64.to_radians())
    }

    fn circular(offset_rad: f64) -> Self {
        let amplitude_rad = 30_f64.to_radians();
        Self {
            joints: [
                Some(JointCommand::new(offset_rad, amplitude_rad, 0.0)),
                Some(JointCommand::new(-offset_rad, amplitude_rad, -PI / 2.0)),
            ],
        }
    }

    /// Joint 1 on its spring, joint 2 commanded with 30 degrees (eq. 18).
    pub fn passive_symmetric() -> Self {
        Self { joints: [None, Self::symmetric().joints[0]] }
    }

    /// Index (0 or 1) of the passive joint, if there is one.
    #[inline]
    pub fn passive_joint(&self) -> Option<usize> {
        self.joints.iter().position(Option::is_none)
    }

    /// Whether half a period later every commanded angle has changed its sign: none has an offset or a
    /// second harmonic.
    #[inline]
    pub fn is_symmetric(&self) -> bool {
        let is_symmetric = |joint: &JointCommand| {
            joint.offset_rad == 0.0 && joint.second() == SecondHarmonic::default()
        };
        self.joints.iter().flatten().all(is_symmetric)
    }

    /// Whether a command has a second harmonic, be it of nothing.
    #[inline(always)]
    pub fn has_second(&self) -> bool {
        self.joints.iter().flatten().any(|joint| joint.second.is_some())
    }

    /// Angle (relative to the offset), rate and acceleration of each joint's first harmonic per radian
    /// of its amplitude at phase `omega t`; zero for a passive joint.
    #[inline(always)]
    pub fn waves<T: Number>(&self, phase_rad: T, omega_rad_s: f64) -> [[T; 3]; 2] {
        let phases_rad =
            self.joints.map(|joint| phase_rad + T::of(joint.map_or(0.0, |joint| joint.phase_rad)));
        let turned = T::both_sin_cos(phases_rad);
        let omega = T::of(omega_rad_s);
        std::array::from_fn(|i| {
            let (sin, cos) = turned[i];
            match self.joints[i] {
                Some(_) => [cos, -(omega * sin), -(omega * omega * cos)],
                None => [T::of(0.0); 3],
            }
        })
    }

    /// Sine and cosine of twice the phase `omega t`; zero where no command has a second harmonic.
    #[inline(always)]
    pub fn double_turn<T: Number>(&self, phase_rad: T) -> [T; 2] {
        if !self.has_second() {
            return [T::of(0.0); 2];
        }
        let (sin, cos) = (T::of(2.0) * phase_rad).sin_cos();
        [sin, cos]
    }

    /// Angle, rate and acceleration per radian of both parts of a second harmonic, from
    /// [`Gait::double_turn`].
    #[inline(always)]
    pub fn second_waves<T: Number>([sin, cos]: [T; 2], omega_rad_s: f64) -> [[T; 3]; 2] {
        let double = T::of(2.0 * omega_rad_s);
        let square = double * double;
        [[cos, -(double * sin), -(square * cos)], [-sin, -(double * cos), square * sin]]
    }

    /// The commanded shape at phase `omega t`.
    #[inline]
    pub fn at(&self, phase_rad: f64, omega_rad_s: f64) -> Shape {
        let waves = self.waves(phase_rad, omega_rad_s);
        self.shape(&waves, self.double_turn(phase_rad), omega_rad_s)
    }

    /// The commanded shape of these waves.
    #[inline(always)]
    pub fn shape<T: Number>(
        &self,
        waves: &[[T; 3]; 2],
        double_turn: [T; 2],
        omega_rad_s: f64,
    ) -> Shape<T> {
        let scaled = |k: usize| -> [T; 2] {
            std::array::from_fn(|i| {
                T::of(self.joints[i].map_or(0.0, |joint| joint.amplitude_rad)) * waves[i][k]
            })
        };
        let offsets = self.joints.map(|joint| T::of(joint.map_or(0.0, |joint| joint.offset_rad)));
        let [phi1, phi2] = scaled(0);
        let mut shape = Shape {
            phi_rad: [offsets[0] + phi1, offsets[1] + phi2],
            rate_rad_s: scaled(1),
            acceleration_rad_s2: scaled(2),
        };
        if self.has_second() {
            let [in_phase, quadrature] = Self::second_waves(double_turn, omega_rad_s);
            for (i, joint) in self.joints.iter().enumerate() {
                let of = joint.map_or(SecondHarmonic::default(), JointCommand::second);
                let [added, rate, acceleration]: [T; 3] = std::array::from_fn(|k| {
                    T::of(of.in_phase_rad) * in_phase[k] + T::of(of.quadrature_rad) * quadrature[k]
                });
                shape.phi_rad[i] += added;
                shape.rate_rad_s[i] += rate;
                shape.acceleration_rad_s2[i] += acceleration;
            }
        }
        shape
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_period_later_an_even_harmonic_is_the_same() {
        let second = Some(SecondHarmonic::new(0.2, 0.4));
        let command = JointCommand { second, ..JointCommand::new(0.0, 0.5, 0.3) };
        let gait = |command| Gait { joints: [Some(command), None] };
        assert!(!gait(command).is_symmetric());
        for phase_rad in [0.1, 2.0, 5.0] {
            let (now, later) = (
                gait(command).at(phase_rad + 0.9, 3.0),
                gait(command.later(0.9)).at(phase_rad, 3.0),
            );
            assert!((now.phi_rad[0] - later.phi_rad[0]).abs() < 1e-15);
            assert!((now.rate_rad_s[0] - later.rate_rad_s[0]).abs() < 1e-14);
            assert!(
                (now.rate_rad_s[0] - 3.0 * command.derivative(1, phase_rad + 0.9)).abs() < 1e-14
            );
        }
        let nothing = JointCommand { second: Some(SecondHarmonic::default()), ..command };
        assert!(gait(nothing).is_symmetric());
    }
}
