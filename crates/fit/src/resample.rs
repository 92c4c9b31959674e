//! Resampled measurements: cycles within trials and trials within frequencies.
//!
//! A resample of a trial's n cycles moves each metric, and each number of the measured gait, by as many of
//! its standard deviations as the mean over the resampled cycles is away from the mean over all, in standard
//! deviations of such resamples ([`TrialNoise`]). So a few cycles do not make the spread too small (by
//! (n - 1)/n, were it left as it is), the covariance of neighbouring cycles counts as in the standard error,
//! what is of the same cycles moves together, and a debiased skid ratio, which is not a mean over cycles, moves
//! with them by its own error. Where the cycles are not at hand the standard deviations alone are
//! drawn from, normally distributed.
//!
//! Trials of the same frequency are drawn from, too. What they differ by beyond their standard
//! errors is the trials' own spread, and is scaled so that its variance is unbiased; a trial that
//! is alone at its frequency is given the spread of the other frequencies' repeats. Without any
//! repeat the intervals do not contain it.
//!
//! Reference: A. C. Davison and D. V. Hinkley, *Bootstrap Methods and their Application*,
//! Cambridge 1997, section 3.8.

use std::collections::BTreeMap;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{ChiSquared, Distribution};
use trilink_robot::metrics::{ByFitted, Metric};
use trilink_statistics::{mean, mean_deviation, median_high};
use trilink_tables::CycleRow;

use super::measurement::Measurement;
use super::trial_noise::TrialNoise;

type Metrics = ByFitted<f64>;

/// Draws measurements of a campaign.
pub(super) struct CampaignResampler {
    pub measurements: Vec<Measurement>,
    /// Indices of each frequency's trials.
    frequencies: Vec<Vec<usize>>,
    /// Means over the trials of each trial's frequency.
    means: Vec<Metrics>,
    noises: Vec<TrialNoise>,
    /// Standard deviation of the trials' own spread as a part of that of their deviations.
    own: Metrics,
    /// Relative standard deviation of repeats around their frequency's mean, and its degrees of freedom.
    spread: Metrics,
    freedom: f64,
    /// Relative deviations of repeats from their frequency's mean, without bias.
    deviations: Vec<Metrics>,
}

/// A measurement that was drawn.
pub(super) struct DrawnTrial {
    /// Which was drawn from.
    pub index: usize,
    pub metrics: Metrics,
    /// By how much the numbers of the measured gait are moved.
    pub gait_steps_rad: [[f64; 3]; 2],
}

impl CampaignResampler {
    /// Of sorted measurements; `cycles` are those that count, by trial.
    pub(crate) fn new(
        measurements: Vec<Measurement>,
        cycles: &BTreeMap<String, Vec<CycleRow>>,
    ) -> Self {
        let frequencies = Measurement::frequencies(&measurements);
        let errors = errors(&measurements);
        let (own, spread, deviations) = own_spread(&measurements, &frequencies, &errors);
        let freedom = (measurements.len() - frequencies.len()) as f64;
        let noise = |(measurement, errors): (&Measurement, &Metrics)| {
            let rows = cycles.get(&measurement.trial).into_iter().flatten();
            TrialNoise::new(measurement, errors, rows.filter(|row| row.used))
        };
        let noises = measurements.iter().zip(&errors).map(noise).collect();
        let mut means_of_trials = vec![Metrics::splat(0.0); measurements.len()];
        for trials in &frequencies {
            let means = means(&measurements, trials);
            trials.iter().for_each(|trial| means_of_trials[*trial] = means);
        }
        Self {
            means: means_of_trials,
            noises,
            measurements,
            frequencies,
            own,
            spread,
            freedom,
            deviations,
        }
    }

    /// What every measurement is off by: its noise, and the standard deviations of the trials' own spread.
    pub(crate) fn noises(&self) -> impl Iterator<Item = (&TrialNoise, Metrics)> {
        let own = |of: Metrics| Metrics::from_fn(|i| self.own[i] * self.spread[i] * of[i]);
        self.noises.iter().zip(self.measurements.iter().map(metrics).map(own))
    }

