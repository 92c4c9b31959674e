//! Selects the used cycles: those after the transient that have no gaps and follow the gait.

use std::ops::Range;

use trilink_statistics::{MAD_TO_DEVIATION, median, median_absolute_deviation};

use super::measure::{Cycle, frames_within};

/// Minimum number of cycles retained even if the first of them still differs from the others.
const MIN_RETAINED: usize = 3;
/// Maximum relative change in the displacement per cycle that is not regarded as drift.
const D_TOLERANCE: f64 = 1e-4;
/// Maximum change in the rotation per cycle that is not regarded as drift, rad.
const DTHETA_TOLERANCE_RAD: f64 = 0.005;
/// Maximum difference between the first cycle and the others that is not regarded as drift, in robust standard
/// deviations.
const MAX_DEVIATIONS: f64 = 3.0;

/// Used cycles, and numbers of cycles left out for each reason.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct CycleSelection {
    /// Indices of the used cycles, ascending.
    pub used: Vec<usize>,
    /// Minimum number of leading cycles that are skipped.
    pub skip: usize,
    /// Number of leading cycles skipped as transient.
    pub skipped: usize,
    /// Number of later cycles, up to the last used one, left out only because of gaps or jumps.
    pub gapped: usize,
    /// Number of later cycles left out because the joints did not follow the gait.
    pub off_gait: usize,
}

impl CycleSelection {
    /// Returns the reason why the cycle with index `nth` is not used; empty if it is used.
    pub(crate) fn reason(&self, nth: usize, cycle: &Cycle) -> String {
        let reason = if self.used.binary_search(&nth).is_ok() {
            ""
        } else if nth < self.skip {
            return format!(
                "one of the first {} cycles, which are skipped as transient",
                self.skip
            );
        } else if !cycle.is_whole() {
            "the cycle has a gap or a jump"
        } else if !cycle.is_gait {
            "the joints do not follow the gait"
        } else {
            "d or the rotation still changes from cycle to cycle"
        };
        reason.to_owned()
    }

    /// Returns the frames in which a trial is checked: from the first cycle after the skipped ones that follows the
    /// gait, even if a gap or a jump excludes it, to the last used cycle; `None` if no cycle is used.
    pub(crate) fn span(&self, cycles: &[Cycle]) -> Option<Range<usize>> {
        let first = cycles.get(self.skip..)?.iter().find(|cycle| cycle.is_gait)?;
        Some(frames_within(first.start, cycles[*self.used.last()?].end))
    }

    /// Returns the frames from the start of the first used cycle to the end of the last; `None` if no cycle is used.
    pub(crate) fn frames(&self, cycles: &[Cycle]) -> Option<Range<usize>> {
        let first = &cycles[*self.used.first()?];
        let last = &cycles[*self.used.last()?];
        Some(frames_within(first.start, last.end))
    }
}

/// Selects the steady cycles. Skips at least `skip` cycles, then further ones as long as the first remaining cycle
/// differs from the rest in displacement or rotation, then one more, in which the transient continues to decay below
/// the noise. At most two thirds of the cycles after the first `skip` are left out as drifting.
pub(crate) fn select(cycles: &[Cycle], skip: usize) -> CycleSelection {
    let usable = |i: &usize| cycles[*i].is_whole() && cycles[*i].is_gait;
    let begin = skip.min(cycles.len());
    let mut used: Vec<usize> = (begin..cycles.len()).filter(usable).collect();
    let min_retained = MIN_RETAINED.max(used.len() / 3);
    let mut drifting = 0;
    while used.len() > min_retained + drifting && drifts(cycles, &used[drifting..]) {
        drifting += 1;
    }
    drifting += usize::from(drifting > 0 && used.len() > min_retained + drifting);
    used.drain(..drifting);
    let later = &cycles[begin..];
    let up_to_last = &cycles[begin..used.last().map_or(cycles.len(), |last| last + 1)];
    CycleSelection {
        skip: begin,
        skipped: if drifting > 0 { used[0] } else { begin },
        gapped: up_to_last.iter().filter(|cycle| !cycle.is_whole() && cycle.is_gait).count(),
        off_gait: later.iter().filter(|cycle| cycle.is_whole() && !cycle.is_gait).count(),
        used,
    }
}

