//! Tables that are kept column by column, as they have a row for each frame of a recording.

use std::collections::BTreeMap;

use polars::prelude::{Column, DataType};

use crate::columns::{numbered, repeated, texts};
use crate::{Columns, StoreError, Table};

/// Columns that are kept as such: a series, or several whose names have a pattern.
pub trait Frames: Sized {
    /// The pattern of a field of this type that names none.
    const PATTERN: &'static str = "{field}";

    fn write(self, pattern: &str, columns: &mut Vec<Column>);

    /// # Errors
    /// A column is not there, or holds something else.
    fn read(table: &Table, pattern: &str) -> Result<Self, StoreError>;

    /// The table of a trial, which begins with its name.
    fn into_table(self, trial: &str) -> Table {
        let mut columns = Vec::new();
        self.write("{}", &mut columns);
        columns.insert(0, repeated("trial", trial, columns.first().map_or(0, Column::len)));
        Table::new(columns)
    }

    /// # Errors
    /// A column is not there, or holds something else.
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

/// Links and wheels are 0, 1, 2; joints are 1 and 2.
impl<S: Frames, const N: usize> Frames for [S; N] {
    fn write(self, pattern: &str, columns: &mut Vec<Column>) {
        self.into_iter().zip(numbered::<N>(pattern)).for_each(|(of, own)| of.write(&own, columns));
    }

    fn read(table: &Table, pattern: &str) -> Result<Self, StoreError> {
        let all = numbered::<N>(pattern).map(|own| S::read(table, &own));
        let all: Vec<S> = all.collect::<Result<_, _>>()?;
        Ok(all.try_into().unwrap_or_else(|_| unreachable!("one for each")))
    }
}

/// A text for each frame, of which there are few: each is kept once, as of a long recording there
/// are millions. None in a table of an older version that does not have the column.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrameTexts {
    known: Vec<String>,
    /// Which of them each frame has.
    frames: Vec<u32>,
}

impl FrameTexts {
    /// The text of each key.
    pub fn of<K: Ord + Copy>(keys: impl Iterator<Item = K>, text: impl Fn(K) -> String) -> Self {
        let (mut known, mut numbers) = (Vec::new(), BTreeMap::new());
        let number = |key| {
            *numbers.entry(key).or_insert_with(|| {
                known.push(text(key));
                known.len() as u32 - 1
            })
        };
        let frames = keys.map(number).collect();
        Self { known, frames }
    }

    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    pub fn get(&self, frame: usize) -> Option<&str> {
        Some(&self.known[*self.frames.get(frame)? as usize])
    }
}

impl Frames for FrameTexts {
    fn write(self, name: &str, columns: &mut Vec<Column>) {
        let of_frames = self.frames.iter().map(|text| self.known[*text as usize].as_str());
        columns.push(texts(name, of_frames));
    }

    fn read(table: &Table, name: &str) -> Result<Self, StoreError> {
        if table.frame.column(name).is_err() {
            return Ok(Self::default());
        }
        let column = table.column(name, ("text", DataType::is_string), &DataType::String)?;
        let texts = column.str().map_err(|error| table.error(&error))?;
        Ok(Self::of(texts.iter().map(Option::unwrap_or_default), str::to_owned))
    }
}

/// Defines a struct whose fields are columns of all frames, see [`Frames`]; a field can have a pattern (`as`).
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
