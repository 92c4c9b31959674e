//! Range, ticks and scale of a plot axis.

use plotters::coord::ranged1d::{
    BoldPoints, KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter,
};
use plotters::coord::types::RangedCoordf64;
use trilink_base::numbers;
use trilink_statistics::extremes;

use super::style::text_width;

/// Closed interval of values.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Range {
    pub low: f64,
    pub high: f64,
}

impl Range {
    pub fn span(self) -> f64 {
        self.high - self.low
    }

    pub fn contains(self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// Returns the smallest range that contains all drawable values; `None` if there are none.
    pub fn enclosing(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let [low, high] = extremes(values.into_iter().filter(|value| value.abs() <= MAX_VALUE));
        (low <= high).then_some(Self { low, high })
    }
}

/// Scale of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub enum Scale {
    /// Linear; begins at zero if the smallest value is near zero relative to the largest.
    #[default]
    Linear,
    /// Linear; begins at zero unless there are negative values.
    FromZero,
    /// Linear, with ticks at integers.
    Whole,
    /// Linear, with the same length per unit as the other axis (equal aspect ratio).
    Equal,
    /// Logarithmic if all values are positive and span a large ratio, otherwise linear.
    Decades,
}

/// Minimum ratio of the largest to the smallest value on a logarithmic axis.
const MIN_LOGARITHMIC_RATIO: f64 = 5.0;
/// Ratio of the smallest to the largest value below which a linear axis begins at zero.
const NEAR_ZERO: f64 = 0.5;
/// Margin on either side of the values, as a fraction of their span.
const MARGIN: f64 = 0.05;
/// Number of ticks by which an axis may exceed its maximum number of ticks in order to have at least two.
const MAX_EXTRA_TICKS: usize = 3;
/// Minimum span of an axis relative to its largest value, so that tiny differences do not fill the axis.
const MIN_SPAN: f64 = 1e-3;
/// Maximum magnitude of a drawable value; beyond it, spans and pixels would not be finite.
const MAX_VALUE: f64 = 1e100;
/// Minimum difference between distinct values; below it, spans and pixels would not be finite.
const MIN_DIFFERENCE: f64 = 1e-100;

/// Axis whose coordinates are the values, or their decimal logarithms if it is logarithmic.
#[derive(Debug, Clone)]
pub(crate) struct Axis {
    pub is_logarithmic: bool,
    is_whole: bool,
    pub range: Range,
    pub ticks: Vec<f64>,
    /// Tick labels to use in place of numbers, each with its position.
    names: Vec<(f64, String)>,
}

impl Axis {
    /// Returns a linear axis over `range` without ticks.
    pub(crate) fn linear(range: Range) -> Self {
        let is_logarithmic = false;
        Self { is_logarithmic, is_whole: false, range, ticks: Vec::new(), names: Vec::new() }
    }

    /// Returns an axis that covers all drawable values or, if `shown` is given, only those within this range.
    pub(crate) fn new(values: &[f64], shown: Option<Range>, scale: Scale) -> Self {
        let values = values.iter().copied();
        let values = values.filter(|value| shown.is_none_or(|shown| shown.contains(*value)));
        let Some(Range { mut low, mut high }) = Range::enclosing(values) else {
            return Self::linear(Range { low: 0.0, high: 1.0 });
        };
        let is_logarithmic =
            scale == Scale::Decades && low > 0.0 && high > MIN_LOGARITHMIC_RATIO * low;
        let is_near_zero = scale == Scale::Linear && low < NEAR_ZERO * high;
        let from_zero = low >= 0.0 && (is_near_zero || scale == Scale::FromZero);
        if is_logarithmic {
            low = low.log10();
            high = high.log10();
        } else if from_zero {
            low = 0.0;
        }
        let span = (high - low).max(MIN_SPAN * high.abs());
        let span = if span < MIN_DIFFERENCE { 1.0 } else { span };
        let margin = MARGIN * span + 0.5 * (span - (high - low));
        let low = if from_zero { 0.0 } else { low - margin };
        let is_whole = scale == Scale::Whole;
        Self { is_logarithmic, is_whole, ..Self::linear(Range { low, high: high + margin }) }
    }

    /// Sets named ticks, which must be in ascending order. If there are any, the axis has no other ticks.
    pub(crate) fn named(self, names: &[(f64, String)]) -> Self {
        let within = names.iter().filter(|(tick, _)| self.range.contains(*tick));
        Self { names: within.cloned().collect(), ..self }
    }

    fn name(&self, tick: f64) -> Option<&str> {
        let index = self.names.binary_search_by(|(known, _)| known.total_cmp(&tick)).ok()?;
        Some(&self.names[index].1)
    }

