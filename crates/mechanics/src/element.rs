//! One collocation element: the equations at its stages, linearised and condensed.
//!
//! A state that is merely the integral of the one before it ([`Reduced::INTEGRATED`]) is no
//! unknown of the element: at every stage it is its start plus the rule's integral.

mod adjoint;

use trilink_robot::{Number, Pose};

use super::lu;
use super::radau::{RADAU, Radau, STAGES};
use super::reduced::{KinematicState, MOST_PARAMETERS, Reduced, Residual};

/// States at the stages of one element.
pub(super) type Stages<const N: usize, T = f64> = [[T; N]; STAGES];

/// An element of a motion, or one in each lane.
pub(super) struct Element<'a, const N: usize, R: Reduced<N>, T: Number = f64> {
    /// The command at the stages.
    pub nodes: &'a [R::Node<T>],
    pub start: &'a [T; N],
    pub stages: &'a Stages<N, T>,
    pub duration_s: T,
}

impl<const N: usize, R: Reduced<N>, T: Number> Element<'_, N, R, T> {
    /// Time derivatives of the states at stage `j`.
    #[inline(always)]
    pub(crate) fn rate(&self, j: usize) -> [T; N] {
        rate(&RADAU, self.start, self.stages, j, T::of(1.0) / self.duration_s)
    }

    /// Angles and velocities of the robot at the stages.
    #[inline(always)]
    pub(crate) fn kinematics(&self, model: &R) -> [KinematicState<T>; STAGES] {
        std::array::from_fn(|j| model.kinematics(&self.nodes[j], &self.stages[j]))
    }
}

/// Time derivatives at stage `j` of the polynomial through `start` and `stages`.
#[inline(always)]
pub(super) fn rate<const N: usize, T: Number>(
    rule: &Radau,
    start: &[T; N],
    stages: &Stages<N, T>,
    j: usize,
    per_s: T,
) -> [T; N] {
    let mut rates = [T::of(0.0); N];
    for i in 0..N {
        let mut sum = T::of(rule.differentiate_start[j]) * start[i];
        for l in 0..STAGES {
            sum += T::of(rule.differentiate[j][l]) * stages[l][i];
        }
        rates[i] = sum * per_s;
    }
    rates
}

/// Unknowns per stage.
pub(super) const fn unknowns<const N: usize, R: Reduced<N>>() -> usize {
    if R::INTEGRATED { N - 1 } else { N }
}

/// Writes the linear system of one element: its `matrix` of blocks (see [`lu::factor`]) and the
/// derivatives of the right-hand side with respect to the element's start, `N` in each row.
/// `equations` gives the residual of a stage from its time derivatives.
#[inline(always)]
fn assemble<const N: usize, R: Reduced<N>, T: Number>(
    element: &Element<N, R, T>,
    matrix: &mut [T],
    right: &mut [T],
    mut equations: impl FnMut(usize, &[T; N]) -> Residual<N, T>,
) {
    let rule = &*RADAU;
    let per_stage = unknowns::<N, R>();
    let size = per_stage * STAGES;
    let per_s = T::of(1.0) / element.duration_s;
    for j in 0..STAGES {
        let rows = &mut right[j * per_stage * N..][..per_stage * N];
        let dy = rate(rule, element.start, element.stages, j, per_s);
        let residual = equations(j, &dy);
        let blocks = &mut matrix[j * per_stage * size..][..per_stage * size];
        for i in 0..per_stage {
            let (state_jacobian, rate_jacobian) =
                (&residual.state_jacobian[i], &residual.rate_jacobian[i]);
            for (l, block) in blocks.chunks_exact_mut(per_stage * per_stage).enumerate() {
                let row = &mut block[i * per_stage..][..per_stage];
                let weight = T::of(rule.differentiate[j][l]) * per_s;
                for m in 0..per_stage {
                    row[m] = rate_jacobian[m] * weight;
                }
                if R::INTEGRATED {
                    row[N - 2] +=
                        state_jacobian[N - 1] * (T::of(rule.integrate[j][l]) * element.duration_s);
                }
                if l == j {
                    (0..per_stage).for_each(|m| row[m] += state_jacobian[m]);
                }
            }
            let start_jacobian = &mut rows[i * N..][..N];
            let weight = T::of(-rule.differentiate_start[j]) * per_s;
            for m in 0..per_stage {
                start_jacobian[m] = rate_jacobian[m] * weight;
            }
            if R::INTEGRATED {
                start_jacobian[N - 1] = -state_jacobian[N - 1];
            }
        }
    }
}

