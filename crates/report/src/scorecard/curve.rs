//! Quantities over frequency, and what is read off them.

use minijinja::Error;
use minijinja::value::{Object, Value};
use trilink_mechanics::{Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::Robot;
use trilink_robot::metrics::{GaitMetrics, Metric};

use super::missing::{NO_TRIALS, missing, unknown};
use super::verdict::Found;

/// One steady motion.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub omega_rad_s: f64,
    pub metrics: GaitMetrics,
    /// NaN where the motion has none, or they are not known.
    pub floquet: f64,
    pub work_j: f64,
}

impl Point {
    /// A motion of which no more is known than its metrics.
    pub(super) fn of_metrics(omega_rad_s: f64, metrics: GaitMetrics) -> Self {
        Self { omega_rad_s, metrics, floquet: f64::NAN, work_j: f64::NAN }
    }

    /// Solves for a motion; `None` if there is none.
    pub(super) fn solve(solver: &mut Solver, problem: &Problem) -> Option<Self> {
        let metrics = solver.solve(problem, REFERENCE_ACCURACY).ok()?;
        let floquet = solver.floquet().ok()?.unwrap_or(f64::NAN);
        let [work_j, _] = solver.work_and_loss_j().ok()?;
        Some(Self { omega_rad_s: problem.omega_rad_s, metrics, floquet, work_j })
    }

    /// What a claim is about.
    ///
    /// # Errors
    /// There is no quantity of this name.
    pub(super) fn get(&self, quantity: &str) -> Result<f64, Error> {
        let Self { omega_rad_s, metrics, .. } = self;
        let is_of = |of: &Metric| of.definition().shown_column == quantity;
        if let Some(metric) = Metric::ALL.into_iter().find(is_of) {
            return Ok(metric.shown(metrics));
        }
        let largest_sigma = || metrics.sigma.into_iter().fold(f64::NAN, f64::max);
        Ok(match quantity {
            "v_over_omega_mm" => 1e3 * metrics.v_m_s / omega_rad_s,
            "sigma_sum" => metrics.sigma.iter().sum(),
            // RMS skid speed of the wheel that skids most over the mean forward speed: eq. 20
            // undone; l is that of both tables.
            "skid_percent" => {
                100.0 * largest_sigma() * Robot::kinematic().l_m * omega_rad_s / metrics.v_m_s
            }
            // Net rotation a cycle, without its sign.
            "turned_deg" => metrics.dtheta_rad.abs().to_degrees(),
            // Largest Floquet multiplier.
            "floquet" => self.floquet,
            // Work of the actuators a metre.
            "work_j_m" => self.work_j / metrics.d_m,
            _ => return Err(unknown(quantity)),
        })
    }
}

/// A quantity over frequency.
#[derive(Debug)]
pub(super) struct Curve {
    /// Frequencies, rad/s, in their order, and values; NaN where it is not known.
    pub points: Vec<(f64, f64)>,
    /// By trials, so that it scatters.
    pub is_measured: bool,
}

impl Object for Curve {}

impl Curve {
    /// A quantity of motions that are in the order of their frequencies.
    pub(super) fn of(points: &[Point], quantity: &str, is_measured: bool) -> Result<Value, Error> {
        let of = |point: &Point| Ok((point.omega_rad_s, point.get(quantity)?));
        let points = points.iter().map(of).collect::<Result<_, Error>>()?;
        Ok(Value::from_object(Self { points, is_measured }))
    }

    fn values(&self) -> impl Iterator<Item = f64> {
        self.points.iter().map(|(_, value)| *value)
    }

    /// Frequency of the highest local maximum between the ends, else of the end that is higher; of
    /// a measured curve, which scatters, of the highest point. And whether it lies between the ends.
    ///
    /// # Errors
    /// There are less than three points.
    pub(super) fn highest(&self) -> Result<(f64, bool), Error> {
        let at = |i: &usize| self.points[*i].1;
        let last = self.points.len().checked_sub(1).filter(|&last| last >= 2);
        let last = last.ok_or_else(|| missing(NO_TRIALS))?;
        let is_peak = |i: &usize| self.is_measured || at(i) >= at(&(i - 1)) && at(i) > at(&(i + 1));
        let candidates = if self.is_measured { 0..last + 1 } else { 1..last };
        let peak = candidates.filter(is_peak).max_by(|i, j| at(i).total_cmp(&at(j)));
        let highest = peak.unwrap_or(if at(&last) > at(&0) { last } else { 0 });
        let is_inside = 0 < highest && highest < last;
        let omega_rad_s = match is_inside && !self.is_measured {
            true => self.vertex(highest),
            false => self.points[highest].0,
        };
        Ok((omega_rad_s, is_inside))
    }

