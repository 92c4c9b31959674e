//! Explanations of the checks (what each examines, why it matters and what to do), parsed from `checks.md`.

use serde::Serialize;

const TEXT: &str = include_str!("checks.md");

/// Explanation of one check: what it examines, why it matters and what to do.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Explanation {
    /// Code and name, such as `W018 joint-places`.
    pub check: &'static str,
    /// Headings and the text below them, without Markdown.
    pub parts: Vec<(&'static str, String)>,
}

impl Explanation {
    /// Returns the explanations of all checks.
    pub fn all() -> impl Iterator<Item = Self> {
        TEXT.split("\n## ").skip(1).map(Self::parse)
    }

    /// Finds the explanation of a check by its code, its name, or both; case does not matter.
    pub fn find(check: &str) -> Option<Self> {
        let matches = |name: &str| name.eq_ignore_ascii_case(check);
        Self::all().find(|one| matches(one.check) || one.check.split(' ').any(matches))
    }

    fn parse(section: &'static str) -> Self {
        let (check, text) = section.split_once('\n').unwrap_or((section, ""));
        Self { check, parts: text.split("\n\n").filter_map(parse_part).collect() }
    }
}

/// Splits a paragraph of the form `**Heading.** text` into heading and text; `None` for any other paragraph.
fn parse_part(paragraph: &'static str) -> Option<(&'static str, String)> {
    let (heading, text) = paragraph.trim().strip_prefix("**")?.split_once(".**")?;
    Some((heading, to_plain_text(text)))
}

/// Joins the lines of a paragraph, and replaces Markdown links by their text.
fn to_plain_text(paragraph: &str) -> String {
    let line = paragraph.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut text = String::new();
    let mut rest = line.as_str();
    while let Some((before, after)) = rest.split_once("](") {
        let (outside, linked) = before.rsplit_once('[').unwrap_or((before, ""));
        text = text + outside + linked;
        rest = after.split_once(')').map_or("", |(_, rest)| rest);
    }
    text + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_check_is_found_by_its_code_or_its_name() {
        for name in ["W018", "w018", "joint-places", "W018 joint-places"] {
            assert_eq!(Explanation::find(name).map(|one| one.check), Some("W018 joint-places"));
        }
        assert_eq!(Explanation::find("W099"), None);
        let paragraph = "`[a]`, see [this](a.md#b) and\n[that](c).";
        assert_eq!(to_plain_text(paragraph), "`[a]`, see this and that.");
    }
}
