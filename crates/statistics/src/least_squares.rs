//! Nonlinear least squares of few parameters: Levenberg and Marquardt's method, run by argmin.
//!
//! argmin's own Gauss-Newton solver has no damping and wants linear algebra of its kind.
//!
//! Reference: J. Nocedal and S. J. Wright, *Numerical Optimization*, 2nd ed., Springer 2006,
//! section 10.3.

use argmin::core::{
    ArgminError, Error, Executor, IterState, KV, OptimizationResult, Problem, Solver, State as _,
    TerminationReason,
};
use nalgebra::{Cholesky, SMatrix, SVector};

const MAX_ITERATIONS: u64 = 60;
const FIRST_DAMPING: f64 = 1e-3;
const MAX_DAMPING: f64 = 1e12;

/// Where the sum of squares is smallest.
#[derive(Debug, Clone, Copy)]
pub struct Minimum<const N: usize> {
    pub parameters: SVector<f64, N>,
    /// The sum of squared residuals.
    pub squares: f64,
    /// Sum of the products of the derivatives, before the last step.
    pub normal: SMatrix<f64, N, N>,
}

/// Minimises the sum of squared residuals over the samples; `model` gives a sample's residual
/// and minus its derivatives by the parameters. The search ends with a step of at most
/// `tolerance` standard errors of the parameters, of residuals that are `least` or more. `None` if it finds no minimum or there are no
/// more samples than parameters.
pub fn minimise<S, M, const N: usize>(
    samples: &[S],
    begin: SVector<f64, N>,
    tolerance: f64,
    least: f64,
    model: M,
) -> Option<Minimum<N>>
where
    M: Fn(&SVector<f64, N>, &S) -> (f64, SVector<f64, N>),
{
    if samples.len() <= N {
        return None;
    }
    let normal = SMatrix::zeros();
    let solver = LevenbergMarquardt { damping: FIRST_DAMPING, tolerance, least, normal };
    let result = Executor::new(Residuals { samples, model }, solver)
        .configure(|state| state.param(begin).max_iters(MAX_ITERATIONS))
        .timer(false)
        .ctrlc(false)
        .run();
    let OptimizationResult { solver, state, .. } = result.ok()?;
    let is_minimum = state.get_termination_reason() == Some(&TerminationReason::SolverConverged);
    let parameters = state.param.filter(|_| is_minimum)?;
    Some(Minimum { parameters, squares: state.cost, normal: solver.normal })
}

struct Residuals<'s, S, M> {
    samples: &'s [S],
    model: M,
}

struct LevenbergMarquardt<const N: usize> {
    damping: f64,
    tolerance: f64,
    least: f64,
    normal: SMatrix<f64, N, N>,
}

/// Parameters and sum of squares.
type State<const N: usize> = IterState<SVector<f64, N>, (), (), (), (), f64>;

impl<'s, S, M, const N: usize> Solver<Residuals<'s, S, M>, State<N>> for LevenbergMarquardt<N>
where
    M: Fn(&SVector<f64, N>, &S) -> (f64, SVector<f64, N>),
{
    fn name(&self) -> &str {
        "Levenberg-Marquardt"
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<Residuals<'s, S, M>>,
        mut state: State<N>,
    ) -> Result<(State<N>, Option<KV>), Error> {
        let missing = || ArgminError::NotInitialized { text: "parameters".to_owned() };
        let Residuals { samples, model } = problem.problem.as_ref().ok_or_else(missing)?;
        let parameters = state.param.ok_or_else(missing)?;
        let squares = |parameters: &SVector<f64, N>| -> f64 {
            samples.iter().map(|sample| model(parameters, sample).0.powi(2)).sum()
        };
        if state.cost.is_infinite() {
            state.cost = squares(&parameters);
        }
        let mut right = SVector::zeros();
        self.normal.fill(0.0);
        for sample in *samples {
            let (residual, slopes) = model(&parameters, sample);
            self.normal += slopes * slopes.transpose();
            right += slopes * residual;
        }
        let mut damped = self.normal;
        (0..N).for_each(|i| damped[(i, i)] *= 1.0 + self.damping);
        let Some(factor) = Cholesky::new(damped) else {
            return Ok((state.terminate_with(TerminationReason::default()), None));
        };
        let step = factor.solve(&right);
        let gain = step.dot(&right);
        let tried = parameters + step;
        let tried_squares = squares(&tried);
        if tried_squares <= state.cost {
            state = state.param(tried).cost(tried_squares);
            self.damping *= 0.1;
        } else {
            self.damping *= 10.0;
        }
        let variance = state.cost / (samples.len() - N) as f64;
        let is_small = gain.abs() <= self.tolerance.powi(2) * variance.max(self.least.powi(2));
        // Where no step lowers the sum any more is the minimum, to rounding.
        if is_small || self.damping > MAX_DAMPING {
            state = state.terminate_with(TerminationReason::SolverConverged);
        }
        Ok((state, None))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Misra1a of the NIST Statistical Reference Datasets.
    #[test]
    fn a_certified_fit_is_found() {
        const SAMPLES: [(f64, f64); 14] = [
            (10.07, 77.6),
            (14.73, 114.9),
            (17.94, 141.1),
            (23.93, 190.8),
            (29.61, 239.9),
            (35.18, 289.0),
            (40.02, 332.8),
            (44.82, 378.4),
            (50.76, 434.8),
            (55.05, 477.3),
            (61.01, 536.8),
            (66.40, 593.1),
            (75.47, 689.1),
            (81.78, 760.0),
        ];
        let model = |p: &SVector<f64, 2>, (y, x): &(f64, f64)| {
            let decay = (-p[1] * x).exp();
            (y - p[0] * (1.0 - decay), SVector::from([1.0 - decay, p[0] * x * decay]))
        };
        let found = minimise(&SAMPLES, SVector::from([250.0, 5e-4]), 1e-6, 0.0, model).unwrap();
        assert!((found.parameters[0] / 238.94212918 - 1.0).abs() < 1e-9, "{found:?}");
        assert!((found.parameters[1] / 5.5015643181e-4 - 1.0).abs() < 1e-9);
        assert!((found.squares / 0.12455138894 - 1.0).abs() < 1e-9);
        assert!(minimise(&SAMPLES[..2], SVector::from([250.0, 5e-4]), 1e-6, 0.0, model).is_none());
    }
}