    /// The vertex of the parabola through a peak and its neighbours.
    fn vertex(&self, peak: usize) -> f64 {
        let [before, here, after] = [peak - 1, peak, peak + 1].map(|i| self.points[i]);
        let slope = |(x0, y0): (f64, f64), (x1, y1): (f64, f64)| (y1 - y0) / (x1 - x0);
        let (left, right) = (slope(before, here), slope(here, after));
        let second_difference = (right - left) / (after.0 - before.0);
        0.5 * (before.0 + here.0) - left / (2.0 * second_difference)
    }

    /// Frequency at which a curve is largest, rad/s.
    pub(super) fn optimum(&self) -> Result<Value, Error> {
        let (omega_rad_s, is_inside) = self.highest()?;
        let at_end = "No maximum between the ends: largest at this one.";
        let note = if is_inside { "" } else { at_end };
        Ok(Value::from_object(Found::with_note(omega_rad_s, note)))
    }

    /// Distance of two such frequencies.
    pub(super) fn optima_apart(&self, other: &Self) -> Result<Value, Error> {
        let ((a, a_is_inside), (b, b_is_inside)) = (self.highest()?, other.highest()?);
        let note = "One of them has no maximum between the ends of the sweep.";
        Ok(Value::from_object(match a_is_inside && b_is_inside {
            true => Found::new((a - b).abs()),
            false => Found::with_note(f64::NAN, note),
        }))
    }

    /// Difference of the largest and the least value over the mean, in per cent; of three points at
    /// least.
    pub(super) fn spread_percent(&self) -> Result<f64, Error> {
        let [low, high] = trilink_statistics::extremes(self.values());
        match self.points.len() {
            0..3 => Err(missing(NO_TRIALS)),
            _ => Ok(100.0 * (high - low) / trilink_statistics::mean(self.values())),
        }
    }

    /// Its largest value.
    pub(super) fn largest(&self) -> f64 {
        self.values().fold(f64::NAN, f64::max)
    }

    /// Frequencies and values of two curves where both have one.
    fn common(&self, over: &Self) -> Result<Vec<(f64, f64, f64)>, Error> {
        let pairs = self.points.iter().filter_map(|(omega_rad_s, value)| {
            let (_, other) = over.points.iter().find(|(other, _)| other == omega_rad_s)?;
            (value + other).is_finite().then_some((*omega_rad_s, *value, *other))
        });
        let pairs: Vec<_> = pairs.collect();
        if pairs.is_empty() { Err(missing(NO_TRIALS)) } else { Ok(pairs) }
    }

    /// Ratio of the means over the frequencies of both.
    pub(super) fn mean_ratio(&self, over: &Self) -> Result<f64, Error> {
        let pairs = self.common(over)?;
        let mean =
            |value: fn(&(f64, f64, f64)) -> f64| trilink_statistics::mean(pairs.iter().map(value));
        Ok(mean(|pair| pair.1) / mean(|pair| pair.2))
    }

    /// Least ratio over the frequencies of both.
    pub(super) fn least_ratio(&self, over: &Self) -> Result<f64, Error> {
        Ok(self.common(over)?.iter().map(|(_, a, b)| a / b).fold(f64::INFINITY, f64::min))
    }

    /// Mean difference of two curves from 4 rad/s on over that up to 2 rad/s.
    pub(super) fn effect_high_over_low(&self, over: &Self) -> Result<f64, Error> {
        let pairs = self.common(over)?;
        let effect = |is_in: fn(f64) -> bool| {
            let pairs = pairs.iter().filter(|(omega, ..)| is_in(*omega));
            trilink_statistics::mean(pairs.map(|(_, a, b)| (a - b).abs()))
        };
        Ok(effect(|omega| omega >= 4.0) / effect(|omega| omega <= 2.0))
    }
}