    /// How many times the standard deviation of each metric's noise so many cycles and repeats tell, at random.
    pub(crate) fn told(&self, mut random: ChaCha8Rng) -> Vec<Metrics> {
        // Of normally distributed values; 1 where nothing tells how many values it is of.
        let mut told = |freedom: f64| match ChiSquared::new(freedom) {
            Ok(squares) => (squares.sample(&mut random) / freedom).sqrt() / mean_deviation(freedom),
            Err(_) => 1.0,
        };
        // d and v are one measurement.
        let mut of_spread: Metrics = Metrics::from_fn(|_| told(self.freedom));
        of_spread[Metric::V] = of_spread[Metric::D];
        let of_trial = |((noise, spread), of): ((&TrialNoise, Metrics), &Measurement)| {
            let of_cycles = told(of.freedom());
            Metrics::from_fn(|i| {
                let own = noise.deviation(i);
                let told = (of_cycles * own).hypot(of_spread[i] * spread[i]) / own.hypot(spread[i]);
                if told.is_finite() { told } else { 1.0 }
            })
        };
        self.noises().zip(&self.measurements).map(of_trial).collect()
    }

    /// A resample, by random numbers for the metrics and for the gaits.
    pub(crate) fn draw(&self, mut random: [ChaCha8Rng; 2]) -> Vec<DrawnTrial> {
        let mut drawn = Vec::with_capacity(self.measurements.len());
        self.frequencies.iter().for_each(|trials| self.draw_of(trials, &mut random, &mut drawn));
        drawn
    }

    /// The same with frequencies drawn, too, by random numbers of its own.
    pub(crate) fn draw_frequencies(
        &self,
        [mut which, random @ ..]: [ChaCha8Rng; 3],
    ) -> Vec<DrawnTrial> {
        let (mut random, mut drawn) = (random, Vec::with_capacity(self.measurements.len()));
        let count = self.frequencies.len();
        for _ in 0..count {
            let trials = &self.frequencies[which.random_range(0..count)];
            self.draw_of(trials, &mut random, &mut drawn);
        }
        drawn
    }

    /// Adds a resample of a frequency's trials, by random numbers for them and for their gaits.
    fn draw_of(&self, trials: &[usize], random: &mut [ChaCha8Rng; 2], drawn: &mut Vec<DrawnTrial>) {
        for &trial in trials {
            let (index, mut metrics) = self.trial_of(trial, trials, &mut random[0]);
            let noise = &self.noises[index];
            let moves = noise.draw(random);
            for (i, metric) in metrics.iter_mut() {
                *metric += noise.deviation(i) * moves.metrics[i];
                if *metric <= 0.0 {
                    *metric = f64::NAN;
                }
            }
            let deviations_rad = noise.gait_deviations_rad();
            let gait_steps_rad =
                [0, 3].map(|of| [of, of + 1, of + 2].map(|i| deviations_rad[i] * moves.gait[i]));
            drawn.push(DrawnTrial { index, metrics, gait_steps_rad });
        }
    }

    /// One of a frequency's trials, and its metrics with the trials' own spread.
    fn trial_of(
        &self,
        trial: usize,
        trials: &[usize],
        random: &mut ChaCha8Rng,
    ) -> (usize, Metrics) {
        let count = trials.len();
        if count == 1 {
            let mut metrics = metrics(&self.measurements[trial]);
            if !self.deviations.is_empty() {
                let deviation = self.deviations[random.random_range(0..self.deviations.len())];
                for (i, metric) in metrics.iter_mut() {
                    *metric *= 1.0 + self.own[i] * deviation[i];
                }
            }
            return (trial, metrics);
        }
        let index = trials[random.random_range(0..count)];
        let drawn = metrics(&self.measurements[index]);
        let means = &self.means[index];
        let scale = (count as f64 / (count as f64 - 1.0)).sqrt();
        let with_spread = |i: Metric| means[i] + self.own[i] * scale * (drawn[i] - means[i]);
        (index, Metrics::from_fn(with_spread))
    }
}

