//! Fits with one set of coefficients for all campaigns of a robot.

use std::collections::BTreeMap;

use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_robot::Model;
use trilink_statistics::mean;
use trilink_tables::config::Config;
use trilink_tables::{
    Columns as _, FitRow, FitStatus, NotTested, NotTestedReason, PredictionSource, SharedFitRow,
};

use super::input::FreeParameter;
use super::job::Job;
use super::measurement::Measurement;
use super::resampler::Resampler;
use super::sharing::{BestModel, SharingTest};
use super::{FitData, FitInput, FitKey, Fitted, Replicates};

/// Inputs for fitting one model to all campaigns of a robot that list the model.
#[derive(Debug, Clone, PartialEq)]
pub struct SharedInput {
    pub robot: String,
    pub model: Model,
    /// Inputs for fitting the model to each campaign; at least two.
    pub campaigns: Vec<FitInput>,
    /// Inputs for every model of every campaign of the robot; the best model of each campaign provides the residuals
    /// for the test of whether the campaigns share their coefficients.
    pub models: Vec<FitInput>,
}

impl SharedInput {
    /// Returns the inputs for all shared fits that the configuration asks for: for each robot, one for each model that
    /// has free parameters and is listed in all campaigns of the robot, in the order of the first campaign's list.
    pub fn all(config: &Config) -> Vec<Self> {
        let robots = config.fit.shared.iter().flat_map(|shared| &shared.robot.0);
        robots.flat_map(|robot| Self::all_of_robot(config, robot)).collect()
    }

    fn all_of_robot(config: &Config, robot: &str) -> Vec<Self> {
        let (campaigns, common) = config.common(robot);
        if campaigns.len() < 2 {
            return Vec::new();
        }
        let mut models = FitInput::all(config);
        models.retain(|input| input.robot.name == robot);
        let inputs = common.into_iter().filter_map(|model| {
            let inputs = campaigns.iter().map(|name| FitInput::new(config, name, model));
            let campaigns = inputs.collect::<Option<Vec<_>>>()?;
            Some(Self { robot: robot.to_owned(), model, campaigns, models: models.clone() })
        });
        inputs.collect()
    }

    /// Returns the parameters that are free in at least one of the campaigns.
    fn free(&self) -> Vec<FreeParameter> {
        let mut free: Vec<FreeParameter> = Vec::new();
        for one in self.campaigns.iter().flat_map(FitInput::free) {
            if free.iter().all(|other| other.parameter != one.parameter) {
                free.push(one);
            }
        }
        free
    }

    pub fn key(&self) -> FitKey {
        FitKey::Shared { robot: self.robot.clone(), model: self.model }
    }

    fn names(&self) -> Vec<String> {
        self.campaigns.iter().map(|input| input.campaign.name.clone()).collect()
    }

    /// Returns the measurements of all campaigns, campaign by campaign.
    fn measurements(&self, data: &FitData) -> Vec<Measurement> {
        let campaigns = self.campaigns.iter().enumerate();
        campaigns
            .flat_map(|(campaign, input)| {
                let own = input.measurements(data).into_iter();
                own.map(move |measurement| Measurement { campaign, ..measurement })
            })
            .collect()
    }

    /// Returns, by trial name, a hash of everything that the fit reads from the trial.
    pub fn trials(&self, data: &FitData) -> BTreeMap<String, String> {
        self.campaigns.iter().flat_map(|input| input.trials(data)).collect()
    }

    /// Returns the inputs for all models of the campaigns, by the names of campaign and model.
    pub fn settings(&self) -> BTreeMap<String, &FitInput> {
        let inputs = self.models.iter();
        inputs
            .map(|input| (format!("{} {}", input.campaign.name, input.model.name), input))
            .collect()
    }

    /// Returns the reason why the measurements of the campaigns cannot be fitted together; `None` if they can.
    fn why_impossible(&self, measurements: &[Measurement]) -> Option<NotTested> {
        let lacks = |campaign: &usize| measurements.iter().all(|of| of.campaign != *campaign);
        if let Some(campaign) = (0..self.campaigns.len()).find(lacks) {
            let name = &self.campaigns[campaign].campaign.name;
            return Some(NotTested::new(NotTestedReason::NoTrials, name));
        }
        let free = self.free();
        let mut pairs = free.iter().flat_map(|a| free.iter().map(|b| (a.parameter, b.parameter)));
        let (part, whole) = pairs.find(|(a, b)| a != b && a.is_part_of(*b))?;
        let of = [whole, part].map(|of| of.name().to_owned()).to_vec();
        Some(NotTested { reason: NotTestedReason::PartOfFree, of })
    }

