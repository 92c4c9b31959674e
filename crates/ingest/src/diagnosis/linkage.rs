//! Checks whether the links are connected as the lengths h and l require and, if not, finds the likely mistake.

use trilink_statistics::{extremes, mean, wrap};
use trilink_tables::config::MarkerLayout;

use crate::checks::{Check, Finding};
use crate::markers::rigid::LinkPose;
use crate::poses::{Constant, JointPosition, Linkage};

/// Maximum distance of a joint from the position that h and l give, mm.
const MAX_GAP_MM: f64 = 5.0;
/// Minimum range of a joint angle at which h and l can be determined separately, not only their sum, rad.
const MIN_TURN_RAD: f64 = 0.17;

/// Checks whether the joints are where the robot's h and l place them. The finding is an error if the cause is known.
/// `None` if the joint positions have not been estimated.
pub(crate) fn check_linkage(
    linkage: &Linkage,
    constant: &Constant,
    layout: &MarkerLayout,
) -> Option<Finding> {
    let found = constant.joints?;
    let mm = linkage.distance_mm(&found);
    let cause = if mm > MAX_GAP_MM { cause(linkage, &constant.own_poses) } else { None };
    let implied = match linkage.is_of_paper() {
        true => "the position that the robot's h_m and l_m imply",
        false => "its configured position",
    };
    let message = format!("a joint is {mm:.2} mm from {implied}");
    let finding = |message| Finding::at_most(Check::JointPositions, mm, message);
    Some(match cause {
        Some(cause) => finding(format!("{message}: {cause}")).failing(),
        None if mm > Check::JointPositions.limit() => {
            finding(format!("{message}: {}", farthest(linkage, &found, layout)))
        }
        None => finding(message),
    })
}

/// Describes the joint that is farthest from where h and l place it, and the changes to h and l that would correct it.
fn farthest(linkage: &Linkage, found: &Linkage, layout: &MarkerLayout) -> String {
    let configured: Vec<[f64; 2]> = linkage.ends().collect();
    let found: Vec<[f64; 2]> = found.ends().collect();
    let offsets: Vec<[f64; 2]> = found
        .iter()
        .zip(&configured)
        .map(|(found, configured)| [0, 1].map(|axis| found[axis] - configured[axis]))
        .collect();
    let end = (0..offsets.len())
        .max_by(|&a, &b| {
            let [a, b] = [a, b].map(|end| offsets[end][0].hypot(offsets[end][1]));
            a.total_cmp(&b)
        })
        .unwrap_or(0);
    let (joint, side) = (end / 2, end % 2);
    let link = linkage.links_of(joint)[side];
    let [x, y] = found[end];
    let (length, length_mm) = match linkage.is_of_paper() {
        true => (["h_m", "l_m"][side], x.abs()),
        false if linkage.order()[joint] == link => ("rear_joint_m", -x),
        false => ("front_joint_m", x),
    };
    let joint = joint + 1;
    let [along, aside] = offsets[end];
    let [x0, y0] = configured[end];
    let change = if along.abs() > aside.abs() {
        format!("set {length} = {:.4} or add {:.1} mm to every x", 1e-3 * length_mm, -along)
    } else {
        let turn_deg = -(y / x).atan().to_degrees();
        format!("rotate the positions by {turn_deg:.1} degrees or add {:.1} mm to every y", -aside)
    };
    format!(
        "joint {joint} is measured at x = {x:.1}, y = {y:.1} mm in the frame of link {link}, but configured at x = \
         {x0:.1}, y = {y0:.1} mm: {change} in {}, whichever is correct for the robot",
        layout.table_of(link)
    )
}

/// Returns the likely reason why joints are not where h and l place them, from link poses fitted separately to each
/// link's markers; `None` if no reason is found.
fn cause(linkage: &Linkage, poses: &[Vec<LinkPose>]) -> Option<String> {
    if !linkage.is_of_paper()
        || poses.is_empty()
        || gap_mm(linkage, poses, [0, 1, 2], [false; 3]) <= MAX_GAP_MM
    {
        return None;
    }
    other_links(linkage, poses).or_else(|| other_lengths(linkage, poses))
}

