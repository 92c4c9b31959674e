//! Derivatives of a steady cycle's metrics with respect to the parameters, in one pass over its
//! elements.
//!
//! Each element is linearised at the solution, the columns of the parameters beside those of
//! its start, and one element beside the other in lanes. Its end then is an affine function of its
//! start, and so are the metrics' integrals over it; composing these along the chain leaves an
//! `N x N` system for the derivatives of the orbit's start. Nothing is kept of an element once it
//! is passed, except where joint 1 turns round.

use std::f64::consts::TAU;

use nalgebra::{SMatrix, SVector};

use super::Problem;
use super::cycle::{Cycle, skid_scale};
use super::element::{Element, Linearisation, Stages, unknowns};
use super::extreme::{Extremes, TurningPoint};
use super::mesh::Mesh;
use super::path::{Leg, Path};
use super::radau::{RADAU, STAGES};
use super::reduced::{
    AMPLITUDE, Derivatives, KinematicState, MOST_PARAMETERS, OFFSET, Reduced, Variable,
};
use crate::metrics::GaitMetrics;
use crate::robot::{Lanes, Number, Parameter, Pose, dot, dskid_rows_dphi, skid_rows};

/// Most columns: states at the start, then parameters.
const MOST_COLUMNS: usize = 5 + MOST_PARAMETERS;

/// Derivatives with respect to the orbit's start (first `N` entries) and to the parameters.
type Affine<T = f64> = [T; MOST_COLUMNS];

/// Room for elements side by side, and for one.
type Workspaces<'a> = (&'a mut Linearisation<Lanes>, &'a mut Linearisation);

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
    (path, cycle): (&Path, &Cycle),
    workspaces: Workspaces,
    wanted: Option<&[Parameter]>,
) -> Option<Derivatives> {
    let is_wanted = |column| match (model.variable(column), wanted) {
        (Variable::Parameter(own), Some(wanted)) => wanted.iter().any(|of| own.is_part_of(*of)),
        _ => false,
    };
    // Numbers of columns that are known when this is compiled.
    if wanted.is_none() {
        first_derivatives(model, mesh, (path, cycle), workspaces, R::PARAMETERS)
    } else if (FIRST_PARAMETERS..R::OF_ROBOT).any(is_wanted) {
        first_derivatives(model, mesh, (path, cycle), workspaces, R::OF_ROBOT)
    } else {
        first_derivatives(model, mesh, (path, cycle), workspaces, FIRST_PARAMETERS)
    }
}

