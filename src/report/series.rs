//! What figures show: quantities of trials and predictions as series of points.

use std::collections::BTreeSet;

use crate::config::SigmaKind;
use crate::metrics::{Estimate, GaitMetrics};
use crate::motion::{Model, MotionStatus};
use crate::report::drawing::{Layer, Look, Point};
use crate::report::looks;
use crate::store::{PredictionRow, PredictionSource, TrialRow, TrialStatus};
use crate::trial::TrialKind;

/// Half-width of a 95 % interval in standard errors (normal distribution).
pub const BAR_STANDARD_ERRORS: f64 = 1.96;

/// A quantity that is plotted against the frequency.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    Displacement,
    Speed,
    /// Skid ratio of wheel 0, 1 or 2.
    Skid(usize),
    /// Of the swing of joint 1.
    Amplitude,
}

/// What figures call a quantity.
pub(super) struct Description {
    pub symbol: &'static str,
    pub axis_label: &'static str,
    pub title: &'static str,
    /// Name in the figures' CSV, with the unit.
    pub csv_name: &'static str,
    /// Unit as text puts it after a number.
    pub unit: &'static str,
    /// Plotted units (mm, mm/s, deg) in one of the tables' (m, m/s, rad).
    per_table_unit: f64,
}

impl Quantity {
    /// Every quantity that a model is judged by.
    pub const ALL: [Self; 6] = [
        Self::Displacement,
        Self::Speed,
        Self::Skid(0),
        Self::Skid(1),
        Self::Skid(2),
        Self::Amplitude,
    ];

    pub fn symbol(self) -> &'static str {
        self.description().symbol
    }

    pub(super) fn description(self) -> Description {
        let of = |symbol, axis_label, title, csv_name, unit, per_table_unit| Description {
            symbol,
            axis_label,
            title,
            csv_name,
            unit,
            per_table_unit,
        };
        const DEG: f64 = 180.0 / std::f64::consts::PI;
        match self {
            Self::Displacement => {
                of("d", "Displacement d (mm)", "Displacement per cycle", "d_mm", " mm", 1e3)
            }
            Self::Speed => of("v", "Mean speed v (mm/s)", "Mean speed", "v_mm_s", " mm/s", 1e3),
            Self::Skid(0) => of("σ₀", "Skid ratio σ₀", "Wheel 0 (middle)", "sigma0", "", 1.0),
            Self::Skid(1) => of("σ₁", "Skid ratio σ₁", "Wheel 1 (front)", "sigma1", "", 1.0),
            Self::Skid(_) => of("σ₂", "Skid ratio σ₂", "Wheel 2 (rear)", "sigma2", "", 1.0),
            Self::Amplitude => {
                of("α₁", "Amplitude α₁ (deg)", "Amplitude of joint 1", "alpha1_deg", " deg", DEG)
            }
        }
    }

    /// What a trial measured, and its standard error.
    pub fn of_trial(self, trial: &TrialRow, sigma: SigmaKind) -> Estimate {
        let skid = trial.sigma(sigma);
        let of = |metrics, skid| self.of(&GaitMetrics { sigma: skid, ..metrics });
        Estimate {
            value: of(trial.metrics, skid.map(|sigma| sigma.value)),
            se: of(trial.metrics_se, skid.map(|sigma| sigma.se)),
        }
    }

    /// In plotted units.
    pub fn of(self, metrics: &GaitMetrics) -> f64 {
        let value = match self {
            Self::Displacement => metrics.d_m,
            Self::Speed => metrics.v_m_s,
            Self::Skid(wheel) => metrics.sigma[wheel],
            Self::Amplitude => metrics.alpha1_rad,
        };
        value * self.description().per_table_unit
    }
}

/// Points that belong together: of the frequency, rad/s, and the quantity.
#[derive(Debug, Clone)]
pub struct Series {
    pub campaign: String,
    /// `measured` or the model's name.
    pub name: String,
    pub is_measured: bool,
    pub look: Look,
    /// By rising frequency; gaps are points that are not numbers.
    points: Vec<Point>,
}

