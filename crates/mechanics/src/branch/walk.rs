//! One branch, point by point.

use nalgebra::Complex;
use trilink_robot::metrics::{Bifurcation, BranchKind, MotionStatus};

use super::{ACCURACY, Branch, BranchPoint};
use crate::mesh::Mesh;
use crate::orbit::{Direction, PeriodicOrbit, Plane, Slopes, largest_lane};
use crate::reduced::Reduced;
use crate::{MotionError, Result};

/// First, longest and shortest step along a branch, of which the parameter's range is 1.
const FIRST: f64 = 2e-3;
const LONGEST: f64 = 0.04;
const SHORTEST: f64 = 1e-7;
const MOST_POINTS: usize = 2000;
/// Of a disturbance in a period, where rounding is one that matters.
const MOST_GROWTH: f64 = 1e9;
/// Cosine of the largest angle between the directions at two points.
const STRAIGHT: f64 = 0.95;
/// How far a point may be from where it was aimed, as a part of the step.
const NEAR: f64 = 0.3;
/// Relative step that is the last.
const SOLVED: f64 = 1e-9;
/// Steps of Newton's method at most.
const MOST_STEPS: usize = 10;
/// The parameter's step for derivatives, of its range.
const DIFFERENCE: f64 = 1e-6;

/// Where a branch begins.
pub(super) struct Origin<const N: usize, R: Reduced<N>> {
    pub value: f64,
    pub parent: Option<usize>,
    mesh: Mesh<N, R>,
    /// The change at phase 0 that leads on to it from the branch that it begins on.
    change: Option<[f64; N]>,
}

impl<const N: usize, R: Reduced<N>> Origin<N, R> {
    /// A branch through a solution, in the direction of the parameter.
    pub(super) fn of_solution(orbit: PeriodicOrbit<N, R>, value: f64) -> Self {
        Self { value, parent: None, mesh: orbit.mesh, change: None }
    }
}

/// A point of a branch to go back to.
#[derive(Clone)]
struct Place<const N: usize, R: Reduced<N>> {
    mesh: Mesh<N, R>,
    value: f64,
    tangent: Direction<N>,
    tests: [f64; TESTS.len()],
    difference: [f64; N],
    weights: [f64; N],
}

/// What changes its sign where something happens.
#[derive(Clone, Copy, PartialEq)]
enum Test {
    Fold,
    Flip,
    Torus,
    /// The motion passes through that of the branch that it began on.
    Joins,
}

const TESTS: [Test; 4] = [Test::Fold, Test::Flip, Test::Torus, Test::Joins];

/// The way along a branch.
pub(super) struct Walk<'a, const N: usize, R: Reduced<N>> {
    model_at: &'a dyn Fn(f64) -> R,
    range: [f64; 2],
    kind: BranchKind,
    index: usize,
    parent: Option<usize>,
    orbit: PeriodicOrbit<N, R>,
    slopes: Slopes<N>,
    value: f64,
    tangent: Direction<N>,
    weights: [f64; N],
    /// How the motion differs from that of the branch that it began on.
    difference: [f64; N],
    reference: [f64; N],
    tests: [f64; TESTS.len()],
    /// Where the branches begin that were met.
    pub origins: Vec<Origin<N, R>>,
    /// Where it ends on the branch that it began on, if it does.
    pub joins_at: Option<f64>,
}

impl<'a, const N: usize, R: Reduced<N>> Walk<'a, N, R> {
    /// Makes ready to go.
    ///
    /// # Errors
    /// The equations are singular where the branch begins.
    pub(super) fn new(
        model_at: &'a dyn Fn(f64) -> R,
        range: [f64; 2],
        origin: Origin<N, R>,
        index: usize,
    ) -> Result<Self> {
        let Origin { value, parent, mesh, change } = origin;
        let model = model_at(value);
        let mut orbit = PeriodicOrbit::default();
        orbit.mesh = mesh;
        let is_mirrored = model.half_period_signs().is_some();
        let kind = match (change.is_some(), orbit.mesh.is_half, is_mirrored) {
            (false, true, _) => BranchKind::Symmetric,
            (false, false, false) => BranchKind::Periodic,
            (false, false, true) | (true, true, _) => BranchKind::SymmetryBroken,
            (true, false, _) => BranchKind::PeriodDoubled,
        };
        if change.is_some() {
            orbit.unfold(&model);
        }
        let mut walk = Self {
            model_at,
            range,
            kind,
            index,
            parent,
            orbit,
            slopes: Slopes::default(),
            value,
            tangent: Direction::default(),
            weights: [0.0; N],
            difference: [0.0; N],
            reference: [0.0; N],
            tests: [0.0; TESTS.len()],
            origins: Vec::new(),
            joins_at: None,
        };
        walk.make_room();
        walk.weigh();
        walk.linearise();
        match change {
            None => {
                let forward = Plane { start: [0.0; N], parameter: 1.0, distance: 1.0 };
                walk.turn_to(&forward)?;
            }
            Some(change) => {
                walk.orbit.propagate(&walk.slopes, change, 0.0);
                walk.tangent = walk.orbit.direction(0.0);
                walk.normalise();
            }
        }
        walk.orbit.accept(&model);
        walk.find_difference();
        walk.find_tests();
        Ok(walk)
    }

