//! The templates, and how they are filled in.

use minijinja::syntax::SyntaxConfig;
use minijinja::value::Serde;
use minijinja::{Environment, UndefinedBehavior};
use serde::Serialize;

/// Names and texts; a name that ends in `.html` makes the engine escape what it fills in.
const TEMPLATES: [(&str, &str); 5] = [
    ("index.html", include_str!("index.html")),
    ("trial.html", include_str!("trial.html")),
    ("figure.html", include_str!("figure.html")),
    ("scorecard.html", include_str!("scorecard.html")),
    ("style.css", include_str!("style.css")),
];

/// The text of all templates: what pages look like.
pub fn texts() -> String {
    TEMPLATES.iter().map(|(_, text)| *text).collect()
}

/// Fills in the template of that name.
///
/// # Errors
/// A template is wrong, or a value that it asks for is not there.
pub fn fill(name: &str, values: &impl Serialize) -> Result<String, minijinja::Error> {
    let mut environment = Environment::new();
    let syntax = SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build();
    environment.set_syntax(syntax?);
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    for (name, text) in TEMPLATES {
        environment.add_template(name, text)?;
    }
    environment.get_template(name)?.render(Serde(values))
}
