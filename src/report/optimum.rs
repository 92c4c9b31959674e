//! The figure of an optimum: the objective over the commands that it answers to most.

use super::contour::contour;
use super::drawing::{Figure, Layer, Layout, Panel};
use super::ending::drawn;
use super::{ReportError, looks};

/// Parts of the best value that lines show it within.
const WITHIN: [f64; 5] = [0.01, 0.05, 0.1, 0.25, 0.5];

/// An objective about its optimum, over one or two numbers of a gait.
#[derive(Debug, Clone)]
pub struct OptimumPlaces<'a> {
    pub campaign: &'a str,
    pub model: &'a str,
    /// What is best there, with its unit.
    pub objective: String,
    pub is_minimised: bool,
    /// What the axes say, and the values along them.
    pub axes: Vec<(String, &'a [f64])>,
    /// The objective at each value of the first axis, for one value of the second after the other; NaN where no
    /// gait counts.
    pub values: &'a [f64],
    /// That of the optimum.
    pub best_value: f64,
    /// Places along the axes: of the optimum, the present gait, and the optima of replicates.
    pub best: Vec<f64>,
    pub present: Vec<f64>,
    pub replicates: Vec<Vec<f64>>,
}

/// Its drawing, in the format that a file with this ending has: `svg`, `png` or `pdf`.
///
/// # Errors
/// There is no such format, or nothing can be drawn.
pub fn optimum_drawing(places: &OptimumPlaces, ending: &str) -> Result<Vec<u8>, ReportError> {
    drawn(&figure(places), ending)
}

/// The drawing of a front of a campaign's model: a point for each gait, and what the axes say.
///
/// # Errors
/// There is no such format, or nothing can be drawn.
pub fn front_drawing(
    [campaign, model]: [&str; 2],
    [along, up]: [&str; 2],
    points: &[(f64, f64)],
    ending: &str,
) -> Result<Vec<u8>, ReportError> {
    let layers = vec![
        Layer::new("front", points.iter().copied(), looks::RECORDED),
        Layer::new("its gaits", points.iter().copied(), looks::OPTIMUM),
    ];
    let title = format!("Gaits of {campaign}, {model}, of which none is better in both");
    let panel = Panel::new("", along, up, layers);
    let titles = [title, String::new()];
    drawn(&Figure::new("front", titles, &[campaign], Layout::Stack, vec![panel]), ending)
}

fn figure(places: &OptimumPlaces) -> Figure {
    let OptimumPlaces { campaign, model, objective, axes, .. } = places;
    let panel = match &axes[..] {
        [x, y] => plane(places, [x, y]),
        [x] => curve(places, x),
        _ => Panel::default(),
    };
    let title = format!("{objective} of {campaign}, {model}, about its optimum");
    let caption = "The commands that are not shown stay as they are at the optimum.".to_owned();
    Figure::new("optimum", [title, caption], &[campaign], Layout::Stack, vec![panel])
}

/// A point of each gait, where it has as many numbers as the map.
fn marks<const N: usize>(
    places: &OptimumPlaces,
    point: impl Fn([f64; N]) -> (f64, f64),
) -> Vec<Layer> {
    let layer = |name: &str, of: &[Vec<f64>], look| {
        let points = of.iter().filter_map(|of| of[..].try_into().ok()).map(&point);
        Layer::new(name, points, look)
    };
    let one = std::slice::from_ref::<Vec<f64>>;
    let marks = [
        layer("of replicates", &places.replicates, looks::REPLICATES),
        layer("present gait", one(&places.present), looks::PRESENT),
        layer("optimum", one(&places.best), looks::OPTIMUM),
    ];
    marks.into_iter().filter(|layer| !layer.points.is_empty()).collect()
}

/// What an axis says, and the values along it.
type Axis<'a> = (String, &'a [f64]);

