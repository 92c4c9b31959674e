//! Patterns of text: one character stands for any characters, none too, and another for one.

/// Whether a label, or the part of it after the subject, matches a pattern with `*` and `?`.
pub(crate) fn matches_label(pattern: &str, label: &str) -> bool {
    let name = label.rsplit_once(':').map_or(label, |(_, name)| name);
    matches(pattern, label, ['*', '?']) || matches(pattern, name, ['*', '?'])
}

/// Whether a text matches a pattern, in which `any` stands for any characters and `one` for one.
pub(crate) fn matches(pattern: &str, text: &str, [any, one]: [char; 2]) -> bool {
    let (pattern, text): (Vec<char>, Vec<char>) =
        (pattern.chars().collect(), text.chars().collect());
    let (mut p, mut t) = (0, 0);
    // The last star, and how far what it stands for reaches.
    let mut star: Option<(usize, usize)> = None;
    while t < text.len() {
        match pattern.get(p) {
            Some(c) if *c == any => {
                star = Some((p, t));
                p += 1;
            }
            Some(c) if *c == one || *c == text[t] => (p, t) = (p + 1, t + 1),
            _ => match &mut star {
                Some((at, reach)) => {
                    *reach += 1;
                    (p, t) = (*at + 1, *reach);
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|c| *c == any)
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
