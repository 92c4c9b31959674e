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

/// Formats a value and its standard error, both rounded to the decimal place of [`place`]; an error smaller than a unit
/// of this place is rounded up to it. Without a positive error, formats only the value, with four significant digits.
pub fn with_error(value: f64, error: f64) -> String {
    if !error.is_finite() || error <= 0.0 {
        return significant(value, 4);
    }
    if !value.is_finite() {
        return NONE.to_owned();
    }
    let place = place(error, value);
    format!("{} ± {}", rounded(value, place), rounded(at_least_a_unit(error, place), place))
}

/// Formats a value and its standard error in the concise notation, such as `104.31(22)`: the digits in parentheses are
/// the error in the last digits of the value. Without a positive error, formats only the value.
pub fn concise(value: f64, error: f64) -> String {
    if !(value.is_finite() && error.is_finite() && error > 0.0) {
        return with_error(value, error);
    }
    let place = place(error, value);
    let last = (at_least_a_unit(error, place) * 10_f64.powi(place.max(0))).round();
    let error = if place < 0 { rounded(last, place) } else { fixed(last, 0) };
    format!("{}({error})", rounded(value, place))
}

/// Returns the error, or a unit of the decimal place if that is larger.
fn at_least_a_unit(error: f64, place: i32) -> f64 {
    error.max(10_f64.powi(-place))
}

/// Maximum number of significant digits of a value with an uncertainty. The scale of a calibrated camera system is not
/// known more accurately, however little the trials scatter.
const MAX_DIGITS: i32 = 5;

/// Returns the decimal place to which a value and its uncertainty are rounded, as a number of decimals: that of the
/// second significant digit of the uncertainty (GUM 7.2.6), but at most that of the digit [`MAX_DIGITS`] of the value;
/// without a positive uncertainty, that of the fourth significant digit of the value. The number is negative for places
/// left of the decimal point.
pub fn place(uncertainty: f64, value: f64) -> i32 {
    if !uncertainty.is_finite() || uncertainty <= 0.0 {
        return i32::try_from(decimals(value, 4)).expect("at most 12");
    }
    // The rounded number determines the place, because 0.0996 is rounded to 0.10.
    let rounded = format!("{uncertainty:.1e}");
    let power = rounded.split_once('e').and_then(|(_, power)| power.parse::<i32>().ok());
    let of_error = 1 - power.expect("an exponent");
    let of_value = match value.abs().log10() {
        power if power.is_finite() => MAX_DIGITS - 1 - power.floor() as i32,
        _ => of_error,
    };
    of_error.min(of_value).clamp(-12, 12)
}

/// Formats a number rounded to a decimal place, such as one returned by [`place`].
pub fn rounded(value: f64, place: i32) -> String {
    match usize::try_from(place) {
        Ok(decimals) => fixed(value, decimals),
        Err(_) => {
            let unit = 10_f64.powi(-place);
            fixed((value / unit).round() * unit, 0)
        }
    }
}

/// Formats a confidence interval for a positive quantity, with `0` or `∞` in place of an open limit; empty if
/// both limits are open.
pub fn interval(limits: [f64; 2], digits: i32) -> String {
    between(limits, |limit| significant(limit, digits))
}

/// Formats a confidence interval like [`interval`], with both limits rounded to a decimal place.
pub fn interval_to(limits: [f64; 2], place: i32) -> String {
    between(limits, |limit| rounded(limit, place))
}

fn between([low, high]: [f64; 2], number: impl Fn(f64) -> String) -> String {
    if !low.is_finite() && !high.is_finite() {
        return String::new();
    }
    let low = if low.is_finite() { number(low) } else { "0".to_owned() };
    let high = if high.is_finite() { number(high) } else { "∞".to_owned() };
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
        let of = [(104.3128, 0.2177), (58.42, 1.31), (12_345.6, 1234.0), (-0.5, f64::NAN)];
        let texts = of.map(|(value, error)| concise(value, error));
        assert_eq!(texts, ["104.31(22)", "58.4(13)", "12300(1200)", "\u{2212}0.5000"]);
        assert_eq!(with_error(12_345.6, 1234.0), "12300 ± 1200");
        assert_eq!(with_error(1.234_56, 0.0996), "1.23 ± 0.10");
        assert_eq!(interval_to([98.413, f64::INFINITY], place(2.1, 104.2)), "98.4 to ∞");
        assert_eq!(rounded(104.21, place(f64::NAN, 104.21)), "104.2");
        assert_eq!(with_error(f64::NAN, 0.1), NONE);
        // Five digits at most.
        assert_eq!(with_error(271.0548, 0.0044), "271.05 ± 0.01");
        assert_eq!(concise(271.0548, 0.0044), "271.05(1)");
        assert_eq!(with_error(0.500_000_49, 7.6e-7), "0.50000 ± 0.00001");
        assert_eq!(with_error(-1_234_567.0, 3.0), "\u{2212}1234600 ± 100");
        assert_eq!(with_error(0.0, 3.21e-7), "0.00000000 ± 0.00000032");
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
