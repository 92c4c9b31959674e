//! Elements shared between figures: maps with the robot, time courses, axis labels and units.

use trilink_mechanics::{Pose, Sample};
use trilink_plot::{Layer, Look, Panel, Scale};
use trilink_robot::{AnyGait, AnyRobot, Chain, Robot};

use crate::looks;

/// Label for frequency axes.
pub const FREQUENCY: &str = "Actuation frequency ω (rad/s)";
/// Label for frequency axes in small panels.
pub(super) const OMEGA: &str = "ω (rad/s)";
/// Degrees per radian.
pub(super) const DEG: f64 = 180.0 / std::f64::consts::PI;

/// Returns a panel with time on the horizontal axis.
pub(super) fn time_course(title: &str, y_label: &str, layers: Vec<Layer>) -> Panel {
    Panel::new(title, "Time (s)", y_label, layers)
}

/// Returns the symbol of the angle of a joint, given the index of the joint.
pub(super) fn angle(joint: usize) -> String {
    subscripted('φ', joint + 1)
}

/// Returns the numbers of the links of a robot with wheels, with the names of the wheels in legends.
pub(crate) fn wheels(robot: &AnyRobot) -> Vec<(usize, String)> {
    match robot {
        AnyRobot::ThreeLinks(_) => {
            (0..Robot::LINKS).map(|number| (number, format!("wheel {number}"))).collect()
        }
        AnyRobot::Chain(chain) => {
            let links = chain.numbering().into_iter().map(|link| &chain.links[link]).enumerate();
            let with_wheels = links.filter(|(_, link)| link.wheel.is_some());
            with_wheels
                .map(|(number, link)| (number, format!("wheel {number} ({})", link.name)))
                .collect()
        }
    }
}

/// Returns a symbol with a number of one digit as its index.
pub(crate) fn subscripted(symbol: char, number: usize) -> String {
    const DIGITS: [char; 10] = ['₀', '₁', '₂', '₃', '₄', '₅', '₆', '₇', '₈', '₉'];
    format!("{symbol}{}", DIGITS[number % 10])
}

/// Returns a noun phrase for the link with a given name, such as `the middle link` or `link 2`.
pub(crate) fn link_noun(name: &str) -> String {
    if name.contains("link") { name.to_owned() } else { format!("the {name} link") }
}

/// Returns a panel that maps the path of link 0, with equal scales on both axes.
pub(super) fn map(title: impl Into<String>, layers: Vec<Layer>) -> Panel {
    scaled(Scale::Equal, Panel::new(title, "x (m)", "y (m)", layers))
}

/// Returns a panel in which one joint angle is plotted against the other.
pub(super) fn gait(title: &str, layers: Vec<Layer>) -> Panel {
    scaled(Scale::Equal, Panel::new(title, "φ₁ (deg)", "φ₂ (deg)", layers))
}

/// Sets the scale of both axes of a panel.
pub(super) fn scaled(scale: Scale, panel: Panel) -> Panel {
    Panel { x_scale: scale, y_scale: scale, ..panel }
}

/// Returns one line for each component of a quantity; `names` are the names of the components, and `points` returns the
/// points of the component with a given index.
pub(super) fn lines(
    names: &[impl AsRef<str>],
    points: impl Fn(usize) -> Vec<(f64, f64)>,
) -> Vec<Layer> {
    names
        .iter()
        .enumerate()
        .map(|(nth, name)| Layer::new(name.as_ref(), points(nth), looks::component(nth)))
        .collect()
}

/// Returns the time course of a quantity for a cycle that is repeated `cycles` times.
pub(super) fn over_time(
    cycle: &[Sample],
    cycles: usize,
    quantity: impl Fn(&Sample) -> f64,
) -> Vec<(f64, f64)> {
    let period_s = cycle.last().map_or(0.0, |last| last.time_s);
    let repeated =
        (0..cycles).flat_map(|n| cycle.iter().skip(usize::from(n > 0)).map(move |s| (n, s)));
    repeated.map(|(n, sample)| (n as f64 * period_s + sample.time_s, quantity(sample))).collect()
}

/// Returns both joint angles (deg) at every sample of a cycle.
pub(super) fn shape(cycle: &[Sample]) -> Vec<(f64, f64)> {
    cycle.iter().map(|sample| (DEG * sample.phi_rad[0], DEG * sample.phi_rad[1])).collect()
}

