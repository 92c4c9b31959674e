//! Series of points for figures: measured and predicted quantities against frequency.

use std::collections::BTreeSet;

use trilink_base::text::interned;
use trilink_mechanics::Model;
use trilink_plot::{Layer, Look, Point};
use trilink_robot::metrics::{GaitMetrics, Metric};
use trilink_statistics::Estimate;
use trilink_statistics::HALF_WIDTH_95;
use trilink_tables::config::{GaitInput, ModelConfig, SigmaKind};
use trilink_tables::trial::TrialKind;
use trilink_tables::{
    ComparisonRow, FitRow, PredictionRow, PredictionSource, TrialRow, TrialStatus,
};

use crate::ReportInput;
use crate::looks::{self, ModelLook};

/// Maximum relative difference between the frequencies of a prediction and a trial that are treated as equal.
pub(crate) const SAME_FREQUENCY: f64 = 2e-3;

/// Metric that is plotted against frequency, with its labels in figures.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Quantity {
    pub metric: Metric,
    pub symbol: &'static str,
    pub title: &'static str,
    /// Name in the CSV files of figures, including the unit.
    pub csv_name: &'static str,
}

pub(crate) const DISPLACEMENT: Quantity = Quantity::new(Metric::D);
pub(crate) const SPEED: Quantity = Quantity::new(Metric::V);
pub(crate) const TURNING: Quantity = Quantity::new(Metric::Dtheta);
pub(crate) const AMPLITUDE: Quantity = Quantity::new(Metric::Alpha1);

/// Returns the metrics to which models are fitted in the order in which figures and pages show them: the skid ratios of
/// all wheels, then the amplitudes of all joints.
pub(crate) fn fitted() -> impl Iterator<Item = Metric> {
    [Metric::D, Metric::V].into_iter().chain(Metric::SIGMA).chain(Metric::ALPHA)
}

impl Quantity {
    pub(crate) const fn new(metric: Metric) -> Self {
        let of = metric.definition();
        Self { metric, symbol: of.symbol, title: of.title, csv_name: of.shown_column }
    }

    /// Creates a quantity with the name of the wheel's link in its title if it is a skid ratio; `links` are the names by
    /// number.
    pub(crate) fn of_links(metric: Metric, links: &[String]) -> Self {
        let wheel = Metric::SIGMA.iter().position(|sigma| *sigma == metric);
        let name = wheel.and_then(|wheel| Some((wheel, links.get(wheel)?)));
        let title = name.map(|(wheel, link)| interned(&format!("Wheel {wheel} ({link})")));
        let own = Self::new(metric);
        Self { title: title.unwrap_or(own.title), ..own }
    }

    pub(crate) fn is_skid(&self) -> bool {
        Metric::SIGMA.contains(&self.metric)
    }

    /// Returns the value of the quantity in the plotted unit (mm, mm/s or deg; none for skid ratios).
    pub(crate) fn of(&self, metrics: &GaitMetrics) -> f64 {
        self.metric.shown(metrics)
    }

    pub(crate) fn axis_label(&self) -> String {
        let named = format!("{} {}", self.metric.definition().label, self.symbol);
        if self.unit().is_empty() { named } else { format!("{named} ({})", self.unit()) }
    }

    /// Returns the plotted unit; empty for skid ratios.
    pub(crate) fn unit(&self) -> &'static str {
        self.metric.definition().dimension.units()[1]
    }

    /// Returns the unit with a leading space, to be appended to a number; empty if there is no unit.
    pub(crate) fn after_number(&self) -> String {
        if self.unit().is_empty() { String::new() } else { format!(" {}", self.unit()) }
    }

    /// Returns the measured value of the quantity in a trial, with the standard error; `sigma` selects the raw or the
    /// debiased skid ratios.
    pub(crate) fn of_trial(&self, trial: &TrialRow, sigma: SigmaKind) -> Estimate {
        let skid = trial.sigma(sigma);
        let metrics = GaitMetrics { sigma: skid.map(|sigma| sigma.value), ..trial.metrics };
        let errors = GaitMetrics { sigma: skid.map(|sigma| sigma.se), ..trial.metrics_se };
        Estimate { value: self.of(&metrics), se: self.of(&errors) }
    }
}

/// Measured or predicted quantity of a campaign against frequency (rad/s).
#[derive(Debug, Clone)]
pub(crate) struct Series {
    pub campaign: String,
    /// Model that predicts the quantity; `None` for measurements.
    pub model: Option<Model>,
    pub flagged: bool,
    /// Points in order of increasing frequency; NaN points are gaps.
    pub layer: Layer,
}

impl Series {
    /// Returns the name of the model, or `flagged` or `measured` for measurements. The layer's name can differ from it.
    pub(crate) fn name(&self) -> &'static str {
        self.model.map_or(if self.flagged { "flagged" } else { "measured" }, Model::name)
    }

    /// Returns the points of the series, without gaps.
    pub(crate) fn points(&self) -> impl Iterator<Item = &Point> {
        self.points_with_limits().map(|(point, ..)| point)
    }

    /// Returns the points of the series, without gaps, each with the name of its trial (empty if none) and the limits
    /// of its confidence interval (NaN if none).
    pub(crate) fn points_with_limits(&self) -> impl Iterator<Item = (&Point, &str, [f64; 2])> {
        let limits = |i: usize| self.layer.band.get(i).copied().unwrap_or([f64::NAN; 2]);
        let trial = |i: usize| self.layer.trials.get(i).map_or("", String::as_str);
        let all = self.layer.points.iter().enumerate();
        let all = all.map(move |(i, point)| (point, trial(i), limits(i)));
        all.filter(|(point, ..)| point.y.is_finite())
    }
}

