//! Pseudo-arclength continuation of one branch of periodic motions.

use nalgebra::Complex;
use trilink_robot::metrics::{Bifurcation, BranchKind, MotionStatus};

use super::{ACCURACY, Branch, BranchPoint};
use crate::mesh::Mesh;
use crate::orbit::{Direction, PeriodicOrbit, Plane, Slopes, largest_lane};
use crate::reduced::Reduced;
use crate::{MotionError, Result};

/// Initial step length, with the parameter range scaled to length 1.
const INITIAL_STEP: f64 = 2e-3;
/// Maximum step length, with the parameter range scaled to length 1.
const MAX_STEP: f64 = 0.04;
/// Minimum step length, with the parameter range scaled to length 1.
const MIN_STEP: f64 = 1e-7;
/// Maximum number of points on a branch.
const MAX_POINTS: usize = 2000;
/// Maximum factor by which a disturbance may grow per period; beyond this, rounding errors matter.
const MAX_GROWTH: f64 = 1e9;
/// Minimum cosine of the angle between the tangents at successive points.
const MIN_COSINE: f64 = 0.95;
/// Maximum distance of a corrected point from its tangent prediction, as a fraction of the step length.
const MAX_CORRECTION: f64 = 0.3;
/// Relative size of the Newton step below which the iteration has converged.
const NEWTON_TOLERANCE: f64 = 1e-9;
/// Maximum number of Newton steps.
const MAX_NEWTON_STEPS: usize = 10;
/// Parameter step for central differences, as a fraction of the parameter range.
const DIFFERENCE_STEP: f64 = 1e-6;

/// Solution from which the continuation of a branch starts.
pub(super) struct BranchStart<const N: usize, R: Reduced<N>> {
    pub value: f64,
    pub parent: Option<usize>,
    mesh: Mesh<N, R>,
    /// Direction in which the state at phase 0 changes where this branch bifurcates from its parent; `None`
    /// if it has no parent.
    change: Option<[f64; N]>,
}

impl<const N: usize, R: Reduced<N>> BranchStart<N, R> {
    /// Creates the start of a branch at a solution, in the direction of increasing parameter.
    pub(super) fn from_solution(orbit: PeriodicOrbit<N, R>, value: f64) -> Self {
        Self { value, parent: None, mesh: orbit.mesh, change: None }
    }
}

/// Checkpoint to which the continuation can return.
#[derive(Clone)]
struct Checkpoint<const N: usize, R: Reduced<N>> {
    mesh: Mesh<N, R>,
    value: f64,
    tangent: Direction<N>,
    tests: [f64; TESTS.len()],
    departure: [f64; N],
    weights: [f64; N],
}

/// Scalar test function, which changes sign at a bifurcation.
#[derive(Clone, Copy, PartialEq)]
enum Test {
    Fold,
    Flip,
    Torus,
    /// Test function that is zero where the motion coincides with that of the parent branch.
    Joins,
}

const TESTS: [Test; 4] = [Test::Fold, Test::Flip, Test::Torus, Test::Joins];

/// State of the continuation of one branch.
pub(super) struct Continuation<'a, const N: usize, R: Reduced<N>> {
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
    /// Deviation of the current motion from the symmetry or the period of the parent branch.
    departure: [f64; N],
    /// Deviation from the parent branch at the previous point.
    reference: [f64; N],
    tests: [f64; TESTS.len()],
    /// Starts of the branches that bifurcate from this branch.
    pub bifurcating: Vec<BranchStart<N, R>>,
    /// Parameter value at which the branch rejoins its parent branch; `None` if it does not.
    pub joins_at: Option<f64>,
}

