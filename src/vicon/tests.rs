//! One fixture for each quirk that exports have and one for each error.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Instant;

use flate2::Compression;
use flate2::write::GzEncoder;
use proptest::prelude::*;

use super::*;

fn fixture(name: &str) -> PathBuf {
    Path::new("tests/fixtures/vicon").join(name)
}

fn read(name: &str) -> MarkerFile {
    read_markers(&fixture(name)).unwrap()
}

fn message(name: &str) -> String {
    read_markers(&fixture(name)).unwrap_err().to_string()
}

/// NaN equals NaN here.
fn rows(file: &MarkerFile) -> Vec<Vec<Option<[f64; 3]>>> {
    let seen = |p: &[f64; 3]| (!p[0].is_nan()).then_some(*p);
    (0..file.frames.len()).map(|row| file.row_mm(row).iter().map(seen).collect()).collect()
}

#[test]
fn a_nexus_export_is_read() {
    let file = read("nexus.csv");
    assert_eq!(file.rate_hz, Some(120.0));
    assert_eq!(file.frames, [1, 2]);
    assert_eq!(file.labels, ["Snake:M1", "Snake:M2"]);
    assert_eq!(file.rows_without_frame, 0);
    assert_eq!(file.position_mm(0, 0), [1.5, -2.0, 3.0]);
    assert_eq!(file.position_mm(1, 1), [11.0, 21.0, 31.0]);
}

#[test]
fn the_way_a_file_was_saved_changes_nothing() {
    let plain = read("nexus.csv");
    for name in [
        "lf-no-end.csv",
        "byte-order-mark.csv",
        "spreadsheet-padded.csv",
        "several-sections.csv",
        "next-section-at-once.csv",
        "semicolons.csv",
        "semicolons-points.csv",
        "tabs.csv",
        "count-column.csv",
        "count-first.csv",
        "rate-without-title.csv",
        "packed.csv.gz",
        "nexus.c3d",
    ] {
        assert_eq!(read(name), plain, "{name}");
    }
}

#[test]
fn a_file_without_title_and_rate_has_an_unknown_rate() {
    for name in ["no-title.csv", "no-rate.csv", "no-title-then-section.csv"] {
        let expected = MarkerFile { rate_hz: None, ..read("nexus.csv") };
        assert_eq!(read(name), expected, "{name}");
    }
}

#[test]
fn labels_stay_as_they_are_though_two_subjects_share_a_name() {
    assert_eq!(read("two-subjects.csv").labels, ["Branch:X", "Branch_1:X", "Branch_1:Y-2"]);
}

#[test]
fn every_section_is_listed_with_its_own_rate() {
    let listed = |name: &str| -> Vec<(String, usize, Option<f64>, usize)> {
        let path = fixture(name);
        let sections = sections(&path, &read_file(&path).unwrap().0).unwrap();
        let fields = |s: Section| (s.name, s.line, s.rate_hz, s.rows);
        sections.into_iter().map(fields).collect()
    };
    let section = |name: &str, line, rate_hz, rows| (name.to_owned(), line, rate_hz, rows);
    let several = [
        section("Devices", 2, Some(1000.0), 2),
        section("Trajectories", 10, Some(120.0), 2),
        section("Trajectory Count", 18, Some(120.0), 2),
    ];
    assert_eq!(listed("several-sections.csv"), several);
    let untitled = [section("", 2, None, 2), section("Trajectory Count", 7, Some(120.0), 2)];
    assert_eq!(listed("no-title-then-section.csv"), untitled);
    assert_eq!(listed("no-rate.csv"), [section("Trajectories", 1, None, 2)]);
    assert_eq!(listed("workstation.csv"), [section("TRAJECTORIES", 4, Some(120.0), 2)]);
    assert_eq!(listed("tabs.csv"), [section("Trajectories", 1, Some(120.0), 2)]);
    assert_eq!(listed("frames.csv"), [section("Trajectories", 1, Some(120.0), 3)]);
    assert_eq!(listed("not-a-table.csv"), []);
}

