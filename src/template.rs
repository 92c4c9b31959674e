//! Rendering of text files and messages from templates.

use minijinja::syntax::SyntaxConfig;
use minijinja::value::{Serde, Value};
use minijinja::{Environment, UndefinedBehavior, escape_formatter};
use serde::Serialize;
use trilink_base::text::escape_controls;
use trilink_tables::config::toml_key;

/// Renders a plain-text template; control characters in values are escaped, so that they cannot act on a terminal.
///
/// Filters: `left` pads a string with spaces on the right; `plain` writes a number with the fewest digits that identify
/// it, and [`fixed`] writes a number with a given number of decimals; `toml` writes a string or a list of strings as a
/// TOML value, and `toml_key` writes a string as a TOML key.
///
/// # Errors
/// Returns an error if the template has a syntax error or uses an undefined value.
pub(crate) fn fill(template: &str, values: &impl Serialize) -> Result<String, minijinja::Error> {
    let mut environment = Environment::new();
    let syntax = SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build();
    environment.set_syntax(syntax?);
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.set_formatter(|out, state, value| match value.as_str() {
        Some(text) => escape_formatter(out, state, &Value::from(escape_controls(text).as_ref())),
        None => escape_formatter(out, state, value),
    });
    environment.add_filter("fixed", |value: Option<f64>, digits: usize| {
        fixed(value.unwrap_or(f64::NAN), digits)
    });
    environment.add_filter("toml", toml);
    environment.add_filter("toml_key", |key: String| toml_key(&key));
    environment.add_filter("left", |text: String, width: usize| format!("{text:width$}"));
    environment.add_filter("plain", |number: f64| number.to_string());
    environment.render_str(template, Serde(values))
}

/// Formats a number with `digits` decimals, and zero without a minus sign.
pub(crate) fn fixed(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let is_zero = text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.'));
    if is_zero { text.trim_start_matches('-').to_owned() } else { text }
}

/// Formats a string or a (nested) list of strings as a TOML value.
fn toml(value: &Value) -> String {
    match (value.as_str(), value.try_iter()) {
        (None, Ok(items)) => {
            format!("[{}]", items.map(|item| toml(&item)).collect::<Vec<_>>().join(", "))
        }
        (text, _) => toml::Value::from(text.unwrap_or_default()).to_string(),
    }
}
