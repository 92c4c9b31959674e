//! Sets of tables that a stage reads and writes together.

/// Implements methods for a struct whose fields are lists of rows: they read and write each list as a table in its own
/// file, and group the rows by the key that the expression `$key` computes for each row.
#[macro_export]
macro_rules! table_set {
    (
        $set:ident by $key_type:ty: $row:ident => $key:expr; $($rows:ident: $file:literal),+ $(,)?
        $(; whole: $whole:ident: $whole_file:literal)?
    ) => {
        /// File names of the tables in this set, which lie in the folder `derived/`.
        pub const TABLES: [&str; [$($file,)+ $($whole_file)?].len()] =
            [$($file,)+ $($whole_file)?];

        impl $set {
            /// Reads all tables of this set from the folder `derived`.
            ///
            /// # Errors
            /// Returns an error if one of the tables cannot be read.
            pub fn read(
                derived: &std::path::Path,
                reader: &$crate::Reader,
            ) -> Result<Self, $crate::StoreError> {
                Ok(Self {
                    $($rows: reader.rows(&derived.join($file))?,)+
                    $($whole: reader.rows(&derived.join($whole_file))?,)?
                })
            }

            /// Writes the tables that have changed to the folder `derived`, and returns the stamps of all tables,
            /// indexed by file name.
            ///
            /// # Errors
            /// Returns an error if one of the tables cannot be written.
            pub fn write(
                &self,
                derived: &std::path::Path,
                provenance: &$crate::Provenance,
            ) -> Result<std::collections::BTreeMap<String, $crate::Stamp>, $crate::StoreError> {
                use $crate::Columns;
                let mut stamps = std::collections::BTreeMap::new();
                $(
                    let table = Columns::to_table(&self.$rows);
                    let stamp = table.write_if_changed(&derived.join($file), provenance)?;
                    stamps.insert($file.to_owned(), stamp);
                )+
                $(
                    let table = Columns::to_table(&self.$whole);
                    let stamp = table.write_if_changed(&derived.join($whole_file), provenance)?;
                    stamps.insert($whole_file.to_owned(), stamp);
                )?
                Ok(stamps)
            }

            /// Groups the rows of all tables by the result to which they belong, such as a trial or a fit. The rows of
            /// a `whole` table belong to no single result and are left out.
            pub fn by_target(self) -> std::collections::BTreeMap<$key_type, Self> {
                let mut all: std::collections::BTreeMap<$key_type, Self> = std::collections::BTreeMap::new();
                $(for $row in self.$rows {
                    all.entry($key).or_default().$rows.push($row);
                })+
                all
            }

            /// Appends the rows of `other`.
            pub fn extend(&mut self, other: Self) {
                $(self.$rows.extend(other.$rows);)+
                $(self.$whole.extend(other.$whole);)?
            }
        }
    };
}
