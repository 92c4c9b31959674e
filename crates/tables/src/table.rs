//! Tables in Parquet files.

use std::cell::Cell;
use std::collections::HashSet;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Once};

use polars::polars_utils::compression::ZstdLevel;
use polars::prelude::{
    Column, CompatLevel, DataFrame, DataType, KeyValueMetadata, ParallelStrategy,
    ParquetCompression, ParquetReader, ParquetWriter, PolarsError, PolarsResult, SchemaExt,
    SerReader, StatisticsOptions,
};
use polars_parquet::write::{KeyValue, schema_to_metadata_key};
use trilink_base::files;

use super::{Columns, PendingFile, Reader, Stamp, StoreError, checksum, unit, write_if_changed};

/// Level of zstd compression; noisy numbers barely shrink further at higher levels.
const ZSTD_LEVEL: i32 = 1;

/// Maximum number of rows, by table name, for tables that are read into memory completely.
const MAX_ROWS: [(&str, usize); 15] = [
    ("trials", 20_000),
    ("checks", 1_000_000),
    ("fits", 1_000),
    ("alternative_fits", 1_000),
    ("shared_fits", 1_000),
    ("predictions", 50_000),
    ("comparison", 1_000),
    ("precision", 10_000),
    ("residuals", 1_000_000),
    ("starts", 100_000),
    ("profiles", 100_000),
    ("bootstrap", 1_000_000),
    ("robot_parameters", 20_000),
    ("optima", 10_000),
    ("optimum_maps", 1_000_000),
];

/// Columns that together identify a row, by table name, for tables in which no two rows may have the same
/// identity.
const ROW_NAMES: [(&str, &[&str]); 5] = [
    ("trials", &["trial"]),
    ("robot_parameters", &["trial"]),
    ("fits", &["campaign", "model"]),
    ("alternative_fits", &["campaign", "model"]),
    ("comparison", &["campaign", "model"]),
];

/// Returns the entry of `by_table` for the table in the file at `path`, whose name without the extension is the table's
/// name; `None` if there is no such entry.
fn lookup<T: Copy>(path: &Path, by_table: &[(&str, T)]) -> Option<T> {
    let name = path.file_stem()?.to_str()?;
    by_table.iter().find(|(table, _)| *table == name).map(|(_, entry)| *entry)
}

/// Returns the maximum number of rows of the table in the file at `path`; `usize::MAX` for tables without a limit.
pub(super) fn max_rows(path: &Path) -> usize {
    lookup(path, &MAX_ROWS).unwrap_or(usize::MAX)
}

/// Returns the columns that together identify a row of the table in the file at `path`; empty if the table has no such
/// columns.
pub fn row_names(path: &Path) -> &'static [&'static str] {
    lookup(path, &ROW_NAMES).unwrap_or_default()
}

/// Key of the input fingerprint in the key-value metadata of a Parquet file.
const INPUT_KEY: &str = "trilink.input";

thread_local! {
    static READING: Cell<bool> = const { Cell::new(false) };
}

/// Installs a panic hook that prints nothing for panics inside [`guarded`], which are reported as errors
/// about the file that is read.
pub fn hush_damaged_tables() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let previous = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !READING.with(Cell::get) {
                previous(panic);
            }
        }));
    });
}

/// Calls a function that reads a file with polars; `None` if polars panics instead of returning an error, as it does
/// for some damaged files.
pub fn guarded<T>(read: impl FnOnce() -> T) -> Option<T> {
    READING.with(|reading| {
        reading.set(true);
        let read = catch_unwind(AssertUnwindSafe(read));
        reading.set(false);
        read.ok()
    })
}

/// Origin of a table, which is written to the key-value metadata of its file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Provenance {
    /// Fingerprint of all inputs from which the table was computed.
    pub input: String,
}

/// Table of named columns of equal length.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// File from which the table was read; empty for a new table.
    pub path: PathBuf,
    /// [`Provenance::input`] stored in the file, if there is one.
    pub input: Option<String>,
    pub frame: DataFrame,
}

impl Table {
    /// Builds a table from `columns`, in the given order.
    ///
    /// # Panics
    /// Panics if the columns differ in length or two have the same name.
    pub fn new(columns: Vec<Column>) -> Self {
        let frame = DataFrame::new_infer_height(columns).expect("columns of a table");
        Self { path: PathBuf::new(), input: None, frame }
    }

