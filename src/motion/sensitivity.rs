//! Derivatives of a steady cycle's metrics with respect to the parameters, in one pass over its
//! elements.
//!
//! Each element is linearised at the solution, the columns of the parameters beside those of
//! its start. Its end then is an affine function of its start, and so are the metrics'
//! integrals over it; composing these along the chain leaves an `N x N` system for the
//! derivatives of the orbit's start. Nothing is kept of an element once it is passed, except
//! where joint 1 turns round.

use std::f64::consts::TAU;

use nalgebra::{SMatrix, SVector};

use super::cycle::{Cycle, skid_scale};
use super::element::{Element, Linearisation, Stages, integrate_poses, unknowns};
use super::extreme::TurningPoint;
use super::mesh::Mesh;
use super::radau::{RADAU, STAGES};
use super::reduced::{
    AMPLITUDE, Derivatives, KinematicState, MOST_PARAMETERS, OFFSET, Reduced, Variable,
};
use crate::metrics::GaitMetrics;
use crate::robot::{Parameter, Pose, Trig, dot, dskid_rows_dphi, skid_rows};

/// Most columns: states at the start, then parameters.
const MOST_COLUMNS: usize = 5 + MOST_PARAMETERS;

/// Derivatives with respect to the orbit's start (first `N` entries) and to the parameters.
type Affine = [f64; MOST_COLUMNS];

/// The metrics that are integrals over the cycle: d, Delta theta, sigma of the wheels, and d where
/// the second half of the period changes by the opposite of the first half's mirror image.
const INTEGRALS: usize = 6;

/// The model's first parameters: the skid coefficients, where its wheels skid.
const FIRST_PARAMETERS: usize = 3;

/// Derivatives of the metrics of the solution on a mesh with respect to the parameters that are
/// `wanted`, or to everything. Others may be left zero. `None` if the linearised motion is
/// singular: it is where two solutions meet.
pub(super) fn differentiate<const N: usize, R: Reduced<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    cycle: &Cycle,
    workspace: &mut Linearisation,
    wanted: Option<&[Parameter]>,
) -> Option<Derivatives> {
    let is_wanted = |column| match (model.variable(column), wanted) {
        (Variable::Parameter(own), Some(wanted)) => wanted.iter().any(|of| own.is_part_of(*of)),
        _ => false,
    };
    // Numbers of columns that are known when this is compiled.
    if wanted.is_none() {
        first_derivatives(model, mesh, cycle, workspace, R::PARAMETERS)
    } else if (FIRST_PARAMETERS..R::OF_ROBOT).any(is_wanted) {
        first_derivatives(model, mesh, cycle, workspace, R::OF_ROBOT)
    } else {
        first_derivatives(model, mesh, cycle, workspace, FIRST_PARAMETERS)
    }
}

