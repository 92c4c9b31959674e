//! Figures of optimal gaits: each objective against the gait commands to which it is most sensitive.

use std::collections::BTreeSet;

use minijinja::context;
use trilink_plot::{Figure, Layer, Layout, Panel, Scale};
use trilink_robot::Model;
use trilink_tables::{MapPoint, Objective, OptimumMapRow};

use super::contour::{contour, refined};
use super::ending::{FigureFile, drawn};
use super::figures::texts;
use super::{FREQUENCY, ReportError, looks};

/// Layer name for gaits outside the range covered by the trials to which the coefficients were fitted.
const EXTRAPOLATED: &str = "extrapolated";
/// Levels of the contour lines: relative differences of an objective from its best value.
const WITHIN: [f64; 5] = [0.01, 0.05, 0.1, 0.25, 0.5];

/// Draws the map of an objective as a function of one or two gait commands, in the format that `file` specifies.
///
/// # Errors
/// Returns an error if the file's extension is not `svg`, `png` or `pdf`, or if the figure cannot be drawn.
pub fn optimum_drawing(
    map: &[OptimumMapRow],
    file: FigureFile<'_>,
) -> Result<Vec<u8>, ReportError> {
    drawn(&figure("optimum", map.first().map_or("", |row| &row.campaign), map), file)
}

/// Draws the Pareto front of two objectives, in the format that `file` specifies.
///
/// Each entry of `points` is a gait on the front: the values of the two objectives, and whether the gait is
/// extrapolated; `present` has the values of the current gait. `along` and `up` are the labels of the horizontal and
/// vertical axes.
///
/// # Errors
/// Returns an error if the file's extension is not `svg`, `png` or `pdf`, or if the figure cannot be drawn.
pub fn front_drawing(
    [campaign, model]: [&str; 2],
    [along, up]: [&str; 2],
    points: &[(f64, f64, bool)],
    present: Option<(f64, f64)>,
    file: FigureFile<'_>,
) -> Result<Vec<u8>, ReportError> {
    let front = points.iter().map(|(x, y, _)| (*x, *y));
    let [measured, extrapolated] = [false, true].map(|wanted| {
        let gaits = points.iter().filter(move |(.., is_extrapolated)| *is_extrapolated == wanted);
        gaits.map(|(x, y, _)| (*x, *y))
    });
    let mut layers = vec![
        Layer::new("front", front, looks::RECORDED),
        Layer::new("gaits on the front", measured, looks::OPTIMUM),
        Layer::new(EXTRAPOLATED, extrapolated, looks::EXTRAPOLATED),
        Layer::new("current gait", present, looks::PRESENT),
    ];
    layers.retain(|layer| !layer.points.is_empty());
    let title = format!("Pareto-optimal gaits of {campaign}, {model}");
    // The gaits are spaced by equal ratios.
    let panel = Panel {
        x_scale: Scale::Decades,
        y_scale: Scale::Decades,
        ..Panel::new("", along, up, layers)
    };
    let titles = [title, String::new()];
    drawn(&Figure::new("front", titles, &[campaign], Layout::Stack, vec![panel]), file)
}

/// Returns the figure of a campaign's objectives as functions of the gait commands, with one panel for each model and
/// objective.
pub(crate) fn figure<'r>(
    stem: &str,
    campaign: &str,
    maps: impl IntoIterator<Item = &'r OptimumMapRow>,
) -> Figure {
    let maps: Vec<&OptimumMapRow> = maps.into_iter().collect();
    let models: BTreeSet<Model> = maps.iter().map(|row| row.model).collect();
    let panels = maps
        .chunk_by(|a, b| (a.model, a.objective) == (b.model, b.objective))
        .map(|map| panel(map, models.len() > 1));
    let panels: Vec<Panel> = panels.collect();
    let models: Vec<&str> = models.iter().map(|model| model.name()).collect();
    let texts = texts("optima", context! { campaign, models });
    let layout = if panels.len() > 1 { Layout::Grid } else { Layout::Stack };
    Figure::new(stem, texts, &[campaign], layout, panels)
}

/// Returns the panel for one objective as a function of the gait commands. The panel's title names the model if the
/// figure shows several models (`has_others`).
fn panel(map: &[&OptimumMapRow], has_others: bool) -> Panel {
    let OptimumMapRow { model, objective, x_command, y_command, .. } = map[0];
    let model = if has_others { format!(", {model}") } else { String::new() };
    let title = with_unit(*objective) + &model;
    let panel = if y_command.is_empty() {
        curve(map, &label(x_command))
    } else {
        plane(map, [x_command, y_command].map(|command| label(command)))
    };
    Panel { title, ..panel }
}

