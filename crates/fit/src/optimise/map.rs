//! The objective about an optimum, over the commands that it answers to most.

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_mechanics::Problem;
use trilink_robot::Model;
use trilink_tables::{MapPoint, OptimumMapRow};

use super::landscape::{ACCURACY, Landscape, Place};
use super::{Command, Optimum, Search, whole_turns};
use crate::MeasuredRange;

/// Values of each command.
const SIZE: usize = 49;
/// Part of its range by which a command is moved to see what that changes.
const MOVED: f64 = 0.05;

/// What a map shows beside the objective: gaits, as they are on its axes.
#[derive(Debug, Clone, Copy, Default)]
pub struct Shown<'s> {
    /// The campaign's own gait.
    pub present: Option<&'s Optimum>,
    /// What varies, in the optimum of each replicate of the fit.
    pub replicates: &'s [Vec<f64>],
    /// What the trials cover that the coefficients were fitted to.
    pub range: Option<&'s MeasuredRange>,
}

impl Search {
    /// The objective about an optimum of this search, over the one or two commands that it answers to most: those of
    /// which a small part of their ranges costs most.
    ///
    /// # Errors
    /// The work was cancelled.
    pub fn map(
        &self,
        (campaign, model): (&str, Model),
        best: &Optimum,
        shown: Shown,
        cancel: &CancelToken,
    ) -> Result<Vec<OptimumMapRow>, Cancelled> {
        let mut landscape = self.landscape(ACCURACY);
        let middle = landscape.place_of(&best.problem);
        let cost = counted(&mut landscape, &middle);
        let loss = |i: usize| {
            let moved = [MOVED, -MOVED].map(|by| {
                let mut place = middle;
                place[i] = (place[i] + by).clamp(0.0, 1.0);
                counted(&mut self.landscape(ACCURACY), &place) - cost
            });
            moved.into_iter().fold(0.0, f64::max)
        };
        let mut telling: Vec<(usize, f64)> = (0..self.free.len()).map(|i| (i, loss(i))).collect();
        telling.sort_by(|a, b| b.1.total_cmp(&a.1));
        telling.truncate(2);
        telling.sort_by_key(|(i, _)| *i);
        let axes: Vec<Axis> = telling
            .iter()
            .map(|(i, _)| Axis {
                nth: *i,
                command: self.free[*i],
                parts: self.parts(*i, middle[*i]),
            })
            .collect();
        let Some((first, second)) = axes.split_first() else { return Ok(Vec::new()) };
        let second = second.first();
        let name = |axis: Option<&Axis>| axis.map_or(String::new(), |of| of.command.to_string());
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
            extrapolated: shown.range.map(|range| range.is_exceeded(of)),
        };
        let at = |axis: &Axis, part: f64| {
            let [low, high] = axis.command.range(&self.bounds);
            in_unit(axis.command, low + part * (high - low))
        };
        let sign = if self.objective.is_minimised() { 1.0 } else { -1.0 };
        let along_first = |part: Option<f64>| {
            cancel.check()?;
            let mut landscape = self.landscape(ACCURACY);
            let (mut place, mut y) = (middle, f64::NAN);
            if let (Some(part), Some(axis)) = (part, second) {
                (place[axis.nth], y) = (part, at(axis, part));
            }
            let point = |part: &f64| {
                place[first.nth] = *part;
                let worse = counted(&mut landscape, &place) - cost;
                let value = best.value * (sign * worse).exp();
                let problem = landscape.problem_at(&place);
                row(MapPoint::Grid, [at(first, *part), y], value, &problem)
            };
            Ok(first.parts.iter().map(point).collect())
        };
        let seconds: Vec<Option<f64>> =
            second.map_or(vec![None], |axis| axis.parts.iter().copied().map(Some).collect());
        let grid = seconds.into_par_iter().with_max_len(1).map(along_first);
        let mut rows = grid.collect::<Result<Vec<Vec<_>>, Cancelled>>()?.concat();
        // A phase a turn away is as near as it can be to the optimum's.
        let place = |value: &dyn Fn(Command) -> f64| {
            let of_axis = |axis: &Axis| {
                let value = value(axis.command);
                let turns_rad = match axis.command.is_phase() {
                    true => whole_turns(value - axis.command.value(&best.problem)),
                    false => 0.0,
                };
                in_unit(axis.command, value - turns_rad)
            };
            [of_axis(first), second.map_or(f64::NAN, of_axis)]
        };
        for values in shown.replicates {
            let of = |command| {
                let found = self.free.iter().zip(values).find(|(of, _)| **of == command);
                found.map_or(f64::NAN, |(_, value)| *value)
            };
            let mut problem = best.problem.clone();
            let both = self.free.iter().zip(values);
            both.for_each(|(command, value)| command.set(&mut problem, *value));
            rows.push(row(MapPoint::Replicate, place(&of), f64::NAN, &problem));
        }
        rows.extend(shown.present.map(|of| {
            let place = place(&|command| command.value(&of.problem));
            row(MapPoint::Present, place, of.value, &of.problem)
        }));
        let optimum = place(&|command| command.value(&best.problem));
        rows.push(row(MapPoint::Optimum, optimum, best.value, &best.problem));
        Ok(rows)
    }

    /// Places along a command, as parts of its range: all of it, or of a phase a turn; that of the optimum
    /// among them.
    fn parts(&self, i: usize, optimum: f64) -> Vec<f64> {
        let command = self.free[i];
        let [low, high] = command.range(&self.bounds);
        let half = PI / (high - low);
        let (from, to) =
            if command.is_phase() { (optimum - half, optimum + half) } else { (0.0, 1.0) };
        let part = |nth: usize| from + (to - from) * nth as f64 / (SIZE - 1) as f64;
        let mut parts: Vec<f64> = (0..SIZE).map(part).collect();
        let nearest = ((optimum - from) / (to - from) * (SIZE - 1) as f64).round() as usize;
        if let Some(nearest) = parts.get_mut(nearest) {
            *nearest = optimum;
        }
        parts
    }
}

/// An axis of a map: which of the free commands, and where along its range there are values.
struct Axis {
    nth: usize,
    command: Command,
    parts: Vec<f64>,
}

/// A command's value as maps have it: rad/s, or degrees.
fn in_unit(command: Command, value: f64) -> f64 {
    if command == Command::Omega { value } else { value * 360.0 / TAU }
}

/// The cost at a place; NaN where there is no stable motion within the limits.
fn counted(landscape: &mut Landscape, place: &Place) -> f64 {
    const EXCEEDED: f64 = 1e-6;
    let point = landscape.evaluate(place);
    let within = point.filter(|point| point.excess.iter().all(|excess| *excess < EXCEEDED));
    within.filter(|_| landscape.is_stable()).map_or(f64::NAN, |point| point.cost)
}
