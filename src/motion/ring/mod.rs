//! Steady periodic motion by collocation on a closed chain of elements.
//!
//! The period (half of it, where the mirror image of the motion must follow) is cut into
//! elements of Radau IIA collocation. Newton's method linearises all of them; each is condensed
//! to how its end answers to its start, and an `N x N` system closes the chain. The product of
//! the ends' answers is the monodromy matrix, whose eigenvalues are the Floquet multipliers.
//! Work and storage grow in proportion to the number of elements.
//!
//! A few coarse elements bring Newton's method near; the end of their polynomials' spectra tells
//! how many elements the accuracy asks for. The factors are kept as long as steps by them shrink
//! fast.

mod newton;
mod resolution;

use std::f64::consts::TAU;

use nalgebra::SMatrix;

use super::MotionError;
use super::cycle::{Cycle, measure};
use super::element::{Linearised, Stages, follow_element, integrate_last, interpolate};
use super::radau::{RADAU, STAGES};
use super::reduced::{Driven, Reduced};

/// The ring's start and its elements' stages.
#[derive(Debug, Clone)]
struct States<const N: usize> {
    start: [f64; N],
    elements: Vec<Stages<N>>,
}

impl<const N: usize> Default for States<N> {
    fn default() -> Self {
        Self { start: [0.0; N], elements: Vec::new() }
    }
}

impl<const N: usize> States<N> {
    /// State where element `k` starts.
    fn start_of(&self, k: usize) -> &[f64; N] {
        if k == 0 { &self.start } else { &self.elements[k - 1][STAGES - 1] }
    }
}

/// A periodic motion and the room to solve for it, which is used again by the next solution.
#[derive(Debug, Clone)]
pub(super) struct Ring<const N: usize, R: Reduced<N>> {
    /// Signs of the states at the end relative to the start; all 1 for a whole period.
    signs: [f64; N],
    /// Whether the elements cover half a period.
    is_half: bool,
    element_s: f64,
    now: States<N>,
    nodes: Vec<R::Node>,
    /// Newton steps of the last solution.
    steps: usize,
    /// The step after a fresh one as a part of that one's square, when last seen.
    bend: f64,
    linearised: Linearised,
    /// Inverse of the matrix that closes the chain.
    closing: SMatrix<f64, N, N>,
    /// The last step by the factors at hand, and the one before.
    step: States<N>,
    last_step: States<N>,
    /// The states before a step, or coarser ones.
    before: States<N>,
    /// Room for single elements.
    room: Linearised,
    /// What the last solution misses as a part of what it may; infinite if there is none.
    missed_part: f64,
    /// What was measured of the solution.
    cycle: Option<Cycle>,
}

/// Where Newton's method starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Start<const N: usize> {
    /// The robot at rest all the time.
    Rest,
    /// The last solution of this ring, if there is one.
    Last,
    /// The motion that follows from a state at phase 0.
    State([f64; N]),
}

/// Elements per period at first, and in the end at least and at most.
const COARSE: usize = 6;
const FEWEST: usize = 8;
const MOST_ELEMENTS: usize = 512;
/// By how much finer the first elements are when a motion from a state fails with coarse ones.
const FINER: [usize; 3] = [1, 4, 16];
/// Relative step at which the coarse elements' solution is good enough to go on from.
const COARSE_STEP: f64 = 0.02;
/// Elements are laid out for this part of what they may miss.
const MARGIN: f64 = 0.4;
/// A solution that could do with this part of its neighbour's elements gets fewer.
const FEWER: f64 = 0.9;

impl<const N: usize, R: Reduced<N>> Default for Ring<N, R> {
    fn default() -> Self {
        Self {
            signs: [1.0; N],
            is_half: false,
            element_s: 0.0,
            now: States::default(),
            nodes: Vec::new(),
            steps: 0,
            bend: 1.0,
            linearised: Linearised::default(),
            closing: SMatrix::zeros(),
            step: States::default(),
            last_step: States::default(),
            before: States::default(),
            room: Linearised::default(),
            missed_part: f64::INFINITY,
            cycle: None,
        }
    }
}

