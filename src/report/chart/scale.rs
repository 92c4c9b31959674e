//! Where values are along an axis of a panel.

use crate::report::axis::{self, Range};

/// From this ratio of its ends on an axis of positive values is logarithmic.
const LOGARITHMIC: f64 = 5.0;
const MARGIN: f64 = 0.05;

/// Values along an axis: where they are between its ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    is_logarithmic: bool,
    range: Range,
}

impl Scale {
    /// An axis that has room for all values, or for `shown` alone.
    pub fn of(values: &[f64], shown: Option<Range>, is_linear: bool) -> Self {
        let is_shown = |value: &f64| {
            value.is_finite()
                && shown.is_none_or(|Range { low, high }| *value >= low && *value <= high)
        };
        let values = values.iter().copied().filter(is_shown);
        let low = values.clone().fold(f64::NAN, f64::min);
        let high = values.fold(f64::NAN, f64::max);
        let is_logarithmic = !is_linear && low > 0.0 && high > LOGARITHMIC * low;
        let of = |value: f64| if is_logarithmic { value.log10() } else { value };
        let (low, high) = (of(low), of(high));
        if !(low.is_finite() && high.is_finite()) {
            return Self { is_logarithmic: false, range: Range { low: 0.0, high: 1.0 } };
        }
        // What is all but one value is not spread over the axis.
        let span = (high - low).max(1e-3 * high.abs()).max(1e-12);
        let margin = MARGIN * span + 0.5 * (span - (high - low));
        let range = Range { low: low - margin, high: high + margin };
        Self { is_logarithmic, range }
    }

    /// Makes two linear axes of `width` and `height` px show lengths alike, by giving one of them
    /// more room.
    pub fn equalise(x: &mut Self, y: &mut Self, width: f64, height: f64) {
        let per_px = |scale: &Self, length: f64| (scale.range.high - scale.range.low) / length;
        let coarser = per_px(x, width).max(per_px(y, height));
        for (scale, length) in [(x, width), (y, height)] {
            let middle = 0.5 * (scale.range.low + scale.range.high);
            let half = 0.5 * coarser * length;
            scale.range = Range { low: middle - half, high: middle + half };
        }
    }

    /// 0 at the axis' start and 1 at its end.
    pub fn part(&self, value: f64) -> f64 {
        let value = if self.is_logarithmic { value.log10() } else { value };
        (value - self.range.low) / (self.range.high - self.range.low)
    }

    pub fn ticks(&self, about: f64) -> Vec<(f64, String)> {
        if !self.is_logarithmic {
            return axis::ticks(self.range, about);
        }
        let Range { low, high } = self.range;
        let decades = (low.floor() as i32)..=(high.ceil() as i32);
        let within = |factors: &[f64]| -> Vec<f64> {
            let all = decades
                .clone()
                .flat_map(|power| factors.iter().map(move |factor| factor * 10_f64.powi(power)));
            all.filter(|value| (low..=high).contains(&value.log10())).collect()
        };
        let fine = within(&[1.0, 2.0, 5.0]);
        let ticks = if fine.len() as f64 <= about + 1.0 { fine } else { within(&[1.0]) };
        ticks.into_iter().map(|value| (value, format!("{value}"))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_metre_is_as_long_along_both_axes() {
        let (mut x, mut y) =
            (Scale::of(&[0.0, 4.0], None, true), Scale::of(&[-0.1, 0.1], None, true));
        let (width, height) = (300.0, 100.0);
        Scale::equalise(&mut x, &mut y, width, height);
        let metre = |scale: &Scale, length: f64| length * (scale.part(1.0) - scale.part(0.0));
        assert!((metre(&x, width) - metre(&y, height)).abs() < 1e-9);
        assert!(x.part(4.0) <= 1.0 && y.part(0.1) <= 1.0 && y.part(-0.1) >= 0.0);
    }

    #[test]
    fn what_is_not_to_be_shown_does_not_stretch_the_axis() {
        let scale = Scale::of(&[-1.0, 1.0, 400.0], Some(Range { low: -5.0, high: 5.0 }), true);
        assert!(scale.part(1.0) > 0.9 && scale.part(400.0) > 1.0);
    }
}
