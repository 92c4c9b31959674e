//! One model of one campaign: its fit, what it is worth, and what it predicts.

use std::sync::atomic::Ordering;

use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_mechanics::REFERENCE_ACCURACY;
use trilink_robot::{Parameter, Robot};
use trilink_tables::config::GaitInput;
use trilink_tables::{BootstrapRow, FitRow, FitStatus, LawLike};

use super::adequacy::Adequacy;
use super::criterion;
use super::fitted_point::FittedPoint;
use super::input::FreeParameter;
use super::intervals::{Intervals, Systematic};
use super::law_class::law_is_like;
use super::objective::{Objective, Protocol};
use super::profile::{Profile, profile, profile_limits};
use super::resampler::Resampler;
use super::search::Ended;
use super::starts::{Start, search_all, search_from};
use super::terms::PENALTY;
use super::{FitData, FitEvent, FitInput, Fitted, OnEvent, Replicates};

/// Fall of the objective, relative to it, for which a fit is resumed.
const LOWER: f64 = 1e-9;
const MOST_RESUMES: usize = 10;
/// Most of the usual starts that a fit takes which has a start nearby.
const USUAL_STARTS: usize = 2;

/// One model of one campaign.
pub(super) struct Job<'j> {
    pub input: &'j FitInput,
    pub free: Vec<FreeParameter>,
    pub objective: Objective,
    /// Coefficients that trials of other kinds gave.
    pub measured: Vec<Parameter>,
    /// The robot with one of its uncertain parameters off by its standard deviation.
    pub others: Vec<Robot>,
    pub resampler: &'j Resampler,
    replicates: &'j Replicates,
}

impl<'j> Job<'j> {
    pub(crate) fn new(
        input: &'j FitInput,
        data: &FitData,
        resampler: &'j Resampler,
        replicates: &'j Replicates,
    ) -> Self {
        let alone = Protocol { name: String::new(), ..input.protocol() };
        Self::of_protocols(vec![alone], input, input.free(), data, resampler, replicates)
    }

    /// Of several campaigns of one robot, with one set of what is `free`.
    pub(crate) fn pooled(
        inputs: &'j [FitInput],
        free: Vec<FreeParameter>,
        data: &FitData,
        resampler: &'j Resampler,
        replicates: &'j Replicates,
    ) -> Self {
        let protocols = inputs.iter().map(FitInput::protocol).collect();
        Self::of_protocols(protocols, &inputs[0], free, data, resampler, replicates)
    }

    fn of_protocols(
        protocols: Vec<Protocol>,
        input: &'j FitInput,
        free: Vec<FreeParameter>,
        data: &FitData,
        resampler: &'j Resampler,
        replicates: &'j Replicates,
    ) -> Self {
        let (robot, measured) = input.measured_robot(data);
        let others = input.uncertain_robots(&robot, data);
        let (laws, gait_input) = (input.model.value.laws(), input.gait_input());
        let measurements = resampler.measurements.clone();
        let objective = Objective::pooled(laws, robot, protocols, gait_input, measurements);
        Self { input, free, objective, measured, others, resampler, replicates }
    }

    /// This job, cancellable by `cancel`.
    pub(crate) fn cancelled_by(mut self, cancel: &CancelToken) -> Self {
        self.objective.cancel = cancel.clone();
        self
    }

    /// The model's rows, without what needs the campaign's other models.
    ///
    /// # Errors
    /// The work was cancelled.
    pub(crate) fn run(&self, on_event: OnEvent) -> Result<Fitted, Cancelled> {
        if self.objective.measurements.is_empty() {
            let status = FitStatus::Failed("failed: no trial with metrics".to_owned());
            let comparison = vec![self.comparison_row(status.clone())];
            let row = |job: &Self| job.fit_row(&job.objective.robot, status.clone());
            let alternatives = self.driven_otherwise().iter().map(row).collect();
            let fits = vec![row(self)];
            return Ok(Fitted { fits, alternatives, comparison, ..Fitted::default() });
        }
        let starts = search_all(&self.objective, &self.free, self.input.fit.starts);
        self.objective.cancel.check()?;
        let (mut fit, status) = self.best_of(&starts);
        if status.is_ok() {
            self.follow_profiles(&mut fit)?;
            self.bootstrap(&mut fit, on_event)?;
            self.assess(&mut fit)?;
        }
        let alternative = self
            .driven_otherwise()
            .map(|job| job.nearby(&fit.point.values, on_event))
            .transpose()?;
        if let Some(other) = alternative.as_ref().filter(|other| other.status.is_ok()) {
            let values: Vec<f64> = other.free.iter().map(|of| other.parameters[*of]).collect();
            self.note_shift(&mut fit, &values);
        }
        Ok(self.rows(fit, &starts, status, alternative))
    }

