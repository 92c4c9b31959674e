//! Misfit: where and by how much a model deviates from the measurements.

use std::fmt::{self, Display, Formatter};

use trilink_base::named;
use trilink_base::text::known;
use trilink_robot::metrics::{ByFitted, Metric};

use super::{serialize_as_sentence, verdict};
use crate::{Column, Columns, StoreError, Table, fill};

named! {
    /// Side of the model's predictions on which the measurements lie.
    pub enum Side {
        Above = "above",
        Below = "below",
        /// The model does not predict the metric.
        Absent = "absent",
    }
}

verdict! {
    /// Run of residuals with the same sign in one metric at neighbouring frequencies.
    pub struct MisfitRun {
        pub side: Side as "_side",
        pub metric: Metric as "_metric",
        /// Campaign to which the residuals belong, if several campaigns are fitted together; otherwise empty.
        pub campaign: String as "_campaign",
        /// Minimum of |measured / predicted - 1| in the run; missing if the model does not predict the
        /// metric.
        pub least: f64 as "_least",
        /// Maximum of |measured / predicted - 1| in the run; missing if the model does not predict the
        /// metric.
        pub most: f64 as "_most",
        /// Largest deviation predicted / measured - 1 of this metric at any frequency, in the run or not; missing if
        /// there is none.
        pub largest: f64 as "_largest",
        pub from_rad_s: f64 as "_from_rad_s",
        pub to_rad_s: f64 as "_to_rad_s",
    }
}

/// Deviation of a model from the measurements.
#[derive(Debug, Clone, PartialEq)]
pub enum Misfit {
    /// Deviations larger than noise explains: one run of residuals for each of the worst metrics, at most
    /// [`Misfit::MAX_RUNS`] runs.
    Off(Vec<MisfitRun>),
    /// RMS of predicted / measured - 1 over the trials for each metric, if the noise is unknown; missing for a metric
    /// without measurements.
    Rms(ByFitted<f64>),
}

impl Misfit {
    /// Maximum number of runs of residuals in [`Misfit::Off`].
    pub const MAX_RUNS: usize = 3;

    /// Formats the largest deviation in a few words, such as `misses d by up to 59 %`: that of the displacement d if it
    /// deviates, because all models predict it; otherwise that of the metric with the largest deviation.
    pub fn largest(&self) -> Option<String> {
        let deviations: Vec<(Metric, f64)> = match self {
            Self::Off(runs) => runs.iter().map(|run| (run.metric, run.largest.abs())).collect(),
            Self::Rms(rms) => rms.iter().map(|(metric, value)| (metric, *value)).collect(),
        };
        let known = deviations.into_iter().filter(|(_, value)| value.is_finite());
        let (metric, most) = known.max_by(|(a, x), (b, y)| {
            (*a == Metric::D).cmp(&(*b == Metric::D)).then(x.total_cmp(y))
        })?;
        let symbol = metric.definition().symbol;
        let percent = two_digits(100.0 * most);
        Some(match self {
            Self::Off(_) => format!("misses {symbol} by up to {percent} %"),
            Self::Rms(_) => format!("misses {symbol} by {percent} % (RMS)"),
        })
    }

    /// Creates a misfit from runs of residuals; `None` if there are none.
    pub fn off(runs: Vec<MisfitRun>) -> Option<Self> {
        (!runs.is_empty()).then_some(Self::Off(runs))
    }

    /// Creates a misfit from RMS deviations; `None` if all of them are missing.
    pub fn rms(rms: ByFitted<f64>) -> Option<Self> {
        let has_value = rms.values().iter().any(|value| value.is_finite());
        has_value.then_some(Self::Rms(rms))
    }
}

impl Columns for Option<Misfit> {
    const PATTERN: &'static str = "{field}{}";

    fn blank() -> Self {
        None
    }

    fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>) {
        let mut all_runs = Vec::new();
        let mut all_rms = Vec::new();
        for value in values {
            let runs = if let Some(Misfit::Off(runs)) = value { &runs[..] } else { &[] };
            all_runs
                .push(std::array::from_fn::<_, { Misfit::MAX_RUNS }, _>(|i| runs.get(i).cloned()));
            all_rms.push(match value {
                Some(Misfit::Rms(rms)) => *rms,
                _ => ByFitted::<f64>::blank(),
            });
        }
        Columns::write_all(all_runs, &fill(pattern, "{}{}"), columns);
        Columns::write_all(all_rms, &fill(pattern, "_rms_{}"), columns);
    }

    fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError> {
        let runs = <[Option<MisfitRun>; Misfit::MAX_RUNS]>::read(table, &fill(pattern, "{}{}"))?;
        let rms = ByFitted::<f64>::read(table, &fill(pattern, "_rms_{}"))?;
        let both = runs.into_iter().zip(rms);
        let misfits = both.map(|(runs, rms)| {
            Misfit::off(runs.into_iter().flatten().collect()).or_else(|| Misfit::rms(rms))
        });
        Ok(misfits.collect())
    }
}

