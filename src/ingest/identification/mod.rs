//! The robot's parameters by trials without a gait, each a least-squares fit of a curve with a few
//! parameters.

pub mod coast;
pub mod release;

use nalgebra::{Cholesky, SMatrix, SVector};

use super::checks::{Check, Finding};
use super::signals::{THIRD_GAIN, third_differences};
use crate::least_squares::{Minimum, minimise};

/// A step of this part of the parameters' standard errors ends the search.
const SMALL_STEP: f64 = 1e-6;
/// Residuals are averaged over at most this time, s: by then those of filtered markers have
/// forgotten each other.
const BATCH_S: f64 = 0.1;
/// How many times the noise the slow part of the residuals may be. Over 120 recordings whose law
/// holds it is 0.8 to 1.4, and to 1.7 if their markers went through a filter of 6 Hz; a
/// coast-down of which a fiftieth is dry comes to 9.
const MISFIT_TOLERANCE: f64 = 2.0;
/// A recording has at least the noise of its digits, m or rad.
const LEAST_NOISE: f64 = 1e-6;

/// A law with its parameters, as fitted to a recording.
#[derive(Debug, Clone, Copy)]
struct Curve<const N: usize> {
    pub parameters: SVector<f64, N>,
    pub covariance: SMatrix<f64, N, N>,
    /// RMS residual.
    pub misfit: f64,
    /// What is slow in the residuals, over what noise makes of it.
    pub times_noise: f64,
}

impl<const N: usize> Curve<N> {
    /// Fits `law`, which gives the value and its derivatives at a time, to samples of time
    /// and value; `None` if there is no minimum or there are no more samples than parameters.
    ///
    /// Noise that is correlated averages out more slowly, and a law that does not hold leaves what
    /// is slow: both are seen in the residuals' means over batches (Schmeiser 1982) of `batch_s` at
    /// most. The errors follow from the batches' variance where it is larger than that of
    /// independent residuals. Noise is what differs between neighbouring batches (von Neumann
    /// 1941), here by third differences, in which the slow rest leaves nothing.
    pub fn fit(
        samples: &[(f64, f64)],
        start: SVector<f64, N>,
        law: impl Fn(&SVector<f64, N>, f64) -> (f64, SVector<f64, N>),
        batch_s: impl Fn(&SVector<f64, N>) -> f64,
    ) -> Option<Self> {
        let residual = |parameters: &SVector<f64, N>, (t, y): &(f64, f64)| {
            let (value, slopes) = law(parameters, *t);
            (y - value, slopes)
        };
        let Minimum { parameters, squares, normal } =
            minimise(samples, start, SMALL_STEP, residual)?;
        let residuals = samples.iter().map(|each| (each.0, residual(&parameters, each).0));
        let batches = batches(residuals, batch_s(&parameters).min(BATCH_S));
        let squares_of = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>();
        let differences: Vec<f64> = third_differences(&batches).collect();
        let noise = squares_of(&differences) / (THIRD_GAIN * differences.len().max(1) as f64);
        let slow = squares_of(&batches) / batches.len().saturating_sub(N).max(1) as f64;
        let variance = squares / (samples.len() - N) as f64;
        Some(Self {
            parameters,
            covariance: Cholesky::new(normal)?.inverse() * variance.max(slow),
            misfit: (squares / samples.len() as f64).sqrt(),
            times_noise: slow.sqrt() / noise.sqrt().max(LEAST_NOISE),
        })
    }

    /// Standard error of a function of the parameters, given its derivatives.
    pub fn se(&self, slopes: SVector<f64, N>) -> f64 {
        slopes.dot(&(self.covariance * slopes)).max(0.0).sqrt()
    }

    /// Whether the law holds, by its name and how far the recording is off it.
    pub fn check(&self, law: &str, off: &str) -> Finding {
        let (found, needed) = (self.times_noise, MISFIT_TOLERANCE);
        let message = match found <= needed {
            true => format!("the recording is {off} (RMS) off {law}"),
            false => format!(
                "the recording does not follow {law}, whose parameters are given no value: it is \
                 {off} (RMS) off, and what is slow in that is {found:.1} times the noise, needed \
                 at most {needed}"
            ),
        };
        Finding::at_most(Check::Decay, found, needed, message)
    }
}

/// Sums of residuals at their times over batches of equal time, each over the root of its count:
/// of independent residuals they have the same variance.
fn batches(residuals: impl Iterator<Item = (f64, f64)>, batch_s: f64) -> Vec<f64> {
    let mut batches: Vec<(f64, f64, f64)> = Vec::new();
    for (t, residual) in residuals {
        let number = (t / batch_s).floor();
        match batches.last_mut().filter(|(last, ..)| *last == number) {
            Some((_, sum, count)) => (*sum, *count) = (*sum + residual, *count + 1.0),
            None => batches.push((number, residual, 1.0)),
        }
    }
    batches.into_iter().map(|(_, sum, count)| sum / count.sqrt()).collect()
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
        let fit = |samples| Curve::fit(samples, SVector::from([1.0, 1.0]), model, |_| 0.2);
        let curve = fit(&samples).unwrap();
        let se = curve.se(SVector::from([0.0, 1.0]));
        assert!((curve.parameters[1] - 0.5).abs() < 3.0 * se, "{}", curve.parameters);
        assert!(se < 1e-3 && curve.misfit < 0.008);
        assert!(curve.check("a law", "0.007").holds(), "{}", curve.times_noise);
        assert!(fit(&samples[..2]).is_none());
    }
}
