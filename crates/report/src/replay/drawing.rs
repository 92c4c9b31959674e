//! Template values of a replay: the still drawing, which needs no script, and the data from which the script animates
//! the drawing.

use minijinja::context;
use minijinja::value::{Serde, Value};
use serde::Serialize;
use trilink_base::numbers::{as_configured, fixed};
use trilink_mechanics::Pose;
use trilink_plot::RGBColor;
use trilink_robot::rotated;

use super::numbers::{self, PER_MM, PER_UNIT, whole};
use super::{Direction, Mark, Motion, Quantity, Replay, body};
use crate::figures::link_noun;

/// Minimum ratio of width to height of the drawing.
const MIN_ASPECT: f64 = 1.5;
/// Maximum ratio of width to height of the drawing.
const MAX_ASPECT: f64 = 3.0;
/// Maximum number of grid squares across the drawing.
const MAX_SQUARES: f64 = 16.0;
/// Maximum width of the drawing, as a multiple of the length of the scale bar.
const MAX_BARS: f64 = 10.0;
/// Margin of floor shown around the wheels, as a multiple of [`Replay::reach_m`].
const FLOOR_MARGIN: f64 = 0.6;
/// Maximum number of poses in the still drawing, not counting the last one.
const MAX_STILLS: usize = 5;
/// Minimum distance between the poses in the still drawing, in robot lengths (twice [`Replay::reach_m`]).
const MIN_STILL_DISTANCE: f64 = 1.3;
/// Maximum length of the arrow that represents the typical value of a quantity (see [`TYPICAL_QUANTILE`]), as a
/// multiple of [`Replay::reach_m`].
const MAX_ARROW: f64 = 0.8;
/// Quantile of a quantity's absolute values that is taken as the typical value.
const TYPICAL_QUANTILE: f64 = 0.95;
/// Length of an arrowhead, in units of 0.1 mm.
const ARROW_HEAD: f64 = 120.0;

/// Visible rectangle of the floor, in units of 0.1 mm.
struct View {
    left: f64,
    right: f64,
    low: f64,
    high: f64,
}

/// Robot drawn in one pose.
#[derive(Serialize)]
struct Still {
    class: &'static str,
    links: Vec<Link>,
}

