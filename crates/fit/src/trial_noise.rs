//! Correlated noise in a trial's metrics and measured gait. Both are computed from the same cycles, and cycles that
//! differ in their skid also differ in their joint angles.
//!
//! A fraction of the standard deviation of each quantity is due to the differences between cycles; this component has
//! the same correlation between quantities as the single cycles. The remaining component, which all cycles of the trial
//! have in common, is independent for each quantity.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use trilink_robot::Robot;
use trilink_robot::metrics::{ByFitted, Metric};
use trilink_statistics::{c4, mean, wrap};
use trilink_tables::CycleRow;

use super::conditions::GAIT_NUMBERS;
use super::gait_over_frequency::GaitErrors;
use super::measurement::Measurement;

/// Number of metrics in the objective plus number of gait parameters.
const NUMBERS: usize = METRICS + GAIT_NUMBERS;
const METRICS: usize = Metric::FITTED.len();

/// Noise of the metrics and gait parameters of one trial.
pub(super) struct TrialNoise {
    /// Unbiased standard deviation of each metric in the objective and of each gait parameter (rad); 0 where it is not
    /// known.
    deviations: [f64; NUMBERS],
    /// For each metric in the objective and each gait parameter, the fraction of its standard deviation that is due to
    /// differences between cycles.
    shares: [f64; NUMBERS],
    /// For each cycle, the deviations of the metrics and gait parameters from their means over the cycles, scaled so
    /// that their squares sum to 1 over the cycles; 0 for quantities that do not differ between cycles.
    cycles: Vec<[f64; NUMBERS]>,
}

/// Random deviations of a trial's metrics and gait parameters, in units of their standard deviations.
pub(super) struct Deviates {
    pub metrics: ByFitted<f64>,
    pub gait: [f64; GAIT_NUMBERS],
}