    /// Makes one unit equally long on both axes, which are `width` and `height` px long, by extending the
    /// range of one axis.
    pub(crate) fn equalise(x: &mut Self, y: &mut Self, width: f64, height: f64) {
        let coarser = (x.range.span() / width).max(y.range.span() / height);
        for (axis, length) in [(x, width), (y, height)] {
            let midpoint = 0.5 * (axis.range.low + axis.range.high);
            let half = 0.5 * coarser * length;
            axis.range = Range { low: midpoint - half, high: midpoint + half };
        }
    }

    /// Sets at most `max_ticks` ticks, and so few that, according to `have_room`, their labels fit. At least two ticks
    /// are set if possible, even if that takes slightly more than `max_ticks`.
    pub(crate) fn set_ticks(&mut self, max_ticks: usize, have_room: impl Fn(&Self) -> bool) {
        let ticks = match (self.names.is_empty(), self.is_logarithmic) {
            (false, _) => Self::named_ticks,
            (true, true) => Self::logarithmic_ticks,
            (true, false) => Self::linear_ticks,
        };
        let mut maxima = max_ticks..max_ticks + MAX_EXTRA_TICKS;
        let max_ticks = maxima.find(|max| ticks(self, *max).len() > 1).unwrap_or(max_ticks);
        for max_ticks in (1..=max_ticks).rev() {
            let found = ticks(self, max_ticks);
            let is_last = found.len() < 2 && self.ticks.len() > 1;
            if !is_last {
                self.ticks = found;
            }
            let are_valid = !self.is_whole || self.ticks.iter().all(|tick| tick.fract() == 0.0);
            if is_last || are_valid && have_room(self) {
                break;
            }
        }
    }

    /// Returns the width of the widest tick label, px.
    pub(crate) fn label_width(&self) -> f64 {
        let widths = self.ticks.iter().map(|tick| text_width(&self.format_ext(tick)));
        widths.fold(0.0, f64::max)
    }

    fn named_ticks(&self, max_ticks: usize) -> Vec<f64> {
        let every = self.names.len().div_ceil(max_ticks);
        self.names.iter().step_by(every).map(|(tick, _)| *tick).collect()
    }

    fn linear_ticks(&self, max_ticks: usize) -> Vec<f64> {
        // Plotters compares numbers with an absolute tolerance of 2e-16, so extreme numbers must be scaled
        // first.
        let unit = 10_f64.powf(self.range.span().log10().floor());
        let unit = if (1e-9..1e9).contains(&unit) { 1.0 } else { unit };
        let range = RangedCoordf64::from(self.range.low / unit..self.range.high / unit);
        range.key_points(BoldPoints(max_ticks)).into_iter().map(|tick| unit * tick).collect()
    }

    /// Returns ticks at 1, 2 and 5 times powers of ten, or only at powers of ten if there would be too many.
    /// Plotters itself offers only powers of ten, which many axes do not contain.
    fn logarithmic_ticks(&self, max_ticks: usize) -> Vec<f64> {
        let fine = self.decade_ticks(&[1.0, 2.0, 5.0]);
        let ticks = if fine.len() <= max_ticks { fine } else { self.decade_ticks(&[1.0]) };
        let every = ticks.len().div_ceil(max_ticks).max(1);
        ticks.into_iter().step_by(every).collect()
    }

    /// Returns ticks at powers of ten multiplied by each of `factors`, within the range of the axis.
    fn decade_ticks(&self, factors: &[f64]) -> Vec<f64> {
        let mut ticks = Vec::new();
        for power in (self.range.low.floor() as i32)..=(self.range.high.ceil() as i32) {
            ticks.extend(factors.iter().map(|factor| factor.log10() + f64::from(power)));
        }
        ticks.retain(|tick| self.range.contains(*tick));
        ticks
    }

