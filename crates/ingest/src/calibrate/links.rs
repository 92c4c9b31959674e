//! Assigns markers to links without a configuration: the markers of a link move as one rigid body, and each link shares a
//! joint with the next one of the chain.
//!
//! Seen from behind, the angle of the first joint is minus that of the last one and vice versa. The two possible orders of
//! the links therefore differ in the joint motions; the commanded gait decides between them. The direction of travel does
//! not decide, because some gaits drive the robot backwards.

use trilink_mocap::Recording;
use trilink_statistics::{quantiles_low, unwrap};

use super::shape::Body;
use super::{fit_body, labels};
use crate::Command;
use crate::error::Problem;
use crate::phase::{CommandedGait, GAIT_HARMONICS, Harmonics};
use crate::poses::{JointPosition, frame_grid};

/// Number of rows, spread over the trial, that are evaluated.
const ROWS: usize = 600;
/// Minimum number of rows in which two markers must be visible together.
const MIN_ROWS: usize = 20;
/// Maximum RMS distance between the two estimates of a joint's position, one from each of the links that it connects,
/// mm.
pub const MAX_JOINT_MISFIT_MM: f64 = 5.0;
/// Maximum spread of a distance between two markers of one rigid body, mm. Noise of 0.2 mm contributes 0.3 mm; the
/// distance between markers of two links that turn by 10 degrees varies by many millimetres.
const MAX_RIGID_SPREAD_MM: f64 = 2.0;
/// Quantiles between which the spread of the distance between two markers is measured, so that swapped labels in a few
/// frames hardly affect it.
const QUANTILES: [f64; 2] = [0.1, 0.9];
/// Distance between the 0.1 and 0.9 quantiles of a standard normal distribution.
const QUANTILE_DISTANCE: f64 = 2.563;

