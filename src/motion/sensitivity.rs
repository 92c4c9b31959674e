//! Derivatives of a steady cycle's metrics by the parameters, in one pass over its elements.
//!
//! Each element is linearised at the solution, the columns of the parameters beside those of
//! its start. Its end then is an affine function of its start, and so are the metrics'
//! integrals over it; composing these along the chain leaves an `N x N` system for how the
//! ring's start answers to the parameters. Nothing is kept of an element once it is passed,
//! except where joint 1 turns round.

use std::f64::consts::TAU;

use nalgebra::SMatrix;

use super::MotionError;
use super::cycle::{Cycle, moments, skid_scale};
use super::element::{Linearised, Stages, unknowns};
use super::extreme::Turn;
use super::path::advance;
use super::radau::{RADAU, STAGES};
use super::reduced::{Derivatives, Driven, MOST_PARAMETERS, Moment, Reduced, Variable};
use super::ring::Ring;
use crate::metrics::GaitMetrics;
use crate::robot::{Parameter, Pose, Trig, dot, dskid_rows_dphi, skid_rows};

/// Most columns: states at the start, then parameters.
pub(super) const MOST_COLUMNS: usize = 5 + MOST_PARAMETERS;

/// Something that depends on the ring's start (first `N` entries) and on the parameters.
type Affine = [f64; MOST_COLUMNS];

/// The metrics that are integrals over the cycle: d, Delta theta, and sigma of the wheels.
const INTEGRALS: usize = 5;

/// The model's first parameters: the skid coefficients, where its wheels skid.
const FIRST_PARAMETERS: usize = 3;

/// Derivatives of the metrics of the ring's solution by the parameters that are `wanted`, or by
/// everything; those by others may be missing.
///
/// # Errors
/// The linearised motion is singular: it is where two solutions meet.
pub(super) fn differentiate<const N: usize, R: Reduced<N>>(
    model: &R,
    driven: &Driven,
    ring: &Ring<N, R>,
    cycle: &Cycle,
    room: &mut Linearised,
    wanted: Option<&[Parameter]>,
) -> Result<Derivatives, MotionError> {
    let is_wanted = |variable| match (variable, wanted) {
        (_, None) => true,
        (Variable::Parameter(own), Some(wanted)) => wanted.iter().any(|of| own.is_part_of(*of)),
        (Variable::Amplitude(_), Some(_)) => false,
    };
    let mut others = (FIRST_PARAMETERS..R::PARAMETERS).map(|column| model.variable(column));
    // Numbers of columns that are known when this is compiled.
    match others.any(is_wanted) {
        true => by_first(model, driven, ring, cycle, room, R::PARAMETERS),
        false => by_first(model, driven, ring, cycle, room, FIRST_PARAMETERS),
    }
}

