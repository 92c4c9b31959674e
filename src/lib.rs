//! The program `trilink`: fits dissipation models to motion-capture trials of a wheeled three-link robot, and draws
//! figures of the results.
//!
//! The program is built from the crates of this workspace, each of which can be used without it. In the order in
//! which a trial passes through them:
//!
//! - `trilink_mocap` reads marker files, `trilink_ingest` processes trials, `trilink_fit` fits models to
//!   them and `trilink_report` draws the results with `trilink_plot`;
//! - `trilink_synth` synthesises trials with known parameters;
//! - `trilink_tables` defines the settings and tables that these crates share, `trilink_mechanics` solves for the
//!   steady-state motions of the models, `trilink_robot` has the robot's equations of motion, `trilink_statistics`
//!   means, quantiles and least squares, and `trilink_base` file access, CSV, patterns, named values, number
//!   formatting and cancellation.
//!
//! This package decides which stages run, and provides the command line. The modules in reading order: [`init`] for a
//! new laboratory, [`build`] that runs the stages, [`compare`], [`inspect`] and [`export`] for the results, [`cli`] for
//! the command line, and the helpers `interrupt` and `template`.

/// Generation of a first `pipeline.toml` and `trials.toml` from marker files alone.
pub mod init;

/// Incremental build engine: which targets are stale and why, and the stages that make them.
pub mod build;

/// Comparison of a run with a baseline.
pub mod compare;

/// Inspection of any table of results.
pub mod inspect;

/// Export of a trial to formats of other viewers.
pub mod export;

/// Command line.
pub mod cli;

/// Handling of Ctrl-C and SIGTERM.
mod interrupt;

/// Rendering of text files and messages from templates.
mod template;