    /// Writes a Parquet file (zstd) atomically.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written; an existing file is then left unchanged.
    pub fn write(&self, path: &Path, provenance: &Provenance) -> Result<(), StoreError> {
        self.write_pending(path, provenance)?.commit().map(|_| ())
    }

    /// Writes a Parquet file under a temporary name; [`PendingFile::commit`] renames it to `path`.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn write_pending(
        &self,
        path: &Path,
        provenance: &Provenance,
    ) -> Result<PendingFile, StoreError> {
        PendingFile::write(path, &self.to_parquet(path, provenance)?)
    }

    /// Writes a Parquet file as [`Table::write`] does, but leaves an existing file untouched if it already
    /// contains exactly the same bytes.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written; an existing file is then left unchanged.
    pub fn write_if_changed(
        &self,
        path: &Path,
        provenance: &Provenance,
    ) -> Result<Stamp, StoreError> {
        write_if_changed(path, &self.to_parquet(path, provenance)?)
    }

    /// Encodes the table as the bytes of a Parquet file, with `provenance` in its metadata; `path` is named in errors.
    fn to_parquet(&self, path: &Path, provenance: &Provenance) -> Result<Vec<u8>, StoreError> {
        let types = arrow_schema(&self.frame);
        let metadata = KeyValueMetadata::from_static(vec![
            (types.key, types.value.unwrap_or_default()),
            ("trilink.version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
            (INPUT_KEY.to_owned(), provenance.input.clone()),
            (checksum::KEY.to_owned(), checksum::PLACEHOLDER.to_owned()),
        ]);
        let mut bytes = Vec::new();
        let level = ZstdLevel::try_new(ZSTD_LEVEL).map_err(|error| table_error(path, &error))?;
        ParquetWriter::new(&mut bytes)
            .set_parallel(false)
            .with_compression(ParquetCompression::Zstd(Some(level)))
            // Column statistics only help to skip row groups, and these tables have a single row group.
            .with_statistics(StatisticsOptions::empty())
            .with_key_value_metadata(Some(metadata))
            .finish(&mut self.frame.clone())
            .map_err(|error| table_error(path, &error))?;
        assert!(checksum::insert(&mut bytes), "the metadata has a placeholder for the checksum");
        Ok(bytes)
    }

    /// Reads a Parquet file.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, is damaged, is not a Parquet file, or has column types
    /// that trilink does not write.
    pub fn read(path: &Path) -> Result<Self, StoreError> {
        Reader::default().table(path)
    }

    /// Parses the bytes of a Parquet file; `path` is named in errors.
    ///
    /// # Errors
    /// Returns an error in the same cases as [`Table::read`].
    pub fn parse(path: &Path, bytes: Vec<u8>) -> Result<Self, StoreError> {
        Self::parse_at_most(path, bytes, usize::MAX)
    }

    /// Parses a table as [`Table::parse`] does, but rejects one with more than `max_rows` rows.
    pub(super) fn parse_at_most(
        path: &Path,
        bytes: Vec<u8>,
        max_rows: usize,
    ) -> Result<Self, StoreError> {
        let table_error = |message: String| StoreError::Table { path: path.to_owned(), message };
        checksum::check(path, &bytes)?;
        let mut reader =
            ParquetReader::new(Cursor::new(bytes)).read_parallel(ParallelStrategy::None);
        let read = || {
            let metadata = reader.get_metadata()?;
            let rows = metadata.num_rows;
            if rows > max_rows {
                let message = format!("found {rows} rows, but at most {max_rows} are allowed");
                return Err(PolarsError::ComputeError(message.into()));
            }
            let pairs = metadata.key_value_metadata().iter().flatten();
            let mut inputs = pairs.filter(|pair| pair.key == INPUT_KEY);
            let input = inputs.next().and_then(|pair| Some(pair.value.as_ref()?.to_string()));
            PolarsResult::Ok((reader.finish()?, input))
        };
        let (frame, input) = guarded(read)
            .ok_or_else(|| table_error("the file is damaged".to_owned()))?
            .map_err(|error| table_error(error.to_string()))?;
        Ok(Self { path: path.to_owned(), input, frame })
    }

    /// Returns the table, or an error if two rows agree in all columns that identify a row (see
    /// [`row_names`]).
    pub(super) fn each_row_once(self) -> Result<Self, StoreError> {
        let names = row_names(&self.path);
        let texts = names.iter().map(|name| self.frame.column(name).ok()?.str().ok());
        // A missing column is reported later by the code that reads the column.
        let Some(texts) = texts.collect::<Option<Vec<_>>>().filter(|texts| !texts.is_empty())
        else {
            return Ok(self);
        };
        let mut seen = HashSet::new();
        for row in 0..self.len() {
            let name: Vec<_> = texts.iter().map(|text| text.get(row).unwrap_or("")).collect();
            let text = name.join(" ");
            if !seen.insert(name) {
                return Err(self.wrong(
                    &names.join(", "),
                    &format!("`{text}` twice"),
                    "each value once",
                ));
            }
        }
        Ok(self)
    }

    /// Returns the number of rows.
    pub fn len(&self) -> usize {
        self.frame.height()
    }

    /// Returns whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Reads the values in a column, or in several columns if `name` is a pattern (see [`Columns`]).
    ///
    /// # Errors
    /// Returns an error if a column is missing or has a type from which `T` cannot be read.
    pub fn values<T: Columns>(&self, name: &str) -> Result<Vec<T>, StoreError> {
        T::read(self, name)
    }

    /// Returns a column converted to `dtype`. `is_needed` tests whether the column's type is of the required
    /// kind, which `needed` names in errors.
    pub(super) fn column(
        &self,
        name: &str,
        (needed, is_needed): (&'static str, fn(&DataType) -> bool),
        dtype: &DataType,
    ) -> Result<Column, StoreError> {
        let column = self.frame.column(name);
        let column = column.map_err(|_| self.wrong(name, "no such column", needed))?;
        match column.dtype() {
            found if is_needed(found) => {
                column.strict_cast(dtype).map_err(|error| self.error(&error))
            }
            found => Err(self.wrong(name, &type_name(found), needed)),
        }
    }

    pub(super) fn wrong(&self, column: &str, found: &str, needed: &'static str) -> StoreError {
        StoreError::Column {
            path: self.path.clone(),
            column: column.to_owned(),
            found: found.to_owned(),
            needed,
        }
    }

    pub(super) fn error(&self, error: &PolarsError) -> StoreError {
        table_error(&self.path, error)
    }
}

/// Returns the name of a column type for errors.
fn type_name(dtype: &DataType) -> String {
    match dtype {
        dtype if dtype.is_float() => "numbers".to_owned(),
        dtype if dtype.is_integer() => "whole numbers".to_owned(),
        DataType::Boolean => "booleans".to_owned(),
        DataType::String => "text".to_owned(),
        other => other.to_string(),
    }
}

fn table_error(path: &Path, error: &PolarsError) -> StoreError {
    StoreError::Table { path: path.to_owned(), message: error.to_string() }
}

/// Returns whether a file is a table that trilink wrote.
pub fn is_own_table(path: &Path) -> bool {
    const KEY: &[u8] = INPUT_KEY.as_bytes();
    files::read(path, files::DATA_BYTES)
        .is_ok_and(|(bytes, _)| bytes.windows(KEY.len()).any(|part| part == KEY))
}

/// Returns the metadata entry that declares the Arrow types of the columns to other programs, each with its unit, if it
/// has one, as the metadata `unit` of the field. It declares the classic layout for text and for lists of text, because
/// pandas cannot read the lists of string views that polars would declare.
fn arrow_schema(frame: &DataFrame) -> KeyValue {
    let mut schema = frame.schema().to_arrow(CompatLevel::oldest());
    for (name, field) in schema.iter_mut() {
        let of_unit = |unit: &str| std::iter::once(("unit".into(), unit.into())).collect();
        field.metadata = unit(name).map(|unit| Arc::new(of_unit(unit)));
    }
    schema_to_metadata_key(&schema)
}

#[cfg(test)]
mod tests {
    use trilink_robot::{Parameter, Quantity};
    use trilink_statistics::Estimate;

    use super::super::columns::{numbers, repeated};
    use super::*;
    use crate::Columns;

    crate::rows! {
        /// Row with columns of all types.
        pub struct Row {
            pub number: f64,
            pub count: i64,
            pub some: Option<i64>,
            pub used: bool,
            pub name: String,
            pub free: Vec<Parameter>,
        }
    }

    fn row(name: &str) -> Row {
        Row { name: name.to_owned(), used: true, ..Row::blank() }
    }

    fn provenance() -> Provenance {
        Provenance { input: "0123".to_owned() }
    }

    #[test]
    fn units_are_in_the_arrow_schema_and_empty_text_is_null() {
        let columns = vec![
            numbers("v_m_s", vec![0.1, 0.2]),
            crate::texts("campaign", ["", "weave"].into_iter()),
        ];
        let table = Table::new(columns);
        assert_eq!(table.frame.column("campaign").unwrap().null_count(), 1);
        assert_eq!(table.values::<String>("campaign").unwrap(), ["", "weave"]);
        let bytes = table.to_parquet(Path::new("t"), &Provenance { input: String::new() }).unwrap();
        let schema = ParquetReader::new(Cursor::new(bytes)).schema().unwrap();
        let unit = |name: &str| {
            let metadata = schema.get(name).unwrap().metadata.clone();
            metadata.and_then(|metadata| metadata.get("unit").map(ToString::to_string))
        };
        assert_eq!((unit("v_m_s").as_deref(), unit("campaign")), (Some("m/s"), None));
    }

    #[test]
    fn integers_that_another_program_wrote_with_gaps_are_read_as_integers() {
        let table = |count: Column| {
            let mut table = Row::to_table(&[row("a"), row("b")]);
            for name in ["count", "some"] {
                let column = count.clone().with_name(name.into());
                table.frame.with_column(column).expect("two rows");
            }
            table
        };
        for count in [
            Column::new("".into(), [Some(12_i64), None]),
            Column::new("".into(), [Some(12_i32), None]),
            numbers("", vec![12.0, f64::NAN]),
            Column::new("".into(), [12.0, f64::NAN]),
        ] {
            let rows = Row::from_table(&table(count)).unwrap();
            assert_eq!([rows[0].count, rows[1].count], [12, 0]);
            assert_eq!([rows[0].some, rows[1].some], [Some(12), None]);
        }
        let broken = Row::from_table(&table(numbers("", vec![12.5, 1.0]))).unwrap_err();
        assert!(broken.to_string().ends_with("column `count`: found 12.5, needed whole numbers"));
    }

    #[test]
    fn integers_whose_sum_could_overflow_are_rejected() {
        let read = |counts: Column| {
            let mut table = Row::to_table(&[row("a"), row("b")]);
            table.frame.with_column(counts.with_name("count".into())).expect("two rows");
            Row::from_table(&table).map(|rows| rows[0].count)
        };
        let max = 1_000_000_000_000;
        assert_eq!(read(Column::new("".into(), [max, -max])).unwrap(), max);
        for counts in [
            Column::new("".into(), [0, max + 1]),
            Column::new("".into(), [0, i64::MIN]),
            numbers("", vec![0.0, -1e13]),
        ] {
            let message = read(counts).unwrap_err().to_string();
            assert!(message.ends_with("needed whole numbers up to 1e12"), "{message}");
        }
        // An integer that is out of range must not be read as null, which would become 0.
        assert!(read(Column::new("".into(), [0, u64::MAX])).is_err());
    }

    #[test]
    fn a_negative_standard_error_is_rejected() {
        let of =
            |se: f64| Estimate::from_table(&Estimate::to_table(&[Estimate { value: -1.0, se }]));
        let message = of(-0.5).unwrap_err().to_string();
        assert_eq!(message, ": column `_se`: found -0.5, needed standard errors, 0 or above");
        assert!([0.5, 0.0, -0.0, f64::NAN].into_iter().all(|se| of(se).is_ok()));
    }

    #[test]
    fn one_error_names_all_missing_columns() {
        let table = Table::new(vec![numbers("number", vec![1.0]), repeated("name", "a", 1)]);
        let message = Row::from_table(&table).unwrap_err().to_string();
        let missing = "columns `count`, `some`, `used`, `free` are missing";
        assert!(message.contains(missing), "{message}");
        assert!(message.ends_with("`trilink run` recomputes the tables of an older version"));
    }

    #[test]
    fn one_error_names_all_missing_columns_and_all_of_other_types() {
        let table = Table::new(vec![
            repeated("number", "x", 1),
            Column::new("count".into(), [true]),
            Column::new("used".into(), [true]),
            numbers("name", vec![1.0]),
            Column::new("free".into(), [1_i64]),
        ]);
        let message = Row::from_table(&table).unwrap_err().to_string();
        assert_eq!(
            message,
            ": column `some` is missing; column `number`: found text, needed numbers; \
             column `count`: found booleans, needed whole numbers; column `name`: found numbers, \
             needed text; column `free`: found whole numbers, needed text; \
             `trilink run` recomputes the tables of an older version"
        );
    }

    #[test]
    fn a_table_is_read_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/table.parquet");
        let rows = vec![
            Row {
                number: 1.5,
                count: 1,
                some: Some(7),
                free: Quantity::Skid.of_each().into(),
                ..row("x")
            },
            Row { number: f64::NAN, count: 2, used: false, ..row("") },
            Row { number: -2.0, count: 3, free: vec![Quantity::Damping.one()], ..row("z") },
        ];
        Row::to_table(&rows).write(&path, &provenance()).unwrap();
        let found = Table::read(&path).unwrap();
        assert_eq!(
            found.frame.get_column_names(),
            ["number", "count", "some", "used", "name", "free"]
        );
        assert_eq!(found.frame.column("some").unwrap().dtype(), &DataType::Int64);
        let found = Row::from_table(&found).unwrap();
        assert!(found[1].number.is_nan());
        for (found, row) in found.into_iter().zip(rows) {
            let number = if row.number.is_nan() { 0.0 } else { found.number };
            assert_eq!(Row { number, ..found }, Row { number, ..row });
        }
        let bytes = std::fs::read(&path).unwrap();
        let holds = |text: &str| bytes.windows(text.len()).any(|part| part == text.as_bytes());
        assert!(holds("trilink.version") && holds("trilink.input"));
    }

    #[test]
    fn an_error_names_the_missing_column() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let table = Table::new(vec![Column::new("count".into(), [1_i64])]);
        table.write(&path, &provenance()).unwrap();
        let found = Table::read(&path).unwrap();
        let message = found.values::<f64>("d_m").unwrap_err().to_string();
        assert!(message.ends_with("column `d_m`: found no such column, needed numbers"));
        let message = found.values::<String>("count").unwrap_err().to_string();
        assert!(message.ends_with("column `count`: found whole numbers, needed text"));
    }

    #[test]
    fn a_damaged_table_is_rejected_and_one_of_another_program_causes_no_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let table = Table::new(vec![
            numbers("number", (0..200).map(f64::from).collect()),
            repeated("name", "trial", 200),
        ]);
        table.write(&path, &provenance()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let read = |bytes: &[u8], index: usize, bits: u8| {
            let mut damaged = bytes.to_vec();
            damaged[index] ^= bits;
            std::fs::write(&path, &damaged).unwrap();
            Table::read(&path)
        };
        let key =
            whole.windows(checksum::KEY.len()).rposition(|part| part == checksum::KEY.as_bytes());
        let key = key.expect("a checksum");
        let value = key + checksum::KEY.len() + 2;
        for index in 0..whole.len() {
            // With a damaged key or writer's name the checksum is not found, but nothing else is damaged.
            let is_in_name =
                (key..value).contains(&index) || (value + 64..value + 73).contains(&index);
            match read(&whole, index, 1 << (index % 8)) {
                Ok(found) => assert!(is_in_name && found.frame == table.frame, "{index}"),
                Err(StoreError::Damaged { .. }) => {}
                Err(error) => assert!(is_in_name, "{index}: {error}"),
            }
        }
        let mut foreign = whole;
        // The file as another library would write it after copying the key-value pairs from the file that it
        // read.
        foreign[value + 72] = b'z';
        std::fs::write(&path, &foreign).unwrap();
        assert_eq!(Table::read(&path).unwrap().frame, table.frame);
        let rejected =
            (0..foreign.len()).filter(|&index| read(&foreign, index, 0x5a).is_err()).count();
        assert!(rejected > foreign.len() / 4, "{rejected} of {}", foreign.len());
    }

    #[test]
    fn a_file_that_is_not_a_table_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        std::fs::write(&path, b"PAR1 but not really").unwrap();
        assert!(matches!(Table::read(&path), Err(StoreError::Table { .. })));
    }
}