impl<const N: usize, R: Reduced<N>> Ring<N, R> {
    /// Finds the periodic solution near `start` with as many elements as the relative
    /// `accuracy` of the metrics takes.
    pub fn solve(
        &mut self,
        model: &R,
        omega_rad_s: f64,
        start: Start<N>,
        accuracy: f64,
    ) -> Result<(), MotionError> {
        let missed_part = std::mem::replace(&mut self.missed_part, f64::INFINITY);
        self.cycle = None;
        let signs = model.half_period_signs();
        let goes_on =
            start == Start::Last && missed_part.is_finite() && self.is_half == signs.is_some();
        self.is_half = signs.is_some();
        self.signs = signs.unwrap_or([1.0; N]);
        (self.steps, self.bend) = (0, 1.0);
        if goes_on {
            self.go_on(model, omega_rad_s, missed_part);
        } else {
            self.begin(model, omega_rad_s, start)?;
            let missed_part = self.missed_part(model, accuracy);
            self.refine(model, omega_rad_s, missed_part)?;
        }
        loop {
            self.newton(model, accuracy)?;
            let missed_part = self.missed_part(model, accuracy);
            if missed_part <= 1.0 {
                self.missed_part = missed_part;
                return Ok(());
            }
            self.refine(model, omega_rad_s, missed_part)?;
        }
    }

    /// Finds an approximate solution with few elements.
    fn begin(&mut self, model: &R, omega_rad_s: f64, start: Start<N>) -> Result<(), MotionError> {
        let coarse = COARSE / self.parts();
        let Start::State(state) = start else {
            self.lay_nodes(model, omega_rad_s, coarse);
            self.now.start = model.at_rest();
            self.now.elements.clear();
            self.now.elements.resize(coarse, [self.now.start; STAGES]);
            self.integrate();
            return self.newton(model, COARSE_STEP);
        };
        let mut tried = Ok(());
        for finer in FINER {
            self.lay_nodes(model, omega_rad_s, finer * coarse);
            tried = self.march(model, state).and_then(|()| self.newton(model, COARSE_STEP));
            if tried.is_ok() {
                break;
            }
        }
        tried
    }

    /// Makes the last solution, which missed `missed_part` of what it could, the start for
    /// another frequency.
    fn go_on(&mut self, model: &R, omega_rad_s: f64, missed_part: f64) {
        let before_s = self.element_s * self.now.elements.len() as f64;
        let enough = self.enough_elements(missed_part);
        if (enough as f64) < FEWER * self.now.elements.len() as f64 {
            self.resample(enough);
        }
        self.lay_nodes(model, omega_rad_s, self.now.elements.len());
        // Velocities go with the frequency, the passive joint's angle does not.
        let faster = before_s / (self.element_s * self.now.elements.len() as f64);
        let rates = if R::HAS_ANGLE { N - 1 } else { N };
        let states = self.now.elements.iter_mut().flatten().chain([&mut self.now.start]);
        states.for_each(|y| y[..rates].iter_mut().for_each(|rate| *rate *= faster));
        self.integrate();
    }

    /// Parts of a period of which the elements cover one.
    pub fn parts(&self) -> usize {
        if self.is_half { 2 } else { 1 }
    }

    /// Elements that miss only what they may, where those at hand miss `missed_part` of it.
    fn enough_elements(&self, missed_part: f64) -> usize {
        let fewest = FEWEST / self.parts();
        // By the rule's order.
        let growth = (missed_part / MARGIN).powf(1.0 / (2.0 * STAGES as f64 - 1.0)).min(4.0);
        ((self.now.elements.len() as f64 * growth).ceil() as usize).max(fewest)
    }

