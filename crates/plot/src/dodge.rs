//! Repeated measurements are drawn beside each other instead of over each other.

use super::figure::Layer;
use super::style::{Look, MARKER_RADIUS, Shape};

/// Maximum distance between neighbouring repeats, as a fraction of a marker's width; measured frequencies of repeats
/// differ by less.
const SAME: f64 = 0.05;
/// Maximum shift, as a fraction of the distance to the nearest other position.
const MAX_SHIFT: f64 = 0.25;
/// Maximum number of repeats that are shifted: more could not be told apart.
const MAX_REPEATS: usize = 8;

/// Returns the horizontal shift (px) of every point of the layers of a panel. Only markers of trials are shifted, and
/// those with the same shape keep their order. `x_px` converts a value to a horizontal position.
pub(crate) fn shifts(layers: &[&Layer], x_px: impl Fn(f64) -> f64) -> Vec<Vec<f64>> {
    let shape_of = |layer: &Layer| match layer.look {
        Look::Marker { shape, .. } if !layer.trials.is_empty() => Some(shape),
        _ => None,
    };
    let mut shifts: Vec<Vec<f64>> =
        layers.iter().map(|layer| vec![0.0; layer.points.len()]).collect();
    for shape in [Shape::Circle, Shape::Square, Shape::Triangle, Shape::Diamond] {
        let mut points: Vec<(f64, usize, usize)> = Vec::new();
        for (nth, layer) in layers.iter().enumerate().filter(|(_, of)| shape_of(of) == Some(shape))
        {
            let at = layer.points.iter().enumerate();
            let at = at.map(|(i, point)| (x_px(point.x), nth, i));
            points.extend(at.filter(|(x, ..)| x.is_finite()));
        }
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let xs: Vec<f64> = points.iter().map(|(x, ..)| *x).collect();
        for (shift, (_, nth, i)) in spread(&xs, 2.0 * MARKER_RADIUS).into_iter().zip(points) {
            shifts[nth][i] = shift;
        }
    }
    shifts
}

/// Returns shifts that draw repeats at the sorted positions `xs` symmetrically beside each other, `width` apart or as far
/// as the distance to the nearest other position permits.
fn spread(xs: &[f64], width: f64) -> Vec<f64> {
    let mut shifts = Vec::with_capacity(xs.len());
    for repeats in xs.chunk_by(|a, b| b - a < SAME * width) {
        let [first, count] = [shifts.len(), repeats.len()];
        let before = first.checked_sub(1).map_or(f64::INFINITY, |i| xs[first] - xs[i]);
        let after = xs.get(first + count).map_or(f64::INFINITY, |x| x - xs[first + count - 1]);
        let half = 0.5 * (count - 1) as f64;
        let distance = match count {
            2..=MAX_REPEATS => width.min(MAX_SHIFT * before.min(after) / half),
            _ => 0.0,
        };
        shifts.extend((0..count).map(|i| distance * (i as f64 - half)));
    }
    shifts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeats_are_beside_each_other_and_nearer_to_their_frequency_than_to_another() {
        let xs = [10.0, 50.0, 50.1, 50.2, 60.0, 90.0, 90.0];
        let shifts = spread(&xs, 6.0);
        let expected = [0.0, -2.45, 0.0, 2.45, 0.0, -3.0, 3.0];
        let is_near = |(found, expected): (&f64, f64)| (found - expected).abs() < 1e-9;
        assert!(shifts.iter().zip(expected).all(is_near), "{shifts:?}");
    }

    #[test]
    fn dense_measurements_stay() {
        let dense: Vec<f64> = (0..200).map(|i| 0.1 * f64::from(i)).collect();
        assert!(spread(&dense, 6.0).iter().all(|shift| *shift == 0.0));
    }

    #[test]
    fn only_markers_of_trials_are_shifted() {
        let look = Look::Marker { colour: crate::INK, shape: Shape::Circle, filled: true };
        let of_model = Layer::new("model", [(1.0, 1.0), (1.0, 2.0)], look);
        let trials = vec!["a".to_owned(), "b".to_owned()];
        let measured = Layer { trials, ..of_model.clone() };
        let found = shifts(&[&of_model, &measured], |x| 100.0 * x);
        assert_eq!(found[0], [0.0; 2]);
        let sides = [-MARKER_RADIUS, MARKER_RADIUS];
        assert!(found[1].iter().zip(sides).all(|(of, side)| (of - side).abs() < 1e-9), "{found:?}");
    }
}
