//! Steady motions over frequency, and what is read off such curves.

use serde::Deserialize;

use super::paper::Paper;
use crate::metrics::GaitMetrics;
use crate::motion::{Problem, REFERENCE_ACCURACY, Solver};
use crate::robot::Robot;
use crate::stats;

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
    /// A motion of which no more is known than its metrics.
    pub fn of_metrics(omega_rad_s: f64, metrics: GaitMetrics) -> Self {
        Self { omega_rad_s, metrics, floquet: f64::NAN, work_j: f64::NAN }
    }

    /// Solves for a motion; `None` if there is none.
    pub fn solve(solver: &mut Solver, problem: &Problem) -> Option<Self> {
        let metrics = solver.solve(problem, REFERENCE_ACCURACY).ok()?;
        let floquet = solver.floquet().ok()?.unwrap_or(f64::NAN);
        let [work_j, _] = solver.work_and_loss_j().ok()?;
        Some(Self { omega_rad_s: problem.omega_rad_s, metrics, floquet, work_j })
    }

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

/// Solves for a motion of the paper at all frequencies, in their order.
pub fn sweep(paper: &Paper, motion: &str) -> Vec<Point> {
    let mut solver = Solver::default();
    let omegas = (0..COUNT).map(|i| FROM_RAD_S + STEP_RAD_S * i as f64);
    let problems = omegas.filter_map(|omega_rad_s| paper.problem(motion, omega_rad_s));
    problems.filter_map(|problem| Point::solve(&mut solver, &problem)).collect()
}

/// Where a curve is largest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Optimum {
    pub omega_rad_s: f64,
    /// Whether it lies between the ends of the curve.
    pub is_inside: bool,
}

/// The highest local maximum between the ends, else the end that is higher; of a measured curve,
/// which scatters, the highest point. `None` for a curve of less than three points.
pub fn optimum(curve: &[Point], quantity: Quantity, is_measured: bool) -> Option<Optimum> {
    let at = |i: &usize| curve[*i].get(quantity);
    let last = curve.len().checked_sub(1).filter(|&last| last >= 2)?;
    let is_peak = |i: &usize| is_measured || at(i) >= at(&(i - 1)) && at(i) > at(&(i + 1));
    let candidates = if is_measured { 0..last + 1 } else { 1..last };
    let peak = candidates.filter(is_peak).max_by(|i, j| at(i).total_cmp(&at(j)));
    let highest = peak.unwrap_or(if at(&last) > at(&0) { last } else { 0 });
    let is_inside = 0 < highest && highest < last;
    let omega_rad_s = match is_inside && !is_measured {
        true => vertex(curve, quantity, highest),
        false => curve[highest].omega_rad_s,
    };
    Some(Optimum { omega_rad_s, is_inside })
}

/// The vertex of the parabola through a peak and its neighbours.
fn vertex(curve: &[Point], quantity: Quantity, peak: usize) -> f64 {
    let [before, here, after] =
        [peak - 1, peak, peak + 1].map(|i| (curve[i].omega_rad_s, curve[i].get(quantity)));
    let slope = |(x0, y0): (f64, f64), (x1, y1): (f64, f64)| (y1 - y0) / (x1 - x0);
    let (left, right) = (slope(before, here), slope(here, after));
    let second_difference = (right - left) / (after.0 - before.0);
    0.5 * (before.0 + here.0) - left / (2.0 * second_difference)
}

/// The points of two curves at the frequencies at which both have all these quantities.
pub fn common(
    a: &[Point],
    b: &[Point],
    quantities: &[Quantity],
) -> Option<(Vec<Point>, Vec<Point>)> {
    let has = |point: &Point| quantities.iter().all(|quantity| point.get(*quantity).is_finite());
    let pairs = a.iter().filter_map(|point| {
        let other = b.iter().find(|other| other.omega_rad_s == point.omega_rad_s)?;
        (has(point) && has(other)).then_some((*point, *other))
    });
    let (a, b): (Vec<Point>, Vec<Point>) = pairs.unzip();
    (!a.is_empty()).then_some((a, b))
}

/// Difference of the largest and the least value over the mean, in per cent; `None` for a curve
/// of less than three points.
pub fn spread_percent(curve: &[Point], quantity: Quantity) -> Option<f64> {
    let values = || curve.iter().map(|point| point.get(quantity));
    let (low, high) =
        (values().fold(f64::INFINITY, f64::min), values().fold(-f64::INFINITY, f64::max));
    (curve.len() >= 3).then(|| 100.0 * (high - low) / mean(curve, quantity))
}

fn mean(curve: &[Point], quantity: Quantity) -> f64 {
    stats::mean(curve.iter().map(|point| point.get(quantity)))
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

/// Mean difference of two curves of the same frequencies from 4 rad/s on over that up to 2 rad/s.
pub fn effect_high_over_low(curve: &[Point], over: &[Point], quantity: Quantity) -> f64 {
    let effect = |is_in: fn(f64) -> bool| {
        let pairs = curve.iter().zip(over).filter(|(point, _)| is_in(point.omega_rad_s));
        stats::mean(pairs.map(|(a, b)| (a.get(quantity) - b.get(quantity)).abs()))
    };
    effect(|omega| omega >= 4.0) / effect(|omega| omega <= 2.0)
}
