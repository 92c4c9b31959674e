//! Files in which header, parameters and size contradict each other in all possible ways.

use std::path::Path;

use crate::LengthUnit;
use crate::{Recording, parse_markers, sections};

const BLOCK: usize = 512;
/// Value of all analog samples, far from the position of any marker.
const ANALOG: f32 = 7777.0;

/// Length of one step of integer data.
const STEP: f64 = 0.05;

/// Content of a synthetic file and its stated metadata, which agree unless a test changes them.
#[derive(Debug, Clone)]
struct File {
    points: usize,
    analog_values: usize,
    frames: usize,
    is_float: bool,
    is_big_endian: bool,
    /// Number of bytes that follow the frames and the zeros with which the frames are padded to whole blocks.
    more_bytes: usize,
    // Stated metadata; parameters that are `None` are not written.
    used: Option<u16>,
    word2: u16,
    channels: Option<u16>,
    samples: u16,
    word3: u16,
    analog_rate: Option<f32>,
    scale: Option<f32>,
    header_scale: f32,
    rate: f32,
    header_rate: f32,
    first: u16,
    last: u16,
    frames_stated: Option<u16>,
    frames_as_float: Option<f32>,
    long_frames: Option<f32>,
    range: Option<[u32; 2]>,
    data_start: Option<u16>,
    /// Block in which the data begin according to the header; `None` for the right one.
    word9: Option<u16>,
    camera_rate: Option<f32>,
    unit: Option<&'static str>,
    /// Number of points that are listed as model outputs.
    angles: usize,
    rotations: Option<u16>,
    is_full: bool,
    last_pointer: Option<u16>,
}

impl File {
    /// Creates a file with consistent metadata. If `has_analog`, each frame has three samples of each of two channels.
    fn new(points: usize, frames: usize, is_float: bool, has_analog: bool) -> Self {
        let scale = if is_float { -0.1 } else { 0.05 };
        let analog_values = if has_analog { 6 } else { 0 };
        Self {
            points,
            analog_values,
            frames,
            is_float,
            is_big_endian: false,
            more_bytes: 0,
            used: Some(points as u16),
            word2: points as u16,
            channels: Some(if has_analog { 2 } else { 0 }),
            samples: if has_analog { 3 } else { 1 },
            word3: analog_values as u16,
            analog_rate: has_analog.then_some(300.0),
            scale: Some(scale),
            header_scale: scale,
            rate: 100.0,
            header_rate: 100.0,
            first: 1,
            last: frames.min(65_535) as u16,
            frames_stated: Some(frames.min(65_535) as u16),
            frames_as_float: None,
            long_frames: None,
            range: None,
            data_start: None,
            word9: None,
            camera_rate: None,
            unit: Some("mm"),
            angles: 0,
            rotations: None,
            is_full: false,
            last_pointer: None,
        }
    }

    fn word(&self, x: u16) -> [u8; 2] {
        if self.is_big_endian { x.to_be_bytes() } else { x.to_le_bytes() }
    }

    fn real(&self, x: f32) -> [u8; 4] {
        if self.is_big_endian { x.to_be_bytes() } else { x.to_le_bytes() }
    }

    fn record(&self, to: &mut Vec<u8>, id: i8, name: &str, content: &[u8]) {
        to.extend([name.len() as u8, id.cast_unsigned()]);
        to.extend(name.as_bytes());
        to.extend(self.word(content.len() as u16 + 3));
        to.extend(content);
        to.push(0);
    }

    fn texts(&self, to: &mut Vec<u8>, name: &str, texts: &[String]) {
        let width = texts.iter().map(String::len).max().unwrap_or(0);
        let mut content = vec![0xff, 2, width as u8, texts.len() as u8];
        texts.iter().for_each(|text| content.extend(format!("{text:width$}").as_bytes()));
        self.record(to, 1, name, &content);
    }

