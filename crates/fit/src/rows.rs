//! Table rows for a fit.

use trilink_robot::metrics::{Metric, WeightKey};
use trilink_robot::{ByParameter, Parameter};
use trilink_tables::{
    BootstrapRow, Columns as _, ComparisonRow, FitNotes, FitRow, FitStatus, NoInterval,
    NoIntervalReason, ProfileRow, StartRow,
};

use super::Fitted;
use super::adequacy::Adequacy;
use super::bands::Bands;
use super::criterion::criterion;
use super::fitted_point::HeldPoint;
use super::input::FreeParameter;
use super::intervals::{Intervals, StandardUncertainty};
use super::job::{Fit, Job};
use super::objective::Failure;
use super::predict::{predictions, residuals};
use super::profile::Class;
use super::robots::Robots;
use super::starts::Start;

/// Relative difference from the best objective within which a start counts as having reached the minimum.
const REACHED_TOLERANCE: f64 = 1e-6;

impl Job<'_> {
    /// Returns the table row for a fit.
    pub(super) fn row(&self, fit: &Fit, starts: &[Start], motions: Result<(), Failure>) -> FitRow {
        let Fit { point, cost, resumed, solves, profiles, .. } = fit;
        let parameters = &point.evaluator.parameters;
        let robots = self.objective.robots.with_values(parameters, &point.values);
        let free: Vec<Parameter> = parameters.iter().map(|free| free.parameter).collect();
        let with_class = |class: Class| {
            let pairs = free.iter().zip(profiles);
            pairs.filter(|(_, profile)| profile.class == class).map(|(free, _)| *free).collect()
        };
        let measured = self.measured.iter().copied();
        let measured = measured.filter(|of| self.model_has(*of) && !free.contains(of)).collect();
        let pairs = parameters.iter().zip(&point.values);
        let at_bound = pairs.filter(|(free, value)| free.is_at_bound(**value).contains(&true));
        let max_cost = cost * (1.0 + REACHED_TOLERANCE);
        let starts_reached = starts.iter().filter(|start| start.cost <= max_cost).count();
        let starts_failed = starts.iter().filter(|start| start.stopped.is_failure()).count();
        let intervals = if motions.is_ok() { fit.intervals() } else { Intervals::NONE };
        let Adequacy { lack_of_fit, by_metric, autocorrelation, runs, .. } = fit.adequacy;
        let [lack_of_fit_d, lack_of_fit_v, lack_of_fit_sigma, lack_of_fit_alpha] = by_metric;
        let [lower, upper] = intervals.limits.map(|limits| spread(parameters, &limits));
        let has_intervals = !free.is_empty() && motions.is_ok() && intervals.why_none.is_none();
        let uncertainty = |part: fn(&StandardUncertainty) -> f64| {
            spread(parameters, &intervals.uncertainties.iter().map(part).collect::<Vec<f64>>())
        };
        let few_frequencies = has_intervals && fit.systematic.blocks.is_empty();
        let single_day = has_intervals && fit.variation.ignores_days();
        FitRow {
            lower,
            upper,
            scatter: spread(parameters, &intervals.scatter),
            systematic: spread(parameters, &intervals.systematic),
            type_a: uncertainty(|of| of.type_a),
            type_b: uncertainty(|of| of.type_b),
            degrees_of_freedom: uncertainty(|of| of.degrees_of_freedom),
            coverage_factor: uncertainty(|of| of.coverage_factor),
            no_interval: intervals.why_none,
            lack_of_fit: lack_of_fit[0],
            lack_of_fit_limit: lack_of_fit[1],
            lack_of_fit_d,
            lack_of_fit_v,
            lack_of_fit_sigma,
            lack_of_fit_alpha,
            autocorrelation: autocorrelation[0],
            autocorrelation_limit: autocorrelation[1],
            runs: runs[0],
            runs_limit: runs[1],
            adequate: fit.adequacy.is_adequate,
            undecided: fit.adequacy.undecided.clone(),
            misfit: fit.adequacy.misfit.clone(),
            notes: FitNotes { few_frequencies, ..self.notes() },
            single_day,
            measured,
            identifiable: with_class(Class::Identifiable),
            practically_not: with_class(Class::PracticallyNot),
            structurally_not: with_class(Class::StructurallyNot),
            law_is_like: fit.law_is_like.clone(),
            at_bound: at_bound.map(|(free, _)| free.parameter).collect(),
            j: if motions.is_ok() { *cost } else { f64::NAN },
            trials: self.objective.measurements.len() as i64,
            starts: starts.len() as i64,
            starts_reached: starts_reached as i64,
            starts_failed: starts_failed as i64,
            resumed: *resumed as i64,
            solves: *solves as i64,
            free,
            ..self.fit_row(&robots, motions)
        }
    }

    /// Returns all rows for a fit: its own, and those for its starts, profiles, replicates, comparison, predictions and
    /// residuals. `alternative` is the row of the same model driven by the other gait (measured or commanded).
    pub(super) fn rows(
        &self,
        mut fit: Fit,
        starts: &[Start],
        motions: Result<(), Failure>,
        alternative: Option<FitRow>,
    ) -> Fitted {
        let comparison = match &motions {
            Ok(()) => self.comparison(&mut fit),
            Err(failure) => self.comparison_row(failure.status),
        };
        let row = self.row(&fit, starts, motions);
        let Fit { point, profiles, replicates, systematic, variation, .. } = &fit;
        let perturbed = &self.perturbed_robots;
        let bands = match why_no_bands(&row, replicates.len()) {
            None => Ok(Bands::new(point, replicates, variation, systematic, perturbed)),
            Some(why) => Err(why),
        };
        let parameters = &point.evaluator.parameters;
        let robots = self.objective.robots.with_values(parameters, &point.values);
        let predictions = predictions(self.input, point, &robots, &bands);
        let numbered_starts = starts.iter().enumerate();
        let profile_points = profiles.iter().enumerate().flat_map(|(index, profile)| {
            profile.points.iter().map(move |point| (index, profile.limit, point))
        });
        let replicates = replicates.iter().zip(&fit.criteria).enumerate();
        Fitted {
            residuals: residuals(
                &point.evaluator.objective.measurements,
                &predictions,
                &variation.noises(),
            ),
            predictions,
            starts: numbered_starts
                .map(|(number, start)| self.start_row(parameters, number, start))
                .collect(),
            profiles: profile_points
                .map(|(index, limit, point)| self.profile_row(parameters, index, limit, point))
                .collect(),
            bootstrap: replicates
                .map(|(number, (refit, criterion))| {
                    self.replicate_row(parameters, number, refit, *criterion)
                })
                .collect(),
            comparison: vec![comparison],
            fits: vec![row],
            alternatives: alternative.into_iter().collect(),
            shared: Vec::new(),
            precision: Vec::new(),
        }
    }

    fn start_row(&self, parameters: &[FreeParameter], number: usize, start: &Start) -> StartRow {
        StartRow {
            campaign: self.input.campaign.name.clone(),
            model: self.input.model.name,
            start: number as i64,
            began: spread(parameters, &start.began),
            ended: spread(parameters, &start.ended),
            j: start.cost,
            solves: start.solves as i64,
            stopped: start.stopped,
        }
    }

    fn profile_row(
        &self,
        parameters: &[FreeParameter],
        index: usize,
        limit_j: f64,
        point: &HeldPoint,
    ) -> ProfileRow {
        ProfileRow {
            campaign: self.input.campaign.name.clone(),
            model: self.input.model.name,
            parameter: parameters[index].parameter,
            value: point.values[index],
            parameters: spread(parameters, &point.values),
            j: point.cost,
            limit_j,
        }
    }

    /// Returns the table row for a bootstrap replicate; `criterion_resampled` is the Schwarz criterion of the model for
    /// a resample in which the frequencies and the trials at each of them are drawn at random.
    pub(super) fn replicate_row(
        &self,
        parameters: &[FreeParameter],
        number: usize,
        refit: &Start,
        criterion_resampled: f64,
    ) -> BootstrapRow {
        BootstrapRow {
            campaign: self.input.campaign.name.clone(),
            model: self.input.model.name,
            replicate: number as i64,
            parameters: spread(parameters, &refit.ended),
            j: refit.cost,
            criterion_resampled,
            solves: refit.solves as i64,
            stopped: refit.stopped,
        }
    }

    /// Returns notes on raw skid ratios used in place of missing debiased ones, on trials that are left out, and on
    /// weighted metrics that no trial has.
    fn notes(&self) -> FitNotes {
        let measurements = &self.objective.measurements;
        let raw = measurements.iter().filter(|measurement| measurement.lacks_debiased);
        let missing = Metric::FITTED.into_iter().filter(|metric| {
            let mut measured = measurements.iter().map(|of| of.metrics[*metric]);
            let protocols = &self.objective.protocols;
            self.objective.robots.has_metric(*metric)
                && protocols.iter().any(|of| of.term_weights()[*metric] > 0.0)
                && measured.all(f64::is_nan)
        });
        FitNotes {
            raw_skid_trials: raw.map(|measurement| measurement.trial.clone()).collect(),
            unlike_repeats: self.unlike_repeats.clone(),
            missing_metrics: missing.collect(),
            ..FitNotes::default()
        }
    }

    /// Returns the model's comparison row, except for the columns that need the other models.
    fn comparison(&self, fit: &mut Fit) -> ComparisonRow {
        let point = &fit.point;
        let contributions = point.contributions();
        let [j_d, j_v, j_sigma, j_alpha] =
            WeightKey::ALL.map(|key| key.metrics().map(|metric| contributions[metric]).sum());
        let (criterion, terms) = criterion(point);
        let free = point.values.len() as i64;
        let (j_left_out, solves) = point.leave_one_frequency_out();
        fit.solves += solves;
        let ([j_extrapolated, extrapolated_above_rad_s], solves) = fit.point.extrapolated();
        fit.solves += solves;
        ComparisonRow {
            j: fit.cost,
            j_d,
            j_v,
            j_sigma,
            j_alpha,
            j_left_out,
            j_extrapolated,
            extrapolated_above_rad_s,
            free,
            terms: terms as i64,
            criterion,
            ..self.comparison_row(FitStatus::Ok)
        }
    }

    pub(super) fn comparison_row(&self, status: FitStatus) -> ComparisonRow {
        ComparisonRow {
            campaign: self.input.campaign.name.clone(),
            model: self.input.model.name,
            status,
            ..ComparisonRow::blank()
        }
    }

    /// Returns a row with the parameters of the model and the failure of the fit, if any; all other values are
    /// missing.
    pub(super) fn fit_row(&self, robots: &Robots, motions: Result<(), Failure>) -> FitRow {
        let failure = motions.err();
        FitRow {
            campaign: self.input.campaign.name.clone(),
            model: self.input.model.name,
            gait_input: self.objective.gait_input,
            parameters: ByParameter::from_fn(|parameter| {
                if self.model_has(parameter) { robots.value(parameter) } else { f64::NAN }
            }),
            status: failure.as_ref().map_or(FitStatus::Ok, |failure| failure.status),
            failure: failure.map_or_else(String::new, |failure| failure.reason),
            ..FitRow::blank()
        }
    }

    /// Whether the model's solution depends on the parameter.
    fn model_has(&self, parameter: Parameter) -> bool {
        self.objective.depends_on(parameter)
    }
}

/// Returns the reason why the predictions of a fit with the given number of bootstrap replicates have no confidence
/// intervals; `None` if they have intervals.
pub(super) fn why_no_bands(fit: &FitRow, replicates: usize) -> Option<NoInterval> {
    use NoIntervalReason::{FitFailed, Inadequate, NoReplicates, NothingFitted};
    let reason = match fit {
        _ if !fit.status.is_ok() => FitFailed,
        FitRow { no_interval: Some(why), .. } => return Some(why.clone()),
        _ if fit.adequate == Some(false) => Inadequate,
        _ if fit.free.is_empty() => NothingFitted,
        _ if replicates == 0 => NoReplicates,
        _ => return None,
    };
    Some(reason.into())
}

/// Returns the values of the free parameters, indexed by parameter; fixed parameters have missing values.
fn spread(parameters: &[FreeParameter], values: &[f64]) -> ByParameter<f64> {
    let mut all = ByParameter::MISSING;
    for (free, value) in parameters.iter().zip(values) {
        all[free.parameter] = *value;
    }
    all
}
