//! Fit of one model to one campaign: search, uncertainty, adequacy and predictions.

use std::sync::atomic::Ordering;

use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_mechanics::REFERENCE_ACCURACY;
use trilink_robot::Parameter;
use trilink_tables::config::{GaitInput, GroupNumbers};
use trilink_tables::{BootstrapRow, FitRow, FitStatus, LawLike};

use super::adequacy::Adequacy;
use super::criterion;
use super::fitted_point::FittedPoint;
use super::input::FreeParameter;
use super::intervals::{Intervals, Systematic};
use super::law_class::law_is_like;
use super::objective::{Failure, Objective, Protocol};
use super::profile::{Profile, profile, profile_limits};
use super::resampler::Resampler;
use super::robots::Robots;
use super::search::Ended;
use super::starts::{Start, search_all, search_from};
use super::terms::PENALTY;
use super::variation::{Variation, VariationFrom};
use super::{FitData, FitEvent, FitInput, Fitted, OnEvent, Replicates};

/// Minimum relative decrease of the objective for which the result of a search resumed from a profile replaces the fit.
const MIN_DECREASE: f64 = 1e-9;
const MAX_RESUMES: usize = 10;
/// Maximum number of other starts for a fit that also starts from the result of a related fit.
const MAX_SPREAD_STARTS: usize = 2;

/// Fit of one model to one campaign, or to several campaigns together.
pub(super) struct Job<'j> {
    pub input: &'j FitInput,
    pub free: Vec<FreeParameter>,
    pub objective: Objective,
    /// Coefficients measured by joint-release and coast-down trials.
    pub measured: Vec<Parameter>,
    /// Copies of the robots, each with one uncertain parameter increased by its standard deviation.
    pub perturbed_robots: Vec<Robots>,
    pub resampler: &'j Resampler,
    /// Trials that are left out because they are unlike their repeats.
    pub unlike_repeats: Vec<String>,
    replicates: &'j Replicates,
}

impl<'j> Job<'j> {
    pub(crate) fn new(
        input: &'j FitInput,
        data: &FitData,
        resampler: &'j Resampler,
        replicates: &'j Replicates,
    ) -> Self {
        let protocol = Protocol { name: String::new(), ..input.protocol() };
        let inputs = std::slice::from_ref(input);
        let numbers = [GroupNumbers::of_single_robot()];
        let protocols = vec![protocol];
        Self::from_protocols(protocols, inputs, &numbers, input.free(), data, resampler, replicates)
    }

    /// Prepares the fit of one set of `free` parameters to several campaigns; `numbers` are those of the parameters of each
    /// campaign's robot.
    pub(crate) fn pooled(
        inputs: &'j [FitInput],
        numbers: &[GroupNumbers],
        free: Vec<FreeParameter>,
        data: &FitData,
        resampler: &'j Resampler,
        replicates: &'j Replicates,
    ) -> Self {
        let protocols = inputs.iter().map(FitInput::protocol).collect();
        Self::from_protocols(protocols, inputs, numbers, free, data, resampler, replicates)
    }

    fn from_protocols(
        protocols: Vec<Protocol>,
        inputs: &'j [FitInput],
        numbers: &[GroupNumbers],
        free: Vec<FreeParameter>,
        data: &FitData,
        resampler: &'j Resampler,
        replicates: &'j Replicates,
    ) -> Self {
        let input = &inputs[0];
        let unlike_repeats = inputs.iter().flat_map(|input| input.unlike_repeats(data)).collect();
        let mut measured = Vec::new();
        let robots = inputs.iter().zip(numbers).map(|(input, numbers)| {
            let (robot, own) = input.measured_robot(data);
            for parameter in own.into_iter().filter_map(|own| numbers.of_group(own)) {
                if !measured.contains(&parameter) {
                    measured.push(parameter);
                }
            }
            (robot, *numbers)
        });
        let robots: Robots = robots.collect();
        let perturbed_robots = robots.perturbed(inputs, data);
        let objective = Objective::pooled(
            input.model.value.laws(),
            robots,
            protocols,
            input.gait_input(),
            resampler.measurements.clone(),
        );
        Self {
            input,
            free,
            objective,
            measured,
            perturbed_robots,
            resampler,
            unlike_repeats,
            replicates,
        }
    }

