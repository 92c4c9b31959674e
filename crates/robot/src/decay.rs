//! Free decay of a motion under viscous resistance, dry friction, or both, in closed form.
//!
//! Dry friction is taken in the limit of zero transition speed: it opposes any motion with a force of
//! constant magnitude, and holds a body at rest against any smaller force.

use std::f64::consts::PI;
use std::ops::Range;

use nalgebra::SVector;
use trilink_base::named;

/// Rates and decrements below this value are taken as zero, to avoid division by zero.
const SMALL: f64 = 1e-9;

named! {
    /// Resistance to a decaying motion.
    pub enum DecayLaw {
        /// Viscous resistance, proportional to the velocity.
        Viscous = "viscous",
        /// Dry friction.
        Coulomb = "coulomb",
        /// Dry and viscous friction.
        CoulombViscous = "coulomb-viscous",
    }
}

impl DecayLaw {
    /// Returns whether the law has a viscous term.
    pub fn is_viscous(self) -> bool {
        self != Self::Coulomb
    }

    /// Returns whether the law has a dry-friction term.
    pub fn is_dry(self) -> bool {
        self != Self::Viscous
    }
}

/// Fraction of the maximum speed below which a pushed robot has been released.
pub const RELEASED: f64 = 0.95;
/// Fraction of the maximum speed at which the coasting that is analysed ends.
const SLOW: f64 = 0.1;
/// Minimum speed at which dry friction has its full magnitude, as a multiple of the wheels' transition speed. Below it,
/// dry friction resembles viscous resistance.
const MIN_TRANSITIONS: f64 = 4.0;

/// Returns the samples in which a pushed robot coasts, from its release until it is slow. Speeds in m/s, NaN where
/// unknown; `transition_m_s` is the transition speed of the wheels' dry friction.
pub fn coasting(speed_m_s: &[f64], transition_m_s: f64) -> Range<usize> {
    let max_m_s = speed_m_s.iter().fold(0.0, |max: f64, v| max.max(v.abs()));
    let first = |from: usize, is: &dyn Fn(f64) -> bool| {
        let found = speed_m_s[from..].iter().position(|v| is(v.abs()));
        found.map_or(speed_m_s.len(), |i| from + i)
    };
    let fastest = first(0, &|v| v >= max_m_s);
    let start = first(fastest, &|v| v < RELEASED * max_m_s);
    let slow_m_s = (SLOW * max_m_s).max(MIN_TRANSITIONS * transition_m_s);
    start..first(start, &|v| v < slow_m_s)
}

/// Straight path of a coasting body: `v' = -lambda v - g` until the body stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coast {
    /// Position at time 0, m.
    pub start_m: f64,
    /// Speed at time 0, m/s.
    pub speed_m_s: f64,
    /// Viscous resistance over mass, lambda, 1/s.
    pub viscous_1_s: f64,
    /// Dry friction over mass, g, m/s^2.
    pub dry_m_s2: f64,
}

impl Coast {
    /// Returns the time at which the body stops, s; infinite if the body never stops.
    pub fn stops_s(&self) -> f64 {
        let Self { speed_m_s, viscous_1_s, dry_m_s2, .. } = *self;
        let ratio = speed_m_s / dry_m_s2;
        if dry_m_s2 > 0.0 && viscous_1_s * ratio > -1.0 {
            let is_small = (viscous_1_s * ratio).abs() < SMALL;
            if is_small { ratio } else { (viscous_1_s * ratio).ln_1p() / viscous_1_s }
        } else {
            f64::INFINITY
        }
    }

