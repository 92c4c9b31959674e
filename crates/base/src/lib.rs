//! Utilities shared by all crates of trilink. This crate depends on no other crate of the workspace.
//!
//! - [`body`]: poses of rigid bodies, stored as the positions of four points.
//! - [`files`]: reading of regular files of limited size; [`csv`]: reading and writing of fields and records.
//! - [`pattern`]: wildcards `*` and `?` in names of files, campaigns and markers.
//! - [`Named`] and [`named!`]: enumerations whose values have names in files, in tables and on the
//!   command line, such as [`LengthUnit`].
//! - [`numbers`] and [`text`]: formatting of numbers and of untrusted text.
//! - [`cancel`]: cancellation of long work, for example by Ctrl-C.
//!
//! ```
//! use trilink_base::{numbers, pattern};
//!
//! assert!(pattern::matches_label("V_*", "Snake:V_1"));
//! assert_eq!(numbers::with_error(104.3128, 0.2177), "104.31 ± 0.22");
//! ```

pub mod body;
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
