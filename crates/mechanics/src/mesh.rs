//! The collocation mesh of a periodic motion: its elements and the states on them.

use std::f64::consts::TAU;
use std::ops::Range;

use trilink_robot::{LANES, Lanes, Number};

use super::element::{Element, Stages, integrate_last, interpolate};
use super::radau::{RADAU, STAGES};
use super::reduced::{Reduced, lanes};

/// Most elements of a period.
pub(super) const MOST_ELEMENTS: usize = 512;

/// The state at phase 0 and those at the elements' stages.
#[derive(Debug, Clone)]
pub(super) struct States<const N: usize> {
    pub start: [f64; N],
    /// Packs of elements that follow each other, one in each lane; where there are too few for the
    /// last pack, its last is there again.
    pub packs: Vec<Stages<N, Lanes>>,
}

impl<const N: usize> Default for States<N> {
    fn default() -> Self {
        Self { start: [0.0; N], packs: Vec::new() }
    }
}

impl<const N: usize> States<N> {
    /// State where element `k` starts.
    pub(crate) fn start_of(&self, k: usize) -> [f64; N] {
        match k.checked_sub(1) {
            None => self.start,
            Some(before) => {
                let stages = &self.packs[before / LANES];
                stages[STAGES - 1].map(|y| y.lane(before % LANES))
            }
        }
    }

    /// States at the stages of element `k`.
    pub(crate) fn stages_of(&self, k: usize) -> Stages<N> {
        self.packs[k / LANES].map(|stage| stage.map(|y| y.lane(k % LANES)))
    }

    /// Fills the packs with `count` elements.
    pub(crate) fn fill(&mut self, count: usize, mut stages_of: impl FnMut(usize) -> Stages<N>) {
        self.packs.clear();
        for pack in 0..count.div_ceil(LANES) {
            let mut elements = [[[0.0; N]; STAGES]; LANES];
            for lane in 0..LANES {
                let k = pack * LANES + lane;
                elements[lane] = if k < count { stages_of(k) } else { elements[lane - 1] };
            }
            let stage = |j: usize| lanes(elements.each_ref().map(|stages| &stages[j]));
            self.packs.push(std::array::from_fn(stage));
        }
    }
}

/// Elements over a period, or over half of it where the mirror image of the motion follows.
#[derive(Debug, Clone)]
pub(super) struct Mesh<const N: usize, R: Reduced<N>> {
    /// Signs of the states at the end relative to the start; all 1 for a whole period.
    pub signs: [f64; N],
    /// Whether the elements cover half a period.
    pub is_half: bool,
    /// Periods that the elements cover where they do not cover half of one.
    pub periods: usize,
    /// Duration of that.
    pub span_s: f64,
    /// Parts of it after which the elements start, and 1.
    pub bounds: Vec<f64>,
    /// The elements' parts of it, and their durations.
    pub parts: Vec<Lanes>,
    pub durations_s: Vec<Lanes>,
    /// Number of elements.
    pub count: usize,
    pub states: States<N>,
    /// The command at every stage of every pack.
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
            parts: Vec::new(),
            durations_s: Vec::new(),
            count: 0,
            states: States::default(),
            nodes: Vec::new(),
        }
    }
}

impl<const N: usize, R: Reduced<N>> Mesh<N, R> {
    /// How many times the elements' span makes a period, or more of them.
    pub(crate) fn spans(&self) -> usize {
        if self.is_half { 2 } else { 1 }
    }

    /// Phase of the command that the elements cover.
    fn span_rad(&self) -> f64 {
        TAU * self.periods as f64 / self.spans() as f64
    }

    /// Number of packs.
    pub(crate) fn packs(&self) -> usize {
        self.count.div_ceil(LANES)
    }

    /// The elements of a pack, the first in its first lane.
    pub(crate) fn elements_of(&self, pack: usize) -> Range<usize> {
        pack * LANES..self.count.min((pack + 1) * LANES)
    }

    /// Parts of the span and durations of the elements of a pack; zero in the lanes without an
    /// element of their own.
    pub(crate) fn weights(&self, pack: usize) -> [Lanes; 2] {
        let used = self.elements_of(pack).len();
        let own = Lanes::new(std::array::from_fn(|lane| if lane < used { 1.0 } else { 0.0 }));
        [self.parts[pack] * own, self.durations_s[pack] * own]
    }

    /// The command at the stages of the elements of a pack, one in each lane.
    #[inline(always)]
    pub(crate) fn nodes(&self, pack: usize) -> &[R::Node<Lanes>] {
        &self.nodes[pack * STAGES..][..STAGES]
    }

    /// States where the elements of a pack start.
    #[inline(always)]
    pub(crate) fn starts(&self, pack: usize) -> [Lanes; N] {
        let last = self.elements_of(pack).end - 1;
        let starts: [[f64; N]; LANES] =
            std::array::from_fn(|lane| self.states.start_of((pack * LANES + lane).min(last)));
        lanes(starts.each_ref())
    }

