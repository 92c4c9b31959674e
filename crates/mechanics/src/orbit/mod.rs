//! Steady periodic motion: a periodic boundary value problem, solved by collocation.
//!
//! The period (half of it, where the mirror image of the motion must follow) is cut into
//! elements of Radau IIA collocation. Newton's method linearises all of them; each is condensed
//! to the derivative of its end with respect to its start, and an `N x N` system closes the
//! chain. The product of these derivatives is the monodromy matrix `M`, whose eigenvalues are the
//! Floquet multipliers. Work and storage grow in proportion to the number of elements.
//!
//! A few coarse elements bring Newton's method near; the end of their polynomials' spectra tells
//! how many elements the accuracy asks for.

mod bordered;
mod newton;
mod resolution;

use nalgebra::SMatrix;

pub(super) use bordered::{Direction, Plane, Slopes};
pub(super) use newton::largest_lane;

use trilink_robot::Lanes;

use super::cycle::{Cycle, measure, skid_scale};
use super::element::{Element, Linearisation, solve_element};
use super::mesh::{MOST_ELEMENTS, Mesh, States};
use super::path::Path;
use super::radau::STAGES;
use super::reduced::Reduced;
use super::sensitivity::Adjoints;
use super::{MotionError, Problem, Result};

/// What solutions took.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Effort {
    /// Newton steps, those of coarse meshes and of starts that failed among them.
    pub newton_steps: usize,
    /// Jacobians that were evaluated and factored.
    pub factorisations: usize,
    /// Systems that were solved by these factors.
    pub linear_solves: usize,
    /// Elements of the last solution.
    pub elements: usize,
}

/// A periodic motion and the workspace to solve for it, which is used again by the next solution.
#[derive(Debug, Clone)]
pub(super) struct PeriodicOrbit<const N: usize, R: Reduced<N>> {
    pub mesh: Mesh<N, R>,
    /// Newton steps of the last solution.
    steps: usize,
    /// Of all solutions since it was last cleared.
    pub effort: Effort,
    /// Newton's contraction: the step after a fresh one over that one's square, when last seen.
    contraction: f64,
    pub linearisation: Linearisation<Lanes>,
    /// Derivatives of each element's end with respect to its start, and its change by the last step
    /// when its start stays.
    transfers: Vec<[[f64; N]; N]>,
    offsets: Vec<[f64; N]>,
    /// `(I - M)^-1`, which closes the chain.
    monodromy_closure: SMatrix<f64, N, N>,
    /// The last step by the factors at hand, and the one before.
    step: States<N>,
    last_step: States<N>,
    /// The states before a step, or coarser ones, and the bounds of their elements.
    before: States<N>,
    bounds_before: Vec<f64>,
    /// Those of a motion under softer friction.
    softer: States<N>,
    /// How much each element's polynomials miss, where the elements are not equally long.
    roughness: Vec<f64>,
    tails: Vec<[Lanes; 7]>,
    /// For single elements.
    pub workspace: Linearisation,
    /// For derivatives.
    pub adjoints: Adjoints,
    /// The last solution's discretisation error over the accepted one; infinite if there is none.
    error_ratio: f64,
    /// Whether the last solution is not its own mirror image, though its commands are.
    pub is_symmetry_broken: bool,
    /// What was found out about the solution: its path, its metrics, its largest Floquet multiplier.
    pub path: Path,
    cycle: Option<Cycle<N>>,
    floquet: Option<f64>,
}

/// A solution that others may start from.
pub(super) struct Kept<const N: usize, R: Reduced<N>> {
    mesh: Mesh<N, R>,
    roughness: Vec<f64>,
    error_ratio: f64,
    is_symmetry_broken: bool,
}

/// Where Newton's method starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Start<const N: usize> {
    /// The model's own guess.
    Guess,
    /// The last solution of this orbit, if there is one.
    Last,
    /// The motion that follows from a state at phase 0.
    State([f64; N]),
    /// The same over a whole period, whether its mirror image follows half a period later or not.
    WholePeriod([f64; N]),
}

impl<const N: usize> Start<N> {
    /// The state at phase 0, if it is known.
    pub(crate) fn state(&self) -> Option<[f64; N]> {
        match self {
            Self::State(state) | Self::WholePeriod(state) => Some(*state),
            Self::Guess | Self::Last => None,
        }
    }
}

