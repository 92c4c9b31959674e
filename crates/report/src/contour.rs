//! Lines along which values on a grid are the same.

use std::collections::BTreeMap;

/// The lines at a level of `values[j * x.len() + i]` at `(x[i], y[j])`, in proportion between neighbours, one
/// after the other with a NaN between them. Where a value is not known (NaN) there are none.
///
/// Reference: W. E. Lorensen and H. E. Cline, *Marching cubes*, Computer Graphics 21 (1987) 163-169, in two
/// dimensions; of a saddle the middle decides.
pub(crate) fn contour(x: &[f64], y: &[f64], values: &[f64], level: f64) -> Vec<(f64, f64)> {
    let value = |i: usize, j: usize| values[j * x.len() + i];
    // A side by its lower left corner: twice its number, and one more for an upright side.
    let side =
        |i: usize, j: usize, is_upright: bool| 2 * (j * x.len() + i) + usize::from(is_upright);
    let mut beside: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for j in 0..y.len().saturating_sub(1) {
        for i in 0..x.len().saturating_sub(1) {
            let corners = [value(i, j), value(i + 1, j), value(i + 1, j + 1), value(i, j + 1)];
            if corners.iter().any(|corner| corner.is_nan()) {
                continue;
            }
            let is_above = corners.map(|corner| corner >= level);
            let sides =
                [side(i, j, false), side(i + 1, j, true), side(i, j + 1, false), side(i, j, true)];
            let crossed: Vec<usize> =
                (0..4).filter(|nth| is_above[*nth] != is_above[(nth + 1) % 4]).collect();
            let middle = corners.iter().sum::<f64>() / 4.0 >= level;
            let joined = match crossed[..] {
                [a, b] => vec![[a, b]],
                // What lies with the middle is not cut off.
                [..] if !crossed.is_empty() && middle == is_above[0] => vec![[0, 1], [2, 3]],
                [..] if !crossed.is_empty() => vec![[3, 0], [1, 2]],
                [..] => Vec::new(),
            };
            for [a, b] in joined.into_iter().map(|pair| pair.map(|nth| sides[nth])) {
                beside.entry(a).or_default().push(b);
                beside.entry(b).or_default().push(a);
            }
        }
    }
    let at = |side: usize| {
        let (i, j) = (side / 2 % x.len(), side / 2 / x.len());
        let (to_i, to_j) = if side.is_multiple_of(2) { (i + 1, j) } else { (i, j + 1) };
        let (from, to) = (value(i, j), value(to_i, to_j));
        let part = (level - from) / (to - from);
        (x[i] + part * (x[to_i] - x[i]), y[j] + part * (y[to_j] - y[j]))
    };
    // Lines that end first, then those that close.
    let ends = beside.iter().filter(|(_, next)| next.len() == 1).map(|(side, _)| *side);
    let starts: Vec<usize> = ends.chain(beside.keys().copied()).collect();
    let mut lines = Vec::new();
    for start in starts {
        let mut here = start;
        let mut line = Vec::new();
        while let Some(next) = beside.get_mut(&here).and_then(Vec::pop) {
            line.push(at(here));
            if let Some(back) = beside.get_mut(&next)
                && let Some(nth) = back.iter().position(|side| *side == here)
            {
                back.swap_remove(nth);
            }
            here = next;
        }
        if !line.is_empty() {
            line.extend([at(here), (f64::NAN, f64::NAN)]);
            lines.extend(line);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(of: impl Fn(f64, f64) -> f64) -> (Vec<f64>, Vec<f64>) {
        let along: Vec<f64> = (0..=40).map(|i| -2.0 + 0.1 * f64::from(i)).collect();
        let row = |y: &f64| along.iter().map(|x| of(*x, *y)).collect::<Vec<f64>>();
        let values = along.iter().flat_map(row).collect();
        (along, values)
    }

    fn lines(of: impl Fn(f64, f64) -> f64, level: f64) -> Vec<Vec<(f64, f64)>> {
        let (along, values) = grid(of);
        let points = contour(&along, &along, &values, level);
        let lines = points.split(|(x, _)| x.is_nan()).filter(|line| !line.is_empty());
        lines.map(<[(f64, f64)]>::to_vec).collect()
    }

    #[test]
    fn the_line_of_a_hill_is_one_circle_that_closes() {
        let found = lines(|x, y| -(x * x + y * y), -1.0);
        let [circle] = &found[..] else { panic!("{found:?}") };
        assert_eq!(circle.first(), circle.last());
        assert!(circle.len() > 60, "{}", circle.len());
        for (x, y) in circle {
            assert!((x.hypot(*y) - 1.0).abs() < 2e-3, "{x} {y}");
        }
    }

    #[test]
    fn lines_end_at_the_grid_s_sides_and_where_nothing_is_known() {
        let found = lines(|x, y| x + 0.01 * y, 0.512);
        let [upright] = &found[..] else { panic!("{found:?}") };
        assert_eq!(upright.len(), 42);
        let ends = [upright[0].1, upright[upright.len() - 1].1].map(f64::abs);
        assert!(ends.iter().all(|y| (y - 2.0).abs() < 1e-9), "{ends:?}");
        let broken = lines(|x, y| if y.abs() < 0.05 { f64::NAN } else { x + 0.01 * y }, 0.512);
        assert_eq!(broken.len(), 2, "{broken:?}");
    }

    #[test]
    fn lines_at_a_saddle_do_not_cross_and_an_even_field_has_none() {
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
