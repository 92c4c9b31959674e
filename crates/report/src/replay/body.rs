//! Shapes of the links of a robot in a replay.

use serde::Serialize;
use trilink_robot::{AnyRobot, Chain, Link, Robot, Wheel, rotated};

use super::numbers::{PER_UNIT, whole};

/// Part of an outer link that is drawn beyond its wheel, as a share of the distance from the wheel to the joint.
const OVERHANG: f64 = 0.3;

/// SVG paths of a link in the coordinates of the link.
#[derive(Serialize)]
pub(super) struct Shape {
    body: String,
    /// Empty for a link without a wheel.
    wheels: String,
    /// Transform from the wheel, along whose rolling direction the x axis points, to the link; empty if there is none.
    pub wheel_transform: String,
}

/// Lengths from which the script of a page computes the poses of the links, as whole numbers of steps.
#[derive(Serialize)]
#[serde(untagged)]
pub(super) enum Lengths {
    ThreeLinks {
        half: [Option<i64>; 2],
        side: [Option<i64>; 2],
    },
    Chain {
        /// Index of the reference link, from front to rear.
        reference: usize,
        /// Distances from the origin of each link to its front and rear joint, from front to rear.
        links: Vec<[Option<i64>; 2]>,
        /// Length of the straight robot.
        length: Option<i64>,
        /// Names of the links by number.
        names: Vec<String>,
        /// Transforms of the arrows at the wheels by number; `None` for a link without a wheel.
        wheels: Vec<Option<String>>,
    },
}

/// Dimensions of the parts of a drawn robot, in steps.
struct Sizes {
    width: f64,
    joint: f64,
    axle: f64,
    radius: f64,
    tread: f64,
}

impl Sizes {
    /// Returns the sizes for a robot whose links have a typical length of `size_m` (see [`part_size_m`]).
    fn new(size_m: f64) -> Self {
        let size = PER_UNIT * size_m;
        let [width, axle, radius, tread] =
            [0.07, 0.19, 0.1, 0.02].map(|share| (share * size).round());
        Self { width, joint: (0.6 * width).round(), axle, radius, tread }
    }

    fn body(&self, from: f64, to: f64) -> String {
        let width = self.width;
        format!("M{from} {}H{to}V{width}H{from}z", -width)
    }

    fn pivot(&self, x: f64) -> String {
        let joint = self.joint;
        format!(
            "M{} 0a{joint} {joint} 0 1 0 {} 0a{joint} {joint} 0 1 0 {} 0",
            x - joint,
            2.0 * joint,
            -2.0 * joint
        )
    }

    /// Returns the two wheels of a link and their axle, at the origin of the link.
    fn wheels(&self) -> String {
        let Self { axle, radius, tread, .. } = self;
        let wheel = |y: f64| {
            format!(
                "M{} {}h{}v{}h{}z",
                -radius,
                y - tread,
                2.0 * radius,
                2.0 * tread,
                -2.0 * radius
            )
        };
        format!("{}{}", wheel(*axle), wheel(-axle)) + &format!("M0 {}V{axle}", -axle)
    }

    /// Returns the two wheels of a link and their axle at their place on the link, with steered wheels turned.
    fn wheels_at(&self, wheel: &Wheel) -> String {
        let Self { axle, radius, tread, .. } = *self;
        let at = |point: [f64; 2]| {
            let [x, y] = rotated(wheel.steer_rad, point);
            format!("{} {}", (PER_UNIT * wheel.place_m + x).round(), y.round())
        };
        let tyre = |y: f64| {
            let corners = [
                [-radius, y - tread],
                [radius, y - tread],
                [radius, y + tread],
                [-radius, y + tread],
            ];
            format!("M{}z", corners.map(at).join("L"))
        };
        format!("{}{}M{}L{}", tyre(axle), tyre(-axle), at([0.0, -axle]), at([0.0, axle]))
    }
}

/// Returns half the length (m) of the straight robot; for three links, the larger of the two distances from the middle
/// wheel to the side wheels.
pub(super) fn reach_m(robot: &AnyRobot) -> f64 {
    match robot {
        AnyRobot::ThreeLinks(robot) => {
            let [front_m, rear_m] = robot.reach_m();
            front_m.max(rear_m)
        }
        AnyRobot::Chain(chain) => 0.5 * length_m(chain),
    }
}

