//! Constraints of wheels that cannot skid.
//!
//! The constraint of each wheel is a row of `W w = -b` for the velocities `w` (of the reference link and the free
//! joints), where `b` is the skid velocity due to the commanded motion. Constant rows `E`, which span the null space of
//! `W` at the mean shape, complete it to a square matrix `A`. The columns of `A^-1` that belong to `E` are the
//! directions in which the chain can move: the equations of motion contain no constraint forces after projection on
//! them, and with the constraints they determine the velocities.

use nalgebra::DMatrix;
use trilink_robot::Number;

use super::balance::{Balance, Node, Posture, System, WheelState};
use super::cluster::Clusters;
use super::plane::{inner, normal, scaled, sum};
use crate::chain::ChainProblem;
use crate::reduced::Residual;
use crate::{MotionError, Result};

/// Constraints of the wheels of a chain with `D` velocities.
#[derive(Debug, Clone)]
pub(super) struct Constraints<const D: usize> {
    /// Number of wheels.
    count: usize,
    /// Rows `E`.
    speeds: Vec<[f64; D]>,
    /// For each row of the residual, the index of its equation: first those of motion, then the constraints. In this
    /// order, pivots of the linear system are large.
    order: Vec<usize>,
}

/// Row of the residual.
pub(super) enum Equation {
    /// Equation of motion along the direction with the given index.
    Motion(usize),
    /// Constraint of the wheel with the given index.
    Constraint(usize),
}

/// Square matrix as the product of a unit lower triangular matrix and one whose rows are orthogonal.
struct RowOrthogonal<T, const N: usize> {
    lower: [[T; N]; N],
    rows: [[T; N]; N],
    /// Reciprocals of the squared lengths of the rows.
    per_square: [T; N],
}

impl<T: Number, const N: usize> RowOrthogonal<T, N> {
    /// Factors a matrix by the modified Gram-Schmidt method.
    #[inline(always)]
    fn new(mut rows: [[T; N]; N]) -> Self {
        let zero = T::splat(0.0);
        let mut lower = [[zero; N]; N];
        let mut per_square = [zero; N];
        for i in 0..N {
            for j in 0..i {
                let share = product(&rows[i], &rows[j]) * per_square[j];
                lower[i][j] = share;
                (0..N).for_each(|k| rows[i][k] -= share * rows[j][k]);
            }
            per_square[i] = T::splat(1.0) / product(&rows[i], &rows[i]);
        }
        Self { lower, rows, per_square }
    }

    #[inline(always)]
    fn solve(&self, mut right: [T; N]) -> [T; N] {
        let mut solution = [T::splat(0.0); N];
        for i in 0..N {
            (0..i).for_each(|j| right[i] -= self.lower[i][j] * right[j]);
            let share = right[i] * self.per_square[i];
            (0..N).for_each(|k| solution[k] += share * self.rows[i][k]);
        }
        solution
    }

    #[inline(always)]
    fn solve_transposed(&self, right: &[T; N]) -> [T; N] {
        let mut solution: [T; N] =
            std::array::from_fn(|i| product(&self.rows[i], right) * self.per_square[i]);
        for i in (0..N).rev() {
            let known = solution[i];
            (0..i).for_each(|j| solution[j] -= self.lower[i][j] * known);
        }
        solution
    }
}

#[inline(always)]
pub(super) fn product<T: Number, const N: usize>(a: &[T; N], b: &[T; N]) -> T {
    (0..N).fold(T::splat(0.0), |sum, i| sum + a[i] * b[i])
}

