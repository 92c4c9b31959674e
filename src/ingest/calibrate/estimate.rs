//! The layout by some of a trial's rows.

use super::joint::Joint;
use super::rolling;
use super::shape::Body;
use crate::ingest::markers::layout::LinkMarker;
use crate::robot::{Robot, rotated};
use crate::vicon::MarkerFile;

/// The middle link's own frame in that of its body.
pub(super) struct Middle {
    pub origin_mm: [f64; 2],
    pub direction_rad: f64,
    pub h_mm: f64,
    pub joints: [Joint; 2],
}

impl Middle {
    /// Half way between the joints with the second and the third body, and towards the second.
    pub fn of(bodies: &[Body; 3], is_used: &dyn Fn(usize) -> bool) -> Option<Self> {
        let joint = |side: usize| Joint::between(&bodies[0], &bodies[1 + side], is_used);
        let joints = [joint(0)?, joint(1)?];
        let [front, rear] = joints.map(|joint| joint.in_first);
        let (dx, dy) = (front[0] - rear[0], front[1] - rear[1]);
        Some(Self {
            origin_mm: [0, 1].map(|axis| 0.5 * (front[axis] + rear[axis])),
            direction_rad: dy.atan2(dx),
            h_mm: 0.5 * dx.hypot(dy),
            joints,
        })
    }
}

/// Links 0, 1, 2 by some of a trial's rows.
pub(super) struct LayoutEstimate {
    /// Of the markers, in their links' own frames.
    pub positions_mm: [Vec<[f64; 3]>; 3],
    pub h_mm: f64,
    /// From joint to axle by the wheels' rolling.
    pub l_mm: [f64; 2],
    pub joints: [Joint; 2],
    /// Of the side links in their bodies' frames, with the axle at the robot's l.
    pub direction_rad: [f64; 2],
}

impl LayoutEstimate {
    /// `None` if the rows do not determine where the joints are or where the wheels roll to.
    pub fn of(
        file: &MarkerFile,
        bodies: &[Body; 3],
        robot: &Robot,
        rate_hz: f64,
        is_used: &dyn Fn(usize) -> bool,
    ) -> Option<Self> {
        let bodies = bodies.each_ref().map(|body| body.refined(file, is_used));
        let middle = Middle::of(&bodies, is_used)?;
        let (mut l_mm, mut direction_rad) = ([0.0; 2], [0.0; 2]);
        for (side, sign) in [(0, 1.0), (1, -1.0)] {
            let outer = &bodies[1 + side];
            let joint = middle.joints[side].in_second;
            let mut velocities = rolling::velocities(outer, joint, &file.frames, rate_hz);
            velocities.retain(|velocity| is_used(velocity.row));
            let guess = mean_turn(&bodies[0], outer, is_used) + middle.direction_rad;
            let lever_mm = sign * 1e3 * robot.l_m;
            let direction = rolling::direction(&velocities, lever_mm, guess)?;
            direction_rad[side] = direction;
            l_mm[side] = sign * rolling::lever_mm(&velocities, direction, lever_mm)?;
        }
        let axes = [
            (middle.origin_mm, middle.direction_rad, 0.0),
            (middle.joints[0].in_second, direction_rad[0], -1e3 * robot.l_m),
            (middle.joints[1].in_second, direction_rad[1], 1e3 * robot.l_m),
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
        Some(Self { positions_mm, h_mm: middle.h_mm, l_mm, joints: middle.joints, direction_rad })
    }
}

/// Mean angle from the outer body's frame to the middle one's, rad.
fn mean_turn(middle: &Body, outer: &Body, is_used: &dyn Fn(usize) -> bool) -> f64 {
    let both = middle.fits.iter().zip(&outer.fits).enumerate().filter(|(row, _)| is_used(*row));
    let turns = both.filter_map(|(_, (a, b))| Some(a.pose?.theta_rad - b.pose?.theta_rad));
    let (sin, cos) =
        turns.fold((0.0, 0.0), |(sin, cos), turn| (sin + turn.sin(), cos + turn.cos()));
    sin.atan2(cos)
}
