//! The information that trials have on a model's coefficients.
//!
//! The fit minimises a weighted sum of absolute deviations, which is the likelihood of Laplace's
//! distribution where the weights are those of the noise. They need not be: the covariance of the
//! coefficients is then the inverse of Godambe's information `H V^-1 H`, of the curvature `H` of the
//! expected objective and the covariance `V` of its gradient. With the relative derivatives `g` of a
//! metric by the coefficients' logarithms, its weight `w` and its relative standard deviation `s` a
//! trial adds `2 w g g' / (sqrt(2) s)` to `H`, the density of Laplace's distribution at zero being
//! `1 / (sqrt(2) s)`, and `w w' g g''` times the expected product of the signs of two deviations to `V`.
//!
//! Reference: R. Koenker, *Quantile Regression*, Cambridge 2005, section 3.2; V. P. Godambe, *An optimum
//! property of regular maximum likelihood estimation*, Ann. Math. Statist. 31 (1960).

use std::f64::consts::{FRAC_2_PI, SQRT_2};

use nalgebra::{DMatrix, DVector};
use trilink_robot::metrics::{ByFitted, Metric};

use crate::{FitInformation, TrialInformation};

/// Largest entry of the gradient's covariance, as a part of it, that rounding leaves where there is none.
const ROUNDING: f64 = 1e-12;

/// What some trials add up to.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sums {
    curvature: DMatrix<f64>,
    gradient: DMatrix<f64>,
}

impl Sums {
    /// Of no trial.
    pub(super) fn none(count: usize) -> Self {
        let zeros = DMatrix::zeros(count, count);
        Self { curvature: zeros.clone(), gradient: zeros }
    }

    /// Of one trial.
    pub(super) fn of(trial: &TrialInformation) -> Self {
        let mut sums = Self::none(trial.slopes.len());
        let deviations = deviations(trial);
        let slopes = |metric: Metric| {
            DVector::from_iterator(trial.slopes.len(), trial.slopes.iter().map(|of| of[metric]))
        };
        let known = |metric: &Metric| trial.weights[*metric] > 0.0 && deviations[*metric] > 0.0;
        let terms = || Metric::FITTED.into_iter().filter(known);
        for one in terms() {
            let (slope, weight) = (slopes(one), trial.weights[one]);
            sums.curvature += SQRT_2 * weight / deviations[one] * &slope * slope.transpose();
            for other in terms() {
                let correlation =
                    covariance(trial, one, other) / (deviations[one] * deviations[other]);
                let signs = FRAC_2_PI * correlation.clamp(-1.0, 1.0).asin();
                let weights = weight * trial.weights[other];
                sums.gradient += weights * signs * &slope * slopes(other).transpose();
            }
        }
        sums
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.curvature += &other.curvature;
        self.gradient += &other.gradient;
    }

    /// Godambe's information; of directions that no trial tells it is zero.
    pub(super) fn information(&self) -> DMatrix<f64> {
        let count = self.gradient.nrows();
        let floor = ROUNDING * self.gradient.diagonal().amax().max(f64::MIN_POSITIVE);
        let gradient = &self.gradient + floor * DMatrix::identity(count, count);
        let solved = gradient.cholesky().map(|of| of.solve(&self.curvature));
        let information = solved.map(|of| &self.curvature * of);
        let information = information.unwrap_or_else(|| DMatrix::zeros(count, count));
        0.5 * (&information + information.transpose())
    }
}

/// What the bounds of the coefficients tell by themselves: of each logarithm the inverse variance of a
/// uniform distribution between them.
pub(super) fn of_bounds(information: &FitInformation) -> DVector<f64> {
    let inverse = |[low, high]: [f64; 2]| 12.0 / (high / low).ln().powi(2);
    let all: Vec<f64> = information.free().map(|(free, _)| inverse(free.bounds)).collect();
    DVector::from_vec(all)
}

/// Relative standard deviation of each metric.
pub(super) fn deviations(trial: &TrialInformation) -> ByFitted<f64> {
    ByFitted::from_fn(|metric| covariance(trial, metric, metric).sqrt())
}

/// What the deviations of two metrics of a trial have in common: all for d and v, else the gait.
fn covariance(trial: &TrialInformation, one: Metric, other: Metric) -> f64 {
    let is_of_d = |of: Metric| matches!(of, Metric::D | Metric::V);
    let is_shared = one == other || is_of_d(one) && is_of_d(other);
    let own = if is_shared { trial.noise[one] * trial.noise[other] } else { 0.0 };
    own + trial.by_gait.iter().map(|of| of[one] * of[other]).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::GaitMetrics;

    use super::*;

    pub(crate) fn trial(
        slopes: &[[f64; 6]],
        weights: [f64; 6],
        noise: [f64; 6],
    ) -> TrialInformation {
        TrialInformation {
            metrics: GaitMetrics::from_array([1.0; 7]),
            weights: weights.into(),
            slopes: slopes.iter().map(|of| (*of).into()).collect(),
            noise: noise.into(),
            by_gait: Vec::new(),
            by_assumed: Vec::new(),
        }
    }

    #[test]
    fn d_and_v_are_one_measurement() {
        let slopes = [[0.5, 0.5, 0.0, 0.0, 0.0, 0.0]];
        let noise = [0.1; 6];
        let of = |d: f64, v: f64| {
            Sums::of(&trial(&slopes, [d, v, 0.0, 0.0, 0.0, 0.0], noise)).information()[(0, 0)]
        };
        // 2 g^2 / s^2, whatever the weight is.
        for (d, v) in [(1.0, 0.0), (0.0, 10.0), (10.0, 1.0)] {
            assert!((of(d, v) / 50.0 - 1.0).abs() < 1e-6, "{}", of(d, v));
        }
    }

    #[test]
    fn weights_that_are_not_those_of_the_noise_cost_information() {
        let slopes = [[1.0, 0.0, 1.0, 0.0, 0.0, 0.0]];
        let noise = [0.01, 0.01, 0.04, 0.0, 0.0, 0.0];
        let of = |d: f64, sigma: f64| {
            Sums::of(&trial(&slopes, [d, 0.0, sigma, 0.0, 0.0, 0.0], noise)).information()[(0, 0)]
        };
        // The most is the sum of both.
        assert!((of(4.0, 1.0) / (2e4 + 2.0 / 0.0016) - 1.0).abs() < 1e-6);
        assert!(of(1.0, 4.0) < 0.5 * of(4.0, 1.0));
    }

    #[test]
    fn what_no_trial_tells_has_no_information() {
        let slopes = [[1.0, 1.0, 0.0, 0.0, 0.0, 0.0], [2.0, 2.0, 0.0, 0.0, 0.0, 0.0]];
        let weights = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let information = Sums::of(&trial(&slopes, weights, [0.1; 6])).information();
        let null = DVector::from_vec(vec![2.0, -1.0]);
        assert!((&information * &null).amax() < 1e-6 * information.amax());
        assert_eq!(Sums::none(2).information().amax(), 0.0);
    }
}
