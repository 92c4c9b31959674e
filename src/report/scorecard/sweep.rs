//! Steady motions over the paper's frequencies, and what is read off such curves.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;
use serde::Deserialize;

use super::paper::Paper;
use crate::metrics::GaitMetrics;
use crate::motion::{REFERENCE_ACCURACY, Solver};
use crate::robot::Robot;

/// First and last frequency and the step between, rad/s: the paper's range in half of the steps
/// of its trials.
const FROM_RAD_S: f64 = 0.5;
const STEP_RAD_S: f64 = 0.25;
const COUNT: usize = 23;

/// What a claim is about, by unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    DMm,
    VMmS,
    /// Speed over frequency, mm.
    VOverOmegaMm,
    Sigma0,
    Sigma1,
    Sigma2,
    /// RMS skid speed of the wheel that skids most over the mean forward speed, per cent.
    SkidPercent,
    Alpha1Deg,
    /// Net rotation a cycle, without its sign.
    TurnedDeg,
    /// Largest Floquet multiplier.
    Floquet,
    /// Work of the actuators a metre.
    WorkJM,
}

/// One steady motion.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    pub omega_rad_s: f64,
    pub metrics: GaitMetrics,
    /// NaN where the motion has none, or they are not known.
    pub floquet: f64,
    pub work_j: f64,
}

impl Point {
    pub fn get(&self, quantity: Quantity) -> f64 {
        let metrics = &self.metrics;
        match quantity {
            Quantity::DMm => 1e3 * metrics.d_m,
            Quantity::VMmS => 1e3 * metrics.v_m_s,
            Quantity::VOverOmegaMm => 1e3 * metrics.v_m_s / self.omega_rad_s,
            Quantity::Sigma0 => metrics.sigma[0],
            Quantity::Sigma1 => metrics.sigma[1],
            Quantity::Sigma2 => metrics.sigma[2],
            Quantity::SkidPercent => {
                let most = metrics.sigma.into_iter().fold(f64::NAN, f64::max);
                // Undoes eq. 20; l is that of both tables.
                100.0 * most * Robot::kinematic().l_m * self.omega_rad_s / metrics.v_m_s
            }
            Quantity::Alpha1Deg => metrics.alpha1_rad.to_degrees(),
            Quantity::TurnedDeg => metrics.dtheta_rad.abs().to_degrees(),
            Quantity::Floquet => self.floquet,
            Quantity::WorkJM => self.work_j / metrics.d_m,
        }
    }
}

/// Solves for a motion of the paper; `None` if there is none.
pub fn solve(
    paper: &Paper<'_>,
    solver: &mut Solver,
    motion: &str,
    omega_rad_s: f64,
) -> Option<Point> {
    let problem = paper.problem(motion, omega_rad_s)?;
    let metrics = solver.solve(&problem, REFERENCE_ACCURACY).ok()?;
    let floquet = solver.floquet().ok()?.unwrap_or(f64::NAN);
    let [work_j, _] = solver.work_and_loss_j().ok()?;
    Some(Point { omega_rad_s, metrics, floquet, work_j })
}

/// Points of a curve, in the order of frequency.
pub type Curve = Vec<Point>;

/// Curves of motions by name.
pub type Curves = BTreeMap<String, Curve>;

/// Solves for all motions of `names` at all frequencies.
pub fn curves(paper: &Paper<'_>, names: &BTreeSet<&str>) -> Curves {
    let names: Vec<&str> = names.iter().copied().collect();
    let curve = |name: &&str| {
        let mut solver = Solver::default();
        let omegas = (0..COUNT).map(|i| FROM_RAD_S + STEP_RAD_S * i as f64);
        let points = omegas.filter_map(|omega| solve(paper, &mut solver, name, omega)).collect();
        ((*name).to_owned(), points)
    };
    names.par_iter().map(curve).collect()
}

/// Where a curve is largest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Optimum {
    pub omega_rad_s: f64,
    /// Whether it lies between the ends of the curve.
    pub is_inside: bool,
}

/// The highest local maximum between the ends, else the end that is higher; `None` for a curve
/// of less than three points.
pub fn optimum(curve: &[Point], quantity: Quantity) -> Option<Optimum> {
    let at = |i: usize| curve[i].get(quantity);
    let last = curve.len().checked_sub(1).filter(|&last| last >= 2)?;
    let is_peak = |i: &usize| at(*i) >= at(i - 1) && at(*i) > at(i + 1);
    match (1..last).filter(is_peak).max_by(|&i, &j| at(i).total_cmp(&at(j))) {
        Some(peak) => Some(Optimum { omega_rad_s: vertex(curve, quantity, peak), is_inside: true }),
        None => {
            let end = if at(last) > at(0) { last } else { 0 };
            Some(Optimum { omega_rad_s: curve[end].omega_rad_s, is_inside: false })
        }
    }
}

/// The vertex of the parabola through a peak and its neighbours.
fn vertex(curve: &[Point], quantity: Quantity, peak: usize) -> f64 {
    let [before, here, after] =
        [peak - 1, peak, peak + 1].map(|i| (curve[i].omega_rad_s, curve[i].get(quantity)));
    let slope = |(x0, y0): (f64, f64), (x1, y1): (f64, f64)| (y1 - y0) / (x1 - x0);
    let (left, right) = (slope(before, here), slope(here, after));
    let bend = (right - left) / (after.0 - before.0);
    0.5 * (before.0 + here.0) - left / (2.0 * bend)
}

/// Difference of the largest and the least value over the mean, in per cent.
pub fn spread_percent(curve: &[Point], quantity: Quantity) -> f64 {
    let values = || curve.iter().map(|point| point.get(quantity));
    let (low, high) = values()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    100.0 * (high - low) / mean(curve, quantity)
}

pub fn mean(curve: &[Point], quantity: Quantity) -> f64 {
    curve.iter().map(|point| point.get(quantity)).sum::<f64>() / curve.len() as f64
}

/// Ratio of the sums of the means of some quantities.
pub fn ratio_of_means(curve: &[Point], over: &[Point], quantities: &[Quantity]) -> f64 {
    let sum = |curve: &[Point]| quantities.iter().map(|q| mean(curve, *q)).sum::<f64>();
    sum(curve) / sum(over)
}

/// Least ratio of two curves of the same frequencies.
pub fn least_ratio(curve: &[Point], over: &[Point], quantity: Quantity) -> f64 {
    let ratios = curve.iter().zip(over).map(|(a, b)| a.get(quantity) / b.get(quantity));
    ratios.fold(f64::INFINITY, f64::min)
}

/// Largest value; NaN for an empty curve.
pub fn largest(curve: &[Point], quantity: Quantity) -> f64 {
    curve.iter().map(|point| point.get(quantity)).fold(f64::NAN, f64::max)
}

/// Mean difference of two curves from 4 rad/s on over that up to 2 rad/s.
pub fn effect_high_over_low(curve: &[Point], over: &[Point], quantity: Quantity) -> f64 {
    let effect = |is_in: &dyn Fn(f64) -> bool| {
        let pairs = curve.iter().zip(over).filter(|(point, _)| is_in(point.omega_rad_s));
        let differences: Vec<f64> =
            pairs.map(|(a, b)| (a.get(quantity) - b.get(quantity)).abs()).collect();
        differences.iter().sum::<f64>() / differences.len() as f64
    };
    effect(&|omega| omega >= 4.0) / effect(&|omega| omega <= 2.0)
}
