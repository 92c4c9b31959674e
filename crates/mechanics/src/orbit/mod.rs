//! Steady-state periodic motion: a periodic boundary value problem, solved by collocation.
//!
//! The period (or half of it, for motions with half-period symmetry) is divided into elements (time steps) of
//! Radau IIA collocation. Newton's method linearises all elements; each is condensed to the derivative of the
//! state at its end with respect to the state at its start, and periodicity leaves an `N x N` system for the
//! state at phase 0. The product of these derivatives is the monodromy matrix `M`, whose eigenvalues are the
//! Floquet multipliers. Work and storage are proportional to the number of elements.
//!
//! Newton's method first converges on a few coarse elements; how fast the Legendre coefficients of their
//! polynomials decay then shows how many elements the accuracy requires.

mod adjoint;
mod bordered;
mod newton;
mod resolution;

use nalgebra::SMatrix;

pub(super) use adjoint::{Adjoint, OfElements};
pub(super) use bordered::{Direction, Plane, Slopes};
pub(super) use newton::largest_lane;
pub(super) use resolution::sum_of_lanes;

use trilink_robot::Lanes;

use super::cycle::{Cycle, measure};
use super::element::{Element, Linearisation, solve_element};
use super::extreme::Extremes;
use super::mesh::{MAX_ELEMENTS, Mesh, States};
use super::path::Path;
use super::radau::STAGES;
use super::reduced::Reduced;
use super::{MotionError, Result};

/// Computational effort spent on solutions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Effort {
    /// Number of Newton steps, including those on coarse meshes and from failed starts.
    pub newton_steps: usize,
    /// Number of Jacobians that were evaluated and factored.
    pub factorisations: usize,
    /// Number of linear systems that were solved with the factored Jacobians.
    pub linear_solves: usize,
    /// Number of collocation elements of the last solution.
    pub elements: usize,
}

/// Solver for the periodic motions of one model, with the last solution and a workspace that the next one
/// reuses.
#[derive(Debug, Clone)]
pub(super) struct PeriodicOrbit<const N: usize, R: Reduced<N>> {
    pub mesh: Mesh<N, R>,
    /// Number of Newton steps of the last solution.
    steps: usize,
    /// Computational effort of all solutions since the last reset.
    pub effort: Effort,
    /// Estimated contraction constant of Newton's method: the ratio of a step to the square of the preceding step, as
    /// last observed directly after a factorisation of the Jacobian.
    contraction: f64,
    pub linearisation: Linearisation<Lanes>,
    /// Derivatives of the state at each element's end with respect to the state at its start.
    transfers: Vec<[[f64; N]; N]>,
    /// Change in the state at each element's end due to the last Newton step, with the state at the element's
    /// start held fixed.
    offsets: Vec<[f64; N]>,
    /// `(I - M)^-1`, with the monodromy matrix M; solves the periodicity condition for the state at phase 0.
    monodromy_closure: SMatrix<f64, N, N>,
    /// Last Newton step, computed with the current factors of the Jacobian.
    step: States<N>,
    /// Newton step before the last one.
    last_step: States<N>,
    /// States before the last Newton step or the last change to the mesh.
    before: States<N>,
    /// Bounds of the elements before the last change to the mesh.
    bounds_before: Vec<f64>,
    /// States to which the homotopy in the transition speed of dry friction returns if a step fails.
    softer: States<N>,
    /// Estimated relative error of each element's polynomials, which determines the next mesh.
    roughness: Vec<f64>,
    /// Highest-order Legendre coefficients of the tracked quantities ([`Reduced::tracked`]), for each pack of elements (one element per SIMD lane).
    tails: Vec<[Lanes; N]>,
    /// Workspace for solving single elements.
    pub workspace: Linearisation,
    /// Ratio of the last solution's discretisation error to the tolerance; infinite if there is no solution.
    error_ratio: f64,
    /// Whether the last solution lacks the half-period symmetry of its commands.
    pub is_symmetry_broken: bool,
    /// Path of the robot in the plane for the last solution.
    pub path: Path<N, R>,
    /// Metrics of the last solution; `None` until they are computed.
    cycle: Option<Cycle>,
    /// Extremes of the angles of the free joints, computed with `cycle`.
    pub(crate) extremes: Vec<Extremes<N>>,
    /// Modulus of the last solution's largest Floquet multiplier; `None` until it is computed.
    floquet: Option<f64>,
}

/// Snapshot of a solution, from which other solutions can start.
pub(super) struct Snapshot<const N: usize, R: Reduced<N>> {
    mesh: Mesh<N, R>,
    roughness: Vec<f64>,
    error_ratio: f64,
    is_symmetry_broken: bool,
}

