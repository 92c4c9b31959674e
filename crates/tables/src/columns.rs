//! What a value is in a table: one column, or several of which each has a part of it.

use polars::prelude::{
    ChunkFull, ChunkSet, Column, DataType, Float64Chunked, IntoColumn, NewChunkedArray,
    PolarsResult, Series, StringChunked,
};
use trilink_base::Named;
use trilink_base::csv;
use trilink_robot::decay::DecayLaw;
use trilink_robot::metrics::{
    Bifurcation, BranchKind, FromRest, GaitMetrics, Metric, MotionStatus,
};
use trilink_robot::{ByParameter, Model, Parameter};
use trilink_statistics::Estimate;

use super::{
    ContradictionKind, Fill, FitStatus, KnownFrom, LabelFault, LawKind, MapPoint, NoIntervalReason,
    NotTestedReason, Objective, Outcome, PredictionSource, Resistance, RunStatus, Severity,
    Sharing, Side, Stopped, StoreError, Table, TrialStatus,
};
use crate::config::GaitInput;
use crate::trial::TrialKind;

/// A value that a table keeps in one column or in several, such as a row.
///
/// A pattern names them: in the place of its `{}` comes the name that a part has within the value.
pub trait Columns: Sized {
    /// The pattern of a field of this type that names none.
    const PATTERN: &'static str = "{field}";

    /// Nothing: numbers missing, counts 0, texts empty, of an enumeration its first value.
    fn blank() -> Self;

    /// Adds the columns of one value a row.
    fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>);

    /// [`Columns::write`] of values that are not needed any more.
    fn write_all(values: Vec<Self>, pattern: &str, columns: &mut Vec<Column>) {
        Self::write(&values.iter().collect::<Vec<_>>(), pattern, columns);
    }

    /// One value a row.
    ///
    /// # Errors
    /// A column is not there, or holds something else.
    fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError>;

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
        Self::read(table, "{}").map_err(|error| match error {
            StoreError::Column { .. } => all_problems::<Self>(table).unwrap_or(error),
            other => other,
        })
    }
}

/// All columns of a table that are missing or of another type; `None` if none is.
fn all_problems<T: Columns>(table: &Table) -> Option<StoreError> {
    let sound = T::to_table(&[]).frame;
    let mut rest = Table { frame: table.frame.clear(), ..table.clone() };
    let (mut missing, mut problems) = (Vec::new(), Vec::new());
    // Each is found with those before it as they should be.
    while let Err(StoreError::Column { column, found, needed, .. }) = T::read(&rest, "{}") {
        rest.frame.with_column(sound.column(&column).ok()?.clone()).ok()?;
        match table.frame.column(&column) {
            Err(_) => missing.push(column),
            Ok(_) => problems.push(format!("column `{column}`: found {found}, needed {needed}")),
        }
    }
    match &missing[..] {
        [] => {}
        [one] => problems.insert(0, format!("column `{one}`: found no such column")),
        all => {
            let all = all.join("`, `");
            problems.insert(0, format!("columns `{all}`: found none of them, needed all"));
        }
    }
    if !missing.is_empty() {
        problems.push("`trilink run` makes the tables of an older version anew".to_owned());
    }
    let (path, problems) = (table.path.clone(), problems.join("; "));
    (!problems.is_empty()).then_some(StoreError::Columns { path, problems })
}

/// The pattern of a field: its `own`, or its type's.
pub fn pattern_of<T: Columns>(outer: &str, field: &str, own: &[&str]) -> String {
    fill(outer, &own.first().unwrap_or(&T::PATTERN).replace("{field}", field))
}

/// A pattern with the name of a part, or with the part's own pattern.
pub fn fill(pattern: &str, part: &str) -> String {
    pattern.replacen("{}", part, 1)
}

