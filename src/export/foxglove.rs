//! A trial as Foxglove and Rerun know one: the links as frame transforms in the cameras' frame
//! (`/tf`), the markers that were seen as point clouds (`/markers`), by Foxglove's own schemas, in
//! metres. Times are since the first frame.

use trilink_robot::Pose;

use super::Motion;
use super::mcap::{Channel, Message as Recorded, mcap};
use super::protobuf::Message;

/// Foxglove's schemas as Protocol Buffers describe them (`foxglove-schemas-protobuf` 0.4, MIT).
const FRAME_TRANSFORMS: &[u8] = include_bytes!("foxglove/FrameTransforms.bin");
const POINT_CLOUD: &[u8] = include_bytes!("foxglove/PointCloud.bin");
/// The frame that all is in.
const CAMERAS: &str = "cameras";
/// `PackedElementField.NumericType.FLOAT32`, its size, and a point's.
const FLOAT32: u64 = 7;
const FLOAT32_BYTES: u32 = 4;
const POINT_BYTES: u32 = 3 * FLOAT32_BYTES;
const NS_PER_S: f64 = 1e9;

pub(super) fn write(motion: &Motion) -> Vec<u8> {
    let channels = [
        Channel { topic: "/tf", schema: "foxglove.FrameTransforms", description: FRAME_TRANSFORMS },
        Channel { topic: "/markers", schema: "foxglove.PointCloud", description: POINT_CLOUD },
    ];
    let of_row = |row: usize| {
        let time_ns = (NS_PER_S * motion.time_s(row)).round() as u64;
        let sequence = row as u32;
        let message =
            move |channel, of: Message| Recorded { channel, sequence, time_ns, data: of.0 };
        let links = motion.pose(row).map(|poses| message(0, frame_transforms(poses, time_ns)));
        let markers = message(1, point_cloud(motion.markers.row_mm(row), time_ns));
        links.into_iter().chain([markers])
    };
    mcap(&channels, (0..motion.rows()).flat_map(of_row))
}

fn timestamp(time_ns: u64) -> Message {
    const NS: u64 = NS_PER_S as u64;
    Message::default().whole(1, time_ns / NS).whole(2, time_ns % NS)
}

fn vector([x, y, z]: [f64; 3]) -> Message {
    Message::default().double(1, x).double(2, y).double(3, z)
}

/// A turn about the vertical.
fn quaternion(theta_rad: f64) -> Message {
    let (sin, cos) = (0.5 * theta_rad).sin_cos();
    vector([0.0, 0.0, sin]).double(4, cos)
}

fn frame_transforms(poses: &[Pose; 3], time_ns: u64) -> Message {
    let all = poses.iter().enumerate();
    all.fold(Message::default(), |message, (link, pose)| {
        let transform = Message::default()
            .message(1, &timestamp(time_ns))
            .bytes(2, CAMERAS.as_bytes())
            .bytes(3, format!("link{link}").as_bytes())
            .message(4, &vector([pose.x_m, pose.y_m, 0.0]))
            .message(5, &quaternion(pose.theta_rad));
        message.message(1, &transform)
    })
}

fn point_cloud(positions_mm: &[[f64; 3]], time_ns: u64) -> Message {
    let origin = Message::default().message(1, &vector([0.0; 3])).message(2, &quaternion(0.0));
    let seen = positions_mm.iter().filter(|at| at.iter().all(|value| value.is_finite()));
    let data: Vec<u8> =
        seen.flatten().flat_map(|value| ((1e-3 * value) as f32).to_le_bytes()).collect();
    let cloud = Message::default()
        .message(1, &timestamp(time_ns))
        .bytes(2, CAMERAS.as_bytes())
        .message(3, &origin)
        .fixed32(4, POINT_BYTES);
    let fields = ["x", "y", "z"].into_iter().zip((0..).step_by(FLOAT32_BYTES as usize));
    let field = |cloud: Message, (name, offset): (&str, u32)| {
        let field = Message::default().bytes(1, name.as_bytes()).fixed32(2, offset);
        cloud.message(5, &field.whole(3, FLOAT32))
    };
    fields.fold(cloud, field).bytes(6, &data)
}
