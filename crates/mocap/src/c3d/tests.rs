//! C3D files with every byte order and number format, and one file for each error.

use proptest::prelude::*;

use super::*;
use crate::LengthUnit;
use crate::{ReadError, parse_markers, sections};

/// Content of a synthetic C3D file; [`Recipe::default`] has the same markers and positions as `nexus.csv`.
struct Recipe {
    order: ByteOrder,
    float: bool,
    unit: &'static str,
    /// Lists of point labels; the second list is written to the parameter `LABELS2`.
    labels: Vec<Vec<&'static str>>,
    angles: Vec<&'static str>,
    first_frame: u32,
    analog_values: usize,
    /// Positions by frame and point; `None` if the point is occluded.
    frames: Vec<Vec<Option<[f64; 3]>>>,
}

impl Default for Recipe {
    fn default() -> Self {
        let first = vec![Some([1.5, -2.0, 3.0]), Some([10.0, 20.0, 30.0])];
        let second = vec![Some([1.25, -2.5, 3.0]), Some([11.0, 21.0, 31.0])];
        Self {
            order: ByteOrder::Intel,
            float: true,
            unit: "mm",
            labels: vec![vec!["Snake:M1", "Snake:M2"]],
            angles: Vec::new(),
            first_frame: 1,
            analog_values: 0,
            frames: vec![first, second],
        }
    }
}

/// Length of one step of integer data, mm.
const STEP: f64 = 0.25;

impl Recipe {
    fn i16(&self, x: i16) -> [u8; 2] {
        if self.order == ByteOrder::Mips { x.to_be_bytes() } else { x.to_le_bytes() }
    }

    fn u16(&self, x: usize) -> [u8; 2] {
        self.i16((x as u16).cast_signed())
    }

    fn f32(&self, x: f64) -> [u8; 4] {
        match self.order {
            ByteOrder::Intel => (x as f32).to_le_bytes(),
            ByteOrder::Mips => (x as f32).to_be_bytes(),
            ByteOrder::Dec => {
                let [c, d, a, b] = ((x * 4.0) as f32).to_le_bytes();
                [a, b, c, d]
            }
        }
    }

    fn record(&self, to: &mut Vec<u8>, id: i8, name: &str, content: &[u8]) {
        to.extend([name.len() as u8, id.cast_unsigned()]);
        to.extend(name.as_bytes());
        to.extend(self.u16(content.len() + 3));
        to.extend(content);
        // No description.
        to.push(0);
    }

    fn texts(&self, to: &mut Vec<u8>, name: &str, texts: &[&str]) {
        let width = texts.iter().map(|text| text.len()).max().unwrap_or(0);
        let mut content = vec![0xff, 2, width as u8, texts.len() as u8];
        texts.iter().for_each(|text| content.extend(format!("{text:width$}").as_bytes()));
        self.record(to, 1, name, &content);
    }

    fn parameters(&self) -> Vec<u8> {
        let processor = match self.order {
            ByteOrder::Intel => 84,
            ByteOrder::Dec => 85,
            ByteOrder::Mips => 86,
        };
        let mut to = vec![1, MAGIC, 2, processor];
        self.record(&mut to, -1, "POINT", &[]);
        self.record(&mut to, -2, "TRIAL", &[]);
        let number = |kind: u8, bytes: &[u8]| [&[kind, 0], bytes].concat();
        self.record(&mut to, 1, "USED", &number(2, &self.u16(self.frames[0].len())));
        self.record(&mut to, 1, "RATE", &number(4, &self.f32(119.88)));
        let scale = if self.float { -1.0 } else { STEP };
        self.record(&mut to, 1, "SCALE", &number(4, &self.f32(scale)));
        self.texts(&mut to, "UNITS", &[self.unit]);
        for (i, labels) in self.labels.iter().enumerate() {
            let name = if i == 0 { "labels".to_owned() } else { format!("LABELS{}", i + 1) };
            self.texts(&mut to, &name, labels);
        }
        self.texts(&mut to, "ANGLES", &self.angles);
        let last = self.first_frame as usize + self.frames.len() - 1;
        for (name, frame) in [("START", self.first_frame as usize), ("END", last)] {
            let words = [self.u16(frame % 65536), self.u16(frame / 65536)].concat();
            let content = [&[2, 1, 2], &words[..]].concat();
            self.record(&mut to, 2, &format!("ACTUAL_{name}_FIELD"), &content);
        }
        to.resize(to.len().next_multiple_of(BLOCK).max(2 * BLOCK), 0);
        to
    }