/// Derivatives with respect to the first `parameters` of the model.
#[inline(always)]
fn first_derivatives<const N: usize, R: Reduced<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    cycle: &Cycle,
    workspace: &mut Linearisation,
    parameters: usize,
) -> Option<Derivatives> {
    let problem = model.problem();
    let columns = N + parameters;
    let gradient = MetricGradient::new(model, mesh, cycle, parameters > R::OF_ROBOT);
    // The mirror image of a motion is that of the opposite offsets: what changes by them half a
    // period later is the opposite of the mirror image of what changes now.
    let is_odd =
        |column| mesh.is_half && matches!(model.variable(column), Variable::Gait(_, OFFSET));
    let mut integrals = [[0.0; MOST_COLUMNS]; INTEGRALS];
    let mut state = [[0.0; MOST_COLUMNS]; N];
    (0..N).for_each(|i| state[i][i] = 1.0);
    let extremes = cycle.extremes.map(|extremes| [extremes.highest, extremes.lowest]);
    let mut state_at_extremes = [state; 2];
    let mut pose = Pose::default();
    for (k, element) in mesh.elements().enumerate() {
        for (extreme, state_at_extreme) in extremes.iter().flatten().zip(&mut state_at_extremes) {
            if extreme.element == k {
                *state_at_extreme = state;
            }
        }
        let right = workspace.solve_sensitivity(model, &element, parameters);

        let (nodes, stages, duration_s) = (element.nodes, element.stages, element.duration_s);
        let states = element.kinematics(model);
        let poses = integrate_poses(pose, &states, duration_s);
        pose = poses[STAGES - 1];
        let gradients = gradient.at_stages::<R, N>(model, &states, &poses);
        for (integral, gradient) in integrals.iter_mut().zip(&gradients) {
            if gradient.iter().all(|gradient| *gradient == KinematicState::default()) {
                continue;
            }
            let mut own = [0.0; MOST_COLUMNS];
            for j in 0..STAGES {
                if parameters > R::OF_ROBOT {
                    let slopes = model.gait_gradient(&nodes[j], &stages[j], &gradient[j]);
                    for column in R::OF_ROBOT..parameters {
                        if let Variable::Gait(joint, number) = model.variable(column) {
                            own[N + column] += slopes[joint][number];
                        }
                    }
                }
            }
            let gradient: Stages<N> =
                std::array::from_fn(|j| model.state_gradient(&nodes[j], &stages[j], &gradient[j]));
            contract::<N, R>(&gradient, duration_s, right, columns, &mut own);
            compose::<N>(&own, &state, columns, integral);
        }
        let mut next = [[0.0; MOST_COLUMNS]; N];
        for (i, next) in next.iter_mut().enumerate() {
            let end = element_end::<N, R>(i, duration_s, right, columns);
            compose::<N>(&end, &state, columns, next);
        }
        state = next;
    }

    // The chain closes: x = S (A x + B), with the opposite of S for what is odd.
    let signs = &mesh.signs;
    let closure = |sign: f64| {
        let open = SMatrix::<f64, N, N>::from_fn(|i, m| {
            let unit = if i == m { 1.0 } else { 0.0 };
            unit - sign * signs[i] * state[i][m]
        });
        open.try_inverse().filter(|entries| entries.iter().all(|x| x.is_finite()))
    };
    let even = closure(1.0)?;
    let odd = if mesh.is_half && parameters > R::OF_ROBOT { closure(-1.0)? } else { even };
    let mut starts = [[0.0; N]; MOST_PARAMETERS];
    for (column, start) in starts.iter_mut().enumerate().take(parameters) {
        let (closure, sign) = if is_odd(column) { (odd, -1.0) } else { (even, 1.0) };
        let right = SVector::<f64, N>::from_fn(|i, _| sign * signs[i] * state[i][N + column]);
        *start = (closure * right).into();
    }
    let total = |affine: &Affine, column: usize| -> f64 {
        affine[N + column] + (0..N).map(|i| affine[i] * starts[column][i]).sum::<f64>()
    };

    let mut alpha1 = [0.0; MOST_PARAMETERS];
    let extremes = extremes.iter().flatten().zip(&state_at_extremes);
    for ((extreme, before), half) in extremes.zip([0.5, -0.5]) {
        let angle = angle_at(model, mesh, extreme, before, workspace, parameters)?;
        for (column, alpha1) in alpha1.iter_mut().enumerate().take(parameters) {
            *alpha1 += half * extreme.sign * total(&angle, column);
        }
    }
    let mut derivatives = Derivatives::NONE;
    for column in 0..parameters {
        let variable = model.variable(column);
        if !problem.knows(variable) {
            continue;
        }
        let [even_d_m, dtheta_rad, sigma @ .., odd_d_m] =
            integrals.each_ref().map(|integral| total(integral, column));
        let is_odd = is_odd(column);
        let d_m = if is_odd { odd_d_m } else { even_d_m };
        let commanded = match (variable, problem.gait.joints[0]) {
            (Variable::Gait(0, AMPLITUDE), Some(command)) => command.amplitude_rad.signum(),
            _ => 0.0,
        };
        let faster = if variable == Variable::Frequency { cycle.metrics.d_m / TAU } else { 0.0 };
        let derivative = GaitMetrics {
            d_m,
            v_m_s: d_m * problem.omega_rad_s / TAU + faster,
            sigma: if is_odd { [0.0; 3] } else { sigma },
            alpha1_rad: if is_odd { 0.0 } else { alpha1[column] + commanded },
            dtheta_rad: if is_odd || !mesh.is_half { dtheta_rad } else { 0.0 },
        };
        derivatives.set(variable, derivative);
    }
    // The proportions of the roll resistances stay when their sum changes.
    let shares = problem.robot.roll_shares();
    let rolls = Parameter::ROLL.map(|roll| derivatives.parameters[roll].to_array());
    derivatives.parameters[Parameter::RollSum] =
        GaitMetrics::from_array(std::array::from_fn(|metric| {
            (0..3).map(|wheel| shares[wheel] * rolls[wheel][metric]).sum()
        }));
    Some(derivatives)
}

