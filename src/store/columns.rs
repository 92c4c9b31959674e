//! What a value is in a table: one column, or several of which each has a part of it.

use polars::prelude::{
    BooleanChunked, ChunkFull, ChunkSet, ChunkTake, Column, DataType, Float64Chunked, IdxCa,
    IdxSize, Int64Chunked, IntoColumn, ListBuilderTrait, ListStringChunkedBuilder, NewChunkedArray,
    PolarsResult, Series, StringChunked,
};

use super::{StoreError, Table};
use crate::metrics::{Estimate, GaitMetrics};
use crate::named::Named;
use crate::robot::{ByParameter, Parameter};

/// A value that a table keeps in one column or in several.
///
/// A pattern names them: in the place of its `{}` comes the name that a part has within the value.
pub trait Columns: Sized {
    /// The pattern for a field that names none: that of a single column is the field's name.
    fn pattern(field: &str) -> String {
        field.to_owned()
    }

    /// Nothing: numbers missing, counts 0, texts empty, of an enumeration its first value.
    fn missing() -> Self;

    /// Adds the columns of one value a row.
    fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>);

    /// One value a row.
    ///
    /// # Errors
    /// A column is not there, or holds something else.
    fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError>;
}

/// A struct whose fields are the columns of a table.
pub trait Rows: Columns {
    /// A row that says nothing.
    fn blank() -> Self {
        Self::missing()
    }

    /// The table of these rows, in order.
    fn to_table(rows: &[Self]) -> Table {
        let mut columns = Vec::new();
        Self::write(&rows.iter().collect::<Vec<_>>(), "{}", &mut columns);
        Table::new(columns)
    }

    /// The rows of a table.
    ///
    /// # Errors
    /// A column is missing or of another type.
    fn from_table(table: &Table) -> Result<Vec<Self>, StoreError> {
        Self::read(table, "{}")
    }
}

impl<T: Columns> Rows for T {}

/// A pattern with the name of a part, or with the part's own pattern.
pub(crate) fn fill(pattern: &str, part: &str) -> String {
    pattern.replacen("{}", part, 1)
}

/// Moves the columns from `first` on, each behind the column that `after` names with the same
/// part, or all behind one column.
pub(crate) fn interleave(columns: &mut Vec<Column>, first: usize, pattern: &str, after: &str) {
    let (start, end) = pattern.split_once("{}").unwrap_or((pattern, ""));
    for (nth, column) in columns.split_off(first).into_iter().enumerate() {
        let part = column.name().strip_prefix(start).and_then(|name| name.strip_suffix(end));
        let before = fill(after, part.unwrap_or_default());
        let offset = if after.contains("{}") { 0 } else { nth };
        let index = columns.iter().position(|column| column.name() == before.as_str());
        columns.insert(index.map_or(columns.len(), |index| index + 1 + offset), column);
    }
}

/// Implements [`Columns`] for a struct by its fields; a field can have a pattern (`as`) and stand
/// behind columns of earlier ones (`after`).
macro_rules! columns {
    ($name:ident { $($field:ident: $type:ty $(as $pattern:literal $(after $after:literal)?)?,)* }) => {
        impl $crate::store::Columns for $name {
            fn pattern(_: &str) -> String {
                "{}".to_owned()
            }

            fn missing() -> Self {
                Self { $($field: <$type as $crate::store::Columns>::missing(),)* }
            }

            fn write(
                values: &[&Self],
                pattern: &str,
                columns: &mut Vec<polars::prelude::Column>,
            ) {
                use $crate::store::columns::{Columns, fill};
                $({
                    let own = [
                        $($pattern.to_owned(),)?
                        <$type as Columns>::pattern(stringify!($field)),
                    ];
                    let own = fill(pattern, &own[0]);
                    let parts: Vec<&$type> = values.iter().map(|value| &value.$field).collect();
                    let _first = columns.len();
                    <$type as Columns>::write(&parts, &own, columns);
                    $($($crate::store::columns::interleave(columns, _first, &own, &fill(pattern, $after));)?)?
                })*
            }

            fn read(
                table: &$crate::store::Table,
                pattern: &str,
            ) -> Result<Vec<Self>, $crate::store::StoreError> {
                use $crate::store::columns::{Columns, fill};
                $(
                    let own = [
                        $($pattern.to_owned(),)?
                        <$type as Columns>::pattern(stringify!($field)),
                    ];
                    let mut $field =
                        <$type as Columns>::read(table, &fill(pattern, &own[0]))?.into_iter();
                )*
                let row = || Some(Self { $($field: $field.next()?,)* });
                Ok(std::iter::from_fn(row).collect())
            }
        }
    };
}