impl<const D: usize> Constraints<D> {
    /// Chooses the rows `E` at the mean shape, in which all commands are at their means. If the chain is straight
    /// there, the first row is the velocity along it. Far from this shape `A` can be singular although `W` is not.
    ///
    /// # Errors
    /// Returns an error if the constraints depend on each other in the mean shape.
    pub(super) fn new<const C: usize>(problem: &ChainProblem) -> Result<Self> {
        const DEPENDENT: f64 = 1e-9;
        const STRAIGHT: f64 = 1e-12;
        let mean = problem.chain.at_mean_shape();
        let length_m = mean.skid_length_m;
        let system: System = System::new(Clusters::new(&mean, problem.omega_rad_s, false));
        let node: Node<f64, C> = system.node(0.0);
        let phi_rad = std::array::from_fn(|c| match c {
            0 => 0.0,
            _ => mean.rest_angle_rad(system.clusters.all[c].joint),
        });
        let posture = system.posture(&node.clusters, [0.0; 3], phi_rad, [0.0; C]);
        let count = system.wheels.len();
        let mut matrix = DMatrix::<f64>::zeros(D + count + 1, D);
        for (i, (cluster, ..)) in system.wheels.iter().enumerate() {
            let wheel = system.wheel(&posture, &node.wheels[i], *cluster);
            let row: [f64; D] = system.skid_row(&posture, &wheel, *cluster);
            for (k, entry) in row.into_iter().enumerate() {
                matrix[(i, k)] = if k < 2 { entry } else { entry / length_m };
            }
        }
        let constraints = matrix.rows(0, count).into_owned();
        if count > 0 {
            let sizes = constraints.singular_values();
            if sizes.min() <= DEPENDENT * sizes.max() {
                return Err(MotionError::Dependent);
            }
        }
        let mut speeds = Vec::new();
        if count < D && (0..count).all(|i| matrix[(i, 0)].abs() < STRAIGHT) {
            matrix[(count, 0)] = 1.0;
            speeds.push(std::array::from_fn(|k| if k == 0 { 1.0 } else { 0.0 }));
        }
        let decomposed = matrix.svd(false, true);
        let values = &decomposed.singular_values;
        let mut by_size: Vec<usize> = (0..D).collect();
        by_size.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
        let wanted = D - count - speeds.len();
        if let Some(directions) = &decomposed.v_t {
            speeds.extend(by_size.into_iter().take(wanted).map(|k| -> [f64; D] {
                // Ahead, as if the chain were straight.
                let sign = if directions[(k, 0)] < 0.0 { -1.0 } else { 1.0 };
                std::array::from_fn(|i| sign * directions[(k, i)])
            }));
        }
        let all = DMatrix::from_fn(D, D, |i, j| match speeds.get(i) {
            Some(speed) => speed[j],
            None => constraints[(i - speeds.len(), j)],
        });
        let order = pivot_order(all);
        for speed in &mut speeds {
            speed[2..].iter_mut().for_each(|entry| *entry *= length_m);
        }
        Ok(Self { count, speeds, order })
    }

    /// Returns the wheels, of which there are at most `D`, along the axes of the reference link, and the rows of `A`.
    #[inline(always)]
    fn matrix<T: Number, const C: usize>(
        &self,
        system: &System,
        node: &Node<T, C>,
        posture: &Posture<T, C>,
    ) -> ([WheelState<T>; D], [[T; D]; D]) {
        let zero = T::splat(0.0);
        let none =
            WheelState { direction: [zero; 2], place: [zero; 2], roll_m_s: zero, skid_m_s: zero };
        let mut wheels = [none; D];
        let mut rows = [[zero; D]; D];
        for (i, (cluster, ..)) in system.wheels.iter().enumerate() {
            wheels[i] = system.wheel(posture, &node.wheels[i], *cluster);
            rows[i] = system.skid_row(posture, &wheels[i], *cluster);
        }
        for (row, speed) in rows[self.count..].iter_mut().zip(&self.speeds) {
            *row = speed.map(T::splat);
        }
        (wheels, rows)
    }

    /// Returns the velocities for which `W w = -b` and `E w` is the same as for the given velocities; the posture is that
    /// at rest.
    pub(super) fn consistent<const C: usize>(
        &self,
        system: &System,
        node: &Node<f64, C>,
        at_rest: &Posture<f64, C>,
        velocities: &[f64; D],
    ) -> [f64; D] {
        let (wheels, rows) = self.matrix(system, node, at_rest);
        let right = std::array::from_fn(|i| match i.checked_sub(self.count) {
            None => -wheels[i].skid_m_s,
            Some(_) => product(&rows[i], velocities),
        });
        RowOrthogonal::new(rows).solve(right)
    }

    /// Returns the row of the residual that is the first equation of motion; `None` if there is none.
    pub(super) fn row_of_motion(&self) -> Option<usize> {
        let equations = (!self.speeds.is_empty()).then_some(&self.order)?;
        equations.iter().position(|equation| *equation == 0)
    }

    /// Returns the directions in which the chain can move and the constraint forces on the wheels, N; the latter are
    /// followed by the other components of the balance.
    #[inline(always)]
    pub(super) fn directions<T: Number, const C: usize>(
        &self,
        system: &System,
        node: &Node<T, C>,
        posture: &Posture<T, C>,
        force: &[T; D],
    ) -> ([[T; D]; D], [T; D]) {
        let (_, rows) = self.matrix(system, node, posture);
        let matrix = RowOrthogonal::new(rows);
        let mut null = [[T::splat(0.0); D]; D];
        for (i, null) in null.iter_mut().enumerate().take(self.speeds.len()) {
            let unit = |k: usize| T::splat(if k == self.count + i { 1.0 } else { 0.0 });
            *null = matrix.solve(std::array::from_fn(unit));
        }
        (null, matrix.solve_transposed(force))
    }