    fn parameters(&self) -> Vec<u8> {
        let mut to = vec![1, 0x50, 1, if self.is_big_endian { 86 } else { 84 }];
        for (id, name) in [(-1, "POINT"), (-2, "ANALOG"), (-3, "TRIAL"), (-4, "ROTATION")] {
            self.record(&mut to, id, name, &[]);
        }
        let whole = |to: &mut Vec<u8>, group: i8, name: &str, number: Option<u16>| {
            let number = number.map(|number| [&[2, 0], &self.word(number)[..]].concat());
            number.iter().for_each(|content| self.record(to, group, name, content));
        };
        let real = |to: &mut Vec<u8>, group: i8, name: &str, number: Option<f32>| {
            let number = number.map(|number| [&[4, 0], &self.real(number)[..]].concat());
            number.iter().for_each(|content| self.record(to, group, name, content));
        };
        whole(&mut to, 1, "USED", self.used);
        whole(&mut to, 1, "FRAMES", self.frames_stated);
        real(&mut to, 1, "FRAMES", self.frames_as_float);
        real(&mut to, 1, "LONG_FRAMES", self.long_frames);
        whole(&mut to, 1, "DATA_START", self.data_start);
        real(&mut to, 1, "SCALE", self.scale);
        real(&mut to, 1, "RATE", Some(self.rate));
        whole(&mut to, 2, "USED", self.channels);
        real(&mut to, 2, "RATE", self.analog_rate);
        real(&mut to, 3, "CAMERA_RATE", self.camera_rate);
        whole(&mut to, 4, "USED", self.rotations);
        for (i, name) in ["ACTUAL_START_FIELD", "ACTUAL_END_FIELD"].iter().enumerate() {
            if let Some(range) = self.range {
                let [low, high] = [range[i] as u16, (range[i] >> 16) as u16].map(|x| self.word(x));
                self.record(&mut to, 3, name, &[&[2, 1, 2], &low[..], &high].concat());
            }
        }
        if let Some(unit) = self.unit {
            self.texts(&mut to, "UNITS", &[unit.to_owned()]);
        }
        let labels: Vec<String> = (0..self.points).map(|i| format!("Car:{i}")).collect();
        self.texts(&mut to, "ANGLES", &labels[..self.angles]);
        self.texts(&mut to, "LABELS", &labels);
        if let Some(pointer) = self.last_pointer {
            let at = to.windows(6).rposition(|bytes| bytes == b"LABELS").unwrap() + 6;
            to.splice(at..at + 2, self.word(pointer));
        }
        // Size of a text record without its characters.
        const MIN_RECORD: usize = 12;
        let length = (to.len() + MIN_RECORD).next_multiple_of(BLOCK);
        while self.is_full && to.len() < length {
            let letters = match length - to.len() {
                rest @ 251.. => rest.min(120),
                rest => rest - MIN_RECORD,
            };
            self.texts(&mut to, "PAD", &["x".repeat(letters)]);
        }
        to.resize(length, 0);
        to[2] = (length / BLOCK) as u8;
        to
    }

    /// Returns the position of a point in a frame, mm.
    fn position(point: usize, frame: usize) -> [f64; 3] {
        [100.0 + (frame % 1000) as f64, 20.0 * (point + 1) as f64, 50.0]
    }

    fn bytes(&self) -> Vec<u8> {
        let parameters = self.parameters();
        let mut file = vec![2, 0x50];
        for word in [self.word2, self.word3, self.first, self.last, 0] {
            file.extend(self.word(word));
        }
        file.extend(self.real(self.header_scale));
        file.extend(self.word(self.word9.unwrap_or(2 + (parameters.len() / BLOCK) as u16)));
        file.extend(self.word(self.samples));
        file.extend(self.real(self.header_rate));
        file.resize(BLOCK, 0);
        file.extend(parameters);
        let mut push = |x: f64, unit: f64| match self.is_float {
            true => file.extend(self.real(x as f32)),
            false => file.extend(self.word(((x / unit).round() as i16).cast_unsigned())),
        };
        for frame in 0..self.frames {
            for point in 0..self.points {
                Self::position(point, frame).iter().for_each(|x| push(*x, STEP));
                push(0.0, 1.0);
            }
            (0..self.analog_values).for_each(|_| push(ANALOG.into(), 1.0));
        }
        file.resize(file.len().next_multiple_of(BLOCK), 0);
        file.resize(file.len() + self.more_bytes, 1);
        file
    }

    fn read(&self) -> Result<Recording, String> {
        let (path, bytes) = (Path::new("a.c3d"), self.bytes());
        let _ = sections(path, &bytes);
        parse_markers(path, &bytes, LengthUnit::Mm).map_err(|error| error.to_string())
    }

