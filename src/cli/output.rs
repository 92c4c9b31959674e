//! Lines on standard output and standard error. If the reader has closed the pipe of standard output
//! (`trilink simulate .. | head`), the program ends.

use std::cell::RefCell;
use std::fmt::Display;
use std::io::{ErrorKind, IsTerminal, Write};

use anstream::AutoStream;
use console::strip_ansi_codes;
use polars::prelude::DataFrame;
use serde::Serialize;
use trilink_base::text::escape_controls;

use super::Failure;
use super::terminal::{Text, Tone, stderr_width, stdout_width};
use crate::template::fill;

/// Results and messages of a command that was called as a function.
#[derive(Debug, Default)]
pub struct Returned {
    /// Whether the exit status of the command would be 1: it is complete, but something needs attention.
    pub needs_attention: bool,
    /// Results as JSON; empty if the command has none.
    pub json: String,
    /// Tables of results, by name.
    pub tables: Vec<(&'static str, DataFrame)>,
    pub notes: Vec<String>,
    pub warnings: Vec<String>,
}

thread_local! {
    /// What the command that runs on this thread returns to its caller; `None` on the command line.
    static RETURNED: RefCell<Option<Returned>> = const { RefCell::new(None) };
}

/// Runs a command on this thread as a function: its results and messages are returned, and nothing is printed.
pub(super) fn returning<T>(command: impl FnOnce() -> T) -> (T, Returned) {
    RETURNED.set(Some(Returned::default()));
    let outcome = command();
    (outcome, RETURNED.take().unwrap_or_default())
}

/// Passes results or messages to the caller of a command; does nothing and returns `false` on the command line.
pub(super) fn to_caller(pass: impl FnOnce(&mut Returned)) -> bool {
    RETURNED.with_borrow_mut(|returned| returned.as_mut().map(pass).is_some())
}

/// Prints lines to standard output, wrapped at the width of the terminal.
pub(super) fn print(text: impl Into<Text>) {
    print_wrapped(&text.into().wrap(stdout_width()));
}

/// Prints lines to standard output that are no longer than the terminal allows.
pub(super) fn print_wrapped(text: &Text) {
    if to_caller(|_| ()) {
        return;
    }
    write_line(AutoStream::auto(std::io::stdout()).lock(), text);
}

/// Writes results for other programs, without colours and on lines of any length; control characters are escaped only
/// on a terminal.
pub(super) fn write_data(text: &str) {
    if to_caller(|returned| returned.json = text.to_owned()) {
        return;
    }
    let stdout = std::io::stdout();
    let text = if stdout.is_terminal() { escape_controls(text) } else { text.into() };
    write_line(stdout.lock(), text);
}

/// Writes a line to standard output, and ends the program quietly if the reader has closed the pipe.
fn write_line(mut stdout: impl Write, text: impl Display) {
    match writeln!(stdout, "{text}").and_then(|()| stdout.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => std::process::exit(0),
        // A result that cannot be written (a full disk, for example) must not look like success.
        Err(error) => {
            note_error(&format!("standard output: {error}"));
            std::process::exit(2)
        }
        Ok(()) => {}
    }
}

/// Prints a value as JSON.
pub(super) fn write_json(value: &impl Serialize) -> Result<(), Failure> {
    write_data(&serde_json::to_string_pretty(value)?);
    Ok(())
}

/// Prints lines to standard error, wrapped at the width of the terminal; a closed pipe is ignored.
pub(super) fn print_note(text: impl Into<Text>) {
    let text = text.into();
    if to_caller(|returned| returned.notes.push(strip_ansi_codes(&text.to_string()).into_owned())) {
        return;
    }
    let text = text.wrap(stderr_width());
    let _ = writeln!(AutoStream::auto(std::io::stderr()).lock(), "{text}");
}

/// Prints an error to standard error.
pub(super) fn note_error(message: &str) {
    print_note(Tone::Bad.paint("error:") + " " + message);
}

/// Prints a warning to standard error.
pub(super) fn warn(message: &str) {
    if to_caller(|returned| returned.warnings.push(message.to_owned())) {
        return;
    }
    print_note(Tone::Doubtful.paint("warning:") + " " + message);
}

/// Prints a line of results to standard output.
macro_rules! say {
    ($($part:tt)*) => {
        $crate::cli::output::print(format!($($part)*))
    };
}

/// Prints a message to standard error.
macro_rules! note {
    ($($part:tt)*) => {
        $crate::cli::output::print_note(format!($($part)*))
    };
}

pub(super) use {note, say};

/// Prints a text template filled in with `values`.
pub(super) fn write_text(template: &str, values: &impl Serialize) -> Result<(), Failure> {
    print(fill(template, values)?.trim_end());
    Ok(())
}

/// Writer of a log that keeps each event on one line, so that no name in an event can forge another line.
pub(super) struct Lines<W>(pub W);

impl<W: Write> Write for Lines<W> {
    /// Writes an event, which the logger passes as a whole.
    fn write(&mut self, event: &[u8]) -> std::io::Result<usize> {
        let text = String::from_utf8_lossy(event);
        let one_line =
            escape_controls(text.trim_end_matches('\n')).replace('\n', "\\n").replace('\t', "\\t");
        writeln!(self.0, "{one_line}")?;
        Ok(event.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_act_on_a_terminal_or_forge_a_line_of_the_log() {
        for (text, shown) in [
            ("d = 0.4 m, +- 2 %\n\tsecond", "d = 0.4 m, +- 2 %\n\tsecond"),
            ("\u{1b}[31mred\u{1b}[0m", "\\u{1b}[31mred\\u{1b}[0m"),
            ("a\rb\u{7}", "a\\rb\\u{7}"),
            ("ok \u{202e}deliaf", "ok \\u{202e}deliaf"),
            ("Gelenk ä \u{3b8}", "Gelenk ä \u{3b8}"),
        ] {
            assert_eq!(escape_controls(text), shown);
        }
        let mut lines = Lines(Vec::new());
        lines.write_all(b"INFO trial\n2026 ERROR forged\n").unwrap();
        assert_eq!(lines.0, b"INFO trial\\n2026 ERROR forged\n");
    }
}
