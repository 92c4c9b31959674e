//! Newton's method for the orbit, and its stability.

use nalgebra::{Complex, Matrix5, SMatrix, SVector};
use trilink_robot::{LANES, Lanes, Number};

use super::PeriodicOrbit;
use crate::mesh::Mesh;
use crate::reduced::{Reduced, lanes};
use crate::{MotionError, Result};

const MOST_STEPS: usize = 60;
/// Newton gives up when steps do not shrink along this part of one.
const LEAST_PART: f64 = 1.0 / 512.0;
/// Factors are kept while a step is at most this part of the one before.
const FAST: f64 = 0.15;
/// By how much less a step by kept factors may shrink than the one before: the first one shrinks
/// twice as much as those that follow.
const SLOWER: f64 = 3.0;
/// Steps below this size are rounding: whether they shrink cannot be judged.
const ROUNDING: f64 = 1e-9;
/// By how much the error may be larger than the contraction seen so far lets expect.
const SAFETY: f64 = 10.0;

impl<const N: usize, R: Reduced<N>> PeriodicOrbit<N, R> {
    pub(crate) fn not_converged(&self) -> MotionError {
        MotionError::NotConverged { steps: self.steps }
    }

    /// Linearises the elements at the present states and prepares the chain's closure.
    fn linearise(&mut self, model: &R) -> Result<()> {
        self.linearise_elements(model);
        let open = SMatrix::<f64, N, N>::identity() - self.monodromy();
        self.monodromy_closure = open.try_inverse().ok_or(self.not_converged())?;
        Ok(())
    }

    /// Linearises the elements at the present states.
    pub(super) fn linearise_elements(&mut self, model: &R) {
        self.effort.factorisations += 1;
        let Self { mesh, linearisation, transfers, .. } = self;
        transfers.clear();
        for pack in 0..mesh.packs() {
            let starts = mesh.starts(pack);
            linearisation.linearise(pack, model, &mesh.pack(pack, &starts), true);
            let ends = linearisation.end_transfer::<N, R>(pack, mesh.durations_s[pack]);
            for lane in 0..mesh.elements_of(pack).len() {
                let mut transfer = [[0.0; N]; N];
                for i in 0..N {
                    (0..N).for_each(|m| transfer[i][m] = ends[i][m].lane(lane));
                }
                transfers.push(transfer);
            }
        }
    }

    /// Evaluates the residuals at the present states; the factors are kept.
    pub(super) fn evaluate(&mut self, model: &R) {
        for pack in 0..self.mesh.packs() {
            let starts = self.mesh.starts(pack);
            self.linearisation.evaluate(pack, model, &self.mesh.pack(pack, &starts));
        }
    }

    /// Derivative of the states at the end of the elements' span with respect to the start's.
    pub(super) fn monodromy(&self) -> SMatrix<f64, N, N> {
        SMatrix::from_columns(&std::array::from_fn::<_, N, _>(|m| {
            let unit = std::array::from_fn(|i| if i == m { 1.0 } else { 0.0 });
            let end = self.transfers.iter().fold(unit, |x, transfer| product(transfer, &x));
            SVector::from_fn(|i, _| self.mesh.signs[i] * end[i])
        }))
    }

    /// Solves the closed chain for the residuals at hand, into `step`.
    fn close(&mut self) {
        self.effort.linear_solves += 1;
        let Self { mesh, linearisation, transfers, offsets, step, .. } = self;
        let Mesh { states, signs, durations_s, .. } = &*mesh;
        offsets.clear();
        let mut end = [0.0; N];
        for pack in 0..mesh.packs() {
            linearisation.solve_step::<N, R>(pack);
            let steps = linearisation.end_step::<N, R>(pack, durations_s[pack]);
            for (lane, k) in mesh.elements_of(pack).enumerate() {
                let offset = steps.map(|step| step.lane(lane));
                end = sum(&product(&transfers[k], &end), &offset);
                offsets.push(offset);
            }
        }
        let ends = states.start_of(mesh.count);
        let mismatch = |i: usize| signs[i] * (end[i] + ends[i]) - states.start[i];
        let first = self.monodromy_closure * SVector::<f64, N>::from_fn(|i, _| mismatch(i));
        step.start = first.into();
        let mut start = step.start;
        step.packs.clear();
        for pack in 0..mesh.packs() {
            let mut starts = [start; LANES];
            for (lane, k) in mesh.elements_of(pack).enumerate() {
                starts[lane..].fill(start);
                start = sum(&product(&transfers[k], &start), &offsets[k]);
            }
            let starts = lanes(starts.each_ref());
            step.packs.push(linearisation.changes::<N, R>(pack, &starts, durations_s[pack]));
        }
    }

