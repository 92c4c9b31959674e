//! CSV: what is written, and what is read of others'.

use std::iter::Peekable;
use std::str::Chars;

/// A line of fields.
pub fn line(fields: &[String]) -> String {
    fields.iter().map(|text| field(text)).collect::<Vec<_>>().join(",") + "\n"
}

/// A field, in quotes where it has to be.
pub fn field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        return format!("\"{}\"", text.replace('"', "\"\""));
    }
    text.to_owned()
}

/// The fields of a line; none of an empty one.
pub fn fields(line: &str) -> Vec<String> {
    let records = records(line, ',').unwrap_or_default();
    records.into_iter().next().map(|(_, fields)| fields).unwrap_or_default()
}

/// The records of a text with the lines that they begin at. Blanks around a field are none of it unless
/// they are in quotes; lines of empty fields and those that begin with `#` are no records.
///
/// # Errors
/// A quote does not end.
pub fn records(text: &str, separator: char) -> Result<Vec<(usize, Vec<String>)>, String> {
    let (mut records, mut line) = (Vec::new(), 1);
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

/// The next field and what ends it; counts the lines in its quotes.
fn field_from(
    chars: &mut Peekable<Chars>,
    separator: char,
    line: &mut usize,
) -> Result<(String, Option<char>), String> {
    let (mut field, mut quoted) = (String::new(), 0);
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
                            let found = "found a quote that does not end, needed its other end";
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
    let (kept, rest) = field.split_at(quoted);
    let rest = if kept.is_empty() { rest.trim() } else { rest.trim_end() };
    Ok((format!("{kept}{rest}"), end))
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
    fn it_is_read_as_spreadsheets_write_it() {
        let records = |text| super::records(text, ',');
        let found =
            records("# a, \"b\na,b\r\n\r\n1,\"x, \"\"y\"\"\n2 \" \n,,\n3, 4 \n\"\",5\"").unwrap();
        let lines: Vec<usize> = found.iter().map(|(line, _)| *line).collect();
        assert_eq!(lines, [2, 4, 7, 8]);
        assert_eq!(found[1].1, ["1", "x, \"y\"\n2 "]);
        assert_eq!(found[2].1, ["3", "4"]);
        assert_eq!(found[3].1, ["", "5\""]);
        let unended = records("a,b\n1,\"2\n").unwrap_err();
        assert!(unended.starts_with("line 2: found a quote"), "{unended}");
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
