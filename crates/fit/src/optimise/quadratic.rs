//! Primal-dual interior-point solver for small convex quadratic programs with box constraints and penalised (elastic)
//! linear limits.
//!
//! Published solvers are designed for large sparse programs; their setup takes longer than solving the model once.
//!
//! Reference: J. Nocedal and S. J. Wright, *Numerical Optimization*, 2nd ed., Springer 2006, section 16.6.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::landscape::Position;

/// Matrix with as many rows and columns as a [`Position`].
pub(super) type Hessian = DMatrix<f64>;

const MAX_ITERATIONS: usize = 60;
/// Duality measure (mean product of slack and multiplier) below which the solver has converged.
const MAX_COMPLEMENTARITY: f64 = 1e-15;
/// Maximum component of the dual residual at the solution.
const MAX_RESIDUAL: f64 = 1e-12;
/// Centring parameter: target for the duality measure as a fraction of its current value.
const CENTRING: f64 = 0.05;
/// Maximum step length as a fraction of the length at which the first slack or multiplier becomes zero.
const MAX_FRACTION_TO_BOUNDARY: f64 = 0.995;

/// Minimisation of `gradient' x + x' hessian x / 2 + penalty sum(max(0, excess + slopes' x))` over `x` in a box.
pub(super) struct QuadraticProgram<'p> {
    /// Number of variables; the remaining entries of the solution are zero.
    pub count: usize,
    pub gradient: &'p Position,
    /// Hessian of the quadratic term; must be positive definite.
    pub hessian: &'p Hessian,
    /// Lower ends of the box, which must be less than the upper ends.
    pub low: Position,
    /// Upper ends of the box.
    pub high: Position,
    /// Excess over each limit at x = 0, see [`Evaluation`](super::landscape::Evaluation).
    pub excess: &'p [f64],
    /// Gradient of the excess over each limit.
    pub slopes: &'p [Position],
    pub penalty: f64,
}

/// Nonnegative slack variable and its nonnegative multiplier; their product is zero at the solution.
#[derive(Debug, Clone, Copy)]
struct Slack {
    value: f64,
    multiplier: f64,
}

impl Slack {
    /// Returns the change in the multiplier that brings the linearised product of value and multiplier to `target`,
    /// given the change in the value.
    fn multiplier_change(self, target: f64, value_change: f64) -> f64 {
        (target - self.multiplier * value_change) / self.value - self.multiplier
    }

    /// Takes a step of the given length along the direction `[value, multiplier]`.
    fn advance(&mut self, length: f64, [value, multiplier]: [f64; 2]) {
        self.value += length * value;
        self.multiplier += length * multiplier;
    }

    /// Returns the step length along the direction `[value, multiplier]` at which either becomes zero.
    fn length_to_boundary(self, [value, multiplier]: [f64; 2]) -> f64 {
        let to_zero = |from: f64, by: f64| if by < 0.0 { -from / by } else { f64::INFINITY };
        to_zero(self.value, value).min(to_zero(self.multiplier, multiplier))
    }
}

/// Limit with slack variables for its margin and its excess, whose multipliers sum to the penalty.
struct Limit {
    index: usize,
    slope: DVector<f64>,
    margin: Slack,
    excess: Slack,
}

impl Limit {
    /// Returns the change in the margin's multiplier for a zero step, and the derivative of this change with respect to
    /// the change in the linearised excess over the limit.
    fn multiplier_response(&self, target: f64) -> [f64; 2] {
        let Self { margin, excess, .. } = self;
        let compliance = excess.value / excess.multiplier + margin.value / margin.multiplier;
        let constant = (target / margin.multiplier - margin.value)
            - (target / excess.multiplier - excess.value);
        [constant / compliance, 1.0 / compliance]
    }

    /// Returns the changes in value and multiplier of the margin and of the excess for a given step.
    fn changes(&self, target: f64, step: &DVector<f64>) -> [[f64; 2]; 2] {
        let [constant, stiffness] = self.multiplier_response(target);
        let slope = self.slope.dot(step);
        let multiplier = constant + stiffness * slope;
        let excess = self.excess;
        let excess = (target + excess.value * multiplier) / excess.multiplier - excess.value;
        [[excess - slope, multiplier], [excess, -multiplier]]
    }
}

