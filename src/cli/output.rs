//! Lines on standard output and standard error. The reader may have closed the pipe
//! (`trilink simulate .. | head`): then the program ends.

use std::borrow::Cow;
use std::io::{ErrorKind, IsTerminal, Write};

/// Text that does nothing to a terminal but to stand there: names may hold control characters and
/// marks that turn the direction of writing, which are escaped. Lines end and columns stay.
pub(super) fn harmless(text: &str) -> Cow<'_, str> {
    escaped(text, |c| matches!(c, '\n' | '\t'))
}

/// Text of one line, whatever names it has.
fn one_line(text: &str) -> Cow<'_, str> {
    escaped(text, |_| false)
}

fn escaped(text: &str, stays: fn(char) -> bool) -> Cow<'_, str> {
    let is_mark = |c| {
        matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}')
            || matches!(c, '\u{2066}'..='\u{2069}')
    };
    let acts = |c: char| (c.is_control() || is_mark(c)) && !stays(c);
    if !text.contains(acts) {
        return text.into();
    }
    let mut escaped = String::new();
    for c in text.chars() {
        match acts(c) {
            true => escaped.extend(c.escape_default()),
            false => escaped.push(c),
        }
    }
    escaped.into()
}

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

/// Writes a line beside the results, on standard error. That nobody reads it ends nothing.
pub(super) fn write_note(text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{}", harmless(text));
}

/// A line of results, on standard output.
macro_rules! say {
    ($($part:tt)*) => {
        $crate::cli::output::write_line(&$crate::cli::output::harmless(&format!($($part)*)))
    };
}

/// A line beside the results, on standard error.
macro_rules! note {
    ($($part:tt)*) => {
        $crate::cli::output::write_note(&format!($($part)*))
    };
}

pub(super) use {note, say};

/// A log's lines: a name cannot begin another one.
pub(super) struct Lines<W>(pub W);

impl<W: Write> Write for Lines<W> {
    /// Each event comes whole.
    fn write(&mut self, event: &[u8]) -> std::io::Result<usize> {
        let text = String::from_utf8_lossy(event);
        writeln!(self.0, "{}", one_line(text.trim_end_matches('\n')))?;
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
