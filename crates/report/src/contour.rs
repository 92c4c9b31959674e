//! Contour lines of a function sampled on a rectangular grid.

use std::collections::BTreeMap;

/// Number of parts into which the distance between grid points is divided, so that contour lines look smooth.
const PARTS: usize = 4;

/// Returns a finer grid, whose values are interpolated by a cubic Catmull-Rom spline along each axis. Values beside an
/// unknown value are unknown, and the original grid points keep their values.
pub(crate) fn refined(x: &[f64], y: &[f64], values: &[f64]) -> [Vec<f64>; 3] {
    let wide = finer_places(x);
    let rows = values.chunks_exact(x.len().max(1)).map(finer_values);
    let rows: Vec<Vec<f64>> = rows.collect();
    let columns: Vec<Vec<f64>> = (0..wide.len())
        .map(|i| finer_values(&rows.iter().map(|row| row[i]).collect::<Vec<_>>()))
        .collect();
    let high = finer_places(y);
    let values = (0..high.len()).flat_map(|j| columns.iter().map(move |column| column[j]));
    let values = values.collect();
    [wide, high, values]
}

/// Returns the places of a refined grid along one axis.
fn finer_places(places: &[f64]) -> Vec<f64> {
    let between =
        |pair: &[f64], part: usize| pair[0] + (pair[1] - pair[0]) * part as f64 / PARTS as f64;
    let pairs = places.windows(2).flat_map(|pair| (0..PARTS).map(move |part| between(pair, part)));
    pairs.chain(places.last().copied()).collect()
}

/// Returns the values of a refined grid along one axis.
fn finer_values(values: &[f64]) -> Vec<f64> {
    let mut finer = Vec::new();
    for i in 1..values.len() {
        let [from, to] = [values[i - 1], values[i]];
        // A missing neighbour is extrapolated linearly.
        let known =
            |i: Option<usize>| i.and_then(|i| values.get(i)).filter(|value| value.is_finite());
        let before = known(i.checked_sub(2)).copied().unwrap_or(2.0 * from - to);
        let after = known(Some(i + 1)).copied().unwrap_or(2.0 * to - from);
        let slopes = [0.5 * (to - before), 0.5 * (after - from)];
        finer.extend((0..PARTS).map(|part| {
            let t = part as f64 / PARTS as f64;
            let rise = 3.0 * (to - from) - 2.0 * slopes[0] - slopes[1];
            let bend = slopes[0] + slopes[1] - 2.0 * (to - from);
            if part == 0 { from } else { from + t * (slopes[0] + t * (rise + t * bend)) }
        }));
    }
    finer.extend(values.last());
    finer
}

