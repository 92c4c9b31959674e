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
pub(super) const MOST_CYCLES: usize = 500;
/// Most cycles until a solution is looked for again after nothing new was found: twice as many each time.
const LONGEST_PAUSE: usize = 32;
/// Elements after which a motion is too rough to be integrated any further.
const MOST_ELEMENTS: usize = 30_000;
/// Most cycles after which a motion that does not settle may repeat itself.
const MOST_PERIODS: usize = 8;
const TOLERANCE: f64 = 1e-5;

/// Integrates the transient from rest, for at most `most_cycles` of [`MOST_CYCLES`], until it is
/// certain in which solution it ends, which the orbit is then; the orbit's own solution, where
/// `is_solved`, is tried first. Gives the cycles after which the motion stays within 1 % of it, and
/// whether it is the one that the orbit had.
pub(super) fn find_attractor<const N: usize, R: Reduced<N>>(
    model: &R,
    orbit: &mut PeriodicOrbit<N, R>,
    is_solved: bool,
    accuracy: f64,
    most_cycles: usize,
) -> Result<(usize, bool)> {
    let period_s = TAU / model.problem().omega_rad_s;
    let known = is_solved.then(|| orbit.here());
    let known_state = known.and_then(|known| known.state());
    let mut candidate = known.filter(|_| orbit.is_stable(model));
    let mut transient = Integrator::new(model, TOLERANCE);
    // At the end of every cycle.
    let mut states = [transient.state; MOST_CYCLES + 1];
    let (mut settled, mut before, mut approaches) = (None, f64::INFINITY, false);
    let (mut held, mut next_look, mut pause, mut last) = (known, 1, 1, 0);
    let (start, cycles) = 'found: {
        for cycle in 1..=most_cycles {
            transient.advance_to(cycle as f64 * period_s, &mut orbit.workspace, |_| {})?;
            states[cycle] = transient.state;
            let far = |candidate: Option<[f64; N]>, state: &[f64; N]| {
                candidate.map_or(f64::INFINITY, |candidate| transient.distance(&candidate, state))
            };
            let candidate_state = candidate.and_then(|candidate| candidate.state());
            let mut distance = far(candidate_state, &transient.state);
            let is_followed = distance < NEARBY && distance < before;
            let is_slow = transient.distance(&states[cycle], &states[cycle - 1]) < SLOW;
            if cycle >= next_look && distance > SETTLED && !is_followed && is_slow {
                let starts = [Start::State(transient.state), Start::WholePeriod(transient.state)];
                let kinds = if model.half_period_signs().is_some() { 2 } else { 1 };
                let mut near = starts.into_iter().take(kinds);
                let found =
                    near.find_map(|start| stable_near(model, orbit, &transient, start, accuracy));
                held = found.map(|_| orbit.here());
                pause = LONGEST_PAUSE.min(2 * pause);
                if let Some((state, now)) = found {
                    let is_other = far(candidate_state, &state) > THERE;
                    (candidate, distance) = (held, now);
                    if is_other {
                        let there = |&cycle: &usize| far(Some(state), &states[cycle]) <= SETTLED;
                        settled = (1..=cycle).rev().take_while(there).last();
                        (before, pause) = (f64::INFINITY, 1);
                    }
                }
                next_look = cycle + pause;
            }
            settled = if distance > SETTLED { None } else { settled.or(Some(cycle)) };
            if let (Some(start), Some(cycles)) = (candidate, settled)
                && (distance < THERE || (distance < CERTAIN && distance < before))
            {
                break 'found (start, cycles);
            }
            (approaches, before) = (distance < before, distance);
            last = cycle;
            if transient.elements > MOST_ELEMENTS {
                break;
            }
        }
        // Slowly, but it gets there.
        if let (Some(start), Some(cycles), true) = (candidate, settled, approaches) {
            break 'found (start, cycles);
        }
        let ago = |cycles: usize| transient.distance(&states[last], &states[last - cycles]);
        if ago(1) < THERE {
            return Err(orbit.not_converged());
        }
        // Not where it only creeps.
        let same = CERTAIN.min(0.05 * ago(1));
        let repeats_after = (2..=MOST_PERIODS.min(last)).find(|&cycles| ago(cycles) < same);
        return Err(MotionError::Unsettled { cycles: last, repeats_after });
    };
    if held != Some(start) {
        orbit.solve(model, start, accuracy)?;
    }
    let state = orbit.mesh.states.start;
    let is_known = known_state.is_some_and(|known| transient.distance(&known, &state) < THERE);
    Ok((cycles, is_known))
}

/// The state at phase 0 of the stable solution near a start from where the transient is, and how far
/// from there it is.
fn stable_near<const N: usize, R: Reduced<N>>(
    model: &R,
    orbit: &mut PeriodicOrbit<N, R>,
    transient: &Integrator<N, R>,
    start: Start<N>,
    accuracy: f64,
) -> Option<([f64; N], f64)> {
    orbit.solve(model, start, accuracy).ok()?;
    let state = orbit.mesh.states.start;
    let distance = transient.distance(&state, &transient.state);
    (distance < NEARBY && orbit.is_stable(model)).then_some((state, distance))
}
