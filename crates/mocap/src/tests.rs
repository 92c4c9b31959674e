//! Tests of the readers, with one fixture for each peculiarity of exports and one for each error.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Instant;

use flate2::Compression;
use flate2::write::GzEncoder;
use proptest::prelude::*;

use super::*;

const MM: LengthUnit = LengthUnit::Mm;

fn fixture(name: &str) -> PathBuf {
    Path::new("tests/fixtures").join(name)
}

fn read(name: &str) -> Recording {
    read_markers(&fixture(name), MM).unwrap()
}

fn message(name: &str) -> String {
    read_markers(&fixture(name), MM).unwrap_err().to_string()
}

/// Returns the positions in all rows, with `None` in place of NaN so that they can be compared.
fn rows(file: &Recording) -> Vec<Vec<Option<[f64; 3]>>> {
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
        "utf-16.csv",
    ] {
        assert_eq!(read(name), plain, "{name}");
    }
}

#[test]
fn other_systems_give_the_same_markers() {
    for name in ["motive.csv", "cortex.trc", "qualisys.tsv"] {
        // Two frames do not show the vertical axis.
        let Recording { doubts, .. } = read(name);
        assert!(doubts.len() == 1 && doubts[0].starts_with("vertical axis: "), "{doubts:?}");
        assert_eq!(read(name), Recording { doubts, ..read("nexus.csv") }, "{name}");
    }
}

#[test]
fn a_file_without_title_and_rate_has_an_unknown_rate() {
    for name in ["no-title.csv", "no-rate.csv", "no-title-then-section.csv"] {
        let expected = Recording { rate_hz: None, ..read("nexus.csv") };
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
    // M1 has two coordinates in frame 2, M2 one in frame 3.
    assert_eq!(file.incomplete, [1, 1]);
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
            "tracker-graph.csv",
            ": found a table of quoted cells (a graph plot, from Tracker), \
             needed a `Trajectories` section",
        ),
        (
            "not-a-table.csv",
            ": found no section at all in a text that begins with `hello, world`, \
             needed a `Trajectories` section",
        ),
        (
            "no-axes.csv",
            ", line 1: found no row of axes in the next lines, \
             needed a row that starts with `Frame,Sub Frame,X,Y,Z`",
        ),
        (
            "no-labels.csv",
            ", line 3: found `Frame,Sub Frame,X,Y,Z,X,Y,Z`, \
             needed at least one marker label with X, Y, Z below the label, or the label of an object with RX, RY, RZ, \
             TX, TY, TZ",
        ),
        (
            "no-markers.csv",
            ", line 4: found `Frame,Sub Frame,RX,RY,RZ`, \
             needed at least one marker label with X, Y, Z below the label, or the label of an object with RX, RY, RZ, \
             TX, TY, TZ",
        ),
        ("bad-rate.csv", ", line 2: found `fast`, needed the frame rate, a number above 0 (in Hz)"),
        ("no-rows.csv", ": found no row of numbers below line 5, needed at least one frame"),
        (
            "no-frame-numbers.csv",
            ": found 2 rows below line 5, all without a frame number, needed at least one row with a frame number",
        ),
        (
            "two-trajectories.csv",
            ", line 16: found a second `Trajectories` section, needed only one",
        ),
        (
            "text-cell.csv",
            ", line 7, column 7 (Snake:M2 Y): found `occluded`, \
             needed a number (in mm) or an empty cell",
        ),
        (
            "nan-cell.csv",
            ", line 6, column 4 (Snake:M1 Y): found `nan`, \
             needed a number (in mm) or an empty cell",
        ),
        ("text-frame.csv", ", line 6, column 1 (Frame): found `one`, needed a whole frame number"),
        (
            "frames-backwards.csv",
            ", line 7: found frame 7 after frame 7, needed a larger frame number",
        ),
        (
            "far-away.csv",
            ", line 6, column 4 (Snake:M1 Y): found `1e30`, \
             needed a number (in mm) or an empty cell",
        ),
        (
            "cut.csv",
            ", line 7: found the end of the file after 5 cells of a row, needed 8 cells; is the copy of the file \
             complete?",
        ),
        (
            "short-rows.csv",
            ", line 16: found rows much too short for the 9 markers of the header, \
             needed one cell for each axis of each marker",
        ),
    ];
    for (name, rest) in expected {
        assert_eq!(message(name), format!("{}{rest}", fixture(name).display()));
    }
}

