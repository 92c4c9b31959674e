//! TRC, the table of markers that OpenSim reads: tabs, one row per frame, three cells per marker,
//! empty where it was not seen. The links' axles and the joints, on the floor, are markers, too:
//! `link0` to `link2`, `joint1` and `joint2`.

use std::fmt::Write as _;

use super::Motion;

const AXLES_AND_JOINTS: [&str; 5] = ["link0", "link1", "link2", "joint1", "joint2"];

pub(super) fn write(motion: &Motion) -> String {
    let mut labels = motion.labels();
    if motion.without_poses.is_none() {
        labels.extend(AXLES_AND_JOINTS.map(str::to_owned));
    }
    let (rows, markers, rate_hz) = (motion.rows(), labels.len(), motion.rate_hz);
    let first = motion.markers.frames.first().copied().unwrap_or(1);
    let mut text = format!(
        "PathFileType\t4\t(X/Y/Z)\t{}.trc\n\
         DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n\
         {rate_hz}\t{rate_hz}\t{rows}\t{markers}\tmm\t{rate_hz}\t{first}\t{rows}\nFrame#\tTime\t",
        motion.name
    );
    // Every line ends with a tab: OpenSim takes the last cell for missing only before one.
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

fn add(text: &mut String, position_mm: [f64; 3]) {
    for value in position_mm {
        if value.is_finite() {
            write!(text, "{value:.4}").ok();
        }
        text.push('\t');
    }
}

fn axles_and_joints_mm(motion: &Motion, row: usize) -> [[f64; 3]; 5] {
    let (Some(robot), Some(links)) = (&motion.robot, motion.pose(row)) else {
        return [[f64::NAN; 3]; 5];
    };
    let [middle, front, rear] = *links;
    let joints = [middle.ahead(robot.h_m), middle.ahead(-robot.h_m)];
    [middle, front, rear, joints[0], joints[1]].map(|at| [1e3 * at.x_m, 1e3 * at.y_m, 0.0])
}
