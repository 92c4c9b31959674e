//! Errors as exceptions, in the program's words.

use pyo3::exceptions::{PyException, PyKeyboardInterrupt};
use pyo3::prelude::*;
use pyo3::types::PyModule;
use trilink::build::RunError;
use trilink::inspect::InspectError;
use trilink_fit::simulate::SetupError;
use trilink_tables::StoreError;

pyo3::create_exception!(trilink, Error, PyException, "What trilink could not do, and why.");
pyo3::create_exception!(
    trilink,
    ConfigError,
    Error,
    "pipeline.toml, trials.toml or an argument in their place: which key, what was found, what was needed."
);
pyo3::create_exception!(
    trilink,
    TableError,
    Error,
    "A table or another file that cannot be read or written, or a column or condition that is none."
);
pyo3::create_exception!(trilink, BusyError, Error, "Another run is busy with the same results.");

/// Adds the exceptions to the module.
pub fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("Error", py.get_type::<Error>())?;
    module.add("ConfigError", py.get_type::<ConfigError>())?;
    module.add("TableError", py.get_type::<TableError>())?;
    module.add("BusyError", py.get_type::<BusyError>())
}

/// An error of the library, as an exception that is not yet raised.
pub struct Failure(PyErr);

impl Failure {
    /// An argument that cannot be used.
    pub fn of_argument(message: &str) -> Self {
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
            RunError::Unconfigured { .. } => Self(ConfigError::new_err(error.to_string())),
            RunError::Held(_) => Self(BusyError::new_err(error.to_string())),
            // What Python raises of itself where nobody says how far the work was.
            RunError::Interrupted { .. } | RunError::Stopped(_) => {
                Self(PyKeyboardInterrupt::new_err(error.to_string()))
            }
            other => Self(Error::new_err(other.to_string())),
        }
    }
}

/// An argument that has another form than it needs.
impl From<serde_json::Error> for Failure {
    fn from(error: serde_json::Error) -> Self {
        Self(ConfigError::new_err(error.to_string()))
    }
}
