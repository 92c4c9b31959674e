//! Derivatives of the metrics of a steady-state cycle with respect to the parameters, by the adjoint method.
//!
//! The adjoint method is efficient because there are fewer metrics than states and parameters. The
//! collocation elements are linearised at the solution and packed into SIMD lanes, and the transposed system
//! of each element is solved for the metrics' integrals over the element and for the states at its end. The
//! derivatives of the metrics with respect to the state at an element's start follow from those with respect
//! to the state at its end, recursively from the last element to the first; periodicity leaves an `N x N`
//! system for the derivatives at the end of the last element. The derivatives of the residuals with respect
//! to the parameters are needed only once all adjoint solutions are known.

use std::f64::consts::TAU;

use nalgebra::{SMatrix, SVector};
use trilink_robot::metrics::{GaitMetrics, padded};
use trilink_robot::{LANES, Lanes, Number, Parameter};

use super::Problem;
use super::cycle::Cycle;
use super::element::{Element, Linearisation};
use super::extreme::{Extremes, TurningPoint};
use super::gradient::{
    DISTANCE, MetricGradient, ODD, ODD_DISTANCE, WORK, add_gait_gradient, weights_of_unknowns,
};
use super::mesh::Mesh;
use super::path::Path;
use super::radau::STAGES;
use super::reduced::{COMMAND_SIZE, Derivatives, MAX_PARAMETERS, ThreeLink, Variable};

/// One value for each variable with respect to which a motion is differentiated.
type ByParameters<T = f64> = [T; MAX_PARAMETERS];

/// Workspaces for several elements at a time (one per SIMD lane), for a single element, and for the adjoint
/// solutions.
pub(super) struct Workspaces<'a> {
    pub linearisation: &'a mut Linearisation<Lanes>,
    pub workspace: &'a mut Linearisation,
    pub adjoints: &'a mut Adjoints,
}

/// Adjoint solutions for every pack of elements (one element per SIMD lane); the buffers are reused.
#[derive(Debug, Clone, Default)]
pub(super) struct Adjoints {
    /// Solutions of the elements' transposed linear systems for the quantities of [`MetricGradient`].
    quantities: Vec<Lanes>,
    /// Solutions of the elements' transposed linear systems for the states at their ends.
    ends: Vec<Lanes>,
    /// Solutions of the elements' transposed linear systems for half the range of joint 1 (alpha1), one pack
    /// at a time.
    alpha1: Vec<Lanes>,
    /// Derivatives of each element's contributions to the quantities of [`MetricGradient`], and of the state
    /// at its end, with respect to the state at its start.
    start_gradients: Vec<Lanes>,
    /// Derivatives, with respect to the states at the elements' ends, of the quantities of [`MetricGradient`]
    /// over the whole motion and, if joint 1 can be passive, of half the range of joint 1 (alpha1).
    end_gradients: Vec<[f64; LANES]>,
}

impl Adjoints {
    /// Resizes the buffers for `packs` packs of elements, given the numbers of unknowns per element, quantities, rows
    /// of `end_gradients` per pack, and states.
    fn resize(&mut self, packs: usize, [size, quantities, rows, states]: [usize; 4]) {
        let zero = Lanes::default();
        self.quantities.resize(packs * size * quantities, zero);
        self.ends.resize(packs * size * states, zero);
        self.alpha1.resize(size, zero);
        self.start_gradients.resize(packs * (quantities + states) * states, zero);
        // Padded lanes remain zero.
        self.end_gradients.clear();
        self.end_gradients.resize(packs * rows * states, [0.0; LANES]);
    }
}

/// Returns the `count` rows of length `K` that `entries` contains for a pack of elements.
fn rows_of<const K: usize, T>(entries: &[T], pack: usize, count: usize) -> &[[T; K]] {
    entries[pack * count * K..][..count * K].as_chunks::<K>().0
}

/// Returns mutable references to the `count` rows of length `K` that `entries` contains for a pack of
/// elements.
fn rows_of_mut<const K: usize, T>(entries: &mut [T], pack: usize, count: usize) -> &mut [[T; K]] {
    entries[pack * count * K..][..count * K].as_chunks_mut::<K>().0
}

