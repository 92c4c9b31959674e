//! Steady periodic motion by collocation on a closed chain of elements.
//!
//! The period (half of it, where the mirror image of the motion must follow) is cut into
//! elements of Radau IIA collocation. Newton's method linearises all of them; each one is
//! condensed to how its end answers to its start, the chain is closed with an `N x N` system,
//! and the product of the ends' answers is the monodromy matrix, whose eigenvalues are the
//! Floquet multipliers. Work and storage grow in proportion to the number of elements.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, SMatrix, SVector};

use super::MotionError;
use super::element::{Condensed, Stages, Workspace, apply, condense, follow_element, tail};
use super::radau::{RADAU, STAGES};
use super::reduced::Reduced;

/// A steady motion at the nodes of its elements.
#[derive(Debug, Clone)]
pub(super) struct Orbit<const N: usize> {
    /// Signs of the states at the end relative to the start; all 1 for a whole period.
    pub signs: [f64; N],
    /// Whether the elements cover half a period.
    pub is_half: bool,
    pub element_s: f64,
    pub elements: Vec<Stages<N>>,
    /// Modulus of the largest Floquet multiplier over a whole period.
    pub floquet: f64,
    /// Newton steps taken.
    pub steps: usize,
}

impl<const N: usize> Orbit<N> {
    /// The state at which element `k` starts.
    pub fn start(&self, k: usize) -> [f64; N] {
        if k > 0 {
            return self.elements[k - 1][STAGES - 1];
        }
        let last = self.elements[self.elements.len() - 1][STAGES - 1];
        std::array::from_fn(|i| self.signs[i] * last[i])
    }

    /// State at a fraction of the elements' span.
    fn at(&self, fraction: f64) -> [f64; N] {
        let position = fraction * self.elements.len() as f64;
        let k = (position as usize).min(self.elements.len() - 1);
        let (start, stages) = (self.start(k), &self.elements[k]);
        std::array::from_fn(|i| {
            let mut values = [start[i]; STAGES + 1];
            for j in 0..STAGES {
                values[j + 1] = stages[j][i];
            }
            RADAU.interpolate(&values, position - k as f64)
        })
    }

    /// Relative size of what the elements' polynomials cannot show: the largest highest
    /// coefficient of a state over the largest value of that state.
    pub fn tail(&self) -> f64 {
        let (mut tails, mut sizes) = ([0.0_f64; N], [0.0_f64; N]);
        for (k, stages) in self.elements.iter().enumerate() {
            let found = tail(&self.start(k), stages);
            for i in 0..N {
                tails[i] = tails[i].max(found[i]);
                sizes[i] = stages.iter().fold(sizes[i], |size, y| size.max(y[i].abs()));
            }
        }
        largest_ratio(&tails, &sizes)
    }
}

/// How a periodic solution is sought.
#[derive(Debug, Clone, Copy)]
pub(super) struct Search {
    /// Elements per period at first.
    pub elements: usize,
    /// Largest relative tail of the spectrum that is accepted.
    pub tail: f64,
}

/// Most elements per period.
const MOST_ELEMENTS: usize = 512;
/// Newton stops when a step is this small relative to the solution: the next one would be
/// the square of it.
const SMALL_STEP: f64 = 1e-6;
const MOST_STEPS: usize = 60;
/// Newton gives up when the residual does not shrink along a step of this part.
const LEAST_DAMPING: f64 = 1.0 / 512.0;

/// Where Newton's method starts.
#[derive(Debug, Clone, Copy)]
pub(super) enum Start<'a, const N: usize> {
    /// The robot at rest all the time.
    Rest,
    /// A neighbouring solution.
    Near(&'a Orbit<N>),
    /// The motion that follows from a state at phase 0.
    State([f64; N]),
}