/// Derivatives by the first `parameters` of the model.
#[inline(always)]
fn by_first<const N: usize, R: Reduced<N>>(
    model: &R,
    driven: &Driven,
    ring: &Ring<N, R>,
    cycle: &Cycle,
    room: &mut Linearised,
    parameters: usize,
) -> Result<Derivatives, MotionError> {
    let singular = MotionError::NotConverged { steps: ring.steps() };
    let columns = N + parameters;
    let gradient = Gradient::new(driven, ring.is_half(), ring.len(), ring.element_s(), cycle);
    let mut integrals = [[0.0; MOST_COLUMNS]; INTEGRALS];
    let mut state = [[0.0; MOST_COLUMNS]; N];
    (0..N).for_each(|i| state[i][i] = 1.0);
    let turns = cycle.extremes.map(|extremes| [extremes.highest, extremes.lowest]);
    let mut state_at_turns = [state; 2];
    let mut pose = Pose::default();
    for k in 0..ring.len() {
        for (turn, state_at_turn) in turns.iter().flatten().zip(&mut state_at_turns) {
            if turn.element == k {
                *state_at_turn = state;
            }
        }
        let (nodes, start, stages) = ring.element(k);
        let duration_s = ring.element_s();
        room.sensitise(model, nodes, start, stages, duration_s, parameters)
            .ok_or(singular.clone())?;
        let right = room.sensitivity();

        let moments = moments(model, ring, k);
        let poses = advance(pose, &moments, duration_s);
        pose = poses[STAGES - 1];
        let by_moment = gradient.by_moments::<R, N>(driven, &moments, &poses);
        for (integral, by_moment) in integrals.iter_mut().zip(&by_moment) {
            if by_moment.iter().flatten().all(|part| *part == 0.0) {
                continue;
            }
            let by_moment = by_moment.map(|[phi1, phi2, u, v, r, w1, w2]| Moment {
                phi_rad: [phi1, phi2],
                velocity: [u, v, r, w1, w2],
            });
            let mut own = [0.0; MOST_COLUMNS];
            for j in 0..STAGES {
                let by_amplitude = model.by_amplitude(&nodes[j], &stages[j], &by_moment[j]);
                for column in 0..parameters {
                    if let Variable::Amplitude(a) = model.variable(column) {
                        own[N + column] += by_amplitude[a];
                    }
                }
            }
            let by_state: Stages<N> =
                std::array::from_fn(|j| model.by_state(&nodes[j], &stages[j], &by_moment[j]));
            contract::<N, R>(&by_state, duration_s, right, columns, &mut own);
            compose::<N>(&own, &state, columns, integral);
        }
        let ends = element_ends::<N, R>(duration_s, right, columns);
        let mut next = [[0.0; MOST_COLUMNS]; N];
        for (next, end) in next.iter_mut().zip(&ends) {
            compose::<N>(end, &state, columns, next);
        }
        state = next;
    }

    // The ring closes: x = S (A x + B).
    let signs = ring.signs();
    let open = SMatrix::<f64, N, N>::from_fn(|i, m| {
        let unit = if i == m { 1.0 } else { 0.0 };
        unit - signs[i] * state[i][m]
    });
    let closing = open.try_inverse().ok_or(singular.clone())?;
    let start = |column: usize| -> [f64; N] {
        let right = nalgebra::SVector::<f64, N>::from_fn(|i, _| signs[i] * state[i][N + column]);
        (closing * right).into()
    };
    let starts: [[f64; N]; MOST_PARAMETERS] =
        std::array::from_fn(|column| if column < parameters { start(column) } else { [0.0; N] });
    let whole = |affine: &Affine, column: usize| -> f64 {
        affine[N + column] + (0..N).map(|i| affine[i] * starts[column][i]).sum::<f64>()
    };

    let mut alpha1 = [0.0; MOST_PARAMETERS];
    if let Some(turns) = turns {
        for ((turn, before), half) in turns.iter().zip(&state_at_turns).zip([0.5, -0.5]) {
            let by = angle_at_turn(model, driven, ring, turn, before, room, parameters)
                .ok_or(singular.clone())?;
            for (column, alpha1) in alpha1.iter_mut().enumerate().take(parameters) {
                *alpha1 += half * turn.sign * whole(&by, column);
            }
        }
    }
    let mut derivatives = Derivatives::NONE;
    for column in 0..parameters {
        let variable = model.variable(column);
        if !driven.knows(variable) {
            continue;
        }
        let [d_m, dtheta_rad, sigma0, sigma1, sigma2] =
            integrals.each_ref().map(|integral| whole(integral, column));
        let commanded = match (variable, driven.gait.joints[0]) {
            (Variable::Amplitude(0), Some(command)) => command.amplitude_rad.signum(),
            _ => 0.0,
        };
        let derivative = GaitMetrics {
            d_m,
            v_m_s: d_m * driven.omega_rad_s / TAU,
            sigma: [sigma0, sigma1, sigma2],
            alpha1_rad: alpha1[column] + commanded,
            dtheta_rad,
        };
        derivatives.set(variable, derivative);
    }
    derivatives.parameters[Parameter::RollSum] = by_roll_sum(driven, &derivatives);
    Ok(derivatives)
}