/// Returns the layer that shows the robot's links at the start of a path, as a line through `points` (see [`links`]).
pub(super) fn links_at_start(points: impl IntoIterator<Item = (f64, f64)>) -> Layer {
    Layer::new("links at the start", points, Look::Links)
}

/// Returns the positions (m) of the front end, the joints and the rear end of a robot, from front to rear; `None` if
/// the number of joint angles is not that of the robot's joints. The ends are at the outer wheels.
pub(super) fn links(robot: &AnyRobot, pose: Pose, phi_rad: &[f64]) -> Option<Vec<(f64, f64)>> {
    if phi_rad.len() != robot.joints() {
        return None;
    }
    let chain = robot.to_chain(&AnyGait::NONE);
    let [_, joints] = chain.poses(pose, phi_rad);
    let links = chain.link_poses(pose, phi_rad);
    let end = |link: usize| links[link].ahead(Chain::outer_place_m(&chain.links[link]));
    let points = [end(0)].into_iter().chain(joints).chain([end(links.len() - 1)]);
    Some(points.map(|pose| (pose.x_m, pose.y_m)).collect())
}

/// Returns an arrow that is drawn beside a path and the points `beside`, and points in the direction of travel.
pub(super) fn travel(path: &[(f64, f64)], beside: &[(f64, f64)]) -> Layer {
    const LENGTH: f64 = 0.35;
    const ASIDE: f64 = 0.1;
    let (from, to) = match path {
        [first, .., last] => (*first, *last),
        _ => ((f64::NAN, f64::NAN), (f64::NAN, f64::NAN)),
    };
    let along = to.0 - from.0;
    let up = to.1 - from.1;
    // The arrow lies outside the full width of the path.
    let length = along.hypot(up);
    let lowest = path
        .iter()
        .chain(beside)
        .map(|point| ((point.1 - from.1) * along - (point.0 - from.0) * up) / length)
        .fold(0.0, f64::min);
    let aside = lowest / length - ASIDE;
    let start = (from.0 + 0.3 * along - aside * up, from.1 + 0.3 * up + aside * along);
    let end = (start.0 + LENGTH * along, start.1 + LENGTH * up);
    Layer::new("direction of travel", [start, end], Look::Arrow)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_robot_lies_along_its_heading() {
        let robot = Robot::kinematic();
        let ([reach, _], [h, _]) = (robot.reach_m(), robot.h_m);
        let robot = AnyRobot::from(robot);
        let pose = Pose { x_m: 1.0, y_m: 2.0, theta_rad: std::f64::consts::FRAC_PI_2 };
        let links = links(&robot, pose, &[0.0; 2]).expect("two joints");
        for ((x, y), along) in links.iter().zip([reach, h, -h, -reach]) {
            assert!((x - 1.0).abs() < 1e-12 && (y - 2.0 - along).abs() < 1e-12);
        }
        // The front link is turned to the left by -phi1; the rear link is straight.
        let bent = super::links(&robot, Pose::default(), &[-0.5, 0.0]).expect("two joints");
        assert!(bent[0].1 > 0.0 && bent[3].1 == 0.0);
    }

    #[test]
    fn a_chain_like_the_robot_of_three_links_is_drawn_through_the_same_points() {
        let (robot, gait) = (Robot::semi_passive(), trilink_robot::Gait::passive_symmetric());
        let pose = Pose { x_m: 0.3, y_m: -0.2, theta_rad: 0.7 };
        let chain = AnyRobot::from(robot.chain(&gait));
        let [found, known] = [&chain, &robot.into()]
            .map(|robot| links(robot, pose, &[0.4, -0.3]).expect("two joints"));
        for (found, known) in found.iter().zip(&known) {
            assert!((found.0 - known.0).abs() + (found.1 - known.1).abs() < 1e-12);
        }
        assert_eq!(found.len(), known.len());
        assert_eq!(links(&chain, pose, &[0.4]), None);
    }

    #[test]
    fn the_arrow_points_in_the_direction_of_travel_beside_the_path() {
        let path = [(0.0, 0.0), (1.0, -0.2), (2.0, 0.1), (3.0, 0.0)];
        let [from, to] = travel(&path, &[]).points[..] else { panic!("an arrow") };
        assert!(to.x > from.x && (to.y - from.y).abs() < 1e-12);
        assert!(from.y < -0.2);
        let [from, _] = travel(&path, &[(0.5, -0.7)]).points[..] else { panic!("an arrow") };
        assert!(from.y < -0.7);
    }
}
