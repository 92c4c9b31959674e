//! Gait optimisation: optimal commands for a model's steady-state motion.
//!
//! The objectives are products of powers of d, omega and the actuators' work. The solver computes their derivatives
//! with respect to every gait parameter. Local searches start from quasi-random points within the ranges of the
//! commands and from the campaign's current gait (multi-start). An optimum is accepted if its motion is stable and is
//! reached from rest.

mod commands;
mod drive;
mod front;
mod landscape;
mod map;
mod quadratic;
mod search;
mod tables;
mod uncertainty;

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_mechanics::{
    FromRest, MotionStatus, Problem, REFERENCE_ACCURACY, Solver, SteadyMotion,
};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{ByParameter, JointCommand, SecondHarmonic};

use crate::simulate::Setup;
use commands::degrees;
pub use commands::{Bounds, Command, CommandUnit};
pub use drive::Drive;
use landscape::{ACCURACY, Landscape, Position, ROUGH_ACCURACY};
pub use map::MapOverlay;
use quadratic::Hessian;
use search::{LocalOptimum, minimise};
pub use tables::{OptimaTables, TABLES};
pub use trilink_tables::Objective;
use trilink_tables::{ByJoint, ByLink, Columns as _, GaitNumbers, OptimumRow};
pub use uncertainty::Uncertainty;

/// Optimisation problem and number of starts.
#[derive(Debug, Clone)]
pub struct Search {
    /// Robot and friction laws, with the current gait and frequency.
    pub problem: Problem,
    pub objective: Objective,
    /// Commands to vary; at least one.
    pub free: Vec<Command>,
    pub bounds: Bounds,
    /// Number of starts, including the current gait.
    pub starts: usize,
}

/// Optimal gait with its steady-state motion.
#[derive(Debug, Clone)]
pub struct Optimum {
    pub problem: Problem,
    pub value: f64,
    pub motion: SteadyMotion,
    pub status: MotionStatus,
    pub from_rest: FromRest,
    /// Names of the active bounds and limits.
    pub at_bound: Vec<String>,
    /// Number of searches that ended in this optimum.
    pub starts: usize,
    /// Hessian of the cost with respect to the free commands, scaled to their ranges; `None` if the gait is not the
    /// result of a search.
    hessian: Option<Hessian>,
}

impl Optimum {
    /// Solves a problem to the reference accuracy; returns `None` if there is no periodic solution.
    fn new(
        problem: Problem,
        objective: Objective,
        at_bound: Vec<String>,
        starts: usize,
    ) -> Option<Self> {
        let mut solver = Solver::default();
        let metrics = solver.solve(&problem, REFERENCE_ACCURACY).ok()?;
        let motion = solver.steady_motion(metrics).ok()?;
        let GaitMetrics { d_m, v_m_s, .. } = motion.metrics;
        Some(Self {
            value: objective.value(d_m, v_m_s, motion.work_j),
            status: motion.status(),
            from_rest: solver.from_rest(&problem, metrics),
            at_bound,
            problem,
            motion,
            starts,
            hessian: None,
        })
    }

    /// Returns the value of the given objective for this gait.
    pub fn value_of(&self, objective: Objective) -> f64 {
        let motion = &self.motion;
        objective.value(motion.metrics.d_m, motion.metrics.v_m_s, motion.work_j)
    }

    /// Returns whether the motion is stable and is reached from rest.
    pub fn is_reachable(&self) -> bool {
        self.status.is_reached_and_stays(self.from_rest)
    }