    fn make_room(&mut self) {
        self.orbit.linearisation.resize::<N, R>(self.orbit.mesh.count);
    }

    fn scale(&self) -> f64 {
        self.range[1] - self.range[0]
    }

    fn linearise(&mut self) {
        let step = DIFFERENCE * self.scale();
        let models = [-step, 0.0, step].map(|by| (self.model_at)(self.value + by));
        self.orbit.linearise_along(&models, step, &mut self.slopes);
    }

    /// Weighs the squares of the states at phase 0 in the length of a direction.
    fn weigh(&mut self) {
        let mut sizes = self.orbit.mesh.states.start.map(f64::abs);
        for (i, y) in
            self.orbit.mesh.states.packs.iter().flatten().flat_map(|y| y.iter().enumerate())
        {
            sizes[i] = sizes[i].max(largest_lane(y.abs()));
        }
        let floor = 1e-6 * sizes.iter().fold(f64::MIN_POSITIVE, |most, size| most.max(*size));
        self.weights = sizes.map(|size| size.max(floor).powi(-2));
    }

    /// The cosine of the angle between two directions of length 1.
    fn cosine(&self, a: &Direction<N>, b: &Direction<N>) -> f64 {
        let weights = &self.weights;
        let states: f64 = (0..N).map(|i| weights[i] * a.states.start[i] * b.states.start[i]).sum();
        states + a.parameter * b.parameter / self.scale().powi(2)
    }

    fn normalise(&mut self) {
        let length = self.cosine(&self.tangent, &self.tangent).sqrt();
        self.tangent.scale(1.0 / length);
    }

    /// The plane across a direction.
    fn across(&self, direction: &Direction<N>, distance: f64) -> Plane<N> {
        let weights = &self.weights;
        Plane {
            start: std::array::from_fn(|i| weights[i] * direction.states.start[i]),
            parameter: direction.parameter / self.scale().powi(2),
            distance,
        }
    }

    /// Finds the branch's direction at the solution that was linearised, on this side of a plane.
    fn turn_to(&mut self, plane: &Plane<N>) -> Result<()> {
        let parameter = self.orbit.step_within(&self.slopes, plane)?;
        self.tangent = self.orbit.direction(parameter);
        self.normalise();
        Ok(())
    }

    /// Newton's method within a plane.
    fn correct(&mut self, plane: &Plane<N>) -> Result<()> {
        let mut last = f64::INFINITY;
        for _ in 0..MOST_STEPS {
            self.linearise();
            let parameter = self.orbit.step_within(&self.slopes, plane)?;
            self.value += parameter;
            let size = self.orbit.go().max(parameter.abs() / self.scale());
            if size < SOLVED {
                return Ok(());
            }
            if !size.is_finite() || size > 2.0 * last || size > 1.0 {
                break;
            }
            last = size;
        }
        Err(MotionError::NotConverged { steps: MOST_STEPS })
    }

    /// Solves within a plane, with as many elements as it takes, and looks on from there.
    fn arrive(&mut self, plane: &Plane<N>) -> Result<()> {
        self.correct(plane)?;
        loop {
            let model = (self.model_at)(self.value);
            let error = self.orbit.accept(&model);
            if !self.orbit.refine_to(&model, error, 0.5 * ACCURACY)? {
                break;
            }
            self.correct(plane)?;
        }
        self.weigh();
        self.linearise();
        let onward = self.across(&self.tangent, 1.0);
        self.turn_to(&onward)?;
        self.find_difference();
        self.find_tests();
        Ok(())
    }

    /// Goes so far along the branch.
    fn advance(&mut self, length: f64) -> Result<()> {
        self.value += length * self.tangent.parameter;
        let tangent = std::mem::take(&mut self.tangent);
        self.orbit.go_along(&tangent, length);
        let plane = self.across(&tangent, 0.0);
        self.tangent = tangent;
        let (aimed, value) = (self.orbit.mesh.states.start, self.value);
        self.arrive(&plane)?;
        let states = &self.orbit.mesh.states;
        let missed: f64 = (self.weights.iter().zip(states.start.iter().zip(aimed)))
            .map(|(weight, (start, aimed))| weight * (start - aimed).powi(2))
            .sum();
        let missed = missed + ((self.value - value) / self.scale()).powi(2);
        // What is further away may be on another branch, or on this one where it comes back.
        if missed.sqrt() > NEAR * length.max(SHORTEST) {
            return Err(MotionError::NotConverged { steps: MOST_STEPS });
        }
        Ok(())
    }