#[test]
fn magnitudes_are_skipped_and_subjects_may_have_spaces() {
    let file = read("magnitude.csv");
    assert_eq!(file.labels, ["Patient 1:M1", "Patient 1:M2"]);
    assert_eq!(rows(&file), rows(&read("nexus.csv")));
}

#[test]
fn the_older_workstation_export_is_read() {
    let file = read("workstation.csv");
    assert_eq!((file.rate_hz, &file.labels[..]), (Some(120.0), &["M1".into(), "M2".into()][..]));
    assert_eq!(rows(&file), rows(&read("nexus.csv")));
}

#[test]
fn missing_is_missing_and_zero_is_zero() {
    let file = read("gaps.csv");
    let expected = [
        vec![None, Some([10.0, 20.0, 30.0])],
        vec![None, Some([11.0, 21.0, 31.0])],
        vec![Some([0.0; 3]), None],
        vec![None, None],
        vec![Some([7.0, 8.0, 9.0]), Some([13.0, 23.0, 33.0])],
    ];
    assert_eq!(rows(&file), expected);
    assert_eq!(file.frames, [1, 2, 3, 4, 5]);
}

#[test]
fn exponents_spaces_and_quotes_are_read() {
    let file = read("exponents.csv");
    assert_eq!(file.row_mm(0), [[9.54159e-5, -1500.0, 3.0], [10.0, 20.0, 30.0]]);
}

#[test]
fn frames_may_start_anywhere_and_jump_and_rows_without_one_are_counted() {
    let file = read("frames.csv");
    assert_eq!(file.frames, [500, 501, 63268]);
    assert_eq!(file.rows_without_frame, 2);
}

#[test]
fn every_error_names_file_line_found_and_needed() {
    let expected = [
        ("absent.csv", ": no such file"),
        ("empty.csv", ": found an empty file, needed a `Trajectories` section"),
        ("blank.csv", ": found an empty file, needed a `Trajectories` section"),
        ("devices-only.csv", ": found only the section `Devices`, needed a `Trajectories` section"),
        (
            "model-outputs.csv",
            ": found only the section `Model Outputs`, needed a `Trajectories` section",
        ),
        (
            "no-trajectories.csv",
            ": found only the sections `Devices`, `Model Outputs`, needed a `Trajectories` section",
        ),
        (
            "tracker-objects.csv",
            ": found only the section `Objects` (poses of rigid bodies, from Tracker), \
             needed a `Trajectories` section",
        ),
        (
            "tracker-graph.csv",
            ": found a table of quoted cells (a graph plot, from Tracker), \
             needed a `Trajectories` section",
        ),
        ("utf-16.csv", ": found UTF-16, needed a text in UTF-8; save it as `CSV UTF-8`"),
        ("not-a-table.csv", ": found no section at all, needed a `Trajectories` section"),
        (
            "no-axes.csv",
            ", line 1: found no row of axes in the next lines, \
             needed a row that starts with `Frame,Sub Frame,X,Y,Z`",
        ),
        (
            "no-labels.csv",
            ", line 3: found `Frame,Sub Frame,X,Y,Z,X,Y,Z`, \
             needed at least one label with X, Y, Z below it",
        ),
        (
            "no-markers.csv",
            ", line 4: found `Frame,Sub Frame,RX,RY,RZ`, \
             needed at least one label with X, Y, Z below it",
        ),
        ("bad-rate.csv", ", line 2: found `fast`, needed the frame rate, a number of Hz above 0"),
        ("metres.csv", ", line 5: found unit `m` of Snake:M1, needed millimetres (`mm`)"),
        ("no-rows.csv", ": found no row of numbers below line 5, needed at least one frame"),
        (
            "no-frame-numbers.csv",
            ": found 2 rows below line 5 and none with a frame number, needed at least one",
        ),
        ("two-trajectories.csv", ", line 16: found a second `Trajectories` section, needed one"),
        (
            "text-cell.csv",
            ", line 7, column 7 (Snake:M2 Y): found `occluded`, \
             needed a number of mm or an empty cell",
        ),
        (
            "nan-cell.csv",
            ", line 6, column 4 (Snake:M1 Y): found `nan`, \
             needed a number of mm or an empty cell",
        ),
        ("text-frame.csv", ", line 6, column 1 (Frame): found `one`, needed a whole frame number"),
        ("frames-backwards.csv", ", line 7: found frame 7 after frame 7, needed a larger number"),
        (
            "far-away.csv",
            ", line 6, column 4 (Snake:M1 Y): found `1e30`, \
             needed a number of mm or an empty cell",
        ),
        (
            "cut.csv",
            ", line 7: found the file's end after 5 cells of a row, needed 8; \
             is the copy complete?",
        ),
        (
            "short-rows.csv",
            ", line 16: found rows much shorter than the 9 markers of the header, \
             needed one cell per axis",
        ),
    ];
    for (name, rest) in expected {
        assert_eq!(message(name), format!("{}{rest}", fixture(name).display()));
    }
}

