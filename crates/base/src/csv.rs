//! Reading and writing of CSV.

use std::iter::Peekable;
use std::str::Chars;

/// Formats fields as a CSV line, including the line feed.
pub fn line(fields: &[String]) -> String {
    fields.iter().map(|text| field(text)).collect::<Vec<_>>().join(",") + "\n"
}

/// Formats a CSV field, quoted if it contains a comma, a quote or a line break.
pub fn field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        return format!("\"{}\"", text.replace('"', "\"\""));
    }
    text.to_owned()
}

/// Splits a CSV line into its fields; an empty line has none.
pub fn fields(line: &str) -> Vec<String> {
    let records = records(line, ',').unwrap_or_default();
    records.into_iter().next().map(|(_, fields)| fields).unwrap_or_default()
}

/// Parses CSV text into records, each with the number of the line on which it begins.
///
/// Blanks around a field are dropped unless they are quoted. Lines whose fields are all empty and lines that
/// begin with `#` are skipped.
///
/// # Errors
/// Returns an error if a quoted field has no closing quote.
pub fn records(text: &str, separator: char) -> Result<Vec<(usize, Vec<String>)>, String> {
    let mut records = Vec::new();
    let mut line = 1;
    let mut chars = text.chars().peekable();
    while let Some(first) = chars.peek() {
        if *first == '#' {
            chars.by_ref().find(|c| *c == '\n');
            line += 1;
            continue;
        }
        let begin = line;
        let mut fields = Vec::new();
        loop {
            let (field, end) = field_from(&mut chars, separator, &mut line)?;
            fields.push(field);
            if end != Some(separator) {
                break;
            }
        }
        line += 1;
        if fields.iter().any(|field| !field.is_empty()) {
            records.push((begin, fields));
        }
    }
    Ok(records)
}

/// Reads the next field and the character that ends it (`None` at the end of the text), and advances `line`
/// by the number of quoted line breaks.
fn field_from(
    chars: &mut Peekable<Chars>,
    separator: char,
    line: &mut usize,
) -> Result<(String, Option<char>), String> {
    let mut field = String::new();
    // Length of the part of `field` that was quoted.
    let mut quoted = 0;
    let end = loop {
        match chars.next() {
            Some('"') if field.trim().is_empty() && quoted == 0 => {
                let begin = *line;
                field.clear();
                loop {
                    match chars.next() {
                        Some('"') if chars.next_if_eq(&'"').is_none() => break,
                        Some(c) => {
                            *line += usize::from(c == '\n');
                            field.push(c);
                        }
                        None => {
                            let found = "found an opening quote, needed its closing quote";
                            return Err(format!("line {begin}: {found}"));
                        }
                    }
                }
                quoted = field.len();
            }
            Some(c) if c != separator && c != '\n' => field.push(c),
            end => break end,
        }
    };
    let (quoted, rest) = field.split_at(quoted);
    let rest = if quoted.is_empty() { rest.trim() } else { rest.trim_end() };
    Ok((format!("{quoted}{rest}"), end))
}

#[cfg(test)]
mod tests {
    #[test]
    fn fields_of_a_line_survive_a_round_trip() {
        for fields in [&["a"][..], &["a, b", "c"], &["5\" disc", "x y", "\"q\", r"], &[]] {
            let quoted: Vec<String> = fields.iter().map(|text| super::field(text)).collect();
            for separator in [",", ", "] {
                assert_eq!(super::fields(&quoted.join(separator)), fields);
            }
        }
    }

    #[test]
    fn csv_written_by_spreadsheets_is_read() {
        let records = |text| super::records(text, ',');
        let found =
            records("# a, \"b\na,b\r\n\r\n1,\"x, \"\"y\"\"\n2 \" \n,,\n3, 4 \n\"\",5\"").unwrap();
        let lines: Vec<usize> = found.iter().map(|(line, _)| *line).collect();
        assert_eq!(lines, [2, 4, 7, 8]);
        assert_eq!(found[1].1, ["1", "x, \"y\"\n2 "]);
        assert_eq!(found[2].1, ["3", "4"]);
        assert_eq!(found[3].1, ["", "5\""]);
        let unended = records("a,b\n1,\"2\n").unwrap_err();
        assert!(unended.starts_with("line 2: found an opening quote"), "{unended}");
    }

    #[test]
    fn only_fields_that_would_be_misread_are_quoted() {
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
