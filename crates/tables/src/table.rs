//! Tables as Parquet files.

use std::cell::Cell;
use std::collections::HashSet;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Once;

use polars::polars_utils::compression::ZstdLevel;
use polars::prelude::{
    Column, CompatLevel, DataFrame, DataType, KeyValueMetadata, ParallelStrategy,
    ParquetCompression, ParquetReader, ParquetWriter, PolarsError, PolarsResult, SchemaExt,
    SerReader, StatisticsOptions,
};
use polars_parquet::write::{KeyValue, schema_to_metadata_key};
use trilink_base::files;

use super::{Columns, PendingFile, Reader, Stamp, StoreError, checksum, write_if_changed};

/// Numbers with noise in them hardly shrink, however long that takes. Statistics, too, would take
/// time: they tell a reader which parts of a table to skip, and these tables have one part.
const ZSTD_LEVEL: i32 = 1;

/// Most rows of the tables that are read as a whole, by their names: an absurd table costs no gigabytes.
const MOST_ROWS: [(&str, usize); 13] = [
    ("trials", 20_000),
    ("checks", 1_000_000),
    ("fits", 1_000),
    ("alternative_fits", 1_000),
    ("shared_fits", 1_000),
    ("predictions", 50_000),
    ("comparison", 1_000),
    ("starts", 100_000),
    ("profiles", 100_000),
    ("bootstrap", 1_000_000),
    ("robot_parameters", 20_000),
    ("optima", 10_000),
    ("optimum_maps", 1_000_000),
];

/// Columns that name a row, of tables in which each has a name of its own.
const ROW_NAMES: [(&str, &[&str]); 5] = [
    ("trials", &["trial"]),
    ("robot_parameters", &["trial"]),
    ("fits", &["campaign", "model"]),
    ("alternative_fits", &["campaign", "model"]),
    ("comparison", &["campaign", "model"]),
];

/// What is known of the table with this file.
fn known<T: Copy>(path: &Path, of_tables: &[(&str, T)]) -> Option<T> {
    let name = path.file_stem()?.to_str()?;
    of_tables.iter().find(|(known, _)| *known == name).map(|(_, of_table)| *of_table)
}

/// Most rows of the table with this file.
pub(super) fn most_rows(path: &Path) -> usize {
    known(path, &MOST_ROWS).unwrap_or(usize::MAX)
}

/// The columns that name a row of the table with this file; none if its rows have no names.
pub fn row_names(path: &Path) -> &'static [&'static str] {
    known(path, &ROW_NAMES).unwrap_or_default()
}

/// Key of the fingerprint in a file's metadata.
const INPUT_KEY: &str = "trilink.input";

thread_local! {
    static READING: Cell<bool> = const { Cell::new(false) };
}

/// Whether this thread is reading a table: a panic then is an error of the file, and a panic
/// hook need not speak of it.
fn is_reading() -> bool {
    READING.with(Cell::get)
}

/// From now on a panic over a damaged table is only the error of its file, and prints nothing.
pub fn hush_damaged_tables() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !is_reading() {
                before(panic);
            }
        }));
    });
}

/// Reads with polars; `None` if the file is damaged such that the reader panics instead of giving
/// an error.
pub fn guarded<T>(read: impl FnOnce() -> T) -> Option<T> {
    READING.with(|reading| {
        reading.set(true);
        let read = catch_unwind(AssertUnwindSafe(read));
        reading.set(false);
        read.ok()
    })
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
    /// The file that it was read from.
    pub path: PathBuf,
    /// [`Provenance::input`] of that file, if it has one.
    pub input: Option<String>,
    pub frame: DataFrame,
}

