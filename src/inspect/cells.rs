//! Conversion of table cells to text and JSON; numbers keep all their digits.

use polars::prelude::{AnyValue, DataType, Float64Chunked, IntoSeries, PolarsResult, Series};
use polars::prelude::{NamedFrom, StringChunked};
use serde_json::Value as Json;
use trilink_tables::time_text;

use super::View;

/// Formats a view as CSV with a header line. Missing values are empty. Text that a spreadsheet would evaluate as a
/// formula is preceded by an apostrophe.
pub fn csv(view: &View) -> String {
    let names = view.columns.iter().map(|column| escape_formula(column.name.clone())).collect();
    let rows = view.cells(|cell| {
        if cell.is_primitive_numeric() { text(cell) } else { escape_formula(text(cell)) }
    });
    let lines = std::iter::once(names).chain(rows);
    lines.map(|cells: Vec<String>| trilink_base::csv::line(&cells)).collect()
}

/// Puts an apostrophe before text that a spreadsheet would evaluate as a formula.
fn escape_formula(text: String) -> String {
    if text.starts_with(['=', '+', '-', '@', '\t', '\r']) { format!("'{text}") } else { text }
}

/// Formats a view as a JSON array of objects, one per line. Missing values and NaN become null.
pub fn json(view: &View) -> String {
    let objects = view.cells(to_json).into_iter().map(|cells| {
        let names = view.columns.iter().map(|column| Json::from(column.name.as_str()));
        let fields = names.zip(cells).map(|(name, cell)| format!("{name}:{cell}"));
        format!("{{{}}}", fields.collect::<Vec<_>>().join(","))
    });
    let objects: Vec<String> = objects.collect();
    format!("[{}]", objects.join(",\n "))
}

/// Formats a cell with all digits. A missing value is empty; the elements of a list are separated by commas.
pub fn text(cell: &AnyValue) -> String {
    if let Some(number) = float(cell) {
        let is_plain = number == 0.0 || (1e-5..1e16).contains(&number.abs());
        let is_plain = is_plain || !number.is_finite();
        return if is_plain { number.to_string() } else { format!("{number:e}") };
    }
    match cell {
        AnyValue::Boolean(boolean) => boolean.to_string(),
        AnyValue::List(list) => list.iter().map(|cell| text(&cell)).collect::<Vec<_>>().join(", "),
        AnyValue::Datetime(..) => time_text(cell).unwrap_or_default(),
        cell => match (cell.get_str(), cell.extract::<i128>()) {
            (Some(text), _) => text.to_owned(),
            (None, whole) => whole.map_or(String::new(), |whole| whole.to_string()),
        },
    }
}

fn to_json(cell: &AnyValue) -> Json {
    match cell {
        AnyValue::Boolean(boolean) => (*boolean).into(),
        AnyValue::List(list) => list.iter().map(|cell| to_json(&cell)).collect(),
        AnyValue::UInt64(whole) => (*whole).into(),
        AnyValue::Datetime(..) => time_text(cell).into(),
        cell if cell.is_integer() => cell.extract::<i64>().into(),
        cell => cell.get_str().map_or_else(|| float(cell).into(), Json::from),
    }
}

/// Returns the number in a floating-point cell; `None` for other cells. A 32-bit number is converted by its shortest
/// decimal, so that 0.1 stays 0.1.
pub fn float(cell: &AnyValue) -> Option<f64> {
    match cell {
        AnyValue::Float64(number) => Some(*number),
        AnyValue::Float32(number) => number.to_string().parse().ok(),
        _ => None,
    }
}

/// Converts a column to a form suited to comparisons and sorting: lists, categories and times become text.
pub(super) fn comparable(series: &Series) -> PolarsResult<Series> {
    let name = series.name().clone();
    Ok(match series.dtype() {
        DataType::List(_)
        | DataType::Categorical(..)
        | DataType::Enum(..)
        | DataType::Datetime(..) => {
            let cells = series.iter().map(|cell| (!cell.is_null()).then(|| text(&cell)));
            StringChunked::new(name, cells.collect::<Vec<_>>()).into_series()
        }
        DataType::Float32 => {
            let numbers = series.iter().map(|cell| float(&cell));
            Float64Chunked::new(name, numbers.collect::<Vec<_>>()).into_series()
        }
        DataType::Null => series.cast(&DataType::Float64)?,
        _ => series.clone(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreadsheet_formulas_are_escaped() {
        let frame = polars::prelude::df!("=x" => ["=1+1", "-a", "a=b"], "n" => [-1.5, 2.0, 3.0]);
        let column = |name: &str| crate::inspect::ColumnInfo {
            name: name.to_owned(),
            type_name: String::new(),
            dtype: None,
        };
        let view = View {
            columns: vec![column("=x"), column("n")],
            frame: frame.unwrap(),
            total: 3,
            left_out: Vec::new(),
        };
        assert_eq!(csv(&view), "'=x,n\n'=1+1,-1.5\n'-a,2\na=b,3\n");
    }

    #[test]
    fn formatted_numbers_parse_to_the_same_value() {
        let full = |number: f64| text(&AnyValue::Float64(number));
        for number in [0.1, -1.0 / 3.0, 1e-300, 6.02e23, 12.0, 0.0, 1.5e-7] {
            assert_eq!(full(number).parse(), Ok(number));
        }
        assert_eq!(full(1.5e-7), "1.5e-7");
        assert_eq!(full(663.466), "663.466");
    }
}
