//! Colours and width of the output.
//!
//! Colours are used as in the messages of clap: if a stream is a terminal, unless `--color`, `NO_COLOR`, `CLICOLOR` or
//! `CLICOLOR_FORCE` state otherwise. Lines are wrapped at the width of the terminal; lines for a pipe or a file are not.

use std::ffi::OsString;
use std::fmt;
use std::ops::Add;

use clap::builder::styling::{AnsiColor, Style};
use clap::{ColorChoice, ValueEnum};
use console::{Term, measure_text_width, strip_ansi_codes};
use serde::{Serialize, Serializer};
use trilink_base::text::escape_controls;

/// Minimum width at which lines are wrapped, characters.
const MIN_WIDTH: usize = 20;
/// Mark at the end of a text that is cut off.
const CUT: &str = " ..";

/// Meaning of a word that is printed in colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tone {
    /// Trial that is ok, model that fits, value within tolerance.
    Good,
    /// Flagged trial, warning, model that may fit.
    Doubtful,
    /// Failed trial, error, model that does not fit, value out of tolerance.
    Bad,
    /// Heading of a table or a block.
    Heading,
}

impl Tone {
    /// Returns the text in the colour of this tone.
    pub(super) fn paint(self, text: impl Into<Text>) -> Text {
        let text = text.into();
        if text.0.is_empty() {
            return text;
        }
        let style = match self {
            Self::Good => AnsiColor::Green.on_default(),
            Self::Doubtful => AnsiColor::Yellow.on_default().bold(),
            Self::Bad => AnsiColor::Red.on_default().bold(),
            Self::Heading => Style::new().bold(),
        };
        Text(format!("{style}{text}{style:#}"))
    }

    /// Returns the tone of a status or verdict, such as `flagged`.
    pub(super) fn of(word: &str) -> Option<Self> {
        match word {
            "ok" | "fits" | "stable" => Some(Self::Good),
            "flagged" | "warning" | "attention" | "interrupted" => Some(Self::Doubtful),
            "failed" | "error" | "does not fit" | "singular" | "diverged" | "unstable" => {
                Some(Self::Bad)
            }
            _ => None,
        }
    }
}

/// Text to print: control characters of names are escaped, so that only a [`Tone`] acts on the terminal.
#[derive(Debug, Clone, Default)]
pub(super) struct Text(String);

impl Text {
    /// Returns a status or verdict in its colour.
    pub(super) fn status(word: impl fmt::Display) -> Self {
        let word = word.to_string();
        match Tone::of(&word) {
            Some(tone) => tone.paint(word),
            None => word.into(),
        }
    }

    /// Joins the lines of a table.
    pub(super) fn lines(lines: &[Self]) -> Self {
        let lines = lines.iter().map(|line| line.0.as_str());
        Self(lines.collect::<Vec<_>>().join("\n"))
    }

    /// Returns the number of characters that the text takes on a line.
    pub(super) fn width(&self) -> usize {
        measure_text_width(&self.0)
    }

    /// Whether the text is empty or the dash that stands for a missing value.
    pub(super) fn is_missing(&self) -> bool {
        matches!(self.0.as_str(), "" | "-")
    }

    /// Removes spaces at the end.
    pub(super) fn trim_end(mut self) -> Self {
        self.0.truncate(self.0.trim_end().len());
        self
    }

    /// Breaks each line that is longer than `width` at spaces. The lines that continue it are indented by two
    /// characters more. A word that is longer than a line stays whole. Without a width, no line is broken.
    pub(super) fn wrap(&self, width: Option<usize>) -> Self {
        let Some(width) = width else { return self.clone() };
        let lines = self.0.split('\n').flat_map(|line| {
            let indent = line.len() - line.trim_start_matches(' ').len() + 2;
            break_line(line, width, &" ".repeat(indent))
        });
        Self(lines.collect::<Vec<_>>().join("\n"))
    }

    /// Returns the number of lines that the text takes.
    pub(super) fn height(&self, width: Option<usize>) -> usize {
        self.wrap(width).0.split('\n').count()
    }

    /// Wraps the text and retains at most `max` lines.
    pub(super) fn cut(&self, width: Option<usize>, max: usize) -> Self {
        if self.height(width) <= max {
            return self.wrap(width);
        }
        let shorter = self.wrap(width.map(|width| width - CUT.len())).0;
        let lines: Vec<&str> = shorter.split('\n').take(max).collect();
        Self(lines.join("\n") + CUT)
    }

