//! Motions that die away by viscous resistance, by dry friction, or by both, in closed form.
//!
//! Dry friction is in its limit of no transition speed: it has one size while there is motion,
//! against it, and holds whatever stands still and is pushed by less.

use std::f64::consts::PI;

use nalgebra::SVector;
use trilink_base::named;

/// Rates and decrements that are smaller are 0, so that nothing is divided by them.
const SMALL: f64 = 1e-9;

named! {
    /// What a motion that dies away is resisted by.
    pub enum DecayLaw {
        /// In proportion to the velocity.
        Viscous = "viscous",
        /// Dry friction.
        Coulomb = "coulomb",
        /// Both.
        CoulombViscous = "coulomb-viscous",
    }
}

impl DecayLaw {
    /// Whether there is a part in proportion to the velocity.
    pub fn is_viscous(self) -> bool {
        self != Self::Coulomb
    }

    /// Whether there is dry friction.
    pub fn is_dry(self) -> bool {
        self != Self::Viscous
    }
}

/// Path of what coasts: `v' = -lambda v - g` until it stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coast {
    /// At time 0, m and m/s.
    pub start_m: f64,
    pub speed_m_s: f64,
    /// Viscous resistance over mass.
    pub viscous_1_s: f64,
    /// Dry friction over mass, m/s^2.
    pub dry_m_s2: f64,
}

impl Coast {
    /// When it stops, s; infinite if it does not.
    pub fn stops_s(&self) -> f64 {
        let Self { speed_m_s, viscous_1_s, dry_m_s2, .. } = *self;
        let ratio = speed_m_s / dry_m_s2;
        match dry_m_s2 > 0.0 && viscous_1_s * ratio > -1.0 {
            true if (viscous_1_s * ratio).abs() < SMALL => ratio,
            true => (viscous_1_s * ratio).ln_1p() / viscous_1_s,
            false => f64::INFINITY,
        }
    }

    /// Path length at a time, m, and its derivatives by the parameters in their order.
    pub fn path_m(&self, t_s: f64) -> (f64, SVector<f64, 4>) {
        let Self { start_m, speed_m_s, viscous_1_s, dry_m_s2 } = *self;
        let t = t_s.min(self.stops_s());
        let [one, two, three] = relaxation(viscous_1_s * t);
        let by_speed = t * one;
        let by_dry = -t * t * two;
        // phi_1' = phi_2 - phi_1 and phi_2' = 2 phi_3 - phi_2.
        let by_viscous =
            speed_m_s * t * t * (two - one) - dry_m_s2 * t.powi(3) * (2.0 * three - two);
        let path_m = start_m + speed_m_s * by_speed + dry_m_s2 * by_dry;
        (path_m, SVector::from([1.0, by_speed, by_viscous, by_dry]))
    }
}

impl From<[f64; 4]> for Coast {
    fn from([start_m, speed_m_s, viscous_1_s, dry_m_s2]: [f64; 4]) -> Self {
        Self { start_m, speed_m_s, viscous_1_s, dry_m_s2 }
    }
}

