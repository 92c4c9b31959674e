//! Columns in memory and Parquet on disk; the only place that writes with polars.

use std::cell::Cell;
use std::fs::File;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use polars::polars_utils::compression::ZstdLevel;
use polars::prelude::{
    ChunkSet, ChunkTake, Column as PolarsColumn, CompatLevel, DataFrame, DataType, Float64Chunked,
    IdxCa, IntoSeries, KeyValueMetadata, ListBuilderTrait, ListStringChunkedBuilder, NamedFrom,
    NewChunkedArray, ParallelStrategy, ParquetCompression, ParquetReader, ParquetWriter,
    PlSmallStr, PolarsError, PolarsResult, SchemaExt, SerReader, Series, StatisticsOptions,
    StringChunked,
};
use polars_parquet::write::{KeyValue, schema_to_metadata_key};

use super::{Beside, Stamp, StoreError, write_if_changed};

/// Numbers with noise in them hardly shrink, however long that takes. Statistics, too, would take
/// time: they tell a reader which parts of a table to skip, and these tables have one part.
const ZSTD_LEVEL: i32 = 1;

/// Key of the fingerprint in a file's metadata.
const INPUT_KEY: &str = "trilink.input";

thread_local! {
    static READING: Cell<bool> = const { Cell::new(false) };
}

/// Whether this thread is reading a table: a panic then is an error of the file, and a panic
/// hook need not speak of it.
pub fn is_reading() -> bool {
    READING.with(Cell::get)
}

/// Reads with polars; `None` if the file is damaged such that the reader panics instead of giving
/// an error.
pub(crate) fn guarded<T>(read: impl FnOnce() -> T) -> Option<T> {
    READING.with(|reading| {
        reading.set(true);
        let read = catch_unwind(AssertUnwindSafe(read));
        reading.set(false);
        read.ok()
    })
}

/// Values of one column. NaN is how a missing number is kept; it is written as null.
#[derive(Debug, Clone, PartialEq)]
pub enum Column {
    F64(Vec<f64>),
    I64(Vec<i64>),
    Bool(Vec<bool>),
    Str(Vec<String>),
    /// Text of few values that repeat: the values, and which of them each row has. It is read
    /// back as `Str`.
    Names(Vec<String>, Vec<u8>),
    StrList(Vec<Vec<String>>),
}

impl Column {
    /// The same text in every row.
    pub fn repeat(value: &str, rows: usize) -> Self {
        Self::Names(vec![value.to_owned()], vec![0; rows])
    }

    fn len(&self) -> usize {
        match self {
            Self::F64(values) => values.len(),
            Self::I64(values) => values.len(),
            Self::Bool(values) => values.len(),
            Self::Str(values) => values.len(),
            Self::Names(_, rows) => rows.len(),
            Self::StrList(values) => values.len(),
        }
    }

    fn kind(&self) -> &'static str {
        match self {
            Self::F64(_) => "numbers",
            Self::I64(_) => "whole numbers",
            Self::Bool(_) => "booleans",
            Self::Str(_) | Self::Names(..) => "text",
            Self::StrList(_) => "lists of text",
        }
    }
}

/// What a table was made from; goes into the file's key-value metadata.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Provenance {
    /// Fingerprint of everything that the table was computed from.
    pub input: String,
}

/// A table: named columns of equal length.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    path: PathBuf,
    /// Fingerprint of what it was made from, if it was read and has one.
    input: Option<String>,
    columns: Vec<(String, Column)>,
    /// The columns as polars has them.
    pub frame: DataFrame,
}

