//! Derivatives of a steady cycle's metrics with respect to the parameters, by the adjoint method.
//!
//! There are fewer metrics than states and parameters. Each element is linearised at the solution,
//! one beside the other in lanes, and its transposed system solved for the integrals of the metrics
//! over it and for the states at its end. The derivatives of the metrics with respect to the state
//! where an element starts follow from those at its end, back along the chain; that it closes leaves
//! an `N x N` system for the last of them. The residuals' derivatives with respect to the
//! parameters are only needed once all adjoint solutions are known.

use std::f64::consts::TAU;

use nalgebra::{SMatrix, SVector};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{LANES, Lanes, Number, Parameter};

use super::Problem;
use super::cycle::Cycle;
use super::element::{Element, Linearisation, unknowns};
use super::extreme::{Extremes, TurningPoint};
use super::gradient::{
    DISTANCE, MetricGradient, ODD, ODD_DISTANCE, WORK, add_by_gait, weights_of_unknowns,
};
use super::mesh::Mesh;
use super::path::Path;
use super::radau::STAGES;
use super::reduced::{Derivatives, MOST_PARAMETERS, NUMBERS, Reduced, Variable};

/// Derivatives with respect to the parameters.
type ByParameters<T = f64> = [T; MOST_PARAMETERS];

/// Room for elements side by side, for one, and for what is kept of each.
pub(super) struct Room<'a> {
    pub linearisation: &'a mut Linearisation<Lanes>,
    pub workspace: &'a mut Linearisation,
    pub adjoints: &'a mut Adjoints,
}

/// What is kept of every pack on the way back; grows once and is used again.
#[derive(Debug, Clone, Default)]
pub(super) struct Adjoints {
    /// Solutions of the transposed systems for the quantities and for the states at the ends.
    quantities: Vec<Lanes>,
    ends: Vec<Lanes>,
    /// The same of alpha1 for one pack.
    alpha1: Vec<Lanes>,
    /// Derivatives of the quantities' parts and of the ends with respect to the elements' starts.
    by_start: Vec<Lanes>,
    /// Derivatives of the whole quantities, then of alpha1 where joint 1 can be passive, with respect
    /// to the elements' ends.
    by_end: Vec<[f64; LANES]>,
}

impl Adjoints {
    /// Makes room for `packs` of so many unknowns, quantities and states.
    fn resize(&mut self, packs: usize, [size, quantities, rows, states]: [usize; 4]) {
        let zero = Lanes::default();
        self.quantities.resize(packs * size * quantities, zero);
        self.ends.resize(packs * size * states, zero);
        self.alpha1.resize(size, zero);
        self.by_start.resize(packs * (quantities + states) * states, zero);
        // Nothing in lanes without an element of their own.
        self.by_end.clear();
        self.by_end.resize(packs * rows * states, [0.0; LANES]);
    }
}

/// The rows of `K` of a pack that has `count` of them.
fn rows_of<const K: usize, T>(of: &[T], pack: usize, count: usize) -> &[[T; K]] {
    of[pack * count * K..][..count * K].as_chunks::<K>().0
}

/// The same to write to.
fn rows_of_mut<const K: usize, T>(of: &mut [T], pack: usize, count: usize) -> &mut [[T; K]] {
    of[pack * count * K..][..count * K].as_chunks_mut::<K>().0
}

/// Derivatives of the metrics of the solution on a mesh with respect to the parameters that are
/// `wanted`, or to everything. Others may be left zero. `None` if the linearised motion is
/// singular: it is where two solutions meet.
pub(super) fn differentiate<const N: usize, R: Reduced<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    solution: (&Path, &Cycle<N>),
    room: Room,
    wanted: Option<&[Parameter]>,
) -> Option<Derivatives> {
    // What fits ask for again and again has numbers of quantities and columns that are known when this is compiled.
    let of_robot = R::OF_ROBOT;
    let all = columns::<N, R>(model.problem());
    match (R::SKIDS, wanted.is_some(), mesh.is_half) {
        (true, true, true) => of_metrics::<N, R, 0, 4>(model, mesh, solution, room, of_robot),
        (true, true, false) => of_metrics::<N, R, 0, 5>(model, mesh, solution, room, of_robot),
        (false, true, true) => of_metrics::<N, R, 3, 1>(model, mesh, solution, room, of_robot),
        (false, true, false) => of_metrics::<N, R, 3, 2>(model, mesh, solution, room, of_robot),
        (true, false, _) => of_metrics::<N, R, 0, 6>(model, mesh, solution, room, all),
        (false, false, _) => of_metrics::<N, R, 3, 3>(model, mesh, solution, room, all),
    }
}