/// Elements at first, per half period or per period.
const COARSE_OF_HALF: usize = 2;
const COARSE: usize = 6;
/// Elements per period in the end at least.
const FEWEST: usize = 8;
/// By how much finer the first elements are when Newton's method fails with coarse ones.
const FINER: [usize; 3] = [1, 4, 16];
/// The speed within which dry friction changes its sign at first on the way to a motion under it, over
/// the characteristic speed of eq. 20, and how much larger than that it may be.
const SOFTEST: f64 = 0.1;
const MOST_SOFT: f64 = 64.0;
/// By how much it falls from one motion on that way to the next, and at least.
const HARDER: f64 = 4.0;
const LEAST_HARDER: f64 = 1.1;
/// Relative accuracy of the motions on that way.
const SOFT_ACCURACY: f64 = 0.01;
/// Relative step at which the coarse elements' solution is good enough to be refined.
const COARSE_STEP: f64 = 0.02;
/// Error ratio that elements are laid out for.
const MARGIN: f64 = 0.4;
/// A solution that could do with this part of its neighbour's elements gets fewer.
const FEWER: f64 = 0.9;

impl<const N: usize, R: Reduced<N>> Default for PeriodicOrbit<N, R> {
    fn default() -> Self {
        Self {
            mesh: Mesh::default(),
            steps: 0,
            effort: Effort::default(),
            contraction: 1.0,
            linearisation: Linearisation::default(),
            transfers: Vec::new(),
            offsets: Vec::new(),
            monodromy_closure: SMatrix::zeros(),
            step: States::default(),
            last_step: States::default(),
            before: States::default(),
            bounds_before: Vec::new(),
            softer: States::default(),
            roughness: Vec::new(),
            tails: Vec::new(),
            workspace: Linearisation::default(),
            adjoints: Adjoints::default(),
            error_ratio: f64::INFINITY,
            is_symmetry_broken: false,
            path: Path::default(),
            cycle: None,
            floquet: None,
        }
    }
}

impl<const N: usize, R: Reduced<N>> PeriodicOrbit<N, R> {
    /// Finds the periodic solution near `start` with as many elements as the relative
    /// `accuracy` of the metrics takes.
    pub(crate) fn solve(&mut self, model: &R, start: Start<N>, accuracy: f64) -> Result<()> {
        let error_ratio = std::mem::replace(&mut self.error_ratio, f64::INFINITY);
        (self.cycle, self.floquet) = (None, None);
        let is_whole = match start {
            Start::WholePeriod(_) => true,
            Start::Last => self.is_symmetry_broken,
            _ => false,
        };
        let mirror = model.half_period_signs();
        let signs = mirror.filter(|_| !is_whole);
        let is_warm =
            start == Start::Last && error_ratio.is_finite() && self.mesh.is_half == signs.is_some();
        // Two motions that are nearly their own mirror image are one to coarse elements.
        let coarse = match (signs.is_some(), is_whole && error_ratio.is_finite()) {
            (true, _) => COARSE_OF_HALF,
            (false, false) => COARSE,
            (false, true) => COARSE.max(self.mesh.count * self.mesh.spans()),
        };
        (self.mesh.is_half, self.mesh.periods) = (signs.is_some(), 1);
        self.mesh.signs = signs.unwrap_or([1.0; N]);
        self.is_symmetry_broken = false;
        (self.steps, self.contraction) = (0, 1.0);
        if is_warm {
            self.start_warm(model, error_ratio);
            self.resolve(model, accuracy)?;
        } else {
            self.solve_cold(model, start, coarse, accuracy)?;
        }
        self.is_symmetry_broken = is_whole && mirror.is_some() && self.turns(accuracy);
        Ok(())
    }

    /// Finds the solution near the states at hand with as many elements as the accuracy takes.
    fn resolve(&mut self, model: &R, accuracy: f64) -> Result<()> {
        loop {
            self.newton(model, accuracy)?;
            let error_ratio = self.error_ratio(model, accuracy);
            if error_ratio <= 1.0 {
                self.error_ratio = error_ratio;
                self.effort.elements = self.mesh.count;
                return Ok(());
            }
            self.refine(model, error_ratio)?;
        }
    }

