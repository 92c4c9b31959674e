//! Which steady motion the robot gets into from rest.
//!
//! Where there are several solutions, Newton's method may find any of them. The motion from
//! rest is followed, and seen at the end of every cycle, until it is near a stable solution
//! and still approaches it.

use std::f64::consts::TAU;

use super::MotionError;
use super::element::Linearised;
use super::reduced::{Driven, Reduced};
use super::ring::{Ring, Start};
use super::transient::Follower;

/// Where the motion from rest ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Arrival {
    /// Cycles after which the motion stays within [`SETTLED`] of it.
    pub cycles: usize,
    /// Whether it is the solution that the ring had.
    pub is_known: bool,
}

/// Relative distance from the steady motion at which the robot has settled.
pub const SETTLED: f64 = 0.01;
/// Distance from a stable solution at which, if it shrinks, the motion is certain to end there.
const CERTAIN: f64 = 1e-3;
/// Distance at which it need not be seen to shrink.
const THERE: f64 = 1e-5;
/// Change from cycle to cycle below which a solution is looked for nearby, unless the one that is
/// known is approached.
const SLOW: f64 = 3e-3;
/// Distance within which that solution is the one which is approached.
const NEARBY: f64 = 0.1;
const MOST_CYCLES: usize = 500;
/// Elements after which a motion is too rough to be followed any further.
const MOST_ELEMENTS: usize = 100_000;
/// Most cycles after which a motion that does not settle may repeat itself.
const MOST_PERIODS: usize = 8;
const TOLERANCE: f64 = 1e-6;

/// Follows the motion from rest until it is certain in which solution it ends; the ring holds
/// that then. The ring's own solution, where `is_solved`, is tried first.
pub(super) fn settle<const N: usize, R: Reduced<N>>(
    model: &R,
    driven: &Driven,
    ring: &mut Ring<N, R>,
    is_solved: bool,
    accuracy: f64,
    room: &mut Linearised,
) -> Result<Arrival, MotionError> {
    let period_s = TAU / driven.omega_rad_s;
    let known = is_solved.then(|| ring.start());
    let mut candidate = known.filter(|_| ring.floquet(model).is_ok_and(|modulus| modulus < 1.0));
    let mut follower = Follower::new(model, driven, TOLERANCE);
    let mut seen = [follower.state; MOST_PERIODS + 1];
    let (mut settled, mut before) = (None, f64::INFINITY);
    let mut held = known;
    for cycle in 1..=MOST_CYCLES {
        follower.advance_to(cycle as f64 * period_s, room, |_| {})?;
        seen.rotate_right(1);
        seen[0] = follower.state;
        let to_candidate = |state| {
            candidate.map_or(f64::INFINITY, |candidate| follower.distance(&candidate, state))
        };
        let mut distance = to_candidate(&follower.state);
        let approaches = distance < NEARBY && distance < before;
        if distance > SETTLED && !approaches && follower.distance(&seen[0], &seen[1]) < SLOW {
            let start = Start::State(follower.state);
            held =
                ring.solve(model, driven.omega_rad_s, start, accuracy).map(|()| ring.start()).ok();
            if let Some(found) = held
                && follower.distance(&found, &follower.state) < NEARBY
                && ring.floquet(model).is_ok_and(|modulus| modulus < 1.0)
            {
                let is_other = to_candidate(&found) > THERE;
                candidate = Some(found);
                distance = follower.distance(&found, &follower.state);
                if is_other {
                    (settled, before) = (None, f64::INFINITY);
                }
            }
        }
        settled = if distance > SETTLED { None } else { settled.or(Some(cycle)) };
        if let (Some(state), Some(cycles)) = (candidate, settled)
            && (distance < THERE || (distance < CERTAIN && distance < before))
        {
            let is_known = known.is_some_and(|known| follower.distance(&known, &state) < THERE);
            if held != candidate {
                ring.solve(model, driven.omega_rad_s, Start::State(state), accuracy)?;
            }
            return Ok(Arrival { cycles, is_known });
        }
        before = distance;
        if follower.elements > MOST_ELEMENTS {
            return Err(MotionError::Unsettled { cycles: cycle, repeats_after: None });
        }
    }
    // Not where it only creeps.
    let same = CERTAIN.min(0.05 * follower.distance(&seen[0], &seen[1]));
    let repeats_after =
        (2..=MOST_PERIODS).find(|&cycles| follower.distance(&seen[0], &seen[cycles]) < same);
    Err(MotionError::Unsettled { cycles: MOST_CYCLES, repeats_after })
}
