//! Table that `simulate` prints.

use trilink_base::text::known;
use trilink_fit::simulate::{Answer, Interval, Setup};
use trilink_mechanics::{FromRest, MotionStatus, SharpLimit};
use trilink_robot::metrics::{Dimension, GaitMetrics, Metric, MetricDefinition};

use crate::cli::table::Table;
use crate::cli::terminal::Text;
use crate::template::fixed;

/// Decimals of lengths and speeds, of skid ratios, and of angles.
const DECIMALS: [usize; 3] = [4, 6, 5];

/// Line of the table.
#[derive(Default)]
struct Line {
    model: &'static str,
    omega: String,
    metrics: Option<GaitMetrics>,
    work: String,
    status: Text,
}

/// Prints a line for each solution, followed by lines with its confidence intervals and with the change in d as the
/// transition speed of dry friction goes to zero, if these are known.
pub(super) fn print(answers: &[Answer]) {
    let lines: Vec<Line> = answers.iter().flat_map(lines_of).collect();
    let mut table = Table::new(&lines)
        .left("model", |line| line.model)
        .right("omega rad/s", |line| &line.omega);
    for metric in answers.first().map(shown).unwrap_or_default() {
        let MetricDefinition { dimension, .. } = *metric.definition();
        let [length, ratio, angle] = DECIMALS;
        let (name, decimals) = match (dimension, dimension.units()[1]) {
            (Dimension::Ratio, _) => (metric.name().to_owned(), ratio),
            (Dimension::Length | Dimension::Speed, unit) => (format!("{metric} {unit}"), length),
            (Dimension::Angle, unit) => (format!("{metric} {unit}"), angle),
        };
        table = table.right(&name, |line| {
            line.metrics.map_or(String::new(), |metrics| fixed(metric.shown(&metrics), decimals))
        });
    }
    table.right("work J/m", |line| &line.work).prose("status", |line| line.status.clone()).print();
}

/// Returns the metrics that have a column: of a chain, not the ranges of its driven joints.
fn shown(answer: &Answer) -> Vec<Metric> {
    let Setup { robot, gait, .. } = answer.setup;
    let is_shown = |metric: &Metric| match Metric::ALPHA.iter().position(|one| one == metric) {
        Some(joint) if robot.as_chain().is_some() => robot.is_free(joint, gait),
        _ => robot.has_metric(*metric),
    };
    Metric::ALL.into_iter().filter(is_shown).collect()
}

/// Returns the line of a solution and the lines below it.
fn lines_of(answer: &Answer) -> Vec<Line> {
    let first = Line {
        model: answer.model.name(),
        omega: answer.omega_rad_s.to_string(),
        ..Line::default()
    };
    if let Some(reason) = &answer.reason {
        return vec![Line { status: Text::status(answer.status) + ": " + reason, ..first }];
    }
    let extrapolated = if answer.is_extrapolated() { ", extrapolated" } else { "" };
    let mut lines = vec![Line {
        metrics: Some(answer.metrics),
        work: known([answer.work_j_m], |[work]| fixed(work, 6)),
        status: Text::status(answer.status)
            + reach_in_words(answer.status, answer.from_rest, answer.cycles_to_settle)
            + extrapolated,
        ..first
    }];
    match &answer.interval {
        Some(Interval { no_interval: Some(why), .. }) => {
            lines.push(Line { status: format!("no intervals: {why}").into(), ..Line::default() });
        }
        Some(Interval { lower, upper, .. }) => {
            for (what, limits) in [("95 % from", lower), ("to", upper)] {
                let omega = what.to_owned();
                lines.push(Line { omega, metrics: Some(*limits), ..Line::default() });
            }
        }
        None => {}
    }
    if let Some(limit) = &answer.sharp_limit {
        let status = sharp_in_words(limit, answer.metrics.d_m);
        lines.push(Line { status: status.into(), ..Line::default() });
    }
    lines
}

/// Describes how a displacement changes as dry friction becomes discontinuous.
fn sharp_in_words(SharpLimit { metrics, uncertainty }: &SharpLimit, d_m: f64) -> String {
    format!(
        "d changes by {:+.2} % (\u{b1}{:.2}) as transition_m_s goes to zero",
        100.0 * (metrics.d_m - d_m) / d_m,
        100.0 * uncertainty.d_m / d_m,
    )
}

/// Describes the symmetry of a steady-state motion and whether the robot reaches it from rest.
fn reach_in_words(
    status: MotionStatus,
    from_rest: Option<FromRest>,
    cycles_to_settle: Option<usize>,
) -> String {
    let symmetry = match status {
        MotionStatus::SymmetryBroken => ": one of two mirror-image motions",
        _ => "",
    };
    let reach = match (from_rest, cycles_to_settle) {
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
