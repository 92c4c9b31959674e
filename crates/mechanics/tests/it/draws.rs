//! Tests with random robots, gaits and coefficients, far beyond those of the paper: every draw ends in a
//! status, and no result contradicts the motion integrated from rest.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;
use trilink_mechanics::{
    Attractor, FIT_ACCURACY, Laws, Model, MotionError, MotionStatus, Problem, REFERENCE_ACCURACY,
    Solver,
};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Gait, JointCommand, Quantity, Robot};

use crate::{Derivatives, three_links};

pub struct Draw(ChaCha8Rng);
impl Draw {
    pub fn new(seed: u64, stream: usize) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(stream as u64);
        Self(generator)
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Returns a log-uniform random number between `low` and `high`.
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.within(low.ln(), high.ln()).exp()
    }

    fn below(&mut self, count: usize) -> usize {
        self.within(0.0, count as f64) as usize
    }

    fn joint(&mut self) -> JointCommand {
        JointCommand {
            offset_rad: if self.below(2) == 0 { 0.0 } else { self.within(-1.0, 1.0) },
            amplitude_rad: self.within(0.05, 0.9),
            phase_rad: self.within(-PI, PI),
            second: None,
        }
    }

    pub fn problem(&mut self) -> Problem {
        let h_m = self.within(0.05, 0.3);
        let l_m = self.within(0.05, 0.3);
        let mass_kg = [self.within(0.3, 3.0), self.within(0.05, 0.5), self.within(0.05, 0.5)];
        let mut robot = Robot {
            h_m: [h_m; 2],
            l_m: [l_m; 2],
            b_m: [l_m * self.within(0.0, 1.0); 2],
            mass_kg,
            inertia_kg_m2: [
                mass_kg[0] * h_m * h_m * self.within(0.1, 0.6),
                mass_kg[1] * l_m * l_m * self.within(0.05, 0.4),
                mass_kg[2] * l_m * l_m * self.within(0.05, 0.4),
            ],
            ..Robot::kinematic()
        };
        // Skid coefficients between the bounds configured for fits.
        for (of, [low, high]) in [
            (Quantity::Roll, [0.01, 3.0]),
            (Quantity::Skid, [1.0, 1000.0]),
            (Quantity::SkidDry, [0.1, 10.0]),
            (Quantity::SkidStatic, [0.1, 10.0]),
            (Quantity::Stribeck, [0.002, 0.2]),
            (Quantity::RollDry, [0.001, 0.3]),
            (Quantity::Transition, [0.001, 0.05]),
            (Quantity::Stiffness, [0.02, 1.0]),
            (Quantity::Damping, [1e-4, 0.1]),
        ] {
            of.numbers_mut(&mut robot).fill_with(|| self.between(low, high));
        }
        robot.rest_angle_rad = if self.below(2) == 0 { 0.0 } else { self.within(-0.4, 0.4) };
        let joints = match self.below(3) {
            0 => [Some(self.joint()), Some(self.joint())],
            1 => [None, Some(self.joint())],
            _ => [Some(self.joint()), None],
        };
        let laws = crate::laws(Model::PAPER[self.below(Model::PAPER.len())].name());
        Problem::new(robot, Gait { joints }, laws, self.between(0.3, 10.0))
    }
}

/// Returns the displacement (m) and rotation (rad) in each of the first `cycles` cycles from rest.
fn displacements(
    problem: &Problem,
    cycles: usize,
    tolerance: f64,
) -> Result<Vec<[f64; 2]>, String> {
    crate::displacements(problem, cycles, tolerance)
        .map_err(|error| format!("cannot be followed: {error}"))
}

