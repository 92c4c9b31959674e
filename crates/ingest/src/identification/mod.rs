//! Identifies the robot's parameters from trials without a gait. For each candidate resistance law, a curve with a few
//! parameters is fitted to the trial by least squares.

pub(crate) mod coast;
pub(crate) mod floor;
mod laws;
pub(crate) mod release;

use nalgebra::{Cholesky, SMatrix, SVector};
use trilink_base::numbers::{as_configured, with_error};
use trilink_statistics::least_squares::{Minimum, minimise};
use trilink_statistics::{fisher, normal_tail};
use trilink_tables::{RobotParameterRow, RobotQuantity};

use super::checks::{Check, Finding};
use super::signals::{THIRD_GAIN, third_differences};

/// Step size, in standard errors of the parameters, at which the least-squares search stops.
const SMALL_STEP: f64 = 1e-6;
/// Maximum duration of a batch of residuals, s: over this time the residuals of filtered markers become uncorrelated.
const BATCH_S: f64 = 0.1;
/// Maximum ratio of the slow component of a law's residuals to the noise, for the law to be considered to hold. With
/// few batches of residuals the limit is higher: the ratio that noise alone exceeds as rarely as a normal deviate
/// exceeds three standard deviations. In 120 recordings that follow the fitted law the ratio is 0.8 to 1.4, and up to
/// 1.7 if the markers were filtered at 6 Hz; for a coast-down in which a fiftieth of the resistance is dry friction it
/// is 9.
const MISFIT_TOLERANCE: f64 = 2.0;
/// Number of standard deviations above which a law is rejected.
const REJECTION_DEVIATIONS: f64 = 3.0;
/// Number of third differences of independent values divided by the number of independent values that carry the same
/// information about the variance.
const THIRD_DEPENDENCE: f64 = 2.31;

/// Returns the unit mistake that explains the ratio between a parameter's measured and configured values; `None` if
/// there is none.
fn mistaken_unit(quantity: &RobotQuantity) -> Option<&'static str> {
    let of_joint = quantity.unit.starts_with("N m");
    match quantity.times_configured() {
        5e2..2e3 => Some("mass_kg is in grams"),
        5e-4..2e-3 if of_joint => Some("the configured value is in N mm"),
        40.0..80.0 if of_joint => Some("the configured value is per degree"),
        _ => None,
    }
}

/// Checks whether a robot's measured parameters roughly agree with the configured ones. A unit mistake that explains
/// all deviations fails the trial; otherwise the configured values may have been guesses, and the trial is only
/// flagged.
pub(crate) fn against_configured(row: &RobotParameterRow) -> Finding {
    let known: Vec<RobotQuantity> = row
        .quantities()
        .filter(|quantity| {
            let ratio = quantity.times_configured();
            ratio > 0.0 && ratio.is_finite()
        })
        .collect();
    let largest = known.iter().max_by(|a, b| factor(a).total_cmp(&factor(b)));
    let Some(largest) = largest else {
        let none =
            "none of the measured parameters can be compared with a configured value".to_owned();
        return Finding::at_most(Check::RobotParameters, 1.0, none);
    };
    let mistake = mistaken_unit(largest)
        .filter(|mistake| known.iter().all(|one| mistaken_unit(one) == Some(mistake)));
    let RobotQuantity { name, unit, measured, configured } = largest;
    let ratio = largest.times_configured();
    let hint = mistake.map_or(String::new(), |mistake| format!(": probably {mistake}"));
    let message = format!(
        "{name} is measured as {} {unit}, but configured as {} {unit}: the measured value is {ratio:.4} times the \
         configured one{hint}",
        with_error(measured.value, measured.se),
        as_configured(*configured),
    );
    let finding = Finding::at_most(Check::RobotParameters, factor(largest), message);
    if mistake.is_some() { finding.failing() } else { finding }
}

/// Returns the ratio of measured to configured value or its reciprocal, whichever is at least 1.
fn factor(quantity: &RobotQuantity) -> f64 {
    let ratio = quantity.times_configured();
    ratio.max(1.0 / ratio)
}

/// Law of motion as a function to be fitted.
#[derive(Clone, Copy)]
struct Law<V, B> {
    /// Function that returns the law's value at a time, and its derivatives with respect to the parameters.
    pub value: V,
    /// Function that returns the duration of the batches of residuals, s, for given parameters.
    pub batch_s: B,
    /// Minimum noise of a recording, in the unit of the law's value.
    pub min_noise: f64,
}

/// Law with the parameters fitted to a recording.
#[derive(Debug, Clone, Copy)]
struct Curve<const N: usize> {
    pub parameters: SVector<f64, N>,
    /// Covariance of the parameters; zero for fixed parameters.
    pub covariance: SMatrix<f64, N, N>,
    /// Sum of squared residuals.
    pub squares: f64,
    /// Variance of independent residuals that would give the same standard errors.
    pub variance: f64,
    /// RMS residual, in the unit of the law's value.
    pub misfit: f64,
    /// Ratio of the slow component of the residuals to the noise.
    pub times_noise: f64,
    /// Limit of `times_noise` up to which the law is considered to hold.
    pub limit: f64,
    /// Degrees of freedom: number of residual batches minus number of free parameters.
    pub freedom: f64,
}