/// Starting point for Newton's method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Start<const N: usize> {
    /// The model's initial guess.
    Guess,
    /// The last solution of this solver, if there is one.
    Last,
    /// The motion integrated from a state at phase 0.
    State([f64; N]),
    /// The motion integrated from a state at phase 0 over a whole period, without assuming half-period
    /// symmetry.
    WholePeriod([f64; N]),
}

impl<const N: usize> Start<N> {
    /// Returns the state at phase 0 from which the motion is integrated; `None` for the other kinds of start.
    pub(crate) fn state(&self) -> Option<[f64; N]> {
        match self {
            Self::State(state) | Self::WholePeriod(state) => Some(*state),
            Self::Guess | Self::Last => None,
        }
    }
}

/// Initial number of collocation elements per half period.
const COARSE_OF_HALF: usize = 2;
/// Initial number of collocation elements per period.
const COARSE: usize = 6;
/// Minimum number of collocation elements per period of an accepted solution.
const MIN_ELEMENTS: usize = 8;
/// Factors by which the initial mesh is refined in successive attempts, until Newton's method converges.
const REFINEMENTS: [usize; 3] = [1, 4, 16];
/// Transition speed at which the homotopy in dry friction starts, relative to the reference speed of the skid ratio
/// (side link length times frequency omega; eq. 20 of the paper).
const INITIAL_TRANSITION: f64 = 0.1;
/// Maximum factor by which the initial transition speed of the homotopy in dry friction is increased while
/// Newton's method fails.
const MAX_SOFTENING: f64 = 64.0;
/// Factor by which each step of the homotopy in dry friction divides the transition speed at the first attempt.
const TRANSITION_RATIO: f64 = 4.0;
/// Minimum factor by which a step of the homotopy in dry friction divides the transition speed; if Newton's method
/// would need a smaller factor, the homotopy fails.
const MIN_TRANSITION_RATIO: f64 = 1.1;
/// Relative accuracy of the intermediate motions of the homotopy in the transition speed of dry friction.
const SOFT_ACCURACY: f64 = 0.01;
/// Relative size of the Newton step below which a coarse mesh is refined.
const COARSE_STEP: f64 = 0.02;
/// Target ratio of the discretisation error to the tolerance in the design of a new mesh.
const TARGET_ERROR_RATIO: f64 = 0.4;
/// Maximum ratio of the sufficient number of elements to the current number at which a warm start coarsens the mesh.
const COARSENING_FRACTION: f64 = 0.9;

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
            error_ratio: f64::INFINITY,
            is_symmetry_broken: false,
            path: Path::default(),
            cycle: None,
            extremes: Vec::new(),
            floquet: None,
        }
    }
}

impl<const N: usize, R: Reduced<N>> PeriodicOrbit<N, R> {
    /// Finds the periodic solution near `start`, with as many elements as the relative `accuracy` of the
    /// metrics requires.
    pub(crate) fn solve(&mut self, model: &R, start: Start<N>, accuracy: f64) -> Result<()> {
        let error_ratio = std::mem::replace(&mut self.error_ratio, f64::INFINITY);
        self.cycle = None;
        self.floquet = None;
        let is_whole = match start {
            Start::WholePeriod(_) => true,
            Start::Last => self.is_symmetry_broken,
            _ => false,
        };
        let mirror = model.half_period_signs();
        let signs = mirror.filter(|_| !is_whole);
        let is_warm =
            start == Start::Last && error_ratio.is_finite() && self.mesh.is_half == signs.is_some();
        // Coarse elements cannot separate the two motions of a mirror-image pair that are nearly symmetric.
        let coarse = if signs.is_some() {
            COARSE_OF_HALF
        } else if is_whole && error_ratio.is_finite() {
            COARSE.max(self.mesh.count * self.mesh.spans())
        } else {
            COARSE
        };
        self.mesh.is_half = signs.is_some();
        self.mesh.periods = 1;
        self.mesh.signs = signs.unwrap_or([1.0; N]);
        self.is_symmetry_broken = false;
        self.steps = 0;
        self.contraction = 1.0;
        if is_warm {
            self.start_warm(model, error_ratio);
            self.resolve(model, accuracy)?;
        } else {
            self.solve_cold(model, start, coarse, accuracy)?;
        }
        self.is_symmetry_broken = is_whole && mirror.is_some() && self.has_net_rotation(accuracy);
        Ok(())
    }

    /// Finds the periodic solution near the current states, with as many elements as the accuracy requires.
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

