//! The objective about an optimum, over the commands that it answers to most.

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;

use super::landscape::{Landscape, Place};
use super::{Command, Objective, Optimum, Search};
use crate::motion::Problem;

/// Values of each command.
const SIZE: usize = 49;
/// Part of its range by which a command is moved to see what that changes.
const MOVED: f64 = 0.05;

/// Values of the objective about an optimum.
#[derive(Debug, Clone)]
pub struct Map {
    pub objective: Objective,
    /// The one or two that the objective answers to most.
    pub commands: Vec<Command>,
    /// Their values, that of the optimum among them: rad/s and degrees.
    pub along: Vec<Vec<f64>>,
    /// The objective at each value of the first command, for one value of the second after the other; NaN
    /// where there is no stable motion within the limits.
    pub values: Vec<f64>,
    /// That of the optimum.
    pub best: f64,
}

impl Map {
    /// What the map's commands are in a problem, in its units.
    pub fn place_of(&self, problem: &Problem) -> Vec<f64> {
        self.place(|command| command.value(problem))
    }

    /// The same of values of these commands, the map's among them.
    pub fn place_among(&self, commands: &[Command], values: &[f64]) -> Vec<f64> {
        let value = |command| commands.iter().zip(values).find(|(of, _)| **of == command);
        self.place(|command| value(command).map_or(f64::NAN, |(_, value)| *value))
    }

    fn place(&self, value: impl Fn(Command) -> f64) -> Vec<f64> {
        let of = |(command, along): (&Command, &Vec<f64>)| {
            let value = shown(*command, value(*command));
            let middle =
                along.first().zip(along.last()).map_or(0.0, |(from, to)| 0.5 * (from + to));
            match command.is_phase() {
                true => value - 360.0 * ((value - middle) / 360.0).round(),
                false => value,
            }
        };
        self.commands.iter().zip(&self.along).map(of).collect()
    }
}

impl Search {
    /// The objective about an optimum of this search. The commands that it answers to most are those of
    /// which a small part of their ranges costs most.
    pub fn map(&self, best: &Optimum) -> Map {
        let mut landscape = self.landscape();
        let middle = landscape.place_of(&best.problem);
        let cost = counted(&mut landscape, &middle);
        let loss = |i: usize| {
            let moved = [MOVED, -MOVED].map(|by| {
                let mut place = middle;
                place[i] = (place[i] + by).clamp(0.0, 1.0);
                counted(&mut self.landscape(), &place) - cost
            });
            moved.into_iter().fold(0.0, f64::max)
        };
        let mut telling: Vec<(usize, f64)> = (0..self.free.len()).map(|i| (i, loss(i))).collect();
        telling.sort_by(|a, b| b.1.total_cmp(&a.1));
        telling.truncate(2);
        telling.sort_by_key(|(i, _)| *i);
        let axes: Vec<(usize, Vec<f64>)> =
            telling.iter().map(|(i, _)| (*i, self.parts(*i, middle[*i]))).collect();
        let rows = axes.get(1).map_or(vec![None], |(_, parts)| parts.iter().map(Some).collect());
        let row = |second: &Option<&f64>| {
            let mut landscape = self.landscape();
            let (mut place, mut values) = (middle, Vec::with_capacity(SIZE));
            if let (Some(part), Some((j, _))) = (second, axes.get(1)) {
                place[*j] = **part;
            }
            for (i, part) in
                axes.iter().take(1).flat_map(|(i, parts)| parts.iter().map(move |of| (i, of)))
            {
                place[*i] = *part;
                let worse = counted(&mut landscape, &place) - cost;
                let sign = if self.objective.is_minimised() { 1.0 } else { -1.0 };
                values.push(best.value * (sign * worse).exp());
            }
            values
        };
        let values = rows.par_iter().with_max_len(1).flat_map_iter(row).collect();
        let value = |i: usize, part: f64| {
            let [low, high] = self.free[i].range(&self.bounds);
            shown(self.free[i], low + part * (high - low))
        };
        let along =
            |(i, parts): &(usize, Vec<f64>)| parts.iter().map(|part| value(*i, *part)).collect();
        Map {
            objective: self.objective,
            commands: axes.iter().map(|(i, _)| self.free[*i]).collect(),
            along: axes.iter().map(along).collect(),
            values,
            best: best.value,
        }
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

/// A command's value as it is shown: rad/s, or degrees.
fn shown(command: Command, value: f64) -> f64 {
    if command == Command::Omega { value } else { value * 360.0 / TAU }
}

/// The cost at a place; NaN where there is no stable motion within the limits.
fn counted(landscape: &mut Landscape, place: &Place) -> f64 {
    const EXCEEDED: f64 = 1e-6;
    let point = landscape.evaluate(place);
    let within = point.filter(|point| point.excess.iter().all(|excess| *excess < EXCEEDED));
    within.filter(|_| landscape.is_stable()).map_or(f64::NAN, |point| point.cost)
}
