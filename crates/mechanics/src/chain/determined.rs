//! Motion that constraints and commands alone determine (eq. 3 of the paper): all joints are driven, and three wheels
//! cannot skid.
//!
//! The velocities of the reference link follow from the constraints `W w = -b` by Cramer's rule. At a singular shape, `det
//! W = 0` (eq. 4), they are bounded only if the numerators vanish as well (condition (5)); the quotient then has a limit,
//! which is interpolated from both sides.

use std::f64::consts::TAU;

use trilink_robot::{Chain, LANES, Lanes, Number};

use super::balance::System;
use crate::radau::bisect;
use crate::{MotionError, Result};

/// Phases at which singular shapes are searched for.
const PHASES: usize = 360;
/// Relative size of `det W` below which the velocities are interpolated from neighbouring phases.
const NEAR_SINGULAR: f64 = 1e-4;
/// Distance in phase of the neighbours from which velocities are interpolated, rad.
const OFFSET_RAD: f64 = 2e-3;
/// Weights of the neighbours, for interpolation to fourth order, and their distances in units of [`OFFSET_RAD`].
const NEIGHBOURS: [(f64, f64); 4] =
    [(-1.0 / 6.0, -2.0), (4.0 / 6.0, -1.0), (4.0 / 6.0, 1.0), (-1.0 / 6.0, 2.0)];
/// Distances in phase from a singular shape at which velocities are compared, rad.
const DISTANCES_RAD: [f64; 2] = [1e-2, 1e-6];
/// Ratio of the two from which velocities grow without bounds.
const MAX_GROWTH: f64 = 10.0;

/// Singular shapes through which a gait passes, of those at which `det W` changes its sign between [`PHASES`].
#[derive(Debug, Clone)]
pub(super) struct Determined {
    /// Size of `det W` below which velocities are interpolated, m.
    near_m: f64,
    crossings_rad: Vec<f64>,
}

/// Solution of the constraints at one phase.
#[derive(Debug, Clone, Copy)]
struct CramerSolution<T> {
    velocities: [T; 3],
    det_m: T,
    /// Columns of the inverse of `W`: minus the derivatives of the velocities with respect to the skid velocity that each
    /// wheel has while the reference link is at rest.
    by_skid: [[T; 3]; 3],
}

impl<T: Number> CramerSolution<T> {
    #[inline(always)]
    fn at(system: &System, phase_rad: T) -> Self {
        let zero = T::splat(0.0);
        let node = system.node::<T, 1>(phase_rad);
        let posture = system.posture(&node.clusters, [zero; 3], [zero], [zero]);
        let mut rows = [[zero; 3]; 3];
        let mut at_rest = [zero; 3];
        for i in 0..3 {
            let wheel = system.wheel(&posture, &node.wheels[i], 0);
            rows[i] = system.skid_row::<T, 1, 3>(&posture, &wheel, 0);
            at_rest[i] = wheel.skid_m_s;
        }
        let cofactors = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| cross(&rows[i], &rows[j]));
        let det_m = (0..3).fold(zero, |sum, k| sum + rows[0][k] * cofactors[0][k]);
        let by_skid = cofactors.map(|row| row.map(|entry| entry / det_m));
        let mut velocities = [zero; 3];
        for (at_rest, by_skid) in at_rest.iter().zip(&by_skid) {
            (0..3).for_each(|k| velocities[k] -= *at_rest * by_skid[k]);
        }
        Self { velocities, det_m, by_skid }
    }
}

