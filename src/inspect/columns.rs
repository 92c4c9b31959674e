//! Columns of any Parquet file, whoever wrote it.

use std::fs::File;
use std::path::Path;

use polars::datatypes::ArrowDataType;
use polars::prelude::{
    DataFrame, DataType, ParallelStrategy, ParquetReader, PolarsResult, SerReader,
};

use crate::store::{StoreError, guarded};

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Boolean,
    /// Whole or not.
    Number,
    Text,
    List,
}

/// What a file says of a column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColumnInfo {
    pub name: String,
    /// Type of its values, such as `float64`.
    pub type_name: String,
    /// `None` if values of the type cannot be shown.
    pub kind: Option<Kind>,
}

/// What a file says of itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileInfo {
    pub rows: usize,
    pub columns: Vec<ColumnInfo>,
    /// Key-value metadata that its writer left; not what is for Arrow's readers.
    pub metadata: Vec<(String, String)>,
}

/// Reads what a Parquet file says of itself and none of its rows.
///
/// # Errors
/// The file cannot be read or is not Parquet.
pub fn describe(path: &Path) -> Result<FileInfo, StoreError> {
    read(path, |mut reader| {
        let schema = reader.schema()?;
        let columns = schema.iter().map(|(name, field)| ColumnInfo {
            name: name.to_string(),
            type_name: type_name(&field.dtype),
            kind: kind(&field.dtype),
        });
        let metadata = reader.get_metadata()?;
        let pairs = metadata.key_value_metadata().iter().flatten();
        let pairs = pairs.filter(|pair| pair.key != "ARROW:schema");
        let text = |value: &Option<_>| value.as_ref().map_or(String::new(), ToString::to_string);
        let pairs = pairs.map(|pair| (pair.key.to_string(), text(&pair.value)));
        let (columns, metadata) = (columns.collect(), pairs.collect());
        Ok(FileInfo { rows: reader.get_metadata()?.num_rows, columns, metadata })
    })
}

/// Reads the named columns and no others, `rows` rows at most.
pub(super) fn read_columns(
    path: &Path,
    names: Vec<String>,
    rows: Option<usize>,
) -> Result<DataFrame, StoreError> {
    let slice = rows.map(|rows| (0, rows));
    read(path, |reader| reader.with_columns(Some(names)).with_slice(slice).finish())
}

fn read<T>(
    path: &Path,
    work: impl FnOnce(ParquetReader<File>) -> PolarsResult<T>,
) -> Result<T, StoreError> {
    let file =
        File::open(path).map_err(|source| StoreError::Read { path: path.to_owned(), source })?;
    let error = |message: String| StoreError::Parquet { path: path.to_owned(), message };
    let reader = ParquetReader::new(file).read_parallel(ParallelStrategy::None);
    guarded(|| work(reader))
        .ok_or_else(|| error("it is damaged".to_owned()))?
        .map_err(|problem| error(problem.to_string()))
}

impl Kind {
    /// As messages name it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Boolean => "a boolean",
            Self::Number => "a number",
            Self::Text => "text",
            Self::List => "a list",
        }
    }

    /// Of the values of a column by which rows are chosen; `None` if all are missing.
    pub(super) fn of(dtype: &DataType) -> Option<Self> {
        match dtype {
            DataType::Null => None,
            DataType::Boolean => Some(Self::Boolean),
            DataType::String => Some(Self::Text),
            _ => Some(Self::Number),
        }
    }

    /// The type of such a column that has no rows.
    pub(super) fn dtype(self) -> DataType {
        match self {
            Self::Boolean => DataType::Boolean,
            Self::Number => DataType::Float64,
            Self::Text | Self::List => DataType::String,
        }
    }
}

/// The types that the reader is built with.
fn kind(dtype: &ArrowDataType) -> Option<Kind> {
    use ArrowDataType::{
        Boolean, Dictionary, Float32, Float64, Int32, Int64, LargeList, LargeUtf8, List, Null,
        UInt32, UInt64, Utf8, Utf8View,
    };
    match dtype {
        Boolean => Some(Kind::Boolean),
        Int32 | Int64 | UInt32 | UInt64 | Float32 | Float64 | Null => Some(Kind::Number),
        Utf8 | LargeUtf8 | Utf8View => Some(Kind::Text),
        Dictionary(_, inner, _) => kind(inner).filter(|kind| *kind == Kind::Text),
        List(inner) | LargeList(inner) => kind(&inner.dtype).map(|_| Kind::List),
        _ => None,
    }
}

fn type_name(dtype: &ArrowDataType) -> String {
    match dtype {
        ArrowDataType::Utf8 | ArrowDataType::LargeUtf8 | ArrowDataType::Utf8View => "text".into(),
        ArrowDataType::List(inner) | ArrowDataType::LargeList(inner) => {
            format!("list of {}", type_name(&inner.dtype))
        }
        ArrowDataType::Dictionary(_, inner, _) => format!("categories of {}", type_name(inner)),
        other => {
            let name = format!("{other:?}").to_lowercase();
            name.split(['(', '{']).next().unwrap_or_default().trim_end().to_owned()
        }
    }
}
