//! What a trial's metrics and its measured gait are off by, which have noise in common: the cycles that
//! differ in their skid differ in their angles, too.
//!
//! Of the standard deviation of each number, a part is what cycles differ by; in that all numbers move
//! together, as they do from cycle to cycle. The rest, which the cycles have in common, is independent.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use trilink_robot::metrics::{ByFitted, Metric};
use trilink_statistics::{mean, mean_deviation, wrap};
use trilink_tables::CycleRow;

use super::conditions::GAIT_NUMBERS;
use super::measurement::Measurement;

/// The metrics with terms in the objective, then the numbers of the gait.
const NUMBERS: usize = METRICS + GAIT_NUMBERS;
const METRICS: usize = Metric::FITTED.len();

/// Noise of one trial.
pub(super) struct TrialNoise {
    /// Standard deviations, without bias; 0 of what nothing tells.
    deviations: [f64; NUMBERS],
    /// The cycles' part of each.
    shares: [f64; NUMBERS],
    /// What each cycle differs by from all, such that the squares of a number sum to 1; 0 of what does not
    /// differ.
    cycles: Vec<[f64; NUMBERS]>,
}

/// What a trial is off by, in standard deviations.
pub(super) struct Deviates {
    pub metrics: ByFitted<f64>,
    pub gait: [f64; GAIT_NUMBERS],
}

impl TrialNoise {
    /// Of standard deviations of the metrics, and the cycles that count, if they are at hand.
    pub(crate) fn new<'c>(
        measurement: &Measurement,
        of_metrics: &ByFitted<f64>,
        cycles: impl Iterator<Item = &'c CycleRow>,
    ) -> Self {
        let of_gait = measurement.gait_deviations_rad();
        let deviations = joined(of_metrics, of_gait.as_flattened())
            .map(|deviation| if deviation.is_finite() { deviation } else { 0.0 });
        let mut cycles: Vec<_> = cycles.map(|cycle| numbers(measurement, cycle)).collect();
        let freedom = cycles.len().saturating_sub(1) as f64;
        let shares = std::array::from_fn(|i| {
            let middle = mean(cycles.iter().map(|cycle| cycle[i]));
            let squares: f64 = cycles.iter().map(|cycle| (cycle[i] - middle).powi(2)).sum();
            let differs = squares > 0.0 && squares.is_finite();
            let unit = |value: f64| if differs { (value - middle) / squares.sqrt() } else { 0.0 };
            cycles.iter_mut().for_each(|cycle| cycle[i] = unit(cycle[i]));
            let by_cycles = (squares / freedom / (freedom + 1.0)).sqrt() / mean_deviation(freedom);
            // Of an error of 0, with either sign, there is no part.
            let is_shared = differs && deviations[i] > 0.0;
            if is_shared { (by_cycles / deviations[i]).min(1.0) } else { 0.0 }
        });
        Self { deviations, shares, cycles }
    }

    /// Standard deviation of a metric.
    pub(crate) fn deviation(&self, metric: Metric) -> f64 {
        self.deviations[metric as usize]
    }

    /// Standard deviations of the gait's numbers, rad.
    pub(crate) fn gait_deviations_rad(&self) -> &[f64] {
        &self.deviations[METRICS..]
    }

    /// The deviates of a resample of the cycles, by random numbers for the metrics and for the gait.
    pub(crate) fn draw(&self, [of_metrics, of_gait]: &mut [ChaCha8Rng; 2]) -> Deviates {
        let mut normal = ByFitted::splat(0.0);
        // d and v are one measurement.
        for (_, normal) in normal.iter_mut().filter(|(metric, _)| *metric != Metric::V) {
            *normal = StandardNormal.sample(of_metrics);
        }
        normal[Metric::V] = normal[Metric::D];
        let normal_of_gait: [f64; GAIT_NUMBERS] =
            std::array::from_fn(|_| StandardNormal.sample(of_gait));
        let count = self.cycles.len();
        let drawn: Vec<usize> = (0..count).map(|_| of_metrics.random_range(0..count)).collect();
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

    /// Standard deviation of a predicted less the measured metric, where one of the gait's numbers changes
    /// the prediction by so much for each.
    pub(crate) fn deviation_of_residual(&self, metric: Metric, by_gait: &[f64]) -> f64 {
        let own = std::iter::once((metric as usize, -self.deviation(metric)));
        let factors: Vec<(usize, f64)> =
            own.chain((METRICS..).zip(by_gait.iter().copied())).collect();
        let together = |cycle: &[f64; NUMBERS]| {
            let moved = factors.iter().map(|&(i, factor)| factor * self.shares[i] * cycle[i]);
            moved.sum::<f64>().powi(2)
        };
        let apart = |&(i, factor): &(usize, f64)| factor.powi(2) * (1.0 - self.shares[i].powi(2));
        let variance =
            self.cycles.iter().map(together).sum::<f64>() + factors.iter().map(apart).sum::<f64>();
        variance.sqrt()
    }
}

