//! One set of coefficients for all campaigns of a robot.

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
use super::sharing::{Nearest, SharingTest};
use super::{FitData, FitInput, FitKey, Fitted, Replicates};

/// What one model is fitted with to all campaigns of a robot that list it.
#[derive(Debug, Clone, PartialEq)]
pub struct SharedInput {
    pub robot: String,
    pub model: Model,
    /// What it is fitted with to each; two at least.
    pub campaigns: Vec<FitInput>,
    /// What all models of these are fitted with: the nearest ones tell what models are off by.
    pub models: Vec<FitInput>,
}

impl SharedInput {
    /// Those that the configuration asks for: of models with something free that all campaigns of
    /// the robot list, in the order of the first.
    pub fn all(config: &Config) -> Vec<Self> {
        let robots = config.fit.shared.iter().flat_map(|shared| &shared.robot.0);
        robots.flat_map(|robot| Self::of_robot(config, robot)).collect()
    }

    /// Those of one robot.
    fn of_robot(config: &Config, robot: &str) -> Vec<Self> {
        let (campaigns, common) = config.common(robot);
        let mut models = FitInput::all(config);
        models.retain(|input| input.robot.name == robot);
        let of_model = |model: Model| {
            let inputs = campaigns.iter().map(|name| FitInput::new(config, name, model));
            let campaigns = inputs.collect::<Option<Vec<_>>>()?;
            Some(Self { robot: robot.to_owned(), model, campaigns, models: models.clone() })
        };
        let common = if campaigns.len() > 1 { common } else { Vec::new() };
        common.into_iter().filter_map(of_model).collect()
    }

    /// What any of the campaigns leaves free.
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

    /// What the campaigns' trials measured, of one after the other.
    fn measurements(&self, data: &FitData) -> Vec<Measurement> {
        let of_campaign = |(campaign, input): (usize, &FitInput)| {
            let own = input.measurements(data).into_iter();
            own.map(move |measurement| Measurement { campaign, ..measurement })
        };
        self.campaigns.iter().enumerate().flat_map(of_campaign).collect()
    }

    /// Hash of what is read of each trial.
    pub fn trials(&self, data: &FitData) -> BTreeMap<String, String> {
        self.campaigns.iter().flat_map(|input| input.trials(data)).collect()
    }

    /// What it and the other models are fitted with, by campaign and model.
    pub fn settings(&self) -> BTreeMap<String, &FitInput> {
        let name = |of: &FitInput| format!("{} {}", of.campaign.name, of.model.name);
        self.models.iter().map(|input| (name(input), input)).collect()
    }

    /// Why there is no fit of these measurements.
    fn impossible(&self, measurements: &[Measurement]) -> Option<NotTested> {
        let lacks = |campaign: &usize| measurements.iter().all(|of| of.campaign != *campaign);
        if let Some(campaign) = (0..self.campaigns.len()).find(lacks) {
            let name = &self.campaigns[campaign].campaign.name;
            return Some(NotTested::of(NotTestedReason::NoTrials, name));
        }
        let free = self.free();
        let mut pairs = free.iter().flat_map(|a| free.iter().map(|b| (a.parameter, b.parameter)));
        let (part, whole) = pairs.find(|(a, b)| a != b && a.is_part_of(*b))?;
        let of = [whole, part].map(|of| of.name().to_owned()).to_vec();
        Some(NotTested { reason: NotTestedReason::PartOfFree, of })
    }

