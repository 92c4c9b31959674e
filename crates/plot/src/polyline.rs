//! Lines of points, cut and thinned to what can be seen of them.

/// The parts of a line with y between two values, where plotters moves what lies outside onto the panel's
/// sides; points that are not numbers break it, too. Of points nearer to each other than `apart`
/// along both axes, which cannot be told apart, one is left.
pub(crate) fn visible(
    line: &[(f64, f64)],
    [low, high]: [f64; 2],
    apart: (f64, f64),
) -> Vec<Vec<(f64, f64)>> {
    let runs = line.split(|(x, y)| !(x.is_finite() && y.is_finite()));
    runs.flat_map(|run| clip(&thin(run, apart), [low, high])).collect()
}

/// The parts of a line within a range, with points where it enters and leaves them.
fn clip(line: &[(f64, f64)], [low, high]: [f64; 2]) -> Vec<Vec<(f64, f64)>> {
    let mut cut = line.first().copied().into_iter().collect::<Vec<_>>();
    for pair in line.windows(2) {
        let [(x, y), to] = [pair[0], pair[1]];
        let bounds = if y < to.1 { [low, high] } else { [high, low] };
        let crossed = bounds.into_iter().filter(|bound| (y < *bound) != (to.1 < *bound));
        cut.extend(crossed.map(|bound| (x + (to.0 - x) * (bound - y) / (to.1 - y), bound)));
        cut.push(to);
    }
    let parts = cut.split(|(_, y)| !(low..=high).contains(y));
    parts.filter(|part| part.len() > 1).map(<[(f64, f64)]>::to_vec).collect()
}

/// The points of the least and of the greatest value of each of so many parts of a line, in their
/// order; none where no value is known.
pub fn envelope(line: &[(f64, f64)], parts: usize) -> Vec<[(f64, f64); 2]> {
    let of_part = |part: &[(f64, f64)]| {
        let seen = || (0..part.len()).filter(|i| part[*i].1.is_finite());
        let by_value = |i: &usize, j: &usize| part[*i].1.total_cmp(&part[*j].1);
        let ends = seen().min_by(by_value).zip(seen().max_by(by_value));
        ends.map_or([(f64::NAN, f64::NAN); 2], |(i, j)| [part[i.min(j)], part[i.max(j)]])
    };
    line.chunks(line.len().div_ceil(parts).max(1)).map(of_part).collect()
}

/// The line without points that are near to the one before, but for its end.
fn thin(line: &[(f64, f64)], apart: (f64, f64)) -> Vec<(f64, f64)> {
    let mut thin = line.to_vec();
    thin.dedup_by(|b, a| ((b.0 - a.0) / apart.0).hypot((b.1 - a.1) / apart.1) < 1.0);
    let end = line.last().filter(|end| thin.last() != Some(end));
    thin.extend(end);
    thin
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: [f64; 2] = [0.0, 10.0];

    #[test]
    fn a_line_that_leaves_the_panel_and_comes_back_is_cut_in_two() {
        let parts = clip(&[(0.0, 5.0), (10.0, -5.0), (20.0, 5.0)], RANGE);
        assert_eq!(parts, [[(0.0, 5.0), (5.0, 0.0)], [(15.0, 0.0), (20.0, 5.0)]]);
    }

    #[test]
    fn a_line_outside_the_panel_is_gone() {
        assert!(clip(&[(0.0, -5.0), (10.0, -1.0)], RANGE).is_empty());
        assert!(clip(&[(0.0, 15.0), (10.0, 15.0)], RANGE).is_empty());
    }

    #[test]
    fn a_gap_breaks_a_line_and_its_end_stays() {
        let line = [(0.0, 1.0), (0.1, 1.0), (5.0, 1.0), (f64::NAN, 1.0), (6.0, 1.0), (6.1, 1.0)];
        let parts = visible(&line, RANGE, (0.5, 0.5));
        assert_eq!(parts, [[(0.0, 1.0), (5.0, 1.0)], [(6.0, 1.0), (6.1, 1.0)]]);
    }

    #[test]
    fn of_many_points_the_extremes_and_the_gaps_are_left() {
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
