//! Confidence intervals expected after additional trials.
//!
//! The linearised model is fitted to Monte Carlo draws of all measurements, including the new ones. The spread of these
//! fits equals the spread of bootstrap replicates up to a factor that is common to all trials. The expected half width
//! is therefore the half width of the fit's interval times the ratio of the spreads with and without the new trials.
//! Errors of the robot's assumed parameters are propagated through each of these fits, too.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use trilink_robot::Parameter;
use trilink_robot::metrics::{ByFitted, Metric};
use trilink_statistics::{HALF_WIDTH_95, SIDES_95, quantiles};
use trilink_tables::{Columns as _, Extrapolation, FitRow};

use super::criterion::predicted_trial;
use super::{Aim, ExpectedRow};
use crate::{FitInformation, FreeParameter, TrialInformation};

/// Number of Monte Carlo draws of noise.
const DRAWS: u64 = 500;
/// Number of Monte Carlo draws of noise whose refit is repeated for each uncertain robot parameter, with that parameter
/// alone increased by its standard deviation.
const DRAWS_ASSUMED: u64 = 50;

/// Free parameter or prediction whose 95 % interval is reported.
pub(super) enum Quantity {
    /// Free parameter, preceded by its index among the free parameters.
    Parameter(usize, FreeParameter),
    /// Metric to be predicted.
    Prediction {
        name: String,
        value: f64,
        extrapolation: Extrapolation,
        /// Relative derivatives of the predicted metric with respect to the coefficients' logarithms.
        slopes: Vec<f64>,
        /// Relative changes in the predicted metric when each uncertain robot parameter is increased by its standard
        /// deviation.
        assumed: Vec<f64>,
    },
}

/// Half widths of the 95 % interval for the logarithm of a quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spread {
    /// Half width due to random errors; NaN if the interval reaches a bound of the coefficient.
    scatter: f64,
    /// Half width due to the uncertain robot parameters.
    systematic: f64,
}

impl Quantity {
    /// Returns all free parameters, followed by the predicted metric if the aim is a prediction.
    ///
    /// # Errors
    /// Returns an error if the model has no stable periodic solution at the frequency of the prediction.
    pub(super) fn all(information: &FitInformation, aim: Aim) -> Result<Vec<Self>, String> {
        let free = information.free().enumerate();
        let mut all: Vec<Self> = free.map(|(i, (free, _))| Self::Parameter(i, *free)).collect();
        if let Aim::Prediction(of) = aim {
            let no_shifts = vec![0.0; all.len()];
            let trial = predicted_trial(information, of, &no_shifts, true)?;
            all.push(Self::Prediction {
                name: format!("{} at {}", of.metric, of.omega_rad_s),
                value: trial.metrics[of.metric],
                extrapolation: information.extrapolation(information.command(), of.omega_rad_s),
                slopes: trial.slopes.iter().map(|slope| slope[of.metric]).collect(),
                assumed: trial.by_assumed.iter().map(|change| change[of.metric]).collect(),
            });
        }
        Ok(all)
    }

    /// Returns the relative change of the quantity due to shifts of the coefficients' logarithms.
    fn change(&self, shifts: &[f64]) -> f64 {
        match self {
            Self::Parameter(number, _) => shifts[*number],
            Self::Prediction { slopes, .. } => {
                slopes.iter().zip(shifts).map(|(slope, shift)| slope * shift).sum()
            }
        }
    }

    /// Returns the relative change of the quantity, at constant coefficients, when the uncertain robot parameter at
    /// `index` is increased by its standard deviation.
    fn change_with_assumed(&self, index: usize) -> f64 {
        match self {
            Self::Parameter(..) => 0.0,
            Self::Prediction { assumed, .. } => assumed[index],
        }
    }

    /// Returns the table row for the quantity. `spreads` are those with the existing trials alone, with the recommended
    /// trials added, and with the same number of evenly spread trials added.
    pub(super) fn row(
        &self,
        information: &FitInformation,
        row: &FitRow,
        spreads: [Spread; 3],
    ) -> ExpectedRow {
        let [now, then, evenly] = spreads;
        match self {
            Self::Prediction { name, value, extrapolation, .. } => {
                let [half_width, expected_half_width, evenly_half_width] =
                    spreads.map(|spread| value * spread.total());
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
                let lower = row.lower[*parameter];
                let upper = row.upper[*parameter];
                let half_width = 0.5 * (upper - lower);
                let [expected_half_width, evenly_half_width] = [then, evenly].map(|spread| {
                    expected_half_width(information, row, *parameter, half_width, now, spread)
                });
                ExpectedRow {
                    quantity: parameter.name().to_owned(),
                    value,
                    extrapolation: Extrapolation::blank(),
                    lower,
                    upper,
                    half_width,
                    expected_half_width,
                    evenly_half_width,
                }
            }
        }
    }
}