/// Columns of the variables that a motion depends on.
fn columns<const N: usize, R: Reduced<N>>(problem: &Problem) -> usize {
    if problem.gait.has_second() { R::PARAMETERS } else { R::OF_FIRST }
}

/// Derivatives by everything of the distance, m, and of what friction takes over a period, `loss_j` in J, which is the work of the
/// actuators; `None` as for [`differentiate`].
pub(super) fn differentiate_distance<const N: usize, R: Reduced<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    solution: (&Path, &Cycle<N>),
    room: Room,
    loss_j: f64,
) -> Option<[Derivatives<f64>; 2]> {
    let problem = model.problem();
    let parameters = columns::<N, R>(problem);
    let (sums, _) =
        by_adjoints::<N, R, DISTANCE, 4>(model, mesh, solution, room, parameters, None)?;
    let sum = |quantity: usize, column: usize| sums[quantity - DISTANCE][column];
    let mut derivatives = [Derivatives::splat(0.0); 2];
    let [distance, work] = &mut derivatives;
    for column in 0..parameters {
        let variable = model.variable(column);
        if !problem.knows(variable) {
            continue;
        }
        let is_odd = is_odd(mesh, variable);
        distance.set(variable, sum(if is_odd { ODD_DISTANCE } else { DISTANCE }, column));
        if !is_odd {
            work.set(variable, sum(WORK, column) / mesh.periods as f64);
        }
    }
    Some([distance.completed(problem, 0.0), work.completed(problem, 2.0 * loss_j)])
}

/// Whether what a variable changes of the motion is the opposite of its mirror image half a period later: the mirror
/// image of a motion is that of the opposite offsets and second harmonics.
fn is_odd<const N: usize, R: Reduced<N>>(mesh: &Mesh<N, R>, variable: Variable) -> bool {
    mesh.is_half && variable.is_odd()
}

/// Derivatives of the metrics by those of `C` quantities from number `FIRST` on, see
/// [`MetricGradient`], and of alpha1 with respect to the first `parameters` of the model.
#[inline(always)]
fn of_metrics<const N: usize, R: Reduced<N>, const FIRST: usize, const C: usize>(
    model: &R,
    mesh: &Mesh<N, R>,
    solution: (&Path, &Cycle<N>),
    room: Room,
    parameters: usize,
) -> Option<Derivatives> {
    let cycle = solution.1;
    let (sums, alpha1) = by_adjoints::<N, R, FIRST, C>(
        model,
        mesh,
        solution,
        room,
        parameters,
        cycle.extremes.as_ref(),
    )?;
    Some(derivatives_of(model, mesh, cycle, parameters, |column| {
        let mut quantities = [0.0; 6];
        (0..C).for_each(|q| quantities[FIRST + q] = sums[q][column]);
        (quantities, alpha1[column])
    }))
}

