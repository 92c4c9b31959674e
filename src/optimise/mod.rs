//! The gait that is best: optimal commands of a model's steady motion.
//!
//! The objectives are products of powers of d, omega and the actuators' work, of which the solver
//! knows the derivatives by every number of the gait. Searches begin at places spread over the
//! ranges and at the present gait. What they end in counts if the motion is stable and is reached
//! from rest.

mod commands;
mod landscape;
mod objective;
mod search;

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;

use crate::metrics::GaitMetrics;
use crate::motion::{
    Attractor, FromRest, MotionStatus, Problem, REFERENCE_ACCURACY, Solver, SteadyMotion,
};
use crate::robot::{Gait, JointCommand, Model};
use crate::simulate::Setup;
use crate::store::rows;
pub use commands::{Bounds, Command};
use landscape::{Landscape, Place};
pub use objective::Objective;
use search::{End, search};

/// Relative difference of two objectives, and of two commands, that are the same.
const SAME_VALUE: f64 = 1e-7;
const SAME_PLACE: f64 = 1e-3;

/// What is to be found.
#[derive(Debug, Clone)]
pub struct Search {
    /// The robot and its laws, with the present gait and frequency.
    pub problem: Problem,
    pub objective: Objective,
    /// The commands that may vary, one at least.
    pub free: Vec<Command>,
    pub bounds: Bounds,
    /// Places where searches begin, the present gait among them.
    pub starts: usize,
}

/// An optimal gait.
#[derive(Debug, Clone)]
pub struct Optimum {
    pub problem: Problem,
    pub value: f64,
    pub motion: SteadyMotion,
    pub status: MotionStatus,
    pub from_rest: FromRest,
    /// Ends of ranges where it is, and limits that it reaches.
    pub at_bound: Vec<String>,
    /// Searches that ended here.
    pub starts: usize,
}

impl Optimum {
    /// Whether the robot gets there from rest and stays.
    pub fn counts(&self) -> bool {
        self.status.is_stable() && self.from_rest == FromRest::Reached
    }

    /// The same as a line of a table.
    pub fn row(&self, rank: usize, objective: Objective, setup: &Setup) -> OptimumRow {
        let numbers =
            self.problem.gait.joints.map(|of| of.map_or([f64::NAN; 3], JointCommand::to_array));
        OptimumRow {
            rank: rank as i64,
            model: setup.model,
            adequate: setup.fit().and_then(|fit| fit.adequate),
            objective,
            value: self.value,
            omega_rad_s: self.problem.omega_rad_s,
            offset_rad: numbers.map(|of| of[0]),
            amplitude_rad: numbers.map(|of| of[1]),
            phase_rad: numbers.map(|of| of[2]),
            metrics: self.motion.metrics,
            work_j: self.motion.work_j,
            power_w: self.power_w(),
            status: self.status,
            from_rest: self.from_rest,
            at_bound: self.at_bound.clone(),
            starts: self.starts as i64,
        }
    }

    /// Mean power of the actuators, W.
    pub fn power_w(&self) -> f64 {
        self.motion.work_j * self.problem.omega_rad_s / TAU
    }
}

rows! {
    /// An optimum as a line of a table. Numbers of a joint that is passive are missing.
    pub struct OptimumRow {
        /// 1 of the best.
        pub rank: i64,
        pub model: Model,
        /// Whether the model fits the trials that its coefficients are from.
        pub adequate: Option<bool>,
        pub objective: Objective,
        pub value: f64,
        pub omega_rad_s: f64,
        pub offset_rad: [f64; 2] as "phi{}_offset_rad",
        pub amplitude_rad: [f64; 2] as "phi{}_amplitude_rad",
        pub phase_rad: [f64; 2] as "phi{}_phase_rad",
        pub metrics: GaitMetrics,
        pub work_j: f64,
        pub power_w: f64,
        pub status: MotionStatus,
        pub from_rest: FromRest,
        pub at_bound: Vec<String>,
        pub starts: i64,
    }
}

