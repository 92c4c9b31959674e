//! Fits to trials with known true values, and the validity of their confidence intervals and adequacy tests.

#![allow(clippy::unwrap_used, unreachable_pub)]

mod adequacy;
mod best;
mod chains;
#[path = "../../../../tests/it/common/trials.rs"]
mod common;
mod competition;
mod coverage;
mod fit;
mod laboratory;
mod recovery;
mod shared;
mod wheels;
mod worlds;
