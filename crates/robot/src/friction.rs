//! Friction of a wheel in one direction, along or across its rolling direction, with its derivatives.
//!
//! ```text
//! resistance(v) = tanh(v / v_t) (F_c + (F_s - F_c) exp(-(v / v_s)^2)) + c v + F_p |v / v_t|^p sign v
//! ```
//!
//! The dry friction F_c, regularised by tanh within the transition speed v_t, is F_s at low speeds and falls
//! to F_c over the Stribeck speed v_s; c is the viscous coefficient (eq. 14 and 15). The power law |v /
//! v_t|^p sign v is implemented as s (1 + s^2)^((p - 1) / 2) with s = v / v_t, which is smooth at rest.
//!
//! Reference: B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, *A survey of models, analysis
//! tools and compensation methods for the control of machines with friction*, Automatica 30 (1994)
//! 1083-1138.

use std::fmt::Debug;

use super::{Laws, LinkNumber, Number, WheelFriction};

/// Friction law for a robot's wheels. Forces are resistances, so they have the sign of the velocity.
pub trait Friction: Copy + Debug + Send + Sync + 'static {
    /// Returns the resistance (N) of a wheel to skidding at a velocity (m/s), and its derivative with respect
    /// to the velocity (kg/s).
    fn skid<T: Number>(wheel: &WheelFriction, velocity: T) -> [T; 2];

    /// Returns the resistance (N) of a wheel to rolling at a velocity (m/s), and its derivative with respect
    /// to the velocity (kg/s).
    fn roll<T: Number>(wheel: &WheelFriction, velocity: T) -> [T; 2];

    /// Returns whether, under the given laws of a model, every friction force is proportional to the wheel's velocity in
    /// the direction of the force.
    fn is_linear(laws: Laws) -> bool;

    /// Returns the derivatives of the resistances to rolling and to skidding at the given velocities with respect to a
    /// number of the wheel: N per unit of the number; zero for a number on which they do not depend.
    fn slopes<T: Number>(
        wheel: &WheelFriction,
        number: LinkNumber,
        roll_m_s: T,
        skid_m_s: T,
    ) -> [T; 2];
}

/// Friction that is the sum of a dry term, a viscous term and a power-law term in the velocity.
#[derive(Debug, Clone, Copy)]
pub struct Dry;

impl Friction for Dry {
    fn is_linear(laws: Laws) -> bool {
        laws.are_linear()
    }

    fn slopes<T: Number>(
        wheel: &WheelFriction,
        number: LinkNumber,
        roll_m_s: T,
        skid_m_s: T,
    ) -> [T; 2] {
        let zero = T::splat(0.0);
        let roll = || Law::roll(wheel).slopes(roll_m_s);
        let skid = || Law::skid(wheel).slopes(skid_m_s);
        match number {
            LinkNumber::Roll => [roll_m_s, zero],
            LinkNumber::Skid => [zero, skid_m_s],
            LinkNumber::RollDry => [roll().dry + roll().static_, zero],
            LinkNumber::SkidDry => [zero, skid().dry],
            LinkNumber::SkidStatic => [zero, skid().static_],
            LinkNumber::Stribeck => [zero, skid().stribeck],
            LinkNumber::SkidPower => [zero, skid().power],
            LinkNumber::SkidExponent => [zero, skid().exponent],
            LinkNumber::Transition => [roll().transition, skid().transition],
            _ => [zero; 2],
        }
    }

    #[inline(always)]
    fn skid<T: Number>(wheel: &WheelFriction, velocity: T) -> [T; 2] {
        Law::skid(wheel).force(velocity)
    }

    #[inline(always)]
    fn roll<T: Number>(wheel: &WheelFriction, velocity: T) -> [T; 2] {
        Law::roll(wheel).force(velocity)
    }
}

/// Friction law of one wheel in one direction.
#[derive(Debug, Clone, Copy)]
struct Law {
    viscous_kg_s: f64,
    dry_n: f64,
    static_n: f64,
    transition_m_s: f64,
    /// Stribeck speed, m/s; zero if dry friction does not depend on speed.
    stribeck_m_s: f64,
    power_n: f64,
    exponent: f64,
}

/// Derivatives of a friction force with respect to the parameters of its law.
struct Slopes<T> {
    dry: T,
    static_: T,
    transition: T,
    stribeck: T,
    power: T,
    exponent: T,
}

