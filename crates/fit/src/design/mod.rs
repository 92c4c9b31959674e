//! Optimal experimental design: the next trials that best determine a fitted model's coefficients or a prediction,
//! or that best discriminate between two models.
//!
//! The analysis is linear in the coefficients about the fit. The design criterion is averaged over bootstrap
//! replicates, so that the advice also holds for other plausible values of the coefficients.

mod choice;
mod criterion;
mod expected;
mod godambe;
mod tell;
mod undetermined;

use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_base::named;
use trilink_robot::AnyGait;
use trilink_robot::metrics::{GaitMetrics, Metric};
use trilink_tables::{Extrapolation, FitRow, Numbered, rows};

use crate::{FitInformation, TrialInformation};
use choice::{Choice, DesignSize};
use criterion::{Criterion, DesignPoint};
use expected::{Quantity, Spread};
use godambe::Sums;

pub use tell::tell;
pub use undetermined::Undetermined;

/// Maximum number of bootstrap replicates over which the design criterion is averaged.
const MAX_REPLICATES: usize = 16;

named! {
    /// Optimality criterion of a design that is to determine all coefficients.
    pub enum Optimality {
        /// D-optimality: minimum volume of the coefficients' confidence region, that is, minimum determinant of the
        /// covariance matrix of the coefficients' logarithms.
        Determinant = "d",
        /// A-optimality: minimum mean variance of the coefficients' logarithms.
        Trace = "a",
    }
}

/// Aim of a design.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Aim {
    /// To determine all free coefficients.
    Coefficients(Optimality),
    /// To predict a metric of the campaign's gait at a frequency.
    Prediction(Prediction),
}

/// Metric to be predicted at a frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Metric to be predicted: one of [`Metric::FITTED`], the metrics in the objective.
    pub metric: Metric,
    pub omega_rad_s: f64,
}

impl Prediction {
    /// Parses a prediction such as `d at 2.5` (metric and frequency in rad/s).
    ///
    /// # Errors
    /// Returns a message with the expected form and the known metrics if the text cannot be parsed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let names =
            Metric::OF_THREE_LINKS.into_iter().filter(|metric| Metric::FITTED.contains(metric));
        let names = names.map(Metric::name).collect::<Vec<_>>().join("`, `");
        let needed = || {
            format!(
                "found `{text}`, needed `METRIC at RAD_S`, such as `d at 2.5`, where METRIC is one of `{names}`"
            )
        };
        let (metric, omega_rad_s) = text.split_once(" at ").ok_or_else(needed)?;
        let metric = Metric::FITTED
            .into_iter()
            .find(|known| known.name() == metric.trim())
            .ok_or_else(needed)?;
        let omega_rad_s: f64 = omega_rad_s.trim().parse().map_err(|_| needed())?;
        if omega_rad_s > 0.0 && omega_rad_s.is_finite() {
            Ok(Self { metric, omega_rad_s })
        } else {
            Err(needed())
        }
    }
}

/// Trial that a design may recommend.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Campaign that the gait belongs to.
    pub campaign: String,
    /// Commands of the driven joints.
    pub command: AnyGait,
    pub omega_rad_s: f64,
}

/// Recommended trials and the uncertainties expected after them.
#[derive(Debug, Clone, PartialEq)]
pub struct Advice {
    pub trials: Vec<DesignRow>,
    pub expected: Vec<ExpectedRow>,
    /// Coefficients that the existing trials do not determine well.
    pub undetermined: Vec<Undetermined>,
    /// Whether the design is the global optimum (exhaustive search) rather than the result of an exchange search.
    pub is_best_of_all: bool,
    /// Number of candidates that were excluded because the model has no stable periodic solution for them.
    pub without_motion: usize,
    /// Expected difference between two rival models in standard errors; NaN unless the aim is to discriminate.
    pub standard_errors: f64,
}

/// Reason why no trials are recommended.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AdviceError {
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error("{0}")]
    Impossible(String),
}

impl From<String> for AdviceError {
    fn from(why: String) -> Self {
        Self::Impossible(why)
    }
}

rows! {
    /// Recommended trial.
    pub struct DesignRow {
        pub campaign: String,
        pub omega_rad_s: f64,
        /// Amplitudes of joints 1 and 2; NaN for a joint that is not driven.
        pub amplitude_rad: [f64; 2] as "phi{}_amplitude_rad",
        /// Amplitudes of joint 3 and the joints behind it, up to the last driven joint.
        pub more_amplitude_rad: Numbered<f64, 3> as "phi{}_amplitude_rad",
        /// Number of times that the trial should be run.
        pub repeats: i64,
        /// Whether the trial lies outside the range of the fitted trials.
        pub extrapolation: Extrapolation as "{}",
        /// Metrics that the fitted model predicts for the trial.
        pub metrics: GaitMetrics,
    }
}

rows! {
    /// Current and expected uncertainty of a quantity.
    pub struct ExpectedRow {
        /// Name of a fitted parameter, or a prediction such as `d at 2.5`.
        pub quantity: String,
        pub value: f64,
        /// Whether a prediction lies outside the range of the fitted trials.
        pub extrapolation: Extrapolation as "{}",
        /// Lower limit of the 95 % confidence interval; NaN if the interval is open.
        pub lower: f64,
        /// Upper limit of the 95 % confidence interval; NaN if the interval is open.
        pub upper: f64,
        /// Half width of the 95 % confidence interval from the existing trials.
        pub half_width: f64,
        /// Half width expected after the recommended trials.
        pub expected_half_width: f64,
        /// Half width expected after the same number of trials spread evenly over the candidates.
        pub evenly_half_width: f64,
    }
}

