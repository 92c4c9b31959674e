//! Reads C3D, a binary motion-capture format (<https://www.c3d.org>): a header of 512 bytes, a parameter section, then
//! for each frame every point (X, Y, Z, residual) and every analog sample.
//!
//! Everything that a file states about its own size is checked against its actual size.

mod counts;
mod parameters;
mod stated;

#[cfg(test)]
mod tests;

use std::path::Path;

use super::cells::{label_text, shown};
use super::markers::{MAX_MM, MISSING};
use super::{FileProblem, Recording, Section, units};
use crate::LengthUnit;
use counts::{Counts, Layout};
use parameters::{ByteOrder, Parameters};

const BLOCK: usize = 512;
/// Maximum number of blocks in a parameter section; the format stores their number in one byte.
const MAX_PARAMETER_BLOCKS: usize = 255;
/// Second byte of every C3D file, by which the format is recognised.
const MAGIC: u8 = 0x50;
/// Parameters that list the points that are model outputs rather than markers.
const MODEL_OUTPUTS: [&str; 5] = ["ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS"];

/// Returns whether a file is C3D, according to its content or its name.
pub(super) fn is_c3d(path: &Path, content: &[u8]) -> bool {
    let name = path.to_string_lossy().to_ascii_lowercase();
    let is_named = name.strip_suffix(".gz").unwrap_or(&name).ends_with(".c3d");
    let has_magic = content.get(1) == Some(&MAGIC);
    let section = parameter_section(content);
    is_named || has_magic && section.is_some_and(|section| ByteOrder::detect(section).is_ok())
}

/// Returns the bytes that may belong to the parameter section: from its start to the maximum length of such a section.
/// Returns `None` if the start that the file states is not within the file.
fn parameter_section(content: &[u8]) -> Option<&[u8]> {
    let block = usize::from(*content.first()?).checked_sub(1)?;
    let section = content.get(block * BLOCK..)?;
    Some(&section[..section.len().min(MAX_PARAMETER_BLOCKS * BLOCK)])
}

/// Parses the markers in a C3D file; `unit` applies if the file does not state a unit.
pub(super) fn parse(content: &[u8], unit: LengthUnit) -> Result<Recording, FileProblem> {
    let mut contents = Contents::read(content)?;
    let stated_mm = contents.mm_per_unit()?;
    if stated_mm.is_none() {
        contents.doubts.push(format!("unit: found none (POINT:UNITS), used {unit} (vicon.unit)"));
    }
    let mm_per_unit = stated_mm.unwrap_or(unit.mm());
    let markers = contents.markers()?;
    let mut positions_mm = Vec::with_capacity(markers.len() * contents.layout.frame_count);
    for (i, frame) in contents.frames(content).enumerate() {
        for (point, label) in &markers {
            let seen = contents.position(frame, *point).unwrap_or(MISSING);
            let position = seen.map(|x| x * mm_per_unit);
            if let Some(x) = position.iter().find(|x| x.abs() > MAX_MM) {
                let frame = contents.first_frame + i as i64;
                let found = format!("{x} mm for {label} in frame {frame}");
                return Err(FileProblem::new(found, "coordinates of at most a kilometre"));
            }
            positions_mm.push(position);
        }
    }
    let frames = (contents.first_frame..).take(contents.layout.frame_count).collect();
    let labels = markers.into_iter().map(|(_, label)| label).collect();
    let recording = Recording::new(contents.rate_hz, frames, labels, positions_mm);
    Ok(Recording { doubts: contents.doubts, ..recording })
}

/// Lists points and analog samples as if they were sections in a CSV export.
pub(super) fn sections(content: &[u8]) -> Result<Vec<Section>, FileProblem> {
    let contents = Contents::read(content)?;
    let frame_count = contents.layout.frame_count;
    let per_frame = contents.analog_per_frame;
    let mut sections = vec![Section {
        name: "Points".to_owned(),
        line: 0,
        rate_hz: contents.rate_hz,
        rows: frame_count,
    }];
    if contents.layout.analog_values > 0 {
        sections.push(Section {
            name: "Analog".to_owned(),
            line: 0,
            rate_hz: contents.rate_hz.map(|rate_hz| rate_hz * per_frame as f64),
            rows: frame_count.saturating_mul(per_frame),
        });
    }
    Ok(sections)
}

/// Parameters, frame layout and metadata of a C3D file.
struct Contents<'f> {
    parameters: Parameters<'f>,
    layout: Layout,
    /// Number of analog samples per channel and frame.
    analog_per_frame: usize,
    first_frame: i64,
    rate_hz: Option<f64>,
    /// Length of one step of integer data, in the file's unit; not used for floats.
    scale: f64,
    /// Notes on missing or contradictory metadata and on the values used instead.
    doubts: Vec<String>,
}

