//! Which one more trial would tell two fitted models of a campaign apart.
//!
//! The frequency and the metric at which their curves differ by most standard errors of a trial,
//! where both have a motion that is stable. A trial's standard error is the median relative one of
//! the trials at the nearest frequencies, with what repeats differ by. d and v are one measurement:
//! it is d's where that is known.
//!
//! Reference: W. G. Hunter and A. M. Reiner, *Designs for discriminating between two rival models*,
//! Technometrics 7 (1965).

use super::objective::METRICS;
use super::resampler::Resampler;
use super::terms::TERMS;
use crate::motion::MotionStatus;
use crate::stats::median_high;
use crate::store::{PredictionRow, PredictionSource};

/// Trials whose noise tells that of another one nearby.
const NEIGHBOURS: usize = 3;
const D: usize = 0;
const V: usize = 1;

/// A trial that would tell two models apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Tell {
    pub omega_rad_s: f64,
    pub metric: &'static str,
    /// How far both models are apart.
    pub standard_errors: f64,
}

/// How well one more trial of a campaign would measure.
pub(super) struct Noise {
    /// Frequency and relative standard errors of each trial.
    trials: Vec<(f64, [f64; TERMS])>,
}

impl Noise {
    pub fn new(resampler: &Resampler) -> Self {
        let both = resampler.measurements.iter().zip(resampler.noises());
        let trials = both.map(|(measurement, noises)| {
            let metrics = measurement.metrics.to_array();
            (measurement.omega_rad_s, std::array::from_fn(|i| noises[i] / metrics[i]))
        });
        Self { trials: trials.collect() }
    }

    /// Relative standard errors of a trial at a frequency; NaN where nothing tells one.
    fn at(&self, omega_rad_s: f64) -> [f64; TERMS] {
        let mut nearest: Vec<&(f64, [f64; TERMS])> = self.trials.iter().collect();
        let distance = |trial: &(f64, _)| (trial.0 / omega_rad_s).ln().abs();
        nearest.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        std::array::from_fn(|i| {
            let known = nearest.iter().map(|(_, noises)| noises[i]).filter(|noise| *noise > 0.0);
            median_high(known.take(NEIGHBOURS).collect())
        })
    }

    /// The trial that would best tell two models apart by their predictions; `None` where they
    /// have no motions at a frequency in common, or nothing tells the noise.
    pub fn tell(&self, one: &[PredictionRow], other: &[PredictionRow]) -> Option<Tell> {
        let is_there = |row: &&PredictionRow| {
            let is_stable =
                matches!(row.status, MotionStatus::Stable | MotionStatus::SymmetryBroken);
            row.source == PredictionSource::Curve && is_stable
        };
        let tells = one.iter().filter(is_there).filter_map(|row| {
            let same = |other: &&PredictionRow| other.omega_rad_s == row.omega_rad_s;
            let other = other.iter().filter(is_there).find(same)?;
            let (noises, of_one) = (self.at(row.omega_rad_s), row.metrics.to_array());
            let of_other = other.metrics.to_array();
            let tell = |metric: usize| {
                let (a, b) = (of_one[metric], of_other[metric]);
                let standard_errors = (a - b).abs() / (noises[metric] * a.abs().max(b.abs()));
                let metric = METRICS[metric];
                let tell = Tell { omega_rad_s: row.omega_rad_s, metric, standard_errors };
                standard_errors.is_finite().then_some(tell)
            };
            let metrics = (0..TERMS).filter(|i| *i != V || noises[D].is_nan());
            most(metrics.filter_map(tell))
        });
        most(tells)
    }
}

/// The first of those with most standard errors.
fn most(tells: impl Iterator<Item = Tell>) -> Option<Tell> {
    tells.reduce(|a, b| if b.standard_errors > a.standard_errors { b } else { a })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::GaitMetrics;
    use crate::store::Columns as _;

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
        let noises = |d: f64, sigma: f64| [d, d, sigma, f64::NAN, f64::NAN, f64::NAN];
        let trials =
            vec![(1.0, noises(0.01, 0.02)), (1.1, noises(0.01, 0.02)), (4.0, noises(0.01, 0.1))];
        let noise = Noise { trials };
        let one = curve(&[(1.0, 0.4, 0.05), (2.0, 0.4, 0.05), (4.0, 0.4, 0.05)]);
        let mut other = curve(&[(1.0, 0.41, 0.05), (2.0, 0.4, 0.04), (4.0, 0.39, 0.02)]);
        let tell = noise.tell(&one, &other).expect("they differ");
        assert_eq!((tell.omega_rad_s, tell.metric), (4.0, "sigma0"));
        // The median of three trials' noise.
        assert!((tell.standard_errors - 0.6 / 0.02).abs() < 1e-9, "{tell:?}");
        other[2].status = MotionStatus::Unstable;
        let tell = noise.tell(&one, &other).expect("they differ");
        assert_eq!((tell.omega_rad_s, tell.metric), (2.0, "sigma0"));
        assert_eq!(noise.tell(&one, &[]), None);
        // The same trial without noise that is known.
        let silent = Noise { trials: vec![(1.0, [0.0; TERMS])] };
        assert_eq!(silent.tell(&one, &other), None);
    }
}
