//! Clipping and thinning of polylines to their visible parts.

/// Splits a line into the parts whose y is within a range, because the plotters crate would move all other
/// points onto the panel's sides. The line is also split at points that are not finite, and points closer
/// than `min_distance` (in x and y) to the preceding point are dropped.
pub(crate) fn visible(
    line: &[(f64, f64)],
    [low, high]: [f64; 2],
    min_distance: (f64, f64),
) -> Vec<Vec<(f64, f64)>> {
    let runs = line.split(|(x, y)| !(x.is_finite() && y.is_finite()));
    runs.flat_map(|run| clip(&thin(run, min_distance), [low, high])).collect()
}

/// Clips a line to a range of y, and adds points where the line enters and leaves the range.
fn clip(line: &[(f64, f64)], [low, high]: [f64; 2]) -> Vec<Vec<(f64, f64)>> {
    let mut with_crossings = line.first().copied().into_iter().collect::<Vec<_>>();
    for pair in line.windows(2) {
        let [(x, y), to] = [pair[0], pair[1]];
        let bounds = if y < to.1 { [low, high] } else { [high, low] };
        for bound in bounds.into_iter().filter(|bound| (y < *bound) != (to.1 < *bound)) {
            with_crossings.push((x + (to.0 - x) * (bound - y) / (to.1 - y), bound));
        }
        with_crossings.push(to);
    }
    let parts = with_crossings.split(|(_, y)| !(low..=high).contains(y));
    parts.filter(|part| part.len() > 1).map(<[(f64, f64)]>::to_vec).collect()
}

/// Divides a line into `parts` parts and returns, for each part, the points with the minimum and maximum y in
/// their order along the line; NaN for a part without finite values.
pub fn envelope(line: &[(f64, f64)], parts: usize) -> Vec<[(f64, f64); 2]> {
    line.chunks(line.len().div_ceil(parts).max(1)).map(extreme_points).collect()
}

/// Returns the points of a line with the minimum and maximum y, in their order along the line; NaN if there
/// are no finite values.
fn extreme_points(line: &[(f64, f64)]) -> [(f64, f64); 2] {
    let finite = (0..line.len()).filter(|i| line[*i].1.is_finite());
    let min = finite.clone().min_by(|i, j| line[*i].1.total_cmp(&line[*j].1));
    let max = finite.max_by(|i, j| line[*i].1.total_cmp(&line[*j].1));
    min.zip(max).map_or([(f64::NAN, f64::NAN); 2], |(i, j)| [line[i.min(j)], line[i.max(j)]])
}

/// Drops points that are closer than `min_distance` (in x and y) to the preceding point, but keeps the last
/// point.
fn thin(line: &[(f64, f64)], min_distance: (f64, f64)) -> Vec<(f64, f64)> {
    let mut thin = line.to_vec();
    thin.dedup_by(|b, a| ((b.0 - a.0) / min_distance.0).hypot((b.1 - a.1) / min_distance.1) < 1.0);
    let end = line.last().filter(|end| thin.last() != Some(end));
    thin.extend(end);
    thin
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: [f64; 2] = [0.0, 10.0];

    #[test]
    fn a_line_that_leaves_the_panel_and_returns_is_split_in_two() {
        let parts = clip(&[(0.0, 5.0), (10.0, -5.0), (20.0, 5.0)], RANGE);
        assert_eq!(parts, [[(0.0, 5.0), (5.0, 0.0)], [(15.0, 0.0), (20.0, 5.0)]]);
    }

    #[test]
    fn a_line_outside_the_panel_is_dropped() {
        assert!(clip(&[(0.0, -5.0), (10.0, -1.0)], RANGE).is_empty());
        assert!(clip(&[(0.0, 15.0), (10.0, 15.0)], RANGE).is_empty());
    }

    #[test]
    fn a_gap_splits_a_line_and_the_last_point_is_kept() {
        let line = [(0.0, 1.0), (0.1, 1.0), (5.0, 1.0), (f64::NAN, 1.0), (6.0, 1.0), (6.1, 1.0)];
        let parts = visible(&line, RANGE, (0.5, 0.5));
        assert_eq!(parts, [[(0.0, 1.0), (5.0, 1.0)], [(6.0, 1.0), (6.1, 1.0)]]);
    }

    #[test]
    fn an_envelope_keeps_the_extremes_and_the_gaps() {
        let value = |i: usize| match i {
            4321 => 7.0,
            5000..6000 => f64::NAN,
            _ => (i as f64 / 50.0).sin(),
        };
        let points: Vec<(f64, f64)> = (0..10_000).map(|i| (i as f64, value(i))).collect();
        let points = envelope(&points, 400).concat();
        assert!(points.len() <= 800);
        assert!(points.contains(&(4321.0, 7.0)));
        assert!(points.iter().any(|(_, y)| y.is_nan()));
        let known = points.iter().filter(|(x, _)| x.is_finite());
        assert!(known.map(|(x, _)| x).is_sorted());
    }
}
