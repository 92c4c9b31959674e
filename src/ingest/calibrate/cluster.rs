//! Which markers move rigidly together, from the distances between them.

use crate::stats::quantiles_low;
use crate::vicon::MarkerFile;

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
pub(super) fn rigid_groups(file: &MarkerFile) -> Vec<Vec<usize>> {
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
fn spread_mm(file: &MarkerFile, a: usize, b: usize) -> f64 {
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
