//! Mistakes of configuration, list and recording, named by their cause: what was measured is
//! compared with what is configured, and with what would be configured if it were right.
//!
//! Three things are looked at in turn, each of which the next one rests on: whether the markers lie
//! on their links as in the layout (`layout`), whether the links hang together as h and l say
//! (`linkage`), and whether the joints do what they are commanded (`gait`). What several trials show
//! together is for `campaigns` and, with what the list leaves out, for `folder`. A trial for which a
//! cause is found gives no metrics: a fit of it would be a fit of the mistake.

mod campaigns;
mod folder;
mod gait;
mod layout;
mod linkage;

pub use folder::{FolderInput, undiagnosed};
pub(crate) use gait::{check_gait, check_swing};
pub(crate) use layout::check_layout;
pub use layout::other_axis_up;
pub(crate) use linkage::check_linkage;
