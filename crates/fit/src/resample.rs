//! Resampling of measurements: cycles within trials, and trials within frequencies.
//!
//! A resample of the n cycles of a trial moves each metric, and each parameter of the measured gait. The deviation of
//! the mean of the resampled cycles from the mean of all cycles is expressed in standard deviations of such means, and
//! the quantity moves by the same number of its own standard deviations ([`TrialNoise`]). Thus
//!
//! - a small number of cycles does not reduce the spread (by the factor (n - 1)/n in the variance),
//! - the covariance of neighbouring cycles has the same effect as in the standard error,
//! - quantities measured in the same cycles move together, and
//! - a debiased skid ratio, which is not a mean over cycles, moves with the cycles in proportion to its own standard
//!   error.
//!
//! Without a table of cycles, these deviations are drawn from normal distributions.
//!
//! Reference: A. C. Davison and D. V. Hinkley, *Bootstrap Methods and their Application*,
//! Cambridge 1997, section 3.8.

use std::collections::BTreeMap;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{ChiSquared, Distribution};
use trilink_robot::metrics::ByFitted;
use trilink_statistics::{c4, median_high};
use trilink_tables::CycleRow;

use super::gait_over_frequency::GaitErrors;
use super::measurement::Measurement;
use super::trial_noise::TrialNoise;

type Metrics = ByFitted<f64>;

/// Resampler of the measurements of one campaign.
pub(super) struct CampaignResampler {
    pub measurements: Vec<Measurement>,
    /// Indices of the trials at each frequency.
    frequencies: Vec<Vec<usize>>,
    pub noises: Vec<TrialNoise>,
}

/// Resampled measurement.
pub(super) struct DrawnTrial {
    /// Index of the drawn measurement.
    pub index: usize,
    pub metrics: Metrics,
    /// Changes in offset, amplitude and phase of the measured gait, for each joint.
    pub gait_steps_rad: GaitErrors,
}

impl CampaignResampler {
    /// Prepares measurements, which must be sorted by [`Measurement::order`], for resampling; `cycles` are the tables
    /// of cycles by trial name.
    pub(crate) fn new(
        measurements: Vec<Measurement>,
        cycles: &BTreeMap<String, Vec<CycleRow>>,
    ) -> Self {
        let frequencies = Measurement::frequencies(&measurements);
        let noises = measurements
            .iter()
            .zip(errors(&measurements))
            .map(|(measurement, errors)| {
                let rows = cycles.get(&measurement.trial).into_iter().flatten();
                TrialNoise::new(measurement, &errors, rows.filter(|row| row.used))
            })
            .collect();
        Self { noises, measurements, frequencies }
    }

    /// Draws, for each trial, the ratio of the estimated to the true standard deviation of the noise, given the number
    /// of cycles.
    pub(crate) fn noise_ratios(&self, mut random: ChaCha8Rng) -> Vec<f64> {
        let freedoms = self.measurements.iter().map(Measurement::degrees_of_freedom);
        let ratios = freedoms.map(|freedom| {
            // The standard deviations of the cycles are unbiased themselves.
            draw_deviation_ratio(freedom, &mut random).map_or(1.0, |ratio| ratio / c4(freedom))
        });
        ratios.collect()
    }

    /// Draws the noise of every trial: deviations of the metrics and of the gait. The two random generators are for the
    /// metrics and for the gaits.
    pub(crate) fn draw_noise(&self, mut random: [ChaCha8Rng; 2]) -> Vec<DrawnTrial> {
        let trials = 0..self.measurements.len();
        trials.map(|index| self.draw_trial(index, Metrics::splat(0.0), &mut random)).collect()
    }

    /// Draws a resample of frequencies, of the trials at each frequency, and of the cycles of each trial; the random
    /// generators are for the frequencies, the metrics and the gaits.
    pub(crate) fn draw_frequencies(
        &self,
        [mut frequencies, metrics, gaits]: [ChaCha8Rng; 3],
    ) -> Vec<DrawnTrial> {
        let mut random = [metrics, gaits];
        let mut drawn = Vec::with_capacity(self.measurements.len());
        let count = self.frequencies.len();
        for _ in 0..count {
            let trials = &self.frequencies[frequencies.random_range(0..count)];
            for _ in trials {
                let index = trials[random[0].random_range(0..trials.len())];
                let metrics = self.measurements[index].metrics.into();
                let mut trial = self.draw_trial(index, metrics, &mut random);
                for (_, metric) in trial.metrics.iter_mut().filter(|(_, value)| **value <= 0.0) {
                    *metric = f64::NAN;
                }
                drawn.push(trial);
            }
        }
        drawn
    }

    /// Adds drawn noise to the metrics of a trial; the two random generators are for the metrics and for the gait.
    fn draw_trial(
        &self,
        index: usize,
        mut metrics: Metrics,
        random: &mut [ChaCha8Rng; 2],
    ) -> DrawnTrial {
        let noise = &self.noises[index];
        let deviates = noise.draw(random);
        for (i, metric) in metrics.iter_mut() {
            *metric += noise.deviation(i) * deviates.metrics[i];
        }
        let deviations_rad = noise.gait_deviations_rad();
        let gait_steps_rad = std::array::from_fn(|joint| {
            std::array::from_fn(|number| {
                let i = 3 * joint + number;
                deviations_rad[i] * deviates.gait[i]
            })
        });
        DrawnTrial { index, metrics, gait_steps_rad }
    }
}

/// Draws the ratio of the estimated to the true standard deviation of normally distributed values, where the estimate
/// is the square root of an unbiased variance; `None` if the degrees of freedom are not known or infinite.
pub(super) fn draw_deviation_ratio(freedom: f64, random: &mut ChaCha8Rng) -> Option<f64> {
    let squares = ChiSquared::new(freedom).ok().filter(|_| freedom.is_finite())?;
    Some((squares.sample(random) / freedom).sqrt())
}