impl TrialNoise {
    /// Prepares the noise model of a trial from the standard deviations of its metrics and from its used cycles;
    /// `cycles` may be empty.
    pub(crate) fn new<'c>(
        measurement: &Measurement,
        metric_deviations: &ByFitted<f64>,
        cycles: impl Iterator<Item = &'c CycleRow>,
    ) -> Self {
        let gait_deviations = measurement.gait_deviations_rad();
        let deviations = concatenated(metric_deviations, gait_deviations.as_flattened())
            .map(|deviation| if deviation.is_finite() { deviation } else { 0.0 });
        let mut cycles: Vec<_> = cycles.map(|cycle| numbers(measurement, cycle)).collect();
        let cycle_freedom = cycles.len().saturating_sub(1) as f64;
        let shares = std::array::from_fn(|i| {
            let mean = mean(cycles.iter().map(|cycle| cycle[i]));
            let squares: f64 = cycles.iter().map(|cycle| (cycle[i] - mean).powi(2)).sum();
            let differs = squares > 0.0 && squares.is_finite();
            for cycle in &mut cycles {
                cycle[i] = if differs { (cycle[i] - mean) / squares.sqrt() } else { 0.0 };
            }
            let by_cycles =
                (squares / cycle_freedom / (cycle_freedom + 1.0)).sqrt() / c4(cycle_freedom);
            // A standard deviation of zero (of either sign) has no such fraction.
            let has_share = differs && deviations[i] > 0.0;
            if has_share { (by_cycles / deviations[i]).min(1.0) } else { 0.0 }
        });
        Self { deviations, shares, cycles }
    }

    /// Returns the standard deviation of a metric.
    pub(crate) fn deviation(&self, metric: Metric) -> f64 {
        self.deviations[metric as usize]
    }

    /// Returns the standard deviations of the gait parameters, rad.
    pub(crate) fn gait_deviations_rad(&self) -> &[f64] {
        &self.deviations[METRICS..]
    }

    /// Draws random deviations: the part due to differences between cycles by resampling the cycles, the rest from
    /// normal distributions. The two random generators are for the metrics and for the gait.
    pub(crate) fn draw(&self, [for_metrics, for_gait]: &mut [ChaCha8Rng; 2]) -> Deviates {
        let mut normal = ByFitted::splat(0.0);
        // d and v are one measurement.
        for (metric, normal) in normal.iter_mut().filter(|(metric, _)| *metric != Metric::V) {
            if metric.is_of_three_links() || self.deviation(metric) > 0.0 {
                *normal = StandardNormal.sample(for_metrics);
            }
        }
        normal[Metric::V] = normal[Metric::D];
        // Those of the joints of three links are always drawn, so that the others do not change their random numbers.
        let is_drawn = |i: usize| i < 3 * Robot::JOINTS || self.gait_deviations_rad()[i] > 0.0;
        let normal_of_gait: [f64; GAIT_NUMBERS] =
            std::array::from_fn(
                |i| {
                    if is_drawn(i) { StandardNormal.sample(for_gait) } else { 0.0 }
                },
            );
        let count = self.cycles.len();
        let drawn: Vec<usize> = (0..count).map(|_| for_metrics.random_range(0..count)).collect();
        let deviate = |i: usize, normal: f64| {
            let share = self.shares[i];
            let by_cycles: f64 = drawn.iter().map(|&n| self.cycles[n][i]).sum();
            share * by_cycles + (1.0 - share * share).sqrt() * normal
        };
        Deviates {
            metrics: ByFitted::from_fn(|metric| deviate(metric as usize, normal[metric])),
            gait: std::array::from_fn(|i| deviate(METRICS + i, normal_of_gait[i])),
        }
    }

    /// Returns the covariance of predicted minus measured for two metrics, each with the changes in its prediction per
    /// standard deviation of each gait parameter.
    pub(crate) fn covariance_of_residuals(&self, metrics: [(Metric, &[f64]); 2]) -> f64 {
        let factors = metrics.map(|(metric, gait_effects)| {
            let mut factors = [0.0; NUMBERS];
            factors[metric as usize] = -self.deviation(metric);
            factors[METRICS..]
                .iter_mut()
                .zip(gait_effects)
                .for_each(|(factor, own)| *factor = *own);
            factors
        });
        let by_cycles = self.cycles.iter().map(|cycle| {
            let [a, b] = factors.each_ref().map(|factors| {
                (0..NUMBERS).map(|i| factors[i] * self.shares[i] * cycle[i]).sum::<f64>()
            });
            a * b
        });
        let [a, b] = &factors;
        let independent = (0..NUMBERS).map(|i| a[i] * b[i] * (1.0 - self.shares[i].powi(2)));
        by_cycles.sum::<f64>() + independent.sum::<f64>()
    }

    /// Returns the standard deviation of predicted minus measured for a metric; `gait_effects` are the changes in the
    /// prediction per standard deviation of each gait parameter.
    pub(crate) fn deviation_of_residual(&self, metric: Metric, gait_effects: &[f64]) -> f64 {
        self.covariance_of_residuals([(metric, gait_effects); 2]).sqrt()
    }
}

/// Returns the metrics and gait parameters measured in one cycle; phases are relative to the phase of the trial's mean
/// gait, and wrapped to at most half a turn.
fn numbers(measurement: &Measurement, cycle: &CycleRow) -> [f64; NUMBERS] {
    let joints = cycle.joints();
    let gait: GaitErrors = std::array::from_fn(|joint| {
        let of = &joints[joint];
        let turned = wrap(of.phase_rad - measurement.gait[joint].phase_rad);
        [of.offset_rad, of.amplitude_rad, turned]
    });
    concatenated(&cycle.metrics.into(), gait.as_flattened())
}

