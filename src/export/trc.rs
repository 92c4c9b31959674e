//! Export as TRC, OpenSim's marker table. The wheel axles and the joints, projected onto the floor, are included as
//! markers: `link0` to `link2`, `joint1` and `joint2`.

use trilink_mocap::{Recording, trc_bytes};

use super::Motion;

/// Labels of the wheel axles and joints.
const AXLES_AND_JOINTS: [&str; 5] = ["link0", "link1", "link2", "joint1", "joint2"];

/// Returns the content of a TRC file.
pub(super) fn write(motion: &Motion) -> Vec<u8> {
    let has_poses = motion.without_poses.is_none();
    let mut labels = motion.labels();
    let mut positions_mm = Vec::new();
    for row in 0..motion.rows() {
        positions_mm.extend_from_slice(motion.markers.row_mm(row));
        if has_poses {
            positions_mm.extend(axles_and_joints_mm(motion, row));
        }
    }
    if has_poses {
        labels.extend(AXLES_AND_JOINTS.map(str::to_owned));
    }
    let frames = motion.markers.frames.clone();
    trc_bytes(&motion.name, &Recording::new(Some(motion.rate_hz), frames, labels, positions_mm))
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
