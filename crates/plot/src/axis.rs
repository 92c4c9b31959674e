//! The limits, the ticks and the scale of an axis.

use plotters::coord::ranged1d::{
    BoldPoints, KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter,
};
use plotters::coord::types::RangedCoordf64;
use trilink_base::numbers;
use trilink_statistics::extremes;

use super::style::text_width;

/// From where to where an axis goes.
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

    /// From the least of the values that can be drawn to the greatest.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let [low, high] = extremes(values.into_iter().filter(|value| value.abs() <= LARGEST));
        (low <= high).then_some(Self { low, high })
    }
}

/// How an axis divides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub enum Scale {
    /// Linear, from zero if the values come near it.
    #[default]
    Linear,
    /// Linear from zero, unless there are values below.
    FromZero,
    /// Linear, with ticks at whole numbers.
    Whole,
    /// Linear, and a unit is as long as on the other axis.
    Equal,
    /// Logarithmic where positive values go over decades.
    Decades,
}

/// From this ratio of its ends on an axis of positive values is logarithmic.
const LOGARITHMIC: f64 = 5.0;
/// Where all values lie above this part of the greatest one, an axis from zero would show little
/// but white.
const NEAR_ZERO: f64 = 0.5;
/// Part of the values' extent that is left free on either side of them.
const MARGIN: f64 = 0.05;
/// How many ticks more than there should be an axis may have so that it has two.
const SOME_MORE: usize = 3;
/// Of the greatest value: smaller differences are not spread over the axis.
const LEAST_SPAN: f64 = 1e-3;
/// Farther from zero nothing is drawn, and with less between them values are one: beyond, spans
/// and pixels are no numbers.
const LARGEST: f64 = 1e100;
const SMALLEST: f64 = 1e-100;

/// An axis. Its coordinates are values, of a logarithmic one their decimal logarithms.
#[derive(Debug, Clone)]
pub(crate) struct Axis {
    pub is_logarithmic: bool,
    is_whole: bool,
    pub range: Range,
    pub ticks: Vec<f64>,
    /// What ticks are called, if not by their numbers.
    names: Vec<(f64, String)>,
}

impl Axis {
    /// An axis without ticks.
    pub(crate) fn linear(range: Range) -> Self {
        let (ticks, names) = (Vec::new(), Vec::new());
        Self { is_logarithmic: false, is_whole: false, range, ticks, names }
    }

    /// An axis with room for all finite values, or for those within `shown`.
    pub(crate) fn new(values: &[f64], shown: Option<Range>, scale: Scale) -> Self {
        let is_shown = |value: &f64| shown.is_none_or(|shown| shown.contains(*value));
        let Some(extent) = Range::of(values.iter().copied().filter(is_shown)) else {
            return Self::linear(Range { low: 0.0, high: 1.0 });
        };
        let Range { low, high } = extent;
        let is_logarithmic = scale == Scale::Decades && low > 0.0 && high > LOGARITHMIC * low;
        let is_near_zero = scale == Scale::Linear && low < NEAR_ZERO * high;
        let from_zero = low >= 0.0 && (is_near_zero || scale == Scale::FromZero);
        let (low, high) = match is_logarithmic {
            true => (low.log10(), high.log10()),
            false => (if from_zero { 0.0 } else { low }, high),
        };
        let span = (high - low).max(LEAST_SPAN * high.abs());
        let span = if span < SMALLEST { 1.0 } else { span };
        let margin = MARGIN * span + 0.5 * (span - (high - low));
        let low = if from_zero { 0.0 } else { low - margin };
        let is_whole = scale == Scale::Whole;
        Self { is_logarithmic, is_whole, ..Self::linear(Range { low, high: high + margin }) }
    }

    /// It with names of ticks, in order; there are no others, if there are any.
    pub(crate) fn named(self, names: &[(f64, String)]) -> Self {
        let within = names.iter().filter(|(tick, _)| self.range.contains(*tick));
        Self { names: within.cloned().collect(), ..self }
    }

    fn name(&self, tick: f64) -> Option<&str> {
        let index = self.names.binary_search_by(|(known, _)| known.total_cmp(&tick)).ok()?;
        Some(&self.names[index].1)
    }

    /// Makes units of two axes of `width` and `height` px equally long, by giving one axis more
    /// room.
    pub(crate) fn equalise(x: &mut Self, y: &mut Self, width: f64, height: f64) {
        let coarser = (x.range.span() / width).max(y.range.span() / height);
        for (axis, length) in [(x, width), (y, height)] {
            let middle = 0.5 * (axis.range.low + axis.range.high);
            let half = 0.5 * coarser * length;
            axis.range = Range { low: middle - half, high: middle + half };
        }
    }