/// Checks that the motion integrated from rest has the attractor's displacement and rotation per cycle.
fn check_attractor(problem: &Problem, settled: &Attractor) -> Result<(), String> {
    let Some(modulus) = settled.motion.floquet.filter(|modulus| *modulus < 1.0) else {
        return Err(format!("settled in an unstable motion: {settled:?}"));
    };
    // The distance is 1 % after these cycles and shrinks by the modulus with each further cycle.
    let soon = settled.cycles + (1e-6_f64.ln() / modulus.max(0.01).ln()).ceil() as usize + 2;
    let GaitMetrics { d_m, dtheta_rad, .. } = settled.motion.metrics;
    let [scale_m, _] = three_links(problem).reach_m();
    // How long a motion wanders before it settles depends on the tolerance.
    let mut message = String::new();
    for cycles in [soon, soon + 400] {
        let [from_rest_m, turn_rad] = displacements(problem, cycles, 1e-8)?[cycles - 1];
        let is_far = (from_rest_m - d_m).abs() > 1e-4 * scale_m.max(from_rest_m);
        if !is_far && (turn_rad - dtheta_rad).abs() <= 1e-4 {
            return Ok(());
        }
        message = format!(
            "goes {d_m} and turns {dtheta_rad}, from rest {from_rest_m} and {turn_rad} after {cycles} cycles"
        );
    }
    Err(message)
}

/// Checks that the motion from rest still changes from cycle to cycle after `cycles` cycles. A motion that does so at
/// either of two integration tolerances passes.
fn check_unsettled(problem: &Problem, cycles: usize) -> Result<(), String> {
    let mut settled = Ok(());
    for tolerance in [1e-7, 1e-9] {
        let last = displacements(problem, cycles, tolerance)?.split_off(cycles - 6);
        let [d_m, turn_rad] = last[5];
        let scales =
            [d_m.max(1e-3 * three_links(problem).skid_length_m()), turn_rad.abs().max(1e-3)];
        let change = |way: &[f64; 2]| {
            ((way[0] - d_m).abs() / scales[0]).max((way[1] - turn_rad).abs() / scales[1])
        };
        if last.iter().map(change).fold(0.0, f64::max) >= 1e-6 {
            return Ok(());
        }
        settled = Err(format!("said not to settle, but goes {:?} in each cycle", last[5]));
    }
    settled
}

/// Solves one random problem and checks the solutions. Returns the outcome, such as `stable` or `unsettled`, or a
/// description of what is wrong. If `is_thorough`, a report that the motion does not settle is confirmed by integrating
/// the motion over time.
fn end(problem: &Problem, is_thorough: bool) -> Result<&'static str, String> {
    let numbers_are_finite = |metrics: &GaitMetrics| {
        let numbers = metrics.to_array();
        numbers.iter().all(|number| number.is_finite()).then_some(()).ok_or(format!("{metrics:?}"))
    };
    let first = problem.solve(REFERENCE_ACCURACY);
    if let Ok(first) = &first {
        numbers_are_finite(&first.metrics)?;
        // The solution with the accuracy of fits approximates the same motion.
        let mut solver = Solver::default();
        let fit = solver.solve(problem, FIT_ACCURACY).map_err(|error| error.to_string())?;
        let same = (fit.d_m - first.metrics.d_m).abs() <= 1e-4 * first.metrics.d_m.max(0.01);
        // It may approximate another motion nearby, to which the more accurate solution then converges, too.
        let finer =
            solver.solve(problem, 0.01 * FIT_ACCURACY).map_err(|error| error.to_string())?;
        let stays = (finer.d_m - fit.d_m).abs() <= 1e-4 * fit.d_m.max(0.01);
        if !same && !stays && first.floquet.is_some_and(|modulus| modulus < 0.9) {
            return Err(format!("to a fit's accuracy {fit:?}, else {:?}", first.metrics));
        }
        if let Ok(derivatives) = Derivatives::of(&mut solver, problem) {
            let Derivatives { parameters, omega, gait, .. } = &derivatives;
            parameters.iter().try_for_each(|(_, by)| numbers_are_finite(&by.metrics))?;
            let gait = gait.as_flattened().iter().map(|by| &by.metrics);
            gait.filter(|by| !by.d_m.is_nan()).try_for_each(numbers_are_finite)?;
            numbers_are_finite(&omega.metrics)?;
        }
    }
    let settled = Solver::default().settle(problem, REFERENCE_ACCURACY);
    let status = match (&first, &settled) {
        (Ok(first), Ok(settled)) if settled.is_found_by_solve => first.status().name(),
        (Ok(first), Ok(_)) if first.status() == MotionStatus::Unstable => "unstable",
        (Ok(_), Ok(_)) => "another",
        (Ok(_), Err(MotionError::Unsettled { cycles, .. })) if is_thorough => {
            check_unsettled(problem, *cycles).map(|()| "unsettled")?
        }
        (Ok(_), Err(MotionError::Unsettled { .. })) => "unsettled",
        (Ok(_), Err(error)) => return Err(error.to_string()),
        (Err(_), Ok(_)) => "found from rest only",
        (Err(_), Err(MotionError::Unsettled { cycles, .. })) if is_thorough => {
            check_unsettled(problem, *cycles).map(|()| "diverged")?
        }
        (Err(error), Err(_)) => return Ok(error.status().name()),
    };
    if let Ok(settled) = &settled
        && settled.motion.floquet.is_some()
    {
        numbers_are_finite(&settled.motion.metrics)?;
        check_attractor(problem, settled)?;
    }
    Ok(status)
}

