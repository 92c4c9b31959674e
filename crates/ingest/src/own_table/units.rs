//! Numbers that cannot be in the units of their columns: the mistakes of whoever typed them in.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use trilink_robot::metrics::{Dimension, Metric};
use trilink_statistics::median;
use trilink_tables::TrialRow;
use trilink_tables::config::Config;

use super::Problems;

/// No robot gets further in a cycle than so many times the distance of its outer wheels.
const MOST_LENGTHS: f64 = 5.0;
/// No robot skids faster than so many times `l omega`.
const MOST_SIGMA: f64 = 3.0;
/// A standard error of it of a larger part says nothing.
const MOST_SIGMA_SE: f64 = 1.0;
/// How many times as large as d over the period v may be, or as small, in most rows and in one: numbers that
/// are read off two figures differ.
const MOST_TIMES: f64 = 1.1;
const MOST_TIMES_OF_ONE: f64 = 1.5;

/// What makes v so many times d over the period.
const MISTAKES: [(f64, &str); 7] = [
    (TAU, "is omega_rad_s in Hz?"),
    (TAU / 60.0, "is omega_rad_s in revolutions per minute?"),
    (TAU / 360.0, "is omega_rad_s in degrees per second?"),
    (1e2, "is v_m_s in cm/s?"),
    (1e3, "is v_m_s in mm/s?"),
    (1e-2, "is d_m in centimetres?"),
    (1e-3, "is d_m in millimetres?"),
];

/// Finds them in the rows that are to be fitted, each with its number.
pub(super) fn mistakes(fitted: &[(usize, &TrialRow)], config: &Config) -> Problems {
    [too_large(fitted, config), speed_and_displacement(fitted), errors(fitted)].concat()
}

/// What is too large, once for a column.
fn too_large(fitted: &[(usize, &TrialRow)], config: &Config) -> Problems {
    let mut found: BTreeMap<String, (usize, String, usize)> = BTreeMap::new();
    for &(row, trial) in fitted {
        let too_large =
            limits(trial, config).into_iter().filter(|(_, value, most, _)| value.abs() > *most);
        for (column, value, most, mistake) in too_large {
            let problem = || format!("found `{value}`, needed {most:.4} at most: {mistake}");
            found.entry(column).or_insert_with(|| (row, problem(), 0)).2 += 1;
        }
    }
    let problem = |(column, (row, problem, count)): (String, (usize, String, usize))| {
        let rows = if count > 1 { format!(" ({count} rows)") } else { String::new() };
        (Some(row), format!("column `{column}`: {problem}{rows}"))
    };
    found.into_iter().map(problem).collect()
}

/// Columns of a trial with its value, the largest there can be, and what may be wrong with a larger one.
fn limits(trial: &TrialRow, config: &Config) -> Vec<(String, f64, f64, &'static str)> {
    const LENGTH: &str = "is it in centimetres or millimetres?";
    const SPEED: &str = "is it in cm/s or mm/s, or omega_rad_s in Hz?";
    const RATIO: &str = "is it in percent?";
    const ANGLE: &str = "is it in degrees?";
    let most_m = match config.campaign_setup(&trial.campaign) {
        Some((robot, _)) => MOST_LENGTHS * 2.0 * (robot.h_m + robot.l_m),
        None => f64::INFINITY,
    };
    let of_metric = |metric: Metric| {
        let definition = metric.definition();
        let (most, mistake) = match definition.dimension {
            Dimension::Length => (most_m, LENGTH),
            Dimension::Speed => (most_m * trial.omega_rad_s / TAU, SPEED),
            Dimension::Ratio => (MOST_SIGMA, RATIO),
            Dimension::Angle => (if definition.is_size { PI } else { TAU }, ANGLE),
        };
        (definition.column.to_owned(), trial.metrics[metric], most, mistake)
    };
    let metrics = Metric::ALL.into_iter().map(of_metric);
    let error =
        |of: Metric| (format!("{}_se", of.column()), trial.metrics_se[of], MOST_SIGMA_SE, RATIO);
    let errors = Metric::SIGMA.into_iter().map(error);
    let debiased = Metric::SIGMA.into_iter().filter_map(|of| of.definition().debiased);
    let debiased = debiased.zip(&trial.sigma_debiased);
    let debiased =
        debiased.map(|(column, sigma)| (column.to_owned(), sigma.value, MOST_SIGMA, RATIO));
    let joints = (1..).zip(&trial.gait).flat_map(|(joint, gait)| {
        let name = |of: &str| format!("phi{joint}_{of}_rad");
        [
            (name("offset"), gait.offset_rad, PI, ANGLE),
            (name("amplitude"), gait.amplitude_rad, PI, ANGLE),
            (name("phase"), gait.phase_rad, TAU, ANGLE),
        ]
    });
    metrics.chain(errors).chain(debiased).chain(joints).collect()
}

