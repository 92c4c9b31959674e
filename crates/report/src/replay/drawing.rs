//! A replay as a page shows it: what is drawn without a script, and what the script draws with.

use minijinja::context;
use minijinja::value::{Serde, Value};
use serde::Serialize;
use trilink_base::numbers::{as_configured, fixed};
use trilink_mechanics::Pose;
use trilink_plot::RGBColor;
use trilink_robot::rotated;

use super::numbers::{self, PER_MM, PER_UNIT, whole};
use super::{Direction, Mark, Motion, Quantity, Replay};

/// Width over height of the drawing, at least and at most.
const LEAST_ASPECT: f64 = 1.5;
const MOST_ASPECT: f64 = 3.0;
/// Squares of the grid across the drawing, and bars of its scale, at most.
const SQUARES: f64 = 16.0;
const BARS: f64 = 10.0;
/// Floor around the wheels, as a part of the distance from the middle to a straight side link's
/// wheel, like the following.
const REACH: f64 = 0.6;
/// Poses that are drawn without a script, and how far they are apart at least, in lengths of the
/// robot.
const MOST_STILLS: usize = 5;
const STILLS_APART: f64 = 1.3;
/// Length of usual arrows at most, and the part of all values that are usual.
const LONGEST_ARROW: f64 = 0.8;
const USUAL: f64 = 0.95;
/// Radius of a marker.
const MARKER: f64 = 0.04;
/// An arrow's head, 0.1 mm.
const HEAD: f64 = 120.0;

/// A rectangle of the floor, 0.1 mm.
struct View {
    left: f64,
    right: f64,
    low: f64,
    high: f64,
}

/// A robot that is drawn.
#[derive(Serialize)]
struct Still {
    class: &'static str,
    links: Vec<Link>,
}