/// `phi_k(x)`, the sums over j of `(-x)^j / (j + k)!`, of k from 1 to 3: `(1 - exp(-x)) / x` and what
/// follows it.
fn relaxation(x: f64) -> [f64; 3] {
    if x.abs() < 1.0 {
        let (mut term, mut three) = (1.0 / 6.0, 0.0);
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

/// Angle of a joint with a spring, let go: `phi'' = -(omega^2 + delta^2) (phi - rest) - 2 delta phi'`,
/// less what dry friction makes of it, until that holds it.
///
/// From one turn to the next it swings about an angle that lies off its rest by what friction holds
/// against the spring, to the side that it comes from. All turns have the same time between them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swing {
    pub rest_rad: f64,
    /// The swing until the first turn is `exp(-delta t) (cosine cos(omega t) + sine sin(omega t))`
    /// about its middle.
    pub cosine_rad: f64,
    pub sine_rad: f64,
    /// delta and omega.
    pub viscous_1_s: f64,
    pub damped_rad_s: f64,
    /// Dry torque over stiffness: how far off its rest the joint can stand still.
    pub dry_rad: f64,
}

impl Swing {
    /// The first turn from time 0 on, s.
    fn first_turn_s(&self) -> f64 {
        let Self { cosine_rad, sine_rad, viscous_1_s, damped_rad_s, .. } = *self;
        let rise = damped_rad_s * sine_rad - viscous_1_s * cosine_rad;
        let fall = damped_rad_s * cosine_rad + viscous_1_s * sine_rad;
        rise.atan2(fall).rem_euclid(PI) / damped_rad_s
    }

    /// The turn at which friction holds it, counted from 1; infinite if it does not.
    fn last_turn(&self, first_rad: f64) -> f64 {
        let (decrement, held) = (self.decrement(), 0.5 * first_rad / self.dry_rad);
        let grown = held * decrement.exp_m1();
        if self.dry_rad <= 0.0 || grown <= -1.0 {
            return f64::INFINITY;
        }
        let is_small = decrement.abs() < SMALL;
        let turns = if is_small { held } else { grown.ln_1p() / decrement };
        turns.ceil().max(1.0)
    }

    /// What is left of the amplitude from one turn to the next without dry friction.
    pub fn ratio(&self) -> f64 {
        (-self.decrement()).exp()
    }

    /// Logarithm of what a turn's amplitude is over the next one's without dry friction.
    fn decrement(&self) -> f64 {
        self.viscous_1_s * PI / self.damped_rad_s
    }

    /// When friction holds it, s; infinite if it does not.
    pub fn stops_s(&self) -> f64 {
        let first_s = self.first_turn_s();
        let last = self.last_turn(self.free(first_s).0.abs());
        first_s + (last - 1.0) * PI / self.damped_rad_s
    }

    /// Angle at a time, rad, and its derivatives by the parameters in their order.
    ///
    /// A turn's time moves with the parameters, but the velocity there is 0.
    pub fn angle_rad(&self, t_s: f64) -> (f64, SVector<f64, 6>) {
        let Self { rest_rad, viscous_1_s, damped_rad_s, dry_rad, .. } = *self;
        let (first_s, half_s) = (self.first_turn_s(), PI / damped_rad_s);
        let (first_rad, dfirst) = self.free(first_s);
        let last = self.last_turn(first_rad.abs());
        let passed = ((t_s - first_s) / half_s + 1.0).floor().max(0.0);
        let turns = passed.min(last);
        let (now_rad, dnow) = match passed < last {
            true => self.free(t_s),
            false => self.free(first_s + (last - 1.0) * half_s),
        };
        // Of the amplitude, friction takes twice its angle at each turn. Over the free swing at the
        // first turn that is as much as a turn's own amplitude is smaller than that.
        let (taken, dtaken) = geometric(self.decrement(), turns);
        let each = 2.0 * dry_rad / first_rad.abs();
        let mut dleft = each * taken / first_rad * dfirst;
        dleft[3] -= each * dtaken * PI / damped_rad_s;
        dleft[4] += each * dtaken * viscous_1_s * PI / damped_rad_s.powi(2);
        dleft[5] = -2.0 * taken / first_rad.abs();
        let left = 1.0 - each * taken;
        let side = -first_rad.signum() * if turns % 2.0 == 0.0 { 1.0 } else { -1.0 };
        let mut slopes = left * dnow + now_rad * dleft;
        slopes[0] = 1.0;
        slopes[5] += side;
        (rest_rad + side * dry_rad + left * now_rad, slopes)
    }

    /// The swing without dry friction, with its derivatives at a given time.
    fn free(&self, t: f64) -> (f64, SVector<f64, 6>) {
        let (envelope, (sin, cos)) =
            ((-self.viscous_1_s * t).exp(), (self.damped_rad_s * t).sin_cos());
        let wave = envelope * (self.cosine_rad * cos + self.sine_rad * sin);
        let turned = envelope * (self.sine_rad * cos - self.cosine_rad * sin);
        (wave, SVector::from([0.0, envelope * cos, envelope * sin, -t * wave, t * turned, 0.0]))
    }
}

/// `sum(exp(j x))` over j below a count, and its derivative by x.
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

    /// What begins at a position with a velocity, by small steps; friction takes from the velocity
    /// what it can.
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
            let moved = |by: f64| {
                let mut moved = p;
                moved[i] += by;
                value(moved).0
            };
            let difference = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            assert!((slopes[i] - difference).abs() < 1e-6, "{i}: {} {difference}", slopes[i]);
        }
    }

    #[test]
    fn a_coast_is_its_equation_s_solution_and_stops() {
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
    fn a_swing_is_its_equation_s_solution_and_stops_off_its_rest() {
        for [viscous, dry] in [[1.7, 0.0], [0.0, 0.02], [1.0, 0.01], [1e-12, 0.02], [0.3, 0.1]] {
            // Let go at 0.5 rad 0.05 s before time 0.
            let damped = (79.0_f64 - viscous * viscous).sqrt();
            let (sin, cos) = (0.05 * damped).sin_cos();
            let (size, lag) = ((0.5 - dry) * (-0.05 * viscous).exp(), viscous / damped);
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
        let (stops, end) = (swing.stops_s(), swing.angle_rad(60.0).0);
        assert!(stops < 5.0 && end != 0.02 && (end - 0.02).abs() <= 0.015, "{stops} {end}");
        assert!((swing.angle_rad(stops).0 - end).abs() < 1e-12);
        assert_eq!(Swing { dry_rad: 0.0, ..swing }.stops_s(), f64::INFINITY);
    }
}
