//! C3D (<https://www.c3d.org>).

use crate::Recording;
use crate::markers::MISSING;

const BLOCK: usize = 512;
/// Labels that one list can hold, and bytes that one label can have.
const LONGEST_LIST: usize = 255;
/// What the residual says of a point that was not seen.
const UNSEEN: f32 = -1.0;
/// Largest number of a word without sign.
const LARGEST_WORD: usize = 65_535;

/// A recording as Nexus 2 writes it to C3D: little-endian floats, mm, a residual of -1 where a marker was
/// not seen. Frames that are not in the recording are written as if no marker was seen; a rate that is
/// not known is written as 0.
pub fn c3d_bytes(markers: &Recording) -> Vec<u8> {
    let first = markers.frames.first().copied().unwrap_or(1);
    let last = markers.frames.last().copied().unwrap_or(first - 1);
    let film = Film {
        rate_hz: markers.rate_hz.unwrap_or(0.0) as f32,
        first_frame: first.max(0) as usize,
        last_frame: last.max(0) as usize,
        labels: &markers.labels,
    };
    // The position of the data is one of the parameters; it does not change their length.
    let blocks = parameters(&film, 0).len() / BLOCK;
    let data_start = 2 + blocks;
    let mut file = header(&film, data_start);
    file.extend(parameters(&film, data_start));
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

/// What a file says about its points.
struct Film<'m> {
    rate_hz: f32,
    first_frame: usize,
    last_frame: usize,
    labels: &'m [String],
}

/// The first block: what can be read without the parameters.
fn header(film: &Film, data_start: usize) -> Vec<u8> {
    let mut header = vec![2, 0x50];
    let (no_analog, longest_gap, per_frame) = (0, 0, 0);
    for number in [film.labels.len(), no_analog, film.first_frame, film.last_frame, longest_gap] {
        header.extend(word(number));
    }
    header.extend((-1.0_f32).to_le_bytes());
    header.extend(word(data_start));
    header.extend(word(per_frame));
    header.extend(film.rate_hz.to_le_bytes());
    header.resize(BLOCK, 0);
    header
}

/// Whole blocks of parameters.
fn parameters(film: &Film, data_start: usize) -> Vec<u8> {
    const POINT: i8 = 1;
    const TRIAL: i8 = 2;
    const ANALOG: i8 = 3;
    let mut to = vec![1, 0x50, 0, 84];
    for (group, name) in [(POINT, "POINT"), (TRIAL, "TRIAL"), (ANALOG, "ANALOG")] {
        record(&mut to, -group, name, &[]);
    }
    let points = film.labels.len();
    let frames = film.last_frame + 1 - film.first_frame;
    for (group, name, number) in [
        (POINT, "USED", points),
        (POINT, "FRAMES", frames),
        (POINT, "DATA_START", data_start),
        (ANALOG, "USED", 0),
    ] {
        record(&mut to, group, name, &[&[2, 0], &word(number)[..]].concat());
    }
    for (name, number) in [("SCALE", -1.0), ("RATE", film.rate_hz)] {
        record(&mut to, POINT, name, &[&[4, 0], &number.to_le_bytes()[..]].concat());
    }
    texts(&mut to, POINT, "UNITS", &["mm".to_owned()]);
    for (i, labels) in film.labels.chunks(LONGEST_LIST).enumerate() {
        let name = if i == 0 { "LABELS".to_owned() } else { format!("LABELS{}", i + 1) };
        texts(&mut to, POINT, &name, labels);
    }
    for (name, frame) in
        [("ACTUAL_START_FIELD", film.first_frame), ("ACTUAL_END_FIELD", film.last_frame)]
    {
        let [low, high] = [frame & LARGEST_WORD, frame >> 16].map(word);
        record(&mut to, TRIAL, name, &[&[2, 1, 2], &low[..], &high].concat());
    }
    // The end is a name without length.
    to.resize((to.len() + 2).next_multiple_of(BLOCK), 0);
    to[2] = (to.len() / BLOCK) as u8;
    to
}

/// A group (negative) or a parameter of a group, without a description.
fn record(to: &mut Vec<u8>, id: i8, name: &str, content: &[u8]) {
    to.extend([name.len() as u8, id.cast_unsigned()]);
    to.extend(name.as_bytes());
    to.extend(word(2 + content.len() + 1));
    to.extend(content);
    to.push(0);
}

fn texts(to: &mut Vec<u8>, group: i8, name: &str, texts: &[String]) {
    let width = texts.iter().map(String::len).max().unwrap_or(0).min(LONGEST_LIST);
    let mut content = vec![(-1_i8).cast_unsigned(), 2, width as u8, texts.len() as u8];
    for text in texts {
        let bytes = text.bytes().chain(std::iter::repeat(b' '));
        content.extend(bytes.take(width));
    }
    record(to, group, name, &content);
}

/// Two bytes; what does not fit is written as the largest, as the cameras do.
fn word(number: usize) -> [u8; 2] {
    (number.min(LARGEST_WORD) as u16).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::{LengthUnit, parse_markers};

    #[test]
    fn a_recording_is_read_as_it_was_written() {
        let position = |i: i32| match i % 7 {
            0 => MISSING,
            _ => [f64::from(i), -0.5 * f64::from(i), 62.0],
        };
        // More labels than one list holds, and frames beyond the header's words.
        let written = Recording::new(
            Some(120.0),
            vec![65_535, 65_536],
            (0..300).map(|i| format!("Snake:M{i}")).collect(),
            (0..600).map(position).collect(),
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
