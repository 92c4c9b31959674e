//! Finds values that cannot be in the units of their columns, for example because of typing errors.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use trilink_robot::metrics::{Dimension, Metric};
use trilink_statistics::median;
use trilink_tables::TrialRow;
use trilink_tables::config::Config;

use super::Problems;

/// Maximum plausible displacement per cycle, as a multiple of the distance between the outer wheels.
const MAX_LENGTHS: f64 = 5.0;
/// Maximum plausible skid ratio.
const MAX_SIGMA: f64 = 3.0;
/// Maximum plausible standard error of a skid ratio.
const MAX_SIGMA_SE: f64 = 1.0;
/// Maximum factor by which v may differ from `d / T` (T is the period) in the median over the rows: values read off two
/// figures do not agree exactly.
const MAX_TIMES: f64 = 1.1;
/// Maximum factor by which v may differ from `d / T` (T is the period) in any single row.
const MAX_TIMES_OF_ONE: f64 = 1.5;

/// Ratios of v to `d / T`, where T is the period, each with the likely mistake that causes it.
const MISTAKES: [(f64, &str); 7] = [
    (TAU, "is omega_rad_s in Hz?"),
    (TAU / 60.0, "is omega_rad_s in revolutions per minute?"),
    (TAU / 360.0, "is omega_rad_s in degrees per second?"),
    (1e2, "is v_m_s in cm/s?"),
    (1e3, "is v_m_s in mm/s?"),
    (1e-2, "is d_m in centimetres?"),
    (1e-3, "is d_m in millimetres?"),
];

/// Finds values of the trials to be fitted that are probably in a wrong unit. `fitted` has each trial with its row
/// index.
pub(super) fn mistakes(fitted: &[(usize, &TrialRow)], config: &Config) -> Problems {
    [too_large(fitted, config), speed_and_displacement(fitted), errors(fitted)].concat()
}

/// Finds values that are too large; each column is reported once.
fn too_large(fitted: &[(usize, &TrialRow)], config: &Config) -> Problems {
    let mut found: BTreeMap<String, (usize, String, usize)> = BTreeMap::new();
    for &(row, trial) in fitted {
        for (column, value, max, mistake) in limits(trial, config) {
            if value.abs() > max {
                let (.., count) = found.entry(column).or_insert_with(|| {
                    let problem = format!(
                        "found `{value}`, but values above {max:.4} are implausible: {mistake}"
                    );
                    (row, problem, 0)
                });
                *count += 1;
            }
        }
    }
    found
        .into_iter()
        .map(|(column, (row, problem, count))| {
            let rows = if count > 1 { format!(" ({count} rows)") } else { String::new() };
            (Some(row), format!("column `{column}`: {problem}{rows}"))
        })
        .collect()
}

/// Lists the columns of a trial with the trial's value, the largest plausible value, and the likely mistake if the
/// value is larger.
fn limits(trial: &TrialRow, config: &Config) -> Vec<(String, f64, f64, &'static str)> {
    const LENGTH: &str = "is the value in centimetres or millimetres?";
    const SPEED: &str = "is the value in cm/s or mm/s, or is omega_rad_s in Hz?";
    const RATIO: &str = "is the value in percent?";
    const ANGLE: &str = "is the value in degrees?";
    let max_m = match config.campaign_setup(&trial.campaign) {
        Some((robot, _)) => MAX_LENGTHS * robot.reach_m().iter().sum::<f64>(),
        None => f64::INFINITY,
    };
    let metrics = Metric::ALL.into_iter().map(|metric| {
        let definition = metric.definition();
        let (max, mistake) = match definition.dimension {
            Dimension::Length => (max_m, LENGTH),
            Dimension::Speed => (max_m * trial.omega_rad_s / TAU, SPEED),
            Dimension::Ratio => (MAX_SIGMA, RATIO),
            Dimension::Angle => (if definition.is_size { PI } else { TAU }, ANGLE),
        };
        (definition.column.to_owned(), trial.metrics[metric], max, mistake)
    });
    let errors = Metric::SIGMA.into_iter().map(|metric| {
        (format!("{}_se", metric.column()), trial.metrics_se[metric], MAX_SIGMA_SE, RATIO)
    });
    let debiased = Metric::SIGMA.into_iter().filter_map(|metric| metric.definition().debiased);
    let debiased = debiased
        .zip(&trial.sigma_debiased)
        .map(|(column, sigma)| (column.to_owned(), sigma.value, MAX_SIGMA, RATIO));
    let joints = (1..).zip(&trial.gait).flat_map(|(joint, gait)| {
        [
            (format!("phi{joint}_offset_rad"), gait.offset_rad, PI, ANGLE),
            (format!("phi{joint}_amplitude_rad"), gait.amplitude_rad, PI, ANGLE),
            (format!("phi{joint}_phase_rad"), gait.phase_rad, TAU, ANGLE),
        ]
    });
    metrics.chain(errors).chain(debiased).chain(joints).collect()
}

