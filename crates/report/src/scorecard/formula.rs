//! Formulas in `claims.toml`: template expressions that evaluate results of the paper's models and of the user's
//! trials. They can use the following functions:
//!
//! - for a motion of the `paper` ([`Paper`]): `at`, `exists`, `cycle`, `curve`, `transient_mm`;
//! - for a campaign in the `trials` and the fits to it ([`Trials`]): `mean_at`, `means`, `travelled_mm`,
//!   `mean_lag_deg`, `off_command_deg`, `robot`, `coefficient`, `fitted`, `existing_share`; for two campaigns,
//!   `coefficient_ratio`; for all campaigns of a robot, `is_refused`;
//! - for a curve returned by `curve` or `means` ([`Curve`]): `optimum`, `optima_apart`, `spread_percent`, `largest`;
//!   for two curves, `mean_ratio`, `least_ratio`, `effect_high_over_low`;
//! - `apart_deg(a, b)`: absolute difference between two phases.

use minijinja::value::{Object, Value};
use minijinja::{Environment, Error, context};
use trilink_statistics::wrap;

use super::curve::Curve;
use super::missing::missing;
use super::paper::Paper;
use super::trials::Trials;
use super::verdict::Found;

impl Object for Found {}

/// Evaluator for the formulas of claims.
pub(super) struct Formulas {
    environment: Environment<'static>,
    values: Value,
}

impl Formulas {
    pub(super) fn new(paper: Paper, trials: Trials) -> Self {
        let mut environment = Environment::new();
        environment.add_function("at", Paper::at);
        environment.add_function("exists", Paper::exists);
        environment.add_function("cycle", Paper::cycle);
        environment.add_function("curve", Paper::curve);
        environment.add_function("transient_mm", Paper::transient_mm);
        environment.add_function("mean_at", Trials::mean_at);
        environment.add_function("means", Trials::means);
        environment.add_function("mean_lag_deg", Trials::mean_lag_deg);
        environment.add_function("off_command_deg", Trials::off_command_deg);
        environment.add_function("robot", Trials::robot);
        environment.add_function("travelled_mm", Trials::travelled_mm);
        environment.add_function("coefficient", Trials::coefficient);
        environment.add_function("coefficient_ratio", Trials::coefficient_ratio);
        environment.add_function("is_refused", Trials::is_refused);
        environment.add_function("fitted", Trials::fitted);
        environment.add_function("existing_share", Trials::existing_share);
        environment.add_function("optimum", Curve::optimum);
        environment.add_function("optima_apart", Curve::optima_apart);
        environment.add_function("spread_percent", Curve::spread_percent);
        environment.add_function("largest", Curve::largest);
        environment.add_function("mean_ratio", Curve::mean_ratio);
        environment.add_function("least_ratio", Curve::least_ratio);
        environment.add_function("effect_high_over_low", Curve::effect_high_over_low);
        environment.add_filter("degrees", f64::to_degrees);
        environment.add_function("apart_deg", |a: f64, b: f64| {
            wrap((a - b).to_radians()).to_degrees().abs()
        });
        let values = context! {
            paper => Value::from_object(paper),
            trials => Value::from_object(trials),
        };
        Self { environment, values }
    }

    /// Evaluates a formula.
    ///
    /// # Errors
    /// Returns an error if a motion does not exist or if the tables lack the data that the formula needs.
    pub(super) fn find(&self, formula: &str) -> Result<Found, Error> {
        let value = self.environment.compile_expression(formula)?.eval(self.values.clone())?;
        if let Some(found) = value.downcast_object_ref::<Found>() {
            return Ok(*found);
        }
        let value = f64::try_from(value)?;
        if value.is_nan() { Err(missing("")) } else { Ok(Found::new(value)) }
    }
}
