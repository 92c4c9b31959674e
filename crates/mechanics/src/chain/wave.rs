//! Commands of joints, rotors and torques as functions of the phase.

use trilink_robot::{CommandNumber, JointCommand, Number, TorqueCommand};

/// Commanded angle as a Fourier series.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Wave {
    offset_rad: f64,
    /// In-phase and quadrature components of the first and, if there is one, the second harmonic, rad.
    first: [f64; 2],
    second: Option<[f64; 2]>,
}

impl Wave {
    pub(super) fn new(command: &JointCommand) -> Self {
        let (sin, cos) = command.phase_rad.sin_cos();
        let first = [command.amplitude_rad * cos, command.amplitude_rad * sin];
        let second = command.second.map(|second| [second.in_phase_rad, second.quadrature_rad]);
        Self { offset_rad: command.offset_rad, first, second }
    }

    /// Returns the derivative of a command with respect to one of its numbers.
    pub(super) fn slope(command: &JointCommand, number: CommandNumber) -> Self {
        let JointCommand { amplitude_rad, phase_rad, .. } = command;
        let (sin, cos) = phase_rad.sin_cos();
        let (mut offset_rad, mut first, mut second) = (0.0, [0.0; 2], None);
        match number {
            CommandNumber::Offset => offset_rad = 1.0,
            CommandNumber::Amplitude => first = [cos, sin],
            CommandNumber::Phase => first = [-amplitude_rad * sin, amplitude_rad * cos],
            CommandNumber::SecondInPhase => second = Some([1.0, 0.0]),
            CommandNumber::SecondQuadrature => second = Some([0.0, 1.0]),
        }
        Self { offset_rad, first, second }
    }

    /// Returns the angle, rate and acceleration at a phase, given its sine and cosine.
    #[inline(always)]
    pub(super) fn at<T: Number>(&self, [sin, cos]: [T; 2], omega_rad_s: f64) -> [T; 3] {
        let mut waves = [T::splat(self.offset_rad), T::splat(0.0), T::splat(0.0)];
        let mut add = |[a, b]: [f64; 2], [sin, cos]: [T; 2], omega_rad_s: f64| {
            let [a, b, omega] = [a, b, omega_rad_s].map(T::splat);
            let angle = a * cos - b * sin;
            waves[0] += angle;
            waves[1] -= omega * (a * sin + b * cos);
            waves[2] -= omega * omega * angle;
        };
        add(self.first, [sin, cos], omega_rad_s);
        if let Some(second) = self.second {
            let double = sin * cos;
            add(second, [double + double, cos * cos - sin * sin], 2.0 * omega_rad_s);
        }
        waves
    }
}

/// Returns a prescribed torque at a phase, N m.
#[inline(always)]
pub(super) fn prescribed<T: Number>(torque: &TorqueCommand, phase_rad: T) -> T {
    let mean = T::splat(torque.mean_nm);
    if torque.amplitude_nm == 0.0 {
        return mean;
    }
    let (_, cos) = (phase_rad + T::splat(torque.phase_rad)).sin_cos();
    mean + T::splat(torque.amplitude_nm) * cos
}
