//! What figures show: quantities of trials and predictions as series of points.

use super::style::{self, Look};
use crate::config::SigmaKind;
use crate::store::{PredictionRow, TrialRow};

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
        match self {
            Self::Displacement => "d",
            Self::Speed => "v",
            Self::Skid(0) => "σ₀",
            Self::Skid(1) => "σ₁",
            Self::Skid(_) => "σ₂",
            Self::Amplitude => "α₁",
        }
    }

    pub fn axis_label(self) -> &'static str {
        match self {
            Self::Displacement => "Displacement d (mm)",
            Self::Speed => "Mean speed v (mm/s)",
            Self::Skid(0) => "Skid ratio σ₀",
            Self::Skid(1) => "Skid ratio σ₁",
            Self::Skid(_) => "Skid ratio σ₂",
            Self::Amplitude => "Amplitude α₁ (deg)",
        }
    }

    pub fn title(self) -> &'static str {
        match self {
            Self::Displacement => "Displacement per cycle",
            Self::Speed => "Mean speed",
            Self::Skid(0) => "Wheel 0 (middle)",
            Self::Skid(1) => "Wheel 1 (front)",
            Self::Skid(_) => "Wheel 2 (rear)",
            Self::Amplitude => "Amplitude of joint 1",
        }
    }

    /// Name in the figures' CSV, with the unit.
    pub fn csv_name(self) -> &'static str {
        match self {
            Self::Displacement => "d_mm",
            Self::Speed => "v_mm_s",
            Self::Skid(0) => "sigma0",
            Self::Skid(1) => "sigma1",
            Self::Skid(_) => "sigma2",
            Self::Amplitude => "alpha1_deg",
        }
    }

    /// Unit as text puts it after a number.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Displacement => " mm",
            Self::Speed => " mm/s",
            Self::Skid(_) => "",
            Self::Amplitude => " deg",
        }
    }

    /// Plotted units (mm, mm/s, deg) in one of the tables' (m, m/s, rad).
    fn per_table_unit(self) -> f64 {
        match self {
            Self::Displacement | Self::Speed => 1000.0,
            Self::Skid(_) => 1.0,
            Self::Amplitude => 180.0 / std::f64::consts::PI,
        }
    }

    /// What a trial measured, and its standard error.
    pub fn of_trial(self, trial: &TrialRow, sigma: SigmaKind) -> (f64, f64) {
        let (value, error) = match self {
            Self::Displacement => (trial.d_m, trial.d_m_se),
            Self::Speed => (trial.v_m_s, trial.v_m_s_se),
            Self::Skid(wheel) => trial.sigma(sigma)[wheel],
            Self::Amplitude => (trial.alpha1_rad, trial.alpha1_rad_se),
        };
        (value * self.per_table_unit(), error * self.per_table_unit())
    }

    pub fn of_prediction(self, row: &PredictionRow) -> f64 {
        let value = match self {
            Self::Displacement => row.d_m,
            Self::Speed => row.v_m_s,
            Self::Skid(wheel) => row.metrics().sigma[wheel],
            Self::Amplitude => row.alpha1_rad,
        };
        value * self.per_table_unit()
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    pub omega_rad_s: f64,
    pub value: f64,
    /// Half-width of the 95 % interval.
    pub error: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Measured,
    Model,
}

/// Points that belong together.
#[derive(Debug, Clone)]
pub struct Series {
    pub campaign: String,
    /// `measured` or the model's name.
    pub name: String,
    /// As the legend calls it.
    pub label: String,
    pub kind: Kind,
    pub look: Look,
    /// Stretches without a gap.
    pub runs: Vec<Vec<Point>>,
}

impl Series {
    pub fn points(&self) -> impl Iterator<Item = &Point> {
        self.runs.iter().flatten()
    }

    fn is_empty(&self) -> bool {
        self.points().next().is_none()
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
            .filter(move |trial| trial.campaign == campaign && trial.kind == "gait")
            .filter(|trial| trial.status != "failed")
    }

    /// Whether there is something to draw of a campaign.
    pub fn has_measurements(self, campaign: &str) -> bool {
        self.measured_trials(campaign).any(|trial| trial.d_m.is_finite())
    }

    /// Models that predict something of a campaign, in the order of legends.
    pub fn models(self, campaign: &str) -> Vec<&'t str> {
        let rows = self.predictions.iter().filter(|row| row.campaign == campaign);
        let mut models: Vec<&str> = rows.map(|row| row.model.as_str()).collect();
        models.sort_by_key(|&model| (style::model_rank(model), model));
        models.dedup();
        models
    }

    /// Measurements with error bars, by rising frequency. Without any there is no series.
    pub fn measured(self, campaign: &str, quantity: Quantity, nth: usize) -> Option<Series> {
        let point = |trial: &TrialRow| {
            let (value, error) = quantity.of_trial(trial, self.sigma);
            let omega = trial.omega_rad_s;
            Point {
                omega_rad_s: if omega.is_finite() { omega } else { trial.omega_commanded_rad_s },
                value,
                error: Some(BAR_STANDARD_ERRORS * error).filter(|error| error.is_finite()),
            }
        };
        let mut run: Vec<Point> = self.measured_trials(campaign).map(point).collect();
        run.retain(|point| point.value.is_finite() && point.omega_rad_s.is_finite());
        run.sort_by(|a, b| a.omega_rad_s.total_cmp(&b.omega_rad_s));
        let series = Series {
            campaign: campaign.to_owned(),
            name: "measured".to_owned(),
            label: "measured".to_owned(),
            kind: Kind::Measured,
            look: style::measured(nth),
            runs: vec![run],
        };
        Some(series).filter(|series| !series.is_empty())
    }

    /// What a model predicts: its curve, broken where no stable motion was found, or where the
    /// model is shown by markers, its values at the trials' frequencies.
    pub fn model(
        self,
        campaign: &str,
        model: &str,
        quantity: Quantity,
        nth: usize,
    ) -> Option<Series> {
        let look = style::model_of_campaign(model, nth);
        let source = match look {
            Look::Line { .. } => "curve",
            Look::Marker { .. } => "trial",
        };
        let mut rows: Vec<_> = self
            .predictions
            .iter()
            .filter(|row| row.campaign == campaign && row.model == model && row.source == source)
            .collect();
        rows.sort_by(|a, b| a.omega_rad_s.total_cmp(&b.omega_rad_s));
        let point = |row: &&PredictionRow| {
            let value = quantity.of_prediction(row);
            (row.status == "stable" && value.is_finite()).then_some(Point {
                omega_rad_s: row.omega_rad_s,
                value,
                error: None,
            })
        };
        let points: Vec<Option<Point>> = rows.iter().map(point).collect();
        let runs = points.split(Option::is_none);
        let series = Series {
            campaign: campaign.to_owned(),
            name: model.to_owned(),
            label: model.to_owned(),
            kind: Kind::Model,
            look,
            runs: runs
                .map(|run| run.iter().copied().flatten().collect::<Vec<_>>())
                .filter(|run| !run.is_empty())
                .collect(),
        };
        Some(series).filter(|series| !series.is_empty())
    }
}