/// Link of a robot in the drawing.
#[derive(Serialize)]
struct Link {
    number: usize,
    transform: String,
    /// CSS class and SVG path of each arrow.
    arrows: Vec<(String, String)>,
    /// CSS class and position (in units of 0.1 mm) of each missing or corrected marker.
    marks: Vec<(&'static str, i64, i64)>,
}

impl Replay {
    /// Returns the template values with which a page shows the replay.
    pub(crate) fn value(&self, title: &str) -> Value {
        let turned_rad = self.travel_rad();
        let view = self.view(turned_rad);
        let [width, height] = [view.right - view.left, view.high - view.low];
        let view_mm = width / PER_MM;
        let [grid_mm, bar_mm] = [MAX_SQUARES, MAX_BARS].map(|count| nice(view_mm / count));
        let longest_mm = 1e3 * MAX_ARROW * self.reach_m();
        // Value that 1 mm of arrow stands for, in the unit of the quantity; equal for all quantities with the same
        // unit.
        let per_mm = |quantity: &Quantity| {
            let same_unit = self.quantities.iter().filter(|other| other.unit == quantity.unit);
            let same_unit = same_unit.filter(|other| other.arrow.is_some());
            let typical = same_unit
                .map(|other| other.units * other.full_scale.unwrap_or_else(|| typical(other)))
                .fold(0.0, f64::max);
            let is_drawn = quantity.arrow.is_some()
                && quantity.values.iter().flatten().any(|of| of.abs() > 0.0);
            (is_drawn && typical > 0.0).then(|| nice(typical / longest_mm))
        };
        let per_mm: Vec<Option<f64>> = self.quantities.iter().map(per_mm).collect();
        let drawn = || self.quantities.iter().zip(&per_mm);
        let arrows: Vec<Option<f64>> =
            drawn().map(|(of, per_mm)| Some(1e-3 * of.units / (*per_mm)?)).collect();
        let scales = drawn().filter_map(|(of, per_mm)| {
            let class = class(of.arrow?);
            let per_mm = (*per_mm)?;
            let (per_mm, bar) = (as_configured(per_mm), as_configured(per_mm * bar_mm));
            Some(context! { class, name => &of.name, unit => of.unit, per_mm, bar })
        });
        let trails = self.motions.iter().map(|of| context! { name => &of.name, path => trail(of) });
        let stills = self.stills(&arrows);
        let shapes = body::shapes(&self.robot);
        context! {
            title,
            alternative => self.alternative(title, stills.len()),
            view_box => [view.left, -view.high, width, height].map(|of| of.round() as i64),
            // The floor is large enough for every position that panning can reach.
            floor => [view.left - width, -view.high - height, 3.0 * width, 3.0 * height]
                .map(|of| of.round() as i64),
            turned => format!("{:.2}", -turned_rad.to_degrees()),
            view_mm => view_mm.round(),
            bar_mm => as_configured(bar_mm),
            grid => (PER_MM * grid_mm).round() as i64,
            shapes => Serde(&shapes),
            marker => (PER_UNIT * body::marker_radius_m(&self.robot)).round() as i64,
            trails => trails.collect::<Vec<_>>(),
            model => self.motions.iter().find_map(|motion| motion.colour).map(hex),
            stills => Serde(stills),
            scales => scales.collect::<Vec<_>>(),
            has_marks => !self.marks.is_empty(),
            frames => self.time_s.len(),
            notes => &self.notes,
            data => numbers::json(self, &arrows),
        }
    }

    /// Returns half the length (m) of the straight robot (see [`body::reach_m`]).
    fn reach_m(&self) -> f64 {
        body::reach_m(&self.robot)
    }

    /// Returns the direction (rad) from the first to the last position of the robot; 0 if these positions are close
    /// together.
    fn travel_rad(&self) -> f64 {
        let mut poses = self.motions.iter().flat_map(|motion| motion.poses.iter().flatten());
        let first = poses.next().map(|(pose, _)| *pose).unwrap_or_default();
        let known =
            self.motions.first().and_then(|motion| motion.poses.iter().flatten().next_back());
        let last = known.map_or(first, |(pose, _)| *pose);
        let [x, y] = [last.x_m - first.x_m, last.y_m - first.y_m];
        if x.hypot(y) > self.reach_m() { y.atan2(x) } else { 0.0 }
    }

    /// Returns the rectangle of floor that contains the robot in all frames, with a margin, in coordinates rotated by
    /// `turned_rad`.
    fn view(&self, turned_rad: f64) -> View {
        let reach = PER_UNIT * FLOOR_MARGIN * self.reach_m();
        let [mut x, mut y] = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        let links = self.motions.iter().flat_map(|motion| {
            (0..motion.poses.len()).filter_map(|frame| self.links(motion, frame))
        });
        for pose in links.flatten() {
            let position = [pose.x_m, pose.y_m].map(|m| whole(m).unwrap_or_default() as f64);
            for (ends, value) in [&mut x, &mut y].into_iter().zip(rotated(-turned_rad, position)) {
                *ends = [ends[0].min(value - reach), ends[1].max(value + reach)];
            }
        }
        let [width, height] = [x, y].map(|[from, to]| to - from);
        let wide = width.max(MIN_ASPECT * height);
        let high = height.max(wide / MAX_ASPECT);
        let [left, right] = centred(x, wide);
        let [low, high] = centred(y, high);
        View { left, right, low, high }
    }