impl<'a, const N: usize, R: Reduced<N>> Continuation<'a, N, R> {
    /// Prepares the continuation of a branch from its start.
    ///
    /// # Errors
    /// Returns an error if the equations are singular at the start of the branch.
    pub(super) fn new(
        model_at: &'a dyn Fn(f64) -> R,
        range: [f64; 2],
        origin: BranchStart<N, R>,
        index: usize,
    ) -> Result<Self> {
        let BranchStart { value, parent, mesh, change } = origin;
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
        let mut continuation = Self {
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
            departure: [0.0; N],
            reference: [0.0; N],
            tests: [0.0; TESTS.len()],
            bifurcating: Vec::new(),
            joins_at: None,
        };
        continuation.resize_workspace();
        continuation.update_weights();
        continuation.linearise();
        match change {
            None => {
                let forward = Plane { start: [0.0; N], parameter: 1.0, distance: 1.0 };
                continuation.update_tangent(&forward)?;
            }
            Some(change) => {
                continuation.orbit.propagate(&continuation.slopes, change, 0.0);
                continuation.tangent = continuation.orbit.direction(0.0);
                continuation.normalise();
            }
        }
        continuation.orbit.accept(&model);
        continuation.update_departure();
        continuation.update_tests();
        Ok(continuation)
    }

    fn resize_workspace(&mut self) {
        self.orbit.linearisation.resize::<N, R>(self.orbit.mesh.count);
    }

    fn scale(&self) -> f64 {
        self.range[1] - self.range[0]
    }

    fn linearise(&mut self) {
        let step = DIFFERENCE_STEP * self.scale();
        let models = [-step, 0.0, step].map(|by| (self.model_at)(self.value + by));
        self.orbit.linearise_along(&models, step, &mut self.slopes);
    }

    /// Updates the weights that the states at phase 0 have in the norm of a direction.
    fn update_weights(&mut self) {
        let mut sizes = self.orbit.mesh.states.start.map(f64::abs);
        for (i, y) in
            self.orbit.mesh.states.packs.iter().flatten().flat_map(|y| y.iter().enumerate())
        {
            sizes[i] = sizes[i].max(largest_lane(y.abs()));
        }
        let floor = 1e-6 * sizes.iter().fold(f64::MIN_POSITIVE, |most, size| most.max(*size));
        self.weights = sizes.map(|size| size.max(floor).powi(-2));
    }

    /// Returns the cosine of the angle between two directions of unit length.
    fn cosine(&self, a: &Direction<N>, b: &Direction<N>) -> f64 {
        let weights = &self.weights;
        let states: f64 = (0..N).map(|i| weights[i] * a.states.start[i] * b.states.start[i]).sum();
        states + a.parameter * b.parameter / self.scale().powi(2)
    }

    fn normalise(&mut self) {
        let length = self.cosine(&self.tangent, &self.tangent).sqrt();
        self.tangent.scale(1.0 / length);
    }

    /// Returns the plane normal to `direction`, at `distance` along it from the current solution.
    fn normal_plane(&self, direction: &Direction<N>, distance: f64) -> Plane<N> {
        let weights = &self.weights;
        Plane {
            start: std::array::from_fn(|i| weights[i] * direction.states.start[i]),
            parameter: direction.parameter / self.scale().powi(2),
            distance,
        }
    }

    /// Updates the tangent to the branch at the linearised solution; `plane` selects its orientation.
    fn update_tangent(&mut self, plane: &Plane<N>) -> Result<()> {
        let parameter = self.orbit.step_within(&self.slopes, plane)?;
        self.tangent = self.orbit.direction(parameter);
        self.normalise();
        Ok(())
    }

    /// Solves for the intersection of the branch with a plane by Newton's method.
    fn correct(&mut self, plane: &Plane<N>) -> Result<()> {
        let mut last = f64::INFINITY;
        for _ in 0..MAX_NEWTON_STEPS {
            self.linearise();
            let parameter = self.orbit.step_within(&self.slopes, plane)?;
            self.value += parameter;
            let size = self.orbit.apply_step().max(parameter.abs() / self.scale());
            if size < NEWTON_TOLERANCE {
                return Ok(());
            }
            if !size.is_finite() || size > 2.0 * last || size > 1.0 {
                break;
            }
            last = size;
        }
        Err(MotionError::NotConverged { steps: MAX_NEWTON_STEPS })
    }

