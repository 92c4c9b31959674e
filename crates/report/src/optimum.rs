//! The figure of optima: each objective over the commands that it answers to most.

use std::collections::BTreeSet;

use minijinja::context;
use trilink_plot::{Figure, Layer, Layout, Panel};
use trilink_robot::Model;
use trilink_tables::{MapPoint, Objective, OptimumMapRow};

use super::contour::contour;
use super::ending::{FigureFile, drawn};
use super::figures::texts;
use super::{FREQUENCY, ReportError, looks};

/// What lies beyond the trials of the fit.
const EXTRAPOLATED: &str = "extrapolated";
/// Parts of the best value that lines show it within.
const WITHIN: [f64; 5] = [0.01, 0.05, 0.1, 0.25, 0.5];

/// The drawing of a map of an objective, in the format that a file with this ending has: `svg`, `png` or `pdf`.
///
/// # Errors
/// There is no such format, or nothing can be drawn.
pub fn optimum_drawing(
    map: &[OptimumMapRow],
    file: FigureFile<'_>,
) -> Result<Vec<u8>, ReportError> {
    drawn(&figure("optimum", map.first().map_or("", |row| &row.campaign), map), file)
}

/// The drawing of a front of a campaign's model: a point for each gait, whether it is extrapolated, and what
/// the axes say.
///
/// # Errors
/// There is no such format, or nothing can be drawn.
pub fn front_drawing(
    [campaign, model]: [&str; 2],
    [along, up]: [&str; 2],
    points: &[(f64, f64, bool)],
    file: FigureFile<'_>,
) -> Result<Vec<u8>, ReportError> {
    let all = points.iter().map(|(x, y, _)| (*x, *y));
    let of = |is_extrapolated: bool| {
        let own = points.iter().filter(move |(.., is)| *is == is_extrapolated);
        own.map(|(x, y, _)| (*x, *y))
    };
    let mut layers = vec![
        Layer::new("front", all, looks::RECORDED),
        Layer::new("its gaits", of(false), looks::OPTIMUM),
        Layer::new(EXTRAPOLATED, of(true), looks::EXTRAPOLATED),
    ];
    layers.retain(|layer| !layer.points.is_empty());
    let title = format!("Gaits of {campaign}, {model}, of which none is better in both");
    let panel = Panel::new("", along, up, layers);
    let titles = [title, String::new()];
    drawn(&Figure::new("front", titles, &[campaign], Layout::Stack, vec![panel]), file)
}

/// A panel for every map of a campaign's objectives.
pub(crate) fn figure<'r>(
    stem: &str,
    campaign: &str,
    maps: impl IntoIterator<Item = &'r OptimumMapRow>,
) -> Figure {
    let maps: Vec<&OptimumMapRow> = maps.into_iter().collect();
    let is_one =
        |a: &&OptimumMapRow, b: &&OptimumMapRow| (a.model, a.objective) == (b.model, b.objective);
    let models: BTreeSet<Model> = maps.iter().map(|row| row.model).collect();
    let panels = maps.chunk_by(is_one).map(|map| panel(map, models.len() > 1));
    let panels: Vec<Panel> = panels.collect();
    let models: Vec<&str> = models.iter().map(|model| model.name()).collect();
    let texts = texts("optima", context! { campaign, models });
    let layout = if panels.len() > 1 { Layout::Grid } else { Layout::Stack };
    Figure::new(stem, texts, &[campaign], layout, panels)
}

/// The panel of one map, which names its model if it `has_others` beside it.
fn panel(map: &[&OptimumMapRow], has_others: bool) -> Panel {
    let OptimumMapRow { model, objective, x_command, y_command, .. } = map[0];
    let model = if has_others { format!(", {model}") } else { String::new() };
    let title = with_unit(*objective) + &model;
    let panel = match y_command.is_empty() {
        true => curve(map, &label(x_command)),
        false => plane(map, [x_command, y_command].map(|command| label(command))),
    };
    Panel { title, ..panel }
}

/// What an axis of a command says.
fn label(command: &str) -> String {
    let number = command.trim_end_matches(|c: char| c.is_ascii_digit());
    let joint = &command[number.len()..];
    match number {
        "offset" => format!("Offset of joint {joint} (deg)"),
        "amplitude" => format!("Amplitude of joint {joint} (deg)"),
        "phase" => format!("Phase of joint {joint} (deg)"),
        "second_in_phase" => format!("Second harmonic of joint {joint}, in phase (deg)"),
        "second_quadrature" => format!("Second harmonic of joint {joint}, in quadrature (deg)"),
        _ => FREQUENCY.to_owned(),
    }
}

/// What an axis of an objective says.
pub fn with_unit(objective: Objective) -> String {
    format!("{objective} ({})", objective.unit())
}

