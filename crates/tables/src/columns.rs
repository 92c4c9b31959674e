//! Conversion between values and table columns: a value occupies one column, or one column for each of its
//! parts.

use polars::prelude::{
    ChunkSet, Column, DataType, Float64Chunked, IntoColumn, NewChunkedArray, PolarsResult, Series,
    StringChunked,
};
use trilink_base::Named;
use trilink_base::csv;
use trilink_robot::decay::DecayLaw;
use trilink_robot::metrics::{
    Bifurcation, BranchKind, ByFitted, FromRest, GaitMetrics, Metric, MotionStatus,
};
use trilink_robot::{ByParameter, Model, Parameter};
use trilink_statistics::Estimate;

use super::{
    ContradictionKind, Fill, FitStatus, KnownFrom, LabelFault, LawKind, LawStatus, MapPoint,
    NoIntervalReason, NoPrecisionReason, NotTestedReason, Objective, Outcome, PredictionSource,
    Resistance, RunStatus, Severity, Sharing, Side, SlopeStatus, Stopped, StoreError, Table,
    TrialStatus, UndecidedReason,
};
use crate::config::GaitInput;
use crate::trial::TrialKind;

/// Type whose values a table stores in one or several columns, such as a struct for a row.
///
/// A pattern determines the column names: its `{}` is replaced by the name of each part of the value.
pub trait Columns: Sized {
    /// Default column-name pattern for a field of this type; `{field}` stands for the field's name.
    const PATTERN: &'static str = "{field}";

    /// Returns an empty value: a missing number, a count of 0, empty text, or the first value of an
    /// enumeration.
    fn blank() -> Self;

    /// Appends the columns that store `values`, with one value in each row.
    fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>);

    /// Appends columns as [`Columns::write`] does, but consumes the values.
    fn write_all(values: Vec<Self>, pattern: &str, columns: &mut Vec<Column>) {
        Self::write(&values.iter().collect::<Vec<_>>(), pattern, columns);
    }

    /// Reads the value in each row of a table.
    ///
    /// # Errors
    /// Returns an error if a column is missing or has the wrong type.
    fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError>;

    /// Builds a table from the given rows, in their order.
    fn to_table(rows: &[Self]) -> Table {
        let mut columns = Vec::new();
        Self::write(&rows.iter().collect::<Vec<_>>(), "{}", &mut columns);
        Table::new(columns)
    }

    /// Reads all rows of a table.
    ///
    /// # Errors
    /// Returns an error that names all columns that are missing or have the wrong type.
    fn from_table(table: &Table) -> Result<Vec<Self>, StoreError> {
        Self::read(table, "{}").map_err(|error| match error {
            StoreError::Column { .. } => all_problems::<Self>(table).unwrap_or(error),
            other => other,
        })
    }
}

/// Returns an error that lists all columns of a table that are missing or have the wrong type; `None` if
/// there are none.
fn all_problems<T: Columns>(table: &Table) -> Option<StoreError> {
    let correct = T::to_table(&[]).frame;
    let mut rest = Table { frame: table.frame.clear(), ..table.clone() };
    let mut missing = Vec::new();
    let mut problems = Vec::new();
    // Reading stops at the first wrong column: replace it by a correct one to find the next.
    while let Err(StoreError::Column { column, found, needed, .. }) = T::read(&rest, "{}") {
        rest.frame.with_column(correct.column(&column).ok()?.clone()).ok()?;
        match table.frame.column(&column) {
            Err(_) => missing.push(column),
            Ok(_) => problems.push(format!("column `{column}`: found {found}, needed {needed}")),
        }
    }
    match &missing[..] {
        [] => {}
        [one] => problems.insert(0, format!("column `{one}` is missing")),
        all => {
            let all = all.join("`, `");
            problems.insert(0, format!("columns `{all}` are missing"));
        }
    }
    if !missing.is_empty() {
        problems.push("`trilink run` recomputes the tables of an older version".to_owned());
    }
    if problems.is_empty() {
        return None;
    }
    Some(StoreError::Columns { path: table.path.clone(), problems: problems.join("; ") })
}