#[test]
fn units_are_understood_and_one_for_all_markers() {
    let plain = read("nexus.csv");
    let metres = read("metres.csv");
    assert_eq!(metres.row_mm(1), [[1250.0, -2500.0, 3000.0], [11e3, 21e3, 31e3]]);
    let text = String::from_utf8(read_file(&fixture("nexus.csv")).unwrap().0).unwrap();
    let read = |units: &str, unit: LengthUnit| {
        let text = text.replace(",,mm,mm,mm,mm,mm,mm\r\n", units);
        let read = parse_markers(Path::new("a"), text.as_bytes(), unit);
        read.map_err(|error| error.to_string())
    };
    for (units, unit) in [("MM", 1.0), ("Centimeters", 10.0), ("metres", 1000.0), ("in", 25.4)] {
        let row = format!(",,{}\r\n", [units; 6].join(","));
        let found = read(&row, LengthUnit::M).unwrap();
        let expected = [[1.5, -2.0, 3.0], [10.0, 20.0, 30.0]].map(|of| of.map(|x: f64| x * unit));
        assert_eq!(found.row_mm(0), expected, "{units}");
    }
    // A table without a row of units, as written by the older Workstation.
    assert_eq!(read("", MM).unwrap().row_mm(0), plain.row_mm(0));
    assert_eq!(read("", LengthUnit::M).unwrap().position_mm(0, 0), [1500.0, -2000.0, 3000.0]);
    assert_eq!(
        read(",,deg,deg,deg,mm,mm,mm\r\n", MM).unwrap_err(),
        "a, line 5: found unit `deg` of Snake:M1, needed a unit of length: `mm`, `cm`, `m`, `in`"
    );
    assert_eq!(
        read(",,mm,mm,mm,m,m,m\r\n", MM).unwrap_err(),
        "a, line 5: found unit `m` of Snake:M2 beside `mm`, needed one unit for all markers"
    );
}

#[test]
fn lines_may_end_by_carriage_returns_alone() {
    let text = String::from_utf8(read_file(&fixture("several-sections.csv")).unwrap().0).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    for (end, last) in [("\r", "\r"), ("\r", ""), ("\r", "\r\r"), ("\r\n", ""), ("\n", "\n\n")] {
        let text = lines.join(end) + last;
        let path = Path::new("a");
        let file = text.as_bytes();
        assert_eq!(parse_markers(path, file, MM).unwrap(), read("nexus.csv"), "{end:?} {last:?}");
        assert_eq!(sections(path, file).unwrap().len(), 3, "{end:?} {last:?}");
    }
}

#[test]
fn labels_are_read_in_utf_8_and_in_windows_1252() {
    let text = String::from_utf8(read_file(&fixture("nexus.csv")).unwrap().0).unwrap();
    let labels = ["M\u{f6}1", "\u{17d}\u{e9}"];
    let expected: Vec<String> = labels.map(|label| format!("Snake:{label}")).to_vec();
    let in_utf8 = text.replace("M1", labels[0]).replace("M2", labels[1]);
    let windows = |c: char| match c {
        '\u{17d}' => 0x8e,
        c => u8::try_from(u32::from(c)).unwrap(),
    };
    let in_windows: Vec<u8> = in_utf8.chars().map(windows).collect();
    for file in [in_utf8.as_bytes(), &in_windows] {
        assert_eq!(parse_markers(Path::new("a"), file, MM).unwrap().labels, expected);
    }
}

