//! What figures show: quantities of trials and predictions as series of points.

use std::collections::BTreeSet;

use trilink_mechanics::Model;
use trilink_plot::{Layer, Look, Point};
use trilink_robot::metrics::{GaitMetrics, Metric};
use trilink_statistics::Estimate;
use trilink_statistics::HALF_WIDTH_95;
use trilink_tables::config::{GaitInput, ModelConfig, Models, SigmaKind};
use trilink_tables::trial::TrialKind;
use trilink_tables::{
    ComparisonRow, FitRow, PredictionRow, PredictionSource, TrialRow, TrialStatus,
};

use crate::looks::{self, ModelLook};

/// Of a frequency: what is nearer to each other is of one trial.
pub(crate) const SAME_FREQUENCY: f64 = 2e-3;

/// A metric that is plotted against the frequency, and what figures call it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Quantity {
    pub metric: Metric,
    pub symbol: &'static str,
    pub title: &'static str,
    /// Name in the figures' CSV, with the unit.
    pub csv_name: &'static str,
}

pub(crate) const DISPLACEMENT: Quantity = Quantity::new(Metric::D);
pub(crate) const SPEED: Quantity = Quantity::new(Metric::V);
pub(crate) const TURNING: Quantity = Quantity::new(Metric::Dtheta);
pub(crate) const AMPLITUDE: Quantity = Quantity::new(Metric::Alpha1);
/// Of joint 2 as if it were the first.
pub(crate) const AMPLITUDE2: Quantity =
    Quantity {
        symbol: "α₂", title: "Amplitude of joint 2", csv_name: "alpha2_deg", ..AMPLITUDE
    };

/// Every quantity that a model is judged by.
pub(crate) fn fitted() -> [Quantity; Metric::FITTED.len()] {
    Metric::FITTED.map(Quantity::new)
}

impl Quantity {
    pub(crate) const fn new(metric: Metric) -> Self {
        let of = metric.definition();
        Self { metric, symbol: of.symbol, title: of.title, csv_name: of.shown_column }
    }

    pub(crate) fn is_skid(&self) -> bool {
        Metric::SIGMA.contains(&self.metric)
    }

    /// In plotted units (mm, mm/s, deg).
    pub(crate) fn of(&self, metrics: &GaitMetrics) -> f64 {
        self.metric.shown(metrics)
    }

    pub(crate) fn axis_label(&self) -> String {
        let named = format!("{} {}", self.metric.definition().label, self.symbol);
        if self.unit().is_empty() { named } else { format!("{named} ({})", self.unit()) }
    }

    /// The plotted unit; skid ratios have none.
    pub(crate) fn unit(&self) -> &'static str {
        self.metric.definition().dimension.units()[1]
    }

    /// The unit as text puts it after a number.
    pub(crate) fn after_number(&self) -> String {
        if self.unit().is_empty() { String::new() } else { format!(" {}", self.unit()) }
    }

    /// What a trial measured, and its standard error.
    pub(crate) fn of_trial(&self, trial: &TrialRow, sigma: SigmaKind) -> Estimate {
        let skid = trial.sigma(sigma);
        let of = |metrics, skid| self.of(&GaitMetrics { sigma: skid, ..metrics });
        Estimate {
            value: of(trial.metrics, skid.map(|sigma| sigma.value)),
            se: of(trial.metrics_se, skid.map(|sigma| sigma.se)),
        }
    }
}

/// Measurements or a model of a campaign against the frequency, rad/s.
#[derive(Debug, Clone)]
pub(crate) struct Series {
    pub campaign: String,
    /// None for measurements.
    pub model: Option<Model>,
    pub flagged: bool,
    /// By rising frequency; gaps are points that are not numbers.
    pub layer: Layer,
}

impl Series {
    /// What it is of, whatever the layer's name.
    pub(crate) fn name(&self) -> &'static str {
        self.model.map_or(if self.flagged { "flagged" } else { "measured" }, Model::name)
    }

    /// The points without the gaps.
    pub(crate) fn points(&self) -> impl Iterator<Item = &Point> {
        self.points_with_limits().map(|(point, ..)| point)
    }

    /// The same with the trials that they are of, if any, and the limits of their intervals; NaN
    /// where there is none.
    pub(crate) fn points_with_limits(&self) -> impl Iterator<Item = (&Point, &str, [f64; 2])> {
        let limits = |i: usize| self.layer.band.get(i).copied().unwrap_or([f64::NAN; 2]);
        let trial = |i: usize| self.layer.trials.get(i).map_or("", String::as_str);
        let all = self.layer.points.iter().enumerate();
        let all = all.map(move |(i, point)| (point, trial(i), limits(i)));
        all.filter(|(point, ..)| point.y.is_finite())
    }
}

