//! Export as TRC, OpenSim's marker table. The origins of the links (the wheel axles of a robot of three links) and the
//! joints, projected onto the floor, are included as markers: `link0`, `link1`, .. and `joint1`, `joint2`, ..

use trilink_mocap::{Recording, trc_bytes};

use super::Motion;

/// Returns the content of a TRC file.
pub(super) fn write(motion: &Motion) -> Vec<u8> {
    let [links, joints] = motion.parts();
    let mut labels = motion.labels();
    labels.extend((0..links).map(|link| format!("link{link}")));
    labels.extend((1..=joints).map(|joint| format!("joint{joint}")));
    let mut positions_mm = Vec::new();
    for row in 0..motion.rows() {
        positions_mm.extend_from_slice(motion.markers.row_mm(row));
        match motion.pose(row) {
            Some(poses) => {
                let places = poses.iter().flatten();
                positions_mm.extend(places.map(|at| [1e3 * at.x_m, 1e3 * at.y_m, 0.0]));
            }
            None => positions_mm.extend(std::iter::repeat_n([f64::NAN; 3], links + joints)),
        }
    }
    let frames = motion.markers.frames.clone();
    trc_bytes(&motion.name, &Recording::new(Some(motion.rate_hz), frames, labels, positions_mm))
}
