//! Results of the user's trials and of the fits to them, from the tables in `derived/`.

use std::sync::Arc;

use minijinja::Error;
use minijinja::value::{Object, Serde, Value, ValueKind};
use trilink_base::Named as _;
use trilink_mechanics::MotionStatus;
use trilink_robot::metrics::{ByMetric, GaitMetrics};
use trilink_robot::{Model, Parameter};
use trilink_statistics::{self, HALF_WIDTH_95, wrap};
use trilink_tables::config::{Config, GaitInput, SigmaKind};
use trilink_tables::{FitRow, PredictionSource, Sharing, TrialRow};

use super::curve::{Curve, Point};
use super::missing::{NO_TRIALS, missing, unknown};
use super::verdict::Found;
use crate::tables::Tables;

/// Maximum relative difference between the frequency of a trial and a frequency stated in the paper, for the two to be
/// treated as equal.
const MAX_DEVIATION: f64 = 0.02;
/// Model for which the paper prints fitted coefficients.
const FITTED_MODEL: Model = Model::SKID_ROLL;

const NO_FIT: &str = "The tables contain no fit for this claim.";

/// Tables of the user's trials, and the kind of skid ratio to be used.
#[derive(Debug)]
pub(super) struct Trials {
    pub tables: Arc<Tables>,
    pub sigma: SigmaKind,
}

impl Object for Trials {}

/// Returns the value in a column of a row, or in a nested field of a column (`path`); true is 1 and false is 0.
fn column_of(row: &impl serde::Serialize, path: &str) -> Result<f64, Error> {
    let mut value = Value::from(Serde(row));
    for name in path.split('.') {
        value = value.get_attr(name)?;
    }
    match value.kind() {
        ValueKind::Bool => Ok(f64::from(u8::from(value.is_true()))),
        ValueKind::None => Ok(f64::NAN),
        _ => f64::try_from(value),
    }
}

/// Returns a finite value, or an error with the reason `lacking` if the value is not finite.
fn finite(value: f64, lacking: &'static str) -> Result<f64, Error> {
    if value.is_finite() { Ok(value) } else { Err(missing(lacking)) }
}

impl Trials {
    /// Returns the gait trials of a campaign that have results.
    fn usable(&self, campaign: &str) -> impl Iterator<Item = &TrialRow> {
        let of = self.tables.trials.iter().filter(move |row| row.campaign == campaign);
        of.filter(|row| {
            let GaitMetrics { d_m, v_m_s, .. } = row.metrics;
            row.status.has_metrics() && d_m.is_finite() && v_m_s.is_finite()
        })
    }

    /// Returns the trials of a campaign that have results and whose commanded frequency agrees with a frequency stated
    /// in the paper.
    fn near(&self, campaign: &str, omega_rad_s: f64) -> Vec<&TrialRow> {
        self.usable(campaign)
            .filter(|row| is_near(row.omega_commanded_rad_s, omega_rad_s))
            .collect()
    }

    /// Returns the mean metrics of a campaign's trials at each commanded frequency, by which the table of trials must
    /// be sorted.
    fn points(&self, campaign: &str) -> Vec<Point> {
        let rows: Vec<&TrialRow> = self.usable(campaign).collect();
        let groups = rows.chunk_by(|a, b| a.omega_commanded_rad_s == b.omega_commanded_rad_s);
        groups
            .map(|group| {
                let metrics = |row: &&TrialRow| {
                    let sigma = row.sigma(self.sigma).map(|sigma| sigma.value);
                    GaitMetrics { sigma, ..row.metrics }
                };
                let all: Vec<GaitMetrics> = group.iter().map(metrics).collect();
                let mean = |of| trilink_statistics::mean(all.iter().map(|metrics| metrics[of]));
                let metrics = ByMetric::<f64>::from_fn(mean).into();
                Point::from_metrics(group[0].omega_commanded_rad_s, metrics)
            })
            .collect()
    }