    /// Returns the position at a time, m, and its derivatives with respect to the fields of [`Coast`], in the
    /// order of the fields.
    pub fn path_m(&self, t_s: f64) -> (f64, SVector<f64, 4>) {
        let Self { start_m, speed_m_s, viscous_1_s, dry_m_s2 } = *self;
        let t = t_s.min(self.stops_s());
        let [one, two, three] = relaxation(viscous_1_s * t);
        let dspeed = t * one;
        let ddry = -t * t * two;
        // phi_1' = phi_2 - phi_1 and phi_2' = 2 phi_3 - phi_2.
        let dviscous = speed_m_s * t * t * (two - one) - dry_m_s2 * t.powi(3) * (2.0 * three - two);
        let path_m = start_m + speed_m_s * dspeed + dry_m_s2 * ddry;
        (path_m, SVector::from([1.0, dspeed, dviscous, ddry]))
    }
}

impl From<[f64; 4]> for Coast {
    fn from([start_m, speed_m_s, viscous_1_s, dry_m_s2]: [f64; 4]) -> Self {
        Self { start_m, speed_m_s, viscous_1_s, dry_m_s2 }
    }
}

/// Returns `phi_k(x)`, the sums over j of `(-x)^j / (j + k)!`, for k from 1 to 3: `(1 - exp(-x)) / x` and
/// its successors.
fn relaxation(x: f64) -> [f64; 3] {
    if x.abs() < 1.0 {
        let mut term = 1.0 / 6.0;
        let mut three = 0.0;
        for j in 0..18 {
            three += term;
            term *= -x / f64::from(j + 4);
        }
        let two = 0.5 - x * three;
        return [1.0 - x * two, two, three];
    }
    let one = -(-x).exp_m1() / x;
    let two = (1.0 - one) / x;
    [one, two, (0.5 - two) / x]
}

/// Free oscillation of a spring-loaded joint: `phi'' = -(omega^2 + delta^2) (phi - rest) - 2 delta phi'` with
/// dry friction, until friction holds the joint.
///
/// Between two turning points the joint oscillates about an equilibrium that is displaced from the rest
/// angle, towards the previous turning point, by the angle that friction holds against the spring. All
/// turning points are equally spaced in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swing {
    pub rest_rad: f64,
    /// Coefficient of the cosine, rad, in the motion about the displaced equilibrium until the first turning
    /// point, `exp(-delta t) (cosine cos(omega t) + sine sin(omega t))`.
    pub cosine_rad: f64,
    /// Coefficient of the sine in the motion until the first turning point, rad.
    pub sine_rad: f64,
    /// Decay rate delta, 1/s.
    pub viscous_1_s: f64,
    /// Damped angular frequency omega, rad/s.
    pub damped_rad_s: f64,
    /// Dry friction torque over stiffness: the largest deflection from the rest angle at which friction can
    /// hold the joint, rad.
    pub dry_rad: f64,
}

impl Swing {
    /// Returns the time of the first turning point at or after time 0, s.
    fn first_turn_s(&self) -> f64 {
        let Self { cosine_rad, sine_rad, viscous_1_s, damped_rad_s, .. } = *self;
        let rise = damped_rad_s * sine_rad - viscous_1_s * cosine_rad;
        let fall = damped_rad_s * cosine_rad + viscous_1_s * sine_rad;
        rise.atan2(fall).rem_euclid(PI) / damped_rad_s
    }

    /// Returns the number (counted from 1) of the turning point at which friction holds the joint, given the
    /// absolute value of the oscillation without dry friction at the first turning point; infinite if
    /// friction never holds the joint.
    fn last_turn(&self, first_rad: f64) -> f64 {
        let decrement = self.decrement();
        let held = 0.5 * first_rad / self.dry_rad;
        let grown = held * decrement.exp_m1();
        if self.dry_rad <= 0.0 || grown <= -1.0 {
            return f64::INFINITY;
        }
        let is_small = decrement.abs() < SMALL;
        let turns = if is_small { held } else { grown.ln_1p() / decrement };
        turns.ceil().max(1.0)
    }

    /// Returns the ratio of successive half-cycle amplitudes in the absence of dry friction.
    pub fn ratio(&self) -> f64 {
        (-self.decrement()).exp()
    }

