//! Which one more trial would tell two fitted models of a campaign apart.
//!
//! The frequency and the metric at which their curves differ by most standard errors of a trial,
//! where both have a motion that is stable. A trial's relative standard error, with what repeats differ
//! by, goes with a power of the frequency, by Theil and Sen's line through the logarithms of all
//! trials'; of fewer than three frequencies it is the median. d and v are one measurement: it is d's
//! where that is known.
//!
//! References: W. G. Hunter and A. M. Reiner, *Designs for discriminating between two rival models*,
//! Technometrics 7 (1965); P. K. Sen, *Estimates of the regression coefficient based on Kendall's tau*, J. Amer.
//! Statist. Assoc. 63 (1968).

use trilink_mechanics::MotionStatus;
use trilink_robot::metrics::{ByFitted, Metric};
use trilink_statistics::median;
use trilink_tables::{PredictionRow, PredictionSource};

use super::resampler::Resampler;

/// Fewer frequencies do not tell a power.
const LEAST_FREQUENCIES: usize = 3;
/// Frequencies that differ by less, relative, are one.
const SAME_FREQUENCY: f64 = 0.01;

/// A trial that would tell two models apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Tell {
    pub omega_rad_s: f64,
    pub metric: Metric,
    /// How far both models are apart.
    pub standard_errors: f64,
}

/// How well one more trial of a campaign would measure: of each metric a power of the frequency, as
/// logarithms of the relative standard error at 1 rad/s, and the power; NaN where nothing tells it.
pub(super) struct Noise(ByFitted<[f64; 2]>);

impl Noise {
    pub(crate) fn new(resampler: &Resampler) -> Self {
        let both = resampler.measurements.iter().zip(resampler.noises());
        let trials = both.map(|(measurement, noises)| {
            let metrics = measurement.metrics;
            (measurement.omega_rad_s, ByFitted::from_fn(|i| noises[i] / metrics[i]))
        });
        Self::of(&trials.collect::<Vec<_>>())
    }

    /// Of each trial's frequency and relative standard errors.
    fn of(trials: &[(f64, ByFitted<f64>)]) -> Self {
        let logarithms = |i: Metric| {
            let known = trials.iter().filter(move |(_, noises)| noises[i] > 0.0);
            known.map(move |(omega_rad_s, noises)| [omega_rad_s.ln(), noises[i].ln()])
        };
        Self(ByFitted::from_fn(|i| line(logarithms(i).collect())))
    }

    /// Relative standard errors of a trial at a frequency; NaN where nothing tells one.
    pub(crate) fn at(&self, omega_rad_s: f64) -> ByFitted<f64> {
        self.0.map(|[begin, power]| (begin + power * omega_rad_s.ln()).exp())
    }

    /// The trial that would best tell two models apart by their predictions; `None` where they
    /// have no motions at a frequency in common, or nothing tells the noise.
    pub(crate) fn tell(&self, one: &[PredictionRow], other: &[PredictionRow]) -> Option<Tell> {
        let is_there = |row: &&PredictionRow| {
            let is_stable =
                matches!(row.status, MotionStatus::Stable | MotionStatus::SymmetryBroken);
            row.source == PredictionSource::Curve && is_stable
        };
        let tells = one.iter().filter(is_there).filter_map(|row| {
            let same = |other: &&PredictionRow| other.omega_rad_s == row.omega_rad_s;
            let other = other.iter().filter(is_there).find(same)?;
            let noises = self.at(row.omega_rad_s);
            let tell = |metric: Metric| {
                let (a, b) = (row.metrics[metric], other.metrics[metric]);
                let standard_errors = (a - b).abs() / (noises[metric] * a.abs().max(b.abs()));
                let tell = Tell { omega_rad_s: row.omega_rad_s, metric, standard_errors };
                standard_errors.is_finite().then_some(tell)
            };
            let is_other = |of: &Metric| *of != Metric::V || noises[Metric::D].is_nan();
            let metrics = Metric::FITTED.into_iter().filter(is_other);
            most(metrics.filter_map(tell))
        });
        most(tells)
    }
}