impl Display for MisfitRun {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let Self { side, metric, campaign, least, most, largest: _, from_rad_s, to_rad_s } = self;
        if !campaign.is_empty() {
            write!(f, "{campaign}: ")?;
        }
        let by = known([*least, *most], |limits| {
            let [least, most] = limits.map(|fraction| two_digits(100.0 * fraction));
            if least == most { format!("{most} % ") } else { format!("{least} to {most} % ") }
        });
        let at = known([*from_rad_s, *to_rad_s], |[from, to]| {
            if from == to { format!(" at {to} rad/s") } else { format!(" at {from} to {to} rad/s") }
        });
        match side {
            Side::Absent => write!(f, "the model predicts no {metric}{at}"),
            _ => write!(f, "the measured {metric} is {by}{side} that of the model{at}"),
        }
    }
}

impl Display for Misfit {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        match self {
            Self::Off(runs) => {
                f.write_str(&runs.iter().map(MisfitRun::to_string).collect::<Vec<_>>().join("; "))
            }
            Self::Rms(rms) => {
                let errors = rms.iter().filter(|(_, error)| error.is_finite());
                let errors: Vec<String> = errors
                    .map(|(metric, error)| format!("{} % in {metric}", two_digits(100.0 * error)))
                    .collect();
                write!(f, "the RMS error of the model is {}", errors.join(", "))
            }
        }
    }
}

serialize_as_sentence!(Misfit);

/// Formats a positive number with two significant digits, or with all digits of its integer part if these are
/// more.
fn two_digits(value: f64) -> String {
    let decimals = (1.0 - value.abs().max(1e-9).log10().floor()).max(0.0) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::GaitMetrics;

    use super::super::tests::stored;
    use super::*;

    #[test]
    fn every_misfit_survives_a_round_trip_and_has_a_sentence() {
        let run = |side, metric, [least, most, from_rad_s, to_rad_s]: [f64; 4]| MisfitRun {
            side,
            metric,
            campaign: String::new(),
            least,
            most,
            largest: 1.0 / (1.0 + most) - 1.0,
            from_rad_s,
            to_rad_s,
        };
        let above = run(Side::Above, Metric::D, [0.07, 1.19, 4.5, 6.0]);
        let below = run(Side::Below, Metric::Sigma0, [0.031, 0.031, 0.5, 0.5]);
        let none = run(Side::Absent, Metric::Alpha1, [0.5, 0.5, 1.0, 3.0]);
        let shared = MisfitRun { campaign: "ours".to_owned(), ..above.clone() };
        let of = |[d, v, sigma0, sigma1, sigma2, alpha1]: [f64; 6]| {
            let values = [d, v, sigma0, sigma1, sigma2, alpha1, f64::NAN];
            ByFitted::from(GaitMetrics::from_array(values))
        };
        let rms = of([0.12, f64::NAN, 0.29, 0.5, 0.002, f64::NAN]);
        let all = [
            None,
            Misfit::off(vec![above, below, none]),
            Misfit::off(vec![shared]),
            Misfit::rms(ByFitted::from_fn(|metric| 0.01 + f64::from(metric as u8))),
        ];
        stored(&all);
        // A missing number (NaN) does not equal itself, so values with missing numbers are compared by their
        // sentences.
        let table = Option::<Misfit>::to_table(&[Misfit::rms(rms)]);
        let [with_gaps] = &Option::<Misfit>::from_table(&table).expect("columns")[..] else {
            panic!("one")
        };
        let sentence =
            |misfit: &Option<Misfit>| misfit.as_ref().map_or(String::new(), Misfit::to_string);
        assert_eq!(
            sentence(with_gaps),
            "the RMS error of the model is 12 % in d, 29 % in sigma0, 50 % in sigma1, 0.20 % in sigma2"
        );
        assert_eq!(
            sentence(&all[1]),
            "the measured d is 7.0 to 119 % above that of the model at 4.5 to 6 rad/s; the measured sigma0 is 3.1 % \
             below that of the model at 0.5 rad/s; the model predicts no alpha1 at 1 to 3 rad/s"
        );
        assert!(sentence(&all[2]).starts_with("ours: the measured d is"));
        assert_eq!(Misfit::off(Vec::new()), None);
        assert_eq!(Misfit::rms(ByFitted::<f64>::blank()), None);
    }
}
