//! Lines on standard output and standard error. The reader may have closed the pipe
//! (`trilink simulate .. | head`): then the program ends.

use std::io::{ErrorKind, Write};

/// Writes a line, and ends the program quietly if nobody reads any more.
pub(super) fn write_line(to: &mut dyn Write, line: std::fmt::Arguments<'_>) {
    match writeln!(to, "{line}").and_then(|()| to.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => std::process::exit(0),
        // A result that cannot be written (a full disk, for example) must not look like success.
        Err(error) => {
            let _ = writeln!(std::io::stderr().lock(), "error: standard output: {error}");
            std::process::exit(2)
        }
        Ok(()) => {}
    }
}

/// A line of results, on standard output.
macro_rules! say {
    ($($part:tt)*) => {
        $crate::cli::output::write_line(&mut std::io::stdout().lock(), format_args!($($part)*))
    };
}

/// A line beside the results, on standard error. That nobody reads it ends nothing.
macro_rules! note {
    ($($part:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr().lock(), $($part)*);
    }};
}

pub(super) use {note, say};