/// What a search has found.
#[derive(Debug, Clone)]
pub struct Found {
    /// Where searches ended, the best first: those that count before those that do not.
    pub optima: Vec<Optimum>,
    /// Searches that found no motion, or none within the limits.
    pub failed: usize,
}

impl Found {
    /// The best gait that counts.
    pub fn best(&self) -> Option<&Optimum> {
        self.optima.first().filter(|best| best.counts())
    }
}

impl Search {
    /// Searches from all starts.
    pub fn run(&self) -> Found {
        let ends: Vec<Option<End>> = (0..self.starts)
            .into_par_iter()
            .with_max_len(1)
            .map(|number| {
                let mut landscape = self.landscape();
                let start = match number {
                    0 => landscape.place_of(&self.problem),
                    number => self.spread(number),
                };
                search(&mut landscape, start)
                    .and_then(|end| self.found_again(end))
                    .and_then(|end| self.among_stable(end, start))
            })
            .collect();
        let failed = ends.iter().filter(|end| end.is_none()).count();
        let mut ends: Vec<End> = ends.into_iter().flatten().collect();
        ends.sort_by(|a, b| a.point.cost.total_cmp(&b.point.cost));
        let mut distinct: Vec<(End, Problem, usize)> = Vec::new();
        for end in ends {
            let problem = normal(self.landscape().problem_at(&end.place));
            let known = distinct.iter_mut().find(|(known, of, _)| {
                (known.point.cost - end.point.cost).abs() < SAME_VALUE && are_same(of, &problem)
            });
            match known {
                Some((.., starts)) => *starts += 1,
                None => distinct.push((end, problem, 1)),
            }
        }
        let confirmed = distinct.into_par_iter().with_max_len(1);
        let mut optima: Vec<Optimum> = confirmed
            .filter_map(|(end, problem, starts)| self.confirm(end, problem, starts))
            .collect();
        optima.sort_by_key(|of| !of.counts());
        Found { optima, failed }
    }

    /// The best of what searches from the present gait end in; what does not vary stays as it is, whatever the
    /// bounds say of it.
    pub fn present(&self) -> Option<Optimum> {
        let bounds = Bounds { angle_rad: f64::INFINITY, rate_rad_s: f64::INFINITY, ..self.bounds };
        Search { bounds, ..self.clone() }.run().optima.into_iter().next()
    }

    /// Where a search ended, if a solution from rest finds the motion there: a search that goes from one motion to
    /// the next may have followed another one, and goes on from the one that is found.
    fn found_again(&self, mut end: End) -> Option<End> {
        const MOST: usize = 4;
        for _ in 0..MOST {
            let mut landscape = self.landscape();
            let found = landscape.evaluate(&end.place)?;
            if (found.cost - end.point.cost).abs() < SAME_VALUE {
                return Some(end);
            }
            end = search(&mut landscape, end.place)?;
        }
        None
    }

    /// The same, or where the motion is unstable there the end of a search from `start` among stable ones, if that
    /// finds one.
    fn among_stable(&self, end: End, start: Place) -> Option<End> {
        let mut landscape = self.landscape();
        landscape.only_stable = true;
        if landscape.evaluate(&end.place).is_some() {
            return Some(end);
        }
        landscape.forget();
        Some(search(&mut landscape, start).and_then(|end| self.found_again(end)).unwrap_or(end))
    }