    /// Converts a value to a coordinate of the axis; NaN if the value cannot be drawn.
    pub(crate) fn scaled(&self, value: f64) -> f64 {
        let value = if value.abs() <= MAX_VALUE { value } else { f64::NAN };
        if self.is_logarithmic { value.log10() } else { value }
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let fraction = (value - self.range.low) / self.range.span();
        from + (fraction * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.range.low..self.range.high
    }
}

impl ValueFormatter<f64> for Axis {
    /// Formats a tick with as many decimals as the tick that needs most.
    fn format_ext(&self, tick: &f64) -> String {
        if let Some(name) = self.name(*tick) {
            // Neighbouring ticks with the same name show the name only once.
            let before = self.ticks.iter().rev().find(|before| *before < tick);
            let is_new = before.is_none_or(|before| self.name(*before) != Some(name));
            return if is_new { name.to_owned() } else { String::new() };
        }
        let value = if self.is_logarithmic { 10_f64.powf(*tick) } else { *tick };
        let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
        let [low, high] = extremes(self.ticks.iter().copied());
        let largest = if self.is_logarithmic { rounded } else { high.max(-low) };
        if largest > 0.0 && !(1e-3..1e7).contains(&largest) {
            if rounded == 0.0 {
                return "0".to_owned();
            }
            return format!("{rounded:e}").replace('-', "\u{2212}");
        }
        if self.is_logarithmic {
            return rounded.to_string();
        }
        let is_whole = |value: f64| (value - value.round()).abs() < 1e-6 * value.abs().max(1.0);
        let are_whole = |n: &i32| self.ticks.iter().all(|tick| is_whole(tick * 10_f64.powi(*n)));
        numbers::fixed(*tick, (0..9).find(are_whole).unwrap_or(9) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(low: f64, high: f64) -> Vec<String> {
        let mut axis = Axis::linear(Range { low, high });
        axis.set_ticks(6, |_| true);
        axis.ticks.iter().map(|tick| axis.format_ext(tick)).collect()
    }

    #[test]
    fn ticks_are_round_numbers_with_the_digits_they_need() {
        assert_eq!(labels(0.0, 6.3), ["0", "2", "4", "6"]);
        assert_eq!(labels(0.0, 0.052), ["0.00", "0.01", "0.02", "0.03", "0.04", "0.05"]);
        assert_eq!(labels(-1.0, 1.0), ["\u{2212}1.0", "\u{2212}0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(labels(395.0, 505.0), ["400", "420", "440", "460", "480", "500"]);
    }

    #[test]
    fn ticks_of_a_logarithmic_axis_divide_decades() {
        let mut axis = Axis::new(&[20.0, 130.0], None, Scale::Decades);
        axis.set_ticks(5, |_| true);
        let labels: Vec<String> = axis.ticks.iter().map(|tick| axis.format_ext(tick)).collect();
        assert_eq!(labels, ["20", "50", "100"]);
    }

    #[test]
    fn named_ticks_are_at_the_positions_of_their_names() {
        let names = ["1 Nov", "1 Nov", "2 Nov", "3 Nov"];
        let names: Vec<(f64, String)> =
            (1..).map(f64::from).zip(names.map(str::to_owned)).collect();
        for (last, expected) in [(1, &["1 Nov"][..]), (4, &["1 Nov", "", "2 Nov", "3 Nov"])] {
            let values: Vec<f64> = (1..=last).map(f64::from).collect();
            let mut axis = Axis::new(&values, None, Scale::Whole).named(&names[..last as usize]);
            axis.set_ticks(6, |_| true);
            let labels: Vec<String> = axis.ticks.iter().map(|tick| axis.format_ext(tick)).collect();
            assert_eq!(labels, expected);
        }
        let mut axis = Axis::new(&[3.0, 4.0], None, Scale::Whole).named(&names);
        axis.set_ticks(6, |_| true);
        assert_eq!(axis.ticks, [3.0, 4.0], "the others are not on the axis");
    }

    #[test]
    fn ticks_of_counts_are_integers() {
        for last in 2..40 {
            let mut axis = Axis::new(&[1.0, f64::from(last)], None, Scale::Whole);
            axis.set_ticks(5, |_| true);
            assert!(axis.ticks.iter().all(|tick| tick.fract() == 0.0), "{:?}", axis.ticks);
            assert!(axis.ticks.len() > 1, "{last}: {:?}", axis.ticks);
        }
        assert_eq!(
            labels(0.0, 0.00021),
            ["0", "5e\u{2212}5", "1e\u{2212}4", "1.5e\u{2212}4", "2e\u{2212}4"]
        );
    }

    #[test]
    fn values_close_together_do_not_start_at_zero_unless_asked() {
        let low = |scale| Axis::new(&[425.0, 490.0], None, scale).range.low;
        assert!(low(Scale::Linear) > 380.0);
        assert_eq!(low(Scale::FromZero), 0.0);
    }

    #[test]
    fn a_single_value_and_none_have_a_range() {
        for values in [vec![], vec![0.0], vec![3.0]] {
            for scale in [Scale::Linear, Scale::FromZero, Scale::Equal, Scale::Decades] {
                let mut axis = Axis::new(&values, None, scale);
                axis.set_ticks(5, |_| true);
                assert!(axis.range.span() > 0.0 && !axis.ticks.is_empty(), "{values:?}");
            }
        }
    }

    #[test]
    fn a_metre_is_as_long_along_both_axes() {
        let [mut x, mut y] =
            [[0.0, 4.0], [-0.1, 0.1]].map(|values| Axis::new(&values, None, Scale::Equal));
        let width = 300.0;
        let height = 100.0;
        Axis::equalise(&mut x, &mut y, width, height);
        let metre = |axis: &Axis, length: f64| length / axis.range.span();
        assert!((metre(&x, width) - metre(&y, height)).abs() < 1e-9);
        assert!(x.range.contains(4.0) && y.range.contains(0.1) && y.range.contains(-0.1));
    }

    #[test]
    fn values_outside_the_shown_range_do_not_stretch_the_axis() {
        let shown = Some(Range { low: -5.0, high: 5.0 });
        let axis = Axis::new(&[-1.0, 1.0, 400.0], shown, Scale::Linear);
        assert!(axis.range.high > 1.0 && axis.range.high < 1.2);
    }
}
