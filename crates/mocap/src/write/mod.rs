//! Writes marker files in the formats of Vicon Nexus 2.

mod c3d;
mod csv;

pub use c3d::c3d_bytes;
pub use csv::csv_bytes;
