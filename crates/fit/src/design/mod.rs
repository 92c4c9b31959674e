//! The next trials: which ones tell most of a fitted model's coefficients, of a prediction, or of which of
//! two models is the one.
//!
//! All is to first order around the fit, and averaged over the replicates of its bootstrap, so that the
//! advice holds where the fit is unsure.

mod choice;
mod criterion;
mod expected;
mod godambe;
mod tell;
mod untold;

use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_base::named;
use trilink_robot::metrics::{GaitMetrics, Metric};
use trilink_robot::{Gait, JointCommand};
use trilink_tables::{Extrapolation, FitRow, rows};

use crate::{FitInformation, TrialInformation};
use choice::{Choice, Size};
use criterion::{Criterion, Weighed};
use expected::{Quantity, Spread};
use godambe::Sums;

pub use tell::tell;
pub use untold::Untold;

/// Most replicates that are averaged over.
const MOST_REPLICATES: usize = 16;

named! {
    /// What trials that tell of all coefficients make as small as possible.
    pub enum Optimality {
        /// The volume of the coefficients' confidence region: the determinant of the covariance of their
        /// logarithms.
        Determinant = "d",
        /// The mean variance of their logarithms.
        Trace = "a",
    }
}

/// What the trials are for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Aim {
    Coefficients(Optimality),
    /// A metric of the campaign's gait at a frequency.
    Prediction(Prediction),
}

/// A metric at a frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// One of [`Metric::FITTED`].
    pub metric: Metric,
    pub omega_rad_s: f64,
}

impl Prediction {
    /// Parses `d at 2.5`.
    ///
    /// # Errors
    /// A sentence on what was needed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let names = Metric::FITTED.map(Metric::name).join("`, `");
        let needed =
            || format!("found `{text}`, needed `METRIC at RAD_S`, such as `d at 2.5`: `{names}`");
        let (metric, omega_rad_s) = text.split_once(" at ").ok_or_else(needed)?;
        let is_named = |of: &Metric| of.name() == metric.trim();
        let metric = Metric::FITTED.into_iter().find(is_named).ok_or_else(needed)?;
        let omega_rad_s: f64 = omega_rad_s.trim().parse().map_err(|_| needed())?;
        match omega_rad_s > 0.0 && omega_rad_s.is_finite() {
            true => Ok(Self { metric, omega_rad_s }),
            false => Err(needed()),
        }
    }
}

/// A trial that could be made.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Whose gait it is.
    pub campaign: String,
    pub command: Gait,
    pub omega_rad_s: f64,
}

/// The advice.
#[derive(Debug, Clone, PartialEq)]
pub struct Advice {
    pub trials: Vec<DesignRow>,
    pub expected: Vec<ExpectedRow>,
    /// Coefficients that the trials so far do not tell.
    pub untold: Vec<Untold>,
    /// Whether all choices were compared, not some of them by exchange.
    pub is_best_of_all: bool,
    /// Candidates without a stable motion, which are left out.
    pub without_motion: usize,
    /// By how many standard errors two models differ with the trials.
    pub standard_errors: f64,
}

/// Why there is no advice.
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
    /// A trial that is advised.
    pub struct DesignRow {
        pub campaign: String,
        pub omega_rad_s: f64,
        /// Of the commanded joints.
        pub amplitude_rad: [f64; 2] as "phi{}_amplitude_rad",
        /// How often it is to be made.
        pub repeats: i64,
        /// Whether it is beyond the trials that were fitted.
        pub extrapolation: Extrapolation as "{}",
        /// What it would measure, as the fit predicts it.
        pub metrics: GaitMetrics,
    }
}

rows! {
    /// How well something is known, and will be.
    pub struct ExpectedRow {
        /// A fitted parameter, or a prediction such as `d at 2.5`.
        pub quantity: String,
        pub value: f64,
        /// Of a prediction whether it is beyond the trials that were fitted.
        pub extrapolation: Extrapolation as "{}",
        /// The 95 % interval; missing where it is open.
        pub lower: f64,
        pub upper: f64,
        /// Half its width, and what is expected of that with the advised trials, and with as many spread evenly over
        /// the candidates.
        pub half_width: f64,
        pub expected_half_width: f64,
        pub evenly_half_width: f64,
    }
}

