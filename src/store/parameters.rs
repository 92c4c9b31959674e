//! The parameters that a fit can free, as columns of tables.

/// Reads and writes a row's columns of all parameters at once.
macro_rules! parameter_columns {
    ($row:ty, $get:ident, $set:ident: $($field:ident),+) => {
        impl $row {
            /// These columns in the order of [`crate::robot::Parameter::ALL`].
            pub fn $get(&self) -> [f64; 9] {
                [$(self.$field),+]
            }

            /// Sets these columns, in the order of [`crate::robot::Parameter::ALL`].
            pub fn $set(&mut self, values: [f64; 9]) {
                [$(self.$field),+] = values;
            }
        }
    };
}

pub(super) use parameter_columns;
