//! Where and by how much a model is off the measurements.

use std::fmt::{self, Display, Formatter};

use trilink_base::named;
use trilink_base::text::known;
use trilink_robot::metrics::Metric;

use super::{serialize_as_sentence, verdict};
use crate::{Column, Columns, StoreError, Table, fill, rows};

named! {
    /// On which side of the model the measurements are.
    pub enum Side {
        Above = "above",
        Below = "below",
        /// The model has no such metric.
        Absent = "absent",
    }
}

verdict! {
    /// Residuals of a metric of one sign at neighbouring frequencies.
    pub struct MisfitRun {
        pub side: Side as "_side",
        pub metric: Metric as "_metric",
        /// Where several campaigns are fitted together.
        pub campaign: String as "_campaign",
        /// Least and largest size of measured / predicted - 1; missing if the model has none.
        pub least: f64 as "_least",
        pub most: f64 as "_most",
        pub from_rad_s: f64 as "_from_rad_s",
        pub to_rad_s: f64 as "_to_rad_s",
    }
}

rows! {
    /// RMS of predicted / measured - 1, by metric; missing of a metric without measurements.
    pub struct MisfitRms {
        pub d: f64,
        pub v: f64,
        pub sigma: [f64; 3] as "sigma{}",
        pub alpha1: f64,
    }
}

impl MisfitRms {
    fn named(&self) -> impl Iterator<Item = (Metric, f64)> {
        let Self { d, v, sigma: [sigma0, sigma1, sigma2], alpha1 } = *self;
        let values = Metric::FITTED.into_iter().zip([d, v, sigma0, sigma1, sigma2, alpha1]);
        values.filter(|(_, value)| value.is_finite())
    }
}

/// Where a model is off the measurements.
#[derive(Debug, Clone, PartialEq)]
pub enum Misfit {
    /// Beyond the noise: the metrics that are furthest off, [`Misfit::MOST`] at most.
    Off(Vec<MisfitRun>),
    /// By so much, where nothing tells the noise.
    Rms(MisfitRms),
}

impl Misfit {
    /// Metrics that are named at most.
    pub const MOST: usize = 3;

    /// `None` if no metric is off.
    pub fn off(runs: Vec<MisfitRun>) -> Option<Self> {
        (!runs.is_empty()).then_some(Self::Off(runs))
    }

    /// `None` without any number.
    pub fn rms(rms: MisfitRms) -> Option<Self> {
        let is_known = rms.named().next().is_some();
        is_known.then_some(Self::Rms(rms))
    }
}

impl Columns for Option<Misfit> {
    const PATTERN: &'static str = "{field}{}";

    fn blank() -> Self {
        None
    }

    fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>) {
        let runs = |value: &&Self| -> [Option<MisfitRun>; Misfit::MOST] {
            let Some(Misfit::Off(runs)) = value else { return Columns::blank() };
            std::array::from_fn(|nth| runs.get(nth).cloned())
        };
        let rms = |value: &&Self| match value {
            Some(Misfit::Rms(rms)) => rms.clone(),
            _ => MisfitRms::blank(),
        };
        let runs: Vec<_> = values.iter().map(runs).collect();
        Columns::write_all(runs, &fill(pattern, "{}{}"), columns);
        Columns::write_all(values.iter().map(rms).collect(), &fill(pattern, "_rms_{}"), columns);
    }

    fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError> {
        let runs = <[Option<MisfitRun>; Misfit::MOST]>::read(table, &fill(pattern, "{}{}"))?;
        let rms = MisfitRms::read(table, &fill(pattern, "_rms_{}"))?;
        let both = runs.into_iter().zip(rms);
        let misfit = |(runs, rms): ([Option<MisfitRun>; Misfit::MOST], MisfitRms)| {
            Misfit::off(runs.into_iter().flatten().collect()).or_else(|| Misfit::rms(rms))
        };
        Ok(both.map(misfit).collect())
    }
}

impl Display for MisfitRun {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let Self { side, metric, campaign, least, most, from_rad_s, to_rad_s } = self;
        if !campaign.is_empty() {
            write!(f, "{campaign}: ")?;
        }
        let by = known([*least, *most], |ends| {
            let [least, most] = ends.map(|part| two_digits(100.0 * part));
            if least == most { format!("{most} % ") } else { format!("{least} to {most} % ") }
        });
        let at = known([*from_rad_s, *to_rad_s], |[from, to]| match from == to {
            true => format!(" at {to} rad/s"),
            false => format!(" at {from} to {to} rad/s"),
        });
        match side {
            Side::Absent => write!(f, "the model has no {metric}{at}"),
            _ => write!(f, "{metric} is measured {by}{side} the model{at}"),
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
                let percent = |(name, part)| format!("{} % in {name}", two_digits(100.0 * part));
                let parts: Vec<String> = rms.named().map(percent).collect();
                write!(f, "the model is off by {} (RMS)", parts.join(", "))
            }
        }
    }
}

serialize_as_sentence!(Misfit);

/// A positive number with two digits, or all of those before the point.
fn two_digits(value: f64) -> String {
    let decimals = (1.0 - value.abs().max(1e-9).log10().floor()).max(0.0) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::super::tests::stored;
    use super::*;

    #[test]
    fn every_misfit_is_read_as_it_was_written_and_said_in_a_sentence() {
        let run = |side, metric, [least, most, from_rad_s, to_rad_s]: [f64; 4]| MisfitRun {
            side,
            metric,
            campaign: String::new(),
            least,
            most,
            from_rad_s,
            to_rad_s,
        };
        let above = run(Side::Above, Metric::D, [0.07, 1.19, 4.5, 6.0]);
        let below = run(Side::Below, Metric::Sigma0, [0.031, 0.031, 0.5, 0.5]);
        let none = run(Side::Absent, Metric::Alpha1, [0.5, 0.5, 1.0, 3.0]);
        let shared = MisfitRun { campaign: "ours".to_owned(), ..above.clone() };
        let sigma = [0.29, 0.5, 0.002];
        let rms = MisfitRms { d: 0.12, sigma, ..MisfitRms::blank() };
        let all = [
            None,
            Misfit::off(vec![above, below, none]),
            Misfit::off(vec![shared]),
            Misfit::rms(MisfitRms { v: 0.1, alpha1: 0.03, d: 2.0, sigma }),
        ];
        stored(&all);
        // A number that is missing is not equal to itself.
        let table = Option::<Misfit>::to_table(&[Misfit::rms(rms)]);
        let [with_gaps] = &Option::<Misfit>::from_table(&table).expect("columns")[..] else {
            panic!("one")
        };
        let said = |of: &Option<Misfit>| of.as_ref().map_or(String::new(), Misfit::to_string);
        assert_eq!(
            said(with_gaps),
            "the model is off by 12 % in d, 29 % in sigma0, 50 % in sigma1, 0.20 % in sigma2 (RMS)"
        );
        assert_eq!(
            said(&all[1]),
            "d is measured 7.0 to 119 % above the model at 4.5 to 6 rad/s; sigma0 is measured \
             3.1 % below the model at 0.5 rad/s; the model has no alpha1 at 1 to 3 rad/s"
        );
        assert!(said(&all[2]).starts_with("ours: d is measured"));
        assert_eq!(Misfit::off(Vec::new()), None);
        assert_eq!(Misfit::rms(MisfitRms::blank()), None);
    }
}