    /// The fit and its row, where no other model is compared with it; searches go out from the usual
    /// starts and from `near` values.
    ///
    /// # Errors
    /// The work was cancelled.
    pub(crate) fn run_alone(&self, near: &[Vec<f64>]) -> Result<(Fit<'_>, FitRow), Cancelled> {
        let mut starts = search_all(&self.objective, &self.free, self.input.fit.starts);
        let from = |values: &Vec<f64>| {
            search_from(self.objective.evaluator(self.free.clone()), values.clone())
        };
        starts.par_extend(near.par_iter().map(from));
        self.objective.cancel.check()?;
        let (mut fit, status) = self.best_of(&starts);
        if status.is_ok() {
            self.follow_profiles(&mut fit)?;
            self.bootstrap(&mut fit, &|_| {})?;
            self.assess(&mut fit)?;
            if let Some(other) = self.driven_otherwise() {
                let evaluator = other.objective.evaluator(self.free.clone());
                let near = search_from(evaluator, fit.point.values.clone());
                fit.solves += near.solves;
                if near.cost < PENALTY {
                    self.note_shift(&mut fit, &near.ended);
                }
            }
        }
        let row = self.row(&fit, &starts, status);
        Ok((fit, row))
    }

    /// The fit that a row has, with the replicates that are given; `otherwise` is driven by the other
    /// gait.
    pub(crate) fn known(&self, row: &FitRow, otherwise: Option<&FitRow>) -> Fit<'_> {
        let values = |row: &FitRow| -> Vec<f64> {
            self.free.iter().map(|of| row.parameters[of.parameter]).collect()
        };
        let evaluator = self.objective.evaluator(self.free.clone());
        let mut fit = Fit::new(FittedPoint::new(evaluator, values(row)), row.j);
        (fit.replicates, fit.criteria) = self.given_replicates(&fit.point).into_iter().unzip();
        fit.systematic = Systematic::new(&fit.point, &self.others).0;
        if let Some(other) = otherwise {
            self.note_shift(&mut fit, &values(other));
        }
        fit
    }

    /// The fit of the start that ended lowest, and whether its motions exist.
    fn best_of<'f>(&'f self, starts: &[Start]) -> (Fit<'f>, FitStatus) {
        // What is less than the motions' own inaccuracy is nothing: the first of these is best.
        let floor = |start: &Start| start.cost.max(REFERENCE_ACCURACY);
        let best = starts.iter().min_by(|a, b| floor(a).total_cmp(&floor(b)));
        let best = best.expect("there is at least one start").clone();
        let evaluator = self.objective.evaluator(self.free.clone());
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
            free: self.free.clone(),
            objective: self.objective.driven_as(gait_input),
            measured: self.measured.clone(),
            others: self.others.clone(),
            ..*self
        })
    }

    /// The fit's row, without profiles if there are replicates, where a fit nearby has these values: searches go out from
    /// there and from the first of the usual starts.
    fn nearby(&self, values: &[f64], on_event: OnEvent) -> Result<FitRow, Cancelled> {
        let parameters = self.free.clone();
        let near = search_from(self.objective.evaluator(parameters.clone()), values.to_vec());
        let mut starts = vec![near];
        if !parameters.is_empty() {
            let usual = self.input.fit.starts.min(USUAL_STARTS);
            starts.extend(search_all(&self.objective, &parameters, usual));
        }
        self.objective.cancel.check()?;
        let (mut fit, status) = self.best_of(&starts);
        if status.is_ok() {
            match self.input.fit.bootstrap {
                0 => self.follow_profiles(&mut fit)?,
                _ => self.bootstrap(&mut fit, on_event)?,
            }
            self.assess(&mut fit)?;
            self.note_shift(&mut fit, values);
        }
        Ok(self.row(&fit, &starts, status))
    }

    /// Profiles of all free parameters; a lower objective on one of them resumes the fit.
    fn follow_profiles(&self, fit: &mut Fit) -> Result<(), Cancelled> {
        if !self.input.fit.profiles {
            return Ok(());
        }
        loop {
            let limits = profile_limits(&fit.point, self.resampler);
            let point = &fit.point;
            fit.profiles = limits
                .par_iter()
                .enumerate()
                .map(|(index, limit)| profile(point, index, *limit))
                .collect();
            self.objective.cancel.check()?;
            fit.solves += fit.profiles.iter().map(|profile| profile.solves).sum::<usize>();
            let lower = fit.profiles.iter().filter_map(|profile| profile.lower_than(point.cost));
            let lowest = lower.min_by(|a, b| a.cost.total_cmp(&b.cost)).cloned();
            let Some(lowest) = lowest.filter(|_| fit.resumed < MOST_RESUMES) else { return Ok(()) };
            let resumed = search_from(fit.point.evaluator.clone(), lowest.values);
            fit.solves += resumed.solves;
            if resumed.cost >= fit.cost * (1.0 - LOWER) {
                return Ok(());
            }
            fit.resumed += 1;
            fit.cost = resumed.cost;
            fit.point = FittedPoint::new(fit.point.evaluator.clone(), resumed.ended);
        }
    }

    /// Replicates that other shards fitted, with their Schwarz criteria.
    fn given_replicates(&self, point: &FittedPoint) -> Vec<(Start, f64)> {
        let parameters = &point.evaluator.parameters;
        let (campaign, model) = (&self.input.campaign.name, self.input.model.name);
        let is_own = |row: &&BootstrapRow| row.campaign == *campaign && row.model == model;
        let known = |row: &BootstrapRow| {
            let refit = Start {
                began: point.values.clone(),
                ended: parameters.iter().map(|free| row.parameters[free.parameter]).collect(),
                cost: row.j,
                solves: usize::try_from(row.solves).unwrap_or_default(),
                stopped: row.stopped,
            };
            (refit, row.criterion_resampled)
        };
        let given = self.replicates.given.get(&self.objective.gait_input);
        given.into_iter().flatten().filter(is_own).map(known).collect()
    }

    fn bootstrap(&self, fit: &mut Fit, on_event: OnEvent) -> Result<(), Cancelled> {
        // Replicates without noise would all be the same.
        let total = if self.resampler.is_silent() { 0 } else { self.input.fit.bootstrap };
        let numbers = &self.replicates.numbers;
        let numbers = numbers.start.min(total)..numbers.end.min(total);
        let (point, ended, total) = (&fit.point, Ended::default(), numbers.len());
        let (parameters, driven_by) = (&point.evaluator.parameters, self.objective.gait_input);
        let mut replicates = self.given_replicates(point);
        let fitted = numbers.into_par_iter().map(|number| {
            let refit = point.refit(&self.resampler.draw(number), &ended);
            // Models are compared of one campaign.
            let criterion = match self.objective.protocols.len() {
                1 => criterion::resampled(point, self.resampler, number),
                _ => f64::NAN,
            };
            // A cancelled search has stopped short of the minimum.
            self.objective.cancel.check()?;
            let done = ended.load(Ordering::Relaxed);
            let row = &self.replicate_row(parameters, number, &refit, criterion);
            on_event(FitEvent::Replicate { driven_by, row, done, total });
            Ok((refit, criterion))
        });
        replicates.extend(fitted.collect::<Result<Vec<_>, Cancelled>>()?);
        (fit.replicates, fit.criteria) = replicates.into_iter().unzip();
        fit.solves += fit.replicates.iter().map(|refit| refit.solves).sum::<usize>();
        Ok(())
    }

    /// Whether the model fits, and what all trials share.
    fn assess(&self, fit: &mut Fit) -> Result<(), Cancelled> {
        fit.adequacy = Adequacy::new(&fit.point, self.resampler);
        if self.objective.laws.skid.is_dry() {
            fit.law_is_like = law_is_like(&fit.point, self.resampler);
        }
        let has_intervals = self.input.fit.bootstrap > 0 || self.input.fit.profiles;
        if has_intervals && !fit.point.values.is_empty() {
            let (systematic, solves) = Systematic::new(&fit.point, &self.others);
            (fit.systematic, fit.solves) = (systematic, fit.solves + solves);
        }
        self.objective.cancel.check()
    }

    /// Takes the coefficients with the measured gait for a known shift where the command drives
    /// the model.
    fn note_shift(&self, fit: &mut Fit, values: &[f64]) {
        if self.objective.gait_input == GaitInput::Commanded {
            fit.systematic.gait = Some(fit.point.shift_to(values));
        }
    }
}