    /// Goes to where the parameter has a value, about so far along the branch.
    fn advance_to(&mut self, value: f64, length: f64) -> Result<()> {
        self.orbit.go_along(&self.tangent, length);
        self.value = value;
        self.arrive(&Plane { start: [0.0; N], parameter: 1.0, distance: 0.0 })
    }

    fn place(&self) -> Place<N, R> {
        let (mesh, tangent) = (self.orbit.mesh.clone(), self.tangent.clone());
        let Self { value, tests, difference, weights, .. } = *self;
        Place { mesh, value, tangent, tests, difference, weights }
    }

    fn back_to(&mut self, place: &Place<N, R>) {
        self.orbit.mesh.clone_from(&place.mesh);
        self.make_room();
        (self.value, self.tangent) = (place.value, place.tangent.clone());
        (self.tests, self.difference) = (place.tests, place.difference);
        self.weights = place.weights;
    }

    /// Half of the span later the motion is another one than it would be on the branch that it began on.
    fn find_difference(&mut self) {
        let Mesh { states, is_half, .. } = &self.orbit.mesh;
        let signs = match self.kind {
            BranchKind::SymmetryBroken => (self.model_at)(self.value).half_period_signs(),
            BranchKind::PeriodDoubled => Some([1.0; N]),
            _ => None,
        };
        if let (false, Some(signs)) = (is_half, signs) {
            let middle = self.orbit.mesh.middle();
            self.difference = std::array::from_fn(|i| signs[i] * middle[i] - states.start[i]);
        }
    }

    /// Multipliers of the span, some of them zero.
    fn multipliers(&self) -> Vec<Complex<f64>> {
        self.orbit
            .multipliers()
            .map_or_else(|_| Vec::new(), |values| values.iter().copied().collect())
    }

