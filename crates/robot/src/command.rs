//! What one joint is commanded to do, with its extremes over a cycle.

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::fmt;

use serde::Serialize;

/// `phi(t) = offset + amplitude cos(omega t + phase)`, all in radians, and its second harmonic.
#[derive(Clone, Copy, Default, PartialEq, Serialize)]
pub struct JointCommand {
    pub offset_rad: f64,
    pub amplitude_rad: f64,
    pub phase_rad: f64,
    /// With one, be it of nothing, motions have derivatives by it.
    #[serde(flatten)]
    pub second: Option<SecondHarmonic>,
}

/// `amplitude2 cos(2 omega t + phase2)` by its parts, `amplitude2 cos(phase2)` and
/// `amplitude2 sin(phase2)`, which are smooth where it comes to nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
#[serde(into = "Polar")]
pub struct SecondHarmonic {
    pub in_phase_rad: f64,
    pub quadrature_rad: f64,
}

/// A second harmonic as it is written.
#[derive(Serialize)]
struct Polar {
    amplitude2_rad: f64,
    phase2_rad: f64,
}

impl From<SecondHarmonic> for Polar {
    #[inline]
    fn from(of: SecondHarmonic) -> Self {
        Self { amplitude2_rad: of.amplitude_rad(), phase2_rad: of.phase_rad() }
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

    /// Within half a turn of zero.
    #[inline]
    pub fn phase_rad(self) -> f64 {
        self.quadrature_rad.atan2(self.in_phase_rad)
    }

    /// Derivatives with respect to amplitude and phase from those with respect to the two parts.
    #[inline]
    pub fn polar_slopes(self, [by_in_phase, by_quadrature]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.phase_rad().sin_cos();
        [
            cos * by_in_phase + sin * by_quadrature,
            self.in_phase_rad * by_quadrature - self.quadrature_rad * by_in_phase,
        ]
    }
}

/// Most turning points of a command, and of its rate, in a cycle.
pub const MOST_TURNS: usize = 4;

/// Phases at which something turns round in a cycle, one after the other; [`Turns::as_slice`].
#[derive(Debug, Clone, Copy, Default)]
pub struct Turns {
    phases_rad: [f64; MOST_TURNS],
    count: usize,
}

impl Turns {
    /// Two of them at least.
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
    /// Without a second harmonic.
    #[inline]
    pub fn new(offset_rad: f64, amplitude_rad: f64, phase_rad: f64) -> Self {
        Self { offset_rad, amplitude_rad, phase_rad, second: None }
    }

    /// Offset, amplitude and phase, rad.
    #[inline]
    pub fn to_array(self) -> [f64; 3] {
        [self.offset_rad, self.amplitude_rad, self.phase_rad]
    }

    /// The same to write to.
    #[inline]
    pub fn numbers_mut(&mut self) -> [&mut f64; 3] {
        [&mut self.offset_rad, &mut self.amplitude_rad, &mut self.phase_rad]
    }

    /// The second harmonic, of nothing where there is none.
    #[inline]
    pub fn second(self) -> SecondHarmonic {
        self.second.unwrap_or_default()
    }

    /// What was measured of the joint that follows this command: its mean and first harmonic, with the
    /// command's second one. It is not known (NaN) where no joint can turn so far.
    #[must_use]
    #[inline]
    pub fn measured(self, measured: Self) -> Self {
        let Self { offset_rad, amplitude_rad, .. } = measured;
        match offset_rad.abs() + amplitude_rad.abs() <= TAU {
            true => Self { second: self.second, ..measured },
            false => Self::new(f64::NAN, f64::NAN, f64::NAN),
        }
    }

    /// The same command as it is an angle of omega later.
    #[must_use]
    #[inline]
    pub fn later(self, phase_rad: f64) -> Self {
        let second = self
            .second
            .map(|of| SecondHarmonic::new(of.amplitude_rad(), of.phase_rad() + 2.0 * phase_rad));
        Self { phase_rad: self.phase_rad + phase_rad, second, ..self }
    }

    /// The angle (order 0) or a derivative of it with respect to the phase `omega t`.
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

    /// Derivatives of the angle (order 0) or of its rate per omega (1) at a phase with respect to
    /// offset, amplitude, phase and both parts of the second harmonic.
    #[inline]
    pub fn slopes(&self, order: i32, phase_rad: f64) -> [f64; 5] {
        let quarters = f64::from(order) * FRAC_PI_2;
        let (sin, cos) = (phase_rad + self.phase_rad + quarters).sin_cos();
        let (sin2, cos2) = (2.0 * phase_rad + quarters).sin_cos();
        let size = 2_f64.powi(order);
        let by_offset = if order == 0 { 1.0 } else { 0.0 };
        [by_offset, cos, -self.amplitude_rad * sin, size * cos2, -size * sin2]
    }