/// Those along the grid's axes, and its values, as far as its rows are whole lines of one grid.
fn grid(map: &[&OptimumMapRow]) -> [Vec<f64>; 3] {
    let grid: Vec<&OptimumMapRow> =
        map.iter().copied().filter(|row| row.point == MapPoint::Grid).collect();
    let across = grid.iter().take_while(|row| row.y.total_cmp(&grid[0].y).is_eq()).count();
    let is_line = |line: &&[&OptimumMapRow]| {
        let is_of = |(row, first): (&&OptimumMapRow, &&OptimumMapRow)| {
            row.x.total_cmp(&first.x).is_eq() && row.y.total_cmp(&line[0].y).is_eq()
        };
        line.iter().zip(&grid).all(is_of)
    };
    let lines: Vec<_> = grid.chunks_exact(across.max(1)).take_while(is_line).collect();
    let x = grid.iter().take(across).map(|row| row.x).collect();
    let y = lines.iter().map(|line| line[0].y).collect();
    [x, y, lines.concat().iter().map(|row| row.value).collect()]
}

/// A point of each gait.
fn marks(map: &[&OptimumMapRow], point: impl Fn(&OptimumMapRow) -> (f64, f64)) -> Vec<Layer> {
    let layer = |(name, of, look)| {
        let points = map.iter().filter(|row| row.point == of).map(|row| point(row));
        Layer::new(name, points, look)
    };
    let is_extrapolated =
        |row: &&&OptimumMapRow| row.point == MapPoint::Optimum && row.extrapolated == Some(true);
    let optimum = match map.iter().find(is_extrapolated) {
        Some(_) => ("optimum, extrapolated", MapPoint::Optimum, looks::EXTRAPOLATED),
        None => ("optimum", MapPoint::Optimum, looks::OPTIMUM),
    };
    let marks = [
        ("of replicates", MapPoint::Replicate, looks::REPLICATES),
        ("present gait", MapPoint::Present, looks::PRESENT),
        optimum,
    ];
    marks.into_iter().map(layer).filter(|layer| !layer.points.is_empty()).collect()
}

/// Lines of the same value over two axes.
fn plane(map: &[&OptimumMapRow], [label_x, label_y]: [String; 2]) -> Panel {
    let [x, y, values] = grid(map);
    let best = map.iter().find(|row| row.point == MapPoint::Optimum);
    let best_value = best.map_or(f64::NAN, |row| row.value);
    // A line stays within the gaits that count.
    let worse = if best.is_some_and(|row| row.objective.is_minimised()) { 1.0 } else { -1.0 };
    let level = |(nth, part): (usize, f64)| {
        let points = contour(&x, &y, &values, best_value * (1.0 + worse * part));
        Layer::new(&format!("within {} %", 100.0 * part), points, looks::within(nth))
    };
    let measured: Vec<f64> = measured(map, values.len());
    let mut layers = vec![
        Layer::new("edge of what counts", edge(&x, &y, &values), looks::EDGE),
        Layer::new("edge of the trials", edge(&x, &y, &measured), looks::TRIALS_EDGE),
    ];
    layers.extend(WITHIN.into_iter().enumerate().rev().map(level));
    layers.retain(|layer| !layer.points.is_empty());
    layers.extend(marks(map, |row| (row.x, row.y)));
    Panel::new("", &label_x, label_y.as_str(), layers)
}

/// The grid with a value where a gait is known not to be extrapolated.
fn measured(map: &[&OptimumMapRow], count: usize) -> Vec<f64> {
    let grid = map.iter().filter(|row| row.point == MapPoint::Grid).take(count);
    let of = |row: &&OptimumMapRow| if row.extrapolated == Some(false) { 1.0 } else { f64::NAN };
    grid.map(of).collect()
}

/// Around the places with a value: half way to the next ones, and along the grid's sides. A single line has none.
fn edge(x: &[f64], y: &[f64], values: &[f64]) -> Vec<(f64, f64)> {
    if x.len().min(y.len()) < 2 {
        return Vec::new();
    }
    let widened = |along: &[f64]| [&along[..1], along, &along[along.len() - 1..]].concat();
    let (wide_x, wide_y) = (widened(x), widened(y));
    let mut counts = vec![0.0; wide_x.len() * wide_y.len()];
    for (nth, _) in values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
        counts[(1 + nth / x.len()) * wide_x.len() + 1 + nth % x.len()] = 1.0;
    }
    contour(&wide_x, &wide_y, &counts, 0.5)
}

