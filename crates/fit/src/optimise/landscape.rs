//! Cost landscape: the objective as a function of the free commands, with limits on commands, power and torque.

use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::DVector;
use trilink_mechanics::{MotionStatus, NumberDerivatives, Problem, Solver};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{ChainNumber, JointCommand};
use trilink_tables::Objective;

use super::commands::{Bounds, Command};
use super::drive::Drive;

/// Position in the landscape: the free commands, each scaled to 0 to 1 over its range, followed by zeros up to at least
/// [`MIN_LENGTH`].
pub(super) type Position = DVector<f64>;

/// Minimum length of a [`Position`]. Scalar products of shorter vectors are summed in another order, so that results
/// would change in their last digits.
const MIN_LENGTH: usize = 11;

/// Maximum number of peaks of the angle or the rate of a joint or rotor: two maxima and two minima if there is a second
/// harmonic.
const PEAKS: usize = 4;
/// Name of the limit on another objective.
pub(super) const MIN_NAME: &str = "least";

/// Indices of the limits: the peaks of the angle of each joint, then those of the rates of each joint and rotor, then the
/// mean power, the torque, and the other objective.
#[derive(Debug, Clone, Copy)]
struct Limits {
    /// Number of joints.
    joints: usize,
    /// Index of the limit on the mean power, which follows those on the commands.
    power: usize,
}

impl Limits {
    fn new(problem: &Problem) -> Self {
        let joints = problem.robot.joints();
        let rotors = problem.robot.as_chain().map_or(0, |chain| chain.links.len());
        Self { joints, power: (2 * joints + rotors) * PEAKS }
    }

    /// Returns the index of the first limit on the angle (order 0) or rate (order 1) of a drive; `None` if it is not
    /// limited.
    fn first(self, drive: Drive, order: i32) -> Option<usize> {
        match (drive, order) {
            (Drive::Angle(joint), 0) => Some(PEAKS * joint),
            (Drive::Angle(joint), _) => Some(PEAKS * (self.joints + joint)),
            (Drive::Rotor(link), 1) => Some(PEAKS * (2 * self.joints + link)),
            (Drive::Rotor(_) | Drive::Torque(_), _) => None,
        }
    }

    fn torque(self) -> usize {
        self.power + 1
    }

    fn least(self) -> usize {
        self.power + 2
    }

    fn count(self) -> usize {
        self.power + 3
    }

    /// Returns the name of a limit, given its index.
    fn name(self, limit: usize, problem: &Problem) -> String {
        let Self { joints, power } = self;
        match (limit / PEAKS, limit.checked_sub(power)) {
            (_, Some(0)) => "power".to_owned(),
            (_, Some(1)) => "torque".to_owned(),
            (_, Some(_)) => MIN_NAME.to_owned(),
            (part, None) if part < joints => format!("angle{}", part + 1),
            (part, None) if part < 2 * joints => format!("rate{}", part - joints + 1),
            (part, None) => {
                let link = problem.robot.as_chain().map(|chain| &chain.links[part - 2 * joints]);
                format!("rotor.{}.rate", link.map_or("", |link| &link.name))
            }
        }
    }
}

/// Relative accuracy of the solver in a final search.
pub(super) const ACCURACY: f64 = 1e-9;
/// Relative accuracy of the solver in a preliminary search.
pub(super) const ROUGH_ACCURACY: f64 = 1e-6;
/// Maximum difference between two costs that count as equal, divided by the accuracy of the solver.
const COST_TOLERANCE: f64 = 100.0;
/// Maximum relative difference between two commands that count as equal, divided by the square root of the solver's
/// accuracy: the objective is stationary at an optimum, so that commands are less accurate than costs.
const COMMAND_TOLERANCE: f64 = 30.0;
/// Floquet multiplier below which a periodic solution counts as stable regardless of how it was computed.
const MAX_STABLE_MULTIPLIER: f64 = 1.0 - 1e-6;
/// Number of samples per cycle at which torques are compared with their limit.
const TORQUE_SAMPLES: usize = 240;
/// Finite-difference step for the torque gradient as a fraction of a command's range, divided by the square root of the
/// solver's accuracy.
const TORQUE_STEP: f64 = 0.3;

