//! What several figures have alike: the robot on a map, lines of one quantity each, units.

use trilink_mechanics::{Pose, Sample};
use trilink_plot::{Layer, Look, Panel, Scale};
use trilink_robot::Robot;

use crate::looks;

/// The axis that frequencies are on.
pub const FREQUENCY: &str = "Actuation frequency ω (rad/s)";
/// The same where there is little room.
pub(super) const OMEGA: &str = "ω (rad/s)";
/// Degrees in a radian.
pub(super) const DEG: f64 = 180.0 / std::f64::consts::PI;

/// A panel against time.
pub(super) fn time_course(title: &str, y_label: &str, layers: Vec<Layer>) -> Panel {
    Panel::new(title, "Time (s)", y_label, layers)
}

/// A map of what the middle link's path is drawn on.
pub(super) fn map(title: impl Into<String>, layers: Vec<Layer>) -> Panel {
    scaled(Scale::Equal, Panel::new(title, "x (m)", "y (m)", layers))
}

/// The joint angles against each other.
pub(super) fn gait(title: &str, layers: Vec<Layer>) -> Panel {
    scaled(Scale::Equal, Panel::new(title, "φ₁ (deg)", "φ₂ (deg)", layers))
}

/// A panel of which both axes divide alike.
pub(super) fn scaled(scale: Scale, panel: Panel) -> Panel {
    Panel { x_scale: scale, y_scale: scale, ..panel }
}

/// Several lines of one quantity.
pub(super) fn lines(names: &[&str], points: impl Fn(usize) -> Vec<(f64, f64)>) -> Vec<Layer> {
    let line = |(nth, name): (usize, &&str)| Layer::new(name, points(nth), looks::component(nth));
    names.iter().enumerate().map(line).collect()
}

/// Time and a quantity of a cycle that is repeated.
pub(super) fn over_time(
    cycle: &[Sample],
    cycles: usize,
    of: impl Fn(&Sample) -> f64,
) -> Vec<(f64, f64)> {
    let period_s = cycle.last().map_or(0.0, |last| last.time_s);
    let repeated =
        (0..cycles).flat_map(|n| cycle.iter().skip(usize::from(n > 0)).map(move |s| (n, s)));
    repeated.map(|(n, sample)| (n as f64 * period_s + sample.time_s, of(sample))).collect()
}

/// Both joint angles over a cycle, deg.
pub(super) fn shape(cycle: &[Sample]) -> Vec<(f64, f64)> {
    cycle.iter().map(|sample| (DEG * sample.phi_rad[0], DEG * sample.phi_rad[1])).collect()
}

/// The robot's links at the start of a path.
pub(super) fn links_at_start(points: impl IntoIterator<Item = (f64, f64)>) -> Layer {
    Layer::new("links at the start", points, Look::Links)
}

/// Front wheel, front joint, rear joint and rear wheel, m.
pub(super) fn links(robot: &Robot, pose: Pose, phi_rad: [f64; 2]) -> Vec<(f64, f64)> {
    let [_, front, rear] = robot.link_poses(pose, phi_rad);
    let places = [front, pose.ahead(robot.h_m), pose.ahead(-robot.h_m), rear];
    places.map(|pose| (pose.x_m, pose.y_m)).into()
}

/// An arrow beside a path in the direction of its travel.
pub(super) fn travel(path: &[(f64, f64)]) -> Layer {
    const LENGTH: f64 = 0.35;
    const ASIDE: f64 = 0.1;
    let (from, to) = match path {
        [first, .., last] => (*first, *last),
        _ => ((f64::NAN, f64::NAN), (f64::NAN, f64::NAN)),
    };
    let (along, up) = (to.0 - from.0, to.1 - from.1);
    // Beside the whole width of the path.
    let length = along.hypot(up);
    let offset =
        |point: &(f64, f64)| ((point.1 - from.1) * along - (point.0 - from.0) * up) / length;
    let lowest = path.iter().map(offset).fold(0.0, f64::min);
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
        let pose = Pose { x_m: 1.0, y_m: 2.0, theta_rad: std::f64::consts::FRAC_PI_2 };
        let links = links(&robot, pose, [0.0; 2]);
        let reach = robot.h_m + robot.l_m;
        for ((x, y), along) in links.iter().zip([reach, robot.h_m, -robot.h_m, -reach]) {
            assert!((x - 1.0).abs() < 1e-12 && (y - 2.0 - along).abs() < 1e-12);
        }
        // Both side links turned to the left: link 1 by -phi1, link 2 by phi2 of its own axis.
        let bent = super::links(&robot, Pose::default(), [-0.5, 0.0]);
        assert!(bent[0].1 > 0.0 && bent[3].1 == 0.0);
    }

    #[test]
    fn the_arrow_points_where_the_path_goes_and_does_not_lie_on_it() {
        let path = [(0.0, 0.0), (1.0, -0.2), (2.0, 0.1), (3.0, 0.0)];
        let [from, to] = travel(&path).points[..] else { panic!("an arrow") };
        assert!(to.x > from.x && (to.y - from.y).abs() < 1e-12);
        assert!(from.y < -0.2);
    }
}
