//! Layout of the frames in a file. Header and parameters both state every count, and the data's
//! size must agree with them to within a block. Of contradictory counts those that fill the data
//! are used, with a note; where that leaves a choice, the file is rejected.

#[cfg(test)]
mod tests;

use std::fmt;

use super::BLOCK;
use super::parameters::{Parameters, bytes_at, decimal};
use crate::FileProblem;

/// Largest 16-bit count; longer recordings state this instead.
const MAX_U16: usize = 65_535;
/// Scales and rates that differ by less than this part are the same number.
const RELATIVE_TOLERANCE: f64 = 1e-4;

/// How the frames lie in the data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    pub points: usize,
    /// Analog values a frame, all channels.
    pub analog_values: usize,
    pub is_float: bool,
    /// First byte of the data.
    pub data_start: usize,
    pub frame_count: usize,
}

impl Layout {
    pub(super) fn frame_bytes(&self) -> usize {
        let value = if self.is_float { 4 } else { 2 };
        value * (4 * self.points + self.analog_values)
    }

    fn bytes(&self) -> usize {
        self.frame_bytes().saturating_mul(self.frame_count)
    }
}

/// A number with the places that state it, the most trusted one first.
#[derive(Default)]
struct Stated<T>(Vec<(T, &'static str)>);

impl<T: Copy + PartialEq> Stated<T> {
    fn of<const N: usize>(places: [(Option<T>, &'static str); N]) -> Self {
        let stated = places.into_iter().filter_map(|(value, place)| Some((value?, place)));
        Self(stated.collect())
    }

    /// Every value once.
    fn values(&self) -> Vec<T> {
        let mut values = Vec::new();
        for (value, _) in &self.0 {
            if !values.contains(value) {
                values.push(*value);
            }
        }
        values
    }

    fn is_contradictory(&self) -> bool {
        self.values().len() > 1
    }
}

impl<T: fmt::Display> fmt::Display for Stated<T> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let texts: Vec<String> =
            self.0.iter().map(|(value, place)| format!("{value} ({place})")).collect();
        f.write_str(&if texts.is_empty() { "none".to_owned() } else { texts.join(" and ") })
    }
}

/// What header and parameters state.
pub(super) struct Counts {
    points: Stated<usize>,
    analog_values: Stated<usize>,
    /// By the rates of points and analog samples; counts only where the others leave it open.
    analog_values_by_rates: Option<usize>,
    channels: Option<usize>,
    /// Negative with floats; else the unit of integers.
    scale: Stated<f64>,
    rate_hz: Stated<f64>,
    data_start: Stated<usize>,
    frames: Stated<usize>,
    /// Whether longer counts are stated than 16 bits have.
    has_long_counts: bool,
    /// Least number of frames where all counts are capped at [`MAX_U16`].
    min_frames: Option<usize>,
    pub first_frame: i64,
    /// Where the data end at most.
    data_end: usize,
}

impl Counts {
    pub(super) fn read(header: &[u8], parameters: &Parameters, file_bytes: usize) -> Self {
        let word = |number: usize| {
            let bytes = bytes_at(header, 2 * (number - 1)).unwrap_or_default();
            usize::from(parameters.order.u16(bytes))
        };
        let real = |number: usize| {
            let bytes = bytes_at(header, 2 * (number - 1))?;
            Some(decimal(parameters.order.f32(bytes))).filter(|x| x.is_finite() && *x != 0.0)
        };
        let number = |group: &str, name: &str| parameters.number(group, name);
        let whole = |group: &str, name: &str| Some(usize::from(number(group, name)? as u16));
        let finite = |name: &str| number("POINT", name).filter(|x| x.is_finite() && *x != 0.0);
        let positive = |rate_hz: &f64| *rate_hz > 0.0;
        let rate_hz = Stated::of([
            (finite("RATE").filter(positive), "POINT:RATE"),
            (real(11).filter(positive), "header words 11 and 12"),
        ]);

        let channels = whole("ANALOG", "USED");
        let by_samples = channels.filter(|channels| *channels == 0 || word(10) > 0);
        let by_rates = || {
            let samples = number("ANALOG", "RATE")? / rate_hz.0.first()?.0;
            let is_whole =
                samples >= 1.0 && (samples.round() / samples - 1.0).abs() < RELATIVE_TOLERANCE;
            Some(channels? * (samples.round() as u16 as usize)).filter(|_| is_whole)
        };
        let block = |block: usize| Some(block.checked_sub(1)? * BLOCK);
        let data_start = Stated::of([
            (block(word(9)), "header word 9"),
            (whole("POINT", "DATA_START").and_then(block), "POINT:DATA_START"),
        ]);
        let rotations = whole("ROTATION", "DATA_START").and_then(block);
        let begins = data_start.0.first().map_or(0, |(start, _)| *start);
        let data_end = rotations.filter(|end| *end > begins).unwrap_or(usize::MAX).min(file_bytes);

        let (first, last) = (word(4), word(5));
        let long = |name: &str| match parameters.numbers("TRIAL", name)?[..] {
            [low, high, ..] => Some(i64::from(low as u16) + 65536 * i64::from(high as u16)),
            _ => None,
        };
        let range = long("ACTUAL_START_FIELD").zip(long("ACTUAL_END_FIELD"));
        let of_range = range.and_then(|(first, last)| usize::try_from(last - first + 1).ok());
        let long_frames = number("POINT", "LONG_FRAMES").map(|frames| frames as u32 as usize);
        let frames = number("POINT", "FRAMES").map(|frames| frames as u32 as usize);
        // Modulo 65536: the last frame's number may have wrapped around.
        let of_header = ![0, MAX_U16].contains(&last);
        let of_header = of_header.then(|| (last + 65536 - first) % 65536 + 1);
        let longest = of_range.or(long_frames);
        // 16 bits of a longer count do not contradict it.
        let is_whole = |count: &usize| match longest {
            Some(long) if long % 65536 == count % 65536 => long == *count,
            _ => *count < MAX_U16,
        };
        let stated = Stated::of([
            (of_range, "TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD"),
            (long_frames, "POINT:LONG_FRAMES"),
            (frames.filter(|frames| *frames > MAX_U16 || is_whole(frames)), "POINT:FRAMES"),
            (of_header.filter(is_whole), "header words 4 and 5"),
        ]);
        let stated = Stated(stated.0.into_iter().filter(|(count, _)| *count > 0).collect());
        let ends_at_most = last == MAX_U16 || frames == Some(MAX_U16);
        Self {
            points: Stated::of([
                (whole("POINT", "USED"), "POINT:USED"),
                (Some(word(2)), "header word 2"),
            ]),
            analog_values: Stated::of([
                (by_samples.map(|used| used * word(10)), "ANALOG:USED x header word 10"),
                (Some(word(3)), "header word 3"),
            ]),
            analog_values_by_rates: by_rates(),
            channels,
            scale: Stated::of([
                (finite("SCALE"), "POINT:SCALE"),
                (real(7), "header words 7 and 8"),
            ]),
            rate_hz,
            data_start,
            has_long_counts: longest.or(frames.filter(|frames| *frames > MAX_U16)).is_some(),
            min_frames: (stated.0.is_empty() && ends_at_most).then(|| match frames {
                Some(frames) if last != MAX_U16 => frames,
                _ => (MAX_U16 + 1).saturating_sub(first),
            }),
            frames: stated,
            first_frame: range.map_or(first as i64, |(first, _)| first),
            data_end,
        }
    }

    /// Whether no place states a point.
    pub(super) fn has_no_points(&self) -> bool {
        self.points.0.iter().all(|(points, _)| *points == 0)
    }

    pub(super) fn rate_hz(&self) -> Option<f64> {
        Some(self.rate_hz.0.first()?.0)
    }

    /// Unit of the data's integers, as part of the file's unit.
    ///
    /// # Errors
    /// The places that state it differ: which is right is not known, and all positions have it.
    pub(super) fn integer_scale(&self) -> Result<f64, FileProblem> {
        let positive: Vec<_> = self.scale.0.iter().filter(|(scale, _)| *scale > 0.0).collect();
        match positive[..] {
            [(first, _), (second, _)] if (first / second - 1.0).abs() > RELATIVE_TOLERANCE => {
                Err(FileProblem::new(
                    format!("two scales of the positions: {}", self.scale),
                    "one: which is right is not known; export the file anew, as floating-point numbers",
                ))
            }
            [(scale, _), ..] => Ok(*scale),
            [] => Err(FileProblem::new("no scale of the positions", "POINT:SCALE")),
        }
    }

    /// How the frames lie in the file, and what had to be chosen between numbers that differ.
    ///
    /// # Errors
    /// There is no frame, the file is shorter than its frames, or its numbers contradict each other
    /// and its size does not tell which are right.
    pub(super) fn layout(&self, content: &[u8]) -> Result<(Layout, Vec<String>), FileProblem> {
        if self.data_start.0.is_empty() {
            return Err(FileProblem::new("no place of the data", "POINT:DATA_START"));
        }
        if self.scale.0.is_empty() {
            return Err(FileProblem::new("no scale of the positions", "POINT:SCALE"));
        }
        if self.frames.0.is_empty() && self.min_frames.is_none() {
            return Err(FileProblem::new("no frames", "at least one"));
        }
        let data = &content[..self.data_end.min(content.len())];
        let stated = self.layouts(&self.analog_values.values());
        let filled = |layouts: &[Layout]| -> Vec<Layout> {
            layouts.iter().filter_map(|layout| self.filled(*layout, data)).collect()
        };
        let mut filling = filled(&stated);
        if filling.is_empty() {
            let by_rates = self.analog_values_by_rates.as_slice();
            filling = filled(&self.layouts(by_rates));
            filling.extend(stated.iter().filter_map(|layout| self.wrapped(*layout, data)));
        }
        let same = |layout: &Layout| Layout { analog_values: 0, frame_count: 0, ..*layout };
        if filling.windows(2).all(|pair| same(&pair[0]) == same(&pair[1])) && filling.len() > 1 {
            // Few frames do not show how many analog values there are, but the rates may.
            filling.retain(|layout| self.is_by_rates(layout.analog_values));
        }
        let layout = match filling[..] {
            [only] => only,
            [] if !self.is_settled(&stated) => return Err(self.contradiction(&stated, data)),
            [] => self.not_filling(stated[0], data)?,
            _ => return Err(self.contradiction(&stated, data)),
        };
        Ok((layout, self.notes(layout, data)))
    }

    /// Every combination of what is stated, without frames.
    fn layouts(&self, analog_values: &[usize]) -> Vec<Layout> {
        let mut layouts = Vec::new();
        let formats = Stated(self.scale.0.iter().map(|(scale, of)| (*scale < 0.0, *of)).collect());
        for data_start in self.data_start.values() {
            for points in self.points.values() {
                for is_float in formats.values() {
                    layouts.extend(analog_values.iter().map(|&analog_values| Layout {
                        points,
                        analog_values,
                        is_float,
                        data_start,
                        frame_count: 0,
                    }));
                }
            }
        }
        // A frame of nothing cannot be counted.
        layouts.retain(|layout| layout.points > 0);
        layouts
    }

    /// The layout with the largest stated frame count that fills the data, or by the size where
    /// all counts are capped at [`MAX_U16`].
    fn filled(&self, layout: Layout, data: &[u8]) -> Option<Layout> {
        let bytes = data.len().checked_sub(layout.data_start)?;
        let frame = layout.frame_bytes();
        let with = |frame_count: usize| Layout { frame_count, ..layout };
        if let Some(least) = self.min_frames {
            // What fills the last block up is no frame.
            let mut count = bytes / frame;
            while bytes - (count.saturating_sub(1)) * frame < BLOCK
                && count > least
                && is_blank(data, with(count), count - 1)
            {
                count -= 1;
            }
            return Some(with(count)).filter(|_| count >= least);
        }
        let fills = |count: &usize| {
            let used = count.saturating_mul(frame);
            used <= bytes && is_padding(&data[layout.data_start + used..])
        };
        let mut counts = self.frames.values();
        counts.sort_unstable_by(|a, b| b.cmp(a));
        let largest = *counts.iter().find(|count| fills(count))?;
        // A smaller count is right if all frames after it are zeros (padding).
        let is_enough = |count: &&usize| is_blank(data, with(largest), **count);
        let least = counts.iter().rev().filter(|count| **count < largest).find(is_enough);
        Some(with(least.copied().unwrap_or(largest)))
    }

    /// The layout where the number of frames is stated modulo 65536.
    fn wrapped(&self, layout: Layout, data: &[u8]) -> Option<Layout> {
        let bytes = data.len().checked_sub(layout.data_start)?;
        let frame = layout.frame_bytes();
        let [stated] = self.frames.values()[..] else { return None };
        let times = (bytes / frame).checked_sub(stated)? / (MAX_U16 + 1);
        let frame_count = stated + times * (MAX_U16 + 1);
        let fills = times > 0 && is_padding(&data[layout.data_start + frame_count * frame..]);
        (fills && !self.has_long_counts).then_some(Layout { frame_count, ..layout })
    }

    /// Whether this number of analog values follows from the rates of points and samples, and the
    /// header has it too, or the number of channels, as some programs write.
    fn is_by_rates(&self, analog_values: usize) -> bool {
        let in_header = self.analog_values.0.last().map(|(values, _)| *values);
        let is_in_header = in_header == Some(analog_values) || in_header == self.channels;
        self.analog_values_by_rates == Some(analog_values) && is_in_header
    }

    /// Whether one layout is stated and one number of frames.
    fn is_settled(&self, stated: &[Layout]) -> bool {
        stated.len() == 1 && self.frames.values().len() == 1
    }

    /// The only stated layout of data that it does not fill, if the file only goes on after it.
    fn not_filling(&self, layout: Layout, data: &[u8]) -> Result<Layout, FileProblem> {
        let frame_count = self.frames.values()[0];
        let layout = Layout { frame_count, ..layout };
        let whole = data.len().saturating_sub(layout.data_start) / layout.frame_bytes();
        if whole < layout.frame_count {
            let found = format!("{whole} of {frame_count} frames");
            return Err(FileProblem::new(found, "all of them; is the copy complete?"));
        }
        Ok(layout)
    }

    fn contradiction(&self, stated: &[Layout], data: &[u8]) -> FileProblem {
        let bytes = |layout: &Layout| data.len().saturating_sub(layout.data_start);
        let mut sizes: Vec<String> = stated.iter().map(|of| bytes(of).to_string()).collect();
        sizes.dedup();
        let frames = match self.min_frames {
            Some(least) => format!("{least} or more"),
            None => self.frames.to_string(),
        };
        let found = format!(
            "counts that contradict each other or the file's size: points {}, analog values a frame {}, \
             scale {}, frames {frames}, in {} bytes of data",
            self.points,
            self.analog_values,
            self.scale,
            sizes.join(" or ")
        );
        let needed = "counts that are the same in header and parameters and fill the data to less \
                      than a block of 512 bytes; export the file anew";
        FileProblem::new(found, needed)
    }

    /// What had to be chosen, each with all numbers.
    fn notes(&self, layout: Layout, data: &[u8]) -> Vec<String> {
        let mut notes = Vec::new();
        let mut note = |what: &str, stated: &dyn fmt::Display, taken: String| {
            notes.push(format!("{what}: found {stated}, took {taken}"));
        };
        let Layout { points, analog_values, is_float, frame_count, .. } = layout;
        if self.points.is_contradictory() {
            note("points", &self.points, points.to_string());
        }
        if self.analog_values.is_contradictory()
            || !self.analog_values.values().contains(&analog_values)
        {
            note("analog values a frame", &self.analog_values, analog_values.to_string());
        }
        if self.scale.0.iter().any(|(scale, _)| (*scale < 0.0) != is_float) {
            let format = if is_float { "floating-point numbers" } else { "integers" };
            note("scale, which is below 0 with floating-point numbers", &self.scale, format.into());
        }
        if let [(first, _), (second, _), ..] = self.rate_hz.0[..]
            && (first / second - 1.0).abs() > RELATIVE_TOLERANCE
        {
            note("frame rate, Hz", &self.rate_hz, first.to_string());
        }
        let is_other = !self.frames.values().contains(&frame_count) && self.min_frames.is_none();
        if self.frames.is_contradictory() || is_other {
            note("frames", &self.frames, frame_count.to_string());
        }
        let (bytes, frame) = (layout.bytes(), layout.frame_bytes());
        let rest = data.get(layout.data_start + bytes..).unwrap_or_default();
        if !is_padding(rest) {
            let over = rest.len();
            let found = format!(
                "{frame_count} of {frame} bytes, which are {bytes}, and {over} bytes of data after them"
            );
            note("frames", &found, frame_count.to_string());
        }
        notes
    }
}

/// Whether so much after the frames only fills the last block up, or is nothing but zeros.
fn is_padding(rest: &[u8]) -> bool {
    rest.len() < BLOCK || rest.iter().all(|&byte| byte == 0)
}

/// Whether the frames of a layout from one on are nothing but zeros.
fn is_blank(data: &[u8], layout: Layout, from: usize) -> bool {
    let frame = layout.frame_bytes();
    let [from, to] = [from, layout.frame_count].map(|at| layout.data_start + at * frame);
    data.get(from..to).is_some_and(|bytes| bytes.iter().all(|&byte| byte == 0))
}
