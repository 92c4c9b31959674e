//! Commanded motion of one joint, with its extremes over a cycle.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::fmt;

use serde::Serialize;

/// Joint command `phi(t) = offset + amplitude cos(omega t + phase)`, all in radians, plus a second harmonic.
#[derive(Clone, Copy, Default, PartialEq, Serialize)]
pub struct JointCommand {
    pub offset_rad: f64,
    pub amplitude_rad: f64,
    pub phase_rad: f64,
    /// Second harmonic; `None` if there is none. If it is present, even with amplitude zero, derivatives with
    /// respect to it are computed.
    #[serde(flatten)]
    pub second: Option<SecondHarmonic>,
}

/// Second harmonic `amplitude2 cos(2 omega t + phase2)`, stored as its components `amplitude2 cos(phase2)`
/// and `amplitude2 sin(phase2)`, which are smooth where the amplitude vanishes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
#[serde(into = "Polar")]
pub struct SecondHarmonic {
    pub in_phase_rad: f64,
    pub quadrature_rad: f64,
}

/// Serialized form of a [`SecondHarmonic`].
#[derive(Serialize)]
struct Polar {
    amplitude2_rad: f64,
    phase2_rad: f64,
}

impl From<SecondHarmonic> for Polar {
    #[inline]
    fn from(harmonic: SecondHarmonic) -> Self {
        Self { amplitude2_rad: harmonic.amplitude_rad(), phase2_rad: harmonic.phase_rad() }
    }
}

impl SecondHarmonic {
    #[inline]
    pub fn new(amplitude_rad: f64, phase_rad: f64) -> Self {
        let (sin, cos) = phase_rad.sin_cos();
        Self { in_phase_rad: amplitude_rad * cos, quadrature_rad: amplitude_rad * sin }
    }

    #[inline]
    pub fn amplitude_rad(self) -> f64 {
        self.in_phase_rad.hypot(self.quadrature_rad)
    }

    /// Returns the phase, in `[-pi, pi]` rad.
    #[inline]
    pub fn phase_rad(self) -> f64 {
        self.quadrature_rad.atan2(self.in_phase_rad)
    }

    /// Converts derivatives with respect to the in-phase and quadrature components of the second harmonic to
    /// derivatives with respect to its amplitude and phase.
    #[inline]
    pub fn polar_slopes(self, [din_phase, dquadrature]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.phase_rad().sin_cos();
        [
            cos * din_phase + sin * dquadrature,
            self.in_phase_rad * dquadrature - self.quadrature_rad * din_phase,
        ]
    }
}

/// Maximum number of turning points (local extremes) that a joint command, or its rate, has in one cycle.
pub const MAX_TURNS: usize = 4;

/// Phases (rad) of the turning points of a joint command, or of its rate, in one cycle, in ascending order;
/// see [`Turns::as_slice`].
#[derive(Debug, Clone, Copy, Default)]
pub struct Turns {
    phases_rad: [f64; MAX_TURNS],
    count: usize,
}

impl Turns {
    /// Returns the phases of the turning points, rad; there are at least two.
    pub fn as_slice(&self) -> &[f64] {
        &self.phases_rad[..self.count]
    }

    fn push(&mut self, phase_rad: f64) {
        if let Some(next) = self.phases_rad.get_mut(self.count) {
            *next = phase_rad;
            self.count += 1;
        }
    }
}

impl fmt::Debug for JointCommand {
    fn fmt(&self, to: &mut fmt::Formatter) -> fmt::Result {
        let Self { offset_rad, amplitude_rad, phase_rad, second } = self;
        let mut fields = to.debug_struct("JointCommand");
        fields.field("offset_rad", offset_rad);
        fields.field("amplitude_rad", amplitude_rad);
        fields.field("phase_rad", phase_rad);
        second.iter().for_each(|second| {
            fields.field("second", second);
        });
        fields.finish()
    }
}

impl JointCommand {
    /// Creates a command without a second harmonic.
    #[inline]
    pub fn new(offset_rad: f64, amplitude_rad: f64, phase_rad: f64) -> Self {
        Self { offset_rad, amplitude_rad, phase_rad, second: None }
    }

    /// Returns the offset, amplitude and phase of the first harmonic, rad.
    #[inline]
    pub fn to_array(self) -> [f64; 3] {
        [self.offset_rad, self.amplitude_rad, self.phase_rad]
    }

    /// Returns mutable references to the offset, amplitude and phase of the first harmonic, rad.
    #[inline]
    pub fn numbers_mut(&mut self) -> [&mut f64; 3] {
        [&mut self.offset_rad, &mut self.amplitude_rad, &mut self.phase_rad]
    }

    /// Returns the second harmonic, zero if there is none.
    #[inline]
    pub fn second(self) -> SecondHarmonic {
        self.second.unwrap_or_default()
    }