    fn landscape(&self) -> Landscape<'_> {
        Landscape::new(self.problem.clone(), self.objective, &self.free, &self.bounds)
    }

    /// Where a search begins: places that fill the ranges evenly, however many there are.
    ///
    /// Reference: M. Roberts, *The unreasonable effectiveness of quasirandom sequences* (2018).
    fn spread(&self, number: usize) -> Place {
        let count = self.free.len() as f64;
        // The positive solution of x^(count + 1) = x + 1.
        let ratio = (0..40).fold(2.0_f64, |x, _| (1.0 + x).powf(1.0 / (count + 1.0)));
        let mut place = Place::zeros();
        for (i, command) in self.free.iter().enumerate() {
            let part = (0.5 + number as f64 / ratio.powi(i as i32 + 1)).fract();
            // A phase has a turn to spare on each side.
            place[i] = if command.is_phase() { (1.0 + part) / 3.0 } else { part };
        }
        self.within_limits(place)
    }

    /// The place moved so that angles and rates are within their limits, as far as what varies can do that.
    fn within_limits(&self, mut place: Place) -> Place {
        const MOST: usize = 8;
        let Bounds { angle_rad, rate_rad_s, .. } = self.bounds;
        let landscape = self.landscape();
        for _ in 0..MOST {
            let mut problem = landscape.problem_at(&place);
            let omega = problem.omega_rad_s;
            for command in problem.gait.joints.iter_mut().flatten() {
                let JointCommand { offset_rad, amplitude_rad, .. } = command;
                let largest = (offset_rad.abs() + *amplitude_rad) / angle_rad;
                *amplitude_rad = (*amplitude_rad / largest.max(1.0)).min(rate_rad_s / omega);
                *offset_rad /= largest.max(1.0);
            }
            place = landscape.place_of(&problem);
        }
        place
    }

    /// The motion of an end, as accurate as it is reported; `None` if it is not found again.
    fn confirm(&self, end: End, problem: Problem, starts: usize) -> Option<Optimum> {
        let mut solver = Solver::default();
        let first = solver.solve(&problem, REFERENCE_ACCURACY);
        let motion = solver.steady_motion(first.clone().ok()?).ok()?;
        let attractor = solver.attractor(&problem, first, REFERENCE_ACCURACY);
        let GaitMetrics { d_m, v_m_s, .. } = motion.metrics;
        Some(Optimum {
            value: self.objective.value(d_m, v_m_s, motion.work_j),
            status: motion.status(),
            from_rest: Attractor::from_rest(&attractor),
            at_bound: self.landscape().bounds_met(&end.place, &end.point),
            problem,
            motion,
            starts,
        })
    }
}

/// The same gait with phases within half a turn of zero.
fn normal(mut problem: Problem) -> Problem {
    for command in problem.gait.joints.iter_mut().flatten() {
        command.phase_rad -= TAU * (command.phase_rad / TAU).round();
    }
    problem
}

/// Whether two problems are one, or each other's mirror image.
fn are_same(one: &Problem, other: &Problem) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() < SAME_PLACE * (1.0 + a.abs().max(b.abs()));
    let turns = |a: f64, b: f64| {
        let apart = (a - b).rem_euclid(TAU);
        apart.min(TAU - apart) < SAME_PLACE * PI
    };
    let is_near = |sign: f64| {
        one.gait.joints.iter().zip(&other.gait.joints).all(|joints| match joints {
            (Some(a), Some(b)) => {
                near(a.offset_rad, sign * b.offset_rad)
                    && near(a.amplitude_rad, b.amplitude_rad)
                    && turns(a.phase_rad, b.phase_rad)
            }
            _ => true,
        })
    };
    near(one.omega_rad_s, other.omega_rad_s) && (is_near(1.0) || is_near(-1.0))
}

/// What of the present gait is not within the bounds, in words; empty if all is.
pub fn outside(gait: &Gait, bounds: &Bounds) -> Vec<String> {
    let mut found = Vec::new();
    for (joint, command) in gait.joints.iter().enumerate() {
        let Some(JointCommand { offset_rad, amplitude_rad, .. }) = command else { continue };
        let (largest, [least, most]) =
            (offset_rad.abs() + amplitude_rad.abs(), bounds.amplitude_rad);
        let degrees = |rad: f64| (1e6 * rad.to_degrees()).round() / 1e6;
        if largest > bounds.angle_rad * (1.0 + 1e-9) {
            found.push(format!(
                "joint {} goes to {} degrees, at most {} are allowed",
                joint + 1,
                degrees(largest),
                degrees(bounds.angle_rad)
            ));
        }
        if *amplitude_rad < least * (1.0 - 1e-9) || *amplitude_rad > most * (1.0 + 1e-9) {
            found.push(format!(
                "joint {} has an amplitude of {} degrees, {} to {} are searched",
                joint + 1,
                degrees(*amplitude_rad),
                degrees(least),
                degrees(most)
            ));
        }
    }
    found
}
