//! The robot's parameters by trials without a gait, each a least-squares fit of a curve with a few
//! parameters.

pub mod coast;
pub mod release;

use nalgebra::{Cholesky, SMatrix, SVector};

use crate::least_squares::{Minimum, minimise};

/// Lags that count, in units of the sum of the autocorrelations.
const WINDOW: f64 = 5.0;
/// A step of this part of the parameters' standard errors ends the search.
const SMALL_STEP: f64 = 1e-6;

/// Parameters with their covariance.
#[derive(Debug, Clone, Copy)]
struct Curve<const N: usize> {
    pub parameters: SVector<f64, N>,
    /// Residuals that are correlated count for fewer independent samples.
    pub covariance: SMatrix<f64, N, N>,
    /// What a change of the samples does to the parameters, after the model's derivatives.
    pub inverse: SMatrix<f64, N, N>,
    /// RMS residual.
    pub misfit: f64,
}

impl<const N: usize> Curve<N> {
    /// Fits `model`, which gives the value and its derivatives at a time, to samples of time
    /// and value; `None` if there is no minimum or there are no more samples than parameters.
    pub fn fit(
        samples: &[(f64, f64)],
        start: SVector<f64, N>,
        model: impl Fn(&SVector<f64, N>, f64) -> (f64, SVector<f64, N>),
    ) -> Option<Self> {
        let residual = |parameters: &SVector<f64, N>, (t, y): &(f64, f64)| {
            let (value, slopes) = model(parameters, *t);
            (y - value, slopes)
        };
        let Minimum { parameters, squares, normal } =
            minimise(samples, start, SMALL_STEP, residual)?;
        let residuals: Vec<f64> =
            samples.iter().map(|each| residual(&parameters, each).0).collect();
        let variance = squares / (samples.len() - N) as f64;
        let inverse = Cholesky::new(normal)?.inverse();
        let covariance = inverse * variance * inflation(&residuals);
        let misfit = (squares / samples.len() as f64).sqrt();
        Some(Self { parameters, covariance, inverse, misfit })
    }

    /// Standard error of a function of the parameters, given its derivatives.
    pub fn se(&self, slopes: SVector<f64, N>) -> f64 {
        slopes.dot(&(self.covariance * slopes)).max(0.0).sqrt()
    }
}

/// By how much the correlation of the residuals raises the variance: the sum of their
/// autocorrelations, up to a lag of [`WINDOW`] times that sum (Sokal 1997). The links' slow tilt
/// is small beside the cameras' noise and counts nevertheless, because it does not average out.
fn inflation(residuals: &[f64]) -> f64 {
    let product =
        |lag: usize| -> f64 { residuals.iter().zip(&residuals[lag..]).map(|(a, b)| a * b).sum() };
    let squares = product(0).max(f64::MIN_POSITIVE);
    let mut sum = 1.0;
    for lag in 1..residuals.len() / 2 {
        sum += 2.0 * product(lag) / squares;
        if lag as f64 >= WINDOW * sum {
            break;
        }
    }
    sum.max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_exponential_is_found_and_its_errors_are_the_scatter() {
        let model = |p: &SVector<f64, 2>, t: f64| {
            let decay = (-p[1] * t).exp();
            (p[0] * decay, SVector::from([decay, -t * p[0] * decay]))
        };
        let noise = |i: usize| 0.01 * ((i * i * 7919) as f64).sin();
        let sample = |i: usize| (0.02 * i as f64, 2.0 * (-0.5 * 0.02 * i as f64).exp() + noise(i));
        let samples: Vec<(f64, f64)> = (0..200).map(sample).collect();
        let curve = Curve::fit(&samples, SVector::from([1.0, 1.0]), model).unwrap();
        let se = curve.se(SVector::from([0.0, 1.0]));
        assert!((curve.parameters[1] - 0.5).abs() < 3.0 * se, "{}", curve.parameters);
        assert!(se < 1e-3 && curve.misfit < 0.008);
        assert!(Curve::fit(&samples[..2], SVector::from([1.0, 1.0]), model).is_none());
    }
}