    /// By the last linearisation.
    fn find_tests(&mut self) {
        let values = self.multipliers();
        let pairs = (0..values.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        let flip = values.iter().map(|value| value + 1.0).product::<Complex<f64>>().re;
        let torus = pairs.map(|(i, j)| values[i] * values[j] - 1.0).product::<Complex<f64>>().re;
        self.tests = [self.tangent.parameter, flip, torus, self.closeness()];
    }

    /// Positive while the motion is on the same side of that of the branch that it began on.
    fn closeness(&self) -> f64 {
        (0..N).map(|i| self.difference[i] * self.reference[i]).sum()
    }

    /// Goes to where a test is zero between a place and one that is `length` away, where it is `end`;
    /// gives how far that is. By the Illinois variant of false position.
    fn locate(&mut self, from: &Place<N, R>, length: f64, end: f64, test: Test) -> Result<f64> {
        const MOST: usize = 60;
        let (mut low, mut high) = (0.0, length);
        let (mut below, mut above) = (from.tests[test as usize], end);
        for _ in 0..MOST {
            let middle = (low * above - high * below) / (above - below);
            self.back_to(from);
            self.advance(middle)?;
            let value = self.tests[test as usize];
            if value == 0.0
                || (high - low) < 1e-9 * length
                || (middle - low).min(high - middle) < 1e-10 * length
            {
                return Ok(middle);
            }
            if (value > 0.0) == (above > 0.0) {
                (high, above, below) = (middle, value, 0.5 * below);
            } else {
                (low, below, above) = (middle, value, 0.5 * above);
            }
        }
        Ok(low)
    }

    /// The motion at hand.
    fn point(&mut self, bifurcation: Option<Bifurcation>) -> BranchPoint {
        let model = (self.model_at)(self.value);
        let metrics = self.orbit.measure(&model).metrics;
        let floquet = self.largest_multiplier();
        let is_broken = self.kind == BranchKind::SymmetryBroken;
        let status = MotionStatus::new(Some(floquet), is_broken);
        BranchPoint { value: self.value, metrics, floquet, status, bifurcation }
    }

    fn largest_multiplier(&self) -> f64 {
        let largest = self.multipliers().iter().map(|value| value.norm()).fold(0.0, f64::max);
        if self.orbit.mesh.is_half { largest * largest } else { largest }
    }

    /// What a test's zero at hand means, if anything.
    fn meaning(&self, test: Test) -> Option<Bifurcation> {
        let flips = match self.orbit.mesh.is_half {
            true => Bifurcation::SymmetryBreaking,
            false => Bifurcation::PeriodDoubling,
        };
        let values = self.multipliers();
        let has = |of: &dyn Fn(&Complex<f64>) -> bool| values.iter().any(of);
        match test {
            Test::Fold => Some(Bifurcation::Fold),
            Test::Flip => has(&|value| (value + 1.0).norm() < 1e-4).then_some(flips),
            // Two real multipliers of product 1 mean nothing.
            Test::Torus => has(&|value| value.im.abs() > 1e-6 && (value.norm() - 1.0).abs() < 1e-5)
                .then_some(Bifurcation::Torus),
            Test::Joins => Some(match self.kind {
                BranchKind::SymmetryBroken => Bifurcation::SymmetryBreaking,
                _ => Bifurcation::PeriodDoubling,
            }),
        }
    }

    /// Follows the branch.
    ///
    /// # Errors
    /// The work was cancelled.
    pub(super) fn walk(&mut self, is_cancelled: &dyn Fn() -> bool) -> Result<Branch> {
        let mut points = vec![self.point(None)];
        let end = self.follow(&mut points, is_cancelled)?;
        Ok(Branch { kind: self.kind, parent: self.parent, points, end })
    }

    fn follow(
        &mut self,
        points: &mut Vec<BranchPoint>,
        is_cancelled: &dyn Fn() -> bool,
    ) -> Result<String> {
        let [low, high] = self.range;
        let mut length = FIRST;
        while points.len() < MOST_POINTS {
            if is_cancelled() {
                return Err(MotionError::Cancelled);
            }
            self.reference = self.difference;
            self.tests[Test::Joins as usize] = self.closeness();
            let from = self.place();
            let arrived = self.advance(length);
            let turned = || self.cosine(&from.tangent, &self.tangent) < STRAIGHT;
            if arrived.is_err() || (length > 100.0 * SHORTEST && turned()) {
                self.back_to(&from);
                length *= 0.5;
                if length < SHORTEST {
                    let why = arrived
                        .err()
                        .map_or("it turns too sharply".to_owned(), |error| error.to_string());
                    return Ok(format!("cannot be followed beyond {:.6}: {why}", self.value));
                }
                continue;
            }
            let mut gone = length;
            let is_inside = (low..=high).contains(&self.value);
            if !is_inside {
                let bound = if self.value > high { high } else { low };
                gone *= (bound - from.value) / (self.value - from.value);
                self.back_to(&from);
                if let Err(error) = self.advance_to(bound, gone) {
                    return Ok(format!("cannot be followed beyond {:.6}: {error}", from.value));
                }
            }
            let growth = self.largest_multiplier();
            if growth > MOST_GROWTH {
                return Ok(format!(
                    "cannot be followed beyond {:.6}: disturbances grow by {growth:.0e} in a period",
                    from.value
                ));
            }
            let here = self.place();
            let (before, after) = (from.tests, here.tests);
            let last = self.point(None);
            let mut met = Vec::new();
            for (i, test) in TESTS.into_iter().enumerate() {
                // The direction of a branch that begins has no part of the parameter.
                let begins = points.len() == 1 && self.parent.is_some();
                let is_zero =
                    before[i] == 0.0 || (begins && matches!(test, Test::Fold | Test::Joins));
                if is_zero || (before[i] > 0.0) == (after[i] > 0.0) {
                    continue;
                }
                let located = self.locate(&from, gone, after[i], test);
                if let (Ok(at), Some(bifurcation)) = (located, self.meaning(test)) {
                    met.push((at, test, self.point(Some(bifurcation)), self.origin(test)));
                }
            }
            met.sort_by(|a, b| a.0.total_cmp(&b.0));
            let joins = met.iter().position(|(_, test, ..)| *test == Test::Joins);
            // What happens there happens to the branch that it joins.
            let joins = joins.map(|i| met.swap_remove(i).2);
            if let Some(point) = joins {
                points.push(point);
                self.joins_at = Some(point.value);
                return Ok(format!("joins the branch that it began on at {:.6}", point.value));
            }
            for (_, _, point, origin) in met {
                points.push(point);
                self.origins.extend(origin);
            }
            self.back_to(&here);
            points.push(last);
            if !is_inside {
                return Ok("the end of the range".to_owned());
            }
            length = (1.4 * length).min(LONGEST);
        }
        Ok(format!("cannot be followed beyond {:.6} in {MOST_POINTS} points", self.value))
    }

    /// Where another branch begins at the point at hand, if one does that can be followed.
    fn origin(&self, test: Test) -> Option<Origin<N, R>> {
        /// Periods of the longest motion.
        const MOST_PERIODS: usize = 2;
        let mesh = self.orbit.mesh.clone();
        let may = test == Test::Flip && (mesh.is_half || 2 * mesh.periods <= MOST_PERIODS);
        let change = self.orbit.flipped().filter(|_| may)?;
        Some(Origin { value: self.value, parent: Some(self.index), mesh, change: Some(change) })
    }
}
