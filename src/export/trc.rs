//! Export as TRC, OpenSim's marker table: tab-separated, one row per frame and three cells per marker, which are empty
//! if the marker is occluded. The wheel axles and the joints, projected onto the floor, are included as markers:
//! `link0` to `link2`, `joint1` and `joint2`.

use std::fmt::Write as _;

use super::Motion;

/// Labels of the wheel axles and joints.
const AXLES_AND_JOINTS: [&str; 5] = ["link0", "link1", "link2", "joint1", "joint2"];

/// Returns the content of a TRC file (the marker table of OpenSim).
pub(super) fn write(motion: &Motion) -> String {
    let mut labels = motion.labels();
    if motion.without_poses.is_none() {
        labels.extend(AXLES_AND_JOINTS.map(str::to_owned));
    }
    let rows = motion.rows();
    let markers = labels.len();
    let rate_hz = motion.rate_hz;
    let first = motion.markers.frames.first().copied().unwrap_or(1);
    let mut text = format!(
        "PathFileType\t4\t(X/Y/Z)\t{}.trc\n\
         DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n\
         {rate_hz}\t{rate_hz}\t{rows}\t{markers}\tmm\t{rate_hz}\t{first}\t{rows}\nFrame#\tTime\t",
        motion.name
    );
    // Every line ends with a tab: OpenSim recognises a missing last cell only if a tab follows it.
    labels.iter().for_each(|label| text.extend([label, "\t\t\t"]));
    text.push_str("\n\t\t");
    for nth in 1..=markers {
        write!(text, "X{nth}\tY{nth}\tZ{nth}\t").ok();
    }
    text.push_str("\n\n");
    for row in 0..rows {
        write!(text, "{}\t{:.6}\t", motion.markers.frames[row], motion.time_s(row)).ok();
        motion.markers.row_mm(row).iter().for_each(|position| add(&mut text, *position));
        if motion.without_poses.is_none() {
            axles_and_joints_mm(motion, row).into_iter().for_each(|at| add(&mut text, at));
        }
        text.push('\n');
    }
    text
}

/// Appends the coordinates of a marker, each followed by a tab; unknown coordinates become empty cells.
fn add(text: &mut String, position_mm: [f64; 3]) {
    for value in position_mm {
        if value.is_finite() {
            write!(text, "{value:.4}").ok();
        }
        text.push('\t');
    }
}

/// Returns the positions of the wheel axles and joints on the floor, mm; NaN where there are no poses.
fn axles_and_joints_mm(motion: &Motion, row: usize) -> [[f64; 3]; 5] {
    let (Some(robot), Some(links)) = (&motion.robot, motion.pose(row)) else {
        return [[f64::NAN; 3]; 5];
    };
    let [middle, front, rear] = *links;
    let [joint1, joint2] = robot.joints(middle);
    [middle, front, rear, joint1, joint2].map(|at| [1e3 * at.x_m, 1e3 * at.y_m, 0.0])
}