    fn file(&self) -> Vec<u8> {
        let parameters = self.parameters();
        let last = self.first_frame as usize + self.frames.len() - 1;
        let points = self.frames[0].len();
        let mut file = vec![2, MAGIC];
        let clip = |frame: usize| frame.min(65535);
        for word in [points, self.analog_values, clip(self.first_frame as usize), clip(last), 0] {
            file.extend(self.u16(word));
        }
        file.extend(self.f32(if self.float { -1.0 } else { STEP }));
        file.extend(self.u16(2 + parameters.len() / BLOCK));
        file.extend(self.u16(1));
        file.extend(self.f32(119.88));
        file.resize(BLOCK, 0);
        file.extend(parameters);
        for position in self.frames.iter().flat_map(|frame| {
            frame.iter().chain(std::iter::repeat_n(&None, self.analog_values.div_ceil(4)))
        }) {
            let [x, y, z] = position.unwrap_or_default();
            let residual = if position.is_some() { 0.0 } else { -1.0 };
            if self.float {
                [x, y, z, residual].iter().for_each(|x| file.extend(self.f32(*x)));
            } else {
                [x, y, z].iter().for_each(|x| file.extend(self.i16((x / STEP).round() as i16)));
                file.extend(self.i16(residual as i16));
            }
        }
        file.resize(file.len().next_multiple_of(BLOCK), 0);
        file
    }

    fn read(&self) -> Result<Recording, ReadError> {
        parse_markers(Path::new("a.c3d"), &self.file(), LengthUnit::Mm)
    }
}

fn plain() -> Recording {
    Recipe::default().read().unwrap()
}

fn message(file: &[u8]) -> String {
    parse_markers(Path::new("a.c3d"), file, LengthUnit::Mm).unwrap_err().to_string()
}

#[test]
fn markers_rate_and_frames_are_read() {
    let file = plain();
    assert_eq!(file.rate_hz, Some(119.88));
    assert_eq!(file.frames, [1, 2]);
    assert_eq!(file.labels, ["Snake:M1", "Snake:M2"]);
    assert_eq!(file.row_mm(0), [[1.5, -2.0, 3.0], [10.0, 20.0, 30.0]]);
    assert_eq!(file.row_mm(1), [[1.25, -2.5, 3.0], [11.0, 21.0, 31.0]]);
}

#[test]
fn every_processor_and_number_format_gives_the_same() {
    for order in [ByteOrder::Intel, ByteOrder::Dec, ByteOrder::Mips] {
        for float in [true, false] {
            let recipe = Recipe { order, float, ..Recipe::default() };
            assert_eq!(recipe.read().unwrap(), plain(), "{order:?} {float}");
        }
    }
}

#[test]
fn a_file_with_another_name_is_recognised_by_its_content() {
    let file = Recipe::default().file();
    assert_eq!(parse_markers(Path::new("a.csv"), &file, LengthUnit::Mm).unwrap(), plain());
}

#[test]
fn analog_samples_are_skipped() {
    let recipe = Recipe { analog_values: 4, ..Recipe::default() };
    assert_eq!(recipe.read().unwrap(), plain());
    let listed = sections(Path::new("a.c3d"), &recipe.file()).unwrap();
    let listed: Vec<_> = listed.into_iter().map(|s| (s.name, s.rate_hz, s.rows)).collect();
    let expected = [("Points".into(), Some(119.88), 2), ("Analog".into(), Some(119.88), 2)];
    assert_eq!(listed, expected);
}

#[test]
fn metres_become_millimetres() {
    let mut recipe = Recipe { unit: "m", ..Recipe::default() };
    recipe.frames[0][0] = Some([1.5, -0.25, 0.125]);
    assert_eq!(recipe.read().unwrap().position_mm(0, 0), [1500.0, -250.0, 125.0]);
}

