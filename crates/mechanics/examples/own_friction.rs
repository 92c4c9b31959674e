//! User-defined friction law: the dry friction F s / sqrt(1 + s^2) with s = v / v_t reverses its sign more
//! gradually than the built-in F tanh(s).
//!
//! `cargo run -p trilink-mechanics --example own_friction` prints the displacement per cycle under both
//! laws.

use trilink_mechanics::{Laws, MotionError, Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::{Friction, Gait, LinkNumber, Number, Robot, WheelFriction};

/// Dry friction `F s / sqrt(1 + s^2)` across the wheels' rolling direction, where s is the skid velocity over
/// the transition speed, with the coefficients of [`Laws::COULOMB`]; the wheels roll freely.
#[derive(Debug, Clone, Copy)]
pub struct Algebraic;

impl Friction for Algebraic {
    fn is_linear(_: Laws) -> bool {
        false
    }

    fn skid<T: Number>(wheel: &WheelFriction, velocity: T) -> [T; 2] {
        let dry_n = wheel.skid_dry_n;
        let per_m_s = 1.0 / wheel.transition_m_s;
        let relative = velocity * T::splat(per_m_s);
        let root = inverse_root(relative);
        [T::splat(dry_n) * relative * root, T::splat(dry_n * per_m_s) * root * root * root]
    }

    fn roll<T: Number>(_: &WheelFriction, _: T) -> [T; 2] {
        [T::splat(0.0); 2]
    }

    fn slopes<T: Number>(wheel: &WheelFriction, number: LinkNumber, _: T, skid_m_s: T) -> [T; 2] {
        let relative = skid_m_s * T::splat(1.0 / wheel.transition_m_s);
        let [_, slope] = Self::skid(wheel, skid_m_s);
        let skid = match number {
            LinkNumber::SkidDry => relative * inverse_root(relative),
            LinkNumber::Transition => -(slope * relative),
            _ => T::splat(0.0),
        };
        [T::splat(0.0), skid]
    }
}

/// Returns 1 / sqrt(1 + s^2) for the relative velocity s.
fn inverse_root<T: Number>(relative: T) -> T {
    (T::splat(-0.5) * (T::splat(1.0) + relative * relative).ln()).exp()
}

fn main() -> Result<(), MotionError> {
    let laws = Laws { roll: trilink_robot::RollLaw::None, ..Laws::COULOMB };
    let robot = Robot { skid_dry_n: [0.5, 0.3, 0.3], ..Robot::kinematic() };
    let problem = Problem::new(robot, Gait::symmetric(), laws, 3.9);
    let tanh = Solver::default().solve(&problem, REFERENCE_ACCURACY)?;
    let algebraic = Solver::with_friction::<Algebraic>().solve(&problem, REFERENCE_ACCURACY)?;
    println!(
        "d = {:.2} mm with tanh, {:.2} mm with the algebraic law",
        1e3 * tanh.d_m,
        1e3 * algebraic.d_m
    );
    Ok(())
}
