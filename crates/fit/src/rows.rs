//! What a fit leaves in the tables.

use trilink_robot::metrics::{Metric, WeightKey};
use trilink_robot::{ByParameter, Parameter, Robot};
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
use super::intervals::Intervals;
use super::job::{Fit, Job};
use super::predict::{predictions, residuals};
use super::profile::Class;
use super::starts::Start;

/// Starts within this part of the best objective have reached it.
const REACHED: f64 = 1e-6;

impl Job<'_> {
    pub(super) fn row(&self, fit: &Fit, starts: &[Start], status: FitStatus) -> FitRow {
        let Fit { point, cost, resumed, solves, profiles, .. } = fit;
        let parameters = &point.evaluator.parameters;
        let robot = self.objective.robot_with(parameters, &point.values);
        let free: Vec<Parameter> = parameters.iter().map(|free| free.parameter).collect();
        let classed = |class: Class| {
            let both = free.iter().zip(profiles);
            both.filter(|(_, profile)| profile.class == class).map(|(of, _)| *of).collect()
        };
        let held = |parameter: &Parameter| self.knows(*parameter) && !free.contains(parameter);
        let both = parameters.iter().zip(&point.values);
        let at_bound = both.filter(|(free, value)| free.is_at_bound(**value).contains(&true));
        let count = |of: &dyn Fn(&Start) -> bool| starts.iter().filter(|s| of(s)).count() as i64;
        let intervals = match status.is_ok() {
            true => fit.intervals(self.resampler),
            false => Intervals::NONE,
        };
        let Adequacy { lack_of_fit, by_metric, autocorrelation, runs, .. } = fit.adequacy;
        let [lack_of_fit_d, lack_of_fit_v, lack_of_fit_sigma, lack_of_fit_alpha] = by_metric;
        let [lower, upper] = intervals.limits.map(|limits| spread(parameters, &limits));
        let has_intervals = !free.is_empty() && status.is_ok() && intervals.why_none.is_none();
        let few_frequencies = has_intervals && fit.systematic.blocks.is_empty();
        FitRow {
            lower,
            upper,
            scatter: spread(parameters, &intervals.scatter),
            systematic: spread(parameters, &intervals.systematic),
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
            misfit: fit.adequacy.misfit.clone(),
            notes: FitNotes { few_frequencies, ..self.notes() },
            measured: self.measured.iter().copied().filter(held).collect(),
            identifiable: classed(Class::Identifiable),
            practically_not: classed(Class::PracticallyNot),
            structurally_not: classed(Class::StructurallyNot),
            law_is_like: fit.law_is_like.clone(),
            at_bound: at_bound.map(|(free, _)| free.parameter).collect(),
            j: if status.is_ok() { *cost } else { f64::NAN },
            trials: self.objective.measurements.len() as i64,
            starts: starts.len() as i64,
            starts_reached: count(&|start| start.cost <= cost * (1.0 + REACHED)),
            starts_failed: count(&|start| start.stopped.is_failure()),
            resumed: *resumed as i64,
            solves: *solves as i64,
            free,
            ..self.fit_row(&robot, status)
        }
    }

    pub(super) fn rows(
        &self,
        mut fit: Fit,
        starts: &[Start],
        status: FitStatus,
        alternative: Option<FitRow>,
    ) -> Fitted {
        let comparison = match status.is_ok() {
            true => self.comparison(&mut fit),
            false => self.comparison_row(status.clone()),
        };
        let row = self.row(&fit, starts, status);
        let Fit { point, profiles, replicates, systematic, .. } = &fit;
        let bands = match why_no_bands(&row, replicates.len()) {
            None => Ok(Bands::new(point, replicates, self.resampler, systematic, &self.others)),
            Some(why) => Err(why),
        };
        let parameters = &point.evaluator.parameters;
        let robot = self.objective.robot_with(parameters, &point.values);
        let (campaign, model) = (&self.input.campaign.name, self.input.model.name);
        let start_row = |(number, start): (usize, &Start)| StartRow {
            campaign: campaign.clone(),
            model,
            start: number as i64,
            began: spread(parameters, &start.began),
            ended: spread(parameters, &start.ended),
            j: start.cost,
            solves: start.solves as i64,
            stopped: start.stopped,
        };
        let profile_row = |(index, limit_j, point): (usize, f64, &HeldPoint)| ProfileRow {
            campaign: campaign.clone(),
            model,
            parameter: parameters[index].parameter,
            value: point.values[index],
            parameters: spread(parameters, &point.values),
            j: point.cost,
            limit_j,
        };
        let profile_points = profiles.iter().enumerate().flat_map(|(index, profile)| {
            profile.points.iter().map(move |point| (index, profile.limit, point))
        });
        let replicate_row = |(number, (refit, criterion)): (usize, (&Start, &f64))| {
            self.replicate_row(parameters, number, refit, *criterion)
        };
        let predictions = predictions(self.input, point, &robot, &bands);
        Fitted {
            residuals: residuals(&point.evaluator.objective.measurements, &predictions),
            predictions,
            starts: starts.iter().enumerate().map(start_row).collect(),
            profiles: profile_points.map(profile_row).collect(),
            bootstrap: replicates
                .iter()
                .zip(&fit.criteria)
                .enumerate()
                .map(replicate_row)
                .collect(),
            comparison: vec![comparison],
            fits: vec![row],
            alternatives: alternative.into_iter().collect(),
            shared: Vec::new(),
        }
    }

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

    /// What was fitted instead of what is missing, and what the objective lacks.
    fn notes(&self) -> FitNotes {
        let measurements = &self.objective.measurements;
        let raw = measurements.iter().filter(|measurement| measurement.lacks_debiased);
        let lacks = |i: &Metric| {
            let mut measured = measurements.iter().map(|of| of.metrics[*i]);
            let protocols = &self.objective.protocols;
            protocols.iter().any(|of| of.term_weights()[*i] > 0.0) && measured.all(f64::is_nan)
        };
        let missing = Metric::FITTED.into_iter().filter(lacks);
        FitNotes {
            raw_skid_trials: raw.map(|measurement| measurement.trial.clone()).collect(),
            missing_metrics: missing.collect(),
            ..FitNotes::default()
        }
    }

    /// The model's row of the comparison, without what needs the other models.
    fn comparison(&self, fit: &mut Fit) -> ComparisonRow {
        let point = &fit.point;
        let parts = point.parts();
        let part = |key: WeightKey| key.metrics().map(|metric| parts[metric]).sum();
        let [j_d, j_v, j_sigma, j_alpha] = WeightKey::ALL.map(part);
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
        let (campaign, model) = (self.input.campaign.name.clone(), self.input.model.name);
        ComparisonRow { campaign, model, status, ..ComparisonRow::blank() }
    }

    /// A row with the parameters that the model knows; all else is missing.
    pub(super) fn fit_row(&self, robot: &Robot, status: FitStatus) -> FitRow {
        let (campaign, model) = (self.input.campaign.name.clone(), self.input.model.name);
        let parameters = self.parameters_of(robot);
        let gait_input = self.objective.gait_input;
        FitRow { campaign, model, gait_input, parameters, status, ..FitRow::blank() }
    }

    fn parameters_of(&self, robot: &Robot) -> ByParameter<f64> {
        let value = |of| if self.knows(of) { of.of(robot) } else { f64::NAN };
        ByParameter::from_fn(value)
    }

    fn knows(&self, parameter: Parameter) -> bool {
        self.objective.protocols.iter().any(|of| self.objective.laws.know(parameter, &of.gait))
    }
}

/// Why the predictions of a fit have no intervals.
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

/// Values of the free parameters among all parameters; the others are missing.
fn spread(parameters: &[FreeParameter], values: &[f64]) -> ByParameter<f64> {
    let mut all = ByParameter::MISSING;
    for (free, value) in parameters.iter().zip(values) {
        all[free.parameter] = *value;
    }
    all
}