impl<'f> Contents<'f> {
    fn read(content: &'f [u8]) -> Result<Self, FileProblem> {
        let header = content.get(..BLOCK).filter(|header| header[1] == MAGIC).ok_or_else(|| {
            FileProblem::new("no C3D header", "a header of 512 bytes, the second of which is 0x50")
        })?;
        let section = parameter_section(content).ok_or_else(|| {
            FileProblem::new("no parameter section", "a parameter section within the file")
        })?;
        let order = ByteOrder::detect(section).map_err(|found| {
            FileProblem::new(format!("processor type {found}"), "84 (Intel), 85 (DEC) or 86 (MIPS)")
        })?;
        let word = |number: usize| {
            let at = 2 * (number - 1);
            usize::from(order.u16([header[at], header[at + 1]]))
        };
        // The section ends where the data begin, or else after the number of blocks that the section states.
        let blocks = match word(9).checked_sub(usize::from(header[0])) {
            Some(blocks) if blocks > 0 => blocks,
            _ => section.get(2).map_or(0, |&blocks| blocks.into()),
        };
        let parameters = Parameters::read(section, blocks * BLOCK, order).ok_or_else(|| {
            FileProblem::new(
                "a truncated or damaged parameter section",
                "a complete parameter section",
            )
        })?;
        let counts = Counts::read(header, &parameters, content.len());
        if counts.has_no_points() {
            return Err(no_points(&parameters, word(3)));
        }
        let (layout, mut doubts) = counts.layout(content)?;
        let analog_per_frame = match parameters.number("ANALOG", "USED") {
            Some(channels) if channels >= 1.0 => layout.analog_values / channels as usize,
            _ => word(10),
        };
        Ok(Self {
            scale: if layout.is_float { -1.0 } else { counts.integer_scale()? },
            layout,
            analog_per_frame,
            first_frame: counts.first_frame(layout, &mut doubts),
            rate_hz: counts.rate_hz(layout, &mut doubts)?,
            doubts,
            parameters,
        })
    }

    /// Returns the index and label of every point that is a marker. Points without a label, or with a placeholder such
    /// as `*12`, are left out, as are model outputs.
    fn markers(&self) -> Result<Vec<(usize, String)>, FileProblem> {
        let texts = |name: &str| self.parameters.texts("POINT", name);
        let lists: Vec<(&str, Vec<&[u8]>)> =
            MODEL_OUTPUTS.iter().filter_map(|name| Some((*name, texts(name)?))).collect();
        let more = (2..).map_while(|i| texts(&format!("LABELS{i}"))).flatten();
        let labels = texts("LABELS").unwrap_or_default().into_iter().chain(more);
        let labelled: Vec<(usize, &[u8])> = labels
            .take(self.layout.points)
            .enumerate()
            .filter(|(_, label)| !label.is_empty() && label[0] != b'*')
            .collect();
        let list_of = |label: &[u8]| {
            lists.iter().find(|(_, labels)| labels.contains(&label)).map(|(name, _)| *name)
        };
        let markers: Vec<(usize, String)> = labelled
            .iter()
            .filter(|(_, label)| list_of(label).is_none())
            .map(|(point, label)| (*point, label_text(label)))
            .collect();
        if !markers.is_empty() {
            return Ok(markers);
        }
        let all = self.layout.points;
        let outputs = labelled.len();
        let mut found = Vec::new();
        if outputs > 0 {
            let mut named: Vec<&str> =
                labelled.iter().filter_map(|(_, label)| list_of(label)).collect();
            named.dedup();
            let named: Vec<String> = named.iter().map(|name| format!("POINT:{name}")).collect();
            found.push(format!(
                "{outputs} points that are model outputs ({}) instead of markers",
                named.join(", ")
            ));
        }
        if all > outputs {
            found.push(format!("{} points without a label", all - outputs));
        }
        let needed = "at least one marker in POINT:LABELS; export the labelled trajectories";
        Err(FileProblem::new(found.join(" and "), needed))
    }

    /// Returns the number of millimetres per unit of the file; `None` if the file does not state a unit.
    fn mm_per_unit(&self) -> Result<Option<f64>, FileProblem> {
        let units = self.parameters.texts("POINT", "UNITS").unwrap_or_default();
        match units.first().copied().unwrap_or_default() {
            b"" => Ok(None),
            unit => match units::parse(unit) {
                Some(unit) => Ok(Some(unit.mm())),
                None => {
                    let found = format!("POINT:UNITS `{}`", shown(unit));
                    Err(FileProblem::new(found, units::needed()))
                }
            },
        }
    }

    /// Iterates over the frames, yielding the bytes of each.
    fn frames<'c>(&self, content: &'c [u8]) -> impl Iterator<Item = &'c [u8]> {
        let data = content.get(self.layout.data_start..).unwrap_or_default();
        data.chunks_exact(self.layout.frame_bytes()).take(self.layout.frame_count)
    }

    /// Returns the position of a point in the file's unit; `None` if the point is occluded.
    fn position(&self, frame: &[u8], point: usize) -> Option<[f64; 3]> {
        let order = self.parameters.order;
        let (position, residual) = if self.layout.is_float {
            let [x, y, z, residual] = values::<4>(frame, point)?.map(|bytes| order.f32(bytes));
            ([x, y, z].map(f64::from), residual)
        } else {
            let [x, y, z, residual] = values::<2>(frame, point)?.map(|bytes| order.i16(bytes));
            ([x, y, z].map(|x| f64::from(x) * self.scale), f32::from(residual))
        };
        (residual >= 0.0 && position.iter().all(|x| !x.is_nan())).then_some(position)
    }
}

/// Returns the four values of a point in a frame (X, Y, Z, residual), as `N` bytes each; `None` if the frame is too
/// short.
fn values<const N: usize>(frame: &[u8], point: usize) -> Option<[[u8; N]; 4]> {
    frame.as_chunks::<N>().0.get(4 * point..)?.first_chunk().copied()
}

/// Returns the error for a file without points.
fn no_points(parameters: &Parameters, analog_values: usize) -> FileProblem {
    let rotations = parameters.number("ROTATION", "USED").filter(|used| *used > 0.0);
    let instead = match (rotations, analog_values) {
        (Some(rotations), _) => format!("only rotations of {rotations} segments"),
        (None, 0) => "as in files that contain only rotations or events".to_owned(),
        (None, _) => "only analog channels".to_owned(),
    };
    let found = format!("no points (POINT:USED is 0), {instead}");
    FileProblem::new(found, "positions of markers; export the labelled trajectories")
}