    /// Returns the logarithmic decrement per half cycle in the absence of dry friction.
    fn decrement(&self) -> f64 {
        self.viscous_1_s * PI / self.damped_rad_s
    }

    /// Returns the time from which friction holds the joint, s; infinite if it never does.
    pub fn stops_s(&self) -> f64 {
        let first_s = self.first_turn_s();
        let last = self.last_turn(self.free(first_s).0.abs());
        first_s + (last - 1.0) * PI / self.damped_rad_s
    }

    /// Returns the joint angle at a time, rad, and its derivatives with respect to the fields of [`Swing`],
    /// in the order of the fields.
    ///
    /// The times of the turning points depend on the fields too, but do not contribute to the derivatives,
    /// because the velocity is zero at a turning point.
    pub fn angle_rad(&self, t_s: f64) -> (f64, SVector<f64, 6>) {
        let Self { rest_rad, viscous_1_s, damped_rad_s, dry_rad, .. } = *self;
        let first_s = self.first_turn_s();
        let half_s = PI / damped_rad_s;
        let (first_rad, dfirst) = self.free(first_s);
        let last = self.last_turn(first_rad.abs());
        let passed = ((t_s - first_s) / half_s + 1.0).floor().max(0.0);
        let turns = passed.min(last);
        let free_s = if passed < last { t_s } else { first_s + (last - 1.0) * half_s };
        let (now_rad, dnow) = self.free(free_s);
        // Friction reduces the amplitude by twice its angle at each turning point. Relative to the amplitude
        // of the free oscillation, the reduction grows from one turning point to the next as that amplitude
        // decays.
        let (reduction, dreduction) = geometric(self.decrement(), turns);
        let each = 2.0 * dry_rad / first_rad.abs();
        let mut dleft = each * reduction / first_rad * dfirst;
        dleft[3] -= each * dreduction * PI / damped_rad_s;
        dleft[4] += each * dreduction * viscous_1_s * PI / damped_rad_s.powi(2);
        dleft[5] = -2.0 * reduction / first_rad.abs();
        let left = 1.0 - each * reduction;
        let side = -first_rad.signum() * if turns % 2.0 == 0.0 { 1.0 } else { -1.0 };
        let mut slopes = left * dnow + now_rad * dleft;
        slopes[0] = 1.0;
        slopes[5] += side;
        (rest_rad + side * dry_rad + left * now_rad, slopes)
    }

    /// Returns the deviation from the equilibrium at time `t` in the absence of dry friction, rad, and its
    /// derivatives with respect to the fields of [`Swing`].
    fn free(&self, t: f64) -> (f64, SVector<f64, 6>) {
        let envelope = (-self.viscous_1_s * t).exp();
        let (sin, cos) = (self.damped_rad_s * t).sin_cos();
        let wave = envelope * (self.cosine_rad * cos + self.sine_rad * sin);
        let turned = envelope * (self.sine_rad * cos - self.cosine_rad * sin);
        (wave, SVector::from([0.0, envelope * cos, envelope * sin, -t * wave, t * turned, 0.0]))
    }
}

/// Returns the sum of `exp(j x)` for j from 0 to `count - 1`, and its derivative with respect to x.
fn geometric(x: f64, count: f64) -> (f64, f64) {
    if x.abs() < SMALL {
        return (count, 0.5 * count * (count - 1.0));
    }
    let sum = (count * x).exp_m1() / x.exp_m1();
    (sum, (count * (count * x).exp() - sum * x.exp()) / x.exp_m1())
}

