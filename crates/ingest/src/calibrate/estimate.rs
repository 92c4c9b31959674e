//! Estimates the marker layout from a subset of a trial's rows.

use trilink_mocap::Recording;
use trilink_robot::{Robot, rotated};
use trilink_statistics::wrap;

use super::rolling;
use super::shape::Body;
use crate::poses::JointPosition;

/// Locates the axis about which two rigid bodies turn relative to each other, in the frames of both bodies, by the
/// symmetrical centre of rotation estimation (SCoRE, Ehrig and others 2006) in the plane. Also returns the RMS distance
/// between the two positions of the axis over the rows, mm. `None` if the bodies do not turn relative to each other.
pub fn locate_joint(
    first: &Body,
    second: &Body,
    is_used: &dyn Fn(usize) -> bool,
) -> Option<(JointPosition, f64)> {
    let fits = first.fits.iter().zip(&second.fits).enumerate().filter(|(row, _)| is_used(*row));
    let poses = fits.filter_map(|(_, (a, b))| Some((a.pose()?, b.pose()?)));
    let equations = JointPosition::default().equations(poses.map(|both| [both]));
    let (moved, _) = equations.solve()?;
    // Each row has two equations.
    let mean_square = equations.residual_squares(&moved) / (0.5 * equations.count);
    Some((JointPosition::default().moved(&moved), mean_square.sqrt()))
}

/// Layout of links 0, 1, 2 estimated from a subset of a trial's rows.
pub(super) struct LayoutEstimate {
    /// Positions of each link's markers in the link frame, mm.
    pub positions_mm: [Vec<[f64; 3]>; 3],
    /// Half the distance between the two joints, mm.
    pub h_mm: f64,
    /// Distances from joint to axle at which the wheels of the side links skid least, mm.
    pub l_mm: [f64; 2],
    /// RMS distance, over the rows, between a joint's positions according to its two links, mm.
    pub joint_residual_mm: [f64; 2],
    /// Directions of the side links in their body frames, fitted with the axle at the configured distance l from the
    /// joint.
    pub direction_rad: [f64; 2],
    /// Angle from the middle link's direction to the direction in which its wheel moves, rad. It is not zero if the
    /// wheel skids to one side because the link is oblique to the others.
    pub oblique_rad: f64,
    /// Angle by which the side wheels have to skid, in the sense opposite to the middle wheel, for the lateral forces
    /// on the robot to balance, rad. It is added to the side links' directions.
    pub skid_rad: f64,
}

impl LayoutEstimate {
    /// Estimates the layout; `None` if the rows do not determine the joints or the rolling directions.
    pub(super) fn new(
        file: &Recording,
        bodies: &[Body; 3],
        robot: &Robot,
        rate_hz: f64,
        is_used: &dyn Fn(usize) -> bool,
    ) -> Option<Self> {
        let bodies = bodies.each_ref().map(|body| body.refined(file, is_used));
        let (front, front_mm) = locate_joint(&bodies[0], &bodies[1], is_used)?;
        let (rear, rear_mm) = locate_joint(&bodies[0], &bodies[2], is_used)?;
        // The middle link lies between the two joints, in the robot's proportions, and points to the front.
        let ahead = front.in_inner;
        let behind = rear.in_inner;
        let [dx, dy] = [0, 1].map(|i| ahead[i] - behind[i]);
        let [h1, h2] = robot.h_m.map(|h_m| h_m / (robot.h_m[0] + robot.h_m[1]));
        let middle = [0, 1].map(|i| h2 * ahead[i] + h1 * behind[i]);
        let middle_rad = dy.atan2(dx);
        let rolling = |body: &Body, point_mm: [f64; 2]| {
            let mut velocities = rolling::velocities(body, point_mm, &file.frames, rate_hz);
            velocities.retain(|velocity| is_used(velocity.row));
            velocities
        };
        let moves_rad = rolling::direction(&rolling(&bodies[0], middle), 0.0, middle_rad)?;
        let oblique_rad = wrap(moves_rad - middle_rad);
        // The lateral forces balance over a cycle.
        let [c0, c1, c2] = robot.skid_kg_s;
        let share = c0 / (c0 + c1 + c2);
        let skid_rad = if share < 1.0 { oblique_rad * share / (1.0 - share) } else { oblique_rad };
        let mut l_mm = [0.0; 2];
        let mut direction_rad = [0.0; 2];
        for (side, joint, sign) in [(0, front, 1.0), (1, rear, -1.0)] {
            let outer = &bodies[1 + side];
            let velocities = rolling(outer, joint.in_outer);
            let turns = bodies[0].turns_to(outer).filter(|(row, _)| is_used(*row));
            let (sin, cos) = turns
                .fold((0.0, 0.0), |(sin, cos), (_, turn)| (sin + turn.sin(), cos + turn.cos()));
            let guess = f64::atan2(sin, cos) + middle_rad;
            let lever_mm = sign * 1e3 * robot.l_m[side];
            let direction = rolling::direction(&velocities, lever_mm, guess)?;
            direction_rad[side] = wrap(direction + skid_rad);
            l_mm[side] = sign * rolling::lever_mm(&velocities, direction, lever_mm)?;
        }
        let axes = [
            (middle, middle_rad, 0.0),
            (front.in_outer, direction_rad[0], -1e3 * robot.l_m[0]),
            (rear.in_outer, direction_rad[1], 1e3 * robot.l_m[1]),
        ];
        let positions_mm = [0, 1, 2].map(|link| {
            let (origin, direction, shift) = axes[link];
            let markers = bodies[link].markers.iter();
            markers
                .map(|marker| {
                    let from_origin =
                        [0, 1].map(|axis| marker.local_position_mm[axis] - origin[axis]);
                    let [x, y] = rotated(-direction, from_origin);
                    [x + shift, y, marker.height_mm]
                })
                .collect()
        });
        let h_mm = 0.5 * dx.hypot(dy);
        let joint_residual_mm = [front_mm, rear_mm];
        Some(Self {
            positions_mm,
            h_mm,
            l_mm,
            joint_residual_mm,
            direction_rad,
            oblique_rad,
            skid_rad,
        })
    }
}