    /// Returns the indices of the frames shown in the still drawing, spaced along the path of the robot. The last of
    /// them is the last frame in which the pose is known in every motion, if there is such a frame.
    fn still_frames(&self) -> Vec<usize> {
        let Some((first, others)) = self.motions.split_first() else { return Vec::new() };
        let known: Vec<usize> =
            (0..first.poses.len()).filter(|i| first.poses[*i].is_some()).collect();
        if known.is_empty() {
            return known;
        }
        let last = known
            .iter()
            .rev()
            .find(|i| others.iter().all(|motion| motion.poses[**i].is_some()))
            .or(known.last());
        let position =
            |i: usize| first.poses[i].map_or((0.0, 0.0), |(pose, _)| (pose.x_m, pose.y_m));
        let apart_m = 2.0 * MIN_STILL_DISTANCE * self.reach_m();
        let mut found: Vec<usize> = last.into_iter().copied().collect();
        for nth in 0..MAX_STILLS {
            let frame = known[nth * known.len().saturating_sub(1) / MAX_STILLS];
            let (x, y) = position(frame);
            let is_apart = found.iter().all(|other| {
                let (other_x, other_y) = position(*other);
                (x - other_x).hypot(y - other_y) > apart_m
            });
            if is_apart {
                found.push(frame);
            }
        }
        found.sort_unstable();
        found
    }

    /// Returns the robots in the still drawing: the main motion in all frames shown, the overlaid motions in the last
    /// of these frames only. `arrows` contains, for each quantity, the arrow length (m) per SI unit of the quantity, or
    /// `None` if no arrow is drawn.
    fn stills(&self, arrows: &[Option<f64>]) -> Vec<Still> {
        let frames = self.still_frames();
        let Some((first, others)) = self.motions.split_first() else { return Vec::new() };
        let over = frames
            .last()
            .into_iter()
            .flat_map(|frame| others.iter().map(move |of| (of, frame, "ghost")));
        let all = frames.iter().map(|frame| (first, frame, "robot")).chain(over);
        all.filter_map(|(motion, frame, class)| {
            let is_first = class == "robot";
            let poses = self.links(motion, *frame)?;
            Some(Still {
                class,
                links: poses
                    .into_iter()
                    .enumerate()
                    .map(|(number, pose)| Link {
                        number,
                        transform: transform(pose),
                        arrows: if is_first {
                            self.arrows(number, *frame, arrows)
                        } else {
                            Vec::new()
                        },
                        marks: if is_first { self.marks_of(number, *frame) } else { Vec::new() },
                    })
                    .collect(),
            })
        })
        .collect()
    }

    /// Returns the CSS class and SVG path of each arrow at a wheel in a frame. `lengths` contains, for each quantity,
    /// the arrow length (m) per SI unit of the quantity, or `None` if no arrow is drawn.
    fn arrows(&self, wheel: usize, frame: usize, lengths: &[Option<f64>]) -> Vec<(String, String)> {
        let drawn = self.quantities.iter().zip(lengths);
        let drawn = drawn.filter_map(|(quantity, length)| {
            let direction = quantity.arrow?;
            let value = quantity.values.get(wheel)?[frame];
            let length = PER_UNIT * (*length)? * value;
            length
                .is_finite()
                .then(|| (class(direction).to_owned(), arrow(direction, length.round())))
        });
        drawn.collect()
    }

    /// Returns the CSS class and position (in units of 0.1 mm) of each missing or corrected marker on a link in a
    /// frame.
    fn marks_of(&self, link: usize, frame: usize) -> Vec<(&'static str, i64, i64)> {
        let now = self
            .marks
            .iter()
            .filter(|Mark { frames: [from, to], .. }| (*from..=*to).contains(&frame));
        let now = now.map(|mark| (&self.markers[mark.marker], mark.is_corrected));
        let own = now.filter(|(marker, _)| marker.link == link);
        own.map(|(marker, is_corrected)| {
            let [x, y] = marker.position_mm.map(|mm| (PER_MM * mm).round() as i64);
            (if is_corrected { "corrected" } else { "missing" }, x, y)
        })
        .collect()
    }