/// Where Theil and Sen's line through the medians of each frequency is at 0, and its slope; that is 0
/// where too few frequencies tell it.
fn line(mut points: Vec<[f64; 2]>) -> [f64; 2] {
    points.sort_by(|[a, _], [b, _]| a.total_cmp(b));
    let of_frequency =
        |of: &[[f64; 2]]| [0, 1].map(|i| median(of.iter().map(|point| point[i]).collect()));
    let chunks = points.chunk_by(|[a, _], [b, _]| b - a < SAME_FREQUENCY);
    let medians: Vec<[f64; 2]> = chunks.map(of_frequency).collect();
    let slopes = medians.iter().enumerate().flat_map(|(i, [x, y])| {
        medians[..i].iter().map(move |[before, below]| (y - below) / (x - before))
    });
    let slope = match medians.len() < LEAST_FREQUENCIES {
        true => 0.0,
        false => median(slopes.collect()),
    };
    [median(medians.iter().map(|[x, y]| y - slope * x).collect()), slope]
}

/// The first of those with most standard errors.
fn most(tells: impl Iterator<Item = Tell>) -> Option<Tell> {
    tells.reduce(|a, b| if b.standard_errors > a.standard_errors { b } else { a })
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::GaitMetrics;
    use trilink_tables::Columns as _;

    use super::*;

    fn curve(of: &[(f64, f64, f64)]) -> Vec<PredictionRow> {
        let row = |(omega_rad_s, d_m, sigma0): &(f64, f64, f64)| PredictionRow {
            omega_rad_s: *omega_rad_s,
            source: PredictionSource::Curve,
            status: MotionStatus::Stable,
            metrics: GaitMetrics {
                d_m: *d_m,
                v_m_s: *d_m,
                sigma: [*sigma0, f64::NAN, f64::NAN],
                ..GaitMetrics::MISSING
            },
            ..PredictionRow::blank()
        };
        of.iter().map(row).collect()
    }

    #[test]
    fn the_metric_that_differs_by_most_standard_errors_tells_where_both_are_stable() {
        let noises = |d: f64, sigma: f64| [d, d, sigma, f64::NAN, f64::NAN, f64::NAN].into();
        // Of two frequencies the median: of logarithms.
        let noise = Noise::of(&[
            (1.0, noises(0.01, 0.02)),
            (1.0, noises(0.01, 0.02)),
            (4.0, noises(0.01, 0.1)),
        ]);
        let one = curve(&[(1.0, 0.4, 0.05), (2.0, 0.4, 0.05), (4.0, 0.4, 0.05)]);
        let mut other = curve(&[(1.0, 0.41, 0.05), (2.0, 0.4, 0.04), (4.0, 0.39, 0.02)]);
        let tell = noise.tell(&one, &other).expect("they differ");
        assert_eq!((tell.omega_rad_s, tell.metric), (4.0, Metric::Sigma0));
        assert!((tell.standard_errors - 0.6 / (0.02_f64 * 0.1).sqrt()).abs() < 1e-9, "{tell:?}");
        other[2].status = MotionStatus::Unstable;
        let tell = noise.tell(&one, &other).expect("they differ");
        assert_eq!((tell.omega_rad_s, tell.metric), (2.0, Metric::Sigma0));
        assert_eq!(noise.tell(&one, &[]), None);
        // The same trial without noise that is known.
        let silent = Noise::of(&[(1.0, ByFitted::splat(0.0))]);
        assert_eq!(silent.tell(&one, &other), None);
    }

    #[test]
    fn noise_goes_with_a_power_of_the_frequency() {
        let mut trials: Vec<(f64, ByFitted<f64>)> = [0.5, 1.0, 2.0, 4.0]
            .map(|omega: f64| (omega, ByFitted::splat(0.01 * omega.powf(1.5))))
            .into();
        // One that is off does not matter.
        trials.push((6.0, ByFitted::splat(3.0)));
        let noise = Noise::of(&trials).at(3.0)[Metric::D];
        assert!((noise / (0.01 * 3_f64.powf(1.5)) - 1.0).abs() < 0.25, "{noise}");
        assert!(Noise::of(&[]).at(3.0)[Metric::D].is_nan());
        let two = Noise::of(&[(1.0, ByFitted::splat(0.01)), (2.0, ByFitted::splat(0.03))]).at(9.0)
            [Metric::D];
        assert!((0.01..0.03).contains(&two), "{two}");
    }
}
