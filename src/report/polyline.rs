//! Lines cut to a panel and into dashes.

type Point = (f64, f64);

/// The parts of a line with `top <= y <= bottom`.
pub fn clip(line: &[Point], top: f64, bottom: f64) -> Vec<Vec<Point>> {
    let mut parts: Vec<Vec<Point>> = Vec::new();
    let mut open = false;
    for pair in line.windows(2) {
        let Some((from, to)) = clip_segment(pair[0], pair[1], top, bottom) else {
            open = false;
            continue;
        };
        match parts.last_mut() {
            Some(part) if open => part.push(to),
            _ => parts.push(vec![from, to]),
        }
        open = to == pair[1];
    }
    parts
}

fn clip_segment(from: Point, to: Point, top: f64, bottom: f64) -> Option<(Point, Point)> {
    let rise = to.1 - from.1;
    let (mut start, mut end) = (0.0_f64, 1.0_f64);
    if rise == 0.0 {
        return (top..=bottom).contains(&from.1).then_some((from, to));
    }
    let (enter, leave) = ((top - from.1) / rise, (bottom - from.1) / rise);
    start = start.max(enter.min(leave));
    end = end.min(enter.max(leave));
    let at = |part: f64| (from.0 + part * (to.0 - from.0), from.1 + part * rise);
    let start_point = if start > 0.0 { at(start) } else { from };
    let end_point = if end < 1.0 { at(end) } else { to };
    (start < end).then_some((start_point, end_point))
}

/// The line without the points that are nearer than `apart` to the last one before them.
pub fn thin(line: impl Iterator<Item = Point>, apart: f64) -> Vec<Point> {
    let mut thin: Vec<Point> = Vec::new();
    let mut end = None;
    for point in line {
        let is_near = |last: &Point| (point.0 - last.0).hypot(point.1 - last.1) < apart;
        if thin.last().is_some_and(is_near) {
            end = Some(point);
        } else {
            thin.push(point);
            end = None;
        }
    }
    thin.extend(end);
    thin
}

/// Cuts a line into dashes; `pattern` is dash, gap, dash, gap, ... and nothing is a solid line.
pub fn dashes(line: &[Point], pattern: &[f64]) -> Vec<Vec<Point>> {
    if pattern.is_empty() || pattern.iter().any(|&length| length <= 0.0) {
        return vec![line.to_vec()];
    }
    let mut dashes = Vec::new();
    let mut turn = 0;
    let mut left = pattern[0];
    let mut dash: Vec<Point> = line.first().copied().into_iter().collect();
    for pair in line.windows(2) {
        let (mut from, to) = (pair[0], pair[1]);
        loop {
            let length = (to.0 - from.0).hypot(to.1 - from.1);
            let drawing = turn % 2 == 0;
            if length < left {
                left -= length;
                if drawing {
                    dash.push(to);
                }
                break;
            }
            let part = if length > 0.0 { left / length } else { 1.0 };
            from = (from.0 + part * (to.0 - from.0), from.1 + part * (to.1 - from.1));
            dash.push(from);
            if drawing {
                dashes.push(std::mem::take(&mut dash));
            } else {
                dash = vec![from];
            }
            turn += 1;
            left = pattern[turn % pattern.len()];
        }
    }
    if turn % 2 == 0 && dash.len() > 1 {
        dashes.push(dash);
    }
    dashes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_leaves_the_panel_and_comes_back_is_cut_in_two() {
        let parts = clip(&[(0.0, 5.0), (10.0, -5.0), (20.0, 5.0)], 0.0, 10.0);
        assert_eq!(parts, [[(0.0, 5.0), (5.0, 0.0)], [(15.0, 0.0), (20.0, 5.0)]]);
    }

    #[test]
    fn a_line_outside_the_panel_is_gone() {
        assert!(clip(&[(0.0, -5.0), (10.0, -1.0)], 0.0, 10.0).is_empty());
        assert!(clip(&[(0.0, 15.0), (10.0, 15.0)], 0.0, 10.0).is_empty());
    }

    #[test]
    fn dashes_go_round_corners() {
        let parts = dashes(&[(0.0, 0.0), (3.0, 0.0), (3.0, 7.0)], &[4.0, 2.0]);
        assert_eq!(parts[0], [(0.0, 0.0), (3.0, 0.0), (3.0, 1.0)]);
        assert_eq!(parts[1], [(3.0, 3.0), (3.0, 7.0)]);
        assert_eq!(parts.len(), 2);
    }
}
