//! Collocation element (time step): its stage equations, linearised and condensed.
//!
//! An angle that is the integral of its rate ([`Reduced::INTEGRATED`]) is not an unknown of the element: at every stage
//! it equals its value at the start of the element plus the integral given by the collocation rule.

mod adjoint;

use trilink_robot::{Number, Pose};

pub(super) use adjoint::fold_angles;

use super::lu;
use super::mesh::renew;
use super::radau::{RADAU, Radau, STAGES};
use super::reduced::{Reduced, Residual};

/// States at the stages of one collocation element.
pub(super) type Stages<const N: usize, T = f64> = [[T; N]; STAGES];

/// Collocation element of a motion, or one element per SIMD lane.
pub(super) struct Element<'a, const N: usize, R: Reduced<N>, T: Number = f64> {
    /// Joint command at each stage.
    pub nodes: &'a [R::Node<T>],
    pub start: &'a [T; N],
    pub stages: &'a Stages<N, T>,
    pub duration_s: T,
}

impl<const N: usize, R: Reduced<N>, T: Number> Element<'_, N, R, T> {
    /// Returns the time derivatives of the element's states at stage `j`.
    #[inline(always)]
    pub(crate) fn rate(&self, j: usize) -> [T; N] {
        rate(&RADAU, self.start, self.stages, j, T::splat(1.0) / self.duration_s)
    }

    /// Returns the joint angles and velocities of the robot at the stages.
    #[inline(always)]
    pub(crate) fn kinematics(&self, model: &R) -> [R::State<T>; STAGES] {
        std::array::from_fn(|j| model.kinematics(&self.nodes[j], &self.stages[j]))
    }
}

/// Returns the time derivatives, at stage `j`, of the polynomial through `start` and `stages`; `per_s` is the
/// reciprocal of the element's duration.
#[inline(always)]
pub(super) fn rate<const N: usize, T: Number>(
    rule: &Radau,
    start: &[T; N],
    stages: &Stages<N, T>,
    j: usize,
    per_s: T,
) -> [T; N] {
    let mut rates = [T::splat(0.0); N];
    for i in 0..N {
        let mut sum = T::splat(rule.differentiate_start[j]) * start[i];
        for l in 0..STAGES {
            sum += T::splat(rule.differentiate[j][l]) * stages[l][i];
        }
        rates[i] = sum * per_s;
    }
    rates
}

/// Assembles the linear system of one element: its block matrix `matrix` (see [`lu::factor`]) and the
/// derivatives of the right-hand side with respect to the state at the element's start, `N` per row.
/// `equations` returns the residual at a stage, given the time derivatives there.
#[inline(always)]
fn assemble<const N: usize, R: Reduced<N>, T: Number>(
    element: &Element<N, R, T>,
    matrix: &mut [T],
    right: &mut [T],
    mut equations: impl FnMut(usize, &[T; N]) -> Residual<N, T>,
) {
    let rule = &*RADAU;
    let per_stage = R::UNKNOWNS;
    let size = per_stage * STAGES;
    let per_s = T::splat(1.0) / element.duration_s;
    for j in 0..STAGES {
        let rows = &mut right[j * per_stage * N..][..per_stage * N];
        let dy = rate(rule, element.start, element.stages, j, per_s);
        let residual = equations(j, &dy);
        let blocks = &mut matrix[j * per_stage * size..][..per_stage * size];
        for i in 0..per_stage {
            let state_jacobian = &residual.state_jacobian[i];
            let rate_jacobian = &residual.rate_jacobian[i];
            for (l, block) in blocks.chunks_exact_mut(per_stage * per_stage).enumerate() {
                let row = &mut block[i * per_stage..][..per_stage];
                let weight = T::splat(rule.differentiate[j][l]) * per_s;
                for m in 0..per_stage {
                    row[m] = rate_jacobian[m] * weight;
                }
                for angle in R::UNKNOWNS..N {
                    row[angle - R::ANGLES] += state_jacobian[angle]
                        * (T::splat(rule.integrate[j][l]) * element.duration_s);
                }
                if l == j {
                    (0..per_stage).for_each(|m| row[m] += state_jacobian[m]);
                }
            }
            let start_jacobian = &mut rows[i * N..][..N];
            let weight = T::splat(-rule.differentiate_start[j]) * per_s;
            for m in 0..per_stage {
                start_jacobian[m] = rate_jacobian[m] * weight;
            }
            for angle in R::UNKNOWNS..N {
                start_jacobian[angle] = -state_jacobian[angle];
            }
        }
    }
}

