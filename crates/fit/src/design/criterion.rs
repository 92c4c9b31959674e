//! What trials are worth.
//!
//! The information of the trials, Godambe's, and that of the coefficients' bounds is the inverse of the
//! covariance of the coefficients' logarithms. With the bounds it has an inverse where the trials tell
//! nothing of a direction, too; that is then as far as the bounds.
//!
//! Reference for the mean over what the coefficients may be: K. Chaloner and I. Verdinelli, *Bayesian
//! experimental design: a review*, Statist. Sci. 10 (1995).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::choice::Score;
use super::godambe::{Sums, of_bounds};
use super::{Aim, Optimality, Prediction};
use crate::{FitInformation, TrialInformation};

/// What trials tell with some values of the coefficients.
#[derive(Debug, Clone)]
pub(super) struct Weighed {
    pub existing: Sums,
    pub candidates: Vec<Sums>,
    /// Derivatives of the prediction that the trials are for.
    prediction: Option<DVector<f64>>,
}

impl Weighed {
    pub(super) fn new(
        existing: &[TrialInformation],
        candidates: Vec<Sums>,
        information: &FitInformation,
        shifts: &[f64],
        aim: Aim,
    ) -> Result<Self, String> {
        let mut sums = Sums::none(shifts.len());
        existing.iter().for_each(|trial| sums.add(&Sums::of(trial)));
        let prediction = match aim {
            Aim::Coefficients(_) => None,
            Aim::Prediction(of) => {
                let told = predicted(information, of, shifts, false)?;
                let slopes = told.slopes.iter().map(|slope| slope[of.metric]);
                Some(DVector::from_vec(slopes.collect()))
            }
        };
        Ok(Self { existing: sums, candidates, prediction })
    }

    /// What these candidates and the existing trials have.
    pub(super) fn sums(&self, choice: &[usize]) -> Sums {
        let mut sums = self.existing.clone();
        choice.iter().for_each(|of| sums.add(&self.candidates[*of]));
        sums
    }
}

/// The trial that a prediction is of.
///
/// # Errors
/// It has no stable motion.
pub(super) fn predicted(
    information: &FitInformation,
    Prediction { omega_rad_s, .. }: Prediction,
    shifts: &[f64],
    assumed: bool,
) -> Result<TrialInformation, String> {
    let told = information.candidate(information.command(), omega_rad_s, shifts, assumed);
    told.ok_or_else(|| format!("--for: the model has no stable motion at {omega_rad_s} rad/s"))
}

/// The score of a choice: what is to be small, on the average over the coefficients' values.
#[derive(Debug, Clone)]
pub(super) struct Criterion {
    /// At the fit, and at replicates.
    pub points: Vec<Weighed>,
    /// Information that the bounds have.
    bounds: DVector<f64>,
    aim: Aim,
}

impl Criterion {
    pub(super) fn new(information: &FitInformation, points: Vec<Weighed>, aim: Aim) -> Self {
        Self { points, bounds: of_bounds(information), aim }
    }

    /// Standard deviations of the logarithms by the bounds alone.
    pub(super) fn of_bounds(&self) -> DVector<f64> {
        self.bounds.map(|inverse| inverse.sqrt().recip())
    }

    /// Covariance of the coefficients' logarithms at the fit.
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
    fn of(&self, choice: &[usize]) -> f64 {
        let of_point = |point: &Weighed| {
            let Some(decomposed) = self.decomposed(&point.sums(choice).information()) else {
                return f64::INFINITY;
            };
            match (self.aim, &point.prediction) {
                (Aim::Coefficients(Optimality::Determinant), _) => -decomposed.ln_determinant(),
                (Aim::Prediction(_), Some(slopes)) => slopes.dot(&decomposed.solve(slopes)),
                _ => decomposed.inverse().trace(),
            }
        };
        self.points.iter().map(of_point).sum::<f64>() / self.points.len() as f64
    }
}
