//! Text files and messages that are filled in from a template.

use minijinja::syntax::SyntaxConfig;
use minijinja::value::{Serde, Value};
use minijinja::{Environment, UndefinedBehavior, escape_formatter};
use serde::Serialize;
use trilink_base::text::harmless;

/// Fills in a template of plain text. Names that others chose cannot act on a terminal.
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
    environment.render_str(template, Serde(values))
}
