//! Whether the links hang together as h and l say, and if not, which of them is meant.

use trilink_statistics::{extremes, mean, wrap};

use crate::checks::{Check, Finding};
use crate::markers::rigid::LinkPose;
use crate::poses::{Constant, JointPosition, Linkage};

/// Joints that are nearer to where h and l put them are theirs, mm.
const NEAR_MM: f64 = 5.0;
/// Joints that turn by less show the sum of h and l only, rad.
const LEAST_TURN_RAD: f64 = 0.17;

/// Finds whether the joints are where h and l of the robot put them. What is found is an error if a
/// cause is known.
pub(crate) fn check_linkage(linkage: &Linkage, constant: &Constant) -> Option<Finding> {
    let found = constant.joints?;
    let mm = linkage.distance_mm(&found);
    let cause = if mm > NEAR_MM { cause(linkage, &constant.own_poses) } else { None };
    let message = format!("a joint is {mm:.2} mm off where h_m and l_m of the robot put it");
    let finding = |message| Finding::at_most(Check::JointPositions, mm, message);
    Some(match cause {
        Some(cause) => finding(format!("{message}: {cause}")).failing(),
        None if mm > Check::JointPositions.limit() => {
            finding(format!("{message}: {}", farthest(linkage, &found)))
        }
        None => finding(message),
    })
}

/// The joint that is farthest from where h and l put it, and what would put it there.
fn farthest(linkage: &Linkage, found: &Linkage) -> String {
    let (configured, found) = (linkage.ends(), found.ends());
    let off = |end: usize| [0, 1].map(|axis| found[end][axis] - configured[end][axis]);
    let off_mm = |end: &usize| off(*end)[0].hypot(off(*end)[1]);
    let end = (0..4).max_by(|a, b| off_mm(a).total_cmp(&off_mm(b))).unwrap_or(0);
    let (joint, link, length) = [(1, 0, "h_m"), (1, 1, "l_m"), (2, 0, "h_m"), (2, 2, "l_m")][end];
    let ([x, y], [along, aside]) = (found[end], off(end));
    let change = if along.abs() > aside.abs() {
        format!("set {length} = {:.4} or add {:.1} mm to the x", 1e-3 * x.abs(), -along)
    } else {
        let turn_deg = -(y / x).atan().to_degrees();
        format!("turn the positions by {turn_deg:.1} degrees or add {:.1} mm to the y", -aside)
    };
    let at = |[x, y]: [f64; 2]| format!("{x:.1}, {y:.1}");
    format!(
        "joint {joint} is at {} mm of link {link}, configured at {}: {change} of markers.link{link}, whichever is \
         true of the robot",
        at(found[end]),
        at(configured[end])
    )
}

/// Why the joints are off where h and l put them by the links' own poses.
fn cause(linkage: &Linkage, poses: &[[LinkPose; 3]]) -> Option<String> {
    if poses.is_empty() || gap_mm(linkage, poses, [0, 1, 2], [false; 3]) <= NEAR_MM {
        return None;
    }
    other_links(linkage, poses).or_else(|| other_lengths(linkage, poses))
}

