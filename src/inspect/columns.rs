//! Columns of Parquet files, including files written by other programs.

use std::io::{self, Cursor};
use std::path::Path;

use polars::datatypes::ArrowDataType;
use polars::io::mmap::MmapBytesReader;
use polars::prelude::{
    ChunkFull, DataFrame, DataType, IntoColumn, ParallelStrategy, ParquetReader, PolarsResult,
    SerReader, StringChunked,
};
use trilink_base::files;
use trilink_tables::{StoreError, checksum, guarded};

use super::find::tables_of;

/// Name of the column that names the table of each row; it is added if the tables of a folder are read as one.
const TRIAL: &str = "trial";

/// Description of a column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColumnInfo {
    pub name: String,
    /// Type of the values, such as `float64`.
    pub type_name: String,
    /// Type used to compare the values: boolean, float or text. `None` if values of this type cannot be shown.
    pub dtype: Option<DataType>,
}

/// Description of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileInfo {
    pub rows: usize,
    pub columns: Vec<ColumnInfo>,
    /// Key-value metadata without Arrow's schema.
    pub metadata: Vec<(String, String)>,
}

/// Describes a Parquet file.
///
/// # Errors
/// Returns an error if the file cannot be read, is damaged or is not Parquet.
pub fn describe(path: &Path) -> Result<FileInfo, StoreError> {
    parse_checked(path, |bytes| description(ParquetReader::new(bytes)))
}

/// Describes a Parquet file from its footer alone, without a check of the file's integrity.
fn describe_footer(path: &Path) -> Result<FileInfo, StoreError> {
    let (file, _) = files::open(path, files::DATA_BYTES).map_err(cannot_read(path))?;
    parse_guarded(path, || description(ParquetReader::new(file)))
}

fn description<R: MmapBytesReader>(mut reader: ParquetReader<R>) -> PolarsResult<FileInfo> {
    let schema = reader.schema()?;
    let columns = schema.iter().map(|(name, field)| ColumnInfo {
        name: name.to_string(),
        type_name: type_name(&field.dtype),
        dtype: compared_type(&field.dtype),
    });
    let metadata = reader.get_metadata()?;
    let pairs = metadata.key_value_metadata().iter().flatten();
    let pairs = pairs
        .filter(|pair| pair.key != "ARROW:schema")
        .map(|pair| (pair.key.to_string(), pair.value.as_deref().unwrap_or_default().to_owned()));
    Ok(FileInfo { rows: metadata.num_rows, columns: columns.collect(), metadata: pairs.collect() })
}

/// Describes a Parquet file, or the tables of a folder as one table. The combined table has a column `trial`, the
/// columns of the first table, and the rows of all tables.
///
/// # Errors
/// Returns an error if a file cannot be read, is damaged or is not Parquet.
pub fn describe_all(path: &Path) -> Result<FileInfo, StoreError> {
    let mut folder_info: Option<FileInfo> = None;
    for (trial, path) in tables_of(path) {
        if trial.is_none() {
            return describe(&path);
        }
        // The rows are only counted here.
        let own = describe_footer(&path)?;
        match &mut folder_info {
            Some(info) => info.rows += own.rows,
            info => {
                let name = ColumnInfo {
                    name: TRIAL.to_owned(),
                    type_name: "text".to_owned(),
                    dtype: Some(DataType::String),
                };
                let columns = std::iter::once(name).chain(own.columns).collect();
                *info = Some(FileInfo { columns, ..own });
            }
        }
    }
    folder_info.map_or_else(|| describe(path), Ok)
}

/// Reads the named columns of the first `rows` rows, or of all rows if `rows` is `None`. If given, `trial` is the value
/// of an added column `trial` in all rows.
pub(super) fn read_columns(
    path: &Path,
    names: &[String],
    trial: Option<&str>,
    rows: Option<usize>,
) -> Result<DataFrame, StoreError> {
    let slice = rows.map(|rows| (0, rows));
    let own = names.iter().filter(|name| trial.is_none() || *name != TRIAL).cloned().collect();
    parse_checked(path, |bytes| {
        let reader = ParquetReader::new(bytes).read_parallel(ParallelStrategy::None);
        let columns = Some(own).filter(|own: &Vec<String>| !own.is_empty());
        let mut frame = reader.with_columns(columns).with_slice(slice).finish()?;
        if let Some(trial) = trial {
            let trials = StringChunked::full(TRIAL.into(), trial, frame.height());
            frame.with_column(trials.into_column())?;
        }
        frame.select(names)
    })
}

fn cannot_read(path: &Path) -> impl FnOnce(io::Error) -> StoreError {
    move |source| StoreError::Read { path: path.to_owned(), source }
}

/// Reads a file, verifies its checksum and parses it.
fn parse_checked<T>(
    path: &Path,
    parse: impl FnOnce(Cursor<Vec<u8>>) -> PolarsResult<T>,
) -> Result<T, StoreError> {
    let (bytes, _) = files::read(path, files::DATA_BYTES).map_err(cannot_read(path))?;
    checksum::check(path, &bytes)?;
    parse_guarded(path, || parse(Cursor::new(bytes)))
}

/// Parses a file that may be damaged; a panic of the parser becomes an error.
fn parse_guarded<T>(path: &Path, parse: impl FnOnce() -> PolarsResult<T>) -> Result<T, StoreError> {
    let error = |message: String| StoreError::Parquet { path: path.to_owned(), message };
    guarded(parse)
        .ok_or_else(|| error("it is damaged".to_owned()))?
        .map_err(|problem| error(problem.to_string()))
}

/// Returns the type to which values are converted for comparisons (text for lists, categories and times); `None` if
/// values of the type `dtype` cannot be shown.
fn compared_type(dtype: &ArrowDataType) -> Option<DataType> {
    use ArrowDataType as Arrow;
    match dtype {
        Arrow::Boolean => Some(DataType::Boolean),
        Arrow::Int32 | Arrow::Int64 | Arrow::UInt32 | Arrow::UInt64 => Some(DataType::Float64),
        Arrow::Float32 | Arrow::Float64 | Arrow::Null => Some(DataType::Float64),
        Arrow::Utf8 | Arrow::LargeUtf8 | Arrow::Utf8View => Some(DataType::String),
        Arrow::Timestamp(..) => Some(DataType::String),
        Arrow::Dictionary(_, inner, _) => compared_type(inner).filter(DataType::is_string),
        Arrow::List(inner) | Arrow::LargeList(inner) => {
            compared_type(&inner.dtype).map(|_| DataType::String)
        }
        _ => None,
    }
}

fn type_name(dtype: &ArrowDataType) -> String {
    use ArrowDataType as Arrow;
    match dtype {
        Arrow::Utf8 | Arrow::LargeUtf8 | Arrow::Utf8View => "text".to_owned(),
        Arrow::List(inner) | Arrow::LargeList(inner) => {
            format!("list of {}", type_name(&inner.dtype))
        }
        Arrow::Dictionary(_, inner, _) => format!("categories of {}", type_name(inner)),
        other => {
            let name = format!("{other:?}").to_lowercase();
            name.split(['(', '{']).next().unwrap_or_default().trim_end().to_owned()
        }
    }
}
