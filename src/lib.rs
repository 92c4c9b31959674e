//! From marker files of a wheeled three-link robot to fitted dissipation models and figures.
//!
//! The modules in the order that a trial passes through them:

pub mod config;
pub mod trial;

pub mod store;

pub mod metrics;
pub mod robot;

pub mod motion;

pub mod fit;
pub mod synth;
