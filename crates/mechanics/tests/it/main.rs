//! Tests of steady-state motions, transients and branches against references, conservation laws and other
//! methods.

#![allow(clippy::unwrap_used, unreachable_pub)]

mod allocations;
mod chain;
mod draws;
mod effort;
mod friction;
mod motion;
mod motion_properties;
mod own_friction;
mod settling;

use trilink_robot::Laws;

/// Returns the friction laws of the model with the given name.
fn laws(model: &str) -> Laws {
    match model {
        "no-skid" | "no-skid-measured" | "no-skid-damped" => Laws::NO_SKID,
        "no-skid-roll" => Laws::NO_SKID_ROLL,
        "skid" => Laws::SKID,
        "skid-roll" => Laws::SKID_ROLL,
        "coulomb" => Laws::COULOMB,
        "coulomb-viscous" => Laws::COULOMB_VISCOUS,
        other => panic!("no model {other}"),
    }
}