    /// The fit beside those to each campaign.
    ///
    /// # Errors
    /// The work was cancelled.
    pub(super) fn fit(
        &self,
        data: &FitData,
        known: &BTreeMap<FitKey, Fitted>,
        cancel: &CancelToken,
    ) -> Result<SharedFitRow, Cancelled> {
        let own = self.campaigns.iter().filter_map(|input| known.get(&input.key()));
        let separate: &[&FitRow] = &own.flat_map(|fitted| &fitted.fits).collect::<Vec<_>>();
        let measurements = self.measurements(data);
        let nearest = nearest(self, &measurements, known);
        let first = &self.campaigns[0];
        let campaign = self.names().join(" and ");
        let blank = SharedFitRow {
            robot: self.robot.clone(),
            campaigns: self.names(),
            j_separate: separate.iter().map(|row| row.j).sum(),
            ..SharedFitRow::blank()
        };
        if let Some(why) = self.impossible(&measurements) {
            let status = FitStatus::Failed(format!("failed: {why}"));
            let gait_input = first.gait_input();
            let model = self.model;
            let fit = FitRow { campaign, model, gait_input, status, ..FitRow::blank() };
            return Ok(SharedFitRow { fit, not_tested: Some(why), ..blank });
        }
        let resampler = Resampler::new(first.fit.seed, measurements, &data.cycles);
        let replicates = Replicates::default();
        let job = Job::pooled(&self.campaigns, self.free(), data, &resampler, &replicates)
            .cancelled_by(cancel);
        let (fit, row) = job.run_alone(&near(&job, separate))?;
        let test = match (self.untestable(&row, separate), nearest) {
            (Some(why), _) => SharingTest::none(why),
            (None, None) => SharingTest::none(NotTestedReason::NoWholeModel),
            (None, Some(nearest)) => {
                SharingTest::new(&fit.point, blank.j_separate, &nearest, &resampler)
            }
        };
        let SharingTest { rise: [rise, rise_limit], p_value, sharing, not_tested } = test;
        let fit = FitRow { campaign, sharing, ..row };
        cancel.check()?;
        Ok(SharedFitRow { fit, rise, rise_limit, p_value, not_tested, ..blank })
    }

    /// Why sharing cannot be tested, whatever the fits leave.
    fn untestable(&self, shared: &FitRow, separate: &[&FitRow]) -> Option<NotTested> {
        if !shared.status.is_ok() {
            return Some(NotTestedReason::SharedFitFailed.into());
        }
        if let Some(failed) = separate.iter().find(|row| !row.status.is_ok()) {
            return Some(NotTested::of(NotTestedReason::FitFailed, &failed.campaign));
        }
        let differs = |row: &&&FitRow| row.free.len() < shared.free.len();
        separate
            .iter()
            .find(differs)
            .map(|row| NotTested::of(NotTestedReason::OtherFree, &row.campaign))
    }
}

/// The coefficients of the campaigns' own fits, and their geometric means.
fn near(job: &Job, separate: &[&FitRow]) -> Vec<Vec<f64>> {
    let values = |row: &&FitRow| -> Vec<f64> {
        job.free.iter().map(|free| row.parameters[free.parameter]).collect()
    };
    let known = separate.iter().filter(|row| row.status.is_ok());
    let own: Vec<Vec<f64>> = known.map(values).collect();
    if own.is_empty() {
        return own;
    }
    let middle = |i: usize| mean(own.iter().map(|values| values[i].ln())).exp();
    let middle: Vec<f64> = (0..job.free.len()).map(middle).collect();
    own.into_iter().chain([middle]).collect()
}

/// Of each campaign the model that is nearest to its measurements; `None` where a campaign has none
/// with all motions.
fn nearest(
    shared: &SharedInput,
    measurements: &[Measurement],
    known: &BTreeMap<FitKey, Fitted>,
) -> Option<Vec<Nearest>> {
    let of_campaign = |own: &[Measurement]| {
        let name = &shared.campaigns[own[0].campaign].campaign.name;
        let inputs = shared.models.iter().filter(|input| input.campaign.name == *name);
        let fits = inputs.filter_map(|input| known.get(&input.key())).filter_map(|fitted| {
            let fit = fitted.fits.first().filter(|fit| fit.status.is_ok())?;
            let rows = fitted.predictions.iter();
            let rows = rows.filter(|row| row.source == PredictionSource::Trial);
            let metrics: Vec<_> = rows.map(|row| row.metrics).collect();
            let is_whole = metrics.len() == own.len();
            is_whole.then_some(Nearest { j: fit.j, metrics, fits: fit.adequate == Some(true) })
        });
        fits.min_by(|a, b| a.j.total_cmp(&b.j))
    };
    measurements.chunk_by(|a, b| a.campaign == b.campaign).map(of_campaign).collect()
}