/// Cost, relative excess over the limits, and the gradients of both at a position in the landscape.
#[derive(Debug, Clone)]
pub(super) struct Evaluation {
    /// Logarithm of the objective, with the sign for which lower is better.
    pub cost: f64,
    pub gradient: Position,
    /// Relative excess over each limit; minus infinity if the limit does not apply.
    pub excess: Vec<f64>,
    pub excess_gradients: Vec<Position>,
}

impl Evaluation {
    /// Removes every exceeded limit that no free command influences; `limits` are the indices to check.
    fn drop_fixed(&mut self, limits: Range<usize>) {
        for i in limits {
            if self.excess[i] > 0.0 && self.excess_gradients[i].amax() == 0.0 {
                self.excess[i] = f64::NEG_INFINITY;
            }
        }
    }
}

/// Cost landscape with a warm-started solver: each solution starts from the previous one.
#[derive(Debug, Clone)]
pub(super) struct Landscape<'a> {
    objective: Objective,
    commands: &'a [Command],
    bounds: &'a Bounds,
    ranges: Vec<[f64; 2]>,
    limits: Limits,
    problem: Problem,
    solver: Solver,
    /// Relative accuracy of the solver.
    pub accuracy: f64,
    /// Whether to reject solutions that are not clearly stable.
    pub only_stable: bool,
    /// Whether the solver looks for a solution only near the previous one, which avoids the costly proof that there is
    /// none.
    pub only_near: bool,
    /// Penalty added to the merit per unit of relative excess over a limit.
    pub penalty: f64,
}

impl<'a> Landscape<'a> {
    pub(super) fn new(
        problem: Problem,
        objective: Objective,
        commands: &'a [Command],
        bounds: &'a Bounds,
        accuracy: f64,
    ) -> Self {
        Self {
            objective,
            commands,
            bounds,
            ranges: commands.iter().map(|command| command.range(bounds)).collect(),
            limits: Limits::new(&problem),
            problem,
            solver: Solver::default(),
            accuracy,
            only_stable: false,
            only_near: false,
            penalty: 1.0,
        }
    }

    /// Makes the next solution start from rest.
    pub(super) fn forget(&mut self) {
        self.solver.forget();
    }

    /// Returns the number of free commands.
    pub(super) fn count(&self) -> usize {
        self.commands.len()
    }

    /// Returns the position at which every command is at the lower end of its range.
    pub(super) fn origin(&self) -> Position {
        Position::zeros(self.count().max(MIN_LENGTH))
    }

    /// Returns the position of a problem, with commands clamped to their ranges.
    pub(super) fn position_of(&self, problem: &Problem) -> Position {
        let mut position = self.origin();
        for (i, command) in self.commands.iter().enumerate() {
            let [low, high] = self.ranges[i];
            position[i] = ((command.value(problem) - low) / (high - low)).clamp(0.0, 1.0);
        }
        position
    }

    /// Returns the problem to solve at a position.
    pub(super) fn problem_at(&self, position: &Position) -> Problem {
        let mut problem = self.problem.clone();
        self.set(&mut problem, position);
        problem
    }

    fn set(&self, problem: &mut Problem, position: &Position) {
        for (i, command) in self.commands.iter().enumerate() {
            let [low, high] = self.ranges[i];
            command.set(problem, low + position[i] * (high - low));
        }
    }

    /// Evaluates the cost at a position, without derivatives and limits; `None` if there is no periodic solution or the
    /// cost is undefined.
    pub(super) fn cost(&mut self, position: &Position) -> Option<f64> {
        let problem = self.problem_at(position);
        let (metrics, work_j) = self.solve(&problem)?;
        Some(self.objective.cost([metrics.d_m, problem.omega_rad_s, work_j]))
            .filter(|cost| cost.is_finite())
    }

    /// Returns whether two costs are equal within the accuracy of the solver.
    pub(super) fn are_same(&self, one: f64, other: f64) -> bool {
        (one - other).abs() < COST_TOLERANCE * self.accuracy
    }