/// Returns the length (m) to which the drawn widths and wheels are proportional.
fn part_size_m(robot: &AnyRobot) -> f64 {
    match robot {
        AnyRobot::ThreeLinks(_) => reach_m(robot),
        // A robot of three equal links has this size in both cases.
        AnyRobot::Chain(chain) => 1.5 * length_m(chain) / chain.links.len() as f64,
    }
}

/// Returns the radius (m) of a drawn marker.
pub(super) fn marker_radius_m(robot: &AnyRobot) -> f64 {
    0.04 * part_size_m(robot)
}

/// Returns the places (m) of the rear and the front end of a link of a chain, without what is beyond the wheel of an
/// outer link.
fn ends_m(chain: &Chain, link: usize) -> [f64; 2] {
    let own = &chain.links[link];
    let rear_m =
        if link + 1 == chain.links.len() { Chain::outer_place_m(own) } else { -own.rear_joint_m };
    let front_m = if link == 0 { Chain::outer_place_m(own) } else { own.front_joint_m };
    [rear_m, front_m]
}

/// Returns the length (m) of a straight chain between its outer wheels.
fn length_m(chain: &Chain) -> f64 {
    let lengths_m = (0..chain.links.len()).map(|link| {
        let [rear_m, front_m] = ends_m(chain, link);
        (front_m - rear_m).abs()
    });
    lengths_m.sum()
}

/// Returns the shapes of the links by number.
pub(super) fn shapes(robot: &AnyRobot) -> Vec<Shape> {
    let sizes = Sizes::new(part_size_m(robot));
    match robot {
        AnyRobot::ThreeLinks(robot) => shapes_of_three(robot, &sizes),
        AnyRobot::Chain(chain) => {
            chain.numbering().into_iter().map(|link| shape(chain, link, &sizes)).collect()
        }
    }
}

fn shapes_of_three(robot: &Robot, sizes: &Sizes) -> Vec<Shape> {
    let [[ahead, behind], [front, rear]] =
        [robot.h_m, robot.l_m].map(|lengths_m| lengths_m.map(|m| (PER_UNIT * m).round()));
    let bodies = [
        sizes.body(-behind, ahead) + &sizes.pivot(ahead) + &sizes.pivot(-behind),
        sizes.body(-front, OVERHANG * front),
        sizes.body(-OVERHANG * rear, rear),
    ];
    let shape = |body| Shape { body, wheels: sizes.wheels(), wheel_transform: String::new() };
    bodies.map(shape).into()
}

fn shape(chain: &Chain, link: usize, sizes: &Sizes) -> Shape {
    let Link { wheel, .. } = &chain.links[link];
    let [rear, front] = ends_m(chain, link).map(|m| PER_UNIT * m);
    let beyond = OVERHANG * (front - rear);
    let is_first = link == 0;
    let is_last = link + 1 == chain.links.len();
    let tip = |end: f64, by: f64, is_outer: bool| (if is_outer { end + by } else { end }).round();
    let mut body = sizes.body(tip(rear, -beyond, is_last), tip(front, beyond, is_first));
    for (end, is_outer) in [(front, is_first), (rear, is_last)] {
        if !is_outer {
            body += &sizes.pivot(end.round());
        }
    }
    Shape {
        body,
        wheels: wheel.map_or(String::new(), |wheel| sizes.wheels_at(&wheel)),
        wheel_transform: wheel.map_or(String::new(), |wheel| wheel_transform(&wheel)),
    }
}

/// Returns the SVG transform from a wheel to its link.
fn wheel_transform(wheel: &Wheel) -> String {
    let place = (PER_UNIT * wheel.place_m).round();
    format!("translate({place} 0)rotate({:.2})", wheel.steer_rad.to_degrees())
}

/// Returns the lengths of a robot for the script of a page.
pub(super) fn lengths(robot: &AnyRobot) -> Lengths {
    match robot {
        AnyRobot::ThreeLinks(robot) => {
            Lengths::ThreeLinks { half: robot.h_m.map(whole), side: robot.l_m.map(whole) }
        }
        AnyRobot::Chain(chain) => Lengths::Chain {
            reference: chain.reference,
            links: chain
                .links
                .iter()
                .map(|link| [link.front_joint_m, link.rear_joint_m].map(whole))
                .collect(),
            length: whole(length_m(chain)),
            names: chain.names_by_number(),
            wheels: chain
                .numbering()
                .into_iter()
                .map(|link| chain.links[link].wheel.as_ref().map(wheel_transform))
                .collect(),
        },
    }
}
