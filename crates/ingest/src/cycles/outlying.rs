//! Detects a used cycle that differs from the others, because the robot was touched or a camera moved.

use trilink_robot::metrics::Metric;
use trilink_statistics::{fisher, mean, normal_tail};

use super::measure::Cycle;
use super::steady::CycleSelection;
use crate::checks::{Check, Finding};

/// Minimum number of standard deviations for a difference to be significant.
const MIN_DEVIATIONS: f64 = 4.0;

/// Returns a finding with the largest significant difference of a cycle from the others in any tested metric, as a
/// fraction of the mean of the others; 0 if no difference is significant. A cycle is not compared with its neighbours,
/// because an event at the end of a cycle affects two of them.
pub(super) fn outlying_cycle(cycles: &[Cycle], steady: &CycleSelection, rate_hz: f64) -> Finding {
    let used = &steady.used;
    let mut value = 0.0;
    let mut message = "no cycle differs significantly from the others".to_owned();
    for metric in Metric::ALL.into_iter().filter(|metric| metric.is_independent_size()) {
        let name = metric.column();
        let found: Vec<f64> = used.iter().map(|&cycle| cycles[cycle].metrics[metric]).collect();
        let middle = mean(found.iter().copied());
        let off: Vec<f64> = found.iter().map(|found| found - middle).collect();
        let all = sums(&off);
        for (i, &cycle) in used.iter().enumerate() {
            let near = i.saturating_sub(1)..used.len().min(i + 2);
            let near: Vec<f64> =
                near.filter(|&j| used[j].abs_diff(cycle) <= 1).map(|j| off[j]).collect();
            let near = sums(&near);
            let [count, sum, squares] = std::array::from_fn(|k| all[k] - near[k]);
            let usual = sum / count;
            let variance = ((squares - sum * usual) / (count - 1.0)).max(0.0);
            // Student's t squared, which follows the F distribution, for a value against the mean of the others.
            let square = (off[i] - usual).powi(2) / (variance * (1.0 + 1.0 / count));
            let difference = ((off[i] - usual) / (middle + usual)).abs();
            // The limit of F decreases with the degrees of freedom, so that the quantile is not needed for most cycles.
            if difference > value && square > MIN_DEVIATIONS.powi(2) {
                let is_chance = square <= fisher(normal_tail(MIN_DEVIATIONS), [1.0, count - 1.0]);
                if is_chance {
                    continue;
                }
                value = difference;
                message = format!(
                    "cycle {cycle}, which begins at {:.1} s, has {name} = {:.4}, but the mean of the other cycles is \
                     {:.4}: was the robot touched, or did a camera move?",
                    cycles[cycle].start / rate_hz,
                    found[i],
                    middle + usual
                );
            }
        }
    }
    Finding::at_most(Check::OutlyingCycle, value, message)
}

/// Returns the number of values, their sum and the sum of their squares.
fn sums(values: &[f64]) -> [f64; 3] {
    let squares = values.iter().map(|value| value * value);
    [values.len() as f64, values.iter().sum(), squares.sum()]
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::GaitMetrics;

    use super::*;

    /// Returns the finding for `count` cycles whose displacements vary by 0.1 %, after the relative changes in `added`
    /// (each with the index of its cycle) have been added to the displacements.
    fn found(count: usize, added: &[(usize, f64)]) -> Finding {
        let cycle = |i: usize| {
            let noise = 1e-3 * (7.7 * i as f64).sin();
            let added: f64 = added.iter().filter(|(at, _)| *at == i).map(|(_, part)| part).sum();
            let d_m = 0.1 * (1.0 + noise + added);
            Cycle {
                start: 100.0 * i as f64,
                end: 100.0 * (i + 1) as f64,
                metrics: GaitMetrics { d_m, ..GaitMetrics::NONE },
                gait: Vec::new(),
                skid_m_s: Vec::new(),
                is_gait: true,
            }
        };
        let cycles: Vec<Cycle> = (0..count).map(cycle).collect();
        let steady = CycleSelection { used: (2..count).collect(), ..CycleSelection::default() };
        outlying_cycle(&cycles, &steady, 120.0)
    }

    #[test]
    fn a_cycle_unlike_the_others_is_found_also_if_its_neighbour_is() {
        assert!(found(12, &[]).holds());
        for added in [&[(6, 0.08)][..], &[(6, 0.08), (7, -0.07)], &[(2, -0.08)], &[(11, 0.08)]] {
            let found = found(12, added);
            let at = added[0].0;
            assert!((found.value - 0.08).abs() < 0.002, "{}", found.value);
            let start_s = 100.0 * at as f64 / 120.0;
            let start = format!("cycle {at}, which begins at {start_s:.1} s, has d_m 0.1");
            assert!(!found.holds() && found.message.starts_with(&start[..start.len() - 3]));
        }
    }

    #[test]
    fn insignificant_and_small_differences_are_not_outlying() {
        assert!(found(12, &[(6, 0.04)]).holds());
        // With too few cycles, differences are not significant even if all cycles differ.
        for count in 3..7 {
            assert_eq!(found(count, &[(count - 1, 0.08)]).value, 0.0);
        }
        let uneven: Vec<_> = (0..12).map(|i| (i, 0.1 * (2.3 * i as f64).cos())).collect();
        assert_eq!(found(12, &uneven).value, 0.0);
    }
}