/// The numbers of a cycle; phases next to the trial's.
fn numbers(measurement: &Measurement, cycle: &CycleRow) -> [f64; NUMBERS] {
    let gait = [0, 1].map(|joint| {
        let of = &cycle.gait[joint];
        let turned = wrap(of.phase_rad - measurement.gait[joint].phase_rad);
        [of.offset_rad, of.amplitude_rad, turned]
    });
    joined(&cycle.metrics.into(), gait.as_flattened())
}

/// Of the metrics with terms, and of the gait.
fn joined(metrics: &ByFitted<f64>, gait: &[f64]) -> [f64; NUMBERS] {
    std::array::from_fn(|i| if i < METRICS { metrics.values()[i] } else { gait[i - METRICS] })
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use trilink_robot::metrics::GaitMetrics;
    use trilink_tables::config::SigmaKind;
    use trilink_tables::{Columns as _, TrialRow};

    use super::*;

    /// A trial whose cycles differ by `d` and, against it, by the phase of its first joint.
    fn noise() -> TrialNoise {
        let d_m = [0.40, 0.43, 0.42, 0.44, 0.41];
        let variance = d_m.iter().map(|d| (d - 0.42_f64).powi(2)).sum::<f64>() / 4.0;
        let mut row = TrialRow { omega_rad_s: 2.0, cycles: 5, ..TrialRow::blank() };
        row.metrics = GaitMetrics { d_m: 0.42, v_m_s: 0.1, ..GaitMetrics::MISSING };
        // Pi and a little more or less.
        row.gait[0].phase_rad = std::f64::consts::PI;
        let (cycles, error) = (
            d_m.map(|d_m| {
                let mut cycle = CycleRow::blank();
                cycle.metrics.d_m = d_m;
                cycle.gait[0].phase_rad = wrap(std::f64::consts::PI - 2.0 * (d_m - 0.42));
                cycle
            }),
            (variance / 5.0).sqrt(),
        );
        // Half of the phase's variance is not the cycles'.
        row.gait[0].phase_rad_se = 2.0 * error * 2.0_f64.sqrt();
        let measurement = Measurement::new(&row, SigmaKind::Raw).expect("a measurement");
        let unbiased = 1.0 / mean_deviation(4.0);
        row.gait[0].phase_rad_se *= unbiased / measurement.unbiased();
        let measurement = Measurement::new(&row, SigmaKind::Raw).expect("a measurement");
        let mut of_metrics = ByFitted::splat(0.0);
        of_metrics[Metric::D] = unbiased * error;
        TrialNoise::new(&measurement, &of_metrics, cycles.iter())
    }

    #[test]
    fn what_differs_between_cycles_moves_together_and_the_rest_alone() {
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
    fn what_has_an_error_of_zero_is_never_off() {
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
        let off = noise.gait_deviations_rad()[2] * drawn.gait[2];
        assert_eq!(off, 0.0, "{off}");
    }

    #[test]
    fn a_residual_spreads_as_what_is_drawn() {
        let noise = noise();
        let d_m = noise.deviation(Metric::D);
        for by_phase in [0.0, 2.0 * d_m, -2.0 * d_m] {
            let by_gait = [0.0, 0.0, by_phase, 0.0, 0.0, 0.0];
            let mut random = [5, 6].map(ChaCha8Rng::seed_from_u64);
            let squares = (0..4000).map(|_| {
                let drawn = noise.draw(&mut random);
                (by_phase * drawn.gait[2] - d_m * drawn.metrics[Metric::D]).powi(2)
            });
            let (drawn, told) =
                (mean(squares).sqrt(), noise.deviation_of_residual(Metric::D, &by_gait));
            assert!((drawn / told - 1.0).abs() < 0.05, "{drawn} {told}");
        }
        // Without a gait.
        assert!((noise.deviation_of_residual(Metric::D, &[]) / d_m - 1.0).abs() < 1e-12);
    }
}
