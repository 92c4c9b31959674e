//! Godambe information of trials on a model's coefficients.
//!
//! The fit minimises a weighted sum of absolute deviations, which is equivalent to maximum likelihood for Laplace
//! distributions if the weights match the noise. They need not match: in general the covariance of the coefficients is
//! the inverse of the Godambe information `H V^-1 H`, where `H` is the curvature of the expected objective and `V` the
//! covariance of its gradient. Consider a metric with relative derivatives `g` with respect to the coefficients'
//! logarithms, weight `w` and relative standard deviation `s`. A trial adds `2 w g g' / (sqrt(2) s)` to `H`, because
//! the density of the Laplace distribution at zero is `1 / (sqrt(2) s)`; each pair of metrics adds `w1 w2 g1 g2'` times
//! the expected product of the signs of the two deviations to `V`.
//!
//! Reference: R. Koenker, *Quantile Regression*, Cambridge 2005, section 3.2; V. P. Godambe, *An optimum
//! property of regular maximum likelihood estimation*, Ann. Math. Statist. 31 (1960).

use std::f64::consts::{FRAC_2_PI, SQRT_2};

use nalgebra::{DMatrix, DVector};
use trilink_robot::metrics::{ByFitted, Metric};

use crate::{FitInformation, TrialInformation};

/// Relative size of rounding errors in the covariance of the gradient; added to the diagonal, it makes the covariance
/// invertible in directions that no trial determines.
const ROUNDING: f64 = 1e-12;

/// Curvature of the objective and covariance of its gradient, both summed over trials.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sums {
    /// Curvature `H` of the expected objective.
    curvature: DMatrix<f64>,
    /// Covariance `V` of the gradient.
    gradient: DMatrix<f64>,
}

impl Sums {
    /// Returns zero sums, for the given number of free coefficients.
    pub(super) fn zero(count: usize) -> Self {
        let zeros = DMatrix::zeros(count, count);
        Self { curvature: zeros.clone(), gradient: zeros }
    }

    /// Returns the contribution of one trial to the curvature and to the covariance of the gradient.
    pub(super) fn from_trial(trial: &TrialInformation) -> Self {
        let mut sums = Self::zero(trial.slopes.len());
        let deviations = deviations(trial);
        let mut terms = Metric::FITTED.to_vec();
        terms.retain(|metric| trial.weights[*metric] > 0.0 && deviations[*metric] > 0.0);
        for &one in &terms {
            let slope = slopes(trial, one);
            let weight = trial.weights[one];
            sums.curvature += SQRT_2 * weight / deviations[one] * &slope * slope.transpose();
            for &other in &terms {
                let correlation =
                    covariance(trial, one, other) / (deviations[one] * deviations[other]);
                let signs = FRAC_2_PI * correlation.clamp(-1.0, 1.0).asin();
                let weights = weight * trial.weights[other];
                sums.gradient += weights * signs * &slope * slopes(trial, other).transpose();
            }
        }
        sums
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.curvature += &other.curvature;
        self.gradient += &other.gradient;
    }

    /// Returns the Godambe information, which is zero in directions that no trial determines.
    pub(super) fn information(&self) -> DMatrix<f64> {
        let count = self.gradient.nrows();
        let floor = ROUNDING * self.gradient.diagonal().amax().max(f64::MIN_POSITIVE);
        let gradient = &self.gradient + floor * DMatrix::identity(count, count);
        let solved = gradient.cholesky().map(|cholesky| cholesky.solve(&self.curvature));
        let information = solved.map(|solved| &self.curvature * solved);
        let information = information.unwrap_or_else(|| DMatrix::zeros(count, count));
        0.5 * (&information + information.transpose())
    }
}

/// Returns the relative derivatives of a metric with respect to the coefficients' logarithms.
fn slopes(trial: &TrialInformation, metric: Metric) -> DVector<f64> {
    DVector::from_iterator(trial.slopes.len(), trial.slopes.iter().map(|slopes| slopes[metric]))
}

