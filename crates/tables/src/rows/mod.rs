//! Rows of the tables in `derived/`. Column names must not change: scripts of users read them.

// Written by the ingest stage:
pub(crate) mod recording;
pub(crate) mod robot_parameters;
pub(crate) mod trials;

// Written by the fit stage:
pub(crate) mod extrapolation;
pub(crate) mod fits;
pub(crate) mod motions;
pub(crate) mod optima;
pub(crate) mod predictions;
pub(crate) mod sensitivities;
