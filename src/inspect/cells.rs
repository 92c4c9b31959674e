//! Cells as text and as JSON, every digit of every number.

use polars::prelude::{AnyValue, DataType, Float64Chunked, IntoSeries, PolarsResult, Series};
use polars::prelude::{NamedFrom, StringChunked};
use serde_json::Value as Json;
use trilink_tables::time_text;

use super::View;

/// CSV with a line of names; what is missing is empty. Text that a spreadsheet would compute as a
/// formula has an apostrophe before it.
pub fn csv(view: &View) -> String {
    let as_text = |text: String| match text.starts_with(['=', '+', '-', '@', '\t', '\r']) {
        true => format!("'{text}"),
        false => text,
    };
    let cell = |cell: &AnyValue| match cell.is_primitive_numeric() {
        true => text(cell),
        false => as_text(text(cell)),
    };
    let names = view.columns.iter().map(|column| as_text(column.name.clone())).collect();
    let lines = std::iter::once(names).chain(view.cells(cell));
    lines.map(|cells: Vec<String>| trilink_base::csv::line(&cells)).collect()
}

/// A JSON array of objects, one a line; what is missing or no number is null.
pub fn json(view: &View) -> String {
    let object = |cells: Vec<Json>| {
        let names = view.columns.iter().map(|column| Json::from(column.name.as_str()));
        let fields = names.zip(cells).map(|(name, cell)| format!("{name}:{cell}"));
        format!("{{{}}}", fields.collect::<Vec<_>>().join(","))
    };
    let objects: Vec<String> = view.cells(to_json).into_iter().map(object).collect();
    format!("[{}]", objects.join(",\n "))
}

/// A cell in full, as CSV has it; what is missing is empty, a list's parts stand between commas.
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

/// The number of a cell that need not be whole. 0.1 of 32 bits is 0.1, not its binary expansion.
pub fn float(cell: &AnyValue) -> Option<f64> {
    match cell {
        AnyValue::Float64(number) => Some(*number),
        AnyValue::Float32(number) => number.to_string().parse().ok(),
        _ => None,
    }
}

/// A column by which rows are chosen and sorted: lists, categories and times by their text.
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
    fn text_is_no_formula_of_a_spreadsheet() {
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
    fn numbers_in_full_read_back_as_the_same() {
        let full = |number: f64| text(&AnyValue::Float64(number));
        for number in [0.1, -1.0 / 3.0, 1e-300, 6.02e23, 12.0, 0.0, 1.5e-7] {
            assert_eq!(full(number).parse(), Ok(number));
        }
        assert_eq!(full(1.5e-7), "1.5e-7");
        assert_eq!(full(663.466), "663.466");
    }
}
