//! Convex quadratic programs of a few variables within a box, with limits that may be exceeded at a price: by the
//! primal-dual interior-point method.
//!
//! Kept solvers of quadratic programs are made for large sparse ones, and take longer to be set up than a motion to be
//! solved for.
//!
//! Reference: J. Nocedal and S. J. Wright, *Numerical Optimization*, 2nd ed., Springer 2006, section 16.6.

use nalgebra::{Cholesky, DMatrix, DVector, SMatrix};

use super::commands::MOST_COMMANDS;
use super::landscape::{LIMITS, Place};

pub(super) type Curvature = SMatrix<f64, MOST_COMMANDS, MOST_COMMANDS>;

const MOST_ITERATIONS: usize = 60;
/// Mean product of what is kept of a limit and its multiplier that is nothing; slope that is nothing.
const NO_PRODUCT: f64 = 1e-15;
const NO_SLOPE: f64 = 1e-12;
/// Part of that product that the next iterate aims at, and of the way to the nearest end that it goes at most.
const CENTRED: f64 = 0.05;
const MOST_OF_THE_WAY: f64 = 0.995;

/// `gradient x + x' curvature x / 2 + price sum(max(0, excess + slopes x))` within a box, to be small.
pub(super) struct QuadraticProgram<'p> {
    /// Variables; the others stay zero.
    pub count: usize,
    pub gradient: &'p Place,
    /// Positive definite.
    pub curvature: &'p Curvature,
    /// Ends of the box, the lower ones below the upper.
    pub low: Place,
    pub high: Place,
    /// Of the limits, see [`Point`](super::landscape::Point).
    pub excess: &'p [f64; LIMITS],
    pub slopes: &'p [Place; LIMITS],
    pub price: f64,
}

/// What must not be negative and its multiplier, which must not be either; their product vanishes in the end.
#[derive(Debug, Clone, Copy)]
struct Slack {
    value: f64,
    multiplier: f64,
}

impl Slack {
    /// How the multiplier changes with the value, so that their product becomes this.
    fn change(self, product: f64, by_value: f64) -> f64 {
        (product - self.multiplier * by_value) / self.value - self.multiplier
    }

    /// Goes a part of the way.
    fn advance(&mut self, part: f64, [value, multiplier]: [f64; 2]) {
        self.value += part * value;
        self.multiplier += part * multiplier;
    }

    /// Part of the way on which nothing becomes negative.
    fn reach(self, [value, multiplier]: [f64; 2]) -> f64 {
        let to_zero = |from: f64, by: f64| if by < 0.0 { -from / by } else { f64::INFINITY };
        to_zero(self.value, value).min(to_zero(self.multiplier, multiplier))
    }
}

/// A limit: what is left of it, and by how much it is exceeded. The multipliers of both sum to the price.
struct Limit {
    number: usize,
    slope: DVector<f64>,
    left: Slack,
    over: Slack,
}

