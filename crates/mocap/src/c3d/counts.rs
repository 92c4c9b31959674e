//! Determines the layout of the frames in a file. The header and the parameters both state every count, and the counts
//! must agree with the size of the data to within a block. If counts contradict each other, those that match the size
//! of the data are used, with a note; if several do, the file is rejected.

#[cfg(test)]
mod tests;

use std::fmt;

use super::BLOCK;
use super::parameters::{Parameters, bytes_at, shortest_decimal};
use crate::FileProblem;

/// Maximum 16-bit count, which files state in place of a count that does not fit into 16 bits.
const MAX_U16: usize = 65_535;
/// Maximum relative difference at which two stated scales, or two stated rates, are considered equal.
const RELATIVE_TOLERANCE: f64 = 1e-4;

/// Layout of the frames in the data section.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    pub points: usize,
    /// Number of analog values per frame, over all channels.
    pub analog_values: usize,
    pub is_float: bool,
    /// Position of the first byte of the data in the file.
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

/// Values that a file states for one quantity, each with the place that states it, the most reliable place first.
#[derive(Default)]
struct Stated<T>(Vec<(T, &'static str)>);

impl<T: Copy + PartialEq> Stated<T> {
    fn new<const N: usize>(places: [(Option<T>, &'static str); N]) -> Self {
        let stated = places.into_iter().filter_map(|(value, place)| Some((value?, place)));
        Self(stated.collect())
    }

    /// Returns the distinct values.
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

/// Counts and related values that the header and the parameters of a C3D file state.
pub(super) struct Counts {
    points: Stated<usize>,
    analog_values: Stated<usize>,
    /// Number of analog values per frame according to the rates of points and analog samples; used only if the other
    /// counts are ambiguous.
    analog_values_by_rates: Option<usize>,
    channels: Option<usize>,
    /// Scale of the coordinates: negative if they are floats, otherwise the length of one step of the integers.
    scale: Stated<f64>,
    rate_hz: Stated<f64>,
    data_start: Stated<usize>,
    frames: Stated<usize>,
    /// Whether the file states a frame count in a form that is not limited to 16 bits.
    has_long_counts: bool,
    /// Minimum number of frames if all stated counts are capped at [`MAX_U16`]; otherwise `None`.
    min_frames: Option<usize>,
    pub first_frame: i64,
    /// Latest possible position of the end of the data, bytes from the start of the file.
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
            Some(shortest_decimal(parameters.order.f32(bytes)))
                .filter(|x| x.is_finite() && *x != 0.0)
        };
        let rate_hz = Stated::new([
            (nonzero(parameters, "RATE").filter(|rate_hz| *rate_hz > 0.0), "POINT:RATE"),
            (real(11).filter(|rate_hz| *rate_hz > 0.0), "header words 11 and 12"),
        ]);

        let channels = parameters.whole("ANALOG", "USED");
        let by_samples = channels.filter(|channels| *channels == 0 || word(10) > 0);
        let samples = parameters
            .number("ANALOG", "RATE")
            .zip(rate_hz.0.first())
            .map(|(analog_hz, (rate_hz, _))| analog_hz / rate_hz)
            .filter(|samples| {
                *samples >= 1.0 && (samples.round() / samples - 1.0).abs() < RELATIVE_TOLERANCE
            });
        let by_rates = channels
            .zip(samples)
            .map(|(channels, samples)| channels * (samples.round() as u16 as usize));
        let data_start = Stated::new([
            (block_start(word(9)), "header word 9"),
            (parameters.whole("POINT", "DATA_START").and_then(block_start), "POINT:DATA_START"),
        ]);
        let rotations = parameters.whole("ROTATION", "DATA_START").and_then(block_start);
        let begins = data_start.0.first().map_or(0, |(start, _)| *start);
        let data_end = rotations.filter(|end| *end > begins).unwrap_or(usize::MAX).min(file_bytes);

        let first = word(4);
        let last = word(5);
        let range = long_number(parameters, "ACTUAL_START_FIELD")
            .zip(long_number(parameters, "ACTUAL_END_FIELD"));
        let of_range = range.and_then(|(first, last)| usize::try_from(last - first + 1).ok());
        let long_frames =
            parameters.number("POINT", "LONG_FRAMES").map(|frames| frames as u32 as usize);
        let frames = parameters.number("POINT", "FRAMES").map(|frames| frames as u32 as usize);
        // Modulo 65536, because the number of the last frame may have wrapped around.
        let of_header = ![0, MAX_U16].contains(&last);
        let of_header = of_header.then(|| (last + 65536 - first) % 65536 + 1);
        let longest = of_range.or(long_frames);
        // A count equal to the lower 16 bits of a longer count does not contradict it.
        let is_whole = |count: &usize| match longest {
            Some(long) if long % 65536 == count % 65536 => long == *count,
            _ => *count < MAX_U16,
        };
        let stated = Stated::new([
            (of_range, "TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD"),
            (long_frames, "POINT:LONG_FRAMES"),
            (frames.filter(|frames| *frames > MAX_U16 || is_whole(frames)), "POINT:FRAMES"),
            (of_header.filter(is_whole), "header words 4 and 5"),
        ]);
        let stated = Stated(stated.0.into_iter().filter(|(count, _)| *count > 0).collect());
        let ends_at_most = last == MAX_U16 || frames == Some(MAX_U16);
        Self {
            points: Stated::new([
                (parameters.whole("POINT", "USED"), "POINT:USED"),
                (Some(word(2)), "header word 2"),
            ]),
            analog_values: Stated::new([
                (by_samples.map(|used| used * word(10)), "ANALOG:USED x header word 10"),
                (Some(word(3)), "header word 3"),
            ]),
            analog_values_by_rates: by_rates,
            channels,
            scale: Stated::new([
                (nonzero(parameters, "SCALE"), "POINT:SCALE"),
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

    /// Returns whether every number of points that the file states is zero.
    pub(super) fn has_no_points(&self) -> bool {
        self.points.0.iter().all(|(points, _)| *points == 0)
    }

    pub(super) fn rate_hz(&self) -> Option<f64> {
        Some(self.rate_hz.0.first()?.0)
    }

    /// Returns the length of one step of integer data, in the file's unit.
    ///
    /// # Errors
    /// Returns an error if the stated scales differ: it is unknown which is right, and the scale affects all positions.
    pub(super) fn integer_scale(&self) -> Result<f64, FileProblem> {
        let positive: Vec<_> = self.scale.0.iter().filter(|(scale, _)| *scale > 0.0).collect();
        match positive[..] {
            [(first, _), (second, _)] if (first / second - 1.0).abs() > RELATIVE_TOLERANCE => {
                Err(FileProblem::new(
                    format!("two scales of the positions: {}", self.scale),
                    "one scale, because it is unknown which scale is correct; export the file again with \
                     floating-point coordinates",
                ))
            }
            [(scale, _), ..] => Ok(*scale),
            [] => Err(FileProblem::new("no scale of the positions", "POINT:SCALE")),
        }
    }

    /// Determines the layout of the frames. Also returns notes on how contradictory counts were resolved.
    ///
    /// # Errors
    /// Returns an error if there are no frames, if the file is too short for its frames, or if its counts contradict
    /// each other and the size of the data does not decide between them.
    pub(super) fn layout(&self, content: &[u8]) -> Result<(Layout, Vec<String>), FileProblem> {
        if self.data_start.0.is_empty() {
            return Err(FileProblem::new("no start of the data", "POINT:DATA_START"));
        }
        if self.scale.0.is_empty() {
            return Err(FileProblem::new("no scale of the positions", "POINT:SCALE"));
        }
        if self.frames.0.is_empty() && self.min_frames.is_none() {
            return Err(FileProblem::new("no frames", "at least one frame"));
        }
        let data = &content[..self.data_end.min(content.len())];
        let stated = self.layouts(&self.analog_values.values());
        let mut filling: Vec<Layout> =
            stated.iter().filter_map(|layout| self.filled(*layout, data)).collect();
        if filling.is_empty() {
            let by_rates = self.layouts(self.analog_values_by_rates.as_slice());
            filling = by_rates.iter().filter_map(|layout| self.filled(*layout, data)).collect();
            filling.extend(stated.iter().filter_map(|layout| self.wrapped(*layout, data)));
        }
        let differs_in_counts_only = filling.windows(2).all(|pair| {
            let [one, other] = [pair[0], pair[1]].map(|layout| Layout {
                analog_values: 0,
                frame_count: 0,
                ..layout
            });
            one == other
        });
        if differs_in_counts_only && filling.len() > 1 {
            // A few frames do not determine the number of analog values, but the rates may.
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

    /// Returns a layout for every combination of the stated values with one of the given numbers of analog values per
    /// frame. The frame counts of the layouts are 0, to be filled in later.
    fn layouts(&self, analog_values: &[usize]) -> Vec<Layout> {
        let mut layouts = Vec::new();
        let formats =
            Stated(self.scale.0.iter().map(|(scale, place)| (*scale < 0.0, *place)).collect());
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
        // Empty frames cannot be counted.
        layouts.retain(|layout| layout.points > 0);
        layouts
    }

    /// Returns the layout with the stated frame count that matches the size of the data, where trailing frames of zeros
    /// count as padding. If all stated counts are capped at [`MAX_U16`], the count follows from the size. Returns
    /// `None` if there is no such count.
    fn filled(&self, layout: Layout, data: &[u8]) -> Option<Layout> {
        let bytes = data.len().checked_sub(layout.data_start)?;
        let frame = layout.frame_bytes();
        let with = |frame_count: usize| Layout { frame_count, ..layout };
        if let Some(min_frames) = self.min_frames {
            // Zeros that pad the last block are not a frame.
            let mut count = bytes / frame;
            while bytes - (count.saturating_sub(1)) * frame < BLOCK
                && count > min_frames
                && is_blank(data, with(count), count - 1)
            {
                count -= 1;
            }
            return Some(with(count)).filter(|_| count >= min_frames);
        }
        let mut counts = self.frames.values();
        counts.sort_unstable_by(|a, b| b.cmp(a));
        let largest = *counts.iter().find(|count| {
            let used = count.saturating_mul(frame);
            used <= bytes && is_padding(&data[layout.data_start + used..])
        })?;
        // A smaller count is right if all frames after it are zeros (padding).
        let smallest = counts
            .iter()
            .rev()
            .filter(|count| **count < largest)
            .find(|count| is_blank(data, with(largest), **count));
        Some(with(smallest.copied().unwrap_or(largest)))
    }

    /// Returns the layout with its frame count, of which the file states only the remainder modulo 65536; `None` if no
    /// such count matches the size of the data.
    fn wrapped(&self, layout: Layout, data: &[u8]) -> Option<Layout> {
        let bytes = data.len().checked_sub(layout.data_start)?;
        let frame = layout.frame_bytes();
        let [stated] = self.frames.values()[..] else { return None };
        let times = (bytes / frame).checked_sub(stated)? / (MAX_U16 + 1);
        let frame_count = stated + times * (MAX_U16 + 1);
        let fills = times > 0 && is_padding(&data[layout.data_start + frame_count * frame..]);
        (fills && !self.has_long_counts).then_some(Layout { frame_count, ..layout })
    }

    /// Returns whether the rates of points and analog samples imply this number of analog values per frame, and the
    /// header states either the same number or, as some programs do, the number of channels.
    fn is_by_rates(&self, analog_values: usize) -> bool {
        let in_header = self.analog_values.0.last().map(|(values, _)| *values);
        let is_in_header = in_header == Some(analog_values) || in_header == self.channels;
        self.analog_values_by_rates == Some(analog_values) && is_in_header
    }

    /// Returns whether all places in the file state the same layout and the same frame count.
    fn is_settled(&self, stated: &[Layout]) -> bool {
        stated.len() == 1 && self.frames.values().len() == 1
    }

    /// Returns the only stated layout with the only stated frame count, although they do not match the size of the
    /// data, because other data may follow the frames. Returns an error if frames are missing.
    fn not_filling(&self, layout: Layout, data: &[u8]) -> Result<Layout, FileProblem> {
        let frame_count = self.frames.values()[0];
        let layout = Layout { frame_count, ..layout };
        let whole = data.len().saturating_sub(layout.data_start) / layout.frame_bytes();
        if whole < layout.frame_count {
            let found = format!("{whole} of {frame_count} frames");
            return Err(FileProblem::new(found, "all frames; is the copy of the file complete?"));
        }
        Ok(layout)
    }

    /// Returns the error that lists the contradictory counts.
    fn contradiction(&self, stated: &[Layout], data: &[u8]) -> FileProblem {
        let mut sizes: Vec<String> = stated
            .iter()
            .map(|layout| data.len().saturating_sub(layout.data_start).to_string())
            .collect();
        sizes.dedup();
        let frames = match self.min_frames {
            Some(min_frames) => format!("{min_frames} or more"),
            None => self.frames.to_string(),
        };
        let found = format!(
            "counts that contradict each other or the file's size: points {}, analog values per frame {}, \
             scale {}, frames {frames}, in {} bytes of data",
            self.points,
            self.analog_values,
            self.scale,
            sizes.join(" or ")
        );
        let needed = "counts that agree in header and parameters and account for all data up to less than a block of \
             512 bytes; export the file again";
        FileProblem::new(found, needed)
    }

    /// Lists how contradictory counts were resolved, with all stated values.
    fn notes(&self, layout: Layout, data: &[u8]) -> Vec<String> {
        let mut notes = Vec::new();
        let mut note = |quantity: &str, stated: &dyn fmt::Display, used: String| {
            notes.push(format!("{quantity}: found {stated}, used {used}"));
        };
        let Layout { points, analog_values, is_float, frame_count, .. } = layout;
        if self.points.is_contradictory() {
            note("points", &self.points, points.to_string());
        }
        if self.analog_values.is_contradictory()
            || !self.analog_values.values().contains(&analog_values)
        {
            note("analog values per frame", &self.analog_values, analog_values.to_string());
        }
        if self.scale.0.iter().any(|(scale, _)| (*scale < 0.0) != is_float) {
            let format = if is_float { "floating-point numbers" } else { "integers" };
            note("scale (negative for floating-point numbers)", &self.scale, format.into());
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
        let bytes = layout.bytes();
        let frame = layout.frame_bytes();
        let rest = data.get(layout.data_start + bytes..).unwrap_or_default();
        if !is_padding(rest) {
            let over = rest.len();
            let found = format!(
                "{frame_count} frames of {frame} bytes each ({bytes} bytes in total) and {over} bytes of data after \
                 them"
            );
            note("frames", &found, frame_count.to_string());
        }
        notes
    }
}

/// Returns a parameter of the group POINT if it is finite and not zero.
fn nonzero(parameters: &Parameters, name: &str) -> Option<f64> {
    parameters.number("POINT", name).filter(|x| x.is_finite() && *x != 0.0)
}

/// Returns an integer of the group TRIAL that is stored in two 16-bit words.
fn long_number(parameters: &Parameters, name: &str) -> Option<i64> {
    match parameters.numbers("TRIAL", name)?[..] {
        [low, high, ..] => Some(i64::from(low as u16) + 65536 * i64::from(high as u16)),
        _ => None,
    }
}

/// Returns the byte position of a block; blocks are counted from 1, so that block 0 gives `None`.
fn block_start(block: usize) -> Option<usize> {
    Some(block.checked_sub(1)? * BLOCK)
}

/// Returns whether `rest`, the bytes after the frames, is shorter than a block or consists of zeros.
fn is_padding(rest: &[u8]) -> bool {
    rest.len() < BLOCK || rest.iter().all(|&byte| byte == 0)
}

/// Returns whether all frames of a layout, from frame `from` on, consist of zeros.
fn is_blank(data: &[u8], layout: Layout, from: usize) -> bool {
    let frame = layout.frame_bytes();
    let [from, to] = [from, layout.frame_count].map(|at| layout.data_start + at * frame);
    data.get(from..to).is_some_and(|bytes| bytes.iter().all(|&byte| byte == 0))
}