/// Adds `of (state)` to `sum`: the entries of `of` beside the states, and those of the states
/// times the states' own.
#[inline(always)]
fn compose<const N: usize>(
    of: &Affine,
    state: &[[f64; MOST_COLUMNS]; N],
    columns: usize,
    sum: &mut Affine,
) {
    for column in N..columns {
        sum[column] += of[column];
    }
    for (weight, state) in of.iter().zip(state) {
        for column in 0..columns {
            sum[column] += weight * state[column];
        }
    }
}

/// Adds to `own` the derivatives of a quantity with this gradient at the stages of an element,
/// with respect to the element's start and the parameters.
#[inline(always)]
fn contract<const N: usize, R: Reduced<N>>(
    gradient: &Stages<N>,
    duration_s: f64,
    right: &[f64],
    columns: usize,
    own: &mut Affine,
) {
    let per_stage = unknowns::<N, R>();
    let mut unknown_gradient = *gradient;
    if R::INTEGRATED {
        // The last state is its start plus the integral of the one before it.
        for j in 0..STAGES {
            own[N - 1] += gradient[j][N - 1];
            for l in 0..STAGES {
                unknown_gradient[l][N - 2] +=
                    duration_s * RADAU.integrate[j][l] * gradient[j][N - 1];
            }
        }
    }
    for j in 0..STAGES {
        for i in (0..per_stage).filter(|i| unknown_gradient[j][*i] != 0.0) {
            let row = &right[(j * per_stage + i) * columns..][..columns];
            for (own, entry) in own.iter_mut().zip(row) {
                *own += unknown_gradient[j][i] * entry;
            }
        }
    }
}

/// Derivatives of state `i` at an element's end with respect to its start and the parameters.
#[inline(always)]
fn element_end<const N: usize, R: Reduced<N>>(
    i: usize,
    duration_s: f64,
    right: &[f64],
    columns: usize,
) -> Affine {
    let (mut gradient, mut end) = ([[0.0; N]; STAGES], [0.0; MOST_COLUMNS]);
    gradient[STAGES - 1][i] = 1.0;
    contract::<N, R>(&gradient, duration_s, right, columns, &mut end);
    end
}

/// Derivatives of the passive joint's angle where it turns round with respect to the orbit's start
/// and the parameters. When it turns does not matter: its rate is zero there.
#[inline(always)]
fn angle_at<const N: usize, R: Reduced<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    extreme: &TurningPoint,
    before: &[Affine; N],
    workspace: &mut Linearisation,
    parameters: usize,
) -> Option<Affine> {
    let columns = N + parameters;
    let (nodes, stages) = extreme.shorter_element(model, mesh, workspace)?;
    let whole = mesh.element(extreme.element);
    let duration_s = extreme.fraction * whole.duration_s;
    let element = Element { nodes: &nodes, start: whole.start, stages: &stages, duration_s };
    let right = workspace.solve_sensitivity(model, &element, parameters);
    let end = element_end::<N, R>(N - 1, duration_s, right, columns);
    let mut angle = [0.0; MOST_COLUMNS];
    compose::<N>(&end, before, columns, &mut angle);
    Some(angle)
}

/// Gradients of the metrics that are integrals.
struct MetricGradient {
    /// Of d with respect to the pose at the end of the elements' span: x, y, theta.
    dd_dend: [f64; 3],
    /// The same of what is odd; `None` where nothing is or nobody asks.
    odd_dd_dend: Option<[f64; 3]>,
    end: Pose,
    /// How many times the span turns the robot over a period.
    turns: f64,
    duration_s: f64,
    /// Of sigma_i with respect to the integral of its wheel's skid velocity squared, doubled;
    /// zero where the wheel does not skid.
    dsigma_dskid: [f64; 3],
}