    /// Returns the command with the mean and first harmonic of `measured` and the second harmonic of `self`;
    /// all NaN if the measured angles exceed a full turn.
    #[must_use]
    #[inline]
    pub fn measured(self, measured: Self) -> Self {
        let Self { offset_rad, amplitude_rad, .. } = measured;
        if offset_rad.abs() + amplitude_rad.abs() <= TAU {
            Self { second: self.second, ..measured }
        } else {
            Self::new(f64::NAN, f64::NAN, f64::NAN)
        }
    }

    /// Returns the command advanced by the given phase `omega t`, rad.
    #[must_use]
    #[inline]
    pub fn advanced(self, phase_rad: f64) -> Self {
        let second = self.second.map(|second| {
            SecondHarmonic::new(second.amplitude_rad(), second.phase_rad() + 2.0 * phase_rad)
        });
        Self { phase_rad: self.phase_rad + phase_rad, second, ..self }
    }

    /// Returns the angle at a phase `omega t` (order 0), or its derivative of the given order with respect to
    /// the phase, rad.
    #[inline]
    pub fn derivative(&self, order: i32, phase_rad: f64) -> f64 {
        let quarters = f64::from(order) * FRAC_PI_2;
        let offset_rad = if order == 0 { self.offset_rad } else { 0.0 };
        let first = self.amplitude_rad * (phase_rad + self.phase_rad + quarters).cos();
        let SecondHarmonic { in_phase_rad, quadrature_rad } = self.second();
        let (sin, cos) = (2.0 * phase_rad + quarters).sin_cos();
        let second = in_phase_rad * cos - quadrature_rad * sin;
        offset_rad + first + 2_f64.powi(order) * second
    }

    /// Returns the derivatives of the angle (order 0), or of its rate divided by omega (order 1), at the
    /// phase `phase_rad` with respect to five variables: the offset, amplitude and phase of the command, and
    /// the in-phase and quadrature components of its second harmonic.
    #[inline]
    pub fn slopes(&self, order: i32, phase_rad: f64) -> [f64; 5] {
        let quarters = f64::from(order) * FRAC_PI_2;
        let (sin, cos) = (phase_rad + self.phase_rad + quarters).sin_cos();
        let (sin2, cos2) = (2.0 * phase_rad + quarters).sin_cos();
        let size = 2_f64.powi(order);
        let doffset = if order == 0 { 1.0 } else { 0.0 };
        [doffset, cos, -self.amplitude_rad * sin, size * cos2, -size * sin2]
    }

    /// Returns the phases `omega t` of the turning points of the angle (order 0) or of its rate (order 1)
    /// over the cycle that begins half a turn before the maximum of the first harmonic.
    #[inline]
    pub fn turns(&self, order: i32) -> Turns {
        /// Number of equal intervals per cycle, so short that none contains two roots of any one of the first
        /// three derivatives of the angle (or of its rate).
        const INTERVALS: usize = 32;
        let mut turns = Turns::default();
        let begin = -self.phase_rad - PI;
        if self.second() == SecondHarmonic::default() {
            let quarter = if order == 0 { 0.0 } else { FRAC_PI_2 };
            [0.0, PI].into_iter().for_each(|half_turn| turns.push(begin + quarter + half_turn));
            return turns;
        }
        // Between two roots of a derivative, the derivative of the next lower order has at most one root.
        for k in 0..INTERVALS {
            let [low, high] = [k, k + 1].map(|k| begin + TAU * k as f64 / INTERVALS as f64);
            let third = self.root(order + 3, low, high).min(high);
            for (low, high) in [(low, third), (third, high)] {
                let second = self.root(order + 2, low, high).min(high);
                for (low, high) in [(low, second), (second, high)] {
                    let phase_rad = self.root(order + 1, low, high);
                    if !phase_rad.is_nan() {
                        turns.push(phase_rad);
                    }
                }
            }
        }
        // The number of turning points must be even; at the ends of the cycle, rounding may hide one or count
        // it twice.
        if turns.count % 2 == 1 {
            turns.push(begin);
        }
        turns
    }

    /// Returns the phase in `[low, high)` at which the derivative of the given order is zero; NaN if there is
    /// none. The interval must contain at most one root.
    fn root(&self, order: i32, mut low: f64, mut high: f64) -> f64 {
        const MAX_STEPS: usize = 60;
        let [at_low, at_high] = [low, high].map(|phase| self.derivative(order, phase));
        if at_low == 0.0 && low < high {
            return low;
        }
        if at_low * at_high >= 0.0 {
            return f64::NAN;
        }
        let mut phase = 0.5 * (low + high);
        for _ in 0..MAX_STEPS {
            let value = self.derivative(order, phase);
            let slope = self.derivative(order + 1, phase);
            if (value > 0.0) == (at_high > 0.0) {
                high = phase;
            } else {
                low = phase;
            }
            let next = phase - value / slope;
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            if (next - phase).abs() <= f64::EPSILON * TAU {
                break;
            }
            phase = next;
        }
        phase
    }

