//! Additional trial that best discriminates between two fitted models of a campaign.
//!
//! This trial has the frequency and the metric at which the two predictions differ by the most standard errors of a
//! trial, among frequencies where both models have a stable periodic solution. The relative standard error of a trial,
//! including the between-trial spread, is modelled as a power of the frequency: the Theil-Sen line through the
//! logarithms of all trials' standard errors, or their median for fewer than three frequencies. d and v are one
//! measurement, represented by d where the noise of d is known.
//!
//! References: W. G. Hunter and A. M. Reiner, *Designs for discriminating between two rival models*,
//! Technometrics 7 (1965); P. K. Sen, *Estimates of the regression coefficient based on Kendall's tau*, J. Amer.
//! Statist. Assoc. 63 (1968).

use trilink_mechanics::MotionStatus;
use trilink_robot::metrics::{ByFitted, Metric};
use trilink_statistics::median;
use trilink_tables::{PredictionRow, PredictionSource, ResidualRow};

use super::measurement::Measurement;

/// Minimum number of frequencies for estimating the exponent of frequency in the power law of the noise.
const MIN_FREQUENCIES: usize = 3;
/// Relative difference below which frequencies count as equal.
const SAME_FREQUENCY: f64 = 0.01;

/// Trial that would discriminate between two models.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DiscriminatingTrial {
    pub omega_rad_s: f64,
    pub metric: Metric,
    /// Difference between the models' predictions, in standard errors of a trial.
    pub standard_errors: f64,
}

/// Power-law model for the relative standard errors of an additional trial of a campaign. For each metric: the
/// logarithm of the standard error at 1 rad/s, and the exponent of the frequency; NaN if no trial has a standard error.
pub(super) struct NoiseModel(ByFitted<[f64; 2]>);

impl NoiseModel {
    pub(crate) fn new(measurements: &[Measurement], noises: &[ByFitted<f64>]) -> Self {
        let trials = measurements.iter().zip(noises).map(|(measurement, noises)| {
            let metrics = measurement.metrics;
            (measurement.omega_rad_s, ByFitted::from_fn(|i| noises[i] / metrics[i]))
        });
        Self::from_trials(&trials.collect::<Vec<_>>())
    }

    /// Fits the model to the noise in the residual rows of a fit.
    pub(crate) fn from_residuals(rows: &[ResidualRow]) -> Self {
        let trials = rows.chunk_by(|a, b| a.trial == b.trial).map(|rows| {
            let mut noises = ByFitted::splat(f64::NAN);
            for row in rows {
                if let Some(metric) = Metric::from_column(&row.metric) {
                    noises[metric] = row.noise / row.measured;
                }
            }
            (rows[0].omega_rad_s, noises)
        });
        Self::from_trials(&trials.collect::<Vec<_>>())
    }

    /// Fits the power law to trials, each given by its frequency (rad/s) and the relative standard errors of its
    /// metrics.
    fn from_trials(trials: &[(f64, ByFitted<f64>)]) -> Self {
        Self(ByFitted::from_fn(|i| {
            let known = trials.iter().filter(|(_, noises)| noises[i] > 0.0);
            line(known.map(|(omega_rad_s, noises)| [omega_rad_s.ln(), noises[i].ln()]).collect())
        }))
    }

    /// Returns the relative standard errors of a trial at a frequency; NaN where the noise is not known.
    pub(crate) fn at(&self, omega_rad_s: f64) -> ByFitted<f64> {
        self.0.map(|[intercept, power]| (intercept + power * omega_rad_s.ln()).exp())
    }

    /// Returns the trial that best discriminates between two models, given their predictions; `None` if there is no
    /// frequency at which both have stable solutions, or if the noise is not known.
    pub(crate) fn best_trial(
        &self,
        one: &[PredictionRow],
        other: &[PredictionRow],
    ) -> Option<DiscriminatingTrial> {
        let trials = one.iter().filter(|row| is_stable_on_curve(row)).filter_map(|row| {
            let other = other
                .iter()
                .find(|other| is_stable_on_curve(other) && other.omega_rad_s == row.omega_rad_s)?;
            self.best_metric(row, other)
        });
        most_discriminating(trials)
    }

    /// Returns the trial at the common frequency of two predictions, with the metric that best discriminates between
    /// the two models; `None` if the noise is not known.
    fn best_metric(
        &self,
        one: &PredictionRow,
        other: &PredictionRow,
    ) -> Option<DiscriminatingTrial> {
        let omega_rad_s = one.omega_rad_s;
        let noises = self.at(omega_rad_s);
        let metrics = Metric::FITTED.into_iter();
        let metrics = metrics.filter(|metric| *metric != Metric::V || noises[Metric::D].is_nan());
        most_discriminating(metrics.filter_map(|metric| {
            let (a, b) = (one.metrics[metric], other.metrics[metric]);
            let standard_errors = (a - b).abs() / (noises[metric] * a.abs().max(b.abs()));
            let trial = DiscriminatingTrial { omega_rad_s, metric, standard_errors };
            standard_errors.is_finite().then_some(trial)
        }))
    }
}