impl From<[f64; 6]> for Swing {
    fn from(
        [rest_rad, cosine_rad, sine_rad, viscous_1_s, damped_rad_s, dry_rad]: [f64; 6],
    ) -> Self {
        Self { rest_rad, cosine_rad, sine_rad, viscous_1_s, damped_rad_s, dry_rad }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Integrates a motion from an initial position and velocity in small steps, with dry friction applied to
    /// the velocity as an impulse, and returns the final position.
    fn integrated([mut x, mut v]: [f64; 2], [spring, viscous, dry]: [f64; 3], end_s: f64) -> f64 {
        const STEPS: usize = 200_000;
        let h = end_s / STEPS as f64;
        for _ in 0..STEPS {
            let free = v - h * (spring * (x + 0.5 * h * v) + viscous * v);
            let next = free.signum() * (free.abs() - h * dry).max(0.0);
            x += 0.5 * h * (v + next);
            v = next;
        }
        x
    }

    fn slopes_are_differences<const N: usize>(
        p: [f64; N],
        value: impl Fn([f64; N]) -> (f64, SVector<f64, N>),
    ) {
        let slopes = value(p).1;
        for i in 0..N {
            let [low, high] = [-1e-6, 1e-6].map(|step| {
                let mut moved = p;
                moved[i] += step;
                value(moved).0
            });
            let difference = (high - low) / 2e-6;
            assert!((slopes[i] - difference).abs() < 1e-6, "{i}: {} {difference}", slopes[i]);
        }
    }

    #[test]
    fn a_coast_solves_its_equation_of_motion_and_stops() {
        for [viscous, dry] in [[0.8, 0.0], [0.0, 0.3], [0.8, 0.3], [1e-7, 0.3], [3.0, 0.01]] {
            let p = [0.1, 0.7, viscous, dry];
            for t in [0.01, 0.5, 1.0, 4.0] {
                let found = Coast::from(p).path_m(t).0;
                let known = 0.1 + integrated([0.0, 0.7], [0.0, viscous, dry], t);
                assert!((found - known).abs() < 1e-5, "{viscous} {dry} {t}: {found} {known}");
                slopes_are_differences(p, |p| Coast::from(p).path_m(t));
            }
            let stops = Coast::from(p).stops_s();
            assert_eq!(stops.is_finite(), dry > 0.0);
            assert!(dry == 0.0 || viscous > 1e-6 || (stops - 0.7 / 0.3).abs() < 1e-6);
        }
    }

    #[test]
    fn a_swing_solves_its_equation_of_motion_and_stops_off_its_rest_angle() {
        for [viscous, dry] in [[1.7, 0.0], [0.0, 0.02], [1.0, 0.01], [1e-12, 0.02], [0.3, 0.1]] {
            // Released at 0.5 rad, 0.05 s before time 0.
            let damped = (79.0_f64 - viscous * viscous).sqrt();
            let (sin, cos) = (0.05 * damped).sin_cos();
            let size = (0.5 - dry) * (-0.05 * viscous).exp();
            let lag = viscous / damped;
            let p = [0.0, size * (cos + lag * sin), size * (lag * cos - sin), viscous, damped, dry];
            for t in [0.01, 0.3, 0.5, 1.0, 2.1, 6.0] {
                let spring = [79.0, 2.0 * viscous, 79.0 * dry];
                let found = Swing::from(p).angle_rad(t).0;
                let known = integrated([0.5, 0.0], spring, t + 0.05);
                assert!((found - known).abs() < 2e-4, "{viscous} {dry} {t}: {found} {known}");
            }
        }
        let p = [0.02, 0.3, -0.2, 0.7, 9.0, 0.015];
        for t in [0.0, 0.2, 0.5, 1.3, 5.0] {
            slopes_are_differences(p, |p| Swing::from(p).angle_rad(t));
            slopes_are_differences([0.02, 0.3, -0.2, 0.0, 9.0, 0.0], |p| {
                Swing::from(p).angle_rad(t)
            });
        }
        let swing = Swing::from(p);
        let stops = swing.stops_s();
        let end = swing.angle_rad(60.0).0;
        assert!(stops < 5.0 && end != 0.02 && (end - 0.02).abs() <= 0.015, "{stops} {end}");
        assert!((swing.angle_rad(stops).0 - end).abs() < 1e-12);
        assert_eq!(Swing { dry_rad: 0.0, ..swing }.stops_s(), f64::INFINITY);
    }
}