/// The linearised elements of a motion, one beside the other in the lanes of `T`; grows once and is
/// used again.
#[derive(Debug, Clone)]
pub(super) struct Linearisation<T = f64> {
    factors: Vec<T>,
    /// Per element: derivatives of its unknowns with respect to its start (`N` columns).
    transfer: Vec<T>,
    /// Per element: the step of its unknowns when its start stays.
    step: Vec<T>,
    /// Per element: derivatives of its residuals with respect to the parameters.
    slopes: Vec<[T; MOST_PARAMETERS]>,
}

impl<T> Default for Linearisation<T> {
    fn default() -> Self {
        let (factors, transfer, step, slopes) = Default::default();
        Self { factors, transfer, step, slopes }
    }
}

impl<T: Number> Linearisation<T> {
    /// Makes room for `count` elements.
    pub(crate) fn resize<const N: usize, R: Reduced<N>>(&mut self, count: usize) {
        let (size, packs) = (unknowns::<N, R>() * STAGES, count.div_ceil(T::COUNT));
        self.factors.resize(packs * size * size, T::of(0.0));
        self.transfer.resize(packs * size * N, T::of(0.0));
        self.step.resize(packs * size, T::of(0.0));
    }

    /// Linearises the elements of `pack` at their stages and factors them; their step is left
    /// unsolved until [`Linearisation::solve_step`], the transfer too where the start stays (not
    /// `with_transfer`). What comes of a singular system is not finite.
    #[inline(always)]
    pub(crate) fn linearise<const N: usize, R: Reduced<N>>(
        &mut self,
        pack: usize,
        model: &R,
        element: &Element<N, R, T>,
        with_transfer: bool,
    ) {
        let per_stage = unknowns::<N, R>();
        let size = per_stage * STAGES;
        let matrix = &mut self.factors[pack * size * size..][..size * size];
        let transfer = &mut self.transfer[pack * size * N..][..size * N];
        let step = &mut self.step[pack * size..][..size];
        assemble(element, matrix, transfer, |j, dy| {
            let residual = model.residual(&element.nodes[j], &element.stages[j], dy);
            for i in 0..per_stage {
                step[j * per_stage + i] = -residual.value[i];
            }
            residual
        });
        lu::factor(per_stage, matrix);
        if with_transfer {
            lu::solve(per_stage, N, matrix, transfer);
        }
    }

    /// Evaluates the residuals of the elements of `pack` alone; the factors stay those of the last
    /// [`Linearisation::linearise`].
    #[inline(always)]
    pub(crate) fn evaluate<const N: usize, R: Reduced<N>>(
        &mut self,
        pack: usize,
        model: &R,
        element: &Element<N, R, T>,
    ) {
        let (rule, per_s) = (&*RADAU, T::of(1.0) / element.duration_s);
        let per_stage = unknowns::<N, R>();
        let step = &mut self.step[pack * per_stage * STAGES..][..per_stage * STAGES];
        for j in 0..STAGES {
            let dy = rate(rule, element.start, element.stages, j, per_s);
            let value = model.residual(&element.nodes[j], &element.stages[j], &dy).value;
            for i in 0..per_stage {
                step[j * per_stage + i] = -value[i];
            }
        }
    }

    /// Solves for the step of the elements of `pack` with the factors at hand.
    #[inline(always)]
    pub(crate) fn solve_step<const N: usize, R: Reduced<N>>(&mut self, pack: usize) {
        let per_stage = unknowns::<N, R>();
        let size = per_stage * STAGES;
        let factors = &self.factors[pack * size * size..][..size * size];
        lu::solve(per_stage, 1, factors, &mut self.step[pack * size..][..size]);
    }

