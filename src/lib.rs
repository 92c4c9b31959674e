//! The program `trilink`: from marker files of a wheeled three-link robot to fitted dissipation models
//! and figures.
//!
//! It is made of the crates of this workspace, each of which can be used without it. In the order that
//! a trial passes through them:
//!
//! - `trilink_mocap` reads marker files, `trilink_ingest` evaluates trials, `trilink_fit` fits models to
//!   them and `trilink_report` draws the results with `trilink_plot`;
//! - `trilink_synth` makes trials with a known truth;
//! - `trilink_tables` has the settings and tables that they share, `trilink_mechanics` solves for the
//!   models' motions, `trilink_robot` has the robot's equations, `trilink_statistics` averages, quantiles and
//!   least squares, `trilink_base` file reads, CSV, patterns, named values, numbers as text and
//!   cancellation.
//!
//! This package decides what is run and prints. The modules in reading order: [`init`] for a new
//! laboratory, [`build`] that runs the stages, [`compare`], [`inspect`] and [`export`] for their results,
//! [`cli`], the command line in front of all, `interrupt` and `template`.

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

/// Ctrl-C and SIGTERM.
mod interrupt;

/// Text files and messages from templates.
mod template;
