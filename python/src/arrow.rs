//! Zero-copy export of tables to Python through Arrow's C stream interface, in PyCapsules.
//!
//! Reference: the Arrow PyCapsule interface,
//! <https://arrow.apache.org/docs/format/CDataInterface/PyCapsuleInterface.html>.

use polars::prelude::{Column, CompatLevel, DataFrame, DataType, Series};
use polars_arrow::array::StructArray;
use polars_arrow::datatypes::{ArrowDataType, Field};
use polars_arrow::ffi::{ArrowArrayStream, export_iterator};
use pyo3::prelude::*;
use pyo3::types::PyCapsule;

/// Returns a capsule with an Arrow stream of the table. All streams share the table's memory, which is freed with the
/// last stream.
pub fn stream<'py>(py: Python<'py>, frame: &DataFrame) -> PyResult<Bound<'py, PyCapsule>> {
    PyCapsule::new_with_value(py, export(frame), c"arrow_array_stream")
}

/// Returns an Arrow stream with one record batch for each chunk of the table's columns.
fn export(frame: &DataFrame) -> ArrowArrayStream {
    let columns = || frame.columns().iter().map(Column::as_materialized_series);
    let fields = columns().map(|column| column.field().to_arrow(level(column)));
    let fields = ArrowDataType::Struct(fields.collect());
    let mut batches = Vec::new();
    for chunk in 0..frame.first_col_n_chunks() {
        let arrays: Vec<_> =
            columns().map(|column| column.to_arrow(chunk, level(column))).collect();
        let rows = arrays.first().map_or(0, |array| array.len());
        batches.push(StructArray::new(fields.clone(), rows, arrays, None).boxed());
    }
    let field = Field::new("".into(), fields, false);
    export_iterator(Box::new(batches.into_iter().map(Ok)), field)
}

/// Returns the Arrow compatibility level with which a column is exported: the newest level, except for lists, because
/// pandas does not accept lists of string views (the few list columns are copied).
fn level(column: &Series) -> CompatLevel {
    match column.dtype() {
        DataType::List(_) => CompatLevel::oldest(),
        _ => CompatLevel::newest(),
    }
}