/// Returns the derivatives of the metrics of the solution on a mesh with respect to the `wanted` parameters,
/// or to all variables if `wanted` is `None`; other derivatives may be zero. Returns `None` if the linearised
/// equations are singular, which happens where two solutions meet.
pub(super) fn differentiate<const N: usize, R: ThreeLink<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    solution: (&Path<N, R>, &Cycle<N>),
    workspaces: Workspaces,
    wanted: Option<&[Parameter]>,
) -> Option<Derivatives> {
    // Fits evaluate these derivatives repeatedly; their numbers of quantities and columns are compile-time
    // constants.
    let of_robot = R::ROBOT_VARIABLES;
    let all = columns::<N, R>(model.problem());
    match (R::SKIDS, wanted.is_some(), mesh.is_half) {
        (true, true, true) => {
            differentiate_metrics::<N, R, 0, 4>(model, mesh, solution, workspaces, of_robot)
        }
        (true, true, false) => {
            differentiate_metrics::<N, R, 0, 5>(model, mesh, solution, workspaces, of_robot)
        }
        (false, true, true) => {
            differentiate_metrics::<N, R, 3, 1>(model, mesh, solution, workspaces, of_robot)
        }
        (false, true, false) => {
            differentiate_metrics::<N, R, 3, 2>(model, mesh, solution, workspaces, of_robot)
        }
        (true, false, _) => {
            differentiate_metrics::<N, R, 0, 6>(model, mesh, solution, workspaces, all)
        }
        (false, false, _) => {
            differentiate_metrics::<N, R, 3, 3>(model, mesh, solution, workspaces, all)
        }
    }
}

/// Returns the number of columns of derivatives: one for each variable on which the motion can depend. Second harmonics
/// are included only if the gait has any.
fn columns<const N: usize, R: ThreeLink<N>>(problem: &Problem) -> usize {
    if problem.gait.has_second() { R::PARAMETERS } else { R::FIRST_HARMONIC_VARIABLES }
}

/// Returns the derivatives, with respect to all variables, of the displacement over a cycle (m) and of the work of the
/// actuators over a cycle (J). The work equals the energy dissipated by friction, `loss_j` (J). Returns `None` if the
/// linearised equations are singular.
pub(super) fn differentiate_distance<const N: usize, R: ThreeLink<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    solution: (&Path<N, R>, &Cycle<N>),
    workspaces: Workspaces,
    loss_j: f64,
) -> Option<[Derivatives<f64>; 2]> {
    let problem = model.problem();
    let parameters = columns::<N, R>(problem);
    let (sums, _) =
        solve_adjoints::<N, R, DISTANCE, 4>(model, mesh, solution, workspaces, parameters, None)?;
    let sum = |quantity: usize, column: usize| sums[quantity - DISTANCE][column];
    let mut derivatives = [Derivatives::splat(0.0); 2];
    let [distance, work] = &mut derivatives;
    for column in 0..parameters {
        let variable = model.variable(column);
        if !problem.depends_on(variable) {
            continue;
        }
        let is_odd = is_odd(mesh, variable);
        distance.set(variable, sum(if is_odd { ODD_DISTANCE } else { DISTANCE }, column));
        if !is_odd {
            work.set(variable, sum(WORK, column) / mesh.periods as f64);
        }
    }
    Some([
        distance.with_omega_and_sums(problem, 0.0),
        work.with_omega_and_sums(problem, 2.0 * loss_j),
    ])
}

/// Returns whether the mesh covers half a period and a variable affects the motion with opposite signs in the two
/// halves of the period: mirroring a motion reverses the offsets and second harmonics of its commands.
fn is_odd<const N: usize, R: ThreeLink<N>>(mesh: &Mesh<N, R>, variable: Variable) -> bool {
    mesh.is_half && variable.is_odd()
}

/// Returns the derivatives of the metrics with respect to the first `parameters` variables of the model, assembled from
/// those of the `C` quantities of [`MetricGradient`] from index `FIRST` on, and of half the range of joint 1 (alpha1).
/// Returns `None` if the linearised equations are singular or a turning point of joint 1 cannot be resolved.
#[inline(always)]
fn differentiate_metrics<const N: usize, R: ThreeLink<N>, const FIRST: usize, const C: usize>(
    model: &R,
    mesh: &Mesh<N, R>,
    solution: (&Path<N, R>, &Cycle<N>),
    workspaces: Workspaces,
    parameters: usize,
) -> Option<Derivatives> {
    let cycle = solution.1;
    let (sums, alpha1) = solve_adjoints::<N, R, FIRST, C>(
        model,
        mesh,
        solution,
        workspaces,
        parameters,
        cycle.extremes.as_ref(),
    )?;
    Some(derivatives_of(model, mesh, cycle, parameters, |column| {
        let mut quantities = [0.0; 6];
        (0..C).for_each(|q| quantities[FIRST + q] = sums[q][column]);
        (quantities, alpha1[column])
    }))
}