#[test]
fn numbers_that_lost_their_decimal_point_are_reported() {
    let table = |number: &dyn Fn(f64) -> String| {
        let mut text = "Trajectories\n120\n;;S:A;;\nFrame;Sub Frame;X;Y;Z\n;;mm;mm;mm\n".to_owned();
        for frame in 0..60 {
            let t = f64::from(frame);
            let [x, y] = [-276.716 + 0.53 * t, 603.46 + 0.71 * t].map(number);
            text += &format!("{};0;{x};{y};61.5\n", 100 + frame);
        }
        parse_markers(Path::new("a"), text.as_bytes(), MM).map_err(|error| error.to_string())
    };
    // With six significant digits, a number with three digits after the point is mistaken for one with a thousands
    // separator.
    let six = |x: f64| format!("{:.2}", x).trim_end_matches('0').to_owned();
    assert_eq!(table(&six).unwrap().doubts, [""; 0]);
    let mixed = |x: f64| match x as i64 % 3 {
        0 => format!("{:.0}", 1000.0 * x),
        _ => six(x),
    };
    let message = table(&mixed).unwrap_err();
    let begin = "a: found numbers that lost their decimal point: S:A X is -276186 in frame 101 and \
                 -275.66 in frame 102, needed";
    assert!(
        message.starts_with(begin) && message.contains("took the points for thousands"),
        "{message}"
    );
    // Neither integers nor a marker that jumps cause an error.
    assert!(table(&|x| format!("{x:.0}")).is_ok());
    assert!(table(&|x| format!("{}", if x as i64 % 3 == 0 { 200_000.0 } else { x })).is_ok());
}

#[test]
fn files_of_other_formats_are_identified_with_advice() {
    let kinds: [(&[u8], &str, &str); 7] = [
        (b"PK\x03\x04\0\0", "a zip archive or an Excel workbook", "; save or unpack it as CSV"),
        (
            b"frame,time_s,link0_x_m\n1,0,0.1\n",
            "a table written by `trilink export`",
            "; use the marker file from which it was made",
        ),
        (b"<!DOCTYPE html>\n<html>", "HTML or XML", "; export CSV or C3D"),
        (b"\0\x01\xff\xfe\0\0garbage", "a binary file", ""),
        (
            b"1,0,1.5,-2,3\n2,0,1.5,-2,3\n",
            "numbers without a header (title, rate, labels and axes)",
            "",
        ),
        (
            b"Frame,Sub Frame,X,Y,Z\n1,0,1,2,3\n",
            "a row of axes in line 1 without a title above it",
            "",
        ),
        (b"dear all\n", "no section at all in a text that begins with `dear all`", ""),
    ];
    for (file, found, instead) in kinds {
        let message = parse_markers(Path::new("a"), file, MM).unwrap_err().to_string();
        assert_eq!(message, format!("a: found {found}, needed a `Trajectories` section{instead}"));
    }
}

#[test]
fn a_packed_file_that_is_cut_off_is_an_error() {
    // The rest of the message comes from the decompression library.
    let expected = format!("{}: cannot be unpacked: ", fixture("broken.csv.gz").display());
    assert!(message("broken.csv.gz").starts_with(&expected));
}

#[test]
fn a_folder_is_an_error_and_no_panic() {
    assert!(read_markers(Path::new("tests"), MM).is_err());
}

#[test]
fn a_packed_file_that_grows_beyond_the_limit_is_refused() {
    let file = read_file(&fixture("packed.csv.gz")).unwrap().0;
    let unpacked = bytes::unpack_at_most(&file, 1 << 20).unwrap().len() as u64;
    assert!(bytes::unpack_at_most(&file, unpacked).is_ok());
    let error = bytes::unpack_at_most(&file, unpacked - 1).unwrap_err();
    let limit = unpacked - 1;
    let expected = format!("a: found more than {limit} bytes when unpacked, needed a smaller file");
    assert_eq!(error.in_file(Path::new("a")).to_string(), expected);
}

#[test]
fn a_packed_file_that_is_made_to_fill_the_memory_is_refused() {
    let mut packer = GzEncoder::new(Vec::new(), Compression::fast());
    (0..65).for_each(|_| packer.write_all(&[b','; 1 << 20]).unwrap());
    let bomb = packer.finish().unwrap();
    assert!(bomb.len() < 1 << 20);
    assert_eq!(
        parse_markers(Path::new("a"), &bomb, MM).unwrap_err().to_string(),
        "a: found more than 67108864 bytes when unpacked, needed a smaller file"
    );
}

