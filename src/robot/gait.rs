//! What the joints are commanded to do (eq. 18 and 19).

use std::f64::consts::PI;

use serde::Serialize;

use super::Number;

/// `phi(t) = offset + amplitude cos(omega t + phase)`, all in radians.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct JointCommand {
    pub offset_rad: f64,
    pub amplitude_rad: f64,
    pub phase_rad: f64,
}

impl JointCommand {
    /// Offset, amplitude and phase, rad.
    pub fn to_array(self) -> [f64; 3] {
        [self.offset_rad, self.amplitude_rad, self.phase_rad]
    }

    /// The same to write to.
    pub fn numbers_mut(&mut self) -> [&mut f64; 3] {
        [&mut self.offset_rad, &mut self.amplitude_rad, &mut self.phase_rad]
    }
}

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
                Some(JointCommand { offset_rad, amplitude_rad, phase_rad: 0.0 }),
                Some(JointCommand { offset_rad: -offset_rad, amplitude_rad, phase_rad: -PI / 2.0 }),
            ],
        }
    }

    /// Joint 1 on its spring, joint 2 commanded with 30 degrees (eq. 18).
    pub fn passive_symmetric() -> Self {
        Self { joints: [None, Self::symmetric().joints[0]] }
    }

    /// Index (0 or 1) of the passive joint, if there is one.
    pub fn passive_joint(&self) -> Option<usize> {
        self.joints.iter().position(Option::is_none)
    }

    /// Whether half a period later every commanded angle has changed its sign.
    pub fn is_symmetric(&self) -> bool {
        self.joints.iter().flatten().all(|joint| joint.offset_rad == 0.0)
    }

    /// Angle (relative to the offset), rate and acceleration of each joint per radian of its
    /// amplitude at phase `omega t`; zero for a passive joint.
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

    /// The commanded shape at phase `omega t`.
    pub fn at(&self, phase_rad: f64, omega_rad_s: f64) -> Shape {
        self.shape(&self.waves(phase_rad, omega_rad_s))
    }

    /// The commanded shape of these waves.
    #[inline(always)]
    pub fn shape<T: Number>(&self, waves: &[[T; 3]; 2]) -> Shape<T> {
        let scaled = |k: usize| -> [T; 2] {
            std::array::from_fn(|i| {
                T::of(self.joints[i].map_or(0.0, |joint| joint.amplitude_rad)) * waves[i][k]
            })
        };
        let offsets = self.joints.map(|joint| T::of(joint.map_or(0.0, |joint| joint.offset_rad)));
        let [phi1, phi2] = scaled(0);
        Shape {
            phi_rad: [offsets[0] + phi1, offsets[1] + phi2],
            rate_rad_s: scaled(1),
            acceleration_rad_s2: scaled(2),
        }
    }
}
