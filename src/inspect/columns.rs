//! Columns of any Parquet file, whoever wrote it.

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

/// The name of each table of a folder, as a column.
const TRIAL: &str = "trial";

/// A column as its file describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColumnInfo {
    pub name: String,
    /// Type of its values, such as `float64`.
    pub type_name: String,
    /// As what rows are chosen by it: booleans, floats or text. `None` if values of its type
    /// cannot be shown.
    pub dtype: Option<DataType>,
}

/// The description of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileInfo {
    pub rows: usize,
    pub columns: Vec<ColumnInfo>,
    /// Key-value metadata that its writer left; not what is for Arrow's readers.
    pub metadata: Vec<(String, String)>,
}

/// The description of a Parquet file.
///
/// # Errors
/// The file cannot be read, is damaged or is not Parquet.
pub fn describe(path: &Path) -> Result<FileInfo, StoreError> {
    parsed(path, |bytes| description(ParquetReader::new(bytes)))
}

/// The same of a file of which the end alone is read, so that whether it is as it was written is not known.
fn describe_end(path: &Path) -> Result<FileInfo, StoreError> {
    let (file, _) = files::open(path, files::DATA_BYTES).map_err(cannot_read(path))?;
    sound(path, || description(ParquetReader::new(file)))
}

fn description<R: MmapBytesReader>(mut reader: ParquetReader<R>) -> PolarsResult<FileInfo> {
    let schema = reader.schema()?;
    let columns = schema.iter().map(|(name, field)| ColumnInfo {
        name: name.to_string(),
        type_name: type_name(&field.dtype),
        dtype: shown_as(&field.dtype),
    });
    let metadata = reader.get_metadata()?;
    let pairs = metadata.key_value_metadata().iter().flatten();
    let pairs = pairs
        .filter(|pair| pair.key != "ARROW:schema")
        .map(|pair| (pair.key.to_string(), pair.value.as_deref().unwrap_or_default().to_owned()));
    let (columns, pairs) = (columns.collect(), pairs.collect());
    Ok(FileInfo { rows: metadata.num_rows, columns, metadata: pairs })
}

/// The same of the tables of a folder: those of the first one and before them `trial`, and all
/// rows.
///
/// # Errors
/// A file cannot be read, is damaged or is not Parquet.
pub fn describe_all(path: &Path) -> Result<FileInfo, StoreError> {
    let mut of_folder: Option<FileInfo> = None;
    for (trial, path) in tables_of(path) {
        if trial.is_none() {
            return describe(&path);
        }
        // Rows that nobody asks for are only counted.
        let own = describe_end(&path)?;
        match &mut of_folder {
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
    of_folder.map_or_else(|| describe(path), Ok)
}

/// Reads the named columns and no others, `rows` rows at most; `trial` is the name that is given.
pub(super) fn read_columns(
    path: &Path,
    names: &[String],
    trial: Option<&str>,
    rows: Option<usize>,
) -> Result<DataFrame, StoreError> {
    let slice = rows.map(|rows| (0, rows));
    let own = names.iter().filter(|name| trial.is_none() || *name != TRIAL).cloned().collect();
    parsed(path, |bytes| {
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

/// What is parsed of a file that is as it was written.
fn parsed<T>(
    path: &Path,
    parse: impl FnOnce(Cursor<Vec<u8>>) -> PolarsResult<T>,
) -> Result<T, StoreError> {
    let (bytes, _) = files::read(path, files::DATA_BYTES).map_err(cannot_read(path))?;
    checksum::check(path, &bytes)?;
    sound(path, || parse(Cursor::new(bytes)))
}

fn sound<T>(path: &Path, parse: impl FnOnce() -> PolarsResult<T>) -> Result<T, StoreError> {
    let error = |message: String| StoreError::Parquet { path: path.to_owned(), message };
    guarded(parse)
        .ok_or_else(|| error("it is damaged".to_owned()))?
        .map_err(|problem| error(problem.to_string()))
}

/// Lists, categories and times are chosen by their text.
fn shown_as(dtype: &ArrowDataType) -> Option<DataType> {
    use ArrowDataType as Arrow;
    match dtype {
        Arrow::Boolean => Some(DataType::Boolean),
        Arrow::Int32 | Arrow::Int64 | Arrow::UInt32 | Arrow::UInt64 => Some(DataType::Float64),
        Arrow::Float32 | Arrow::Float64 | Arrow::Null => Some(DataType::Float64),
        Arrow::Utf8 | Arrow::LargeUtf8 | Arrow::Utf8View => Some(DataType::String),
        Arrow::Timestamp(..) => Some(DataType::String),
        Arrow::Dictionary(_, inner, _) => shown_as(inner).filter(DataType::is_string),
        Arrow::List(inner) | Arrow::LargeList(inner) => {
            shown_as(&inner.dtype).map(|_| DataType::String)
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
