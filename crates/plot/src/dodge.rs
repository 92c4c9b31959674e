//! Repeated measurements are drawn beside each other instead of over each other.

use super::figure::Layer;
use super::style::{Look, MARKER_RADIUS, Shape};

/// Distances between neighbouring markers that are tried in turn, as fractions of a marker's width.
const DISTANCES: [f64; 4] = [1.0, 0.8, 0.6, 0.4];
/// Maximum shift of a marker, as a multiple of its width. Measurements so dense that they would have to be
/// shifted farther stay where they are.
const MAX_SHIFT: f64 = 2.0;

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

/// Returns the smallest shifts (in the least-squares sense) after which markers of the given width at the sorted
/// positions `xs` are beside each other, or overlap as little as [`MAX_SHIFT`] permits.
fn spread(xs: &[f64], width: f64) -> Vec<f64> {
    let within = |shifts: &Vec<f64>| shifts.iter().all(|shift| shift.abs() <= MAX_SHIFT * width);
    let tried = DISTANCES.into_iter().map(|distance| apart(xs, distance * width));
    tried.into_iter().find(within).unwrap_or_else(|| vec![0.0; xs.len()])
}

/// Returns the least-squares shifts after which sorted positions are at least `distance` apart: an isotonic regression
/// by pooling adjacent violators.
fn apart(xs: &[f64], distance: f64) -> Vec<f64> {
    let mut pools: Vec<(f64, usize)> = Vec::new();
    for (i, x) in xs.iter().enumerate() {
        let (mut mean, mut count) = (x - distance * i as f64, 1);
        while let Some((before, of)) = pools.pop_if(|(before, _)| *before > mean) {
            mean = (before * of as f64 + mean * count as f64) / (of + count) as f64;
            count += of;
        }
        pools.push((mean, count));
    }
    let means = pools.into_iter().flat_map(|(mean, count)| std::iter::repeat_n(mean, count));
    means.zip(xs).enumerate().map(|(i, (mean, x))| mean + distance * i as f64 - x).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeats_are_beside_each_other_and_other_points_stay() {
        let xs = [10.0, 50.0, 50.0, 50.0, 53.0, 90.0];
        let shifts = spread(&xs, 6.0);
        assert_eq!([shifts[0], shifts[5]], [0.0; 2]);
        let drawn: Vec<f64> = xs.iter().zip(&shifts).map(|(x, shift)| x + shift).collect();
        for pair in drawn[1..5].windows(2) {
            assert!((pair[1] - pair[0] - 6.0).abs() < 1e-9, "{drawn:?}");
        }
        let sum: f64 = shifts.iter().sum();
        assert!(sum.abs() < 1e-9 && shifts.iter().all(|shift| shift.abs() < 12.0), "{shifts:?}");
    }

    #[test]
    fn many_repeats_overlap_and_dense_measurements_stay() {
        let shifts = spread(&[20.0; 8], 6.0);
        assert!(shifts.windows(2).all(|pair| pair[1] - pair[0] > 2.0), "{shifts:?}");
        assert!(shifts.iter().all(|shift| shift.abs() <= 12.0), "{shifts:?}");
        let dense: Vec<f64> = (0..200).map(f64::from).collect();
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
