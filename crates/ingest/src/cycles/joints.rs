//! Contribution of the joint positions to the standard errors of the means. The joint positions are estimated from the
//! trial itself, so their error is common to all cycles and does not show in the differences between cycles.
//!
//! The contribution is estimated by the jackknife over parts of the trial. Using the joint positions estimated without
//! one part shifts the links slightly ([`JointShift`]): a wheel moves by `a` along and `b` across its link and rotates
//! by `c`. With the link's angular rate theta' and the wheel's roll velocity, the skid velocity changes by
//! `b' + a theta' - c roll`.

use std::ops::Range;

use trilink_robot::rotated;
use trilink_statistics::{mean, seen};
use trilink_tables::Coordinates;

use super::measure::CycleData;
use crate::geometry::Connection;
use crate::phase::{GAIT_HARMONICS, Harmonics};
use crate::poses::{JointShift, PARTS, PoseShift};

/// Standard errors due to the uncertainty of the joint positions, whose errors are common to all cycles of a trial.
pub(super) struct JointErrors {
    /// Standard errors of offset, amplitude and phase of each joint's first harmonic, rad.
    pub gait_rad: Vec<[f64; 3]>,
    /// Standard errors of the wheels' mean squared skid velocities, by link, m^2/s^2; zero for a link without a wheel.
    pub skid_square: Vec<f64>,
}

/// Computes the standard errors due to the uncertainty of the joint positions for the cycles in a range of frames.
pub(super) fn joint_errors(data: &CycleData, frames: &Range<usize>) -> JointErrors {
    let shifts: Vec<&JointShift> =
        data.tracked.joint_shifts.iter().filter(|shift| frames.contains(&shift.frame)).collect();
    JointErrors {
        gait_rad: (0..data.geometry.joints())
            .map(|joint| gait_shifts(data, frames, &shifts, joint).map(jackknife))
            .collect(),
        skid_square: (0..data.geometry.links.len())
            .map(|link| jackknife(skid_shifts(data, frames, &shifts, link)))
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

/// Leaves out one part of the trial at a time from the estimate of the joint positions, and returns the changes in the
/// mean squared skid velocity of a link's wheel; NaN if the link has none.
fn skid_shifts(
    data: &CycleData,
    frames: &Range<usize>,
    shifts: &[&JointShift],
    link: usize,
) -> [f64; PARTS] {
    let driven = data.driven;
    let half_rate_hz = 0.5 * data.rate_hz;
    let skid = &data.raw_wheels.skid_m_s[link];
    let fit = Harmonics::fit(skid, frames.clone(), &driven.phase, driven.shape_harmonics);
    let (Some(fit), Some(wheel)) = (fit, data.geometry.links[link].wheel) else {
        return [f64::NAN; PARTS];
    };
    let slope = fit.slope().over(frames.clone(), &driven.phase);
    let fit = fit.over(frames.clone(), &driven.phase);
    let mut path: Vec<(usize, &Connection)> = data.geometry.path(link).collect();
    path.reverse();
    let Coordinates { theta_rad, phi_rad, .. } = &data.motion.coordinates;
    let heading = |frame: usize| {
        let turns = path.iter().map(|(_, inner)| inner.sign * phi_rad[inner.joint][frame]);
        turns.fold(theta_rad[frame], |heading, turn| heading + turn)
    };
    std::array::from_fn(|part| {
        let products = shifts.iter().filter(|shift| frames.contains(&(shift.frame + 1)));
        let product = |JointShift { frame, without }: &&JointShift| {
            let PoseShift { moved_m: [mut along, mut across], turned_rad } = without[part];
            // The robot's configured lengths give the position of the wheel (eq. 1), so that each link rotates about
            // its joint with the next one towards link 0.
            for (outer, inner) in &path {
                let Connection { link, joint, sign, on_inner_m, on_outer_m } = **inner;
                let to_joint = [along, across + on_inner_m * turned_rad[link]];
                [along, across] = rotated(-sign * phi_rad[joint][*frame], to_joint);
                across += -on_outer_m * turned_rad[*outer];
            }
            let turn_rad = turned_rad[link];
            let at_wheel = [along, across + wheel.place_m * turn_rad];
            let [along, across] = rotated(-wheel.steer_rad, at_wheel);
            let turning_rad_s = (heading(frame + 1) - heading(frame - 1)) * half_rate_hz;
            let own = along * turning_rad_s - turn_rad * data.motion.wheels.roll_m_s[link][*frame];
            let i = frame - frames.start;
            // Over whole cycles, the mean product of a series with a rate is minus the mean product of the series'
            // derivative with the integrated rate.
            2.0 * (fit[i] * own - slope[i] * driven.omega_rad_s * across)
        };
        let products: Vec<f64> = products.filter(|shift| shift.frame > 0).map(product).collect();
        mean(seen(&products))
    })
}

/// Returns the jackknife standard error, given the estimates without each part; zero if one of them is NaN.
fn jackknife(without: [f64; PARTS]) -> f64 {
    let middle = mean(without);
    let squares: f64 = without.iter().map(|value| (value - middle).powi(2)).sum();
    ((PARTS - 1) as f64 / PARTS as f64 * squares).sqrt().max(0.0)
}