impl Table {
    /// A table of `columns`, all of one length and each of another name, in this order.
    pub fn new(columns: Vec<Column>) -> Self {
        let frame = DataFrame::new_infer_height(columns).expect("columns of a table");
        Self { path: PathBuf::new(), input: None, frame }
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
    pub fn write_beside(
        &self,
        path: &Path,
        provenance: &Provenance,
    ) -> Result<PendingFile, StoreError> {
        PendingFile::write(path, &self.to_parquet(path, provenance)?)
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
        write_if_changed(path, &self.to_parquet(path, provenance)?)
    }

    /// The bytes of the file.
    fn to_parquet(&self, path: &Path, provenance: &Provenance) -> Result<Vec<u8>, StoreError> {
        let types = arrow_schema(&self.frame);
        let metadata = KeyValueMetadata::from_static(vec![
            (types.key, types.value.unwrap_or_default()),
            ("trilink.version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
            (INPUT_KEY.to_owned(), provenance.input.clone()),
            (checksum::KEY.to_owned(), checksum::NONE.to_owned()),
        ]);
        let mut bytes = Vec::new();
        let write = |level| {
            ParquetWriter::new(&mut bytes)
                .set_parallel(false)
                .with_compression(ParquetCompression::Zstd(Some(level)))
                .with_statistics(StatisticsOptions::empty())
                .with_key_value_metadata(Some(metadata))
                .finish(&mut self.frame.clone())
        };
        ZstdLevel::try_new(ZSTD_LEVEL)
            .and_then(write)
            .map_err(|error| table_error(path, &error))?;
        assert!(checksum::put(&mut bytes), "the metadata has a place for it");
        Ok(bytes)
    }

    /// Reads a Parquet file.
    ///
    /// # Errors
    /// The file cannot be read, is damaged or is not Parquet, or holds types that trilink does not write.
    pub fn read(path: &Path) -> Result<Self, StoreError> {
        Reader::default().table(path)
    }

    /// [`Table::read`] of bytes at hand.
    pub fn parse(path: &Path, bytes: Vec<u8>) -> Result<Self, StoreError> {
        Self::parse_at_most(path, bytes, usize::MAX)
    }

    /// [`Table::parse`] of a table that has so many rows at most.
    pub(super) fn parse_at_most(
        path: &Path,
        bytes: Vec<u8>,
        most: usize,
    ) -> Result<Self, StoreError> {
        let table_error = |message: String| StoreError::Table { path: path.to_owned(), message };
        checksum::check(path, &bytes)?;
        let mut reader =
            ParquetReader::new(Cursor::new(bytes)).read_parallel(ParallelStrategy::None);
        let read = || {
            let metadata = reader.get_metadata()?;
            if metadata.num_rows > most {
                let message = format!("found {} rows, needed at most {most}", metadata.num_rows);
                return Err(PolarsError::ComputeError(message.into()));
            }
            let pairs = metadata.key_value_metadata().iter().flatten();
            let mut inputs = pairs.filter(|pair| pair.key == INPUT_KEY);
            let input = inputs.next().and_then(|pair| Some(pair.value.as_ref()?.to_string()));
            PolarsResult::Ok((reader.finish()?, input))
        };
        let (frame, input) = guarded(read)
            .ok_or_else(|| table_error("it is damaged".to_owned()))?
            .map_err(|error| table_error(error.to_string()))?;
        Ok(Self { path: path.to_owned(), input, frame })
    }

    /// The same table, if no two of its rows have one name.
    pub(super) fn each_row_once(self) -> Result<Self, StoreError> {
        let names = row_names(&self.path);
        let texts = names.iter().map(|name| self.frame.column(name).ok()?.str().ok());
        // A column that is not there is missed by name where it is needed.
        let Some(texts) = texts.collect::<Option<Vec<_>>>().filter(|texts| !texts.is_empty())
        else {
            return Ok(self);
        };
        let mut seen = HashSet::new();
        let name = |row| texts.iter().map(|text| text.get(row).unwrap_or("")).collect::<Vec<_>>();
        match (0..self.len()).map(name).find(|name| !seen.insert(name.clone())) {
            Some(again) => {
                let found = format!("`{}` twice", again.join(" "));
                Err(self.wrong(&names.join(", "), &found, "each once"))
            }
            None => Ok(self),
        }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.frame.height()
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Values of a column, or of several whose names have a pattern.
    ///
    /// # Errors
    /// A column is not there, or holds something else.
    pub fn values<T: Columns>(&self, name: &str) -> Result<Vec<T>, StoreError> {
        T::read(self, name)
    }

    /// A column of a type that is `needed` (what it is called, and whether one is it), as `dtype`.
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
            found => Err(self.wrong(name, &kind(found), needed)),
        }
    }

    pub(super) fn wrong(&self, column: &str, found: &str, needed: &'static str) -> StoreError {
        let (path, column) = (self.path.clone(), column.to_owned());
        StoreError::Column { path, column, found: found.to_owned(), needed }
    }

    pub(super) fn error(&self, error: &PolarsError) -> StoreError {
        table_error(&self.path, error)
    }
}

/// What a type is called in errors.
fn kind(dtype: &DataType) -> String {
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

/// Whether a file is a table that this program wrote.
pub fn is_own_table(path: &Path) -> bool {
    const KEY: &[u8] = INPUT_KEY.as_bytes();
    files::read(path, files::DATA_BYTES)
        .is_ok_and(|(bytes, _)| bytes.windows(KEY.len()).any(|part| part == KEY))
}

/// The types that Arrow's readers are to make of the columns: text and lists of text as they have
/// always been. pandas cannot take a list of views, which is what polars would name.
fn arrow_schema(frame: &DataFrame) -> KeyValue {
    schema_to_metadata_key(&frame.schema().to_arrow(CompatLevel::oldest()))
}

#[cfg(test)]
mod tests {
    use trilink_robot::{Parameter, Quantity};
    use trilink_statistics::Estimate;

    use super::super::columns::{numbers, repeated};
    use super::*;
    use crate::Columns;

    crate::rows! {
        /// A row with columns of all types.
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
    fn whole_numbers_that_another_program_wrote_with_gaps_are_whole_numbers() {
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
    fn whole_numbers_of_which_a_sum_would_be_none_are_refused() {
        let read = |counts: Column| {
            let mut table = Row::to_table(&[row("a"), row("b")]);
            table.frame.with_column(counts.with_name("count".into())).expect("two rows");
            Row::from_table(&table).map(|rows| rows[0].count)
        };
        let most = 1_000_000_000_000;
        assert_eq!(read(Column::new("".into(), [most, -most])).unwrap(), most);
        for counts in [
            Column::new("".into(), [0, most + 1]),
            Column::new("".into(), [0, i64::MIN]),
            numbers("", vec![0.0, -1e13]),
        ] {
            let message = read(counts).unwrap_err().to_string();
            assert!(message.ends_with("needed whole numbers up to 1e12"), "{message}");
        }
        // Not null, which would count 0.
        assert!(read(Column::new("".into(), [0, u64::MAX])).is_err());
    }

    #[test]
    fn a_negative_standard_error_is_refused() {
        let of =
            |se: f64| Estimate::from_table(&Estimate::to_table(&[Estimate { value: -1.0, se }]));
        let message = of(-0.5).unwrap_err().to_string();
        assert_eq!(message, ": column `_se`: found -0.5, needed standard errors, 0 or above");
        assert!([0.5, 0.0, -0.0, f64::NAN].into_iter().all(|se| of(se).is_ok()));
    }

    #[test]
    fn missing_columns_are_named_all_at_once() {
        let table = Table::new(vec![numbers("number", vec![1.0]), repeated("name", "a", 1)]);
        let message = Row::from_table(&table).unwrap_err().to_string();
        let missing = "columns `count`, `some`, `used`, `free`: found none of them";
        assert!(message.contains(missing), "{message}");
        assert!(message.ends_with("`trilink run` makes the tables of an older version anew"));
    }

    #[test]
    fn columns_of_other_types_are_named_all_at_once_with_those_that_are_missing() {
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
            ": column `some`: found no such column; column `number`: found text, needed numbers; \
             column `count`: found booleans, needed whole numbers; column `name`: found numbers, \
             needed text; column `free`: found whole numbers, needed text; \
             `trilink run` makes the tables of an older version anew"
        );
    }

    #[test]
    fn a_table_comes_back_as_it_was_written() {
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
    fn a_column_that_is_not_there_is_named() {
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
    fn a_damaged_table_is_refused_and_what_another_program_wrote_is_no_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let table = Table::new(vec![
            numbers("number", (0..200).map(f64::from).collect()),
            repeated("name", "trial", 200),
        ]);
        table.write(&path, &provenance()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let read = |bytes: &[u8], place: usize, bits: u8| {
            let mut damaged = bytes.to_vec();
            damaged[place] ^= bits;
            std::fs::write(&path, &damaged).unwrap();
            Table::read(&path)
        };
        let key =
            whole.windows(checksum::KEY.len()).rposition(|part| part == checksum::KEY.as_bytes());
        let key = key.expect("a checksum");
        let value = key + checksum::KEY.len() + 2;
        for place in 0..whole.len() {
            // Without its name or the writer's there is no checksum, but nothing else is damaged.
            let is_of_name =
                (key..value).contains(&place) || (value + 64..value + 73).contains(&place);
            match read(&whole, place, 1 << (place % 8)) {
                Ok(found) => assert!(is_of_name && found.frame == table.frame, "{place}"),
                Err(StoreError::Damaged { .. }) => {}
                Err(error) => assert!(is_of_name, "{place}: {error}"),
            }
        }
        let mut foreign = whole;
        // A library that keeps the pairs of what it read.
        foreign[value + 72] = b'z';
        std::fs::write(&path, &foreign).unwrap();
        assert_eq!(Table::read(&path).unwrap().frame, table.frame);
        let refused =
            (0..foreign.len()).filter(|&place| read(&foreign, place, 0x5a).is_err()).count();
        assert!(refused > foreign.len() / 4, "{refused} of {}", foreign.len());
    }

    #[test]
    fn a_file_that_is_no_table_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        std::fs::write(&path, b"PAR1 but not really").unwrap();
        assert!(matches!(Table::read(&path), Err(StoreError::Table { .. })));
    }
}
