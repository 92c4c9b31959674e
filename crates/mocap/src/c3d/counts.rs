//! Determines the layout of the frames in a file. Several places state each count: words of the header, parameters,
//! and the size of the data, which the frames must fill to within a block. If places contradict each other, the counts
//! that fill the data are used, with a note; if none or several do, the file is rejected with all stated values.

#[cfg(test)]
mod tests;

use std::fmt;

use super::BLOCK;
use super::parameters::{Parameters, bytes_at, shortest_decimal};
use super::stated::{FrameCount, MAX_U16, Stated};
use crate::FileProblem;

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
    fn value_bytes(&self) -> usize {
        if self.is_float { 4 } else { 2 }
    }

    pub(super) fn frame_bytes(&self) -> usize {
        self.value_bytes() * (4 * self.points + self.analog_values)
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
    analog_rate_hz: Option<f64>,
    /// Positions of the first byte of the data in the file.
    data_start: Stated<usize>,
    frames: Stated<FrameCount>,
    first_frame: Stated<i64>,
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
        let rate = |group: &str, name: &str| {
            parameters.number(group, name).filter(|rate_hz| rate_hz.is_finite() && *rate_hz > 0.0)
        };
        let rate_hz = Stated::new([
            (rate("POINT", "RATE"), "POINT:RATE"),
            (real(11).filter(|rate_hz| *rate_hz > 0.0), "header words 11 and 12"),
            (rate("TRIAL", "CAMERA_RATE"), "TRIAL:CAMERA_RATE"),
        ]);
        let analog_rate_hz = rate("ANALOG", "RATE");

        let channels = parameters.whole("ANALOG", "USED");
        let by_samples = channels.filter(|channels| *channels == 0 || word(10) > 0);
        let samples = analog_rate_hz
            .zip(rate_hz.0.first())
            .filter(|_| rate_hz.0.windows(2).all(|pair| is_same(pair[0].0, pair[1].0)))
            .map(|(analog_hz, (rate_hz, _))| analog_hz / rate_hz)
            .filter(|samples| *samples >= 1.0 && is_same(samples.round(), *samples));
        let by_rates = channels
            .zip(samples)
            .map(|(channels, samples)| channels * (samples.round() as u16 as usize));
        let data_start = Stated::new([
            (block_start(word(9)), "header word 9"),
            (parameters.whole("POINT", "DATA_START").and_then(block_start), "POINT:DATA_START"),
        ]);
        let rotations = parameters.whole("ROTATION", "DATA_START").and_then(block_start);
        let parameter_section = block_start(header.first().copied().unwrap_or_default().into());
        let begins = data_start.0.first().map_or(0, |(start, _)| *start);
        let data_end = [rotations, parameter_section].into_iter().flatten();
        let data_end = data_end.filter(|end| *end > begins).fold(file_bytes, usize::min);

        let (first, last) = (word(4), word(5));
        let start = parameters.long_number("TRIAL", "ACTUAL_START_FIELD");
        let end = parameters.long_number("TRIAL", "ACTUAL_END_FIELD");
        let of_range =
            start.zip(end).and_then(|(start, end)| usize::try_from(end - start + 1).ok());
        let long_frames = parameters.long_number("POINT", "LONG_FRAMES");
        let count = |frames: i64| usize::try_from(frames).ok().filter(|frames| *frames > 0);
        let frames = parameters.long_number("POINT", "FRAMES").and_then(count);
        Self {
            frames: Stated::new([
                (
                    of_range.filter(|frames| *frames > 0).map(FrameCount::Exact),
                    "TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD",
                ),
                (long_frames.and_then(count).map(FrameCount::Exact), "POINT:LONG_FRAMES"),
                (frames.and_then(FrameCount::of_parameter), "POINT:FRAMES"),
                (FrameCount::of_header(first, last), "header words 4 and 5"),
            ]),
            first_frame: Stated::new([
                (start, "TRIAL:ACTUAL_START_FIELD"),
                (Some(first as i64), "header word 4"),
            ]),
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
            analog_rate_hz,
            data_start,
            data_end,
        }
    }

    /// Returns whether every number of points that the file states is zero.
    pub(super) fn has_no_points(&self) -> bool {
        self.points.0.iter().all(|(points, _)| *points == 0)
    }

    /// Returns the frame rate, Hz, that most places state; `None` if the file states none. Adds a note if places
    /// contradict it.
    ///
    /// # Errors
    /// Returns an error if no rate is stated by more places than any other: the rate affects all velocities.
    pub(super) fn rate_hz(
        &self,
        layout: Layout,
        notes: &mut Vec<String>,
    ) -> Result<Option<f64>, FileProblem> {
        let mut stated = Stated(self.rate_hz.0.clone());
        if let (Some(analog_hz), Some(channels @ 1..)) = (self.analog_rate_hz, self.channels)
            && layout.analog_values >= channels
        {
            let samples = layout.analog_values / channels;
            stated.0.push((analog_hz / samples as f64, "ANALOG:RATE over samples per frame"));
        }
        let votes =
            |rate_hz: f64| stated.0.iter().filter(|(other, _)| is_same(rate_hz, *other)).count();
        let most = stated.0.iter().map(|(rate_hz, _)| votes(*rate_hz)).max().unwrap_or(0);
        let mut winners =
            stated.0.iter().map(|(rate_hz, _)| *rate_hz).filter(|rate_hz| votes(*rate_hz) == most);
        let Some(used) = winners.next() else { return Ok(None) };
        if winners.any(|other| !is_same(used, other)) {
            return Err(FileProblem::new(
                format!("contradictory frame rates, Hz: {stated}"),
                "one frame rate, because it is unknown which is correct; export the file again",
            ));
        }
        if most < stated.0.len() {
            notes.push(format!("frame rate, Hz: found {stated}, used {used}"));
        }
        Ok(Some(used))
    }

    /// Returns the number of the first frame. Adds a note if the file states another number, too: numbers of frames
    /// occur only in messages and tables, so that they need not be certain.
    pub(super) fn first_frame(&self, layout: Layout, notes: &mut Vec<String>) -> i64 {
        let is_admitted = |place: &str| {
            let count = self.frames.0.iter().find(|(_, name)| name.starts_with(place));
            count.is_some_and(|(count, _)| count.admits(layout.frame_count))
        };
        let [(start, _), .., (word, _)] = self.first_frame.0[..] else {
            return self.first_frame.0.first().map_or(0, |(first, _)| *first);
        };
        let is_range = is_admitted("TRIAL") || !is_admitted("header");
        // The word is 16 bits long; a larger number is stated as the largest or wraps around.
        let max = MAX_U16 as i64;
        let is_word = start == word || start > max && (word == max || word == start % (max + 1));
        let used = if is_range { start } else { word };
        if !is_word {
            notes.push(format!("first frame: found {}, used {used}", self.first_frame));
        }
        used
    }

    /// Returns the length of one step of integer data, in the file's unit.
    ///
    /// # Errors
    /// Returns an error if the stated scales differ: it is unknown which is right, and the scale affects all positions.
    pub(super) fn integer_scale(&self) -> Result<f64, FileProblem> {
        let positive: Vec<_> = self.scale.0.iter().filter(|(scale, _)| *scale > 0.0).collect();
        match positive[..] {
            [(first, _), (second, _)] if !is_same(*first, *second) => Err(FileProblem::new(
                format!("two scales of the positions: {}", self.scale),
                "one scale, because it is unknown which scale is correct; export the file again with \
                 floating-point coordinates",
            )),
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
        if self.frames.0.is_empty() {
            return Err(FileProblem::new("no frames", "at least one frame"));
        }
        let data = &content[..self.data_end.min(content.len())];
        let stated = self.layouts(&self.analog_values.values());
        let mut filling: Vec<Layout> =
            stated.iter().filter_map(|layout| self.filled(*layout, data)).collect();
        if filling.is_empty() {
            let by_rates = self.layouts(self.analog_values_by_rates.as_slice());
            filling = by_rates.iter().filter_map(|layout| self.filled(*layout, data)).collect();
            filling.extend(stated.iter().flat_map(|layout| self.wrapped(*layout, data)));
        }
        filling.retain(|layout| self.is_decided(*layout));
        if stated.len() > 1 || self.agreed_frames().is_none() && self.has_counts() {
            filling.retain(|layout| ends_in_zeros(data, *layout));
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
        match (&filling[..], &stated[..], self.agreed_frames()) {
            (&[only], ..) => Ok((only, self.notes(only))),
            ([], &[layout], Some(frames)) if self.filled(layout, data).is_none() => {
                Err(self.not_filled(layout, frames, data))
            }
            _ => Err(self.contradiction(&stated, data)),
        }
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
    /// count as padding. If all stated counts are lower limits, the count follows from the size. Returns `None` if
    /// there is no such count.
    fn filled(&self, layout: Layout, data: &[u8]) -> Option<Layout> {
        let bytes = data.len().checked_sub(layout.data_start)?;
        let frame = layout.frame_bytes();
        let with = |frame_count: usize| Layout { frame_count, ..layout };
        if !self.has_counts() {
            // Zeros that pad the last block are not a frame.
            let mut count = bytes / frame;
            while count > 0
                && bytes - (count - 1) * frame < BLOCK
                && !self.is_contradicted(count - 1)
                && is_blank(data, with(count), count - 1)
            {
                count -= 1;
            }
            return Some(with(count)).filter(|_| !self.is_contradicted(count));
        }
        let mut counts: Vec<usize> =
            self.frames.0.iter().filter_map(|(count, _)| count.stated()).collect();
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

    /// Returns the layouts with frame counts beyond 65535 of which a place states only the remainder modulo 65536, and
    /// that match the size of the data.
    fn wrapped(&self, layout: Layout, data: &[u8]) -> Vec<Layout> {
        let Some(bytes) = data.len().checked_sub(layout.data_start) else { return Vec::new() };
        let frame = layout.frame_bytes();
        let mut counts = Vec::new();
        for count in self.frames.values() {
            let FrameCount::Short(count) = count else { continue };
            let Some(more) = (bytes / frame).checked_sub(count) else { continue };
            let count = count + more / (MAX_U16 + 1) * (MAX_U16 + 1);
            let fills = is_padding(&data[layout.data_start + count * frame..]);
            if count > MAX_U16 && fills && !counts.contains(&count) {
                counts.push(count);
            }
        }
        counts.into_iter().map(|frame_count| Layout { frame_count, ..layout }).collect()
    }

    /// Returns whether the rates of points and analog samples imply this number of analog values per frame, and the
    /// header states either the same number or, as some programs do, the number of channels.
    fn is_by_rates(&self, analog_values: usize) -> bool {
        let in_header = self.analog_values.0.last().map(|(values, _)| *values);
        let is_in_header = in_header == Some(analog_values) || in_header == self.channels;
        self.analog_values_by_rates == Some(analog_values) && is_in_header
    }

    /// Returns whether the size of the data decides which stated values are right. In a short recording, one value more
    /// in each frame takes up less than a block, so that only the rates decide.
    fn is_decided(&self, layout: Layout) -> bool {
        let is_long = layout.frame_count * layout.value_bytes() >= BLOCK;
        let is_analog_decided = if self.analog_values.is_contradictory() {
            self.is_by_rates(layout.analog_values)
        } else {
            self.analog_values_by_rates.is_none_or(|by_rates| by_rates == layout.analog_values)
        };
        let formats = self.scale.0.windows(2).any(|pair| pair[0].0 * pair[1].0 < 0.0);
        is_long || is_analog_decided && !self.points.is_contradictory() && !formats
    }

    /// Returns whether any place in the file states a number of frames that is not only a lower limit.
    fn has_counts(&self) -> bool {
        self.frames.0.iter().any(|(count, _)| count.stated().is_some())
    }

    /// Returns whether a place in the file states another number of frames.
    fn is_contradicted(&self, frames: usize) -> bool {
        self.frames.0.iter().any(|(count, _)| !count.admits(frames))
    }

    /// Returns the number of frames on which all places in the file agree; `None` if there is none.
    fn agreed_frames(&self) -> Option<usize> {
        let stated = self.frames.0.iter().filter_map(|(count, _)| count.stated());
        stated.max().filter(|frames| !self.is_contradicted(*frames))
    }

    /// Returns the error for counts on which all places agree, but that the size of the data contradicts.
    fn not_filled(&self, layout: Layout, frames: usize, data: &[u8]) -> FileProblem {
        let Layout { points, analog_values, is_float, data_start, .. } = layout;
        let frame = layout.frame_bytes();
        let bytes = data.len().saturating_sub(data_start);
        let format = if is_float { "floating-point numbers" } else { "integers" };
        let of = format!(
            "of {frame} bytes each ({points} points, {analog_values} analog values, {format})"
        );
        if bytes / frame < frames {
            let found = format!("{} of {frames} frames {of}", bytes / frame);
            return FileProblem::new(found, "all frames; is the copy of the file complete?");
        }
        let over = bytes - frames * frame;
        FileProblem::new(
            format!("{frames} frames {of} and {over} bytes of data after them"),
            "counts that account for all data up to less than a block of 512 bytes; export the file again",
        )
    }

    /// Returns the error that lists the contradictory counts.
    fn contradiction(&self, stated: &[Layout], data: &[u8]) -> FileProblem {
        let mut sizes: Vec<String> = stated
            .iter()
            .map(|layout| data.len().saturating_sub(layout.data_start).to_string())
            .collect();
        sizes.dedup();
        let mut analog_values = Stated(self.analog_values.0.clone());
        let by_rates = self.analog_values_by_rates;
        analog_values
            .0
            .extend(by_rates.map(|values| (values, "ANALOG:USED x ANALOG:RATE / POINT:RATE")));
        let found = format!(
            "counts that contradict each other or the file's size: points {}, analog values per frame {}, \
             scale {}, frames {}, first byte {}, in {} bytes of data",
            self.points,
            analog_values,
            self.scale,
            self.frames,
            self.data_start,
            sizes.join(" or ")
        );
        let needed = "counts that agree in header and parameters and account for all data up to less than a block of \
             512 bytes; export the file again";
        FileProblem::new(found, needed)
    }

    /// Lists how contradictory counts were resolved, with all stated values.
    fn notes(&self, layout: Layout) -> Vec<String> {
        let mut notes = Vec::new();
        let mut note = |quantity: &str, stated: &dyn fmt::Display, used: String| {
            notes.push(format!("{quantity}: found {stated}, used {used}"));
        };
        let Layout { points, analog_values, is_float, data_start, frame_count } = layout;
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
        if self.data_start.is_contradictory() {
            note("first byte of the data", &self.data_start, data_start.to_string());
        }
        // A count of which only the remainder is stated has to be confirmed by a place that states all of it.
        let counts = self.frames.values();
        let is_remainder = !counts.contains(&FrameCount::Exact(frame_count))
            && counts.iter().any(|count| count.stated().is_some_and(|count| count != frame_count));
        if self.is_contradicted(frame_count) || is_remainder {
            note("frames", &self.frames, frame_count.to_string());
        }
        notes
    }
}

/// Returns a parameter of the group POINT if it is finite and not zero.
fn nonzero(parameters: &Parameters, name: &str) -> Option<f64> {
    parameters.number("POINT", name).filter(|x| x.is_finite() && *x != 0.0)
}

/// Returns whether two scales or rates are equal up to rounding.
fn is_same(one: f64, other: f64) -> bool {
    (one / other - 1.0).abs() <= RELATIVE_TOLERANCE
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

/// Returns whether the last frame of a layout has a value other than zero and only zeros follow it, as padding.
fn ends_in_zeros(data: &[u8], layout: Layout) -> bool {
    let end = layout.data_start + layout.frame_count * layout.frame_bytes();
    let is_padded = data.get(end..).is_some_and(|rest| rest.iter().all(|&byte| byte == 0));
    is_padded && layout.frame_count > 0 && !is_blank(data, layout, layout.frame_count - 1)
}
