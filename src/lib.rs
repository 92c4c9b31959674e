//! The program `trilink`: from marker files of a wheeled three-link robot to fitted dissipation models
//! and figures.
//!
//! It is made of the crates of this workspace, each of which can be used without it. In the order that
//! a trial passes through them:
//!
//! - `trilink_mocap` reads marker files, `trilink_ingest` makes trials of them, `trilink_fit` fits
//!   models to those and `trilink_report` shows what came of it, by `trilink_plot`;
//! - `trilink_synth` makes trials with a known truth;
//! - `trilink_tables` has the settings and tables that they share, `trilink_mechanics` the models'
//!   motion, `trilink_robot` the equations, `trilink_statistics` and `trilink_base` the rest.
//!
//! What is here decides what is run and talks to people. The modules in reading order: [`init`] for a
//! new laboratory, [`build`] that runs the stages, [`compare`], [`inspect`] and [`export`] for what
//! they left, [`cli`] in front of all, [`interrupt`].

/// Marker files alone to a first `pipeline.toml` and `trials.toml`.
pub mod init;

/// The engine: what is up to date, what is redone and why; the stages one after the other.
pub mod build;

/// A run against a baseline.
pub mod compare;

/// A look into any table.
pub mod inspect;

/// A trial for other viewers.
pub mod export;

/// The command line.
pub mod cli;

/// Ctrl-C.
mod interrupt;

mod template;
