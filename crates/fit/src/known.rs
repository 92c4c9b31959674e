//! A fit that is in the tables, and how far what it predicts may be off, without fitting again.

use std::collections::BTreeMap;

use trilink_mechanics::{MotionError, Problem, Solver};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Parameter, Robot};
use trilink_tables::{BootstrapRow, FitRow, NoInterval, NoIntervalReason};

use super::alternatives::Alternatives;
use super::bands::Bands;
use super::fitted_point::FittedPoint;
use super::information::FitInformation;
use super::job::{Fit, Job};
use super::resampler::Resampler;
use super::rows::why_no_bands;
use super::{FitData, FitInput, Replicates};

/// Relative difference of the objective of tables and of what they were made from that is none.
const SAME_OBJECTIVE: f64 = 1e-3;

/// A fit as the tables have it.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownFit {
    pub row: FitRow,
    /// The same driven by the other gait, if there is one.
    pub alternative: Option<FitRow>,
    pub replicates: Vec<BootstrapRow>,
}

/// How far predictions of a fit may be off, see [`KnownFit::with_bands`].
pub struct PredictionBands<'b>(Bands<'b>);

impl PredictionBands<'_> {
    /// 95 % limits of the metrics of the motion that a solver has solved for last, of this problem.
    ///
    /// # Errors
    /// The motion has no derivatives, or a replicate none at all.
    pub fn limits(
        &self,
        solver: Solver,
        problem: &Problem,
        metrics: GaitMetrics,
    ) -> Result<[GaitMetrics; 2], MotionError> {
        Ok(self.0.band(solver, problem, metrics)?.limits(&metrics, &[[0.0; 3]; 2]))
    }

    /// What the coefficients may be off by: shifts of the logarithms of the free parameters in each
    /// replicate, corrected as those of the intervals are.
    pub fn replicates(&self) -> (&[Parameter], &[Vec<f64>]) {
        self.0.replicates()
    }

    /// A robot with what its coefficients may be as well, by `most` replicates at most.
    pub fn alternatives(&self, robot: &Robot, most: usize) -> Alternatives {
        self.0.alternatives(robot, most)
    }

    /// The robot that the fit assumes, but for the free parameters.
    pub fn robot(&self) -> &Robot {
        self.0.robot()
    }

    /// The same with one of its parameters off by its standard deviation, and what shifts the logarithms
    /// of the free parameters have in the fit with it.
    pub fn assumed(&self) -> impl Iterator<Item = (&Robot, &[f64])> {
        self.0.assumed()
    }
}

impl KnownFit {
    /// Does something with the bands that the fit's predictions have: those of `predictions.parquet`,
    /// for any gait that is commanded, at any frequency. `data` are what was fitted.
    ///
    /// # Errors
    /// There are none.
    pub fn with_bands<T>(
        &self,
        input: &FitInput,
        data: &FitData,
        task: impl FnOnce(&PredictionBands) -> T,
    ) -> Result<T, NoInterval> {
        self.with_fit(input, data, |bands, _, _| task(&PredictionBands(bands)))
    }

    /// Does something with what single trials tell of the coefficients, those of `data`, which were
    /// fitted, and others.
    ///
    /// # Errors
    /// That is not known.
    pub fn with_information<T>(
        &self,
        input: &FitInput,
        data: &FitData,
        task: impl FnOnce(&FitInformation) -> T,
    ) -> Result<T, NoInterval> {
        self.with_fit(input, data, |bands, job, point| {
            let (_, replicates) = bands.replicates();
            task(&FitInformation::new(point, job.resampler, replicates, &job.others))
        })
    }

    fn with_fit<T>(
        &self,
        input: &FitInput,
        data: &FitData,
        task: impl FnOnce(Bands, &Job, &FittedPoint) -> T,
    ) -> Result<T, NoInterval> {
        if let Some(why) = why_no_bands(&self.row, self.replicates.len()) {
            return Err(why);
        }
        let free = input.free().into_iter().map(|free| free.parameter);
        if !free.eq(self.row.free.iter().copied()) || input.gait_input() != self.row.gait_input {
            return Err(NoIntervalReason::OtherSettings.into());
        }
        let resampler = Resampler::new(input.fit.seed, input.measurements(data), &data.cycles);
        let given = BTreeMap::from([(self.row.gait_input, self.replicates.clone())]);
        let replicates = Replicates { numbers: 0..0, given };
        let job = Job::new(input, data, &resampler, &replicates);
        let otherwise = self.alternative.as_ref().filter(|other| other.status.is_ok());
        let fit = job.known(&self.row, otherwise);
        let Fit { point, replicates, systematic, .. } = &fit;
        if (point.cost - self.row.j).abs() > SAME_OBJECTIVE * self.row.j.abs().max(1e-6) {
            return Err(NoIntervalReason::OtherTrials.into());
        }
        let bands = Bands::new(point, replicates, &resampler, systematic, &job.others);
        Ok(task(bands, &job, point))
    }
}