#[test]
fn a_packed_file_that_is_cut_off_is_an_error() {
    // What follows is the unpacking library's own words.
    let expected = format!("{}: cannot be unpacked: ", fixture("broken.csv.gz").display());
    assert!(message("broken.csv.gz").starts_with(&expected));
}

#[test]
fn a_folder_is_an_error_and_no_panic() {
    assert!(read_markers(Path::new("tests/fixtures")).is_err());
}

#[test]
fn a_packed_file_that_grows_beyond_the_limit_is_refused() {
    let file = read_file(&fixture("packed.csv.gz")).unwrap().0;
    let unpacked = bytes::unpack_at_most(&file, 1 << 20).unwrap().len() as u64;
    assert!(bytes::unpack_at_most(&file, unpacked).is_ok());
    let error = bytes::unpack_at_most(&file, unpacked - 1).unwrap_err();
    let limit = unpacked - 1;
    let expected = format!("a: found more than {limit} bytes when unpacked, needed at most that");
    assert_eq!(error.of(Path::new("a")).to_string(), expected);
}

#[test]
fn a_packed_file_that_is_made_to_fill_the_memory_is_refused() {
    let mut packer = GzEncoder::new(Vec::new(), Compression::fast());
    (0..65).for_each(|_| packer.write_all(&[b','; 1 << 20]).unwrap());
    let bomb = packer.finish().unwrap();
    assert!(bomb.len() < 1 << 20);
    assert_eq!(
        parse_markers(Path::new("a"), &bomb).unwrap_err().to_string(),
        "a: found more than 67108864 bytes when unpacked, needed at most that"
    );
}

/// Polars alone took 1.6 times as long as this reader for the same bytes, one thread each.
#[test]
#[ignore = "a timing; alone and with --release: cargo test --release --lib -- --ignored reading"]
fn reading_is_as_fast_as_parsing_every_cell() {
    let mut text = String::from("Trajectories\n120\n,");
    let row = |cell: &str| cell.repeat(30) + "\n";
    text += &row(",Snake:M1,,")[..];
    text += &("Frame,Sub Frame".to_owned() + &row(",X,Y,Z"));
    for frame in 0..5000 {
        let x = f64::from(frame) * 0.1 - 200.0;
        text +=
            &format!("{frame},0{}", row(&format!(",{x:.3},{:.2},62.0{}", -7.0 * x, frame % 89)));
    }
    let best = |work: &dyn Fn() -> f64| {
        let timed = |_| {
            let begin = Instant::now();
            std::hint::black_box(work());
            begin.elapsed()
        };
        (0..20).map(timed).min().unwrap()
    };
    let read = || parse_markers(Path::new("a"), text.as_bytes()).unwrap().row_mm(4999)[29][2];
    let parse = || {
        let cells = text.split(['\n', ',']).filter_map(|cell| cell.parse::<f64>().ok());
        cells.sum::<f64>()
    };
    let (read, parse) = (best(&read), best(&parse));
    assert!(read <= parse, "reading {read:?}, every cell {parse:?}");
}

