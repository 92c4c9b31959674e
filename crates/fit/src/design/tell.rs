//! The trials that best tell two fitted models of a campaign apart.
//!
//! Were one model true, the other, fitted again with the new trials, would come as near to them as the
//! trials so far let it. What then remains, in squares of standard errors, is to be as large as
//! possible, whichever of the two is true.
//!
//! Reference: A. C. Atkinson and V. V. Fedorov, *The design of experiments for discriminating between two
//! rival models*, Biometrika 62 (1975).

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_robot::metrics::Metric;

use super::choice::{Size, best};
use super::godambe::{deviations, of_bounds};
use super::{Advice, AdviceError, Candidate, design_rows};
use crate::{FitInformation, TrialInformation};

/// What trials add to the sums of squares of the model that is not true.
#[derive(Debug, Clone)]
struct Squares {
    /// Of the differences between both models; their products with the derivatives; and the squares of those.
    differences: f64,
    products: DVector<f64>,
    curvature: DMatrix<f64>,
}

impl Squares {
    fn none(count: usize) -> Self {
        Self {
            differences: 0.0,
            products: DVector::zeros(count),
            curvature: DMatrix::zeros(count, count),
        }
    }

    /// Of a trial where one model is true and the rival is another.
    fn of(truth: &TrialInformation, rival: &TrialInformation) -> Self {
        let count = rival.slopes.len();
        let (mut squares, deviations) = (Self::none(count), deviations(rival));
        let is_known = |of: Metric| rival.weights[of] > 0.0 && deviations[of] > 0.0;
        let (truth, own) = (truth.metrics, rival.metrics);
        for metric in Metric::FITTED.into_iter().filter(|of| is_known(*of)) {
            // d and v are one measurement.
            if metric == Metric::V && is_known(Metric::D) {
                continue;
            }
            let difference = (truth[metric] / own[metric]).ln() / deviations[metric];
            if !difference.is_finite() {
                continue;
            }
            let slopes = rival.slopes.iter().map(|of| of[metric] / deviations[metric]);
            let slopes = DVector::from_iterator(count, slopes);
            squares.differences += difference * difference;
            squares.products += difference * &slopes;
            squares.curvature += &slopes * slopes.transpose();
        }
        squares
    }

    fn add(&mut self, other: &Self) {
        self.differences += other.differences;
        self.products += &other.products;
        self.curvature += &other.curvature;
    }
}

/// A model that is not true: what its trials so far hold it to, and what each candidate adds.
struct Rival {
    held: DMatrix<f64>,
    candidates: Vec<Squares>,
}

impl Rival {
    fn new(
        information: &FitInformation,
        truth: &[TrialInformation],
        own: &[TrialInformation],
    ) -> Self {
        let none = vec![0.0; information.free().count()];
        let mut held = DMatrix::from_diagonal(&of_bounds(information));
        for trial in information.trials(&none, false) {
            held += Squares::of(&trial, &trial).curvature;
        }
        let candidates = truth.iter().zip(own).map(|(truth, own)| Squares::of(truth, own));
        Self { held, candidates: candidates.collect() }
    }

    /// Squares of standard errors that remain with these trials.
    fn remains(&self, choice: &[usize]) -> f64 {
        let mut sum = Squares::none(self.held.nrows());
        choice.iter().for_each(|of| sum.add(&self.candidates[*of]));
        let solved = (&self.held + &sum.curvature).cholesky().map(|of| of.solve(&sum.products));
        sum.differences - solved.map_or(0.0, |of| of.dot(&sum.products))
    }
}

/// The trials of `candidates`, `add` of them, each at most `repeats` times, that tell the fits of two models apart best.
///
/// # Errors
/// There is no advice, or the work was cancelled.
pub fn tell(
    one: &FitInformation,
    other: &FitInformation,
    candidates: &[Candidate],
    [add, repeats]: [usize; 2],
    cancel: &CancelToken,
) -> Result<Advice, AdviceError> {
    let told = |of: &FitInformation, candidate: &Candidate| {
        let none = vec![0.0; of.free().count()];
        of.candidate(candidate.command, candidate.omega_rad_s, &none, false)
    };
    let both = candidates.par_iter().with_max_len(1).map(|of| {
        cancel.check()?;
        Ok(told(one, of).zip(told(other, of)))
    });
    let both = both.collect::<Result<Vec<_>, Cancelled>>()?;
    let common = candidates.iter().zip(both).filter_map(|(of, both)| Some((of, both?)));
    let (common, (of_one, of_other)): (Vec<&Candidate>, (Vec<_>, Vec<_>)) = common.unzip();
    if common.is_empty() {
        return Err("at no candidate both models have a stable motion".to_owned().into());
    }
    let rivals = [Rival::new(other, &of_one, &of_other), Rival::new(one, &of_other, &of_one)];
    let score = |choice: &[usize]| -> f64 {
        -0.5 * rivals.iter().map(|rival| rival.remains(choice)).sum::<f64>()
    };
    let size = Size { add, candidates: common.len(), repeats };
    let (choice, is_best_of_all) = best(&score, size, cancel)?;
    Ok(Advice {
        trials: design_rows(one, &choice, &common, &of_one),
        expected: Vec::new(),
        untold: Vec::new(),
        is_best_of_all,
        without_motion: candidates.len() - common.len(),
        standard_errors: (-score(&choice)).max(0.0).sqrt(),
    })
}