fn draw(seed: u64, count: usize, is_thorough: bool) {
    draws((0..count).map(|i| Draw::new(seed, i).problem()).collect(), is_thorough);
}

/// Solves all problems and checks the solutions. If `is_thorough`, a motion reported not to settle within a
/// number of cycles is also integrated for that number of cycles to confirm the report.
fn draws(problems: Vec<Problem>, is_thorough: bool) {
    let count = problems.len();
    let ends: Vec<_> = problems
        .into_par_iter()
        .enumerate()
        .with_max_len(1)
        .map(|(i, problem)| {
            let began = std::time::Instant::now();
            (i, end(&problem, is_thorough), began.elapsed().as_secs_f64(), problem)
        })
        .collect();
    let mut counts = BTreeMap::new();
    let mut wrong = Vec::new();
    for (i, end, time_s, problem) in &ends {
        match end {
            Ok(status) => *counts.entry(*status).or_insert(0) += 1,
            Err(message) => wrong.push(format!("draw {i}: {message}: {problem:?}")),
        }
        if *time_s > 60.0 {
            wrong.push(format!("draw {i}: {time_s} s: {problem:?}"));
        }
    }
    let slowest_s = ends.iter().map(|end| end.2).fold(0.0, f64::max);
    eprintln!("{counts:?}, {} wrong, the slowest took {slowest_s:.1} s", wrong.len());
    assert!(wrong.is_empty(), "{} of {count}:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn two_hundred_draws_agree_with_the_motion_from_rest() {
    draw(1, 200, false);
}

/// On coarse elements, the discretised equations have spurious solutions that do not approximate any motion of the
/// robot.
#[test]
fn a_spurious_coarse_solution_is_replaced_on_a_finer_mesh() {
    for i in [4507, 6017, 8284] {
        let settled = Solver::default().settle(&Draw::new(2, i).problem(), REFERENCE_ACCURACY);
        assert!(settled.is_ok_and(|settled| settled.is_found_by_solve), "draw {i}");
    }
}

/// Returns random robots and gaits, with both joints commanded or one passive, each under every friction law.
/// Every second robot and its gait have half-period symmetry.
fn robots_of_every_law(seed: u64, robots: usize) -> Vec<Problem> {
    let robot = |i: usize| {
        let mut draw = Draw::new(seed, i);
        let mut problem = draw.problem();
        problem.omega_rad_s = draw.between(0.05, 30.0);
        if i.is_multiple_of(2) {
            problem.robot.set(Quantity::RestAngle.one(), 0.0);
            problem.gait.joints.iter_mut().flatten().for_each(|joint| joint.offset_rad = 0.0);
        }
        problem
    };
    let of_every_law = |problem: Problem| {
        let laws = [Laws::NO_SKID, Laws::NO_SKID_ROLL, Laws::SKID, Laws::SKID_ROLL];
        laws.map(|laws| Problem { laws, ..problem.clone() })
    };
    (0..robots).map(robot).flat_map(of_every_law).collect()
}

#[test]
fn two_robots_at_any_frequency_agree_with_the_motion_from_rest() {
    draws(robots_of_every_law(3, 2), false);
}

#[test]
#[ignore = "minutes: cargo test --release -p trilink-mechanics --test it forty -- --ignored"]
fn forty_robots_at_any_frequency_agree_with_the_motion_from_rest() {
    draws(robots_of_every_law(3, 40), true);
}

#[test]
#[ignore = "minutes: cargo test -p trilink-mechanics --test it ten_thousand -- --ignored --nocapture"]
fn ten_thousand_draws_agree_with_the_motion_from_rest() {
    draw(2, 10_000, true);
}
