//! What every part of trilink needs and none owns: files of a bounded size, CSV, patterns of names,
//! values with names, and numbers and texts as people read them. It depends on no other crate of the
//! workspace.
//!
//! - [`files`]: regular files of a bounded size; [`csv`]: fields and records, written and read.
//! - [`pattern`]: `*` and `?` in names of files, campaigns and markers.
//! - [`Named`] and [`named!`]: enumerations whose values have names in files, in tables and on the
//!   command line; [`LengthUnit`] is one.
//! - [`numbers`] and [`text`]: numbers, and text from elsewhere, as they are printed.
//! - [`cancel`]: work that Ctrl-C stops.
//!
//! ```
//! use trilink_base::{numbers, pattern};
//!
//! assert!(pattern::matches_label("V_*", "Snake:V_1"));
//! assert_eq!(numbers::with_error(104.3128, 0.2177), "104.31 ± 0.22");
//! ```

pub mod cancel;
pub mod csv;
pub mod files;
mod length;
mod named;
pub mod numbers;
pub mod pattern;
pub mod text;

pub use length::LengthUnit;
pub use named::Named;