/// Returns the derivatives of the `C` quantities of [`MetricGradient`] from index `FIRST` on, and of half the range
/// between the `extremes` of joint 1 (alpha1), with respect to the first `parameters` variables. Returns `None` if the
/// linearised equations are singular or a turning point of joint 1 cannot be resolved.
#[inline(always)]
fn solve_adjoints<const N: usize, R: ThreeLink<N>, const FIRST: usize, const C: usize>(
    model: &R,
    mesh: &Mesh<N, R>,
    (path, cycle): (&Path<N, R>, &Cycle<N>),
    workspaces: Workspaces,
    parameters: usize,
    extremes: Option<&Extremes<N>>,
) -> Option<([ByParameters; C], ByParameters)> {
    let Workspaces { linearisation, workspace, adjoints } = workspaces;
    let per_stage = R::UNKNOWNS;
    let size = per_stage * STAGES;
    let rows_per_pack = C + R::ANGLES;
    adjoints.resize(mesh.packs(), [size, C, rows_per_pack, N]);
    let gradient = MetricGradient::new(model, mesh, cycle);
    let mut sums = [[Lanes::default(); MAX_PARAMETERS]; C];
    for (pack, leg) in path.legs.iter().enumerate() {
        let starts = mesh.starts(pack);
        let element = mesh.pack(pack, &starts);
        linearisation.linearise_all(pack, model, &element, parameters);
        let rows = rows_of_mut::<C, _>(&mut adjoints.quantities, pack, size);
        let weights = mesh.weights(pack);
        let mut last_start_gradients = [Lanes::default(); C];
        for q in 0..C {
            let gradients = gradient.at_stages(model, FIRST + q, leg, weights);
            let unknown_weights;
            (unknown_weights, last_start_gradients[q]) =
                weights_of_unknowns(model, &element, leg, &gradients);
            for j in 0..STAGES {
                for i in 0..per_stage {
                    rows[j * per_stage + i][q] = unknown_weights[j][i];
                }
            }
            // If the wheels skid, d and Delta theta depend on the states alone.
            if parameters > R::ROBOT_VARIABLES && (!R::SKIDS || !(3..WORK).contains(&(FIRST + q))) {
                let sum = &mut sums[q];
                add_gait_gradient(model, &element, leg, &gradients, parameters, sum);
            }
            if FIRST + q == WORK {
                gradient.add_work_slopes(model, leg, weights, &mut sums[q]);
            }
        }
        let mut start_gradients = linearisation.solve_adjoint::<N, R, C>(pack, 0, rows);
        for q in 0..C {
            start_gradients[q][N - 1] += last_start_gradients[q];
        }
        let rows = rows_of_mut::<N, _>(&mut adjoints.ends, pack, size);
        let ends = linearisation.solve_adjoint_of_end::<N, R>(pack, element.duration_s, rows);
        let starts_of_pack = rows_of_mut::<N, _>(&mut adjoints.start_gradients, pack, C + N);
        starts_of_pack[..C].copy_from_slice(&start_gradients);
        starts_of_pack[C..].copy_from_slice(&ends);
    }

    // With half-period symmetry, the opposite extreme follows half a period later.
    let mut alpha1 = [0.0; MAX_PARAMETERS];
    let mut turns = [None; 2];
    if let Some(Extremes { highest, lowest }) = extremes {
        let parts = if mesh.is_half { [1.0, 0.0] } else { [0.5, -0.5] };
        for ((extreme, part), turn) in [highest, lowest].into_iter().zip(parts).zip(&mut turns) {
            if part != 0.0 {
                let angle = angle_at(model, mesh, extreme, workspace, parameters)?;
                let weight = part * extreme.sign;
                *turn = Some((extreme.element, angle.0.map(|slope| weight * slope)));
                alpha1.iter_mut().zip(angle.1).for_each(|(sum, slope)| *sum += weight * slope);
            }
        }
    }
    back_along_chain::<N, R, FIRST, C>(mesh, adjoints, &turns)?;

    let mut alpha1_sums = [[Lanes::default(); MAX_PARAMETERS]];
    for pack in 0..mesh.packs() {
        let quantities = rows_of_mut::<C, _>(&mut adjoints.quantities, pack, size);
        let ends = rows_of::<N, _>(&adjoints.ends, pack, size);
        let end_gradients = rows_of::<N, _>(&adjoints.end_gradients, pack, rows_per_pack);
        let from_end = |q: usize, row: &[Lanes; N]| {
            (0..N).fold(Lanes::default(), |sum, i| sum + Lanes::new(end_gradients[q][i]) * row[i])
        };
        for (quantities, end) in quantities.iter_mut().zip(ends) {
            for q in 0..C {
                quantities[q] += from_end(q, end);
            }
        }
        linearisation
            .subtract_parameter_gradients::<N, R, C>(pack, parameters, quantities, &mut sums);
        if extremes.is_some() {
            let rows = &mut rows_of_mut::<1, _>(&mut adjoints.alpha1, 0, size);
            rows.iter_mut().zip(ends).for_each(|(row, end)| *row = [from_end(C, end)]);
            linearisation.subtract_parameter_gradients::<N, R, 1>(
                pack,
                parameters,
                rows,
                &mut alpha1_sums,
            );
        }
    }
    let total = |sums: &ByParameters<Lanes>, column: usize| -> f64 {
        (0..LANES).map(|lane| sums[column].lane(lane)).sum()
    };
    alpha1.iter_mut().enumerate().for_each(|(p, sum)| *sum += total(&alpha1_sums[0], p));
    let mut totals = [[0.0; MAX_PARAMETERS]; C];
    for (totals, sums) in totals.iter_mut().zip(&sums) {
        (0..parameters).for_each(|column| totals[column] = total(sums, column));
    }
    Some((totals, alpha1))
}

