//! The table that `simulate` prints.

use trilink_fit::simulate::{Answer, Interval};
use trilink_mechanics::{FromRest, MotionStatus, SharpLimit};
use trilink_robot::metrics::{Dimension, GaitMetrics, Metric, MetricDefinition};

use crate::cli::output::say;
use crate::template::fixed;

pub(super) fn print(answers: &[&Answer]) {
    let names = answers.iter().map(|answer| answer.model.name().chars().count());
    let width = names.chain([5]).max().unwrap_or_default();
    let heading = |metric: Metric| match metric.definition().dimension.units()[1] {
        "" => metric.name().to_owned(),
        unit => format!("{metric} {unit}"),
    };
    say!(
        "{:<width$} {:>11} {} {:>10}  status",
        "model",
        "omega rad/s",
        in_columns(heading),
        "work J/m"
    );
    for answer in answers {
        let model = answer.model.name();
        if let Some(reason) = &answer.reason {
            say!("{model:<width$} {:>11} {}: {reason}", answer.omega_rad_s, answer.status);
            continue;
        }
        let work = match answer.work_j_m.is_nan() {
            true => String::new(),
            false => fixed(answer.work_j_m, 6),
        };
        say!(
            "{model:<width$} {:>11} {} {work:>10}  {}{}{}",
            answer.omega_rad_s,
            numbers(&answer.metrics, [7, 9, 8]),
            answer.status,
            reach_in_words(answer),
            if answer.is_extrapolated() { ", extrapolated" } else { "" },
        );
        if let Some(interval) = &answer.interval {
            print_interval(interval, width);
        }
        if let Some(SharpLimit { metrics, uncertainty }) = &answer.sharp_limit {
            let d_m = answer.metrics.d_m;
            let percent = |value: f64| 100.0 * value / d_m;
            say!(
                "{:<width$} {:>11} d is {:+.2} % (\u{b1}{:.2}) where transition_m_s goes to zero",
                "",
                "",
                percent(metrics.d_m - d_m),
                percent(uncertainty.d_m),
            );
        }
    }
}

/// The limits of an interval below the metrics.
fn print_interval(interval: &Interval, width: usize) {
    if let Some(why) = &interval.no_interval {
        say!("{:<width$} {:>11} no intervals: {}", "", "", why);
        return;
    }
    for (what, limits) in [("95 % from", interval.lower), ("to", interval.upper)] {
        say!("{:<width$} {what:>11} {}", "", numbers(&limits, [4, 6, 5]));
    }
}

/// Metrics in columns; `digits` are those of lengths, of skid ratios and of angles.
fn numbers(metrics: &GaitMetrics, [length, ratio, angle]: [usize; 3]) -> String {
    in_columns(|metric| {
        let digits = match metric.definition().dimension {
            Dimension::Length | Dimension::Speed => length,
            Dimension::Ratio => ratio,
            Dimension::Angle => angle,
        };
        fixed(metric.shown(metrics), digits)
    })
}

fn in_columns(of: impl Fn(Metric) -> String) -> String {
    let cell = |metric: Metric| {
        let MetricDefinition { dimension, is_size, .. } = *metric.definition();
        // With a sign it takes a place more.
        let is_narrow = is_size && matches!(dimension, Dimension::Ratio | Dimension::Angle);
        format!("{:>1$}", of(metric), if is_narrow { 12 } else { 13 })
    };
    Metric::ALL.map(cell).join(" ")
}

/// What is to be known of a motion beside its numbers.
fn reach_in_words(answer: &Answer) -> String {
    let of_two = match answer.status {
        MotionStatus::SymmetryBroken => ": one of two that are each other's mirror image",
        _ => "",
    };
    let reach = match (answer.from_rest, answer.cycles_to_settle) {
        (Some(FromRest::Reached), Some(0)) => String::new(),
        (Some(FromRest::Reached), Some(1)) => ", from rest after 1 cycle".to_owned(),
        (Some(FromRest::Reached), Some(cycles)) => format!(", from rest after {cycles} cycles"),
        (Some(FromRest::Another), _) => {
            ", but from rest the robot gets into another motion (--from-rest)".to_owned()
        }
        (Some(FromRest::Unsettled), _) => ", but from rest the robot does not settle".to_owned(),
        _ => String::new(),
    };
    of_two.to_owned() + &reach
}
