//! Steady periodic motion by collocation on a closed chain of elements.
//!
//! The period (half of it, where the mirror image of the motion must follow) is cut into
//! elements of Radau IIA collocation. Newton's method linearises all of them; each is condensed
//! to how its end answers to its start, and an `N x N` system closes the chain. The product of
//! the ends' answers is the monodromy matrix, whose eigenvalues are the Floquet multipliers.
//! Work and storage grow in proportion to the number of elements.
//!
//! A few coarse elements bring Newton's method near; what is left of their polynomials' spectra
//! tells how many elements the accuracy asks for. The factors are kept as long as steps with
//! them shrink fast.

use std::f64::consts::TAU;

use nalgebra::{Matrix5, SMatrix, SVector};

use super::MotionError;
use super::cycle::{Cycle, measure};
use super::element::{
    Linearised, Stages, follow_element, integrate_last, interpolate, lower_tail, tail,
};
use super::path::{Pose, advance};
use super::radau::{RADAU, STAGES};
use super::reduced::{Driven, Moment, Reduced};

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
const MOST_STEPS: usize = 60;
/// Newton gives up when steps do not shrink along this part of one.
const LEAST_PART: f64 = 1.0 / 512.0;
/// Factors are kept while a step is at most this part of the one before.
const FAST: f64 = 0.15;
/// Steps below this size are rounding: whether they shrink cannot be judged.
const ROUNDING: f64 = 1e-9;
/// By how much what is left may be larger than what was seen lets expect.
const SAFETY: f64 = 10.0;
/// Part of the accuracy that the elements may miss.
const MISSED: f64 = 0.5;
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
    fn parts(&self) -> usize {
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

    fn not_converged(&self) -> MotionError {
        MotionError::NotConverged { steps: self.steps }
    }

    /// Linearises the chain at the present states and prepares its closing.
    fn linearise(&mut self, model: &R) -> Result<(), MotionError> {
        for (k, nodes) in self.nodes.chunks_exact(STAGES).enumerate() {
            let (start, stages) = (self.now.start_of(k), &self.now.elements[k]);
            self.linearised
                .linearise(k, model, nodes, start, stages, self.element_s)
                .ok_or(MotionError::NotConverged { steps: self.steps })?;
        }
        let open = SMatrix::<f64, N, N>::identity() - self.monodromy();
        self.closing = open.try_inverse().ok_or(self.not_converged())?;
        Ok(())
    }

    /// Evaluates the residuals at the present states; the factors are kept.
    fn evaluate(&mut self, model: &R) {
        for (k, nodes) in self.nodes.chunks_exact(STAGES).enumerate() {
            let (start, stages) = (self.now.start_of(k), &self.now.elements[k]);
            self.linearised.evaluate(k, model, nodes, start, stages, self.element_s);
        }
    }

    /// How a state answers to a change at the start, one turn of the ring later.
    fn monodromy(&self) -> SMatrix<f64, N, N> {
        SMatrix::from_columns(&std::array::from_fn::<_, N, _>(|m| {
            let mut x: [f64; N] = std::array::from_fn(|i| if i == m { 1.0 } else { 0.0 });
            for k in 0..self.now.elements.len() {
                x = self.linearised.end_change::<N, R>(k, &x, self.element_s, false);
            }
            SVector::from_fn(|i, _| self.signs[i] * x[i])
        }))
    }

    /// Solves the closed chain for the residuals at hand, into `step`.
    fn close(&mut self) {
        let count = self.now.elements.len();
        let mut offset = [0.0; N];
        for k in 0..count {
            self.linearised.solve_step::<N, R>(k);
            offset = self.linearised.end_change::<N, R>(k, &offset, self.element_s, true);
        }
        let end = self.now.start_of(count);
        let mismatch = |i: usize| self.signs[i] * (offset[i] + end[i]) - self.now.start[i];
        let first = self.closing * SVector::<f64, N>::from_fn(|i, _| mismatch(i));
        self.step.start = first.into();
        let mut start = self.step.start;
        self.step.elements.clear();
        for k in 0..count {
            let changes = self.linearised.changes::<N, R>(k, &start, self.element_s);
            start = changes[STAGES - 1];
            self.step.elements.push(changes);
        }
    }

    /// Newton's method until what is left is below `accuracy`, relative to the states. A step is
    /// damped until the next one by the same factors is shorter (natural monotonicity, which
    /// does not depend on how the equations are scaled), and the factors are kept while steps
    /// by them shrink fast.
    ///
    /// Reference: P. Deuflhard, *Newton Methods for Nonlinear Problems*, Springer 2004,
    /// section 3.3.
    fn newton(&mut self, model: &R, accuracy: f64) -> Result<(), MotionError> {
        let enough = 0.3 * accuracy;
        let mut first_part = 1.0;
        while self.steps < MOST_STEPS {
            self.linearise(model)?;
            self.close();
            let sizes = self.sizes();
            let mut size = self.step_size(&sizes);
            if !size.is_finite() {
                return Err(self.not_converged());
            }
            let is_last = SAFETY * self.bend * size * size <= enough;
            let mut part = first_part;
            let mut next_size = loop {
                self.move_by(if is_last { 1.0 } else { part });
                if is_last {
                    return Ok(());
                }
                let next_size = self.next_step(model, &sizes);
                if next_size < (1.0 - 0.25 * part) * size || size < ROUNDING {
                    break next_size;
                }
                // Back, and on by less.
                std::mem::swap(&mut self.step, &mut self.last_step);
                std::mem::swap(&mut self.now, &mut self.before);
                part *= 0.5;
                if part < LEAST_PART {
                    return Err(self.not_converged());
                }
            };
            first_part = f64::min(1.0, 2.0 * part);
            if part == 1.0 {
                self.bend = next_size / (size * size);
            }
            while part == 1.0 && next_size < FAST * size && self.steps < MOST_STEPS {
                let shrinks = next_size / size;
                size = next_size;
                self.move_by(1.0);
                if shrinks * size <= enough {
                    return Ok(());
                }
                next_size = self.next_step(model, &sizes);
            }
        }
        Err(self.not_converged())
    }

    /// The step from the present states by the factors at hand, and its size.
    fn next_step(&mut self, model: &R, sizes: &[f64; N]) -> f64 {
        self.evaluate(model);
        std::mem::swap(&mut self.step, &mut self.last_step);
        self.close();
        let size = self.step_size(sizes);
        if size.is_finite() { size } else { f64::INFINITY }
    }

    /// Goes a part of `step`; where it comes from is left in `before`.
    fn move_by(&mut self, part: f64) {
        self.steps += 1;
        std::mem::swap(&mut self.before, &mut self.now);
        let (now, before, step) = (&mut self.now, &self.before, &self.step);
        now.start = std::array::from_fn(|i| before.start[i] + part * step.start[i]);
        now.elements.clear();
        now.elements.extend(before.elements.iter().zip(&step.elements).map(|(before, step)| {
            std::array::from_fn(|j| std::array::from_fn(|i| before[j][i] + part * step[j][i]))
        }));
    }

    /// Largest value of each state before or after a step.
    fn sizes(&self) -> [f64; N] {
        let mut sizes = [0.0_f64; N];
        for (y, step) in self.now.elements.iter().flatten().zip(self.step.elements.iter().flatten())
        {
            for i in 0..N {
                sizes[i] = sizes[i].max(y[i].abs()).max((y[i] + step[i]).abs());
            }
        }
        sizes
    }

    /// Largest step of any state over that state's size.
    fn step_size(&self, sizes: &[f64; N]) -> f64 {
        let mut steps = [0.0_f64; N];
        for step in self.step.elements.iter().flatten() {
            for i in 0..N {
                // Not `max`, which passes over NaN.
                steps[i] = if step[i].abs() <= steps[i] { steps[i] } else { step[i].abs() };
            }
        }
        largest_ratio(&steps, sizes)
    }

    /// Relative size, in the order of magnitude, of what the ends of the elements miss of the
    /// velocities, in the world's frame, and angles.
    ///
    /// The elements' polynomials miss about as much as their highest coefficient, the ends, where
    /// the rule is of nearly twice the order, only what comes four degrees later; the fall of the
    /// spectrum over the last two degrees tells how little that is.
    fn missed(&self, model: &R) -> f64 {
        let (mut tails, mut lower) = ([0.0_f64; 7], [0.0_f64; 7]);
        let mut sizes = [0.0_f64; 7];
        let moment = model.moment(&model.node(0.0), &self.now.start);
        let (mut start, mut pose) = (in_the_world(&moment, 0.0), Pose::default());
        for (nodes, stages) in self.nodes.chunks_exact(STAGES).zip(&self.now.elements) {
            let moments = std::array::from_fn(|j| model.moment(&nodes[j], &stages[j]));
            let poses = advance(pose, &moments, self.element_s);
            pose = poses[STAGES - 1];
            let values: Stages<7> =
                std::array::from_fn(|j| in_the_world(&moments[j], poses[j].theta_rad));
            let (found, found_lower) = (tail(&start, &values), lower_tail(&start, &values));
            for i in 0..7 {
                tails[i] = tails[i].max(found[i]);
                lower[i] = lower[i].max(found_lower[i]);
                sizes[i] = values.iter().fold(sizes[i], |size, value| size.max(value[i].abs()));
            }
            start = values[STAGES - 1];
        }
        let missed: [f64; 7] = std::array::from_fn(|i| {
            let fall = if tails[i] < lower[i] { tails[i] / lower[i] } else { 1.0 };
            tails[i] * fall * fall
        });
        largest_ratio(&missed, &sizes)
    }

    /// What is missed as a part of that at which the metrics are right to `accuracy`. Where a
    /// disturbance dies out slowly, the elements' errors add up.
    fn missed_part(&self, model: &R, accuracy: f64) -> f64 {
        let sizes = self.sizes();
        let row = |i: usize| (0..N).map(|m| self.closing[(i, m)].abs() * sizes[m]).sum::<f64>();
        let growth = largest_ratio(&std::array::from_fn(row), &sizes);
        self.missed(model) * growth.max(1.0) / (MISSED * accuracy)
    }

    /// State at phase 0.
    pub fn start(&self) -> [f64; N] {
        self.now.start
    }

    /// Modulus of the largest Floquet multiplier of a whole period, from a fresh
    /// linearisation.
    pub fn floquet(&mut self, model: &R) -> Result<f64, MotionError> {
        const MOST_SWEEPS: usize = 1000;
        self.linearise(model)?;
        let product = self.monodromy();
        // The eigenvalues of the smaller matrix and zeros: of one size for all rings.
        let padded = Matrix5::from_fn(|i, j| if i < N && j < N { product[(i, j)] } else { 0.0 });
        if padded.iter().any(|entry| !entry.is_finite()) {
            return Err(self.not_converged());
        }
        let schur = padded.try_schur(f64::EPSILON, MOST_SWEEPS).ok_or(self.not_converged())?;
        let values = schur.complex_eigenvalues();
        let largest = values.iter().map(|value| value.norm()).fold(0.0, f64::max);
        Ok(if self.is_half { largest * largest } else { largest })
    }

    /// One Newton step from the last solution; gives the step relative to the states.
    pub fn polish(&mut self, model: &R) -> Result<f64, MotionError> {
        self.linearise(model)?;
        self.close();
        let size = self.step_size(&self.sizes());
        self.move_by(1.0);
        self.cycle = None;
        Ok(size)
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

/// Largest of `parts[i] / sizes[i]`. A state that is nothing beside the others, such as the
/// lateral motion of a robot that goes straight, counts as rounding.
fn largest_ratio<const N: usize>(parts: &[f64; N], sizes: &[f64; N]) -> f64 {
    const NOTHING: f64 = 1e-9;
    let floor = NOTHING * sizes.iter().fold(0.0_f64, |largest, size| largest.max(*size));
    let mut largest = 0.0;
    for i in (0..N).filter(|&i| parts[i] != 0.0) {
        let ratio = parts[i] / sizes[i].max(floor);
        if ratio.is_nan() {
            return f64::INFINITY;
        }
        largest = f64::max(largest, ratio);
    }
    largest
}

/// Angles and velocities of a moment at a heading, the velocity along the world's axes.
fn in_the_world(moment: &Moment, theta_rad: f64) -> [f64; 7] {
    let [phi1, phi2] = moment.phi_rad;
    let [u, v, r, w1, w2] = moment.velocity;
    let (sin, cos) = theta_rad.sin_cos();
    [phi1, phi2, u * cos - v * sin, u * sin + v * cos, r, w1, w2]
}
