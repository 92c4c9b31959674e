//! Errors of `pipeline.toml` and `trials.toml`: which file, line or key, what was found and
//! what was needed.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

/// Why a configuration or a list of trials cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    #[error("{}: cannot be read: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{}, line {line}: {message}{}", path.display(), hint(suggestion))]
    Syntax { path: PathBuf, line: usize, message: String, suggestion: Option<String> },
    #[error("{}: key `{key}`: found {found}, needed {needed}", path.display())]
    Value { path: PathBuf, key: String, found: String, needed: String },
    #[error("{}: found {found}, needed {needed}", pattern.display())]
    Pattern { pattern: PathBuf, found: String, needed: &'static str },
}

fn hint(suggestion: &Option<String>) -> String {
    suggestion.as_ref().map_or(String::new(), |name| format!("; did you mean `{name}`?"))
}

/// Parses TOML; an unknown key's error names its line and the nearest known key.
pub(crate) fn parse_toml<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, ConfigError> {
    toml::from_str(text).map_err(|error| ConfigError::toml(path, text, &error))
}

impl ConfigError {
    pub(super) fn toml(path: &Path, text: &str, error: &toml::de::Error) -> Self {
        let start = error.span().map_or(0, |span| span.start.min(text.len()));
        let line = 1 + text.as_bytes()[..start].iter().filter(|&&byte| byte == b'\n').count();
        let written = text.lines().nth(line - 1).unwrap_or_default();
        let message = in_plain_words(error.message().trim());
        let message = format!("{message}{}", mistake(&message, written));
        Self::Syntax { path: path.to_owned(), line, suggestion: unknown_name(&message), message }
    }
}

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
        ("invalid unquoted key", "a key such as `\"Snake:M1\"` stands in quotes; without"),
    ];
    words.iter().fold(message.to_owned(), |message, (rust, plain)| message.replace(rust, plain))
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
pub(crate) fn did_you_mean<'a>(
    name: &str,
    candidates: impl IntoIterator<Item = &'a str>,
) -> String {
    nearest(name, candidates).map_or(String::new(), |name| format!("; did you mean `{name}`?"))
}

/// The candidate most like `name`, if any is at all like it.
pub(crate) fn nearest<'a>(
    name: &str,
    candidates: impl IntoIterator<Item = &'a str>,
) -> Option<&'a str> {
    candidates
        .into_iter()
        .map(|candidate| (strsim::jaro_winkler(name, candidate), candidate))
        .filter(|(likeness, _)| *likeness > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}
