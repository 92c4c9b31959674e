//! Marker files as tables.

use std::path::PathBuf;

use polars::prelude::{Column, DataFrame};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use trilink_base::Named as _;
use trilink_mocap::{LengthUnit, Recording, read_markers};

use crate::error::Failure;
use crate::table::accessor;

/// Reads a marker file and returns access to its table, and notes on missing or contradictory metadata. The table has
/// a row for each frame and marker, in the order of the file.
pub fn read<'py>(py: Python<'py>, path: PathBuf, unit: &str) -> PyResult<Bound<'py, PyTuple>> {
    let (frame, doubts) = py.detach(|| {
        let unit = LengthUnit::of_name(unit).ok_or_else(|| {
            Failure::from_argument(format!("unit: found `{unit}`, needed mm, cm, m or in"))
        })?;
        let recording = read_markers(&path, unit)?;
        Ok::<_, Failure>((table(&recording)?, recording.doubts))
    })?;
    (accessor(py, frame)?, doubts).into_pyobject(py)
}

fn table(recording: &Recording) -> Result<DataFrame, Failure> {
    let Recording { rate_hz, frames, labels, positions_mm, .. } = recording;
    let by_marker = |frame: &i64| std::iter::repeat_n(*frame, labels.len());
    let frame: Vec<i64> = frames.iter().flat_map(by_marker).collect();
    let first = frames.first().copied().unwrap_or_default();
    let time_s = |frame: &i64| rate_hz.map(|rate_hz| (frame - first) as f64 / rate_hz);
    let times_s: Vec<Option<f64>> = frame.iter().map(time_s).collect();
    let markers: Vec<&str> =
        frames.iter().flat_map(|_| labels.iter().map(String::as_str)).collect();
    let axis = |axis: usize| -> Vec<f64> { positions_mm.iter().map(|mm| mm[axis]).collect() };
    let rows = frame.len();
    let columns = vec![
        Column::new("frame".into(), frame),
        Column::new("time_s".into(), times_s),
        Column::new("marker".into(), markers),
        Column::new("x_mm".into(), axis(0)),
        Column::new("y_mm".into(), axis(1)),
        Column::new("z_mm".into(), axis(2)),
    ];
    Ok(DataFrame::new(rows, columns)?)
}