    /// Derivatives of the unknowns of the elements of `pack` with respect to their start, and their
    /// step.
    #[inline(always)]
    fn answers<const N: usize, R: Reduced<N>>(&self, pack: usize) -> (&[T], &[T]) {
        let size = unknowns::<N, R>() * STAGES;
        (&self.transfer[pack * size * N..][..size * N], &self.step[pack * size..][..size])
    }

    /// Changes of the stages of the elements of `pack` by their step when their start changes by
    /// `start`.
    #[inline(always)]
    pub(crate) fn changes<const N: usize, R: Reduced<N>>(
        &self,
        pack: usize,
        start: &[T; N],
        duration_s: T,
    ) -> Stages<N, T> {
        let per_stage = unknowns::<N, R>();
        let (transfer, step) = self.answers::<N, R>(pack);
        let mut changes = [[T::of(0.0); N]; STAGES];
        for j in 0..STAGES {
            for i in 0..per_stage {
                let row = j * per_stage + i;
                let entries = transfer[row * N..][..N].iter().zip(start);
                changes[j][i] =
                    entries.fold(step[row], |sum, (entry, start)| sum + *entry * *start);
            }
        }
        if R::INTEGRATED {
            integrate_last(&mut changes, start[N - 1], duration_s);
        }
        changes
    }

    /// Derivatives of the ends of the elements of `pack` with respect to their start.
    #[inline(always)]
    pub(crate) fn end_transfer<const N: usize, R: Reduced<N>>(
        &self,
        pack: usize,
        duration_s: T,
    ) -> [[T; N]; N] {
        let (transfer, _) = self.answers::<N, R>(pack);
        let mut ends = [[T::of(0.0); N]; N];
        for m in 0..N {
            let end = end_change::<N, R, T>(duration_s, |row| transfer[row * N + m]);
            (0..N).for_each(|i| ends[i][m] = end[i]);
        }
        if R::INTEGRATED {
            ends[N - 1][N - 1] += T::of(1.0);
        }
        ends
    }

    /// Changes of the ends of the elements of `pack` by their step when their start stays.
    #[inline(always)]
    pub(crate) fn end_step<const N: usize, R: Reduced<N>>(
        &self,
        pack: usize,
        duration_s: T,
    ) -> [T; N] {
        let (_, step) = self.answers::<N, R>(pack);
        end_change::<N, R, T>(duration_s, |row| step[row])
    }
}

/// Change of an element's end by those of its unknowns.
#[inline(always)]
fn end_change<const N: usize, R: Reduced<N>, T: Number>(
    duration_s: T,
    unknown: impl Fn(usize) -> T,
) -> [T; N] {
    let per_stage = unknowns::<N, R>();
    std::array::from_fn(|i| {
        if i < per_stage {
            return unknown((STAGES - 1) * per_stage + i);
        }
        let weights = RADAU.integrate[STAGES - 1];
        (0..STAGES).fold(T::of(0.0), |sum, l| {
            sum + duration_s * T::of(weights[l]) * unknown(l * per_stage + i - 1)
        })
    })
}

/// Sets the last state of every stage to its start plus the integral of the state before it.
#[inline(always)]
pub(super) fn integrate_last<const N: usize, T: Number>(
    stages: &mut Stages<N, T>,
    start: T,
    duration_s: T,
) {
    let integrals = integrals(&stages.map(|y| y[N - 2]), duration_s);
    for j in 0..STAGES {
        stages[j][N - 1] = start + integrals[j];
    }
}

/// Integrals from an element's start to its stages.
#[inline(always)]
pub(super) fn integrals<T: Number>(rates: &[T; STAGES], duration_s: T) -> [T; STAGES] {
    let rule = &*RADAU;
    let mut integrals = [T::of(0.0); STAGES];
    for j in 0..STAGES {
        for l in 0..STAGES {
            integrals[j] += T::of(rule.integrate[j][l]) * rates[l];
        }
        integrals[j] = duration_s * integrals[j];
    }
    integrals
}