    /// Returns the mean of a quantity over the trials at the commanded frequency closest to `omega` (rad/s), a
    /// frequency stated in the paper; returns an error if none is within [`MAX_DEVIATION`].
    pub(super) fn mean_at(&self, campaign: &str, omega: f64, quantity: &str) -> Result<f64, Error> {
        let points = self.points(campaign).into_iter();
        let off = |point: &Point| (point.omega_rad_s - omega).abs();
        let near = points.filter(|point| is_near(point.omega_rad_s, omega));
        let nearest = near.min_by(|a, b| off(a).total_cmp(&off(b)));
        nearest.ok_or_else(|| missing(NO_TRIALS))?.get(quantity)
    }

    /// Returns the mean of a quantity over the trials of a campaign as a function of commanded frequency.
    pub(super) fn means(&self, campaign: &str, quantity: &str) -> Result<Value, Error> {
        Curve::from_points(&self.points(campaign), quantity, true)
    }

    /// Returns the mean displacement per cycle (mm) in the trials near a frequency stated in the paper, with its 95 %
    /// confidence interval.
    pub(super) fn travelled_mm(&self, campaign: &str, omega_rad_s: f64) -> Result<Value, Error> {
        let trials = self.near(campaign, omega_rad_s);
        let value = 1e3 * trilink_statistics::mean(trials.iter().map(|row| row.metrics.d_m));
        let variances = trials.iter().map(|row| row.metrics_se.d_m.powi(2));
        let half = 1e3 * HALF_WIDTH_95 * variances.sum::<f64>().sqrt() / trials.len() as f64;
        let limits = half.is_finite().then_some([value - half, value + half]);
        Ok(Value::from_object(Found { limits, ..Found::new(finite(value, NO_TRIALS)?) }))
    }

    /// Returns the mean phase (degrees) by which phi2 lags phi1 in the trials near a frequency stated in the paper.
    pub(super) fn mean_lag_deg(&self, campaign: &str, omega_rad_s: f64) -> Result<f64, Error> {
        let trials = self.near(campaign, omega_rad_s);
        // The phases are close together, so the mean is taken relative to the first phase.
        let lag = |row: &TrialRow| row.gait[0].phase_rad - row.gait[1].phase_rad;
        let first = lag(trials.first().ok_or_else(|| missing(NO_TRIALS))?);
        let off = trilink_statistics::mean(trials.iter().map(|row| wrap(lag(row) - first)));
        Ok((first + off).to_degrees())
    }

    /// Returns the largest deviation (degrees) of a measured joint offset or amplitude from the paper's command, over
    /// all commanded joints and all trials near a frequency stated in the paper.
    pub(super) fn off_command_deg(&self, campaign: &str, omega_rad_s: f64) -> Result<f64, Error> {
        let setup = Config::default().campaign_setup(campaign);
        let (_, gait) = setup.ok_or_else(|| unknown(campaign))?;
        let off = |row: &TrialRow| {
            let commands = gait.joints.iter().zip(row.gait);
            let off = commands.filter_map(|(joint, found)| {
                let joint = (*joint)?;
                let off = (found.offset_rad - joint.offset_rad).abs();
                Some(off.max((found.amplitude_rad - joint.amplitude_rad).abs()))
            });
            off.fold(0.0, f64::max).to_degrees()
        };
        let off = self.near(campaign, omega_rad_s).into_iter().map(off);
        off.max_by(f64::total_cmp).ok_or_else(|| missing(NO_TRIALS))
    }

    /// Returns the mean of a table column over the joint-release and coast-down trials of a robot.
    pub(super) fn robot(&self, robot: &str, column: &str) -> Result<f64, Error> {
        let rows = self.tables.robots.iter().filter(|row| row.robot == robot);
        let values = rows.map(|row| column_of(row, column)).collect::<Result<Vec<f64>, _>>()?;
        let mean = trilink_statistics::mean(values.into_iter().filter(|value| value.is_finite()));
        finite(mean, "The tables contain no joint-release or coast-down trial of this robot.")
    }