/// Returns the column-name pattern of a field: the first entry of `own` or, if there is none, the default for
/// the field's type, inserted into the pattern `outer`.
pub fn pattern_of<T: Columns>(outer: &str, field: &str, own: &[&str]) -> String {
    fill(outer, &own.first().unwrap_or(&T::PATTERN).replace("{field}", field))
}

/// Replaces the `{}` in a column-name pattern by the name, or the pattern, of a part.
pub fn fill(pattern: &str, part: &str) -> String {
    pattern.replacen("{}", part, 1)
}

/// Moves the columns from index `first` on, whose names follow `pattern`, to places after earlier columns. If
/// `after` contains `{}`, it is the name pattern of the earlier columns, and each column is placed after the
/// one for the same part; otherwise all columns are placed after the column named `after`.
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

/// Implements [`Columns`] for a struct from its fields. A field can have a column-name pattern (`as`), and
/// its columns can be placed after those of earlier fields (`after`).
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

/// Defines a struct whose fields are table columns; for the syntax see [`columns!`].
#[macro_export]
macro_rules! rows {
    ($(#[$meta:meta])* pub struct $name:ident {
        $(
            $(#[$field_meta:meta])*
            pub $field:ident: $type:ty $(as $pattern:literal $(after $after:literal)?)?,
        )*
    }) => {
        $(#[$meta])*
        // Whether other crates can use the struct depends on the visibility of its module.
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

/// The columns of an array are numbered 0, 1, 2 for links and wheels, and 1, 2 for joints.
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

/// Returns the column-name patterns for the elements of an array, numbered from 1 if there are two elements,
/// otherwise from 0.
pub(super) fn numbered<const N: usize>(pattern: &str) -> impl Iterator<Item = String> {
    (0..N).map(move |i| fill(pattern, &(i + usize::from(N == 2)).to_string()))
}

/// Implements [`Columns`] for numbers that are indexed by metrics or parameters, given all of them, their names, and the
/// blank value.
macro_rules! impl_columns_of_robots {
    ($type:ty, $all:expr, $name:path, $blank:expr) => {
        impl Columns for $type {
            const PATTERN: &'static str = "{}";

            fn blank() -> Self {
                $blank
            }

            /// Appends a column for each number of a robot of three links, and for each other that a value has.
            fn write(values: &[&Self], pattern: &str, columns: &mut Vec<Column>) {
                for of in $all {
                    let parts: Vec<&f64> = values.iter().map(|value| &value[of]).collect();
                    if of.is_of_three_links() || parts.iter().any(|part| !part.is_nan()) {
                        f64::write(&parts, &fill(pattern, $name(of)), columns);
                    }
                }
            }

            fn read(table: &Table, pattern: &str) -> Result<Vec<Self>, StoreError> {
                let mut values = vec![$blank; table.len()];
                for of in $all {
                    let name = fill(pattern, $name(of));
                    if of.is_of_three_links() || table.frame.column(&name).is_ok() {
                        let column = f64::read(table, &name)?.into_iter();
                        values.iter_mut().zip(column).for_each(|(value, part)| value[of] = part);
                    }
                }
                Ok(values)
            }
        }
    };
}

impl_columns_of_robots!(GaitMetrics, Metric::ALL, Metric::column, Self::MISSING);
impl_columns_of_robots!(ByFitted<f64>, Metric::FITTED, Metric::name, Self::splat(f64::NAN));
impl_columns_of_robots!(ByParameter<f64>, Parameter::OF_ANY_ROBOT, Parameter::name, Self::MISSING);

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

/// Implements [`Columns`] for a boolean type, given its blank value and a conversion from a cell. The
/// conversion returns `None` for a missing cell that the type cannot represent.
macro_rules! impl_boolean_columns {
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

impl_boolean_columns!(bool, false, |value| value);
impl_boolean_columns!(Option<bool>, None, Some);

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

/// Enumeration whose values are stored in tables by their names.
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
    LawStatus,
    SlopeStatus,
    MapPoint,
    Metric,
    Model,
    MotionStatus,
    NoIntervalReason,
    NoPrecisionReason,
    NotTestedReason,
    UndecidedReason,
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

/// Maximum magnitude of an integer in a table, so that the sum of a column does not overflow.
const MAX_INTEGER: u64 = 1_000_000_000_000;

/// Integers are also read from floating-point columns, because other programs convert integer columns with
/// missing values to floating point.
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
                let to_integer = |number: f64| match number.fract() {
                    0.0 => Ok(Some(number as i64)),
                    _ if number.is_nan() => Ok(None),
                    _ => Err(table.wrong(name, &number.to_string(), NEEDED)),
                };
                f64::read(table, name)?.into_iter().map(to_integer).collect::<Result<_, _>>()?
            } else {
                let needed = (NEEDED, DataType::is_integer as fn(&DataType) -> bool);
                let column = table.column(name, needed, &DataType::Int64)?;
                column.i64().map_err(|error| table.error(&error))?.iter().collect()
            };
        match values.iter().flatten().find(|value| value.unsigned_abs() > MAX_INTEGER) {
            Some(value) => Err(table.wrong(name, &value.to_string(), "whole numbers up to 1e12")),
            None => Ok(values),
        }
    }
}

/// A missing value is read as 0.
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

/// A missing value is stored as null; empty text is read as missing, too.
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
        named(table, name, column.str(), |text| {
            if text.is_empty() { Some(None) } else { T::of_name(text).map(Some) }
        })
    }
}

