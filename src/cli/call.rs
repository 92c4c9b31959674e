//! Commands as functions of another program, such as the Python module: their results are returned instead of printed.

use std::error::Error;
use std::ffi::OsString;

use clap::Parser;
use clap::error::ErrorKind as UsageError;
use trilink_base::cancel::CancelToken;
use trilink_fit::simulate::SetupError;
use trilink_tables::StoreError;
use trilink_tables::config::ConfigError;

use super::output::{Returned, returning};
use super::progress::Shown;
use super::{Arguments, Outcome, is_cancelled};
use crate::build::RunError;
use crate::inspect::InspectError;

/// Program that calls a command as a function.
#[derive(Debug, Clone)]
pub struct Caller {
    pub shown: Shown,
    /// Function that prints a line of progress.
    pub line: fn(&str),
    /// Token that cancels the command.
    pub cancel: CancelToken,
}

/// Kind of error, for callers that handle some kinds differently.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// Invalid argument or configuration.
    Config,
    /// Table or other file that cannot be read or written.
    Table,
    /// Another run is using the same results.
    Busy,
    Cancelled,
    Other,
}

impl ErrorKind {
    /// Returns the kind of an error of this program.
    pub fn of(error: &(dyn Error + 'static)) -> Self {
        match error.downcast_ref() {
            Some(
                RunError::Trials(_) | RunError::Unconfigured { .. } | RunError::NoProject { .. },
            ) => {
                return Self::Config;
            }
            Some(RunError::Store(_)) => return Self::Table,
            Some(RunError::Held(_)) => return Self::Busy,
            Some(RunError::Interrupted { .. } | RunError::Stopped(_)) => return Self::Cancelled,
            _ => {}
        }
        let setup: Option<&SetupError> = error.downcast_ref();
        if error.is::<InspectError>()
            || error.is::<StoreError>()
            || matches!(setup, Some(SetupError::Table(_)))
        {
            Self::Table
        } else if error.is::<ConfigError>()
            || setup.is_some()
            // Messages about an option begin with its name.
            || error.to_string().starts_with("--")
        {
            Self::Config
        } else {
            Self::Other
        }
    }
}

/// Error of a command that was called as a function.
#[derive(Debug, Clone, thiserror::Error)]
#[error("{message}")]
pub struct CallError {
    pub kind: ErrorKind,
    pub message: String,
}

impl From<clap::Error> for CallError {
    fn from(error: clap::Error) -> Self {
        let message = match (error.kind(), error.source()) {
            (UsageError::ValueValidation, Some(source)) => {
                let option = error.get(clap::error::ContextKind::InvalidArg);
                option.map_or(String::new(), |option| format!("{option}: ")) + &source.to_string()
            }
            _ => {
                let text = error.to_string();
                let first = text.split("\n\n").next().unwrap_or_default();
                let lines = first.trim_start_matches("error: ").lines().map(str::trim);
                lines.collect::<Vec<_>>().join(" ")
            }
        };
        Self { kind: ErrorKind::Config, message }
    }
}

/// Calls a command with a command line, whose first word is the program's name, and returns its results.
///
/// # Errors
/// Returns an error with the message that the program prints; messages name the options of the command line.
pub fn call(line: &[OsString], caller: Caller) -> Result<Returned, CallError> {
    let mut arguments = Arguments::try_parse_from(line)?;
    arguments.options.caller = Some(caller);
    let (outcome, returned) = returning(|| arguments.command.run(&arguments.options, line));
    match outcome {
        Ok(outcome) => {
            Ok(Returned { needs_attention: outcome == Outcome::NeedsAttention, ..returned })
        }
        Err(failure) => {
            let kind = match is_cancelled(&failure) {
                true => ErrorKind::Cancelled,
                false => ErrorKind::of(&*failure),
            };
            Err(CallError { kind, message: failure.to_string() })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Calls a command without progress.
    fn call_line(line: &str) -> Result<Returned, CallError> {
        let line: Vec<OsString> = line.split(' ').map(OsString::from).collect();
        let cancel = CancelToken::default();
        call(&line, Caller { shown: Shown::Nothing, line: |_| (), cancel })
    }

    #[test]
    fn a_command_returns_its_rows_notes_and_errors() {
        let over = "trilink branches kinematic-skewed --over omega_rad_s=1..1.1";
        let returned = call_line(over).expect("branches");
        let [("rows", ref rows)] = returned.tables[..] else { panic!("{returned:?}") };
        assert!(rows.height() > 1 && rows.column("d_m").is_ok() && !returned.needs_attention);
        let wrong = [
            (format!("{over} --omega 2"), "--omega: the frequency cannot be fixed"),
            (format!("{over} --omega x"), "--omega <RAD_S>: invalid float literal"),
            ("trilink branches x".to_owned(), "required arguments were not provided: --over <KEY"),
        ];
        for (line, message) in wrong {
            let error = call_line(&line).expect_err(&line);
            assert_eq!(error.kind, ErrorKind::Config, "{error}");
            assert!(error.message.contains(message), "{error}");
        }
    }

    #[test]
    fn a_cancelled_command_returns_no_result() {
        let cancel = CancelToken::default();
        cancel.cancel();
        let caller = Caller { shown: Shown::Nothing, line: |_| (), cancel };
        let line = "trilink branches kinematic-skewed --over omega_rad_s=1..1.1".split(' ');
        let line: Vec<OsString> = line.map(OsString::from).collect();
        let error = call(&line, caller).expect_err("cancelled");
        assert_eq!(error.kind, ErrorKind::Cancelled);
    }
}
