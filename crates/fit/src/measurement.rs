//! Measured metrics and gait of one trial.

use std::cmp::Ordering;
use std::ops::RangeInclusive;

use trilink_robot::metrics::{ByMetric, GaitMetrics};
use trilink_robot::{JointCommand, MAX_JOINTS};
use trilink_statistics::{c4, student};
use trilink_tables::config::SigmaKind;
use trilink_tables::{SAME_FREQUENCY, TrialRow};

use super::gait_over_frequency::GaitErrors;

/// Measured metrics and gait of one trial.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurement {
    pub trial: String,
    /// Day of the recording.
    pub day: String,
    /// Index among the campaigns that are fitted together; 0 if there is only one campaign.
    pub campaign: usize,
    /// Commanded frequency, which is common to repeats; the measured one if no command is known.
    pub frequency_rad_s: f64,
    /// Measured frequency.
    pub omega_rad_s: f64,
    /// Trial means of the metrics; a missing metric has no term in the objective.
    pub metrics: GaitMetrics,
    /// Standard errors of the trial means.
    pub errors: GaitMetrics,
    /// Number of cycles averaged in the trial means.
    pub cycles: usize,
    /// Mean and first harmonic of the measured joint angles, from front to rear; NaN for a joint that the robot lacks.
    pub gait: [JointCommand; MAX_JOINTS],
    /// Standard errors of offset, amplitude and phase of each joint.
    pub gait_errors_rad: GaitErrors,
    /// Whether raw skid ratios are used because the debiased ones are missing.
    pub lacks_debiased: bool,
    /// Whether coordinates were filtered before the export, so that the standard errors are not valid.
    pub is_filtered: bool,
}

/// Plausible range of a metric, in the metric's unit; values outside are treated as missing.
const PLAUSIBLE: RangeInclusive<f64> = 1e-9..=1e9;

impl Measurement {
    /// Creates the measurement for a trial; `None` if the trial has failed, has no frequency, or has neither d nor v. A
    /// metric that is not above zero (1e-9), such as a debiased skid ratio that does not exceed the noise, is treated
    /// as missing, since relative deviations (eq. 21 of the paper) are divided by it.
    pub fn new(trial: &TrialRow, kind: SigmaKind) -> Option<Self> {
        let sigma = trial.sigma(kind);
        let raw = GaitMetrics { sigma: sigma.map(|sigma| sigma.value), ..trial.metrics };
        let metrics = GaitMetrics::from(ByMetric::<f64>::from_fn(|metric| {
            let value = raw[metric];
            let is_missing = metric.definition().is_size && !PLAUSIBLE.contains(&value);
            if is_missing { f64::NAN } else { value }
        }));
        let joints = trial.joints();
        let usable = trial.status.has_metrics()
            && trial.omega_rad_s > 0.0
            && trial.omega_rad_s.is_finite()
            && (metrics.d_m.is_finite() || metrics.v_m_s.is_finite());
        usable.then(|| Self {
            trial: trial.trial.clone(),
            day: trial.day.clone(),
            campaign: 0,
            frequency_rad_s: trial.frequency_rad_s(),
            omega_rad_s: trial.omega_rad_s,
            metrics,
            errors: GaitMetrics { sigma: sigma.map(|sigma| sigma.se), ..trial.metrics_se },
            cycles: usize::try_from(trial.cycles).unwrap_or(0),
            gait: joints.map(|joint| joint.command()),
            gait_errors_rad: joints.map(|joint| joint.errors_rad()),
            lacks_debiased: kind == SigmaKind::Debiased && trial.lacks_debiased(),
            is_filtered: trial.noise_white == Some(false),
        })
    }

    /// Returns the degrees of freedom of the standard errors; 0 if the number of cycles is unknown.
    pub(super) fn degrees_of_freedom(&self) -> f64 {
        self.cycles.saturating_sub(1) as f64
    }

    /// Returns the factor that turns standard errors into unbiased standard deviations. Standard errors from a small
    /// number of cycles are widened as by Student's t distribution, so that 1.96 of them contain one trial's error;
    /// that would be too wide for a quantity estimated from many trials together.
    pub(super) fn bias_correction(&self) -> f64 {
        let freedom = self.degrees_of_freedom();
        if freedom > 0.0 { 1.0 / (student(freedom) * c4(freedom)) } else { 1.0 }
    }

    /// Returns the unbiased standard deviations of offset, amplitude and phase for each joint.
    pub(super) fn gait_deviations_rad(&self) -> GaitErrors {
        self.gait_errors_rad.map(|of_joint| of_joint.map(|error| self.bias_correction() * error))
    }

    /// Compares by campaign, frequency, name and measured values, so that sorting does not depend on the initial order.
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

    /// Returns the indices of the measurements at each frequency of each campaign. The measurements must be sorted by
    /// [`Self::order`].
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
    fn a_metric_outside_its_plausible_range_is_missing() {
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
