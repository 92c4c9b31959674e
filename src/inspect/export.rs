//! Rows for other programs: CSV and JSON, every digit of every number.

use serde::ser::{Serialize, SerializeMap, Serializer};

use super::{Value, View};

/// CSV with a line of names; what is missing is empty.
pub fn csv(view: &View) -> String {
    let line = |cells: &mut dyn Iterator<Item = String>| {
        cells.map(|cell| crate::csv::field(&cell)).collect::<Vec<_>>().join(",") + "\n"
    };
    let names = line(&mut view.columns.iter().map(|column| column.name.clone()));
    let rows = view.rows.iter().map(|row| line(&mut row.iter().map(Value::text)));
    names + &rows.collect::<String>()
}

/// A JSON array of objects, one a line; what is missing or no number is null.
///
/// # Errors
/// None that is known of: cells are plain data.
pub fn json(view: &View) -> serde_json::Result<String> {
    let rows = view.rows.iter().map(|row| serde_json::to_string(&Row { view, row }));
    let rows = rows.collect::<serde_json::Result<Vec<_>>>()?;
    Ok(format!("[{}]", rows.join(",\n ")))
}

struct Row<'v> {
    view: &'v View,
    row: &'v [Value],
}

impl Serialize for Row<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.row.len()))?;
        for (column, value) in self.view.columns.iter().zip(self.row) {
            map.serialize_entry(&column.name, value)?;
        }
        map.end()
    }
}

impl Serialize for Value {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Missing => serializer.serialize_unit(),
            Self::Boolean(boolean) => serializer.serialize_bool(*boolean),
            Self::Whole(whole) => serializer.serialize_i128(*whole),
            Self::Number(number) if number.is_finite() => serializer.serialize_f64(*number),
            Self::Number(_) => serializer.serialize_unit(),
            Self::Text(text) => serializer.serialize_str(text),
            Self::List(list) => list.serialize(serializer),
        }
    }
}
