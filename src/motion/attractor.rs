//! The steady motion that attracts the robot from rest.
//!
//! Where there are several solutions, Newton's method may find any of them. The transient from
//! rest is integrated, and looked at after every cycle, until it is near a stable solution
//! and still approaches it.

use std::f64::consts::TAU;

use super::orbit::{PeriodicOrbit, Start};
use super::reduced::Reduced;
use super::transient::Integrator;
use super::{MotionError, Result};

/// Relative distance from the steady motion at which the robot has settled.
const SETTLED: f64 = 0.01;
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
/// Elements after which a motion is too rough to be integrated any further.
const MOST_ELEMENTS: usize = 100_000;
/// Most cycles after which a motion that does not settle may repeat itself.
const MOST_PERIODS: usize = 8;
const TOLERANCE: f64 = 1e-5;

/// Integrates the transient from rest until it is certain in which solution it ends, which the
/// orbit is then; the orbit's own solution, where `is_solved`, is tried first. Gives the cycles
/// after which the motion stays within 1 % of it, and whether it is the one that the orbit had.
pub(super) fn find_attractor<const N: usize, R: Reduced<N>>(
    model: &R,
    orbit: &mut PeriodicOrbit<N, R>,
    is_solved: bool,
    accuracy: f64,
) -> Result<(usize, bool)> {
    let period_s = TAU / model.problem().omega_rad_s;
    let known = is_solved.then_some(orbit.mesh.states.start);
    let mut candidate = known.filter(|_| orbit.is_stable(model));
    let mut transient = Integrator::new(model, TOLERANCE);
    let mut seen = [transient.state; MOST_PERIODS + 1];
    let (mut settled, mut before) = (None, f64::INFINITY);
    let mut held = known;
    for cycle in 1..=MOST_CYCLES {
        transient.advance_to(cycle as f64 * period_s, &mut orbit.workspace, |_| {})?;
        seen.rotate_right(1);
        seen[0] = transient.state;
        let to_candidate = |state| {
            candidate.map_or(f64::INFINITY, |candidate| transient.distance(&candidate, state))
        };
        let mut distance = to_candidate(&transient.state);
        let approaches = distance < NEARBY && distance < before;
        if distance > SETTLED && !approaches && transient.distance(&seen[0], &seen[1]) < SLOW {
            let start = Start::State(transient.state);
            let solved = orbit.solve(model, start, accuracy);
            held = solved.ok().map(|()| orbit.mesh.states.start);
            if let Some(found) = held
                && transient.distance(&found, &transient.state) < NEARBY
                && orbit.is_stable(model)
            {
                let is_other = to_candidate(&found) > THERE;
                candidate = Some(found);
                distance = transient.distance(&found, &transient.state);
                if is_other {
                    (settled, before) = (None, f64::INFINITY);
                }
            }
        }
        settled = if distance > SETTLED { None } else { settled.or(Some(cycle)) };
        if let (Some(state), Some(cycles)) = (candidate, settled)
            && (distance < THERE || (distance < CERTAIN && distance < before))
        {
            let is_known = known.is_some_and(|known| transient.distance(&known, &state) < THERE);
            if held != candidate {
                orbit.solve(model, Start::State(state), accuracy)?;
            }
            return Ok((cycles, is_known));
        }
        before = distance;
        if transient.elements > MOST_ELEMENTS {
            return Err(MotionError::Unsettled { cycles: cycle, repeats_after: None });
        }
    }
    // Not where it only creeps.
    let same = CERTAIN.min(0.05 * transient.distance(&seen[0], &seen[1]));
    let repeats_after =
        (2..=MOST_PERIODS).find(|&cycles| transient.distance(&seen[0], &seen[cycles]) < same);
    Err(MotionError::Unsettled { cycles: MOST_CYCLES, repeats_after })
}