/// v is d over the period: in most rows, or in each.
fn speed_and_displacement(fitted: &[(usize, &TrialRow)]) -> Problems {
    let is_given = |(_, trial): &&(usize, &TrialRow)| {
        trial.metrics.d_m > 0.0 && trial.metrics.v_m_s > 0.0 && trial.omega_rad_s > 0.0
    };
    let given = || fitted.iter().filter(is_given);
    let period_s = |trial: &TrialRow| TAU / trial.omega_rad_s;
    let times = |trial: &TrialRow| trial.metrics.v_m_s * period_s(trial) / trial.metrics.d_m;
    let exchanged = |trial: &TrialRow| trial.metrics.d_m * period_s(trial) / trial.metrics.v_m_s;
    let about = |value: f64, of: f64, most: f64| (1.0 / most..=most).contains(&(value / of));
    let middle =
        |of: &dyn Fn(&TrialRow) -> f64| median(given().map(|(_, trial)| of(trial)).collect());
    let usual = middle(&times);
    if usual.is_nan() || about(usual, 1.0, MOST_TIMES) {
        let wrong = given().filter(|(_, trial)| !about(times(trial), 1.0, MOST_TIMES_OF_ONE));
        let problem = |(row, trial): &(usize, &TrialRow)| {
            let TrialRow { metrics, omega_rad_s, .. } = trial;
            let problem = format!(
                "columns `d_m`, `v_m_s`: found `{}` and `{}` at {omega_rad_s} rad/s, needed a v that is d over the \
                 period, {:.4}",
                metrics.d_m,
                metrics.v_m_s,
                metrics.d_m / period_s(trial)
            );
            (Some(*row), problem)
        };
        return wrong.map(problem).collect();
    }
    let mistake = MISTAKES.into_iter().find(|(of, _)| about(usual, *of, MOST_TIMES));
    let mistake = match mistake {
        Some((_, mistake)) => mistake,
        None if about(middle(&exchanged), 1.0, MOST_TIMES) => "are these columns exchanged?",
        None => "leave v_m_s out if it is another speed",
    };
    vec![(
        None,
        format!(
            "columns `d_m`, `v_m_s`: found a v of {usual:.4} times d over the period (2 pi / omega_rad_s), the median \
             of {} rows, needed 1: {mistake}",
            given().count()
        ),
    )]
}

/// Standard errors of d and v that are larger than these, in most rows.
fn errors(fitted: &[(usize, &TrialRow)]) -> Problems {
    let of_metric = |metric: Metric| {
        let column = metric.column();
        let ratio =
            |(_, trial): &(usize, &TrialRow)| trial.metrics_se[metric] / trial.metrics[metric];
        let ratios: Vec<f64> = fitted.iter().map(ratio).filter(|ratio| ratio.is_finite()).collect();
        let (count, usual) = (ratios.len(), median(ratios));
        let problem = format!(
            "column `{column}_se`: found {usual:.4} times `{column}`, the median of {count} rows, needed 1 at most: \
             is it in millimetres or percent?"
        );
        (usual > 1.0).then_some((None, problem))
    };
    [Metric::D, Metric::V].into_iter().filter_map(of_metric).collect()
}
