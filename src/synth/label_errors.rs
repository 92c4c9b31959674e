//! Markers that are not where their labels say: swapped with another of the link, or jumped.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

/// How far a marker jumps, mm.
const JUMP_MM: f64 = 20.0;

/// A frame in which a marker is not where its label says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct LabelError {
    /// Number of the frame in the marker file.
    pub frame: usize,
    pub link: usize,
    /// Whether two labels were swapped; else one marker jumped.
    pub swapped: bool,
}

/// Puts a label error into a part of the frames: half of them get two labels of one link swapped, in the others a marker jumps by [`JUMP_MM`] in some direction of the plane.
/// Where fewer than two markers of the link were seen the frame is left alone: such a link has
/// no pose. `links` are those of the markers in their order.
pub(super) fn add_label_errors(
    positions_mm: &mut [Option<[f64; 3]>],
    links: &[usize],
    first_frame: usize,
    part: f64,
    random: &mut ChaCha8Rng,
) -> Vec<LabelError> {
    let mut errors = Vec::new();
    for (frame, markers) in (first_frame..).zip(positions_mm.chunks_exact_mut(links.len())) {
        if random.random::<f64>() >= part {
            continue;
        }
        let link = random.random_range(0..3);
        let seen: Vec<usize> =
            (0..links.len()).filter(|&i| links[i] == link && markers[i].is_some()).collect();
        if seen.len() < 2 {
            continue;
        }
        let first = random.random_range(0..seen.len());
        let swapped = random.random::<bool>();
        if swapped {
            let second = (first + random.random_range(1..seen.len())) % seen.len();
            markers.swap(seen[first], seen[second]);
        } else if let Some(position) = &mut markers[seen[first]] {
            let (sin, cos) = random.random_range(0.0..TAU).sin_cos();
            position[0] += JUMP_MM * cos;
            position[1] += JUMP_MM * sin;
        }
        errors.push(LabelError { frame, link, swapped });
    }
    errors
}