/// Returns the RMS distance between the positions of each joint according to its two links, mm. It is assumed that the
/// poses of links 0, 1, 2 are actually those of the links in `order`, and that the links marked in `turned` point
/// backwards.
fn gap_mm(linkage: &Linkage, poses: &[Vec<LinkPose>], order: [usize; 3], turned: [bool; 3]) -> f64 {
    let squares = poses.iter().flat_map(|poses| {
        let at = |link: usize, [x, y]: [f64; 2]| {
            let sign = if turned[link] { -1.0 } else { 1.0 };
            poses[order[link]].at([sign * x, sign * y])
        };
        linkage.joints().iter().zip(1..).map(move |(joint, link)| {
            let a = at(0, joint.in_inner);
            let b = at(link, joint.in_outer);
            (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
        })
    });
    mean(squares).sqrt()
}

/// Describes which links are swapped or point backwards, if this explains why adjacent links do not meet at their
/// joints; otherwise `None`.
fn other_links(linkage: &Linkage, poses: &[Vec<LinkPose>]) -> Option<String> {
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
        found.find(|(order, turned)| gap_mm(linkage, poses, *order, *turned) <= MAX_GAP_MM)?;
    let moved: Vec<String> = (0..3)
        .filter(|&link| order[link] != link)
        .map(|link| format!("markers.link{} lists the markers of link {link}", order[link]))
        .collect();
    let backwards: Vec<String> = (0..3)
        .filter(|&link| turned[link])
        .map(|link| {
            let table = order[link];
            format!(
                "link {link} points backwards: reverse the signs of x and y in markers.link{table}"
            )
        })
        .collect();
    let exchange = match moved.len() {
        0 => None,
        _ => Some(format!(
            "{}: rename each of these tables after the link whose markers it lists",
            moved.join(", ")
        )),
    };
    Some(exchange.into_iter().chain(backwards).collect::<Vec<_>>().join("; "))
}

/// Formats the lengths, mm, measured at the front and at the rear joint.
fn in_words([front, rear]: [f64; 2]) -> String {
    format!("{front:.1} and {rear:.1} mm")
}

fn is_near(pair: [f64; 2], mm: f64) -> bool {
    pair.iter().all(|found| (found - mm).abs() <= MAX_GAP_MM)
}

fn midpoint(pair: [f64; 2]) -> f64 {
    0.5 * (pair[0] + pair[1])
}

/// Describes the values of h and l, or the offset of marker positions, that explain why adjacent links do not meet at
/// their joints; `None` if there is no such explanation.
fn other_lengths(linkage: &Linkage, poses: &[Vec<LinkPose>]) -> Option<String> {
    let JointPosition { in_inner, in_outer } = linkage.joints()[0];
    let [h_mm, l_mm] = [in_inner[0], -in_outer[0]];
    let joints = [1, 2].map(|link| {
        let turns = poses.iter().map(|poses| wrap(poses[link].theta_rad - poses[0].theta_rad));
        let [low, high] = extremes(turns);
        if high - low <= MIN_TURN_RAD {
            return None;
        }
        let both = poses.iter().map(|poses| [(poses[0], poses[link])]);
        let (moved, _) = JointPosition::default().equations(both).solve()?;
        Some(JointPosition::default().moved(&moved))
    });
    let [Some(front), Some(rear)] = joints else { return None };
    let h = [front.in_inner[0], -rear.in_inner[0]];
    let l = [-front.in_outer[0], rear.in_outer[0]];
    let aside = [front.in_inner[1], rear.in_inner[1], front.in_outer[1], rear.in_outer[1]];
    if is_near(h, l_mm) && is_near(l, h_mm) {
        return Some(format!(
            "h_m and l_m are swapped: h is measured as {}, and l as {}, but they are configured as {:.1} and {:.1} \
             mm; set h_m = {:.4} and l_m = {:.4}",
            in_words(h),
            in_words(l),
            h_mm,
            l_mm,
            1e-3 * midpoint(h),
            1e-3 * midpoint(l)
        ));
    }
    let mut causes = Vec::new();
    for (name, found, configured) in [("h", h, h_mm), ("l", l, l_mm)] {
        if is_near(found, configured) {
            continue;
        }
        let ratio = configured / midpoint(found);
        let unit = [(1000.0, "millimetres"), (100.0, "centimetres")]
            .into_iter()
            .find(|(factor, _)| (ratio / factor - 1.0).abs() < 0.1)
            .map_or(String::new(), |(_, unit)| format!(" (is this value in {unit}?)"));
        let advice = if (found[0] - found[1]).abs() <= MAX_GAP_MM {
            format!("set {name}_m = {:.4}", 1e-3 * midpoint(found))
        } else {
            "perhaps the origin of the marker coordinates in one of the [markers] tables is not on the axle of its \
             link"
                .to_owned()
        };
        causes.push(format!(
            "{name}_m of the robot: measured {} at the front and rear joints, configured {configured:.1} mm{unit}: \
             {advice}",
            in_words(found)
        ));
    }
    if let Some(off) = aside.iter().copied().find(|off| off.abs() > MAX_GAP_MM) {
        causes.push(format!(
            "a joint is {off:.1} mm off the centre line of its link: the positions in one of the [markers] tables are \
             rotated or have the wrong origin"
        ));
    }
    (!causes.is_empty()).then(|| causes.join("; "))
}
