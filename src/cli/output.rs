//! Lines on standard output and standard error. The reader may have closed the pipe
//! (`trilink simulate .. | head`): then the program ends.

use std::collections::BTreeMap;
use std::io::{ErrorKind, IsTerminal, Write};

use serde::Serialize;
use trilink_base::text::harmless;

use super::Failure;
use crate::template::fill;

/// Writes text and the end of its line to standard output, and ends the program quietly if nobody
/// reads any more.
pub(super) fn write_line(text: &str) {
    let mut to = std::io::stdout().lock();
    match writeln!(to, "{text}").and_then(|()| to.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => std::process::exit(0),
        // A result that cannot be written (a full disk, for example) must not look like success.
        Err(error) => {
            write_note(&format!("error: standard output: {error}"));
            std::process::exit(2)
        }
        Ok(()) => {}
    }
}

/// Writes results for other programs, every character of them unless a terminal shows them.
pub(super) fn write_data(text: &str) {
    match std::io::stdout().is_terminal() {
        true => write_line(&harmless(text)),
        false => write_line(text),
    }
}

/// Prints a value as JSON.
pub(super) fn write_json(value: &impl Serialize) -> Result<(), Failure> {
    write_data(&serde_json::to_string_pretty(value)?);
    Ok(())
}

/// Writes a line beside the results, on standard error. That nobody reads it ends nothing.
pub(super) fn write_note(text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{}", harmless(text));
}

/// A line of results, on standard output.
macro_rules! say {
    ($($part:tt)*) => {
        $crate::cli::output::write_line(&trilink_base::text::harmless(&format!($($part)*)))
    };
}

/// A line beside the results, on standard error.
macro_rules! note {
    ($($part:tt)*) => {
        $crate::cli::output::write_note(&format!($($part)*))
    };
}

pub(super) use {note, say};

/// Prints a value as JSON, or else as a template of text shows it, in which it is `of`.
pub(super) fn write(value: &impl Serialize, as_json: bool, template: &str) -> Result<(), Failure> {
    match as_json {
        true => write_json(value)?,
        false => write_text(template, &BTreeMap::from([("of", value)]))?,
    }
    Ok(())
}

/// Prints a template of text with these values.
pub(super) fn write_text(template: &str, values: &impl Serialize) -> Result<(), Failure> {
    say!("{}", fill(template, values)?.trim_end());
    Ok(())
}

/// A log's lines: a name cannot begin another one.
pub(super) struct Lines<W>(pub W);

impl<W: Write> Write for Lines<W> {
    /// Each event comes whole.
    fn write(&mut self, event: &[u8]) -> std::io::Result<usize> {
        let text = String::from_utf8_lossy(event);
        let one_line =
            harmless(text.trim_end_matches('\n')).replace('\n', "\\n").replace('\t', "\\t");
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
    fn names_do_nothing_to_a_terminal_and_begin_no_line_of_a_log() {
        for (text, shown) in [
            ("d = 0.4 m, +- 2 %\n\tsecond", "d = 0.4 m, +- 2 %\n\tsecond"),
            ("\u{1b}[31mred\u{1b}[0m", "\\u{1b}[31mred\\u{1b}[0m"),
            ("a\rb\u{7}", "a\\rb\\u{7}"),
            ("ok \u{202e}deliaf", "ok \\u{202e}deliaf"),
            ("Gelenk ä \u{3b8}", "Gelenk ä \u{3b8}"),
        ] {
            assert_eq!(harmless(text), shown);
        }
        let mut lines = Lines(Vec::new());
        lines.write_all(b"INFO trial\n2026 ERROR forged\n").unwrap();
        assert_eq!(lines.0, b"INFO trial\\n2026 ERROR forged\n");
    }
}