/// The objective along one axis.
fn curve(map: &[&OptimumMapRow], label: &str) -> Panel {
    let [along, _, values] = grid(map);
    let objective = map.first().map_or(String::new(), |row| with_unit(row.objective));
    let points = along.iter().copied().zip(values.iter().copied());
    let at = |row: &OptimumMapRow| {
        let known = along.iter().zip(&values).filter(|(_, value)| value.is_finite());
        let near = known.min_by(|(a, _), (b, _)| (*a - row.x).abs().total_cmp(&(*b - row.x).abs()));
        (row.x, near.map_or(f64::NAN, |(_, value)| *value))
    };
    let beyond = map.iter().filter(|row| row.point == MapPoint::Grid).take(along.len());
    let beyond = beyond.map(|row| {
        let is_extrapolated = row.extrapolated == Some(true);
        (row.x, if is_extrapolated { row.value } else { f64::NAN })
    });
    let beyond = Layer::new(EXTRAPOLATED, beyond, looks::TRIALS_EDGE);
    let mut layers = vec![Layer::new(&objective, points, looks::RECORDED)];
    layers.extend(Some(beyond).filter(|of| of.points.iter().any(|point| point.y.is_finite())));
    layers.extend(marks(map, at));
    Panel::new("", label, objective.as_str(), layers)
}

#[cfg(test)]
mod tests {
    use trilink_tables::Columns;

    use super::*;

    #[test]
    fn lines_lie_around_the_optimum_and_an_edge_around_what_counts() {
        let value = |x: f64, y: f64| if x > 1.85 { f64::NAN } else { 2.0 - (x - 1.0).powi(2) - y };
        let row = |point: MapPoint, x: f64, y: f64| OptimumMapRow {
            campaign: "any".to_owned(),
            objective: Objective::Speed,
            point,
            x_command: "omega".to_owned(),
            y_command: "amplitude2".to_owned(),
            x,
            y,
            value: value(x, y),
            ..OptimumMapRow::blank()
        };
        let along = |i: i32| 0.1 * f64::from(i);
        let point = |nth: i32| row(MapPoint::Grid, along(nth % 21), along(nth / 21));
        let mut map: Vec<OptimumMapRow> = (0..21 * 21).map(point).collect();
        map.push(row(MapPoint::Present, 0.5, 1.0));
        map.push(row(MapPoint::Optimum, 1.0, 0.0));
        let figure = figure("any-optima", "any", &map);
        let [panel] = &figure.panels[..] else { panic!("{figure:?}") };
        assert_eq!(panel.y_label, "Amplitude of joint 2 (deg)");
        let named = |name: &str| panel.layers.iter().find(|of| of.name == name).expect("a layer");
        for point in named("within 25 %").points.iter().filter(|of| of.x.is_finite()) {
            assert!((value(point.x, point.y) - 1.5).abs() < 0.01, "{point:?}");
        }
        let most = named("edge of what counts").points.iter().fold(0.0, |most, of| of.x.max(most));
        assert!((most - 1.85).abs() < 1e-9, "{most}");
        assert_eq!(named("optimum").points.len(), 1);
        assert!(panel.layers.iter().all(|of| of.name != "of replicates"));
        let drawn = |ending| optimum_drawing(&map, FigureFile { ending, is_synthetic: true });
        assert!(drawn("gif").is_err());
        let svg = String::from_utf8(drawn("svg").expect("is drawn")).expect("text");
        assert!(svg.contains(">Synthetic trials, not recorded</text>"));
    }

    #[test]
    fn of_rows_that_are_no_grid_the_whole_lines_are_drawn() {
        let row = |nth: i32| OptimumMapRow {
            x_command: "omega".to_owned(),
            y_command: "amplitude2".to_owned(),
            x: f64::from(nth % 5),
            y: f64::from(nth / 5),
            value: f64::from(nth),
            ..OptimumMapRow::blank()
        };
        let whole: Vec<OptimumMapRow> = (0..25).map(row).collect();
        let lines = |map: &[OptimumMapRow]| {
            let [x, y, values] = grid(&map.iter().collect::<Vec<_>>());
            assert_eq!(values.len(), x.len() * y.len());
            y.len()
        };
        assert_eq!(lines(&whole), 5);
        // A row is missing, is there twice, is elsewhere; and there are none.
        assert_eq!(lines(&whole[..24]), 4);
        assert_eq!(lines(&[&whole[..13], &whole[12..]].concat()), 2);
        let mut moved = whole.clone();
        moved[17].x = f64::NAN;
        assert_eq!(lines(&moved), 3);
        assert_eq!(lines(&[]), 0);
        // Whatever is left of it, down to a part of one line.
        for left in 1..whole.len() {
            assert_eq!(figure("any-optima", "any", &whole[..left]).panels.len(), 1, "{left}");
        }
    }
}