impl Table {
    /// A table of `columns` in this order.
    pub fn new<'a>(columns: impl IntoIterator<Item = (&'a str, Column)>) -> Self {
        let columns: Vec<(String, Column)> =
            columns.into_iter().map(|(name, column)| (name.to_owned(), column)).collect();
        let polars = columns.iter().map(|(name, column)| to_polars(name, column));
        let frame = polars.collect::<PolarsResult<_>>().and_then(DataFrame::new_infer_height);
        Self { path: PathBuf::new(), input: None, columns, frame: frame.unwrap_or_default() }
    }

    /// [`Provenance::input`] of the file that it was read from.
    pub fn input(&self) -> Option<&str> {
        self.input.as_deref()
    }

    /// Names and columns in order.
    pub fn columns(&self) -> &[(String, Column)] {
        &self.columns
    }

    /// Writes Parquet (zstd) in one piece.
    ///
    /// # Errors
    /// The file cannot be written; what was there before stays.
    pub fn write(&self, path: &Path, provenance: &Provenance) -> Result<(), StoreError> {
        self.write_beside(path, provenance)?.settle().map(|_| ())
    }

    /// [`Table::write`] but for the last step: the file is not yet in its place.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_beside(&self, path: &Path, provenance: &Provenance) -> Result<Beside, StoreError> {
        Beside::write(path, |file| {
            write_parquet(&mut self.frame.clone(), file, provenance).map_err(std::io::Error::other)
        })
    }

    /// [`Table::write`], unless the file is this table already: then it is left alone.
    ///
    /// # Errors
    /// The file cannot be written; what was there before stays.
    pub fn write_if_changed(
        &self,
        path: &Path,
        provenance: &Provenance,
    ) -> Result<Stamp, StoreError> {
        let mut bytes = Vec::new();
        write_parquet(&mut self.frame.clone(), &mut bytes, provenance)
            .map_err(|error| table_error(path, &error))?;
        write_if_changed(path, &bytes)
    }

    /// Reads a Parquet file.
    ///
    /// # Errors
    /// The file cannot be read or is not Parquet, or holds types that trilink does not write.
    pub fn read(path: &Path) -> Result<Self, StoreError> {
        let file = File::open(path)
            .map_err(|source| StoreError::Read { path: path.to_owned(), source })?;
        let table_error = |message: String| StoreError::Table { path: path.to_owned(), message };
        let mut reader = ParquetReader::new(file).read_parallel(ParallelStrategy::None);
        let read = || {
            let pairs = reader.get_metadata()?.key_value_metadata().iter().flatten();
            let mut inputs = pairs.filter(|pair| pair.key == INPUT_KEY);
            let input = inputs.next().and_then(|pair| Some(pair.value.as_ref()?.to_string()));
            PolarsResult::Ok((reader.finish()?, input))
        };
        let (frame, input) = guarded(read)
            .ok_or_else(|| table_error("it is damaged".to_owned()))?
            .map_err(|error| table_error(error.to_string()))?;
        let columns = frame
            .columns()
            .iter()
            .map(|column| Ok((column.name().to_string(), from_polars(path, column)?)))
            .collect::<Result<_, StoreError>>()?;
        Ok(Self { path: path.to_owned(), input, columns, frame })
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.columns.first().map_or(0, |(_, column)| column.len())
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Numbers of a column; missing ones are NaN.
    ///
    /// # Errors
    /// There is no such column, or it holds something else; so for the other kinds.
    pub fn f64(&self, name: &str) -> Result<&[f64], StoreError> {
        match self.column(name, "numbers")? {
            Column::F64(values) => Ok(values),
            other => Err(self.mismatch(name, other, "numbers")),
        }
    }

    /// Whole numbers of a column.
    pub fn i64(&self, name: &str) -> Result<&[i64], StoreError> {
        match self.column(name, "whole numbers")? {
            Column::I64(values) => Ok(values),
            other => Err(self.mismatch(name, other, "whole numbers")),
        }
    }

    /// Booleans of a column.
    pub fn bool(&self, name: &str) -> Result<&[bool], StoreError> {
        match self.column(name, "booleans")? {
            Column::Bool(values) => Ok(values),
            other => Err(self.mismatch(name, other, "booleans")),
        }
    }

    /// Text of a column.
    pub fn str(&self, name: &str) -> Result<&[String], StoreError> {
        match self.column(name, "text")? {
            Column::Str(values) => Ok(values),
            other => Err(self.mismatch(name, other, "text")),
        }
    }

    /// Lists of text of a column.
    pub fn str_list(&self, name: &str) -> Result<&[Vec<String>], StoreError> {
        match self.column(name, "lists of text")? {
            Column::StrList(values) => Ok(values),
            other => Err(self.mismatch(name, other, "lists of text")),
        }
    }

    fn column(&self, name: &str, needed: &'static str) -> Result<&Column, StoreError> {
        let found = self.columns.iter().find(|(column, _)| column == name);
        found.map(|(_, column)| column).ok_or_else(|| StoreError::Column {
            path: self.path.clone(),
            column: name.to_owned(),
            found: "no such column".to_owned(),
            needed,
        })
    }

    fn mismatch(&self, name: &str, found: &Column, needed: &'static str) -> StoreError {
        StoreError::Column {
            path: self.path.clone(),
            column: name.to_owned(),
            found: found.kind().to_owned(),
            needed,
        }
    }
}