    /// Returns the row for the table of a campaign's optima; `present` is the campaign's own gait at its best
    /// frequency.
    pub fn row(
        &self,
        rank: usize,
        campaign: &str,
        setup: &Setup,
        search: &Search,
        present: Option<&Self>,
    ) -> OptimumRow {
        let Problem { robot, gait, laws, .. } = &self.problem;
        let mut numbers = missing_numbers(&self.problem);
        Drive::all(&self.problem).iter().for_each(|drive| drive.fill(&self.problem, &mut numbers));
        OptimumRow {
            campaign: campaign.to_owned(),
            rank: rank as i64,
            model: setup.model,
            parameters: ByParameter::from_fn(|parameter| {
                if robot.depends_on(parameter, *laws, gait) {
                    robot.value(parameter)
                } else {
                    f64::NAN
                }
            }),
            adequate: setup.fit().and_then(|fit| fit.adequate),
            extrapolation: setup.extrapolation(&self.problem),
            objective: search.objective,
            value: self.value,
            omega_rad_s: self.problem.omega_rad_s,
            offset_rad: numbers.offset_rad,
            amplitude_rad: numbers.amplitude_rad,
            phase_rad: numbers.phase_rad,
            amplitude2_rad: numbers.amplitude2_rad,
            phase2_rad: numbers.phase2_rad,
            torque_mean_nm: numbers.torque_mean_nm,
            torque_amplitude_nm: numbers.torque_amplitude_nm,
            torque_phase_rad: numbers.torque_phase_rad,
            rotor_amplitude_rad: numbers.rotor_amplitude_rad,
            rotor_phase_rad: numbers.rotor_phase_rad,
            rotor_amplitude2_rad: numbers.rotor_amplitude2_rad,
            rotor_phase2_rad: numbers.rotor_phase2_rad,
            lower: missing_numbers(&self.problem),
            upper: missing_numbers(&self.problem),
            metrics: self.motion.metrics,
            work_j: self.motion.work_j,
            power_w: self.power_w(),
            status: self.status,
            from_rest: self.from_rest,
            at_bound: self.at_bound.clone(),
            starts: self.starts as i64,
            present_value: present.map_or(f64::NAN, |of| of.value),
            present_omega_rad_s: present.map_or(f64::NAN, |of| of.problem.omega_rad_s),
            free: search.free.iter().map(|command| command.name(robot)).collect(),
            bounds: search.bounds.describe(&self.problem),
            ..OptimumRow::blank()
        }
    }

    /// Returns the mean power of the actuators, W.
    pub fn power_w(&self) -> f64 {
        self.motion.work_j * self.problem.omega_rad_s / TAU
    }
}

/// Returns missing numbers for every joint of a problem's robot and, if it has commanded torques or rotors, for the
/// torques of its joints and for the rotors of its links.
fn missing_numbers(problem: &Problem) -> GaitNumbers {
    let joints = problem.robot.joints();
    let drives = Drive::all(problem);
    let of_joints = |count: usize| ByJoint::from_iter(vec![f64::NAN; count]);
    let of_torques =
        if drives.iter().any(|drive| matches!(drive, Drive::Torque(_))) { joints } else { 0 };
    let rotors =
        if drives.iter().any(|drive| matches!(drive, Drive::Rotor(_))) { joints + 1 } else { 0 };
    let of_rotors = || ByLink::from_iter(vec![f64::NAN; rotors]);
    GaitNumbers {
        offset_rad: of_joints(joints),
        amplitude_rad: of_joints(joints),
        phase_rad: of_joints(joints),
        amplitude2_rad: of_joints(joints),
        phase2_rad: of_joints(joints),
        torque_mean_nm: of_joints(of_torques),
        torque_amplitude_nm: of_joints(of_torques),
        torque_phase_rad: of_joints(of_torques),
        rotor_amplitude_rad: of_rotors(),
        rotor_phase_rad: of_rotors(),
        rotor_amplitude2_rad: of_rotors(),
        rotor_phase2_rad: of_rotors(),
        ..GaitNumbers::blank()
    }
}

/// Result of a multi-start search.
#[derive(Debug, Clone)]
pub struct SearchResult {
    /// Distinct optima, best first; those that are stable and reached from rest precede all others.
    pub optima: Vec<Optimum>,
    /// Number of searches that failed, that is, did not end in a gait within the limits whose motion is confirmed by a
    /// solution from rest.
    pub failed: usize,
}

impl SearchResult {
    /// Returns the best optimum that is stable and reached from rest; `None` if there is no such optimum.
    pub fn best(&self) -> Option<&Optimum> {
        self.optima.first().filter(|best| best.is_reachable())
    }
}

