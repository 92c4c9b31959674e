//! Whether one of the cycles that count is unlike the others: a robot that was touched, a camera that moved.

use trilink_robot::metrics::Metric;
use trilink_statistics::{fisher, mean};

use super::measure::Cycle;
use super::steady::Steady;
use crate::checks::{Check, Finding};

/// What chance does no more often than so many standard deviations is not taken for chance.
const DEVIATIONS: f64 = 4.0;

/// By how much the cycle that differs most from the others does so, as a part of their mean, in a metric; 0 if
/// chance would do as much. v follows d, and what is no size may be none. Its neighbours are none of the others: what happens where
/// one cycle ends is in two of them.
pub(super) fn outlying_cycle(cycles: &[Cycle], steady: &Steady, rate_hz: f64) -> Finding {
    let used = &steady.used;
    let mut value = 0.0;
    let mut message = "no cycle differs from the others".to_owned();
    let is_tested = |of: &Metric| *of != Metric::V && of.definition().is_size;
    for metric in Metric::ALL.into_iter().filter(is_tested) {
        let name = metric.column();
        let of = |&cycle: &usize| cycles[cycle].metrics[metric];
        let found: Vec<f64> = used.iter().map(of).collect();
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
            // Student's t, whose square is F, of a value against the mean of others.
            let chance = fisher(DEVIATIONS, [1.0, count - 1.0]) * variance * (1.0 + 1.0 / count);
            let part = ((off[i] - usual) / (middle + usual)).abs();
            // Of a few others anything may be chance.
            if chance.is_finite() && (off[i] - usual).powi(2) > chance && part > value {
                value = part;
                message = format!(
                    "cycle {cycle}, from {:.1} s on, has {name} {:.4} and the others {:.4}: was the robot touched, \
                     or did a camera move?",
                    cycles[cycle].start / rate_hz,
                    found[i],
                    middle + usual
                );
            }
        }
    }
    Finding::at_most(Check::OutlyingCycle, value, message)
}

/// How many, their sum and that of their squares.
fn sums(values: &[f64]) -> [f64; 3] {
    let squares = values.iter().map(|value| value * value);
    [values.len() as f64, values.iter().sum(), squares.sum()]
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::GaitMetrics;
    use trilink_tables::{Columns as _, JointCycle};

    use super::*;

    /// Found among cycles whose d differ by 0.1 % and more by what is added.
    fn found(count: usize, added: &[(usize, f64)]) -> Finding {
        let cycle = |i: usize| {
            let noise = 1e-3 * (7.7 * i as f64).sin();
            let added: f64 = added.iter().filter(|(at, _)| *at == i).map(|(_, part)| part).sum();
            let d_m = 0.1 * (1.0 + noise + added);
            Cycle {
                start: 100.0 * i as f64,
                end: 100.0 * (i + 1) as f64,
                metrics: GaitMetrics { d_m, ..GaitMetrics::NONE },
                gait: [JointCycle::blank(), JointCycle::blank()],
                skid_m_s: Default::default(),
                is_gait: true,
            }
        };
        let cycles: Vec<Cycle> = (0..count).map(cycle).collect();
        let steady = Steady { used: (2..count).collect(), ..Steady::default() };
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
            let says = format!("cycle {at}, from {start_s:.1} s on, has d_m 0.1");
            assert!(!found.holds() && found.message.starts_with(&says[..says.len() - 3]));
        }
    }

    #[test]
    fn what_chance_does_and_what_is_small_is_not_outlying() {
        assert!(found(12, &[(6, 0.04)]).holds());
        // Too few to tell, and all different.
        for count in 3..7 {
            assert_eq!(found(count, &[(count - 1, 0.08)]).value, 0.0);
        }
        let uneven: Vec<_> = (0..12).map(|i| (i, 0.1 * (2.3 * i as f64).cos())).collect();
        assert_eq!(found(12, &uneven).value, 0.0);
    }
}
