//! The friction of a wheel in one direction, along it or across, with its derivatives.
//!
//! ```text
//! resistance(v) = tanh(v / v_t) (F_c + (F_s - F_c) exp(-(v / v_s)^2)) + c v + F_p |v / v_t|^p sign v
//! ```
//!
//! Dry friction F_c, which tanh makes continuous within the transition speed v_t, is F_s at low
//! speeds and falls to F_c over the Stribeck speed v_s; c is viscous (eq. 14 and 15). For |v / v_t|^p sign v
//! stands s (1 + s^2)^((p - 1) / 2), s = v / v_t, which is smooth at rest.
//!
//! Reference: B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, *A survey of models, analysis
//! tools and compensation methods for the control of machines with friction*, Automatica 30 (1994)
//! 1083-1138.

use std::fmt::Debug;

use super::{Number, Parameter, Quantity, Robot};

/// Friction of a robot's wheels. Forces are those that resist, so of the velocity's sign.
pub trait Friction: Copy + Debug + Send + Sync + 'static {
    /// Parameters of skidding alone.
    const SKID: &'static [Parameter];
    /// Parameters of rolling, and of both.
    const ROLL: &'static [Parameter];
    /// Whether every force is in proportion to its velocity.
    const IS_LINEAR: bool;

    /// The force against a wheel's velocity across it, and its derivative with respect to that.
    fn skid<T: Number>(robot: &Robot, wheel: usize, velocity: T) -> [T; 2];

    /// The same along it.
    fn roll<T: Number>(robot: &Robot, wheel: usize, velocity: T) -> [T; 2];

    /// Gives `add` the derivatives of the force across a wheel with respect to the parameters by
    /// their places in [`Friction::SKID`] followed by [`Friction::ROLL`].
    fn skid_slopes<T: Number>(robot: &Robot, wheel: usize, velocity: T, add: impl FnMut(usize, T));

    /// The same of the force along it, by their places in [`Friction::ROLL`].
    fn roll_slopes<T: Number>(robot: &Robot, wheel: usize, velocity: T, add: impl FnMut(usize, T));
}

/// Viscous friction alone.
#[derive(Debug, Clone, Copy)]
pub struct Viscous;

impl Friction for Viscous {
    const SKID: &'static [Parameter] = &Quantity::Skid.of_each();
    const ROLL: &'static [Parameter] = &Quantity::Roll.of_each();
    const IS_LINEAR: bool = true;

    #[inline(always)]
    fn skid<T: Number>(robot: &Robot, wheel: usize, velocity: T) -> [T; 2] {
        let c_kg_s = T::of(robot.skid_kg_s[wheel]);
        [c_kg_s * velocity, c_kg_s]
    }

    #[inline(always)]
    fn roll<T: Number>(robot: &Robot, wheel: usize, velocity: T) -> [T; 2] {
        let c_kg_s = T::of(robot.roll_kg_s[wheel]);
        [c_kg_s * velocity, c_kg_s]
    }

    #[inline(always)]
    fn skid_slopes<T: Number>(_: &Robot, wheel: usize, velocity: T, mut add: impl FnMut(usize, T)) {
        add(wheel, velocity);
    }

    #[inline(always)]
    fn roll_slopes<T: Number>(_: &Robot, wheel: usize, velocity: T, mut add: impl FnMut(usize, T)) {
        add(wheel, velocity);
    }
}

/// Dry and viscous friction, and a power of the velocity.
#[derive(Debug, Clone, Copy)]
pub struct Dry;

