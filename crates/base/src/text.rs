//! Text of others, such as names, where people read it.

use std::borrow::Cow;

/// Text that does nothing but to stand there: control characters and marks that turn the direction
/// of writing are escaped, but for the ends of lines and tabulators.
pub fn harmless(text: &str) -> Cow<'_, str> {
    let turns = |c| {
        matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}')
            || matches!(c, '\u{2066}'..='\u{2069}')
    };
    let acts = |c: char| (c.is_control() || turns(c)) && !matches!(c, '\n' | '\t');
    if !text.contains(acts) {
        return text.into();
    }
    let mut harmless = String::new();
    for c in text.chars() {
        match acts(c) {
            true => harmless.extend(c.escape_default()),
            false => harmless.push(c),
        }
    }
    harmless.into()
}

/// A part of a sentence that states these numbers; empty if one of them is missing.
pub fn known<const N: usize>(numbers: [f64; N], part: impl FnOnce([f64; N]) -> String) -> String {
    if numbers.iter().all(|number| number.is_finite()) { part(numbers) } else { String::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_and_turning_marks_are_escaped() {
        assert_eq!(harmless("a\tb\nσ₀ \u{2212}1"), "a\tb\nσ₀ \u{2212}1");
        assert_eq!(harmless("\u{1b}[31m\r\0"), "\\u{1b}[31m\\r\\u{0}");
        assert_eq!(harmless("a\u{202e}b\u{2066}"), "a\\u{202e}b\\u{2066}");
    }
}
