//! Errors that are common to all cycles of a trial, and that therefore do not show in the differences between cycles.
//!
//! - The joint positions are estimated from the trial itself. Their contribution is estimated by the delete-a-group
//!   jackknife over parts of the trial, which shifts the links slightly ([`JointShift`]).
//! - The mean tilt of link 0 on its suspension displaces its markers from the wheels ([`Constant::tilt_shifts`]). The
//!   displacements of the other links are absorbed by the refined joint positions; the small changes in their headings
//!   are neglected, and so is the tilt of its neighbours if link 0 has no markers.
//!
//! If a wheel is displaced by (a, b) along and across its rolling direction and its heading changes by c, its skid
//! velocity changes, to first order, by db/dt + a theta' - c times the roll velocity, where theta' is the link's angular
//! rate. The mean squared skid velocity changes by twice the mean product of this change and the skid velocity. Over whole
//! cycles, the mean product of the skid velocity and db/dt is minus that of b and the derivative of the skid velocity,
//! which is omega times its derivative by the phase.
//!
//! [`Constant::tilt_shifts`]: crate::poses::Constant::tilt_shifts

use std::ops::Range;

use trilink_robot::rotated;
use trilink_statistics::mean;
use trilink_tables::Coordinates;

use super::measure::CycleData;
use crate::geometry::{Connection, WheelPlace};
use crate::phase::{GAIT_HARMONICS, Harmonics};
use crate::poses::{JointShift, PARTS, PoseShift};

/// Standard errors due to errors that are common to all cycles of a trial.
pub(super) struct CommonErrors {
    /// Standard errors of offset, amplitude and phase of each joint's first harmonic, rad.
    pub gait_se_rad: Vec<[f64; 3]>,
    /// Standard errors of the wheels' mean squared skid velocities, by link, m^2/s^2; zero for a link without a wheel.
    pub skid_square_se: Vec<f64>,
}

/// Computes the standard errors for the cycles in a range of frames.
pub(super) fn common_errors(data: &CycleData, frames: &Range<usize>) -> CommonErrors {
    let shifts: Vec<&JointShift> =
        data.tracked.joint_shifts.iter().filter(|shift| frames.contains(&shift.frame)).collect();
    CommonErrors {
        gait_se_rad: (0..data.geometry.joints())
            .map(|joint| gait_shifts(data, frames, &shifts, joint).map(jackknife))
            .collect(),
        skid_square_se: (0..data.geometry.links.len())
            .map(|link| {
                let Some(response) = SkidResponse::new(data, frames, link) else { return 0.0 };
                let without = std::array::from_fn(|part| {
                    response.change(shifts.iter().map(|shift| (shift.frame, &shift.without[part])))
                });
                let [about_x, about_y] = data
                    .tracked
                    .constant
                    .tilt_shifts
                    .map(|shift| response.change(frames.clone().map(|frame| (frame, &shift))));
                jackknife(without).hypot(about_x.hypot(about_y).max(0.0))
            })
            .collect(),
    }
}

/// Returns, for each part of the trial, the changes in offset, amplitude and phase of a joint's first harmonic if the
/// joint positions are estimated without this part.
fn gait_shifts(
    data: &CycleData,
    frames: &Range<usize>,
    shifts: &[&JointShift],
    joint: usize,
) -> [[f64; PARTS]; 3] {
    let phase = &data.driven.phase;
    let phi_rad = &data.tracked.seen.phi_rad[joint];
    let first = Harmonics::fit(phi_rad, frames.clone(), phase, GAIT_HARMONICS);
    let Some(first) = first else { return [[f64::NAN; PARTS]; 3] };
    let [ahead, behind] = [joint, joint + 1].map(|place| data.geometry.order[place]);
    let weights: [&dyn Fn(f64) -> f64; 3] =
        [&|_| 1.0, &|phase| 2.0 * phase.cos(), &|phase| -2.0 * phase.sin() / first.amplitude(1)];
    weights.map(|weight| {
        std::array::from_fn(|part| {
            mean(shifts.iter().map(|JointShift { frame, without }| {
                let PoseShift { turned_rad, .. } = without[part];
                let turned_rad = turned_rad[behind] - turned_rad[ahead];
                turned_rad * weight(phase.at(*frame as f64) + first.phase_rad())
            }))
        })
    })
}

