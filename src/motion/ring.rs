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

use nalgebra::{SMatrix, SVector};

use super::MotionError;
use super::element::{Linearised, Stages, follow_element, integrate_last, rate, tail};
use super::radau::{RADAU, STAGES};
use super::reduced::{Parameter, Reduced};

/// A periodic motion and the room to solve for it, which is used again by the next solution.
#[derive(Debug, Clone)]
pub(super) struct Ring<const N: usize, R: Reduced<N>> {
    /// Signs of the states at the end relative to the start; all 1 for a whole period.
    signs: [f64; N],
    /// Whether the elements cover half a period.
    is_half: bool,
    element_s: f64,
    start: [f64; N],
    elements: Vec<Stages<N>>,
    nodes: Vec<R::Node>,
    /// Newton steps of the last solution.
    steps: usize,
    linearised: Linearised,
    /// Inverse of the matrix that closes the chain.
    closing: SMatrix<f64, N, N>,
    step: Vec<Stages<N>>,
    /// Change of the start that belongs to `step`.
    start_step: [f64; N],
    /// Room for single elements.
    room: Linearised,
    /// The elements before a step, or the coarser ones.
    before: Vec<Stages<N>>,
    is_solved: bool,
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

/// Elements per period at first, and at most.
const COARSE: usize = 6;
const MOST_ELEMENTS: usize = 512;
/// Relative step at which the coarse elements' solution is good enough to go on from.
const COARSE_STEP: f64 = 0.02;
const MOST_STEPS: usize = 60;
/// Newton gives up when the residual does not shrink along a step of this part.
const LEAST_PART: f64 = 1.0 / 512.0;
/// Factors are kept while a step is at most this part of the one before.
const FAST: f64 = 0.15;
/// Steps below this size are rounding: their residual cannot be judged.
const ROUNDING: f64 = 1e-9;

impl<const N: usize, R: Reduced<N>> Default for Ring<N, R> {
    fn default() -> Self {
        Self {
            signs: [1.0; N],
            is_half: false,
            element_s: 0.0,
            start: [0.0; N],
            elements: Vec::new(),
            nodes: Vec::new(),
            steps: 0,
            linearised: Linearised::default(),
            closing: SMatrix::zeros(),
            step: Vec::new(),
            start_step: [0.0; N],
            room: Linearised::default(),
            before: Vec::new(),
            is_solved: false,
        }
    }
}

/// Largest relative tail of the elements' spectra at which the metrics, which converge about
/// twice as fast, are right to `accuracy`.
fn tail_for(accuracy: f64) -> f64 {
    0.35 * accuracy.sqrt()
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
        let solved = self.solve_near(model, omega_rad_s, start, accuracy);
        self.is_solved = solved.is_ok();
        solved
    }

    fn solve_near(
        &mut self,
        model: &R,
        omega_rad_s: f64,
        start: Start<N>,
        accuracy: f64,
    ) -> Result<(), MotionError> {
        let signs = model.half_period_signs();
        let goes_on = start == Start::Last && self.is_solved && self.is_half == signs.is_some();
        self.is_half = signs.is_some();
        self.signs = signs.unwrap_or([1.0; N]);
        self.steps = 0;
        let parts = if self.is_half { 2 } else { 1 };
        let target = tail_for(accuracy);
        if goes_on {
            let before_s = self.element_s;
            self.lay_nodes(model, omega_rad_s, self.elements.len());
            // Velocities go with the frequency, the passive joint's angle does not.
            let faster = before_s / self.element_s;
            let rates = if R::HAS_ANGLE { N - 1 } else { N };
            let states = self.elements.iter_mut().flatten().chain([&mut self.start]);
            states.for_each(|y| y[..rates].iter_mut().for_each(|rate| *rate *= faster));
            self.integrate();
        } else {
            self.lay_nodes(model, omega_rad_s, COARSE / parts);
            self.start = model.at_rest();
            self.elements.clear();
            self.elements.resize(COARSE / parts, [self.start; STAGES]);
            match start {
                Start::State(state) => self.march(model, state)?,
                Start::Rest | Start::Last => self.integrate(),
            }
            self.newton(model, COARSE_STEP)?;
            self.refine(model, omega_rad_s, target)?;
        }
        loop {
            self.newton(model, accuracy)?;
            if self.tail() <= target {
                return Ok(());
            }
            self.refine(model, omega_rad_s, target)?;
        }
    }