    /// Sets at most so many ticks, or some more where these would be fewer than two; fewer if these do not
    /// satisfy `have_room`, but two if there are.
    pub(crate) fn set_ticks(&mut self, most: usize, have_room: impl Fn(&Self) -> bool) {
        let ticks = match (self.names.is_empty(), self.is_logarithmic) {
            (false, _) => Self::named_ticks,
            (true, true) => Self::logarithmic_ticks,
            (true, false) => Self::linear_ticks,
        };
        let tells = |most: &usize| ticks(self, *most).len() > 1;
        let most = (most..most + SOME_MORE).find(tells).unwrap_or(most);
        for most in (1..=most).rev() {
            let found = ticks(self, most);
            let is_last = found.len() < 2 && self.ticks.len() > 1;
            if !is_last {
                self.ticks = found;
            }
            let are_right = !self.is_whole || self.ticks.iter().all(|tick| tick.fract() == 0.0);
            if is_last || are_right && have_room(self) {
                break;
            }
        }
    }

    /// Width of the widest label of a tick, px.
    pub(crate) fn label_width(&self) -> f64 {
        let widths = self.ticks.iter().map(|tick| text_width(&self.format_ext(tick)));
        widths.fold(0.0, f64::max)
    }

    fn named_ticks(&self, most: usize) -> Vec<f64> {
        let every = self.names.len().div_ceil(most);
        self.names.iter().step_by(every).map(|(tick, _)| *tick).collect()
    }

    fn linear_ticks(&self, most: usize) -> Vec<f64> {
        // Plotters tells numbers apart to 2e-16, whatever their size.
        let unit = 10_f64.powf(self.range.span().log10().floor());
        let unit = if (1e-9..1e9).contains(&unit) { 1.0 } else { unit };
        let range = RangedCoordf64::from(self.range.low / unit..self.range.high / unit);
        range.key_points(BoldPoints(most)).into_iter().map(|tick| unit * tick).collect()
    }

    /// Decades, and where there is room their halves and fifths: plotters knows whole decades
    /// alone, of which many axes here have none.
    fn logarithmic_ticks(&self, most: usize) -> Vec<f64> {
        let within = |factors: &[f64]| -> Vec<f64> {
            let decades = (self.range.low.floor() as i32)..=(self.range.high.ceil() as i32);
            let of_decade = |power| factors.iter().map(move |f| f.log10() + f64::from(power));
            let ticks = decades.flat_map(of_decade);
            ticks.filter(|tick| self.range.contains(*tick)).collect()
        };
        let fine = within(&[1.0, 2.0, 5.0]);
        let decades = if fine.len() <= most { fine } else { within(&[1.0]) };
        let every = decades.len().div_ceil(most).max(1);
        decades.into_iter().step_by(every).collect()
    }

    /// A value in the axis' coordinates; NaN if it cannot be drawn.
    pub(crate) fn scaled(&self, value: f64) -> f64 {
        let value = if value.abs() <= LARGEST { value } else { f64::NAN };
        if self.is_logarithmic { value.log10() } else { value }
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let part = (value - self.range.low) / self.range.span();
        from + (part * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.range.low..self.range.high
    }
}

impl ValueFormatter<f64> for Axis {
    /// With as many decimals as any of the ticks needs.
    fn format_ext(&self, tick: &f64) -> String {
        if let Some(name) = self.name(*tick) {
            // Neighbours of one name have it once.
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
    fn ticks_that_have_names_stand_where_these_are() {
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
    fn ticks_of_counted_things_are_whole_numbers() {
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
    fn one_value_and_none_still_have_a_range() {
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
        let (width, height) = (300.0, 100.0);
        Axis::equalise(&mut x, &mut y, width, height);
        let metre = |axis: &Axis, length: f64| length / axis.range.span();
        assert!((metre(&x, width) - metre(&y, height)).abs() < 1e-9);
        assert!(x.range.contains(4.0) && y.range.contains(0.1) && y.range.contains(-0.1));
    }

    #[test]
    fn what_is_not_to_be_shown_does_not_stretch_the_axis() {
        let shown = Some(Range { low: -5.0, high: 5.0 });
        let axis = Axis::new(&[-1.0, 1.0, 400.0], shown, Scale::Linear);
        assert!(axis.range.high > 1.0 && axis.range.high < 1.2);
    }
}
