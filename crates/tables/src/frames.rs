//! Tables with one row per frame of a recording, which are held column by column in memory.

use std::collections::BTreeMap;

use polars::prelude::{Column, DataType};

use crate::columns::{numbered, repeated, texts};
use crate::{Columns, StoreError, Table};

/// Type whose values are stored in one or several columns with one row per frame; a pattern determines the
/// column names (see [`Columns`]).
pub trait Frames: Sized {
    /// Default column-name pattern for a field of this type; `{field}` stands for the field's name.
    const PATTERN: &'static str = "{field}";

    /// Appends the columns that store the value.
    fn write(self, pattern: &str, columns: &mut Vec<Column>);

    /// Reads a value from its columns in a table.
    ///
    /// # Errors
    /// Returns an error if a column is missing or has the wrong type.
    fn read(table: &Table, pattern: &str) -> Result<Self, StoreError>;

    /// Builds the table of a trial; its first column, `trial`, contains the trial's name in every row.
    fn into_table(self, trial: &str) -> Table {
        let mut columns = Vec::new();
        self.write("{}", &mut columns);
        columns.insert(0, repeated("trial", trial, columns.first().map_or(0, Column::len)));
        Table::new(columns)
    }

    /// Reads a value from the table of a trial.
    ///
    /// # Errors
    /// Returns an error if a column is missing or has the wrong type.
    fn from_table(table: &Table) -> Result<Self, StoreError> {
        Self::read(table, "{}")
    }
}

impl<T: Columns> Frames for Vec<T> {
    fn write(self, name: &str, columns: &mut Vec<Column>) {
        T::write_all(self, name, columns);
    }

    fn read(table: &Table, name: &str) -> Result<Self, StoreError> {
        T::read(table, name)
    }
}

/// The columns of an array are numbered 0, 1, 2 for links and wheels, and 1, 2 for joints.
impl<S: Frames, const N: usize> Frames for [S; N] {
    fn write(self, pattern: &str, columns: &mut Vec<Column>) {
        for (element, pattern) in self.into_iter().zip(numbered::<N>(pattern)) {
            element.write(&pattern, columns);
        }
    }

    fn read(table: &Table, pattern: &str) -> Result<Self, StoreError> {
        let all = numbered::<N>(pattern).map(|pattern| S::read(table, &pattern));
        let all: Vec<S> = all.collect::<Result<_, _>>()?;
        Ok(all.try_into().unwrap_or_else(|_| unreachable!("one for each pattern")))
    }
}

/// Columns that not every table has: `None` if one of them is absent or of another type.
impl<S: Frames> Frames for Option<S> {
    const PATTERN: &'static str = S::PATTERN;

    fn write(self, pattern: &str, columns: &mut Vec<Column>) {
        if let Some(value) = self {
            value.write(pattern, columns);
        }
    }

    fn read(table: &Table, pattern: &str) -> Result<Self, StoreError> {
        match S::read(table, pattern) {
            Err(error) if error.is_schema_mismatch() => Ok(None),
            read => read.map(Some),
        }
    }
}

/// Text for each frame. Equal texts are stored only once, because a long recording has millions of frames but few
/// different texts. Empty if the table comes from an older version of the program and lacks the column.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrameTexts {
    distinct: Vec<String>,
    /// Index into `distinct`, for each frame.
    frames: Vec<u32>,
}

impl FrameTexts {
    /// Computes the text for each frame from the frame's key; frames with equal keys get equal texts.
    pub fn new<K: Ord + Copy>(keys: impl Iterator<Item = K>, text: impl Fn(K) -> String) -> Self {
        let mut distinct = Vec::new();
        let mut indices = BTreeMap::new();
        let mut frames = Vec::new();
        for key in keys {
            frames.push(*indices.entry(key).or_insert_with(|| {
                distinct.push(text(key));
                distinct.len() as u32 - 1
            }));
        }
        Self { distinct, frames }
    }

    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    pub fn get(&self, frame: usize) -> Option<&str> {
        Some(&self.distinct[*self.frames.get(frame)? as usize])
    }
}

impl Frames for FrameTexts {
    fn write(self, name: &str, columns: &mut Vec<Column>) {
        let frames = self.frames.iter().map(|index| self.distinct[*index as usize].as_str());
        columns.push(texts(name, frames));
    }

    fn read(table: &Table, name: &str) -> Result<Self, StoreError> {
        if table.frame.column(name).is_err() {
            return Ok(Self::default());
        }
        let column = table.column(name, ("text", DataType::is_string), &DataType::String)?;
        let texts = column.str().map_err(|error| table.error(&error))?;
        Ok(Self::new(texts.iter().map(Option::unwrap_or_default), str::to_owned))
    }
}

/// Defines a struct whose fields are columns with one row per frame (see [`Frames`]); a field can have a
/// column-name pattern (`as`).
#[macro_export]
macro_rules! frames {
    ($(#[$meta:meta])* pub struct $name:ident {
        $($(#[$field_meta:meta])* pub $field:ident: $type:ty $(as $pattern:literal)?,)*
    }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Default, PartialEq)]
        pub struct $name { $($(#[$field_meta])* pub $field: $type,)* }

        impl $crate::Frames for $name {
            const PATTERN: &'static str = "{}";

            fn write(self, pattern: &str, columns: &mut Vec<$crate::Column>) {
                $(
                    let own = [$($pattern,)? <$type as $crate::Frames>::PATTERN][0];
                    let own = $crate::fill(pattern, &own.replace("{field}", stringify!($field)));
                    self.$field.write(&own, columns);
                )*
            }

            fn read(table: &$crate::Table, pattern: &str) -> Result<Self, $crate::StoreError> {
                $(
                    let own = [$($pattern,)? <$type as $crate::Frames>::PATTERN][0];
                    let own = $crate::fill(pattern, &own.replace("{field}", stringify!($field)));
                    let $field = $crate::Frames::read(table, &own)?;
                )*
                Ok(Self { $($field,)* })
            }
        }
    };
}
