//! C3D, the cameras' binary format (<https://www.c3d.org>): a header of 512 bytes, a section of
//! parameters, then frame by frame every point (X, Y, Z, residual) and every analog sample.
//!
//! Everything that the file states about its own size is checked against the bytes that are there.

mod parameters;

#[cfg(test)]
mod tests;

use std::path::Path;

use super::cells::shown;
use super::markers::{LARGEST_MM, MISSING};
use super::{MarkerFile, Problem, Section};
use parameters::{ByteOrder, Parameters, bytes_at, decimal};

const BLOCK: usize = 512;
/// Blocks that a section of parameters can have: they are counted by one byte.
const MOST_PARAMETER_BLOCKS: usize = 255;
/// Second byte of every C3D file.
const MAGIC: u8 = 0x50;
/// Lists of points that are not markers but what models made of them.
const MODEL_OUTPUTS: [&str; 5] = ["ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS"];

/// Whether a file is C3D, by its content or else by its name.
pub(super) fn is_c3d(path: &Path, content: &[u8]) -> bool {
    let name = path.to_string_lossy().to_ascii_lowercase();
    let is_named = name.strip_suffix(".gz").unwrap_or(&name).ends_with(".c3d");
    let order = || ByteOrder::of(parameter_section(content)?).ok();
    is_named || content.get(1) == Some(&MAGIC) && order().is_some()
}

/// The bytes from the parameters' start that can belong to them.
fn parameter_section(content: &[u8]) -> Option<&[u8]> {
    let block = usize::from(*content.first()?).checked_sub(1)?;
    let section = content.get(block * BLOCK..)?;
    Some(&section[..section.len().min(MOST_PARAMETER_BLOCKS * BLOCK)])
}

/// The markers of a C3D file.
pub(super) fn parse(content: &[u8]) -> Result<MarkerFile, Problem> {
    let contents = Contents::read(content)?;
    let mm_per_unit = contents.mm_per_unit()?;
    // First: labels are cheap to invent, frames are not.
    let data = contents.frames(content)?;
    let markers = contents.markers()?;
    let mut positions_mm = Vec::with_capacity(markers.len() * contents.frame_count);
    for (i, frame) in data.enumerate() {
        for (point, label) in &markers {
            let seen = contents.position(frame, *point).unwrap_or(MISSING);
            let position = seen.map(|x| x * mm_per_unit);
            if let Some(x) = position.iter().find(|x| x.abs() > LARGEST_MM) {
                let frame = contents.first_frame + i as i64;
                let found = format!("{x} mm for {label} in frame {frame}");
                return Err(Problem::new(found, "a number of mm within a kilometre"));
            }
            positions_mm.push(position);
        }
    }
    Ok(MarkerFile {
        rate_hz: contents.rate_hz,
        frames: (contents.first_frame..).take(contents.frame_count).collect(),
        labels: markers.into_iter().map(|(_, label)| label).collect(),
        rows_without_frame: 0,
        rows_too_long: 0,
        positions_mm,
    })
}

/// Points and analog samples as if they were sections of an export.
pub(super) fn sections(content: &[u8]) -> Result<Vec<Section>, Problem> {
    let contents = Contents::read(content)?;
    let section =
        |name: &str, rate_hz, rows| Section { name: name.to_owned(), line: 0, rate_hz, rows };
    let per_frame = contents.analog_per_frame;
    let analog_hz = contents.rate_hz.map(|rate_hz| rate_hz * per_frame as f64);
    let points = section("Points", contents.rate_hz, contents.frame_count);
    let analog = section("Analog", analog_hz, contents.frame_count.saturating_mul(per_frame));
    Ok([points].into_iter().chain((contents.analog_values > 0).then_some(analog)).collect())
}

/// What the header and the parameters state of the data.
struct Contents<'f> {
    parameters: Parameters<'f>,
    points: usize,
    /// Analog values a frame, all channels.
    analog_values: usize,
    /// Analog samples a frame and channel.
    analog_per_frame: usize,
    first_frame: i64,
    frame_count: usize,
    rate_hz: Option<f64>,
    /// Millimetres (or metres) a step of integer data; floats have a negative one.
    scale: f64,
    /// First byte of the data.
    data_start: usize,
}