    /// Returns a snapshot from which another solution can start.
    pub(crate) fn snapshot(&self) -> Snapshot<N, R> {
        Snapshot {
            mesh: self.mesh.clone(),
            roughness: self.roughness.clone(),
            error_ratio: self.error_ratio,
            is_symmetry_broken: self.is_symmetry_broken,
        }
    }

    /// Restores a snapshot as the start of the next solution; the path and the metrics are not restored.
    pub(crate) fn restore(&mut self, snapshot: Snapshot<N, R>) {
        self.mesh = snapshot.mesh;
        self.roughness = snapshot.roughness;
        self.error_ratio = snapshot.error_ratio;
        self.is_symmetry_broken = snapshot.is_symmetry_broken;
    }

    /// Creates a solver whose next solution starts from the last solution of this solver.
    pub(crate) fn successor(&self) -> Self {
        let mut successor = Self::default();
        successor.restore(self.snapshot());
        successor
    }

    /// Finds the periodic solution from an approximation on `coarse` elements, or on more if Newton's method does not
    /// converge.
    fn solve_cold(
        &mut self,
        model: &R,
        start: Start<N>,
        coarse: usize,
        accuracy: f64,
    ) -> Result<()> {
        let mut result = Err(self.not_converged());
        for refinement in REFINEMENTS {
            result = self.start_cold(model, start, refinement * coarse);
            if result.is_ok() {
                let error_ratio = self.error_ratio(model, accuracy);
                result =
                    self.refine(model, error_ratio).and_then(|()| self.resolve(model, accuracy));
                if !matches!(result, Err(MotionError::NotConverged { .. })) {
                    break;
                }
            }
        }
        result
    }

    /// Finds an approximate periodic solution on `count` elements.
    fn start_cold(&mut self, model: &R, start: Start<N>, count: usize) -> Result<()> {
        self.mesh.divide_equally(count);
        self.lay_out(model);
        self.mesh.guess(model);
        self.steps = 0;
        match start {
            Start::State(state) => self.march(model, state, 1e-4)?,
            // Nearly singular equations magnify the error of the start.
            Start::WholePeriod(state) => self.march(model, state, 1e-9)?,
            Start::Guess | Start::Last => return self.soften(model),
        }
        self.newton(model, COARSE_STEP)
    }

    /// Finds an approximate periodic solution from the current states. Under dry friction, the solution is followed
    /// from a larger transition speed down to the actual one (homotopy).
    fn soften(&mut self, model: &R) -> Result<()> {
        let softest = INITIAL_TRANSITION * model.skid_scale_m_s() / model.transition_m_s();
        let mut last_factor = f64::INFINITY;
        let mut factor = softest.max(1.0);
        while let Some(softened) = model.with_transition_scaled(factor) {
            self.steps = 0;
            self.softer.start = self.mesh.states.start;
            self.softer.packs.clone_from(&self.mesh.states.packs);
            match self.newton(&softened, COARSE_STEP) {
                Ok(()) if factor == 1.0 => return Ok(()),
                Ok(()) => {
                    let error_ratio = self.error_ratio(&softened, SOFT_ACCURACY);
                    self.refine(&softened, error_ratio)?;
                    last_factor = factor;
                    factor = f64::max(1.0, factor / TRANSITION_RATIO);
                }
                Err(error) => {
                    std::mem::swap(&mut self.mesh.states, &mut self.softer);
                    factor = if last_factor.is_finite() {
                        (last_factor * factor).sqrt()
                    } else {
                        TRANSITION_RATIO * factor
                    };
                    if last_factor / factor < MIN_TRANSITION_RATIO
                        || factor > MAX_SOFTENING * softest.max(1.0)
                    {
                        return Err(error);
                    }
                }
            }
        }
        self.newton(model, COARSE_STEP)
    }

    /// Prepares a warm start: adapts the last solution to the model's frequency, and coarsens the mesh if
    /// `error_ratio`, the last solution's ratio of discretisation error to tolerance, allows it.
    fn start_warm(&mut self, model: &R, error_ratio: f64) {
        let before_s = self.mesh.span_s;
        let sufficient = self.sufficient_elements(error_ratio);
        if (sufficient as f64) < COARSENING_FRACTION * self.mesh.count as f64 {
            self.resample(model, sufficient);
        }
        self.lay_out(model);
        // Velocities scale with the frequency; angles do not.
        let frequency_ratio = before_s / self.mesh.span_s;
        let rates = N - R::ANGLES;
        let States { start, packs } = &mut self.mesh.states;
        start[..rates].iter_mut().for_each(|rate| *rate *= frequency_ratio);
        let states = packs.iter_mut().flatten();
        states.for_each(|y| {
            y[..rates].iter_mut().for_each(|rate| *rate *= Lanes::splat(frequency_ratio))
        });
        self.mesh.integrate();
    }