    /// Makes the job cancellable by `cancel`.
    pub(crate) fn cancelled_by(mut self, cancel: &CancelToken) -> Self {
        self.objective.cancel = cancel.clone();
        self
    }

    /// Fits the model and returns its rows, except for the columns that need the campaign's other models.
    ///
    /// # Errors
    /// Returns an error if the fit is cancelled.
    pub(crate) fn run(&self, on_event: OnEvent) -> Result<Fitted, Cancelled> {
        if self.objective.measurements.is_empty() {
            let failure =
                Failure { status: FitStatus::Failed, reason: "no trial with metrics".to_owned() };
            let comparison = vec![self.comparison_row(failure.status)];
            let fit_row = |job: &Self| job.fit_row(&job.objective.robots, Err(failure.clone()));
            let alternatives = self.with_other_gait_input().iter().map(fit_row).collect();
            let fits = vec![fit_row(self)];
            return Ok(Fitted { fits, alternatives, comparison, ..Fitted::default() });
        }
        let starts = search_all(&self.objective, &self.free, self.input.fit.starts);
        self.objective.cancel.check()?;
        let (mut fit, motions) = self.best_of(&starts);
        if motions.is_ok() {
            self.assess_noise(&mut fit);
            self.follow_profiles(&mut fit)?;
            self.bootstrap(&mut fit, on_event)?;
            self.assess(&mut fit)?;
        }
        let alternative = self
            .with_other_gait_input()
            .map(|job| job.refit_nearby(&fit.point.values, on_event))
            .transpose()?;
        if let Some(other) = alternative.as_ref().filter(|other| other.status.is_ok()) {
            let values: Vec<f64> = other.free.iter().map(|of| other.parameters[*of]).collect();
            self.record_gait_shift(&mut fit, &values);
        }
        Ok(self.rows(fit, &starts, motions, alternative))
    }

    /// Fits the model without comparing it with others, and returns the fit and its row. Searches start from the
    /// configured values, from points spread over the range between the bounds, and from the parameter values in
    /// `near`.
    ///
    /// # Errors
    /// Returns an error if the fit is cancelled.
    pub(crate) fn run_alone(&self, near: &[Vec<f64>]) -> Result<(Fit<'_>, FitRow), Cancelled> {
        let mut starts = search_all(&self.objective, &self.free, self.input.fit.starts);
        starts.par_extend(near.par_iter().map(|values| {
            search_from(self.objective.evaluator(self.free.clone()), values.clone())
        }));
        self.objective.cancel.check()?;
        let (mut fit, motions) = self.best_of(&starts);
        if motions.is_ok() {
            self.assess_noise(&mut fit);
            self.follow_profiles(&mut fit)?;
            self.bootstrap(&mut fit, &|_| {})?;
            self.assess(&mut fit)?;
            if let Some(other) = self.with_other_gait_input() {
                let evaluator = other.objective.evaluator(self.free.clone());
                let refit = search_from(evaluator, fit.point.values.clone());
                fit.solves += refit.solves;
                if refit.cost < PENALTY {
                    self.record_gait_shift(&mut fit, &refit.ended);
                }
            }
        }
        let row = self.row(&fit, &starts, motions);
        Ok((fit, row))
    }

