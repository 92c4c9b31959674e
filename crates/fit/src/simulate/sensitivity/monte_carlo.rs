//! Propagation of the input uncertainties through the equations of motion themselves, without linearisation.
//!
//! Reference: JCGM 101:2008, *Propagation of distributions using a Monte Carlo method*. Errors are drawn from normal
//! distributions (6.4.7), those of the fitted coefficients' logarithms from a multivariate one (6.4.8); the intervals
//! are probabilistically symmetric (7.7).

use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_mechanics::Problem;
use trilink_statistics::variance_components::covariance_root;
use trilink_statistics::{mean, quantiles};
use trilink_tables::SensitivityRow;

use super::budget::InputUncertainty;
use super::quantity::Quantity;

/// Largest part of the draws that may have no periodic solution; the limits of 95 % would hardly change if these draws
/// were all beyond one of them.
const MAX_UNSOLVED: f64 = 1e-3;

/// Number of draws, and the seed of their random numbers.
#[derive(Debug, Clone, Copy)]
pub struct Draws {
    pub count: usize,
    pub seed: u64,
}

/// Adds to the rows of one motion the standard deviations and limits of the metrics over `draws` motions with inputs
/// drawn at random. `solve` returns the values of `metrics` for a problem, or `None` if it has no periodic solution.
/// Deviations and limits stay missing (NaN) if no input is uncertain, or if more than 0.1 % of the drawn problems have no
/// periodic solution.
///
/// # Errors
/// Returns an error if the computation is cancelled.
pub(in crate::simulate) fn add_monte_carlo(
    rows: &mut [SensitivityRow],
    (problem, metrics): (&Problem, &[String]),
    solve: &(impl Fn(&Problem) -> Option<Vec<f64>> + Sync),
    uncertainty: &InputUncertainty,
    draws: Draws,
    cancel: &CancelToken,
) -> Result<(), Cancelled> {
    let root = uncertainty.fitted.as_ref().and_then(|fitted| {
        let size = fitted.coefficients.len();
        covariance_root(DMatrix::from_fn(size, size, |i, j| fitted.covariance[i][j]))
    });
    let is_known = uncertainty.fitted.is_some() == root.is_some();
    if !is_known || uncertainty.quantities(&problem.robot).next().is_none() {
        return Ok(());
    }
    let drawn = (0..draws.count as u64).into_par_iter().map(|stream| {
        cancel.check()?;
        let mut random = ChaCha8Rng::seed_from_u64(draws.seed);
        random.set_stream(stream);
        Ok(solve(&drawn_problem(problem, uncertainty, root.as_ref(), &mut random)))
    });
    let drawn = drawn.collect::<Result<Vec<Option<Vec<f64>>>, Cancelled>>()?;
    let solved: Vec<&Vec<f64>> = drawn.iter().flatten().collect();
    let unsolved = drawn.len() - solved.len();
    for (index, metric) in metrics.iter().enumerate() {
        let values: Vec<f64> = solved.iter().map(|metrics| metrics[index]).collect();
        let mut limits = [f64::NAN; 3];
        if unsolved as f64 <= MAX_UNSOLVED * drawn.len() as f64 {
            let middle = mean(values.iter().copied());
            let squares = values.iter().map(|value| (value - middle).powi(2)).sum::<f64>();
            let deviation = (squares / (values.len() as f64 - 1.0)).sqrt();
            let [lower, upper] = quantiles(values, [0.025, 0.975]);
            limits = [deviation, lower, upper];
        }
        for row in rows.iter_mut().filter(|row| row.metric == *metric) {
            row.draws = Some(drawn.len() as i64);
            row.unsolved_draws = Some(unsolved as i64);
            [row.draws_deviation, row.draws_lower, row.draws_upper] = limits;
        }
    }
    Ok(())
}

/// Draws the inputs of a problem.
fn drawn_problem(
    problem: &Problem,
    uncertainty: &InputUncertainty,
    root: Option<&DMatrix<f64>>,
    random: &mut ChaCha8Rng,
) -> Problem {
    let mut normal = StandardNormal.sample_iter(random);
    let mut drawn = problem.clone();
    let coefficients = uncertainty.fitted.as_ref().map_or(&[][..], |of| &of.coefficients);
    let mut shifts = DVector::zeros(coefficients.len());
    for error in &uncertainty.independent {
        let in_deviations: f64 = normal.next().unwrap_or_default();
        for (quantity, deviation) in &error.quantities {
            let value = quantity.value(&drawn) + in_deviations * deviation;
            quantity.set(&mut drawn, value);
        }
        for (shift, refit) in shifts.iter_mut().zip(&error.refit) {
            *shift += in_deviations * refit;
        }
    }
    if let Some(root) = root {
        let errors = DVector::from_fn(coefficients.len(), |_, _| normal.next().unwrap_or_default());
        shifts += root * errors;
    }
    for (coefficient, shift) in coefficients.iter().zip(&shifts) {
        let quantity = Quantity::Robot(*coefficient);
        let value = quantity.value(&drawn) * shift.exp();
        quantity.set(&mut drawn, value);
    }
    drawn
}