    /// Asserts that the markers and frames that were read are those of this file.
    fn assert_right(&self, read: &Recording) {
        assert_eq!(read.frames.len(), self.frames, "{self:?}");
        assert_eq!(read.labels.len(), self.points, "{self:?}");
        for row in 0..self.frames {
            for point in 0..self.points {
                let (found, is) = (read.position_mm(row, point), Self::position(point, row));
                let off = (0..3).map(|axis| (found[axis] - is[axis]).abs()).fold(0.0, f64::max);
                assert!(off < 1e-3, "{self:?}: {found:?} for {is:?} in row {row}");
            }
        }
    }

    /// Asserts that the file is read correctly and without notes.
    fn assert_read(&self) {
        let read = self.read().unwrap();
        assert_eq!(read.doubts, [""; 0]);
        self.assert_right(&read);
    }

    /// Asserts that the file is either read correctly, with notes that contain all of `numbers`, or rejected with an
    /// error that contains them.
    fn assert_reported(&self, numbers: &[&str]) {
        let message = match self.read() {
            Ok(read) => {
                self.assert_right(&read);
                read.doubts.join("; ")
            }
            Err(message) => message,
        };
        for number in numbers {
            assert!(message.contains(number), "{message:?} without {number:?}: {self:?}");
        }
    }

    /// Asserts that the file is read correctly, with a note that contains all of `numbers`.
    fn assert_read_with_note(&self, numbers: &[&str]) {
        assert!(self.read().is_ok(), "{:?}", self.read());
        self.assert_reported(numbers);
    }
}

/// Returns short files, which fit into one block whatever counts they state, and long ones.
fn all() -> impl Iterator<Item = File> {
    let sizes = [(2, 6), (3, 600), (10, 900)];
    sizes.into_iter().flat_map(|(points, frames)| {
        [(true, true), (true, false), (false, true), (false, false)]
            .into_iter()
            .map(move |(is_float, has_analog)| File::new(points, frames, is_float, has_analog))
    })
}

#[test]
fn a_consistent_file_is_read_without_a_note() {
    for file in all() {
        file.assert_read();
        File { used: None, frames_stated: None, scale: None, channels: None, ..file.clone() }
            .assert_read();
        File { analog_rate: None, range: Some([1, file.frames as u32]), ..file.clone() }
            .assert_read();
        File { is_big_endian: true, ..file.clone() }.assert_read();
        // Blocks of zeros are ignored.
        let bytes = [file.bytes(), vec![0; 3 * BLOCK]].concat();
        let read = parse_markers(Path::new("a.c3d"), &bytes, LengthUnit::Mm).unwrap();
        assert_eq!(read.doubts, [""; 0]);
        file.assert_right(&read);
        // The scale does not apply to floating-point data.
        if file.is_float {
            File { header_scale: -1.0, ..file }.assert_read();
        }
    }
}