    /// Newton's method until what is left is below `accuracy`, relative to the states. A step is
    /// damped until the next one by the same factors is shorter (natural monotonicity, which
    /// does not depend on how the equations are scaled), and the factors are kept while steps
    /// by them shrink fast.
    ///
    /// Reference: P. Deuflhard, *Newton Methods for Nonlinear Problems*, Springer 2004,
    /// section 3.3.
    pub(super) fn newton(&mut self, model: &R, accuracy: f64) -> Result<()> {
        let enough = 0.3 * accuracy;
        let mut first_part = 1.0;
        while self.steps < MOST_STEPS {
            self.linearise(model)?;
            self.close();
            let sizes = self.sizes();
            let mut size = self.step_size(&sizes);
            if !size.is_finite() {
                return Err(self.not_converged());
            }
            let is_last = SAFETY * self.contraction * size * size <= enough;
            let mut part = first_part;
            let mut next_size = loop {
                self.move_by(if is_last { 1.0 } else { part });
                if is_last {
                    return Ok(());
                }
                let next_size = self.next_step(model, &sizes);
                if next_size < (1.0 - 0.25 * part) * size || size < ROUNDING {
                    break next_size;
                }
                // Back, and on by less.
                std::mem::swap(&mut self.step, &mut self.last_step);
                std::mem::swap(&mut self.mesh.states, &mut self.before);
                part *= 0.5;
                if part < LEAST_PART {
                    return Err(self.not_converged());
                }
            };
            first_part = f64::min(1.0, 2.0 * part);
            if part == 1.0 {
                self.contraction = next_size / (size * size);
            }
            while part == 1.0 && next_size < FAST * size && self.steps < MOST_STEPS {
                let shrinks = next_size / size;
                size = next_size;
                self.move_by(1.0);
                if SLOWER * shrinks * size <= enough {
                    return Ok(());
                }
                next_size = self.next_step(model, &sizes);
            }
        }
        Err(self.not_converged())
    }

    /// The step from the present states by the factors at hand, and its size.
    fn next_step(&mut self, model: &R, sizes: &[f64; N]) -> f64 {
        self.evaluate(model);
        std::mem::swap(&mut self.step, &mut self.last_step);
        self.close();
        let size = self.step_size(sizes);
        if size.is_finite() { size } else { f64::INFINITY }
    }

    /// Goes a part of `step`; where it comes from is left in `before`.
    pub(super) fn move_by(&mut self, part: f64) {
        self.steps += 1;
        self.effort.newton_steps += 1;
        std::mem::swap(&mut self.before, &mut self.mesh.states);
        let (now, before, step) = (&mut self.mesh.states, &self.before, &self.step);
        now.start = std::array::from_fn(|i| before.start[i] + part * step.start[i]);
        let part = Lanes::splat(part);
        now.packs.clear();
        now.packs.extend_from_slice(&before.packs);
        for (now, step) in now.packs.iter_mut().flatten().zip(step.packs.iter().flatten()) {
            (0..N).for_each(|i| now[i] += part * step[i]);
        }
    }

    /// Largest value of each state before or after a step.
    pub(super) fn sizes(&self) -> [f64; N] {
        let mut sizes = [Lanes::default(); N];
        let states = self.mesh.states.packs.iter().flatten();
        for (y, step) in states.zip(self.step.packs.iter().flatten()) {
            for i in 0..N {
                sizes[i] = sizes[i].fast_max(y[i].abs()).fast_max((y[i] + step[i]).abs());
            }
        }
        sizes.map(largest_lane)
    }

    /// Largest step of any state over that state's size; infinite where a step is not finite.
    pub(super) fn step_size(&self, sizes: &[f64; N]) -> f64 {
        let (mut steps, mut all) = ([Lanes::default(); N], Lanes::default());
        for step in self.step.packs.iter().flatten() {
            keep_largest(&mut steps, step);
            step.iter().for_each(|step| all += *step);
        }
        let is_finite = (0..LANES).all(|lane| all.lane(lane).is_finite());
        if is_finite { largest_ratio(&steps.map(largest_lane), sizes) } else { f64::INFINITY }
    }

