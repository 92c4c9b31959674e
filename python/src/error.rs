//! Errors of the library as Python exceptions, with the messages of the program `trilink`; arguments take the place of
//! the options that messages name.

use std::error::Error;

use polars::error::PolarsError;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyType;
use trilink::cli::{CallError, ErrorKind};

/// Module of the package that defines the exceptions.
const MODULE: &str = "trilink._errors";

/// Error that has not been raised in Python yet.
pub struct Failure {
    kind: ErrorKind,
    message: String,
}

impl Failure {
    /// Creates the error for an invalid argument.
    pub fn from_argument(message: String) -> Self {
        Self { kind: ErrorKind::Config, message }
    }

    fn new(kind: ErrorKind, message: &str) -> Self {
        Self { kind, message: in_python(message) }
    }
}

impl<E: Error + 'static> From<E> for Failure {
    fn from(error: E) -> Self {
        let any: &(dyn Error + 'static) = &error;
        let kind = if let Some(error) = any.downcast_ref::<CallError>() {
            error.kind
        } else if any.is::<PolarsError>() {
            ErrorKind::Table
        } else if any.is::<serde_json::Error>() {
            ErrorKind::Config
        } else {
            ErrorKind::of(any)
        };
        Self::new(kind, &error.to_string())
    }
}

impl From<Failure> for PyErr {
    fn from(Failure { kind, message }: Failure) -> Self {
        let class = match kind {
            ErrorKind::Config => "ConfigError",
            ErrorKind::Table => "TableError",
            ErrorKind::Busy => "BusyError",
            ErrorKind::Other => "Error",
            // The exception that Python raises on Ctrl-C; the message describes the progress.
            ErrorKind::Cancelled => return PyKeyboardInterrupt::new_err(message),
        };
        Python::attach(|py| {
            let class = py.import(MODULE).and_then(|module| module.getattr(class));
            match class.and_then(|class| Ok(class.cast_into::<PyType>()?)) {
                Ok(class) => PyErr::from_type(class, message),
                Err(error) => error,
            }
        })
    }
}

/// Options whose arguments in Python are not named like them.
const RENAMED: [(&str, &str); 2] = [("omega", "omega_rad_s"), ("for", "prediction")];

/// Returns a message of the program with arguments in place of the options that it names: `--omega: found -1` becomes
/// `omega_rad_s: found -1`, and a value that `--set` sets becomes an argument of its own.
fn in_python(message: &str) -> String {
    let message = message
        .replace("the option --", "the argument --")
        .replace("the options:", "the arguments:");
    let message =
        message.replace("this option is", "this argument is").replace("add -c ", "pass config=");
    let mut text = String::new();
    let mut rest = message.as_str();
    while let Some(start) = rest.find("--") {
        let (before, option) = rest.split_at(start);
        text += before;
        let name = &option[2..];
        let end = name.find(|c: char| !c.is_ascii_lowercase() && c != '-').unwrap_or(name.len());
        let is_word = before.is_empty() || before.ends_with([' ', '`', '(', '"', '\'', '\n']);
        if end == 0 || !is_word {
            text += "--";
            rest = name;
            continue;
        }
        let (name, mut after) = name.split_at(end);
        // Messages about the use of options also state the names of their values, such as `--omega <RAD_S>`.
        if let Some((_, behind)) = after.strip_prefix(" <").and_then(|value| value.split_once('>'))
        {
            after = behind.trim_start_matches("...");
        }
        let renamed = RENAMED.iter().find(|(option, _)| *option == name);
        let name = renamed.map_or_else(|| name.replace('-', "_"), |(_, name)| (*name).to_owned());
        let is_first = text.is_empty();
        if name == "set" && is_first {
            after = after.trim_start_matches([':', ' ']);
        } else if is_first || text.ends_with(['`', '"', '\'']) {
            text += &name;
        } else {
            text += &format!("`{name}`");
        }
        rest = after;
    }
    text + rest
}
