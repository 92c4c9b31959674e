//! Nonlinear least squares with few parameters by the Levenberg-Marquardt method, run by argmin.
//!
//! The Gauss-Newton solver of argmin has no damping and requires its own linear-algebra traits.
//!
//! Reference: J. Nocedal and S. J. Wright, *Numerical Optimization*, 2nd ed., Springer 2006,
//! section 10.3.

use argmin::core::{
    ArgminError, Error, Executor, IterState, KV, OptimizationResult, Problem, Solver, State as _,
    TerminationReason,
};
use nalgebra::{Cholesky, SMatrix, SVector};

const MAX_ITERATIONS: u64 = 60;
const INITIAL_DAMPING: f64 = 1e-3;
const MAX_DAMPING: f64 = 1e12;

/// Result of a least-squares minimisation.
#[derive(Debug, Clone, Copy)]
pub struct Minimum<const N: usize> {
    pub parameters: SVector<f64, N>,
    /// Sum of squared residuals at the minimum.
    pub squares: f64,
    /// Matrix `J^T J` of the normal equations, with the Jacobian `J` of the residuals at the start of the
    /// last iteration.
    pub normal: SMatrix<f64, N, N>,
}

/// Minimises the sum of squared residuals over `samples`, starting from the parameters `start`. For each
/// sample, `model` returns the residual and the negatives of its derivatives with respect to the parameters.
/// The search has converged when a step is at most `tolerance` times the standard errors of the parameters;
/// these assume that the standard deviation of a residual is at least `min_deviation`. Returns `None` if the
/// search does not converge, or if the number of samples does not exceed the number of parameters.
pub fn minimise<S, M, const N: usize>(
    samples: &[S],
    start: SVector<f64, N>,
    tolerance: f64,
    min_deviation: f64,
    model: M,
) -> Option<Minimum<N>>
where
    M: Fn(&SVector<f64, N>, &S) -> (f64, SVector<f64, N>),
{
    if samples.len() <= N {
        return None;
    }
    let normal = SMatrix::zeros();
    let solver = LevenbergMarquardt { damping: INITIAL_DAMPING, tolerance, min_deviation, normal };
    let result = Executor::new(Residuals { samples, model }, solver)
        .configure(|state| state.param(start).max_iters(MAX_ITERATIONS))
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

impl<S, M> Residuals<'_, S, M> {
    fn sum_of_squares<const N: usize>(&self, parameters: &SVector<f64, N>) -> f64
    where
        M: Fn(&SVector<f64, N>, &S) -> (f64, SVector<f64, N>),
    {
        self.samples.iter().map(|sample| (self.model)(parameters, sample).0.powi(2)).sum()
    }
}

struct LevenbergMarquardt<const N: usize> {
    damping: f64,
    tolerance: f64,
    min_deviation: f64,
    normal: SMatrix<f64, N, N>,
}

/// State of the iteration: parameters and sum of squares.
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
        let (Some(residuals), Some(parameters)) = (&problem.problem, state.param) else {
            return Err(ArgminError::NotInitialized { text: "parameters".to_owned() }.into());
        };
        let Residuals { samples, model } = residuals;
        if state.cost.is_infinite() {
            state.cost = residuals.sum_of_squares(&parameters);
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
        let tried_squares = residuals.sum_of_squares(&tried);
        if tried_squares <= state.cost {
            state = state.param(tried).cost(tried_squares);
            self.damping *= 0.1;
        } else {
            self.damping *= 10.0;
        }
        let variance = state.cost / (samples.len() - N) as f64;
        let is_small =
            gain.abs() <= self.tolerance.powi(2) * variance.max(self.min_deviation.powi(2));
        // If no step reduces the sum of squares, the parameters are at the minimum to rounding error.
        if is_small || self.damping > MAX_DAMPING {
            state = state.terminate_with(TerminationReason::SolverConverged);
        }
        Ok((state, None))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reference problem: Misra1a of the NIST Statistical Reference Datasets.
    #[test]
    fn the_certified_parameters_are_found() {
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
