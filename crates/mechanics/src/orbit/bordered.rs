//! Newton steps along a branch of periodic solutions, with a parameter among the unknowns.
//!
//! Each element is condensed to the derivatives of the state at its end with respect to the state at its
//! start and to the parameter. The system is completed by `N + 1` equations: periodicity, and one that
//! confines a step to a plane across the branch. The bordered system is regular at folds, where the
//! periodicity equations alone are singular (pseudo-arclength continuation: H. B. Keller, in *Applications of
//! Bifurcation Theory*, Academic Press 1977).

use nalgebra::{DMatrix, DVector};
use trilink_robot::{LANES, Lanes, Number};

use super::PeriodicOrbit;
use super::newton::{dynamic, product, sum};
use crate::Result;
use crate::mesh::States;
use crate::reduced::{Reduced, lanes};

/// Derivatives of the states at the elements' stages and ends with respect to the continuation parameter,
/// with the states at the elements' starts held fixed.
#[derive(Debug, Clone, Default)]
pub(crate) struct Slopes<const N: usize> {
    stages: States<N>,
    ends: Vec<[f64; N]>,
}

/// Direction, from a solution, in the space spanned by the states and the continuation parameter.
#[derive(Debug, Clone, Default)]
pub(crate) struct Direction<const N: usize> {
    pub states: States<N>,
    pub parameter: f64,
}

impl<const N: usize> Direction<N> {
    /// Multiplies the direction by a factor.
    pub(crate) fn scale(&mut self, by: f64) {
        self.parameter *= by;
        self.states.start.iter_mut().for_each(|y| *y *= by);
        let by = Lanes::splat(by);
        let states = self.states.packs.iter_mut().flatten().flatten();
        states.for_each(|y| *y = by * *y);
    }
}

/// Plane in which Newton steps lie: the scalar product of `start` and the step in the state at phase 0, plus
/// `parameter` times the step in the continuation parameter, equals `distance`.
pub(crate) struct Plane<const N: usize> {
    pub start: [f64; N],
    pub parameter: f64,
    pub distance: f64,
}

impl<const N: usize, R: Reduced<N>> PeriodicOrbit<N, R> {
    /// Linearises the elements with respect to the states and, by central differences, with respect to the continuation
    /// parameter; the latter derivatives are stored in `slopes`. The parameter in the models `below` and `above`
    /// differs from that in `at` by `-step` and `step`.
    pub(crate) fn linearise_along(
        &mut self,
        [below, at, above]: &[R; 3],
        step: f64,
        slopes: &mut Slopes<N>,
    ) {
        self.mesh.lay_out(at);
        self.linearise_elements(at);
        slopes.stages.packs.clear();
        slopes.ends.clear();
        for (model, weight) in [(below, -0.5 / step), (above, 0.5 / step)] {
            self.mesh.lay_out(model);
            self.evaluate(model);
            let weights = Lanes::splat(weight);
            let zero = Lanes::default();
            for pack in 0..self.mesh.packs() {
                self.linearisation.solve_step::<N, R>(pack);
                let duration_s = self.mesh.durations_s[pack];
                let changes = self.linearisation.changes::<N, R>(pack, &[zero; N], duration_s);
                let ends = self.linearisation.end_step::<N, R>(pack, duration_s);
                let changes = changes.map(|stage| stage.map(|change| weights * change));
                match slopes.stages.packs.get_mut(pack) {
                    None => slopes.stages.packs.push(changes),
                    Some(slopes) => {
                        let pairs = slopes.iter_mut().flatten().zip(changes.iter().flatten());
                        pairs.for_each(|(slope, change)| *slope += *change);
                    }
                }
                for (lane, k) in self.mesh.elements_of(pack).enumerate() {
                    let change = ends.map(|end| weight * end.lane(lane));
                    match slopes.ends.get_mut(k) {
                        None => slopes.ends.push(change),
                        Some(slope) => *slope = sum(slope, &change),
                    }
                }
            }
        }
        self.mesh.lay_out(at);
        self.evaluate(at);
        for pack in 0..self.mesh.packs() {
            self.linearisation.solve_step::<N, R>(pack);
        }
    }

