//! One collocation element: the equations at its stages, linearised and condensed.

use super::lu::factor_and_solve;
use super::radau::{RADAU, STAGES};
use super::reduced::Reduced;

/// States at the stages of one element.
pub(super) type Stages<const N: usize> = [[f64; N]; STAGES];

/// The linearised element: how its stages answer to its start.
///
/// To first order a change `x` of the start changes the stages by `transfer x + step`.
#[derive(Debug, Clone)]
pub(super) struct Condensed<const N: usize> {
    pub transfer: [[[f64; N]; N]; STAGES],
    pub step: Stages<N>,
}

/// Room for one element's linear system.
#[derive(Debug, Default)]
pub(super) struct Workspace {
    matrix: Vec<f64>,
    rhs: Vec<f64>,
}

/// Time derivatives at the stages of the polynomial through `start` and `stages`.
#[inline(always)]
fn rates<const N: usize>(start: &[f64; N], stages: &Stages<N>, duration_s: f64) -> Stages<N> {
    let rule = &*RADAU;
    std::array::from_fn(|j| {
        std::array::from_fn(|i| {
            let from_stages: f64 =
                (0..STAGES).map(|l| rule.differentiate[j][l] * stages[l][i]).sum();
            (rule.differentiate_start[j] * start[i] + from_stages) / duration_s
        })
    })
}

/// Evaluates the equations at the stages of an element, adds the squares of their residuals
/// to `square` and condenses the linearised system. `None` if it is singular.
#[inline(always)]
pub(super) fn condense<const N: usize, R: Reduced<N>>(
    model: &R,
    nodes: &[R::Node],
    start: &[f64; N],
    stages: &Stages<N>,
    duration_s: f64,
    workspace: &mut Workspace,
    square: &mut f64,
) -> Option<Condensed<N>> {
    let rule = &*RADAU;
    let (size, columns) = (N * STAGES, N + 1);
    workspace.matrix.clear();
    workspace.matrix.resize(size * size, 0.0);
    workspace.rhs.clear();
    workspace.rhs.resize(size * columns, 0.0);
    let rates = rates(start, stages, duration_s);
    for j in 0..STAGES {
        let residual = model.residual(&nodes[j], &stages[j], &rates[j]);
        for i in 0..N {
            let row = &mut workspace.matrix[(j * N + i) * size..][..size];
            for l in 0..STAGES {
                let weight = rule.differentiate[j][l] / duration_s;
                for k in 0..N {
                    row[l * N + k] = residual.by_rate[i][k] * weight;
                }
            }
            let right = &mut workspace.rhs[(j * N + i) * columns..][..columns];
            for k in 0..N {
                row[j * N + k] += residual.by_state[i][k];
                right[k] = -residual.by_rate[i][k] * rule.differentiate_start[j] / duration_s;
            }
            right[N] = -residual.value[i];
            *square += residual.value[i] * residual.value[i];
        }
    }
    if !factor_and_solve(size, columns, &mut workspace.matrix, &mut workspace.rhs) {
        return None;
    }
    let answer = |j: usize, i: usize, k: usize| workspace.rhs[(j * N + i) * columns + k];
    Some(Condensed {
        transfer: std::array::from_fn(|j| {
            std::array::from_fn(|i| std::array::from_fn(|k| answer(j, i, k)))
        }),
        step: std::array::from_fn(|j| std::array::from_fn(|i| answer(j, i, N))),
    })
}

/// The stages of one element from a known start, or `None` if Newton's method fails.
pub(super) fn follow_element<const N: usize, R: Reduced<N>>(
    model: &R,
    nodes: &[R::Node],
    start: &[f64; N],
    duration_s: f64,
    tolerance: f64,
    workspace: &mut Workspace,
) -> Option<Stages<N>> {
    const MOST_STEPS: usize = 12;
    let mut stages = [*start; STAGES];
    for _ in 0..MOST_STEPS {
        let mut square = 0.0;
        let condensed = condense(model, nodes, start, &stages, duration_s, workspace, &mut square)?;
        let (mut step, mut size) = (0.0_f64, 0.0_f64);
        for (y, change) in stages.iter_mut().zip(&condensed.step) {
            for i in 0..N {
                y[i] += change[i];
                step = step.max(change[i].abs());
                size = size.max(y[i].abs());
            }
        }
        if !size.is_finite() {
            return None;
        }
        // The next step would be about the square of this one.
        if step <= size * (0.01 * tolerance).sqrt().min(1e-4) {
            return Some(stages);
        }
    }
    None
}

/// Size of the highest Legendre coefficient of each state's polynomial in the element.
pub(super) fn tail<const N: usize>(start: &[f64; N], stages: &Stages<N>) -> [f64; N] {
    let weights = RADAU.tail;
    std::array::from_fn(|i| {
        let from_stages: f64 = (0..STAGES).map(|j| weights[j + 1] * stages[j][i]).sum();
        (weights[0] * start[i] + from_stages).abs()
    })
}

/// Applies a small matrix.
pub(super) fn apply<const N: usize>(matrix: &[[f64; N]; N], x: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|i| (0..N).map(|k| matrix[i][k] * x[k]).sum())
}