/// Derivatives with respect to the first `parameters` of the model.
#[inline(always)]
fn first_derivatives<const N: usize, R: Reduced<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    (path, cycle): (&Path, &Cycle),
    (linearisation, workspace): Workspaces,
    parameters: usize,
) -> Option<Derivatives> {
    let problem = model.problem();
    let columns = N + parameters;
    let gradient = MetricGradient::new(model, mesh, cycle, parameters > R::OF_ROBOT);
    // The mirror image of a motion is that of the opposite offsets: what changes by them half a
    // period later is the opposite of the mirror image of what changes now.
    let is_odd =
        |column| mesh.is_half && matches!(model.variable(column), Variable::Gait(_, OFFSET));
    let known = gradient.known();
    let mut integrals = [[0.0; MOST_COLUMNS]; INTEGRALS];
    let mut state = [[0.0; MOST_COLUMNS]; N];
    (0..N).for_each(|i| state[i][i] = 1.0);
    // Half a period later comes the opposite extreme.
    let extremes = cycle.extremes.map(|Extremes { highest, lowest }| match mesh.is_half {
        true => [Some((highest, 1.0)), None],
        false => [Some((highest, 0.5)), Some((lowest, -0.5))],
    });
    let extremes = extremes.unwrap_or_default();
    let mut state_at_extremes = [state; 2];
    for (pack, leg) in path.legs.iter().enumerate() {
        let starts = mesh.starts(pack);
        let element = mesh.pack(pack, &starts);
        let right = linearisation.solve_sensitivity(model, &element, parameters);
        let gradients = gradient.at_stages::<R, N>(model, leg);
        let mut own = [[Lanes::default(); MOST_COLUMNS]; INTEGRALS];
        for ((own, gradients), _) in own.iter_mut().zip(&gradients).zip(known).filter(|of| of.1) {
            let mut state_gradients = [[Lanes::default(); N]; STAGES];
            for (j, gradient) in gradients.iter().enumerate() {
                let (node, y) = (&element.nodes[j], &element.stages[j]);
                state_gradients[j] = model.state_gradient(node, y, gradient);
                if parameters > R::OF_ROBOT {
                    let slopes = model.gait_gradient(node, y, gradient);
                    for column in R::OF_ROBOT..parameters {
                        if let Variable::Gait(joint, number) = model.variable(column) {
                            own[N + column] += slopes[joint][number];
                        }
                    }
                }
            }
            contract::<N, R, _>(&state_gradients, mesh.element_s, right, columns, own);
        }
        let ends: [Affine<Lanes>; N] =
            std::array::from_fn(|i| element_end::<N, R, _>(i, mesh.element_s, right, columns));
        for (lane, k) in mesh.elements_of(pack).enumerate() {
            for ((extreme, _), before) in extremes.iter().flatten().zip(&mut state_at_extremes) {
                if extreme.element == k {
                    *before = state;
                }
            }
            for ((integral, own), _) in integrals.iter_mut().zip(&own).zip(known).filter(|of| of.1)
            {
                compose::<N, _>(own, lane, &state, columns, integral);
            }
            let mut next = [[0.0; MOST_COLUMNS]; N];
            for (end, next) in ends.iter().zip(&mut next) {
                compose::<N, _>(end, lane, &state, columns, next);
            }
            state = next;
        }
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
    for ((extreme, part), before) in extremes.iter().flatten().zip(&state_at_extremes) {
        let angle = angle_at(model, mesh, extreme, before, workspace, parameters)?;
        for (column, alpha1) in alpha1.iter_mut().enumerate().take(parameters) {
            *alpha1 += part * extreme.sign * total(&angle, column);
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
        let derivative = GaitMetrics {
            d_m,
            v_m_s: d_m * problem.omega_rad_s / TAU,
            sigma: if is_odd { [0.0; 3] } else { sigma },
            alpha1_rad: if is_odd { 0.0 } else { alpha1[column] + commanded },
            dtheta_rad: if is_odd || !mesh.is_half { dtheta_rad } else { 0.0 },
        };
        derivatives.set(variable, derivative);
    }
    if parameters > R::OF_ROBOT {
        derivatives.omega = domega(problem, cycle, &derivatives);
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

/// Derivatives with respect to omega, from those with respect to the robot's parameters: per
/// radian of phase the motion depends on dissipation over omega and on stiffness over its square.
fn domega(problem: &Problem, cycle: &Cycle, derivatives: &Derivatives) -> GaitMetrics {
    let mut sum = GaitMetrics { v_m_s: cycle.metrics.d_m / TAU, ..GaitMetrics::NONE }.to_array();
    for (parameter, derivative) in derivatives.parameters.iter() {
        let power = if parameter == Parameter::Stiffness { 2.0 } else { 1.0 };
        let part = power * parameter.of(&problem.robot) / problem.omega_rad_s;
        for (sum, derivative) in sum.iter_mut().zip(derivative.to_array()) {
            *sum -= part * derivative;
        }
    }
    GaitMetrics::from_array(sum)
}

/// Adds `of (state)` to `sum`: the entries in a lane of `of` beside the states, and those of the
/// states times the states' own.
#[inline(always)]
fn compose<const N: usize, T: Number>(
    of: &Affine<T>,
    lane: usize,
    state: &[[f64; MOST_COLUMNS]; N],
    columns: usize,
    sum: &mut Affine,
) {
    for column in N..columns {
        sum[column] += of[column].lane(lane);
    }
    for (weight, state) in of.iter().zip(state) {
        for column in 0..columns {
            sum[column] += weight.lane(lane) * state[column];
        }
    }
}

/// Adds to `own` the derivatives of a quantity with this gradient at the stages of an element,
/// with respect to the element's start and the parameters.
#[inline(always)]
fn contract<const N: usize, R: Reduced<N>, T: Number>(
    gradient: &Stages<N, T>,
    duration_s: f64,
    right: &[T],
    columns: usize,
    own: &mut Affine<T>,
) {
    let per_stage = unknowns::<N, R>();
    let mut unknown_gradient = *gradient;
    if R::INTEGRATED {
        // The last state is its start plus the integral of the one before it.
        for j in 0..STAGES {
            own[N - 1] += gradient[j][N - 1];
            for l in 0..STAGES {
                unknown_gradient[l][N - 2] +=
                    T::of(duration_s * RADAU.integrate[j][l]) * gradient[j][N - 1];
            }
        }
    }
    for j in 0..STAGES {
        for i in 0..per_stage {
            let row = &right[(j * per_stage + i) * columns..][..columns];
            for (own, entry) in own.iter_mut().zip(row) {
                *own += unknown_gradient[j][i] * *entry;
            }
        }
    }
}

/// Derivatives of state `i` at an element's end with respect to its start and the parameters.
#[inline(always)]
fn element_end<const N: usize, R: Reduced<N>, T: Number>(
    i: usize,
    duration_s: f64,
    right: &[T],
    columns: usize,
) -> Affine<T> {
    let per_stage = unknowns::<N, R>();
    let mut end = [T::of(0.0); MOST_COLUMNS];
    let mut add = |weight: T, row: usize| {
        let row = &right[row * columns..][..columns];
        end.iter_mut().zip(row).for_each(|(end, entry)| *end += weight * *entry);
    };
    if i < per_stage {
        add(T::of(1.0), (STAGES - 1) * per_stage + i);
    } else {
        // The last state is its start plus the integral of the one before it.
        for (l, weight) in RADAU.integrate[STAGES - 1].iter().enumerate() {
            add(T::of(duration_s * weight), l * per_stage + i - 1);
        }
        end[i] += T::of(1.0);
    }
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
    let (start, duration_s) =
        (mesh.states.start_of(extreme.element), extreme.fraction * mesh.element_s);
    let element = Element { nodes: &nodes, start: &start, stages: &stages, duration_s };
    let right = workspace.solve_sensitivity(model, &element, parameters);
    let end = element_end::<N, R, _>(N - 1, duration_s, right, columns);
    let mut angle = [0.0; MOST_COLUMNS];
    compose::<N, _>(&end, 0, before, columns, &mut angle);
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
        let scale = skid_scale(model.problem()).powi(2) * mesh.count as f64;
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

    /// Which of the integrals have a gradient.
    fn known(&self) -> [bool; INTEGRALS] {
        let [sigma0, sigma1, sigma2] = self.dsigma_dskid.map(|slope| slope != 0.0);
        [true, self.turns != 0.0, sigma0, sigma1, sigma2, self.odd_dd_dend.is_some()]
    }

    /// Gradients of the integrals with respect to the robot's angles and velocities at the stages
    /// of elements in lanes, each on its own path.
    #[inline(always)]
    fn at_stages<R: Reduced<N>, const N: usize>(
        &self,
        model: &R,
        leg: &Leg,
    ) -> [[KinematicState<Lanes>; STAGES]; INTEGRALS] {
        let mut gradients = [[KinematicState::default(); STAGES]; INTEGRALS];
        let weights = RADAU.integrate[STAGES - 1];
        gradients[0] = self.path(self.dd_dend, leg);
        if let Some(odd_dd_dend) = self.odd_dd_dend {
            gradients[INTEGRALS - 1] = self.path(odd_dd_dend, leg);
        }
        for j in 0..STAGES {
            gradients[1][j].velocity[2] = Lanes::splat(self.turns * self.duration_s * weights[j]);
        }
        if R::SKIDS {
            let robot = &model.problem().robot;
            for (j, KinematicState { velocity, .. }) in leg.states.iter().enumerate() {
                let trig = &leg.trig[j];
                let (rows, slopes) = (skid_rows(robot, trig), dskid_rows_dphi(robot, trig));
                for (wheel, row) in rows.iter().enumerate() {
                    let gradient = &mut gradients[2 + wheel][j];
                    let factor = Lanes::splat(weights[j] * self.dsigma_dskid[wheel]);
                    let factor = factor * dot(row, velocity);
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
        dd_dend: [f64; 3],
        Leg { states, directions, ends: [end_x, end_y], .. }: &Leg,
    ) -> [KinematicState<Lanes>; STAGES] {
        let mut d = [KinematicState::default(); STAGES];
        let [dd_dx, dd_dy, dd_dtheta] = dd_dend.map(Lanes::splat);
        // Turning the rest of the path.
        let [whole_x, whole_y] = [self.end.x_m, self.end.y_m].map(Lanes::splat);
        let later = dd_dtheta + dd_dy * (whole_x - *end_x) - dd_dx * (whole_y - *end_y);
        for j in 0..STAGES {
            let weight = Lanes::splat(self.duration_s * RADAU.integrate[STAGES - 1][j]);
            let (sin, cos) = directions[j];
            let [u, v, ..] = states[j].velocity;
            let (along, across) = (dd_dx * cos + dd_dy * sin, dd_dy * cos - dd_dx * sin);
            d[j].velocity[0] = weight * along;
            d[j].velocity[1] = weight * across;
            d[j].velocity[2] += weight * later;
            let turned = weight * (u * across - v * along);
            for l in 0..STAGES {
                d[l].velocity[2] += turned * Lanes::splat(self.duration_s * RADAU.integrate[j][l]);
            }
        }
        d
    }
}