/// Defines a struct whose fields are columns, see [`columns!`].
macro_rules! rows {
    ($(#[$meta:meta])* pub struct $name:ident {
        $(
            $(#[$field_meta:meta])*
            pub $field:ident: $type:ty $(as $pattern:literal $(after $after:literal)?)?,
        )*
    }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq)]
        pub struct $name { $($(#[$field_meta])* pub $field: $type,)* }

        $crate::store::columns::columns! {
            $name { $($field: $type $(as $pattern $(after $after)?)?,)* }
        }
    };
}

pub(crate) use {columns, rows};

columns! {
    GaitMetrics {
        d_m: f64,
        v_m_s: f64,
        sigma: [f64; 3] as "sigma{}",
        alpha1_rad: f64,
        dtheta_rad: f64,
    }
}

/// The value, and the standard error with `_se` behind its name.
impl Columns for Estimate {
    fn pattern(field: &str) -> String {
        format!("{field}{{}}")
    }

    fn missing() -> Self {
        Self::MISSING
    }

    fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>) {
        columns.push(numbers(&fill(pattern, ""), values.iter().map(|of| of.value).collect()));
        columns.push(numbers(&fill(pattern, "_se"), values.iter().map(|of| of.se).collect()));
    }

    fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError> {
        let values = f64::read(table, &fill(pattern, ""))?;
        let errors = f64::read(table, &fill(pattern, "_se"))?;
        Ok(values.into_iter().zip(errors).map(|(value, se)| Self { value, se }).collect())
    }
}

/// Links and wheels are 0, 1, 2; joints are 1 and 2.
impl<T: Columns, const N: usize> Columns for [T; N] {
    fn missing() -> Self {
        std::array::from_fn(|_| T::missing())
    }

    fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>) {
        for i in 0..N {
            let parts: Vec<&T> = values.iter().map(|value| &value[i]).collect();
            T::write(&parts, &fill(pattern, &number::<N>(i)), columns);
        }
    }

    fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError> {
        let part = |i| T::read(table, &fill(pattern, &number::<N>(i)));
        let parts = (0..N).map(part).collect::<Result<Vec<_>, _>>()?;
        Ok(across(parts, table.len(), |part| std::array::from_fn(part)))
    }
}

fn number<const N: usize>(i: usize) -> String {
    (i + usize::from(N == 2)).to_string()
}

impl<T: Columns> Columns for ByParameter<T> {
    fn pattern(_: &str) -> String {
        "{}".to_owned()
    }

    fn missing() -> Self {
        Self::from_fn(|_| T::missing())
    }

    fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>) {
        for parameter in Parameter::ALL {
            let parts: Vec<&T> = values.iter().map(|value| &value[parameter]).collect();
            T::write(&parts, &fill(pattern, parameter.column()), columns);
        }
    }

    fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError> {
        let part = |of: Parameter| T::read(table, &fill(pattern, of.column()));
        let parts = Parameter::ALL.into_iter().map(part).collect::<Result<Vec<_>, _>>()?;
        Ok(across(parts, table.len(), |part| Self::from_fn(|of| part(of as usize))))
    }
}

/// Rows of columns: `row` makes one from what gives its parts by their index.
fn across<T: Columns, R>(
    parts: Vec<Vec<T>>,
    rows: usize,
    row: impl Fn(&mut dyn FnMut(usize) -> T) -> R,
) -> Vec<R> {
    let mut parts: Vec<_> = parts.into_iter().map(Vec::into_iter).collect();
    let mut part = |i: usize| parts[i].next().unwrap_or_else(T::missing);
    (0..rows).map(|_| row(&mut part)).collect()
}

impl Columns for f64 {
    fn missing() -> Self {
        f64::NAN
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        columns.push(numbers(name, values.iter().map(|value| **value).collect()));
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        let needed = ("numbers", DataType::is_primitive_numeric as fn(&_) -> _);
        let column = table.column(name, needed, &DataType::Float64)?;
        let values = column.f64().map_err(|error| table.error(&error))?;
        Ok(values.iter().map(|value| value.unwrap_or(f64::NAN)).collect())
    }
}

impl Columns for Option<i64> {
    fn missing() -> Self {
        None
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        let values: Int64Chunked = values.iter().map(|value| **value).collect();
        columns.push(values.with_name(name.into()).into_column());
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        let needed = ("whole numbers", DataType::is_integer as fn(&_) -> _);
        let column = table.column(name, needed, &DataType::Int64)?;
        Ok(column.i64().map_err(|error| table.error(&error))?.iter().collect())
    }
}

impl Columns for i64 {
    fn missing() -> Self {
        0
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        columns.push(whole_numbers(name, values.iter().map(|value| **value).collect()));
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        let values = <Option<i64>>::read(table, name)?;
        let all: Option<Vec<i64>> = values.into_iter().collect();
        all.ok_or_else(|| table.wrong(name, "missing values", "whole numbers"))
    }
}

impl Columns for bool {
    fn missing() -> Self {
        false
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        let values: BooleanChunked = values.iter().map(|value| **value).collect();
        columns.push(values.with_name(name.into()).into_column());
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        let needed = ("booleans", DataType::is_bool as fn(&_) -> _);
        let column = table.column(name, needed, &DataType::Boolean)?;
        let values = column.bool().map_err(|error| table.error(&error))?;
        let all: Option<Vec<bool>> = values.iter().collect();
        all.ok_or_else(|| table.wrong(name, "missing values", "booleans"))
    }
}

