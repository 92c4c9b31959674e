//! The robot's parameters by trials without a gait, each a least-squares fit of a curve with a few
//! parameters, by each of the laws that may be what resists the motion.

pub(crate) mod coast;
mod laws;
pub(crate) mod release;

use nalgebra::{Cholesky, SMatrix, SVector};
use trilink_statistics::fisher;
use trilink_statistics::least_squares::{Minimum, minimise};
use trilink_tables::{RobotParameterRow, RobotQuantity};

use super::checks::{Check, Finding};
use super::signals::{THIRD_GAIN, third_differences};

/// A step of this part of the parameters' standard errors ends the search.
const SMALL_STEP: f64 = 1e-6;
/// Residuals are averaged over at most this time, s: by then those of filtered markers have
/// forgotten each other.
const BATCH_S: f64 = 0.1;
/// How many times the noise the slow part of the residuals may be, or what that ratio of two errors is
/// at three standard deviations if there are few batches. Over 120 recordings whose law
/// holds it is 0.8 to 1.4, and to 1.7 if their markers went through a filter of 6 Hz; a
/// coast-down of which a fiftieth is dry comes to 9.
const MISFIT_TOLERANCE: f64 = 2.0;
/// Standard deviations beyond which a law is refused.
const REFUSED_BEYOND: f64 = 3.0;
/// Third differences of independent values are as certain as so many times fewer independent ones.
const THIRD_DEPENDENCE: f64 = 2.31;

/// The mistake of units that makes one measured parameter so many times as large as configured.
fn mistaken_unit(of: &RobotQuantity) -> Option<&'static str> {
    let of_joint = of.unit.starts_with("N m");
    match of.times_configured() {
        5e2..2e3 => Some("mass_kg is in grams"),
        5e-4..2e-3 if of_joint => Some("it is configured in N mm"),
        40.0..80.0 if of_joint => Some("it is configured per degree"),
        _ => None,
    }
}

/// Whether what a trial tells of its robot is about what is configured. A mistake of units that
/// explains all of it fails the trial; else whoever measures a parameter may have configured a guess.
pub(crate) fn against_configured(row: &RobotParameterRow) -> Finding {
    let ratio = RobotQuantity::times_configured;
    let times = |of: &RobotQuantity| ratio(of).max(1.0 / ratio(of));
    let is_known = |of: &RobotQuantity| ratio(of) > 0.0 && ratio(of).is_finite();
    let known = || row.quantities().filter(is_known);
    let Some(of) = known().max_by(|a, b| times(a).total_cmp(&times(b))) else {
        let none = "none is configured".to_owned();
        return Finding::at_most(Check::RobotParameters, 1.0, none);
    };
    let mistake =
        mistaken_unit(&of).filter(|of| known().all(|one| mistaken_unit(&one) == Some(of)));
    let RobotQuantity { name, unit, measured, configured } = of;
    let (measured, factor) = (measured.value, ratio(&of));
    let hint = mistake.map_or(String::new(), |mistake| format!(": probably {mistake}"));
    let message = format!(
        "{name} is measured {measured:.3e} {unit}, configured {configured:.3e}: {factor:.4} times as much{hint}"
    );
    let finding = Finding::at_most(Check::RobotParameters, times(&of), message);
    if mistake.is_some() { finding.failing() } else { finding }
}

/// A law of motion.
#[derive(Clone, Copy)]
struct Law<V, B> {
    /// The value at a time and its derivatives by the parameters.
    pub value: V,
    /// How long the residuals' batches are, s, by the parameters.
    pub batch_s: B,
    /// A recording has at least this noise, in the unit of the value.
    pub least_noise: f64,
}

/// A law with its parameters, as fitted to a recording.
#[derive(Debug, Clone, Copy)]
struct Curve<const N: usize> {
    pub parameters: SVector<f64, N>,
    /// 0 of what was not free.
    pub covariance: SMatrix<f64, N, N>,
    /// Sum of squared residuals, and the variance of independent ones that have the errors' size.
    pub squares: f64,
    pub variance: f64,
    /// RMS residual.
    pub misfit: f64,
    /// What is slow in the residuals, over what noise makes of it; and what that is at most where
    /// the law holds.
    pub times_noise: f64,
    pub limit: f64,
    /// Batches of residuals beyond the number of free parameters.
    pub freedom: f64,
}

