//! Numbers as people read them.

/// Stands where there is no number.
pub const NONE: &str = "–";
const MINUS: &str = "\u{2212}";

/// A number with `decimals` digits after the point.
pub fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return NONE.to_owned();
    }
    /// From here on the decimals of a number are not its own.
    const LONG: f64 = 1e15;
    let text = match value.abs() < LONG {
        true => format!("{value:.decimals$}"),
        false => format!("{value:.3e}"),
    };
    match text.strip_prefix('-') {
        Some(zero) if zero.bytes().all(|byte| b"0.".contains(&byte)) => zero.to_owned(),
        Some(positive) => format!("{MINUS}{positive}"),
        None => text,
    }
}

/// A number with `digits` significant digits, never fewer than its whole part has.
pub fn significant(value: f64, digits: i32) -> String {
    fixed(value, decimals(value, digits))
}

/// A number that a person wrote: four significant digits, without zeros at the end.
pub fn as_configured(value: f64) -> String {
    let text = significant(value, 4);
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

/// Four significant digits, a whole number as such, and a power of ten for next to nothing.
pub fn short(value: Option<f64>) -> String {
    match value.unwrap_or(f64::NAN) {
        value if (value - value.round()).abs() < 1e-9 && value.round() != 0.0 => fixed(value, 0),
        value if value != 0.0 && value.abs() < 1e-4 => format!("{value:.0e}"),
        value => significant(value, 4),
    }
}

/// A value with its standard error, both to the error's second digit.
pub fn with_error(value: f64, error: f64) -> String {
    if !error.is_finite() || error <= 0.0 {
        return significant(value, 4);
    }
    let decimals = decimals(error, 2).min(6);
    match value.is_finite() {
        true => format!("{} ± {}", fixed(value, decimals), fixed(error, decimals)),
        false => NONE.to_owned(),
    }
}

/// A 95 % confidence interval of a positive number, `0` or `∞` where it is open; empty where it is
/// open on both sides.
pub fn interval([low, high]: [f64; 2], digits: i32) -> String {
    let text = |limit: f64, open: &str| match limit.is_finite() {
        true => significant(limit, digits),
        false => open.to_owned(),
    };
    match low.is_finite() || high.is_finite() {
        true => format!("{} to {}", text(low, "0"), text(high, "∞")),
        false => String::new(),
    }
}

/// A relative difference in per cent, with its sign.
pub fn percent(found: f64, truth: f64) -> String {
    let percent = 100.0 * (found / truth - 1.0);
    let sign = if percent > 0.0 && percent.is_finite() { "+" } else { "" };
    in_percent(format!("{sign}{}", fixed(percent, 2)))
}

/// A part of a whole in per cent.
pub fn share(part: f64) -> String {
    in_percent(fixed(100.0 * part, 1))
}

fn in_percent(text: String) -> String {
    if text == NONE { text } else { format!("{text} %") }
}

/// Digits after the point of a number with `digits` significant ones.
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
    fn configured_numbers_are_as_short_as_they_were_written() {
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