impl Friction for Dry {
    const SKID: &'static [Parameter] = &parameters::<16>(&[
        Quantity::Skid,
        Quantity::SkidDry,
        Quantity::SkidStatic,
        Quantity::Stribeck,
        Quantity::SkidPower,
        Quantity::SkidExponent,
    ]);
    const ROLL: &'static [Parameter] =
        &parameters::<7>(&[Quantity::Roll, Quantity::RollDry, Quantity::Transition]);
    const IS_LINEAR: bool = false;

    #[inline(always)]
    fn skid<T: Number>(robot: &Robot, wheel: usize, velocity: T) -> [T; 2] {
        Law::skid(robot, wheel).force(velocity)
    }

    #[inline(always)]
    fn roll<T: Number>(robot: &Robot, wheel: usize, velocity: T) -> [T; 2] {
        Law::roll(robot, wheel).force(velocity)
    }

    #[inline(always)]
    fn skid_slopes<T: Number>(
        robot: &Robot,
        wheel: usize,
        velocity: T,
        mut add: impl FnMut(usize, T),
    ) {
        let slopes = Law::skid(robot, wheel).slopes(velocity);
        add(wheel, slopes.viscous);
        add(3 + wheel, slopes.dry);
        add(6 + wheel, slopes.static_);
        add(9, slopes.stribeck);
        add(10 + wheel, slopes.power);
        add(13 + wheel, slopes.exponent);
        add(Self::SKID.len() + 6, slopes.transition);
    }

    #[inline(always)]
    fn roll_slopes<T: Number>(
        robot: &Robot,
        wheel: usize,
        velocity: T,
        mut add: impl FnMut(usize, T),
    ) {
        let slopes = Law::roll(robot, wheel).slopes(velocity);
        add(wheel, slopes.viscous);
        add(3 + wheel, slopes.dry);
        add(6, slopes.transition);
    }
}

/// The numbers of quantities, one after the other.
const fn parameters<const COUNT: usize>(quantities: &[Quantity]) -> [Parameter; COUNT] {
    let (mut all, mut count, mut i) = ([quantities[0].of(0); COUNT], 0, 0);
    while i < quantities.len() {
        let mut place = 0;
        while place < quantities[i].count() {
            all[count] = quantities[i].of(place);
            (count, place) = (count + 1, place + 1);
        }
        i += 1;
    }
    assert!(count == COUNT, "another number of parameters");
    all
}

/// The friction of one wheel in one direction.
#[derive(Debug, Clone, Copy)]
struct Law {
    viscous_kg_s: f64,
    dry_n: f64,
    static_n: f64,
    transition_m_s: f64,
    /// 0 where dry friction is the same at all speeds.
    stribeck_m_s: f64,
    power_n: f64,
    exponent: f64,
}

/// Derivatives of a force with respect to the parameters of its law.
struct Slopes<T> {
    viscous: T,
    dry: T,
    static_: T,
    transition: T,
    stribeck: T,
    power: T,
    exponent: T,
}

impl Law {
    #[inline(always)]
    fn skid(robot: &Robot, wheel: usize) -> Self {
        Self {
            viscous_kg_s: robot.skid_kg_s[wheel],
            dry_n: robot.skid_dry_n[wheel],
            static_n: robot.skid_static_n[wheel],
            transition_m_s: robot.transition_m_s,
            stribeck_m_s: robot.stribeck_m_s,
            power_n: robot.skid_power_n[wheel],
            exponent: robot.skid_exponent[wheel],
        }
    }

    #[inline(always)]
    fn roll(robot: &Robot, wheel: usize) -> Self {
        let dry_n = robot.roll_dry_n[wheel];
        Self {
            viscous_kg_s: robot.roll_kg_s[wheel],
            dry_n,
            static_n: dry_n,
            transition_m_s: robot.transition_m_s,
            stribeck_m_s: 0.0,
            power_n: 0.0,
            exponent: 1.0,
        }
    }

    /// The part of the way from static to dry friction that is still to go at a velocity, and the
    /// derivative of that.
    #[inline(always)]
    fn slow<T: Number>(&self, velocity: T) -> [T; 2] {
        if self.stribeck_m_s == 0.0 {
            return [T::of(0.0); 2];
        }
        let relative = velocity * T::of(1.0 / self.stribeck_m_s);
        let slow = (-(relative * relative)).exp();
        [slow, -(slow * relative * T::of(2.0 / self.stribeck_m_s))]
    }

    /// The power of a relative velocity, its derivative with respect to that and to the exponent.
    #[inline(always)]
    fn power<T: Number>(&self, relative: T) -> [T; 3] {
        let square = T::of(1.0) + relative * relative;
        let logarithm = T::of(0.5) * square.ln();
        let factor = (T::of(self.exponent - 1.0) * logarithm).exp();
        let more = T::of(self.exponent - 1.0) * relative * relative / square;
        let power = relative * factor;
        [power, factor * (T::of(1.0) + more), power * logarithm]
    }

