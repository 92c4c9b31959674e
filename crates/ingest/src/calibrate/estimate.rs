//! The layout by some of a trial's rows.

use trilink_mocap::Recording;
use trilink_robot::{Robot, rotated};
use trilink_statistics::wrap;

use super::rolling;
use super::shape::Body;
use crate::markers::layout::LinkMarker;
use crate::poses::JointPosition;

/// The axis about which two rigid bodies turn, in the frames of both, and the RMS distance of the
/// two positions over the rows, mm; `None` if they do not turn against each other. Symmetrical
/// centre of rotation estimation (SCoRE, Ehrig and others 2006), in the plane.
pub fn between(
    first: &Body,
    second: &Body,
    is_used: &dyn Fn(usize) -> bool,
) -> Option<(JointPosition, f64)> {
    let fits = first.fits.iter().zip(&second.fits).enumerate().filter(|(row, _)| is_used(*row));
    let poses = fits.filter_map(|(_, (a, b))| Some((a.pose()?, b.pose()?)));
    let equations = JointPosition::default().equations(poses.map(|both| [both]));
    let (moved, _) = equations.solve()?;
    // Two equations for each row.
    let mean_square = equations.residual_squares(&moved) / (0.5 * equations.count);
    Some((JointPosition::default().moved(&moved), mean_square.sqrt()))
}

/// Links 0, 1, 2 by some of a trial's rows.
pub(super) struct LayoutEstimate {
    /// Of the markers, in their links' own frames.
    pub positions_mm: [Vec<[f64; 3]>; 3],
    pub h_mm: f64,
    /// From joint to axle by the wheels' rolling.
    pub l_mm: [f64; 2],
    /// RMS distance of the two positions of each joint, mm.
    pub joint_residual_mm: [f64; 2],
    /// Of the side links in their bodies' frames, with the axle at the robot's l.
    pub direction_rad: [f64; 2],
    /// From the middle link's direction to the one in which its wheel moves: it skids to one side
    /// where it is aslant of the others.
    pub aslant_rad: f64,
    /// By how much the side wheels then skid to the other side, which is added to their directions.
    pub skid_rad: f64,
}

impl LayoutEstimate {
    /// `None` if the rows do not determine where the joints are or where the wheels roll to.
    pub(super) fn of(
        file: &Recording,
        bodies: &[Body; 3],
        robot: &Robot,
        rate_hz: f64,
        is_used: &dyn Fn(usize) -> bool,
    ) -> Option<Self> {
        let bodies = bodies.each_ref().map(|body| body.refined(file, is_used));
        let (front, front_mm) = between(&bodies[0], &bodies[1], is_used)?;
        let (rear, rear_mm) = between(&bodies[0], &bodies[2], is_used)?;
        // The middle link lies half way between its joints and points to the front.
        let (ahead, behind) = (front.in_middle, rear.in_middle);
        let (dx, dy) = (ahead[0] - behind[0], ahead[1] - behind[1]);
        let (middle, middle_rad) = ([0, 1].map(|i| 0.5 * (ahead[i] + behind[i])), dy.atan2(dx));
        let rolling = |body: &Body, point_mm: [f64; 2]| {
            let mut velocities = rolling::velocities(body, point_mm, &file.frames, rate_hz);
            velocities.retain(|velocity| is_used(velocity.row));
            velocities
        };
        let moves_rad = rolling::direction(&rolling(&bodies[0], middle), 0.0, middle_rad)?;
        let aslant_rad = wrap(moves_rad - middle_rad);
        // Over a cycle the forces to the side are in balance.
        let [c0, c1, c2] = robot.skid_kg_s;
        let part = c0 / (c0 + c1 + c2);
        let skid_rad = if part < 1.0 { aslant_rad * part / (1.0 - part) } else { aslant_rad };
        let (mut l_mm, mut direction_rad) = ([0.0; 2], [0.0; 2]);
        for (side, joint, sign) in [(0, front, 1.0), (1, rear, -1.0)] {
            let outer = &bodies[1 + side];
            let velocities = rolling(outer, joint.in_outer);
            let turns = bodies[0].turns_to(outer).filter(|(row, _)| is_used(*row));
            let (sin, cos) = turns
                .fold((0.0, 0.0), |(sin, cos), (_, turn)| (sin + turn.sin(), cos + turn.cos()));
            let guess = f64::atan2(sin, cos) + middle_rad;
            let lever_mm = sign * 1e3 * robot.l_m;
            let direction = rolling::direction(&velocities, lever_mm, guess)?;
            direction_rad[side] = wrap(direction + skid_rad);
            l_mm[side] = sign * rolling::lever_mm(&velocities, direction, lever_mm)?;
        }
        let axes = [
            (middle, middle_rad, 0.0),
            (front.in_outer, direction_rad[0], -1e3 * robot.l_m),
            (rear.in_outer, direction_rad[1], 1e3 * robot.l_m),
        ];
        let positions_mm = [0, 1, 2].map(|link| {
            let (origin, direction, shift) = axes[link];
            let of = |marker: &LinkMarker| {
                let from_origin = [0, 1].map(|axis| marker.local_position_mm[axis] - origin[axis]);
                let [x, y] = rotated(-direction, from_origin);
                [x + shift, y, marker.height_mm]
            };
            bodies[link].markers.iter().map(of).collect()
        });
        let (h_mm, joint_residual_mm) = (0.5 * dx.hypot(dy), [front_mm, rear_mm]);
        Some(Self {
            positions_mm,
            h_mm,
            l_mm,
            joint_residual_mm,
            direction_rad,
            aslant_rad,
            skid_rad,
        })
    }
}
