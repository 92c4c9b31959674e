//! Diagnoses mistakes in the configuration, the trial list and the recording: the measurements are compared with the
//! configuration, and with the configuration as it would be without each likely mistake.
//!
//! Three comparisons build on one another: whether the markers lie on their links as in the layout (`layout`), whether
//! the links are connected as h and l require (`linkage`), and whether the joints follow their commands (`gait`).
//! `campaigns` compares several trials, and `folder` also compares the trial list with the folder's files. A trial with
//! a known mistake gets no metrics, because models would be fitted to the mistake.

mod campaigns;
mod folder;
mod gait;
mod heading;
mod layout;
mod linkage;

pub(crate) use folder::restate;
pub use folder::{FolderInput, without_diagnosis};
pub(crate) use gait::{check_gait, check_swing};
pub use layout::axis_up_message;
pub(crate) use layout::check_layout;
pub(crate) use linkage::check_linkage;
