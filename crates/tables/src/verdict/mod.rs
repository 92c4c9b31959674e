//! Findings from fits and comparisons: values that tables store in columns, each with one function that
//! formats it as a sentence.

mod contradiction;
mod law_like;
mod misfit;
mod notes;
mod outcome;
mod why;

pub use contradiction::{Contradiction, ContradictionKind, Resistance};
pub use law_like::{LINEAR_PART, LawKind, LawLike};
pub use misfit::{Misfit, MisfitRun, Side};
pub use notes::FitNotes;
pub use outcome::{Comparison, Outcome};
pub use why::{
    NoInterval, NoIntervalReason, NoPrecisionReason, NotTested, NotTestedReason, Reason, Undecided,
    UndecidedReason, Why,
};

/// Defines a finding: a struct whose first field is the kind of finding. Tables store it as an `Option`, in
/// columns whose names are the name of the row's field followed by the given suffixes.
macro_rules! verdict {
    (
        $(#[$meta:meta])*
        pub struct $name:ident {
            $(#[$key_meta:meta])*
            pub $key:ident: $key_type:ty as $key_suffix:literal,
            $($(#[$field_meta:meta])* pub $field:ident: $type:ty as $suffix:literal,)*
        }
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq)]
        pub struct $name {
            $(#[$key_meta])*
            pub $key: $key_type,
            $($(#[$field_meta])* pub $field: $type,)*
        }

        impl $crate::Columns for Option<$name> {
            const PATTERN: &'static str = "{field}{}";

            fn blank() -> Self {
                None
            }

            fn write(values: &[&Self], pattern: &str, columns: &mut Vec<$crate::Column>) {
                use $crate::{Columns, fill};
                let keys = values.iter().map(|value| value.as_ref().map(|value| value.$key));
                Columns::write_all(keys.collect::<Vec<_>>(), &fill(pattern, $key_suffix), columns);
                $({
                    let mut parts = Vec::new();
                    for value in values {
                        parts.push(match value {
                            Some(value) => value.$field.clone(),
                            None => <$type>::blank(),
                        });
                    }
                    Columns::write_all(parts, &fill(pattern, $suffix), columns);
                })*
            }

            fn read(
                table: &$crate::Table,
                pattern: &str,
            ) -> Result<Vec<Self>, $crate::StoreError> {
                use $crate::fill;
                let keys = Option::<$key_type>::read(table, &fill(pattern, $key_suffix))?;
                $(let mut $field = <$type>::read(table, &fill(pattern, $suffix))?.into_iter();)*
                let rows = keys.into_iter().map(|$key| {
                    $(let $field = $field.next().unwrap_or_else(<$type>::blank);)*
                    $key.map(|$key| $name { $key, $($field,)* })
                });
                Ok(rows.collect())
            }
        }
    };
}

/// Implements serialization of a finding as a sentence, for JSON and report pages.
macro_rules! serialize_as_sentence {
    ($($name:ty),+) => {$(
        impl serde::Serialize for $name {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_str(self)
            }
        }
    )+};
}

use {serialize_as_sentence, verdict};

#[cfg(test)]
mod tests {
    use std::fmt::Debug;

    use crate::{Columns, Table};

    /// Checks that values are read from a table as they were written to it, and returns the table.
    pub(super) fn stored<T: Columns + Debug + PartialEq>(values: &[T]) -> Table {
        let pattern = T::PATTERN.replace("{field}", "of");
        let mut columns = Vec::new();
        T::write(&values.iter().collect::<Vec<_>>(), &pattern, &mut columns);
        let table = Table::new(columns);
        assert_eq!(T::read(&table, &pattern).expect("the columns"), values);
        table
    }
}