    /// What the next solution may start from.
    pub(crate) fn keep(&self) -> Kept<N, R> {
        Kept {
            mesh: self.mesh.clone(),
            roughness: self.roughness.clone(),
            error_ratio: self.error_ratio,
            is_symmetry_broken: self.is_symmetry_broken,
        }
    }

    /// Makes what was kept the start of the next solution; nothing else can be asked of it.
    pub(crate) fn restore(&mut self, kept: Kept<N, R>) {
        let Kept { mesh, roughness, error_ratio, is_symmetry_broken } = kept;
        (self.mesh, self.roughness) = (mesh, roughness);
        (self.error_ratio, self.is_symmetry_broken) = (error_ratio, is_symmetry_broken);
    }

    /// Another one whose next solution starts from this one's last.
    pub(crate) fn successor(&self) -> Self {
        let mut successor = Self::default();
        successor.restore(self.keep());
        successor
    }

    /// Finds the solution from an approximate one with few elements, or with more where that one or what it leads
    /// to is none.
    fn solve_cold(
        &mut self,
        model: &R,
        start: Start<N>,
        coarse: usize,
        accuracy: f64,
    ) -> Result<()> {
        let mut tried = Err(self.not_converged());
        for finer in FINER {
            tried = self.start_cold(model, start, finer * coarse);
            if tried.is_ok() {
                let error_ratio = self.error_ratio(model, accuracy);
                tried =
                    self.refine(model, error_ratio).and_then(|()| self.resolve(model, accuracy));
                if !matches!(tried, Err(MotionError::NotConverged { .. })) {
                    break;
                }
            }
        }
        tried
    }

    /// Finds an approximate solution with so many elements.
    fn start_cold(&mut self, model: &R, start: Start<N>, count: usize) -> Result<()> {
        self.mesh.divide(count);
        self.lay_out(model);
        self.mesh.guess(model);
        self.steps = 0;
        match start {
            Start::State(state) => self.march(model, state, 1e-4)?,
            // Nearly singular equations magnify what is missed here.
            Start::WholePeriod(state) => self.march(model, state, 1e-9)?,
            Start::Guess | Start::Last => return self.soften(model),
        }
        self.newton(model, COARSE_STEP)
    }

    /// Finds an approximate solution from the states at hand: under dry friction through those under
    /// friction that changes its sign less suddenly.
    fn soften(&mut self, model: &R) -> Result<()> {
        let Problem { robot, .. } = model.problem();
        let softest = SOFTEST * skid_scale(model.problem()) / robot.transition_m_s;
        let (mut reached, mut aim) = (f64::INFINITY, softest.max(1.0));
        while let Some(softened) = model.softened(aim) {
            self.steps = 0;
            self.softer.start = self.mesh.states.start;
            self.softer.packs.clone_from(&self.mesh.states.packs);
            match self.newton(&softened, COARSE_STEP) {
                Ok(()) if aim == 1.0 => return Ok(()),
                Ok(()) => {
                    let error_ratio = self.error_ratio(&softened, SOFT_ACCURACY);
                    self.refine(&softened, error_ratio)?;
                    (reached, aim) = (aim, f64::max(1.0, aim / HARDER));
                }
                Err(error) => {
                    std::mem::swap(&mut self.mesh.states, &mut self.softer);
                    aim = if reached.is_finite() { (reached * aim).sqrt() } else { HARDER * aim };
                    if reached / aim < LEAST_HARDER || aim > MOST_SOFT * softest.max(1.0) {
                        return Err(error);
                    }
                }
            }
        }
        self.newton(model, COARSE_STEP)
    }

    /// Makes the last solution, which had this error ratio, the start for another frequency.
    fn start_warm(&mut self, model: &R, error_ratio: f64) {
        let before_s = self.mesh.span_s;
        let enough = self.enough_elements(error_ratio);
        if (enough as f64) < FEWER * self.mesh.count as f64 {
            self.resample(model, enough);
        }
        self.lay_out(model);
        // Velocities go with the frequency, the passive joint's angle does not.
        let faster = before_s / self.mesh.span_s;
        let rates = if R::HAS_ANGLE { N - 1 } else { N };
        let States { start, packs } = &mut self.mesh.states;
        start[..rates].iter_mut().for_each(|rate| *rate *= faster);
        let states = packs.iter_mut().flatten();
        states.for_each(|y| y[..rates].iter_mut().for_each(|rate| *rate *= Lanes::splat(faster)));
        self.mesh.integrate();
    }