    /// Restores a fit from its row and this job's replicates, without a search; `alternative` is the row for the same
    /// model driven by the other gait (measured or commanded).
    pub(crate) fn restore(&self, row: &FitRow, alternative: Option<&FitRow>) -> Fit<'_> {
        let values = |row: &FitRow| -> Vec<f64> {
            self.free.iter().map(|of| row.parameters[of.parameter]).collect()
        };
        let evaluator = self.objective.evaluator(self.free.clone());
        let mut fit = self.fit_at(FittedPoint::new(evaluator, values(row)), row.j);
        fit.forget_needless_variation(row.adequate);
        (fit.replicates, fit.criteria) = self.given_replicates(&fit.point).into_iter().unzip();
        fit.systematic = Systematic::new(&fit.point, &self.perturbed_robots).0;
        if let Some(other) = alternative {
            self.record_gait_shift(&mut fit, &values(other));
        }
        fit
    }

    /// Returns a fit in progress at a point with the given objective.
    fn fit_at<'f>(&'f self, point: FittedPoint<'f>, cost: f64) -> Fit<'f> {
        let variation = self.variation(&point);
        Fit::new(point, variation, cost)
    }

    /// Tests the adequacy of the model, which decides whether the estimated variation between trials is needed.
    fn assess_noise<'f>(&'f self, fit: &mut Fit<'f>) {
        fit.adequacy = Adequacy::new(&fit.point, &fit.variation, &self.perturbed_robots);
        fit.forget_needless_variation(fit.adequacy.is_adequate);
    }

    fn variation(&self, point: &FittedPoint) -> Variation<'j> {
        Variation::new(point, self.resampler, self.input.fit.day_sd)
    }

    /// Returns the fit from the start with the lowest final objective, and whether the model has a
    /// periodic solution for every trial.
    fn best_of<'f>(&'f self, starts: &[Start]) -> (Fit<'f>, Result<(), Failure>) {
        // Objectives below the accuracy of the solver count as equal: the first of them is best.
        let floor = |start: &Start| start.cost.max(REFERENCE_ACCURACY);
        let best = starts.iter().min_by(|a, b| floor(a).total_cmp(&floor(b)));
        let best = best.expect("there is at least one start").clone();
        let evaluator = self.objective.evaluator(self.free.clone());
        let point = FittedPoint::new(evaluator, best.ended);
        let motions = point.check_motions();
        let solves =
            starts.iter().map(|start| start.solves).sum::<usize>() + point.evaluator.solves;
        (Fit { solves, ..self.fit_at(point, best.cost) }, motions)
    }

    /// Returns the same job driven by the other of the measured and the commanded gait; `None` if the model can be driven by
    /// one of them only.
    fn with_other_gait_input(&self) -> Option<Self> {
        Some(Self {
            input: self.input,
            free: self.free.clone(),
            objective: self.objective.driven_as(self.input.other_gait_input()?),
            measured: self.measured.clone(),
            perturbed_robots: self.perturbed_robots.clone(),
            unlike_repeats: self.unlike_repeats.clone(),
            ..*self
        })
    }

    /// Fits the model, starting from `values` (the result of a related fit) and from at most [`MAX_SPREAD_STARTS`]
    /// other starts, and returns its row. Profiles are computed only if no replicates are configured.
    fn refit_nearby(&self, values: &[f64], on_event: OnEvent) -> Result<FitRow, Cancelled> {
        let parameters = self.free.clone();
        let near = search_from(self.objective.evaluator(parameters.clone()), values.to_vec());
        let mut starts = vec![near];
        if !parameters.is_empty() {
            let count = self.input.fit.starts.min(MAX_SPREAD_STARTS);
            starts.extend(search_all(&self.objective, &parameters, count));
        }
        self.objective.cancel.check()?;
        let (mut fit, motions) = self.best_of(&starts);
        if motions.is_ok() {
            self.assess_noise(&mut fit);
            if self.input.fit.bootstrap == 0 {
                self.follow_profiles(&mut fit)?;
            } else {
                self.bootstrap(&mut fit, on_event)?;
            }
            self.assess(&mut fit)?;
            self.record_gait_shift(&mut fit, values);
        }
        Ok(self.row(&fit, &starts, motions))
    }

    /// Profiles all free parameters; if a profile reaches a lower objective, resumes the search from there.
    fn follow_profiles<'f>(&'f self, fit: &mut Fit<'f>) -> Result<(), Cancelled> {
        if !self.input.fit.profiles {
            return Ok(());
        }
        loop {
            let limits = profile_limits(&fit.point, &fit.variation);
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
            let Some(lowest) = lowest.filter(|_| fit.resumed < MAX_RESUMES) else { return Ok(()) };
            let resumed = search_from(fit.point.evaluator.clone(), lowest.values);
            fit.solves += resumed.solves;
            if resumed.cost >= fit.cost * (1.0 - MIN_DECREASE) {
                return Ok(());
            }
            fit.resumed += 1;
            fit.cost = resumed.cost;
            fit.point = FittedPoint::new(fit.point.evaluator.clone(), resumed.ended);
            fit.variation = self.variation(&fit.point);
            self.assess_noise(fit);
        }
    }

    /// Returns the bootstrap replicates that other shards (separate runs of the same fit) have computed, with their
    /// Schwarz criteria.
    fn given_replicates(&self, point: &FittedPoint) -> Vec<(Start, f64)> {
        let parameters = &point.evaluator.parameters;
        let campaign = &self.input.campaign.name;
        let model = self.input.model.name;
        let given: Option<&Vec<BootstrapRow>> =
            self.replicates.given.get(&self.objective.gait_input);
        given
            .into_iter()
            .flatten()
            .filter(|row| row.campaign == *campaign && row.model == model)
            .map(|row| {
                let refit = Start {
                    began: point.values.clone(),
                    ended: parameters.iter().map(|free| row.parameters[free.parameter]).collect(),
                    cost: row.j,
                    solves: usize::try_from(row.solves).unwrap_or_default(),
                    stopped: row.stopped,
                };
                (refit, row.criterion_resampled)
            })
            .collect()
    }

    /// Fits the replicates and computes their Schwarz criteria.
    fn bootstrap(&self, fit: &mut Fit, on_event: OnEvent) -> Result<(), Cancelled> {
        // Without noise, all replicates would be equal.
        let total = if self.resampler.is_noise_free() { 0 } else { self.input.fit.bootstrap };
        let numbers = &self.replicates.numbers;
        let numbers = numbers.start.min(total)..numbers.end.min(total);
        let total = numbers.len();
        let ended = Ended::default();
        let Fit { point, variation, .. } = &*fit;
        let parameters = &point.evaluator.parameters;
        let driven_by = self.objective.gait_input;
        let mut replicates = self.given_replicates(point);
        let fitted = numbers.into_par_iter().map(|number| {
            let refit = point.refit(&variation.draw(number), &ended);
            // Models are compared only within one campaign.
            let criterion = if self.objective.protocols.len() == 1 {
                criterion::resampled_criterion(point, self.resampler, number)
            } else {
                f64::NAN
            };
            // A cancelled search may have stopped short of the minimum.
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

    /// Computes the systematic uncertainty, and checks whether a simpler friction law is equivalent.
    fn assess(&self, fit: &mut Fit) -> Result<(), Cancelled> {
        if self.objective.laws.skid.is_dry() {
            fit.law_is_like = law_is_like(&fit.point, &fit.variation);
        }
        let has_intervals = self.input.fit.bootstrap > 0 || self.input.fit.profiles;
        if has_intervals && !fit.point.values.is_empty() {
            let (systematic, solves) = Systematic::new(&fit.point, &self.perturbed_robots);
            fit.systematic = systematic;
            fit.solves += solves;
        }
        self.objective.cancel.check()
    }

    /// Records the shift of the coefficients from `fit` to `values`, the coefficients of the fit in which the measured
    /// gait drives the model; does nothing unless the commanded gait drives the model of this job.
    fn record_gait_shift(&self, fit: &mut Fit, values: &[f64]) {
        if self.objective.gait_input == GaitInput::Commanded {
            fit.systematic.gait = Some(fit.point.shift_to(values));
        }
    }
}

/// Fit in progress.
pub(super) struct Fit<'o> {
    pub point: FittedPoint<'o>,
    pub variation: Variation<'o>,
    pub cost: f64,
    pub resumed: usize,
    /// Number of periodic solutions computed.
    pub solves: usize,
    /// One profile for each free parameter; empty if no profiles were computed.
    pub profiles: Vec<Profile>,
    pub replicates: Vec<Start>,
    /// Schwarz criteria for bootstrap resamples in which the frequencies and the trials at each of them are drawn at
    /// random, one for each replicate.
    pub criteria: Vec<f64>,
    pub adequacy: Adequacy,
    /// Simpler law that cannot be distinguished from the fitted one; `None` if the data distinguish them.
    pub law_is_like: Option<LawLike>,
    pub systematic: Systematic,
}

impl<'o> Fit<'o> {
    fn new(point: FittedPoint<'o>, variation: Variation<'o>, cost: f64) -> Self {
        Self {
            point,
            variation,
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

    /// Assumes no variation between trials if the noise of the cycles explains the residuals (`is_adequate`) and there
    /// are no repeats from which the variation was estimated.
    fn forget_needless_variation(&mut self, is_adequate: Option<bool>) {
        if self.variation.from == VariationFrom::Residuals && is_adequate == Some(true) {
            self.variation = self.variation.without_variation();
        }
    }

    pub(crate) fn intervals(&self) -> Intervals {
        let Self { point, profiles, replicates, adequacy, systematic, variation, .. } = self;
        Intervals::new(point, profiles, replicates, variation, adequacy, systematic)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use trilink_robot::Model;
    use trilink_robot::metrics::{GaitMetrics, Metric, padded};
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
                    sigma: padded(&fields[3..6]),
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
        // Start away from the minimum, which is at 100.7, 33.9, 43.6 kg/s.
        let evaluator = job.objective.evaluator(input.free());
        let point = FittedPoint::new(evaluator, vec![95.0, 34.0, 44.0]);
        let began = point.cost;
        let mut fit = job.fit_at(point, began);
        job.follow_profiles(&mut fit).unwrap();
        assert!(began > 0.269 && fit.resumed >= 1, "{began} {}", fit.resumed);
        assert!((fit.cost / 0.26140684 - 1.0).abs() < 1e-6, "{}", fit.cost);
        // The profiles belong to the resumed fit.
        assert!(fit.profiles.iter().all(|profile| profile.lower_than(fit.cost).is_none()));
    }

    #[test]
    fn the_known_measurements_give_the_known_fit() {
        let mut config = config();
        config.fit.starts = 1;
        config.fit.bootstrap = 2;
        let input = FitInput::new(&config, CAMPAIGN, Model::SKID_ROLL).expect("the paper's");
        let resampler = Resampler::new(1, measurements(), &BTreeMap::new());
        let replicates = Replicates::default();
        let job = Job::new(&input, &FitData::default(), &resampler, &replicates);
        let Fitted { fits, bootstrap, comparison, predictions, residuals, .. } =
            job.run(&|_| {}).unwrap();
        let fit = &fits[0];
        let first = Quantity::Skid.parameter(0);
        let coefficients = Quantity::Skid.of_each().map(|skid| fit.parameters[skid]).into_iter();
        // The test data have no standard errors.
        assert!(fit.upper[first].is_nan() && bootstrap.is_empty());
        let same_reason = predictions.iter().all(|row| row.no_interval == fit.no_interval);
        assert!(fit.no_interval.is_some() && same_reason);
        let predicted = predictions[20].metrics;
        let found = coefficients
            .chain([fit.j, comparison[0].j_left_out, predicted.d_m, predicted.sigma[0]])
            .map(|number| format!("{number:.4e}"))
            .collect::<Vec<_>>()
            .join(" ");
        const KNOWN: &str = "1.0069e2 3.3889e1 4.3584e1 2.6141e-1 2.6762e-1 4.3931e-1 3.0847e-2";
        assert_eq!(found, KNOWN);
        // The residuals add up to the objective.
        let weights = &config.campaign[CAMPAIGN].weights;
        let term = |row: &ResidualRow| {
            let weight = weights.for_metric(Metric::from_column(&row.metric).expect("a metric"));
            assert_eq!(row.residual, row.measured - row.predicted);
            weight * (row.residual / row.measured).abs()
        };
        let sum: f64 = residuals.iter().map(term).sum();
        assert!((sum / measurements().len() as f64 / fit.j - 1.0).abs() < 1e-6, "{sum} {}", fit.j);
        let names = measurements().into_iter().map(|of| of.trial).collect::<BTreeSet<_>>();
        assert_eq!(residuals.iter().map(|row| row.trial.clone()).collect::<BTreeSet<_>>(), names);
    }
}