impl Law {
    #[inline(always)]
    fn skid(wheel: &WheelFriction) -> Self {
        Self {
            viscous_kg_s: wheel.skid_kg_s,
            dry_n: wheel.skid_dry_n,
            static_n: wheel.skid_static_n,
            transition_m_s: wheel.transition_m_s,
            stribeck_m_s: wheel.stribeck_m_s,
            power_n: wheel.skid_power_n,
            exponent: wheel.skid_exponent,
        }
    }

    #[inline(always)]
    fn roll(wheel: &WheelFriction) -> Self {
        let dry_n = wheel.roll_dry_n;
        Self {
            viscous_kg_s: wheel.roll_kg_s,
            dry_n,
            static_n: dry_n,
            transition_m_s: wheel.transition_m_s,
            stribeck_m_s: 0.0,
            power_n: 0.0,
            exponent: 1.0,
        }
    }

    /// Returns the fraction of the excess of static over Coulomb friction that remains at a velocity, and the
    /// derivative of this fraction with respect to the velocity.
    #[inline(always)]
    fn static_fraction<T: Number>(&self, velocity: T) -> [T; 2] {
        if self.stribeck_m_s == 0.0 {
            return [T::splat(0.0); 2];
        }
        let relative = velocity * T::splat(1.0 / self.stribeck_m_s);
        let static_fraction = (-(relative * relative)).exp();
        [static_fraction, -(static_fraction * relative * T::splat(2.0 / self.stribeck_m_s))]
    }

    /// Returns the smoothed power law at a velocity relative to the transition speed, and its derivatives
    /// with respect to this relative velocity and to the exponent.
    #[inline(always)]
    fn power<T: Number>(&self, relative: T) -> [T; 3] {
        let square = T::splat(1.0) + relative * relative;
        let logarithm = T::splat(0.5) * square.ln();
        let factor = (T::splat(self.exponent - 1.0) * logarithm).exp();
        let slope = T::splat(self.exponent - 1.0) * relative * relative / square;
        let power = relative * factor;
        [power, factor * (T::splat(1.0) + slope), power * logarithm]
    }

    /// Returns the friction force at a velocity and its derivative with respect to the velocity.
    #[inline(always)]
    fn force<T: Number>(&self, velocity: T) -> [T; 2] {
        let viscous_kg_s = T::splat(self.viscous_kg_s);
        let mut smooth = [viscous_kg_s * velocity, viscous_kg_s];
        if self.power_n != 0.0 {
            let [power, dpower, _] = self.power(velocity * T::splat(1.0 / self.transition_m_s));
            smooth[0] += T::splat(self.power_n) * power;
            smooth[1] += T::splat(self.power_n / self.transition_m_s) * dpower;
        }
        if self.dry_n == 0.0 && (self.stribeck_m_s == 0.0 || self.static_n == 0.0) {
            return smooth;
        }
        let per_m_s = T::splat(1.0 / self.transition_m_s);
        let sign = (velocity * per_m_s).tanh();
        let dsign = (T::splat(1.0) - sign * sign) * per_m_s;
        let [static_fraction, dstatic_fraction] = self.static_fraction(velocity);
        let excess = T::splat(self.static_n - self.dry_n);
        let size = T::splat(self.dry_n) + excess * static_fraction;
        [smooth[0] + sign * size, smooth[1] + dsign * size + sign * excess * dstatic_fraction]
    }

    /// Returns the derivatives of the friction force at a velocity with respect to the parameters of the law.
    #[inline(always)]
    fn slopes<T: Number>(&self, velocity: T) -> Slopes<T> {
        let per_m_s = T::splat(1.0 / self.transition_m_s);
        let relative = velocity * per_m_s;
        let sign = relative.tanh();
        let [static_fraction, dstatic_fraction] = self.static_fraction(velocity);
        let excess = T::splat(self.static_n - self.dry_n);
        let size = T::splat(self.dry_n) + excess * static_fraction;
        let stribeck = match self.stribeck_m_s {
            0.0 => T::splat(0.0),
            stribeck_m_s => {
                -(sign * excess * dstatic_fraction * velocity * T::splat(1.0 / stribeck_m_s))
            }
        };
        let [power, dpower, exponent] = self.power(relative);
        let transition = (T::splat(1.0) - sign * sign) * size + T::splat(self.power_n) * dpower;
        Slopes {
            dry: sign * (T::splat(1.0) - static_fraction),
            static_: sign * static_fraction,
            transition: -(transition * relative * per_m_s),
            stribeck,
            power,
            exponent: T::splat(self.power_n) * exponent,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_are_the_derivatives_of_the_force() {
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
        let fields: [Field; 6] = [
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
