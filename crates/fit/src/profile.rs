//! Objective profiles: one free parameter is held fixed and the others are fitted.
//!
//! The profile's interval contains the parameter values at which the objective is below a threshold. For least squares
//! the threshold follows from the chi-square distribution; there is no such distribution for a sum of absolute values,
//! so that resamples determine the threshold. Holding the parameter at its fitted value raises the objective of each
//! resample; the threshold is the rise that 95 of 100 resamples do not exceed. Resamples are fitted with the objective
//! linearised at the fit, without solving the model again, and widened for the degrees of freedom of the noise.
//!
//! Reference: A. Raue et al., *Structural and practical identifiability analysis of partially
//! observed dynamical models by exploiting the profile likelihood*, Bioinformatics 25 (2009).

use rayon::prelude::*;
use trilink_mechanics::REFERENCE_ACCURACY;
use trilink_statistics::quantiles_low;

use super::fitted_point::{FittedPoint, HeldPoint};
use super::least_absolute::{minimise, sum};
use super::resample::DrawnTrial;
use super::search::limits;
use super::variation::Variation;

/// Level of the quantile, over the resamples, of the rise in the objective that determines the threshold of a profile.
const LEVEL: f64 = 0.95;
/// Number of resamples from which the threshold of a profile is determined.
const RESAMPLES: usize = 400;
/// First step along a profile, as a change in the logarithm of its parameter.
const FIRST_STEP: f64 = 0.03;
/// Ratio between successive steps along a profile.
const GROWTH: f64 = 1.8;
/// Tolerance for locating the point where the profile crosses the threshold, as a fraction of its distance from the
/// estimate on a log scale.
const CROSSING_TOLERANCE: f64 = 0.02;
/// Maximum change in the logarithm of a coefficient for which linearised residuals are used.
const RADIUS: f64 = 1.0;
/// Substitute for a missing bound: a shift of a parameter's logarithm that no fit of a resample reaches.
const UNBOUNDED_LOG: f64 = 30.0;

/// Identifiability of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Class {
    Identifiable,
    /// The profile stays below its threshold up to at least one bound of the parameter.
    PracticallyNot,
    /// The objective does not change with the parameter.
    StructurallyNot,
}

/// Objective profile of one parameter.
#[derive(Debug, Clone)]
pub(super) struct Profile {
    /// Points of the profile in ascending order of the parameter, including the fit itself.
    pub points: Vec<HeldPoint>,
    pub limit: f64,
    /// Values of the parameter, below and above the fitted one, at which the profile crosses its threshold; `None`
    /// where it does not cross before the bound.
    pub interval: [Option<f64>; 2],
    pub class: Class,
    pub solves: usize,
}

/// Returns the numerical error of an objective due to the search and the solver.
fn inaccuracy(cost: f64) -> f64 {
    5e-6 + 1e-5 * cost
}

/// Returns the threshold of the objective for the profile of each parameter; infinite if every parameter is at a bound.
///
/// A coefficient that is at a bound stays there when resamples are fitted, whatever the noise. Holding it fixed then
/// does not raise their objectives, and these determine no threshold for it (S. G. Self and K.-Y. Liang, J. Am. Stat.
/// Assoc. 82 (1987) 605). Its threshold is the largest among the coefficients that are not at a bound.
pub(super) fn profile_limits(fit: &FittedPoint, variation: &Variation) -> Vec<f64> {
    let parameters = &fit.evaluator.parameters;
    let bounds = limits(parameters, &fit.values, RADIUS);
    let rises: Vec<Vec<f64>> = (0..RESAMPLES)
        .into_par_iter()
        .map(|number| resampled_rises(fit, &bounds, &variation.draw(number)))
        .collect();
    let widenings = variation.widenings(fit);
    let own: Vec<f64> = (0..bounds.len())
        .map(|index| {
            let rises = rises.iter().map(|rises| rises[index]).collect();
            let rise = widenings[index].powi(2) * quantiles_low(rises, [LEVEL])[0];
            fit.cost + rise.max(2.0 * inaccuracy(fit.cost))
        })
        .collect();
    let is_at_bound: Vec<bool> = parameters
        .iter()
        .zip(&fit.values)
        .map(|(of, value)| of.is_at_bound(*value))
        .map(|sides| sides.contains(&true))
        .collect();
    let determined = own.iter().zip(&is_at_bound).filter(|(_, at_bound)| !**at_bound);
    let max_determined =
        determined.map(|(limit, _)| *limit).reduce(f64::max).unwrap_or(f64::INFINITY);
    own.iter()
        .zip(&is_at_bound)
        .map(|(own, at_bound)| if *at_bound { max_determined } else { *own })
        .collect()
}