    /// Returns the maximum relative difference between two commands that count as equal.
    pub(super) fn command_tolerance(&self) -> f64 {
        COMMAND_TOLERANCE * self.accuracy.sqrt()
    }

    /// Returns whether the latest solution is stable.
    pub(super) fn is_stable(&mut self) -> bool {
        self.solver.status().is_ok_and(MotionStatus::is_stable)
    }

    /// Solves a problem; returns the metrics and the actuators' work per cycle, J (1 if the work is not needed). `None`
    /// if there is no periodic solution (or no stable one, if required), or if displacement or work is not positive,
    /// because the cost is a logarithm.
    fn solve(&mut self, problem: &Problem) -> Option<(GaitMetrics, f64)> {
        let metrics = if self.only_near {
            self.solver.solve_near(problem, self.accuracy)
        } else {
            self.solver.solve(problem, self.accuracy)
        };
        let metrics = metrics.ok()?;
        if self.only_stable
            && self.solver.floquet().ok()?.is_some_and(|modulus| modulus > MAX_STABLE_MULTIPLIER)
        {
            return None;
        }
        let work_j = if self.needs_work() { self.solver.loss_j().ok()? } else { 1.0 };
        let is_undefined = metrics.d_m <= 0.0 || (self.has_work_objective() && work_j <= 0.0);
        (!is_undefined).then_some((metrics, work_j))
    }

    /// Returns whether the objective to optimise, or another objective that is subject to a limit, depends on the work.
    fn has_work_objective(&self) -> bool {
        let limited = self.bounds.least.map(|(objective, _)| objective);
        [self.objective].into_iter().chain(limited).any(Objective::depends_on_work)
    }

    fn needs_work(&self) -> bool {
        self.has_work_objective() || self.bounds.power_w.is_some()
    }

    /// Returns the merit: the cost plus the penalty for exceeded limits.
    pub(super) fn merit(&self, point: &Evaluation) -> f64 {
        point.cost + point.excess.iter().map(|excess| self.penalty * excess.max(0.0)).sum::<f64>()
    }

    /// Evaluates cost, limits and their gradients at a position; returns `None` if there is no periodic solution or the
    /// cost is undefined.
    pub(super) fn evaluate(&mut self, position: &Position) -> Option<Evaluation> {
        self.evaluate_below(position, f64::INFINITY)?.ok()
    }

    /// Evaluates a position as [`Self::evaluate`] does; but if the merit exceeds `max_merit`, returns the merit as an
    /// error without computing derivatives.
    pub(super) fn evaluate_below(
        &mut self,
        position: &Position,
        max_merit: f64,
    ) -> Option<Result<Evaluation, f64>> {
        let problem = self.problem_at(position);
        let evaluation = self.evaluate_problem(&problem, position, max_merit)?;
        let is_finite = evaluation.as_ref().is_err()
            || evaluation.as_ref().is_ok_and(|point| {
                let gradients = point.excess_gradients.iter().chain([&point.gradient]);
                point.cost.is_finite() && gradients.flatten().all(|slope| slope.is_finite())
            });
        is_finite.then_some(evaluation)
    }

