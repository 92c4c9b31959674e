//! Which cycles count: those after the transient that are whole and show the gait.

use std::ops::Range;

use trilink_statistics::{MAD_TO_DEVIATION, median, median_absolute_deviation};

use super::measure::{Cycle, frames_within};

/// Cycles that are kept however much the first of them still differs from the others.
const LEAST_KEPT: usize = 3;
/// Changes below these are no drift: part of d, and rad.
const D_TOLERANCE: f64 = 1e-4;
const DTHETA_TOLERANCE_RAD: f64 = 0.005;
/// Robust standard deviations by which the first cycle may differ.
const DEVIATIONS: f64 = 3.0;

/// Which cycles count and which were left out why.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Steady {
    /// Indices of the cycles that count, increasing.
    pub used: Vec<usize>,
    /// Leading cycles that are skipped whatever they show.
    pub skip: usize,
    /// Leading cycles taken for transient.
    pub skipped: usize,
    /// Later cycles that would count but for gaps or jumps, up to the last that counts.
    pub gapped: usize,
    /// Later cycles left out because the joints were off their gait.
    pub off_gait: usize,
}

impl Steady {
    /// Why a cycle does not count; empty where it does.
    pub(crate) fn reason(&self, nth: usize, cycle: &Cycle) -> String {
        let reason = if self.used.binary_search(&nth).is_ok() {
            ""
        } else if nth < self.skip {
            return format!("one of the first {}, taken for transient", self.skip);
        } else if !cycle.is_whole() {
            "part of it was not seen, or the robot jumps in it"
        } else if !cycle.is_gait {
            "the joints are off their gait"
        } else {
            "d or the rotation still changes from cycle to cycle"
        };
        reason.to_owned()
    }

    /// The frames that the checks of a trial look at: from the first cycle that is not skipped and shows the
    /// gait, although a gap, a jump or what a jump makes of its neighbours may cost it, to the last that counts.
    pub(crate) fn span(&self, cycles: &[Cycle]) -> Option<Range<usize>> {
        let first = cycles.get(self.skip..)?.iter().find(|cycle| cycle.is_gait)?;
        Some(frames_within(first.start, cycles[*self.used.last()?].end))
    }

    /// The frames from the first cycle that counts to the last one.
    pub(crate) fn frames(&self, cycles: &[Cycle]) -> Option<Range<usize>> {
        let (first, last) = (&cycles[*self.used.first()?], &cycles[*self.used.last()?]);
        Some(frames_within(first.start, last.end))
    }
}

/// Skips at least `skip` cycles, more while the first one left still differs from the rest in
/// d or Delta theta, and then one in which the decay goes on below what noise shows; but never more
/// than two thirds of what is there.
pub(crate) fn steady(cycles: &[Cycle], skip: usize) -> Steady {
    let usable = |i: &usize| cycles[*i].is_whole() && cycles[*i].is_gait;
    let begin = skip.min(cycles.len());
    let mut used: Vec<usize> = (begin..cycles.len()).filter(usable).collect();
    let least = LEAST_KEPT.max(used.len() / 3);
    let mut drifting = 0;
    while used.len() > least + drifting && drifts(cycles, &used[drifting..]) {
        drifting += 1;
    }
    drifting += usize::from(drifting > 0 && used.len() > least + drifting);
    used.drain(..drifting);
    let later = &cycles[begin..];
    let up_to_last = &cycles[begin..used.last().map_or(cycles.len(), |last| last + 1)];
    let is_gapped = |cycle: &&Cycle| !cycle.is_whole() && cycle.is_gait;
    Steady {
        skip: begin,
        skipped: if drifting > 0 { used[0] } else { begin },
        gapped: up_to_last.iter().filter(is_gapped).count(),
        off_gait: later.iter().filter(|cycle| cycle.is_whole() && !cycle.is_gait).count(),
        used,
    }
}