#[test]
fn occluded_points_are_missing_and_zero_is_zero() {
    for float in [true, false] {
        let mut recipe = Recipe { float, ..Recipe::default() };
        recipe.frames[0] = vec![None, Some([0.0; 3])];
        let file = recipe.read().unwrap();
        assert!(file.position_mm(0, 0).iter().all(|x| x.is_nan()));
        assert_eq!(file.position_mm(0, 1), [0.0; 3]);
    }
    let mut recipe = Recipe::default();
    recipe.frames[0][0] = Some([1.0, f64::NAN, 2.0]);
    assert!(recipe.read().unwrap().position_mm(0, 0).iter().all(|x| x.is_nan()));
}

#[test]
fn points_without_a_label_and_model_outputs_are_no_markers() {
    let mut recipe = Recipe {
        labels: vec![vec!["*12", "Snake:M1", "Snake:Angles"], vec!["", "Snake:M2"]],
        angles: vec!["Snake:Angles"],
        ..Recipe::default()
    };
    for (frame, plain) in recipe.frames.iter_mut().zip(Recipe::default().frames) {
        // The last point is not in the lists of labels.
        *frame = vec![None, plain[0], Some([9.0; 3]), Some([8.0; 3]), plain[1], Some([7.0; 3])];
    }
    assert_eq!(recipe.read().unwrap(), plain());
}

#[test]
fn frame_numbers_beyond_65535_are_read() {
    let recipe = Recipe { first_frame: 70_000, ..Recipe::default() };
    assert_eq!(recipe.read().unwrap().frames, [70_000, 70_001]);
}

#[test]
fn every_error_says_what_was_found_and_needed() {
    let whole = Recipe::default().file();
    let with = |at: usize, byte: u8| {
        let mut file = whole.clone();
        file[at] = byte;
        message(&file)
    };
    let needed_header =
        "a.c3d: found no C3D header, needed a header of 512 bytes, the second of which is 0x50";
    assert_eq!(message(&[]), needed_header);
    assert_eq!(message(&whole[..511]), needed_header);
    assert_eq!(message(b"Trajectories\n120\n"), needed_header);
    assert_eq!(
        with(0, 0),
        "a.c3d: found no parameter section, needed a parameter section within the file"
    );
    assert_eq!(
        with(BLOCK + 3, 1),
        "a.c3d: found processor type 1, needed 84 (Intel), 85 (DEC) or 86 (MIPS)"
    );
    let cut = &whole[..BLOCK + 100];
    assert_eq!(
        message(cut),
        "a.c3d: found a truncated or damaged parameter section, needed a complete parameter section"
    );
    let needed_all = "needed all frames; is the copy of the file complete?";
    let data = 3 * BLOCK;
    let of = "of 32 bytes each (2 points, 0 analog values, floating-point numbers)";
    let found = format!("a.c3d: found 1 of 2 frames {of}, {needed_all}");
    assert_eq!(message(&whole[..data + 40]), found);
    let labels = vec![vec!["*0", "*1"]];
    let unlabelled = Recipe { labels, ..Recipe::default() }.read().unwrap_err().to_string();
    assert_eq!(
        unlabelled,
        "a.c3d: found 2 points without a label, needed at least one marker in POINT:LABELS; export the \
         labelled trajectories"
    );
    let mut wild = Recipe::default();
    wild.frames[1][0] = Some([0.0, 2e6, 0.0]);
    assert_eq!(
        wild.read().unwrap_err().to_string(),
        "a.c3d: found 2000000 mm for Snake:M1 in frame 2, needed coordinates of at most a kilometre"
    );
}

proptest! {
    #[test]
    fn damaged_files_never_panic(
        damage in prop::collection::vec((0_usize..1700, any::<u8>()), 0..12),
        length in 0_usize..2100,
        float in any::<bool>(),
    ) {
        let mut file = Recipe { float, analog_values: 4, ..Recipe::default() }.file();
        for (at, byte) in damage {
            file[at] = byte;
        }
        file.truncate(length.max(BLOCK));
        let path = Path::new("a.c3d");
        let _ = sections(path, &file);
        if let Ok(markers) = parse_markers(path, &file, LengthUnit::Mm) {
            let numbers = 3 * markers.frames.len() * markers.labels.len();
            prop_assert!(2 * numbers <= file.len());
        }
    }
}
