//! Python exceptions for the errors of the library, with the same messages as the program `trilink`.

use pyo3::exceptions::{PyException, PyKeyboardInterrupt};
use pyo3::prelude::*;
use pyo3::types::PyModule;
use trilink::build::RunError;
use trilink::inspect::InspectError;
use trilink_fit::simulate::SetupError;
use trilink_tables::StoreError;

pyo3::create_exception!(trilink, Error, PyException, "Base class of all errors of trilink.");
pyo3::create_exception!(
    trilink,
    ConfigError,
    Error,
    "Invalid pipeline.toml, trials.toml or argument; the message names the key, what was found and what is needed."
);
pyo3::create_exception!(
    trilink,
    TableError,
    Error,
    "A table or other file that cannot be read or written, or an invalid column or condition."
);
pyo3::create_exception!(trilink, BusyError, Error, "Another run is writing the same results.");

/// Adds the exception classes to the Python module.
pub fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("Error", py.get_type::<Error>())?;
    module.add("ConfigError", py.get_type::<ConfigError>())?;
    module.add("TableError", py.get_type::<TableError>())?;
    module.add("BusyError", py.get_type::<BusyError>())
}

/// Library error, converted to a Python exception that has not been raised yet.
pub struct Failure(PyErr);

impl Failure {
    /// Creates the error for an invalid argument.
    pub fn from_argument(message: &str) -> Self {
        Self(ConfigError::new_err(message.to_owned()))
    }
}

impl From<Failure> for PyErr {
    fn from(Failure(exception): Failure) -> Self {
        exception
    }
}

impl From<trilink_tables::config::ConfigError> for Failure {
    fn from(error: trilink_tables::config::ConfigError) -> Self {
        Self(ConfigError::new_err(error.to_string()))
    }
}

impl From<SetupError> for Failure {
    fn from(error: SetupError) -> Self {
        Self(ConfigError::new_err(error.to_string()))
    }
}

impl From<InspectError> for Failure {
    fn from(error: InspectError) -> Self {
        Self(TableError::new_err(error.to_string()))
    }
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        Self(TableError::new_err(error.to_string()))
    }
}

impl From<polars::error::PolarsError> for Failure {
    fn from(error: polars::error::PolarsError) -> Self {
        Self(TableError::new_err(error.to_string()))
    }
}

impl From<RunError> for Failure {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Trials(error) => error.into(),
            RunError::Store(error) => error.into(),
            RunError::Unconfigured { .. } | RunError::NoProject { .. } => {
                Self(ConfigError::new_err(error.to_string()))
            }
            RunError::Held(_) => Self(BusyError::new_err(error.to_string())),
            // The same exception that Python raises on Ctrl-C, with a message that describes the progress of the run.
            RunError::Interrupted { .. } | RunError::Stopped(_) => {
                Self(PyKeyboardInterrupt::new_err(error.to_string()))
            }
            other => Self(Error::new_err(other.to_string())),
        }
    }
}

/// Converts the error for JSON arguments that are invalid or do not have the expected form.
impl From<serde_json::Error> for Failure {
    fn from(error: serde_json::Error) -> Self {
        Self(ConfigError::new_err(error.to_string()))
    }
}
