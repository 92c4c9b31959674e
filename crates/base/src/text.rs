//! Printing of text, including untrusted text such as names in files.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

/// Returns a copy of a text that lives as long as the program; equal texts share one copy.
pub fn interned(text: &str) -> &'static str {
    static TEXTS: Mutex<BTreeSet<&str>> = Mutex::new(BTreeSet::new());
    let mut texts = TEXTS.lock().unwrap_or_else(PoisonError::into_inner);
    if !texts.contains(text) {
        texts.insert(Box::leak(text.into()));
    }
    texts.get(text).copied().unwrap_or_default()
}

/// Escapes control characters (except line feeds and tabs) and marks that change the text direction.
pub fn escape_controls(text: &str) -> Cow<'_, str> {
    if !text.contains(needs_escape) {
        return text.into();
    }
    let mut escaped = String::new();
    for c in text.chars() {
        if needs_escape(c) {
            escaped.extend(c.escape_default());
        } else {
            escaped.push(c);
        }
    }
    escaped.into()
}

fn needs_escape(c: char) -> bool {
    let changes_direction = matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}')
        || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    (c.is_control() || changes_direction) && !matches!(c, '\n' | '\t')
}

/// Formats `numbers` with `format`, as part of a sentence; returns an empty string if any number is not finite.
pub fn known<const N: usize>(numbers: [f64; N], format: impl FnOnce([f64; N]) -> String) -> String {
    if numbers.iter().all(|number| number.is_finite()) { format(numbers) } else { String::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_and_direction_marks_are_escaped() {
        assert_eq!(escape_controls("a\tb\nσ₀ \u{2212}1"), "a\tb\nσ₀ \u{2212}1");
        assert_eq!(escape_controls("\u{1b}[31m\r\0"), "\\u{1b}[31m\\r\\u{0}");
        assert_eq!(escape_controls("a\u{202e}b\u{2066}"), "a\\u{202e}b\\u{2066}");
    }
}