/// The stages of an element from its start, by Newton's method from the stages that it has, or
/// `None` if it fails. The factors are kept while steps by them shrink fast. Overwrites element 0
/// of the workspace.
pub(super) fn solve_element<const N: usize, R: Reduced<N>>(
    model: &R,
    guess: &Element<N, R>,
    tolerance: f64,
    workspace: &mut Linearisation,
) -> Option<Stages<N>> {
    const MOST_STEPS: usize = 12;
    /// Factors are kept while a step by them is at most this part of the one before.
    const FAST: f64 = 0.15;
    let Element { nodes, start, duration_s, .. } = *guess;
    let mut stages = *guess.stages;
    if R::INTEGRATED {
        integrate_last(&mut stages, start[N - 1], duration_s);
    }
    let enough = 0.01 * tolerance;
    let (mut is_fresh, mut last_step) = (true, f64::INFINITY);
    for _ in 0..MOST_STEPS {
        let element = Element { nodes, start, stages: &stages, duration_s };
        match is_fresh {
            true => workspace.linearise(0, model, &element, false),
            false => workspace.evaluate(0, model, &element),
        }
        workspace.solve_step::<N, R>(0);
        let changes = workspace.changes::<N, R>(0, &[0.0; N], duration_s);
        let (mut step, mut size) = (0.0_f64, 0.0_f64);
        for (y, change) in stages.iter_mut().zip(&changes) {
            for i in 0..N {
                y[i] += change[i];
                // Not `max`, which passes over NaN.
                step = if change[i].abs() <= step { step } else { change[i].abs() };
                size = size.max(y[i].abs());
            }
        }
        if !step.is_finite() {
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

/// A Legendre coefficient of each state's polynomial in the element, or the state at a place of it:
/// what comes of these weights, see [`Radau::spectrum`] and [`Radau::weights`].
#[inline(always)]
pub(super) fn weighted<const N: usize, T: Number>(
    weights: &[f64; STAGES + 1],
    start: &[T; N],
    stages: &Stages<N, T>,
) -> [T; N] {
    let mut sums = [T::of(0.0); N];
    for i in 0..N {
        sums[i] = T::of(weights[0]) * start[i];
        for j in 0..STAGES {
            sums[i] += T::of(weights[j + 1]) * stages[j][i];
        }
    }
    sums
}

/// State at a fraction of an element, or of its polynomial beyond.
pub(super) fn interpolate<const N: usize>(
    start: &[f64; N],
    stages: &Stages<N>,
    fraction: f64,
) -> [f64; N] {
    weighted(&RADAU.weights(fraction), start, stages)
}

/// Where the robot goes: poses at the stages of an element that starts at `from`; the last is its end.
pub(super) fn integrate_poses(
    from: Pose,
    states: &[KinematicState; STAGES],
    duration_s: f64,
) -> [Pose; STAGES] {
    integrate_path(from, states, duration_s).0
}

/// The same with sine and cosine of the headings.
pub(super) fn integrate_path(
    from: Pose,
    states: &[KinematicState; STAGES],
    duration_s: f64,
) -> ([Pose; STAGES], [(f64, f64); STAGES]) {
    let turned = integrals(&states.map(|state| state.velocity[2]), duration_s);
    let headings_rad = turned.map(|turned| from.theta_rad + turned);
    let mut directions = [(0.0, 1.0); STAGES];
    for j in (0..STAGES).step_by(2) {
        let next = (j + 1).min(STAGES - 1);
        [directions[j], directions[next]] =
            Number::both_sin_cos([headings_rad[j], headings_rad[next]]);
    }
    let mut rates = [[0.0; STAGES]; 2];
    for j in 0..STAGES {
        let ((sin, cos), [u, v, ..]) = (directions[j], states[j].velocity);
        (rates[0][j], rates[1][j]) = (cos * u - sin * v, sin * u + cos * v);
    }
    let [x, y] = rates.map(|rates| integrals(&rates, duration_s));
    let pose =
        |j: usize| Pose { x_m: from.x_m + x[j], y_m: from.y_m + y[j], theta_rad: headings_rad[j] };
    (std::array::from_fn(pose), directions)
}
