//! From marker files of a wheeled three-link robot to fitted dissipation models and figures.
//!
//! The steady motion of the paper's robot with skid and roll resistance, in metres a cycle:
//!
//! ```
//! use trilink::config::Config;
//! use trilink::motion::{Problem, REFERENCE_ACCURACY, Solver};
//! use trilink::robot::Laws;
//!
//! let (mut robot, gait) = Config::default().campaign_setup("kinematic-symmetric").unwrap();
//! robot.skid_kg_s = [104.0, 34.0, 45.0];
//! let problem = Problem { robot, gait, laws: Laws::SKID_ROLL, omega_rad_s: 3.9 };
//! let metrics = Solver::default().solve(&problem, REFERENCE_ACCURACY).unwrap();
//! assert!((metrics.d_m - 0.478359748170948).abs() < 1e-10);
//! ```
//!
//! The modules in the order that a trial passes through them:

/// `pipeline.toml`.
pub mod config;
/// `trials.toml`.
pub mod trial;

/// Marker files alone -> a first `pipeline.toml` and `trials.toml`.
pub mod init;

/// Marker files -> markers over time.
pub mod vicon;

/// Markers -> link poses -> wheel velocities -> cycles -> one row per trial.
pub mod ingest;

/// Trials of a table that was made elsewhere.
pub mod own_table;

/// Models fitted to the trials.
pub mod fit;

/// Figures and the page.
pub mod report;

/// What is up to date, what is redone and why; all of it, one stage after the other.
pub mod build;

/// A run against a baseline.
pub mod compare;
/// The trials that would tell most.
pub mod design;
/// What checks look at, why that matters and what to do.
pub mod explanations;
/// A trial for other viewers.
pub mod export;
/// A look into any table.
pub mod inspect;
/// The gait that is best.
pub mod optimise;
/// A model's motion by names, without trials.
pub mod simulate;

/// The command line.
pub mod cli;
/// Ctrl-C.
pub mod interrupt;

/// What the stages share: the mechanics, the models' motion, metrics and tables; and trials
/// with a known truth.
pub(crate) mod clock;
pub(crate) mod csv;
pub(crate) mod files;
pub(crate) mod least_squares;
pub mod metrics;
pub mod motion;
pub mod named;
pub(crate) mod pattern;
pub mod robot;
pub(crate) mod stats;
pub mod store;
pub mod synth;
pub(crate) mod text;