/// Tables from which quantities are plotted against frequency.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Source<'t> {
    pub trials: &'t [TrialRow],
    pub predictions: &'t [PredictionRow],
    pub fits: &'t [FitRow],
    pub comparison: &'t [ComparisonRow],
    /// Kind of measured skid ratios that the fits use.
    pub sigma: SigmaKind,
    pub input: &'t ReportInput,
}

impl<'t> Source<'t> {
    /// Returns the colour and dashes for a model.
    pub(crate) fn look(self, model: Model) -> ModelLook {
        self.input.look(model)
    }

    /// Returns the names of the links of a campaign's robot by number.
    pub(crate) fn links(self, campaign: &str) -> Vec<String> {
        self.input.links(campaign)
    }

    /// Returns whether a model predicts skid ratios; true for models that are not configured.
    pub(crate) fn skids(self, model: Model) -> bool {
        self.input.models().get(&model).is_none_or(|model| model.laws().skids())
    }

    /// Returns whether the configuration drives a model by the gait measured in each trial, whichever
    /// gait input other models use; false for unknown models.
    pub(crate) fn is_of_trials(self, model: Model) -> bool {
        self.input.models().get(&model).is_some_and(ModelConfig::is_of_trials)
    }

    /// Returns the gait trials of a campaign, except failed ones.
    pub(crate) fn measured_trials(self, campaign: &str) -> impl Iterator<Item = &'t TrialRow> {
        self.trials
            .iter()
            .filter(move |trial| trial.campaign == campaign && trial.kind == TrialKind::Gait)
            .filter(|trial| trial.status.has_metrics())
    }

    /// Returns whether a campaign has measurements that can be plotted.
    pub(crate) fn has_measurements(self, campaign: &str) -> bool {
        self.measured_trials(campaign).any(|trial| trial.metrics.d_m.is_finite())
    }

    /// Returns the models that have predictions for a campaign, in the order used in legends.
    pub(crate) fn models(self, campaign: &str) -> BTreeSet<Model> {
        let rows = self.predictions.iter().filter(|row| row.campaign == campaign);
        rows.map(|row| row.model).collect()
    }

    /// Returns a campaign's preferred model among those with skid: the preferred model of the comparison if it has
    /// skid, otherwise the best-ranked model with skid (adequate models first, then by the selection criterion).
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

    /// Returns the predictions of a model for a campaign; `source` selects those at the trials' frequencies or those
    /// along the prediction curve.
    pub(crate) fn predicted(
        self,
        campaign: &str,
        model: Model,
        source: PredictionSource,
    ) -> impl Iterator<Item = &'t PredictionRow> {
        let rows = self.predictions.iter().filter(move |row| row.campaign == campaign);
        rows.filter(move |row| row.model == model && row.source == source)
    }

    /// Returns the measurements with error bars in order of increasing frequency: one series for the flagged trials if
    /// there are any, and one for the trials with status `ok`. `nth` is the index of the campaign in the panel.
    pub(crate) fn measured(self, campaign: &str, quantity: &Quantity, nth: usize) -> Vec<Series> {
        // The first series is drawn beneath the others.
        let looks = [(true, looks::flagged(nth)), (false, looks::measured(nth))];
        looks
            .into_iter()
            .filter_map(|(flagged, look)| self.measured_as(campaign, quantity, flagged, look))
            .collect()
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

    /// Returns the predictions of a model for the `nth` campaign in a panel; `None` if there are none. They are the
    /// prediction curve with its confidence band, interrupted where no stable motion exists; for a model that is
    /// plotted with markers, they are the predictions at the trials' frequencies.
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
        let mut band: Vec<[f64; 2]> =
            rows.iter().map(|row| [&row.lower, &row.upper].map(|of| shown(row, of))).collect();
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

    /// Returns the prediction of a model at the frequency of a trial; `None` if there is no such prediction.
    pub(crate) fn of_trial(self, trial: &TrialRow, model: Model) -> Option<&'t PredictionRow> {
        let rows = self.predicted(&trial.campaign, model, PredictionSource::Trial);
        let distance = |row: &&PredictionRow| (row.omega_rad_s - trial.omega_rad_s).abs();
        let nearest = rows.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        (distance(&nearest) < SAME_FREQUENCY * trial.omega_rad_s).then_some(nearest)
    }

    fn fits_of(self, campaign: &str) -> impl Iterator<Item = &'t FitRow> {
        self.fits.iter().filter(move |fit| fit.campaign == campaign)
    }

    /// Describes in words which gait input (the commanded or the measured gait) was used to fit models to campaigns,
    /// given pairs of campaign and model; empty if none of them has a fit. Models that are always driven by the
    /// measured gait of each trial are ignored.
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
                "commanded gait of some campaigns and the measured gait of others".to_owned()
            }
            _ if commanded.len() <= measured.len() => {
                format!("measured gait (commanded gait for {})", names(commanded))
            }
            _ => format!("commanded gait (measured gait for {})", names(measured)),
        }
    }
}

/// Creates a series from points (frequency, value, half-width of the error bar) in order of increasing frequency;
/// returns `None` if all values are gaps (NaN).
fn series(
    campaign: &str,
    model: Option<Model>,
    points: impl Iterator<Item = (f64, f64, f64)>,
    look: Look,
) -> Option<Series> {
    let mut layer = Layer::with_errors("", points, look);
    // A gap must not extend the range of the axes.
    for gap in layer.points.iter_mut().filter(|point| !point.y.is_finite()) {
        gap.x = f64::NAN;
    }
    let is_empty = layer.points.iter().all(|point| point.y.is_nan());
    let mut series = Series { campaign: campaign.to_owned(), model, flagged: false, layer };
    series.layer.name = series.name().to_owned();
    (!is_empty).then_some(series)
}