/// Finds a periodic solution near `start` with as many elements as it takes.
pub(super) fn solve<const N: usize, R: Reduced<N>>(
    model: &R,
    omega_rad_s: f64,
    start: Start<N>,
    search: Search,
) -> Result<Orbit<N>, MotionError> {
    let signs = model.half_period_signs();
    let is_half = signs.is_some();
    let (parts, span) = if is_half { (2, 0.5) } else { (1, 1.0) };
    let mut count = (search.elements / parts).max(1);
    let mut chain = Chain {
        model,
        omega_rad_s,
        orbit: Orbit {
            signs: signs.unwrap_or([1.0; N]),
            is_half,
            element_s: 0.0,
            elements: Vec::new(),
            floquet: f64::NAN,
            steps: 0,
        },
        span,
        nodes: Vec::new(),
        condensed: Vec::new(),
        workspace: Workspace::default(),
    };
    match start {
        Start::Near(orbit) if orbit.is_half == is_half => {
            count = count.max(orbit.elements.len());
            chain.lay_out(count, Some(orbit));
        }
        Start::Near(_) | Start::Rest => chain.lay_out(count, None),
        Start::State(state) => {
            chain.lay_out(count, None);
            chain.march(state)?;
        }
    }
    loop {
        chain.newton()?;
        let tail = chain.orbit.tail();
        if tail <= search.tail {
            chain.orbit.floquet = chain.floquet();
            return Ok(chain.orbit);
        }
        if count * parts >= MOST_ELEMENTS {
            return Err(MotionError::Unresolved { tail });
        }
        // The tail falls with the power STAGES + 1 of the elements' length.
        let growth = (tail / search.tail).powf(1.0 / (STAGES as f64 + 1.0)).clamp(1.2, 3.0);
        count = ((count as f64 * growth).ceil() as usize).min(MOST_ELEMENTS / parts);
        let coarser = chain.orbit.clone();
        chain.lay_out(count, Some(&coarser));
    }
}

struct Chain<'m, const N: usize, R: Reduced<N>> {
    model: &'m R,
    omega_rad_s: f64,
    orbit: Orbit<N>,
    /// Part of the period that the elements cover.
    span: f64,
    nodes: Vec<R::Node>,
    condensed: Vec<Condensed<N>>,
    workspace: Workspace,
}

impl<const N: usize, R: Reduced<N>> Chain<'_, N, R> {
    /// Cuts the span into `count` elements and fills them from `earlier` or with rest.
    fn lay_out(&mut self, count: usize, earlier: Option<&Orbit<N>>) {
        let fraction = |k: usize, j: usize| (k as f64 + RADAU.nodes[j]) / count as f64;
        self.orbit.element_s = TAU / self.omega_rad_s * self.span / count as f64;
        self.nodes.clear();
        for k in 0..count {
            for j in 0..STAGES {
                self.nodes.push(self.model.node(TAU * self.span * fraction(k, j)));
            }
        }
        let rest = self.model.at_rest();
        self.orbit.elements = (0..count)
            .map(|k| {
                std::array::from_fn(|j| earlier.map_or(rest, |orbit| orbit.at(fraction(k, j))))
            })
            .collect();
    }

    /// Fills the elements with the motion that follows from a state.
    fn march(&mut self, mut state: [f64; N]) -> Result<(), MotionError> {
        let element_s = self.orbit.element_s;
        for (k, nodes) in self.nodes.chunks_exact(STAGES).enumerate() {
            let stages =
                follow_element(self.model, nodes, &state, element_s, 1e-4, &mut self.workspace);
            let stages = stages.ok_or(MotionError::Stuck { time_s: k as f64 * element_s })?;
            self.orbit.elements[k] = stages;
            state = stages[STAGES - 1];
        }
        Ok(())
    }

    /// Condenses every element at the present states; returns the residual's norm.
    fn linearise(&mut self) -> Result<f64, MotionError> {
        let mut square = 0.0;
        self.condensed.clear();
        for (k, nodes) in self.nodes.chunks_exact(STAGES).enumerate() {
            let condensed = condense(
                self.model,
                nodes,
                &self.orbit.start(k),
                &self.orbit.elements[k],
                self.orbit.element_s,
                &mut self.workspace,
                &mut square,
            );
            self.condensed
                .push(condensed.ok_or(MotionError::NotConverged { steps: self.orbit.steps })?);
        }
        if square.is_finite() {
            return Ok((square / self.nodes.len() as f64).sqrt());
        }
        Err(MotionError::NotConverged { steps: self.orbit.steps })
    }

    /// The Newton step of every stage.
    fn step(&self) -> Result<Vec<Stages<N>>, MotionError> {
        // The end of the chain answers to its start as `product x + offset`.
        let mut product: [[f64; N]; N] =
            std::array::from_fn(|i| std::array::from_fn(|k| if i == k { 1.0 } else { 0.0 }));
        let mut offset = [0.0; N];
        for element in &self.condensed {
            let end = &element.transfer[STAGES - 1];
            product = multiply(end, &product);
            offset = apply(end, &offset);
            for i in 0..N {
                offset[i] += element.step[STAGES - 1][i];
            }
        }
        let signs = &self.orbit.signs;
        let closing = SMatrix::<f64, N, N>::from_fn(|i, k| {
            f64::from(u8::from(i == k)) - signs[i] * product[i][k]
        });
        let right = SVector::<f64, N>::from_fn(|i, _| signs[i] * offset[i]);
        let singular = MotionError::NotConverged { steps: self.orbit.steps };
        let closing = DMatrix::from_column_slice(N, N, closing.as_slice());
        let right = nalgebra::DVector::from_column_slice(right.as_slice());
        let first = closing.lu().solve(&right).ok_or(singular)?;
        let mut start: [f64; N] = std::array::from_fn(|i| first[i]);
        let mut steps = Vec::with_capacity(self.condensed.len());
        for element in &self.condensed {
            let stages: Stages<N> = std::array::from_fn(|j| {
                let answer = apply(&element.transfer[j], &start);
                std::array::from_fn(|i| answer[i] + element.step[j][i])
            });
            start = stages[STAGES - 1];
            steps.push(stages);
        }
        Ok(steps)
    }

    /// Newton's method, damped while the residual does not shrink.
    fn newton(&mut self) -> Result<(), MotionError> {
        let mut norm = self.linearise()?;
        for _ in 0..MOST_STEPS {
            self.orbit.steps += 1;
            let step = self.step()?;
            let before = self.orbit.elements.clone();
            let size = relative_size(&step, &before);
            let mut part = 1.0;
            loop {
                self.orbit.elements = moved(&before, &step, part);
                let found = self.linearise();
                // A small step cannot be judged by its residual: rounding rules there.
                if size * part < SMALL_STEP {
                    found?;
                    return Ok(());
                }
                match found {
                    Ok(found) if found < norm * (1.0 + 1e-9) || norm == 0.0 => {
                        norm = found;
                        break;
                    }
                    _ => part *= 0.5,
                }
                if part < LEAST_DAMPING {
                    return Err(MotionError::NotConverged { steps: self.orbit.steps });
                }
            }
        }
        Err(MotionError::NotConverged { steps: self.orbit.steps })
    }

    /// Modulus of the largest Floquet multiplier of a whole period.
    fn floquet(&self) -> f64 {
        let mut product: [[f64; N]; N] =
            std::array::from_fn(|i| std::array::from_fn(|k| if i == k { 1.0 } else { 0.0 }));
        for element in &self.condensed {
            product = multiply(&element.transfer[STAGES - 1], &product);
        }
        let monodromy = DMatrix::from_fn(N, N, |i, k| self.orbit.signs[i] * product[i][k]);
        let largest =
            monodromy.complex_eigenvalues().iter().map(|value| value.norm()).fold(0.0, f64::max);
        if self.orbit.is_half { largest * largest } else { largest }
    }
}

