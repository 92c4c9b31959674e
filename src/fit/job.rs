//! One model of one campaign: its fit, what it is worth, and what it predicts.

use std::sync::atomic::Ordering;

use rayon::prelude::*;

use super::adequacy::Adequacy;
use super::bands::Bands;
use super::criterion::{self, criterion};
use super::fitted_point::{FittedPoint, HeldPoint};
use super::input::FreeParameter;
use super::intervals::{Intervals, Systematic};
use super::law_class::law_is_like;
use super::objective::{METRICS, Objective};
use super::predict::predictions;
use super::profile::{Class, Profile, profile, profile_limits};
use super::resample::Resampler;
use super::search::Ended;
use super::starts::{Start, search_all, search_from};
use super::{FitData, FitEvent, FitInput, Fitted, OnEvent, Replicates};
use crate::config::GaitInput;
use crate::motion::REFERENCE_ACCURACY;
use crate::robot::{ByParameter, Parameter, Robot};
use crate::store::{
    BootstrapRow, Columns as _, ComparisonRow, FitRow, FitStatus, ProfileRow, StartRow,
};

/// Starts within this part of the best objective have reached it.
const REACHED: f64 = 1e-6;
/// Fall of the objective, relative to it, for which a fit is resumed.
const LOWER: f64 = 1e-9;
const MOST_RESUMES: usize = 10;
/// Most of the usual starts that a fit takes which has a start nearby.
const USUAL_STARTS: usize = 2;

/// One model of one campaign.
pub(super) struct Job<'j> {
    pub input: &'j FitInput,
    objective: Objective,
    /// Coefficients that trials of other kinds gave.
    measured: Vec<Parameter>,
    /// The robot with one of its uncertain parameters off by its standard deviation.
    others: Vec<Robot>,
    resampler: &'j Resampler,
    replicates: &'j Replicates,
}

impl<'j> Job<'j> {
    pub fn new(
        input: &'j FitInput,
        data: &FitData,
        resampler: &'j Resampler,
        replicates: &'j Replicates,
    ) -> Self {
        let (robot, measured) = input.measured_robot(data);
        let others = input.uncertain_robots(&robot, data);
        let objective = Objective::new(
            input.model.value.laws(),
            robot,
            input.gait.value.to_gait(),
            input.campaign.value.weights,
            input.gait_input(),
            resampler.measurements.clone(),
        );
        Self { input, objective, measured, others, resampler, replicates }
    }

    /// The model's rows, without what needs the campaign's other models.
    pub fn run(&self, on_event: OnEvent) -> Fitted {
        if self.objective.measurements.is_empty() {
            let status = FitStatus::Failed("failed: no trial with metrics".to_owned());
            let comparison = vec![self.comparison_row(status.clone())];
            let row = |job: &Self| job.fit_row(&job.objective.robot, status.clone());
            let alternatives = self.driven_otherwise().iter().map(row).collect();
            return Fitted { fits: vec![row(self)], alternatives, comparison, ..Fitted::default() };
        }
        let starts = search_all(&self.objective, &self.input.free(), self.input.fit.starts);
        let (mut fit, status) = self.best_of(&starts);
        if status.is_ok() {
            self.follow_profiles(&mut fit);
            self.bootstrap(&mut fit, on_event);
            self.assess(&mut fit);
        }
        let alternative =
            self.driven_otherwise().map(|job| job.nearby(&fit.point.values, on_event));
        if let Some(other) = alternative.as_ref().filter(|other| other.status.is_ok()) {
            let values: Vec<f64> = other.free.iter().map(|of| other.parameters[*of]).collect();
            self.note_shift(&mut fit, &values);
        }
        self.rows(fit, &starts, status, alternative)
    }