impl<'f> Contents<'f> {
    fn read(content: &'f [u8]) -> Result<Self, Problem> {
        let header = content.get(..BLOCK).filter(|header| header[1] == MAGIC).ok_or_else(|| {
            Problem::new("no C3D header", "512 bytes of which the second is 0x50")
        })?;
        let section = parameter_section(content)
            .ok_or_else(|| Problem::new("no parameter section", "one inside the file"))?;
        let order = ByteOrder::of(section).map_err(|found| {
            Problem::new(format!("processor type {found}"), "84 (Intel), 85 (DEC) or 86 (MIPS)")
        })?;
        let parameters = Parameters::read(section, order)
            .ok_or_else(|| Problem::new("a cut or damaged parameter section", "a whole one"))?;
        let word = |i: usize| order.u16([header[2 * i], header[2 * i + 1]]);
        // A number is taken from the parameters or else from the header.
        let real = |name: &str, i: usize| {
            let in_header = || Some(decimal(order.f32(bytes_at(header, 2 * i)?)));
            parameters.number("POINT", name).or_else(in_header).unwrap_or(0.0)
        };
        let whole = |name: &str| Some(usize::from(parameters.number("POINT", name)? as u16));
        let (first_frame, last_frame) = frame_range(&parameters, word(3), word(4));
        let data_block = match word(8) {
            0 => whole("DATA_START").unwrap_or(0),
            block => usize::from(block),
        };
        let data_start = data_block.checked_sub(1).map(|block| block * BLOCK);
        Ok(Self {
            points: whole("USED").unwrap_or(usize::from(word(1))),
            analog_values: usize::from(word(2)),
            analog_per_frame: usize::from(word(9)),
            first_frame,
            frame_count: usize::try_from(last_frame - first_frame + 1).unwrap_or(0),
            rate_hz: Some(real("RATE", 10)).filter(|hz| *hz > 0.0 && hz.is_finite()),
            scale: real("SCALE", 6),
            data_start: data_start
                .ok_or_else(|| Problem::new("no place of the data", "POINT:DATA_START"))?,
            parameters,
        })
    }

    /// Index and label of every point that is a marker. Unlabelled points have none, or `*12`.
    fn markers(&self) -> Result<Vec<(usize, String)>, Problem> {
        let texts = |name: &str| self.parameters.texts("POINT", name);
        let outputs: Vec<&[u8]> =
            MODEL_OUTPUTS.iter().filter_map(|name| texts(name)).flatten().collect();
        let more = (2..).map_while(|i| texts(&format!("LABELS{i}"))).flatten();
        let labels = texts("LABELS").unwrap_or_default().into_iter().chain(more);
        let is_marker =
            |label: &[u8]| !label.is_empty() && label[0] != b'*' && !outputs.contains(&label);
        let markers = labels.take(self.points).enumerate().filter(|(_, label)| is_marker(label));
        let text = |(point, label)| (point, String::from_utf8_lossy(label).into_owned());
        let markers: Vec<(usize, String)> = markers.map(text).collect();
        if markers.is_empty() {
            let found = format!("{} points without a label", self.points);
            return Err(Problem::new(found, "at least one marker in POINT:LABELS"));
        }
        Ok(markers)
    }

    fn mm_per_unit(&self) -> Result<f64, Problem> {
        let units = self.parameters.texts("POINT", "UNITS").unwrap_or_default();
        match units.first().copied().unwrap_or_default() {
            b"mm" => Ok(1.0),
            b"m" => Ok(1000.0),
            unit => Err(Problem::new(format!("POINT:UNITS `{}`", shown(unit)), "`mm` or `m`")),
        }
    }

    fn is_float(&self) -> bool {
        self.scale < 0.0
    }

    /// The bytes of each frame.
    fn frames<'c>(&self, content: &'c [u8]) -> Result<impl Iterator<Item = &'c [u8]>, Problem> {
        let value = if self.is_float() { 4 } else { 2 };
        let frame = value * (4 * self.points + self.analog_values);
        let data = content.get(self.data_start..).unwrap_or_default();
        if self.frame_count == 0 || frame == 0 {
            return Err(Problem::new("no frames", "at least one"));
        }
        let whole = data.len() / frame;
        if whole < self.frame_count {
            let found = format!("{whole} of {} frames", self.frame_count);
            return Err(Problem::new(found, "all of them; is the copy complete?"));
        }
        Ok(data.chunks_exact(frame).take(self.frame_count))
    }

    /// Where a point was, in the file's unit; `None` if the cameras did not see it.
    fn position(&self, frame: &[u8], point: usize) -> Option<[f64; 3]> {
        let order = self.parameters.order;
        let (position, residual) = if self.is_float() {
            let [x, y, z, residual] = values::<4>(frame, point)?.map(|bytes| order.f32(bytes));
            ([x, y, z].map(f64::from), residual)
        } else {
            let [x, y, z, residual] = values::<2>(frame, point)?.map(|bytes| order.i16(bytes));
            ([x, y, z].map(|x| f64::from(x) * self.scale), f32::from(residual))
        };
        (residual >= 0.0 && position.iter().all(|x| !x.is_nan())).then_some(position)
    }
}

/// The four values of a point in a frame.
fn values<const N: usize>(frame: &[u8], point: usize) -> Option<[[u8; N]; 4]> {
    frame.as_chunks::<N>().0.get(4 * point..)?.first_chunk().copied()
}

/// First and last frame. The header's words end at 65535; longer files have parameters.
fn frame_range(parameters: &Parameters<'_>, first: u16, last: u16) -> (i64, i64) {
    let long = |name: &str| match parameters.numbers("TRIAL", name)?[..] {
        [low, high, ..] => Some(i64::from(low as u16) + 65536 * i64::from(high as u16)),
        _ => None,
    };
    if let Some(range) = long("ACTUAL_START_FIELD").zip(long("ACTUAL_END_FIELD")) {
        return range;
    }
    let first = i64::from(first);
    let counted = parameters.number("POINT", "LONG_FRAMES");
    let last = counted.map_or(i64::from(last), |frames| first + i64::from(frames as u32) - 1);
    (first, last)
}