#[test]
fn every_contradiction_is_resolved_by_the_size_or_rejected_with_all_numbers() {
    for file in all() {
        let is_long = file.frames > 100;
        for other in [1, 5, file.points + 1, 2 * file.points, 40] {
            if other == file.points {
                continue;
            }
            let numbers = [format!("{} (", file.points), format!("{other} (")];
            let numbers = numbers.each_ref().map(String::as_str);
            let other = other as u16;
            let files =
                [File { used: Some(other), ..file.clone() }, File { word2: other, ..file.clone() }];
            for file in files {
                if is_long {
                    file.assert_read_with_note(&numbers)
                } else {
                    file.assert_reported(&numbers)
                }
            }
        }
        for other in [0, 1, 2, 4, 12] {
            let product = other * file.samples;
            let numbers = [format!("{} (", file.analog_values), format!("{other} (header word 3")];
            let numbers = numbers.each_ref().map(String::as_str);
            if usize::from(other) != file.analog_values {
                let file = File { word3: other, ..file.clone() };
                if is_long {
                    file.assert_read_with_note(&numbers)
                } else {
                    file.assert_reported(&numbers)
                }
            }
            if usize::from(product) != file.analog_values {
                let numbers = [numbers[0], &format!("{product} (ANALOG:USED")];
                let file = File { channels: Some(other), ..file.clone() };
                if is_long {
                    file.assert_read_with_note(&numbers)
                } else {
                    file.assert_reported(&numbers)
                }
            }
        }
        if file.analog_values > 0 {
            let numbers = ["2 (ANALOG:USED", "6 (header word 3"];
            File { samples: 1, ..file.clone() }.assert_read_with_note(&numbers);
            // Header word 3 counts the channels.
            let numbers = ["6 (ANALOG:USED", "2 (header word 3"];
            File { word3: 2, ..file.clone() }.assert_read_with_note(&numbers);
        }
        for other in [1, file.frames - 1, file.frames + 1, 2 * file.frames, 40_000] {
            let numbers = [format!("{} (", file.frames), format!("{other} (")];
            let numbers = numbers.each_ref().map(String::as_str);
            let (frames, last) = (Some(other as u16), other as u16);
            File { frames_stated: frames, ..file.clone() }.assert_read_with_note(&numbers);
            File { last, ..file.clone() }.assert_read_with_note(&numbers);
            let long_frames = Some(other as f32);
            File { long_frames, ..file.clone() }.assert_read_with_note(&numbers);
            let range = Some([1, other as u32]);
            File { range, ..file.clone() }.assert_read_with_note(&numbers);
        }
        // Scale of the other number format, in the header or in the parameter.
        let (own, other) = (file.header_scale, if file.is_float { 0.05 } else { -0.1 });
        let numbers = [format!("{own} ("), format!("{other} (")];
        let numbers = numbers.each_ref().map(String::as_str);
        let files = [File { scale: Some(other), ..file.clone() }];
        for file in files {
            if is_long {
                file.assert_read_with_note(&numbers)
            } else {
                file.assert_reported(&numbers)
            }
        }
        if !file.is_float {
            let message = File { scale: Some(0.02), ..file.clone() }.read().unwrap_err();
            assert!(message.contains("0.02 (POINT:SCALE) and 0.05 (header"), "{message}");
        }
        // The position at which the data match the size of the file is used.
        File { data_start: Some(2), ..file.clone() }.assert_read_with_note(&["512 (POINT:DATA"]);
    }
}

/// Header and parameters agree on a wrong count: only the size of the data reveals it.
#[test]
fn counts_that_only_the_size_contradicts_are_rejected_with_the_numbers() {
    for file in all().filter(|file| file.frames > 100) {
        let rejected = |file: File, numbers: &[String]| {
            let message = file.read().map(|read| read.doubts).unwrap_err();
            for number in numbers {
                assert!(message.contains(number), "{message:?} without {number:?}: {file:?}");
            }
        };
        let frames = format!("{} frames of", file.frames);
        for points in [1, 2, 5, 11] {
            if usize::from(points) != file.points {
                let file = File { used: Some(points), word2: points, ..file.clone() };
                rejected(file, &[frames.clone(), format!("({points} points")]);
            }
        }
        for values in [1, 12] {
            let (channels, samples) = (Some(values), 1);
            let file = File { channels, samples, word3: values, analog_rate: None, ..file.clone() };
            rejected(file, &[frames.clone(), format!("{values} analog values")]);
        }
        let (fewer, more) = ((file.frames / 2) as u16, (file.frames + 100) as u16);
        for (count, message) in [(fewer, "bytes of data after them"), (more, "needed all frames")] {
            let file = File { last: count, frames_stated: Some(count), ..file.clone() };
            rejected(file, &[format!("{count} frames of"), message.to_owned()]);
        }
        let scale = if file.is_float { 0.05 } else { -0.1 };
        let other = if file.is_float { "integers" } else { "floating-point numbers" };
        let file_with = File { scale: Some(scale), header_scale: scale, ..file.clone() };
        rejected(file_with, &[frames.clone(), other.to_owned()]);
        rejected(
            File { more_bytes: 2000, ..file },
            &[frames, "bytes of data after them".to_owned()],
        );
    }
}

/// Wrong value in one place of a file.
struct Wrong {
    value: String,
    /// Name of the place in messages.
    place: &'static str,
    /// States the wrong value in this place.
    state: Box<dyn Fn(&mut File)>,
}

