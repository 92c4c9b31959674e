//! Quantities as functions of frequency, and characteristics of these curves: optima, spreads, ratios.

use minijinja::Error;
use minijinja::value::{Object, Value};
use trilink_mechanics::{Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::Robot;
use trilink_robot::metrics::{GaitMetrics, Metric};

use super::missing::{NO_TRIALS, missing, unknown};
use super::verdict::Found;

/// Steady-state motion at a given frequency.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub omega_rad_s: f64,
    pub metrics: GaitMetrics,
    /// Modulus of the largest Floquet multiplier; NaN if there is none or it is unknown.
    pub floquet: f64,
    /// Work of the actuators per cycle; NaN if unknown.
    pub work_j: f64,
}

impl Point {
    /// Creates a point for a motion of which only the metrics are known.
    pub(super) fn from_metrics(omega_rad_s: f64, metrics: GaitMetrics) -> Self {
        Self { omega_rad_s, metrics, floquet: f64::NAN, work_j: f64::NAN }
    }

    /// Solves for the steady-state motion; returns `None` if there is none.
    pub(super) fn solve(solver: &mut Solver, problem: &Problem) -> Option<Self> {
        let metrics = solver.solve(problem, REFERENCE_ACCURACY).ok()?;
        let floquet = solver.floquet().ok()?.unwrap_or(f64::NAN);
        let [work_j, _] = solver.work_and_loss_j().ok()?;
        Some(Self { omega_rad_s: problem.omega_rad_s, metrics, floquet, work_j })
    }

    /// Returns the value of a quantity of the motion; `quantity` is its name in the formulas of claims.
    ///
    /// # Errors
    /// Returns an error if there is no quantity with this name.
    pub(super) fn get(&self, quantity: &str) -> Result<f64, Error> {
        let Self { omega_rad_s, metrics, .. } = self;
        if let Some(metric) =
            Metric::ALL.into_iter().find(|of| of.definition().shown_column == quantity)
        {
            return Ok(metric.shown(metrics));
        }
        Ok(match quantity {
            "v_over_omega_mm" => 1e3 * metrics.v_m_s / omega_rad_s,
            "sigma_sum" => metrics.sigma[..Robot::LINKS].iter().sum(),
            // Largest RMS skid speed of any wheel, divided by the mean forward speed; the skid ratios (eq. 20) are
            // converted with the link length l that both tables of the paper give.
            "skid_percent" => {
                let largest_sigma = metrics.sigma.into_iter().fold(f64::NAN, f64::max);
                100.0 * largest_sigma * Robot::kinematic().skid_length_m() * omega_rad_s
                    / metrics.v_m_s
            }
            // Absolute net rotation per cycle.
            "turned_deg" => metrics.dtheta_rad.abs().to_degrees(),
            "floquet" => self.floquet,
            // Work of the actuators per metre of displacement.
            "work_j_m" => self.work_j / metrics.d_m,
            _ => return Err(unknown(quantity)),
        })
    }
}

/// Quantity as a function of frequency.
#[derive(Debug)]
pub(super) struct Curve {
    /// Pairs of frequency (rad/s) and value, sorted by frequency; unknown values are NaN.
    pub points: Vec<(f64, f64)>,
    /// Whether the values are measured and therefore scatter.
    pub is_measured: bool,
}

impl Object for Curve {}

impl Curve {
    /// Creates the curve of a quantity from motions, which must be sorted by frequency.
    pub(super) fn from_points(
        points: &[Point],
        quantity: &str,
        is_measured: bool,
    ) -> Result<Value, Error> {
        let points = points
            .iter()
            .map(|point| Ok((point.omega_rad_s, point.get(quantity)?)))
            .collect::<Result<_, Error>>()?;
        Ok(Value::from_object(Self { points, is_measured }))
    }

    fn values(&self) -> impl Iterator<Item = f64> {
        self.points.iter().map(|(_, value)| *value)
    }

    /// Returns the frequency (rad/s) of the curve's maximum, and whether this frequency lies inside the frequency
    /// range.
    ///
    /// For a computed curve, the maximum is the highest local maximum inside the range or, if there is none, the higher
    /// end of the curve. For a measured curve, which scatters, it is the highest point.
    ///
    /// # Errors
    /// Returns an error if there are fewer than three points.
    pub(super) fn highest(&self) -> Result<(f64, bool), Error> {
        let at = |i: &usize| self.points[*i].1;
        let last = self.points.len().checked_sub(1).filter(|&last| last >= 2);
        let last = last.ok_or_else(|| missing(NO_TRIALS))?;
        let candidates = if self.is_measured { 0..last + 1 } else { 1..last };
        let peak = candidates
            .filter(|i| self.is_measured || at(i) >= at(&(i - 1)) && at(i) > at(&(i + 1)))
            .max_by(|i, j| at(i).total_cmp(&at(j)));
        let highest = peak.unwrap_or(if at(&last) > at(&0) { last } else { 0 });
        let is_inside = 0 < highest && highest < last;
        let omega_rad_s = if is_inside && !self.is_measured {
            self.vertex(highest)
        } else {
            self.points[highest].0
        };
        Ok((omega_rad_s, is_inside))
    }

