//! Marker files as Vicon Nexus 2 writes them.

mod c3d;
mod csv;

pub use c3d::c3d_bytes;
pub use csv::csv_bytes;