/// A value that a table keeps as text.
pub trait Text: Sized {
    /// See [`Columns::missing`].
    fn nothing() -> Self;
    fn as_text(&self) -> &str;
    /// `None` if no value has this text.
    fn of_text(text: &str) -> Option<Self>;
}

impl Text for String {
    fn nothing() -> Self {
        Self::new()
    }

    fn as_text(&self) -> &str {
        self
    }

    fn of_text(text: &str) -> Option<Self> {
        Some(text.to_owned())
    }
}

impl<T: Named> Text for T {
    fn nothing() -> Self {
        T::VALUES[0]
    }

    fn as_text(&self) -> &str {
        self.as_str()
    }

    fn of_text(text: &str) -> Option<Self> {
        T::VALUES.iter().copied().find(|value| value.as_str() == text)
    }
}

impl<T: Text> Columns for T {
    fn missing() -> Self {
        T::nothing()
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        columns.push(texts(name, values.iter().map(|value| value.as_text())));
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        read_texts(table, name, T::of_text)
    }
}

/// Text that is empty where there is no value.
impl<T: Text> Columns for Option<T> {
    fn missing() -> Self {
        None
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        let values = values.iter().map(|value| value.as_ref().map_or("", T::as_text));
        columns.push(texts(name, values));
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        read_texts(table, name, |text| match text {
            "" => Some(None),
            text => T::of_text(text).map(Some),
        })
    }
}

fn read_texts<T>(
    table: &Table,
    name: &str,
    of_text: impl Fn(&str) -> Option<T>,
) -> Result<Vec<T>, StoreError> {
    let needed = ("text", DataType::is_string as fn(&_) -> _);
    let column = table.column(name, needed, &DataType::String)?;
    values_of_texts(table, name, column.str(), of_text)
}

fn values_of_texts<T>(
    table: &Table,
    name: &str,
    texts: PolarsResult<&StringChunked>,
    of_text: impl Fn(&str) -> Option<T>,
) -> Result<Vec<T>, StoreError> {
    let value = |text: Option<&str>| {
        let text = text.unwrap_or_default();
        of_text(text).ok_or_else(|| table.wrong(name, &format!("`{text}`"), "a known name"))
    };
    texts.map_err(|error| table.error(&error))?.iter().map(value).collect()
}

impl Text for Parameter {
    fn nothing() -> Self {
        Self::ALL[0]
    }

    fn as_text(&self) -> &str {
        self.column()
    }

    fn of_text(text: &str) -> Option<Self> {
        Self::of_column(text)
    }
}

impl<T: Text> Columns for Vec<T> {
    fn missing() -> Self {
        Self::new()
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        let total = values.iter().map(|list| list.len()).sum();
        let mut lists = ListStringChunkedBuilder::new(name.into(), values.len(), total);
        values.iter().for_each(|list| lists.append_values_iter(list.iter().map(T::as_text)));
        columns.push(lists.finish().into_column());
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        let needed = ("lists of text", DataType::is_list as fn(&_) -> _);
        let text = DataType::List(Box::new(DataType::String));
        let column = table.column(name, needed, &text)?;
        let lists = column.list().map_err(|error| table.error(&error))?;
        let list = |list: Option<Series>| match list {
            Some(list) => values_of_texts(table, name, list.str(), T::of_text),
            None => Ok(Self::new()),
        };
        lists.series_iter().map(list).collect()
    }
}

/// A column of numbers; missing ones, which are NaN, become nulls.
pub fn numbers(name: &str, values: Vec<f64>) -> Column {
    let values = Float64Chunked::from_vec(name.into(), values);
    let missing = values.is_nan();
    let nulls = missing.any().then(|| values.set(&missing, None).expect("as long as the values"));
    nulls.unwrap_or(values).into_column()
}

/// A column of whole numbers.
pub fn whole_numbers(name: &str, values: Vec<i64>) -> Column {
    Int64Chunked::from_vec(name.into(), values).into_column()
}

/// A column of text.
pub fn texts<'t>(name: &str, values: impl Iterator<Item = &'t str>) -> Column {
    StringChunked::from_iter_values(name.into(), values).into_column()
}

/// A column of text of which there are but a few kinds: faster than [`texts`].
pub fn names(name: &str, values: impl Iterator<Item = &'static str>) -> Column {
    let mut kinds: Vec<&str> = Vec::new();
    let index = |value: &'static str| {
        let known = kinds.iter().position(|kind| *kind == value);
        known.unwrap_or_else(|| {
            kinds.push(value);
            kinds.len() - 1
        }) as IdxSize
    };
    let rows = IdxCa::from_vec(name.into(), values.map(index).collect());
    let kinds = StringChunked::from_slice(name.into(), &kinds);
    kinds.take(&rows).expect("every index is of a kind").into_column()
}

/// A column with the same text in every row.
pub fn repeated(name: &str, value: &str, rows: usize) -> Column {
    StringChunked::full(name.into(), value, rows).into_column()
}
