//! Tables by Arrow's C stream interface, in PyCapsules, without a copy.
//!
//! Reference: the Arrow PyCapsule interface, <https://arrow.apache.org/docs/format/CDataInterface/PyCapsuleInterface.html>.

use polars::prelude::{Column, CompatLevel, DataFrame, DataType, Series};
use polars_arrow::array::StructArray;
use polars_arrow::datatypes::{ArrowDataType, Field};
use polars_arrow::ffi::{ArrowArrayStream, export_iterator};
use pyo3::prelude::*;
use pyo3::types::{PyCFunction, PyCapsule};

/// A function that gives a capsule with a stream of the table each time that it is called. All share
/// the table's memory, which is freed with the last of them.
pub fn streams(py: Python<'_>, frame: DataFrame) -> PyResult<Bound<'_, PyCFunction>> {
    PyCFunction::new_closure(py, Some(c"stream"), None, move |arguments, _| {
        let capsule =
            PyCapsule::new_with_value(arguments.py(), stream(&frame), c"arrow_array_stream")?;
        PyResult::Ok(capsule.unbind())
    })
}

/// A record batch for each chunk of the table's columns.
fn stream(frame: &DataFrame) -> ArrowArrayStream {
    let columns = || frame.columns().iter().map(Column::as_materialized_series);
    let fields = columns().map(|column| column.field().to_arrow(level(column)));
    let fields = ArrowDataType::Struct(fields.collect());
    let batch = |chunk: usize| {
        let arrays: Vec<_> =
            columns().map(|column| column.to_arrow(chunk, level(column))).collect();
        let rows = arrays.first().map_or(0, |array| array.len());
        StructArray::new(fields.clone(), rows, arrays, None).boxed()
    };
    let batches: Vec<_> = (0..frame.first_col_n_chunks()).map(batch).collect();
    let field = Field::new("".into(), fields, false);
    export_iterator(Box::new(batches.into_iter().map(Ok)), field)
}

/// As polars has it, but for lists: pandas takes no list of views of text, so that these few cells are
/// copied.
fn level(column: &Series) -> CompatLevel {
    match column.dtype() {
        DataType::List(_) => CompatLevel::oldest(),
        _ => CompatLevel::newest(),
    }
}
