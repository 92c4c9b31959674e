//! One collocation element: the equations at its stages, linearised and condensed.
//!
//! A state that is merely the integral of the one before it ([`Reduced::INTEGRATED`]) is no
//! unknown of the element: at every stage it is its start plus the rule's integral.

use super::lu;
use super::radau::{RADAU, Radau, STAGES};
use super::reduced::{MOST_PARAMETERS, Reduced, Residual};

/// States at the stages of one element.
pub(super) type Stages<const N: usize> = [[f64; N]; STAGES];

/// Room for the linearised elements of a motion; grows once and is used again.
#[derive(Debug, Clone, Default)]
pub(super) struct Linearised {
    factors: Vec<f64>,
    pivots: Vec<usize>,
    /// Per element: how its unknowns answer to its start (`N` columns).
    transfer: Vec<f64>,
    /// Per element: the step of its unknowns when its start stays.
    step: Vec<f64>,
    /// Of one element, see [`Linearised::sensitivity`].
    sensitivity: Vec<f64>,
}

/// Unknowns per stage.
pub(super) const fn unknowns<const N: usize, R: Reduced<N>>() -> usize {
    if R::INTEGRATED { N - 1 } else { N }
}

/// Time derivatives at stage `j` of the polynomial through `start` and `stages`.
#[inline(always)]
pub(super) fn rate<const N: usize>(
    rule: &Radau,
    start: &[f64; N],
    stages: &Stages<N>,
    j: usize,
    per_s: f64,
) -> [f64; N] {
    std::array::from_fn(|i| {
        let mut sum = rule.differentiate_start[j] * start[i];
        for l in 0..STAGES {
            sum += rule.differentiate[j][l] * stages[l][i];
        }
        sum * per_s
    })
}

/// Writes the linear system of one element: its `matrix` and, in the first `N` of each row's
/// `columns`, how the right-hand side answers to the element's start. `equations` gives the
/// residual of a stage from its time derivatives and may fill the other columns of the
/// stage's rows.
#[inline(always)]
pub(super) fn assemble<const N: usize, R: Reduced<N>>(
    start: &[f64; N],
    stages: &Stages<N>,
    duration_s: f64,
    matrix: &mut [f64],
    right: &mut [f64],
    columns: usize,
    mut equations: impl FnMut(usize, &[f64; N], &mut [f64]) -> Residual<N>,
) {
    let rule = &*RADAU;
    let per_stage = unknowns::<N, R>();
    let size = per_stage * STAGES;
    let per_s = 1.0 / duration_s;
    for j in 0..STAGES {
        let dy = rate(rule, start, stages, j, per_s);
        let rows = &mut right[j * per_stage * columns..][..per_stage * columns];
        let residual = equations(j, &dy, rows);
        for i in 0..per_stage {
            let row = &mut matrix[(j * per_stage + i) * size..][..size];
            for l in 0..STAGES {
                let weight = rule.differentiate[j][l] * per_s;
                for m in 0..per_stage {
                    row[l * per_stage + m] = residual.by_rate[i][m] * weight;
                }
                if R::INTEGRATED {
                    row[l * per_stage + N - 2] +=
                        residual.by_state[i][N - 1] * rule.integrate[j][l] * duration_s;
                }
            }
            let by_start = &mut rows[i * columns..][..N];
            for m in 0..per_stage {
                row[j * per_stage + m] += residual.by_state[i][m];
                by_start[m] = -residual.by_rate[i][m] * rule.differentiate_start[j] * per_s;
            }
            if R::INTEGRATED {
                by_start[N - 1] = -residual.by_state[i][N - 1];
            }
        }
    }
}

impl Linearised {
    /// Makes room for `count` elements.
    pub fn resize<const N: usize, R: Reduced<N>>(&mut self, count: usize) {
        let size = unknowns::<N, R>() * STAGES;
        self.factors.resize(count * size * size, 0.0);
        self.pivots.resize(count * size, 0);
        self.transfer.resize(count * size * N, 0.0);
        self.step.resize(count * size, 0.0);
    }

    /// Linearises element `k` at its stages and factors it; its step is left unsolved until
    /// [`Linearised::solve_step`]. `None` if the system is singular.
    #[inline(always)]
    pub fn linearise<const N: usize, R: Reduced<N>>(
        &mut self,
        k: usize,
        model: &R,
        nodes: &[R::Node],
        start: &[f64; N],
        stages: &Stages<N>,
        duration_s: f64,
    ) -> Option<()> {
        self.factor(k, model, nodes, start, stages, duration_s)?;
        let size = unknowns::<N, R>() * STAGES;
        let matrix = &self.factors[k * size * size..][..size * size];
        let pivots = &self.pivots[k * size..][..size];
        lu::solve(size, N, matrix, pivots, &mut self.transfer[k * size * N..][..size * N]);
        Some(())
    }

