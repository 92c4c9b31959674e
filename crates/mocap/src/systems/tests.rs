//! Files of other systems than Vicon, with the same markers in every variant that the systems write.

use std::path::Path;

use crate::{LengthUnit, Recording, parse_markers, sections};

const RATE_HZ: f64 = 120.0;
const FRAMES: usize = 60;

/// Returns the position of a marker, mm, with z up; `None` in the frames in which marker 1 is occluded.
fn position(marker: usize, frame: usize) -> Option<[f64; 3]> {
    let hidden = marker == 1 && (10..15).contains(&frame);
    let along = frame as f64;
    (!hidden).then_some([100.0 + 2.5 * along, -40.0 * marker as f64 + 1.25 * along, 62.5])
}

/// Way in which a file is written.
#[derive(Clone, Copy)]
struct Style {
    labels: [&'static str; 2],
    separator: char,
    decimal: char,
    /// Millimetres per unit, and name of the unit.
    unit: (f64, &'static str),
    y_up: bool,
    /// Text for a coordinate of an occluded marker.
    missing: &'static str,
    first: usize,
    /// Frame rate that the times follow.
    time_hz: f64,
}

const STYLE: Style = Style {
    labels: ["Snake:M1", "Snake:M2"],
    separator: ',',
    decimal: '.',
    unit: (1.0, "mm"),
    y_up: false,
    missing: "",
    first: 0,
    time_hz: RATE_HZ,
};

impl Style {
    fn number(&self, x: f64) -> String {
        format!("{x:.6}").replace('.', &self.decimal.to_string())
    }

    fn time(&self, frame: usize) -> String {
        self.number(frame as f64 / self.time_hz)
    }

    /// Returns the cells of the coordinates of a marker.
    fn cells(&self, marker: usize, frame: usize) -> Vec<String> {
        let Some([x, y, z]) = position(marker, frame) else {
            return vec![self.missing.to_owned(); 3];
        };
        let axes = if self.y_up { [y, z, x] } else { [x, y, z] };
        axes.map(|x| self.number(x / self.unit.0)).to_vec()
    }

    /// Joins rows of cells, with commas in place of other separators in `head`.
    fn lines(&self, head: &str, rows: impl Iterator<Item = Vec<String>>) -> String {
        let separator = self.separator.to_string();
        let rows = rows.map(|row| row.join(&separator) + "\r\n");
        head.replace(',', &separator) + &rows.collect::<String>()
    }

    /// Export of Motive with a rigid body, its expected markers, both markers and an unlabelled one. `rotation` names
    /// the columns of the rotation; `is_named` adds the names of the header rows, as newer versions do.
    fn motive(&self, rotation: &[&str], is_named: bool) -> String {
        let [a, b] = self.labels;
        let mut rows = vec![String::new(); 5];
        let mut add = |kind: &str, name: &str, what: &str, axes: &[&str]| {
            for axis in axes {
                for (row, cell) in rows.iter_mut().zip([kind, name, "7F01", what, axis]) {
                    *row += &format!(",{cell}");
                }
            }
        };
        let xyz = ["X", "Y", "Z"];
        add("Rigid Body", "Snake", "Rotation", rotation);
        add("Rigid Body", "Snake", "Position", &xyz);
        add("Rigid Body", "Snake", "Mean Marker Error", &[""]);
        add("Rigid Body Marker", a, "Position", &xyz);
        add("Rigid Body Marker", a, "Marker Quality", &[""]);
        add("Marker", a, "Position", &xyz);
        add("Marker", "Unlabeled 1204", "Position", &xyz);
        add("Marker", b, "Position", &xyz);
        let names = if is_named { ["Type", "Name", "ID", ""] } else { [""; 4] };
        let unit = self.unit.1;
        let mut head = format!(
            "Format Version,1.23,Take Name,take 7,Capture Frame Rate,{rate},Export Frame Rate,{rate},Capture Start \
             Time,2026-03-02 11.20.30.123 AM,Total Frames in Take,900,Total Exported Frames,{FRAMES},Rotation Type,\
             XYZ,Length Units,{unit},Coordinate Space,Global\r\n\r\n",
            rate = self.number(RATE_HZ).replace(',', "\u{1}"),
        );
        for (row, name) in rows.iter().zip(names) {
            head += &format!(",{name}{row}\r\n");
        }
        head += &format!("Frame,Time (Seconds){}\r\n", rows[4]);
        let head = head.replace(',', &self.separator.to_string()).replace('\u{1}', ",");
        let body = (0..FRAMES).map(|frame| {
            let mut row = vec![(self.first + frame).to_string(), self.time(frame)];
            row.extend((0..rotation.len() + 8).map(|_| self.number(0.125)));
            row.extend([self.cells(0, frame), vec![self.number(9.0); 3]].concat());
            row.extend(self.cells(1, frame));
            row
        });
        // Replaces no comma: the header has its separators already.
        let separator = self.separator.to_string();
        head + &body.map(|row| row.join(&separator) + "\r\n").collect::<String>()
    }

    fn trc(&self) -> String {
        let [a, b] = self.labels;
        let (frames, unit) = (FRAMES, self.unit.1);
        let head = format!(
            "PathFileType,4,(X/Y/Z),a.trc\r\n\
             DataRate,CameraRate,NumFrames,NumMarkers,Units,OrigDataRate,OrigDataStartFrame,OrigNumFrames\r\n\
             {RATE_HZ},{RATE_HZ},{frames},2,{unit},{RATE_HZ},1,{frames}\r\n\
             Frame#,Time,{a},,,{b},,\r\n,,X1,Y1,Z1,X2,Y2,Z2\r\n\r\n"
        );
        let rows = (0..FRAMES).map(|frame| {
            let begin = vec![(self.first + frame).to_string(), self.time(frame)];
            [begin, self.cells(0, frame), self.cells(1, frame)].concat()
        });
        self.lines(&head, rows)
    }

    /// Export of Qualisys with the columns of frames and times, each if its name is in `leading`, named if `is_named`.
    fn qualisys(&self, leading: &[&str], is_named: bool) -> String {
        let [a, b] = self.labels;
        let mut head = format!(
            "NO_OF_FRAMES,{FRAMES}\r\nNO_OF_CAMERAS,8\r\nNO_OF_MARKERS,2\r\nFREQUENCY,{RATE_HZ}\r\nNO_OF_ANALOG,0\r\n\
             ANALOG_FREQUENCY,0\r\nDESCRIPTION,--\r\nTIME_STAMP,2026-03-02; 11:20:30.123,4531.5\r\n\
             DATA_INCLUDED,3D\r\nEVENT,start,12,0.1\r\nMARKER_NAMES,{a},{b}\r\nTRAJECTORY_TYPES,Measured,Mixed\r\n"
        );
        if is_named {
            let axes = [a, b].map(|label| format!("{label} X,{label} Y,{label} Z"));
            let mut names: Vec<&str> = leading.to_vec();
            names.extend(axes.iter().map(String::as_str));
            head += &(names.join(",") + "\r\n");
        }
        let rows = (0..FRAMES).map(|frame| {
            let mut row = Vec::new();
            for column in leading {
                row.push(match *column {
                    "Frame" => (self.first + frame).to_string(),
                    _ => self.time(frame),
                });
            }
            [row, self.cells(0, frame), self.cells(1, frame)].concat()
        });
        self.lines(&head, rows)
    }
}

const TABS: Style = Style { separator: '\t', first: 1, ..STYLE };
const QUALISYS: Style = Style { missing: "0.000", ..TABS };
const QUATERNION: [&str; 4] = ["X", "Y", "Z", "W"];

fn read(text: &[u8]) -> Result<Recording, String> {
    let path = Path::new("a.csv");
    let _ = sections(path, text);
    parse_markers(path, text, LengthUnit::Mm).map_err(|error| error.to_string())
}

fn message(text: &str) -> String {
    read(text.as_bytes()).unwrap_err()
}

fn assert_right(text: &[u8], style: &Style) {
    let file = read(text).unwrap();
    assert_eq!(file.labels, style.labels);
    assert_eq!((file.rate_hz, file.frames.len()), (Some(RATE_HZ), FRAMES));
    assert_eq!(file.frames[0], style.first as i64);
    assert_eq!(file.doubts, [""; 0]);
    assert_eq!((file.rows_too_long, file.rows_without_frame), (0, 0));
    for frame in 0..FRAMES {
        for marker in 0..2 {
            let found = file.position_mm(frame, marker);
            match position(marker, frame) {
                Some(is) => {
                    let off = (0..3).map(|axis| (found[axis] - is[axis]).abs()).fold(0.0, f64::max);
                    assert!(off < 1e-3, "{found:?} for {is:?} in frame {frame}");
                }
                None => assert!(found.iter().all(|x| x.is_nan()), "{found:?} in frame {frame}"),
            }
        }
    }
}

#[test]
fn every_system_gives_the_same_markers_in_any_unit_and_with_y_or_z_up() {
    for unit in [(1.0, "mm"), (10.0, "Centimeters"), (1000.0, "Meters"), (1.0, "Millimeters")] {
        for y_up in [false, true] {
            let style = Style { unit, y_up, ..STYLE };
            assert_right(style.motive(&QUATERNION, false).as_bytes(), &style);
            let style = Style { unit, y_up, ..TABS };
            assert_right(style.trc().as_bytes(), &style);
            let style = Style { y_up, ..QUALISYS };
            assert_right(style.qualisys(&["Frame", "Time"], true).as_bytes(), &style);
        }
    }
}

#[test]
fn line_ends_encodings_and_spreadsheets_change_nothing() {
    let accented = ["Sn\u{e4}ke:M\u{f6}1", "Snake:\u{e9}"];
    for (separator, decimal) in [(',', '.'), ('\t', '.'), (';', '.'), (';', ','), ('\t', ',')] {
        let style = Style { separator, decimal, labels: accented, ..STYLE };
        let zeros = if decimal == ',' { "0,000" } else { "0.000" };
        let qualisys = Style { missing: zeros, ..style };
        for (text, style) in [
            (style.motive(&QUATERNION, true), style),
            (style.trc(), style),
            (qualisys.qualisys(&["Frame", "Time"], true), qualisys),
        ] {
            for end in ["\r\n", "\n", "\r"] {
                assert_right(text.replace("\r\n", end).as_bytes(), &style);
            }
            assert_right(["\u{feff}", &text].concat().as_bytes(), &style);
            let latin1: Vec<u8> =
                text.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
            assert_right(&latin1, &style);
            let units = |mark: &str| [mark, &text].concat().encode_utf16().collect::<Vec<u16>>();
            for mark in ["\u{feff}", ""] {
                let little: Vec<u8> =
                    units(mark).iter().flat_map(|unit| unit.to_le_bytes()).collect();
                let big: Vec<u8> = units(mark).iter().flat_map(|unit| unit.to_be_bytes()).collect();
                assert_right(&little, &style);
                assert_right(&big, &style);
            }
        }
    }
}

#[test]
fn missing_values_may_be_words_in_all_systems_but_vicon_s() {
    for missing in ["", "NaN", "nan", "NULL"] {
        let style = Style { missing, ..TABS };
        assert_right(style.trc().as_bytes(), &style);
        assert_right(style.qualisys(&[], false).as_bytes(), &style);
        let style = Style { missing, ..STYLE };
        assert_right(style.motive(&QUATERNION, false).as_bytes(), &style);
    }
    // Three zeros are a position for all systems but Qualisys.
    let zeros = Style { missing: "0.000", ..TABS };
    assert_eq!(read(zeros.trc().as_bytes()).unwrap().position_mm(12, 1), [0.0; 3]);
}

#[test]
fn motive_s_rigid_bodies_are_skipped_whatever_the_order_of_their_rotation() {
    for order in ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX", "XYZW"] {
        let rotation: Vec<String> = order.chars().map(String::from).collect();
        let rotation: Vec<&str> = rotation.iter().map(String::as_str).collect();
        for is_named in [false, true] {
            assert_right(STYLE.motive(&rotation, is_named).as_bytes(), &STYLE);
        }
    }
    let text = STYLE.motive(&QUATERNION, true);
    // A row of parents, and another version of the format.
    let parents = text.replacen(",ID,", ",Parent,,,\r\n,ID,", 1).replacen(",1.23,", ",1.25,", 1);
    assert_right(parents.as_bytes(), &STYLE);
    let listed = sections(Path::new("a.csv"), text.as_bytes()).unwrap();
    let [one] = listed.as_slice() else { panic!("{listed:?}") };
    assert_eq!((&one.name[..], one.line, one.rows), ("Markers (OptiTrack Motive CSV)", 7, FRAMES));
}

#[test]
fn a_motive_file_that_cannot_be_read_is_named_with_the_setting_to_change() {
    let text = STYLE.motive(&QUATERNION, false);
    let bodies = text.replace(",Marker", ",Bone Marker");
    assert_eq!(
        message(&bodies),
        "a.csv: found OptiTrack Motive CSV without markers (types of columns: `Rigid Body`, `Rigid Body Marker`, \
         `Bone Marker`), needed columns of the type `Marker`; enable `Markers` in the export settings of Motive"
    );
    let unlabelled = text.replace("Snake:M", "Unlabeled:");
    assert_eq!(
        message(&unlabelled),
        "a.csv: found OptiTrack Motive CSV with 3 unlabelled markers and no other, needed labelled markers; label \
         them in Motive and export the file again"
    );
    let (first, _) = text.split_once("\r\n").unwrap();
    assert_eq!(
        message(first),
        "a.csv: found OptiTrack Motive CSV without a row `Frame,Time (Seconds),X,Y,Z`, needed the header; enable it \
         in the export settings of Motive"
    );
    assert_eq!(
        message(&text.replace("Units,mm", "Units,furlongs")),
        "a.csv, line 1: found Length Units `furlongs`, needed a unit of length: `mm`, `cm`, `m`, `in`"
    );
}

#[test]
fn rates_times_and_counts_of_a_file_must_agree() {
    let slow = |style: Style| Style { time_hz: 100.0, ..style };
    for text in [
        slow(STYLE).motive(&QUATERNION, false),
        slow(TABS).trc(),
        slow(QUALISYS).qualisys(&["Frame", "Time"], true),
    ] {
        assert_eq!(
            message(&text),
            "a.csv: found contradictory frame rates, Hz: 120 (header) and 100.000000 (times of the first and the last \
             frame), needed one frame rate, because it is unknown which is correct; export the file again"
        );
    }
    let doubts = |text: String| read(text.as_bytes()).unwrap().doubts;
    let motive =
        STYLE.motive(&QUATERNION, false).replace("Exported Frames,60", "Exported Frames,90");
    assert_eq!(doubts(motive), ["frames: found 90 (Total Exported Frames) and 60 (rows), used 60"]);
    let trc = TABS.trc().replace("\t60\t2\t", "\t61\t3\t");
    assert_eq!(
        doubts(trc),
        [
            "markers: found 3 (NumMarkers) and 2 (row of axes), used 2",
            "frames: found 61 (NumFrames) and 60 (rows), used 60"
        ]
    );
    let qualisys = QUALISYS.qualisys(&[], false).replace("FRAMES\t60", "FRAMES\t30");
    assert_eq!(doubts(qualisys), ["frames: found 30 (NO_OF_FRAMES) and 60 (rows), used 60"]);
    let none = STYLE.motive(&QUATERNION, false).replace("Length Units,mm,", "");
    assert_eq!(doubts(none), ["unit: found none (Length Units), used mm (vicon.unit)"]);
}

#[test]
fn labels_of_a_trc_file_belong_to_the_axes_below_them() {
    let text = TABS.trc();
    let [a, b] = TABS.labels;
    let above = format!("Time\t{a}\t\t\t{b}\t\t");
    assert!(text.contains(&above));
    // Side by side, without a gap, and without the leading tabs of the row of axes.
    for (labels, axes) in [
        (format!("Time\t{a}\t{b}"), "\t\tX1"),
        (format!("Time\t{a}\t\t{b}"), "X1"),
        (above.clone(), "X1"),
    ] {
        let text = text.replace(&above, &labels).replace("\t\tX1", axes);
        assert_right(text.as_bytes(), &TABS);
    }
    // A marker without a label is left out.
    let only_second = read(text.replace(a, "").as_bytes()).unwrap();
    assert_eq!(only_second.labels, [b]);
    assert_eq!(Some(only_second.position_mm(0, 0)), position(1, 0));
    let three = text.replace(&above, &format!("Time\t{a}\t{b}\tM3"));
    assert_eq!(
        message(&three),
        "a.csv, line 4: found 3 labels for 2 markers, needed the label of each marker above its X"
    );
    let no_axes = text.replace("X1\tY1", "X1\tX1");
    assert!(message(&no_axes).starts_with("a.csv, line 5: found `X1`, needed a row of axes"));
}

#[test]
fn columns_of_frames_and_times_of_a_qualisys_file_are_optional() {
    for leading in [&["Frame", "Time"][..], &["Frame"], &["Time"], &[]] {
        for is_named in [true, false] {
            let text = QUALISYS.qualisys(leading, is_named);
            assert_right(text.as_bytes(), &QUALISYS);
            // Each row ends by a separator.
            let padded = text.replace("\r\n", "\t\r\n");
            assert_right(padded.as_bytes(), &QUALISYS);
        }
    }
    // A frame in which no marker is visible, without frame numbers.
    let text = Style { missing: "", ..QUALISYS }.qualisys(&[], false);
    let lines: Vec<&str> = text.split_inclusive("\r\n").collect();
    let hidden = [lines[..20].concat(), "\t\t\t\t\t\r\n".to_owned(), lines[21..].concat()].concat();
    let file = read(hidden.as_bytes()).unwrap();
    assert_eq!((file.frames.len(), file.doubts.len()), (FRAMES, 0));
    assert!(file.row_mm(8).iter().flatten().all(|x| x.is_nan()));
    assert_eq!(Some(file.position_mm(9, 0)), position(0, 9));
    let triggered = QUALISYS.qualisys(&[], false).replace("FREQUENCY\t120", "FREQUENCY\tEXT");
    assert_eq!(read(triggered.as_bytes()).unwrap().rate_hz, None);
    let needed = "needed 3D data with MARKER_NAMES; export the labelled trajectories as 3D data, with the header";
    let text = QUALISYS.qualisys(&[], true);
    for (from, to, found) in [
        ("INCLUDED\t3D", "INCLUDED\t2D", "Qualisys TSV with 2D data"),
        ("DATA_INCLUDED\t3D", "NO_OF_BODIES\t3", "Qualisys TSV with 6D data of rigid bodies"),
        ("MARKER_NAMES", "OTHER", "Qualisys TSV without markers"),
    ] {
        assert_eq!(message(&text.replace(from, to)), format!("a.csv: found {found}, {needed}"));
    }
    let one = text.replace("\tSnake:M2\r\n", "\r\n");
    assert!(message(&one).contains("found 6 columns for 1 markers"), "{}", message(&one));
}

#[test]
fn a_vertical_axis_that_the_motion_does_not_show_is_noted() {
    let text = TABS.trc();
    let head: String = text.split_inclusive("\r\n").take(7).collect();
    let file = read(head.as_bytes()).unwrap();
    let note =
        "vertical axis: found none (the markers move 0.0 mm along y and 0.0 mm along z), used z";
    assert_eq!(file.doubts, ["frames: found 60 (NumFrames) and 1 (rows), used 1", note]);
    assert_eq!(file.position_mm(0, 0), [100.0, 0.0, 62.5]);
    let motive = STYLE.motive(&QUATERNION, false);
    let head: String = motive.split_inclusive("\r\n").take(8).collect();
    let file = read(head.as_bytes()).unwrap();
    assert!(file.doubts[1].ends_with("used y"), "{:?}", file.doubts);
    assert_eq!(file.position_mm(0, 0), [62.5, 100.0, 0.0]);
}

#[test]
fn index_columns_and_decimal_commas_between_commas_are_named() {
    let vicon = "Trajectories\n120\n,,S:A,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1.5,2.5,3.5\n2,0,1.6,2.6,3.5\n";
    assert!(read(vicon.as_bytes()).is_ok());
    let indexed: String =
        vicon.lines().enumerate().map(|(i, line)| format!("{i},{line}\n")).collect();
    assert_eq!(
        message(&indexed),
        "a.csv: found a column with an index before `Frame` in line 4, as pandas writes it, needed a `Trajectories` \
         section; save the file without it"
    );
    let commas = vicon.replace('.', ",");
    assert!(message(&commas).contains("decimal commas"), "{}", message(&commas));
    let motive = Style { decimal: ',', ..STYLE }.motive(&QUATERNION, false);
    assert!(message(&motive).contains("decimal commas"), "{}", message(&motive));
}
