//! One model of one campaign: its fit, what it is worth, and what it predicts.

use std::sync::atomic::Ordering;

use rayon::prelude::*;

use super::compare::bic;
use super::fitted_point::{FittedPoint, Refit};
use super::free::FreeParameter;
use super::objective::{Objective, PENALTY};
use super::predict::predictions;
use super::profile::{Class, Profile, ProfilePoint, profile, profile_limits};
use super::resample::Resampler;
use super::search::Ended;
use super::starts::{Start, search_all, search_from};
use super::{FitEvent, FitInput, Fitted, OnEvent};
use crate::config::GaitInput;
use crate::motion::{Model, REFERENCE_ACCURACY};
use crate::robot::{ByParameter, Gait, Parameter, Robot};
use crate::stats::quantiles;
use crate::store::{
    BootstrapRow, Columns as _, ComparisonRow, FitRow, FitStatus, ProfileRow, StartRow,
};

/// Starts within this part of the best objective have reached it.
const REACHED: f64 = 1e-6;
/// Fall of the objective, relative to it, for which a fit is resumed.
const LOWER: f64 = 1e-9;
const MOST_RESUMES: usize = 10;
/// Parts of the replicates outside of a 95 % interval, on either side.
const OUTSIDE: f64 = 0.025;

/// One model of one campaign.
pub(super) struct Job<'j> {
    pub input: &'j FitInput,
    pub robot: Robot,
    pub gait: Gait,
    /// Coefficients that trials of other kinds gave.
    pub measured: Vec<Parameter>,
    pub resampler: &'j Resampler,
    pub measurements: &'j [super::Measurement],
}

/// What a job gives: its rows, and the replicates' objectives.
pub(super) struct JobResult {
    pub tables: Fitted,
    pub replicates: Vec<f64>,
}

/// A model that was fitted before.
impl From<Fitted> for JobResult {
    fn from(tables: Fitted) -> Self {
        Self { replicates: tables.bootstrap.iter().map(|row| row.j).collect(), tables }
    }
}

