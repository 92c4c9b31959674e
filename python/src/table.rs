//! Tables in Python: a function with access to a table in memory, which `trilink.Table` wraps.

use polars::prelude::{AnyValue, Column, DataFrame, DataType, PolarsError, TimeUnit};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyCFunction, PyDict, PyList, PyTuple};
use serde_json::json;
use trilink::inspect::{meaning, unit};

use crate::arrow::stream;
use crate::error::Failure;

/// Returns a Python function that gives access to a table. Its first argument is the operation; see [`access`].
pub fn accessor(py: Python<'_>, mut frame: DataFrame) -> PyResult<Bound<'_, PyCFunction>> {
    frame.align_chunks();
    let call = move |arguments: &Bound<'_, PyTuple>, _: Option<&Bound<'_, PyDict>>| {
        access(arguments, &frame).map(Bound::unbind)
    };
    PyCFunction::new_closure(py, Some(c"access"), None, call)
}

/// Carries out an operation on a table:
/// - `describe`: the number of rows, and a JSON array with name, unit and meaning of each column;
/// - `stream`: a capsule with an Arrow stream of the table;
/// - `column`, name: the NumPy type of a column and its values in native byte order, or as a list of objects;
/// - `slice`, offset, length: access to some of the rows;
/// - `select`, names: access to some of the columns.
fn access<'py>(arguments: &Bound<'py, PyTuple>, frame: &DataFrame) -> PyResult<Bound<'py, PyAny>> {
    let py = arguments.py();
    let operation: String = arguments.get_item(0)?.extract()?;
    match operation.as_str() {
        "describe" => {
            let names = frame.get_column_names().into_iter();
            let columns: Vec<_> = names
                .map(
                    |name| json!({ "name": &**name, "unit": unit(name), "meaning": meaning(name) }),
                )
                .collect();
            let columns = serde_json::Value::from(columns).to_string();
            Ok((frame.height(), columns).into_pyobject(py)?.into_any())
        }
        "stream" => Ok(stream(py, frame)?.into_any()),
        "column" => {
            let name: String = arguments.get_item(1)?.extract()?;
            let column = frame.column(&name).map_err(|_| PyKeyError::new_err(name))?;
            values(py, column)
        }
        "slice" => {
            let (offset, length): (i64, usize) =
                (arguments.get_item(1)?.extract()?, arguments.get_item(2)?.extract()?);
            Ok(accessor(py, frame.slice(offset, length))?.into_any())
        }
        _ => {
            let names: Vec<String> = arguments.get_item(1)?.extract()?;
            let selected = frame.select(names.iter().map(String::as_str)).map_err(Failure::from)?;
            Ok(accessor(py, selected)?.into_any())
        }
    }
}

/// Returns the NumPy type of a column with its values. Missing numbers are NaN, missing times NaT, and other missing
/// values None.
fn values<'py>(py: Python<'py>, column: &Column) -> PyResult<Bound<'py, PyAny>> {
    let (kind, bytes) = match column.dtype() {
        DataType::Boolean if column.null_count() == 0 => {
            let booleans = column.bool().map_err(Failure::from)?;
            ("?", booleans.iter().map(|value| u8::from(value == Some(true))).collect())
        }
        DataType::Datetime(unit, _) => {
            let kind = match unit {
                TimeUnit::Nanoseconds => "M8[ns]",
                TimeUnit::Microseconds => "M8[us]",
                TimeUnit::Milliseconds => "M8[ms]",
            };
            (kind, integers(&column.to_physical_repr()).map_err(Failure::from)?)
        }
        kind if kind.is_integer() && column.null_count() == 0 => {
            ("i8", integers(column).map_err(Failure::from)?)
        }
        kind if kind.is_primitive_numeric() => {
            let floats = column.cast(&DataType::Float64).map_err(Failure::from)?;
            let floats = floats.f64().map_err(Failure::from)?;
            let bytes = floats.iter().flat_map(|value| value.unwrap_or(f64::NAN).to_ne_bytes());
            ("f8", bytes.collect::<Vec<u8>>())
        }
        _ => {
            let cells = column.as_materialized_series().iter().map(|cell| object(py, &cell));
            let cells = PyList::new(py, cells.collect::<PyResult<Vec<_>>>()?)?;
            return Ok(("O", cells).into_pyobject(py)?.into_any());
        }
    };
    Ok((kind, PyByteArray::new(py, &bytes)).into_pyobject(py)?.into_any())
}

/// Returns the values of an integer column as 64-bit integers; missing values are the least integer (NaT).
fn integers(column: &Column) -> Result<Vec<u8>, PolarsError> {
    let integers = column.cast(&DataType::Int64)?;
    let values = integers.i64()?.iter();
    Ok(values.flat_map(|value| value.unwrap_or(i64::MIN).to_ne_bytes()).collect())
}

/// Converts a cell to a Python object.
fn object<'py>(py: Python<'py>, cell: &AnyValue) -> PyResult<Bound<'py, PyAny>> {
    Ok(match cell {
        AnyValue::Null => py.None().into_bound(py),
        AnyValue::Boolean(value) => value.into_pyobject(py)?.to_owned().into_any(),
        AnyValue::List(items) => {
            let items = items.iter().map(|item| object(py, &item));
            PyList::new(py, items.collect::<PyResult<Vec<_>>>()?)?.into_any()
        }
        cell => match (cell.get_str(), cell.extract::<f64>()) {
            (Some(text), _) => text.into_pyobject(py)?.into_any(),
            (None, Some(number)) if cell.is_integer() => {
                (number as i64).into_pyobject(py)?.into_any()
            }
            (None, Some(number)) => number.into_pyobject(py)?.into_any(),
            (None, None) => cell.to_string().into_pyobject(py)?.into_any(),
        },
    })
}

/// Returns access to a table of the given columns, each a list of numbers (None if missing) or of texts.
pub fn from_columns<'py>(
    py: Python<'py>,
    columns: Vec<(String, Bound<'py, PyAny>)>,
) -> PyResult<Bound<'py, PyCFunction>> {
    let columns = columns.into_iter().map(|(name, values)| {
        Ok(match values.extract::<Vec<Option<f64>>>() {
            Ok(numbers) => Column::new(name.into(), numbers),
            Err(_) => Column::new(name.into(), values.extract::<Vec<String>>()?),
        })
    });
    let columns: Vec<Column> = columns.collect::<PyResult<_>>()?;
    let rows = columns.first().map_or(0, Column::len);
    accessor(py, DataFrame::new(rows, columns).map_err(Failure::from)?)
}
