//! The objective over the commands that may vary, and what limits them.

use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::SVector;
use trilink_mechanics::{MotionStatus, Problem, Solver};
use trilink_robot::JointCommand;
use trilink_robot::metrics::GaitMetrics;
use trilink_tables::Objective;

use super::commands::{Bounds, Command, MOST_COMMANDS};

/// Commands as parts of their ranges, 0 to 1; those that do not vary are zero.
pub(super) type Place = SVector<f64, MOST_COMMANDS>;

/// Limits that are no ranges: two highest and two lowest places of each joint's angle and of its rate, of which a
/// command without a second harmonic has one each, the power, the torque, another objective.
pub(super) const LIMITS: usize = 4 * PEAKS + 3;
/// Of a joint's angle, or of its rate.
const PEAKS: usize = 4;
const RATE: usize = 2 * PEAKS;
const POWER: usize = 4 * PEAKS;
const TORQUE: usize = POWER + 1;
const LEAST: usize = POWER + 2;
/// Their names.
pub(super) const LEAST_NAME: &str = "least";
/// Numbers of a command without those of its second harmonic.
const NUMBERS: usize = 3;
const LIMIT_NAMES: [&str; 7] =
    ["angle1", "angle2", "rate1", "rate2", "power", "torque", LEAST_NAME];

/// Relative accuracy of the motions of a search, and of one after which another begins where it has ended.
pub(super) const ACCURACY: f64 = 1e-9;
pub(super) const ROUGH_ACCURACY: f64 = 1e-6;
/// Relative difference of two objectives that are the same, over the accuracy of the motions.
const SAME_VALUE: f64 = 100.0;
/// Relative difference of two commands that are the same, over the root of that accuracy: at an optimum the objective is
/// flat.
const SAME_COMMAND: f64 = 30.0;
/// Largest Floquet multiplier of a motion that is stable however it was solved for.
const CLEARLY_STABLE: f64 = 1.0 - 1e-6;
/// Moments of a cycle at which torques are compared with their limit.
const TORQUE_SAMPLES: usize = 240;
/// Step of a command, as a part of its range, that tells what it changes of the largest torque, over the root of the
/// motions' accuracy.
const TORQUE_STEP: f64 = 0.3;

/// The objective at one place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    /// Logarithm of the objective, with the sign that makes it a cost; its gradient.
    pub cost: f64,
    pub gradient: Place,
    /// By how much each limit is exceeded, as a part of it, and the gradient of that; minus infinity where there is
    /// none.
    pub excess: [f64; LIMITS],
    pub excess_gradients: [Place; LIMITS],
}

impl Point {
    /// What nothing that varies can change is no limit.
    fn drop_fixed(&mut self, limits: Range<usize>) {
        for i in limits {
            if self.excess[i] > 0.0 && self.excess_gradients[i].amax() == 0.0 {
                self.excess[i] = f64::NEG_INFINITY;
            }
        }
    }
}

/// Evaluates the objective, each motion from the last one.
#[derive(Debug, Clone)]
pub(super) struct Landscape<'a> {
    objective: Objective,
    commands: &'a [Command],
    bounds: &'a Bounds,
    ranges: [[f64; 2]; MOST_COMMANDS],
    problem: Problem,
    solver: Solver,
    /// Relative accuracy of the motions.
    pub accuracy: f64,
    /// Whether a motion that is not clearly stable is none.
    pub only_stable: bool,
    /// Whether motions are looked for near the last one only: that there is none is what takes longest to find out.
    pub only_near: bool,
    /// What it costs to exceed a limit by all of it.
    pub price: f64,
}

impl<'a> Landscape<'a> {
    pub(super) fn new(
        problem: Problem,
        objective: Objective,
        commands: &'a [Command],
        bounds: &'a Bounds,
        accuracy: f64,
    ) -> Self {
        let mut ranges = [[0.0, 1.0]; MOST_COMMANDS];
        commands.iter().zip(&mut ranges).for_each(|(of, range)| *range = of.range(bounds));
        Self {
            objective,
            commands,
            bounds,
            ranges,
            problem,
            solver: Solver::default(),
            accuracy,
            only_stable: false,
            only_near: false,
            price: 1.0,
        }
    }

    /// Makes the next motion start from rest.
    pub(super) fn forget(&mut self) {
        self.solver.forget();
    }

    /// How many commands vary.
    pub(super) fn count(&self) -> usize {
        self.commands.len()
    }

