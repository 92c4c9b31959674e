//! The tables of `derived/`, a file for each stage that writes some. Column names are a contract: scripts
//! of others read them.

// The ingest:
pub(crate) mod recording;
pub(crate) mod robot_parameters;
pub(crate) mod trials;

// The fit:
pub(crate) mod extrapolation;
pub(crate) mod fits;
pub(crate) mod motions;
pub(crate) mod optima;
pub(crate) mod predictions;
pub(crate) mod sensitivities;