#[inline(always)]
fn cross<T: Number>(a: &[T; 3], b: &[T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Singular shape at a phase.
#[derive(Debug, Clone, Copy)]
pub(super) struct Crossing {
    phase_rad: f64,
}

impl Crossing {
    /// Returns phases at decreasing distances from the singular shape; see [`is_unbounded`].
    pub(super) fn approach_rad(self) -> [f64; 2] {
        DISTANCES_RAD.map(|distance_rad| self.phase_rad + distance_rad)
    }

    fn is_unbounded(self, size_at: impl Fn(f64) -> f64) -> bool {
        is_unbounded(self.approach_rad().map(size_at))
    }
}

/// Returns whether a quantity with the given sizes at [`Crossing::approach_rad`], in SI units, grows without bounds.
pub(super) fn is_unbounded([far, near]: [f64; 2]) -> bool {
    /// Size that rounding can have near a singular shape.
    const ROUNDING: f64 = 1e-9;
    near.is_nan() || near > MAX_GROWTH * far.max(ROUNDING)
}

impl Determined {
    /// Examines the singular shapes through which the gait passes.
    ///
    /// # Errors
    /// Returns an error if all shapes of the gait are singular, or if the velocities are unbounded at one.
    pub(super) fn new(system: &System, chain: &Chain) -> Result<Self> {
        const BISECTIONS: usize = 40;
        const DEPENDENT: f64 = 1e-12;
        let phase_rad = |i: usize| TAU * (i as f64 + 0.5) / PHASES as f64;
        let mut dets_m = [0.0; PHASES + 1];
        for pack in 0..PHASES / LANES {
            let phases = Lanes::new(std::array::from_fn(|lane| phase_rad(pack * LANES + lane)));
            let CramerSolution { det_m, .. } = CramerSolution::at(system, phases);
            (0..LANES).for_each(|lane| dets_m[pack * LANES + lane] = det_m.lane(lane));
        }
        dets_m[PHASES] = dets_m[0];
        let largest_m = dets_m.iter().fold(0.0_f64, |largest, det_m| largest.max(det_m.abs()));
        if largest_m.is_nan() || largest_m <= DEPENDENT * chain.skid_length_m {
            // All shapes of the gait are singular.
            return Err(MotionError::Singular { phase_rad: phase_rad(0) });
        }
        let mut determined = Self { near_m: NEAR_SINGULAR * largest_m, crossings_rad: Vec::new() };
        for i in (0..PHASES).filter(|i| dets_m[*i] * dets_m[i + 1] <= 0.0) {
            let det_m = |phase_rad: f64| CramerSolution::at(system, phase_rad).det_m;
            determined.crossings_rad.push(bisect(
                det_m,
                phase_rad(i),
                phase_rad(i + 1),
                BISECTIONS,
            ));
        }
        let size_at = |phase_rad: f64| {
            let CramerSolution { velocities: [u, v, r], .. } =
                CramerSolution::at(system, phase_rad);
            u.abs().max(v.abs()).max(r.abs() * chain.skid_length_m)
        };
        if let Some(unbounded) =
            determined.crossings().find(|crossing| crossing.is_unbounded(size_at))
        {
            return Err(MotionError::Singular { phase_rad: unbounded.phase_rad });
        }
        Ok(determined)
    }

    /// Returns the singular shapes through which the gait passes.
    pub(super) fn crossings(&self) -> impl Iterator<Item = Crossing> {
        self.crossings_rad.iter().map(|phase_rad| Crossing { phase_rad: *phase_rad })
    }

    /// Returns the phases, with their weights, from which a function of the phase is interpolated near a singular shape;
    /// elsewhere the phase itself.
    #[inline(always)]
    pub(super) fn points<T: Number>(
        &self,
        system: &System,
        phase_rad: T,
    ) -> (usize, [(f64, T); 4]) {
        let CramerSolution { det_m, .. } = CramerSolution::at(system, phase_rad);
        let is_near = (0..T::COUNT).any(|lane| det_m.lane(lane).abs() <= self.near_m);
        if is_near {
            let points = NEIGHBOURS
                .map(|(weight, steps)| (weight, phase_rad + T::splat(steps * OFFSET_RAD)));
            return (4, points);
        }
        (1, [(1.0, phase_rad); 4])
    }

    /// Returns the velocities of the reference link along and across itself and its turning rate.
    #[inline(always)]
    pub(super) fn velocities<T: Number>(&self, system: &System, phase_rad: T) -> [T; 3] {
        let (count, points) = self.points(system, phase_rad);
        let mut velocities = [T::splat(0.0); 3];
        for (weight, phase_rad) in &points[..count] {
            let of_point = CramerSolution::at(system, *phase_rad).velocities;
            (0..3).for_each(|k| velocities[k] += T::splat(*weight) * of_point[k]);
        }
        velocities
    }

    /// Returns the time derivatives of the velocities, by central differences of fourth order, followed by zeros.
    pub(super) fn rates<const N: usize>(&self, system: &System, phase_rad: f64) -> [f64; N] {
        const STEP_RAD: f64 = 1e-3;
        let at = |steps: f64| self.velocities(system, phase_rad + steps * STEP_RAD);
        let [before, after, far_before, far_after] = [at(-1.0), at(1.0), at(-2.0), at(2.0)];
        let per_s = system.clusters.omega_rad_s / (12.0 * STEP_RAD);
        std::array::from_fn(|i| match i {
            0..3 => per_s * (8.0 * (after[i] - before[i]) - (far_after[i] - far_before[i])),
            _ => 0.0,
        })
    }
}

/// Returns the velocities `w` at a phase, and the factors `f`, one per wheel, for which a change `ds` in the wheels' skid
/// velocities at fixed `w` changes `factors` times `w` by `-f` times `ds`.
pub(super) fn velocities_and_factors<T: Number>(
    system: &System,
    phase_rad: T,
    factors: &[T; 3],
) -> ([T; 3], [T; 3]) {
    let CramerSolution { velocities, by_skid, .. } = CramerSolution::at(system, phase_rad);
    let of_wheels =
        by_skid.map(|by_skid| (0..3).fold(T::splat(0.0), |sum, k| sum + factors[k] * by_skid[k]));
    (velocities, of_wheels)
}