    /// Elements with an error ratio of [`MARGIN`], where those at hand have `error_ratio`.
    fn enough_elements(&self, error_ratio: f64) -> usize {
        let fewest = FEWEST / self.mesh.spans();
        // By the rule's order.
        let growth = (error_ratio / MARGIN).powf(1.0 / (2.0 * STAGES as f64 - 1.0)).min(4.0);
        ((self.mesh.count as f64 * growth).ceil() as usize).max(fewest)
    }

    /// Replaces the elements by as many as are needed, if those at hand are too few.
    fn refine(&mut self, model: &R, error_ratio: f64) -> Result<()> {
        let (fewest, most) = (FEWEST / self.mesh.spans(), MOST_ELEMENTS / self.mesh.spans());
        let count = self.mesh.count;
        if error_ratio <= 1.0 && count >= fewest {
            return Ok(());
        }
        if count >= most || !error_ratio.is_finite() {
            return Err(MotionError::Unresolved { error: self.discretisation_error(model) });
        }
        let finer = self.enough_elements(error_ratio).clamp(count + 1, most);
        self.resample(model, finer);
        self.linearisation.resize::<N, R>(finer);
        Ok(())
    }

    /// Replaces the elements by `count` others, shorter ones where the polynomials miss more.
    fn resample(&mut self, model: &R, count: usize) {
        self.bounds_before.clear();
        self.bounds_before.reserve(MOST_ELEMENTS + 1);
        self.bounds_before.extend_from_slice(&self.mesh.bounds);
        if R::IS_LINEAR {
            self.mesh.divide(count);
        } else {
            self.equidistribute(count);
        }
        self.mesh.resample(model, &self.bounds_before, &mut self.before);
    }

    /// Lays out the commands of the elements and the workspace for them.
    fn lay_out(&mut self, model: &R) {
        self.mesh.lay_out(model);
        self.linearisation.resize::<N, R>(self.mesh.count);
    }

    /// Fills the elements with the motion that follows from a state.
    fn march(&mut self, model: &R, state: [f64; N], tolerance: f64) -> Result<()> {
        let Self { mesh, workspace, .. } = self;
        workspace.resize::<N, R>(1);
        let (mut start, mut result) = (state, Ok(()));
        let mut marched = std::mem::take(&mut mesh.states);
        marched.start = state;
        marched.fill(mesh.count, |k| {
            let (nodes, mut stages) = (mesh.nodes_of(model, k), [start; STAGES]);
            if result.is_ok() {
                let duration_s = mesh.duration_s(k);
                let guess = Element { nodes: &nodes, start: &start, stages: &stages, duration_s };
                match solve_element(model, &guess, tolerance, workspace) {
                    Some(solved) => (stages, start) = (solved, solved[STAGES - 1]),
                    None => {
                        result = Err(MotionError::Stuck { time_s: mesh.bounds[k] * mesh.span_s })
                    }
                }
            }
            stages
        });
        mesh.states = marched;
        result
    }

    /// Where the last solution is and how to get back to it.
    pub(crate) fn here(&self) -> Start<N> {
        let state = self.mesh.states.start;
        if self.is_symmetry_broken { Start::WholePeriod(state) } else { Start::State(state) }
    }

    /// Whether the robot has turned after a whole period, by more than a motion that was solved to
    /// this accuracy may miss; what is its own mirror image has not.
    fn turns(&self, accuracy: f64) -> bool {
        const LEAST: f64 = 1e-7;
        let rates = self.path.legs.iter().flat_map(|leg| &leg.states);
        let largest = rates
            .fold(Lanes::default(), |largest, state| largest.fast_max(state.velocity[2].abs()));
        let most = LEAST.max(30.0 * accuracy) * newton::largest_lane(largest) * self.mesh.span_s;
        self.path.end.theta_rad.abs() > most
    }

    /// What a cycle of the solution amounts to.
    pub(crate) fn measure(&mut self, model: &R) -> Cycle<N> {
        let Self { mesh, path, workspace, cycle, .. } = self;
        *cycle.get_or_insert_with(|| measure(model, mesh, path, workspace))
    }
}