#[derive(Serialize)]
struct Link {
    number: usize,
    transform: String,
    /// Class and path of each arrow.
    arrows: Vec<(String, String)>,
    /// Class and place of markers that were missing or corrected.
    marks: Vec<(&'static str, i64, i64)>,
}

impl Replay {
    /// What the page's template is filled with.
    pub(crate) fn value(&self, title: &str) -> Value {
        let turned_rad = self.travel_rad();
        let view = self.view(turned_rad);
        let [width, height] = [view.right - view.left, view.high - view.low];
        let view_mm = width / PER_MM;
        let [grid_mm, bar_mm] = [SQUARES, BARS].map(|count| nice(view_mm / count));
        let longest_mm = 1e3 * LONGEST_ARROW * (self.robot.h_m + self.robot.l_m);
        // What a millimetre of an arrow stands for, in the quantities' unit: the same for all that
        // have one.
        let per_mm = |quantity: &Quantity| {
            let alike = self.quantities.iter().filter(|other| other.unit == quantity.unit);
            let alike = alike.filter(|other| other.arrow.is_some());
            let usual = alike.map(|other| other.units * usual(other)).fold(0.0, f64::max);
            let is_drawn = quantity.arrow.is_some()
                && quantity.values.iter().flatten().any(|of| of.abs() > 0.0);
            (is_drawn && usual > 0.0).then(|| nice(usual / longest_mm))
        };
        let per_mm: Vec<Option<f64>> = self.quantities.iter().map(per_mm).collect();
        let drawn = || self.quantities.iter().zip(&per_mm);
        let arrows: Vec<Option<f64>> =
            drawn().map(|(of, per_mm)| Some(1e-3 * of.units / (*per_mm)?)).collect();
        let scales = drawn().filter_map(|(of, per_mm)| {
            let (class, per_mm) = (class(of.arrow?), (*per_mm)?);
            let (per_mm, bar) = (as_configured(per_mm), as_configured(per_mm * bar_mm));
            Some(context! { class, name => of.name, unit => of.unit, per_mm, bar })
        });
        let trails = self.motions.iter().map(|of| context! { name => &of.name, path => trail(of) });
        let stills = self.stills(&arrows);
        let size = self.robot.h_m + self.robot.l_m;
        context! {
            title,
            alternative => self.alternative(title, stills.len()),
            view_box => [view.left, -view.high, width, height].map(|of| of.round() as i64),
            // With so much around it that it does not end where one can go.
            floor => [view.left - width, -view.high - height, 3.0 * width, 3.0 * height]
                .map(|of| of.round() as i64),
            turned => format!("{:.2}", -turned_rad.to_degrees()),
            view_mm => view_mm.round(),
            bar_mm => as_configured(bar_mm),
            grid => (PER_MM * grid_mm).round() as i64,
            shapes => Serde(self.shapes()),
            marker => (PER_UNIT * MARKER * size).round() as i64,
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

    /// Direction from where the robot is first to where it is last; none worth the name if that is
    /// near.
    fn travel_rad(&self) -> f64 {
        let mut poses = self.motions.iter().flat_map(|motion| motion.poses.iter().flatten());
        let first = poses.next().map(|(pose, _)| *pose).unwrap_or_default();
        let known =
            self.motions.first().and_then(|motion| motion.poses.iter().flatten().next_back());
        let last = known.map_or(first, |(pose, _)| *pose);
        let [x, y] = [last.x_m - first.x_m, last.y_m - first.y_m];
        if x.hypot(y) > self.robot.h_m + self.robot.l_m { y.atan2(x) } else { 0.0 }
    }

    /// The floor that the robot needs, with some around it, as seen by one who is turned.
    fn view(&self, turned_rad: f64) -> View {
        let reach = PER_UNIT * REACH * (self.robot.h_m + self.robot.l_m);
        let [mut x, mut y] = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        let links = self.motions.iter().flat_map(|motion| {
            (0..motion.poses.len()).filter_map(|frame| self.links(motion, frame))
        });
        for pose in links.flatten() {
            let place = [pose.x_m, pose.y_m].map(|m| whole(m).unwrap_or_default() as f64);
            for (ends, value) in [&mut x, &mut y].into_iter().zip(rotated(-turned_rad, place)) {
                *ends = [ends[0].min(value - reach), ends[1].max(value + reach)];
            }
        }
        let [width, height] = [x, y].map(|[from, to]| to - from);
        let wide = width.max(LEAST_ASPECT * height);
        let high = height.max(wide / MOST_ASPECT);
        let centred = |[from, to]: [f64; 2], span: f64| {
            let middle = 0.5 * (from + to);
            [middle - 0.5 * span, middle + 0.5 * span]
        };
        let ([left, right], [low, high]) = (centred(x, wide), centred(y, high));
        View { left, right, low, high }
    }

    /// The links as paths in their own frames, body and wheels.
    fn shapes(&self) -> [[String; 2]; 3] {
        let [half, side] = [self.robot.h_m, self.robot.l_m].map(|m| (PER_UNIT * m).round());
        let size = half + side;
        let [body, axle, wheel, tread] = [0.07, 0.19, 0.1, 0.02].map(|part| (part * size).round());
        let joint = (0.6 * body).round();
        let body = |from: f64, to: f64| format!("M{from} {}H{to}V{body}H{from}z", -body);
        let pivot = |x: f64| {
            format!(
                "M{} 0a{joint} {joint} 0 1 0 {} 0a{joint} {joint} 0 1 0 {} 0",
                x - joint,
                2.0 * joint,
                -2.0 * joint
            )
        };
        let one = |y: f64| {
            format!("M{} {}h{}v{}h{}z", -wheel, y - tread, 2.0 * wheel, 2.0 * tread, -2.0 * wheel)
        };
        let wheels = format!("{}{}", one(axle), one(-axle)) + &format!("M0 {}V{axle}", -axle);
        let bodies = [
            body(-half, half) + &pivot(half) + &pivot(-half),
            body(-side, 0.3 * side),
            body(-0.3 * side, side),
        ];
        bodies.map(|body| [body, wheels.clone()])
    }

    /// Frames that show the robot along its way; the last one is known of every motion, if any is.
    fn still_frames(&self) -> Vec<usize> {
        let Some((first, others)) = self.motions.split_first() else { return Vec::new() };
        let is_known = |i: &usize| first.poses[*i].is_some();
        let known: Vec<usize> = (0..first.poses.len()).filter(is_known).collect();
        if known.is_empty() {
            return known;
        }
        let of_all = |i: &&usize| others.iter().all(|motion| motion.poses[**i].is_some());
        let last = known.iter().rev().find(of_all).or(known.last());
        let at = |i: usize| first.poses[i].map_or((0.0, 0.0), |(pose, _)| (pose.x_m, pose.y_m));
        let apart_m = 2.0 * STILLS_APART * (self.robot.h_m + self.robot.l_m);
        let is_apart = |a: usize, b: usize| (at(a).0 - at(b).0).hypot(at(a).1 - at(b).1) > apart_m;
        let mut found: Vec<usize> = last.into_iter().copied().collect();
        for part in 0..MOST_STILLS {
            let frame = known[part * known.len().saturating_sub(1) / MOST_STILLS];
            if found.iter().all(|other| is_apart(frame, *other)) {
                found.push(frame);
            }
        }
        found.sort_unstable();
        found
    }

    fn stills(&self, arrows: &[Option<f64>]) -> Vec<Still> {
        let frames = self.still_frames();
        let Some((first, others)) = self.motions.split_first() else { return Vec::new() };
        let over = frames
            .last()
            .into_iter()
            .flat_map(|frame| others.iter().map(move |of| (of, frame, "ghost")));
        let all = frames.iter().map(|frame| (first, frame, "robot")).chain(over);
        let still = |(motion, frame, class): (&Motion, &usize, &'static str)| {
            let is_first = class == "robot";
            let poses = self.links(motion, *frame)?;
            let link = |(number, pose): (usize, Pose)| Link {
                number,
                transform: transform(pose),
                arrows: if is_first { self.arrows(number, *frame, arrows) } else { Vec::new() },
                marks: if is_first { self.marks_of(number, *frame) } else { Vec::new() },
            };
            Some(Still { class, links: poses.into_iter().enumerate().map(link).collect() })
        };
        all.filter_map(still).collect()
    }

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

    /// What the drawing shows for those who cannot see it.
    fn alternative(&self, title: &str, robots: usize) -> String {
        let poses = || self.motions[0].poses.iter().flatten();
        let (first, last) = (poses().next(), poses().next_back());
        let way = first.zip(last).map(|((a, _), (b, _))| {
            let [x, y] = [b.x_m - a.x_m, b.y_m - a.y_m];
            let seconds = self.time_s.last().zip(self.time_s.first()).map_or(0.0, |(b, a)| b - a);
            format!(
                " In {} s its middle link moves {} mm and turns by {}°.",
                fixed(seconds, 1),
                fixed(1e3 * x.hypot(y), 0),
                fixed((b.theta_rad - a.theta_rad).to_degrees(), 0)
            )
        });
        let over = self.motions.get(1).map(|motion| format!(" Dashed over it: {}.", motion.name));
        format!(
            "{title}: the robot from above, drawn {robots} times along its trail.{}{}",
            way.unwrap_or_default(),
            over.unwrap_or_default()
        )
    }
}

fn class(direction: Direction) -> &'static str {
    match direction {
        Direction::Along => "roll",
        Direction::Across => "skid",
    }
}

/// What most values of a quantity are below.
fn usual(quantity: &Quantity) -> f64 {
    let values = quantity.values.iter().flatten().map(|value| value.abs());
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let usual = (USUAL * values.len() as f64) as usize;
    values.get(usual).copied().unwrap_or_default()
}

/// The next of 1, 2, 5, 10, ...
pub(super) fn nice(value: f64) -> f64 {
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

/// The way of link 0; it breaks where that is not known.
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

/// An arrow from the wheel, 0.1 mm long.
fn arrow(direction: Direction, length: f64) -> String {
    let back = length - length.signum() * HEAD.min(0.5 * length.abs());
    let wide = 0.5 * (length - back);
    match direction {
        Direction::Along => format!("M0 0H{length}M{back} {wide}L{length} 0 {back} {}", -wide),
        Direction::Across => format!("M0 0V{length}M{wide} {back}L0 {length} {} {back}", -wide),
    }
}
