//! What the trials at hand and the fits to them show: from the tables of `derived/`.

use serde::Deserialize;

use super::curve::Point;
use super::verdict::Found;
use crate::config::SigmaKind;
use crate::metrics::GaitMetrics;
use crate::motion::MotionStatus;
use crate::named::Named as _;
use crate::report::tables::Tables;
use crate::robot::{Gait, Model, Parameter};
use crate::stats::{self, wrap};
use crate::store::{PredictionSource, RobotParameterRow, TrialRow, TrialStatus};

/// Part of the printed frequency that a trial may be off.
const NEAR: f64 = 0.02;
/// Model whose coefficients the paper prints.
const FITTED_MODEL: Model = Model::SkidRoll;

/// What a release or a coast-down measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RobotQuantity {
    RestAngleDeg,
    DampingRatio,
    StiffnessNmRad,
    DampingNmSRad,
    RollSumKgS,
}

impl RobotQuantity {
    /// Mean over the trials of a robot that measure it.
    pub fn find(self, tables: &Tables, robot: &str) -> Option<f64> {
        let value = |row: &RobotParameterRow| match self {
            Self::RestAngleDeg => row.rest_angle_rad.value.to_degrees(),
            Self::DampingRatio => row.damping_ratio.value,
            Self::StiffnessNmRad => row.stiffness_nm_rad.value,
            Self::DampingNmSRad => row.damping_nm_s_rad.value,
            Self::RollSumKgS => row.roll_sum_kg_s.value,
        };
        let values = tables.robots.iter().filter(|row| row.robot == robot).map(value);
        mean(values.filter(|value| value.is_finite()))
    }
}

/// Part of an objective.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    J,
    JAlpha,
}

/// Mean; `None` of nothing.
fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values = values.peekable();
    values.peek()?;
    Some(stats::mean(values))
}

/// Trials of a campaign that have results.
fn trials<'t>(tables: &'t Tables, campaign: &str) -> impl Iterator<Item = &'t TrialRow> {
    let of = tables.trials.iter().filter(move |row| row.campaign == campaign);
    of.filter(|row| {
        let GaitMetrics { d_m, v_m_s, .. } = row.metrics;
        row.status != TrialStatus::Failed && d_m.is_finite() && v_m_s.is_finite()
    })
}

fn is_near(omega_rad_s: f64, printed_rad_s: f64) -> bool {
    (omega_rad_s - printed_rad_s).abs() <= NEAR * printed_rad_s
}

fn trials_near<'t>(tables: &'t Tables, campaign: &str, omega_rad_s: f64) -> Vec<&'t TrialRow> {
    let near = |row: &&TrialRow| is_near(row.omega_commanded_rad_s, omega_rad_s);
    trials(tables, campaign).filter(near).collect()
}

/// Means over the trials at each commanded frequency. (Tables come in its order.)
pub fn curve(tables: &Tables, campaign: &str, sigma: SigmaKind) -> Vec<Point> {
    let rows: Vec<&TrialRow> = trials(tables, campaign).collect();
    let groups = rows.chunk_by(|a, b| a.omega_commanded_rad_s == b.omega_commanded_rad_s);
    let mean_of = |group: &[&TrialRow]| {
        let metrics = |row: &&TrialRow| {
            let sigma = row.sigma(sigma).map(|sigma| sigma.value);
            GaitMetrics { sigma, ..row.metrics }.to_array()
        };
        let all: Vec<[f64; 7]> = group.iter().map(metrics).collect();
        let mean = |i: usize| stats::mean(all.iter().map(|metrics| metrics[i]));
        let metrics = GaitMetrics::from_array(std::array::from_fn(mean));
        Point::of_metrics(group[0].omega_commanded_rad_s, metrics)
    };
    groups.map(mean_of).collect()
}

/// The point nearest to a printed frequency.
pub fn nearest(curve: &[Point], omega_rad_s: f64) -> Option<&Point> {
    let near = curve.iter().filter(|point| is_near(point.omega_rad_s, omega_rad_s));
    let off = |point: &Point| (point.omega_rad_s - omega_rad_s).abs();
    near.min_by(|a, b| off(a).total_cmp(&off(b)))
}

/// Mean phase of phi1 after phi2 at a frequency.
pub fn lag_deg(tables: &Tables, campaign: &str, omega_rad_s: f64) -> Option<f64> {
    let trials = trials_near(tables, campaign, omega_rad_s);
    // The phases lie together: their mean may be taken about the first's.
    let lag = |row: &TrialRow| row.gait[0].phase_rad - row.gait[1].phase_rad;
    let first = lag(trials.first()?);
    let off = mean(trials.iter().map(|row| wrap(lag(row) - first)))?;
    Some((first + off).to_degrees())
}

/// Largest difference of a commanded joint's offset or amplitude from the command.
pub fn off_command_deg(
    tables: &Tables,
    campaign: &str,
    gait: &Gait,
    omega_rad_s: f64,
) -> Option<f64> {
    let off = |row: &TrialRow| {
        let commands = gait.joints.iter().zip(row.gait);
        let off = commands.filter_map(|(joint, found)| {
            let joint = (*joint)?;
            let off = (found.offset_rad - joint.offset_rad).abs();
            Some(off.max((found.amplitude_rad - joint.amplitude_rad).abs()))
        });
        off.fold(0.0, f64::max).to_degrees()
    };
    trials_near(tables, campaign, omega_rad_s).into_iter().map(off).max_by(f64::total_cmp)
}

/// A coefficient that a fit left free, with its interval.
pub fn fitted(tables: &Tables, campaign: &str, parameter: &str) -> Option<Found> {
    let parameter = Parameter::of_name(parameter)?;
    let mut fits = tables.fits.iter();
    let fit = fits.find(|fit| {
        fit.campaign == campaign && fit.model == FITTED_MODEL && fit.free.contains(&parameter)
    })?;
    let value = fit.parameters[parameter];
    let limits = [fit.lower[parameter], fit.upper[parameter]];
    let limits = limits.iter().any(|limit| limit.is_finite()).then_some(limits);
    Some(Found { limits, ..Found::new(value) })
}

/// A model's objective, or a part of it, over the largest of others.
pub fn objective_ratio(
    tables: &Tables,
    campaign: &str,
    model: Model,
    over: &[Model],
    part: Part,
) -> Option<f64> {
    let objective = |model: Model| {
        let mut rows = tables.comparison.iter();
        let row = rows.find(|row| row.campaign == campaign && row.model == model)?;
        let value = match part {
            Part::J => row.j,
            Part::JAlpha => row.j_alpha,
        };
        Some(value).filter(|value| value.is_finite())
    };
    let others = over.iter().map(|model| objective(*model)).collect::<Option<Vec<f64>>>()?;
    let worst = others.into_iter().fold(0.0, f64::max);
    (worst != 0.0).then_some(objective(model)? / worst)
}

/// Part of the trials at whose frequencies a model has a motion.
pub fn existing_share(tables: &Tables, campaign: &str, model: Model) -> Option<f64> {
    let rows = tables.predictions.iter().filter(|row| row.source == PredictionSource::Trial);
    let rows = rows.filter(|row| row.campaign == campaign && row.model == model);
    let exists = |status| matches!(status, MotionStatus::Stable | MotionStatus::Unstable);
    mean(rows.map(|row| f64::from(u8::from(exists(row.status)))))
}
