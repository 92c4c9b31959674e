//! What one trial measured.

use std::cmp::Ordering;

use crate::config::SigmaKind;
use crate::metrics::GaitMetrics;
use crate::robot::JointCommand;
use crate::store::TrialRow;

/// What one trial measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurement {
    pub trial: String,
    /// Commanded if that is known: repeats of a frequency have it in common.
    pub frequency_rad_s: f64,
    pub omega_rad_s: f64,
    /// What is missing has no term in the objective.
    pub metrics: GaitMetrics,
    /// Standard errors of the metrics.
    pub errors: GaitMetrics,
    /// Cycles that the metrics are means of.
    pub cycles: usize,
    /// Mean and first harmonic of the measured joint angles.
    pub gait: [JointCommand; 2],
}

/// Frequencies that differ by less than this part are the same.
const SAME_FREQUENCY: f64 = 0.005;

impl Measurement {
    /// The measurement of a trial; `None` if the trial has failed or has no metrics. A single
    /// metric is missing where it is not above zero, as a skid ratio of which nothing is left
    /// above the noise: eq. 21 divides by it.
    pub fn new(trial: &TrialRow, sigma: SigmaKind) -> Option<Self> {
        let sigma = trial.sigma(sigma);
        let raw = GaitMetrics { sigma: sigma.map(|(value, _)| value), ..trial.metrics() };
        let [d_m, v_m_s, sigma0, sigma1, sigma2, alpha1_rad] = std::array::from_fn(|i| {
            let value = raw.to_array()[i];
            if value > 0.0 && value.is_finite() { value } else { f64::NAN }
        });
        let metrics = GaitMetrics {
            d_m,
            v_m_s,
            sigma: [sigma0, sigma1, sigma2],
            alpha1_rad,
            dtheta_rad: trial.dtheta_rad,
        };
        let usable = trial.status != "failed"
            && trial.omega_rad_s > 0.0
            && trial.omega_rad_s.is_finite()
            && (d_m.is_finite() || v_m_s.is_finite());
        let commanded = trial.omega_commanded_rad_s;
        let joint = |offset_rad, amplitude_rad, phase_rad| JointCommand {
            offset_rad,
            amplitude_rad,
            phase_rad,
        };
        usable.then(|| Self {
            trial: trial.trial.clone(),
            frequency_rad_s: if commanded > 0.0 { commanded } else { trial.omega_rad_s },
            omega_rad_s: trial.omega_rad_s,
            metrics,
            errors: GaitMetrics {
                d_m: trial.d_m_se,
                v_m_s: trial.v_m_s_se,
                sigma: sigma.map(|(_, error)| error),
                alpha1_rad: trial.alpha1_rad_se,
                dtheta_rad: trial.dtheta_rad_se,
            },
            cycles: usize::try_from(trial.cycles).unwrap_or(0),
            gait: [
                joint(trial.phi1_offset_rad, trial.phi1_amplitude_rad, trial.phi1_phase_rad),
                joint(trial.phi2_offset_rad, trial.phi2_amplitude_rad, trial.phi2_phase_rad),
            ],
        })
    }

    /// By frequency, then by name, then by what was measured: an order that does not depend on
    /// that of the trials.
    pub fn order(&self, other: &Self) -> Ordering {
        let numbers = |of: &Self| {
            let metrics = of.metrics.to_array();
            let errors = of.errors.to_array();
            [of.omega_rad_s].into_iter().chain(metrics).chain(errors)
        };
        let by_numbers = || {
            let pairs = numbers(self).zip(numbers(other));
            pairs.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne())
        };
        self.frequency_rad_s
            .total_cmp(&other.frequency_rad_s)
            .then_with(|| self.trial.cmp(&other.trial))
            .then_with(|| by_numbers().unwrap_or(Ordering::Equal))
    }

    /// Indices of the measurements of each frequency; the measurements are in their order.
    pub(super) fn frequencies(sorted: &[Self]) -> Vec<Vec<usize>> {
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for (i, measurement) in sorted.iter().enumerate() {
            let frequency = measurement.frequency_rad_s;
            match groups.last_mut() {
                Some(group)
                    if frequency <= sorted[group[0]].frequency_rad_s * (1.0 + SAME_FREQUENCY) =>
                {
                    group.push(i);
                }
                _ => groups.push(vec![i]),
            }
        }
        groups
    }
}
