//! Newton's method for the periodic orbit, and the stability of the orbit.

use nalgebra::{Complex, DMatrix, Matrix5, SMatrix, SVector};
use trilink_robot::{LANES, Lanes, Number};

use super::PeriodicOrbit;
use crate::mesh::{Mesh, renew};
use crate::reduced::{MAX_STATES, Reduced, lanes};
use crate::{MotionError, Result};

/// Maximum number of Newton steps.
const MAX_STEPS: usize = 60;
/// Minimum damping factor; Newton's method fails if a step damped by this factor is still not acceptable.
const MIN_DAMPING: f64 = 1.0 / 512.0;
/// Maximum ratio of successive Newton steps at which the factors of the Jacobian are reused.
const FAST_CONTRACTION: f64 = 0.15;
/// Safety factor for the contraction observed while a factored Jacobian is reused, because the first step contracts
/// twice as much as the following ones.
const CONTRACTION_SAFETY: f64 = 3.0;
/// Relative step size below which steps are dominated by rounding errors, so that their contraction cannot be
/// judged.
const ROUNDING: f64 = 1e-9;
/// Safety factor for the error predicted from the observed contraction.
const ERROR_SAFETY: f64 = 10.0;

impl<const N: usize, R: Reduced<N>> PeriodicOrbit<N, R> {
    pub(crate) fn not_converged(&self) -> MotionError {
        MotionError::NotConverged { steps: self.steps }
    }

    /// Linearises the elements at the current states and prepares the solution of the cyclic linear system of
    /// the periodic orbit.
    pub(crate) fn linearise(&mut self, model: &R) -> Result<()> {
        self.linearise_elements(model);
        let open = SMatrix::<f64, N, N>::identity() - self.monodromy();
        self.monodromy_closure = open.try_inverse().ok_or(self.not_converged())?;
        Ok(())
    }