fn metrics(measurement: &Measurement) -> Metrics {
    measurement.metrics.into()
}

/// Means over some trials; what a trial does not have is left out.
fn means(measurements: &[Measurement], trials: &[usize]) -> Metrics {
    Metrics::from_fn(|i| {
        let values = trials.iter().map(|&trial| measurements[trial].metrics[i]);
        mean(values.filter(|value| value.is_finite()))
    })
}

/// Standard deviations of every trial's metrics. Where one is missing, as with a single cycle, the
/// median relative spread of the other trials' cycles replaces it; 0 if no trial has one.
fn errors(measurements: &[Measurement]) -> Vec<Metrics> {
    let known = |of: &Measurement| Metrics::from(of.errors).map(|error| of.unbiased() * error);
    let root = |measurement: &Measurement| (measurement.cycles.max(1) as f64).sqrt();
    let typical: Metrics = Metrics::from_fn(|i| {
        let spread = |of: &Measurement| known(of)[i] / of.metrics[i] * root(of);
        let spreads = measurements.iter().map(spread).filter(|spread| spread.is_finite());
        let median = median_high(spreads.collect());
        if median.is_nan() { 0.0 } else { median }
    });
    let filled = |measurement: &Measurement| {
        let (known, metrics) = (known(measurement), measurement.metrics);
        Metrics::from_fn(|i| match known[i].is_finite() {
            true => known[i],
            false => typical[i] * metrics[i] / root(measurement),
        })
    };
    measurements.iter().map(filled).collect()
}