    /// Where a problem is, as far as it is within the ranges.
    pub(super) fn place_of(&self, problem: &Problem) -> Place {
        let mut place = Place::zeros();
        for (i, command) in self.commands.iter().enumerate() {
            let [low, high] = self.ranges[i];
            place[i] = ((command.value(problem) - low) / (high - low)).clamp(0.0, 1.0);
        }
        place
    }

    /// The problem at a place.
    pub(super) fn problem_at(&self, place: &Place) -> Problem {
        let mut problem = self.problem.clone();
        self.set(&mut problem, place);
        problem
    }

    fn set(&self, problem: &mut Problem, place: &Place) {
        for (i, command) in self.commands.iter().enumerate() {
            let [low, high] = self.ranges[i];
            command.set(problem, low + place[i] * (high - low));
        }
    }

    /// The cost at a place alone, as accurate as [`Self::evaluate`] has it.
    pub(super) fn cost(&mut self, place: &Place) -> Option<f64> {
        let problem = self.problem_at(place);
        let (metrics, work_j) = self.solve(&problem)?;
        Some(self.objective.cost([metrics.d_m, problem.omega_rad_s, work_j]))
            .filter(|cost| cost.is_finite())
    }

    /// Whether two costs are the same, as far as motions of this accuracy tell.
    pub(super) fn are_same(&self, one: f64, other: f64) -> bool {
        (one - other).abs() < SAME_VALUE * self.accuracy
    }

    /// Relative difference of two commands that are the same, as far as motions of this accuracy tell.
    pub(super) fn same_command(&self) -> f64 {
        SAME_COMMAND * self.accuracy.sqrt()
    }

    /// Whether the motion that was solved for last is stable.
    pub(super) fn is_stable(&mut self) -> bool {
        self.solver.status().is_ok_and(MotionStatus::is_stable)
    }

    /// The metrics of a motion, and its work where that is needed; `None` where there is no motion, or it
    /// comes to nothing.
    fn solve(&mut self, problem: &Problem) -> Option<(GaitMetrics, f64)> {
        let metrics = match self.only_near {
            true => self.solver.solve_near(problem, self.accuracy),
            false => self.solver.solve(problem, self.accuracy),
        };
        let metrics = metrics.ok()?;
        if self.only_stable
            && self.solver.floquet().ok()?.is_some_and(|modulus| modulus > CLEARLY_STABLE)
        {
            return None;
        }
        let work_j = if self.needs_work() { self.solver.loss_j().ok()? } else { 1.0 };
        let is_nothing = metrics.d_m <= 0.0 || (self.knows_work() && work_j <= 0.0);
        (!is_nothing).then_some((metrics, work_j))
    }

    /// Whether the objective, or the other one that is limited, is made of work.
    fn knows_work(&self) -> bool {
        let least = self.bounds.least.map(|(of, _)| of);
        [self.objective].into_iter().chain(least).any(Objective::knows_work)
    }

    fn needs_work(&self) -> bool {
        self.knows_work() || self.bounds.power_w.is_some()
    }

    /// The cost with the price of exceeded limits.
    pub(super) fn merit(&self, point: &Point) -> f64 {
        point.cost + point.excess.iter().map(|of| self.price * of.max(0.0)).sum::<f64>()
    }

    /// The objective at a place; `None` where there is no motion, or it comes to nothing.
    pub(super) fn evaluate(&mut self, place: &Place) -> Option<Point> {
        self.evaluate_below(place, f64::INFINITY)?.ok()
    }

    /// The same, or the merit alone, which takes no derivatives, where that is more than `most`.
    pub(super) fn evaluate_below(
        &mut self,
        place: &Place,
        most: f64,
    ) -> Option<Result<Point, f64>> {
        let problem = self.problem_at(place);
        let found = self.point(&problem, place, most)?;
        let is_finite = found.as_ref().is_err()
            || found.is_ok_and(|point| {
                let gradients = point.excess_gradients.iter().chain([&point.gradient]);
                point.cost.is_finite() && gradients.flatten().all(|slope| slope.is_finite())
            });
        is_finite.then_some(found)
    }

