//! Gaits: commanded motion of the joints (eq. 18 and 19).

use std::f64::consts::PI;

use serde::ser::{Serialize, SerializeStruct as _, Serializer};

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

impl<const JOINTS: usize> Gait<JOINTS> {
    /// No command.
    pub const NONE: Self = Self { joints: [None; JOINTS] };
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
            let later = command.advanced(0.9);
            for order in 0..2 {
                let [now, then] = [
                    command.derivative(order, phase_rad + 0.9),
                    later.derivative(order, phase_rad),
                ];
                assert!((now - then).abs() < 1e-14);
            }
        }
        let nothing = JointCommand { second: Some(SecondHarmonic::default()), ..command };
        assert!(gait(nothing).is_symmetric());
    }
}
