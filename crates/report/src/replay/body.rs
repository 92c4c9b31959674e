//! Shapes of the links of a robot in a replay.

use serde::Serialize;
use trilink_robot::{Chain, Link, Wheel, rotated};

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
pub(super) struct Lengths {
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

/// Returns half the length (m) of the straight robot.
pub(super) fn reach_m(robot: &Chain) -> f64 {
    0.5 * length_m(robot)
}

/// Returns the length (m) to which the drawn widths and wheels are proportional: half the length of a robot of three
/// links.
fn part_size_m(robot: &Chain) -> f64 {
    1.5 * length_m(robot) / robot.links.len() as f64
}

/// Returns the radius (m) of a drawn marker.
pub(super) fn marker_radius_m(robot: &Chain) -> f64 {
    0.04 * part_size_m(robot)
}

/// Returns the places (m) of the rear and the front end of a link, without what is beyond the wheel of an
/// outer link.
fn ends_m(chain: &Chain, link: usize) -> [f64; 2] {
    let own = &chain.links[link];
    let rear_m =
        if link + 1 == chain.links.len() { Chain::outer_place_m(own) } else { -own.rear_joint_m };
    let front_m = if link == 0 { Chain::outer_place_m(own) } else { own.front_joint_m };
    [rear_m, front_m]
}

/// Returns the length (m) of the straight robot between its outer wheels or, on links without one, centres of mass.
fn length_m(chain: &Chain) -> f64 {
    let lengths_m = (0..chain.links.len()).map(|link| {
        let [rear_m, front_m] = ends_m(chain, link);
        (front_m - rear_m).abs()
    });
    lengths_m.sum()
}

/// Returns the shapes of the links by number.
pub(super) fn shapes(robot: &Chain) -> Vec<Shape> {
    let sizes = Sizes::new(part_size_m(robot));
    robot.numbering().into_iter().map(|link| shape(robot, link, &sizes)).collect()
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
pub(super) fn lengths(robot: &Chain) -> Lengths {
    let joints_m = |link: &Link| [link.front_joint_m, link.rear_joint_m].map(whole);
    let wheel = |link: usize| robot.links[link].wheel.as_ref().map(wheel_transform);
    Lengths {
        reference: robot.reference,
        links: robot.links.iter().map(joints_m).collect(),
        length: whole(length_m(robot)),
        names: robot.names_by_number(),
        wheels: robot.numbering().into_iter().map(wheel).collect(),
    }
}
