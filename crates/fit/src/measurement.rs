//! What one trial measured.

use std::cmp::Ordering;
use std::ops::RangeInclusive;

use trilink_robot::JointCommand;
use trilink_robot::metrics::{ByMetric, GaitMetrics};
use trilink_statistics::{mean_deviation, student};
use trilink_tables::config::SigmaKind;
use trilink_tables::{TrialRow, TrialStatus};

/// What one trial measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurement {
    pub trial: String,
    /// Which one of the campaigns that are fitted together; 0 of one that is fitted by itself.
    pub campaign: usize,
    /// Commanded if that is known: repeats of a frequency have it in common.
    pub frequency_rad_s: f64,
    pub omega_rad_s: f64,
    /// What is missing has no term in the objective.
    pub metrics: GaitMetrics,
    /// Standard errors of the metrics.
    pub errors: GaitMetrics,
    /// Cycles that the metrics are means of.
    pub cycles: usize,
    /// Mean and first harmonic of the measured joint angles, and the standard errors of offset,
    /// amplitude and phase.
    pub gait: [JointCommand; 2],
    pub gait_errors_rad: [[f64; 3]; 2],
    /// Whether raw skid ratios stand for debiased ones that are not known.
    pub lacks_debiased: bool,
    /// Whether a filter before the export has left its errors untold.
    pub is_filtered: bool,
}

/// Frequencies that differ by less than this part are the same.
pub(super) const SAME_FREQUENCY: f64 = 0.005;
/// What a metric of a trial can be, in its unit; any other is missing.
const MEASURABLE: RangeInclusive<f64> = 1e-9..=1e9;

impl Measurement {
    /// The measurement of a trial; `None` if the trial has failed or has no metrics. A single
    /// metric is missing where it is not above zero (1e-9), as a skid ratio of which nothing is
    /// left above the noise: eq. 21 divides by it.
    pub fn new(trial: &TrialRow, kind: SigmaKind) -> Option<Self> {
        let sigma = trial.sigma(kind);
        let raw = GaitMetrics { sigma: sigma.map(|sigma| sigma.value), ..trial.metrics };
        let known = |value: f64| if MEASURABLE.contains(&value) { value } else { f64::NAN };
        let metrics = GaitMetrics::from(ByMetric::<f64>::from_fn(|metric| {
            let is_size = metric.definition().is_size;
            if is_size { known(raw[metric]) } else { raw[metric] }
        }));
        let usable = trial.status != TrialStatus::Failed
            && trial.omega_rad_s > 0.0
            && trial.omega_rad_s.is_finite()
            && (metrics.d_m.is_finite() || metrics.v_m_s.is_finite());
        let commanded = trial.omega_commanded_rad_s;
        usable.then(|| Self {
            trial: trial.trial.clone(),
            campaign: 0,
            frequency_rad_s: if commanded > 0.0 { commanded } else { trial.omega_rad_s },
            omega_rad_s: trial.omega_rad_s,
            metrics,
            errors: GaitMetrics { sigma: sigma.map(|sigma| sigma.se), ..trial.metrics_se },
            cycles: usize::try_from(trial.cycles).unwrap_or(0),
            gait: trial.gait.map(|joint| joint.command()),
            gait_errors_rad: trial.gait.map(|joint| joint.errors_rad()),
            lacks_debiased: kind == SigmaKind::Debiased && trial.lacks_debiased(),
            is_filtered: trial.noise_white == Some(false),
        })
    }

    /// Degrees of freedom of the errors; none where nothing tells how many cycles they are of.
    pub(super) fn freedom(&self) -> f64 {
        self.cycles.saturating_sub(1) as f64
    }

    /// What the errors are to be multiplied with to be standard deviations without bias. An error of a few
    /// cycles is as wide as Student's distribution, so that one trial is within 1.96 of them; of what many
    /// trials have in common it says too much.
    pub(super) fn unbiased(&self) -> f64 {
        let freedom = self.freedom();
        if freedom > 0.0 { 1.0 / (student(freedom) * mean_deviation(freedom)) } else { 1.0 }
    }

    /// Standard deviations of the gait's numbers, without bias.
    pub(super) fn gait_deviations_rad(&self) -> [[f64; 3]; 2] {
        self.gait_errors_rad.map(|of_joint| of_joint.map(|error| self.unbiased() * error))
    }

    /// By campaign, then by frequency, then by name, then by what was measured: an order that does not depend on
    /// that of the trials.
    pub fn order(&self, other: &Self) -> Ordering {
        let numbers = |of: &Self| {
            let all = of.metrics.to_array().into_iter().chain(of.errors.to_array());
            [of.omega_rad_s].into_iter().chain(all).map(f64::to_bits)
        };
        self.campaign
            .cmp(&other.campaign)
            .then_with(|| self.frequency_rad_s.total_cmp(&other.frequency_rad_s))
            .then_with(|| self.trial.cmp(&other.trial))
            .then_with(|| numbers(self).cmp(numbers(other)))
    }

    /// Indices of the measurements of each frequency of each campaign; the measurements are in their
    /// order.
    pub(super) fn frequencies(sorted: &[Self]) -> Vec<Vec<usize>> {
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for (i, measurement) in sorted.iter().enumerate() {
            let is_same = |other: &Self| {
                measurement.campaign == other.campaign
                    && measurement.frequency_rad_s <= other.frequency_rad_s * (1.0 + SAME_FREQUENCY)
            };
            match groups.last_mut() {
                Some(group) if is_same(&sorted[group[0]]) => group.push(i),
                _ => groups.push(vec![i]),
            }
        }
        groups
    }
}

#[cfg(test)]
mod tests {
    use trilink_tables::Columns as _;

    use super::*;

    #[test]
    fn a_metric_that_no_trial_can_have_is_missing() {
        let mut row = TrialRow { omega_rad_s: 2.0, ..TrialRow::blank() };
        for absurd in [0.0, -0.4, 5e-324, 1e308, f64::INFINITY] {
            row.metrics = GaitMetrics { d_m: absurd, v_m_s: 0.1, ..GaitMetrics::MISSING };
            let measurement = Measurement::new(&row, SigmaKind::Raw).expect("a speed");
            assert!(measurement.metrics.d_m.is_nan() && measurement.metrics.v_m_s == 0.1);
            row.metrics.v_m_s = absurd;
            assert_eq!(Measurement::new(&row, SigmaKind::Raw), None, "{absurd}");
        }
    }
}