/// Index of the element that contains a turning point of joint 1, and the derivatives of half that joint's
/// range (alpha1) with respect to the state at the element's start; `None` if this turning point is not
/// evaluated.
type Turn<const N: usize> = Option<(usize, [f64; N])>;

/// Computes [`Adjoints`]`::end_gradients`, the derivatives of the quantities with respect to the states at the
/// elements' ends, from the last element to the first. Returns `None` if the cyclic linear system of the periodic orbit
/// is singular.
#[inline(always)]
fn back_along_chain<const N: usize, R: ThreeLink<N>, const FIRST: usize, const C: usize>(
    mesh: &Mesh<N, R>,
    adjoints: &mut Adjoints,
    turns: &[Turn<N>; 2],
) -> Option<()> {
    /// Maximum number of rows: one for each quantity, one for half the range of joint 1, and, in the first of
    /// the two passes over the elements, one for each state at the end of the last element.
    const MAX_ROWS: usize = 12;
    let Adjoints { start_gradients, end_gradients, .. } = adjoints;
    let rows_per_pack = C + R::ANGLES;
    let back = |rows: &mut [[f64; N]], k: usize| {
        let (own, ends) = rows_of::<N, _>(start_gradients, k / LANES, C + N).split_at(C);
        let lane = k % LANES;
        let mut transfer = [[0.0; N]; N];
        for i in 0..N {
            (0..N).for_each(|m| transfer[i][m] = ends[i][m].lane(lane));
        }
        for (q, row) in rows.iter_mut().enumerate() {
            let mut start = [0.0; N];
            for m in 0..N {
                start[m] = if q < C { own[q][m].lane(lane) } else { 0.0 };
                (0..N).for_each(|i| start[m] += row[i] * transfer[i][m]);
            }
            *row = start;
        }
        for (_, slopes) in turns.iter().flatten().filter(|turn| turn.0 == k) {
            (0..N).for_each(|m| rows[C][m] += slopes[m]);
        }
    };
    let mut rows = [[0.0; N]; MAX_ROWS];
    let rows = &mut rows[..rows_per_pack + N];
    (0..N).for_each(|i| rows[rows_per_pack + i][i] = 1.0);
    (0..mesh.count).rev().for_each(|k| back(rows, k));

    // Periodicity: the state at the start of the first element is that at the end of the last one, up to the
    // signs of the half-period symmetry.
    let signs = &mesh.signs;
    let closure = |sign: f64| {
        let open = SMatrix::<f64, N, N>::from_fn(|m, i| {
            let unit = if i == m { 1.0 } else { 0.0 };
            unit - sign * signs[i] * rows[rows_per_pack + i][m]
        });
        open.try_inverse().filter(|entries| entries.iter().all(|x| x.is_finite()))
    };
    let even = closure(1.0)?;
    let is_odd = |q: usize| mesh.is_half && q < C && ODD.contains(&(FIRST + q));
    let odd = if (0..C).any(is_odd) { closure(-1.0)? } else { even };
    for q in 0..rows_per_pack {
        let (closure, sign) = if is_odd(q) { (odd, -1.0) } else { (even, 1.0) };
        let start = closure * SVector::<f64, N>::from(rows[q]);
        (0..N).for_each(|i| rows[q][i] = sign * signs[i] * start[i]);
    }
    let rows = &mut rows[..rows_per_pack];
    for k in (0..mesh.count).rev() {
        let starts_of_pack = rows_of_mut::<N, _>(end_gradients, k / LANES, rows_per_pack);
        for (starts_of_pack, row) in starts_of_pack.iter_mut().zip(&*rows) {
            (0..N).for_each(|i| starts_of_pack[i][k % LANES] = row[i]);
        }
        back(rows, k);
    }
    Some(())
}

