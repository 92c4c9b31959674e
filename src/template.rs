//! Text files and messages that are filled in from a template.

use minijinja::syntax::SyntaxConfig;
use minijinja::value::{Serde, Value};
use minijinja::{Environment, UndefinedBehavior, escape_formatter};
use serde::Serialize;
use trilink_base::text::harmless;
use trilink_tables::config::toml_key;

/// Fills in a template of plain text. Names that others chose cannot act on a terminal. `left` fills a text up with
/// spaces, `plain` writes a number with as few digits as tell it from others, [`fixed`] with some; `toml` and `toml_key`
/// write texts and lists of them as values, and keys.
///
/// # Errors
/// The template is wrong, or a value that it asks for is not there.
pub(crate) fn fill(template: &str, values: &impl Serialize) -> Result<String, minijinja::Error> {
    let mut environment = Environment::new();
    let syntax = SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build();
    environment.set_syntax(syntax?);
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.set_formatter(|out, state, value| match value.as_str() {
        Some(text) => escape_formatter(out, state, &Value::from(harmless(text).as_ref())),
        None => escape_formatter(out, state, value),
    });
    let or_nan = |value: Option<f64>, digits: usize| fixed(value.unwrap_or(f64::NAN), digits);
    environment.add_filter("fixed", or_nan);
    environment.add_filter("toml", toml);
    environment.add_filter("toml_key", |key: String| toml_key(&key));
    environment.add_filter("left", |text: String, width: usize| format!("{text:width$}"));
    environment.add_filter("plain", |number: f64| number.to_string());
    environment.render_str(template, Serde(values))
}

/// A number with `digits` after the point, without a minus before nothing.
pub(crate) fn fixed(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let is_nothing = text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.'));
    if is_nothing { text.trim_start_matches('-').to_owned() } else { text }
}

fn toml(value: &Value) -> String {
    match (value.as_str(), value.try_iter()) {
        (None, Ok(items)) => {
            format!("[{}]", items.map(|item| toml(&item)).collect::<Vec<_>>().join(", "))
        }
        (text, _) => toml::Value::from(text.unwrap_or_default()).to_string(),
    }
}
