//! What each check looks at, why that matters and what to do: the text of `checks.md` beside this file.

use serde::Serialize;

const TEXT: &str = include_str!("checks.md");

/// The explanation of one check.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Explanation {
    /// Code and name, such as `W018 joint-places`.
    pub check: &'static str,
    /// Headings and what stands under them, without marks.
    pub parts: Vec<(&'static str, String)>,
}

impl Explanation {
    /// Those of all checks.
    pub fn all() -> impl Iterator<Item = Self> {
        TEXT.split("\n## ").skip(1).map(Self::read)
    }

    /// That of a check by its code, its name, or both, in any case.
    pub fn of(check: &str) -> Option<Self> {
        let is_it = |name: &str| name.eq_ignore_ascii_case(check);
        Self::all().find(|of| is_it(of.check) || of.check.split(' ').any(is_it))
    }

    fn read(section: &'static str) -> Self {
        let (check, text) = section.split_once('\n').unwrap_or((section, ""));
        let part = |paragraph: &'static str| {
            let (heading, text) = paragraph.trim().strip_prefix("**")?.split_once(".**")?;
            Some((heading, plain(text)))
        };
        Self { check, parts: text.split("\n\n").filter_map(part).collect() }
    }
}

/// A paragraph in one line; of its links the text alone.
fn plain(paragraph: &str) -> String {
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
            assert_eq!(Explanation::of(name).map(|of| of.check), Some("W018 joint-places"));
        }
        assert_eq!(Explanation::of("W099"), None);
        assert_eq!(plain("`[a]`, see [this](a.md#b) and\n[that](c)."), "`[a]`, see this and that.");
    }
}