    /// Breaks the text into lines of at most `width` characters.
    pub(super) fn broken(&self, width: usize) -> Vec<Self> {
        break_line(&self.0, width, "").into_iter().map(Self).collect()
    }
}

/// Breaks a line at spaces; every line but the first begins with `indent`.
fn break_line(line: &str, width: usize, indent: &str) -> Vec<String> {
    let mut lines = Vec::new();
    let mut current = String::new();
    for (n, word) in line.split(' ').enumerate() {
        let is_blank = current.trim_start().is_empty();
        if is_blank && !lines.is_empty() {
            current = format!("{indent}{word}");
        } else if is_blank || measure_text_width(&current) + 1 + measure_text_width(word) <= width {
            current += if n == 0 { "" } else { " " };
            current += word;
        } else {
            lines.push(current.trim_end().to_owned());
            current = format!("{indent}{word}");
        }
    }
    lines.push(current);
    lines
}

impl<T: AsRef<str>> From<T> for Text {
    fn from(text: T) -> Self {
        Self(escape_controls(text.as_ref()).into_owned())
    }
}

impl<T: Into<Text>> Add<T> for Text {
    type Output = Self;

    fn add(mut self, other: T) -> Self {
        self.0 += &other.into().0;
        self
    }
}

/// Serializes the text without colours.
impl Serialize for Text {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&strip_ansi_codes(&self.0))
    }
}

impl fmt::Display for Text {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Returns the width of lines on standard output, characters; `None` if they are not wrapped.
pub(super) fn stdout_width() -> Option<usize> {
    width(&Term::stdout())
}

/// Returns the width of lines on standard error, characters; `None` if they are not wrapped.
pub(super) fn stderr_width() -> Option<usize> {
    width(&Term::stderr())
}

/// Returns the width that the variable `COLUMNS` states, and otherwise that of the terminal.
fn width(stream: &Term) -> Option<usize> {
    let columns = std::env::var("COLUMNS").ok().and_then(|columns| columns.parse().ok());
    let columns = columns.filter(|columns| *columns > 0);
    let terminal = || stream.is_term().then(|| usize::from(stream.size().1));
    Some(columns.or_else(terminal)?.max(MIN_WIDTH))
}

/// Applies the option `--color` of a command line, so that it also holds for errors in the command line.
pub(super) fn choose_colors(line: &[OsString]) {
    let mut choice = ColorChoice::Auto;
    let mut words = line.iter().filter_map(|word| word.to_str()).take_while(|word| *word != "--");
    while let Some(word) = words.next() {
        let when = match word.strip_prefix("--color") {
            Some("") => words.next(),
            Some(rest) => rest.strip_prefix('='),
            None => None,
        };
        choice = when.and_then(|when| ColorChoice::from_str(when, false).ok()).unwrap_or(choice);
    }
    let choice = match choice {
        ColorChoice::Auto => anstream::ColorChoice::Auto,
        ColorChoice::Always => anstream::ColorChoice::Always,
        ColorChoice::Never => anstream::ColorChoice::Never,
    };
    choice.write_global();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_break_at_spaces_and_continue_two_characters_further() {
        let text =
            Text::from("  one two three\nfour five six seven\n\n  a-word-of-twenty-letters b");
        let wrapped = text.wrap(Some(12)).to_string();
        let expected =
            "  one two\n    three\nfour five\n  six seven\n\n  a-word-of-twenty-letters\n    b";
        assert_eq!(wrapped, expected);
        assert_eq!(text.wrap(None).to_string(), text.to_string());
        assert_eq!(text.cut(Some(12), 2).to_string(), "  one two\n    three ..");
        assert_eq!(text.cut(None, 4).to_string(), text.to_string());
    }

    #[test]
    fn colours_take_no_width_and_names_have_none() {
        let text = Tone::Bad.paint("failed") + ": \u{1b}[31mred";
        assert_eq!(text.to_string(), "\u{1b}[1m\u{1b}[31mfailed\u{1b}[0m: \\u{1b}[31mred");
        assert_eq!(text.width(), "failed: \\u{1b}[31mred".len());
        assert_eq!(text.broken(16).len(), 2);
    }
}
