//! Maps of the objective around an optimum, plotted against the commands with the largest influence.

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_mechanics::Problem;
use trilink_robot::Model;
use trilink_tables::{MapPoint, OptimumMapRow};

use super::commands::CommandUnit;
use super::landscape::{ACCURACY, Landscape, Position};
use super::{Bounds, Command, Optimum, Search, whole_turns};
use crate::MeasuredRange;

/// Number of grid values for each command.
const SIZE: usize = 49;
/// Perturbation of a command, as a fraction of its range, for ranking the commands by sensitivity.
const PERTURBATION: f64 = 0.05;

/// Gaits that a map shows in addition to the objective.
#[derive(Debug, Clone, Copy, Default)]
pub struct MapOverlay<'s> {
    /// Current gait of the campaign.
    pub present: Option<&'s Optimum>,
    /// Values of the free commands, rad/s or rad, at the best optimum for each replicate of the fit.
    pub replicates: &'s [Vec<f64>],
    /// Range covered by the trials to which the coefficients were fitted.
    pub range: Option<&'s MeasuredRange>,
}

impl Search {
    /// Computes a map of the objective around an optimum of this search. Its axes are the one or two free commands for
    /// which a change by a small fraction of the range increases the cost most.
    ///
    /// # Errors
    /// Returns an error if the computation is cancelled.
    pub fn map(
        &self,
        (campaign, model): (&str, Model),
        best: &Optimum,
        overlay: MapOverlay,
        cancel: &CancelToken,
    ) -> Result<Vec<OptimumMapRow>, Cancelled> {
        let mut landscape = self.landscape(ACCURACY);
        let centre = landscape.position_of(&best.problem);
        let cost = stable_cost(&mut landscape, &centre);
        let axes = self.most_sensitive_axes(&centre, cost);
        let Some((first, second)) = axes.split_first() else { return Ok(Vec::new()) };
        let second = second.first();
        let name = |axis: Option<&Axis>| {
            axis.map_or(String::new(), |of| of.command.name(&self.problem.robot))
        };
        let [x_command, y_command] = [Some(first), second].map(name);
        let row = |point: MapPoint, [x, y]: [f64; 2], value: f64, of: &Problem| OptimumMapRow {
            campaign: campaign.to_owned(),
            model,
            objective: self.objective,
            point,
            x_command: x_command.clone(),
            y_command: y_command.clone(),
            x,
            y,
            value,
            extrapolated: overlay.range.map(|range| range.is_exceeded(of)),
        };
        let sign = if self.objective.is_minimised() { 1.0 } else { -1.0 };
        let second_values: Vec<Option<f64>> =
            second.map_or(vec![None], |axis| axis.fractions.iter().copied().map(Some).collect());
        let grid = second_values.into_par_iter().with_max_len(1).map(|second_value| {
            cancel.check()?;
            let mut landscape = self.landscape(ACCURACY);
            let mut position = centre.clone();
            let mut y = f64::NAN;
            if let (Some(fraction), Some(axis)) = (second_value, second) {
                position[axis.index] = fraction;
                y = axis.value_at(fraction, &self.bounds);
            }
            let rows = first.fractions.iter().map(|fraction| {
                position[first.index] = *fraction;
                let increase = stable_cost(&mut landscape, &position) - cost;
                let value = best.value * (sign * increase).exp();
                let problem = landscape.problem_at(&position);
                let x = first.value_at(*fraction, &self.bounds);
                row(MapPoint::Grid, [x, y], value, &problem)
            });
            Ok(rows.collect())
        });
        let mut rows = grid.collect::<Result<Vec<Vec<_>>, Cancelled>>()?.concat();
        let coordinates = |problem: &Problem| {
            let coordinate = |axis: &Axis| axis.coordinate(problem, &best.problem);
            [coordinate(first), second.map_or(f64::NAN, coordinate)]
        };
        for values in overlay.replicates {
            let mut problem = best.problem.clone();
            let commands = self.free.iter().zip(values);
            commands.for_each(|(command, value)| command.set(&mut problem, *value));
            rows.push(row(MapPoint::Replicate, coordinates(&problem), f64::NAN, &problem));
        }
        rows.extend(overlay.present.map(|present| {
            let Optimum { value, problem, .. } = present;
            row(MapPoint::Present, coordinates(problem), *value, problem)
        }));
        let optimum = coordinates(&best.problem);
        rows.push(row(MapPoint::Optimum, optimum, best.value, &best.problem));
        Ok(rows)
    }