    /// Returns the phases at which the angle is largest and smallest, rad.
    fn extremes(&self) -> [f64; 2] {
        let turns = self.turns(0);
        let phases = turns.as_slice().iter().copied();
        let by_angle = |a: &f64, b: &f64| self.derivative(0, *a).total_cmp(&self.derivative(0, *b));
        [phases.clone().max_by(by_angle), phases.min_by(by_angle)].map(|phase| phase.unwrap_or(0.0))
    }

    /// Returns the maximum absolute angle over a cycle, rad.
    pub fn peak_angle_rad(&self) -> f64 {
        self.extremes().into_iter().map(|at| self.derivative(0, at).abs()).fold(0.0, f64::max)
    }

    /// Returns the maximum absolute rate over a cycle, divided by omega, rad.
    pub fn peak_rate_rad(&self) -> f64 {
        let turns = self.turns(1);
        let rates = turns.as_slice().iter().map(|at| self.derivative(1, *at).abs());
        rates.fold(0.0, f64::max)
    }

    /// Returns the maximum and minimum angle of a cycle, rad.
    #[inline]
    pub fn range_rad(&self) -> [f64; 2] {
        self.extremes().map(|at| self.derivative(0, at))
    }

    /// Returns half the difference between the maximum and the minimum angle of a cycle, rad.
    #[inline]
    pub fn half_range_rad(&self) -> f64 {
        if self.second() == SecondHarmonic::default() {
            return self.amplitude_rad.abs();
        }
        let [highest, lowest] = self.range_rad();
        0.5 * (highest - lowest)
    }

    /// Returns the derivatives of [`JointCommand::half_range_rad`] with respect to the same variables as
    /// [`JointCommand::slopes`].
    #[inline]
    pub fn half_range_slopes(&self) -> [f64; 5] {
        if self.second() == SecondHarmonic::default() {
            return [0.0, self.amplitude_rad.signum(), 0.0, 0.0, 0.0];
        }
        let [highest, lowest] = self.extremes().map(|at| self.slopes(0, at));
        std::array::from_fn(|i| 0.5 * (highest[i] - lowest[i]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_measured_angle_beyond_one_turn_is_unknown() {
        let command = JointCommand::new(0.1, 0.5, 0.2);
        let measured = |offset_rad, amplitude_rad| {
            command.measured(JointCommand::new(offset_rad, amplitude_rad, 0.3)).to_array()
        };
        assert_eq!(measured(-3.0, 3.0), [-3.0, 3.0, 0.3]);
        for [offset_rad, amplitude_rad] in [[0.1, 1e6], [-7.0, 0.5], [f64::NAN, 0.5]] {
            assert!(measured(offset_rad, amplitude_rad).iter().all(|number| number.is_nan()));
        }
    }

    /// At a flat top, three turning points coincide; a command with a dominant second harmonic has four
    /// turning points.
    #[test]
    fn peaks_and_their_slopes_agree_with_a_fine_grid() {
        let seconds = [(0.125, PI), (0.12499, PI), (0.1251, PI - 1e-4), (0.05, 0.3), (0.8, -2.0)];
        for (amplitude_rad, phase_rad) in seconds {
            let second = Some(SecondHarmonic::new(amplitude_rad, phase_rad));
            let command = JointCommand { second, ..JointCommand::new(0.1, 0.5, 0.0) };
            let command = command.advanced(0.7);
            let largest = |of: &JointCommand, order: i32| {
                (0..200_000)
                    .map(|k| of.derivative(order, TAU * f64::from(k) / 2e5).abs())
                    .fold(0.0, f64::max)
            };
            let peaks = [command.peak_angle_rad(), command.peak_rate_rad()];
            for (order, peak) in peaks.into_iter().enumerate() {
                let known = largest(&command, order as i32);
                assert!((0.0..1e-9).contains(&(peak - known + 1e-15)), "{peak} {known}");
            }
            let slopes = command.half_range_slopes();
            for (i, slope) in slopes.into_iter().enumerate() {
                let moved = |step: f64| {
                    let mut command = command;
                    match i {
                        0..3 => *command.numbers_mut()[i] += step,
                        3 => command.second.as_mut().unwrap().in_phase_rad += step,
                        _ => command.second.as_mut().unwrap().quadrature_rad += step,
                    }
                    command.half_range_rad()
                };
                let known = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                assert!((slope - known).abs() < 2e-3, "{command:?} {i}: {slope} {known}");
            }
        }
    }
}