    /// Computes the Newton step that lies in a plane, stores the changes in the states in `step`, and returns the
    /// change in the continuation parameter. [`PeriodicOrbit::linearise_along`] must have been called before.
    ///
    /// # Errors
    /// Returns an error if the equations are singular.
    pub(crate) fn step_within(&mut self, slopes: &Slopes<N>, plane: &Plane<N>) -> Result<f64> {
        let Self { mesh, linearisation, transfers, offsets, .. } = self;
        offsets.clear();
        let mut end = [0.0; N];
        let mut slope = [0.0; N];
        for pack in 0..mesh.packs() {
            let steps = linearisation.end_step::<N, R>(pack, mesh.durations_s[pack]);
            for (lane, k) in mesh.elements_of(pack).enumerate() {
                let offset = steps.map(|step| step.lane(lane));
                end = sum(&product(&transfers[k], &end), &offset);
                slope = sum(&product(&transfers[k], &slope), &slopes.ends[k]);
                offsets.push(offset);
            }
        }
        let ends = mesh.states.start_of(mesh.count);
        let monodromy = self.monodromy();
        let mesh = &self.mesh;
        let mut matrix = DMatrix::identity(N + 1, N + 1);
        let mut right = DVector::zeros(N + 1);
        for i in 0..N {
            (0..N).for_each(|m| matrix[(i, m)] -= monodromy[(i, m)]);
            matrix[(i, N)] = -mesh.signs[i] * slope[i];
            matrix[(N, i)] = plane.start[i];
            right[i] = mesh.signs[i] * (end[i] + ends[i]) - mesh.states.start[i];
        }
        matrix[(N, N)] = plane.parameter;
        right[N] = plane.distance;
        let solved = matrix.lu().solve(&right).filter(|step| step.iter().all(|x| x.is_finite()));
        let solved = solved.ok_or(self.not_converged())?;
        self.propagate(slopes, std::array::from_fn(|i| solved[i]), solved[N]);
        Ok(solved[N])
    }

    /// Propagates a change in the state at phase 0 (`start`) and in the continuation parameter along the elements, and
    /// stores the resulting changes in all states in `step`. [`PeriodicOrbit::step_within`] must have been called
    /// before, or [`PeriodicOrbit::linearise_along`] at a solution.
    pub(crate) fn propagate(&mut self, slopes: &Slopes<N>, mut start: [f64; N], parameter: f64) {
        let Self { mesh, linearisation, transfers, step, .. } = self;
        step.start = start;
        step.packs.clear();
        for pack in 0..mesh.packs() {
            let steps = linearisation.end_step::<N, R>(pack, mesh.durations_s[pack]);
            let mut starts = [start; LANES];
            for (lane, k) in mesh.elements_of(pack).enumerate() {
                starts[lane..].fill(start);
                let parameter_changes = slopes.ends[k].map(|slope| parameter * slope);
                let offset = sum(&steps.map(|step| step.lane(lane)), &parameter_changes);
                start = sum(&product(&transfers[k], &start), &offset);
            }
            let starts = lanes(starts.each_ref());
            let mut changes = linearisation.changes::<N, R>(pack, &starts, mesh.durations_s[pack]);
            let parameter_changes = slopes.stages.packs[pack].iter().flatten();
            for (change, slope) in changes.iter_mut().flatten().zip(parameter_changes) {
                *change += Lanes::splat(parameter) * *slope;
            }
            step.packs.push(changes);
        }
    }

    /// Returns the direction of the last Newton step, given the change in the continuation parameter in that step.
    pub(crate) fn direction(&self, parameter: f64) -> Direction<N> {
        Direction { states: self.step.clone(), parameter }
    }

    /// Adds the last Newton step to the states and returns the size of the step relative to the states.
    pub(crate) fn apply_step(&mut self) -> f64 {
        let size = self.step_size(&self.sizes());
        self.move_by(1.0);
        size
    }

    /// Moves the states by `length` times a direction.
    pub(crate) fn move_along(&mut self, direction: &Direction<N>, length: f64) {
        self.step.clone_from(&direction.states);
        self.move_by(length);
    }

    /// Accepts the current states as a solution and returns their discretisation error.
    pub(crate) fn accept(&mut self, model: &R) -> f64 {
        self.cycle = None;
        self.floquet = None;
        self.path.follow(model, &self.mesh);
        self.discretisation_error(model)
    }

    /// Refines the mesh if `error` exceeds `max_error`, and returns whether the mesh was refined.
    ///
    /// # Errors
    /// Returns an error if too many elements would be needed.
    pub(crate) fn refine_to(&mut self, model: &R, error: f64, max_error: f64) -> Result<bool> {
        let is_rough = error > max_error;
        if is_rough {
            self.refine(model, error / max_error)?;
        }
        Ok(is_rough)
    }

    /// Extends the solution to twice its time span; the second half follows from the first by symmetry or periodicity.
    pub(crate) fn unfold(&mut self, model: &R) {
        let doubled = self.mesh.unfold(model, &mut self.before);
        self.linearisation.resize::<N, R>(doubled);
    }

    /// Returns, from the last linearisation, the change in the state at phase 0 that comes closest to being reversed
    /// after the time span of the mesh (Floquet multiplier -1); `None` if the singular value decomposition fails.
    pub(crate) fn flip_direction(&self) -> Option<[f64; N]> {
        let matrix = DMatrix::identity(N, N) + dynamic(&self.monodromy());
        let svd = matrix.try_svd(false, true, f64::EPSILON, 1000)?;
        let (smallest, _) = svd.singular_values.argmin();
        let rows = svd.v_t?;
        Some(std::array::from_fn(|i| rows[(smallest, i)]))
    }
}
