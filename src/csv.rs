//! Lines of CSV.

/// A line of fields.
pub(crate) fn line(fields: &[String]) -> String {
    fields.iter().map(|text| field(text)).collect::<Vec<_>>().join(",") + "\n"
}

/// A field, in quotes where it has to be.
pub(crate) fn field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        return format!("\"{}\"", text.replace('"', "\"\""));
    }
    text.to_owned()
}

/// The fields of a line, which may have a blank before each; none of an empty one.
pub(crate) fn fields(line: &str) -> Vec<String> {
    let (mut fields, mut is_quoted) = (Vec::new(), false);
    let mut characters = line.chars().peekable();
    while characters.peek().is_some() {
        let mut field = String::new();
        while characters.next_if_eq(&' ').is_some() {}
        while let Some(character) = characters.next() {
            match character {
                '"' if is_quoted && characters.next_if_eq(&'"').is_some() => field.push('"'),
                '"' => is_quoted = !is_quoted,
                ',' if !is_quoted => break,
                other => field.push(other),
            }
        }
        fields.push(field);
    }
    fields
}

#[cfg(test)]
mod tests {
    #[test]
    fn fields_of_a_line_are_read_back() {
        for fields in [&["a"][..], &["a, b", "c"], &["5\" disc", "x y", "\"q\", r"], &[]] {
            let quoted: Vec<String> = fields.iter().map(|text| super::field(text)).collect();
            for separator in [",", ", "] {
                assert_eq!(super::fields(&quoted.join(separator)), fields);
            }
        }
    }

    #[test]
    fn only_fields_that_would_be_misread_are_in_quotes() {
        for (text, field) in [
            ("a b", "a b"),
            ("a, b", "\"a, b\""),
            ("5\" disc", "\"5\"\" disc\""),
            ("two\nlines", "\"two\nlines\""),
        ] {
            assert_eq!(super::field(text), field);
        }
    }
}