    fn evaluate_problem(
        &mut self,
        problem: &Problem,
        position: &Position,
        max_merit: f64,
    ) -> Option<Result<Evaluation, f64>> {
        let (metrics, work_j) = self.solve(problem)?;
        let (power, least) = (self.limits.power, self.limits.least());
        let omega = problem.omega_rad_s;
        let values = [metrics.d_m, omega, work_j];
        let mut point = Evaluation {
            cost: self.objective.cost(values),
            gradient: self.origin(),
            excess: vec![f64::NEG_INFINITY; self.limits.count()],
            excess_gradients: vec![self.origin(); self.limits.count()],
        };
        self.limit_commands(&mut point, problem);
        if let Some(power_w) = self.bounds.power_w {
            point.excess[power] = work_j * omega / (TAU * power_w) - 1.0;
        }
        if let Some((objective, value)) = self.bounds.least {
            point.excess[least] = objective.cost(values) - objective.cost_of_value(value);
        }
        if self.bounds.torque_nm.is_none() {
            let merit = self.merit(&point);
            if merit > max_merit {
                return Some(Err(merit));
            }
        }
        let numbers = self.commands.iter().filter_map(|command| match command {
            Command::Omega => None,
            Command::Number(number) => Some(*number),
        });
        let numbers: Vec<ChainNumber> = numbers.collect();
        let (by_omega, by_number) = self.solver.derivatives_with_omega(&numbers).ok()?;
        let mut by_number = by_number.into_iter();
        for (i, command) in self.commands.iter().enumerate() {
            let size = self.ranges[i][1] - self.ranges[i][0];
            let NumberDerivatives { metrics: slopes, work_j: work } = match command {
                Command::Omega => by_omega,
                Command::Number(_) => by_number.next()?,
            };
            let d_m = slopes.d_m;
            let dln_omega = if *command == Command::Omega { 1.0 / omega } else { 0.0 };
            let slope = |objective: Objective| {
                let [d_power, omega_power, work_power] = objective.powers();
                let relative = d_power * d_m / metrics.d_m
                    + omega_power * dln_omega
                    + work_power * work / work_j;
                -size * relative
            };
            point.gradient[i] = slope(self.objective);
            if let Some((objective, _)) = self.bounds.least {
                point.excess_gradients[least][i] = slope(objective);
            }
            if let Some(power_w) = self.bounds.power_w {
                let derivative = (work + work_j * dln_omega) * omega / (TAU * power_w);
                point.excess_gradients[power][i] = size * derivative;
            }
        }
        if let Some(torque_nm) = self.bounds.torque_nm {
            self.limit_torque(&mut point, torque_nm, problem, position)?;
        }
        point.drop_fixed(power..self.limits.count());
        Some(Ok(point))
    }

    /// Stores the relative excess of joint angles and rates over their limits in `point`, with gradients.
    fn limit_commands(&self, point: &mut Evaluation, problem: &Problem) {
        let omega = problem.omega_rad_s;
        self.for_each_peak(problem, |limit, drive, order, Peak { value, slopes }, most| {
            point.excess[limit] = value / most - 1.0;
            for (i, command) in self.commands.iter().enumerate() {
                let size = self.ranges[i][1] - self.ranges[i][0];
                let slope = match command {
                    Command::Omega if order == 1 => value / omega,
                    command => command.index_in(drive).map_or(0.0, |number| slopes[number]),
                };
                point.excess_gradients[limit][i] = size * slope / most;
            }
        });
        point.drop_fixed(0..self.limits.power);
    }

    /// Returns the relative excess of joint angles and rates at a position over their limits; minus infinity for all
    /// other limits.
    pub(super) fn excess_of_commands(&self, position: &Position) -> Vec<f64> {
        let mut excess = vec![f64::NEG_INFINITY; self.limits.count()];
        self.for_each_peak(&self.problem_at(position), |limit, _, _, peak, most| {
            excess[limit] = peak.value / most - 1.0;
        });
        excess
    }

    /// Calls `task` for every limited peak with the index of the limit, the drive, the order of the derivative (0 for
    /// the angle, 1 for the rate), the peak, and the maximum value allowed for it.
    fn for_each_peak(&self, problem: &Problem, mut task: impl FnMut(usize, Drive, i32, Peak, f64)) {
        let Bounds { angle_rad, rate_rad_s, .. } = *self.bounds;
        let rate_per_omega = rate_rad_s / problem.omega_rad_s;
        for drive in Drive::all(problem) {
            let Some(command) = drive.angle(problem) else { continue };
            for (order, max_value) in [(0, angle_rad), (1, rate_per_omega)] {
                let Some(first) = self.limits.first(drive, order) else { continue };
                for (limit, peak) in (first..).zip(peaks(command, order)) {
                    if let Some(peak) = peak {
                        task(limit, drive, order, peak, max_value);
                    }
                }
            }
        }
    }

