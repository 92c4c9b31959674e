//! Rendering of the HTML templates, and the templates shared between them.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use minijinja::syntax::SyntaxConfig;
use minijinja::value::{Serde, Value};
use minijinja::{Environment, UndefinedBehavior, escape_formatter};
use serde::Serialize;
use trilink_base::numbers::{
    as_configured, concise, fixed, interval_to, percent, place, rounded, share, short, significant,
    with_error,
};
use trilink_base::text::escape_controls;
use trilink_plot::ROBOTO;
use trilink_tables::Explanation;

/// Names and sources of the templates that other templates include or extend.
const SHARED: [(&str, &str); 15] = [
    ("base.html", include_str!("base.html")),
    ("check.html", include_str!("check.html")),
    ("campaign.html", include_str!("campaign.html")),
    ("changes.html", include_str!("changes.html")),
    ("figure.html", include_str!("figure.html")),
    ("sheet.html", include_str!("sheet.html")),
    ("macros.html", include_str!("macros.html")),
    ("optima.html", include_str!("optima.html")),
    ("replay.html", include_str!("replay.html")),
    ("replay.css", include_str!("replay.css")),
    ("replay.js", include_str!("replay.js")),
    ("scorecard.html", include_str!("scorecard.html")),
    ("script.js", include_str!("script.js")),
    ("style.css", include_str!("style.css")),
    ("tables.js", include_str!("tables.js")),
];

/// Renders a template with `values`.
///
/// Values are HTML-escaped if `name` ends with `.html` or `.xml`; control characters in text are always escaped. The
/// functions in [`trilink_base::numbers`] are available as filters.
///
/// # Errors
/// Returns an error if the template is invalid or uses an undefined value.
pub fn fill(
    name: &str,
    template: &str,
    values: &impl Serialize,
) -> Result<String, minijinja::Error> {
    let mut environment = Environment::new();
    let syntax = SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build();
    environment.set_syntax(syntax?);
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.set_formatter(|out, state, value| match value.as_str() {
        Some(text) if !value.is_safe() => {
            escape_formatter(out, state, &Value::from(escape_controls(text).as_ref()))
        }
        _ => escape_formatter(out, state, value),
    });
    environment.add_filter("fixed", fixed);
    environment.add_filter("significant", significant);
    environment.add_filter("as_configured", as_configured);
    environment.add_filter("with_error", with_error);
    environment.add_filter("concise", concise);
    environment.add_filter("percent", percent);
    environment.add_filter("share", share);
    environment.add_filter("short", short);
    environment.add_filter("interval_to", |limits: Vec<f64>, place| {
        limits.try_into().map_or_else(|_| String::new(), |limits| interval_to(limits, place))
    });
    environment.add_filter("place", place);
    environment.add_filter("rounded", rounded);
    environment.add_filter("explained", |check: String| Serde(Explanation::find(&check)));
    environment.add_filter("degrees", f64::to_degrees);
    environment.add_test("finite", f64::is_finite);
    environment.add_global("font_base64", STANDARD.encode(ROBOTO));
    for (name, text) in SHARED {
        environment.add_template(name, text)?;
    }
    environment.add_template(name, template)?;
    environment.get_template(name)?.render(Serde(values))
}