/// Returns wrong values for every place of a file that states its layout, its frame rate or its frame numbers.
fn wrong_values(file: &File) -> Vec<Wrong> {
    const RANGE: &str = "TRIAL:ACTUAL_START_FIELD";
    const USED: &str = "ANALOG:USED";
    let mut made: Vec<Wrong> = Vec::new();
    let mut add = |value: &dyn ToString, place, state: Box<dyn Fn(&mut File)>| {
        made.push(Wrong { value: value.to_string(), place, state });
    };
    let points = file.points as u16;
    for other in [1, points - 1, points + 1, 2 * points].into_iter().filter(|x| *x != points) {
        add(&other, "POINT:USED", Box::new(move |file| file.used = Some(other)));
        add(&other, "header word 2", Box::new(move |file| file.word2 = other));
    }
    let values = file.analog_values as u16;
    for other in [0, 1, 2, 4, 12] {
        if other != values {
            add(&other, "header word 3", Box::new(move |file| file.word3 = other));
        }
        let product = other * file.samples;
        if product != values {
            add(&product, USED, Box::new(move |file| file.channels = Some(other)));
        }
        if other > 0 && values > 0 && 2 * other != values {
            add(&(2 * other), USED, Box::new(move |file| file.samples = other));
        }
    }
    let other = if file.is_float { 0.05 } else { -0.1 };
    add(&other, "POINT:SCALE", Box::new(move |file| file.scale = Some(other)));
    add(&other, "header words 7 and 8", Box::new(move |file| file.header_scale = other));
    let count = file.frames as u32;
    for other in [count / 2, count - 1, count + 1, 2 * count, count + 65_536] {
        add(&other, RANGE, Box::new(move |file| file.range = Some([1, other])));
        let long = other as f32;
        add(&other, "POINT:LONG_FRAMES", Box::new(move |file| file.long_frames = Some(long)));
        let float = move |file: &mut File| {
            (file.frames_stated, file.frames_as_float) = (None, Some(long));
        };
        add(&other, "POINT:FRAMES", Box::new(float));
        if let Ok(other) = u16::try_from(other) {
            let short = move |file: &mut File| file.frames_stated = Some(other);
            add(&other, "POINT:FRAMES", Box::new(short));
            add(&other, "header words 4 and 5", Box::new(move |file| file.last = other));
        }
    }
    let cap = "65535 or more";
    add(&cap, "POINT:FRAMES", Box::new(|file| file.frames_stated = Some(65_535)));
    add(&cap, "header words 4 and 5", Box::new(|file| file.last = 65_535));
    add(&"101", RANGE, Box::new(move |file| file.range = Some([101, 100 + count])));
    for rate in [50.0, 99.9, 300.0] {
        add(&rate, "POINT:RATE", Box::new(move |file| file.rate = rate));
        add(&rate, "header words 11 and 12", Box::new(move |file| file.header_rate = rate));
        add(&rate, "TRIAL:CAMERA_RATE", Box::new(move |file| file.camera_rate = Some(rate)));
    }
    if values > 0 {
        add(&50, "ANALOG:RATE", Box::new(|file| file.analog_rate = Some(150.0)));
    }
    add(&512, "POINT:DATA_START", Box::new(|file| file.data_start = Some(2)));
    made
}

/// A file with two wrong values is read correctly, with notes that contain both, or rejected with an error that
/// contains at least one. Where both are the same for the same quantity, only the size of the data can contradict them.
#[test]
fn no_pair_of_wrong_values_is_read_silently() {
    let mut outcomes = [0; 2];
    for file in all().filter(|file| file.frames < 900) {
        let wrong = wrong_values(&file);
        for (i, one) in wrong.iter().enumerate() {
            for other in wrong[i..].iter().filter(|other| other.place != one.place) {
                let mut file = file.clone();
                (one.state)(&mut file);
                (other.state)(&mut file);
                let is_named = |message: &str, Wrong { value, place, .. }: &Wrong| {
                    message.contains(&format!("{value} ({place}"))
                        || message.contains(&format!(" of {value} frames of"))
                        // Without the right number of channels, the rate of their samples states nothing.
                        || *place == "ANALOG:RATE"
                };
                let is_same = one.value == other.value;
                match file.read() {
                    Ok(read) if is_same && read.doubts.is_empty() => {
                        let is_rate = one.place.contains("RATE") || other.place.contains("RATE");
                        // Less than a block, here one frame, decides nothing.
                        let is_within_block =
                            file.frames == 6 || read.frames.len().abs_diff(file.frames) == 1;
                        assert!(is_rate || is_within_block, "{} {file:?}", one.place);
                    }
                    Ok(read) => {
                        if !is_same {
                            file.assert_right(&read);
                        }
                        let notes = read.doubts.join("; ");
                        for wrong in [one, other] {
                            assert!(is_named(&notes, wrong), "{notes}: {} {file:?}", wrong.place);
                        }
                        outcomes[0] += 1;
                    }
                    Err(message) => {
                        let of_any = is_named(&message, one) || is_named(&message, other);
                        assert!(
                            of_any || is_same,
                            "{message}: {} {} {file:?}",
                            one.place,
                            other.place
                        );
                        outcomes[1] += 1;
                    }
                }
            }
        }
    }
    println!("{outcomes:?}");
    assert!(outcomes.iter().all(|&count| count > 4_000), "{outcomes:?}");
}