    /// Stores the relative excess of the largest torque over its limit (`torque_nm`, N m) in `point`, with a
    /// finite-difference gradient; returns `None` if the torque is zero or cannot be computed.
    fn limit_torque(
        &mut self,
        point: &mut Evaluation,
        torque_nm: f64,
        problem: &Problem,
        position: &Position,
    ) -> Option<()> {
        let limit = self.limits.torque();
        let here = largest_torque(&mut self.solver)?;
        point.excess[limit] = here / torque_nm - 1.0;
        let mut neighbour = problem.clone();
        let size = TORQUE_STEP * self.accuracy.sqrt();
        for i in 0..self.count() {
            let step = if position[i] + size > 1.0 { -size } else { size };
            let mut moved = position.clone();
            moved[i] += step;
            self.set(&mut neighbour, &moved);
            self.solver.solve(&neighbour, self.accuracy).ok()?;
            let there = largest_torque(&mut self.solver)?;
            point.excess_gradients[limit][i] = (there - here) / (step * torque_nm);
        }
        Some(())
    }

    /// Returns the names of the active bounds (ends of ranges, such as `least omega`) and limits.
    pub(super) fn bounds_met(&self, position: &Position, point: &Evaluation) -> Vec<String> {
        const NEAR: f64 = 1e-6;
        let mut met = Vec::new();
        for (i, command) in self.commands.iter().enumerate().filter(|(_, of)| !of.is_phase()) {
            let end = if position[i] < NEAR {
                "least"
            } else if position[i] > 1.0 - NEAR {
                "most"
            } else {
                continue;
            };
            met.push(format!("{end} {}", command.name(&self.problem.robot)));
        }
        for (limit, excess) in point.excess.iter().enumerate() {
            let name = self.limits.name(limit, &self.problem);
            if *excess > -NEAR && !met.contains(&name) {
                met.push(name);
            }
        }
        met
    }
}

/// Returns the largest absolute torque of the actuators of joints in a cycle, N m; `None` if it is zero.
fn largest_torque(solver: &mut Solver) -> Option<f64> {
    let largest = solver.largest_torque_nm(TORQUE_SAMPLES).ok()?;
    (largest > 0.0).then_some(largest)
}

/// Extremum of a joint's angle or rate in one direction, with derivatives with respect to the parameters of the joint's
/// command.
#[derive(Clone, Copy)]
struct Peak {
    value: f64,
    slopes: [f64; 5],
}

/// Returns the peaks of a command's angle (order 0) or of its rate divided by omega (order 1).
///
/// Without a second harmonic the angle has one peak in each direction, and the rate has a single one. With a second
/// harmonic there are two maxima and two minima; if there is only one of each, it is repeated.
fn peaks(command: &JointCommand, order: i32) -> [Option<Peak>; PEAKS] {
    let JointCommand { offset_rad, amplitude_rad, .. } = *command;
    if command.second.is_none() {
        let side = |sign: f64| {
            let value = sign * offset_rad + amplitude_rad;
            Some(Peak { value, slopes: [sign, 1.0, 0.0, 0.0, 0.0] })
        };
        return if order == 0 {
            [side(1.0), side(-1.0), None, None]
        } else {
            let slopes = [0.0, 1.0, 0.0, 0.0, 0.0];
            [Some(Peak { value: amplitude_rad, slopes }), None, None, None]
        };
    }
    let turns = command.turns(order);
    let value = |phase: f64| command.derivative(order, phase);
    let descending = |a: &f64, b: &f64| value(*b).total_cmp(&value(*a));
    let highest = turns.as_slice().iter().copied().min_by(descending);
    let lowest = turns.as_slice().iter().copied().max_by(descending);
    let (Some(highest), Some(lowest)) = (highest, lowest) else { return [None; PEAKS] };
    let mut phases = [highest, highest, lowest, lowest];
    if let Ok(all) = <[f64; PEAKS]>::try_from(turns.as_slice()) {
        phases = all;
        phases.sort_by(descending);
    }
    // Sort each pair by phase, so that the order does not change when the other peak becomes the higher one.
    phases.chunks_mut(2).for_each(|pair| pair.sort_by(f64::total_cmp));
    let mut peaks = [None; PEAKS];
    for (index, (peak, phase)) in peaks.iter_mut().zip(phases).enumerate() {
        let sign = if index < 2 { 1.0 } else { -1.0 };
        let slopes = command.slopes(order, phase).map(|slope| sign * slope);
        *peak = Some(Peak { value: sign * value(phase), slopes });
    }
    peaks
}