/// The trials of `candidates`, `add` of them, each at most `repeats` times, that serve an aim best; `row` is the
/// fit's.
///
/// # Errors
/// There is no advice, or the work was cancelled.
pub fn advise(
    information: &FitInformation,
    row: &FitRow,
    candidates: &[Candidate],
    aim: Aim,
    [add, repeats]: [usize; 2],
    cancel: &CancelToken,
) -> Result<Advice, AdviceError> {
    let none: Vec<f64> = vec![0.0; information.free().count()];
    let all = candidates.len();
    let (candidates, told) = with_motion(information, candidates, &none, cancel)?;
    let existing = information.trials(&none, true);
    let weighed = |trials: &[TrialInformation]| trials.iter().map(Sums::of).collect();
    let mut points = vec![Weighed::new(&existing, weighed(&told), information, &none, aim)?];
    points.extend(at_replicates(information, &candidates, aim, cancel)?);
    let criterion = Criterion::new(information, points, aim);
    let (choice, is_best_of_all) =
        choice::best(&criterion, Size { add, candidates: candidates.len(), repeats }, cancel)?;
    let quantities = Quantity::all(information, aim)?;
    let spread = |choice: &[usize]| {
        let trials = existing.iter().chain(choice.iter().map(|of| &told[*of]));
        Spread::new(information, &trials.collect::<Vec<_>>(), &quantities)
    };
    let even: Choice = (0..add)
        .map(|i| ((i as f64 + 0.5) / add as f64 * candidates.len() as f64) as usize)
        .collect();
    let [now, then, evenly] = [Choice::new(), choice.clone(), even].map(|of| spread(&of));
    let expected = |(i, quantity): (usize, &Quantity)| {
        quantity.row(information, row, [now[i], then[i], evenly[i]])
    };
    Ok(Advice {
        trials: design_rows(information, &choice, &candidates, &told),
        expected: quantities.iter().enumerate().map(expected).collect(),
        untold: untold::untold(information, row, &criterion, &candidates),
        is_best_of_all,
        without_motion: all - candidates.len(),
        standard_errors: f64::NAN,
    })
}

/// The candidates that have a stable motion at these shifts, and what they tell.
fn with_motion<'c>(
    information: &FitInformation,
    candidates: &'c [Candidate],
    shifts: &[f64],
    cancel: &CancelToken,
) -> Result<(Vec<&'c Candidate>, Vec<TrialInformation>), AdviceError> {
    let told = |of: &Candidate| {
        cancel.check()?;
        Ok(information.candidate(of.command, of.omega_rad_s, shifts, true))
    };
    let all = candidates.par_iter().with_max_len(1).map(told);
    let all: Vec<Option<TrialInformation>> = all.collect::<Result<_, Cancelled>>()?;
    let both = candidates.iter().zip(all).filter_map(|(of, told)| Some((of, told?)));
    let (candidates, told): (Vec<_>, Vec<_>) = both.unzip();
    match candidates.is_empty() {
        true => Err("no candidate has a stable motion".to_owned().into()),
        false => Ok((candidates, told)),
    }
}

/// What trials tell with the coefficients of some replicates.
fn at_replicates(
    information: &FitInformation,
    candidates: &[&Candidate],
    aim: Aim,
    cancel: &CancelToken,
) -> Result<Vec<Weighed>, Cancelled> {
    let all = information.replicates();
    let count = all.len().min(MOST_REPLICATES);
    let numbers: Vec<usize> = (0..count).map(|i| i * all.len() / count).collect();
    let at = |number: usize| {
        cancel.check()?;
        let shifts = &all[number];
        let of = |of: &&Candidate| {
            let told = information.candidate(of.command, of.omega_rad_s, shifts, false);
            told.as_ref().map_or_else(|| Sums::none(shifts.len()), Sums::of)
        };
        let told = candidates.iter().map(of).collect();
        Ok(Weighed::new(&information.trials(shifts, false), told, information, shifts, aim).ok())
    };
    let weighed = numbers.into_par_iter().with_max_len(1).map(at);
    Ok(weighed.collect::<Result<Vec<_>, Cancelled>>()?.into_iter().flatten().collect())
}

/// The chosen trials, each once.
fn design_rows(
    information: &FitInformation,
    choice: &[usize],
    candidates: &[&Candidate],
    told: &[TrialInformation],
) -> Vec<DesignRow> {
    let of = |same: &[usize]| {
        let Candidate { campaign, command, omega_rad_s } = candidates[same[0]];
        let amplitude = |of: JointCommand| of.amplitude_rad;
        DesignRow {
            campaign: campaign.clone(),
            omega_rad_s: *omega_rad_s,
            amplitude_rad: command.joints.map(|of| of.map_or(f64::NAN, amplitude)),
            repeats: same.len() as i64,
            extrapolation: information.extrapolation(*command, *omega_rad_s),
            metrics: told[same[0]].metrics,
        }
    };
    choice.chunk_by(|a, b| a == b).map(of).collect()
}