/// Derivatives of `C` quantities from number `FIRST` on, and of half the range between the `extremes`,
/// with respect to the first `parameters` of the model.
#[inline(always)]
fn by_adjoints<const N: usize, R: Reduced<N>, const FIRST: usize, const C: usize>(
    model: &R,
    mesh: &Mesh<N, R>,
    (path, cycle): (&Path, &Cycle<N>),
    room: Room,
    parameters: usize,
    extremes: Option<&Extremes<N>>,
) -> Option<([ByParameters; C], ByParameters)> {
    let Room { linearisation, workspace, adjoints } = room;
    let per_stage = unknowns::<N, R>();
    let size = per_stage * STAGES;
    let whole = C + usize::from(R::HAS_ANGLE);
    adjoints.resize(mesh.packs(), [size, C, whole, N]);
    let gradient = MetricGradient::new(model, mesh, cycle);
    let mut sums = [[Lanes::default(); MOST_PARAMETERS]; C];
    for (pack, leg) in path.legs.iter().enumerate() {
        let starts = mesh.starts(pack);
        let element = mesh.pack(pack, &starts);
        linearisation.linearise_all(pack, model, &element, parameters);
        let rows = rows_of_mut::<C, _>(&mut adjoints.quantities, pack, size);
        let weights = mesh.weights(pack);
        let mut by_last = [Lanes::default(); C];
        for q in 0..C {
            let gradients = gradient.at_stages(model, FIRST + q, leg, weights);
            let by_unknown;
            (by_unknown, by_last[q]) = weights_of_unknowns(model, &element, &leg.trig, &gradients);
            for j in 0..STAGES {
                for i in 0..per_stage {
                    rows[j * per_stage + i][q] = by_unknown[j][i];
                }
            }
            // Where the wheels skid, d and Delta theta depend on the states alone.
            if parameters > R::OF_ROBOT && (!R::SKIDS || !(3..WORK).contains(&(FIRST + q))) {
                let sum = &mut sums[q];
                add_by_gait(model, &element, &leg.trig, &gradients, parameters, sum);
            }
            if FIRST + q == WORK {
                gradient.add_work_slopes(model, leg, weights, &mut sums[q]);
            }
        }
        let mut by_start = linearisation.solve_adjoint::<N, R, C>(pack, 0, rows);
        for q in 0..C {
            by_start[q][N - 1] += by_last[q];
        }
        let rows = rows_of_mut::<N, _>(&mut adjoints.ends, pack, size);
        let ends = linearisation.solve_adjoint_of_end::<N, R>(pack, element.duration_s, rows);
        let kept = rows_of_mut::<N, _>(&mut adjoints.by_start, pack, C + N);
        kept[..C].copy_from_slice(&by_start);
        kept[C..].copy_from_slice(&ends);
    }

    // Half a period later comes the opposite extreme.
    let mut alpha1 = [0.0; MOST_PARAMETERS];
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

    let mut alpha1_sums = [[Lanes::default(); MOST_PARAMETERS]];
    for pack in 0..mesh.packs() {
        let quantities = rows_of_mut::<C, _>(&mut adjoints.quantities, pack, size);
        let ends = rows_of::<N, _>(&adjoints.ends, pack, size);
        let by_end = rows_of::<N, _>(&adjoints.by_end, pack, whole);
        let from_end = |q: usize, row: &[Lanes; N]| {
            (0..N).fold(Lanes::default(), |sum, i| sum + Lanes::new(by_end[q][i]) * row[i])
        };
        for (quantities, end) in quantities.iter_mut().zip(ends) {
            for q in 0..C {
                quantities[q] += from_end(q, end);
            }
        }
        linearisation.add_by_parameters::<N, R, C>(pack, parameters, quantities, &mut sums);
        if extremes.is_some() {
            let rows = &mut rows_of_mut::<1, _>(&mut adjoints.alpha1, 0, size);
            rows.iter_mut().zip(ends).for_each(|(row, end)| *row = [from_end(C, end)]);
            linearisation.add_by_parameters::<N, R, 1>(pack, parameters, rows, &mut alpha1_sums);
        }
    }
    let total = |sums: &ByParameters<Lanes>, column: usize| -> f64 {
        (0..LANES).map(|lane| sums[column].lane(lane)).sum()
    };
    alpha1.iter_mut().enumerate().for_each(|(p, sum)| *sum += total(&alpha1_sums[0], p));
    let mut totals = [[0.0; MOST_PARAMETERS]; C];
    for (totals, sums) in totals.iter_mut().zip(&sums) {
        (0..parameters).for_each(|column| totals[column] = total(sums, column));
    }
    Some((totals, alpha1))
}

/// Where an alpha1 comes from: the element and its derivatives with respect to that element's start.
type Turn<const N: usize> = Option<(usize, [f64; N])>;