impl<const N: usize> Curve<N> {
    /// Fits the free ones of a law's parameters to samples of time and value; `None` if there is no
    /// minimum or there are no more samples than parameters.
    ///
    /// Noise that is correlated averages out more slowly, and a law that does not hold leaves what
    /// is slow: both are seen in the residuals' means over batches (Schmeiser 1982) of `batch_s` at
    /// most. The errors follow from the batches' variance where it is larger than that of
    /// independent residuals. Noise is what differs between neighbouring batches (von Neumann
    /// 1941), here by third differences, in which the slow rest leaves nothing.
    pub(crate) fn fit<const FREE: usize>(
        samples: &[(f64, f64)],
        start: SVector<f64, N>,
        free: [usize; FREE],
        Law { value, batch_s, least_noise }: Law<
            impl Fn(&SVector<f64, N>, f64) -> (f64, SVector<f64, N>),
            impl Fn(&SVector<f64, N>) -> f64,
        >,
    ) -> Option<Self> {
        let whole = |some: &SVector<f64, FREE>| {
            let mut all = start;
            free.iter().zip(some).for_each(|(i, value)| all[*i] = *value);
            all
        };
        let residual = |some: &SVector<f64, FREE>, (t, y): &(f64, f64)| {
            let (value, slopes) = value(&whole(some), *t);
            (y - value, SVector::from(free.map(|i| slopes[i])))
        };
        let begin = SVector::from(free.map(|i| start[i]));
        let Minimum { parameters, squares, normal } =
            minimise(samples, begin, SMALL_STEP, least_noise, residual)?;
        let residuals = samples.iter().map(|each| (each.0, residual(&parameters, each).0));
        let batches = batches(residuals, batch_s(&whole(&parameters)).min(BATCH_S));
        let squares_of = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>();
        let differences: Vec<f64> = third_differences(&batches).collect();
        let noise = squares_of(&differences) / (THIRD_GAIN * differences.len().max(1) as f64);
        let freedom = batches.len().saturating_sub(FREE).max(1) as f64;
        let slow = squares_of(&batches) / freedom;
        let certain = differences.len() as f64 / THIRD_DEPENDENCE;
        let limit = fisher(REFUSED_BEYOND, [freedom, certain]).sqrt().max(MISFIT_TOLERANCE);
        let variance = (squares / (samples.len() - FREE) as f64).max(slow);
        let of_free = Cholesky::new(normal)?.inverse() * variance;
        let mut covariance = SMatrix::zeros();
        for (row, i) in free.into_iter().enumerate() {
            free.iter().enumerate().for_each(|(k, j)| covariance[(i, *j)] = of_free[(row, k)]);
        }
        Some(Self {
            parameters: whole(&parameters),
            covariance,
            squares,
            variance,
            misfit: (squares / samples.len() as f64).sqrt(),
            times_noise: slow.sqrt() / noise.sqrt().max(least_noise),
            limit,
            freedom,
        })
    }

    /// The one that is least off.
    pub(crate) fn smallest(found: impl IntoIterator<Item = Option<Self>>) -> Option<Self> {
        let found = found.into_iter().flatten();
        found.min_by(|one, other| one.squares.total_cmp(&other.squares))
    }

    /// Standard error of a function of the parameters, given its derivatives.
    pub(crate) fn se(&self, slopes: SVector<f64, N>) -> f64 {
        slopes.dot(&(self.covariance * slopes)).max(0.0).sqrt()
    }

    /// Whether the law holds, by its name and how far the recording is off it.
    pub(crate) fn check(&self, law: &str, off: &str) -> Finding {
        let (found, needed) = (self.times_noise, self.limit);
        let message = match found <= needed {
            true => format!("the recording is {off} (RMS) off {law}"),
            false => format!(
                "the recording does not follow {law}: it is {off} (RMS) off, and what is slow in \
                 that is {found:.1} times the noise, needed at most {needed:.1}"
            ),
        };
        Finding::new(Check::Decay, found <= needed, found, needed, message)
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
        let law = Law { value: model, batch_s: |_: &_| 0.2, least_noise: 0.0 };
        let fit = |samples| Curve::fit(samples, SVector::from([1.0, 1.0]), [0, 1], law);
        let curve = fit(&samples).unwrap();
        let se = curve.se(SVector::from([0.0, 1.0]));
        assert!((curve.parameters[1] - 0.5).abs() < 3.0 * se, "{}", curve.parameters);
        assert!(se < 1e-3 && curve.misfit < 0.008);
        assert!(curve.check("a law", "0.007").holds(), "{}", curve.times_noise);
        assert!(fit(&samples[..2]).is_none());
    }
}