/// Linearised collocation elements of a motion, in packs of one element per SIMD lane of `T`; the buffers are
/// reused.
#[derive(Debug, Clone)]
pub(super) struct Linearisation<T = f64> {
    factors: Vec<T>,
    /// Derivatives of each element's unknowns with respect to the state at its start (`N` columns).
    transfer: Vec<T>,
    /// Newton step of each element's unknowns with the state at its start held fixed.
    step: Vec<T>,
}

impl<T> Default for Linearisation<T> {
    fn default() -> Self {
        Self { factors: Vec::new(), transfer: Vec::new(), step: Vec::new() }
    }
}

impl<T: Number> Linearisation<T> {
    /// Resizes the buffers for `count` elements; what they held is lost if they grow.
    pub(crate) fn resize<const N: usize, R: Reduced<N>>(&mut self, count: usize) {
        let size = R::UNKNOWNS * STAGES;
        let packs = count.div_ceil(T::COUNT);
        let resize = |buffer: &mut Vec<T>, count: usize| {
            if buffer.len() < count {
                renew(buffer, count);
            }
            buffer.resize(count, T::splat(0.0));
        };
        resize(&mut self.factors, packs * size * size);
        resize(&mut self.transfer, packs * size * N);
        resize(&mut self.step, packs * size);
    }

