//! What `optimise --figure` draws.

use std::path::Path;

use crate::cli::Failure;
use crate::optimise::Optimum;
use crate::report::{front_drawing, optimum_drawing, with_unit};
use crate::store::{Objective, OptimumMapRow, write_if_changed};

/// Draws the map of an objective.
pub(super) fn draw(path: &Path, map: &[OptimumMapRow]) -> Result<(), Failure> {
    write_if_changed(path, &optimum_drawing(map, ending(path))?)?;
    Ok(())
}

/// Draws a front of an objective and another one.
pub(super) fn draw_front(
    path: &Path,
    names: [&str; 2],
    [objective, other]: [Objective; 2],
    front: &[Optimum],
) -> Result<(), Failure> {
    let points: Vec<(f64, f64)> = front.iter().map(|of| (other.value_of(of), of.value)).collect();
    let labels = [other, objective].map(with_unit);
    let drawn = front_drawing(names, labels.each_ref().map(String::as_str), &points, ending(path))?;
    write_if_changed(path, &drawn)?;
    Ok(())
}

fn ending(path: &Path) -> &str {
    path.extension().and_then(|ending| ending.to_str()).unwrap_or_default()
}