    /// Replaces the elements by as many as bring the tail to `target`.
    fn refine(&mut self, model: &R, omega_rad_s: f64, target: f64) -> Result<(), MotionError> {
        let tail = self.tail();
        if tail <= target {
            return Ok(());
        }
        let most = if self.is_half { MOST_ELEMENTS / 2 } else { MOST_ELEMENTS };
        let count = self.elements.len();
        if count >= most || !tail.is_finite() {
            return Err(MotionError::Unresolved { tail });
        }
        // The tail falls with about this power of the elements' length.
        let growth = (1.1 * tail / target).powf(1.0 / (STAGES as f64 + 0.5)).min(4.0);
        let finer = ((count as f64 * growth).ceil() as usize).clamp(count + 1, most);
        std::mem::swap(&mut self.before, &mut self.elements);
        self.elements.clear();
        for k in 0..finer {
            let at = |j: usize| {
                let position = (k as f64 + RADAU.nodes[j]) / finer as f64 * count as f64;
                let coarse = (position as usize).min(count - 1);
                let start =
                    if coarse == 0 { self.start } else { self.before[coarse - 1][STAGES - 1] };
                interpolate(&start, &self.before[coarse], position - coarse as f64)
            };
            self.elements.push(std::array::from_fn(at));
        }
        self.lay_nodes(model, omega_rad_s, finer);
        self.integrate();
        Ok(())
    }