/// RMS distance of the joints' two positions, mm, if links 0, 1, 2 are those of `order`, and those
/// `turned` point backwards.
fn gap_mm(linkage: &Linkage, poses: &[[LinkPose; 3]], order: [usize; 3], turned: [bool; 3]) -> f64 {
    let squares = poses.iter().flat_map(|poses| {
        let at = |link: usize, [x, y]: [f64; 2]| {
            let sign = if turned[link] { -1.0 } else { 1.0 };
            poses[order[link]].at([sign * x, sign * y])
        };
        linkage.joints.iter().zip(1..).map(move |(joint, link)| {
            let (a, b) = (at(0, joint.in_middle), at(link, joint.in_outer));
            (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
        })
    });
    mean(squares).sqrt()
}

/// Links that are exchanged or point backwards.
fn other_links(linkage: &Linkage, poses: &[[LinkPose; 3]]) -> Option<String> {
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [2, 1, 0], [1, 2, 0], [2, 0, 1]];
    let turns = [
        [false; 3],
        [false, true, false],
        [false, false, true],
        [false, true, true],
        [true, false, false],
    ];
    let mut found = orders.into_iter().flat_map(|order| turns.map(|turned| (order, turned)));
    let (order, turned) =
        found.find(|(order, turned)| gap_mm(linkage, poses, *order, *turned) <= NEAR_MM)?;
    let moved: Vec<String> = (0..3)
        .filter(|&link| order[link] != link)
        .map(|link| format!("the markers of markers.link{} are those of link {link}", order[link]))
        .collect();
    let backwards: Vec<String> = (0..3)
        .filter(|&link| turned[link])
        .map(|link| {
            let table = order[link];
            format!(
                "link {link} points backwards: change the signs of x and y in markers.link{table}"
            )
        })
        .collect();
    let exchange = match moved.len() {
        0 => None,
        _ => Some(format!("{}: exchange these tables", moved.join(", "))),
    };
    Some(exchange.into_iter().chain(backwards).collect::<Vec<_>>().join("; "))
}

/// h and l that close the joints.
fn other_lengths(linkage: &Linkage, poses: &[[LinkPose; 3]]) -> Option<String> {
    let [h_mm, l_mm] = [linkage.joints[0].in_middle[0], -linkage.joints[0].in_outer[0]];
    let joints = [1, 2].map(|link| {
        let turn = |poses: &[LinkPose; 3]| wrap(poses[link].theta_rad - poses[0].theta_rad);
        let [low, high] = extremes(poses.iter().map(turn));
        let both = poses.iter().map(|poses| [(poses[0], poses[link])]);
        let equations = JointPosition::default().equations(both);
        let found = (high - low > LEAST_TURN_RAD).then(|| equations.solve()).flatten();
        found.map(|(moved, _)| JointPosition::default().moved(&moved))
    });
    let [Some(front), Some(rear)] = joints else { return None };
    let h = [front.in_middle[0], -rear.in_middle[0]];
    let l = [-front.in_outer[0], rear.in_outer[0]];
    let aside = [front.in_middle[1], rear.in_middle[1], front.in_outer[1], rear.in_outer[1]];
    let measured = |[front, rear]: [f64; 2]| format!("{front:.1} and {rear:.1} mm");
    let is = |pair: [f64; 2], mm: f64| pair.iter().all(|found| (found - mm).abs() <= NEAR_MM);
    let both = |pair: [f64; 2]| 0.5 * (pair[0] + pair[1]);
    if is(h, l_mm) && is(l, h_mm) {
        return Some(format!(
            "h_m and l_m are exchanged: h is measured as {}, l as {}, configured {:.1} and {:.1} mm; \
             set h_m = {:.4} and l_m = {:.4}",
            measured(h),
            measured(l),
            h_mm,
            l_mm,
            1e-3 * both(h),
            1e-3 * both(l)
        ));
    }
    let mut causes = Vec::new();
    for (name, found, configured) in [("h", h, h_mm), ("l", l, l_mm)] {
        if is(found, configured) {
            continue;
        }
        let ratio = configured / both(found);
        let unit = [(1000.0, "millimetres"), (100.0, "centimetres")]
            .into_iter()
            .find(|(factor, _)| (ratio / factor - 1.0).abs() < 0.1)
            .map_or(String::new(), |(_, unit)| format!(" (is it in {unit}?)"));
        let advice = match (found[0] - found[1]).abs() <= NEAR_MM {
            true => format!("set {name}_m = {:.4}", 1e-3 * both(found)),
            false => "the origin of a link's table in [markers] may be off its axle".to_owned(),
        };
        causes.push(format!(
            "{name}_m of the robot: measured {} at the front and rear joint, configured {configured:.1} \
             mm{unit}: {advice}",
            measured(found)
        ));
    }
    if let Some(off) = aside.iter().copied().find(|off| off.abs() > NEAR_MM) {
        causes.push(format!(
            "a joint is {off:.1} mm beside the line along its link: the links' tables in [markers] \
             are turned or have another origin"
        ));
    }
    (!causes.is_empty()).then(|| causes.join("; "))
}
