//! Lines cut to a panel: plotters moves what lies outside onto the panel's sides.

use super::axis::Range;

type Point = (f64, f64);

/// The parts of a line with y in `range`; points that are not numbers break it, too. Of points
/// nearer to each other than `apart` along both axes, which cannot be told apart, one is left.
pub fn visible(line: &[Point], range: Range, apart: (f64, f64)) -> Vec<Vec<Point>> {
    let runs = line.split(|(x, y)| !(x.is_finite() && y.is_finite()));
    runs.flat_map(|run| clip(&thin(run, apart), range)).collect()
}

fn clip(line: &[Point], range: Range) -> Vec<Vec<Point>> {
    let mut parts: Vec<Vec<Point>> = Vec::new();
    let mut is_open = false;
    for pair in line.windows(2) {
        let Some((from, to)) = clip_segment(pair[0], pair[1], range) else {
            is_open = false;
            continue;
        };
        match parts.last_mut() {
            Some(part) if is_open => part.push(to),
            _ => parts.push(vec![from, to]),
        }
        is_open = to == pair[1];
    }
    parts
}

fn clip_segment(from: Point, to: Point, range: Range) -> Option<(Point, Point)> {
    if range.contains(from.1) && range.contains(to.1) {
        return Some((from, to));
    }
    let rise = to.1 - from.1;
    let (enter, leave) = ((range.low - from.1) / rise, (range.high - from.1) / rise);
    let (start, end) = (enter.min(leave).max(0.0), enter.max(leave).min(1.0));
    let at = |part: f64| (from.0 + part * (to.0 - from.0), from.1 + part * rise);
    let start_point = if start > 0.0 { at(start) } else { from };
    let end_point = if end < 1.0 { at(end) } else { to };
    (start < end).then_some((start_point, end_point))
}

fn thin(line: &[Point], apart: (f64, f64)) -> Vec<Point> {
    let mut thin: Vec<Point> = Vec::new();
    for (i, (x, y)) in line.iter().enumerate() {
        let is_near = |last: &Point| ((x - last.0) / apart.0).hypot((y - last.1) / apart.1) < 1.0;
        if i + 1 == line.len() || !thin.last().is_some_and(is_near) {
            thin.push((*x, *y));
        }
    }
    thin
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: Range = Range { low: 0.0, high: 10.0 };

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
}