impl Job<'_> {
    pub fn run(&self, on_event: OnEvent) -> JobResult {
        if self.measurements.is_empty() {
            return self.without_trials();
        }
        let objective = Objective {
            model: self.input.model,
            robot: self.robot.clone(),
            gait: self.gait,
            weights: self.input.campaign.value.weights,
            gait_input: self.input.fit.gait_input,
            measurements: self.measurements.to_vec(),
        };
        let parameters = self.input.free();
        let starts = search_all(&objective, &parameters, self.input.fit.starts);
        // What is less than the motions' own inaccuracy is nothing: the first of these is best.
        let floor = |start: &Start| start.cost.max(REFERENCE_ACCURACY);
        let best = starts.iter().min_by(|a, b| floor(a).total_cmp(&floor(b)));
        let best = best.expect("there is at least one start").clone();
        let mut solves: usize = starts.iter().map(|start| start.solves).sum();
        let point = FittedPoint::new(&objective, &parameters, best.ended);
        let status = point.status();
        solves += point.evaluator.solves;
        let mut fit = Fit {
            point,
            cost: best.cost,
            resumed: 0,
            solves,
            profiles: Vec::new(),
            replicates: Vec::new(),
        };
        if status.is_ok() {
            self.follow_profiles(&mut fit);
            self.bootstrap(&mut fit, on_event);
        }
        self.rows(fit, &starts, status)
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
            fit.point = fit.point.moved_to(resumed.ended);
        }
    }

    fn bootstrap(&self, fit: &mut Fit, on_event: OnEvent) {
        let total = self.input.fit.bootstrap;
        let (point, ended) = (&fit.point, Ended::default());
        let (campaign, model) = (self.input.campaign.name.as_str(), self.input.model);
        fit.replicates = (0..total)
            .into_par_iter()
            .map(|number| {
                let refit = point.refit(self.resampler.draw(number), &ended);
                let done = ended.load(Ordering::Relaxed);
                on_event(FitEvent::Replicate { campaign, model, done, total });
                refit
            })
            .collect();
        fit.solves += fit.replicates.iter().map(|refit| refit.solves).sum::<usize>();
    }

    fn rows(&self, fit: Fit, starts: &[Start], status: FitStatus) -> JobResult {
        let Fit { point, cost, resumed, profiles, replicates, .. } = &fit;
        let (campaign, model) = (&self.input.campaign.name, self.input.model);
        let parameters = &point.evaluator.parameters;
        let objective = &point.evaluator.objective;
        let robot = objective.robot_with(parameters, &point.values);
        let free: Vec<Parameter> = parameters.iter().map(|free| free.parameter).collect();
        let classed = |class: Class| {
            let both = free.iter().zip(profiles);
            both.filter(|(_, profile)| profile.class == class).map(|(of, _)| *of).collect()
        };
        let held = |parameter: &Parameter| {
            model.knows(*parameter, &self.gait) && !free.contains(parameter)
        };
        let ok = Some(&fit).filter(|_| status.is_ok());
        let (comparison, more_solves) = self.comparison(ok, &status);
        let both = parameters.iter().zip(&point.values);
        let at_bound = both.filter(|(free, value)| free.is_at_bound(**value).contains(&true));
        let count = |of: &dyn Fn(&Start) -> bool| starts.iter().filter(|s| of(s)).count() as i64;
        let [lower, upper] = fit.intervals(self.resampler).map(|limit| spread(parameters, &limit));
        let row = FitRow {
            lower,
            upper,
            measured: self.measured.iter().copied().filter(held).collect(),
            identifiable: classed(Class::Identifiable),
            practically_not: classed(Class::PracticallyNot),
            structurally_not: classed(Class::StructurallyNot),
            at_bound: at_bound.map(|(free, _)| free.parameter).collect(),
            j: if status.is_ok() { *cost } else { f64::NAN },
            trials: self.measurements.len() as i64,
            starts: starts.len() as i64,
            starts_reached: count(&|start| start.cost <= cost * (1.0 + REACHED)),
            starts_failed: count(&|start| start.stopped.is_failure()),
            resumed: *resumed as i64,
            solves: (fit.solves + more_solves) as i64,
            free,
            ..self.fit_row(&robot, status)
        };
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
        let profile_rows = |(index, profile): (usize, &Profile)| {
            let row = |point: &ProfilePoint| ProfileRow {
                campaign: campaign.clone(),
                model,
                parameter: parameters[index].parameter,
                value: point.values[index],
                parameters: spread(parameters, &point.values),
                j: point.cost,
                limit_j: profile.limit,
            };
            profile.points.iter().map(row).collect::<Vec<_>>()
        };
        let replicate_row = |(number, refit): (usize, &Refit)| BootstrapRow {
            campaign: campaign.clone(),
            model,
            replicate: number as i64,
            parameters: spread(parameters, &refit.values),
            j: refit.cost,
            solves: refit.solves as i64,
            stopped: refit.stopped,
        };
        JobResult {
            replicates: replicates.iter().map(|refit| refit.cost).collect(),
            tables: Fitted {
                predictions: predictions(campaign, objective, &robot),
                starts: starts.iter().enumerate().map(start_row).collect(),
                profiles: profiles.iter().enumerate().flat_map(profile_rows).collect(),
                bootstrap: replicates.iter().enumerate().map(replicate_row).collect(),
                comparison: vec![comparison],
                fits: vec![row],
            },
        }
    }

    /// The model's row of the comparison, without what needs the other models; and how many
    /// motions that took.
    fn comparison(&self, fit: Option<&Fit>, status: &FitStatus) -> (ComparisonRow, usize) {
        let (campaign, model) = (self.input.campaign.name.clone(), self.input.model);
        let row =
            ComparisonRow { campaign, model, status: status.clone(), ..ComparisonRow::blank() };
        let Some(Fit { point, cost, .. }) = fit else { return (row, 0) };
        let [j_d, j_v, j_sigma @ .., j_alpha] = point.parts();
        let objective = &point.evaluator.objective;
        let terms: usize = self.measurements.iter().map(|each| objective.terms(each).count()).sum();
        let free = point.evaluator.parameters.len();
        let (j_left_out, mut solves) = point.leave_one_frequency_out();
        let mut row = ComparisonRow {
            j: *cost,
            j_d,
            j_v,
            j_sigma: j_sigma.iter().sum(),
            j_alpha,
            j_left_out,
            free: free as i64,
            terms: terms as i64,
            criterion: bic(*cost, terms, free),
            ..row
        };
        let other = match self.input.fit.gait_input {
            GaitInput::Commanded => GaitInput::Measured,
            GaitInput::Measured => GaitInput::Commanded,
        };
        if self.input.model != Model::NoSkidMeasured {
            let otherwise = Objective { gait_input: other, ..objective.as_ref().clone() };
            let found = point.refit_otherwise(&otherwise);
            solves += found.solves;
            row.other_gait_input = Some(other);
            // A trial without a motion costs more than any fit.
            if found.cost < PENALTY / self.measurements.len() as f64 {
                row.other_gait_j = found.cost;
                let robot = otherwise.robot_with(&point.evaluator.parameters, &found.ended);
                row.other_gait_parameters = self.parameters_of(&robot);
            }
        }
        (row, solves)
    }

    fn without_trials(&self) -> JobResult {
        let status = FitStatus::Failed("failed: no trial with metrics".to_owned());
        let (comparison, _) = self.comparison(None, &status);
        let fits = vec![self.fit_row(&self.robot, status)];
        let tables = Fitted { fits, comparison: vec![comparison], ..Fitted::default() };
        JobResult { tables, replicates: Vec::new() }
    }

    /// A row with the parameters that the model knows; all else is missing.
    fn fit_row(&self, robot: &Robot, status: FitStatus) -> FitRow {
        let (FitInput { campaign, model, .. }, parameters) =
            (self.input, self.parameters_of(robot));
        let campaign = campaign.name.clone();
        FitRow { campaign, model: *model, parameters, status, ..FitRow::blank() }
    }

    fn parameters_of(&self, robot: &Robot) -> ByParameter<f64> {
        ByParameter::from_fn(|parameter| {
            let is_known = self.input.model.knows(parameter, &self.gait);
            if is_known { parameter.of(robot) } else { f64::NAN }
        })
    }
}