impl Search {
    /// Runs searches from all starts: first at low solver accuracy, then at high accuracy from the distinct results of
    /// the first searches.
    ///
    /// # Errors
    /// Returns an error if the search is cancelled.
    pub fn run(&self, cancel: &CancelToken) -> Result<SearchResult, Cancelled> {
        let seeds = self.second_harmonic_starts(cancel)?;
        let ends: Vec<Option<LocalOptimum>> = (0..self.starts + seeds.len())
            .into_par_iter()
            .with_max_len(1)
            .map(|number| {
                cancel.check()?;
                let mut landscape = self.landscape(ROUGH_ACCURACY);
                let start = match number.checked_sub(self.starts) {
                    Some(seed) => seeds[seed].clone(),
                    None if number == 0 => landscape.position_of(&self.problem),
                    None => self.quasi_random_start(number),
                };
                Ok(find_local_optimum(&mut landscape, start, None))
            })
            .collect::<Result<_, Cancelled>>()?;
        let all = ends.len();
        let rough = ends.into_iter().flatten().map(|end| (end, 1)).collect();
        let fine: Vec<Option<(LocalOptimum, usize)>> = self
            .distinct(rough, ROUGH_ACCURACY)
            .into_par_iter()
            .with_max_len(1)
            .map(|(end, _, starts)| {
                cancel.check()?;
                let mut landscape = self.landscape(ACCURACY);
                let end = find_local_optimum(&mut landscape, end.position, Some(end.hessian));
                Ok(end.map(|end| (end, starts)))
            })
            .collect::<Result<_, Cancelled>>()?;
        let fine: Vec<(LocalOptimum, usize)> = fine.into_iter().flatten().collect();
        let failed = all - fine.iter().map(|(_, starts)| starts).sum::<usize>();
        let distinct = self.distinct(fine, ACCURACY).into_par_iter().with_max_len(1);
        let mut optima: Vec<Optimum> = distinct
            .filter_map(|(end, problem, starts)| self.confirm(end, problem, starts))
            .collect();
        optima.sort_by_key(|optimum| !optimum.is_reachable());
        Ok(SearchResult { optima, failed })
    }

    /// Returns the distinct optima, best first, each with its problem and the number of searches that ended in it.
    ///
    /// `accuracy` is the solver accuracy with which the optima were found.
    fn distinct(
        &self,
        mut ends: Vec<(LocalOptimum, usize)>,
        accuracy: f64,
    ) -> Vec<(LocalOptimum, Problem, usize)> {
        let landscape = self.landscape(accuracy);
        ends.sort_by(|(a, _), (b, _)| a.point.cost.total_cmp(&b.point.cost));
        let mut distinct: Vec<(LocalOptimum, Problem, usize)> = Vec::new();
        for (end, count) in ends {
            let problem = normalise_phases(landscape.problem_at(&end.position));
            let known = distinct
                .iter_mut()
                .find(|(known, of, _)| are_same(&landscape, (known, of), (&end, &problem)));
            match known {
                Some((.., starts)) => *starts += count,
                None => distinct.push((end, problem, count)),
            }
        }
        distinct
    }

    /// Returns additional starts for a search with second harmonics: the best gaits without second harmonics, so that
    /// the result is at least as good as these, and the same gaits with small second harmonics. The latter are needed
    /// because the first-order effect of second harmonics on the objective is zero for a gait with half-period
    /// symmetry.
    fn second_harmonic_starts(&self, cancel: &CancelToken) -> Result<Vec<Position>, Cancelled> {
        const MAX_GAITS: usize = 3;
        const PERTURBATION: f64 = 0.04;
        let mut first = self.clone();
        first.free.retain(|command| !command.is_second());
        if first.free.len() == self.free.len() || first.free.is_empty() {
            return Ok(Vec::new());
        }
        let landscape = self.landscape(ACCURACY);
        let result = first.run(cancel)?;
        let best = result.optima.iter().filter(|optimum| optimum.is_reachable()).take(MAX_GAITS);
        let starts = best.flat_map(|optimum| {
            let position = landscape.position_of(&optimum.problem);
            let mut moved = position.clone();
            for (i, command) in self.free.iter().enumerate() {
                moved[i] +=
                    if command.is_second() { PERTURBATION * (1.0 + 0.3 * i as f64) } else { 0.0 };
            }
            [position, self.within_limits(moved)]
        });
        Ok(starts.collect())
    }