    /// Replaces the elements by as many as are needed, if those at hand miss too much.
    fn refine(&mut self, model: &R, omega_rad_s: f64, missed_part: f64) -> Result<(), MotionError> {
        let fewest = FEWEST / self.parts();
        if missed_part <= 1.0 && self.now.elements.len() >= fewest {
            return Ok(());
        }
        let most = MOST_ELEMENTS / self.parts();
        let count = self.now.elements.len();
        if count >= most || !missed_part.is_finite() {
            return Err(MotionError::Unresolved { missed: self.missed(model) });
        }
        let finer = self.enough_elements(missed_part).clamp(count + 1, most);
        self.resample(finer);
        self.lay_nodes(model, omega_rad_s, finer);
        self.integrate();
        Ok(())
    }

    /// Replaces the elements by `wanted` others with the same polynomials.
    fn resample(&mut self, wanted: usize) {
        std::mem::swap(&mut self.before, &mut self.now);
        let (from, to) = (&self.before, &mut self.now);
        let count = from.elements.len();
        to.start = from.start;
        to.elements.clear();
        for k in 0..wanted {
            let at = |j: usize| {
                let position = (k as f64 + RADAU.nodes[j]) / wanted as f64 * count as f64;
                let k = (position as usize).min(count - 1);
                interpolate(from.start_of(k), &from.elements[k], position - k as f64)
            };
            to.elements.push(std::array::from_fn(at));
        }
    }

    /// Lays out the nodes of `count` elements and room for them.
    fn lay_nodes(&mut self, model: &R, omega_rad_s: f64, count: usize) {
        let span = TAU / self.parts() as f64;
        self.element_s = span / omega_rad_s / count as f64;
        self.nodes.clear();
        for k in 0..count {
            for node in RADAU.nodes {
                self.nodes.push(model.node(span * (k as f64 + node) / count as f64));
            }
        }
        self.linearised.resize::<N, R>(count);
    }

    /// Makes an integrated state the integral that it is.
    fn integrate(&mut self) {
        if R::INTEGRATED {
            let mut start = self.now.start[N - 1];
            for stages in &mut self.now.elements {
                integrate_last(stages, start, self.element_s);
                start = stages[STAGES - 1][N - 1];
            }
        }
    }

    /// Fills the elements with the motion that follows from a state.
    fn march(&mut self, model: &R, state: [f64; N]) -> Result<(), MotionError> {
        self.now.start = state;
        self.now.elements.clear();
        let mut from = state;
        let element_s = self.element_s;
        for (k, nodes) in self.nodes.chunks_exact(STAGES).enumerate() {
            let room = &mut self.linearised;
            let guess = [from; STAGES];
            let stages = follow_element(model, nodes, &from, element_s, &guess, 1e-4, room)
                .ok_or(MotionError::Stuck { time_s: k as f64 * element_s })?;
            self.now.elements.push(stages);
            from = stages[STAGES - 1];
        }
        Ok(())
    }

    /// State at phase 0.
    pub fn start(&self) -> [f64; N] {
        self.now.start
    }

    /// Signs of the states at the end relative to the start.
    pub fn signs(&self) -> &[f64; N] {
        &self.signs
    }

    /// Whether the elements cover half a period.
    pub fn is_half(&self) -> bool {
        self.is_half
    }

    /// Duration of one element, s.
    pub fn element_s(&self) -> f64 {
        self.element_s
    }

    /// Newton steps of the last solution.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.now.elements.len()
    }

    /// What a cycle of the solution amounts to.
    pub fn measure(&mut self, model: &R, driven: &Driven) -> Cycle {
        if let Some(cycle) = self.cycle {
            return cycle;
        }
        let mut room = self.take_room();
        let cycle = measure(model, driven, self, &mut room);
        self.give_room(room);
        *self.cycle.insert(cycle)
    }

    /// Lends room for single elements; give it back with [`Ring::give_room`].
    pub fn take_room(&mut self) -> Linearised {
        std::mem::take(&mut self.room)
    }

    /// Takes the room back.
    pub fn give_room(&mut self, room: Linearised) {
        self.room = room;
    }

    /// Nodes, start and stages of element `k`.
    pub fn element(&self, k: usize) -> (&[R::Node], &[f64; N], &Stages<N>) {
        let nodes = &self.nodes[k * STAGES..][..STAGES];
        (nodes, self.now.start_of(k), &self.now.elements[k])
    }
}
