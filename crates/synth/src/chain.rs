//! Draws true coefficients of chains.

use rand_chacha::ChaCha8Rng;
use trilink_robot::{Chain, Joint, WheelFriction};

use super::planted::{add_servo_errors, random_factor};

/// Draws a campaign's true skid coefficients and the errors of the servos; returns the chain with both.
pub(super) fn planted(mut chain: Chain, random: &mut ChaCha8Rng) -> Chain {
    change_friction(&mut chain, |_, friction| friction.skid_kg_s *= random_factor(random));
    with_servo_errors(chain, random)
}

/// Draws the true viscous and dry skid coefficients of a robot from `of_robot`, and the errors of the servos from
/// `random`; returns the chain with both.
pub(super) fn planted_dry(
    mut chain: Chain,
    of_robot: &mut ChaCha8Rng,
    random: &mut ChaCha8Rng,
) -> Chain {
    change_friction(&mut chain, |_, friction| {
        let [viscous, dry] = [(); 2].map(|()| random_factor(of_robot));
        friction.skid_kg_s *= viscous;
        for force_n in
            [&mut friction.skid_dry_n, &mut friction.skid_static_n, &mut friction.skid_power_n]
        {
            *force_n *= dry;
        }
    });
    with_servo_errors(chain, random)
}

fn with_servo_errors(mut chain: Chain, random: &mut ChaCha8Rng) -> Chain {
    let driven = chain.joints.iter_mut().filter_map(|joint| match joint {
        Joint::Driven(command) => Some(command),
        Joint::Free(_) => None,
    });
    add_servo_errors(driven, random);
    chain
}

/// Changes the friction of each wheel by a function of the number of its link.
pub(super) fn change_friction(
    chain: &mut Chain,
    mut change: impl FnMut(usize, &mut WheelFriction),
) {
    for (number, place) in chain.numbering().into_iter().enumerate() {
        if let Some(wheel) = &mut chain.links[place].wheel {
            change(number, &mut wheel.friction);
        }
    }
}