    /// Returns a noun phrase for link 0.
    fn reference(&self) -> String {
        link_noun(&self.robot.links[self.robot.reference].name)
    }

    /// Returns the text alternative (`alt` text) for the still drawing, in which the robot appears `robots` times.
    fn alternative(&self, title: &str, robots: usize) -> String {
        let mut poses = self.motions[0].poses.iter().flatten();
        let first = poses.next();
        let last = poses.next_back().or(first);
        let travel = first.zip(last).map(|((a, _), (b, _))| {
            let [x, y] = [b.x_m - a.x_m, b.y_m - a.y_m];
            let seconds = self.time_s.last().zip(self.time_s.first()).map_or(0.0, |(b, a)| b - a);
            format!(
                " In {} s, {} moves {} mm and turns by {}°.",
                fixed(seconds, 1),
                self.reference(),
                fixed(1e3 * x.hypot(y), 0),
                fixed((b.theta_rad - a.theta_rad).to_degrees(), 0)
            )
        });
        let over = self.motions.get(1).map(|motion| format!(" Dashed overlay: {}.", motion.name));
        format!(
            "{title}: the robot from above, drawn {robots} times along its path.{}{}",
            travel.unwrap_or_default(),
            over.unwrap_or_default()
        )
    }
}

/// Returns the interval of length `span` with the same midpoint as the interval `[from, to]`.
fn centred([from, to]: [f64; 2], span: f64) -> [f64; 2] {
    let midpoint = 0.5 * (from + to);
    [midpoint - 0.5 * span, midpoint + 0.5 * span]
}

/// Returns the CSS class of the arrows in a direction.
fn class(direction: Direction) -> &'static str {
    match direction {
        Direction::Along => "roll",
        Direction::Across => "skid",
    }
}

/// Returns the typical absolute value of a quantity, which is the quantile [`TYPICAL_QUANTILE`].
fn typical(quantity: &Quantity) -> f64 {
    let values = quantity.values.iter().flatten().map(|value| value.abs());
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let index = (TYPICAL_QUANTILE * values.len() as f64) as usize;
    values.get(index).copied().unwrap_or_default()
}

/// Rounds a positive value up to the next number in the series ..., 1, 2, 5, 10, ...
pub(crate) fn nice(value: f64) -> f64 {
    let decade = 10_f64.powf(value.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|step| step * decade);
    steps.into_iter().find(|step| *step >= value * (1.0 - 1e-9)).unwrap_or(value)
}

fn hex(RGBColor(red, green, blue): RGBColor) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn transform(pose: Pose) -> String {
    let [x, y] = [pose.x_m, pose.y_m].map(|m| whole(m).unwrap_or_default());
    format!("translate({x} {y})rotate({:.2})", pose.theta_rad.to_degrees() % 360.0)
}

/// Returns the trajectory of link 0 as an SVG path, with gaps where the pose is unknown.
fn trail(motion: &Motion) -> String {
    let mut path = String::new();
    let mut last: Option<[i64; 2]> = None;
    for pose in &motion.poses {
        let now = pose.and_then(|(pose, _)| Some([whole(pose.x_m)?, whole(pose.y_m)?]));
        match (last, now) {
            (Some([x, y]), Some([to_x, to_y])) => path += &format!("l{} {}", to_x - x, to_y - y),
            (None, Some([x, y])) => path += &format!("M{x} {y}"),
            (_, None) => {}
        }
        last = now;
    }
    path
}

/// Returns the SVG path of an arrow that starts at the wheel; `length` is in units of 0.1 mm.
fn arrow(direction: Direction, length: f64) -> String {
    let back = length - length.signum() * ARROW_HEAD.min(0.5 * length.abs());
    let wide = 0.5 * (length - back);
    match direction {
        Direction::Along => format!("M0 0H{length}M{back} {wide}L{length} 0 {back} {}", -wide),
        Direction::Across => format!("M0 0V{length}M{wide} {back}L0 {length} {} {back}", -wide),
    }
}
