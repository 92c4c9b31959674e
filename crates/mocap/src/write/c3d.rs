//! Writes C3D files (<https://www.c3d.org>).

use crate::Recording;
use crate::markers::MISSING;

const BLOCK: usize = 512;
/// Maximum number of labels in a list, and maximum number of bytes in a label.
const MAX_LIST: usize = 255;
/// Residual that marks a point as occluded.
const UNSEEN: f32 = -1.0;
/// Maximum value of an unsigned 16-bit word.
const MAX_WORD: usize = 65_535;

/// Encodes a recording as Nexus 2 writes it to C3D: little-endian floats, mm, and a residual of -1 where a marker is
/// occluded. Frames missing from the recording are written with all markers occluded; an unknown rate is written as 0.
pub fn c3d_bytes(markers: &Recording) -> Vec<u8> {
    let first = markers.frames.first().copied().unwrap_or(1);
    let last = markers.frames.last().copied().unwrap_or(first - 1);
    let metadata = Metadata {
        rate_hz: markers.rate_hz.unwrap_or(0.0) as f32,
        first_frame: first.max(0) as usize,
        last_frame: last.max(0) as usize,
        labels: &markers.labels,
    };
    // The position of the data is itself one of the parameters and does not change their length.
    let blocks = parameters(&metadata, 0).len() / BLOCK;
    let data_start = 2 + blocks;
    let mut file = header(&metadata, data_start);
    file.extend(parameters(&metadata, data_start));
    let mut next = 0;
    for frame in first..=last {
        let is_there = markers.frames[next] == frame;
        for marker in 0..markers.labels.len() {
            let position = if is_there { markers.position_mm(next, marker) } else { MISSING };
            let is_seen = !position[0].is_nan();
            let [x, y, z] = if is_seen { position.map(|x| x as f32) } else { [0.0; 3] };
            let residual = if is_seen { 0.0 } else { UNSEEN };
            file.extend([x, y, z, residual].into_iter().flat_map(f32::to_le_bytes));
        }
        next += usize::from(is_there);
    }
    file.resize(file.len().next_multiple_of(BLOCK), 0);
    file
}

/// Metadata of a recording as written to a C3D file.
struct Metadata<'m> {
    rate_hz: f32,
    first_frame: usize,
    last_frame: usize,
    labels: &'m [String],
}

/// Builds the first block of the file, which can be read without the parameters.
fn header(metadata: &Metadata, data_start: usize) -> Vec<u8> {
    let mut header = vec![2, 0x50];
    let no_analog = 0;
    let longest_gap = 0;
    let analog_per_frame = 0;
    for number in
        [metadata.labels.len(), no_analog, metadata.first_frame, metadata.last_frame, longest_gap]
    {
        header.extend(word(number));
    }
    header.extend((-1.0_f32).to_le_bytes());
    header.extend(word(data_start));
    header.extend(word(analog_per_frame));
    header.extend(metadata.rate_hz.to_le_bytes());
    header.resize(BLOCK, 0);
    header
}

/// Builds the parameter section, padded to whole blocks.
fn parameters(metadata: &Metadata, data_start: usize) -> Vec<u8> {
    const POINT: i8 = 1;
    const TRIAL: i8 = 2;
    const ANALOG: i8 = 3;
    let mut to = vec![1, 0x50, 0, 84];
    for (group, name) in [(POINT, "POINT"), (TRIAL, "TRIAL"), (ANALOG, "ANALOG")] {
        record(&mut to, -group, name, &[]);
    }
    let points = metadata.labels.len();
    let frames = metadata.last_frame + 1 - metadata.first_frame;
    for (group, name, number) in [
        (POINT, "USED", points),
        (POINT, "FRAMES", frames),
        (POINT, "DATA_START", data_start),
        (ANALOG, "USED", 0),
    ] {
        record(&mut to, group, name, &[&[2, 0], &word(number)[..]].concat());
    }
    for (name, number) in [("SCALE", -1.0), ("RATE", metadata.rate_hz)] {
        record(&mut to, POINT, name, &[&[4, 0], &number.to_le_bytes()[..]].concat());
    }
    texts(&mut to, POINT, "UNITS", &["mm".to_owned()]);
    for (i, labels) in metadata.labels.chunks(MAX_LIST).enumerate() {
        let name = if i == 0 { "LABELS".to_owned() } else { format!("LABELS{}", i + 1) };
        texts(&mut to, POINT, &name, labels);
    }
    for (name, frame) in
        [("ACTUAL_START_FIELD", metadata.first_frame), ("ACTUAL_END_FIELD", metadata.last_frame)]
    {
        let [low, high] = [frame & MAX_WORD, frame >> 16].map(word);
        record(&mut to, TRIAL, name, &[&[2, 1, 2], &low[..], &high].concat());
    }
    // A name of length zero marks the end of the parameters.
    to.resize((to.len() + 2).next_multiple_of(BLOCK), 0);
    to[2] = (to.len() / BLOCK) as u8;
    to
}

/// Appends a group (negative id) or a parameter of a group, without a description.
fn record(to: &mut Vec<u8>, id: i8, name: &str, content: &[u8]) {
    to.extend([name.len() as u8, id.cast_unsigned()]);
    to.extend(name.as_bytes());
    to.extend(word(2 + content.len() + 1));
    to.extend(content);
    to.push(0);
}

/// Appends a parameter that is a list of strings.
fn texts(to: &mut Vec<u8>, group: i8, name: &str, texts: &[String]) {
    let width = texts.iter().map(String::len).max().unwrap_or(0).min(MAX_LIST);
    let mut content = vec![(-1_i8).cast_unsigned(), 2, width as u8, texts.len() as u8];
    for text in texts {
        let bytes = text.bytes().chain(std::iter::repeat(b' '));
        content.extend(bytes.take(width));
    }
    record(to, group, name, &content);
}

/// Encodes a number in two bytes; a number that does not fit is encoded as the maximum, as camera systems do.
fn word(number: usize) -> [u8; 2] {
    (number.min(MAX_WORD) as u16).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::{LengthUnit, parse_markers};

    #[test]
    fn a_recording_is_read_as_it_was_written() {
        let mut positions = vec![MISSING; 600];
        for (i, position) in positions.iter_mut().enumerate().filter(|(i, _)| i % 7 != 0) {
            *position = [i as f64, -0.5 * i as f64, 62.0];
        }
        // More labels than fit into one list, and more frames than fit into the header's words.
        let written = Recording::new(
            Some(120.0),
            vec![65_535, 65_536],
            (0..300).map(|i| format!("Snake:M{i}")).collect(),
            positions,
        );
        let read = |file: &[u8]| parse_markers(Path::new("a.c3d"), file, LengthUnit::Mm).unwrap();
        assert_eq!(format!("{:?}", read(&c3d_bytes(&written))), format!("{written:?}"));
        let with_a_jump = Recording { frames: vec![65_535, 65_537], ..written };
        let read = read(&c3d_bytes(&with_a_jump));
        assert_eq!(read.frames, [65_535, 65_536, 65_537]);
        assert!(read.row_mm(1).iter().flatten().all(|x| x.is_nan()));
        assert_eq!(format!("{:?}", read.row_mm(2)), format!("{:?}", with_a_jump.row_mm(1)));
    }
}
