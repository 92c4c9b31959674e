//! Ranges and ticks that read well.

/// From where to where an axis goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    pub low: f64,
    pub high: f64,
}

/// Values that a panel shows.
#[derive(Debug, Clone, Default)]
pub struct Shown {
    /// Ends of the measurements' error bars.
    pub measured: Vec<f64>,
    pub modelled: Vec<f64>,
}

/// A model further above the measurements than this would flatten them.
const FARTHEST_MODEL: f64 = 1.5;
/// Where everything lies above this part of the greatest value, an axis from zero would
/// show little but white.
const NEED_NOT_SHOW_ZERO: f64 = 0.5;
const HEADROOM: f64 = 0.06;

/// The vertical range: all measurements, and the models as far as they leave these readable.
pub fn vertical(shown: &Shown, from_zero: bool) -> Range {
    let highest = |values: &[f64]| values.iter().copied().fold(f64::NAN, f64::max);
    let measured = highest(&shown.measured);
    let ceiling = if measured > 0.0 { FARTHEST_MODEL * measured } else { f64::INFINITY };
    let values: Vec<f64> = shown
        .measured
        .iter()
        .chain(shown.modelled.iter().filter(|&&value| value <= ceiling))
        .copied()
        .collect();
    let (low, high) = (values.iter().copied().fold(f64::NAN, f64::min), highest(&values));
    if !(low.is_finite() && high.is_finite()) {
        return Range { low: 0.0, high: 1.0 };
    }
    let needs_zero = from_zero || low < NEED_NOT_SHOW_ZERO * high;
    if needs_zero && low >= 0.0 {
        let high = if high > 0.0 { high } else { 1.0 };
        return Range { low: 0.0, high: high * (1.0 + HEADROOM) };
    }
    let span = (high - low).max(0.02 * high.abs().max(low.abs())).max(f64::MIN_POSITIVE);
    Range { low: low - 2.0 * HEADROOM * span, high: high + 2.0 * HEADROOM * span }
}

/// The horizontal range: from zero if the frequencies come near it.
pub fn horizontal(values: &[f64]) -> Range {
    let low = values.iter().copied().fold(f64::NAN, f64::min);
    let high = values.iter().copied().fold(f64::NAN, f64::max);
    if !(low.is_finite() && high.is_finite()) {
        return Range { low: 0.0, high: 1.0 };
    }
    let span = if high > low { high - low } else { 0.2 * high.abs().max(1.0) };
    let margin = 0.05 * span;
    let start = if low >= 0.0 && low < 0.4 * high { 0.0 } else { low - margin };
    Range { low: start, high: high + margin }
}

/// Round values within a range, and their text.
pub fn ticks(range: Range, about: f64) -> Vec<(f64, String)> {
    let rough = (range.high - range.low) / about;
    let power = rough.log10().floor();
    let unit = 10_f64.powf(power);
    let step = [1.0, 2.0, 2.5, 5.0, 10.0]
        .into_iter()
        .map(|factor| factor * unit)
        .find(|step| *step >= rough * 0.999)
        .unwrap_or(10.0 * unit);
    let decimals = (0..9).find(|&n| is_whole(step * 10_f64.powi(n))).unwrap_or(9) as usize;
    let first = (range.low / step - 1e-9).ceil() as i64;
    let last = (range.high / step + 1e-9).floor() as i64;
    (first..=last)
        .map(|n| {
            let value = n as f64 * step;
            (value, format!("{value:.decimals$}").replace('-', "\u{2212}"))
        })
        .collect()
}

fn is_whole(value: f64) -> bool {
    (value - value.round()).abs() < 1e-6 * value.abs().max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(low: f64, high: f64) -> Vec<String> {
        ticks(Range { low, high }, 5.0).into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round_numbers_with_the_digits_they_need() {
        assert_eq!(labels(0.0, 6.3), ["0", "2", "4", "6"]);
        assert_eq!(labels(0.0, 0.052), ["0.00", "0.02", "0.04"]);
        assert_eq!(labels(-1.0, 1.0), ["\u{2212}1.0", "\u{2212}0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(labels(395.0, 505.0), ["400", "425", "450", "475", "500"]);
    }

    #[test]
    fn a_model_far_above_the_measurements_does_not_flatten_them() {
        let shown = Shown { measured: vec![100.0, 500.0], modelled: vec![90.0, 700.0, 2000.0] };
        let range = vertical(&shown, false);
        assert_eq!(range.low, 0.0);
        assert!(range.high > 700.0 && range.high < 800.0, "{range:?}");
    }

    #[test]
    fn values_close_together_do_not_start_at_zero_unless_asked() {
        let shown = Shown { measured: vec![425.0, 490.0], modelled: vec![] };
        assert!(vertical(&shown, false).low > 380.0);
        assert_eq!(vertical(&shown, true).low, 0.0);
    }

    #[test]
    fn one_value_and_none_still_have_a_range() {
        for values in [vec![], vec![0.0], vec![3.0]] {
            let shown = Shown { measured: values.clone(), modelled: vec![] };
            let (y, x) = (vertical(&shown, false), horizontal(&values));
            assert!(y.high > y.low && x.high > x.low, "{values:?}");
            assert!(!ticks(y, 5.0).is_empty());
        }
    }
}