/// Returns the derivatives of the passive joint's angle at a turning point with respect to the state at the start of
/// the element that contains this point, and with respect to the first `parameters` variables. A shift of the turning
/// point in time has no effect on the angle. Returns `None` if the element cannot be solved up to the turning point.
#[inline(always)]
fn angle_at<const N: usize, R: ThreeLink<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    extreme: &TurningPoint<N>,
    workspace: &mut Linearisation,
    parameters: usize,
) -> Option<([f64; N], ByParameters)> {
    let (nodes, stages) = extreme.shorter_element(model, mesh, workspace)?;
    let start = mesh.states.start_of(extreme.element);
    let duration_s = extreme.fraction * mesh.duration_s(extreme.element);
    let element = Element { nodes: &nodes, start: &start, stages: &stages, duration_s };
    workspace.linearise_all(0, model, &element, parameters);
    let (adjoint, start_gradients) = workspace.solve_adjoint_of_last::<N, R>(0, duration_s);
    let mut parameter_gradients = [[0.0; MAX_PARAMETERS]];
    workspace.subtract_parameter_gradients::<N, R, 1>(
        0,
        parameters,
        &adjoint,
        &mut parameter_gradients,
    );
    Some((start_gradients, parameter_gradients[0]))
}

/// Assembles the derivatives of the metrics. `slopes` returns, for the index of a variable, the derivatives of the
/// quantities of [`MetricGradient`] and, if joint 1 is passive, of half its range (alpha1).
fn derivatives_of<const N: usize, R: ThreeLink<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    cycle: &Cycle<N>,
    parameters: usize,
    slopes: impl Fn(usize) -> ([f64; 6], f64),
) -> Derivatives {
    let problem = model.problem();
    let half_range_slopes =
        problem.gait.joints[0].map_or([0.0; 5], |command| command.half_range_slopes());
    let mut derivatives = Derivatives::splat(GaitMetrics::NONE);
    for column in 0..parameters {
        let variable = model.variable(column);
        if !problem.depends_on(variable) {
            continue;
        }
        let is_odd = is_odd(mesh, variable);
        let ([sigma @ .., even_d_m, dtheta_rad, odd_d_m], alpha1_rad) = slopes(column);
        let d_m = if is_odd { odd_d_m } else { even_d_m };
        let commanded = match variable {
            Variable::Gait(0, number) => half_range_slopes[number],
            Variable::Second(0, part) => half_range_slopes[COMMAND_SIZE + part],
            _ => 0.0,
        };
        let derivative = GaitMetrics {
            d_m,
            v_m_s: d_m * problem.omega_rad_s / TAU,
            sigma: padded(&if is_odd { [0.0; 3] } else { sigma }),
            alpha_rad: padded(&[if is_odd { 0.0 } else { alpha1_rad + commanded }]),
            dtheta_rad: if is_odd || !mesh.is_half { dtheta_rad } else { 0.0 },
        };
        derivatives.set(variable, derivative);
    }
    if parameters > R::ROBOT_VARIABLES {
        derivatives.omega = domega(problem, cycle.d_m, &derivatives);
    }
    derivatives.set_sums(&problem.robot, |shares, rolls| {
        let rolls = rolls.map(GaitMetrics::to_array);
        GaitMetrics::from_array(std::array::from_fn(|metric| {
            (0..3).map(|wheel| shares[wheel] * rolls[wheel][metric]).sum()
        }))
    });
    derivatives
}

/// Returns the derivatives of the metrics with respect to omega, computed from their derivatives with respect
/// to the robot's parameters.
fn domega(problem: &Problem, d_m: f64, derivatives: &Derivatives) -> GaitMetrics {
    let mut sum = GaitMetrics { v_m_s: d_m / TAU, ..GaitMetrics::NONE }.to_array();
    for (parameter, factor) in problem.omega_scaling() {
        let derivative = derivatives.parameters[parameter].to_array();
        sum.iter_mut().zip(derivative).for_each(|(sum, slope)| *sum += factor * slope);
    }
    GaitMetrics::from_array(sum)
}