fn drifts(cycles: &[Cycle], used: &[usize]) -> bool {
    let differs = |value: &dyn Fn(&Cycle) -> f64, tolerance: &dyn Fn(f64) -> f64| {
        let rest: Vec<f64> = used[1..].iter().map(|&i| value(&cycles[i])).collect();
        let (middle, spread) = (median(rest.clone()), median_absolute_deviation(&rest));
        let limit = (DEVIATIONS * MAD_TO_DEVIATION * spread).max(tolerance(middle));
        (value(&cycles[used[0]]) - middle).abs() > limit
    };
    differs(&|cycle| cycle.metrics.d_m, &|d| D_TOLERANCE * d)
        || differs(&|cycle| cycle.metrics.dtheta_rad, &|_| DTHETA_TOLERANCE_RAD)
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::GaitMetrics;
    use trilink_tables::Columns;

    use super::*;

    fn cycles(d_m: &[f64]) -> Vec<Cycle> {
        d_m.iter()
            .map(|&d_m| Cycle {
                start: 0.0,
                end: 0.0,
                metrics: GaitMetrics { d_m, dtheta_rad: 0.0, ..GaitMetrics::MISSING },
                gait: Columns::blank(),
                skid_m_s: [const { Vec::new() }; 3],
                is_gait: true,
            })
            .collect()
    }

    #[test]
    fn at_least_the_configured_cycles_are_skipped() {
        let steady = steady(&cycles(&[0.4; 10]), 2);
        assert_eq!(steady.used, (2..10).collect::<Vec<_>>());
        assert_eq!(steady.skipped, 2);
    }

    #[test]
    fn cycles_are_skipped_while_d_drifts() {
        let decay = |i: i32| 0.4 * (1.0 + 0.2 * (-f64::from(i)).exp());
        let d_m: Vec<f64> = (0..16).map(decay).collect();
        // 0.2 exp(-i) falls below 0.01 % between cycles 7 and 8.
        let (list, found) = (cycles(&d_m), steady(&cycles(&d_m), 1));
        assert_eq!(found.used, (9..16).collect::<Vec<_>>());
        assert!(found.reason(5, &list[5]).contains("still changes"));
        let lasting: Vec<f64> = (0..9).map(|i| 0.4 + 0.1 * f64::from(i)).collect();
        assert!(steady(&cycles(&lasting), 0).used.len() >= LEAST_KEPT);
    }

    #[test]
    fn gaps_and_pauses_are_left_out_and_counted() {
        let mut list = cycles(&[0.4, 0.4, 0.4, f64::NAN, 0.4, 0.4, 0.4, 0.4]);
        list[5].is_gait = false;
        let expected =
            Steady { used: vec![2, 4, 6, 7], skip: 2, skipped: 2, gapped: 1, off_gait: 1 };
        let found = steady(&list, 2);
        assert_eq!(found, expected);
        // The frames of each: a jump in the first of them is looked at, too.
        list.iter_mut().zip(0..).for_each(|(cycle, nth)| {
            (cycle.start, cycle.end) = (100.0 * f64::from(nth), 100.0 * f64::from(nth + 1));
        });
        assert_eq!(found.span(&list), Some(200..801));
        list[2].metrics.d_m = f64::NAN;
        assert_eq!(steady(&list, 2).span(&list), Some(200..801));
        list[2].is_gait = false;
        assert_eq!(steady(&list, 2).span(&list), Some(300..801));
        (list[2].metrics.d_m, list[2].is_gait) = (0.4, true);
        // The robot leaves the cameras' sight at the end.
        let mut longer = list.clone();
        longer.extend(cycles(&[f64::NAN; 4]));
        assert_eq!(steady(&longer, 2), expected);
        let reasons = list.iter().enumerate().map(|(nth, cycle)| found.reason(nth, cycle));
        let transient = "one of the first 2, taken for transient";
        let (unseen, off) =
            ("part of it was not seen, or the robot jumps in it", "the joints are off their gait");
        assert!(reasons.eq([transient, transient, "", unseen, "", off, "", ""]));
    }
}