    /// Phases `omega t` at which the angle (order 0) or its rate (1) turns round, from half a turn
    /// before the first harmonic's largest angle on.
    #[inline]
    pub fn turns(&self, order: i32) -> Turns {
        /// Parts of a cycle in which no derivative up to the third has two roots.
        const PARTS: usize = 32;
        let mut turns = Turns::default();
        let begin = -self.phase_rad - PI;
        if self.second() == SecondHarmonic::default() {
            let quarter = if order == 0 { 0.0 } else { FRAC_PI_2 };
            [0.0, PI].into_iter().for_each(|later| turns.push(begin + quarter + later));
            return turns;
        }
        let mut turn = |low: f64, high: f64| {
            let phase_rad = self.root(order + 1, low, high);
            if !phase_rad.is_nan() {
                turns.push(phase_rad);
            }
        };
        // Between the roots of the next derivative there is one at most of this one, and so on.
        for k in 0..PARTS {
            let [low, high] = [k, k + 1].map(|k| begin + TAU * k as f64 / PARTS as f64);
            let third = self.root(order + 3, low, high).min(high);
            for (low, high) in [(low, third), (third, high)] {
                let second = self.root(order + 2, low, high).min(high);
                turn(low, second);
                turn(second, high);
            }
        }
        // Their number is even; where the cycle closes, rounding may hide one or show it twice.
        if turns.count % 2 == 1 {
            turns.push(begin);
        }
        turns
    }

    /// Where a derivative that has one root at most between two phases, the first of them included,
    /// has it; NaN if there is none.
    fn root(&self, order: i32, mut low: f64, mut high: f64) -> f64 {
        const MOST_STEPS: usize = 60;
        let [at_low, at_high] = [low, high].map(|phase| self.derivative(order, phase));
        if at_low == 0.0 && low < high {
            return low;
        }
        if at_low * at_high >= 0.0 {
            return f64::NAN;
        }
        let mut phase = 0.5 * (low + high);
        for _ in 0..MOST_STEPS {
            let (value, slope) = (self.derivative(order, phase), self.derivative(order + 1, phase));
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

    /// Where the angle is highest and where it is lowest, as phases.
    fn extremes(&self) -> [f64; 2] {
        let turns = self.turns(0);
        let phases = || turns.as_slice().iter().copied();
        let by_angle = |a: &f64, b: &f64| self.derivative(0, *a).total_cmp(&self.derivative(0, *b));
        [phases().max_by(by_angle), phases().min_by(by_angle)].map(|of| of.unwrap_or(0.0))
    }

    /// Largest angle without its sign over a cycle, rad.
    pub fn peak_angle_rad(&self) -> f64 {
        self.extremes().into_iter().map(|at| self.derivative(0, at).abs()).fold(0.0, f64::max)
    }

    /// Largest rate without its sign over a cycle, per omega, rad.
    pub fn peak_rate_rad(&self) -> f64 {
        let turns = self.turns(1);
        let rates = turns.as_slice().iter().map(|at| self.derivative(1, *at).abs());
        rates.fold(0.0, f64::max)
    }

    /// Highest and lowest angle of a cycle, rad.
    #[inline]
    pub fn range_rad(&self) -> [f64; 2] {
        self.extremes().map(|at| self.derivative(0, at))
    }

    /// Half the way between the highest and the lowest angle of a cycle, rad.
    #[inline]
    pub fn half_range_rad(&self) -> f64 {
        match self.second() == SecondHarmonic::default() {
            true => self.amplitude_rad.abs(),
            false => {
                let [highest, lowest] = self.range_rad();
                0.5 * (highest - lowest)
            }
        }
    }

    /// Derivatives of that with respect to the numbers of [`JointCommand::slopes`].
    #[inline]
    pub fn half_range_slopes(&self) -> [f64; 5] {
        match self.second() == SecondHarmonic::default() {
            true => [0.0, self.amplitude_rad.signum(), 0.0, 0.0, 0.0],
            false => {
                let [highest, lowest] = self.extremes().map(|at| self.slopes(0, at));
                std::array::from_fn(|i| 0.5 * (highest[i] - lowest[i]))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_joint_can_turn_by_is_not_known() {
        let command = JointCommand::new(0.1, 0.5, 0.2);
        let measured = |offset_rad, amplitude_rad| {
            command.measured(JointCommand::new(offset_rad, amplitude_rad, 0.3)).to_array()
        };
        assert_eq!(measured(-3.0, 3.0), [-3.0, 3.0, 0.3]);
        for [offset_rad, amplitude_rad] in [[0.1, 1e6], [-7.0, 0.5], [f64::NAN, 0.5]] {
            assert!(measured(offset_rad, amplitude_rad).iter().all(|number| number.is_nan()));
        }
    }

    /// A flat top has three turning points in one place, and a dominant second harmonic turns round
    /// four times.
    #[test]
    fn peaks_and_their_slopes_are_those_of_a_fine_grid() {
        let seconds = [(0.125, PI), (0.12499, PI), (0.1251, PI - 1e-4), (0.05, 0.3), (0.8, -2.0)];
        for (amplitude_rad, phase_rad) in seconds {
            let second = Some(SecondHarmonic::new(amplitude_rad, phase_rad));
            let command = JointCommand { second, ..JointCommand::new(0.1, 0.5, 0.0) };
            let command = command.later(0.7);
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