    /// Returns this search with the frequency as the only free command, if it is free.
    pub fn by_omega(&self) -> Self {
        let mut by_omega = self.clone();
        by_omega.free.retain(|command| *command == Command::Omega);
        by_omega
    }

    /// Repeats this search without limits on joint angles and rates, which the current gait may exceed, and returns the
    /// best optimum; `None` if the search finds none.
    ///
    /// # Errors
    /// Returns an error if the search is cancelled.
    pub fn present(&self, cancel: &CancelToken) -> Result<Option<Optimum>, Cancelled> {
        let bounds = Bounds { angle_rad: f64::INFINITY, rate_rad_s: f64::INFINITY, ..self.bounds };
        let result = Search { bounds, ..self.clone() }.run(cancel)?;
        Ok(result.optima.into_iter().next())
    }

    /// Returns the cost landscape of this search for a given relative accuracy of the solver.
    fn landscape(&self, accuracy: f64) -> Landscape<'_> {
        let problem = self.problem.clone();
        Landscape::new(problem, self.objective, &self.free, &self.bounds, accuracy)
    }

    /// Returns the start with the given index in a quasi-random (R) sequence, which fills the ranges evenly for any
    /// number of starts.
    ///
    /// Reference: M. Roberts, *The unreasonable effectiveness of quasirandom sequences* (2018).
    fn quasi_random_start(&self, number: usize) -> Position {
        let count = self.free.len() as f64;
        // Positive solution of x^(count + 1) = x + 1.
        let ratio = (0..40).fold(2.0_f64, |x, _| (1.0 + x).powf(1.0 / (count + 1.0)));
        let mut position = self.landscape(ACCURACY).origin();
        for (i, command) in self.free.iter().enumerate() {
            let fraction = (0.5 + number as f64 / ratio.powi(i as i32 + 1)).fract();
            // The range of a phase has a spare turn on each side.
            position[i] = if command.is_phase() { (1.0 + fraction) / 3.0 } else { fraction };
            if command.is_second() {
                position[i] = 0.5 + 0.5 * (fraction - 0.5);
            }
        }
        self.within_limits(position)
    }

    /// Returns the position rescaled so that joint angles and rates stay within their limits, as far as the free
    /// commands allow.
    fn within_limits(&self, mut position: Position) -> Position {
        const ITERATIONS: usize = 8;
        let Bounds { angle_rad, rate_rad_s, .. } = self.bounds;
        let landscape = self.landscape(ACCURACY);
        for _ in 0..ITERATIONS {
            let mut problem = landscape.problem_at(&position);
            let omega = problem.omega_rad_s;
            for drive in Drive::all(&problem) {
                // The angle of a rotor is not limited.
                let angle_rad =
                    if matches!(drive, Drive::Rotor(_)) { f64::INFINITY } else { angle_rad };
                let Some(command) = drive.angle_mut(&mut problem) else { continue };
                if let Some(second) = command.second {
                    let rate = command.peak_rate_rad() * omega / rate_rad_s;
                    let factor = 1.0 / (command.peak_angle_rad() / angle_rad).max(rate).max(1.0);
                    command.offset_rad *= factor;
                    command.amplitude_rad *= factor;
                    let amplitude_rad = factor * second.amplitude_rad();
                    command.second = Some(SecondHarmonic::new(amplitude_rad, second.phase_rad()));
                    continue;
                }
                let JointCommand { offset_rad, amplitude_rad, .. } = command;
                let largest = (offset_rad.abs() + *amplitude_rad) / angle_rad;
                *amplitude_rad = (*amplitude_rad / largest.max(1.0)).min(rate_rad_s / omega);
                *offset_rad /= largest.max(1.0);
            }
            position = landscape.position_of(&problem);
        }
        position
    }

    /// Solves a local optimum's problem to the reference accuracy; returns `None` if there is no periodic solution.
    fn confirm(&self, end: LocalOptimum, problem: Problem, starts: usize) -> Option<Optimum> {
        let at_bound = self.landscape(ACCURACY).bounds_met(&end.position, &end.point);
        let optimum = Optimum::new(problem, self.objective, at_bound, starts)?;
        Some(Optimum { hessian: Some(end.hessian), ..optimum })
    }
}