    /// The same for an element the start of which stays: how it answers to that is not solved
    /// for.
    #[inline(always)]
    fn factor<const N: usize, R: Reduced<N>>(
        &mut self,
        k: usize,
        model: &R,
        nodes: &[R::Node],
        start: &[f64; N],
        stages: &Stages<N>,
        duration_s: f64,
    ) -> Option<()> {
        let per_stage = unknowns::<N, R>();
        let size = per_stage * STAGES;
        let matrix = &mut self.factors[k * size * size..][..size * size];
        let pivots = &mut self.pivots[k * size..][..size];
        let transfer = &mut self.transfer[k * size * N..][..size * N];
        let step = &mut self.step[k * size..][..size];
        assemble::<N, R>(start, stages, duration_s, matrix, transfer, N, |j, dy, _| {
            let residual = model.residual(&nodes[j], &stages[j], dy);
            for i in 0..per_stage {
                step[j * per_stage + i] = -residual.value[i];
            }
            residual
        });
        lu::factor(size, matrix, pivots).then_some(())
    }

    /// Solves one element for how its unknowns answer to its start and to the first `parameters`
    /// of the model's; see [`Linearised::sensitivity`]. Uses the room of element 0. `None` if the
    /// system is singular.
    #[inline(always)]
    pub fn sensitise<const N: usize, R: Reduced<N>>(
        &mut self,
        model: &R,
        nodes: &[R::Node],
        start: &[f64; N],
        stages: &Stages<N>,
        duration_s: f64,
        parameters: usize,
    ) -> Option<()> {
        let per_stage = unknowns::<N, R>();
        let (size, columns) = (per_stage * STAGES, N + parameters);
        self.resize::<N, R>(1);
        self.sensitivity.resize(size * columns, 0.0);
        let matrix = &mut self.factors[..size * size];
        let pivots = &mut self.pivots[..size];
        let right = &mut self.sensitivity[..size * columns];
        assemble::<N, R>(start, stages, duration_s, matrix, right, columns, |j, dy, rows| {
            let mut by = [[0.0; MOST_PARAMETERS]; N];
            let residual = model.sensitivity(&nodes[j], &stages[j], dy, &mut by);
            for i in 0..per_stage {
                let row = &mut rows[i * columns + N..][..parameters];
                row.iter_mut().zip(&by[i]).for_each(|(entry, by)| *entry = -by);
            }
            residual
        });
        if !lu::factor(size, matrix, pivots) {
            return None;
        }
        lu::solve(size, columns, matrix, pivots, right);
        Some(())
    }

    /// The answers of [`Linearised::sensitise`]: per unknown `N` columns of the start, then the
    /// parameters' columns.
    pub fn sensitivity(&self) -> &[f64] {
        &self.sensitivity
    }

    /// Evaluates the residuals of element `k` alone; the factors stay those of the last
    /// [`Linearised::linearise`].
    #[inline(always)]
    pub fn evaluate<const N: usize, R: Reduced<N>>(
        &mut self,
        k: usize,
        model: &R,
        nodes: &[R::Node],
        start: &[f64; N],
        stages: &Stages<N>,
        duration_s: f64,
    ) {
        let rule = &*RADAU;
        let per_stage = unknowns::<N, R>();
        let step = &mut self.step[k * per_stage * STAGES..][..per_stage * STAGES];
        for j in 0..STAGES {
            let dy = rate(rule, start, stages, j, 1.0 / duration_s);
            let value = model.residual(&nodes[j], &stages[j], &dy).value;
            for i in 0..per_stage {
                step[j * per_stage + i] = -value[i];
            }
        }
    }

    /// Solves for element `k`'s step with the factors at hand.
    #[inline(always)]
    pub fn solve_step<const N: usize, R: Reduced<N>>(&mut self, k: usize) {
        let size = unknowns::<N, R>() * STAGES;
        let factors = &self.factors[k * size * size..][..size * size];
        let pivots = &self.pivots[k * size..][..size];
        lu::solve(size, 1, factors, pivots, &mut self.step[k * size..][..size]);
    }

    /// The last of [`Linearised::changes`].
    #[inline(always)]
    pub fn end_change<const N: usize, R: Reduced<N>>(
        &self,
        k: usize,
        start: &[f64; N],
        duration_s: f64,
        whole: bool,
    ) -> [f64; N] {
        let per_stage = unknowns::<N, R>();
        let size = per_stage * STAGES;
        let transfer = &self.transfer[k * size * N..][..size * N];
        let step = &self.step[k * size..][..size];
        let change = |row: usize| {
            let own = if whole { step[row] } else { 0.0 };
            let entries = &transfer[row * N..][..N];
            entries.iter().zip(start).fold(own, |sum, (entry, start)| sum + entry * start)
        };
        let mut end = [0.0; N];
        for i in 0..per_stage {
            end[i] = change((STAGES - 1) * per_stage + i);
        }
        if R::INTEGRATED {
            let weights = &RADAU.integrate[STAGES - 1];
            let sum: f64 = (0..STAGES).map(|l| weights[l] * change(l * per_stage + N - 2)).sum();
            end[N - 1] = start[N - 1] + duration_s * sum;
        }
        end
    }