/// Concatenates the metrics in the objective and the gait parameters.
fn concatenated(metrics: &ByFitted<f64>, gait: &[f64]) -> [f64; NUMBERS] {
    std::array::from_fn(|i| if i < METRICS { metrics.values()[i] } else { gait[i - METRICS] })
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use trilink_robot::metrics::GaitMetrics;
    use trilink_tables::config::SigmaKind;
    use trilink_tables::{Columns as _, TrialRow};

    use super::*;

    /// Returns the noise of a trial in whose cycles the phase of joint 1 decreases as d increases.
    fn noise() -> TrialNoise {
        let d_m = [0.40, 0.43, 0.42, 0.44, 0.41];
        let variance = d_m.iter().map(|d| (d - 0.42_f64).powi(2)).sum::<f64>() / 4.0;
        let mut row = TrialRow { omega_rad_s: 2.0, cycles: 5, ..TrialRow::blank() };
        row.metrics = GaitMetrics { d_m: 0.42, v_m_s: 0.1, ..GaitMetrics::MISSING };
        // The phases of the cycles lie on both sides of pi.
        row.gait[0].phase_rad = std::f64::consts::PI;
        let error = (variance / 5.0).sqrt();
        let cycles = d_m.map(|d_m| {
            let mut cycle = CycleRow::blank();
            cycle.metrics.d_m = d_m;
            cycle.gait[0].phase_rad = wrap(std::f64::consts::PI - 2.0 * (d_m - 0.42));
            cycle
        });
        // Half of the variance of the phase is not due to differences between cycles.
        row.gait[0].phase_rad_se = 2.0 * error * 2.0_f64.sqrt();
        let measurement = Measurement::new(&row, SigmaKind::Raw).expect("a measurement");
        let unbiased = 1.0 / c4(4.0);
        row.gait[0].phase_rad_se *= unbiased / measurement.bias_correction();
        let measurement = Measurement::new(&row, SigmaKind::Raw).expect("a measurement");
        let mut metric_deviations = ByFitted::splat(0.0);
        metric_deviations[Metric::D] = unbiased * error;
        TrialNoise::new(&measurement, &metric_deviations, cycles.iter())
    }

    #[test]
    fn differences_between_cycles_move_together_and_the_rest_independently() {
        let noise = noise();
        let phase = 2;
        let mut random = [3, 4].map(ChaCha8Rng::seed_from_u64);
        let drawn: Vec<[f64; 2]> = (0..4000)
            .map(|_| noise.draw(&mut random))
            .map(|drawn| [drawn.metrics[Metric::D], drawn.gait[phase]])
            .collect();
        let product = |a: usize, b: usize| mean(drawn.iter().map(|each| each[a] * each[b]));
        assert!((product(0, 0) - 1.0).abs() < 0.06 && (product(1, 1) - 1.0).abs() < 0.06);
        assert!((product(0, 1) + 0.5_f64.sqrt()).abs() < 0.05, "{}", product(0, 1));
    }

    #[test]
    fn a_number_with_a_standard_error_of_zero_does_not_move() {
        let mut row = TrialRow { omega_rad_s: 2.0, cycles: 5, ..TrialRow::blank() };
        row.metrics = GaitMetrics { d_m: 0.42, v_m_s: 0.1, ..GaitMetrics::MISSING };
        row.gait[0].phase_rad_se = -0.0;
        let measurement = Measurement::new(&row, SigmaKind::Raw).expect("a measurement");
        let mut cycles = [CycleRow::blank(), CycleRow::blank()];
        for (cycle, phase_rad) in cycles.iter_mut().zip([-0.1, 0.1]) {
            cycle.gait[0].phase_rad = phase_rad;
        }
        let noise = TrialNoise::new(&measurement, &ByFitted::splat(0.0), cycles.iter());
        let drawn = noise.draw(&mut [3, 4].map(ChaCha8Rng::seed_from_u64));
        let deviation = noise.gait_deviations_rad()[2] * drawn.gait[2];
        assert_eq!(deviation, 0.0, "{deviation}");
    }

    #[test]
    fn the_deviation_of_a_residual_is_that_of_the_draws() {
        let noise = noise();
        let d_m = noise.deviation(Metric::D);
        for by_phase in [0.0, 2.0 * d_m, -2.0 * d_m] {
            let by_gait = [0.0, 0.0, by_phase, 0.0, 0.0, 0.0];
            let mut random = [5, 6].map(ChaCha8Rng::seed_from_u64);
            let squares = (0..4000).map(|_| {
                let drawn = noise.draw(&mut random);
                (by_phase * drawn.gait[2] - d_m * drawn.metrics[Metric::D]).powi(2)
            });
            let drawn = mean(squares).sqrt();
            let computed = noise.deviation_of_residual(Metric::D, &by_gait);
            assert!((drawn / computed - 1.0).abs() < 0.05, "{drawn} {computed}");
        }
        // Case without gait effects.
        assert!((noise.deviation_of_residual(Metric::D, &[]) / d_m - 1.0).abs() < 1e-12);
    }
}