/// Searches from a start for a local optimum whose motion is confirmed by a solution from rest; `None` if none is
/// found. If this motion is unstable, the search is repeated among stable motions, and a stable optimum takes
/// precedence.
fn find_local_optimum(
    landscape: &mut Landscape,
    start: Position,
    hessian: Option<Hessian>,
) -> Option<LocalOptimum> {
    landscape.forget();
    landscape.only_stable = false;
    let end = minimise(landscape, start.clone(), hessian.clone())?;
    let end = confirm_from_rest(landscape, end)?;
    if landscape.is_stable() {
        return Some(end);
    }
    landscape.forget();
    landscape.only_stable = true;
    let stable =
        minimise(landscape, start, hessian).and_then(|end| confirm_from_rest(landscape, end));
    Some(stable.filter(|_| landscape.is_stable()).unwrap_or(end))
}

/// Returns the local optimum `end` if a solution from rest reproduces its cost. Otherwise, the search had followed
/// another branch of solutions: it restarts from `end` with the solution that is found from rest. `None` if no optimum
/// is confirmed.
fn confirm_from_rest(landscape: &mut Landscape, mut end: LocalOptimum) -> Option<LocalOptimum> {
    const MAX_RESTARTS: usize = 4;
    for _ in 0..MAX_RESTARTS {
        landscape.forget();
        let only_stable = std::mem::replace(&mut landscape.only_stable, false);
        let cost = landscape.cost(&end.position)?;
        landscape.only_stable = only_stable;
        if landscape.are_same(cost, end.point.cost) {
            return Some(end);
        }
        end = minimise(landscape, end.position, None)?;
    }
    None
}

/// Rounds an angle to a whole number of turns, rad.
fn whole_turns(angle_rad: f64) -> f64 {
    TAU * (angle_rad / TAU).round()
}

/// Returns the same gait with all phases shifted to within half a turn of zero.
fn normalise_phases(mut problem: Problem) -> Problem {
    for drive in Drive::all(&problem) {
        let phase_rad = drive.phase().value(&problem);
        drive.phase().set(&mut problem, phase_rad - whole_turns(phase_rad));
    }
    problem
}

/// Returns whether two local optima are the same gait or mirror images of each other, within the accuracy of the
/// solver.
fn are_same(
    landscape: &Landscape,
    (one_end, one): (&LocalOptimum, &Problem),
    (other_end, other): (&LocalOptimum, &Problem),
) -> bool {
    if !landscape.are_same(one_end.point.cost, other_end.point.cost) {
        return false;
    }
    let tolerance = landscape.command_tolerance();
    let drives = Drive::all(one);
    are_close(one.omega_rad_s, other.omega_rad_s, tolerance)
        && [1.0, -1.0].iter().any(|sign| {
            let mut commands = drives.iter().flat_map(|drive| drive.commands());
            commands.all(|command| {
                let [a, b] = [one, other].map(|of| command.value(of));
                if command.is_phase() {
                    let difference = (a - b).rem_euclid(TAU);
                    difference.min(TAU - difference) < tolerance * PI
                } else {
                    are_close(a, if command.is_odd() { sign * b } else { b }, tolerance)
                }
            })
        })
}

fn are_close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() < tolerance * (1.0 + a.abs().max(b.abs()))
}

