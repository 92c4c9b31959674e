//! Optimality criterion for experimental designs.
//!
//! The covariance of the coefficients' logarithms is the inverse of a sum: the Godambe information of the trials plus
//! the information from the coefficients' bounds. The bounds make the sum invertible: in a direction that the trials do
//! not determine, the standard deviation is the one implied by the bounds.
//!
//! Reference for averaging the criterion over plausible coefficients: K. Chaloner and I. Verdinelli, *Bayesian
//! experimental design: a review*, Statist. Sci. 10 (1995).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::choice::Score;
use super::godambe::{Sums, bounds_information};
use super::{Aim, Optimality, Prediction};
use crate::{FitInformation, TrialInformation};

/// Information from the existing and the candidate trials at given values of the coefficients.
#[derive(Debug, Clone)]
pub(super) struct DesignPoint {
    pub existing: Sums,
    pub candidates: Vec<Sums>,
    /// Relative derivatives of the prediction with respect to the coefficients' logarithms; `None` unless a prediction
    /// is the aim.
    prediction: Option<DVector<f64>>,
}

impl DesignPoint {
    pub(super) fn new(
        existing: &[TrialInformation],
        candidates: Vec<Sums>,
        information: &FitInformation,
        shifts: &[f64],
        aim: Aim,
    ) -> Result<Self, String> {
        let mut sums = Sums::zero(shifts.len());
        existing.iter().for_each(|trial| sums.add(&Sums::from_trial(trial)));
        let prediction = match aim {
            Aim::Coefficients(_) => None,
            Aim::Prediction(of) => {
                let trial = predicted_trial(information, of, shifts, false)?;
                let slopes = trial.slopes.iter().map(|slope| slope[of.metric]);
                Some(DVector::from_vec(slopes.collect()))
            }
        };
        Ok(Self { existing: sums, candidates, prediction })
    }

    /// Returns the sums of curvature and gradient covariance over all existing trials and the chosen candidates.
    pub(super) fn sums(&self, choice: &[usize]) -> Sums {
        let mut sums = self.existing.clone();
        choice.iter().for_each(|candidate| sums.add(&self.candidates[*candidate]));
        sums
    }
}

/// Returns the information from a trial with the campaign's gait at the frequency of a prediction, at the given shifts
/// of the coefficients' logarithms; `assumed` adds the changes due to the uncertain robot parameters.
///
/// # Errors
/// Returns an error if the model has no stable periodic solution at the frequency of the prediction.
pub(super) fn predicted_trial(
    information: &FitInformation,
    Prediction { omega_rad_s, .. }: Prediction,
    shifts: &[f64],
    assumed: bool,
) -> Result<TrialInformation, String> {
    let trial = information.candidate(information.command(), omega_rad_s, shifts, assumed);
    trial.ok_or_else(|| {
        format!("--for: the model predicts no stable periodic motion at {omega_rad_s} rad/s")
    })
}

/// Design criterion averaged over the fit and its bootstrap replicates.
#[derive(Debug, Clone)]
pub(super) struct Criterion {
    /// Design points for the fit and for its bootstrap replicates, the fit first.
    pub points: Vec<DesignPoint>,
    /// Information from the bounds: inverse variances of the coefficients' logarithms.
    bounds: DVector<f64>,
    aim: Aim,
}

impl Criterion {
    pub(super) fn new(information: &FitInformation, points: Vec<DesignPoint>, aim: Aim) -> Self {
        Self { points, bounds: bounds_information(information), aim }
    }

    /// Returns the standard deviations of the coefficients' logarithms implied by the bounds alone.
    pub(super) fn deviations_from_bounds(&self) -> DVector<f64> {
        self.bounds.map(|inverse| inverse.sqrt().recip())
    }

    /// Returns the covariance of the coefficients' logarithms at the fit after adding the chosen candidates.
    pub(super) fn covariance(&self, choice: &[usize]) -> DMatrix<f64> {
        let count = self.bounds.len();
        let information = self.points[0].sums(choice).information();
        self.decomposed(&information).map_or(DMatrix::zeros(count, count), |of| of.inverse())
    }

    fn decomposed(&self, information: &DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
        (information + DMatrix::from_diagonal(&self.bounds)).cholesky()
    }
}

impl Score for Criterion {
    fn score(&self, choice: &[usize]) -> f64 {
        let scores = self.points.iter().map(|point| {
            let Some(decomposed) = self.decomposed(&point.sums(choice).information()) else {
                return f64::INFINITY;
            };
            match (self.aim, &point.prediction) {
                (Aim::Coefficients(Optimality::Determinant), _) => -decomposed.ln_determinant(),
                (Aim::Prediction(_), Some(slopes)) => slopes.dot(&decomposed.solve(slopes)),
                _ => decomposed.inverse().trace(),
            }
        });
        scores.sum::<f64>() / self.points.len() as f64
    }
}
