//! Lines on standard output and standard error. If the reader has closed the pipe of standard output
//! (`trilink simulate .. | head`), the program ends.

use std::collections::BTreeMap;
use std::io::{ErrorKind, IsTerminal, Write};

use serde::Serialize;
use trilink_base::text::escape_controls;

use super::Failure;
use crate::template::fill;

/// Writes a line to standard output, and ends the program quietly if the reader has closed the pipe.
pub(super) fn write_line(text: &str) {
    let mut stdout = std::io::stdout().lock();
    match writeln!(stdout, "{text}").and_then(|()| stdout.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => std::process::exit(0),
        // A result that cannot be written (a full disk, for example) must not look like success.
        Err(error) => {
            write_note(&format!("error: standard output: {error}"));
            std::process::exit(2)
        }
        Ok(()) => {}
    }
}

/// Writes results for other programs; control characters are escaped only on a terminal.
pub(super) fn write_data(text: &str) {
    if std::io::stdout().is_terminal() {
        write_line(&escape_controls(text));
    } else {
        write_line(text);
    }
}

/// Prints a value as JSON.
pub(super) fn write_json(value: &impl Serialize) -> Result<(), Failure> {
    write_data(&serde_json::to_string_pretty(value)?);
    Ok(())
}

/// Writes a line to standard error; a closed pipe is ignored.
pub(super) fn write_note(text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{}", escape_controls(text));
}

/// Prints a line of results to standard output.
macro_rules! say {
    ($($part:tt)*) => {
        $crate::cli::output::write_line(&trilink_base::text::escape_controls(&format!($($part)*)))
    };
}

/// Prints a message to standard error.
macro_rules! note {
    ($($part:tt)*) => {
        $crate::cli::output::write_note(&format!($($part)*))
    };
}

pub(super) use {note, say};

/// Prints a value as JSON if `as_json` is set, and otherwise as text: a filled-in template, which refers to the value
/// as `of`.
pub(super) fn write(value: &impl Serialize, as_json: bool, template: &str) -> Result<(), Failure> {
    if as_json { write_json(value) } else { write_text(template, &BTreeMap::from([("of", value)])) }
}

/// Prints a text template filled in with `values`.
pub(super) fn write_text(template: &str, values: &impl Serialize) -> Result<(), Failure> {
    say!("{}", fill(template, values)?.trim_end());
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