/// Returns a message for each bound on angles, amplitudes or torques that the current gait exceeds.
pub fn exceeded_bounds(problem: &Problem, bounds: &Bounds) -> Vec<String> {
    let mut messages = Vec::new();
    for drive in Drive::all(problem) {
        let part = drive.part(&problem.robot);
        let Some(command) = drive.angle(problem) else {
            let [Some(amplitude_nm), Some(mean_nm)] =
                [Some(drive.amplitude()), drive.offset()].map(|of| Some(of?.value(problem)))
            else {
                continue;
            };
            let largest_nm = amplitude_nm.abs() + mean_nm.abs();
            if let Some(most_nm) =
                bounds.torque_nm.filter(|most_nm| largest_nm > most_nm * (1.0 + 1e-9))
            {
                messages.push(format!(
                    "the torque of {part} reaches {largest_nm} N m, but at most {most_nm} are allowed"
                ));
            }
            continue;
        };
        let JointCommand { offset_rad, amplitude_rad, second, .. } = command;
        let largest = match second {
            Some(_) => command.peak_angle_rad(),
            None => offset_rad.abs() + amplitude_rad.abs(),
        };
        let [low, high] = drive.amplitude().range(bounds);
        if largest > bounds.angle_rad * (1.0 + 1e-9) && !matches!(drive, Drive::Rotor(_)) {
            messages.push(format!(
                "{part} reaches {} degrees, but at most {} are allowed",
                degrees(largest),
                degrees(bounds.angle_rad)
            ));
        }
        if *amplitude_rad < low * (1.0 - 1e-9) || *amplitude_rad > high * (1.0 + 1e-9) {
            messages.push(format!(
                "{part} has an amplitude of {} degrees, outside the searched range of {} to {} degrees",
                degrees(*amplitude_rad),
                degrees(low),
                degrees(high)
            ));
        }
    }
    messages
}

#[cfg(test)]
mod tests {
    use trilink_mechanics::{Problem, Solver};
    use trilink_robot::{Gait, Laws, Robot};

    use super::*;

    /// Creates a search over the frequency alone.
    pub(super) fn frequency_search(
        problem: Problem,
        objective: Objective,
        omega_rad_s: [f64; 2],
    ) -> Search {
        let bounds = Bounds {
            omega_rad_s,
            amplitude_rad: [0.1, 0.8],
            rotor_amplitude_rad: [0.1, 0.8],
            angle_rad: 1.2,
            rate_rad_s: 10.0,
            power_w: None,
            torque_nm: None,
            least: None,
        };
        Search { problem, objective, free: vec![Command::Omega], bounds, starts: 2 }
    }

    /// Between 0.3523 and 0.3595 rad/s the model has three periodic solutions; the start determines which one a search
    /// follows.
    #[test]
    fn the_search_restarts_from_an_optimum_on_another_branch() {
        let problem = Problem::new(
            Robot { damping_nm_s_rad: 0.0005, ..Robot::semi_passive() },
            Gait::passive_symmetric(),
            Laws::SKID,
            0.356,
        );
        let search = frequency_search(problem.clone(), Objective::Distance, [0.345, 0.365]);
        let mut landscape = search.landscape(ACCURACY);
        let position = landscape.position_of(&problem);
        let from_rest = landscape.cost(&position).expect("a motion");
        let ends = [0.0, 1.0].map(|from| {
            landscape.forget();
            let along = (0..=20).map(|i| {
                let mut between = position.clone();
                between[0] = from + (position[0] - from) * f64::from(i) / 20.0;
                landscape.evaluate(&between)
            });
            let point = along.last().flatten().expect("a motion");
            LocalOptimum { position: position.clone(), point, hessian: Hessian::identity(11, 11) }
        });
        let is_other = ends.each_ref().map(|end| !landscape.are_same(end.point.cost, from_rest));
        assert!(is_other.contains(&true), "{ends:?} {from_rest}");
        for (end, is_other) in ends.into_iter().zip(is_other) {
            let found = confirm_from_rest(&mut landscape, end.clone()).expect("an end");
            let mut fresh = search.landscape(ACCURACY);
            let cost = fresh.cost(&found.position).expect("a motion");
            assert!(fresh.are_same(cost, found.point.cost), "{found:?} {cost}");
            let is_same = found.position == position && found.point.cost == end.point.cost;
            assert_eq!(is_same, !is_other, "{found:?}");
        }
    }