    /// Returns the fit of a model to a campaign under the commanded gait, as in the paper, or under the measured gait
    /// for [`Model::NO_SKID_MEASURED`], which has no other fit.
    fn fit_of(&self, campaign: &str, model: &str) -> Result<&FitRow, Error> {
        let Tables { fits, alternative_fits, .. } = &*self.tables;
        let mut fits = fits.iter().chain(alternative_fits).filter(|fit| {
            fit.gait_input == GaitInput::Commanded || fit.model == Model::NO_SKID_MEASURED
        });
        let fit = fits.find(|fit| fit.campaign == campaign && fit.model.name() == model);
        fit.filter(|fit| fit.status.is_ok()).ok_or_else(|| missing(NO_FIT))
    }

    /// Returns a free coefficient of the fit of [`FITTED_MODEL`] to a campaign, with its 95 % confidence interval.
    pub(super) fn coefficient(&self, campaign: &str, parameter: &str) -> Result<Value, Error> {
        self.free_coefficient(campaign, parameter).map(Value::from_object)
    }

    /// Divides a free coefficient of [`FITTED_MODEL`], fitted to `campaign`, by the same coefficient fitted to `over`;
    /// returns the ratio with its 95 % confidence interval. The errors of the two fits are taken as independent.
    pub(super) fn coefficient_ratio(
        &self,
        campaign: &str,
        over: &str,
        parameter: &str,
    ) -> Result<Value, Error> {
        let [of, over] = [campaign, over].map(|name| self.free_coefficient(name, parameter));
        let of = of?;
        let over = over?;
        let value = of.value / over.value;
        let limits = of.limits.zip(over.limits).map(|([low, high], [over_low, over_high])| {
            let side =
                |own: f64, other: f64| (own / of.value).ln().hypot((other / over.value).ln()).exp();
            [value / side(low, over_high), value * side(high, over_low)]
        });
        Ok(Value::from_object(Found { limits, ..Found::new(value) }))
    }

    /// Returns 1 if a model's fits reject a common set of coefficients for all campaigns of a robot, and 0 if they
    /// accept it.
    pub(super) fn is_refused(&self, robot: &str, model: &str) -> Result<f64, Error> {
        let mut rows = self.tables.shared_fits.iter();
        let row = rows.find(|row| row.robot == robot && row.fit.model.name() == model);
        let row = row.filter(|row| row.fit.gait_input == GaitInput::Commanded);
        let sharing = row.and_then(|row| row.fit.sharing).ok_or_else(|| missing(NO_FIT))?;
        Ok(f64::from(u8::from(sharing == Sharing::Refused)))
    }

    fn free_coefficient(&self, campaign: &str, parameter: &str) -> Result<Found, Error> {
        let parameter = Parameter::of_name(parameter).ok_or_else(|| unknown(parameter))?;
        let fit = self.fit_of(campaign, FITTED_MODEL.name())?;
        if !fit.free.contains(&parameter) {
            return Err(missing(NO_FIT));
        }
        let limits = [fit.lower[parameter], fit.upper[parameter]];
        let limits = limits.iter().any(|limit| limit.is_finite()).then_some(limits);
        Ok(Found { limits, ..Found::new(fit.parameters[parameter]) })
    }

    /// Returns the value in a table column for the fit of a model to a campaign.
    pub(super) fn fitted(&self, campaign: &str, model: &str, column: &str) -> Result<f64, Error> {
        finite(column_of(self.fit_of(campaign, model)?, column)?, NO_FIT)
    }

    /// Returns the fraction of a campaign's trials at whose frequencies a model has a steady-state motion.
    pub(super) fn existing_share(&self, campaign: &str, model: &str) -> Result<f64, Error> {
        let rows = self.tables.predictions.iter();
        let rows = rows.filter(|row| row.source == PredictionSource::Trial);
        let rows = rows.filter(|row| row.campaign == campaign && row.model.name() == model);
        let exists = rows.map(|row| {
            let exists = row.status.is_stable() || row.status == MotionStatus::Unstable;
            f64::from(u8::from(exists))
        });
        finite(trilink_statistics::mean(exists), NO_FIT)
    }
}

fn is_near(omega_rad_s: f64, printed_rad_s: f64) -> bool {
    (omega_rad_s - printed_rad_s).abs() <= MAX_DEVIATION * printed_rad_s
}
