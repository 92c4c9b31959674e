//! Gaits: commanded motion of the joints (eq. 18 and 19).

use std::f64::consts::PI;

use serde::ser::{Serialize, SerializeStruct as _, Serializer};

use super::Number;
use super::command::{JointCommand, SecondHarmonic};

/// Commands of the joints. A joint without a command is passive: its spring and damper (eq. 11 of the paper)
/// govern it. Of a robot of three links, at most one joint may be passive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gait<const JOINTS: usize = 2> {
    pub joints: [Option<JointCommand>; JOINTS],
}

impl<const JOINTS: usize> Serialize for Gait<JOINTS> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut gait = serializer.serialize_struct("Gait", 1)?;
        gait.serialize_field("joints", self.joints.as_slice())?;
        gait.end()
    }
}

/// Angles, rates and accelerations of both joints at one time; zero for a passive joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape<T = f64> {
    pub phi_rad: [T; 2],
    pub rate_rad_s: [T; 2],
    pub acceleration_rad_s2: [T; 2],
}

impl Gait {
    /// Returns the symmetric gait: no offsets, amplitudes of 30 degrees, a quarter period apart (eq. 19 of
    /// the paper).
    pub fn symmetric() -> Self {
        Self::circular(0.0)
    }

    /// Returns the skewed gait: [`Gait::symmetric`] with offsets of 45 and -45 degrees.
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

    /// Returns the gait in which joint 1 is passive and joint 2 is commanded with an amplitude of 30 degrees
    /// (eq. 18 of the paper).
    pub fn passive_symmetric() -> Self {
        Self { joints: [None, Self::symmetric().joints[0]] }
    }

    /// Returns the index (0 or 1) of the passive joint, if there is one.
    #[inline]
    pub fn passive_joint(&self) -> Option<usize> {
        self.joints.iter().position(Option::is_none)
    }

    /// Returns whether the commands have half-period symmetry: half a period later, every commanded angle has
    /// the opposite sign. This is so if no command has an offset or a nonzero second harmonic.
    #[inline]
    pub fn is_symmetric(&self) -> bool {
        self.joints
            .iter()
            .flatten()
            .all(|joint| joint.offset_rad == 0.0 && joint.second() == SecondHarmonic::default())
    }

    /// Returns whether a command has a second harmonic, even one of amplitude zero.
    #[inline(always)]
    pub fn has_second(&self) -> bool {
        self.joints.iter().flatten().any(|joint| joint.second.is_some())
    }

    /// Returns the angle (relative to the offset), rate and acceleration of each joint's first harmonic at
    /// phase `omega t`, per radian of the joint's amplitude; zero for a passive joint.
    #[inline(always)]
    pub fn waves<T: Number>(&self, phase_rad: T, omega_rad_s: f64) -> [[T; 3]; 2] {
        let phases_rad = self
            .joints
            .map(|joint| phase_rad + T::splat(joint.map_or(0.0, |joint| joint.phase_rad)));
        let turned = T::both_sin_cos(phases_rad);
        let omega = T::splat(omega_rad_s);
        std::array::from_fn(|i| {
            let (sin, cos) = turned[i];
            match self.joints[i] {
                Some(_) => [cos, -(omega * sin), -(omega * omega * cos)],
                None => [T::splat(0.0); 3],
            }
        })
    }

    /// Returns the sine and cosine of twice the phase `omega t`; zero if no command has a second harmonic.
    #[inline(always)]
    pub fn double_turn<T: Number>(&self, phase_rad: T) -> [T; 2] {
        if !self.has_second() {
            return [T::splat(0.0); 2];
        }
        let (sin, cos) = (T::splat(2.0) * phase_rad).sin_cos();
        [sin, cos]
    }

    /// Returns the angle, rate and acceleration due to the in-phase and quadrature components of a second
    /// harmonic, per radian of the component, from the result of [`Gait::double_turn`].
    #[inline(always)]
    pub fn second_waves<T: Number>([sin, cos]: [T; 2], omega_rad_s: f64) -> [[T; 3]; 2] {
        let double = T::splat(2.0 * omega_rad_s);
        let square = double * double;
        [[cos, -(double * sin), -(square * cos)], [-sin, -(double * cos), square * sin]]
    }

    /// Returns the commanded joint angles, rates and accelerations at phase `omega t`.
    #[inline]
    pub fn at(&self, phase_rad: f64, omega_rad_s: f64) -> Shape {
        let waves = self.waves(phase_rad, omega_rad_s);
        self.shape(&waves, self.double_turn(phase_rad), omega_rad_s)
    }

    /// Returns the commanded shape from the results of [`Gait::waves`] and [`Gait::double_turn`].
    #[inline(always)]
    pub fn shape<T: Number>(
        &self,
        waves: &[[T; 3]; 2],
        double_turn: [T; 2],
        omega_rad_s: f64,
    ) -> Shape<T> {
        let offsets =
            self.joints.map(|joint| T::splat(joint.map_or(0.0, |joint| joint.offset_rad)));
        let amplitudes =
            self.joints.map(|joint| T::splat(joint.map_or(0.0, |joint| joint.amplitude_rad)));
        let mut shape = Shape {
            phi_rad: std::array::from_fn(|i| offsets[i] + amplitudes[i] * waves[i][0]),
            rate_rad_s: std::array::from_fn(|i| amplitudes[i] * waves[i][1]),
            acceleration_rad_s2: std::array::from_fn(|i| amplitudes[i] * waves[i][2]),
        };
        if self.has_second() {
            let [in_phase, quadrature] = Self::second_waves(double_turn, omega_rad_s);
            for (i, joint) in self.joints.iter().enumerate() {
                let second = joint.map_or(SecondHarmonic::default(), JointCommand::second);
                let [added, rate, acceleration]: [T; 3] = std::array::from_fn(|k| {
                    T::splat(second.in_phase_rad) * in_phase[k]
                        + T::splat(second.quadrature_rad) * quadrature[k]
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
    fn a_second_harmonic_breaks_the_half_period_symmetry() {
        let second = Some(SecondHarmonic::new(0.2, 0.4));
        let command = JointCommand { second, ..JointCommand::new(0.0, 0.5, 0.3) };
        let gait = |command| Gait { joints: [Some(command), None] };
        assert!(!gait(command).is_symmetric());
        for phase_rad in [0.1, 2.0, 5.0] {
            let now = gait(command).at(phase_rad + 0.9, 3.0);
            let later = gait(command.advanced(0.9)).at(phase_rad, 3.0);
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
