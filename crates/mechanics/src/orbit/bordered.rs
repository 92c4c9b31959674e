//! Steps along a branch of solutions, of which a parameter is one of the unknowns.
//!
//! Each element is condensed to the derivatives of its end with respect to its start and to the
//! parameter, so that `N + 1` equations close the chain: that it repeats itself, and one more, which
//! keeps a step within a plane across the branch. They are regular at folds, where the `N` are not
//! (pseudo-arclength continuation: H. B. Keller, in *Applications of Bifurcation Theory*, Academic
//! Press 1977).

use nalgebra::{Matrix5, Matrix6, SMatrix, Vector6};
use trilink_robot::{LANES, Lanes, Number};

use super::PeriodicOrbit;
use super::newton::{padded, product, sum};
use crate::Result;
use crate::mesh::States;
use crate::reduced::{Reduced, lanes};

/// Derivatives of the elements' stages and ends with respect to the parameter when their starts stay.
#[derive(Debug, Clone, Default)]
pub(crate) struct Slopes<const N: usize> {
    stages: States<N>,
    ends: Vec<[f64; N]>,
}

/// A direction from a solution: of its states and of the parameter.
#[derive(Debug, Clone, Default)]
pub(crate) struct Direction<const N: usize> {
    pub states: States<N>,
    pub parameter: f64,
}

impl<const N: usize> Direction<N> {
    /// Makes it longer or shorter.
    pub(crate) fn scale(&mut self, by: f64) {
        self.parameter *= by;
        self.states.start.iter_mut().for_each(|y| *y *= by);
        let by = Lanes::splat(by);
        let states = self.states.packs.iter_mut().flatten().flatten();
        states.for_each(|y| *y = by * *y);
    }
}

/// A plane: what a step's states at phase 0 and its parameter are weighted with, and what comes of it.
pub(crate) struct Plane<const N: usize> {
    pub start: [f64; N],
    pub parameter: f64,
    pub distance: f64,
}

impl<const N: usize, R: Reduced<N>> PeriodicOrbit<N, R> {
    /// Linearises the elements with respect to the parameter, too, from the models below, at and above
    /// its value, of which those beside it are `step` away.
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
            let (weights, zero) = (Lanes::splat(weight), Lanes::default());
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

    /// Solves for the step within a plane, into `step`; gives that of the parameter. After
    /// [`PeriodicOrbit::linearise_along`].
    ///
    /// # Errors
    /// The equations are singular.
    pub(crate) fn step_within(&mut self, slopes: &Slopes<N>, plane: &Plane<N>) -> Result<f64> {
        let Self { mesh, linearisation, transfers, offsets, .. } = self;
        offsets.clear();
        let (mut end, mut slope) = ([0.0; N], [0.0; N]);
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
        // As large for every model: what is left over stays zero.
        let mut matrix = Matrix6::identity();
        let mut right = Vector6::zeros();
        for i in 0..N {
            (0..N).for_each(|m| matrix[(i, m)] -= monodromy[(i, m)]);
            matrix[(i, 5)] = -mesh.signs[i] * slope[i];
            matrix[(5, i)] = plane.start[i];
            right[i] = mesh.signs[i] * (end[i] + ends[i]) - mesh.states.start[i];
        }
        (matrix[(5, 5)], right[5]) = (plane.parameter, plane.distance);
        let solved = matrix.lu().solve(&right).filter(|step| step.iter().all(|x| x.is_finite()));
        let solved = solved.ok_or(self.not_converged())?;
        self.propagate(slopes, std::array::from_fn(|i| solved[i]), solved[5]);
        Ok(solved[5])
    }

    /// Where a change at phase 0 and of the parameter leads, into `step`. After
    /// [`PeriodicOrbit::step_within`] or [`PeriodicOrbit::linearise_along`] of a solution.
    pub(crate) fn propagate(&mut self, slopes: &Slopes<N>, mut start: [f64; N], parameter: f64) {
        let Self { mesh, linearisation, transfers, step, .. } = self;
        step.start = start;
        step.packs.clear();
        for pack in 0..mesh.packs() {
            let steps = linearisation.end_step::<N, R>(pack, mesh.durations_s[pack]);
            let mut starts = [start; LANES];
            for (lane, k) in mesh.elements_of(pack).enumerate() {
                starts[lane..].fill(start);
                let by_parameter = slopes.ends[k].map(|slope| parameter * slope);
                let offset = sum(&steps.map(|step| step.lane(lane)), &by_parameter);
                start = sum(&product(&transfers[k], &start), &offset);
            }
            let starts = lanes(starts.each_ref());
            let mut changes = linearisation.changes::<N, R>(pack, &starts, mesh.durations_s[pack]);
            let by_parameter = slopes.stages.packs[pack].iter().flatten();
            for (change, slope) in changes.iter_mut().flatten().zip(by_parameter) {
                *change += Lanes::splat(parameter) * *slope;
            }
            step.packs.push(changes);
        }
    }

    /// The last step as a direction.
    pub(crate) fn direction(&self, parameter: f64) -> Direction<N> {
        Direction { states: self.step.clone(), parameter }
    }

    /// Goes the last step; gives its size relative to the states.
    pub(crate) fn go(&mut self) -> f64 {
        let size = self.step_size(&self.sizes());
        self.move_by(1.0);
        size
    }

    /// Goes a part of a direction.
    pub(crate) fn go_along(&mut self, direction: &Direction<N>, part: f64) {
        self.step.clone_from(&direction.states);
        self.move_by(part);
    }

    /// Takes the states at hand for a solution; gives its discretisation error.
    pub(crate) fn accept(&mut self, model: &R) -> f64 {
        (self.cycle, self.floquet) = (None, None);
        self.path.follow(model, &self.mesh);
        self.discretisation_error(model)
    }

    /// Replaces the elements by more of them where `error` is larger than what may be missed; gives
    /// whether it is.
    ///
    /// # Errors
    /// There are too many.
    pub(crate) fn refine_to(&mut self, model: &R, error: f64, enough: f64) -> Result<bool> {
        let is_rough = error > enough;
        if is_rough {
            self.refine(model, error / enough)?;
        }
        Ok(is_rough)
    }

    /// Makes the solution one over twice the span, the second half of which follows from the first.
    pub(crate) fn unfold(&mut self, model: &R) {
        let doubled = self.mesh.unfold(model, &mut self.before);
        self.linearisation.resize::<N, R>(doubled);
    }

    /// The change at phase 0 that is the opposite of itself after the elements' span, where there is
    /// one. By the last linearisation.
    pub(crate) fn flipped(&self) -> Option<[f64; N]> {
        let monodromy: SMatrix<f64, N, N> = self.monodromy();
        let svd =
            (Matrix5::identity() + padded(&monodromy)).try_svd(false, true, f64::EPSILON, 1000)?;
        let (smallest, _) = svd.singular_values.argmin();
        let rows = svd.v_t?;
        Some(std::array::from_fn(|i| rows[(smallest, i)]))
    }
}
