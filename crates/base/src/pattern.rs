//! Wildcard patterns: one wildcard stands for any number of characters, another for exactly one.

use crate::body;

/// Returns whether a label, with or without its subject (`Subject:label`), matches a pattern with `*` and `?`; the label
/// of a point of a rigid body stands for the name of the body.
pub fn matches_label(pattern: &str, label: &str) -> bool {
    let label = body::name(label);
    let name = label.rsplit_once(':').map_or(label, |(_, name)| name);
    matches(pattern, label, ['*', '?']) || matches(pattern, name, ['*', '?'])
}

/// Returns whether `text` matches a pattern in which the character `any` stands for any number of characters
/// and `one` for exactly one.
pub fn matches(pattern: &str, text: &str, [any, one]: [char; 2]) -> bool {
    let mut pattern = pattern.chars();
    let mut text = text.chars();
    // Where to resume after a mismatch: the pattern after the last `any`, and the text that follows what it matched.
    let mut last_any = None;
    while let Some(c) = text.clone().next() {
        match pattern.clone().next() {
            Some(p) if p == any => {
                pattern.next();
                last_any = Some((pattern.clone(), text.clone()));
            }
            Some(p) if p == one || p == c => {
                pattern.next();
                text.next();
            }
            _ => match &mut last_any {
                Some((follows, rest)) => {
                    rest.next();
                    pattern = follows.clone();
                    text = rest.clone();
                }
                None => return false,
            },
        }
    }
    pattern.all(|p| p == any)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wildcards_stand_for_characters() {
        for (pattern, text, expected) in [
            ("V_*", "V_1", true),
            ("V_*", "V_", true),
            ("V_*", "v_1", false),
            ("V_*", "AV_1", false),
            ("*_virtual", "front_virtual", true),
            ("*a*b*", "xxaxxbxx", true),
            ("*a*b*", "xxbxxaxx", false),
            ("*ab", "aab", true),
            ("M?", "M1", true),
            ("M?", "M", false),
            ("M?", "M10", false),
            ("**", "", true),
            ("", "", true),
            ("", "M1", false),
            ("Ä?", "Äß", true),
        ] {
            assert_eq!(matches(pattern, text, ['*', '?']), expected, "{pattern} {text}");
        }
    }

    #[test]
    fn labels_match_with_and_without_their_subject() {
        assert!(matches_label("V_*", "Snake:V_1") && matches_label("Snake:V_*", "Snake:V_1"));
        assert!(matches_label("Pole:*", "Pole:M1") && !matches_label("Pole:*", "Snake:M1"));
        assert!(!matches_label("Snake", "Snake:V_1"));
    }
}
