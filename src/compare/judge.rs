//! Whether a difference is more than noise.

use trilink_statistics::HALF_WIDTH_95;
use trilink_tables::config::Tolerance;

use super::snapshot::{Record, number};

/// The outcome of a comparison of two values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    Same,
    Within,
    /// Different, without a tolerance or a standard error to judge it by, or of a model that fits
    /// in neither run.
    NotJudged,
    Out,
}

/// A judged difference of two values.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Judged {
    pub verdict: Verdict,
    /// Largest difference that is within; `None` where there is none.
    pub limit: Option<f64>,
    /// The difference in standard errors of both runs, of as many cycles as it would take.
    #[serde(rename = "standard_errors")]
    pub errors: Option<f64>,
}

/// Judges a number that differs.
pub(super) fn judge(
    tolerance: Tolerance,
    [baseline, candidate]: [f64; 2],
    error: Option<StandardError>,
) -> Judged {
    let difference = tolerance.distance([baseline, candidate]);
    let errors = error.and_then(|error| error.normal(difference));
    let fixed = [tolerance.absolute, tolerance.relative.map(|part| part * baseline.abs())];
    let fixed = fixed.into_iter().flatten().fold(f64::NAN, f64::max);
    let by_errors = tolerance.standard_errors.zip(errors);
    let limit = [Some(fixed), by_errors.map(|(most, errors)| most * difference / errors)];
    let limit = limit.into_iter().flatten().fold(f64::NAN, f64::max);
    let is_within = difference <= fixed || by_errors.is_some_and(|(most, errors)| errors <= most);
    let is_judged = tolerance.judges() && (tolerance.standard_errors.is_none() || errors.is_some());
    let verdict = match (baseline == candidate, is_within, is_judged) {
        (true, _, _) => Verdict::Same,
        (_, true, _) => Verdict::Within,
        (_, _, true) => Verdict::Out,
        (_, _, false) => Verdict::NotJudged,
    };
    Judged { verdict, limit: Some(limit).filter(|limit| limit.is_finite()), errors }
}

/// The largest difference from a baseline that is within a tolerance, where the difference has this
/// standard error; `None` if it takes an error that is not known.
pub(super) fn limit(tolerance: Tolerance, baseline: f64, error: f64) -> Option<f64> {
    let by_errors = tolerance.standard_errors.map(|most| most * error);
    if by_errors.is_some_and(f64::is_nan) {
        return None;
    }
    let relative = tolerance.relative.map(|part| part * baseline.abs());
    [tolerance.absolute, relative, by_errors].into_iter().flatten().reduce(f64::max)
}

/// The standard error of a difference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StandardError {
    pub error: f64,
    /// Degrees of freedom; infinite where the error is known well.
    pub freedom: f64,
}

impl StandardError {
    /// Of the difference of two runs' values of a column, by their `*_se`, the scatter's part of
    /// their 95 % intervals or the limits of these. `None` if one of them has none.
    pub(super) fn of_difference(column: &str, [one, other]: [&Record; 2]) -> Option<Self> {
        Some(Self::of(column, one)?.with(Self::of(column, other)?))
    }

    /// Of a record's value.
    pub(super) fn of(column: &str, record: &Record) -> Option<Self> {
        let of = |end: &str| number(record, &format!("{column}_{end}"));
        if let Some(error) = of("se") {
            let cycles = number(record, "cycles").unwrap_or(f64::INFINITY);
            return Some(Self { error, freedom: (cycles - 1.0).max(1.0) });
        }
        let half_width = match of("scatter") {
            Some(half_width) => half_width,
            None => (of("hi")? - of("lo")?) / 2.0,
        };
        let error = half_width / HALF_WIDTH_95;
        Some(Self { error, freedom: f64::INFINITY })
    }

    /// Of a sum or difference of independent values (Welch 1947 and Satterthwaite 1946 for the
    /// degrees of freedom).
    pub(super) fn with(self, other: Self) -> Self {
        let squares = [self, other].map(|of| of.error * of.error);
        let spread = squares[0].powi(2) / self.freedom + squares[1].powi(2) / other.freedom;
        let sum = squares[0] + squares[1];
        let freedom = if spread > 0.0 { sum * sum / spread } else { f64::INFINITY };
        Self { error: sum.sqrt(), freedom }
    }

    /// A difference in standard errors, as far out as it would be if the error were known: few
    /// cycles give large multiples by chance (Wallace, Annals of Mathematical Statistics 30,
    /// 1959).
    pub(super) fn normal(self, difference: f64) -> Option<f64> {
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
    fn multiples_of_an_error_from_few_cycles_count_less() {
        let error = |freedom| StandardError { error: 0.5, freedom };
        // Two-sided probabilities of Student's t: 2.776 of 4 and 2.228 of 10 degrees of freedom
        // have the 5 % that 1.96 has.
        for (freedom, multiple, expected) in
            [(4.0, 2.776, 1.96), (10.0, 2.228, 1.96), (4.0, 8.61, 3.29), (f64::INFINITY, 3.0, 3.0)]
        {
            let found = error(freedom).normal(multiple * 0.5).unwrap();
            assert!((found - expected).abs() < 0.05, "{found} {expected}");
        }
        assert_eq!(StandardError { error: 0.0, freedom: 3.0 }.normal(1.0), None);
    }

    #[test]
    fn a_difference_is_within_if_one_of_the_limits_says_so() {
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