/// Response of a wheel's mean squared skid velocity to displacements of the links.
struct SkidResponse<'a> {
    data: &'a CycleData<'a>,
    frames: Range<usize>,
    link: usize,
    wheel: WheelPlace,
    /// Connections from link 0 outwards to the wheel's link.
    path: Vec<(usize, &'a Connection)>,
    /// Skid velocity, m/s, and its derivative by the phase, m/s/rad, in each of the frames.
    skid_m_s: Vec<f64>,
    slope_m_s: Vec<f64>,
}

impl<'a> SkidResponse<'a> {
    /// Returns `None` if the link has no wheel or its skid velocity is not known.
    fn new(data: &'a CycleData, frames: &Range<usize>, link: usize) -> Option<Self> {
        let driven = data.driven;
        let skid_m_s = &data.raw_wheels.skid_m_s[link];
        let fit = Harmonics::fit(skid_m_s, frames.clone(), &driven.phase, driven.shape_harmonics)?;
        let mut path: Vec<(usize, &Connection)> = data.geometry.path(link).collect();
        path.reverse();
        Some(Self {
            data,
            frames: frames.clone(),
            link,
            wheel: data.geometry.links[link].wheel?,
            path,
            skid_m_s: fit.over(frames.clone(), &driven.phase),
            slope_m_s: fit.slope().over(frames.clone(), &driven.phase),
        })
    }

    /// Returns the heading of the wheel's link in a frame, rad.
    fn heading(&self, frame: usize) -> f64 {
        let Coordinates { theta_rad, phi_rad, .. } = &self.data.motion.coordinates;
        let turns = self.path.iter().map(|(_, inner)| inner.sign * phi_rad[inner.joint][frame]);
        turns.fold(theta_rad[frame], |heading, turn| heading + turn)
    }

    /// Returns the change in the mean squared skid velocity, m^2/s^2, given the displacements in some frames.
    fn change<'s>(&self, shifts: impl Iterator<Item = (usize, &'s PoseShift)>) -> f64 {
        let inner = self.frames.start.max(1)..self.frames.end.saturating_sub(1);
        let changes = shifts
            .filter(|(frame, _)| inner.contains(frame))
            .map(|(frame, shift)| self.change_in(frame, shift));
        mean(changes.filter(|change| !change.is_nan()))
    }

    /// Returns the change in the squared skid velocity in a frame, m^2/s^2, up to a term whose mean over whole cycles is
    /// zero.
    fn change_in(&self, frame: usize, shift: &PoseShift) -> f64 {
        let Self { data, link, wheel, .. } = *self;
        let PoseShift { moved_m: [mut along, mut across], turned_rad } = *shift;
        // The robot's configured lengths give the position of the wheel (eq. 1), so that each link rotates about its
        // joint with the next one towards link 0.
        for (outer, inner) in &self.path {
            let Connection { link, joint, sign, on_inner_m, on_outer_m } = **inner;
            let to_joint = [along, across + on_inner_m * turned_rad[link]];
            let phi_rad = data.motion.coordinates.phi_rad[joint][frame];
            [along, across] = rotated(-sign * phi_rad, to_joint);
            across += -on_outer_m * turned_rad[*outer];
        }
        let turn_rad = turned_rad[link];
        let at_wheel = [along, across + wheel.place_m * turn_rad];
        let [along, across] = rotated(-wheel.steer_rad, at_wheel);
        let turning_rad_s =
            (self.heading(frame + 1) - self.heading(frame - 1)) * 0.5 * data.rate_hz;
        let own = along * turning_rad_s - turn_rad * data.motion.wheels.roll_m_s[link][frame];
        let i = frame - self.frames.start;
        2.0 * (self.skid_m_s[i] * own - self.slope_m_s[i] * data.driven.omega_rad_s * across)
    }
}

/// Returns the jackknife standard error, given the estimates without each part; zero if one of them is NaN.
fn jackknife(without: [f64; PARTS]) -> f64 {
    let middle = mean(without);
    let squares: f64 = without.iter().map(|value| (value - middle).powi(2)).sum();
    ((PARTS - 1) as f64 / PARTS as f64 * squares).sqrt().max(0.0)
}
