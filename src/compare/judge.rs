//! Judgement of whether a difference exceeds noise.

use trilink_statistics::HALF_WIDTH_95;
use trilink_tables::config::Tolerance;

use super::noise::{BETWEEN, BETWEEN_DOF};
use super::snapshot::{INTERVAL, Record, number};

/// Verdict on the difference between two values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    Same,
    Within,
    /// Different, but not judged, because there is no tolerance or standard error, because the model is inadequate, or
    /// because the baseline has no value.
    NotJudged,
    Out,
}

/// Judgement of the difference between two values.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Judgement {
    pub verdict: Verdict,
    /// Largest difference within tolerance; `None` if the tolerance depends on an unknown standard error.
    pub limit: Option<f64>,
    /// Difference expressed as an equivalent normal deviate: in combined standard errors of both runs, corrected for
    /// the few degrees of freedom of these standard errors. `None` if the standard error is unknown or zero.
    #[serde(rename = "standard_errors")]
    pub errors: Option<f64>,
}

impl From<Verdict> for Judgement {
    fn from(verdict: Verdict) -> Self {
        Self { verdict, limit: None, errors: None }
    }
}

/// Judges the difference between two numbers; `error` is the standard error of the difference, if known.
pub(super) fn judge(
    tolerance: Tolerance,
    [baseline, candidate]: [f64; 2],
    error: Option<StandardError>,
) -> Judgement {
    let difference = tolerance.distance([baseline, candidate]);
    let errors = error.and_then(|error| error.equivalent_normal(difference));
    let fixed = [tolerance.absolute, tolerance.relative.map(|ratio| ratio * baseline.abs())];
    let fixed = fixed.into_iter().flatten().fold(f64::NAN, f64::max);
    let by_errors = tolerance.standard_errors.zip(errors);
    let limit = [Some(fixed), by_errors.map(|(most, errors)| most * difference / errors)];
    let limit = limit.into_iter().flatten().fold(f64::NAN, f64::max);
    let is_within = difference <= fixed || by_errors.is_some_and(|(most, errors)| errors <= most);
    let is_judged = tolerance.judges() && (tolerance.standard_errors.is_none() || errors.is_some());
    let verdict = if baseline == candidate {
        Verdict::Same
    } else if is_within {
        Verdict::Within
    } else if is_judged {
        Verdict::Out
    } else {
        Verdict::NotJudged
    };
    Judgement { verdict, limit: Some(limit).filter(|limit| limit.is_finite()), errors }
}

/// Returns the largest difference from a baseline value that is within tolerance, given the standard error of the
/// difference; `None` if the tolerance depends on a standard error that is unknown (NaN).
pub(super) fn limit(tolerance: Tolerance, baseline: f64, error: f64) -> Option<f64> {
    let by_errors = tolerance.standard_errors.map(|most| most * error);
    if by_errors.is_some_and(f64::is_nan) {
        return None;
    }
    let relative = tolerance.relative.map(|ratio| ratio * baseline.abs());
    [tolerance.absolute, relative, by_errors].into_iter().flatten().reduce(f64::max)
}

/// Standard error with its degrees of freedom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StandardError {
    pub error: f64,
    /// Degrees of freedom; infinite if the standard error is known exactly.
    pub freedom: f64,
}

impl StandardError {
    /// Returns the standard error of the difference in a column between two runs; `None` if it is unknown in either
    /// run.
    pub(super) fn of_difference(column: &str, [one, other]: [&Record; 2]) -> Option<Self> {
        Some(Self::from_record(column, one)?.combine(Self::from_record(column, other)?))
    }

    /// Returns the standard error of a record's value; `None` if it is unknown.
    pub(super) fn from_record(column: &str, record: &Record) -> Option<Self> {
        if column == "j" {
            return Self::of_objective(record);
        }
        if let Some(cycles) = Self::of_cycles(column, record) {
            let between = Self::between(column, record);
            return Some(between.map_or(cycles, |between| cycles.combine(between)));
        }
        let value = |suffix: &str| number(record, &format!("{column}{suffix}"));
        if let Some(error) = value("_u_a") {
            // The effective degrees of freedom of u_c are those of u_A times (u_c / u_A)^4.
            let ratio = error.powi(2) / (error.powi(2) + value("_u_b").unwrap_or(0.0).powi(2));
            let freedom = value("_dof").map_or(f64::INFINITY, |freedom| freedom * ratio.powi(2));
            return Some(Self { error, freedom });
        }
        let half_width = match value("_scatter") {
            Some(half_width) => half_width,
            None => match number(record, &format!("{INTERVAL}{column}")) {
                Some(width) => width / 2.0,
                None => (value("_hi")? - value("_lo")?) / 2.0,
            },
        };
        Some(Self { error: half_width / HALF_WIDTH_95, freedom: f64::INFINITY })
    }

    /// Returns the standard error of a trial mean that the scatter of the cycles causes; `None` if it is unknown.
    pub(super) fn of_cycles(column: &str, record: &Record) -> Option<Self> {
        let error = number(record, &format!("{column}_se"))?;
        let cycles = number(record, "cycles").unwrap_or(f64::INFINITY);
        Some(Self { error, freedom: (cycles - 1.0).max(1.0) })
    }

