//! Tables whose rows are structs: one definition gives the columns, writing and reading.

use super::{Column, StoreError, Table};

/// A struct whose fields are the columns of a table.
pub trait Rows: Sized {
    /// A row that says nothing: numbers missing, counts 0, texts empty.
    fn blank() -> Self;
    /// The table of these rows, in order.
    fn to_table(rows: &[Self]) -> Table;
    /// The rows of a table.
    ///
    /// # Errors
    /// A column is missing or of another type.
    fn from_table(table: &Table) -> Result<Vec<Self>, StoreError>;
}

/// A type that a field of a row can have.
pub(crate) trait Cell: Clone {
    const BLANK: Self;
    fn gather(values: Vec<Self>) -> Column;
    fn values<'t>(table: &'t Table, column: &str) -> Result<&'t [Self], StoreError>;
}

macro_rules! cell {
    ($type:ty, $variant:ident, $getter:ident, $blank:expr) => {
        impl Cell for $type {
            const BLANK: Self = $blank;
            fn gather(values: Vec<Self>) -> Column {
                Column::$variant(values)
            }
            fn values<'t>(table: &'t Table, column: &str) -> Result<&'t [Self], StoreError> {
                table.$getter(column)
            }
        }
    };
}

cell!(f64, F64, f64, f64::NAN);
cell!(i64, I64, i64, 0);
cell!(bool, Bool, bool, false);
cell!(String, Str, str, String::new());
cell!(Vec<String>, StrList, str_list, Vec::new());

/// Defines a row struct and its [`Rows`]; the fields' names are the columns' names.
macro_rules! rows {
    ($(#[$meta:meta])* pub struct $name:ident {
        $($(#[$field_meta:meta])* pub $field:ident: $type:ty,)*
    }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq)]
        pub struct $name { $($(#[$field_meta])* pub $field: $type,)* }

        impl $crate::store::Rows for $name {
            fn blank() -> Self {
                Self { $($field: <$type as $crate::store::Cell>::BLANK,)* }
            }

            fn to_table(rows: &[Self]) -> $crate::store::Table {
                $crate::store::Table::new([$((
                    stringify!($field),
                    $crate::store::Cell::gather(
                        rows.iter().map(|row| row.$field.clone()).collect::<Vec<$type>>(),
                    ),
                ),)*])
            }

            fn from_table(
                table: &$crate::store::Table,
            ) -> Result<Vec<Self>, $crate::store::StoreError> {
                $(let $field = <$type as $crate::store::Cell>::values(
                    table,
                    stringify!($field),
                )?;)*
                Ok((0..table.len()).map(|i| Self { $($field: $field[i].clone(),)* }).collect())
            }
        }
    };
}

pub(crate) use rows;
