//! Errors in `pipeline.toml` and `trials.toml`, with the file, the line or key, what was found and what is
//! needed.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

use super::settings::{key_at, line_at};
use super::strict::Strict;

/// Error in a configuration file or a trial list.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    #[error("{}: cannot be read: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{}: this trial folder, with its trials.toml, does not exist", .0.display())]
    NoTrialFolder(PathBuf),
    #[error(
        "{folder}: this trial folder has no trials.toml; `trilink init {folder}` drafts it from the marker files (add \
         --out DIR to leave an existing pipeline.toml unchanged)",
        folder = .0.display()
    )]
    NoTrialList(PathBuf),
    #[error("{}, line {line}: {}{message}{}", path.display(), key_prefix(key), hint(suggestion))]
    Syntax {
        path: PathBuf,
        line: usize,
        /// Key whose value is wrong; `None` if the error does not concern a value.
        key: Option<String>,
        message: String,
        suggestion: Option<String>,
    },
    #[error("{}: key `{key}`: found {found}, needed {needed}", path.display())]
    Value { path: PathBuf, key: String, found: String, needed: String },
    /// Several values are not yet filled in.
    #[error("{}: found nan for {} keys, needed numbers: {}", path.display(), keys.len(), keys.join(", "))]
    Unfilled {
        path: PathBuf,
        /// Keys with their lines, such as `robot.a.b_m (line 7)`.
        keys: Vec<String>,
    },
    #[error("{}: found {found}, needed {needed}", pattern.display())]
    Pattern { pattern: PathBuf, found: String, needed: &'static str },
}

fn key_prefix(key: &Option<String>) -> String {
    key.as_ref().map_or(String::new(), |key| format!("key `{key}`: "))
}

fn hint(suggestion: &Option<String>) -> String {
    suggestion.as_ref().map_or(String::new(), |name| format!("; did you mean `{name}`?"))
}

/// Parses TOML strictly; the error about an unknown key names its line and the most similar known key.
pub fn parse_toml<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, ConfigError> {
    let parsed = toml::Deserializer::parse(text).and_then(|text| T::deserialize(Strict(text)));
    parsed.map_err(|error| ConfigError::toml(path, text, &error))
}

impl ConfigError {
    pub(super) fn toml(path: &Path, text: &str, error: &toml::de::Error) -> Self {
        let start = error.span().map_or(0, |span| span.start.min(text.len()));
        let line = line_at(text, start);
        let line_text = text.lines().nth(line - 1).unwrap_or_default();
        let message = in_plain_words(error.message().trim());
        let message = format!("{message}{}", explain_mistake(&message, line_text));
        let is_about_value = VALUE_ERRORS.iter().any(|prefix| message.starts_with(prefix));
        let key = if is_about_value { key_at(text, start) } else { None };
        let suggestion = suggest_name(&message);
        Self::Syntax { path: path.to_owned(), line, key, message, suggestion }
    }
}

/// Beginnings of those error messages of the TOML parser that concern the value of a key.
const VALUE_ERRORS: [&str; 4] = ["found a list", "invalid ", "unknown variant", "wanted "];

/// Returns an explanation of a common mistake in a line of TOML, to be appended to the parser's `message`; empty if the
/// line contains no such mistake.
fn explain_mistake(message: &str, line: &str) -> String {
    let line = line.trim();
    let table = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
    match (table, line.split_once('=')) {
        (Some("trial"), _) => "; found [trial], needed [[trial]] before each trial".to_owned(),
        (_, Some((key, _))) if message.starts_with("invalid unquoted key") => {
            format!("; {} must be in quotes: \"{}\"", key.trim(), key.trim())
        }
        _ => String::new(),
    }
}

/// Replaces the names of Rust types in messages from serde by words that users understand.
fn in_plain_words(message: &str) -> String {
    let words = [
        ("expected usize", "expected a non-negative whole number"),
        ("expected f64", "expected a number"),
        ("an array of length", "a list of length"),
        ("type: sequence", "type: list"),
        ("expected a sequence", "expected a list"),
        ("expected a map", "expected a table"),
        (
            "invalid unquoted key, expected",
            "a key such as `\"Snake:M1\"` needs quotes; keys without quotes may contain only",
        ),
    ];
    let message = message
        .split_once(", expected struct ")
        .map_or_else(|| message.to_owned(), |(found, _)| format!("{found}, expected a table"));
    words.iter().fold(message, |message, (rust, plain)| message.replace(rust, plain))
}

/// Returns the expected name that is most similar to the unknown name in a serde message such as "unknown field `a`,
/// expected one of `b`, `c`"; `None` if no name is similar or the message has another form.
fn suggest_name(message: &str) -> Option<String> {
    if !message.starts_with("unknown ") {
        return None;
    }
    let mut quoted = message.split('`').skip(1).step_by(2);
    let unknown = quoted.next()?;
    nearest(unknown, quoted).map(str::to_owned)
}

/// Returns a question with the candidate that is most similar to `name`; empty if none is similar.
pub fn did_you_mean<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    nearest(name, candidates).map_or(String::new(), |name| format!("; did you mean `{name}`?"))
}

/// Returns the candidate that is most similar to `name`; `None` if none is similar.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .into_iter()
        .map(|candidate| (strsim::jaro_winkler(name, candidate), candidate))
        .filter(|(similarity, _)| *similarity > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}
