//! Objective of a fit as a Python function.

use std::path::PathBuf;

use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyCFunction, PyDict, PyTuple};
use serde_json::json;
use trilink_fit::{FitData, FitInput, FitProblem, Term};
use trilink_tables::Reader;

use crate::error::Failure;

/// Sets up the objective of a model of a campaign, with the trials in the folder of tables. Returns its description as
/// JSON, and the function that evaluates it; see [`evaluate`].
pub fn objective<'py>(
    py: Python<'py>,
    config: Option<PathBuf>,
    campaign: &str,
    model: &str,
) -> PyResult<Bound<'py, PyTuple>> {
    let problem = py.detach(|| {
        let config = crate::config::load(config.as_deref())?;
        let input = FitInput::find(&config, campaign, model)?;
        let data = FitData::read(&config.paths.derived, &Reader::default())?;
        let problem = FitProblem::new(&input, &data);
        if problem.terms.is_empty() {
            let none = format!("campaign {campaign}: found no trial with metrics, needed one");
            return Err(Failure::from_argument(none));
        }
        Ok(problem)
    })?;
    let each = |value: fn(&Term) -> serde_json::Value| -> Vec<serde_json::Value> {
        problem.terms.iter().map(value).collect()
    };
    let names = problem.parameters.iter().map(|free| free.parameter.name());
    let described = json!({
        "names": names.collect::<Vec<_>>(),
        "bounds": problem.parameters.iter().map(|free| free.bounds).collect::<Vec<_>>(),
        "x0": problem.start,
        "trials": each(|term| json!(term.trial)),
        "metrics": each(|term| json!(term.metric.column())),
        "measured": each(|term| json!(term.measured)),
        "standard_errors": each(|term| json!(term.se)),
        "weights": each(|term| json!(term.weight)),
    });
    let call = move |arguments: &Bound<'_, PyTuple>, _: Option<&Bound<'_, PyDict>>| {
        let (values, with_jacobian): (Vec<f64>, bool) = arguments.extract()?;
        evaluate(arguments.py(), &problem, &values, with_jacobian)
    };
    let function = PyCFunction::new_closure(py, Some(c"objective"), None, call)?;
    (described.to_string(), function).into_pyobject(py)
}

/// Evaluates the objective; returns J, the residuals and, one row after the other, the Jacobian (empty unless
/// requested), as 64-bit floats in native byte order.
fn evaluate(
    py: Python<'_>,
    problem: &FitProblem,
    values: &[f64],
    with_jacobian: bool,
) -> PyResult<(f64, Py<PyByteArray>, Py<PyByteArray>)> {
    let residuals = py.detach(|| problem.residuals(values, with_jacobian));
    let floats = |values: &mut dyn Iterator<Item = &f64>| {
        let bytes: Vec<u8> = values.flat_map(|value| value.to_ne_bytes()).collect();
        PyByteArray::new(py, &bytes).unbind()
    };
    let jacobian = floats(&mut residuals.jacobian.iter().flatten());
    Ok((residuals.cost(), floats(&mut residuals.values.iter()), jacobian))
}