    /// The force and its derivative with respect to the velocity.
    #[inline(always)]
    fn force<T: Number>(&self, velocity: T) -> [T; 2] {
        let viscous_kg_s = T::of(self.viscous_kg_s);
        let mut smooth = [viscous_kg_s * velocity, viscous_kg_s];
        if self.power_n != 0.0 {
            let [power, dpower, _] = self.power(velocity * T::of(1.0 / self.transition_m_s));
            smooth[0] += T::of(self.power_n) * power;
            smooth[1] += T::of(self.power_n / self.transition_m_s) * dpower;
        }
        if self.dry_n == 0.0 && (self.stribeck_m_s == 0.0 || self.static_n == 0.0) {
            return smooth;
        }
        let per_m_s = T::of(1.0 / self.transition_m_s);
        let sign = (velocity * per_m_s).tanh();
        let dsign = (T::of(1.0) - sign * sign) * per_m_s;
        let [slow, dslow] = self.slow(velocity);
        let more = T::of(self.static_n - self.dry_n);
        let size = T::of(self.dry_n) + more * slow;
        [smooth[0] + sign * size, smooth[1] + dsign * size + sign * more * dslow]
    }

    #[inline(always)]
    fn slopes<T: Number>(&self, velocity: T) -> Slopes<T> {
        let per_m_s = T::of(1.0 / self.transition_m_s);
        let relative = velocity * per_m_s;
        let sign = relative.tanh();
        let [slow, dslow] = self.slow(velocity);
        let more = T::of(self.static_n - self.dry_n);
        let size = T::of(self.dry_n) + more * slow;
        let stribeck = match self.stribeck_m_s {
            0.0 => T::of(0.0),
            stribeck_m_s => -(sign * more * dslow * velocity * T::of(1.0 / stribeck_m_s)),
        };
        let [power, dpower, exponent] = self.power(relative);
        let transition = (T::of(1.0) - sign * sign) * size + T::of(self.power_n) * dpower;
        Slopes {
            viscous: velocity,
            dry: sign * (T::of(1.0) - slow),
            static_: sign * slow,
            transition: -(transition * relative * per_m_s),
            stribeck,
            power,
            exponent: T::of(self.power_n) * exponent,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_are_those_of_the_force() {
        let law = Law {
            viscous_kg_s: 3.0,
            dry_n: 1.1,
            static_n: 1.7,
            transition_m_s: 0.005,
            stribeck_m_s: 0.03,
            power_n: 0.4,
            exponent: 0.6,
        };
        type Field = (fn(&mut Law) -> &mut f64, fn(&Slopes<f64>) -> f64);
        let fields: [Field; 7] = [
            (|law| &mut law.viscous_kg_s, |slopes| slopes.viscous),
            (|law| &mut law.dry_n, |slopes| slopes.dry),
            (|law| &mut law.static_n, |slopes| slopes.static_),
            (|law| &mut law.transition_m_s, |slopes| slopes.transition),
            (|law| &mut law.stribeck_m_s, |slopes| slopes.stribeck),
            (|law| &mut law.power_n, |slopes| slopes.power),
            (|law| &mut law.exponent, |slopes| slopes.exponent),
        ];
        for velocity in [-0.2, -0.02, -0.004, 0.0, 1e-4, 0.006, 0.05] {
            let near = |found: f64, step: f64, high: f64, low: f64| {
                let known = (high - low) / (2.0 * step);
                assert!((found - known).abs() < 1e-5 * (1.0 + known.abs()), "{found}, {known}");
            };
            let force = |velocity| law.force::<f64>(velocity)[0];
            near(law.force(velocity)[1], 1e-7, force(velocity + 1e-7), force(velocity - 1e-7));
            let slopes = law.slopes(velocity);
            let without = Law { power_n: 0.0, ..law }.slopes::<f64>(velocity);
            assert_eq!(without.power, slopes.power);
            for (field, slope) in fields {
                let step = 1e-6 * *field(&mut law.clone());
                let changed = |step: f64| {
                    let mut law = law;
                    *field(&mut law) += step;
                    law.force::<f64>(velocity)[0]
                };
                near(slope(&slopes), step, changed(step), changed(-step));
            }
        }
    }
}
