//! What the uncertainty of each number contributes to a prediction, to first order.
//!
//! What the configuration or trials of other kinds say of the robot is independent; where the coefficients
//! are fitted, each also moves the fit, so that a part of it cancels. The fitted coefficients vary
//! together, as in the replicates of the bootstrap.
//!
//! Reference: JCGM 100:2008, *Guide to the expression of uncertainty in measurement*, section 5.

use trilink_mechanics::Problem;
use trilink_robot::{Gait, Laws, Parameter, Robot};
use trilink_tables::KnownFrom;
use trilink_tables::config::RobotConfig;

use super::quantity::Quantity;
use crate::PredictionBands;

/// What is known of how far numbers are off.
#[derive(Debug, Clone, Default)]
pub(crate) struct Uncertain {
    independent: Vec<Independent>,
    fitted: Option<Together>,
}

/// A number that is off by itself.
#[derive(Debug, Clone)]
struct Independent {
    quantity: Quantity,
    deviation: f64,
    source: KnownFrom,
    /// What else one standard deviation of it changes: the fitted coefficients, by their logarithms.
    refit: Vec<f64>,
}

/// Fitted coefficients, and the covariance of their logarithms.
#[derive(Debug, Clone)]
struct Together {
    coefficients: Vec<Parameter>,
    covariance: Vec<Vec<f64>>,
}

impl Uncertain {
    /// By the standard deviations of the configuration, of what a motion knows.
    pub(in crate::simulate) fn configured(robot: &RobotConfig, laws: Laws, gait: &Gait) -> Self {
        let independent = |(parameter, deviation)| {
            let (quantity, source) = (Quantity::Robot(parameter), KnownFrom::Configured);
            Independent { quantity, deviation, source, refit: Vec::new() }
        };
        let independent = robot.deviations(laws, gait).into_iter().map(independent).collect();
        Self { independent, fitted: None }
    }

    /// By the replicates of a fit, and what it assumed of the robot. `measured` are coefficients that
    /// trials of other kinds gave.
    pub(in crate::simulate) fn fitted(
        bands: &PredictionBands,
        problem: &Problem,
        measured: &[Parameter],
    ) -> Self {
        let (coefficients, replicates) = bands.replicates();
        let covariance = covariance(replicates, coefficients.len());
        let independent = bands.assumed().filter_map(|(robot, shifts)| {
            let quantity = changed(problem, bands.robot(), robot)?;
            let is_measured = |of: &Parameter| quantity == Quantity::Robot(*of);
            let is_measured = measured.iter().any(is_measured);
            let source = if is_measured { KnownFrom::Measured } else { KnownFrom::Configured };
            let at =
                |robot: &Robot| quantity.of(&Problem { robot: robot.clone(), ..problem.clone() });
            let deviation = at(robot) - at(bands.robot());
            Some(Independent { quantity, deviation, source, refit: shifts.to_vec() })
        });
        Self {
            independent: independent.collect(),
            fitted: Some(Together { coefficients: coefficients.to_vec(), covariance }),
        }
    }

    /// All that it is about.
    pub(super) fn quantities(&self) -> impl Iterator<Item = Quantity> {
        let own = self.independent.iter().map(|of| of.quantity);
        let fitted = self.fitted.iter().flat_map(|of| of.coefficients.iter().copied());
        own.chain(fitted.map(Quantity::Robot))
    }
}

/// The quantity that another robot has another value of; a sum where all of its parts do.
fn changed(problem: &Problem, robot: &Robot, other: &Robot) -> Option<Quantity> {
    let with = |robot: &Robot| Problem { robot: robot.clone(), ..problem.clone() };
    let (own, other) = (with(robot), with(other));
    let all = Quantity::all(problem).into_iter().filter(|of| of.of(&own) != of.of(&other));
    let all: Vec<Quantity> = all.collect();
    match all[..] {
        [one] => Some(one),
        [Quantity::Robot(first), ..] => first.sum().map(Quantity::Robot),
        _ => None,
    }
}

/// Of the columns of shifts.
fn covariance(shifts: &[Vec<f64>], columns: usize) -> Vec<Vec<f64>> {
    let count = shifts.len() as f64;
    let mean = |column: usize| shifts.iter().map(|of| of[column]).sum::<f64>() / count;
    let means: Vec<f64> = (0..columns).map(mean).collect();
    let entry = |a: usize, b: usize| {
        let products = shifts.iter().map(|of| (of[a] - means[a]) * (of[b] - means[b]));
        products.sum::<f64>() / (count - 1.0).max(1.0)
    };
    (0..columns).map(|a| (0..columns).map(|b| entry(a, b)).collect()).collect()
}

/// Adds a part to those of other numbers, or to what else is known of its own.
fn add(parts: &mut Vec<(String, Part)>, name: String, part: Part) {
    match parts.iter_mut().find(|(known, _)| *known == name) {
        None => parts.push((name, part)),
        Some((_, known)) => {
            *known = Part {
                deviation: known.deviation.hypot(part.deviation),
                source: part.source,
                contribution: known.contribution.hypot(part.contribution),
                variance_part: known.variance_part + part.variance_part,
            };
        }
    }
}

/// What everything that is known contributes to one metric.
pub(super) struct Budget {
    parts: Vec<(String, Part)>,
    /// Standard deviation of the metric; missing where nothing is known.
    pub deviation: f64,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    pub deviation: f64,
    pub source: KnownFrom,
    pub contribution: f64,
    pub variance_part: f64,
}

impl Budget {
    /// By the derivatives of the metric with respect to each quantity.
    pub(super) fn new(
        uncertain: &Uncertain,
        problem: &Problem,
        by: &dyn Fn(Quantity) -> f64,
    ) -> Self {
        let together = uncertain.fitted.as_ref();
        let coefficients = together.map_or(&[][..], |of| &of.coefficients);
        // Per logarithm of each.
        let slopes: Vec<f64> = coefficients
            .iter()
            .map(|of| by(Quantity::Robot(*of)) * of.of(&problem.robot))
            .collect();
        let along = |shifts: &[f64]| -> f64 {
            slopes.iter().zip(shifts).map(|(slope, shift)| slope * shift).sum()
        };
        let mut parts: Vec<(String, Part)> = Vec::new();
        for Independent { quantity, deviation, source, refit } in &uncertain.independent {
            let change = by(*quantity) * deviation + along(refit);
            let (deviation, contribution) = (deviation.abs(), change.abs());
            let variance_part = change.powi(2);
            let part = Part { deviation, source: *source, contribution, variance_part };
            add(&mut parts, quantity.name(), part);
        }
        for (index, coefficient) in coefficients.iter().enumerate() {
            let row = together.map_or(&[][..], |of| &of.covariance[index]);
            let deviation = row[index].sqrt();
            let part = Part {
                deviation: deviation * coefficient.of(&problem.robot),
                source: KnownFrom::Fitted,
                contribution: (slopes[index] * deviation).abs(),
                variance_part: slopes[index] * along(row),
            };
            add(&mut parts, coefficient.name().to_owned(), part);
        }
        let variance: f64 = parts.iter().map(|(_, part)| part.variance_part).sum();
        for (_, part) in &mut parts {
            part.variance_part /= variance;
        }
        let deviation = if parts.is_empty() { f64::NAN } else { variance.sqrt() };
        Self { parts, deviation }
    }

    /// That of a quantity, if anything is known of it.
    pub(super) fn part(&self, name: &str) -> Option<&Part> {
        self.parts.iter().find(|(of, _)| of == name).map(|(_, part)| part)
    }
}