/// Whether a prediction is a point of the prediction curve (not of a trial) and its periodic solution is stable.
fn is_stable_on_curve(row: &PredictionRow) -> bool {
    let is_stable = matches!(row.status, MotionStatus::Stable | MotionStatus::SymmetryBroken);
    row.source == PredictionSource::Curve && is_stable
}

/// Fits a Theil-Sen line to `points` (logarithms of frequency and standard error), of which those at equal frequencies
/// are replaced by their median. Returns its intercept and its slope, which is 0 for fewer than [`MIN_FREQUENCIES`]
/// frequencies.
pub(super) fn line(mut points: Vec<[f64; 2]>) -> [f64; 2] {
    points.sort_by(|[a, _], [b, _]| a.total_cmp(b));
    let medians: Vec<[f64; 2]> = points
        .chunk_by(|[a, _], [b, _]| b - a < SAME_FREQUENCY)
        .map(|points| [0, 1].map(|i| median(points.iter().map(|point| point[i]).collect())))
        .collect();
    let slopes = medians.iter().enumerate().flat_map(|(i, [x, y])| {
        medians[..i].iter().map(move |[before, below]| (y - below) / (x - before))
    });
    let slope = if medians.len() < MIN_FREQUENCIES { 0.0 } else { median(slopes.collect()) };
    [median(medians.iter().map(|[x, y]| y - slope * x).collect()), slope]
}

/// Returns the trial for which the predictions of the two models differ by the most standard errors, the first one if
/// several are equal; `None` if there are no trials.
fn most_discriminating(
    trials: impl Iterator<Item = DiscriminatingTrial>,
) -> Option<DiscriminatingTrial> {
    trials.reduce(|a, b| if b.standard_errors > a.standard_errors { b } else { a })
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::{GaitMetrics, padded};
    use trilink_tables::Columns as _;

    use super::*;

    fn curve(points: &[(f64, f64, f64)]) -> Vec<PredictionRow> {
        let row = |(omega_rad_s, d_m, sigma0): &(f64, f64, f64)| PredictionRow {
            omega_rad_s: *omega_rad_s,
            source: PredictionSource::Curve,
            status: MotionStatus::Stable,
            metrics: GaitMetrics {
                d_m: *d_m,
                v_m_s: *d_m,
                sigma: padded(&[*sigma0]),
                ..GaitMetrics::MISSING
            },
            ..PredictionRow::blank()
        };
        points.iter().map(row).collect()
    }

    #[test]
    fn the_metric_with_the_largest_difference_is_found_where_both_models_are_stable() {
        let noises = |d: f64, sigma: f64| {
            ByFitted::of_three_links([d, d, sigma, f64::NAN, f64::NAN, f64::NAN], f64::NAN)
        };
        // With two frequencies the noise is the median of the logarithms.
        let noise = NoiseModel::from_trials(&[
            (1.0, noises(0.01, 0.02)),
            (1.0, noises(0.01, 0.02)),
            (4.0, noises(0.01, 0.1)),
        ]);
        let one = curve(&[(1.0, 0.4, 0.05), (2.0, 0.4, 0.05), (4.0, 0.4, 0.05)]);
        let mut other = curve(&[(1.0, 0.41, 0.05), (2.0, 0.4, 0.04), (4.0, 0.39, 0.02)]);
        let trial = noise.best_trial(&one, &other).expect("they differ");
        assert_eq!((trial.omega_rad_s, trial.metric), (4.0, Metric::Sigma0));
        assert!((trial.standard_errors - 0.6 / (0.02_f64 * 0.1).sqrt()).abs() < 1e-9, "{trial:?}");
        other[2].status = MotionStatus::Unstable;
        let trial = noise.best_trial(&one, &other).expect("they differ");
        assert_eq!((trial.omega_rad_s, trial.metric), (2.0, Metric::Sigma0));
        assert_eq!(noise.best_trial(&one, &[]), None);
        // Without known noise no trial can be recommended.
        let unknown = NoiseModel::from_trials(&[(1.0, ByFitted::splat(0.0))]);
        assert_eq!(unknown.best_trial(&one, &other), None);
    }
    #[test]
    fn the_noise_is_a_power_of_the_frequency() {
        let mut trials: Vec<(f64, ByFitted<f64>)> = [0.5, 1.0, 2.0, 4.0]
            .map(|omega: f64| (omega, ByFitted::splat(0.01 * omega.powf(1.5))))
            .into();
        // A single outlier has little effect.
        trials.push((6.0, ByFitted::splat(3.0)));
        let noise = NoiseModel::from_trials(&trials).at(3.0)[Metric::D];
        assert!((noise / (0.01 * 3_f64.powf(1.5)) - 1.0).abs() < 0.25, "{noise}");
        assert!(NoiseModel::from_trials(&[]).at(3.0)[Metric::D].is_nan());
        let two = [(1.0, ByFitted::splat(0.01)), (2.0, ByFitted::splat(0.03))];
        let two = NoiseModel::from_trials(&two).at(9.0)[Metric::D];
        assert!((0.01..0.03).contains(&two), "{two}");
    }
}
