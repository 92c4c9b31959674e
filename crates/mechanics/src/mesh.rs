//! Collocation mesh of a periodic motion: its elements (time steps) and their states.

use std::f64::consts::TAU;
use std::ops::Range;

use trilink_robot::{LANES, Lanes, Number};

use super::element::{Element, Stages, integrate_angles, interpolate};
use super::radau::{RADAU, STAGES};
use super::reduced::{Reduced, lanes};

/// Maximum number of elements per period.
pub(super) const MAX_ELEMENTS: usize = 512;

/// States of a mesh: at phase 0, where its first element starts, and at the stages of all elements.
#[derive(Debug, Clone)]
pub(super) struct States<const N: usize> {
    pub start: [f64; N],
    /// Packs of successive elements, one element per SIMD lane; the last pack is padded with copies of its
    /// last element.
    pub packs: Vec<Stages<N, Lanes>>,
}

impl<const N: usize> Default for States<N> {
    fn default() -> Self {
        Self { start: [0.0; N], packs: Vec::new() }
    }
}

impl<const N: usize> States<N> {
    /// Returns the state at the start of element `k`.
    pub(crate) fn start_of(&self, k: usize) -> [f64; N] {
        match k.checked_sub(1) {
            None => self.start,
            Some(before) => {
                let stages = &self.packs[before / LANES];
                stages[STAGES - 1].map(|y| y.lane(before % LANES))
            }
        }
    }

    /// Sets the states to others plus a multiple of a change.
    pub(crate) fn set_moved(&mut self, before: &Self, factor: f64, change: &Self) {
        self.start = std::array::from_fn(|i| before.start[i] + factor * change.start[i]);
        let factor = Lanes::splat(factor);
        renew(&mut self.packs, before.packs.len());
        self.packs.extend_from_slice(&before.packs);
        for (y, change) in self.packs.iter_mut().flatten().zip(change.packs.iter().flatten()) {
            (0..N).for_each(|i| y[i] += factor * change[i]);
        }
    }

    /// Returns the states at the stages of element `k`.
    pub(crate) fn stages_of(&self, k: usize) -> Stages<N> {
        self.packs[k / LANES].map(|stage| stage.map(|y| y.lane(k % LANES)))
    }

    /// Sets the states at the stages of `count` elements to those that `stages_of` returns for each element
    /// index.
    pub(crate) fn fill(&mut self, count: usize, mut stages_of: impl FnMut(usize) -> Stages<N>) {
        renew(&mut self.packs, count.div_ceil(LANES));
        for pack in 0..count.div_ceil(LANES) {
            let mut elements = [[[0.0; N]; STAGES]; LANES];
            for lane in 0..LANES {
                let k = pack * LANES + lane;
                elements[lane] = if k < count { stages_of(k) } else { elements[lane - 1] };
            }
            self.packs
                .push(std::array::from_fn(|j| lanes(elements.each_ref().map(|stages| &stages[j]))));
        }
    }
}

/// Mesh of collocation elements over one or more periods, or over half a period if the motion has half-period
/// symmetry.
#[derive(Debug, Clone)]
pub(super) struct Mesh<const N: usize, R: Reduced<N>> {
    /// Factors (1 or -1) by which the states at the end of the mesh's time span differ from those at its
    /// start; all 1 for whole periods.
    pub signs: [f64; N],
    /// Whether the elements cover half a period.
    pub is_half: bool,
    /// Number of periods that the elements cover, or 1 if they cover only half a period (`is_half`).
    pub periods: usize,
    /// Duration of the time span that all elements together cover, s.
    pub span_s: f64,
    /// Boundaries between the elements as fractions of the mesh's time span, from 0 to 1.
    pub bounds: Vec<f64>,
    /// Lengths of the elements as fractions of the mesh's time span, one element per SIMD lane.
    pub fractions: Vec<Lanes>,
    /// Durations of the elements, s, one element per SIMD lane.
    pub durations_s: Vec<Lanes>,
    /// Number of elements.
    pub count: usize,
    pub states: States<N>,
    /// Joint command at each stage of each pack of elements, one element per SIMD lane.
    nodes: Vec<R::Node<Lanes>>,
}

impl<const N: usize, R: Reduced<N>> Default for Mesh<N, R> {
    fn default() -> Self {
        Self {
            signs: [1.0; N],
            is_half: false,
            periods: 1,
            span_s: 0.0,
            bounds: Vec::new(),
            fractions: Vec::new(),
            durations_s: Vec::new(),
            count: 0,
            states: States::default(),
            nodes: Vec::new(),
        }
    }
}

impl<const N: usize, R: Reduced<N>> Mesh<N, R> {
    /// Returns the number of time spans of the mesh after which the motion repeats: 2 if the mesh covers half
    /// a period, otherwise 1.
    pub(crate) fn spans(&self) -> usize {
        if self.is_half { 2 } else { 1 }
    }