/// Checks that v equals `d / T`, where T is the period. Returns a single problem if this is wrong in most rows,
/// otherwise one problem for each wrong row.
fn speed_and_displacement(fitted: &[(usize, &TrialRow)]) -> Problems {
    let given: Vec<&(usize, &TrialRow)> = fitted
        .iter()
        .filter(|(_, trial)| {
            trial.metrics.d_m > 0.0 && trial.metrics.v_m_s > 0.0 && trial.omega_rad_s > 0.0
        })
        .collect();
    let usual = median(given.iter().map(|(_, trial)| speed_ratio(trial)).collect());
    if usual.is_nan() || is_about(usual, 1.0, MAX_TIMES) {
        let wrong = given
            .into_iter()
            .filter(|(_, trial)| !is_about(speed_ratio(trial), 1.0, MAX_TIMES_OF_ONE));
        return wrong
            .map(|(row, trial)| {
                let TrialRow { metrics, omega_rad_s, .. } = trial;
                let problem = format!(
                    "columns `d_m`, `v_m_s`: found `{}` and `{}` at {omega_rad_s} rad/s, but v should be d divided by \
                     the period, that is, {:.4}",
                    metrics.d_m,
                    metrics.v_m_s,
                    metrics.d_m / period_s(trial)
                );
                (Some(*row), problem)
            })
            .collect();
    }
    let exchanged = given
        .iter()
        .map(|(_, trial)| trial.metrics.d_m * period_s(trial) / trial.metrics.v_m_s)
        .collect();
    let mistake = MISTAKES.into_iter().find(|(ratio, _)| is_about(usual, *ratio, MAX_TIMES));
    let mistake = match mistake {
        Some((_, mistake)) => mistake,
        None if is_about(median(exchanged), 1.0, MAX_TIMES) => "are these columns swapped?",
        None => "omit column `v_m_s` if it contains another speed",
    };
    vec![(
        None,
        format!(
            "columns `d_m`, `v_m_s`: v should equal d divided by the period (2 pi / omega_rad_s), but v is {usual:.4} \
             times that quotient (median of {} rows): {mistake}",
            given.len()
        ),
    )]
}

fn period_s(trial: &TrialRow) -> f64 {
    TAU / trial.omega_rad_s
}

/// Returns the ratio of v to `d / T`, where T is the period; it is 1 if the two columns are consistent.
fn speed_ratio(trial: &TrialRow) -> f64 {
    trial.metrics.v_m_s * period_s(trial) / trial.metrics.d_m
}

/// Returns whether the ratio of two values lies between `1 / max_factor` and `max_factor`.
fn is_about(value: f64, other: f64, max_factor: f64) -> bool {
    (1.0 / max_factor..=max_factor).contains(&(value / other))
}

/// Finds standard errors of d and v that exceed the values themselves in most rows.
fn errors(fitted: &[(usize, &TrialRow)]) -> Problems {
    let mut problems = Problems::new();
    for metric in [Metric::D, Metric::V] {
        let column = metric.column();
        let ratios: Vec<f64> = fitted
            .iter()
            .map(|(_, trial)| trial.metrics_se[metric] / trial.metrics[metric])
            .filter(|ratio| ratio.is_finite())
            .collect();
        let count = ratios.len();
        let usual = median(ratios);
        if usual > 1.0 {
            let problem = format!(
                "column `{column}_se`: the standard errors are {usual:.4} times the values in `{column}` (median of \
                 {count} rows), but should be smaller than these: are they in millimetres or percent?"
            );
            problems.push((None, problem));
        }
    }
    problems
}