    /// Lays out the nodes of `count` elements and room for them.
    fn lay_nodes(&mut self, model: &R, omega_rad_s: f64, count: usize) {
        let span = if self.is_half { 0.5 * TAU } else { TAU };
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
            let mut start = self.start[N - 1];
            for stages in &mut self.elements {
                integrate_last(stages, start, self.element_s);
                start = stages[STAGES - 1][N - 1];
            }
        }
    }

    /// Fills the elements with the motion that follows from a state.
    fn march(&mut self, model: &R, state: [f64; N]) -> Result<(), MotionError> {
        self.start = state;
        let mut from = state;
        let element_s = self.element_s;
        for (k, nodes) in self.nodes.chunks_exact(STAGES).enumerate() {
            let room = &mut self.linearised;
            let stages = follow_element(model, nodes, &from, element_s, 1e-4, room)
                .ok_or(MotionError::Stuck { time_s: k as f64 * element_s })?;
            self.elements[k] = stages;
            from = stages[STAGES - 1];
        }
        Ok(())
    }

    /// Visits every element with its number, nodes, start and stages; gives the norm of the
    /// residuals, infinite if an element refuses.
    fn visit(
        &mut self,
        mut element: impl FnMut(
            &mut Linearised,
            usize,
            &[R::Node],
            &[f64; N],
            &Stages<N>,
        ) -> Option<f64>,
    ) -> f64 {
        let mut square = 0.0;
        let mut start = &self.start;
        for (k, (nodes, stages)) in self.nodes.chunks_exact(STAGES).zip(&self.elements).enumerate()
        {
            match element(&mut self.linearised, k, nodes, start, stages) {
                Some(more) => square += more,
                None => return f64::INFINITY,
            }
            start = &stages[STAGES - 1];
        }
        let norm = (square / self.nodes.len() as f64).sqrt();
        if norm.is_finite() { norm } else { f64::INFINITY }
    }

    /// Linearises the chain at the present states and prepares its closing.
    pub fn linearise(&mut self, model: &R) -> Result<f64, MotionError> {
        let element_s = self.element_s;
        let norm = self.visit(|room, k, nodes, start, stages| {
            room.linearise(k, model, nodes, start, stages, element_s)
        });
        if norm == f64::INFINITY {
            return Err(MotionError::NotConverged { steps: self.steps });
        }
        let product = self.monodromy();
        let identity = SMatrix::<f64, N, N>::identity();
        self.closing = (identity - product)
            .try_inverse()
            .ok_or(MotionError::NotConverged { steps: self.steps })?;
        Ok(norm)
    }

    /// Residuals at the present states, with the factors kept.
    fn evaluate(&mut self, model: &R) -> f64 {
        let element_s = self.element_s;
        self.visit(|room, k, nodes, start, stages| {
            Some(room.evaluate(k, model, nodes, start, stages, element_s))
        })
    }

    /// How a state answers to a change at the start, one turn of the ring later.
    fn monodromy(&self) -> SMatrix<f64, N, N> {
        SMatrix::from_columns(&std::array::from_fn::<_, N, _>(|m| {
            let mut x: [f64; N] = std::array::from_fn(|i| if i == m { 1.0 } else { 0.0 });
            for k in 0..self.elements.len() {
                let changes = self.linearised.changes::<N, R>(k, &x, self.element_s, false);
                x = changes[STAGES - 1];
            }
            SVector::from_fn(|i, _| self.signs[i] * x[i])
        }))
    }

    /// Solves the closed chain for the right-hand sides in the elements and a mismatch at the
    /// ring's joint; gives the change of the start and leaves those of the stages in `step`.
    pub fn close(&mut self, mismatch: [f64; N]) -> [f64; N] {
        let mut offset = [0.0; N];
        for k in 0..self.elements.len() {
            self.linearised.solve_step::<N, R>(k);
            let changes = self.linearised.changes::<N, R>(k, &offset, self.element_s, true);
            offset = changes[STAGES - 1];
        }
        let right = SVector::<f64, N>::from_fn(|i, _| self.signs[i] * offset[i] + mismatch[i]);
        let first = self.closing * right;
        let first: [f64; N] = std::array::from_fn(|i| first[i]);
        self.start_step = first;
        let mut start = first;
        self.step.clear();
        for k in 0..self.elements.len() {
            let changes = self.linearised.changes::<N, R>(k, &start, self.element_s, true);
            start = changes[STAGES - 1];
            self.step.push(changes);
        }
        first
    }

    /// Newton's method until what is left is below `accuracy`, relative to the states; damped
    /// while the residual does not shrink, with kept factors while steps shrink fast.
    fn newton(&mut self, model: &R, accuracy: f64) -> Result<(), MotionError> {
        let failed = |steps| Err(MotionError::NotConverged { steps });
        let mut norm = self.linearise(model)?;
        let (mut last, mut is_fresh) = (f64::INFINITY, true);
        for _ in 0..MOST_STEPS {
            self.steps += 1;
            let end = self.elements[self.elements.len() - 1][STAGES - 1];
            let mismatch = std::array::from_fn(|i| self.signs[i] * end[i] - self.start[i]);
            let start_step = self.close(mismatch);
            let size = self.step_size();
            if !size.is_finite() {
                return failed(self.steps);
            }
            let shrinks = size / last;
            // What the next step would be: the square of a fresh one, or the same part again.
            let left = if is_fresh { 3.0 * size * size } else { size * shrinks };
            self.before.clear();
            self.before.extend_from_slice(&self.elements);
            let start_before = self.start;
            let mut part = 1.0;
            loop {
                self.move_by(&start_before, &start_step, part);
                if left <= 0.3 * accuracy && part == 1.0 {
                    return Ok(());
                }
                let found = self.evaluate(model);
                if found < norm || (size * part < ROUNDING && found.is_finite()) {
                    norm = found;
                    break;
                }
                if !is_fresh {
                    // The old factors led astray: back, and on with new ones.
                    self.move_by(&start_before, &start_step, 0.0);
                    norm = f64::INFINITY;
                    break;
                }
                part *= 0.5;
                if part < LEAST_PART {
                    return failed(self.steps);
                }
            }
            let fast = part == 1.0 && (shrinks < FAST || (is_fresh && size < FAST));
            if fast && norm.is_finite() {
                is_fresh = false;
            } else {
                norm = self.linearise(model)?;
                is_fresh = true;
            }
            last = size;
        }
        failed(self.steps)
    }

    fn move_by(&mut self, start: &[f64; N], start_step: &[f64; N], part: f64) {
        self.start = std::array::from_fn(|i| start[i] + part * start_step[i]);
        for ((now, before), step) in self.elements.iter_mut().zip(&self.before).zip(&self.step) {
            for j in 0..STAGES {
                for i in 0..N {
                    now[j][i] = before[j][i] + part * step[j][i];
                }
            }
        }
    }

    /// Largest step of any state over the largest value of that state before or after it.
    fn step_size(&self) -> f64 {
        let (mut steps, mut sizes) = ([0.0_f64; N], [0.0_f64; N]);
        for (step, from) in self.step.iter().flatten().zip(self.elements.iter().flatten()) {
            for i in 0..N {
                steps[i] = steps[i].max(step[i].abs());
                sizes[i] = sizes[i].max(from[i].abs()).max((from[i] + step[i]).abs());
            }
        }
        largest_ratio(&steps, &sizes)
    }

    /// Relative size of what the elements' polynomials cannot show: the largest highest
    /// coefficient of a state over the largest value of that state.
    fn tail(&self) -> f64 {
        let (mut tails, mut sizes) = ([0.0_f64; N], [0.0_f64; N]);
        let mut start = &self.start;
        for stages in &self.elements {
            let found = tail(start, stages);
            for i in 0..N {
                tails[i] = tails[i].max(found[i]);
                sizes[i] = stages.iter().fold(sizes[i], |size, y| size.max(y[i].abs()));
            }
            start = &stages[STAGES - 1];
        }
        largest_ratio(&tails, &sizes)
    }

    /// Modulus of the largest Floquet multiplier of a whole period, from a fresh
    /// linearisation.
    pub fn floquet(&mut self, model: &R) -> Result<f64, MotionError> {
        self.linearise(model)?;
        let product = self.monodromy();
        let monodromy = nalgebra::DMatrix::from_column_slice(N, N, product.as_slice());
        let values = monodromy.complex_eigenvalues();
        let largest = values.iter().map(|value| value.norm()).fold(0.0, f64::max);
        Ok(if self.is_half { largest * largest } else { largest })
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
        self.elements.len()
    }

    /// Change of element `k`'s start by the last [`Ring::close`].
    pub fn start_step(&self, k: usize) -> [f64; N] {
        if k == 0 { self.start_step } else { self.step[k - 1][STAGES - 1] }
    }

    /// Lends room for single elements; give it back with [`Ring::give_room`].
    pub fn take_room(&mut self) -> Linearised {
        std::mem::take(&mut self.room)
    }

    /// Takes the room back.
    pub fn give_room(&mut self, room: Linearised) {
        self.room = room;
    }

    /// Changes of element `k`'s stages by the last [`Ring::close`].
    pub fn step(&self, k: usize) -> &Stages<N> {
        &self.step[k]
    }

    /// Changes of all states when `parameter` does, into [`Ring::step`]. The chain must be
    /// linearised at the solution.
    pub fn differentiate(&mut self, model: &R, parameter: Parameter) {
        let rule = &*RADAU;
        for k in 0..self.elements.len() {
            let start = if k == 0 { &self.start } else { &self.elements[k - 1][STAGES - 1] };
            let (nodes, stages) = (&self.nodes[k * STAGES..], &self.elements[k]);
            let per_s = 1.0 / self.element_s;
            self.linearised.set_step::<N, R>(k, |j| {
                let dy = rate(rule, start, stages, j, per_s);
                model.residual_by(&nodes[j], &stages[j], &dy, parameter).map(|by| -by)
            });
        }
        self.close([0.0; N]);
    }

    /// Nodes, start and stages of element `k`.
    pub fn element(&self, k: usize) -> (&[R::Node], &[f64; N], &Stages<N>) {
        let start = if k == 0 { &self.start } else { &self.elements[k - 1][STAGES - 1] };
        (&self.nodes[k * STAGES..][..STAGES], start, &self.elements[k])
    }
}

/// Largest of `parts[i] / sizes[i]`. A state that is nothing beside the others, such as the
/// lateral motion of a robot that goes straight, counts as rounding.
fn largest_ratio<const N: usize>(parts: &[f64; N], sizes: &[f64; N]) -> f64 {
    const NOTHING: f64 = 1e-9;
    let floor = NOTHING * sizes.iter().fold(0.0_f64, |largest, size| largest.max(*size));
    let ratio = |i: usize| parts[i] / sizes[i].max(floor);
    (0..N).filter(|&i| parts[i] > 0.0).map(ratio).fold(0.0, f64::max)
}

/// State at a fraction of an element.
fn interpolate<const N: usize>(start: &[f64; N], stages: &Stages<N>, part: f64) -> [f64; N] {
    std::array::from_fn(|i| {
        let mut values = [start[i]; STAGES + 1];
        for j in 0..STAGES {
            values[j + 1] = stages[j][i];
        }
        RADAU.interpolate(&values, part)
    })
}
