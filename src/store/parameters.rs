//! The parameters that a fit can free, as columns of tables.

/// Names of the parameters' columns. `roll_sum_kg_s` is the sum of the three roll coefficients.
pub const PARAMETERS: [&str; 9] = [
    "skid0_kg_s",
    "skid1_kg_s",
    "skid2_kg_s",
    "roll0_kg_s",
    "roll1_kg_s",
    "roll2_kg_s",
    "roll_sum_kg_s",
    "stiffness_nm_rad",
    "damping_nm_s_rad",
];

/// Reads and writes a row's columns of all [`PARAMETERS`] at once.
macro_rules! parameter_columns {
    ($row:ty, $get:ident, $set:ident: $($field:ident),+) => {
        impl $row {
            /// These columns in the order of [`crate::store::PARAMETERS`].
            pub fn $get(&self) -> [f64; 9] {
                [$(self.$field),+]
            }

            /// Sets these columns, in the order of [`crate::store::PARAMETERS`].
            pub fn $set(&mut self, values: [f64; 9]) {
                [$(self.$field),+] = values;
            }
        }
    };
}

pub(super) use parameter_columns;