impl MetricGradient {
    fn new<const N: usize, R: Reduced<N>>(
        model: &R,
        mesh: &Mesh<N, R>,
        cycle: &Cycle,
        with_gait: bool,
    ) -> Self {
        let Pose { x_m: x, y_m: y, theta_rad } = cycle.end;
        // Of the half period and its mirror image.
        let whole = cycle.end * cycle.end.mirrored();
        let (sin, cos) = theta_rad.sin_cos();
        let turned = whole.x_m * (cos * y - sin * x) + whole.y_m * (cos * x + sin * y);
        let halves = |sign: f64| {
            let (sin, cos) = (sign * sin, sign * cos);
            [
                whole.x_m * (1.0 + cos) + whole.y_m * sin,
                whole.x_m * sin + whole.y_m * (1.0 - cos),
                turned,
            ]
        };
        let dd_dend = if mesh.is_half { halves(1.0) } else { [x, y, 0.0] };
        let odd_dd_dend = (mesh.is_half && with_gait).then(|| halves(-1.0));
        let scale = skid_scale(model.problem()).powi(2) * mesh.len() as f64;
        let dsigma_dskid = cycle.metrics.sigma.map(|sigma| match sigma {
            0.0 => 0.0,
            sigma => 1.0 / (scale * sigma),
        });
        // A distance of nothing has no gradient.
        let d_m = cycle.metrics.d_m;
        let scaled = |dd_dend: [f64; 3]| {
            if d_m > 0.0 { dd_dend.map(|slope| slope / d_m) } else { [0.0; 3] }
        };
        let (dd_dend, odd_dd_dend) = (scaled(dd_dend), odd_dd_dend.map(scaled));
        let turns = match (mesh.is_half, with_gait) {
            (false, _) => 1.0,
            (true, true) => 2.0,
            (true, false) => 0.0,
        };
        let (end, duration_s) = (cycle.end, mesh.element_s);
        Self { dd_dend, odd_dd_dend, end, turns, duration_s, dsigma_dskid }
    }

    /// Gradients of the integrals with respect to the robot's angles and velocities at the stages
    /// of an element.
    #[inline(always)]
    fn at_stages<R: Reduced<N>, const N: usize>(
        &self,
        model: &R,
        states: &[KinematicState; STAGES],
        poses: &[Pose; STAGES],
    ) -> [[KinematicState; STAGES]; INTEGRALS] {
        let mut gradients = [[KinematicState::default(); STAGES]; INTEGRALS];
        let weights = RADAU.integrate[STAGES - 1];
        gradients[0] = self.path(self.dd_dend, states, poses);
        if let Some(odd_dd_dend) = self.odd_dd_dend {
            gradients[INTEGRALS - 1] = self.path(odd_dd_dend, states, poses);
        }
        for j in 0..STAGES {
            gradients[1][j].velocity[2] = self.turns * self.duration_s * weights[j];
        }
        if R::SKIDS {
            let robot = &model.problem().robot;
            for (j, KinematicState { phi_rad, velocity }) in states.iter().enumerate() {
                let trig = Trig::new(*phi_rad);
                let (rows, slopes) = (skid_rows(robot, &trig), dskid_rows_dphi(robot, &trig));
                for (wheel, row) in rows.iter().enumerate() {
                    let gradient = &mut gradients[2 + wheel][j];
                    let factor = weights[j] * self.dsigma_dskid[wheel] * dot(row, velocity);
                    gradient.velocity = row.map(|entry| factor * entry);
                    if wheel > 0 {
                        gradient.phi_rad[wheel - 1] = factor * dot(&slopes[wheel - 1], velocity);
                    }
                }
            }
        }
        gradients
    }

    /// Gradients of d, given that with respect to the end.
    #[inline(always)]
    fn path(
        &self,
        [dd_dx, dd_dy, dd_dtheta]: [f64; 3],
        states: &[KinematicState; STAGES],
        poses: &[Pose; STAGES],
    ) -> [KinematicState; STAGES] {
        let mut d = [KinematicState::default(); STAGES];
        let weights = RADAU.integrate[STAGES - 1];
        let end = &poses[STAGES - 1];
        // Turning the rest of the path.
        let later = dd_dtheta + dd_dy * (self.end.x_m - end.x_m) - dd_dx * (self.end.y_m - end.y_m);
        for j in 0..STAGES {
            let weight = self.duration_s * weights[j];
            let (sin, cos) = poses[j].theta_rad.sin_cos();
            let [u, v, ..] = states[j].velocity;
            d[j].velocity[0] = weight * (dd_dx * cos + dd_dy * sin);
            d[j].velocity[1] = weight * (dd_dy * cos - dd_dx * sin);
            d[j].velocity[2] += weight * later;
            let turned = dd_dy * (u * cos - v * sin) - dd_dx * (u * sin + v * cos);
            for l in 0..STAGES {
                d[l].velocity[2] += weight * turned * self.duration_s * RADAU.integrate[j][l];
            }
        }
        d
    }
}
