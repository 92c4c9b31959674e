//! Search for the attractor that the robot reaches from rest.
//!
//! Where several periodic solutions exist, Newton's method may find any of them. The transient from rest is
//! therefore integrated and examined after every cycle, until it is close to a stable periodic solution and
//! still approaching it.

use std::f64::consts::TAU;

use super::orbit::{PeriodicOrbit, Start};
use super::reduced::Reduced;
use super::transient::Integrator;
use super::{MotionError, Result};

/// Relative distance from the steady-state motion below which the transient counts as settled.
const SETTLED_DISTANCE: f64 = 0.01;
/// Relative distance from a stable solution below which an approaching transient is certain to converge to
/// it.
const CERTAIN_DISTANCE: f64 = 1e-3;
/// Relative distance below which two states count as equal.
const COINCIDENT_DISTANCE: f64 = 1e-5;
/// Relative change per cycle below which a periodic solution is sought near the transient, unless the
/// transient is approaching a known one.
const SEARCH_CHANGE: f64 = 3e-3;
/// Relative distance from a known solution within which the transient can count as approaching that solution.
const FOLLOWED_DISTANCE: f64 = 0.1;
/// Maximum number of cycles for which the transient is integrated.
pub(super) const MAX_CYCLES: usize = 500;
/// Maximum number of cycles between two searches for a nearby periodic solution; the interval doubles after
/// each search that finds nothing new.
const MAX_PAUSE: usize = 32;
/// Maximum number of time steps (collocation elements) of the transient; motions that need more are too rough
/// to be integrated further.
const MAX_ELEMENTS: usize = 30_000;
/// Maximum period, in cycles, at which a transient that does not settle is recognised as repeating.
const MAX_PERIODS: usize = 8;
/// Relative error tolerance per time step of the transient.
const TOLERANCE: f64 = 1e-5;

/// Integrates the transient from rest, for at most `max_cycles` cycles (no more than [`MAX_CYCLES`]), until
/// it is certain to converge to a stable solution, and stores that solution in `orbit`. If `is_solved`, the
/// solution already in `orbit` is tried first. Returns the number of cycles after which the transient
/// stays within 1 % of the attractor, and whether the attractor is the original solution in `orbit`.
pub(super) fn find_attractor<const N: usize, R: Reduced<N>>(
    model: &R,
    orbit: &mut PeriodicOrbit<N, R>,
    is_solved: bool,
    accuracy: f64,
    max_cycles: usize,
) -> Result<(usize, bool)> {
    let period_s = TAU / model.omega_rad_s();
    let original = is_solved.then(|| orbit.as_start());
    let original_state = original.and_then(|original| original.state());
    let mut candidate = original.filter(|_| orbit.is_stable(model));
    let mut transient = Integrator::new(model, TOLERANCE);
    // State at the end of each cycle.
    let mut states = [transient.state; MAX_CYCLES + 1];
    let mut settled = None;
    let mut before = f64::INFINITY;
    let mut approaches = false;
    let mut orbit_solution = original;
    let mut next_look = 1;
    let mut pause = 1;
    let mut last = 0;
    let (start, cycles) = 'found: {
        for cycle in 1..=max_cycles {
            transient.advance_to(cycle as f64 * period_s, &mut orbit.workspace, |_| {})?;
            states[cycle] = transient.state;
            let candidate_state = candidate.and_then(|candidate| candidate.state());
            let mut distance = transient.distance_from(candidate_state.as_ref());
            let is_followed = distance < FOLLOWED_DISTANCE && distance < before;
            let is_slow = transient.distance(&states[cycle], &states[cycle - 1]) < SEARCH_CHANGE;
            if cycle >= next_look && distance > SETTLED_DISTANCE && !is_followed && is_slow {
                let starts = [Start::State(transient.state), Start::WholePeriod(transient.state)];
                let kinds = if model.half_period_signs().is_some() { 2 } else { 1 };
                let found = starts[..kinds].iter().find_map(|start| {
                    find_stable_nearby(model, orbit, &transient, *start, accuracy)
                });
                orbit_solution = found.map(|_| orbit.as_start());
                pause = MAX_PAUSE.min(2 * pause);
                if let Some((state, new_distance)) = found {
                    let is_other = candidate_state.is_none_or(|candidate| {
                        transient.distance(&candidate, &state) > COINCIDENT_DISTANCE
                    });
                    candidate = orbit_solution;
                    distance = new_distance;
                    if is_other {
                        settled = (1..=cycle)
                            .rev()
                            .take_while(|&cycle| {
                                transient.distance(&state, &states[cycle]) <= SETTLED_DISTANCE
                            })
                            .last();
                        before = f64::INFINITY;
                        pause = 1;
                    }
                }
                next_look = cycle + pause;
            }
            settled = if distance > SETTLED_DISTANCE { None } else { settled.or(Some(cycle)) };
            if let (Some(start), Some(cycles)) = (candidate, settled)
                && (distance < COINCIDENT_DISTANCE
                    || (distance < CERTAIN_DISTANCE && distance < before))
            {
                break 'found (start, cycles);
            }
            approaches = distance < before;
            before = distance;
            last = cycle;
            if transient.elements > MAX_ELEMENTS {
                break;
            }
        }
        // The transient still approaches the candidate, but slowly.
        if let (Some(start), Some(cycles), true) = (candidate, settled, approaches) {
            break 'found (start, cycles);
        }
        let change = transient.distance(&states[last], &states[last - 1]);
        if change < COINCIDENT_DISTANCE {
            return Err(orbit.not_converged());
        }
        // A transient that changes slowly does not count as repeating.
        let max_change = CERTAIN_DISTANCE.min(0.05 * change);
        let repeats_after = (2..=MAX_PERIODS.min(last))
            .find(|&cycles| transient.distance(&states[last], &states[last - cycles]) < max_change);
        return Err(MotionError::Unsettled { cycles: last, repeats_after });
    };
    if orbit_solution != Some(start) {
        orbit.solve(model, start, accuracy)?;
    }
    let state = orbit.mesh.states.start;
    let is_original = original_state
        .is_some_and(|original| transient.distance(&original, &state) < COINCIDENT_DISTANCE);
    Ok((cycles, is_original))
}

/// Finds a stable periodic solution near the current state of the transient. Returns the solution's state at
/// phase 0 and its relative distance from the transient; `None` if no such solution is found.
fn find_stable_nearby<const N: usize, R: Reduced<N>>(
    model: &R,
    orbit: &mut PeriodicOrbit<N, R>,
    transient: &Integrator<N, R>,
    start: Start<N>,
    accuracy: f64,
) -> Option<([f64; N], f64)> {
    orbit.solve(model, start, accuracy).ok()?;
    let state = orbit.mesh.states.start;
    let distance = transient.distance(&state, &transient.state);
    (distance < FOLLOWED_DISTANCE && orbit.is_stable(model)).then_some((state, distance))
}