/// Returns the information from the coefficients' bounds: for each logarithm, the inverse variance of a uniform
/// distribution between the bounds.
pub(super) fn bounds_information(information: &FitInformation) -> DVector<f64> {
    let inverse_variances = information.free().map(|(free, _)| {
        let [low, high] = free.bounds;
        12.0 / (high / low).ln().powi(2)
    });
    DVector::from_vec(inverse_variances.collect())
}

/// Returns the relative standard deviation of each metric of a trial.
pub(super) fn deviations(trial: &TrialInformation) -> ByFitted<f64> {
    ByFitted::from_fn(|metric| covariance(trial, metric, metric).sqrt())
}

/// Returns the covariance of the relative deviations of two metrics of a trial. The deviations of d and v are equal;
/// all other pairs of metrics have only the errors of the gait in common.
fn covariance(trial: &TrialInformation, one: Metric, other: Metric) -> f64 {
    let are_both_d = [one, other].iter().all(|metric| matches!(metric, Metric::D | Metric::V));
    let is_shared = one == other || are_both_d;
    let own = if is_shared { trial.noise[one] * trial.noise[other] } else { 0.0 };
    own + trial.by_gait.iter().map(|of| of[one] * of[other]).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::{ByFitted, GaitMetrics};

    use super::*;

    pub(crate) fn trial(
        slopes: &[[f64; 6]],
        weights: [f64; 6],
        noise: [f64; 6],
    ) -> TrialInformation {
        TrialInformation {
            metrics: GaitMetrics::from_array([1.0; 7]),
            weights: ByFitted::of_three_links(weights, 0.0),
            slopes: slopes.iter().map(|of| ByFitted::of_three_links(*of, 0.0)).collect(),
            noise: ByFitted::of_three_links(noise, 0.0),
            by_gait: Vec::new(),
            by_assumed: Vec::new(),
        }
    }

    #[test]
    fn d_and_v_are_one_measurement() {
        let slopes = [[0.5, 0.5, 0.0, 0.0, 0.0, 0.0]];
        let noise = [0.1; 6];
        // Expected: 2 g^2 / s^2, whatever the weight.
        for (d, v) in [(1.0, 0.0), (0.0, 10.0), (10.0, 1.0)] {
            let trial = trial(&slopes, [d, v, 0.0, 0.0, 0.0, 0.0], noise);
            let information = Sums::from_trial(&trial).information()[(0, 0)];
            assert!((information / 50.0 - 1.0).abs() < 1e-6, "{information}");
        }
    }

    #[test]
    fn weights_that_do_not_match_the_noise_lose_information() {
        let slopes = [[1.0, 0.0, 1.0, 0.0, 0.0, 0.0]];
        let noise = [0.01, 0.01, 0.04, 0.0, 0.0, 0.0];
        let [matched, mismatched] = [[4.0, 1.0], [1.0, 4.0]].map(|[d, sigma]| {
            let trial = trial(&slopes, [d, 0.0, sigma, 0.0, 0.0, 0.0], noise);
            Sums::from_trial(&trial).information()[(0, 0)]
        });
        // The maximum is the sum of the information from d and from sigma.
        assert!((matched / (2e4 + 2.0 / 0.0016) - 1.0).abs() < 1e-6);
        assert!(mismatched < 0.5 * matched);
    }

    #[test]
    fn directions_that_no_trial_determines_have_no_information() {
        let slopes = [[1.0, 1.0, 0.0, 0.0, 0.0, 0.0], [2.0, 2.0, 0.0, 0.0, 0.0, 0.0]];
        let weights = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let information = Sums::from_trial(&trial(&slopes, weights, [0.1; 6])).information();
        let null = DVector::from_vec(vec![2.0, -1.0]);
        assert!((&information * &null).amax() < 1e-6 * information.amax());
        assert_eq!(Sums::zero(2).information().amax(), 0.0);
    }
}