    /// Modulus of the largest Floquet multiplier of a whole period, from a fresh
    /// linearisation.
    pub(crate) fn floquet(&mut self, model: &R) -> Result<f64> {
        if let Some(floquet) = self.floquet {
            return Ok(floquet);
        }
        self.linearise(model)?;
        let values = self.multipliers()?;
        let largest = values.iter().map(|value| value.norm()).fold(0.0, f64::max);
        Ok(*self.floquet.insert(if self.mesh.is_half { largest * largest } else { largest }))
    }

    /// Multipliers of the elements' span, some of them zero. By the factors at hand.
    pub(crate) fn multipliers(&self) -> Result<SVector<Complex<f64>, 5>> {
        const MOST_SWEEPS: usize = 1000;
        let padded = padded(&self.monodromy());
        if padded.iter().any(|entry| !entry.is_finite()) {
            return Err(self.not_converged());
        }
        let schur = padded.try_schur(f64::EPSILON, MOST_SWEEPS).ok_or(self.not_converged())?;
        Ok(schur.complex_eigenvalues())
    }

    /// Whether a motion that is its own mirror image has lost its stability to a pair of motions that
    /// are each other's: a multiplier of the half period is below -1. By the factors at hand.
    pub(crate) fn breaks_symmetry(&self) -> bool {
        self.mesh.is_half && (Matrix5::identity() + padded(&self.monodromy())).determinant() < 0.0
    }

    /// Whether the last solution is known to be stable.
    pub(crate) fn is_stable(&mut self, model: &R) -> bool {
        self.floquet(model).is_ok_and(|modulus| modulus < 1.0)
    }

    /// One Newton step from the last solution; gives the step relative to the states.
    pub(crate) fn polish(&mut self, model: &R) -> Result<f64> {
        self.linearise(model)?;
        self.close();
        let size = self.step_size(&self.sizes());
        self.move_by(1.0);
        self.path.follow(model, &self.mesh);
        (self.cycle, self.floquet) = (None, None);
        Ok(size)
    }
}

/// The matrix and zeros, which adds to the eigenvalues nothing but zeros: of one size for all orbits.
pub(super) fn padded<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Matrix5<f64> {
    Matrix5::from_fn(|i, j| if i < N && j < N { matrix[(i, j)] } else { 0.0 })
}

/// `matrix x`.
#[inline(always)]
pub(super) fn product<const N: usize>(matrix: &[[f64; N]; N], x: &[f64; N]) -> [f64; N] {
    let mut product = [0.0; N];
    for i in 0..N {
        (0..N).for_each(|m| product[i] += matrix[i][m] * x[m]);
    }
    product
}

#[inline(always)]
pub(super) fn sum<const N: usize>(a: &[f64; N], b: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|i| a[i] + b[i])
}

/// Replaces each of `largest` by the size of a value that is larger.
#[inline(always)]
pub(super) fn keep_largest<const K: usize>(largest: &mut [Lanes; K], values: &[Lanes; K]) {
    for (largest, value) in largest.iter_mut().zip(values) {
        *largest = largest.fast_max(value.abs());
    }
}

pub(crate) fn largest_lane(lanes: Lanes) -> f64 {
    lanes.to_array().into_iter().fold(0.0, f64::max)
}

/// Largest of `parts[i] / sizes[i]`. A state that is nothing beside the others, such as the
/// lateral motion of a robot that goes straight, counts as rounding.
pub(super) fn largest_ratio<const N: usize>(parts: &[f64; N], sizes: &[f64; N]) -> f64 {
    const NOTHING: f64 = 1e-9;
    let floor = NOTHING * sizes.iter().fold(0.0_f64, |largest, size| largest.max(*size));
    let mut largest = 0.0;
    for i in (0..N).filter(|&i| parts[i] != 0.0) {
        let ratio = parts[i] / sizes[i].max(floor);
        if ratio.is_nan() {
            return f64::INFINITY;
        }
        largest = f64::max(largest, ratio);
    }
    largest
}