#[test]
fn a_wrong_rate_is_outvoted_or_rejected() {
    for file in all() {
        let has_analog = file.analog_values > 0;
        for rate in [50.0, 99.9, 300.0] {
            let wrong = [File { rate, ..file.clone() }, File { header_rate: rate, ..file.clone() }];
            for (file, place) in wrong.into_iter().zip(["POINT:RATE", "header words 11 and 12"]) {
                let number = format!("{rate} ({place})");
                let outvoted = File { camera_rate: Some(100.0), ..file.clone() }.read().unwrap();
                assert_eq!(outvoted.rate_hz, Some(100.0));
                assert!(outvoted.doubts[0].contains(&number), "{:?}", outvoted.doubts);
                let read = file.read();
                assert_eq!(read.is_ok(), has_analog, "{read:?}");
                match read {
                    Ok(read) => assert_eq!((read.rate_hz, read.doubts.len()), (Some(100.0), 1)),
                    Err(message) => {
                        let begin = "a.c3d: found contradictory frame rates, Hz: ";
                        assert!(
                            message.starts_with(begin) && message.contains(&number),
                            "{message}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn the_first_frame_is_that_of_the_place_whose_range_fills_the_data() {
    let file = File { first: 11, last: 16, ..File::new(2, 6, true, false) };
    for (range, first, notes) in [
        ([11, 16], 11, 0),
        ([101, 106], 101, 1),
        // A range that was not updated when the recording was cut.
        ([1, 600], 11, 2),
    ] {
        let read = File { range: Some(range), ..file.clone() }.read().unwrap();
        assert_eq!((read.frames[0], read.doubts.len()), (first, notes), "{:?}", read.doubts);
    }
    // Words of the header that are too short for the number of the frame.
    for (first, last) in [(65_535, 65_535), (4_464, 4_469)] {
        let late = File { range: Some([70_000, 70_005]), first, last, ..file.clone() };
        let read = late.read().unwrap();
        assert_eq!((read.frames[0], &read.doubts[..]), (70_000, &[][..]));
    }
}

#[test]
fn values_per_frame_include_all_samples_where_the_header_counts_channels() {
    let file = File { word3: 2, ..File::new(2, 6, true, true) };
    let read = file.read().unwrap();
    file.assert_right(&read);
    let told = "analog values per frame: found 6 (ANALOG:USED x header word 10) and 2 (header word 3), used 6";
    assert_eq!(read.doubts, [told]);
    let listed = sections(Path::new("a.c3d"), &file.bytes()).unwrap();
    let analog = listed.iter().find(|section| section.name == "Analog").unwrap();
    assert_eq!((analog.rate_hz, analog.rows), (Some(300.0), 18));
    // A few frames without a rate do not determine the number.
    let unknown = File { analog_rate: None, ..file }.read().unwrap_err();
    assert!(unknown.contains("counts that contradict each other"), "{unknown}");
}

#[test]
fn recordings_beyond_65535_frames_are_read_to_their_end() {
    for is_float in [false, true] {
        // Counts that are capped, that wrap around to 0, and that another parameter states in full.
        let ends = File::new(1, 70_000, is_float, false);
        ends.assert_read();
        File { frames_stated: None, ..ends.clone() }.assert_read();
        File { last: 4_464, frames_stated: Some(65_535), ..ends.clone() }
            .assert_read_with_note(&["4464 (header words 4 and 5)", "used 70000"]);
        File { last: 4_464, frames_stated: Some(4_464), ..ends.clone() }
            .assert_read_with_note(&["4464 (POINT:FRAMES)", "used 70000"]);
        File { range: Some([1, 70_000]), frames_stated: Some(4_464), ..ends.clone() }.assert_read();
        File { long_frames: Some(70_000.0), last: 4_464, ..ends.clone() }.assert_read();
        let (frames_stated, frames_as_float) = (None, Some(70_000.0));
        File { frames_stated, frames_as_float, ..ends.clone() }.assert_read();
        // A parameter that states more frames than there are.
        File { range: Some([1, 70_000]), ..File::new(1, 4_464, is_float, false) }
            .assert_read_with_note(&["70000 (TRIAL:ACTUAL", "used 4464"]);
        let cut = File { range: Some([1, 80_000]), ..ends.clone() }.read().unwrap_err();
        assert!(cut.contains("70016 of 80000 frames of"), "{cut}");
        File { frames: 65_535, ..ends }.assert_read();
    }
    let late =
        File { first: 60_000, last: 65_535, range: None, ..File::new(2, 9_000, true, false) };
    let read = late.read().unwrap();
    late.assert_right(&read);
    assert_eq!((read.frames[0], read.doubts.len()), (60_000, 0));
}

#[test]
fn a_parameter_section_may_be_full_and_its_last_record_lead_anywhere() {
    for file in all() {
        File { last_pointer: Some(0x1100), ..file.clone() }.assert_read();
        File { last_pointer: Some(0), ..file.clone() }.assert_read();
        File { is_full: true, is_big_endian: true, ..file.clone() }.assert_read();
        File { is_full: true, ..file }.assert_read();
    }
}

#[test]
fn units_are_understood_and_a_missing_one_is_noted() {
    let file = File::new(2, 6, true, false);
    for (unit, mm) in [
        ("mm", 1.0),
        ("MM", 1.0),
        ("millimetres", 1.0),
        ("cm", 10.0),
        ("m", 1000.0),
        ("Meters", 1000.0),
        ("metres", 1000.0),
        ("inches", 25.4),
    ] {
        let read = File { unit: Some(unit), ..file.clone() }.read().unwrap();
        assert_eq!(read.position_mm(0, 1), [100.0, 40.0, 50.0].map(|x: f64| x * mm), "{unit}");
    }
    let other = File { unit: Some("deg"), ..file.clone() }.read().unwrap_err();
    let needed = "needed a unit of length: `mm`, `cm`, `m`, `in`";
    assert_eq!(other, format!("a.c3d: found POINT:UNITS `deg`, {needed}"));
    let none = File { unit: None, ..file };
    for unit in LengthUnit::ALL {
        let read = parse_markers(Path::new("a.c3d"), &none.bytes(), unit).unwrap();
        assert_eq!(read.position_mm(5, 0), [105.0, 20.0, 50.0].map(|x: f64| x * unit.mm()));
        let told = format!("unit: found none (POINT:UNITS), used {unit} (vicon.unit)");
        assert_eq!(read.doubts, [told]);
    }
}

#[test]
fn a_file_without_markers_is_rejected_with_its_other_content() {
    let plain = File::new(2, 6, true, false);
    let outputs = File { angles: 2, ..plain.clone() }.read().unwrap_err();
    assert_eq!(
        outputs,
        "a.c3d: found 2 points that are model outputs (POINT:ANGLES) instead of markers, needed at \
         least one marker in POINT:LABELS; export the labelled trajectories"
    );
    let none = File { points: 0, used: Some(0), word2: 0, ..plain };
    let needed = "needed positions of markers; export the labelled trajectories";
    let found = "found no points (POINT:USED is 0)";
    assert_eq!(
        none.read().unwrap_err(),
        format!("a.c3d: {found}, as in files that contain only rotations or events, {needed}")
    );
    let rotations = File { rotations: Some(3), ..none.clone() };
    let message = rotations.read().unwrap_err();
    assert_eq!(message, format!("a.c3d: {found}, only rotations of 3 segments, {needed}"));
    let analog = File { points: 0, used: Some(0), word2: 0, ..File::new(2, 6, true, true) };
    let message = analog.read().unwrap_err();
    assert_eq!(message, format!("a.c3d: {found}, only analog channels, {needed}"));
}