    /// Solves for the intersection of the branch with a plane, refining the mesh as needed, and updates the
    /// tangent and the test functions.
    fn correct_and_refine(&mut self, plane: &Plane<N>) -> Result<()> {
        self.correct(plane)?;
        loop {
            let model = (self.model_at)(self.value);
            let error = self.orbit.accept(&model);
            if !self.orbit.refine_to(&model, error, 0.5 * ACCURACY)? {
                break;
            }
            self.correct(plane)?;
        }
        self.update_weights();
        self.linearise();
        let onward = self.normal_plane(&self.tangent, 1.0);
        self.update_tangent(&onward)?;
        self.update_departure();
        self.update_tests();
        Ok(())
    }

    /// Advances along the branch by the arclength `length`.
    fn advance(&mut self, length: f64) -> Result<()> {
        self.value += length * self.tangent.parameter;
        let tangent = std::mem::take(&mut self.tangent);
        self.orbit.move_along(&tangent, length);
        let plane = self.normal_plane(&tangent, 0.0);
        self.tangent = tangent;
        let predicted = self.orbit.mesh.states.start;
        let value = self.value;
        self.correct_and_refine(&plane)?;
        let states = &self.orbit.mesh.states;
        let squares: f64 = (self.weights.iter().zip(states.start.iter().zip(predicted)))
            .map(|(weight, (start, predicted))| weight * (start - predicted).powi(2))
            .sum();
        let distance_squared = squares + ((self.value - value) / self.scale()).powi(2);
        // A point further away may lie on another branch, or on a different part of this one.
        if distance_squared.sqrt() > MAX_CORRECTION * length.max(MIN_STEP) {
            return Err(MotionError::NotConverged { steps: MAX_NEWTON_STEPS });
        }
        Ok(())
    }

    /// Advances to the parameter value `value`, which lies at a distance of about `length` along the branch.
    fn advance_to(&mut self, value: f64, length: f64) -> Result<()> {
        self.orbit.move_along(&self.tangent, length);
        self.value = value;
        self.correct_and_refine(&Plane { start: [0.0; N], parameter: 1.0, distance: 0.0 })
    }

    fn checkpoint(&self) -> Checkpoint<N, R> {
        let mesh = self.orbit.mesh.clone();
        let tangent = self.tangent.clone();
        let Self { value, tests, departure, weights, .. } = *self;
        Checkpoint { mesh, value, tangent, tests, departure, weights }
    }

    fn restore(&mut self, checkpoint: &Checkpoint<N, R>) {
        self.orbit.mesh.clone_from(&checkpoint.mesh);
        self.resize_workspace();
        self.value = checkpoint.value;
        self.tangent = checkpoint.tangent.clone();
        self.tests = checkpoint.tests;
        self.departure = checkpoint.departure;
        self.weights = checkpoint.weights;
    }

    /// Updates `departure`: the state halfway through the time span of the mesh (mirrored on a
    /// symmetry-broken branch) minus the state at the start of that time span. It is zero on the parent
    /// branch.
    fn update_departure(&mut self) {
        let Mesh { states, is_half, .. } = &self.orbit.mesh;
        let signs = match self.kind {
            BranchKind::SymmetryBroken => (self.model_at)(self.value).half_period_signs(),
            BranchKind::PeriodDoubled => Some([1.0; N]),
            _ => None,
        };
        if let (false, Some(signs)) = (is_half, signs) {
            let middle = self.orbit.mesh.middle();
            self.departure = std::array::from_fn(|i| signs[i] * middle[i] - states.start[i]);
        }
    }

    /// Returns the Floquet multipliers over the time span of the mesh (one or more periods, or half of one),
    /// padded with zeros to a length of at least 5; empty if they cannot be computed.
    fn multipliers(&self) -> Vec<Complex<f64>> {
        self.orbit
            .multipliers()
            .map_or_else(|_| Vec::new(), |values| values.into_iter().take(N.max(5)).collect())
    }