/// The trials' own spread as a part of that of their deviations from their frequency's mean, the
/// latter, and these deviations.
fn own_spread(
    measurements: &[Measurement],
    frequencies: &[Vec<usize>],
    errors: &[Metrics],
) -> (Metrics, Metrics, Vec<Metrics>) {
    let mut freedom = 0.0;
    let mut deviations: Vec<Metrics> = Vec::new();
    let (mut squares, mut expected) = (Metrics::splat(0.0), Metrics::splat(0.0));
    for trials in frequencies.iter().filter(|trials| trials.len() > 1) {
        let count = trials.len() as f64;
        let means = means(measurements, trials);
        freedom += count - 1.0;
        for &trial in trials {
            let found = measurements[trial].metrics;
            let relative: Metrics = Metrics::from_fn(|i| found[i] / means[i] - 1.0);
            for i in Metric::FITTED {
                if relative[i].is_finite() {
                    squares[i] += relative[i].powi(2);
                    expected[i] += (errors[trial][i] / means[i]).powi(2) * (count - 1.0) / count;
                }
            }
            let scale = (count / (count - 1.0)).sqrt();
            let known = |relative: f64| if relative.is_finite() { scale * relative } else { 0.0 };
            deviations.push(relative.map(known));
        }
    }
    let own = |i: Metric| {
        let part = 1.0 - expected[i] / squares[i];
        if part > 0.0 { part.sqrt() } else { 0.0 }
    };
    let spread =
        squares.map(|squares| if freedom > 0.0 { (squares / freedom).sqrt() } else { 0.0 });
    (Metrics::from_fn(own), spread, deviations)
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::GaitMetrics;
    use trilink_tables::config::SigmaKind;
    use trilink_tables::{Columns as _, TrialRow};

    use super::*;
    use crate::resampler::Resampler;

    /// A trial with d of these cycles; everything else does not vary.
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
                sigma: [0.03, f64::NAN, f64::NAN],
                ..GaitMetrics::MISSING
            },
            metrics_se: GaitMetrics {
                d_m: (squares / (count - 1.0) / count).sqrt(),
                sigma: [0.001, f64::NAN, f64::NAN],
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

    /// Standard deviation of a number over many resamples.
    fn deviation(resampler: &Resampler, of: impl Fn(&[DrawnTrial]) -> f64) -> f64 {
        let values: Vec<f64> = (0..4000).map(|number| of(&resampler.draw(number))).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64)
            .sqrt()
    }

    #[test]
    fn a_few_cycles_spread_by_their_standard_error_with_and_without_their_table() {
        for with_cycles in [true, false] {
            for d_m in [vec![0.40, 0.43], vec![0.40, 0.43, 0.42], vec![0.40, 0.41, 0.43, 0.45]] {
                let trial = trial("one", 2.0, &d_m);
                let expected = trial.0.unbiased() * trial.0.errors.d_m;
                let resampler = resampler(vec![trial], with_cycles);
                let found = deviation(&resampler, |resample| resample[0].metrics[Metric::D]);
                assert!((found / expected - 1.0).abs() < 0.05, "{found} for {expected}");
            }
        }
    }

    #[test]
    fn a_single_cycle_is_given_the_spread_of_the_other_trials() {
        let single = trial("single", 3.0, &[0.5]);
        assert!(single.0.errors.d_m.is_nan());
        let several = trial("one", 2.0, &[0.40, 0.42, 0.44]);
        let unbiased = several.0.unbiased();
        let resampler = resampler(vec![several, single], true);
        let found = deviation(&resampler, |resample| resample[1].metrics[Metric::D]);
        // A cycle's relative spread is 0.02 / 0.42.
        let expected = unbiased * 0.5 * 0.02 / 0.42;
        assert!((found / expected - 1.0).abs() < 0.05, "{found} for {expected}");
    }

    #[test]
    fn the_mean_of_repeats_spreads_by_what_the_repeats_differ_by() {
        // Hardly any spread within the trials, much between them.
        let values = [[0.400, 0.401, 0.402], [0.420, 0.421, 0.422], [0.447, 0.448, 0.449]];
        let trials = (0..).zip(values).map(|(i, d_m)| trial(&format!("r{i}"), 2.0, &d_m));
        let resampler = resampler(trials.collect(), true);
        let mean = |resample: &[DrawnTrial]| {
            resample.iter().map(|each| each.metrics[Metric::D]).sum::<f64>() / 3.0
        };
        let means = [0.401_f64, 0.421, 0.448];
        let middle = means.iter().sum::<f64>() / 3.0;
        let variance = means.iter().map(|mean| (mean - middle).powi(2)).sum::<f64>() / 2.0 / 3.0;
        let found = deviation(&resampler, mean);
        assert!((found / variance.sqrt() - 1.0).abs() < 0.05, "{found}");
    }

    #[test]
    fn a_trial_alone_at_its_frequency_is_given_the_spread_of_the_repeats() {
        let mut trials: Vec<_> = (0..)
            .zip([0.40, 0.42, 0.44, 0.46])
            .map(|(i, d)| trial(&format!("r{i}"), 2.0, &[d - 1e-4, d, d + 1e-4]))
            .collect();
        trials.push(trial("alone", 3.0, &[0.2999, 0.3, 0.3001]));
        let resampler = resampler(trials, true);
        let found = deviation(&resampler, |resample| resample[4].metrics[Metric::D]);
        let relative = (0.002_f64 / 3.0).sqrt() / 0.43;
        assert!((found / (0.3 * relative) - 1.0).abs() < 0.05, "{found}");
    }

    #[test]
    fn the_same_number_is_the_same_resample() {
        let trials = || vec![trial("one", 2.0, &[0.40, 0.43, 0.42])];
        let (first, second) = (resampler(trials(), true), resampler(trials(), true));
        let d_m = |resampler: &Resampler, number| resampler.draw(number)[0].metrics[Metric::D];
        assert!((0..20).all(|number| d_m(&first, number) == d_m(&second, number)));
        assert!((1..20).any(|number| d_m(&first, number) != d_m(&first, 0)));
    }
}