/// Returns the `add` trials among `candidates`, each repeated at most `repeats` times, that are optimal for `aim`.
///
/// `row` is the row of the fit in the fit table.
///
/// # Errors
/// Returns an error if there are too few candidates, if the model has no stable periodic solution for any candidate or
/// for the prediction, or if the search is cancelled.
pub fn advise(
    information: &FitInformation,
    row: &FitRow,
    candidates: &[Candidate],
    aim: Aim,
    [add, repeats]: [usize; 2],
    cancel: &CancelToken,
) -> Result<Advice, AdviceError> {
    let no_shifts: Vec<f64> = vec![0.0; information.free().count()];
    let all = candidates.len();
    let (candidates, trials) = with_motion(information, candidates, &no_shifts, cancel)?;
    let existing = information.trials(&no_shifts, true);
    let sums = trials.iter().map(Sums::from_trial).collect();
    let mut points = vec![DesignPoint::new(&existing, sums, information, &no_shifts, aim)?];
    points.extend(at_replicates(information, &candidates, aim, cancel)?);
    let criterion = Criterion::new(information, points, aim);
    let size = DesignSize { add, candidates: candidates.len(), repeats };
    let (choice, is_best_of_all) = choice::find_best(&criterion, size, cancel)?;
    let quantities = Quantity::all(information, aim)?;
    let even: Choice = (0..add)
        .map(|i| ((i as f64 + 0.5) / add as f64 * candidates.len() as f64) as usize)
        .collect();
    let [now, then, evenly] = [Choice::new(), choice.clone(), even].map(|choice| {
        let trials = existing.iter().chain(choice.iter().map(|candidate| &trials[*candidate]));
        Spread::new(information, &trials.collect::<Vec<_>>(), &quantities)
    });
    let expected = quantities
        .iter()
        .enumerate()
        .map(|(i, quantity)| quantity.row(information, row, [now[i], then[i], evenly[i]]));
    Ok(Advice {
        trials: design_rows(information, &choice, &candidates, &trials),
        expected: expected.collect(),
        undetermined: undetermined::find_undetermined(information, row, &criterion, &candidates),
        is_best_of_all,
        without_motion: all - candidates.len(),
        standard_errors: f64::NAN,
    })
}

/// Returns the candidates for which the model, with the coefficients' logarithms changed by `shifts`, has a stable
/// periodic solution, and the information that each of them gives.
fn with_motion<'c>(
    information: &FitInformation,
    candidates: &'c [Candidate],
    shifts: &[f64],
    cancel: &CancelToken,
) -> Result<(Vec<&'c Candidate>, Vec<TrialInformation>), AdviceError> {
    let all = candidates.par_iter().with_max_len(1).map(|candidate| {
        cancel.check()?;
        Ok(information.candidate(candidate.command, candidate.omega_rad_s, shifts, true))
    });
    let all: Vec<Option<TrialInformation>> = all.collect::<Result<_, Cancelled>>()?;
    let (candidates, trials): (Vec<_>, Vec<_>) = candidates
        .iter()
        .zip(all)
        .filter_map(|(candidate, trial)| Some((candidate, trial?)))
        .unzip();
    if candidates.is_empty() {
        return Err("the model predicts no stable periodic motion for any candidate trial"
            .to_owned()
            .into());
    }
    Ok((candidates, trials))
}

/// Returns the information from the existing and the candidate trials at the coefficients of each of at most
/// [`MAX_REPLICATES`] bootstrap replicates.
fn at_replicates(
    information: &FitInformation,
    candidates: &[&Candidate],
    aim: Aim,
    cancel: &CancelToken,
) -> Result<Vec<DesignPoint>, Cancelled> {
    let all = information.replicates();
    let count = all.len().min(MAX_REPLICATES);
    let indices: Vec<usize> = (0..count).map(|i| i * all.len() / count).collect();
    let points = indices.into_par_iter().with_max_len(1).map(|index| {
        cancel.check()?;
        let shifts = &all[index];
        let sums = candidates.iter().map(|candidate| {
            information
                .candidate(candidate.command, candidate.omega_rad_s, shifts, false)
                .as_ref()
                .map_or_else(|| Sums::zero(shifts.len()), Sums::from_trial)
        });
        let sums = sums.collect();
        let existing = information.trials(shifts, false);
        Ok(DesignPoint::new(&existing, sums, information, shifts, aim).ok())
    });
    Ok(points.collect::<Result<Vec<_>, Cancelled>>()?.into_iter().flatten().collect())
}

/// Returns one row for each distinct trial of a choice.
fn design_rows(
    information: &FitInformation,
    choice: &[usize],
    candidates: &[&Candidate],
    trials: &[TrialInformation],
) -> Vec<DesignRow> {
    let rows = choice.chunk_by(|a, b| a == b).map(|repeated| {
        let Candidate { campaign, command, omega_rad_s } = candidates[repeated[0]];
        let amplitudes_rad =
            command.joints.map(|joint| joint.map_or(f64::NAN, |of| of.amplitude_rad));
        let driven = command.joints.iter().rposition(Option::is_some).map_or(0, |last| last + 1);
        DesignRow {
            campaign: campaign.clone(),
            omega_rad_s: *omega_rad_s,
            amplitude_rad: [0, 1].map(|i| amplitudes_rad[i]),
            more_amplitude_rad: amplitudes_rad
                .get(2..driven)
                .unwrap_or_default()
                .iter()
                .copied()
                .collect(),
            repeats: repeated.len() as i64,
            extrapolation: information.extrapolation(*command, *omega_rad_s),
            metrics: trials[repeated[0]].metrics,
        }
    });
    rows.collect()
}