    /// Changes of element `k`'s stages by its step when its start changes by `start`.
    #[inline(always)]
    pub fn changes<const N: usize, R: Reduced<N>>(
        &self,
        k: usize,
        start: &[f64; N],
        duration_s: f64,
    ) -> Stages<N> {
        let per_stage = unknowns::<N, R>();
        let size = per_stage * STAGES;
        let transfer = &self.transfer[k * size * N..][..size * N];
        let step = &self.step[k * size..][..size];
        let mut changes = [[0.0; N]; STAGES];
        for j in 0..STAGES {
            for i in 0..per_stage {
                let row = &transfer[(j * per_stage + i) * N..][..N];
                let mut sum = step[j * per_stage + i];
                for m in 0..N {
                    sum += row[m] * start[m];
                }
                changes[j][i] = sum;
            }
        }
        if R::INTEGRATED {
            integrate_last(&mut changes, start[N - 1], duration_s);
        }
        changes
    }
}

/// Sets the last state of every stage to its start plus the integral of the state before it.
#[inline(always)]
pub(super) fn integrate_last<const N: usize>(stages: &mut Stages<N>, start: f64, duration_s: f64) {
    let rule = &*RADAU;
    for j in 0..STAGES {
        let mut sum = 0.0;
        for l in 0..STAGES {
            sum += rule.integrate[j][l] * stages[l][N - 2];
        }
        stages[j][N - 1] = start + duration_s * sum;
    }
}

/// The stages of one element from a known start, by Newton's method from a guess, or `None` if
/// it fails. The factors are kept while steps by them shrink fast. Uses the room of element 0.
pub(super) fn follow_element<const N: usize, R: Reduced<N>>(
    model: &R,
    nodes: &[R::Node],
    start: &[f64; N],
    duration_s: f64,
    guess: &Stages<N>,
    tolerance: f64,
    room: &mut Linearised,
) -> Option<Stages<N>> {
    const MOST_STEPS: usize = 12;
    /// Part of the step before at which a step by kept factors is short enough to keep them.
    const FAST: f64 = 0.15;
    let mut stages = *guess;
    if R::INTEGRATED {
        integrate_last(&mut stages, start[N - 1], duration_s);
    }
    let enough = 0.01 * tolerance;
    let (mut is_fresh, mut last_step) = (true, f64::INFINITY);
    for _ in 0..MOST_STEPS {
        match is_fresh {
            true => room.factor(0, model, nodes, start, &stages, duration_s)?,
            false => room.evaluate(0, model, nodes, start, &stages, duration_s),
        }
        room.solve_step::<N, R>(0);
        let changes = room.changes::<N, R>(0, &[0.0; N], duration_s);
        let (mut step, mut size) = (0.0_f64, 0.0_f64);
        for (y, change) in stages.iter_mut().zip(&changes) {
            for i in 0..N {
                y[i] += change[i];
                step = step.max(change[i].abs());
                size = size.max(y[i].abs());
            }
        }
        if !size.is_finite() {
            return None;
        }
        let step = step / size.max(f64::MIN_POSITIVE);
        let shrinks = step / last_step;
        // The next step would be about the square of a fresh one, and would shrink like the
        // others by kept factors.
        let is_last = match is_fresh {
            true => step <= enough.sqrt().min(1e-4),
            false => shrinks < FAST && shrinks * step <= enough,
        };
        if is_last {
            return Some(stages);
        }
        is_fresh = !is_fresh && shrinks >= FAST;
        last_step = step;
    }
    None
}

/// Size of the highest Legendre coefficient of each state's polynomial in the element.
pub(super) fn tail<const N: usize>(start: &[f64; N], stages: &Stages<N>) -> [f64; N] {
    let [.., weights] = RADAU.spectrum;
    std::array::from_fn(|i| coefficient(&weights, i, start, stages).abs())
}

/// The same of the coefficient two degrees lower.
pub(super) fn lower_tail<const N: usize>(start: &[f64; N], stages: &Stages<N>) -> [f64; N] {
    let [weights, ..] = RADAU.spectrum;
    std::array::from_fn(|i| coefficient(&weights, i, start, stages).abs())
}

fn coefficient<const N: usize>(
    weights: &[f64; STAGES + 1],
    i: usize,
    start: &[f64; N],
    stages: &Stages<N>,
) -> f64 {
    let from_stages: f64 = (0..STAGES).map(|j| weights[j + 1] * stages[j][i]).sum();
    weights[0] * start[i] + from_stages
}

/// State at a fraction of an element, or of its polynomial beyond.
pub(super) fn interpolate<const N: usize>(
    start: &[f64; N],
    stages: &Stages<N>,
    part: f64,
) -> [f64; N] {
    let weights = RADAU.weights(part);
    std::array::from_fn(|i| coefficient(&weights, i, start, stages))
}
