//! Formatting of numbers for human readers.

/// Text shown in place of a missing number.
pub const NONE: &str = "–";
const MINUS: &str = "\u{2212}";

/// Formats a number with `decimals` digits after the decimal point; [`NONE`] if it is not finite.
pub fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return NONE.to_owned();
    }
    /// Magnitude from which numbers are formatted with an exponent, because a double of that size has no exact
    /// decimals.
    const MAX_FIXED: f64 = 1e15;
    let text = if value.abs() < MAX_FIXED {
        format!("{value:.decimals$}")
    } else {
        format!("{value:.3e}")
    };
    match text.strip_prefix('-') {
        Some(zero) if zero.bytes().all(|byte| b"0.".contains(&byte)) => zero.to_owned(),
        Some(positive) => format!("{MINUS}{positive}"),
        None => text,
    }
}

/// Formats a number with `digits` significant digits, or with all digits of its integer part if these are
/// more.
pub fn significant(value: f64, digits: i32) -> String {
    fixed(value, decimals(value, digits))
}

/// Formats a number as in a configuration file: with four significant digits and without trailing zeros.
pub fn as_configured(value: f64) -> String {
    let text = significant(value, 4);
    if !text.contains('.') {
        return text;
    }
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Formats a number briefly: nonzero integers without decimals, magnitudes below 1e-4 with an exponent, and all other
/// numbers with four significant digits; [`NONE`] if the number is missing.
pub fn short(value: Option<f64>) -> String {
    match value.unwrap_or(f64::NAN) {
        value if (value - value.round()).abs() < 1e-9 && value.round() != 0.0 => fixed(value, 0),
        value if value != 0.0 && value.abs() < 1e-4 => format!("{value:.0e}"),
        value => significant(value, 4),
    }
}

/// Formats a value and its standard error, both rounded to the second significant digit of the error. Without a
/// positive error, formats only the value, with four significant digits.
pub fn with_error(value: f64, error: f64) -> String {
    if !error.is_finite() || error <= 0.0 {
        return significant(value, 4);
    }
    if !value.is_finite() {
        return NONE.to_owned();
    }
    let decimals = decimals(error, 2).min(6);
    format!("{} ± {}", fixed(value, decimals), fixed(error, decimals))
}

/// Formats a confidence interval for a positive quantity, with `0` or `∞` in place of an open limit; empty if
/// both limits are open.
pub fn interval([low, high]: [f64; 2], digits: i32) -> String {
    if !low.is_finite() && !high.is_finite() {
        return String::new();
    }
    let low = if low.is_finite() { significant(low, digits) } else { "0".to_owned() };
    let high = if high.is_finite() { significant(high, digits) } else { "∞".to_owned() };
    format!("{low} to {high}")
}

/// Formats the relative difference between `found` and `truth` as a signed percentage.
pub fn percent(found: f64, truth: f64) -> String {
    let percent = 100.0 * (found / truth - 1.0);
    let sign = if percent > 0.0 && percent.is_finite() { "+" } else { "" };
    in_percent(format!("{sign}{}", fixed(percent, 2)))
}

/// Formats a fraction as a percentage.
pub fn share(part: f64) -> String {
    in_percent(fixed(100.0 * part, 1))
}

fn in_percent(text: String) -> String {
    if text == NONE { text } else { format!("{text} %") }
}

/// Returns the number of decimals that give a number `digits` significant digits.
pub fn decimals(value: f64, digits: i32) -> usize {
    if value == 0.0 || !value.is_finite() {
        return 0;
    }
    let power = value.abs().log10().floor() as i32;
    (digits - 1 - power).clamp(0, 12) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_their_errors_allow() {
        assert_eq!(with_error(104.3128, 0.2177), "104.31 ± 0.22");
        assert_eq!(with_error(437.2, 12.4), "437 ± 12");
        assert_eq!(with_error(104.3128, f64::NAN), "104.3");
        assert_eq!(with_error(f64::NAN, 0.1), NONE);
    }

    #[test]
    fn configured_numbers_are_printed_as_short_as_they_were_written() {
        let texts = [0.6, 1000.0, 0.188, 104.0, 0.0].map(as_configured);
        assert_eq!(texts, ["0.6", "1000", "0.188", "104", "0"]);
        assert_eq!(significant(0.6, 4), "0.6000");
    }

    #[test]
    fn a_negative_zero_has_no_sign() {
        assert_eq!(fixed(-0.001, 2), "0.00");
        assert_eq!(fixed(-1.5, 1), "\u{2212}1.5");
        assert_eq!(percent(1.0, 1.0), "0.00 %");
        assert_eq!(percent(1.01, 1.0), "+1.00 %");
        assert_eq!(percent(1.0, 0.0), NONE);
    }
}