/// Returns the changes in value and multiplier of the slacks at the lower and the upper end of a variable's range, for
/// a given step of the variable.
fn end_changes([low, high]: [Slack; 2], target: f64, step: f64) -> [[f64; 2]; 2] {
    [[step, low.multiplier_change(target, step)], [-step, high.multiplier_change(target, -step)]]
}

impl QuadraticProgram<'_> {
    /// Returns the minimiser and the multipliers of the limits.
    pub(super) fn solve(&self) -> (Position, Vec<f64>) {
        let Self { count, excess, slopes, penalty, .. } = *self;
        let of_count = |of: &Position| -> DVector<f64> { of.rows(0, count).into_owned() };
        let [gradient, low, high] = [self.gradient, &self.low, &self.high].map(of_count);
        let hessian: DMatrix<f64> = self.hessian.view((0, 0), (count, count)).into_owned();
        let mut x = 0.5 * (&low + &high);
        let mut ends: Vec<[Slack; 2]> = (0..count)
            .map(|i| [x[i] - low[i], high[i] - x[i]].map(|value| Slack { value, multiplier: 1.0 }))
            .collect();
        let mut limits: Vec<Limit> = (0..excess.len())
            .filter(|index| excess[*index].is_finite())
            .map(|index| {
                let slope = of_count(&slopes[index]);
                let now = excess[index] + slope.dot(&x);
                let over = now.max(0.0) + 1.0;
                let [margin, excess] =
                    [over - now, over].map(|value| Slack { value, multiplier: 0.5 * penalty });
                Limit { index, slope, margin, excess }
            })
            .collect();
        for _ in 0..MAX_ITERATIONS {
            let mut residual = &gradient + &hessian * &x;
            let mut matrix = hessian.clone();
            let slacks = ends.iter().flatten().copied();
            let slacks = slacks.chain(limits.iter().flat_map(|of| [of.margin, of.excess]));
            let pairs = 2 * (count + limits.len());
            let product = slacks.map(|of| of.value * of.multiplier).sum::<f64>() / pairs as f64;
            for (i, [low, high]) in ends.iter().enumerate() {
                residual[i] += high.multiplier - low.multiplier;
            }
            for limit in &limits {
                residual.axpy(limit.margin.multiplier, &limit.slope, 1.0);
            }
            if product < MAX_COMPLEMENTARITY && residual.amax() < MAX_RESIDUAL {
                break;
            }
            let target = CENTRING * product;
            let mut right = -residual;
            for (i, [low, high]) in ends.iter().enumerate() {
                matrix[(i, i)] += low.multiplier / low.value + high.multiplier / high.value;
                right[i] +=
                    low.multiplier_change(target, 0.0) - high.multiplier_change(target, 0.0);
            }
            for limit in &limits {
                let [constant, stiffness] = limit.multiplier_response(target);
                matrix.ger(stiffness, &limit.slope, &limit.slope, 1.0);
                right.axpy(-constant, &limit.slope, 1.0);
            }
            let Some(factors) = Cholesky::new(matrix) else { break };
            let step = factors.solve(&right);
            let mut length = f64::INFINITY;
            for (i, slacks) in ends.iter().enumerate() {
                let changes = end_changes(*slacks, target, step[i]);
                for (slack, change) in slacks.iter().zip(changes) {
                    length = length.min(slack.length_to_boundary(change));
                }
            }
            for limit in &limits {
                let [margin, excess] = limit.changes(target, &step);
                length = length
                    .min(limit.margin.length_to_boundary(margin))
                    .min(limit.excess.length_to_boundary(excess));
            }
            let length = (MAX_FRACTION_TO_BOUNDARY * length).min(1.0);
            for limit in &mut limits {
                let [margin, excess] = limit.changes(target, &step);
                limit.margin.advance(length, margin);
                limit.excess.advance(length, excess);
            }
            for (i, slacks) in ends.iter_mut().enumerate() {
                let changes = end_changes(*slacks, target, step[i]);
                slacks.iter_mut().zip(changes).for_each(|(slack, by)| slack.advance(length, by));
            }
            x.axpy(length, &step, 1.0);
        }
        // A multiplier that exceeds its slack identifies an active bound; the solution is moved exactly onto it.
        for (i, [at_low, at_high]) in ends.iter().enumerate() {
            if at_low.value < at_low.multiplier {
                x[i] = low[i];
            } else if at_high.value < at_high.multiplier {
                x[i] = high[i];
            }
        }
        let mut multipliers = vec![0.0; excess.len()];
        limits.iter().for_each(|limit| multipliers[limit.index] = limit.margin.multiplier);
        let mut solution = Position::zeros(self.gradient.len());
        solution.rows_mut(0, count).copy_from(&x);
        (solution, multipliers)
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const COUNT: usize = 3;
    /// Length of a position; the entries after the first [`COUNT`] are zero.
    const LENGTH: usize = 5;
    const LIMITS: usize = 7;
    const NONE: [f64; LIMITS] = [f64::NEG_INFINITY; LIMITS];

    /// Returns the value of a program's objective at `x`.
    fn value(program: &QuadraticProgram, x: &Position) -> f64 {
        let limits = program.excess.iter().zip(program.slopes);
        let over: f64 = limits.map(|(excess, slope)| (excess + slope.dot(x)).max(0.0)).sum();
        program.gradient.dot(x) + 0.5 * x.dot(&(program.hessian * x)) + program.penalty * over
    }

    #[test]
    fn the_solution_is_the_nearest_point_on_a_limit_and_at_an_end_of_the_box() {
        // Point nearest to (2, 1, 0.3) that satisfies x + y <= 1 and x <= 0.4.
        let gradient = -Position::from_vec(vec![2.0, 1.0, 0.3, 0.0, 0.0]);
        let mut slopes = vec![Position::zeros(LENGTH); LIMITS];
        slopes[4][0] = 1.0;
        slopes[4][1] = 1.0;
        let mut excess = NONE;
        excess[4] = -1.0;
        let mut high = Position::repeat(LENGTH, 1.0);
        high[0] = 0.4;
        let program = QuadraticProgram {
            count: COUNT,
            gradient: &gradient,
            hessian: &Hessian::identity(LENGTH, LENGTH),
            low: Position::repeat(LENGTH, -1.0),
            high,
            excess: &excess,
            slopes: &slopes,
            penalty: 10.0,
        };
        let (x, multipliers) = program.solve();
        for (found, known) in x.iter().zip([0.4, 0.6, 0.3]) {
            assert!((found - known).abs() < 1e-9, "{x:?}");
        }
        assert_eq!(x[0], 0.4);
        // The multiplier is the decrease in the objective per unit relaxation of the limit.
        assert!((multipliers[4] - 0.4).abs() < 1e-7, "{multipliers:?}");
        // With a penalty below the multiplier the limit is exceeded.
        let (x, multipliers) = QuadraticProgram { penalty: 0.1, ..program }.solve();
        assert!((x[1] - 0.9).abs() < 1e-7 && (multipliers[4] - 0.1).abs() < 1e-7, "{x:?}");
    }

    #[test]
    fn no_neighbour_of_the_solution_is_better() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        for _ in 0..200 {
            let mut any = |scale: f64| {
                Position::from_fn(LENGTH, |i, _| {
                    if i < COUNT { scale * random.random_range(-1.0..1.0) } else { 0.0 }
                })
            };
            let mut hessian = Hessian::identity(LENGTH, LENGTH) * 0.01;
            (0..COUNT).for_each(|_| {
                let row = any(3.0);
                hessian += &row * row.transpose();
            });
            let gradient = any(2.0);
            let mut slopes = vec![Position::zeros(LENGTH); LIMITS];
            let mut excess = NONE;
            for limit in 0..6 {
                slopes[limit] = any(2.0);
                excess[limit] = any(1.0)[0];
            }
            let program = QuadraticProgram {
                count: COUNT,
                gradient: &gradient,
                hessian: &hessian,
                low: any(0.4).map(|of| of - 0.5),
                high: any(0.4).map(|of| of + 0.5),
                excess: &excess,
                slopes: &slopes,
                penalty: 5.0,
            };
            let (x, _) = program.solve();
            let best = value(&program, &x);
            for size in [1e-6, 1e-3, 0.1] {
                for _ in 0..40 {
                    let there = (&x + any(size)).zip_zip_map(
                        &program.low,
                        &program.high,
                        |x, low, high| x.clamp(low, high),
                    );
                    let other = value(&program, &there);
                    assert!(other > best - 1e-11, "{best} {other} {x:?} {there:?}");
                }
            }
        }
    }
}