    /// Returns the number of elements that is expected to change the ratio of discretisation error to tolerance from
    /// `error_ratio` to [`TARGET_ERROR_RATIO`].
    fn sufficient_elements(&self, error_ratio: f64) -> usize {
        let min_elements = MIN_ELEMENTS / self.mesh.spans();
        // The error decreases with the order of the collocation rule.
        let growth =
            (error_ratio / TARGET_ERROR_RATIO).powf(1.0 / (2.0 * STAGES as f64 - 1.0)).min(4.0);
        ((self.mesh.count as f64 * growth).ceil() as usize).max(min_elements)
    }

    /// Refines the mesh if its elements are too few or the ratio of discretisation error to tolerance is too
    /// large.
    fn refine(&mut self, model: &R, error_ratio: f64) -> Result<()> {
        let min_elements = MIN_ELEMENTS / self.mesh.spans();
        let max_elements = MAX_ELEMENTS / self.mesh.spans();
        let count = self.mesh.count;
        if error_ratio <= 1.0 && count >= min_elements {
            return Ok(());
        }
        if count >= max_elements || !error_ratio.is_finite() {
            return Err(MotionError::Unresolved { error: self.discretisation_error(model) });
        }
        let refined = self.sufficient_elements(error_ratio).clamp(count + 1, max_elements);
        self.resample(model, refined);
        self.linearisation.resize::<N, R>(refined);
        Ok(())
    }

    /// Replaces the mesh by one with `count` elements: equally long under linear friction, otherwise shorter
    /// where the discretisation error is larger.
    fn resample(&mut self, model: &R, count: usize) {
        self.bounds_before.clear();
        self.bounds_before.reserve(MAX_ELEMENTS + 1);
        self.bounds_before.extend_from_slice(&self.mesh.bounds);
        if model.is_linear() {
            self.mesh.divide_equally(count);
        } else {
            self.equidistribute(count);
        }
        self.mesh.resample(model, &self.bounds_before, &mut self.before);
    }

    /// Computes the durations and joint commands of the elements, and resizes the workspace to their number.
    fn lay_out(&mut self, model: &R) {
        self.mesh.lay_out(model);
        self.linearisation.resize::<N, R>(self.mesh.count);
    }

    /// Sets the states to the motion integrated from a state at phase 0.
    fn march(&mut self, model: &R, state: [f64; N], tolerance: f64) -> Result<()> {
        let Self { mesh, workspace, .. } = self;
        workspace.resize::<N, R>(1);
        let mut start = state;
        let mut result = Ok(());
        let mut marched = std::mem::take(&mut mesh.states);
        marched.start = state;
        marched.fill(mesh.count, |k| {
            let nodes = mesh.nodes_of(model, k);
            let mut stages = [start; STAGES];
            if result.is_ok() {
                let duration_s = mesh.duration_s(k);
                let guess = Element { nodes: &nodes, start: &start, stages: &stages, duration_s };
                match solve_element(model, &guess, tolerance, workspace) {
                    Some(solved) => {
                        stages = solved;
                        start = solved[STAGES - 1];
                    }
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

    /// Returns a starting point from which Newton's method finds the last solution again.
    pub(crate) fn as_start(&self) -> Start<N> {
        let state = self.mesh.states.start;
        if self.is_symmetry_broken { Start::WholePeriod(state) } else { Start::State(state) }
    }

    /// Returns whether the net rotation over a whole period exceeds the error of a motion that was solved to
    /// `accuracy`; a motion with half-period symmetry has no net rotation.
    fn has_net_rotation(&self, accuracy: f64) -> bool {
        const MIN_TOLERANCE: f64 = 1e-7;
        let rates = self.path.legs.iter().flat_map(|leg| &leg.states);
        let largest = rates
            .fold(Lanes::default(), |largest, state| largest.fast_max(R::body(state)[2].abs()));
        let tolerance =
            MIN_TOLERANCE.max(30.0 * accuracy) * newton::largest_lane(largest) * self.mesh.span_s;
        self.path.end.theta_rad.abs() > tolerance
    }

    /// Returns the metrics of the last solution, computed at the first call and cached.
    pub(crate) fn measure(&mut self, model: &R) -> Cycle {
        let Self { mesh, path, workspace, cycle, extremes, .. } = self;
        *cycle.get_or_insert_with(|| measure(model, mesh, path, workspace, extremes))
    }
}
