//! Sets of tables that a stage reads and writes together.

/// Gives a struct of rows the tables that hold them: their names, how they are read and written
/// together, and how the rows are told apart by the target that they are of, which `$key` gives.
#[macro_export]
macro_rules! table_set {
    ($set:ident by $key_type:ty: $row:ident => $key:expr; $($rows:ident: $file:literal),+ $(,)?) => {
        /// The tables of the stage as a whole, inside of `derived/`.
        pub const TABLES: [&str; [$($file),+].len()] = [$($file),+];

        impl $set {
            /// Reads the tables that the stage left.
            ///
            /// # Errors
            /// One of them cannot be read.
            pub fn read(
                derived: &std::path::Path,
                reader: &$crate::Reader,
            ) -> Result<Self, $crate::StoreError> {
                Ok(Self { $($rows: reader.rows(&derived.join($file))?),+ })
            }

            /// Writes the tables, unless they are there already; gives their stamps by name.
            ///
            /// # Errors
            /// One of them cannot be written.
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
                Ok(stamps)
            }

            /// The rows by what they are of.
            pub fn by_target(self) -> std::collections::BTreeMap<$key_type, Self> {
                let mut all: std::collections::BTreeMap<$key_type, Self> = std::collections::BTreeMap::new();
                $(for $row in self.$rows {
                    all.entry($key).or_default().$rows.push($row);
                })+
                all
            }

            /// Adds the rows of another one.
            pub fn extend(&mut self, other: Self) {
                $(self.$rows.extend(other.$rows);)+
            }
        }
    };
}