    fn point(&mut self, problem: &Problem, place: &Place, most: f64) -> Option<Result<Point, f64>> {
        let (metrics, work_j) = self.solve(problem)?;
        let omega = problem.omega_rad_s;
        let values = [metrics.d_m, omega, work_j];
        let mut point = Point {
            cost: self.objective.cost(values),
            gradient: Place::zeros(),
            excess: [f64::NEG_INFINITY; LIMITS],
            excess_gradients: [Place::zeros(); LIMITS],
        };
        self.limit_commands(&mut point, problem);
        if let Some(power_w) = self.bounds.power_w {
            point.excess[POWER] = work_j * omega / (TAU * power_w) - 1.0;
        }
        if let Some((of, value)) = self.bounds.least {
            point.excess[LEAST] = of.cost(values) - of.cost_of_value(value);
        }
        if self.bounds.torque_nm.is_none() {
            let merit = self.merit(&point);
            if merit > most {
                return Some(Err(merit));
            }
        }
        let [distance, work] = self.solver.distance_and_work_derivatives().ok()?;
        for (i, command) in self.commands.iter().enumerate() {
            let size = self.ranges[i][1] - self.ranges[i][0];
            let (d_m, work) = match *command {
                Command::Omega => (distance.omega, work.omega),
                Command::Joint(joint, number) if number >= NUMBERS => {
                    let part = number - NUMBERS;
                    (distance.second[joint][part], work.second[joint][part])
                }
                Command::Joint(joint, number) => {
                    (distance.gait[joint][number], work.gait[joint][number])
                }
            };
            let by_omega = if *command == Command::Omega { 1.0 / omega } else { 0.0 };
            let slope = |of: Objective| {
                let [of_d, of_omega, of_work] = of.powers();
                let relative =
                    of_d * d_m / metrics.d_m + of_omega * by_omega + of_work * work / work_j;
                -size * relative
            };
            point.gradient[i] = slope(self.objective);
            if let Some((of, _)) = self.bounds.least {
                point.excess_gradients[LEAST][i] = slope(of);
            }
            if let Some(power_w) = self.bounds.power_w {
                let by_command = (work + work_j * by_omega) * omega / (TAU * power_w);
                point.excess_gradients[POWER][i] = size * by_command;
            }
        }
        if let Some(torque_nm) = self.bounds.torque_nm {
            self.limit_torque(&mut point, torque_nm, problem, place)?;
        }
        point.drop_fixed(POWER..LIMITS);
        Some(Ok(point))
    }

    /// Fills in by how much the commands exceed the limits of angles and rates.
    fn limit_commands(&self, point: &mut Point, problem: &Problem) {
        let omega = problem.omega_rad_s;
        self.each_peak(problem, |limit, joint, order, Peak { value, slopes }, most| {
            point.excess[limit] = value / most - 1.0;
            for (i, of) in self.commands.iter().enumerate() {
                let size = self.ranges[i][1] - self.ranges[i][0];
                let slope = match *of {
                    Command::Omega if order == 1 => value / omega,
                    Command::Joint(own, number) if own == joint => slopes[number],
                    _ => 0.0,
                };
                point.excess_gradients[limit][i] = size * slope / most;
            }
        });
        point.drop_fixed(0..POWER);
    }

    /// By how much the commands at a place exceed the limits of angles and rates; minus infinity for other limits.
    pub(super) fn excess_of_commands(&self, place: &Place) -> [f64; LIMITS] {
        let mut excess = [f64::NEG_INFINITY; LIMITS];
        self.each_peak(&self.problem_at(place), |limit, _, _, peak, most| {
            excess[limit] = peak.value / most - 1.0;
        });
        excess
    }

    /// Does `task` with every limit of a peak: its number, the joint, whether it is one of the angle or of the rate (0,
    /// 1), the peak, and what it may be at most.
    fn each_peak(&self, problem: &Problem, mut task: impl FnMut(usize, usize, i32, Peak, f64)) {
        let Bounds { angle_rad, rate_rad_s, .. } = *self.bounds;
        let most_per_rad = rate_rad_s / problem.omega_rad_s;
        for (joint, command) in problem.gait.joints.iter().enumerate() {
            let Some(command) = command else { continue };
            for (order, first, most) in
                [(0, PEAKS * joint, angle_rad), (1, RATE + PEAKS * joint, most_per_rad)]
            {
                for (limit, peak) in (first..).zip(peaks(command, order)) {
                    if let Some(peak) = peak {
                        task(limit, joint, order, peak, most);
                    }
                }
            }
        }
    }

