//! Profiles: the objective with one free parameter held and the others fitted.
//!
//! A value of a parameter is inside of its profile's interval if the objective there is not above
//! a limit. For least squares chi-square would give it; a sum of absolute values has no such law,
//! so that it is taken from resampled measurements: where the fit were the truth, holding the
//! parameter at it would cost a resample's fit so much in 95 of 100. Resamples are fitted with
//! the objective linearised at the fit, which costs no motion, and corrected
//! ([`super::noise_correction`]).
//!
//! Reference: A. Raue et al., *Structural and practical identifiability analysis of partially
//! observed dynamical models by exploiting the profile likelihood*, Bioinformatics 25 (2009).

use rayon::prelude::*;
use trilink_mechanics::REFERENCE_ACCURACY;
use trilink_statistics::quantiles_low;

use super::fitted_point::{FittedPoint, HeldPoint};
use super::least_absolute::{minimise, sum};
use super::noise_correction::NoiseCorrection;
use super::resampler::Resampler;
use super::search::limits;

/// Part of the resamples that the limit covers.
const LEVEL: f64 = 0.95;
/// Resamples that it is taken from.
const RESAMPLES: usize = 400;
/// First step of a parameter's logarithm and what the next ones grow by.
const FIRST_STEP: f64 = 0.03;
const GROWTH: f64 = 1.8;
/// Part of the distance from the fit to which the crossing of the limit is found.
const CROSSING: f64 = 0.02;
/// Linearised residuals are good within about this factor's logarithm.
const RADIUS: f64 = 1.0;
/// Logarithm of a factor that no fit of a resample reaches.
const UNBOUNDED_LOG: f64 = 30.0;

/// How well the measurements determine a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Class {
    Identifiable,
    /// The objective stays under the limit up to a bound.
    PracticallyNot,
    /// The objective does not change at all.
    StructurallyNot,
}

/// The profile of one parameter.
#[derive(Debug, Clone)]
pub(super) struct Profile {
    /// By rising value; the fit is one of them.
    pub points: Vec<HeldPoint>,
    pub limit: f64,
    /// Where the objective crosses the limit; `None` where it does not up to the bound.
    pub interval: [Option<f64>; 2],
    pub class: Class,
    pub solves: usize,
}

/// Change of the objective that is the search's and the motions' own inaccuracy.
fn noise(cost: f64) -> f64 {
    5e-6 + 1e-5 * cost
}

/// The objective's limit for each parameter; infinite where the resamples determine none.
///
/// A resample's fit stays at a bound whatever its noise: holding a coefficient there raises no
/// objective and gives no limit (S. G. Self and K.-Y. Liang, J. Am. Stat. Assoc. 82 (1987) 605).
/// Such a coefficient takes the largest limit of the others.
pub(super) fn profile_limits(fit: &FittedPoint, resampler: &Resampler) -> Vec<f64> {
    let parameters = &fit.evaluator.parameters;
    let bounds = limits(parameters, &fit.values, RADIUS);
    let rises: Vec<Vec<f64>> = (0..RESAMPLES)
        .into_par_iter()
        .map(|number| {
            let all = fit.resampled_residuals(&resampler.draw(number));
            let free = minimise(&all, &bounds, None);
            let rise = |index: usize| {
                let lowest = match bounds[index].contains(&free[index]) {
                    true => minimise(&all, &with_unbounded(&bounds, index), None),
                    false => free.clone(),
                };
                sum(&all, &minimise(&all, &bounds, Some(index))) - sum(&all, &lowest)
            };
            (0..bounds.len()).map(rise).collect()
        })
        .collect();
    let correction = NoiseCorrection::of(fit, resampler);
    let limit = |index: usize| {
        let of_one = rises.iter().map(|rises| rises[index]).collect();
        let rise = correction.rise * quantiles_low(of_one, [LEVEL])[0];
        fit.cost + rise.max(2.0 * noise(fit.cost))
    };
    let is_at_bound: Vec<bool> = parameters
        .iter()
        .zip(&fit.values)
        .map(|(of, value)| of.is_at_bound(*value))
        .map(|sides| sides.contains(&true))
        .collect();
    let own: Vec<f64> = (0..bounds.len()).map(limit).collect();
    let determined = own.iter().zip(&is_at_bound).filter(|(_, at_bound)| !**at_bound);
    let of_others = determined.map(|(limit, _)| *limit).reduce(f64::max).unwrap_or(f64::INFINITY);
    own.iter()
        .zip(&is_at_bound)
        .map(|(own, at_bound)| if *at_bound { of_others } else { *own })
        .collect()
}

/// The bounds with one parameter unbounded, so that a resample's linearised residuals give the
/// whole rise by noise, not one cut off at the bound.
fn with_unbounded(bounds: &[[f64; 2]], index: usize) -> Vec<[f64; 2]> {
    let mut open = bounds.to_vec();
    open[index] = [-UNBOUNDED_LOG, UNBOUNDED_LOG];
    open
}

/// The profile of the parameter with this index.
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
        [None, None] if rise <= noise(fit.cost) => Class::StructurallyNot,
        _ => Class::PracticallyNot,
    };
    Profile { points, limit, interval, class, solves }
}

/// A profile on one side of the fit.
struct Side {
    points: Vec<HeldPoint>,
    crossing: Option<f64>,
    solves: usize,
}

/// Steps away from the fit until the objective is above the limit or the bound is reached, and
/// then back to where it crosses the limit; `side` is 0 for below and 1 for above. Not by argmin's
/// BrentRoot: a refit depends on where it begins, which has to be the last point under the limit.
fn trace(fit: &FittedPoint, index: usize, limit: f64, side: usize) -> Side {
    let fitted = fit.values[index];
    let bound = fit.evaluator.parameters[index].bounds[side];
    let whole = (bound / fitted).ln();
    let mut evaluator = fit.evaluator.clone();
    let mut points: Vec<HeldPoint> = Vec::new();
    // Offset of the logarithm, values and objective under the limit; offset and objective above.
    let mut under = (0.0, fit.values.clone(), fit.cost);
    let mut over: Option<(f64, f64)> = None;
    let (mut step, mut halve) = (FIRST_STEP.copysign(whole), false);
    loop {
        let offset = match over {
            None if under.0 != whole => {
                let next = under.0 + step;
                step *= GROWTH;
                if next.abs() < whole.abs() { next } else { whole }
            }
            Some((over, cost)) if (over - under.0).abs() > CROSSING * over.abs() => {
                // Where a line between the two meets the limit, but not too near to either.
                let part = (limit - under.2) / (cost - under.2);
                let part = if halve { 0.5 } else { part.clamp(0.1, 0.9) };
                halve = !halve;
                under.0 + part * (over - under.0)
            }
            _ => break,
        };
        let mut values = under.1.clone();
        values[index] = if offset == whole { bound } else { fitted * offset.exp() };
        let point = HeldPoint::fit(&mut evaluator, values, index);
        match point.cost > limit {
            true => over = Some((offset, point.cost)),
            false => under = (offset, point.values.clone(), point.cost),
        }
        points.push(point);
    }
    let crossing = over.map(|(over, _)| fitted * under.0.midpoint(over).exp());
    Side { points, crossing, solves: evaluator.solves }
}

impl Profile {
    /// The lowest point, if it is lower than the fit by more than inaccuracy.
    pub(crate) fn lower_than(&self, cost: f64) -> Option<&HeldPoint> {
        let lowest = self.points.iter().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        (lowest.cost.max(REFERENCE_ACCURACY) < cost * (1.0 - 1e-7)).then_some(lowest)
    }
}