    /// Returns the frequency at the vertex of the parabola through the point with index `peak` and its two neighbours.
    fn vertex(&self, peak: usize) -> f64 {
        let [before, here, after] = [peak - 1, peak, peak + 1].map(|i| self.points[i]);
        let slope = |(x0, y0): (f64, f64), (x1, y1): (f64, f64)| (y1 - y0) / (x1 - x0);
        let left = slope(before, here);
        let right = slope(here, after);
        let second_difference = (right - left) / (after.0 - before.0);
        0.5 * (before.0 + here.0) - left / (2.0 * second_difference)
    }

    /// Returns the frequency (rad/s) at which the curve has its maximum.
    pub(super) fn optimum(&self) -> Result<Value, Error> {
        let (omega_rad_s, is_inside) = self.highest()?;
        let at_end = "The curve has no maximum inside the sweep; the value given is the end of the sweep at which the \
                      curve is highest.";
        let note = if is_inside { "" } else { at_end };
        Ok(Value::from_object(Found::with_note(omega_rad_s, note)))
    }

    /// Returns the absolute difference (rad/s) between the frequencies at which two curves have their maxima; NaN if
    /// either maximum is at an end of the frequency range.
    pub(super) fn optima_apart(&self, other: &Self) -> Result<Value, Error> {
        let ((a, a_is_inside), (b, b_is_inside)) = (self.highest()?, other.highest()?);
        let note = "One of the two curves has no maximum inside the sweep.";
        Ok(Value::from_object(if a_is_inside && b_is_inside {
            Found::new((a - b).abs())
        } else {
            Found::with_note(f64::NAN, note)
        }))
    }

    /// Returns the difference between the maximum and the minimum of the curve, in per cent of its mean; returns an
    /// error if there are fewer than three points.
    pub(super) fn spread_percent(&self) -> Result<f64, Error> {
        let [low, high] = trilink_statistics::extremes(self.values());
        match self.points.len() {
            0..3 => Err(missing(NO_TRIALS)),
            _ => Ok(100.0 * (high - low) / trilink_statistics::mean(self.values())),
        }
    }

    /// Returns the largest value of the curve.
    pub(super) fn largest(&self) -> f64 {
        self.values().fold(f64::NAN, f64::max)
    }

    /// Returns the frequencies (rad/s) at which both this curve and `over` have a value, each with the two values;
    /// returns an error if there are none.
    fn common(&self, over: &Self) -> Result<Vec<(f64, f64, f64)>, Error> {
        let pairs = self.points.iter().filter_map(|(omega_rad_s, value)| {
            let (_, other) = over.points.iter().find(|(other, _)| other == omega_rad_s)?;
            (value + other).is_finite().then_some((*omega_rad_s, *value, *other))
        });
        let pairs: Vec<_> = pairs.collect();
        if pairs.is_empty() { Err(missing(NO_TRIALS)) } else { Ok(pairs) }
    }

    /// Returns the mean of this curve divided by the mean of `over`, at the frequencies common to both.
    pub(super) fn mean_ratio(&self, over: &Self) -> Result<f64, Error> {
        let pairs = self.common(over)?;
        let mean =
            |value: fn(&(f64, f64, f64)) -> f64| trilink_statistics::mean(pairs.iter().map(value));
        Ok(mean(|pair| pair.1) / mean(|pair| pair.2))
    }

    /// Returns the minimum ratio of this curve to `over`, at the frequencies common to both.
    pub(super) fn least_ratio(&self, over: &Self) -> Result<f64, Error> {
        Ok(self.common(over)?.iter().map(|(_, a, b)| a / b).fold(f64::INFINITY, f64::min))
    }

    /// Returns the mean absolute difference between two curves at frequencies of at least 4 rad/s, divided by their
    /// mean absolute difference at frequencies of at most 2 rad/s.
    pub(super) fn effect_high_over_low(&self, over: &Self) -> Result<f64, Error> {
        let pairs = self.common(over)?;
        let effect = |is_in: fn(f64) -> bool| {
            let pairs = pairs.iter().filter(|(omega, ..)| is_in(*omega));
            trilink_statistics::mean(pairs.map(|(_, a, b)| (a - b).abs()))
        };
        Ok(effect(|omega| omega >= 4.0) / effect(|omega| omega <= 2.0))
    }
}
