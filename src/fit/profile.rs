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

use super::fitted_point::FittedPoint;
use super::least_absolute::{minimise, minimise_holding, sum};
use super::resample::Resampler;
use super::search::limits;
use crate::stats::quantiles_low;

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

/// How well the measurements determine a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Class {
    Identifiable,
    /// The objective stays under the limit up to a bound.
    PracticallyNot,
    /// The objective does not change at all.
    StructurallyNot,
}

/// A point of a profile.
#[derive(Debug, Clone)]
pub(super) struct ProfilePoint {
    /// All free parameters.
    pub values: Vec<f64>,
    pub cost: f64,
}

/// The profile of one parameter.
#[derive(Debug, Clone)]
pub(super) struct Profile {
    /// By rising value; the fit is one of them.
    pub points: Vec<ProfilePoint>,
    pub limit: f64,
    /// Where the objective comes to the limit; `None` where it does not up to the bound.
    pub interval: [Option<f64>; 2],
    pub class: Class,
    pub solves: usize,
}

/// Change of the objective that is the search's and the motions' own inaccuracy.
fn noise(cost: f64) -> f64 {
    5e-6 + 1e-5 * cost
}

/// The objective's limit for each parameter.
pub(super) fn profile_limits(fit: &FittedPoint, resampler: &Resampler) -> Vec<f64> {
    let bounds = limits(fit.parameters(), &fit.values, RADIUS);
    let count = bounds.len();
    let rises: Vec<Vec<f64>> = (0..RESAMPLES)
        .into_par_iter()
        .map(|number| {
            let all = fit.linearised(resampler.draw(number)).residuals;
            let free = sum(&all, &minimise(&all, &bounds));
            let held = |index| sum(&all, &minimise_holding(&all, &bounds, Some(index)));
            (0..count).map(|index| held(index) - free).collect()
        })
        .collect();
    let correction = fit.noise_correction(&resampler.noises());
    let limit = |index: usize| {
        let of_one = rises.iter().map(|rises| rises[index]).collect();
        let rise = correction.rise * quantiles_low(of_one, [LEVEL])[0];
        fit.cost + rise.max(2.0 * noise(fit.cost))
    };
    (0..count).map(limit).collect()
}

/// The profile of the parameter with this index.
pub(super) fn profile(fit: &FittedPoint, index: usize, limit: f64) -> Profile {
    let (below, above) =
        rayon::join(|| Side::trace(fit, index, limit, 0), || Side::trace(fit, index, limit, 1));
    let fitted = ProfilePoint { values: fit.values.clone(), cost: fit.cost };
    let interval = [below.crossing, above.crossing];
    let solves = below.solves + above.solves;
    let mut points = below.points;
    points.push(fitted);
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
    points: Vec<ProfilePoint>,
    crossing: Option<f64>,
    solves: usize,
}

impl Side {
    /// Steps away from the fit until the objective is above the limit or the bound is reached;
    /// `side` is 0 for below and 1 for above.
    fn trace(fit: &FittedPoint, index: usize, limit: f64, side: usize) -> Self {
        let fitted = fit.values[index];
        let bound = fit.parameters()[index].bounds[side];
        let whole = (bound / fitted).ln();
        let mut evaluator = fit.evaluator();
        let mut points: Vec<ProfilePoint> = Vec::new();
        let mut at = |offset: f64, from: &[f64]| {
            let mut values = from.to_vec();
            values[index] = if offset == whole { bound } else { fitted * offset.exp() };
            let (values, cost) = FittedPoint::refit_holding(&mut evaluator, values, index);
            points.push(ProfilePoint { values: values.clone(), cost });
            (values, cost)
        };
        // Offsets of the logarithm, values and objective on this side and on the other side of
        // the limit.
        let mut under = (0.0, fit.values.clone(), fit.cost);
        let mut over = None;
        let mut step = FIRST_STEP.copysign(whole);
        while under.0 != whole && over.is_none() {
            let next = under.0 + step;
            let offset = if next.abs() < whole.abs() { next } else { whole };
            let (values, cost) = at(offset, &under.1);
            match cost > limit {
                true => over = Some((offset, values, cost)),
                false => under = (offset, values, cost),
            }
            step *= GROWTH;
        }
        let crossing = over.map(|mut over| {
            // Not argmin's BrentRoot: a refit depends on the point that it begins from, and has to
            // begin from the last one under the limit.
            let mut halve = false;
            while (over.0 - under.0).abs() > CROSSING * over.0.abs() {
                // Where a line between the two meets the limit, but not too near to either.
                let part = (limit - under.2) / (over.2 - under.2);
                let part = if halve { 0.5 } else { part.clamp(0.1, 0.9) };
                halve = !halve;
                let offset = under.0 + part * (over.0 - under.0);
                let (values, cost) = at(offset, &under.1);
                match cost > limit {
                    true => over = (offset, values, cost),
                    false => under = (offset, values, cost),
                }
            }
            fitted * under.0.midpoint(over.0).exp()
        });
        let solves = evaluator.solves();
        Self { points, crossing, solves }
    }
}

impl Profile {
    /// The lowest point, if it is lower than the fit by more than inaccuracy.
    pub fn lower_than(&self, cost: f64) -> Option<&ProfilePoint> {
        let lowest = self.points.iter().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        (lowest.cost < cost * (1.0 - 1e-7)).then_some(lowest)
    }
}