    /// Returns axes for at most two commands: those for which a small change increases the cost most.
    fn most_sensitive_axes(&self, centre: &Position, cost: f64) -> Vec<Axis> {
        let mut increases: Vec<(usize, f64)> = (0..self.free.len())
            .map(|i| {
                let increases = [PERTURBATION, -PERTURBATION].map(|by| {
                    let mut position = centre.clone();
                    position[i] = (position[i] + by).clamp(0.0, 1.0);
                    stable_cost(&mut self.landscape(ACCURACY), &position) - cost
                });
                (i, increases.into_iter().fold(0.0, f64::max))
            })
            .collect();
        increases.sort_by(|a, b| b.1.total_cmp(&a.1));
        increases.truncate(2);
        increases.sort_by_key(|(i, _)| *i);
        let axes = increases.iter().map(|(i, _)| Axis {
            index: *i,
            command: self.free[*i],
            fractions: self.grid_fractions(*i, centre[*i]),
        });
        axes.collect()
    }

    /// Returns the grid values for a command as fractions of its range. The grid includes the optimum and covers the
    /// whole range, or one full turn for a phase.
    fn grid_fractions(&self, i: usize, optimum: f64) -> Vec<f64> {
        let command = self.free[i];
        let [low, high] = command.range(&self.bounds);
        let half = PI / (high - low);
        let (from, to) =
            if command.is_phase() { (optimum - half, optimum + half) } else { (0.0, 1.0) };
        let mut fractions: Vec<f64> =
            (0..SIZE).map(|index| from + (to - from) * index as f64 / (SIZE - 1) as f64).collect();
        let nearest = ((optimum - from) / (to - from) * (SIZE - 1) as f64).round() as usize;
        if let Some(nearest) = fractions.get_mut(nearest) {
            *nearest = optimum;
        }
        fractions
    }
}

/// Axis of a map.
struct Axis {
    /// Index of the command among the free commands.
    index: usize,
    command: Command,
    /// Grid values as fractions of the command's range.
    fractions: Vec<f64>,
}

impl Axis {
    /// Returns the value of the command at a fraction of its range, in rad/s for the frequency, degrees for angles and
    /// N m for torques.
    fn value_at(&self, fraction: f64, bounds: &Bounds) -> f64 {
        let [low, high] = self.command.range(bounds);
        in_map_unit(self.command, low + fraction * (high - low))
    }

    /// Returns the value of the command in a problem, in rad/s for the frequency and in degrees for angles. A phase is
    /// shifted by whole turns to be as near as possible to its value at the optimum.
    fn coordinate(&self, problem: &Problem, optimum: &Problem) -> f64 {
        let value = self.command.value(problem);
        let turns_rad = if self.command.is_phase() {
            whole_turns(value - self.command.value(optimum))
        } else {
            0.0
        };
        in_map_unit(self.command, value - turns_rad)
    }
}

/// Converts a command to the unit of a map: rad/s for the frequency, degrees for angles (from rad), N m for torques.
fn in_map_unit(command: Command, value: f64) -> f64 {
    if command.unit() == CommandUnit::Rad { value * 360.0 / TAU } else { value }
}

/// Returns the cost at a position; NaN if there is no stable periodic solution within the limits.
fn stable_cost(landscape: &mut Landscape, position: &Position) -> f64 {
    const MAX_EXCESS: f64 = 1e-6;
    let point = landscape.evaluate(position);
    let within = point.filter(|point| point.excess.iter().all(|excess| *excess < MAX_EXCESS));
    within.filter(|_| landscape.is_stable()).map_or(f64::NAN, |point| point.cost)
}
