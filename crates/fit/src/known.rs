//! Fit restored from its tables without refitting, and the uncertainty of its predictions.

use std::collections::BTreeMap;

use trilink_mechanics::{MotionError, Problem, Solver};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{AnyRobot, Parameter};
use trilink_tables::{BootstrapRow, FitRow, NoInterval, NoIntervalReason};

use super::alternatives::Alternatives;
use super::bands::Bands;
use super::fitted_point::FittedPoint;
use super::gait_over_frequency::EXACT;
use super::information::FitInformation;
use super::job::{Fit, Job};
use super::resampler::Resampler;
use super::rows::why_no_bands;
use super::variation::Variation;
use super::{FitData, FitInput, Replicates};

/// Maximum relative difference between the stored objective and the one for the current data, for which the stored fit
/// counts as a fit to these data.
const SAME_OBJECTIVE: f64 = 1e-3;

/// Result of an earlier fit, as read back from the output tables.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownFit {
    pub row: FitRow,
    /// Fit of the same model driven by the other gait (measured or commanded), if there is one.
    pub alternative: Option<FitRow>,
    pub replicates: Vec<BootstrapRow>,
}

/// Uncertainty of the predictions of a fit; see [`KnownFit::with_bands`].
pub struct PredictionBands<'b>(Bands<'b>);

impl PredictionBands<'_> {
    /// Returns the 95 % limits of `metrics`, which must be those of the periodic solution of `problem`; `solver` must
    /// have found this solution last.
    ///
    /// # Errors
    /// Returns an error if the solution has no derivatives, or if the model has no periodic solution for a replicate.
    pub fn limits(
        &self,
        solver: Solver,
        problem: &Problem,
        metrics: GaitMetrics,
    ) -> Result<[GaitMetrics; 2], MotionError> {
        Ok(self.0.band(solver, problem, metrics)?.limits(&metrics, &EXACT))
    }

    /// Returns the free parameters, and the shifts of their logarithms in each replicate, with the same noise
    /// correction as in the confidence intervals.
    pub fn replicates(&self) -> (&[Parameter], &[Vec<f64>]) {
        self.0.replicates()
    }

    /// Returns robots with the coefficients of refits: of the first `most` bootstrap replicates, and of all refits that
    /// are not replicates. They are copies of `robot`, except that a refit with a changed robot parameter keeps its own
    /// robot.
    pub fn alternatives(&self, robot: &AnyRobot, most: usize) -> Alternatives {
        self.0.alternatives(robot, most)
    }

    /// Returns the robot on which the fit is based; its free parameters have their values from before the fit.
    pub fn robot(&self) -> &AnyRobot {
        self.0.robot()
    }

    /// Returns, for each uncertain robot parameter, the robot with that parameter increased by its standard deviation,
    /// and the shifts of the logarithms of the free parameters from the original fit to the refit with this robot.
    pub fn assumed(&self) -> impl Iterator<Item = (&AnyRobot, &[f64])> {
        self.0.assumed()
    }
}

impl KnownFit {
    /// Calls `task` with the uncertainty of the fit's predictions for any commanded gait and frequency, as computed for
    /// `predictions.parquet`. `data` are the fitted measurements.
    ///
    /// # Errors
    /// Returns the reason if the predictions of the fit have no intervals.
    pub fn with_bands<T>(
        &self,
        input: &FitInput,
        data: &FitData,
        task: impl FnOnce(&PredictionBands) -> T,
    ) -> Result<T, NoInterval> {
        self.with_fit(input, data, |bands, _, _, _| task(&PredictionBands(bands)))
    }

    /// Calls `task` with the information that single trials, fitted or candidate, give about the coefficients. `data`
    /// are the fitted measurements.
    ///
    /// # Errors
    /// Returns the reason if the predictions of the fit have no intervals.
    pub fn with_information<T>(
        &self,
        input: &FitInput,
        data: &FitData,
        task: impl FnOnce(&FitInformation) -> T,
    ) -> Result<T, NoInterval> {
        self.with_fit(input, data, |bands, job, point, variation| {
            let (_, replicates) = bands.replicates();
            task(&FitInformation::new(point, variation, replicates, &job.perturbed_robots))
        })
    }

    fn with_fit<T>(
        &self,
        input: &FitInput,
        data: &FitData,
        task: impl FnOnce(Bands, &Job, &FittedPoint, &Variation) -> T,
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
        let alternative = self.alternative.as_ref().filter(|other| other.status.is_ok());
        let fit = job.restore(&self.row, alternative);
        let Fit { point, replicates, systematic, variation, .. } = &fit;
        if (point.cost - self.row.j).abs() > SAME_OBJECTIVE * self.row.j.abs().max(1e-6) {
            return Err(NoIntervalReason::OtherTrials.into());
        }
        let bands = Bands::new(point, replicates, variation, systematic, &job.perturbed_robots);
        Ok(task(bands, &job, point, variation))
    }
}
