//! Which markers are a link's if the configuration does not say it: those that move rigidly
//! together. The middle link has a joint with both others.
//!
//! Seen from behind, the front joint's angle is minus the rear one's and the other way round. So
//! the two ways to name the side links differ in which joint does what, and in which of them is
//! ahead: the one that the commanded gait fits better is right. The direction in which the robot
//! moves does not decide: some gaits drive it backwards.

use trilink_mocap::Recording;
use trilink_robot::JointCommand;
use trilink_statistics::{quantiles_low, unwrap};

use super::estimate::between;
use super::shape::Body;
use crate::error::Problem;
use crate::phase::{CommandedGait, GAIT_HARMONICS, Harmonics};
use crate::poses::frame_grid;

/// Rows that are looked at, spread over the trial.
const ROWS: usize = 600;
/// Rows in which two markers must be seen together.
const LEAST_ROWS: usize = 20;
/// A distance that changes by less than this is rigid, mm. Noise of 0.2 mm makes 0.3; markers
/// of two links that turn by ten degrees change theirs by many millimetres.
const RIGID_MM: f64 = 2.0;
/// The middle part of the distances that counts, and its width for normal deviates of unit
/// deviation: swapped labels in a few frames do not matter.
const QUANTILES: [f64; 2] = [0.1, 0.9];
const WIDTH: f64 = 2.563;

/// Groups of the columns of a file, each of two at least and rigid, by their first column; other
/// columns are in no group. Two groups join if all distances between them are constant, the most
/// constant first (complete linkage).
pub fn rigid_groups(file: &Recording) -> Vec<Vec<usize>> {
    let columns = 0..file.labels.len();
    let spread = |a: usize| columns.clone().map(move |b| spread_mm(file, a, b)).collect();
    let spreads: Vec<Vec<f64>> = columns.clone().map(spread).collect();
    let mut groups: Vec<Vec<usize>> = columns.map(|column| vec![column]).collect();
    loop {
        let apart = |i: usize, j: usize| {
            let pairs = groups[i].iter().flat_map(|&a| groups[j].iter().map(move |&b| (a, b)));
            pairs.map(|(a, b)| spreads[a][b]).fold(0.0, f64::max)
        };
        let nearest = (0..groups.len())
            .flat_map(|j| (0..j).map(move |i| (i, j)))
            .map(|(i, j)| (apart(i, j), i, j))
            .filter(|(apart, _, _)| *apart < RIGID_MM)
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, i, j)) = nearest else { break };
        let joined = groups.remove(j);
        groups[i].extend(joined);
    }
    groups.retain(|group| group.len() >= 2);
    groups.iter_mut().for_each(|group| group.sort_unstable());
    groups.sort();
    groups
}

/// Robust standard deviation of the distance of two markers; infinite if they are hardly ever
/// seen together.
fn spread_mm(file: &Recording, a: usize, b: usize) -> f64 {
    if a == b {
        return 0.0;
    }
    let stride = (file.frames.len() / ROWS).max(1);
    let distances: Vec<f64> = (0..file.frames.len())
        .step_by(stride)
        .map(|row| {
            let [p, q] = [a, b].map(|column| file.position_mm(row, column));
            (p[0] - q[0]).hypot(p[1] - q[1])
        })
        .filter(|distance| !distance.is_nan())
        .collect();
    if distances.len() < LEAST_ROWS {
        return f64::INFINITY;
    }
    let [low, high] = quantiles_low(distances, QUANTILES);
    (high - low) / WIDTH
}

/// The bodies with the middle link first, and then the one in front, as far as there is a commanded
/// gait.
pub fn in_order(
    file: &Recording,
    mut bodies: [Body; 3],
    command: Option<CommandedGait>,
) -> Result<[Body; 3], Problem> {
    let misfit = |a: usize, b: usize| {
        between(&bodies[a], &bodies[b], &|_| true)
            .map(|(_, residual_mm)| residual_mm)
            .ok_or(Problem::NoLayout)
    };
    let apart = [misfit(1, 2)?, misfit(0, 2)?, misfit(0, 1)?];
    let middle = (0..3).max_by(|&a, &b| apart[a].total_cmp(&apart[b])).unwrap_or(0);
    bodies.swap(0, middle);
    let Some(command) = command else { return Ok(bodies) };
    let (first, frames) = frame_grid(&file.frames)?;
    let misfit = |front: usize, rear: usize| {
        let phi_rad = [(0, front), (rear, 0)].map(|(a, b)| {
            let mut phi_rad = vec![f64::NAN; frames];
            for (row, turn) in bodies[a].turns_to(&bodies[b]) {
                phi_rad[(file.frames[row] - first) as usize] = turn;
            }
            unwrap(&mut phi_rad);
            phi_rad
        });
        off_command(&command, &phi_rad)
    };
    if misfit(2, 1) < misfit(1, 2) {
        bodies.swap(1, 2);
    }
    Ok(bodies)
}

/// How far the first harmonics of two joints are from the command, rad^2.
fn off_command(command: &CommandedGait, phi_rad: &[Vec<f64>; 2]) -> f64 {
    let Ok(driven) = command.estimate_phase(phi_rad) else { return f64::INFINITY };
    let off = |(phi_rad, joint): (&Vec<f64>, _)| -> Option<f64> {
        let joint: JointCommand = joint?;
        let found = Harmonics::fit(phi_rad, driven.moving.clone(), &driven.phase, GAIT_HARMONICS)?;
        let (amplitude, turn) = (found.amplitude(1), found.phase_rad() - joint.phase_rad);
        let product = amplitude * joint.amplitude_rad * turn.cos();
        Some(amplitude.powi(2) + joint.amplitude_rad.powi(2) - 2.0 * product)
    };
    phi_rad.iter().zip(command.gait.joints).filter_map(off).sum()
}