    /// Updates, from the latest linearisation, the values of the test functions that detect bifurcations.
    fn update_tests(&mut self) {
        let values = self.multipliers();
        let pairs = (0..values.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        let flip = values.iter().map(|value| value + 1.0).product::<Complex<f64>>().re;
        let torus = pairs.map(|(i, j)| values[i] * values[j] - 1.0).product::<Complex<f64>>().re;
        self.tests = [self.tangent.parameter, flip, torus, self.departure_projection()];
    }

    /// Returns the scalar product of the deviations from the parent branch at the current and the previous
    /// point. Its sign changes where the motion crosses the parent branch.
    fn departure_projection(&self) -> f64 {
        (0..N).map(|i| self.departure[i] * self.reference[i]).sum()
    }

    /// Advances to the zero of a test function by the Illinois variant of false position. The zero lies
    /// between the checkpoint `from` and the point at distance `length` from it, where the test function has
    /// the value `end`. Returns the distance from the checkpoint.
    fn locate(
        &mut self,
        from: &Checkpoint<N, R>,
        length: f64,
        end: f64,
        test: Test,
    ) -> Result<f64> {
        const MAX_ITERATIONS: usize = 60;
        let mut low = 0.0;
        let mut high = length;
        let mut below = from.tests[test as usize];
        let mut above = end;
        for _ in 0..MAX_ITERATIONS {
            let middle = (low * above - high * below) / (above - below);
            self.restore(from);
            self.advance(middle)?;
            let value = self.tests[test as usize];
            if value == 0.0
                || (high - low) < 1e-9 * length
                || (middle - low).min(high - middle) < 1e-10 * length
            {
                return Ok(middle);
            }
            if (value > 0.0) == (above > 0.0) {
                high = middle;
                above = value;
                below *= 0.5;
            } else {
                low = middle;
                below = value;
                above *= 0.5;
            }
        }
        Ok(low)
    }

    /// Returns the current solution as a point of the branch.
    fn point(&mut self, bifurcation: Option<Bifurcation>) -> BranchPoint {
        let model = (self.model_at)(self.value);
        let metrics = model.gait_metrics(&self.orbit.measure(&model));
        let floquet = self.largest_multiplier();
        let is_broken = self.kind == BranchKind::SymmetryBroken;
        let status = MotionStatus::new(Some(floquet), is_broken);
        BranchPoint { value: self.value, metrics, floquet, status, bifurcation }
    }

    fn largest_multiplier(&self) -> f64 {
        let largest = self.multipliers().iter().map(|value| value.norm()).fold(0.0, f64::max);
        if self.orbit.mesh.is_half { largest * largest } else { largest }
    }

    /// Returns the bifurcation indicated by a zero of a test function at the current solution, if any.
    fn bifurcation(&self, test: Test) -> Option<Bifurcation> {
        let mut multipliers = self.multipliers().into_iter();
        match test {
            Test::Fold => Some(Bifurcation::Fold),
            Test::Flip => {
                let bifurcation = if self.orbit.mesh.is_half {
                    Bifurcation::SymmetryBreaking
                } else {
                    Bifurcation::PeriodDoubling
                };
                multipliers.any(|value| (value + 1.0).norm() < 1e-4).then_some(bifurcation)
            }
            // Two real multipliers whose product is 1 do not indicate a bifurcation.
            Test::Torus => multipliers
                .any(|value| value.im.abs() > 1e-6 && (value.norm() - 1.0).abs() < 1e-5)
                .then_some(Bifurcation::Torus),
            Test::Joins => Some(match self.kind {
                BranchKind::SymmetryBroken => Bifurcation::SymmetryBreaking,
                _ => Bifurcation::PeriodDoubling,
            }),
        }
    }

    /// Traces the branch from its start to its end and returns it with its points.
    ///
    /// # Errors
    /// Returns an error if the computation was cancelled.
    pub(super) fn trace(&mut self, is_cancelled: &dyn Fn() -> bool) -> Result<Branch> {
        let mut points = vec![self.point(None)];
        let end = self.trace_points(&mut points, is_cancelled)?;
        Ok(Branch { kind: self.kind, parent: self.parent, points, end })
    }

    fn trace_points(
        &mut self,
        points: &mut Vec<BranchPoint>,
        is_cancelled: &dyn Fn() -> bool,
    ) -> Result<String> {
        let [low, high] = self.range;
        let mut length = INITIAL_STEP;
        while points.len() < MAX_POINTS {
            if is_cancelled() {
                return Err(MotionError::Cancelled);
            }
            self.reference = self.departure;
            self.tests[Test::Joins as usize] = self.departure_projection();
            let from = self.checkpoint();
            let advanced = self.advance(length);
            if advanced.is_err()
                || (length > 100.0 * MIN_STEP
                    && self.cosine(&from.tangent, &self.tangent) < MIN_COSINE)
            {
                self.restore(&from);
                length *= 0.5;
                if length < MIN_STEP {
                    let why =
                        advanced.err().map_or("the branch turns too sharply".to_owned(), |error| {
                            error.to_string()
                        });
                    return Ok(format!(
                        "the branch cannot be followed beyond {:.6}: {why}",
                        self.value
                    ));
                }
                continue;
            }
            let mut distance = length;
            let is_inside = (low..=high).contains(&self.value);
            if !is_inside {
                let bound = if self.value > high { high } else { low };
                distance *= (bound - from.value) / (self.value - from.value);
                self.restore(&from);
                if let Err(error) = self.advance_to(bound, distance) {
                    return Ok(format!(
                        "the branch cannot be followed beyond {:.6}: {error}",
                        from.value
                    ));
                }
            }
            let growth = self.largest_multiplier();
            if growth > MAX_GROWTH {
                return Ok(format!(
                    "the branch cannot be followed beyond {:.6}: disturbances grow by a factor of {growth:.0e} in a \
                     period",
                    from.value
                ));
            }
            let here = self.checkpoint();
            let before = from.tests;
            let after = here.tests;
            let last = self.point(None);
            let mut met = Vec::new();
            for (i, test) in TESTS.into_iter().enumerate() {
                // At its start a bifurcating branch is tangent to the direction of constant parameter.
                let begins = points.len() == 1 && self.parent.is_some();
                let is_zero =
                    before[i] == 0.0 || (begins && matches!(test, Test::Fold | Test::Joins));
                if is_zero || (before[i] > 0.0) == (after[i] > 0.0) {
                    continue;
                }
                let located = self.locate(&from, distance, after[i], test);
                if let (Ok(at), Some(bifurcation)) = (located, self.bifurcation(test)) {
                    met.push((
                        at,
                        test,
                        self.point(Some(bifurcation)),
                        self.bifurcating_branch(test),
                    ));
                }
            }
            met.sort_by(|a, b| a.0.total_cmp(&b.0));
            let joins = met.iter().position(|(_, test, ..)| *test == Test::Joins);
            // The bifurcation at the junction belongs to the parent branch.
            let joins = joins.map(|i| met.swap_remove(i).2);
            if let Some(point) = joins {
                points.push(point);
                self.joins_at = Some(point.value);
                return Ok(format!("the branch rejoins its parent branch at {:.6}", point.value));
            }
            for (_, _, point, origin) in met {
                points.push(point);
                self.bifurcating.extend(origin);
            }
            self.restore(&here);
            points.push(last);
            if !is_inside {
                return Ok("the end of the range".to_owned());
            }
            length = (1.4 * length).min(MAX_STEP);
        }
        Ok(format!(
            "the branch cannot be followed beyond {:.6} with {MAX_POINTS} points",
            self.value
        ))
    }

    /// Returns the start of the branch that bifurcates from the current point; `None` if there is no such
    /// branch, or if it cannot be traced.
    fn bifurcating_branch(&self, test: Test) -> Option<BranchStart<N, R>> {
        /// Maximum period of a motion, in periods of the command.
        const MAX_PERIODS: usize = 2;
        let mesh = self.orbit.mesh.clone();
        let can_bifurcate = test == Test::Flip && (mesh.is_half || 2 * mesh.periods <= MAX_PERIODS);
        let change = self.orbit.flip_direction().filter(|_| can_bifurcate)?;
        Some(BranchStart {
            value: self.value,
            parent: Some(self.index),
            mesh,
            change: Some(change),
        })
    }
}