/// Fills in the derivatives with respect to the elements' ends; `None` if the chain cannot be closed.
#[inline(always)]
fn back_along_chain<const N: usize, R: Reduced<N>, const FIRST: usize, const C: usize>(
    mesh: &Mesh<N, R>,
    adjoints: &mut Adjoints,
    turns: &[Turn<N>; 2],
) -> Option<()> {
    /// Quantities, alpha1, and, at first, the states at the end of the chain.
    const MOST_ROWS: usize = 12;
    let Adjoints { by_start, by_end, .. } = adjoints;
    let whole = C + usize::from(R::HAS_ANGLE);
    let back = |rows: &mut [[f64; N]], k: usize| {
        let (own, ends) = rows_of::<N, _>(by_start, k / LANES, C + N).split_at(C);
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
    let mut rows = [[0.0; N]; MOST_ROWS];
    let rows = &mut rows[..whole + N];
    (0..N).for_each(|i| rows[whole + i][i] = 1.0);
    (0..mesh.count).rev().for_each(|k| back(rows, k));

    // The chain closes: where it starts is where it ends, with the opposite signs for what is odd.
    let signs = &mesh.signs;
    let closure = |sign: f64| {
        let open = SMatrix::<f64, N, N>::from_fn(|m, i| {
            let unit = if i == m { 1.0 } else { 0.0 };
            unit - sign * signs[i] * rows[whole + i][m]
        });
        open.try_inverse().filter(|entries| entries.iter().all(|x| x.is_finite()))
    };
    let even = closure(1.0)?;
    let is_odd = |q: usize| mesh.is_half && q < C && ODD.contains(&(FIRST + q));
    let odd = if (0..C).any(is_odd) { closure(-1.0)? } else { even };
    for q in 0..whole {
        let (closure, sign) = if is_odd(q) { (odd, -1.0) } else { (even, 1.0) };
        let start = closure * SVector::<f64, N>::from(rows[q]);
        (0..N).for_each(|i| rows[q][i] = sign * signs[i] * start[i]);
    }
    let rows = &mut rows[..whole];
    for k in (0..mesh.count).rev() {
        let kept = rows_of_mut::<N, _>(by_end, k / LANES, whole);
        for (kept, row) in kept.iter_mut().zip(&*rows) {
            (0..N).for_each(|i| kept[i][k % LANES] = row[i]);
        }
        back(rows, k);
    }
    Some(())
}

/// Derivatives of the passive joint's angle where it turns round with respect to the start of its
/// element and the parameters. When it turns does not matter: its rate is zero there.
#[inline(always)]
fn angle_at<const N: usize, R: Reduced<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    extreme: &TurningPoint<N>,
    workspace: &mut Linearisation,
    parameters: usize,
) -> Option<([f64; N], ByParameters)> {
    let (nodes, stages) = extreme.shorter_element(model, mesh, workspace)?;
    let (start, duration_s) = (
        mesh.states.start_of(extreme.element),
        extreme.fraction * mesh.duration_s(extreme.element),
    );
    let element = Element { nodes: &nodes, start: &start, stages: &stages, duration_s };
    workspace.linearise_all(0, model, &element, parameters);
    let (adjoint, by_start) = workspace.solve_adjoint_of_last::<N, R>(0, duration_s);
    let mut by_parameters = [[0.0; MOST_PARAMETERS]];
    workspace.add_by_parameters::<N, R, 1>(0, parameters, &adjoint, &mut by_parameters);
    Some((by_start, by_parameters[0]))
}

/// The derivatives of the metrics from those of the quantities, of all that there are, and of
/// alpha1 with respect to the variable in each column.
fn derivatives_of<const N: usize, R: Reduced<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    cycle: &Cycle<N>,
    parameters: usize,
    of: impl Fn(usize) -> ([f64; 6], f64),
) -> Derivatives {
    let problem = model.problem();
    let of_range = problem.gait.joints[0].map_or([0.0; 5], |of| of.half_range_slopes());
    let mut derivatives = Derivatives::splat(GaitMetrics::NONE);
    for column in 0..parameters {
        let variable = model.variable(column);
        if !problem.knows(variable) {
            continue;
        }
        let is_odd = is_odd(mesh, variable);
        let ([sigma @ .., even_d_m, dtheta_rad, odd_d_m], alpha1_rad) = of(column);
        let d_m = if is_odd { odd_d_m } else { even_d_m };
        let commanded = match variable {
            Variable::Gait(0, number) => of_range[number],
            Variable::Second(0, part) => of_range[NUMBERS + part],
            _ => 0.0,
        };
        let derivative = GaitMetrics {
            d_m,
            v_m_s: d_m * problem.omega_rad_s / TAU,
            sigma: if is_odd { [0.0; 3] } else { sigma },
            alpha1_rad: if is_odd { 0.0 } else { alpha1_rad + commanded },
            dtheta_rad: if is_odd || !mesh.is_half { dtheta_rad } else { 0.0 },
        };
        derivatives.set(variable, derivative);
    }
    if parameters > R::OF_ROBOT {
        derivatives.omega = domega(problem, cycle.metrics.d_m, &derivatives);
    }
    derivatives.set_sums(&problem.robot, |shares, rolls| {
        let rolls = rolls.map(GaitMetrics::to_array);
        GaitMetrics::from_array(std::array::from_fn(|metric| {
            (0..3).map(|wheel| shares[wheel] * rolls[wheel][metric]).sum()
        }))
    });
    derivatives
}

/// Derivatives with respect to omega, from those with respect to the robot's parameters.
fn domega(problem: &Problem, d_m: f64, derivatives: &Derivatives) -> GaitMetrics {
    let mut sum = GaitMetrics { v_m_s: d_m / TAU, ..GaitMetrics::NONE }.to_array();
    for (parameter, part) in problem.parts_of_omega() {
        let derivative = derivatives.parameters[parameter].to_array();
        sum.iter_mut().zip(derivative).for_each(|(sum, of)| *sum += part * of);
    }
    GaitMetrics::from_array(sum)
}