/// The tables that figures are drawn from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Source<'t> {
    pub trials: &'t [TrialRow],
    pub predictions: &'t [PredictionRow],
    pub fits: &'t [FitRow],
    pub comparison: &'t [ComparisonRow],
    /// The measured skid ratios that the fits compare with.
    pub sigma: SigmaKind,
    pub models: &'t Models,
}

impl<'t> Source<'t> {
    /// How a model is shown.
    pub(crate) fn look(self, model: Model) -> ModelLook {
        ModelLook::new(model, self.models)
    }

    /// Whether a model says something of skid ratios.
    pub(crate) fn skids(self, model: Model) -> bool {
        self.models.get(&model).is_none_or(|model| model.laws().skids())
    }

    /// Whether a model is driven by each trial's own gait and no other.
    pub(crate) fn is_of_trials(self, model: Model) -> bool {
        self.models.get(&model).is_some_and(ModelConfig::is_of_trials)
    }

    /// Trials of a campaign that have metrics.
    pub(crate) fn measured_trials(self, campaign: &str) -> impl Iterator<Item = &'t TrialRow> {
        self.trials
            .iter()
            .filter(move |trial| trial.campaign == campaign && trial.kind == TrialKind::Gait)
            .filter(|trial| trial.status != TrialStatus::Failed)
    }

    /// Whether there is something to draw of a campaign.
    pub(crate) fn has_measurements(self, campaign: &str) -> bool {
        self.measured_trials(campaign).any(|trial| trial.metrics.d_m.is_finite())
    }

    /// Models that predict something of a campaign, in the order of legends.
    pub(crate) fn models(self, campaign: &str) -> BTreeSet<Model> {
        let rows = self.predictions.iter().filter(|row| row.campaign == campaign);
        rows.map(|row| row.model).collect()
    }

    /// Of a campaign's models that skid the preferred one; where the preferred model of all cannot
    /// skid the first of the others in the order of the comparison: adequate ones first, then by
    /// criterion.
    pub(crate) fn preferred_with_skid(self, campaign: &str) -> Option<Model> {
        let fit_of = |model: Model| self.fits_of(campaign).find(|fit| fit.model == model);
        let adequacy = |model: Model| match fit_of(model).and_then(|fit| fit.adequate) {
            Some(true) => 0,
            None => 1,
            Some(false) => 2,
        };
        let rows = self.comparison.iter().filter(|row| row.campaign == campaign);
        let ranked = rows.filter(|row| row.criterion.is_finite() && self.skids(row.model));
        let first = ranked.min_by(|a, b| {
            let key = |row: &ComparisonRow| (!row.preferred, adequacy(row.model));
            key(a).cmp(&key(b)).then(a.criterion.total_cmp(&b.criterion))
        });
        first.map(|row| row.model)
    }

    /// What a model predicts of a campaign, at the trials' frequencies or along its curve.
    pub(crate) fn predicted(
        self,
        campaign: &str,
        model: Model,
        source: PredictionSource,
    ) -> impl Iterator<Item = &'t PredictionRow> {
        let rows = self.predictions.iter().filter(move |row| row.campaign == campaign);
        rows.filter(move |row| row.model == model && row.source == source)
    }

    /// Measurements with error bars, by rising frequency, and apart from them those of flagged
    /// trials. Without any there is no series.
    pub(crate) fn measured(self, campaign: &str, quantity: &Quantity, nth: usize) -> Vec<Series> {
        let looks = [(false, looks::measured(nth)), (true, looks::flagged(nth))];
        let series = |(flagged, look)| self.measured_as(campaign, quantity, flagged, look);
        looks.into_iter().filter_map(series).collect()
    }

    fn measured_as(
        self,
        campaign: &str,
        quantity: &Quantity,
        flagged: bool,
        look: Look,
    ) -> Option<Series> {
        let point = |trial: &TrialRow| {
            let Estimate { value, se } = quantity.of_trial(trial, self.sigma);
            let omega = trial.omega_rad_s;
            let x = if omega.is_finite() { omega } else { trial.omega_commanded_rad_s };
            (x, value, HALF_WIDTH_95 * se)
        };
        let trials = self.measured_trials(campaign);
        let trials = trials.filter(|trial| flagged == (trial.status == TrialStatus::Flagged));
        let mut trials: Vec<_> = trials.map(|trial| (point(trial), &trial.trial)).collect();
        trials.retain(|((x, y, _), _)| x.is_finite() && y.is_finite());
        trials.sort_by(|(a, _), (b, _)| a.0.total_cmp(&b.0));
        let points = trials.iter().map(|(point, _)| *point);
        let mut series = series(campaign, None, points, look)?;
        series.flagged = flagged;
        series.layer.name = series.name().to_owned();
        series.layer.trials = trials.into_iter().map(|(_, trial)| trial.clone()).collect();
        Some(series)
    }

    /// What a model predicts: its curve with its band, broken where no stable motion was found, or
    /// where the model is shown by markers, its values at the trials' frequencies.
    pub(crate) fn model(
        self,
        campaign: &str,
        model: Model,
        quantity: &Quantity,
        nth: usize,
    ) -> Option<Series> {
        let look = self.look(model).of_campaign(nth);
        let source = match look {
            Look::Marker { .. } => PredictionSource::Trial,
            _ => PredictionSource::Curve,
        };
        let mut rows: Vec<&PredictionRow> = self.predicted(campaign, model, source).collect();
        rows.sort_by(|a, b| a.omega_rad_s.total_cmp(&b.omega_rad_s));
        let shown = |row: &PredictionRow, metrics: &GaitMetrics| {
            let is_stable = row.status.is_stable();
            if is_stable { quantity.of(metrics) } else { f64::NAN }
        };
        let limits = |row: &&PredictionRow| [&row.lower, &row.upper].map(|of| shown(row, of));
        let mut band: Vec<[f64; 2]> = rows.iter().map(limits).collect();
        if band.as_flattened().iter().all(|limit| limit.is_nan()) {
            band.clear();
        }
        let points = rows.iter().map(|row| (row.omega_rad_s, shown(row, &row.metrics), f64::NAN));
        let mut series = series(campaign, Some(model), points, look)?;
        series.layer.band = band;
        let mut fits = self.fits_of(campaign).filter(|fit| fit.model == model);
        if fits.any(|fit| fit.adequate == Some(false)) {
            series.layer.name.push_str(" (does not fit)");
        }
        Some(series)
    }

    /// What a model predicts of a trial: at its frequency.
    pub(crate) fn of_trial(self, trial: &TrialRow, model: Model) -> Option<&'t PredictionRow> {
        let rows = self.predicted(&trial.campaign, model, PredictionSource::Trial);
        let distance = |row: &&PredictionRow| (row.omega_rad_s - trial.omega_rad_s).abs();
        let nearest = rows.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        (distance(&nearest) < SAME_FREQUENCY * trial.omega_rad_s).then_some(nearest)
    }

    fn fits_of(self, campaign: &str) -> impl Iterator<Item = &'t FitRow> {
        self.fits.iter().filter(move |fit| fit.campaign == campaign)
    }

    /// The gait that drives the fits of models to campaigns, in words; empty where there is none.
    /// Models that are driven by each trial's measured gait whatever `[fit]` says are not counted.
    pub(crate) fn gait_input<'m>(
        self,
        shown: impl IntoIterator<Item = (&'m str, Model)>,
    ) -> String {
        let mut by_input = [BTreeSet::new(), BTreeSet::new()];
        for (campaign, model) in shown {
            let fit = self.fits_of(campaign).find(|fit| fit.model == model);
            let fit = fit.filter(|_| !self.is_of_trials(model));
            if let Some(fit) = fit {
                by_input[usize::from(fit.gait_input == GaitInput::Measured)].insert(model);
            }
        }
        let [commanded, measured] = &by_input;
        let names = |models: &BTreeSet<Model>| {
            models.iter().map(|model| model.name()).collect::<Vec<_>>().join(" and ")
        };
        match (commanded.is_empty(), measured.is_empty()) {
            (true, true) => String::new(),
            (false, true) => "commanded gait".to_owned(),
            (true, false) => "measured gait".to_owned(),
            _ if !commanded.is_disjoint(measured) => {
                "commanded gait of some campaigns and the measured one of others".to_owned()
            }
            _ if commanded.len() <= measured.len() => {
                format!("measured gait, {} under the commanded one", names(commanded))
            }
            _ => format!("commanded gait, {} under the measured one", names(measured)),
        }
    }
}

/// A series of points by rising frequency, if it has one.
fn series(
    campaign: &str,
    model: Option<Model>,
    points: impl Iterator<Item = (f64, f64, f64)>,
    look: Look,
) -> Option<Series> {
    let mut layer = Layer::with_errors("", points, look);
    // Axes do not go to where there is a gap.
    for gap in layer.points.iter_mut().filter(|point| !point.y.is_finite()) {
        gap.x = f64::NAN;
    }
    let is_empty = layer.points.iter().all(|point| point.y.is_nan());
    let mut series = Series { campaign: campaign.to_owned(), model, flagged: false, layer };
    series.layer.name = series.name().to_owned();
    (!is_empty).then_some(series)
}