    /// Returns the phase by which the command advances over the time span of the mesh, rad.
    fn span_rad(&self) -> f64 {
        TAU * self.periods as f64 / self.spans() as f64
    }

    /// Returns the number of packs of elements; a pack has one element per SIMD lane.
    pub(crate) fn packs(&self) -> usize {
        self.count.div_ceil(LANES)
    }

    /// Returns the indices of the elements in a pack, lane by lane.
    pub(crate) fn elements_of(&self, pack: usize) -> Range<usize> {
        pack * LANES..self.count.min((pack + 1) * LANES)
    }

    /// Returns the lengths (as fractions of the mesh's time span) and the durations (s) of the elements in a
    /// pack; zero in padded lanes.
    pub(crate) fn weights(&self, pack: usize) -> [Lanes; 2] {
        let used = self.elements_of(pack).len();
        let own = Lanes::new(std::array::from_fn(|lane| if lane < used { 1.0 } else { 0.0 }));
        [self.fractions[pack] * own, self.durations_s[pack] * own]
    }

    /// Returns the joint command at the stages of the elements in a pack, one element per lane.
    #[inline(always)]
    pub(crate) fn nodes(&self, pack: usize) -> &[R::Node<Lanes>] {
        &self.nodes[pack * STAGES..][..STAGES]
    }

    /// Returns the states at the starts of the elements in a pack, one element per lane.
    #[inline(always)]
    pub(crate) fn starts(&self, pack: usize) -> [Lanes; N] {
        let last = self.elements_of(pack).end - 1;
        let starts: [[f64; N]; LANES] =
            std::array::from_fn(|lane| self.states.start_of((pack * LANES + lane).min(last)));
        lanes(starts.each_ref())
    }