    /// Fills in by how much the largest torque exceeds its limit. What changes that is found from
    /// neighbouring motions.
    fn limit_torque(
        &mut self,
        point: &mut Point,
        torque_nm: f64,
        problem: &Problem,
        place: &Place,
    ) -> Option<()> {
        let largest = |solver: &mut Solver, passive: Option<usize>| -> Option<f64> {
            let samples = solver.cycle(TORQUE_SAMPLES).ok()?;
            let of_sample = samples.iter().flat_map(|sample| {
                let torques = sample.forces.torque_nm.into_iter().enumerate();
                torques.filter(|(joint, _)| Some(*joint) != passive).map(|(_, of)| of.abs())
            });
            // Where the shape is singular torques are not known.
            let largest = of_sample.filter(|of| of.is_finite()).fold(0.0, f64::max);
            (largest > 0.0).then_some(largest)
        };
        let passive = problem.gait.passive_joint();
        let here = largest(&mut self.solver, passive)?;
        point.excess[TORQUE] = here / torque_nm - 1.0;
        let mut neighbour = problem.clone();
        let size = TORQUE_STEP * self.accuracy.sqrt();
        for i in 0..self.count() {
            let step = if place[i] + size > 1.0 { -size } else { size };
            let mut moved = *place;
            moved[i] += step;
            self.set(&mut neighbour, &moved);
            self.solver.solve(&neighbour, self.accuracy).ok()?;
            let there = largest(&mut self.solver, passive)?;
            point.excess_gradients[TORQUE][i] = (there - here) / (step * torque_nm);
        }
        Some(())
    }

    /// What keeps a place where it is: ends of ranges, and limits that are reached.
    pub(super) fn bounds_met(&self, place: &Place, point: &Point) -> Vec<String> {
        const NEAR: f64 = 1e-6;
        let mut met = Vec::new();
        for (i, command) in self.commands.iter().enumerate().filter(|(_, of)| !of.is_phase()) {
            let end = match place[i] {
                part if part < NEAR => "least",
                part if part > 1.0 - NEAR => "most",
                _ => continue,
            };
            met.push(format!("{end} {command}"));
        }
        let names =
            |limit: usize| LIMIT_NAMES[(limit / PEAKS).min(4) + limit.saturating_sub(POWER)];
        for (name, excess) in (0..LIMITS).map(names).zip(point.excess) {
            if excess > -NEAR && !met.iter().any(|known| *known == name) {
                met.push(name.to_owned());
            }
        }
        met
    }
}

/// How far a joint goes, or how fast, to one side, with the derivatives of that with respect to the
/// numbers of its command.
#[derive(Clone, Copy)]
struct Peak {
    value: f64,
    slopes: [f64; 5],
}

/// The peaks of a command's angle (order 0) or of its rate per omega (1): of a first harmonic alone that to
/// each side, of the rate one; else the two highest and the two lowest, one twice where there is no other.
fn peaks(command: &JointCommand, order: i32) -> [Option<Peak>; PEAKS] {
    let JointCommand { offset_rad, amplitude_rad, .. } = *command;
    if command.second.is_none() {
        let side = |sign: f64| {
            let value = sign * offset_rad + amplitude_rad;
            Some(Peak { value, slopes: [sign, 1.0, 0.0, 0.0, 0.0] })
        };
        return match order {
            0 => [side(1.0), side(-1.0), None, None],
            _ => {
                let slopes = [0.0, 1.0, 0.0, 0.0, 0.0];
                [Some(Peak { value: amplitude_rad, slopes }), None, None, None]
            }
        };
    }
    let turns = command.turns(order);
    let value = |phase: f64| command.derivative(order, phase);
    let by_value = |a: &f64, b: &f64| value(*b).total_cmp(&value(*a));
    let phases = || turns.as_slice().iter().copied();
    let (Some(highest), Some(lowest)) = (phases().min_by(by_value), phases().max_by(by_value))
    else {
        return [None; PEAKS];
    };
    let mut places = [highest, highest, lowest, lowest];
    if let Ok(all) = <[f64; PEAKS]>::try_from(turns.as_slice()) {
        places = all;
        places.sort_by(by_value);
    }
    // In the order in which they come, which stays when the other one is the higher.
    places.chunks_mut(2).for_each(|pair| pair.sort_by(f64::total_cmp));
    let mut found = [None; PEAKS];
    for (nth, (peak, phase)) in found.iter_mut().zip(places).enumerate() {
        let sign = if nth < 2 { 1.0 } else { -1.0 };
        let slopes = command.slopes(order, phase).map(|slope| sign * slope);
        *peak = Some(Peak { value: sign * value(phase), slopes });
    }
    found
}