/// Polars took 1.6 times as long as this reader for the same bytes, with one thread each.
#[test]
#[ignore = "a timing; alone and with --release: cargo test --release -p trilink-mocap --lib reading -- --ignored"]
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
    let read = || parse_markers(Path::new("a"), text.as_bytes(), MM).unwrap().row_mm(4999)[29][2];
    let parse = || {
        let cells = text.split(['\n', ',']).filter_map(|cell| cell.parse::<f64>().ok());
        cells.sum::<f64>()
    };
    let (read, parse) = (best(&read), best(&parse));
    assert!(read <= parse, "reading {read:?}, every cell {parse:?}");
}

#[test]
#[ignore = "a timing; alone: cargo test -p trilink-mocap --lib other_text -- --ignored --nocapture"]
fn other_text_formats_are_read_in_at_most_1_5_times_the_time_of_csv() {
    let labels = (0..28).map(|i| trilink_base::body::point_label(&format!("B{}", i / 4), i % 4));
    let positions = (0..4000 * 7).flat_map(|i| {
        let t = 0.001 * f64::from(i);
        let axes = trilink_base::body::turned([(2, 3.0 * t), (1, 0.01), (0, 0.02 * t.sin())]);
        trilink_base::body::points([900.0 * t.cos(), -700.0 * t.sin(), 62.0], &axes)
    });
    let file =
        Recording::new(Some(120.0), (1..4001).collect(), labels.collect(), positions.collect());
    let encoded = Format::ALL.map(|format| (format, format.encode("a", &file)));
    let mut best = [f64::INFINITY; Format::ALL.len()];
    // In turn, so that other load on the machine affects all alike.
    for _ in 0..30 {
        for ((format, bytes), best) in encoded.iter().zip(&mut best) {
            let path = PathBuf::from(format!("a.{}", format.extension()));
            let begin = Instant::now();
            std::hint::black_box(parse_markers(&path, bytes, MM).unwrap());
            // A pose has a position and a quaternion.
            let values = if format.has_bodies() { 7 * 7 } else { 28 * 3 };
            *best = best.min(begin.elapsed().as_secs_f64() / (4000.0 * f64::from(values)));
        }
    }
    for (format, own) in Format::ALL.into_iter().zip(best) {
        let ratio = own / best[0];
        println!("{format}: {ratio:.2} times CSV per value ({:.1} ns)", 1e9 * own);
        let is_text = format != Format::C3d && !format.has_bodies();
        assert!(!is_text || ratio < 1.5, "{format}: {ratio:.2}");
    }
}

/// Returns the bytes of every fixture.
fn fixtures() -> &'static [Vec<u8>] {
    static FIXTURES: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    FIXTURES.get_or_init(|| {
        let mut paths: Vec<PathBuf> =
            std::fs::read_dir(fixture("")).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        paths.iter().map(|path| read_file(path).unwrap().0).collect()
    })
}

/// Maximum memory of a recording as a multiple of the file size.
const MEMORY_FACTOR: usize = 64;

impl Recording {
    fn memory_bytes(&self) -> usize {
        let labels = self.labels.iter().map(String::capacity).sum::<usize>();
        labels
            + self.labels.capacity() * size_of::<String>()
            + self.frames.capacity() * size_of::<i64>()
            + self.positions_mm.capacity() * size_of::<[f64; 3]>()
    }
}

/// Damage to a file at one position.
#[derive(Debug, Clone)]
enum Damage {
    Byte(u8),
    Insert(&'static [u8]),
    /// Number of bytes removed or repeated.
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

    /// Damage anywhere in any file leads to a result or an error, never to a position with only some coordinates, and
    /// never to memory use far beyond the size of the file.
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
            let Ok(markers) = parse_markers(path, &file, MM) else { continue };
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
        let _ = parse_markers(Path::new("any"), &file, MM);
    }
}