/// A fit that is not complete yet.
struct Fit<'o> {
    point: FittedPoint<'o>,
    cost: f64,
    resumed: usize,
    solves: usize,
    /// One per free parameter, or none.
    profiles: Vec<Profile>,
    replicates: Vec<Refit>,
}

impl Fit<'_> {
    /// Lower and upper limits of the free parameters' 95 % intervals: the replicates' quantiles,
    /// corrected for noise that counts twice, or without replicates the profiles' limits. Missing
    /// where the interval is open: where the profile does not end it, or where the replicates'
    /// quantile is a bound.
    fn intervals(&self, resampler: &Resampler) -> [Vec<f64>; 2] {
        let spread = self.point.noise_correction(&resampler.noises()).spread;
        [0, 1].map(|side| {
            let limit = |(index, free): (usize, &FreeParameter)| {
                let profiled = self.profiles.get(index).map(|profile| profile.interval[side]);
                if profiled == Some(None) {
                    return f64::NAN;
                }
                let limit = match self.replicates.is_empty() {
                    true => profiled.flatten().unwrap_or(f64::NAN),
                    false => {
                        let values = self.replicates.iter().map(|refit| refit.values[index]);
                        quantiles(values.collect(), [OUTSIDE, 1.0 - OUTSIDE])[side]
                    }
                };
                if free.is_at_bound(limit)[side] {
                    return f64::NAN;
                }
                let fitted = self.point.values[index];
                match self.replicates.is_empty() {
                    true => limit,
                    false => fitted * (limit / fitted).powf(spread),
                }
            };
            self.point.evaluator.parameters.iter().enumerate().map(limit).collect()
        })
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
    use crate::config::Config;
    use crate::config::SigmaKind;
    use crate::fit::Measurement;
    use crate::metrics::GaitMetrics;
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

    #[test]
    fn a_profile_that_finds_a_lower_objective_resumes_the_fit() {
        let config = Config::default();
        let (robot, gait) = config.campaign_setup(CAMPAIGN).expect("the paper's");
        let measurements = measurements();
        let resampler = Resampler::new(CAMPAIGN, 1, &measurements, &BTreeMap::new());
        let job = Job {
            input: &FitInput::new(&config, CAMPAIGN, Model::SkidRoll).expect("the paper's"),
            robot: robot.clone(),
            gait,
            measured: Vec::new(),
            resampler: &resampler,
            measurements: &measurements,
        };
        let (weights, gait_input) = (config.campaign[CAMPAIGN].weights, config.fit.gait_input);
        let objective = Objective {
            model: job.input.model,
            robot,
            gait,
            weights,
            gait_input,
            measurements: measurements.clone(),
        };
        let parameters = job.input.free();
        // Away from the best, which is at 100.7, 33.9, 43.6 kg/s.
        let point = FittedPoint::new(&objective, &parameters, vec![95.0, 34.0, 44.0]);
        let began = point.cost;
        let mut fit = Fit {
            cost: point.cost,
            point,
            resumed: 0,
            solves: 0,
            profiles: Vec::new(),
            replicates: Vec::new(),
        };
        job.follow_profiles(&mut fit);
        assert!(began > 0.269 && fit.resumed >= 1, "{began} {}", fit.resumed);
        assert!((fit.cost / 0.26140684 - 1.0).abs() < 1e-6, "{}", fit.cost);
        // The profiles are those of the lower fit.
        assert!(fit.profiles.iter().all(|profile| profile.lower_than(fit.cost).is_none()));
    }

    #[test]
    fn known_measurements_are_fitted_as_ever() {
        let mut config = Config::default();
        config.fit.starts = 1;
        config.fit.bootstrap = 2;
        let (robot, gait) = config.campaign_setup(CAMPAIGN).expect("the paper's");
        let measurements = measurements();
        let resampler = Resampler::new(CAMPAIGN, 1, &measurements, &BTreeMap::new());
        let input = &FitInput::new(&config, CAMPAIGN, Model::SkidRoll).expect("the paper's");
        let (measured, resampler, measurements) = (Vec::new(), &resampler, &measurements[..]);
        let job = Job { input, robot, gait, measured, resampler, measurements };
        let Fitted { fits, bootstrap, comparison, predictions, .. } = job.run(&|_| {}).tables;
        let (fit, first) = (&fits[0], Parameter::Skid0);
        let found = Parameter::SKID.map(|skid| fit.parameters[skid]).into_iter();
        let found = found.chain([fit.j, fit.upper[first], bootstrap[1].parameters[first]]);
        let predicted = predictions[20].metrics;
        let others = [comparison[0].j_left_out, predicted.d_m, predicted.sigma[0]];
        let found = found.chain(others).map(|number| format!("{number:.4e}"));
        let found = found.collect::<Vec<_>>().join(" ");
        const KNOWN: &str =
            "1.0069e2 3.3889e1 4.3584e1 2.6141e-1 1.0069e2 1.0069e2 2.6762e-1 4.3931e-1 3.0847e-2";
        assert_eq!(found, KNOWN);
    }
}