/// Returns the axis label for a gait command.
fn label(command: &str) -> String {
    if let Some((link, kind)) =
        command.strip_prefix("rotor.").and_then(|rotor| rotor.rsplit_once('.'))
    {
        let kind = match kind {
            "amplitude" => "Amplitude",
            "phase" => "Phase",
            "second_in_phase" => "In-phase second harmonic",
            _ => "Quadrature second harmonic",
        };
        return format!("{kind} of the rotor of {link} (deg)");
    }
    let kind = command.trim_end_matches(|c: char| c.is_ascii_digit());
    let joint = &command[kind.len()..];
    match kind {
        "offset" => format!("Offset of joint {joint} (deg)"),
        "amplitude" => format!("Amplitude of joint {joint} (deg)"),
        "phase" => format!("Phase of joint {joint} (deg)"),
        "torque" => format!("Torque of joint {joint} (N m)"),
        "mean" => format!("Mean torque of joint {joint} (N m)"),
        "second_in_phase" => format!("In-phase second harmonic of joint {joint} (deg)"),
        "second_quadrature" => format!("Quadrature second harmonic of joint {joint} (deg)"),
        _ => FREQUENCY.to_owned(),
    }
}

/// Returns the axis label for an objective: its name with the unit.
pub fn with_unit(objective: Objective) -> String {
    format!("{objective} ({})", objective.unit())
}

/// Returns the x coordinates, the y coordinates and the objective values of a map's grid; incomplete grid lines at the
/// end are dropped.
fn grid(map: &[&OptimumMapRow]) -> [Vec<f64>; 3] {
    let grid: Vec<&OptimumMapRow> =
        map.iter().copied().filter(|row| row.point == MapPoint::Grid).collect();
    let across = grid.iter().take_while(|row| row.y.total_cmp(&grid[0].y).is_eq()).count();
    let lines: Vec<_> = grid
        .chunks_exact(across.max(1))
        .take_while(|line| {
            line.iter().zip(&grid).all(|(row, first)| {
                row.x.total_cmp(&first.x).is_eq() && row.y.total_cmp(&line[0].y).is_eq()
            })
        })
        .collect();
    let x = grid.iter().take(across).map(|row| row.x).collect();
    let y = lines.iter().map(|line| line[0].y).collect();
    [x, y, lines.concat().iter().map(|row| row.value).collect()]
}

/// Returns the markers for the optimum, the campaign's configured gait and the optima of the bootstrap replicates;
/// `point` returns the position of a row in the panel.
fn marks(map: &[&OptimumMapRow], point: impl Fn(&OptimumMapRow) -> (f64, f64)) -> Vec<Layer> {
    let mut optima = map.iter().filter(|row| row.point == MapPoint::Optimum);
    let optimum = if optima.any(|row| row.extrapolated == Some(true)) {
        ("optimum, extrapolated", MapPoint::Optimum, looks::EXTRAPOLATED)
    } else {
        ("optimum", MapPoint::Optimum, looks::OPTIMUM)
    };
    let kinds = [
        ("optima of replicates", MapPoint::Replicate, looks::REPLICATES),
        ("current gait", MapPoint::Present, looks::PRESENT),
        optimum,
    ];
    let layers = kinds.into_iter().map(|(name, kind, look)| {
        let points = map.iter().filter(|row| row.point == kind).map(|row| point(row));
        Layer::new(name, points, look)
    });
    layers.filter(|layer| !layer.points.is_empty()).collect()
}

/// Returns the panel with contour lines of an objective over two gait commands.
fn plane(map: &[&OptimumMapRow], [label_x, label_y]: [String; 2]) -> Panel {
    let [x, y, values] = grid(map);
    let best = map.iter().find(|row| row.point == MapPoint::Optimum);
    let best_value = best.map_or(f64::NAN, |row| row.value);
    let worse = if best.is_some_and(|row| row.objective.is_minimised()) { 1.0 } else { -1.0 };
    let measured: Vec<f64> = measured(map, values.len());
    let [fine_x, fine_y, fine_values] = refined(&x, &y, &values);
    let mut layers = vec![
        Layer::new("edge of the feasible gaits", edge(&x, &y, &values), looks::EDGE),
        Layer::new("edge of the trials", edge(&x, &y, &measured), looks::TRIALS_EDGE),
    ];
    layers.extend(WITHIN.into_iter().enumerate().rev().map(|(nth, part)| {
        let points = contour(&fine_x, &fine_y, &fine_values, best_value * (1.0 + worse * part));
        Layer::new(&format!("within {} %", 100.0 * part), points, looks::within(nth))
    }));
    layers.retain(|layer| !layer.points.is_empty());
    layers.extend(marks(map, |row| (row.x, row.y)));
    Panel::new("", &label_x, label_y.as_str(), layers)
}