    /// Linearises and factors the elements in pack `pack` (one per SIMD lane of `T`). The Newton step is left
    /// to [`Linearisation::solve_step`]; the derivatives with respect to the states at the elements' starts
    /// are solved for only if `with_transfer`. The results of a singular system are not finite.
    #[inline(always)]
    pub(crate) fn linearise<const N: usize, R: Reduced<N>>(
        &mut self,
        pack: usize,
        model: &R,
        element: &Element<N, R, T>,
        with_transfer: bool,
    ) {
        let per_stage = R::UNKNOWNS;
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

    /// Evaluates the residuals of the elements in pack `pack` (one per SIMD lane of `T`); the factors
    /// computed by the last [`Linearisation::linearise`] are retained.
    #[inline(always)]
    pub(crate) fn evaluate<const N: usize, R: Reduced<N>>(
        &mut self,
        pack: usize,
        model: &R,
        element: &Element<N, R, T>,
    ) {
        let rule = &*RADAU;
        let per_s = T::splat(1.0) / element.duration_s;
        let per_stage = R::UNKNOWNS;
        let step = &mut self.step[pack * per_stage * STAGES..][..per_stage * STAGES];
        for j in 0..STAGES {
            let dy = rate(rule, element.start, element.stages, j, per_s);
            let value = model.value(&element.nodes[j], &element.stages[j], &dy);
            for i in 0..per_stage {
                step[j * per_stage + i] = -value[i];
            }
        }
    }

    /// Solves for the Newton step of the elements in pack `pack` (one per SIMD lane of `T`), with the current
    /// factors.
    #[inline(always)]
    pub(crate) fn solve_step<const N: usize, R: Reduced<N>>(&mut self, pack: usize) {
        let per_stage = R::UNKNOWNS;
        let size = per_stage * STAGES;
        let factors = &self.factors[pack * size * size..][..size * size];
        lu::solve(per_stage, 1, factors, &mut self.step[pack * size..][..size]);
    }

    /// Returns, for the elements in pack `pack` (one per SIMD lane of `T`), the derivatives of the unknowns
    /// with respect to the state at an element's start, and the Newton step.
    #[inline(always)]
    fn solutions<const N: usize, R: Reduced<N>>(&self, pack: usize) -> (&[T], &[T]) {
        let size = R::UNKNOWNS * STAGES;
        (&self.transfer[pack * size * N..][..size * N], &self.step[pack * size..][..size])
    }

    /// Returns the changes in the states at the stages of the elements in pack `pack` (one per SIMD lane of
    /// `T`): their Newton step plus the effect of the change `start` in the states at their starts.
    #[inline(always)]
    pub(crate) fn changes<const N: usize, R: Reduced<N>>(
        &self,
        pack: usize,
        start: &[T; N],
        duration_s: T,
    ) -> Stages<N, T> {
        let per_stage = R::UNKNOWNS;
        let (transfer, step) = self.solutions::<N, R>(pack);
        let mut changes = [[T::splat(0.0); N]; STAGES];
        for j in 0..STAGES {
            for i in 0..per_stage {
                let row = j * per_stage + i;
                let entries = transfer[row * N..][..N].iter().zip(start);
                changes[j][i] =
                    entries.fold(step[row], |sum, (entry, start)| sum + *entry * *start);
            }
        }
        integrate_angles::<N, R, T>(&mut changes, start, duration_s);
        changes
    }

    /// Returns, for each element in pack `pack` (one per SIMD lane of `T`), the derivatives of the state at
    /// its end with respect to the state at its start.
    #[inline(always)]
    pub(crate) fn end_transfer<const N: usize, R: Reduced<N>>(
        &self,
        pack: usize,
        duration_s: T,
    ) -> [[T; N]; N] {
        let (transfer, _) = self.solutions::<N, R>(pack);
        let mut ends = [[T::splat(0.0); N]; N];
        for m in 0..N {
            let end = end_change::<N, R, T>(duration_s, |row| transfer[row * N + m]);
            (0..N).for_each(|i| ends[i][m] = end[i]);
        }
        for angle in R::UNKNOWNS..N {
            ends[angle][angle] += T::splat(1.0);
        }
        ends
    }

    /// Returns, for each element in pack `pack` (one per SIMD lane of `T`), the change in the state at its
    /// end due to the Newton step, with the state at its start held fixed.
    #[inline(always)]
    pub(crate) fn end_step<const N: usize, R: Reduced<N>>(
        &self,
        pack: usize,
        duration_s: T,
    ) -> [T; N] {
        let (_, step) = self.solutions::<N, R>(pack);
        end_change::<N, R, T>(duration_s, |row| step[row])
    }
}

/// Returns the change in the state at an element's end, given the changes in its unknowns.
#[inline(always)]
fn end_change<const N: usize, R: Reduced<N>, T: Number>(
    duration_s: T,
    unknown: impl Fn(usize) -> T,
) -> [T; N] {
    let per_stage = R::UNKNOWNS;
    std::array::from_fn(|i| {
        if i < per_stage {
            return unknown((STAGES - 1) * per_stage + i);
        }
        let weights = RADAU.integrate[STAGES - 1];
        (0..STAGES).fold(T::splat(0.0), |sum, l| {
            sum + duration_s * T::splat(weights[l]) * unknown(l * per_stage + i - R::ANGLES)
        })
    })
}

/// Sets the angles at every stage to their values at the element's start plus the integrals of their rates, if the
/// model defines them as such integrals.
#[inline(always)]
pub(super) fn integrate_angles<const N: usize, R: Reduced<N>, T: Number>(
    stages: &mut Stages<N, T>,
    start: &[T; N],
    duration_s: T,
) {
    for angle in R::UNKNOWNS..N {
        let integrals = integrals(&stages.map(|y| y[angle - R::ANGLES]), duration_s);
        for j in 0..STAGES {
            stages[j][angle] = start[angle] + integrals[j];
        }
    }
}

/// Returns the integrals from an element's start to each stage of a quantity with the given `rates` at the
/// stages.
#[inline(always)]
pub(super) fn integrals<T: Number>(rates: &[T; STAGES], duration_s: T) -> [T; STAGES] {
    let rule = &*RADAU;
    let mut integrals = [T::splat(0.0); STAGES];
    for j in 0..STAGES {
        for l in 0..STAGES {
            integrals[j] += T::splat(rule.integrate[j][l]) * rates[l];
        }
        integrals[j] = duration_s * integrals[j];
    }
    integrals
}

/// Solves for the states at the stages of an element by Newton's method, starting from `guess`; returns
/// `None` if the iteration fails. The factors are reused while they give fast contraction. Overwrites element
/// 0 of the workspace.
pub(super) fn solve_element<const N: usize, R: Reduced<N>>(
    model: &R,
    guess: &Element<N, R>,
    tolerance: f64,
    workspace: &mut Linearisation,
) -> Option<Stages<N>> {
    const MAX_STEPS: usize = 12;
    /// Maximum ratio of successive Newton steps at which the factors are reused.
    const FAST_CONTRACTION: f64 = 0.15;
    let Element { nodes, start, duration_s, .. } = *guess;
    let mut stages = *guess.stages;
    integrate_angles::<N, R, f64>(&mut stages, start, duration_s);
    let max_error = 0.01 * tolerance;
    let mut is_fresh = true;
    let mut last_step = f64::INFINITY;
    for _ in 0..MAX_STEPS {
        let element = Element { nodes, start, stages: &stages, duration_s };
        if is_fresh {
            workspace.linearise(0, model, &element, false);
        } else {
            workspace.evaluate(0, model, &element);
        }
        workspace.solve_step::<N, R>(0);
        let changes = workspace.changes::<N, R>(0, &[0.0; N], duration_s);
        let mut step = 0.0_f64;
        let mut size = 0.0_f64;
        for (y, change) in stages.iter_mut().zip(&changes) {
            for i in 0..N {
                y[i] += change[i];
                // `max` would ignore NaN.
                step = if change[i].abs() <= step { step } else { change[i].abs() };
                size = size.max(y[i].abs());
            }
        }
        if !step.is_finite() {
            return None;
        }
        let step = step / size.max(f64::MIN_POSITIVE);
        let contraction = step / last_step;
        // With fresh factors the next step is about the square of this one; with reused factors steps
        // continue to contract at the same rate.
        let is_last = if is_fresh {
            step <= max_error.sqrt().min(1e-4)
        } else {
            contraction < FAST_CONTRACTION && contraction * step <= max_error
        };
        if is_last {
            return Some(stages);
        }
        is_fresh = !is_fresh && contraction >= FAST_CONTRACTION;
        last_step = step;
    }
    None
}

/// Returns, for each state, the weighted sum of its values at the start and the stages of an element: a
/// Legendre coefficient of the element's polynomial (see [`Radau::spectrum`]) or the polynomial's value at a
/// point (see [`Radau::weights`]).
#[inline(always)]
pub(super) fn weighted<const N: usize, T: Number>(
    weights: &[f64; STAGES + 1],
    start: &[T; N],
    stages: &Stages<N, T>,
) -> [T; N] {
    let mut sums = [T::splat(0.0); N];
    for i in 0..N {
        sums[i] = T::splat(weights[0]) * start[i];
        for j in 0..STAGES {
            sums[i] += T::splat(weights[j + 1]) * stages[j][i];
        }
    }
    sums
}

/// Returns the state after a fraction of an element's length, by extrapolation if the fraction exceeds 1.
pub(super) fn interpolate<const N: usize>(
    start: &[f64; N],
    stages: &Stages<N>,
    fraction: f64,
) -> [f64; N] {
    weighted(&RADAU.weights(fraction), start, stages)
}

/// Returns the poses at the stages of an element that starts at pose `from`; the last one is the pose at the
/// element's end.
pub(super) fn integrate_poses(
    from: Pose,
    velocities: &[[f64; 3]; STAGES],
    duration_s: f64,
) -> [Pose; STAGES] {
    integrate_path(from, velocities, duration_s).0
}

/// Returns the poses at the stages of an element that starts at pose `from`, and the sine and cosine of
/// their headings.
pub(super) fn integrate_path(
    from: Pose,
    velocities: &[[f64; 3]; STAGES],
    duration_s: f64,
) -> ([Pose; STAGES], [(f64, f64); STAGES]) {
    let turned = integrals(&velocities.map(|[_, _, turning]| turning), duration_s);
    let headings_rad = turned.map(|turned| from.theta_rad + turned);
    let mut directions = [(0.0, 1.0); STAGES];
    for j in (0..STAGES).step_by(2) {
        let next = (j + 1).min(STAGES - 1);
        [directions[j], directions[next]] =
            Number::both_sin_cos([headings_rad[j], headings_rad[next]]);
    }
    let mut rates = [[0.0; STAGES]; 2];
    for j in 0..STAGES {
        let (sin, cos) = directions[j];
        let [u, v, _] = velocities[j];
        rates[0][j] = cos * u - sin * v;
        rates[1][j] = sin * u + cos * v;
    }
    let [x, y] = rates.map(|rates| integrals(&rates, duration_s));
    let poses = std::array::from_fn(|j| Pose {
        x_m: from.x_m + x[j],
        y_m: from.y_m + y[j],
        theta_rad: headings_rad[j],
    });
    (poses, directions)
}