    /// Returns the equation of a row of the residual: the index of a direction in which the chain can move, or that of a
    /// constraint.
    pub(super) fn equation(&self, row: usize) -> Equation {
        let equation = self.order[row];
        match equation.checked_sub(self.speeds.len()) {
            Some(wheel) => Equation::Constraint(wheel),
            None => Equation::Motion(equation),
        }
    }

    /// Replaces the first `D` rows of a residual, and of its derivatives if `SLOPES`, by the equations of motion along the
    /// null space, and the constraints.
    #[inline(always)]
    pub(super) fn apply<T: Number, const N: usize, const C: usize, const SLOPES: bool>(
        &self,
        system: &System,
        node: &Node<T, C>,
        posture: &Posture<T, C>,
        balance: &Balance<T, C, D>,
        residual: &mut Residual<N, T>,
    ) {
        let zero = T::splat(0.0);
        let one = T::splat(1.0);
        let (wheels, rows) = self.matrix(system, node, posture);
        let matrix = RowOrthogonal::new(rows);
        // Constraint forces, then the forces along the null space.
        let supplied = matrix.solve_transposed(&balance.force);
        for (row, &equation) in self.order.iter().enumerate() {
            let slopes = &mut residual.state_jacobian[row];
            let rate_slopes = &mut residual.rate_jacobian[row];
            if let Some(i) = equation.checked_sub(self.speeds.len()) {
                let (cluster, ..) = system.wheels[i];
                residual.value[row] = wheels[i].skid_m_s;
                if !SLOPES {
                    continue;
                }
                slopes[..D].copy_from_slice(&rows[i]);
                rate_slopes[..D].fill(zero);
                for b in 1..C {
                    slopes[D + b - 1] = if system.is_beyond(b, cluster) {
                        turned(system, b, wheels[i].direction, posture.velocity[b])
                    } else {
                        zero
                    };
                }
                continue;
            }
            residual.value[row] = supplied[self.count + equation];
            if !SLOPES {
                continue;
            }
            let unit = std::array::from_fn(|i| if i == self.count + equation { one } else { zero });
            let null = matrix.solve(unit);
            for j in 0..D {
                let sums =
                    |matrix: &[[T; D]; D]| (0..D).fold(zero, |sum, i| sum + null[i] * matrix[i][j]);
                slopes[j] = sums(&balance.dforce_dvelocity);
                rate_slopes[j] = sums(&balance.mass);
            }
            // The null space turns with the wheels.
            let origins = origins(system, posture, &null);
            for b in 1..C {
                let mut sum = product(&null, &balance.dforce_dphi[b]);
                for (i, (cluster, ..)) in system.wheels.iter().enumerate() {
                    if system.is_beyond(b, *cluster) {
                        let turned = turned(system, b, wheels[i].direction, origins[b]);
                        sum -= supplied[i] * turned;
                    }
                }
                slopes[D + b - 1] = sum;
            }
        }
    }
}

/// Returns the derivative of a wheel's skid velocity with respect to the angle of the free joint of cluster `b`, on
/// which it hangs, given the wheel's rolling direction and the velocity of that joint.
#[inline(always)]
pub(super) fn turned<T: Number>(
    system: &System,
    b: usize,
    direction: [T; 2],
    velocity: [T; 2],
) -> T {
    -(T::splat(system.clusters.all[b].sign) * inner(direction, velocity))
}

/// Returns the velocities of the clusters' origins for given velocities of the reference link and of the free joints,
/// without the commanded motion.
#[inline(always)]
fn origins<T: Number, const C: usize, const D: usize>(
    system: &System,
    posture: &Posture<T, C>,
    velocity: &[T; D],
) -> [[T; 2]; C] {
    let mut origins = [[velocity[0], velocity[1]]; C];
    let mut rates = [velocity[2]; C];
    for c in 1..C {
        let p = system.parent(c);
        rates[c] = rates[p] + T::splat(system.clusters.all[c].sign) * velocity[2 + c];
        origins[c] = sum(origins[p], scaled(rates[p], normal(posture.place[c].at)));
    }
    origins
}

/// Returns the order of the rows of a matrix in which elimination with partial pivoting takes them.
fn pivot_order(mut matrix: DMatrix<f64>) -> Vec<usize> {
    let count = matrix.nrows();
    let mut order: Vec<usize> = (0..count).collect();
    for k in 0..count {
        let size = |row: &usize| matrix[(*row, k)].abs();
        let best = (k..count).max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or(k);
        matrix.swap_rows(k, best);
        order.swap(k, best);
        for i in k + 1..count {
            let factor = matrix[(i, k)] / matrix[(k, k)];
            if factor.is_finite() {
                (k..count).for_each(|j| matrix[(i, j)] -= factor * matrix[(k, j)]);
            }
        }
    }
    order
}
