//! Parsing of numbers on the command line.

/// Numbers that one value of an option lists, such as the frequencies in `--omega 3.9,4`.
pub(super) type NumberList = Vec<f64>;

/// Parses a finite number; returns `None` if the text is not one.
pub(super) fn finite(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|value: &f64| value.is_finite())
}

/// Parses a finite number above 0; returns `None` if the text is not one.
pub(super) fn positive(text: &str) -> Option<f64> {
    finite(text).filter(|number| *number > 0.0)
}

/// Parses a range `LOW..HIGH`; returns `None` if it is invalid.
pub(super) fn low_high(text: &str) -> Option<[f64; 2]> {
    let (low, high) = text.split_once("..")?;
    Some([finite(low)?, finite(high)?])
}

/// Returns a parser for numbers from `low` to `high`; its error message adds `unit` to the limits.
pub(super) fn within(
    low: f64,
    high: f64,
    unit: &'static str,
) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| {
        let needed = || format!("found `{text}`, needed a number from {low} to {high}{unit}");
        text.parse().ok().filter(|number| (low..=high).contains(number)).ok_or_else(needed)
    }
}

/// Parses frequencies (rad/s): a list such as `3.9,4`, or a range such as `0.5..6/12`, twelve from 0.5 to 6.
pub(super) fn parse_omegas(text: &str) -> Result<NumberList, String> {
    parse_numbers(text, "a frequency")
}

/// Parses a list or range of positive numbers. Error messages refer to each number as `what`, such as "a frequency".
pub(super) fn parse_numbers(text: &str, what: &str) -> Result<NumberList, String> {
    let mut omegas = Vec::new();
    for part in text.split(',') {
        let Some((low, rest)) = part.split_once("..") else {
            omegas.push(parse_number(part, what)?);
            continue;
        };
        let needed = || format!("found `{part}`, needed LOW..HIGH/COUNT, such as 0.5..6/12");
        let (high, count) = rest.split_once('/').ok_or_else(needed)?;
        let low = parse_number(low, what)?;
        let high = parse_number(high, what)?;
        let count: usize = count.trim().parse().map_err(|_| needed())?;
        if !(2..=100_000).contains(&count) {
            return Err(format!("found {count} numbers, needed 2 to 100000"));
        }
        omegas.extend((0..count).map(|i| {
            let omega = low + (high - low) * i as f64 / (count - 1) as f64;
            // Rounding gives 0.7 instead of 0.7000000000000001.
            let rounded = (omega * 1e12).round() / 1e12;
            if rounded > 0.0 { rounded } else { omega }
        }));
    }
    Ok(omegas)
}

/// Parses a positive number. Error messages refer to it as `what`.
fn parse_number(text: &str, what: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        Ok(number) => Err(format!("found {number}, needed {what} above 0")),
        Err(_) => Err(format!("found `{text}`, needed a number")),
    }
}

#[cfg(test)]
mod tests {
    use super::parse_omegas;

    #[test]
    fn lists_and_ranges_are_frequencies() {
        assert_eq!(parse_omegas("3.9,4").unwrap(), [3.9, 4.0]);
        assert_eq!(parse_omegas("1..2/3,6").unwrap(), [1.0, 1.5, 2.0, 6.0]);
        assert_eq!(parse_omegas("0.5..1.1/4").unwrap(), [0.5, 0.7, 0.9, 1.1]);
    }

    #[test]
    fn an_invalid_frequency_is_reported() {
        for (text, named) in [
            ("x", "found `x`, needed a number"),
            ("-1", "found -1, needed a frequency above 0"),
            ("1..2", "found `1..2`, needed LOW..HIGH/COUNT"),
            ("1..2/1", "found 1 numbers, needed 2 to 100000"),
        ] {
            let message = parse_omegas(text).err().unwrap();
            assert!(message.contains(named), "{message}");
        }
    }
}