/// Returns the expected half width of a coefficient's interval: the present `half_width`, scaled according to the
/// spreads with the existing trials alone (`now`) and with additional trials (`then`).
fn expected_half_width(
    information: &FitInformation,
    row: &FitRow,
    parameter: Parameter,
    half_width: f64,
    now: Spread,
    then: Spread,
) -> f64 {
    let value = row.parameters[parameter];
    let scatter = row.scatter[parameter];
    let systematic = row.systematic[parameter];
    let in_proportion = |known: f64, now: f64, then: f64| {
        let scaled = known * then / now;
        if scaled.is_finite() { scaled } else { value * then }
    };
    let expected_scatter = in_proportion(scatter, now.scatter, then.scatter);
    let expected_systematic = if information.is_driven_as_measured() && now.systematic > 0.0 {
        in_proportion(systematic, now.systematic, then.systematic)
    } else if systematic.is_finite() {
        // New trials do not reduce the effect of the servos' tracking error.
        systematic
    } else {
        0.0
    };
    let sum = expected_scatter.hypot(expected_systematic);
    let scaled = half_width * sum / scatter.hypot(systematic);
    if scaled.is_finite() { scaled } else { sum }
}

impl Spread {
    /// Returns the half width due to random and systematic errors together, combined in quadrature.
    fn total(self) -> f64 {
        self.scatter.hypot(self.systematic)
    }

    /// Returns the spreads of quantities for given trials. The random numbers of a trial depend only on its position in
    /// the list, so that lists that begin with the same trials share their draws (common random numbers).
    pub(super) fn new(
        information: &FitInformation,
        trials: &[&TrialInformation],
        quantities: &[Quantity],
    ) -> Vec<Self> {
        let count = trials.first().map_or(0, |of| of.by_assumed.len());
        let draws = (0..DRAWS).into_par_iter().map(|number| {
            let errors: Vec<ByFitted<f64>> = trials
                .iter()
                .enumerate()
                .map(|(i, trial)| draw_errors(trial, number, i as u64))
                .collect();
            let shifts = information.nearest(trials, &errors);
            let assumed = if number < DRAWS_ASSUMED { count } else { 0 };
            let shifts_with_assumed = (0..assumed).map(|assumed| {
                let errors: Vec<ByFitted<f64>> = trials
                    .iter()
                    .zip(&errors)
                    .map(|(trial, errors)| {
                        ByFitted::from_fn(|i| errors[i] - trial.by_assumed[assumed][i])
                    })
                    .collect();
                information.nearest(trials, &errors)
            });
            (shifts, shifts_with_assumed.collect())
        });
        let draws: Vec<(Vec<f64>, Vec<Vec<f64>>)> = draws.collect();
        let spreads = quantities.iter().map(|quantity| {
            let changes = draws.iter().map(|(shifts, _)| quantity.change(shifts)).collect();
            let [low, high] = quantiles(changes, SIDES_95);
            let is_open = match quantity {
                Quantity::Parameter(number, free) => {
                    let value = information.free().nth(*number).map_or(f64::NAN, |(_, of)| of);
                    free.is_at_bound(value * low.exp())[0]
                        || free.is_at_bound(value * high.exp())[1]
                }
                Quantity::Prediction { .. } => false,
            };
            let squares = draws.iter().take(DRAWS_ASSUMED as usize).flat_map(|(shifts, others)| {
                others.iter().enumerate().map(move |(assumed, other)| {
                    let change_of_fit = quantity.change(other) - quantity.change(shifts);
                    (change_of_fit + quantity.change_with_assumed(assumed)).powi(2)
                })
            });
            let variance = squares.sum::<f64>() / DRAWS_ASSUMED as f64;
            Self {
                scatter: if is_open { f64::NAN } else { 0.5 * (high - low) },
                systematic: HALF_WIDTH_95 * variance.sqrt(),
            }
        });
        spreads.collect()
    }
}

/// Draws the relative errors of a trial's metrics; `draw` seeds the random number generator, and `index`, the trial's
/// position, selects its stream.
fn draw_errors(trial: &TrialInformation, draw: u64, index: u64) -> ByFitted<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(draw);
    random.set_stream(index);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let mut own: ByFitted<f64> = ByFitted::from_fn(|_| normal());
    // d and v are one measurement.
    own[Metric::V] = own[Metric::D];
    let mut errors = ByFitted::from_fn(|i| trial.noise[i] * own[i]);
    for effect in &trial.by_gait {
        let error = normal();
        effect.iter().for_each(|(metric, effect)| errors[metric] += error * effect);
    }
    errors
}