    /// At a period doubling, the solution with the period of the gait becomes unstable.
    #[test]
    fn a_search_that_ends_in_an_unstable_motion_is_repeated_among_stable_ones() {
        const STEP_RAD_S: f64 = 0.02;
        let offset = JointCommand::new(0.8137, 0.2838, 2.662);
        let problem = |omega_rad_s: f64| {
            Problem::new(
                Robot {
                    h_m: [0.1695; 2],
                    l_m: [0.1551; 2],
                    b_m: [0.02867; 2],
                    mass_kg: [2.93, 0.196, 0.2922],
                    inertia_kg_m2: [351e-4, 6e-4, 22.9e-4],
                    roll_kg_s: [0.0; 3],
                    skid_kg_s: [0.0; 3],
                    stiffness_nm_rad: 0.4998,
                    damping_nm_s_rad: 0.0643,
                    rest_angle_rad: -0.1661,
                    ..Robot::semi_passive()
                },
                Gait { joints: [Some(offset), None] },
                Laws::NO_SKID,
                omega_rad_s,
            )
        };
        let mut solver = Solver::default();
        let mut speed_and_stability = |omega_rad_s: f64| {
            let metrics = solver.solve(&problem(omega_rad_s), 1e-9).expect("a motion");
            (metrics.v_m_s, solver.status().expect("it is solved for").is_stable())
        };
        let omegas = (0..=130).map(|i| 1.9 + STEP_RAD_S * f64::from(i));
        let all: Vec<(f64, (f64, bool))> =
            omegas.map(|omega| (omega, speed_and_stability(omega))).collect();
        // A stable solution next to an unstable one that is faster.
        let into_unstable = all.windows(2).find_map(|pair| {
            let is_into =
                |a: &(f64, (f64, bool)), b: &(f64, (f64, bool))| a.1.1 && !b.1.1 && b.1.0 > a.1.0;
            let [a, b] = pair else { return None };
            if is_into(a, b) { Some((a.0, b.0)) } else { is_into(b, a).then_some((b.0, a.0)) }
        });
        let (stable, unstable) = into_unstable.expect("both");
        let away = stable + (stable - unstable);
        let range = [away.min(unstable), away.max(unstable)];
        let search = frequency_search(problem(away), Objective::Speed, range);
        let mut landscape = search.landscape(ACCURACY);
        let start = landscape.position_of(&problem(away));
        let is_stable = |position: &Position| {
            let mut fresh = search.landscape(ACCURACY);
            fresh.cost(position).expect("a motion");
            fresh.is_stable()
        };
        let first = minimise(&mut landscape, start.clone(), None).expect("an end");
        assert!(!is_stable(&first.position), "{first:?} {stable} {unstable}");
        let end = find_local_optimum(&mut landscape, start, None).expect("an end");
        assert!(is_stable(&end.position), "{end:?}");
        let omega_rad_s = landscape.problem_at(&end.position).omega_rad_s;
        assert!((omega_rad_s - stable).abs() < STEP_RAD_S, "{omega_rad_s} {stable} {unstable}");
        let found = search.run(&CancelToken::default()).expect("the search is not cancelled");
        assert!(found.optima.iter().all(|of| of.status.is_stable()));
    }

    #[test]
    fn a_cancelled_search_ends_at_once() {
        let search = frequency_search(
            Problem::new(Robot::kinematic(), Gait::symmetric(), Laws::SKID_ROLL, 3.0),
            Objective::Speed,
            [1.0, 8.0],
        );
        // Without cancellation this search would take hours.
        let search = Search { starts: 1_000_000, ..search };
        let cancel = CancelToken::default();
        cancel.cancel();
        assert!(search.run(&cancel).is_err() && search.present(&cancel).is_err());
        assert!(search.front(Objective::Distance, &cancel).is_err());
    }
}