    /// The elements of a pack, one in each lane, which start in these states.
    #[inline(always)]
    pub(crate) fn pack<'a>(
        &'a self,
        pack: usize,
        start: &'a [Lanes; N],
    ) -> Element<'a, N, R, Lanes> {
        let (nodes, stages) = (self.nodes(pack), &self.states.packs[pack]);
        Element { nodes, start, stages, duration_s: self.durations_s[pack] }
    }

    /// Duration of element `k`.
    pub(crate) fn duration_s(&self, k: usize) -> f64 {
        self.durations_s[k / LANES].lane(k % LANES)
    }

    /// The command at a fraction of element `k`.
    pub(crate) fn node_at(&self, model: &R, k: usize, fraction: f64) -> R::Node<f64> {
        model.node(self.span_rad() * part_at(&self.bounds, k, fraction))
    }

    /// The command at the stages of element `k`.
    pub(crate) fn nodes_of(&self, model: &R, k: usize) -> [R::Node<f64>; STAGES] {
        RADAU.nodes.map(|node| self.node_at(model, k, node))
    }

    /// Makes the elements equally long.
    pub(crate) fn divide(&mut self, count: usize) {
        self.bounds.clear();
        self.bounds.reserve(MOST_ELEMENTS + 1);
        self.bounds.extend((0..=count).map(|k| k as f64 / count as f64));
    }

    /// Lays out the commands of the elements between the bounds; their states are left to the caller.
    pub(crate) fn lay_out(&mut self, model: &R) {
        let span_rad = self.span_rad();
        self.count = self.bounds.len() - 1;
        self.span_s = span_rad / model.problem().omega_rad_s;
        self.nodes.clear();
        self.parts.clear();
        self.durations_s.clear();
        for pack in 0..self.packs() {
            let of = |lane: usize| (pack * LANES + lane).min(self.count - 1);
            let [start, end] = [0, 1]
                .map(|after| Lanes::new(std::array::from_fn(|lane| self.bounds[of(lane) + after])));
            let part = end - start;
            self.parts.push(part);
            self.durations_s.push(part * Lanes::splat(self.span_s));
            for node in RADAU.nodes {
                let part = start + part * Lanes::splat(node);
                self.nodes.push(model.node(Lanes::splat(span_rad) * part));
            }
        }
    }

    /// Replaces the elements, which were between the bounds `before`, by those between the present
    /// ones with the same polynomials. The old states are left in `states`.
    pub(crate) fn resample(&mut self, model: &R, before: &[f64], states: &mut States<N>) {
        std::mem::swap(states, &mut self.states);
        self.states.start = states.start;
        let (bounds, mut old) = (&self.bounds, 0);
        self.states.fill(bounds.len() - 1, |k| {
            RADAU.nodes.map(|node| {
                let part = part_at(bounds, k, node);
                while old + 2 < before.len() && before[old + 1] <= part {
                    old += 1;
                }
                let fraction = (part - before[old]) / (before[old + 1] - before[old]);
                interpolate(&states.start_of(old), &states.stages_of(old), fraction)
            })
        });
        self.lay_out(model);
        self.integrate();
    }

    /// Covers twice as much, of which the second half follows from the first; gives the number of
    /// elements. The old states are left in `before`.
    pub(crate) fn unfold(&mut self, model: &R, before: &mut States<N>) -> usize {
        std::mem::swap(before, &mut self.states);
        let (count, signs) = (self.count, self.signs);
        let later = |y: [f64; N]| std::array::from_fn(|i| signs[i] * y[i]);
        self.states.start = before.start;
        self.states.fill(2 * count, |k| {
            let stages = before.stages_of(k % count);
            if k < count { stages } else { stages.map(later) }
        });
        self.periods *= if self.is_half { 1 } else { 2 };
        (self.is_half, self.signs) = (false, [1.0; N]);
        let doubled = self.bounds.iter().chain(self.bounds[1..].iter());
        let doubled: Vec<f64> = doubled
            .enumerate()
            .map(|(k, bound)| 0.5 * (bound + if k > count { 1.0 } else { 0.0 }))
            .collect();
        self.bounds = doubled;
        self.lay_out(model);
        self.integrate();
        2 * count
    }

    /// The state half way through the elements' span.
    pub(crate) fn middle(&self) -> [f64; N] {
        let k = self.bounds.partition_point(|bound| *bound < 0.5).clamp(1, self.count) - 1;
        let [from, to] = [self.bounds[k], self.bounds[k + 1]];
        let fraction = (0.5 - from) / (to - from);
        interpolate(&self.states.start_of(k), &self.states.stages_of(k), fraction)
    }

    /// Fills the elements that are laid out with the model's guess.
    pub(crate) fn guess(&mut self, model: &R) {
        let (guess, span_rad, bounds) = (model.guess(), self.span_rad(), &self.bounds);
        let at = |k: usize, node: f64| guess(span_rad * part_at(bounds, k, node));
        self.states.start = guess(0.0);
        self.states.fill(self.count, |k| RADAU.nodes.map(|node| at(k, node)));
        self.integrate();
    }

    /// Makes an integrated state the integral that it is.
    pub(crate) fn integrate(&mut self) {
        if R::INTEGRATED {
            let mut start = self.states.start[N - 1];
            for pack in 0..self.packs() {
                let count = self.elements_of(pack).len();
                let stages = &mut self.states.packs[pack];
                integrate_last(stages, Lanes::splat(0.0), self.durations_s[pack]);
                let added = stages[STAGES - 1][N - 1];
                let starts = in_turn(&mut start, count, |at, lane| at + added.lane(lane));
                stages.iter_mut().for_each(|y| y[N - 1] += starts);
            }
        }
    }
}

/// The part of the span after which a fraction of element `k` between these bounds is over.
fn part_at(bounds: &[f64], k: usize, fraction: f64) -> f64 {
    bounds[k] + (bounds[k + 1] - bounds[k]) * fraction
}

/// Where each of the first `count` lanes starts, each where the one before it ends, which is `next`;
/// the others repeat the last of them. Leaves its end in `start`.
#[inline(always)]
pub(super) fn in_turn(start: &mut f64, count: usize, next: impl Fn(f64, usize) -> f64) -> Lanes {
    let mut starts = [*start; LANES];
    for lane in 0..count {
        starts[lane..].fill(*start);
        *start = next(*start, lane);
    }
    Lanes::new(starts)
}