fn multiply<const N: usize>(a: &[[f64; N]; N], b: &[[f64; N]; N]) -> [[f64; N]; N] {
    std::array::from_fn(|i| std::array::from_fn(|k| (0..N).map(|m| a[i][m] * b[m][k]).sum()))
}

fn moved<const N: usize>(from: &[Stages<N>], step: &[Stages<N>], part: f64) -> Vec<Stages<N>> {
    from.iter()
        .zip(step)
        .map(|(from, step)| {
            std::array::from_fn(|j| std::array::from_fn(|i| from[j][i] + part * step[j][i]))
        })
        .collect()
}

/// Largest step of any state over the largest value of that state before or after it.
fn relative_size<const N: usize>(step: &[Stages<N>], from: &[Stages<N>]) -> f64 {
    let (mut steps, mut sizes) = ([0.0_f64; N], [0.0_f64; N]);
    for (step, from) in step.iter().flatten().zip(from.iter().flatten()) {
        for i in 0..N {
            steps[i] = steps[i].max(step[i].abs());
            sizes[i] = sizes[i].max(from[i].abs()).max((from[i] + step[i]).abs());
        }
    }
    largest_ratio(&steps, &sizes)
}

/// Largest of `parts[i] / sizes[i]`. A state that is nothing beside the others, such as the
/// lateral motion of a robot that goes straight, counts as rounding.
fn largest_ratio<const N: usize>(parts: &[f64; N], sizes: &[f64; N]) -> f64 {
    const NOTHING: f64 = 1e-9;
    let floor = NOTHING * sizes.iter().fold(0.0_f64, |largest, size| largest.max(*size));
    let ratio = |i: usize| parts[i] / sizes[i].max(floor);
    (0..N).filter(|&i| parts[i] > 0.0).map(ratio).fold(0.0, f64::max)
}
