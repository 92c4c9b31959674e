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

#[cfg(test)]
mod tests {
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