impl Series {
    /// The points without the gaps.
    pub fn points(&self) -> impl Iterator<Item = &Point> {
        self.points.iter().filter(|point| point.y.is_finite())
    }

    /// What a panel shows of it under a name.
    pub fn layer(&self, name: String) -> Layer {
        Layer { name, points: self.points.clone(), look: self.look }
    }
}

/// The tables that figures are drawn from.
#[derive(Debug, Clone, Copy)]
pub struct Source<'t> {
    pub trials: &'t [TrialRow],
    pub predictions: &'t [PredictionRow],
    /// The measured skid ratios that the fits compare with.
    pub sigma: SigmaKind,
}

impl<'t> Source<'t> {
    /// Trials of a campaign that have metrics.
    pub fn measured_trials(self, campaign: &str) -> impl Iterator<Item = &'t TrialRow> {
        self.trials
            .iter()
            .filter(move |trial| trial.campaign == campaign && trial.kind == TrialKind::Gait)
            .filter(|trial| trial.status != TrialStatus::Failed)
    }

    /// Whether there is something to draw of a campaign.
    pub fn has_measurements(self, campaign: &str) -> bool {
        self.measured_trials(campaign).any(|trial| trial.metrics.d_m.is_finite())
    }

    /// Models that predict something of a campaign, in the order of legends.
    pub fn models(self, campaign: &str) -> BTreeSet<Model> {
        let rows = self.predictions.iter().filter(|row| row.campaign == campaign);
        rows.map(|row| row.model).collect()
    }

    /// Measurements with error bars, by rising frequency. Without any there is no series.
    pub fn measured(self, campaign: &str, quantity: Quantity, nth: usize) -> Option<Series> {
        let point = |trial: &TrialRow| {
            let Estimate { value, se } = quantity.of_trial(trial, self.sigma);
            let omega = trial.omega_rad_s;
            Point {
                x: if omega.is_finite() { omega } else { trial.omega_commanded_rad_s },
                y: value,
                error: BAR_STANDARD_ERRORS * se,
            }
        };
        let points = self.measured_trials(campaign).map(point);
        let points = points.filter(|point| point.x.is_finite() && point.y.is_finite());
        self.series(campaign, "measured", looks::measured(nth), points.collect())
    }

    /// What a model predicts: its curve, broken where no stable motion was found, or where the
    /// model is shown by markers, its values at the trials' frequencies.
    pub fn model(
        self,
        campaign: &str,
        model: Model,
        quantity: Quantity,
        nth: usize,
    ) -> Option<Series> {
        let look = looks::model_of_campaign(model, nth);
        let source = match look {
            Look::Marker { .. } => PredictionSource::Trial,
            _ => PredictionSource::Curve,
        };
        let rows = self.predictions.iter().filter(|row| row.campaign == campaign);
        let rows = rows.filter(|row| row.model == model && row.source == source);
        let point = |row: &PredictionRow| {
            let y = match row.status == MotionStatus::Stable {
                true => quantity.of(&row.metrics),
                false => f64::NAN,
            };
            Point { x: row.omega_rad_s, y, error: f64::NAN }
        };
        self.series(campaign, model.name(), look, rows.map(point).collect())
    }

    fn series(
        self,
        campaign: &str,
        name: &str,
        look: Look,
        mut points: Vec<Point>,
    ) -> Option<Series> {
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        // Axes do not go to where there is a gap.
        for gap in points.iter_mut().filter(|point| !point.y.is_finite()) {
            gap.x = f64::NAN;
        }
        let (campaign, is_measured) = (campaign.to_owned(), name == "measured");
        let series = Series { campaign, name: name.to_owned(), is_measured, look, points };
        Some(series).filter(|series| series.points().next().is_some())
    }
}