/// Moves the columns from `first` on, each behind the column that `after` names with the same
/// part, or all behind one column.
pub fn interleave(columns: &mut Vec<Column>, first: usize, pattern: &str, after: &str) {
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
#[macro_export]
macro_rules! columns {
    ($name:ident $(as $outer:literal)? {
        $($field:ident: $type:ty $(as $pattern:literal $(after $after:literal)?)?,)*
    }) => {
        impl $crate::Columns for $name {
            const PATTERN: &'static str = [$($outer,)? "{}"][0];

            fn blank() -> Self {
                Self { $($field: <$type as $crate::Columns>::blank(),)* }
            }

            fn write(values: &[&Self], pattern: &str, columns: &mut Vec<$crate::Column>) {

                $({
                    let own = $crate::pattern_of::<$type>(pattern, stringify!($field), &[$($pattern)?]);
                    let parts: Vec<&$type> = values.iter().map(|value| &value.$field).collect();
                    let _first = columns.len();
                    <$type as $crate::Columns>::write(&parts, &own, columns);
                    $($($crate::interleave(columns, _first, &own, &$crate::fill(pattern, $after));)?)?
                })*
            }

            fn read(
                table: &$crate::Table,
                pattern: &str,
            ) -> Result<Vec<Self>, $crate::StoreError> {

                $(
                    let own = $crate::pattern_of::<$type>(pattern, stringify!($field), &[$($pattern)?]);
                    let mut $field = <$type as $crate::Columns>::read(table, &own)?.into_iter();
                )*
                Ok(std::iter::from_fn(|| Some(Self { $($field: $field.next()?,)* })).collect())
            }
        }
    };
}

/// Defines a struct whose fields are columns, see [`columns!`].
#[macro_export]
macro_rules! rows {
    ($(#[$meta:meta])* pub struct $name:ident {
        $(
            $(#[$field_meta:meta])*
            pub $field:ident: $type:ty $(as $pattern:literal $(after $after:literal)?)?,
        )*
    }) => {
        $(#[$meta])*
        // Whether another crate sees it depends on where it stands.
        #[allow(unreachable_pub)]
        #[derive(Debug, Clone, PartialEq)]
        pub struct $name { $($(#[$field_meta])* pub $field: $type,)* }

        $crate::columns! {
            $name { $($field: $type $(as $pattern $(after $after)?)?,)* }
        }
    };
}

columns! {
    Estimate as "{field}{}" {
        value: f64 as "",
        se: f64 as "_se",
    }
}

/// Links and wheels are 0, 1, 2; joints are 1 and 2.
impl<T: Columns, const N: usize> Columns for [T; N] {
    fn blank() -> Self {
        std::array::from_fn(|_| T::blank())
    }

    fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>) {
        write_parts(values, numbered::<N>(pattern), columns);
    }

    fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError> {
        read_parts(table, numbered::<N>(pattern))
    }
}

pub(super) fn numbered<const N: usize>(pattern: &str) -> impl Iterator<Item = String> {
    (0..N).map(move |i| fill(pattern, &(i + usize::from(N == 2)).to_string()))
}

impl Columns for GaitMetrics {
    const PATTERN: &'static str = "{}";

    fn blank() -> Self {
        Self::MISSING
    }

    fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>) {
        for metric in Metric::ALL {
            let parts: Vec<&f64> = values.iter().map(|value| &value[metric]).collect();
            f64::write(&parts, &fill(pattern, metric.column()), columns);
        }
    }

    fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError> {
        let patterns = Metric::ALL.into_iter().map(|metric| fill(pattern, metric.column()));
        Ok(read_parts(table, patterns)?.into_iter().map(Self::from_array).collect())
    }
}

impl<T: Columns> Columns for ByParameter<T> {
    const PATTERN: &'static str = "{}";

    fn blank() -> Self {
        Self::from_array(Columns::blank())
    }

    fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>) {
        let values: Vec<_> = values.iter().map(|value| value.as_array()).collect();
        write_parts(&values, by_parameter(pattern), columns);
    }

    fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError> {
        Ok(read_parts(table, by_parameter(pattern))?.into_iter().map(Self::from_array).collect())
    }
}

fn by_parameter(pattern: &str) -> impl Iterator<Item = String> {
    Parameter::ALL.into_iter().map(move |parameter| fill(pattern, parameter.name()))
}

fn write_parts<T: Columns, const N: usize>(
    values: &[&[T; N]],
    patterns: impl Iterator<Item = String>,
    columns: &mut Vec<Column>,
) {
    for (i, pattern) in patterns.enumerate() {
        let parts: Vec<&T> = values.iter().map(|value| &value[i]).collect();
        T::write(&parts, &pattern, columns);
    }
}

fn read_parts<T: Columns, const N: usize>(
    table: &Table,
    patterns: impl Iterator<Item = String>,
) -> Result<Vec<[T; N]>, StoreError> {
    let parts = patterns.map(|pattern| Ok(T::read(table, &pattern)?.into_iter()));
    let mut parts = parts.collect::<Result<Vec<_>, StoreError>>()?;
    let row = |_| std::array::from_fn(|i| parts[i].next().unwrap_or_else(T::blank));
    Ok((0..table.len()).map(row).collect())
}

/// Implements [`Columns`] for a column of booleans: what nothing is, and how values are read; `None` if some
/// are missing.
macro_rules! booleans {
    ($type:ty, $blank:expr, $read:expr) => {
        impl Columns for $type {
            fn blank() -> Self {
                $blank
            }

            fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
                let values: Vec<Self> = values.iter().map(|value| **value).collect();
                columns.push(plain(name, values));
            }

            fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
                const NEEDED: &str = "booleans";
                let column = table.column(name, (NEEDED, DataType::is_bool), &DataType::Boolean)?;
                let values = column.bool().map_err(|error| table.error(&error))?.iter();
                let values: Option<Vec<Self>> = values.map($read).collect();
                values.ok_or_else(|| table.wrong(name, "missing values", NEEDED))
            }
        }
    };
}

fn plain<T: AsRef<[V]>, V>(name: &str, values: T) -> Column
where
    Series: polars::prelude::NamedFrom<T, [V]>,
{
    Column::new(name.into(), values)
}

booleans!(bool, false, |value| value);
booleans!(Option<bool>, None, Some);

impl Columns for f64 {
    fn blank() -> Self {
        Self::NAN
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        columns.push(numbers(name, values.iter().map(|value| **value).collect()));
    }

    fn write_all(values: Vec<Self>, name: &str, columns: &mut Vec<Column>) {
        columns.push(numbers(name, values));
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        let is_number = DataType::is_primitive_numeric;
        let column = table.column(name, ("numbers", is_number), &DataType::Float64)?;
        let values = column.f64().map_err(|error| table.error(&error))?.iter();
        let values: Vec<Self> = values.map(|value| value.unwrap_or(Self::NAN)).collect();
        match values.iter().find(|value| **value < 0.0) {
            Some(value) if name.ends_with("_se") => {
                Err(table.wrong(name, &format!("{value:?}"), "standard errors, 0 or above"))
            }
            _ => Ok(values),
        }
    }
}

/// Values that stand in tables by their names.
pub trait NamedCell: Named {}

macro_rules! named_cells {
    ($($type:ty),+ $(,)?) => { $(impl NamedCell for $type {})+ };
}

named_cells![
    Bifurcation,
    BranchKind,
    ContradictionKind,
    DecayLaw,
    Fill,
    FitStatus,
    FromRest,
    GaitInput,
    KnownFrom,
    LabelFault,
    LawKind,
    MapPoint,
    Metric,
    Model,
    MotionStatus,
    NoIntervalReason,
    NotTestedReason,
    Objective,
    Outcome,
    Parameter,
    PredictionSource,
    Resistance,
    RunStatus,
    Severity,
    Sharing,
    Side,
    Stopped,
    String,
    TrialKind,
    TrialStatus,
];

/// No whole number of a table is larger, so that the sum of a column can be taken.
const LARGEST_WHOLE: u64 = 1_000_000_000_000;

/// Other programs turn whole numbers into floating-point ones where some are missing.
impl Columns for Option<i64> {
    fn blank() -> Self {
        None
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        columns.push(plain(name, values.iter().map(|value| **value).collect::<Vec<_>>()));
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        const NEEDED: &str = "whole numbers";
        let values: Vec<Self> =
            if table.frame.column(name).is_ok_and(|column| column.dtype().is_float()) {
                let whole = |number: f64| match number.fract() {
                    0.0 => Ok(Some(number as i64)),
                    _ if number.is_nan() => Ok(None),
                    _ => Err(table.wrong(name, &number.to_string(), NEEDED)),
                };
                f64::read(table, name)?.into_iter().map(whole).collect::<Result<_, _>>()?
            } else {
                let whole = table.column(name, (NEEDED, DataType::is_integer), &DataType::Int64)?;
                whole.i64().map_err(|error| table.error(&error))?.iter().collect()
            };
        match values.iter().flatten().find(|value| value.unsigned_abs() > LARGEST_WHOLE) {
            Some(value) => Err(table.wrong(name, &value.to_string(), "whole numbers up to 1e12")),
            None => Ok(values),
        }
    }
}

/// What is missing counts 0.
impl Columns for i64 {
    fn blank() -> Self {
        0
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        columns.push(plain(name, values.iter().map(|value| **value).collect::<Vec<_>>()));
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        let values = Option::<Self>::read(table, name)?.into_iter();
        Ok(values.map(Option::unwrap_or_default).collect())
    }
}

impl<T: NamedCell> Columns for T {
    fn blank() -> Self {
        T::first()
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        columns.push(texts(name, values.iter().map(|value| value.as_name())));
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        let column = table.column(name, ("text", DataType::is_string), &DataType::String)?;
        named(table, name, column.str(), T::of_name)
    }
}

/// Text that is empty where there is no value.
impl<T: NamedCell> Columns for Option<T> {
    fn blank() -> Self {
        None
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        let values = values.iter().map(|value| value.as_ref().map_or("", T::as_name));
        columns.push(texts(name, values));
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        let column = table.column(name, ("text", DataType::is_string), &DataType::String)?;
        let of_name =
            |text: &str| if text.is_empty() { Some(None) } else { T::of_name(text).map(Some) };
        named(table, name, column.str(), of_name)
    }
}

/// Names in one text, as a line of CSV with a blank after each comma: many readers know no lists.
impl<T: NamedCell> Columns for Vec<T> {
    fn blank() -> Self {
        Self::new()
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        let text = |list: &&Self| {
            let names = list.iter().map(|value| csv::field(value.as_name()));
            names.collect::<Vec<_>>().join(", ")
        };
        let joined: Vec<String> = values.iter().map(text).collect();
        columns.push(texts(name, joined.iter().map(String::as_str)));
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        let column = table.column(name, ("text", DataType::is_string), &DataType::String)?;
        let values = |text: &str| csv::fields(text).iter().map(|name| T::of_name(name)).collect();
        named(table, name, column.str(), values)
    }
}

/// Values by their names; a missing name is empty.
fn named<T>(
    table: &Table,
    column: &str,
    texts: PolarsResult<&StringChunked>,
    of_name: impl Fn(&str) -> Option<T>,
) -> Result<Vec<T>, StoreError> {
    let value = |text: Option<&str>| {
        let text = text.unwrap_or_default();
        of_name(text).ok_or_else(|| table.wrong(column, &format!("`{text}`"), "a known name"))
    };
    texts.map_err(|error| table.error(&error))?.iter().map(value).collect()
}

/// A column of numbers; missing ones, which are NaN, become nulls.
pub fn numbers(name: &str, values: Vec<f64>) -> Column {
    let values = Float64Chunked::from_vec(name.into(), values);
    let missing = values.is_nan();
    let nulls = missing.any().then(|| values.set(&missing, None).expect("as long as the values"));
    nulls.unwrap_or(values).into_column()
}

/// A column of what is true, false or not known.
pub fn truths(name: &str, values: Vec<Option<bool>>) -> Column {
    plain(name, values)
}

/// A column of text.
pub fn texts<'t>(name: &str, values: impl Iterator<Item = &'t str>) -> Column {
    StringChunked::from_iter_values(name.into(), values).into_column()
}

/// A column with the same text in every row.
pub fn repeated(name: &str, value: &str, rows: usize) -> Column {
    StringChunked::full(name.into(), value, rows).into_column()
}