/// Returns, for each parameter, the rise of a resample's linearised objective when that parameter is held fixed.
fn resampled_rises(fit: &FittedPoint, bounds: &[[f64; 2]], resample: &[DrawnTrial]) -> Vec<f64> {
    let residuals = fit.resampled_residuals(resample);
    let free = minimise(&residuals, bounds, None);
    (0..bounds.len())
        .map(|index| {
            let lowest = if bounds[index].contains(&free[index]) {
                minimise(&residuals, &with_unbounded(bounds, index), None)
            } else {
                free.clone()
            };
            let held = minimise(&residuals, bounds, Some(index));
            sum(&residuals, &held) - sum(&residuals, &lowest)
        })
        .collect()
}

/// Returns the bounds with one parameter unbounded, so that the bound does not limit the rise of a resample's
/// linearised objective.
fn with_unbounded(bounds: &[[f64; 2]], index: usize) -> Vec<[f64; 2]> {
    let mut open = bounds.to_vec();
    open[index] = [-UNBOUNDED_LOG, UNBOUNDED_LOG];
    open
}

/// Computes the profile of the parameter with the given index; `limit` is the threshold of the objective.
pub(super) fn profile(fit: &FittedPoint, index: usize, limit: f64) -> Profile {
    let (below, above) =
        rayon::join(|| trace(fit, index, limit, 0), || trace(fit, index, limit, 1));
    let interval = [below.crossing, above.crossing];
    let solves = below.solves + above.solves;
    let mut points = below.points;
    points.push(HeldPoint { values: fit.values.clone(), cost: fit.cost });
    points.extend(above.points);
    points.sort_by(|a, b| a.values[index].total_cmp(&b.values[index]));
    let rise = points.iter().map(|point| (point.cost - fit.cost).abs()).fold(0.0, f64::max);
    let class = match interval {
        [Some(_), Some(_)] => Class::Identifiable,
        [None, None] if rise <= inaccuracy(fit.cost) => Class::StructurallyNot,
        _ => Class::PracticallyNot,
    };
    Profile { points, limit, interval, class, solves }
}

/// Objective profile on one side of the fit.
struct HalfProfile {
    points: Vec<HeldPoint>,
    crossing: Option<f64>,
    solves: usize,
}

/// Computes the profile of the parameter at `index` on one side of its fitted value (`side` is 0 for below, 1 for
/// above) until the objective exceeds the threshold `limit` or the parameter reaches its bound. Then refines the point
/// at which the objective crosses the threshold. argmin's `BrentRoot` is not used, because each refit has to start from
/// the last point below the threshold.
fn trace(fit: &FittedPoint, index: usize, limit: f64, side: usize) -> HalfProfile {
    let fitted = fit.values[index];
    let bound = fit.evaluator.parameters[index].bounds[side];
    let whole = (bound / fitted).ln();
    let mut evaluator = fit.evaluator.clone();
    let mut points: Vec<HeldPoint> = Vec::new();
    // `under`: shift of the logarithm, values and objective below the threshold; `over`: shift and objective above it.
    let mut under = (0.0, fit.values.clone(), fit.cost);
    let mut over: Option<(f64, f64)> = None;
    let mut step = FIRST_STEP.copysign(whole);
    let mut halve = false;
    loop {
        let shift = match over {
            None if under.0 != whole => {
                let next = under.0 + step;
                step *= GROWTH;
                if next.abs() < whole.abs() { next } else { whole }
            }
            Some((over, cost)) if (over - under.0).abs() > CROSSING_TOLERANCE * over.abs() => {
                // Alternate bisection with linear interpolation that is kept away from both ends.
                let fraction = (limit - under.2) / (cost - under.2);
                let fraction = if halve { 0.5 } else { fraction.clamp(0.1, 0.9) };
                halve = !halve;
                under.0 + fraction * (over - under.0)
            }
            _ => break,
        };
        let mut values = under.1.clone();
        values[index] = if shift == whole { bound } else { fitted * shift.exp() };
        let point = HeldPoint::fit(&mut evaluator, values, index);
        if point.cost > limit {
            over = Some((shift, point.cost));
        } else {
            under = (shift, point.values.clone(), point.cost);
        }
        points.push(point);
    }
    let crossing = over.map(|(over, _)| fitted * under.0.midpoint(over).exp());
    HalfProfile { points, crossing, solves: evaluator.solves }
}

impl Profile {
    /// Returns the lowest point of the profile if its objective is lower than `cost` by more than the numerical error.
    pub(crate) fn lower_than(&self, cost: f64) -> Option<&HeldPoint> {
        let lowest = self.points.iter().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        (lowest.cost.max(REFERENCE_ACCURACY) < cost * (1.0 - 1e-7)).then_some(lowest)
    }
}