/// Derivative by the sum of the roll resistances, whose proportions stay.
fn by_roll_sum(driven: &Driven, derivatives: &Derivatives) -> GaitMetrics {
    let shares = driven.robot.roll_shares();
    let by_wheel = Parameter::ROLL.map(|roll| derivatives.parameters[roll].to_array());
    GaitMetrics::from_array(std::array::from_fn(|metric| {
        (0..3).map(|wheel| shares[wheel] * by_wheel[wheel][metric]).sum()
    }))
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

/// Adds to `own` how a quantity with the gradient `by_state` at the stages of an element
/// depends on the element's start and on the parameters.
#[inline(always)]
fn contract<const N: usize, R: Reduced<N>>(
    by_state: &Stages<N>,
    duration_s: f64,
    right: &[f64],
    columns: usize,
    own: &mut Affine,
) {
    let per_stage = unknowns::<N, R>();
    let mut by_unknown = *by_state;
    if R::INTEGRATED {
        // The last state is its start plus the integral of the one before it.
        for j in 0..STAGES {
            own[N - 1] += by_state[j][N - 1];
            for l in 0..STAGES {
                by_unknown[l][N - 2] += duration_s * RADAU.integrate[j][l] * by_state[j][N - 1];
            }
        }
    }
    for j in 0..STAGES {
        for i in 0..per_stage {
            let row = &right[(j * per_stage + i) * columns..][..columns];
            for (own, entry) in own.iter_mut().zip(row) {
                *own += by_unknown[j][i] * entry;
            }
        }
    }
}

/// How the states at an element's end depend on its start and on the parameters.
#[inline(always)]
fn element_ends<const N: usize, R: Reduced<N>>(
    duration_s: f64,
    right: &[f64],
    columns: usize,
) -> [[f64; MOST_COLUMNS]; N] {
    let per_stage = unknowns::<N, R>();
    let mut ends = [[0.0; MOST_COLUMNS]; N];
    for (i, end) in ends.iter_mut().enumerate().take(per_stage) {
        let row = &right[((STAGES - 1) * per_stage + i) * columns..][..columns];
        end[..columns].copy_from_slice(row);
    }
    if R::INTEGRATED {
        ends[N - 1] = integral_at_end::<N, R>(duration_s, right, columns);
    }
    ends
}

/// The same of the last state, where it is the integral of the one before it.
#[inline(always)]
fn integral_at_end<const N: usize, R: Reduced<N>>(
    duration_s: f64,
    right: &[f64],
    columns: usize,
) -> Affine {
    let per_stage = unknowns::<N, R>();
    let mut end = [0.0; MOST_COLUMNS];
    end[N - 1] = 1.0;
    for l in 0..STAGES {
        let weight = duration_s * RADAU.integrate[STAGES - 1][l];
        let row = &right[(l * per_stage + N - 2) * columns..][..columns];
        for (end, entry) in end.iter_mut().zip(row) {
            *end += weight * entry;
        }
    }
    end
}

/// How the passive joint's angle where it turns round depends on the ring's start and on the
/// parameters. When it turns does not matter: its rate is zero there.
#[inline(always)]
fn angle_at_turn<const N: usize, R: Reduced<N>>(
    model: &R,
    driven: &Driven,
    ring: &Ring<N, R>,
    turn: &Turn,
    before: &[[f64; MOST_COLUMNS]; N],
    room: &mut Linearised,
    parameters: usize,
) -> Option<Affine> {
    let columns = N + parameters;
    let (nodes, stages) = turn.shorter(model, driven, ring, room)?;
    let (_, start, _) = ring.element(turn.element);
    let duration_s = turn.part * ring.element_s();
    room.sensitise(model, &nodes, start, &stages, duration_s, parameters)?;
    let right = room.sensitivity();
    let end = element_ends::<N, R>(duration_s, right, columns)[N - 1];
    let mut angle = [0.0; MOST_COLUMNS];
    compose::<N>(&end, before, columns, &mut angle);
    Some(angle)
}

/// Gradient of the metrics that are integrals.
struct Gradient {
    /// Gradient of d with respect to the pose at the end of the elements' span: x, y, theta.
    by_end: [f64; 3],
    end: Pose,
    is_half: bool,
    duration_s: f64,
    /// Gradient of sigma_i with respect to the integral of its wheel's skid velocity squared,
    /// doubled; zero where the wheel does not skid.
    by_skid: [f64; 3],
}

impl Gradient {
    fn new(driven: &Driven, is_half: bool, count: usize, duration_s: f64, cycle: &Cycle) -> Self {
        let Pose { x_m: x, y_m: y, theta_rad } = cycle.end;
        let (sin, cos) = theta_rad.sin_cos();
        let by_end = if is_half {
            // Of the half period and its mirror image, see `with_mirror_image`.
            let (whole_x, whole_y) = (x + cos * x + sin * y, y + sin * x - cos * y);
            [
                whole_x * (1.0 + cos) + whole_y * sin,
                whole_x * sin + whole_y * (1.0 - cos),
                whole_x * (cos * y - sin * x) + whole_y * (cos * x + sin * y),
            ]
        } else {
            [x, y, 0.0]
        };
        let scale = skid_scale(driven).powi(2) * count as f64;
        let by_skid = cycle.metrics.sigma.map(|sigma| match sigma {
            0.0 => 0.0,
            sigma => 1.0 / (scale * sigma),
        });
        // A distance of nothing has no gradient.
        let d_m = cycle.metrics.d_m;
        let by_end = if d_m > 0.0 { by_end.map(|part| part / d_m) } else { [0.0; 3] };
        Self { by_end, end: cycle.end, is_half, duration_s, by_skid }
    }

    /// Gradients of the integrals with respect to phi1, phi2, u, v, theta', phi1', phi2' at the
    /// stages of an element.
    #[inline(always)]
    fn by_moments<R: Reduced<N>, const N: usize>(
        &self,
        driven: &Driven,
        moments: &[Moment; STAGES],
        poses: &[Pose; STAGES],
    ) -> [[[f64; 7]; STAGES]; INTEGRALS] {
        let mut by = [[[0.0; 7]; STAGES]; INTEGRALS];
        let [by_x, by_y, by_theta] = self.by_end;
        let weights = RADAU.integrate[STAGES - 1];
        let end = &poses[STAGES - 1];
        // Turning the rest of the way.
        let later = by_theta + by_y * (self.end.x_m - end.x_m) - by_x * (self.end.y_m - end.y_m);
        for j in 0..STAGES {
            let weight = self.duration_s * weights[j];
            let (sin, cos) = poses[j].theta_rad.sin_cos();
            let [u, v, ..] = moments[j].velocity;
            by[0][j][2] = weight * (by_x * cos + by_y * sin);
            by[0][j][3] = weight * (by_y * cos - by_x * sin);
            by[0][j][4] += weight * later;
            let turned = by_y * (u * cos - v * sin) - by_x * (u * sin + v * cos);
            for l in 0..STAGES {
                by[0][l][4] += weight * turned * self.duration_s * RADAU.integrate[j][l];
            }
            if !self.is_half {
                by[1][j][4] = weight;
            }
        }
        if R::SKIDS {
            for (j, moment) in moments.iter().enumerate() {
                let trig = Trig::new(moment.phi_rad);
                let rows = skid_rows(&driven.robot, &trig);
                let turns = dskid_rows_dphi(&driven.robot, &trig);
                for (wheel, row) in rows.iter().enumerate() {
                    let by = &mut by[2 + wheel][j];
                    let factor = weights[j] * self.by_skid[wheel] * dot(row, &moment.velocity);
                    (0..5).for_each(|i| by[2 + i] = factor * row[i]);
                    if wheel > 0 {
                        by[wheel - 1] = factor * dot(&turns[wheel - 1], &moment.velocity);
                    }
                }
            }
        }
        by
    }
}
