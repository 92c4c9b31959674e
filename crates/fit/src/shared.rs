//! Fits with one set of coefficients for all campaigns of a robot, or of robots with common wheels.

use std::collections::BTreeMap;

use serde::Serialize;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_robot::Model;
use trilink_statistics::mean;
use trilink_tables::config::{Config, GroupNumbers, RobotGroup};
use trilink_tables::{
    Columns as _, FitRow, FitStatus, NotTested, NotTestedReason, PredictionSource, SharedFitRow,
    hash,
};

use super::input::FreeParameter;
use super::job::Job;
use super::measurement::Measurement;
use super::resampler::Resampler;
use super::sharing::{BestModel, SharingTest};
use super::{FitData, FitInput, FitKey, Fitted, Replicates};

/// Inputs for fitting one model to all campaigns of a group of robots.
#[derive(Debug, Clone, PartialEq)]
pub struct SharedInput {
    pub group: RobotGroup,
    pub model: Model,
    /// Inputs for fitting the model to each campaign; at least two.
    pub campaigns: Vec<FitInput>,
    /// Inputs for every model of every campaign of the robots; the best-fitting model of each campaign provides the
    /// residuals for the test of whether the campaigns share their coefficients.
    pub models: Vec<FitInput>,
}

/// Settings on which a shared fit depends.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SharedSettings<'s> {
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    wheels: &'s [String],
    /// Inputs for all models of the campaigns, by the names of campaign and model.
    #[serde(flatten)]
    models: BTreeMap<String, &'s FitInput>,
}

impl SharedInput {
    /// Returns the inputs for all shared fits that the configuration asks for: for each group of robots, one for each
    /// model that has free parameters and is listed in all campaigns of the robots, in the order of the first campaign's
    /// list.
    pub fn all(config: &Config) -> Vec<Self> {
        let groups = config.robot_groups().into_iter();
        groups.flat_map(|group| Self::all_of_group(config, &group)).collect()
    }

    fn all_of_group(config: &Config, group: &RobotGroup) -> Vec<Self> {
        let (campaigns, common) = config.common(&group.robots);
        let mut models = FitInput::all(config);
        models.retain(|input| group.robots.contains(&input.robot.name));
        let inputs = common.into_iter().filter_map(|model| {
            let inputs = campaigns.iter().map(|name| FitInput::new(config, name, model));
            let campaigns = inputs.collect::<Option<Vec<_>>>()?;
            Some(Self { group: group.clone(), model, campaigns, models: models.clone() })
        });
        inputs.collect()
    }

    /// Returns the numbers of the parameters of each campaign's robot.
    fn numbers(&self) -> Vec<GroupNumbers> {
        let own = |input: &FitInput| self.group.numbers_of(&input.robot.name).copied();
        let all = self.campaigns.iter().map(own);
        all.map(|own| own.expect("the group has the robots of its campaigns")).collect()
    }

    /// Returns the parameters that are free in at least one of the campaigns.
    ///
    /// # Errors
    /// Returns the reason why a free parameter of a campaign is none of the group.
    fn free(&self) -> Result<Vec<FreeParameter>, NotTested> {
        let mut free: Vec<FreeParameter> = Vec::new();
        for (input, numbers) in self.campaigns.iter().zip(self.numbers()) {
            for own in input.free() {
                let parameter = numbers.of_group(own.parameter).ok_or_else(|| {
                    NotTested::new(NotTestedReason::SumOfWheels, own.parameter.key())
                })?;
                if free.iter().all(|other| other.parameter != parameter) {
                    free.push(FreeParameter { parameter, ..own });
                }
            }
        }
        if self.group.robots.len() > 1 {
            free.sort_by_key(|free| free.parameter);
        }
        Ok(free)
    }

    pub fn key(&self) -> FitKey {
        FitKey::Shared { robot: self.group.name(), model: self.model }
    }

    /// Returns a hash of everything that the fit reads from the measured parameters of the robots.
    pub fn robots(&self, data: &FitData) -> String {
        let robots = self.campaigns.iter().map(|input| (&input.robot.name, input.robots(data)));
        hash(format!("{:?}", robots.collect::<BTreeMap<_, _>>()).as_bytes())
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

    pub fn settings(&self) -> SharedSettings<'_> {
        let inputs = self.models.iter();
        let models = inputs
            .map(|input| (format!("{} {}", input.campaign.name, input.model.name), input))
            .collect();
        SharedSettings { wheels: &self.group.wheels, models }
    }

