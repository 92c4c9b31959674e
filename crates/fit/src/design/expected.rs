//! The intervals that more trials would leave.
//!
//! The fit of the model, linearised, to many draws of all measurements, the new ones among them, has
//! the spread that the bootstrap's replicates would have, but for a factor that all trials have in
//! common: half widths are those of the fit's intervals times the ratio of the spreads with and
//! without the new trials. What is assumed of the robot moves each of these fits, too.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use trilink_robot::Parameter;
use trilink_robot::metrics::{ByFitted, Metric};
use trilink_statistics::{HALF_WIDTH_95, SIDES_95, quantiles};
use trilink_tables::{Columns as _, Extrapolation, FitRow};

use super::criterion::predicted;
use super::{Aim, ExpectedRow};
use crate::{FitInformation, FreeParameter, TrialInformation};

/// Draws of the noise, and those of them with which the robot's uncertain numbers are off in turn.
const DRAWS: u64 = 500;
const DRAWS_ASSUMED: u64 = 50;

/// Something of which the interval is told.
pub(super) enum Quantity {
    /// A free parameter, by its number.
    Parameter(usize, FreeParameter),
    /// A prediction, with its value and what it changes by, relative: with each coefficient's logarithm
    /// and with each uncertain number of the robot.
    Prediction {
        name: String,
        value: f64,
        extrapolation: Extrapolation,
        slopes: Vec<f64>,
        assumed: Vec<f64>,
    },
}

/// Half widths of 95 % of a quantity's logarithm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spread {
    /// NaN where a bound of the coefficient ends it.
    scatter: f64,
    systematic: f64,
}

impl Quantity {
    pub(super) fn all(information: &FitInformation, aim: Aim) -> Result<Vec<Self>, String> {
        let free = information.free().enumerate();
        let mut all: Vec<Self> = free.map(|(i, (free, _))| Self::Parameter(i, *free)).collect();
        if let Aim::Prediction(of) = aim {
            let none = vec![0.0; all.len()];
            let told = predicted(information, of, &none, true)?;
            all.push(Self::Prediction {
                name: format!("{} at {}", of.metric, of.omega_rad_s),
                value: told.metrics[of.metric],
                extrapolation: information.extrapolation(information.command(), of.omega_rad_s),
                slopes: told.slopes.iter().map(|slope| slope[of.metric]).collect(),
                assumed: told.by_assumed.iter().map(|of_one| of_one[of.metric]).collect(),
            });
        }
        Ok(all)
    }

    /// Its change, relative, where the coefficients' logarithms are shifted so.
    fn change(&self, shifts: &[f64]) -> f64 {
        match self {
            Self::Parameter(number, _) => shifts[*number],
            Self::Prediction { slopes, .. } => {
                slopes.iter().zip(shifts).map(|(slope, shift)| slope * shift).sum()
            }
        }
    }

    /// The same by an uncertain number of the robot with the coefficients as they are.
    fn by_assumed(&self, number: usize) -> f64 {
        match self {
            Self::Parameter(..) => 0.0,
            Self::Prediction { assumed, .. } => assumed[number],
        }
    }

    /// From its spread now, with the advised trials, and with as many spread evenly.
    pub(super) fn row(
        &self,
        information: &FitInformation,
        row: &FitRow,
        spreads: [Spread; 3],
    ) -> ExpectedRow {
        let [now, then, evenly] = spreads;
        match self {
            Self::Prediction { name, value, extrapolation, .. } => {
                let half_widths = spreads.map(|of| value * of.total());
                let [half_width, expected_half_width, evenly_half_width] = half_widths;
                ExpectedRow {
                    quantity: name.clone(),
                    value: *value,
                    extrapolation: extrapolation.clone(),
                    lower: value - half_width,
                    upper: value + half_width,
                    half_width,
                    expected_half_width,
                    evenly_half_width,
                }
            }
            Self::Parameter(_, FreeParameter { parameter, .. }) => {
                let value = row.parameters[*parameter];
                let [lower, upper] = [row.lower[*parameter], row.upper[*parameter]];
                let half_width = 0.5 * (upper - lower);
                let expected = |spread: Spread| {
                    expected_half_width(information, row, *parameter, half_width, now, spread)
                };
                ExpectedRow {
                    quantity: parameter.name().to_owned(),
                    value,
                    extrapolation: Extrapolation::blank(),
                    lower,
                    upper,
                    half_width,
                    expected_half_width: expected(then),
                    evenly_half_width: expected(evenly),
                }
            }
        }
    }
}