/// Returns the contour lines at `level`, found by marching squares. The lines are concatenated, each followed by a NaN
/// point.
///
/// `values[j * x.len() + i]` is the function value at `(x[i], y[j])`; crossings are interpolated linearly along the
/// edges of the grid. Cells with an unknown (NaN) corner contain no lines.
///
/// Reference: W. E. Lorensen and H. E. Cline, *Marching cubes*, Computer Graphics 21 (1987) 163-169, applied in two
/// dimensions; saddle cells are resolved by the mean of their corners.
pub(crate) fn contour(x: &[f64], y: &[f64], values: &[f64], level: f64) -> Vec<(f64, f64)> {
    let value = |i: usize, j: usize| values[j * x.len() + i];
    // Index of a grid edge: twice the index of its lower left corner, plus one for a vertical edge.
    let edge =
        |i: usize, j: usize, is_vertical: bool| 2 * (j * x.len() + i) + usize::from(is_vertical);
    let mut neighbours: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for j in 0..y.len().saturating_sub(1) {
        for i in 0..x.len().saturating_sub(1) {
            let corners = [value(i, j), value(i + 1, j), value(i + 1, j + 1), value(i, j + 1)];
            if corners.iter().any(|corner| corner.is_nan()) {
                continue;
            }
            let is_above = corners.map(|corner| corner >= level);
            let edges =
                [edge(i, j, false), edge(i + 1, j, true), edge(i, j + 1, false), edge(i, j, true)];
            let crossed: Vec<usize> =
                (0..4).filter(|nth| is_above[*nth] != is_above[(nth + 1) % 4]).collect();
            let is_centre_above = corners.iter().sum::<f64>() / 4.0 >= level;
            let joined = match crossed[..] {
                [a, b] => vec![[a, b]],
                // In a saddle cell, the lines cut off the two corners that lie on the opposite side of the level from
                // the centre.
                [..] if !crossed.is_empty() && is_centre_above == is_above[0] => {
                    vec![[0, 1], [2, 3]]
                }
                [..] if !crossed.is_empty() => vec![[3, 0], [1, 2]],
                [..] => Vec::new(),
            };
            for [a, b] in joined.into_iter().map(|pair| pair.map(|nth| edges[nth])) {
                neighbours.entry(a).or_default().push(b);
                neighbours.entry(b).or_default().push(a);
            }
        }
    }
    let crossing = |edge: usize| {
        let i = edge / 2 % x.len();
        let j = edge / 2 / x.len();
        let (to_i, to_j) = if edge.is_multiple_of(2) { (i + 1, j) } else { (i, j + 1) };
        let from = value(i, j);
        let to = value(to_i, to_j);
        let fraction = (level - from) / (to - from);
        (x[i] + fraction * (x[to_i] - x[i]), y[j] + fraction * (y[to_j] - y[j]))
    };
    // Open lines are traced first, from their ends; closed lines can start anywhere.
    let ends = neighbours.iter().filter(|(_, next)| next.len() == 1).map(|(edge, _)| *edge);
    let starts: Vec<usize> = ends.chain(neighbours.keys().copied()).collect();
    let mut lines = Vec::new();
    for start in starts {
        let mut here = start;
        let mut line = Vec::new();
        while let Some(next) = neighbours.get_mut(&here).and_then(Vec::pop) {
            line.push(crossing(here));
            if let Some(back) = neighbours.get_mut(&next)
                && let Some(nth) = back.iter().position(|edge| *edge == here)
            {
                back.swap_remove(nth);
            }
            here = next;
        }
        if !line.is_empty() {
            line.extend([crossing(here), (f64::NAN, f64::NAN)]);
            lines.extend(line);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(value: impl Fn(f64, f64) -> f64) -> (Vec<f64>, Vec<f64>) {
        let along: Vec<f64> = (0..=40).map(|i| -2.0 + 0.1 * f64::from(i)).collect();
        let values = along
            .iter()
            .flat_map(|y| along.iter().map(|x| value(*x, *y)).collect::<Vec<f64>>())
            .collect();
        (along, values)
    }

    fn lines(value: impl Fn(f64, f64) -> f64, level: f64) -> Vec<Vec<(f64, f64)>> {
        let (along, values) = grid(value);
        let points = contour(&along, &along, &values, level);
        let lines = points.split(|(x, _)| x.is_nan()).filter(|line| !line.is_empty());
        lines.map(<[(f64, f64)]>::to_vec).collect()
    }

    #[test]
    fn a_refined_grid_keeps_its_points_and_gaps_and_follows_a_smooth_function() {
        let along = [0.0, 1.0, 2.0, 3.0, 4.0];
        let value = |x: f64, y: f64| if x > 3.5 { f64::NAN } else { x * x + 0.5 * x * y };
        let values: Vec<f64> = along.iter().flat_map(|y| along.map(|x| value(x, *y))).collect();
        let [x, y, finer] = refined(&along, &along, &values);
        assert_eq!([x.len(), y.len(), finer.len()], [17, 17, 17 * 17]);
        for (nth, found) in finer.iter().enumerate() {
            let (x, y) = (x[nth % 17], y[nth / 17]);
            if (1.0..=2.0).contains(&x) {
                assert!((found - value(x, y)).abs() < 1e-12, "{x} {y}: {found}");
            }
            assert_eq!(found.is_nan(), x > 3.0, "{x} {y}: {found}");
        }
        assert!(refined(&[], &[], &[]).iter().all(Vec::is_empty));
    }

    #[test]
    fn contour_of_a_hill_is_a_single_closed_circle() {
        let found = lines(|x, y| -(x * x + y * y), -1.0);
        let [circle] = &found[..] else { panic!("{found:?}") };
        assert_eq!(circle.first(), circle.last());
        assert!(circle.len() > 60, "{}", circle.len());
        for (x, y) in circle {
            assert!((x.hypot(*y) - 1.0).abs() < 2e-3, "{x} {y}");
        }
    }

    #[test]
    fn contour_lines_end_at_grid_sides_and_at_unknown_values() {
        let found = lines(|x, y| x + 0.01 * y, 0.512);
        let [upright] = &found[..] else { panic!("{found:?}") };
        assert_eq!(upright.len(), 42);
        let ends = [upright[0].1, upright[upright.len() - 1].1].map(f64::abs);
        assert!(ends.iter().all(|y| (y - 2.0).abs() < 1e-9), "{ends:?}");
        let broken = lines(|x, y| if y.abs() < 0.05 { f64::NAN } else { x + 0.01 * y }, 0.512);
        assert_eq!(broken.len(), 2, "{broken:?}");
    }

    #[test]
    fn contour_lines_do_not_cross_at_saddles_and_a_constant_field_has_none() {
        for level in [-0.01, 0.01] {
            let found = lines(|x, y| (x - 0.03) * (y - 0.04), level);
            assert_eq!(found.len(), 2, "{found:?}");
            for line in &found {
                assert!(
                    line.iter().all(|(x, y)| (x - 0.03) * (y - 0.04) * level > 0.0),
                    "{line:?}"
                );
            }
        }
        assert!(lines(|_, _| 1.0, 1.0).is_empty());
        assert!(contour(&[], &[], &[], 1.0).is_empty());
    }
}