/// Groups the columns (markers) of a file into rigid bodies of at least two markers, ordered by their first columns. A
/// column that moves rigidly with no other column is omitted. Two groups are merged if all distances between their
/// markers are constant, beginning with the least variable distances (complete linkage).
pub fn rigid_groups(file: &Recording) -> Vec<Vec<usize>> {
    let columns = 0..file.labels.len();
    let spreads: Vec<Vec<f64>> =
        columns.clone().map(|a| columns.clone().map(|b| spread_mm(file, a, b)).collect()).collect();
    let mut groups: Vec<Vec<usize>> = columns.map(|column| vec![column]).collect();
    loop {
        let nearest = (0..groups.len())
            .flat_map(|j| (0..j).map(move |i| (i, j)))
            .map(|(i, j)| (max_spread(&spreads, &groups[i], &groups[j]), i, j))
            .filter(|(spread, _, _)| *spread < MAX_RIGID_SPREAD_MM)
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

/// Returns the largest spread of the distances between markers of two groups, mm.
fn max_spread(spreads: &[Vec<f64>], one: &[usize], other: &[usize]) -> f64 {
    let pairs = one.iter().flat_map(|&a| other.iter().map(move |&b| (a, b)));
    pairs.map(|(a, b)| spreads[a][b]).fold(0.0, f64::max)
}

/// Returns the robust standard deviation of the distance between two markers, mm; infinite if the markers are visible
/// together in too few rows.
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
    if distances.len() < MIN_ROWS {
        return f64::INFINITY;
    }
    let [low, high] = quantiles_low(distances, QUANTILES);
    (high - low) / QUANTILE_DISTANCE
}

/// Locates the joint of two rigid bodies, the axis about which they turn relative to each other, in the frame of each by
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

/// RMS distances between the two positions of a joint that each pair of rigid bodies might share, mm; infinite for bodies
/// that do not turn relative to each other.
pub struct JointMisfits(Vec<Vec<f64>>);

impl JointMisfits {
    pub fn new(bodies: &[Body]) -> Self {
        let mut misfits_mm = vec![vec![f64::INFINITY; bodies.len()]; bodies.len()];
        for (a, b) in (0..bodies.len()).flat_map(|b| (0..b).map(move |a| (a, b))) {
            let joint = locate_joint(&bodies[a], &bodies[b], &|_| true);
            let misfit_mm = joint.map_or(f64::INFINITY, |(_, rms_mm)| rms_mm);
            (misfits_mm[a][b], misfits_mm[b][a]) = (misfit_mm, misfit_mm);
        }
        Self(misfits_mm)
    }

    /// Returns the indices of the bodies that form the longest chain, from one end to the other: pairs are joined in the
    /// order of their misfits, up to `max_mm`, unless a body already has two joints or the chain would close. Of several
    /// chains of this length, the one whose largest misfit is smallest. The end with the lower index comes first.
    pub fn chain(&self, max_mm: f64) -> Vec<usize> {
        let Self(misfits_mm) = self;
        let bodies = misfits_mm.len();
        let mut pairs: Vec<(usize, usize)> =
            (0..bodies).flat_map(|b| (0..b).map(move |a| (a, b))).collect();
        pairs.retain(|(a, b)| misfits_mm[*a][*b] < max_mm);
        pairs.sort_by(|(a, b), (c, d)| misfits_mm[*a][*b].total_cmp(&misfits_mm[*c][*d]));
        // Every body is at first a chain of its own. A joined chain has a larger misfit than those that it joins.
        let mut chains: Vec<Vec<usize>> = (0..bodies).map(|body| vec![body]).collect();
        let mut longest = Vec::new();
        for (a, b) in pairs {
            let with_end =
                |end| move |chain: &Vec<usize>| [chain.first(), chain.last()].contains(&Some(&end));
            let [one, other] = [a, b].map(|end| chains.iter().position(with_end(end)));
            let (Some(one), Some(other)) = (one, other) else { continue };
            if one == other {
                continue;
            }
            let mut after = chains[other].clone();
            if after.first() != Some(&b) {
                after.reverse();
            }
            let mut joined = chains[one].clone();
            if joined.last() != Some(&a) {
                joined.reverse();
            }
            joined.extend(after);
            if joined.len() > longest.len() {
                longest.clone_from(&joined);
            }
            chains.retain(|chain| !joined.contains(&chain[0]));
            chains.push(joined);
        }
        if longest.first() > longest.last() {
            longest.reverse();
        }
        longest
    }
}

/// Finds the columns of the markers of the links from front to rear by their motion; the driven joints of the command
/// determine which end is the front, unless they look the same from both ends.
pub(super) fn found_groups(
    file: &Recording,
    links: usize,
    command: Option<&Command>,
    rate_hz: f64,
) -> Result<Vec<Vec<usize>>, Problem> {
    /// Ratio of the misfits of both orders below which one is that of the command.
    const MAX_MISFIT_RATIO: f64 = 0.5;
    let groups = rigid_groups(file);
    if groups.len() < links {
        let list: Vec<String> = groups.iter().map(|group| labels(file, group).join(" ")).collect();
        let (found, list) = (groups.len(), list.join("; "));
        return Err(Problem::RigidGroups { found, list, needed: links });
    }
    let bodies: Vec<Body> =
        groups.iter().map(|group| fit_body(file, group)).collect::<Result<_, _>>()?;
    let mut chain = JointMisfits::new(&bodies).chain(MAX_JOINT_MISFIT_MM);
    if chain.len() != links {
        return Err(Problem::ShortChain { found: chain.len(), needed: links });
    }
    let driven = command.filter(|command| command.joints.iter().any(Option::is_some));
    let Some(Command { joints, omega_rad_s }) = driven else { return Err(Problem::NoFront) };
    let command = CommandedGait { joints, omega_rad_s: *omega_rad_s, rate_hz, skip_cycles: 0 };
    let (first, frames) = frame_grid(&file.frames)?;
    let misfit = |chain: &[usize]| {
        let joints = chain.windows(2).map(|pair| {
            let mut phi_rad = vec![f64::NAN; frames];
            for (row, turn) in bodies[pair[1]].turns_to(&bodies[pair[0]]) {
                phi_rad[(file.frames[row] - first) as usize] = turn;
            }
            unwrap(&mut phi_rad);
            phi_rad
        });
        command_misfit(&command, &joints.collect::<Vec<_>>())
    };
    let reversed: Vec<usize> = chain.iter().rev().copied().collect();
    let [own, of_reversed] = [&chain, &reversed].map(|chain| misfit(chain));
    if own.min(of_reversed) >= MAX_MISFIT_RATIO * own.max(of_reversed) {
        return Err(Problem::NoFront);
    }
    if of_reversed < own {
        chain = reversed;
    }
    Ok(chain.into_iter().map(|body| groups[body].clone()).collect())
}

/// Returns the sum of squared deviations of the first harmonics of the joint angles from the command, rad^2.
fn command_misfit(command: &CommandedGait, phi_rad: &[Vec<f64>]) -> f64 {
    let Ok(driven) = command.estimate_phase(phi_rad) else { return f64::INFINITY };
    let squares = phi_rad.iter().zip(command.joints).filter_map(|(phi_rad, joint)| {
        let joint = (*joint)?;
        let found = Harmonics::fit(phi_rad, driven.moving.clone(), &driven.phase, GAIT_HARMONICS)?;
        let amplitude = found.amplitude(1);
        let turn = found.phase_rad() - joint.phase_rad;
        let product = amplitude * joint.amplitude_rad * turn.cos();
        Some(amplitude.powi(2) + joint.amplitude_rad.powi(2) - 2.0 * product)
    });
    squares.sum()
}