/// Returns the standard deviations of the metrics for every trial. A missing value, as with a single cycle, is replaced
/// using the median relative spread between the cycles of the other trials; the replacement is 0 if this spread is not
/// known for any trial.
fn errors(measurements: &[Measurement]) -> Vec<Metrics> {
    let known: Vec<Metrics> = measurements
        .iter()
        .map(|of| Metrics::from(of.errors).map(|error| of.bias_correction() * error))
        .collect();
    let roots: Vec<f64> = measurements.iter().map(|of| (of.cycles.max(1) as f64).sqrt()).collect();
    let typical: Metrics = Metrics::from_fn(|i| {
        let trials = measurements.iter().zip(&known).zip(&roots);
        let spreads = trials.map(|((of, known), root)| known[i] / of.metrics[i] * root);
        let median = median_high(spreads.filter(|spread| spread.is_finite()).collect());
        if median.is_nan() { 0.0 } else { median }
    });
    let trials = measurements.iter().zip(known).zip(roots);
    trials
        .map(|((of, known), root)| {
            Metrics::from_fn(|i| {
                if known[i].is_finite() { known[i] } else { typical[i] * of.metrics[i] / root }
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::{GaitMetrics, Metric, padded};
    use trilink_tables::config::SigmaKind;
    use trilink_tables::{Columns as _, TrialRow};

    use super::*;
    use crate::resampler::Resampler;

    /// Creates a trial whose cycles have the given values of d and differ in nothing else.
    fn trial(name: &str, omega_rad_s: f64, d_m: &[f64]) -> (Measurement, Vec<CycleRow>) {
        let count = d_m.len() as f64;
        let mean = d_m.iter().sum::<f64>() / count;
        let squares: f64 = d_m.iter().map(|d| (d - mean).powi(2)).sum();
        let row = TrialRow {
            trial: name.to_owned(),
            omega_rad_s,
            omega_commanded_rad_s: omega_rad_s,
            cycles: d_m.len() as i64,
            metrics: GaitMetrics {
                d_m: mean,
                v_m_s: 1.0,
                sigma: padded(&[0.03]),
                ..GaitMetrics::MISSING
            },
            metrics_se: GaitMetrics {
                d_m: (squares / (count - 1.0) / count).sqrt(),
                sigma: padded(&[0.001]),
                ..GaitMetrics::MISSING
            },
            ..TrialRow::blank()
        };
        let metrics = |d_m: f64| GaitMetrics { d_m, ..GaitMetrics::MISSING };
        let cycle =
            |d_m: &f64| CycleRow { metrics: metrics(*d_m), used: true, ..CycleRow::blank() };
        let measurement = Measurement::new(&row, SigmaKind::Raw).expect("a measurement");
        (measurement, d_m.iter().map(cycle).collect())
    }

    fn resampler(trials: Vec<(Measurement, Vec<CycleRow>)>, with_cycles: bool) -> Resampler {
        let cycles: BTreeMap<String, Vec<CycleRow>> = trials
            .iter()
            .filter(|_| with_cycles)
            .map(|(measurement, cycles)| (measurement.trial.clone(), cycles.clone()))
            .collect();
        let measurements: Vec<Measurement> = trials.into_iter().map(|(each, _)| each).collect();
        Resampler::new(1, measurements, &cycles)
    }

    /// Returns the standard deviation of a quantity over many draws of noise.
    fn deviation(resampler: &Resampler, number_of: impl Fn(&[DrawnTrial]) -> f64) -> f64 {
        let values: Vec<f64> = (0..4000).map(|nth| number_of(&resampler.draw_noise(nth))).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64)
            .sqrt()
    }

    #[test]
    fn a_few_cycles_scatter_by_their_standard_error_with_and_without_their_table() {
        for with_cycles in [true, false] {
            for d_m in [vec![0.40, 0.43], vec![0.40, 0.43, 0.42], vec![0.40, 0.41, 0.43, 0.45]] {
                let trial = trial("one", 2.0, &d_m);
                let expected = trial.0.bias_correction() * trial.0.errors.d_m;
                let resampler = resampler(vec![trial], with_cycles);
                let found = deviation(&resampler, |resample| resample[0].metrics[Metric::D]);
                assert!((found / expected - 1.0).abs() < 0.05, "{found} for {expected}");
            }
        }
    }

    #[test]
    fn a_single_cycle_has_the_scatter_of_the_other_trials() {
        let single = trial("single", 3.0, &[0.5]);
        assert!(single.0.errors.d_m.is_nan());
        let several = trial("one", 2.0, &[0.40, 0.42, 0.44]);
        let bias_correction = several.0.bias_correction();
        let resampler = resampler(vec![several, single], true);
        let found = deviation(&resampler, |resample| resample[1].metrics[Metric::D]);
        // The relative spread between cycles is 0.02 / 0.42.
        let expected = bias_correction * 0.5 * 0.02 / 0.42;
        assert!((found / expected - 1.0).abs() < 0.05, "{found} for {expected}");
    }

    #[test]
    fn equal_numbers_give_equal_noise() {
        let trials = || vec![trial("one", 2.0, &[0.40, 0.43, 0.42])];
        let first = resampler(trials(), true);
        let second = resampler(trials(), true);
        let d_m =
            |resampler: &Resampler, number| resampler.draw_noise(number)[0].metrics[Metric::D];
        assert!((0..20).all(|number| d_m(&first, number) == d_m(&second, number)));
        assert!((1..20).any(|number| d_m(&first, number) != d_m(&first, 0)));
    }
}