    /// Returns the standard deviation of a trial mean between trials and days; `None` if it is unknown.
    pub(super) fn between(column: &str, record: &Record) -> Option<Self> {
        let metric = column.trim_end_matches("_debiased");
        let error = number(record, &format!("{metric}{BETWEEN}"))?;
        let freedom = number(record, &format!("{metric}{BETWEEN_DOF}")).unwrap_or(f64::INFINITY);
        Some(Self { error, freedom })
    }

    /// Returns the standard deviation of the objective of a fit if noise alone causes the misfit; `None` if the noise
    /// is unknown. The limit of the misfit ratio is about two standard deviations above its expectation of 1.
    fn of_objective(fit: &Record) -> Option<Self> {
        let value = |column: &str| number(fit, column);
        let expected = value("j")? / value("lack_of_fit")?;
        let deviation = (value("lack_of_fit_limit")? - 1.0) / HALF_WIDTH_95;
        Some(Self { error: expected * deviation, freedom: f64::INFINITY })
    }

    /// Returns the standard error of the sum or difference of two independent values, with degrees of freedom by the
    /// Welch-Satterthwaite equation (Satterthwaite 1946, Welch 1947).
    pub(super) fn combine(self, other: Self) -> Self {
        let squares = [self, other].map(|of| of.error * of.error);
        let spread = squares[0].powi(2) / self.freedom + squares[1].powi(2) / other.freedom;
        let sum = squares[0] + squares[1];
        let freedom = if spread > 0.0 { sum * sum / spread } else { f64::INFINITY };
        Self { error: sum.sqrt(), freedom }
    }

    /// Returns the normal deviate that is as improbable as the difference is under Student's t distribution, because
    /// with few degrees of freedom large multiples of the standard error occur by chance (Wallace, Annals of
    /// Mathematical Statistics 30, 1959); `None` if the standard error is unknown or zero.
    pub(super) fn equivalent_normal(self, difference: f64) -> Option<f64> {
        let multiple = difference / self.error;
        if !(self.error > 0.0 && multiple.is_finite()) {
            return None;
        }
        let nu = self.freedom;
        if nu > 1e6 {
            return Some(multiple);
        }
        Some((nu * (multiple * multiple / nu).ln_1p()).sqrt() * (8.0 * nu + 1.0) / (8.0 * nu + 3.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_degrees_of_freedom_reduce_the_equivalent_normal_deviate() {
        let error = |freedom| StandardError { error: 0.5, freedom };
        // Two-sided 5 % points of Student's t: 2.776 for 4 and 2.228 for 10 degrees of freedom, 1.96 for infinitely
        // many.
        for (freedom, multiple, expected) in
            [(4.0, 2.776, 1.96), (10.0, 2.228, 1.96), (4.0, 8.61, 3.29), (f64::INFINITY, 3.0, 3.0)]
        {
            let found = error(freedom).equivalent_normal(multiple * 0.5).unwrap();
            assert!((found - expected).abs() < 0.05, "{found} {expected}");
        }
        assert_eq!(StandardError { error: 0.0, freedom: 3.0 }.equivalent_normal(1.0), None);
    }

    #[test]
    fn a_difference_is_within_tolerance_if_it_is_within_one_of_the_limits() {
        let error = Some(StandardError { error: 0.1, freedom: f64::INFINITY });
        let none = Tolerance::default();
        let absolute = Tolerance { absolute: Some(0.5), ..none };
        let relative = Tolerance { relative: Some(0.1), ..none };
        let errors = Tolerance { standard_errors: Some(3.0), ..none };
        let both = Tolerance { relative: Some(0.1), standard_errors: Some(3.0), ..none };
        use Verdict::{NotJudged, Out, Same, Within};
        for (tolerance, values, error, verdict) in [
            (absolute, [1.0, 1.4], None, Within),
            (absolute, [1.0, 1.6], None, Out),
            (absolute, [1.0, 1.0], None, Same),
            (relative, [-4.0, -4.3], None, Within),
            (relative, [-4.0, -4.5], None, Out),
            (errors, [1.0, 1.25], error, Within),
            (errors, [1.0, 1.35], error, Out),
            (errors, [1.0, 1.25], None, NotJudged),
            (both, [9.0, 9.8], error, Within),
            (both, [1.0, 1.25], error, Within),
            (both, [1.0, 1.35], error, Out),
            (both, [1.0, 1.05], None, Within),
            (none, [1.0, 2.0], error, NotJudged),
        ] {
            assert_eq!(
                judge(tolerance, values, error).verdict,
                verdict,
                "{tolerance:?} {values:?}"
            );
        }
        assert_eq!(judge(absolute, [1.0, 1.6], None).limit, Some(0.5));
        for (tolerance, error, expected) in [
            (absolute, f64::NAN, Some(0.5)),
            (relative, f64::NAN, Some(0.4)),
            (errors, 0.1, Some(0.3)),
            (errors, f64::NAN, None),
            (both, 0.1, Some(0.4)),
            (none, 0.1, None),
        ] {
            let found = limit(tolerance, -4.0, error);
            assert!(found == expected || (found.unwrap() - expected.unwrap()).abs() < 1e-12);
        }
    }
}
