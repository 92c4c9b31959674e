//! Fits of trials with a known truth, and what their limits and tests of adequacy are worth.

#![allow(clippy::unwrap_used, unreachable_pub)]

mod adequacy;
mod best;
#[path = "../../../../tests/it/common/trials.rs"]
mod common;
mod competition;
mod coverage;
mod fit;
mod recovery;
mod shared;