/// Returns whether the first used cycle differs from the other used cycles in displacement or rotation.
fn drifts(cycles: &[Cycle], used: &[usize]) -> bool {
    let d_m: Vec<f64> = used.iter().map(|&i| cycles[i].metrics.d_m).collect();
    let dtheta_rad: Vec<f64> = used.iter().map(|&i| cycles[i].metrics.dtheta_rad).collect();
    first_differs(&d_m, |d| D_TOLERANCE * d) || first_differs(&dtheta_rad, |_| DTHETA_TOLERANCE_RAD)
}

/// Returns whether the first value differs from the median of the rest by more than noise and a tolerance, which is a
/// function of the median.
fn first_differs(values: &[f64], tolerance: impl Fn(f64) -> f64) -> bool {
    let rest = &values[1..];
    let middle = median(rest.to_vec());
    let spread = median_absolute_deviation(rest);
    let limit = (MAX_DEVIATIONS * MAD_TO_DEVIATION * spread).max(tolerance(middle));
    (values[0] - middle).abs() > limit
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::GaitMetrics;

    use super::*;

    fn cycles(d_m: &[f64]) -> Vec<Cycle> {
        d_m.iter()
            .map(|&d_m| Cycle {
                start: 0.0,
                end: 0.0,
                metrics: GaitMetrics { d_m, dtheta_rad: 0.0, ..GaitMetrics::MISSING },
                gait: Vec::new(),
                skid_m_s: Vec::new(),
                is_gait: true,
            })
            .collect()
    }

    #[test]
    fn at_least_the_configured_cycles_are_skipped() {
        let steady = select(&cycles(&[0.4; 10]), 2);
        assert_eq!(steady.used, (2..10).collect::<Vec<_>>());
        assert_eq!(steady.skipped, 2);
    }

    #[test]
    fn cycles_are_skipped_while_d_drifts() {
        let decay = |i: i32| 0.4 * (1.0 + 0.2 * (-f64::from(i)).exp());
        let d_m: Vec<f64> = (0..16).map(decay).collect();
        // 0.2 exp(-i) drops below 0.01 % between cycles 7 and 8.
        let list = cycles(&d_m);
        let found = select(&list, 1);
        assert_eq!(found.used, (9..16).collect::<Vec<_>>());
        assert!(found.reason(5, &list[5]).contains("still changes"));
        let lasting: Vec<f64> = (0..9).map(|i| 0.4 + 0.1 * f64::from(i)).collect();
        assert!(select(&cycles(&lasting), 0).used.len() >= MIN_RETAINED);
    }

    #[test]
    fn gaps_and_pauses_are_left_out_and_counted() {
        let mut list = cycles(&[0.4, 0.4, 0.4, f64::NAN, 0.4, 0.4, 0.4, 0.4]);
        list[5].is_gait = false;
        let expected =
            CycleSelection { used: vec![2, 4, 6, 7], skip: 2, skipped: 2, gapped: 1, off_gait: 1 };
        let found = select(&list, 2);
        assert_eq!(found, expected);
        // A jump in the first used cycle is also detected.
        for (cycle, nth) in list.iter_mut().zip(0..) {
            cycle.start = 100.0 * f64::from(nth);
            cycle.end = 100.0 * f64::from(nth + 1);
        }
        assert_eq!(found.span(&list), Some(200..801));
        list[2].metrics.d_m = f64::NAN;
        assert_eq!(select(&list, 2).span(&list), Some(200..801));
        list[2].is_gait = false;
        assert_eq!(select(&list, 2).span(&list), Some(300..801));
        list[2].metrics.d_m = 0.4;
        list[2].is_gait = true;
        // The robot leaves the cameras' field of view at the end.
        let mut longer = list.clone();
        longer.extend(cycles(&[f64::NAN; 4]));
        assert_eq!(select(&longer, 2), expected);
        let reasons = list.iter().enumerate().map(|(nth, cycle)| found.reason(nth, cycle));
        let transient = "one of the first 2 cycles, which are skipped as transient";
        let gap = "the cycle has a gap or a jump";
        let off = "the joints do not follow the gait";
        assert!(reasons.eq([transient, transient, "", gap, "", off, "", ""]));
    }
}