impl QuadraticProgram<'_> {
    /// The solution and the multipliers of the limits.
    pub(super) fn solve(&self) -> (Place, [f64; LIMITS]) {
        let Self { count, excess, slopes, price, .. } = *self;
        let of_count = |of: &Place| -> DVector<f64> { of.rows(0, count).into_owned() };
        let [gradient, low, high] = [self.gradient, &self.low, &self.high].map(of_count);
        let curvature: DMatrix<f64> = self.curvature.view((0, 0), (count, count)).into_owned();
        let mut x = 0.5 * (&low + &high);
        // Below and above.
        let of_ends = |i: usize| {
            [x[i] - low[i], high[i] - x[i]].map(|value| Slack { value, multiplier: 1.0 })
        };
        let mut ends: Vec<[Slack; 2]> = (0..count).map(of_ends).collect();
        let in_play = (0..LIMITS).filter(|number| excess[*number].is_finite());
        let mut limits: Vec<Limit> = in_play
            .map(|number| {
                let slope = of_count(&slopes[number]);
                let now = excess[number] + slope.dot(&x);
                let over = now.max(0.0) + 1.0;
                let slack = |value: f64| Slack { value, multiplier: 0.5 * price };
                Limit { number, slope, left: slack(over - now), over: slack(over) }
            })
            .collect();
        for _ in 0..MOST_ITERATIONS {
            let mut residual = &gradient + &curvature * &x;
            let mut matrix = curvature.clone();
            let slacks = ends.iter().flatten().copied();
            let slacks = slacks.chain(limits.iter().flat_map(|of| [of.left, of.over]));
            let pairs = 2 * (count + limits.len());
            let product = slacks.map(|of| of.value * of.multiplier).sum::<f64>() / pairs as f64;
            for (i, [below, above]) in ends.iter().enumerate() {
                residual[i] += above.multiplier - below.multiplier;
            }
            for limit in &limits {
                residual.axpy(limit.left.multiplier, &limit.slope, 1.0);
            }
            if product < NO_PRODUCT && residual.amax() < NO_SLOPE {
                break;
            }
            let aim = CENTRED * product;
            let mut right = -residual;
            for (i, [below, above]) in ends.iter().enumerate() {
                matrix[(i, i)] += below.multiplier / below.value + above.multiplier / above.value;
                right[i] += below.change(aim, 0.0) - above.change(aim, 0.0);
            }
            // How the multiplier of a limit changes where the solution stays, and by how much less with it.
            let parts = |Limit { left, over, .. }: &Limit| {
                let softness = over.value / over.multiplier + left.value / left.multiplier;
                let there =
                    (aim / left.multiplier - left.value) - (aim / over.multiplier - over.value);
                [there / softness, 1.0 / softness]
            };
            for limit in &limits {
                let [there, stiffness] = parts(limit);
                matrix.ger(stiffness, &limit.slope, &limit.slope, 1.0);
                right.axpy(-there, &limit.slope, 1.0);
            }
            let Some(factors) = Cholesky::new(matrix) else { break };
            let step = factors.solve(&right);
            let end_changes = |i: usize, [below, above]: &[Slack; 2]| {
                [[step[i], below.change(aim, step[i])], [-step[i], above.change(aim, -step[i])]]
            };
            let limit_changes = |limit: &Limit| {
                let [there, stiffness] = parts(limit);
                let slope = limit.slope.dot(&step);
                let multiplier = there + stiffness * slope;
                let Limit { over, .. } = limit;
                let over = (aim + over.value * multiplier) / over.multiplier - over.value;
                [[over - slope, multiplier], [over, -multiplier]]
            };
            let mut part = f64::INFINITY;
            for (i, of) in ends.iter().enumerate() {
                let [below, above] = end_changes(i, of);
                part = part.min(of[0].reach(below)).min(of[1].reach(above));
            }
            for limit in &limits {
                let [left, over] = limit_changes(limit);
                part = part.min(limit.left.reach(left)).min(limit.over.reach(over));
            }
            let part = (MOST_OF_THE_WAY * part).min(1.0);
            for limit in &mut limits {
                let [left, over] = limit_changes(limit);
                limit.left.advance(part, left);
                limit.over.advance(part, over);
            }
            for (i, of) in ends.iter_mut().enumerate() {
                let changes = end_changes(i, of);
                of.iter_mut().zip(changes).for_each(|(of, by)| of.advance(part, by));
            }
            x.axpy(part, &step, 1.0);
        }
        // An end whose multiplier does not vanish is where the solution is.
        for (i, [below, above]) in ends.iter().enumerate() {
            if below.value < below.multiplier {
                x[i] = low[i];
            } else if above.value < above.multiplier {
                x[i] = high[i];
            }
        }
        let mut multipliers = [0.0; LIMITS];
        limits.iter().for_each(|of| multipliers[of.number] = of.left.multiplier);
        let mut solution = Place::zeros();
        solution.rows_mut(0, count).copy_from(&x);
        (solution, multipliers)
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const NONE: [f64; LIMITS] = [f64::NEG_INFINITY; LIMITS];
    const COUNT: usize = 3;

    /// The value of a program.
    fn value(program: &QuadraticProgram, x: &Place) -> f64 {
        let over = |(excess, slope): (&f64, &Place)| (excess + slope.dot(x)).max(0.0);
        let over: f64 = program.excess.iter().zip(program.slopes).map(over).sum();
        program.gradient.dot(x) + 0.5 * x.dot(&(program.curvature * x)) + program.price * over
    }

    #[test]
    fn the_nearest_place_on_a_line_and_at_an_end() {
        // The nearest place to (2, 1, 0.3) with x + y <= 1 and x <= 0.4.
        let gradient = -Place::from_fn(|i, _| [2.0, 1.0, 0.3].get(i).copied().unwrap_or(0.0));
        let mut slopes = [Place::zeros(); LIMITS];
        (slopes[4][0], slopes[4][1]) = (1.0, 1.0);
        let mut excess = NONE;
        excess[4] = -1.0;
        let mut high = Place::repeat(1.0);
        high[0] = 0.4;
        let program = QuadraticProgram {
            count: COUNT,
            gradient: &gradient,
            curvature: &Curvature::identity(),
            low: Place::repeat(-1.0),
            high,
            excess: &excess,
            slopes: &slopes,
            price: 10.0,
        };
        let (x, multipliers) = program.solve();
        for (found, known) in x.iter().zip([0.4, 0.6, 0.3]) {
            assert!((found - known).abs() < 1e-9, "{x:?}");
        }
        assert_eq!(x[0], 0.4);
        // What y would gain.
        assert!((multipliers[4] - 0.4).abs() < 1e-7, "{multipliers:?}");
        // Where it costs less to exceed the limit than to keep it, it is exceeded.
        let (x, multipliers) = QuadraticProgram { price: 0.1, ..program }.solve();
        assert!((x[1] - 0.9).abs() < 1e-7 && (multipliers[4] - 0.1).abs() < 1e-7, "{x:?}");
    }

    #[test]
    fn no_place_nearby_is_better() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        for _ in 0..200 {
            let mut any = |scale: f64| {
                let entry =
                    |i: usize| if i < COUNT { scale * random.random_range(-1.0..1.0) } else { 0.0 };
                Place::from_iterator((0..MOST_COMMANDS).map(entry))
            };
            let mut curvature = Curvature::identity() * 0.01;
            (0..COUNT).for_each(|_| {
                let row = any(3.0);
                curvature += row * row.transpose();
            });
            let (gradient, mut slopes, mut excess) = (any(2.0), [Place::zeros(); LIMITS], NONE);
            for limit in 0..6 {
                slopes[limit] = any(2.0);
                excess[limit] = any(1.0)[0];
            }
            let program = QuadraticProgram {
                count: COUNT,
                gradient: &gradient,
                curvature: &curvature,
                low: any(0.4).map(|of| of - 0.5),
                high: any(0.4).map(|of| of + 0.5),
                excess: &excess,
                slopes: &slopes,
                price: 5.0,
            };
            let (x, _) = program.solve();
            let best = value(&program, &x);
            for size in [1e-6, 1e-3, 0.1] {
                for _ in 0..40 {
                    let there =
                        (x + any(size)).zip_zip_map(&program.low, &program.high, |x, low, high| {
                            x.clamp(low, high)
                        });
                    let other = value(&program, &there);
                    assert!(other > best - 1e-11, "{best} {other} {x:?} {there:?}");
                }
            }
        }
    }
}
