//! What a fit or a comparison found: values that tables keep in columns, and of each the one function that
//! makes the sentence which people read.

mod contradiction;
mod law_like;
mod misfit;
mod notes;
mod outcome;
mod why;

pub use contradiction::{Contradiction, ContradictionKind, Resistance};
pub use law_like::{LINEAR_PART, LawKind, LawLike};
pub use misfit::{Misfit, MisfitRms, MisfitRun, Side};
pub use notes::FitNotes;
pub use outcome::{Comparison, Outcome};
pub use why::{NoInterval, NoIntervalReason, NotTested, NotTestedReason, Reason, Why};

/// Defines a verdict that there may be none of: what it is, by a name, and its numbers. Its columns are those of
/// an `Option`, each named by the row's field and an end.
macro_rules! verdict {
    (
        $(#[$meta:meta])*
        pub struct $name:ident {
            $(#[$key_meta:meta])*
            pub $key:ident: $key_type:ty as $key_end:literal,
            $($(#[$field_meta:meta])* pub $field:ident: $type:ty as $end:literal,)*
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
                Columns::write_all(keys.collect::<Vec<_>>(), &fill(pattern, $key_end), columns);
                $({
                    let part = |value: &&Self| match value {
                        Some(value) => value.$field.clone(),
                        None => <$type>::blank(),
                    };
                    let parts: Vec<$type> = values.iter().map(part).collect();
                    Columns::write_all(parts, &fill(pattern, $end), columns);
                })*
            }

            fn read(
                table: &$crate::Table,
                pattern: &str,
            ) -> Result<Vec<Self>, $crate::StoreError> {
                use $crate::fill;
                let keys = Option::<$key_type>::read(table, &fill(pattern, $key_end))?;
                $(let mut $field = <$type>::read(table, &fill(pattern, $end))?.into_iter();)*
                let row = |$key: Option<$key_type>| {
                    $(let $field = $field.next().unwrap_or_else(<$type>::blank);)*
                    $key.map(|$key| $name { $key, $($field,)* })
                };
                Ok(keys.into_iter().map(row).collect())
            }
        }
    };
}

/// JSON and pages have the sentence.
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

    /// Writes the columns of values, and reads them again.
    pub(super) fn stored<T: Columns + Debug + PartialEq>(values: &[T]) -> Table {
        let (pattern, mut columns) = (T::PATTERN.replace("{field}", "of"), Vec::new());
        T::write(&values.iter().collect::<Vec<_>>(), &pattern, &mut columns);
        let table = Table::new(columns);
        assert_eq!(T::read(&table, &pattern).expect("the columns"), values);
        table
    }
}