/// Bytes of every fixture.
fn fixtures() -> &'static [Vec<u8>] {
    static FIXTURES: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    FIXTURES.get_or_init(|| {
        let mut paths: Vec<PathBuf> =
            std::fs::read_dir(fixture("")).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        paths.iter().map(|path| read_file(path).unwrap().0).collect()
    })
}

/// What reading may hold at most, bytes: so many times the file, and some.
const MEMORY_FACTOR: usize = 64;

impl MarkerFile {
    fn memory_bytes(&self) -> usize {
        let labels = self.labels.iter().map(String::capacity).sum::<usize>();
        labels
            + self.labels.capacity() * size_of::<String>()
            + self.frames.capacity() * size_of::<i64>()
            + self.positions_mm.capacity() * size_of::<[f64; 3]>()
    }
}

/// One thing that happens to a file, somewhere in it.
#[derive(Debug, Clone)]
enum Damage {
    Byte(u8),
    Insert(&'static [u8]),
    /// So many bytes are gone, or are there twice.
    Remove(usize),
    Repeat(usize),
}

fn damage() -> impl Strategy<Value = (prop::sample::Index, Damage)> {
    const PIECES: [&[u8]; 14] = [
        b"Trajectories\n",
        b"\nFrame,Sub Frame,X,Y,Z\n",
        b"\nFrame;Sub Frame;X;Y;Z\n",
        b"X,Y,Z,",
        b",,mm,mm",
        b",,,,,,,,,,,,,,,,",
        b"\n\n",
        b"1e308",
        b"-9223372036854775808",
        b"0.0000000000000000000000000001e-400",
        b"\"\"",
        b"\xff\xff\xff\xff",
        b"\0\0",
        b"\x1f\x8b",
    ];
    let kind = prop_oneof![
        4 => any::<u8>().prop_map(Damage::Byte),
        2 => prop::sample::select(&PIECES[..]).prop_map(Damage::Insert),
        1 => (1_usize..80).prop_map(Damage::Remove),
        1 => (1_usize..80).prop_map(Damage::Repeat),
    ];
    (any::<prop::sample::Index>(), kind)
}

fn apply(file: &mut Vec<u8>, at: prop::sample::Index, damage: Damage) {
    if file.is_empty() {
        return;
    }
    let at = at.index(file.len());
    let end = |length: usize| (at + length).min(file.len());
    match damage {
        Damage::Byte(byte) => file[at] = byte,
        Damage::Insert(piece) => drop(file.splice(at..at, piece.iter().copied())),
        Damage::Remove(length) => drop(file.drain(at..end(length))),
        Damage::Repeat(length) => {
            let again = file[at..end(length)].to_vec();
            file.splice(at..at, again);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, ..ProptestConfig::default() })]

    /// Damage anywhere in any file gives a result or an error, never a marker that is there in
    /// part, and never much more memory than the file has bytes.
    #[test]
    fn damaged_files_neither_panic_nor_fill_the_memory(
        which in any::<prop::sample::Index>(),
        damages in prop::collection::vec(damage(), 0..8),
    ) {
        let mut file = which.get(fixtures()).clone();
        damages.into_iter().for_each(|(at, damage)| apply(&mut file, at, damage));
        for name in ["damaged.csv", "damaged.c3d"] {
            let path = Path::new(name);
            let _ = sections(path, &file);
            let Ok(markers) = parse_markers(path, &file) else { continue };
            for row in 0..markers.frames.len() {
                for position in markers.row_mm(row) {
                    let missing = position.iter().filter(|x| x.is_nan()).count();
                    prop_assert!(missing == 0 || missing == 3);
                }
            }
            if !file.starts_with(&[0x1f, 0x8b]) {
                prop_assert!(markers.memory_bytes() <= MEMORY_FACTOR * (file.len() + 64));
            }
        }
    }

    #[test]
    fn any_bytes_never_panic(file in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = parse_markers(Path::new("any"), &file);
    }
}
