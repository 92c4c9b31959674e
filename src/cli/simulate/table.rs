//! Table that `simulate` prints.

use trilink_fit::simulate::{Answer, Interval};
use trilink_mechanics::{FromRest, MotionStatus, SharpLimit};
use trilink_robot::metrics::{Dimension, GaitMetrics, Metric, MetricDefinition};

use crate::cli::output::say;
use crate::template::fixed;

/// Prints a line for each solution, followed by lines with its confidence intervals and with the change in d as the
/// transition speed of dry friction goes to zero, if these are known.
pub(super) fn print(answers: &[&Answer]) {
    let names = answers.iter().map(|answer| answer.model.name().chars().count());
    let width = names.chain([5]).max().unwrap_or_default();
    let headings = in_columns(|metric| match metric.definition().dimension.units()[1] {
        "" => metric.name().to_owned(),
        unit => format!("{metric} {unit}"),
    });
    say!("{:<width$} {:>11} {headings} {:>10}  status", "model", "omega rad/s", "work J/m");
    for answer in answers {
        let model = answer.model.name();
        if let Some(reason) = &answer.reason {
            say!("{model:<width$} {:>11} {}: {reason}", answer.omega_rad_s, answer.status);
            continue;
        }
        let work = if answer.work_j_m.is_nan() { String::new() } else { fixed(answer.work_j_m, 6) };
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
            say!(
                "{:<width$} {:>11} d changes by {:+.2} % (\u{b1}{:.2}) as transition_m_s goes to \
                 zero",
                "",
                "",
                100.0 * (metrics.d_m - d_m) / d_m,
                100.0 * uncertainty.d_m / d_m,
            );
        }
    }
}

/// Prints the lower and upper confidence limits of the metrics in two lines, or the reason why there are none. `width`
/// is the width of the column of models, characters.
fn print_interval(interval: &Interval, width: usize) {
    if let Some(why) = &interval.no_interval {
        say!("{:<width$} {:>11} no intervals: {}", "", "", why);
        return;
    }
    for (what, limits) in [("95 % from", interval.lower), ("to", interval.upper)] {
        say!("{:<width$} {what:>11} {}", "", numbers(&limits, [4, 6, 5]));
    }
}

/// Formats metrics in columns with the given numbers of decimals: for lengths and speeds, for skid ratios, and for
/// angles.
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

/// Returns one line with a column per metric; `text` returns the content of a metric's column.
fn in_columns(text: impl Fn(Metric) -> String) -> String {
    let cells = Metric::ALL.map(|metric| {
        let MetricDefinition { dimension, is_size, .. } = *metric.definition();
        // Signed metrics need one more character.
        let is_narrow = is_size && matches!(dimension, Dimension::Ratio | Dimension::Angle);
        format!("{:>1$}", text(metric), if is_narrow { 12 } else { 13 })
    });
    cells.join(" ")
}

/// Describes the symmetry of a steady-state motion and whether the robot reaches it from rest.
fn reach_in_words(answer: &Answer) -> String {
    let symmetry = match answer.status {
        MotionStatus::SymmetryBroken => ": one of two mirror-image motions",
        _ => "",
    };
    let reach = match (answer.from_rest, answer.cycles_to_settle) {
        (Some(FromRest::Reached), Some(0)) => String::new(),
        (Some(FromRest::Reached), Some(1)) => ", reached from rest after 1 cycle".to_owned(),
        (Some(FromRest::Reached), Some(cycles)) => {
            format!(", reached from rest after {cycles} cycles")
        }
        (Some(FromRest::Another), _) => {
            ", but starting from rest, the robot settles into a different motion (--from-rest)"
                .to_owned()
        }
        (Some(FromRest::Unsettled), _) => {
            ", but starting from rest, the robot does not settle".to_owned()
        }
        _ => String::new(),
    };
    symmetry.to_owned() + &reach
}