/// A coefficient's half width with other trials, of which the spread is this.
fn expected_half_width(
    information: &FitInformation,
    row: &FitRow,
    parameter: Parameter,
    half_width: f64,
    now: Spread,
    then: Spread,
) -> f64 {
    let value = row.parameters[parameter];
    let (scatter, systematic) = (row.scatter[parameter], row.systematic[parameter]);
    let in_proportion = |known: f64, now: f64, then: f64| {
        let scaled = known * then / now;
        if scaled.is_finite() { scaled } else { value * then }
    };
    let by_scatter = in_proportion(scatter, now.scatter, then.scatter);
    // A servo that misses its command does so in the new trials, too.
    let by_systematic = match information.is_driven_as_measured() && now.systematic > 0.0 {
        true => in_proportion(systematic, now.systematic, then.systematic),
        false if systematic.is_finite() => systematic,
        false => 0.0,
    };
    let sum = by_scatter.hypot(by_systematic);
    let scaled = half_width * sum / scatter.hypot(systematic);
    if scaled.is_finite() { scaled } else { sum }
}

impl Spread {
    fn total(self) -> f64 {
        self.scatter.hypot(self.systematic)
    }

    /// Those of some quantities with these trials. Trials in common are drawn alike.
    pub(super) fn new(
        information: &FitInformation,
        trials: &[&TrialInformation],
        quantities: &[Quantity],
    ) -> Vec<Self> {
        let count = trials.first().map_or(0, |of| of.by_assumed.len());
        let draw = |number: u64| {
            let off: Vec<ByFitted<f64>> =
                trials.iter().enumerate().map(|(i, of)| drawn(of, number, i as u64)).collect();
            let shifts = information.nearest(trials, &off);
            let others = if number < DRAWS_ASSUMED { count } else { 0 };
            let with = |assumed: usize| {
                let moved = |(trial, off): (&&TrialInformation, &ByFitted<f64>)| {
                    ByFitted::from_fn(|i| off[i] - trial.by_assumed[assumed][i])
                };
                let off: Vec<ByFitted<f64>> = trials.iter().zip(&off).map(moved).collect();
                information.nearest(trials, &off)
            };
            (shifts, (0..others).map(with).collect())
        };
        let all: Vec<(Vec<f64>, Vec<Vec<f64>>)> = (0..DRAWS).into_par_iter().map(draw).collect();
        let of_quantity = |quantity: &Quantity| {
            let changes = all.iter().map(|(shifts, _)| quantity.change(shifts)).collect();
            let [low, high] = quantiles(changes, SIDES_95);
            let is_open = match quantity {
                Quantity::Parameter(number, free) => {
                    let value = information.free().nth(*number).map_or(f64::NAN, |(_, of)| of);
                    free.is_at_bound(value * low.exp())[0]
                        || free.is_at_bound(value * high.exp())[1]
                }
                Quantity::Prediction { .. } => false,
            };
            let squares = all.iter().take(DRAWS_ASSUMED as usize).flat_map(|(shifts, others)| {
                others.iter().enumerate().map(move |(assumed, other)| {
                    let by_fit = quantity.change(other) - quantity.change(shifts);
                    (by_fit + quantity.by_assumed(assumed)).powi(2)
                })
            });
            let variance = squares.sum::<f64>() / DRAWS_ASSUMED as f64;
            Self {
                scatter: if is_open { f64::NAN } else { 0.5 * (high - low) },
                systematic: HALF_WIDTH_95 * variance.sqrt(),
            }
        };
        quantities.iter().map(of_quantity).collect()
    }
}

/// What a trial's metrics are off by in a draw, relative.
fn drawn(trial: &TrialInformation, draw: u64, number: u64) -> ByFitted<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(draw);
    random.set_stream(number);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let mut own: ByFitted<f64> = ByFitted::from_fn(|_| normal());
    // d and v are one measurement.
    own[Metric::V] = own[Metric::D];
    let mut off = ByFitted::from_fn(|i| trial.noise[i] * own[i]);
    for effect in &trial.by_gait {
        let moves = normal();
        effect.iter().for_each(|(metric, effect)| off[metric] += moves * effect);
    }
    off
}