/// Returns one value for each of the first `count` grid points: 1 if the gait is known to lie within the range of the
/// trials, otherwise NaN.
fn measured(map: &[&OptimumMapRow], count: usize) -> Vec<f64> {
    let grid = map.iter().filter(|row| row.point == MapPoint::Grid).take(count);
    grid.map(|row| if row.extrapolated == Some(false) { 1.0 } else { f64::NAN }).collect()
}

/// Returns the boundary of the region whose grid points have values. It runs halfway between neighbouring points with
/// and without a value, and along the sides of the grid; it is empty for a single line of grid points.
fn edge(x: &[f64], y: &[f64], values: &[f64]) -> Vec<(f64, f64)> {
    if x.len().min(y.len()) < 2 {
        return Vec::new();
    }
    let widened = |along: &[f64]| [&along[..1], along, &along[along.len() - 1..]].concat();
    let wide_x = widened(x);
    let wide_y = widened(y);
    let mut is_known = vec![0.0; wide_x.len() * wide_y.len()];
    for (nth, _) in values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
        is_known[(1 + nth / x.len()) * wide_x.len() + 1 + nth % x.len()] = 1.0;
    }
    contour(&wide_x, &wide_y, &is_known, 0.5)
}

/// Returns the panel with an objective plotted against one gait command.
fn curve(map: &[&OptimumMapRow], label: &str) -> Panel {
    let [along, _, values] = grid(map);
    let objective = map.first().map_or(String::new(), |row| with_unit(row.objective));
    let points = along.iter().copied().zip(values.iter().copied());
    let extrapolated = map.iter().filter(|row| row.point == MapPoint::Grid).take(along.len());
    let extrapolated = extrapolated.map(|row| {
        let is_extrapolated = row.extrapolated == Some(true);
        (row.x, if is_extrapolated { row.value } else { f64::NAN })
    });
    let extrapolated = Layer::new(EXTRAPOLATED, extrapolated, looks::TRIALS_EDGE);
    let mut layers = vec![Layer::new(&objective, points, looks::RECORDED)];
    if extrapolated.points.iter().any(|point| point.y.is_finite()) {
        layers.push(extrapolated);
    }
    layers.extend(marks(map, |row| {
        let known = along.iter().zip(&values).filter(|(_, value)| value.is_finite());
        let nearest =
            known.min_by(|(a, _), (b, _)| (*a - row.x).abs().total_cmp(&(*b - row.x).abs()));
        (row.x, nearest.map_or(f64::NAN, |(_, value)| *value))
    }));
    Panel::new("", label, objective.as_str(), layers)
}

#[cfg(test)]
mod tests {
    use trilink_tables::Columns;

    use super::*;

    #[test]
    fn contour_lines_surround_the_optimum_and_a_boundary_the_feasible_gaits() {
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
        let largest = named("edge of the feasible gaits")
            .points
            .iter()
            .fold(0.0, |largest, point| point.x.max(largest));
        assert!((largest - 1.85).abs() < 1e-9, "{largest}");
        assert_eq!(named("optimum").points.len(), 1);
        assert!(panel.layers.iter().all(|layer| layer.name != "optima of replicates"));
        let file = |ending| FigureFile { ending, is_synthetic: true, print: Default::default() };
        let drawn = |ending| optimum_drawing(&map, file(ending));
        assert!(drawn("gif").is_err());
        let svg = String::from_utf8(drawn("svg").expect("is drawn")).expect("text");
        assert!(svg.contains(">Synthetic trials, not recorded</text>"));
    }

    #[test]
    fn only_complete_lines_of_an_incomplete_grid_are_drawn() {
        let whole: Vec<OptimumMapRow> = (0..25)
            .map(|nth| OptimumMapRow {
                x_command: "omega".to_owned(),
                y_command: "amplitude2".to_owned(),
                x: f64::from(nth % 5),
                y: f64::from(nth / 5),
                value: f64::from(nth),
                ..OptimumMapRow::blank()
            })
            .collect();
        let lines = |map: &[OptimumMapRow]| {
            let [x, y, values] = grid(&map.iter().collect::<Vec<_>>());
            assert_eq!(values.len(), x.len() * y.len());
            y.len()
        };
        assert_eq!(lines(&whole), 5);
        // In turn: one row is missing, one is duplicated, one is misplaced, and all are missing.
        assert_eq!(lines(&whole[..24]), 4);
        assert_eq!(lines(&[&whole[..13], &whole[12..]].concat()), 2);
        let mut moved = whole.clone();
        moved[17].x = f64::NAN;
        assert_eq!(lines(&moved), 3);
        assert_eq!(lines(&[]), 0);
        // Any subset of the rows can be drawn.
        for left in 1..whole.len() {
            assert_eq!(figure("any-optima", "any", &whole[..left]).panels.len(), 1, "{left}");
        }
    }
}
