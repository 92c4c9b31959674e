//! Repeatability and reproducibility of the metrics of a campaign, as in ISO 5725-2.

use std::collections::{BTreeMap, BTreeSet};

use trilink_robot::AnyGait;
use trilink_robot::metrics::Metric;
use trilink_statistics::precision::{Precision, RelativeDeviation};
use trilink_tables::{NoPrecisionReason, PrecisionRow};

use super::measurement::Measurement;

/// Returns the precision of each metric that a fit can use; that of the amplitude of a joint only if the `gait` does not
/// command its angle.
/// `measurements` are those of the campaign, sorted by [`Measurement::order`].
pub(super) fn rows(
    campaign: &str,
    gait: &AnyGait,
    measurements: &[Measurement],
) -> Vec<PrecisionRow> {
    let is_driven = |metric| {
        let joint = Metric::ALPHA.iter().position(|alpha| *alpha == metric);
        joint.is_some_and(|joint| gait.joints[joint].is_some())
    };
    let is_measured = |metric| measurements.iter().any(|of| of.metrics[metric].is_finite());
    let metrics = Metric::FITTED.into_iter().filter(|metric| {
        !is_driven(*metric) && (metric.is_of_three_links() || is_measured(*metric))
    });
    metrics.map(|metric| row(campaign, measurements, metric)).collect()
}

fn row(campaign: &str, measurements: &[Measurement], metric: Metric) -> PrecisionRow {
    let measured = |of: &&Measurement| of.metrics[metric].is_finite();
    let names: BTreeSet<&str> =
        measurements.iter().filter(measured).map(|of| of.day.as_str()).collect();
    let days: BTreeMap<&str, usize> = names.iter().copied().zip(0..).collect();
    let frequencies = Measurement::frequencies(measurements).into_iter();
    let levels = frequencies.map(|trials| {
        let trials = trials.into_iter().map(|index| &measurements[index]).filter(measured);
        trials.map(|of| (days[of.day.as_str()], of.metrics[metric])).collect::<Vec<_>>()
    });
    let levels: Vec<Vec<(usize, f64)>> = levels.collect();
    let Precision { mut repeatability, mut reproducibility } = Precision::new(&levels);
    let [no_repeatability, no_reproducibility] = if names.is_empty() {
        [Some(NoPrecisionReason::NotMeasured); 2]
    } else if names.contains("") {
        // Repeats of the same day cannot be told from those of different days.
        (repeatability, reproducibility) = (None, None);
        [Some(NoPrecisionReason::UnknownDay); 2]
    } else {
        let no_days = if names.len() == 1 {
            NoPrecisionReason::OneDay
        } else {
            NoPrecisionReason::NoCommonFrequency
        };
        [
            repeatability.is_none().then_some(NoPrecisionReason::NoRepeats),
            reproducibility.is_none().then_some(no_days),
        ]
    };
    let number = |of: Option<RelativeDeviation>, part: fn(RelativeDeviation) -> f64| {
        of.map_or(f64::NAN, part)
    };
    PrecisionRow {
        campaign: campaign.to_owned(),
        metric: metric.column().to_owned(),
        trials: levels.iter().map(Vec::len).sum::<usize>() as i64,
        days: names.len() as i64,
        repeatability: number(repeatability, |of| of.deviation),
        repeatability_dof: number(repeatability, |of| of.degrees_of_freedom),
        reproducibility: number(reproducibility, |of| of.deviation),
        reproducibility_dof: number(reproducibility, |of| of.degrees_of_freedom),
        no_repeatability,
        no_reproducibility,
    }
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::GaitMetrics;
    use trilink_tables::config::{Config, SigmaKind};
    use trilink_tables::{Columns as _, TrialRow};

    use super::*;

    /// Returns the row of the displacement for trials with a day, a frequency and a displacement (m).
    fn of_d(trials: &[(&str, f64, f64)]) -> PrecisionRow {
        let measurement = |(nth, &(day, omega_rad_s, d_m)): (usize, &(&str, f64, f64))| {
            let metrics = GaitMetrics { d_m, ..GaitMetrics::MISSING };
            let (trial, day) = (nth.to_string(), day.to_owned());
            let omega_commanded_rad_s = omega_rad_s;
            let row = TrialRow {
                trial,
                day,
                // The measured frequency differs from trial to trial.
                omega_rad_s: omega_rad_s * (1.0 + 1e-5 * nth as f64),
                omega_commanded_rad_s,
                metrics,
                ..TrialRow::blank()
            };
            Measurement::new(&row, SigmaKind::Raw).expect("usable")
        };
        let mut measurements: Vec<Measurement> =
            trials.iter().enumerate().map(measurement).collect();
        measurements.sort_by(Measurement::order);
        let gait = Config::default().gait["symmetric"].to_gait().into();
        let rows = rows("c", &gait, &measurements);
        assert_eq!(rows.len(), 5, "the joints are commanded");
        assert_eq!(rows[1].metric, "v_m_s");
        assert_eq!(rows[1].no_repeatability, Some(NoPrecisionReason::NotMeasured));
        rows.into_iter().next().expect("a row")
    }

    #[test]
    fn repeats_and_days_give_the_precision_and_their_absence_gives_the_reason() {
        use NoPrecisionReason::{NoCommonFrequency, NoRepeats, OneDay, UnknownDay};
        let repeats = [("mon", 2.0, 0.102), ("mon", 2.0, 0.098), ("mon", 4.0, 0.3)];
        let found = of_d(&repeats);
        assert_eq!((found.metric.as_str(), found.trials, found.days), ("d_m", 3, 1));
        assert!((found.repeatability - 8e-4_f64.sqrt()).abs() < 1e-9, "{found:?}");
        assert_eq!((found.repeatability_dof, found.no_repeatability), (1.0, None));
        assert!(found.reproducibility.is_nan());
        assert_eq!(found.no_reproducibility, Some(OneDay));

        let found = of_d(&[("mon", 2.0, 0.102), ("tue", 2.0, 0.098), ("tue", 4.0, 0.3)]);
        assert!((found.reproducibility - 8e-4_f64.sqrt()).abs() < 1e-9, "{found:?}");
        assert!(found.repeatability.is_nan() && found.repeatability_dof.is_nan());
        assert_eq!((found.no_repeatability, found.no_reproducibility), (Some(NoRepeats), None));

        let found = of_d(&[("mon", 2.0, 0.102), ("tue", 4.0, 0.3), ("tue", 4.0, 0.3)]);
        assert_eq!((found.repeatability, found.no_reproducibility), (0.0, Some(NoCommonFrequency)));
        let found = of_d(&[("", 2.0, 0.102), ("", 2.0, 0.098), ("tue", 2.0, 0.3)]);
        assert!(found.repeatability.is_nan() && found.reproducibility.is_nan());
        assert_eq!([found.no_repeatability, found.no_reproducibility], [Some(UnknownDay); 2]);
    }
}