/// A fit that is not complete yet.
pub(super) struct Fit<'o> {
    pub point: FittedPoint<'o>,
    pub cost: f64,
    pub resumed: usize,
    /// Motions solved for so far.
    pub solves: usize,
    /// One per free parameter, or none.
    pub profiles: Vec<Profile>,
    pub replicates: Vec<Start>,
    /// Criteria of the replicates with frequencies resampled, too.
    pub criteria: Vec<f64>,
    pub adequacy: Adequacy,
    /// The law that its own is not told from.
    pub law_is_like: Option<LawLike>,
    pub systematic: Systematic,
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
            law_is_like: None,
            systematic: Systematic::default(),
        }
    }

    pub(crate) fn intervals(&self, resampler: &Resampler) -> Intervals {
        let Self { point, profiles, replicates, adequacy, systematic, .. } = self;
        Intervals::new(point, profiles, replicates, resampler, adequacy, systematic)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use trilink_robot::Model;
    use trilink_robot::metrics::{GaitMetrics, Metric};
    use trilink_tables::config::{Config, SigmaKind};
    use trilink_tables::{Columns as _, ResidualRow, TrialRow};

    use trilink_robot::Quantity;

    use super::*;
    use crate::Measurement;

    const CAMPAIGN: &str = "kinematic-symmetric";

    fn measurements() -> Vec<Measurement> {
        let data = include_str!("../tests/fixtures/kinematic-symmetric.csv");
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
        job.follow_profiles(&mut fit).unwrap();
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
        let Fitted { fits, bootstrap, comparison, predictions, residuals, .. } =
            job.run(&|_| {}).unwrap();
        let (fit, first) = (&fits[0], Quantity::Skid.of(0));
        let found = Quantity::Skid.of_each().map(|skid| fit.parameters[skid]).into_iter();
        // Nothing tells their noise.
        assert!(fit.upper[first].is_nan() && bootstrap.is_empty());
        let reasons = predictions.iter().all(|row| row.no_interval == fit.no_interval);
        assert!(fit.no_interval.is_some() && reasons);
        let found = found.chain([fit.j]);
        let predicted = predictions[20].metrics;
        let others = [comparison[0].j_left_out, predicted.d_m, predicted.sigma[0]];
        let found = found.chain(others).map(|number| format!("{number:.4e}"));
        let found = found.collect::<Vec<_>>().join(" ");
        const KNOWN: &str = "1.0069e2 3.3889e1 4.3584e1 2.6141e-1 2.6762e-1 4.3931e-1 3.0847e-2";
        assert_eq!(found, KNOWN);
        // The objective is made of the residuals.
        let weights = &config.campaign[CAMPAIGN].weights;
        let term = |row: &ResidualRow| {
            let weight = weights.of(Metric::of_column(&row.metric).expect("a metric"));
            assert_eq!(row.residual, row.measured - row.predicted);
            weight * (row.residual / row.measured).abs()
        };
        let sum: f64 = residuals.iter().map(term).sum();
        assert!((sum / measurements().len() as f64 / fit.j - 1.0).abs() < 1e-6, "{sum} {}", fit.j);
        let names = measurements().into_iter().map(|of| of.trial).collect::<BTreeSet<_>>();
        assert_eq!(residuals.iter().map(|row| row.trial.clone()).collect::<BTreeSet<_>>(), names);
    }
}
