//! Patterns of text: one character stands for any characters, none too, and another for one.

/// Whether a label, or the part of it after the subject, matches a pattern with `*` and `?`.
pub fn matches_label(pattern: &str, label: &str) -> bool {
    let name = label.rsplit_once(':').map_or(label, |(_, name)| name);
    matches(pattern, label, ['*', '?']) || matches(pattern, name, ['*', '?'])
}

/// Whether a text matches a pattern, in which `any` stands for any characters and `one` for one.
pub fn matches(pattern: &str, text: &str, [any, one]: [char; 2]) -> bool {
    let (mut pattern, mut text) = (pattern.chars(), text.chars());
    // What follows the last star, and the text after what it stands for.
    let mut star = None;
    while let Some(c) = text.clone().next() {
        match pattern.clone().next() {
            Some(of) if of == any => {
                pattern.next();
                star = Some((pattern.clone(), text.clone()));
            }
            Some(of) if of == one || of == c => {
                pattern.next();
                text.next();
            }
            _ => match &mut star {
                Some((follows, rest)) => {
                    rest.next();
                    (pattern, text) = (follows.clone(), rest.clone());
                }
                None => return false,
            },
        }
    }
    pattern.all(|of| of == any)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stars_and_question_marks_stand_for_characters() {
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
    fn a_label_is_matched_with_or_without_its_subject() {
        assert!(matches_label("V_*", "Snake:V_1") && matches_label("Snake:V_*", "Snake:V_1"));
        assert!(matches_label("Pole:*", "Pole:M1") && !matches_label("Pole:*", "Snake:M1"));
        assert!(!matches_label("Snake", "Snake:V_1"));
    }
}