impl<const N: usize> Curve<N> {
    /// Fits the free parameters of a law to samples of time and value. `None` if the sum of squares has no minimum or
    /// there are no more samples than parameters.
    ///
    /// Correlated noise averages out more slowly, and a law that does not hold leaves slowly varying residuals: both
    /// appear in the means of the residuals over batches (Schmeiser 1982) of at most `batch_s`. The standard errors
    /// follow from the variance of the batch means where it exceeds that of independent residuals. The noise is
    /// estimated from differences between neighbouring batches (von Neumann 1941); third differences are used, to which
    /// slowly varying residuals contribute nothing.
    pub(crate) fn fit<const FREE: usize>(
        samples: &[(f64, f64)],
        start: SVector<f64, N>,
        free: [usize; FREE],
        Law { value, batch_s, min_noise }: Law<
            impl Fn(&SVector<f64, N>, f64) -> (f64, SVector<f64, N>),
            impl Fn(&SVector<f64, N>) -> f64,
        >,
    ) -> Option<Self> {
        let residual = |values: &SVector<f64, FREE>, (t, y): &(f64, f64)| {
            let (value, slopes) = value(&with_free(start, free, values), *t);
            (y - value, SVector::from(free.map(|i| slopes[i])))
        };
        let begin = SVector::from(free.map(|i| start[i]));
        let Minimum { parameters, squares, normal } =
            minimise(samples, begin, SMALL_STEP, min_noise, residual)?;
        let fitted = with_free(start, free, &parameters);
        let residuals = samples.iter().map(|each| (each.0, residual(&parameters, each).0));
        let batches = batches(residuals, batch_s(&fitted).min(BATCH_S));
        let differences: Vec<f64> = third_differences(&batches).collect();
        let noise = sum_of_squares(&differences) / (THIRD_GAIN * differences.len().max(1) as f64);
        let freedom = batches.len().saturating_sub(FREE).max(1) as f64;
        let slow = sum_of_squares(&batches) / freedom;
        let noise_freedom = differences.len() as f64 / THIRD_DEPENDENCE;
        let limit = fisher(normal_tail(REJECTION_DEVIATIONS), [freedom, noise_freedom]);
        let limit = limit.sqrt().max(MISFIT_TOLERANCE);
        let variance = (squares / (samples.len() - FREE) as f64).max(slow);
        let of_free = Cholesky::new(normal)?.inverse() * variance;
        let mut covariance = SMatrix::zeros();
        for (row, i) in free.into_iter().enumerate() {
            free.iter().enumerate().for_each(|(k, j)| covariance[(i, *j)] = of_free[(row, k)]);
        }
        Some(Self {
            parameters: fitted,
            covariance,
            squares,
            variance,
            misfit: (squares / samples.len() as f64).sqrt(),
            times_noise: slow.sqrt() / noise.sqrt().max(min_noise),
            limit,
            freedom,
        })
    }

    /// Returns the curve with the smallest sum of squared residuals; `None` if there is no curve.
    pub(crate) fn smallest(found: impl IntoIterator<Item = Option<Self>>) -> Option<Self> {
        let found = found.into_iter().flatten();
        found.min_by(|one, other| one.squares.total_cmp(&other.squares))
    }

    /// Returns the standard error of a function of the parameters, given its derivatives with respect to them.
    pub(crate) fn se(&self, slopes: SVector<f64, N>) -> f64 {
        slopes.dot(&(self.covariance * slopes)).max(0.0).sqrt()
    }
}

/// Returns all parameters, with the free ones set to the given values.
fn with_free<const N: usize, const FREE: usize>(
    mut parameters: SVector<f64, N>,
    free: [usize; FREE],
    values: &SVector<f64, FREE>,
) -> SVector<f64, N> {
    free.iter().zip(values).for_each(|(i, value)| parameters[*i] = *value);
    parameters
}

fn sum_of_squares(values: &[f64]) -> f64 {
    values.iter().map(|x| x * x).sum::<f64>()
}

/// Sums residuals, given with their times, over batches of equal duration and divides each sum by the square root of
/// the batch's count, so that for independent residuals all results have the same variance.
fn batches(residuals: impl Iterator<Item = (f64, f64)>, batch_s: f64) -> Vec<f64> {
    let mut batches: Vec<(f64, f64, f64)> = Vec::new();
    for (t, residual) in residuals {
        let number = (t / batch_s).floor();
        match batches.last_mut().filter(|(last, ..)| *last == number) {
            Some((_, sum, count)) => {
                *sum += residual;
                *count += 1.0;
            }
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
        let samples: Vec<(f64, f64)> = (0..200)
            .map(|i| {
                let noise = 0.01 * ((i * i * 7919) as f64).sin();
                (0.02 * i as f64, 2.0 * (-0.5 * 0.02 * i as f64).exp() + noise)
            })
            .collect();
        let law = Law { value: model, batch_s: |_: &_| 0.2, min_noise: 0.0 };
        let fit = |samples| Curve::fit(samples, SVector::from([1.0, 1.0]), [0, 1], law);
        let curve = fit(&samples).unwrap();
        let se = curve.se(SVector::from([0.0, 1.0]));
        assert!((curve.parameters[1] - 0.5).abs() < 3.0 * se, "{}", curve.parameters);
        assert!(se < 1e-3 && curve.misfit < 0.008);
        assert!(curve.times_noise <= curve.limit, "{}", curve.times_noise);
        assert!(fit(&samples[..2]).is_none());
    }
}