    /// Returns the free parameters of the fit.
    ///
    /// # Errors
    /// Returns the reason why the measurements of the campaigns cannot be fitted together.
    fn free_of_all(&self, measurements: &[Measurement]) -> Result<Vec<FreeParameter>, NotTested> {
        let lacks = |campaign: &usize| measurements.iter().all(|of| of.campaign != *campaign);
        if let Some(campaign) = (0..self.campaigns.len()).find(lacks) {
            let name = &self.campaigns[campaign].campaign.name;
            return Err(NotTested::new(NotTestedReason::NoTrials, name));
        }
        if !self.group.is_complete() {
            return Err(NotTestedReason::TooManyWheels.into());
        }
        let free = self.free()?;
        let mut pairs = free.iter().flat_map(|a| free.iter().map(|b| (a.parameter, b.parameter)));
        if let Some((part, whole)) = pairs.find(|(a, b)| a != b && a.is_part_of(*b)) {
            let of = [whole, part].map(|of| of.name().to_owned()).to_vec();
            return Err(NotTested { reason: NotTestedReason::PartOfFree, of });
        }
        Ok(free)
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
            robot: self.group.name(),
            campaigns: self.names(),
            wheels: self.group.wheels.clone(),
            joints: self.group.joints.clone(),
            j_separate: separate.iter().map(|row| row.j).sum(),
            ..SharedFitRow::blank()
        };
        let free = match self.free_of_all(&measurements) {
            Ok(free) => free,
            Err(why) => {
                let status = FitStatus::Failed;
                let failure = why.to_string();
                let gait_input = first.gait_input();
                let model = self.model;
                let fit =
                    FitRow { campaign, model, gait_input, status, failure, ..FitRow::blank() };
                return Ok(SharedFitRow { fit, not_tested: Some(why), ..blank });
            }
        };
        let resampler = Resampler::new(first.fit.seed, measurements, &data.cycles);
        let replicates = Replicates::default();
        let numbers = self.numbers();
        let job = Job::pooled(&self.campaigns, &numbers, free, data, &resampler, &replicates)
            .cancelled_by(cancel);
        let (fit, row) = job.run_alone(&self.starting_values(&job, separate))?;
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
        let lacks_free = |row: &&&FitRow| {
            let numbers = self.numbers_of_campaign(&row.campaign);
            let mut own = shared.free.iter().filter_map(|of| numbers?.own(*of));
            own.any(|(own, _)| !row.free.contains(&own))
        };
        let different = separate.iter().find(lacks_free)?;
        Some(NotTested::new(NotTestedReason::OtherFree, &different.campaign))
    }

    /// Returns the numbers of the parameters of a campaign's robot.
    fn numbers_of_campaign(&self, campaign: &str) -> Option<&GroupNumbers> {
        let input = self.campaigns.iter().find(|input| input.campaign.name == campaign)?;
        self.group.numbers_of(&input.robot.name)
    }

    /// Returns starting values for the shared fit: the coefficients of each successful separate fit, and their geometric
    /// means, which replace those that a robot does not have. Empty if all separate fits have failed.
    fn starting_values(&self, job: &Job, separate: &[&FitRow]) -> Vec<Vec<f64>> {
        let fitted = separate.iter().filter(|row| row.status.is_ok());
        let mut starts: Vec<Vec<f64>> = fitted
            .map(|row| {
                let numbers = self.numbers_of_campaign(&row.campaign);
                let values = job.free.iter().map(|free| {
                    let (own, ratio) = numbers?.own(free.parameter)?;
                    Some(row.parameters[own] / ratio)
                });
                values.map(|value| value.unwrap_or(f64::NAN)).collect()
            })
            .collect();
        if starts.is_empty() {
            return starts;
        }
        let mean_of = |(i, free): (usize, &FreeParameter)| {
            let known = starts.iter().map(|values| values[i]).filter(|value| value.is_finite());
            let mean = mean(known.map(f64::ln)).exp();
            if mean.is_finite() { mean } else { job.objective.robots.value(free.parameter) }
        };
        let means: Vec<f64> = job.free.iter().enumerate().map(mean_of).collect();
        for (value, mean) in starts.iter_mut().flat_map(|values| values.iter_mut().zip(&means)) {
            if !value.is_finite() {
                *value = *mean;
            }
        }
        starts.push(means);
        starts
    }
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
                .filter_map(|fitted| predicted(fitted, own.len()));
            models.min_by(|a, b| a.j.total_cmp(&b.j))
        })
        .collect()
}

/// Returns the model of a fit with the predicted metrics for every trial; `None` if a trial has no prediction.
fn predicted(fitted: &Fitted, trials: usize) -> Option<BestModel> {
    let fit = fitted.fits.first().filter(|fit| fit.status.is_ok())?;
    let rows = fitted.predictions.iter();
    let rows = rows.filter(|row| row.source == PredictionSource::Trial);
    let metrics: Vec<_> = rows.map(|row| row.metrics).collect();
    let is_adequate = fit.adequate == Some(true);
    (metrics.len() == trials).then_some(BestModel { j: fit.j, metrics, is_adequate })
}
