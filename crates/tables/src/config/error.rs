//! Errors of `pipeline.toml` and `trials.toml`: which file, line or key, what was found and
//! what was needed.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use super::settings::{key_at, line_at};
use super::strict::Strict;

/// Why a configuration or a list of trials cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    #[error("{}: cannot be read: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{}, line {line}: {}{message}{}", path.display(), of_key(key), hint(suggestion))]
    Syntax {
        path: PathBuf,
        line: usize,
        /// Whose value is wrong.
        key: Option<String>,
        message: String,
        suggestion: Option<String>,
    },
    #[error("{}: key `{key}`: found {found}, needed {needed}", path.display())]
    Value { path: PathBuf, key: String, found: String, needed: String },
    #[error("{}: found {found}, needed {needed}", pattern.display())]
    Pattern { pattern: PathBuf, found: String, needed: &'static str },
}

fn of_key(key: &Option<String>) -> String {
    key.as_ref().map_or(String::new(), |key| format!("key `{key}`: "))
}

fn hint(suggestion: &Option<String>) -> String {
    suggestion.as_ref().map_or(String::new(), |name| format!("; did you mean `{name}`?"))
}

/// Parses TOML; an unknown key's error names its line and the nearest known key.
pub fn parse_toml<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, ConfigError> {
    let parsed = toml::Deserializer::parse(text).and_then(|text| T::deserialize(Strict(text)));
    parsed.map_err(|error| ConfigError::toml(path, text, &error))
}

impl ConfigError {
    pub(super) fn toml(path: &Path, text: &str, error: &toml::de::Error) -> Self {
        let start = error.span().map_or(0, |span| span.start.min(text.len()));
        let line = line_at(text, start);
        let written = text.lines().nth(line - 1).unwrap_or_default();
        let message = in_plain_words(error.message().trim());
        let message = format!("{message}{}", mistake(&message, written));
        let is_of_value = OF_VALUES.iter().any(|begin| message.starts_with(begin));
        let key = if is_of_value { key_at(text, start) } else { None };
        let suggestion = unknown_name(&message);
        Self::Syntax { path: path.to_owned(), line, key, message, suggestion }
    }
}

/// How messages begin that are of a key's value.
const OF_VALUES: [&str; 4] = ["found a list", "invalid ", "unknown variant", "wanted "];

/// What a line was probably meant to be.
fn mistake(message: &str, line: &str) -> String {
    let line = line.trim();
    let table = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
    let is_list = |name: &str| !name.starts_with('[') && name == "trial";
    match (table, line.split_once('=')) {
        (Some(name), _) if is_list(name) => {
            format!("; found [{name}], needed [[{name}]] for each of a list")
        }
        (_, Some((key, _))) if message.starts_with("invalid unquoted key") => {
            format!("; found {}, needed it in quotes: \"{}\"", key.trim(), key.trim())
        }
        _ => String::new(),
    }
}

/// serde names Rust's types; people write numbers.
fn in_plain_words(message: &str) -> String {
    let words = [
        ("expected usize", "expected a whole number of 0 or more"),
        ("expected f64", "expected a number"),
        ("an array of length", "a list of length"),
        ("type: sequence", "type: list"),
        ("expected a sequence", "expected a list"),
        ("expected a map", "expected a table"),
        ("invalid unquoted key", "a key such as `\"Snake:M1\"` stands in quotes; without"),
    ];
    let message = message
        .split_once(", expected struct ")
        .map_or_else(|| message.to_owned(), |(found, _)| format!("{found}, expected a table"));
    words.iter().fold(message, |message, (rust, plain)| message.replace(rust, plain))
}

/// serde says "unknown field `a`, expected one of `b`, `c`": the expected name nearest to `a`.
fn unknown_name(message: &str) -> Option<String> {
    if !message.starts_with("unknown ") {
        return None;
    }
    let mut quoted = message.split('`').skip(1).step_by(2);
    let unknown = quoted.next()?;
    nearest(unknown, quoted).map(str::to_owned)
}

/// A question by the candidate most like `name`, empty if none is at all like it.
pub fn did_you_mean<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    nearest(name, candidates).map_or(String::new(), |name| format!("; did you mean `{name}`?"))
}

/// The candidate most like `name`, if any is at all like it.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .into_iter()
        .map(|candidate| (strsim::jaro_winkler(name, candidate), candidate))
        .filter(|(likeness, _)| *likeness > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}