    /// Returns the elements in a pack, one per lane, with the given states at their starts.
    #[inline(always)]
    pub(crate) fn pack<'a>(
        &'a self,
        pack: usize,
        start: &'a [Lanes; N],
    ) -> Element<'a, N, R, Lanes> {
        let nodes = self.nodes(pack);
        let stages = &self.states.packs[pack];
        Element { nodes, start, stages, duration_s: self.durations_s[pack] }
    }

    /// Returns the duration of element `k`, s.
    pub(crate) fn duration_s(&self, k: usize) -> f64 {
        self.durations_s[k / LANES].lane(k % LANES)
    }

    /// Returns the joint command at the time in element `k` that follows the element's start by the given fraction of
    /// the element's duration.
    pub(crate) fn node_at(&self, model: &R, k: usize, fraction: f64) -> R::Node<f64> {
        model.node(self.phase_rad(k, fraction))
    }

    /// Returns the phase at the time of [`Mesh::node_at`], rad.
    pub(crate) fn phase_rad(&self, k: usize, fraction: f64) -> f64 {
        self.span_rad() * span_position(&self.bounds, k, fraction)
    }

    /// Returns the joint command at the stages of element `k`.
    pub(crate) fn nodes_of(&self, model: &R, k: usize) -> [R::Node<f64>; STAGES] {
        RADAU.nodes.map(|node| self.node_at(model, k, node))
    }

    /// Divides the mesh's time span into `count` elements of equal length.
    pub(crate) fn divide_equally(&mut self, count: usize) {
        self.bounds.clear();
        self.bounds.reserve(MAX_ELEMENTS + 1);
        self.bounds.extend((0..=count).map(|k| k as f64 / count as f64));
    }

    /// Recomputes the mesh's time span, and the durations and joint commands of its elements, from the element bounds.
    /// The states are not updated.
    pub(crate) fn lay_out(&mut self, model: &R) {
        let span_rad = self.span_rad();
        self.count = self.bounds.len() - 1;
        self.span_s = span_rad / model.omega_rad_s();
        let packs = self.packs();
        renew(&mut self.nodes, packs * STAGES);
        renew(&mut self.fractions, packs);
        renew(&mut self.durations_s, packs);
        for pack in 0..packs {
            let elements: [usize; LANES] =
                std::array::from_fn(|lane| (pack * LANES + lane).min(self.count - 1));
            let start = Lanes::new(elements.map(|k| self.bounds[k]));
            let end = Lanes::new(elements.map(|k| self.bounds[k + 1]));
            let fraction = end - start;
            self.fractions.push(fraction);
            self.durations_s.push(fraction * Lanes::splat(self.span_s));
            self.nodes.extend(RADAU.nodes.iter().map(|node| {
                let position = start + fraction * Lanes::splat(*node);
                model.node(Lanes::splat(span_rad) * position)
            }));
        }
    }

    /// Sets the states of the elements between the current bounds by interpolating those of the elements between the
    /// bounds `before`. The old states are left in `states`.
    pub(crate) fn resample(&mut self, model: &R, before: &[f64], states: &mut States<N>) {
        std::mem::swap(states, &mut self.states);
        self.states.start = states.start;
        let bounds = &self.bounds;
        let mut old = 0;
        let of_old = |old: usize| (states.start_of(old), states.stages_of(old));
        let (mut start, mut stages) = of_old(0);
        self.states.fill(bounds.len() - 1, |k| {
            RADAU.nodes.map(|node| {
                let position = span_position(bounds, k, node);
                while old + 2 < before.len() && before[old + 1] <= position {
                    old += 1;
                    (start, stages) = of_old(old);
                }
                let fraction = (position - before[old]) / (before[old + 1] - before[old]);
                interpolate(&start, &stages, fraction)
            })
        });
        self.lay_out(model);
        self.integrate();
    }

    /// Doubles the time span of the mesh and returns the new number of elements. The states in the second half follow
    /// from those in the first by symmetry (if the mesh covered half a period) or periodicity. The old states are left
    /// in `before`.
    pub(crate) fn unfold(&mut self, model: &R, before: &mut States<N>) -> usize {
        std::mem::swap(before, &mut self.states);
        let count = self.count;
        let signs = self.signs;
        self.states.start = before.start;
        self.states.fill(2 * count, |k| {
            let stages = before.stages_of(k % count);
            if k < count {
                stages
            } else {
                stages.map(|y| std::array::from_fn(|i| signs[i] * y[i]))
            }
        });
        self.periods *= if self.is_half { 1 } else { 2 };
        self.is_half = false;
        self.signs = [1.0; N];
        self.bounds = (self.bounds.iter().chain(&self.bounds[1..]).enumerate())
            .map(|(k, bound)| 0.5 * (bound + if k > count { 1.0 } else { 0.0 }))
            .collect();
        self.lay_out(model);
        self.integrate();
        2 * count
    }

    /// Returns the state halfway through the mesh's time span.
    pub(crate) fn middle(&self) -> [f64; N] {
        let k = self.bounds.partition_point(|bound| *bound < 0.5).clamp(1, self.count) - 1;
        let [from, to] = [self.bounds[k], self.bounds[k + 1]];
        let fraction = (0.5 - from) / (to - from);
        interpolate(&self.states.start_of(k), &self.states.stages_of(k), fraction)
    }

    /// Sets the states of the elements to the model's initial guess.
    pub(crate) fn guess(&mut self, model: &R) {
        let guess = model.guess();
        let span_rad = self.span_rad();
        let bounds = &self.bounds;
        self.states.start = guess(0.0);
        self.states.fill(self.count, |k| {
            RADAU.nodes.map(|node| guess(span_rad * span_position(bounds, k, node)))
        });
        self.integrate();
    }

    /// Recomputes the angles by integrating their rates over time, if the model defines them as such integrals.
    pub(crate) fn integrate(&mut self) {
        let mut ends = self.states.start;
        for pack in 0..self.packs() {
            let count = self.elements_of(pack).len();
            let stages = &mut self.states.packs[pack];
            let zero = [Lanes::splat(0.0); N];
            integrate_angles::<N, R, Lanes>(stages, &zero, self.durations_s[pack]);
            for angle in R::UNKNOWNS..N {
                let added = stages[STAGES - 1][angle];
                let next = |at, lane: usize| at + added.lane(lane);
                let starts = accumulate_lanes(&mut ends[angle], count, next);
                stages.iter_mut().for_each(|y| y[angle] += starts);
            }
        }
    }

    /// Returns the phases `omega t` of the stages of the elements in a pack, one element per lane, rad.
    pub(crate) fn phases_rad(&self, pack: usize) -> [Lanes; STAGES] {
        let last = self.count - 1;
        let start =
            Lanes::new(std::array::from_fn(|lane| self.bounds[(pack * LANES + lane).min(last)]));
        let span_rad = Lanes::splat(self.span_rad());
        RADAU.nodes.map(|node| span_rad * (start + self.fractions[pack] * Lanes::splat(node)))
    }
}

/// Clears a vector and makes room for `count` elements, without copying those that it held.
pub(super) fn renew<T>(elements: &mut Vec<T>, count: usize) {
    elements.clear();
    if elements.capacity() < count {
        *elements = Vec::with_capacity(count.next_power_of_two());
    }
}

/// Returns the position of a point, as a fraction of the mesh's time span, given the element bounds, the
/// index `k` of the element and the fraction of that element before the point.
fn span_position(bounds: &[f64], k: usize, fraction: f64) -> f64 {
    bounds[k] + (bounds[k + 1] - bounds[k]) * fraction
}

/// Accumulates a value, initially `start`, along the first `count` lanes, and returns its value at the start of each
/// lane; further lanes repeat the last of these. `next` returns the value at the end of a lane, given that at its start
/// and the lane's index. The final value is left in `start`.
#[inline(always)]
pub(super) fn accumulate_lanes(
    start: &mut f64,
    count: usize,
    next: impl Fn(f64, usize) -> f64,
) -> Lanes {
    let mut starts = [*start; LANES];
    for lane in 0..count {
        starts[lane..].fill(*start);
        *start = next(*start, lane);
    }
    Lanes::new(starts)
}