fn table_error(path: &Path, error: &PolarsError) -> StoreError {
    StoreError::Table { path: path.to_owned(), message: error.to_string() }
}

fn write_parquet(
    frame: &mut DataFrame,
    to: impl Write,
    provenance: &Provenance,
) -> PolarsResult<()> {
    let types = arrow_schema(frame);
    let metadata = KeyValueMetadata::from_static(vec![
        (types.key, types.value.unwrap_or_default()),
        ("trilink.version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        (INPUT_KEY.to_owned(), provenance.input.clone()),
    ]);
    let compression = ParquetCompression::Zstd(Some(ZstdLevel::try_new(ZSTD_LEVEL)?));
    ParquetWriter::new(to)
        .set_parallel(false)
        .with_compression(compression)
        .with_statistics(StatisticsOptions::empty())
        .with_key_value_metadata(Some(metadata))
        .finish(frame)
        .map(|_| ())
}

/// Whether a file is a table that this program wrote.
pub fn is_own_table(path: &Path) -> bool {
    const KEY: &[u8] = INPUT_KEY.as_bytes();
    std::fs::read(path).is_ok_and(|bytes| bytes.windows(KEY.len()).any(|part| part == KEY))
}

/// The types that Arrow's readers are to make of the columns: text and lists of text as they have
/// always been. pandas cannot take a list of views, which is what polars would name.
fn arrow_schema(frame: &DataFrame) -> KeyValue {
    schema_to_metadata_key(&frame.schema().to_arrow(CompatLevel::oldest()))
}

fn to_polars(name: &str, column: &Column) -> PolarsResult<PolarsColumn> {
    let name = PlSmallStr::from_str(name);
    let series = match column {
        Column::F64(values) => {
            let values = Float64Chunked::from_slice(name, values);
            let missing = values.is_nan();
            let nulls = missing.any().then(|| values.set(&missing, None)).transpose()?;
            nulls.unwrap_or(values).into_series()
        }
        Column::I64(values) => Series::new(name, values),
        Column::Bool(values) => Series::new(name, values),
        Column::Str(values) => StringChunked::from_slice(name, values).into_series(),
        Column::Names(names, rows) => {
            let rows = rows.iter().map(|&row| row.into()).collect();
            let names = StringChunked::from_slice(name.clone(), names);
            names.take(&IdxCa::from_vec(name, rows))?.into_series()
        }
        Column::StrList(values) => {
            let total = values.iter().map(Vec::len).sum();
            let mut lists = ListStringChunkedBuilder::new(name, values.len(), total);
            for list in values {
                lists.append_values_iter(list.iter().map(String::as_str));
            }
            lists.finish().into_series()
        }
    };
    Ok(series.into())
}

fn from_polars(path: &Path, column: &PolarsColumn) -> Result<Column, StoreError> {
    let error = |found: String| StoreError::Column {
        path: path.to_owned(),
        column: column.name().to_string(),
        found,
        needed: "a type that trilink writes",
    };
    let missing = |_| error("missing values".to_owned());
    let wrong = |problem: PolarsError| error(problem.to_string());
    let series = column.as_materialized_series();
    Ok(match series.dtype() {
        dtype if dtype.is_float() || dtype.is_integer() && series.null_count() > 0 => {
            let numbers = series.cast(&DataType::Float64).map_err(wrong)?;
            let numbers = numbers.f64().map_err(wrong)?;
            Column::F64(numbers.iter().map(|x| x.unwrap_or(f64::NAN)).collect())
        }
        dtype if dtype.is_integer() => {
            let numbers = series.cast(&DataType::Int64).map_err(wrong)?;
            Column::I64(numbers.i64().map_err(wrong)?.into_no_null_iter().collect())
        }
        DataType::Boolean => {
            let values = series.bool().map_err(wrong)?.iter();
            Column::Bool(values.collect::<Option<_>>().ok_or(()).map_err(missing)?)
        }
        DataType::String => {
            let values = series.str().map_err(wrong)?.iter();
            Column::Str(values.map(|text| text.unwrap_or_default().to_owned()).collect())
        }
        DataType::List(_) => {
            let lists = series.list().map_err(wrong)?;
            let to_names = |list: Option<Series>| -> Result<Vec<String>, StoreError> {
                let Some(list) = list else { return Ok(Vec::new()) };
                let names = list.str().map_err(wrong)?.iter();
                Ok(names.map(|text| text.unwrap_or_default().to_owned()).collect())
            };
            let lists = lists.series_iter().map(to_names);
            Column::StrList(lists.collect::<Result<_, _>>()?)
        }
        other => return Err(error(other.to_string())),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn provenance() -> Provenance {
        Provenance { input: "0123".to_owned() }
    }

    #[test]
    fn a_table_comes_back_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/table.parquet");
        let lists = vec![vec!["a".to_owned(), "b".to_owned()], vec![], vec!["c".to_owned()]];
        let table = Table::new([
            ("number", Column::F64(vec![1.5, f64::NAN, -2.0])),
            ("count", Column::I64(vec![1, 2, 3])),
            ("used", Column::Bool(vec![true, false, true])),
            ("name", Column::Str(vec!["x".into(), String::new(), "z".into()])),
            ("free", Column::StrList(lists.clone())),
        ]);
        table.write(&path, &provenance()).unwrap();
        let found = Table::read(&path).unwrap();
        let names: Vec<&str> = found.columns().iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["number", "count", "used", "name", "free"]);
        let numbers = found.f64("number").unwrap();
        assert!(numbers[0] == 1.5 && numbers[1].is_nan() && numbers[2] == -2.0);
        assert_eq!(found.i64("count").unwrap(), [1, 2, 3]);
        assert_eq!(found.bool("used").unwrap(), [true, false, true]);
        assert_eq!(found.str("name").unwrap(), ["x", "", "z"]);
        assert_eq!(found.str_list("free").unwrap(), lists);
        let bytes = std::fs::read(&path).unwrap();
        let holds = |text: &str| bytes.windows(text.len()).any(|part| part == text.as_bytes());
        assert!(holds("trilink.version") && holds("trilink.input"));
    }

    #[test]
    fn a_column_that_is_not_there_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let table = Table::new([("count", Column::I64(vec![1]))]);
        table.write(&path, &provenance()).unwrap();
        let found = Table::read(&path).unwrap();
        let message = found.f64("d_m").unwrap_err().to_string();
        assert!(message.ends_with("column `d_m`: found no such column, needed numbers"));
        let message = found.str("count").unwrap_err().to_string();
        assert!(message.ends_with("column `count`: found whole numbers, needed text"));
    }

    #[test]
    fn no_damage_to_a_table_is_a_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let table = Table::new([
            ("number", Column::F64((0..200).map(f64::from).collect())),
            ("name", Column::repeat("trial", 200)),
        ]);
        table.write(&path, &provenance()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let mut refused = 0;
        for place in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[place] ^= 0x5a;
            std::fs::write(&path, &damaged).unwrap();
            refused += usize::from(Table::read(&path).is_err());
        }
        assert!(refused > whole.len() / 4, "{refused} of {}", whole.len());
    }

    #[test]
    fn a_file_that_is_no_table_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        std::fs::write(&path, b"PAR1 but not really").unwrap();
        assert!(matches!(Table::read(&path), Err(StoreError::Table { .. })));
    }
}