    /// Linearises the elements at the current states.
    pub(super) fn linearise_elements(&mut self, model: &R) {
        self.effort.factorisations += 1;
        let Self { mesh, linearisation, transfers, .. } = self;
        renew(transfers, mesh.count);
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

    /// Evaluates the residuals of the elements at the current states; the factors of the Jacobian are retained.
    pub(super) fn evaluate(&mut self, model: &R) {
        for pack in 0..self.mesh.packs() {
            let starts = self.mesh.starts(pack);
            self.linearisation.evaluate(pack, model, &self.mesh.pack(pack, &starts));
        }
    }

    /// Returns the monodromy matrix: the derivative of the state at the end of the mesh's time span (mirrored if the
    /// mesh covers half a period) with respect to the state at its start.
    pub(super) fn monodromy(&self) -> SMatrix<f64, N, N> {
        SMatrix::from_columns(&std::array::from_fn::<_, N, _>(|m| {
            let unit = std::array::from_fn(|i| if i == m { 1.0 } else { 0.0 });
            let end = self.transfers.iter().fold(unit, |x, transfer| product(transfer, &x));
            SVector::from_fn(|i, _| self.mesh.signs[i] * end[i])
        }))
    }

    /// Solves the cyclic linear system of the periodic orbit for the current residuals and stores the Newton
    /// step in `step`.
    fn solve_step(&mut self) {
        self.effort.linear_solves += 1;
        let Self { mesh, linearisation, transfers, offsets, step, .. } = self;
        let Mesh { states, signs, durations_s, .. } = &*mesh;
        renew(offsets, mesh.count);
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
        let mismatch =
            SVector::<f64, N>::from_fn(|i, _| signs[i] * (end[i] + ends[i]) - states.start[i]);
        step.start = (self.monodromy_closure * mismatch).into();
        let mut start = step.start;
        renew(&mut step.packs, mesh.packs());
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

    /// Iterates Newton's method until the error relative to the states is below `accuracy`. A step is damped until the
    /// next step with the same factors of the Jacobian is shorter (natural monotonicity test, which is invariant to the
    /// scaling of the equations). The factors are reused as long as convergence is fast.
    ///
    /// Reference: P. Deuflhard, *Newton Methods for Nonlinear Problems*, Springer 2004,
    /// section 3.3.
    pub(super) fn newton(&mut self, model: &R, accuracy: f64) -> Result<()> {
        let max_error = 0.3 * accuracy;
        let mut initial_damping = 1.0;
        while self.steps < MAX_STEPS {
            self.linearise(model)?;
            self.solve_step();
            let sizes = self.sizes();
            let mut size = self.step_size(&sizes);
            if !size.is_finite() {
                return Err(self.not_converged());
            }
            let is_last = ERROR_SAFETY * self.contraction * size * size <= max_error;
            let mut damping = initial_damping;
            let mut next_size = loop {
                self.move_by(if is_last { 1.0 } else { damping });
                if is_last {
                    return Ok(());
                }
                let next_size = self.next_step(model, &sizes);
                if next_size < (1.0 - 0.25 * damping) * size || size < ROUNDING {
                    break next_size;
                }
                // Reject the step and try a shorter one.
                std::mem::swap(&mut self.step, &mut self.last_step);
                std::mem::swap(&mut self.mesh.states, &mut self.before);
                damping *= 0.5;
                if damping < MIN_DAMPING {
                    return Err(self.not_converged());
                }
            };
            initial_damping = f64::min(1.0, 2.0 * damping);
            if damping == 1.0 {
                self.contraction = next_size / (size * size);
            }
            while damping == 1.0 && next_size < FAST_CONTRACTION * size && self.steps < MAX_STEPS {
                let contraction = next_size / size;
                size = next_size;
                self.move_by(1.0);
                if CONTRACTION_SAFETY * contraction * size <= max_error {
                    return Ok(());
                }
                next_size = self.next_step(model, &sizes);
            }
        }
        Err(self.not_converged())
    }

    /// Computes the next Newton step from the current states with the current factors of the Jacobian, and returns the
    /// size of the step relative to the magnitudes `sizes` of the states.
    fn next_step(&mut self, model: &R, sizes: &[f64; N]) -> f64 {
        self.evaluate(model);
        std::mem::swap(&mut self.step, &mut self.last_step);
        self.solve_step();
        let size = self.step_size(sizes);
        if size.is_finite() { size } else { f64::INFINITY }
    }

    /// Adds a multiple of `step` to the states; the previous states are left in `before`.
    pub(super) fn move_by(&mut self, factor: f64) {
        self.steps += 1;
        self.effort.newton_steps += 1;
        std::mem::swap(&mut self.before, &mut self.mesh.states);
        self.mesh.states.set_moved(&self.before, factor, &self.step);
    }

    /// Returns, for each state variable, its largest magnitude over the orbit, both before and after the current Newton
    /// step.
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

    /// Returns the size of the current Newton step: the largest ratio, over the state variables, of the change in a
    /// variable to its magnitude in `sizes`; infinite if the step is not finite.
    pub(super) fn step_size(&self, sizes: &[f64; N]) -> f64 {
        let mut steps = [Lanes::default(); N];
        let mut all = Lanes::default();
        for step in self.step.packs.iter().flatten() {
            keep_largest(&mut steps, step);
            step.iter().for_each(|step| all += *step);
        }
        let is_finite = (0..LANES).all(|lane| all.lane(lane).is_finite());
        if is_finite { largest_ratio(&steps.map(largest_lane), sizes) } else { f64::INFINITY }
    }

    /// Returns the modulus of the largest Floquet multiplier over a whole period, from a fresh linearisation.
    pub(crate) fn floquet(&mut self, model: &R) -> Result<f64> {
        if let Some(floquet) = self.floquet {
            return Ok(floquet);
        }
        self.linearise(model)?;
        let values = self.multipliers()?;
        let largest = values.iter().map(|value| value.norm()).fold(0.0, f64::max);
        Ok(*self.floquet.insert(if self.mesh.is_half { largest * largest } else { largest }))
    }

    /// Returns the Floquet multipliers over the time span of the mesh (one or more periods, or half of one), according
    /// to the last linearisation, followed by zeros.
    pub(crate) fn multipliers(&self) -> Result<[Complex<f64>; MAX_STATES]> {
        const MAX_SWEEPS: usize = 1000;
        let monodromy = self.monodromy();
        if monodromy.iter().any(|entry| !entry.is_finite()) {
            return Err(self.not_converged());
        }
        let mut values = [Complex::default(); MAX_STATES];
        let failed = || self.not_converged();
        if N <= 5 {
            let schur =
                padded(&monodromy).try_schur(f64::EPSILON, MAX_SWEEPS).ok_or_else(failed)?;
            values[..5].copy_from_slice(schur.complex_eigenvalues().as_slice());
        } else {
            let schur =
                dynamic(&monodromy).try_schur(f64::EPSILON, MAX_SWEEPS).ok_or_else(failed)?;
            values[..N].copy_from_slice(schur.complex_eigenvalues().as_slice());
        }
        Ok(values)
    }

    /// Returns whether, according to the last linearisation, a motion with half-period symmetry is unstable to the loss
    /// of that symmetry: whether a Floquet multiplier over the half period is below -1.
    pub(crate) fn breaks_symmetry(&self) -> bool {
        let determinant = || {
            let monodromy = self.monodromy();
            if N <= 5 {
                (Matrix5::identity() + padded(&monodromy)).determinant()
            } else {
                (DMatrix::identity(N, N) + dynamic(&monodromy)).determinant()
            }
        };
        self.mesh.is_half && determinant() < 0.0
    }

    /// Returns whether the last solution is known to be stable: whether the modulus of its largest Floquet multiplier
    /// could be computed and is below 1.
    pub(crate) fn is_stable(&mut self, model: &R) -> bool {
        self.floquet(model).is_ok_and(|modulus| modulus < 1.0)
    }

    /// Takes one Newton step from the last solution and returns the size of the step relative to the states.
    pub(crate) fn polish(&mut self, model: &R) -> Result<f64> {
        self.linearise(model)?;
        self.solve_step();
        let size = self.step_size(&self.sizes());
        self.move_by(1.0);
        self.path.follow(model, &self.mesh);
        self.cycle = None;
        self.floquet = None;
        Ok(size)
    }
}

/// Returns the matrix padded with zeros to 5 x 5, the size for the three-link robot. The padding adds only zero
/// eigenvalues.
fn padded<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Matrix5<f64> {
    Matrix5::from_fn(|i, j| if i < N && j < N { matrix[(i, j)] } else { 0.0 })
}

/// Returns the matrix with dimensions that are known only at run time.
pub(super) fn dynamic<const N: usize>(matrix: &SMatrix<f64, N, N>) -> DMatrix<f64> {
    DMatrix::from_fn(N, N, |i, j| matrix[(i, j)])
}

/// Returns the product of a matrix and a vector.
#[inline(always)]
pub(super) fn product<const N: usize>(matrix: &[[f64; N]; N], x: &[f64; N]) -> [f64; N] {
    let mut product = [0.0; N];
    for i in 0..N {
        (0..N).for_each(|m| product[i] += matrix[i][m] * x[m]);
    }
    product
}

/// Returns the sum of two vectors.
#[inline(always)]
pub(super) fn sum<const N: usize>(a: &[f64; N], b: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|i| a[i] + b[i])
}

/// Updates the largest magnitudes seen so far with those of `values`.
#[inline(always)]
pub(super) fn keep_largest<const K: usize>(largest: &mut [Lanes; K], values: &[Lanes; K]) {
    for (largest, value) in largest.iter_mut().zip(values) {
        *largest = largest.fast_max(value.abs());
    }
}

/// Returns the maximum over the lanes, whose values must be nonnegative.
pub(crate) fn largest_lane(lanes: Lanes) -> f64 {
    lanes.to_array().into_iter().fold(0.0, f64::max)
}

/// Returns the largest of the ratios `errors[i] / sizes[i]`. A size that is negligible relative to the largest one,
/// such as that of the lateral motion of a robot that moves straight, is replaced by a small fraction of the largest
/// size.
pub(super) fn largest_ratio<const N: usize>(errors: &[f64; N], sizes: &[f64; N]) -> f64 {
    const RELATIVE_FLOOR: f64 = 1e-9;
    let floor = RELATIVE_FLOOR * sizes.iter().fold(0.0_f64, |largest, size| largest.max(*size));
    let mut largest = 0.0;
    for i in (0..N).filter(|&i| errors[i] != 0.0) {
        let ratio = errors[i] / sizes[i].max(floor);
        if ratio.is_nan() {
            return f64::INFINITY;
        }
        largest = f64::max(largest, ratio);
    }
    largest
}