    /// The fit of the start that ended lowest, and whether its motions exist.
    fn best_of<'f>(&'f self, starts: &[Start]) -> (Fit<'f>, FitStatus) {
        // What is less than the motions' own inaccuracy is nothing: the first of these is best.
        let floor = |start: &Start| start.cost.max(REFERENCE_ACCURACY);
        let best = starts.iter().min_by(|a, b| floor(a).total_cmp(&floor(b)));
        let best = best.expect("there is at least one start").clone();
        let evaluator = self.objective.evaluator(self.input.free());
        let point = FittedPoint::new(evaluator, best.ended);
        let status = point.status();
        let solves =
            starts.iter().map(|start| start.solves).sum::<usize>() + point.evaluator.solves;
        (Fit { solves, ..Fit::new(point, best.cost) }, status)
    }

    /// The same fit driven by the other gait; `None` where the model has one of its own.
    fn driven_otherwise(&self) -> Option<Self> {
        let gait_input = self.objective.gait_input.other();
        self.input.model.value.input.is_none().then(|| Self {
            input: self.input,
            objective: self.objective.driven_as(gait_input),
            measured: self.measured.clone(),
            others: self.others.clone(),
            ..*self
        })
    }

    /// The fit's row, without profiles if there are replicates, where a fit nearby has these values: searches go out from
    /// there and from the first of the usual starts.
    fn nearby(&self, values: &[f64], on_event: OnEvent) -> FitRow {
        let parameters = self.input.free();
        let near = search_from(self.objective.evaluator(parameters.clone()), values.to_vec());
        let mut starts = vec![near];
        if !parameters.is_empty() {
            let usual = self.input.fit.starts.min(USUAL_STARTS);
            starts.extend(search_all(&self.objective, &parameters, usual));
        }
        let (mut fit, status) = self.best_of(&starts);
        if status.is_ok() {
            match self.input.fit.bootstrap {
                0 => self.follow_profiles(&mut fit),
                _ => self.bootstrap(&mut fit, on_event),
            }
            self.assess(&mut fit);
            self.note_shift(&mut fit, values);
        }
        self.row(&fit, &starts, status)
    }

    /// Profiles of all free parameters; a lower objective on one of them resumes the fit.
    fn follow_profiles(&self, fit: &mut Fit) {
        if !self.input.fit.profiles {
            return;
        }
        loop {
            let limits = profile_limits(&fit.point, self.resampler);
            let point = &fit.point;
            fit.profiles = limits
                .par_iter()
                .enumerate()
                .map(|(index, limit)| profile(point, index, *limit))
                .collect();
            fit.solves += fit.profiles.iter().map(|profile| profile.solves).sum::<usize>();
            let lower = fit.profiles.iter().filter_map(|profile| profile.lower_than(point.cost));
            let lowest = lower.min_by(|a, b| a.cost.total_cmp(&b.cost)).cloned();
            let Some(lowest) = lowest.filter(|_| fit.resumed < MOST_RESUMES) else { return };
            let resumed = search_from(fit.point.evaluator.clone(), lowest.values);
            fit.solves += resumed.solves;
            if resumed.cost >= fit.cost * (1.0 - LOWER) {
                return;
            }
            fit.resumed += 1;
            fit.cost = resumed.cost;
            fit.point = FittedPoint::new(fit.point.evaluator.clone(), resumed.ended);
        }
    }

    fn bootstrap(&self, fit: &mut Fit, on_event: OnEvent) {
        // Replicates without noise would all be the same.
        let total = if self.resampler.is_silent() { 0 } else { self.input.fit.bootstrap };
        let Replicates { numbers, given } = self.replicates;
        let numbers = numbers.start.min(total)..numbers.end.min(total);
        let (point, ended, total) = (&fit.point, Ended::default(), numbers.len());
        let (parameters, driven_by) = (&point.evaluator.parameters, self.objective.gait_input);
        let (campaign, model) = (&self.input.campaign.name, self.input.model.name);
        let is_own = |row: &&BootstrapRow| row.campaign == *campaign && row.model == model;
        let known = |row: &BootstrapRow| {
            let refit = Start {
                began: point.values.clone(),
                ended: parameters.iter().map(|free| row.parameters[free.parameter]).collect(),
                cost: row.j,
                solves: row.solves as usize,
                stopped: row.stopped,
            };
            (refit, row.criterion_resampled)
        };
        let given = given.get(&driven_by).into_iter().flatten();
        let mut replicates: Vec<(Start, f64)> = given.filter(is_own).map(known).collect();
        replicates.par_extend(numbers.into_par_iter().map(|number| {
            let refit = point.refit(&self.resampler.draw(number), &ended);
            let criterion = criterion::resampled(point, self.resampler, number);
            let done = ended.load(Ordering::Relaxed);
            let row = &self.replicate_row(parameters, number, &refit, criterion);
            on_event(FitEvent::Replicate { driven_by, row, done, total });
            (refit, criterion)
        }));
        (fit.replicates, fit.criteria) = replicates.into_iter().unzip();
        fit.solves += fit.replicates.iter().map(|refit| refit.solves).sum::<usize>();
    }

    /// Whether the model fits, and what all trials share.
    fn assess(&self, fit: &mut Fit) {
        fit.adequacy = Adequacy::new(&fit.point, self.resampler);
        if self.objective.laws.skid.is_dry() {
            fit.law_is_like = law_is_like(&fit.point, self.resampler);
        }
        let has_intervals = self.input.fit.bootstrap > 0 || self.input.fit.profiles;
        if has_intervals && !fit.point.values.is_empty() {
            let (systematic, solves) = Systematic::new(&fit.point, &self.others);
            (fit.systematic, fit.solves) = (systematic, fit.solves + solves);
        }
    }

    /// Takes the coefficients with the measured gait for a known shift where the command drives
    /// the model.
    fn note_shift(&self, fit: &mut Fit, values: &[f64]) {
        if self.objective.gait_input == GaitInput::Commanded {
            fit.systematic.gait = Some(fit.point.shift_to(values));
        }
    }

    fn row(&self, fit: &Fit, starts: &[Start], status: FitStatus) -> FitRow {
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
        let [lower, upper] = intervals.limits.map(|limits| spread(parameters, &limits));
        FitRow {
            lower,
            upper,
            scatter: spread(parameters, &intervals.scatter),
            systematic: spread(parameters, &intervals.systematic),
            no_interval: intervals.why_none,
            lack_of_fit: lack_of_fit[0],
            lack_of_fit_limit: lack_of_fit[1],
            lack_of_fit_d: by_metric[0],
            lack_of_fit_v: by_metric[1],
            lack_of_fit_sigma: by_metric[2],
            lack_of_fit_alpha: by_metric[3],
            autocorrelation: autocorrelation[0],
            autocorrelation_limit: autocorrelation[1],
            runs: runs[0],
            runs_limit: runs[1],
            adequate: fit.adequacy.is_adequate,
            misfit: fit.adequacy.misfit.clone(),
            notes: self.notes(),
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

    fn rows(
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
        let bands = match why_no_bands(&row, replicates) {
            "" => Ok(Bands::new(point, replicates, self.resampler, systematic, &self.others)),
            why => Err(why.to_owned()),
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
        Fitted {
            predictions: predictions(self.input, point, &robot, &bands),
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
        }
    }

    fn replicate_row(
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
    fn notes(&self) -> String {
        let measurements = &self.objective.measurements;
        let raw: Vec<&str> = measurements
            .iter()
            .filter(|measurement| measurement.lacks_debiased)
            .map(|measurement| measurement.trial.as_str())
            .collect();
        let mut notes = Vec::new();
        if !raw.is_empty() {
            notes.push(format!(
                "raw skid ratios are fitted, since debiased ones are not known: trial {}",
                raw.join(", ")
            ));
        }
        let weights = self.objective.term_weights();
        let lacks = |i: &usize| {
            let mut measured = measurements.iter().map(|of| of.metrics.to_array()[*i]);
            weights[*i] > 0.0 && measured.all(f64::is_nan)
        };
        let lacking: Vec<&str> = (0..METRICS.len()).filter(lacks).map(|i| METRICS[i]).collect();
        if !lacking.is_empty() {
            notes.push(format!("the objective lacks {}: no trial has it", lacking.join(", ")));
        }
        notes.join("; ")
    }

    /// The model's row of the comparison, without what needs the other models.
    fn comparison(&self, fit: &mut Fit) -> ComparisonRow {
        let point = &fit.point;
        let [j_d, j_v, j_sigma @ .., j_alpha] = point.parts();
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
            j_sigma: j_sigma.iter().sum(),
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

    fn comparison_row(&self, status: FitStatus) -> ComparisonRow {
        let (campaign, model) = (self.input.campaign.name.clone(), self.input.model.name);
        ComparisonRow { campaign, model, status, ..ComparisonRow::blank() }
    }

    /// A row with the parameters that the model knows; all else is missing.
    fn fit_row(&self, robot: &Robot, status: FitStatus) -> FitRow {
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
        self.objective.laws.know(parameter, &self.objective.gait)
    }
}

/// A fit that is not complete yet.
struct Fit<'o> {
    point: FittedPoint<'o>,
    cost: f64,
    resumed: usize,
    /// Motions solved for so far.
    solves: usize,
    /// One per free parameter, or none.
    profiles: Vec<Profile>,
    replicates: Vec<Start>,
    /// Criteria of the replicates with frequencies resampled, too.
    criteria: Vec<f64>,
    adequacy: Adequacy,
    /// The law that its own is not told from.
    law_is_like: String,
    systematic: Systematic,
}

impl<'o> Fit<'o> {
    fn new(point: FittedPoint<'o>, cost: f64) -> Self {
        Self {
            point,
            cost,
            resumed: 0,
            solves: 0,
            profiles: Vec::new(),
            replicates: Vec::new(),
            criteria: Vec::new(),
            adequacy: Adequacy::UNKNOWN,
            law_is_like: String::new(),
            systematic: Systematic::default(),
        }
    }

    fn intervals(&self, resampler: &Resampler) -> Intervals {
        let Self { point, profiles, replicates, adequacy, systematic, .. } = self;
        Intervals::new(point, profiles, replicates, resampler, adequacy, systematic)
    }
}

/// Why the predictions of a fit have no intervals; empty where they have.
fn why_no_bands<'f>(fit: &'f FitRow, replicates: &[Start]) -> &'f str {
    match fit {
        _ if !fit.status.is_ok() => "the fit has failed",
        _ if !fit.no_interval.is_empty() => &fit.no_interval,
        _ if fit.adequate == Some(false) => "the model does not fit",
        _ if fit.free.is_empty() => "no coefficient is fitted",
        _ if replicates.is_empty() => "no replicates were asked for",
        _ => "",
    }
}

/// Values of the free parameters among all parameters; the others are missing.
fn spread(parameters: &[FreeParameter], values: &[f64]) -> ByParameter<f64> {
    let mut all = ByParameter::MISSING;
    for (free, value) in parameters.iter().zip(values) {
        all[free.parameter] = *value;
    }
    all
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::config::{Config, SigmaKind};
    use crate::fit::Measurement;
    use crate::metrics::GaitMetrics;
    use crate::robot::Model;
    use crate::store::TrialRow;

    const CAMPAIGN: &str = "kinematic-symmetric";

    fn measurements() -> Vec<Measurement> {
        let data = include_str!("../../tests/fixtures/reference/fit/kinematic-symmetric.csv");
        let row = |(number, line): (usize, &str)| {
            let fields: Vec<f64> = line.split(',').map(|f| f.parse().unwrap_or(f64::NAN)).collect();
            let row = TrialRow {
                trial: number.to_string(),
                omega_rad_s: fields[0],
                metrics: GaitMetrics {
                    d_m: fields[1],
                    v_m_s: fields[2],
                    sigma: [fields[3], fields[4], fields[5]],
                    ..GaitMetrics::MISSING
                },
                ..TrialRow::blank()
            };
            Measurement::new(&row, SigmaKind::Raw).expect("a measurement")
        };
        data.lines().skip(1).enumerate().map(row).collect()
    }

    fn config() -> Config {
        let mut config = Config::default();
        config.fit.gait_input = GaitInput::Commanded;
        config
    }

    #[test]
    fn a_profile_that_finds_a_lower_objective_resumes_the_fit() {
        let config = config();
        let input = FitInput::new(&config, CAMPAIGN, Model::SKID_ROLL).expect("the paper's");
        let resampler = Resampler::new(1, measurements(), &BTreeMap::new());
        let replicates = Replicates::default();
        let job = Job::new(&input, &FitData::default(), &resampler, &replicates);
        // Away from the best, which is at 100.7, 33.9, 43.6 kg/s.
        let evaluator = job.objective.evaluator(input.free());
        let point = FittedPoint::new(evaluator, vec![95.0, 34.0, 44.0]);
        let began = point.cost;
        let mut fit = Fit::new(point, began);
        job.follow_profiles(&mut fit);
        assert!(began > 0.269 && fit.resumed >= 1, "{began} {}", fit.resumed);
        assert!((fit.cost / 0.26140684 - 1.0).abs() < 1e-6, "{}", fit.cost);
        // The profiles are those of the lower fit.
        assert!(fit.profiles.iter().all(|profile| profile.lower_than(fit.cost).is_none()));
    }

    #[test]
    fn known_measurements_are_fitted_as_ever() {
        let mut config = config();
        config.fit.starts = 1;
        config.fit.bootstrap = 2;
        let input = FitInput::new(&config, CAMPAIGN, Model::SKID_ROLL).expect("the paper's");
        let resampler = Resampler::new(1, measurements(), &BTreeMap::new());
        let replicates = Replicates::default();
        let job = Job::new(&input, &FitData::default(), &resampler, &replicates);
        let Fitted { fits, bootstrap, comparison, predictions, .. } = job.run(&|_| {});
        let (fit, first) = (&fits[0], Parameter::Skid0);
        let found = Parameter::SKID.map(|skid| fit.parameters[skid]).into_iter();
        // Nothing tells their noise.
        assert!(fit.upper[first].is_nan() && bootstrap.is_empty());
        let reasons = predictions.iter().all(|row| row.no_interval == fit.no_interval);
        assert!(!fit.no_interval.is_empty() && reasons);
        let found = found.chain([fit.j]);
        let predicted = predictions[20].metrics;
        let others = [comparison[0].j_left_out, predicted.d_m, predicted.sigma[0]];
        let found = found.chain(others).map(|number| format!("{number:.4e}"));
        let found = found.collect::<Vec<_>>().join(" ");
        const KNOWN: &str = "1.0069e2 3.3889e1 4.3584e1 2.6141e-1 2.6762e-1 4.3931e-1 3.0847e-2";
        assert_eq!(found, KNOWN);
    }
}