/// Lines of the same value over two axes.
fn plane(places: &OptimumPlaces, [(label_x, x), (label_y, y)]: [&Axis; 2]) -> Panel {
    let OptimumPlaces { values, best_value, is_minimised, .. } = places;
    // A line stays within the gaits that count.
    let worse = if *is_minimised { 1.0 } else { -1.0 };
    let level = |(nth, part): (usize, f64)| {
        let points = contour(x, y, values, best_value * (1.0 + worse * part));
        Layer::new(&format!("within {} %", 100.0 * part), points, looks::within(nth))
    };
    let mut layers = vec![Layer::new("edge of what counts", edge(x, y, values), looks::EDGE)];
    layers.extend(WITHIN.into_iter().enumerate().rev().map(level));
    layers.retain(|layer| !layer.points.is_empty());
    layers.extend(marks(places, |[x, y]| (x, y)));
    Panel::new("", label_x, label_y.as_str(), layers)
}

/// Around the places with a value: half way to the next ones, and along the grid's sides.
fn edge(x: &[f64], y: &[f64], values: &[f64]) -> Vec<(f64, f64)> {
    let widened = |along: &[f64]| match along {
        [first, .., last] => [&[*first][..], along, &[*last]].concat(),
        _ => along.to_vec(),
    };
    let (wide_x, wide_y) = (widened(x), widened(y));
    let mut counts = vec![0.0; wide_x.len() * wide_y.len()];
    for (nth, _) in values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
        counts[(1 + nth / x.len()) * wide_x.len() + 1 + nth % x.len()] = 1.0;
    }
    contour(&wide_x, &wide_y, &counts, 0.5)
}

/// The objective along one axis.
fn curve(places: &OptimumPlaces, (label, along): &Axis) -> Panel {
    let OptimumPlaces { objective, values, .. } = places;
    let points = along.iter().copied().zip(values.iter().copied());
    let at = |[x]: [f64; 1]| {
        let known = along.iter().zip(*values).filter(|(_, value)| value.is_finite());
        let near = known.min_by(|(a, _), (b, _)| (*a - x).abs().total_cmp(&(*b - x).abs()));
        (x, near.map_or(f64::NAN, |(_, value)| *value))
    };
    let mut layers = vec![Layer::new(objective, points, looks::RECORDED)];
    layers.extend(marks(places, at));
    Panel::new("", label, objective.as_str(), layers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_lie_around_the_optimum_and_an_edge_around_what_counts() {
        let along: Vec<f64> = (0..=20).map(|i| 0.1 * f64::from(i)).collect();
        let value = |x: f64, y: f64| if x > 1.85 { f64::NAN } else { 2.0 - (x - 1.0).powi(2) - y };
        let values: Vec<f64> =
            along.iter().flat_map(|y| along.iter().map(|x| value(*x, *y))).collect();
        let places = OptimumPlaces {
            campaign: "any",
            model: "skid",
            objective: "v (m/s)".to_owned(),
            is_minimised: false,
            axes: ["one", "another"].map(|label| (label.to_owned(), &along[..])).into(),
            values: &values,
            best_value: 2.0,
            best: vec![1.0, 0.0],
            present: vec![0.5, 1.0],
            replicates: Vec::new(),
        };
        let panel = plane(&places, [&places.axes[0], &places.axes[1]]);
        let named = |name: &str| panel.layers.iter().find(|of| of.name == name).expect("a layer");
        for point in named("within 25 %").points.iter().filter(|of| of.x.is_finite()) {
            assert!((value(point.x, point.y) - 1.5).abs() < 0.01, "{point:?}");
        }
        let most = named("edge of what counts").points.iter().fold(0.0, |most, of| of.x.max(most));
        assert!((most - 1.85).abs() < 1e-9, "{most}");
        assert_eq!(named("optimum").points.len(), 1);
        assert!(panel.layers.iter().all(|of| of.name != "of replicates"));
        assert!(
            optimum_drawing(&places, "svg").is_ok() && optimum_drawing(&places, "gif").is_err()
        );
    }
}