/// A list is stored as text in one column, because many programs cannot read lists: the text is a line of CSV
/// with a space after each comma.
impl<T: NamedCell> Columns for Vec<T> {
    fn blank() -> Self {
        Self::new()
    }

    fn write(values: &[&Self], name: &str, columns: &mut Vec<Column>) {
        let mut lines = Vec::new();
        for list in values {
            let names: Vec<_> = list.iter().map(|value| csv::field(value.as_name())).collect();
            lines.push(names.join(", "));
        }
        // An empty list is not a missing value.
        columns.push(StringChunked::from_iter_values(name.into(), lines.iter()).into_column());
    }

    fn read(table: &Table, name: &str) -> Result<Vec<Self>, StoreError> {
        let column = table.column(name, ("text", DataType::is_string), &DataType::String)?;
        named(table, name, column.str(), |text| {
            csv::fields(text).iter().map(|name| T::of_name(name)).collect()
        })
    }
}

/// Converts the text in each cell of a column to a value; missing text is read as empty text.
fn named<T>(
    table: &Table,
    column: &str,
    texts: PolarsResult<&StringChunked>,
    of_name: impl Fn(&str) -> Option<T>,
) -> Result<Vec<T>, StoreError> {
    let mut values = Vec::new();
    for text in texts.map_err(|error| table.error(&error))?.iter() {
        let text = text.unwrap_or_default();
        let value = of_name(text);
        values
            .push(value.ok_or_else(|| table.wrong(column, &format!("`{text}`"), "a known name"))?);
    }
    Ok(values)
}

/// Builds a column of numbers; NaN is stored as null.
pub fn numbers(name: &str, values: Vec<f64>) -> Column {
    let values = Float64Chunked::from_vec(name.into(), values);
    let missing = values.is_nan();
    let nulls = missing
        .any()
        .then(|| values.set(&missing, None).expect("the mask is as long as the values"));
    nulls.unwrap_or(values).into_column()
}

/// Builds a column of booleans; `None` is stored as null.
pub fn booleans(name: &str, values: Vec<Option<bool>>) -> Column {
    plain(name, values)
}

/// Builds a column of text; empty text is stored as null.
pub fn texts<'t>(name: &str, values: impl Iterator<Item = &'t str>) -> Column {
    let values = values.map(|value| Some(value).filter(|value| !value.is_empty()));
    StringChunked::from_iter_options(name.into(), values).into_column()
}

/// Builds a column with the same text in every row.
pub fn repeated(name: &str, value: &str, rows: usize) -> Column {
    texts(name, std::iter::repeat_n(value, rows))
}
