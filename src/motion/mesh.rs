//! The collocation mesh of a periodic motion: its elements and the states on them.

use std::f64::consts::TAU;

use super::element::{Element, Stages, integrate_last, interpolate};
use super::radau::{RADAU, STAGES};
use super::reduced::{Reduced, lanes};
use crate::robot::{LANES, Lanes};

/// The state at phase 0 and those at the elements' stages.
#[derive(Debug, Clone)]
pub(super) struct States<const N: usize> {
    pub start: [f64; N],
    pub elements: Vec<Stages<N>>,
}

impl<const N: usize> Default for States<N> {
    fn default() -> Self {
        Self { start: [0.0; N], elements: Vec::new() }
    }
}

impl<const N: usize> States<N> {
    /// State where element `k` starts.
    pub fn start_of(&self, k: usize) -> &[f64; N] {
        if k == 0 { &self.start } else { &self.elements[k - 1][STAGES - 1] }
    }
}

/// Elements of equal length over a period, or over half of it where the mirror image of the
/// motion follows.
#[derive(Debug, Clone)]
pub(super) struct Mesh<const N: usize, R: Reduced<N>> {
    /// Signs of the states at the end relative to the start; all 1 for a whole period.
    pub signs: [f64; N],
    /// Whether the elements cover half a period.
    pub is_half: bool,
    /// Duration of one element.
    pub element_s: f64,
    pub states: States<N>,
    /// The command at every stage.
    pub nodes: Vec<R::Node<f64>>,
    /// The same in packs, see [`Mesh::pack`].
    packed: Vec<R::Node<Lanes>>,
}

impl<const N: usize, R: Reduced<N>> Default for Mesh<N, R> {
    fn default() -> Self {
        Self {
            signs: [1.0; N],
            is_half: false,
            element_s: 0.0,
            states: States::default(),
            nodes: Vec::new(),
            packed: Vec::new(),
        }
    }
}

impl<const N: usize, R: Reduced<N>> Mesh<N, R> {
    /// Number of elements.
    pub fn len(&self) -> usize {
        self.states.elements.len()
    }

    /// How many times the elements' span makes a period.
    pub fn spans(&self) -> usize {
        if self.is_half { 2 } else { 1 }
    }

    /// Element `k`.
    #[inline(always)]
    pub fn element(&self, k: usize) -> Element<'_, N, R> {
        Element {
            nodes: &self.nodes[k * STAGES..][..STAGES],
            start: self.states.start_of(k),
            stages: &self.states.elements[k],
            duration_s: self.element_s,
        }
    }

    /// The elements in their order.
    pub fn elements(&self) -> impl Iterator<Item = Element<'_, N, R>> {
        (0..self.len()).map(|k| self.element(k))
    }

    /// Number of packs.
    pub fn packs(&self) -> usize {
        self.len().div_ceil(LANES)
    }

    /// Which element is in a lane of a pack; where there are too few, the last is there again.
    fn in_lane(&self, pack: usize, lane: usize) -> usize {
        (pack * LANES + lane).min(self.len() - 1)
    }

    /// States at the start and the stages of the elements of a pack, one in each lane.
    #[inline(always)]
    pub fn packed_states(&self, pack: usize) -> ([Lanes; N], Stages<N, Lanes>) {
        let elements: [usize; LANES] = std::array::from_fn(|lane| self.in_lane(pack, lane));
        let stages = elements.map(|k| &self.states.elements[k]);
        let mut packed = [[Lanes::default(); N]; STAGES];
        for j in 0..STAGES {
            packed[j] = lanes(stages.map(|stages| &stages[j]));
        }
        (lanes(elements.map(|k| self.states.start_of(k))), packed)
    }

    /// The elements of a pack, one in each lane, in these states.
    #[inline(always)]
    pub fn pack<'a>(
        &'a self,
        pack: usize,
        (start, stages): &'a ([Lanes; N], Stages<N, Lanes>),
    ) -> Element<'a, N, R, Lanes> {
        let nodes = &self.packed[pack * STAGES..][..STAGES];
        Element { nodes, start, stages, duration_s: self.element_s }
    }

    /// The command at a fraction of element `k`.
    pub fn node_at(&self, model: &R, k: usize, fraction: f64) -> R::Node<f64> {
        model.node(model.problem().omega_rad_s * self.element_s * (k as f64 + fraction))
    }

    /// Lays out the commands of `count` elements; their states are left to the caller.
    pub fn lay_out(&mut self, model: &R, count: usize) {
        let span = TAU / self.spans() as f64;
        self.element_s = span / model.problem().omega_rad_s / count as f64;
        self.nodes.clear();
        for k in 0..count {
            for node in RADAU.nodes {
                self.nodes.push(model.node(span * (k as f64 + node) / count as f64));
            }
        }
        self.packed.clear();
        for pack in 0..count.div_ceil(LANES) {
            for j in 0..STAGES {
                let of = |lane: usize| (pack * LANES + lane).min(count - 1) * STAGES + j;
                self.packed.push(R::pack(std::array::from_fn(|lane| &self.nodes[of(lane)])));
            }
        }
    }

    /// Replaces the elements by `wanted` others with the same polynomials. The old states are
    /// left in `before`.
    pub fn resample(&mut self, wanted: usize, before: &mut States<N>) {
        std::mem::swap(before, &mut self.states);
        let count = before.elements.len();
        self.states.start = before.start;
        self.states.elements.clear();
        for k in 0..wanted {
            let at = |j: usize| {
                let position = (k as f64 + RADAU.nodes[j]) / wanted as f64 * count as f64;
                let k = (position as usize).min(count - 1);
                interpolate(before.start_of(k), &before.elements[k], position - k as f64)
            };
            self.states.elements.push(std::array::from_fn(at));
        }
    }

    /// Fills the elements that are laid out with the model's guess.
    pub fn guess(&mut self, model: &R) {
        let (guess, states) = (model.guess(), &mut self.states);
        let count = self.nodes.len() / STAGES;
        let span = TAU / if self.is_half { 2.0 } else { 1.0 };
        let at = |k: usize, node: f64| guess(span * (k as f64 + node) / count as f64);
        states.start = guess(0.0);
        states.elements.clear();
        states.elements.extend((0..count).map(|k| RADAU.nodes.map(|node| at(k, node))));
        self.integrate();
    }

    /// Makes an integrated state the integral that it is.
    pub fn integrate(&mut self) {
        if R::INTEGRATED {
            let mut start = self.states.start[N - 1];
            for stages in &mut self.states.elements {
                integrate_last(stages, start, self.element_s);
                start = stages[STAGES - 1][N - 1];
            }
        }
    }
}