    /// Fits the campaigns together and tests whether they share their coefficients, given the separate fits in `known`.
    ///
    /// # Errors
    /// Returns an error if the fit is cancelled.
    pub(super) fn fit(
        &self,
        data: &FitData,
        known: &BTreeMap<FitKey, Fitted>,
        cancel: &CancelToken,
    ) -> Result<SharedFitRow, Cancelled> {
        let own = self.campaigns.iter().filter_map(|input| known.get(&input.key()));
        let separate: &[&FitRow] = &own.flat_map(|fitted| &fitted.fits).collect::<Vec<_>>();
        let measurements = self.measurements(data);
        let best_models = best_models(self, &measurements, known);
        let first = &self.campaigns[0];
        let campaign = self.names().join(" and ");
        let blank = SharedFitRow {
            robot: self.robot.clone(),
            campaigns: self.names(),
            j_separate: separate.iter().map(|row| row.j).sum(),
            ..SharedFitRow::blank()
        };
        if let Some(why) = self.why_impossible(&measurements) {
            let status = FitStatus::Failed;
            let failure = why.to_string();
            let gait_input = first.gait_input();
            let model = self.model;
            let fit = FitRow { campaign, model, gait_input, status, failure, ..FitRow::blank() };
            return Ok(SharedFitRow { fit, not_tested: Some(why), ..blank });
        }
        let resampler = Resampler::new(first.fit.seed, measurements, &data.cycles);
        let replicates = Replicates::default();
        let job = Job::pooled(&self.campaigns, self.free(), data, &resampler, &replicates)
            .cancelled_by(cancel);
        let (fit, row) = job.run_alone(&starting_values(&job, separate))?;
        let test = match (self.why_untestable(&row, separate), best_models) {
            (Some(why), _) => SharingTest::none(why),
            (None, None) => SharingTest::none(NotTestedReason::NoWholeModel),
            (None, Some(best_models)) => {
                SharingTest::new(&fit.point, blank.j_separate, &best_models, &fit.variation)
            }
        };
        let SharingTest { rise: [rise, rise_limit], p_value, sharing, not_tested } = test;
        let fit = FitRow { campaign, sharing, ..row };
        cancel.check()?;
        Ok(SharedFitRow { fit, rise, rise_limit, p_value, not_tested, ..blank })
    }

    /// Returns the reason why it cannot be tested whether the campaigns share their coefficients: a fit has failed, or
    /// a parameter of the shared fit is not free in all separate fits. `None` if it can be tested.
    fn why_untestable(&self, shared: &FitRow, separate: &[&FitRow]) -> Option<NotTested> {
        if !shared.status.is_ok() {
            return Some(NotTestedReason::SharedFitFailed.into());
        }
        if let Some(failed) = separate.iter().find(|row| !row.status.is_ok()) {
            return Some(NotTested::new(NotTestedReason::FitFailed, &failed.campaign));
        }
        let different = separate.iter().find(|row| row.free.len() < shared.free.len())?;
        Some(NotTested::new(NotTestedReason::OtherFree, &different.campaign))
    }
}

/// Returns starting values for the shared fit: the coefficients of each successful separate fit, and their geometric
/// means. Empty if all separate fits have failed.
fn starting_values(job: &Job, separate: &[&FitRow]) -> Vec<Vec<f64>> {
    let fitted = separate.iter().filter(|row| row.status.is_ok());
    let mut starts: Vec<Vec<f64>> = fitted
        .map(|row| job.free.iter().map(|free| row.parameters[free.parameter]).collect())
        .collect();
    if starts.is_empty() {
        return starts;
    }
    let means = (0..job.free.len())
        .map(|i| mean(starts.iter().map(|values| values[i].ln())).exp())
        .collect();
    starts.push(means);
    starts
}

/// Returns the best-fitting model for each campaign; `None` if some campaign has no model with a periodic solution for
/// every trial.
fn best_models(
    shared: &SharedInput,
    measurements: &[Measurement],
    known: &BTreeMap<FitKey, Fitted>,
) -> Option<Vec<BestModel>> {
    let campaigns = measurements.chunk_by(|a, b| a.campaign == b.campaign);
    campaigns
        .map(|own| {
            let name = &shared.campaigns[own[0].campaign].campaign.name;
            let inputs = shared.models.iter().filter(|input| input.campaign.name == *name);
            let models = inputs
                .filter_map(|input| known.get(&input.key()))
                .filter_map(|fitted| whole_model(fitted, own.len()));
            models.min_by(|a, b| a.j.total_cmp(&b.j))
        })
        .collect()
}

/// Returns the model of a fit with the predicted metrics for every trial; `None` if a trial has no prediction.
fn whole_model(fitted: &Fitted, trials: usize) -> Option<BestModel> {
    let fit = fitted.fits.first().filter(|fit| fit.status.is_ok())?;
    let rows = fitted.predictions.iter();
    let rows = rows.filter(|row| row.source == PredictionSource::Trial);
    let metrics: Vec<_> = rows.map(|row| row.metrics).collect();
    let is_adequate = fit.adequate == Some(true);
    (metrics.len() == trials).then_some(BestModel { j: fit.j, metrics, is_adequate })
}
