//! Export to Foxglove and Rerun: the links as frame transforms in the camera system's frame (`/tf`) and the visible
//! markers as point clouds (`/markers`), with Foxglove's schemas, in metres. Times are counted from the first frame.

use trilink_robot::Pose;

use super::Motion;
use super::mcap::{Channel, Message as Recorded, mcap};
use super::protobuf::Message;

/// Schema `foxglove.FrameTransforms` as a `FileDescriptorSet` (`foxglove-schemas-protobuf` 0.4, MIT).
const FRAME_TRANSFORMS: &[u8] = include_bytes!("foxglove/FrameTransforms.bin");
/// Schema `foxglove.PointCloud` as a `FileDescriptorSet` (`foxglove-schemas-protobuf` 0.4, MIT).
const POINT_CLOUD: &[u8] = include_bytes!("foxglove/PointCloud.bin");
/// Name of the camera system's frame, the parent of all links and markers.
const CAMERAS: &str = "cameras";
/// Value of `PackedElementField.NumericType.FLOAT32`.
const FLOAT32: u64 = 7;
/// Size of a coordinate in bytes.
const FLOAT32_BYTES: u32 = 4;
/// Size of a point in bytes.
const POINT_BYTES: u32 = 3 * FLOAT32_BYTES;
const NS_PER_S: f64 = 1e9;

/// Returns the content of an MCAP file for Foxglove.
pub(super) fn write(motion: &Motion) -> Vec<u8> {
    let channels = [
        Channel { topic: "/tf", schema: "foxglove.FrameTransforms", description: FRAME_TRANSFORMS },
        Channel { topic: "/markers", schema: "foxglove.PointCloud", description: POINT_CLOUD },
    ];
    let messages = (0..motion.rows()).flat_map(|row| {
        let time_ns = (NS_PER_S * motion.time_s(row)).round() as u64;
        let links = motion.pose(row).map(|[links, _]| (0, frame_transforms(links, time_ns)));
        let markers = (1, point_cloud(motion.markers.row_mm(row), time_ns));
        links.into_iter().chain([markers]).map(move |(channel, message)| Recorded {
            channel,
            sequence: row as u32,
            time_ns,
            data: message.0,
        })
    });
    mcap(&channels, messages)
}

/// Encodes a time (ns) as `google.protobuf.Timestamp`.
fn timestamp(time_ns: u64) -> Message {
    const NS: u64 = NS_PER_S as u64;
    Message::default().whole(1, time_ns / NS).whole(2, time_ns % NS)
}

/// Encodes a vector as `foxglove.Vector3`.
fn vector([x, y, z]: [f64; 3]) -> Message {
    Message::default().double(1, x).double(2, y).double(3, z)
}

/// Encodes a rotation about the vertical axis as `foxglove.Quaternion`.
fn quaternion(theta_rad: f64) -> Message {
    let (sin, cos) = (0.5 * theta_rad).sin_cos();
    vector([0.0, 0.0, sin]).double(4, cos)
}

/// Encodes the poses of the links as `foxglove.FrameTransforms`.
fn frame_transforms(poses: &[Pose], time_ns: u64) -> Message {
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

/// Encodes the visible markers as `foxglove.PointCloud`.
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
    let cloud = fields.fold(cloud, |cloud, (name, offset)| {
        let field = Message::default().bytes(1, name.as_bytes()).fixed32(2, offset);
        cloud.message(5, &field.whole(3, FLOAT32))
    });
    cloud.bytes(6, &data)
}
