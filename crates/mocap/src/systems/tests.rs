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
    let others = text.replace(",Marker", ",Bone Marker").replace(",Rigid Body,", ",Bone,");
    let others = others.replace(",Rigid Body,", ",Bone,");
    assert_eq!(
        message(&others),
        "a.csv: found OptiTrack Motive CSV without markers (types of columns: `Bone`, `Rigid Body Marker`, `Bone \
         Marker`), needed columns of the type `Marker` or `Rigid Body`; enable `Markers` or `Rigid Bodies` in the \
         export settings of Motive"
    );
    let bodies = STYLE.motive(&["X", "Y", "Z"], false).replace(",Marker", ",Bone Marker");
    assert_eq!(
        message(&bodies.replace("Rotation Type,XYZ", "Rotation Type,Other")),
        "a.csv, line 7: found rotation of `Snake` in 3 columns, with the Rotation Type `Other`, needed X, Y, Z, W of a \
         quaternion or three angles with their order, such as XYZ; export the file again with the Rotation Type \
         `Quaternion`"
    );
    let unlabelled = text.replace("Snake:M", "Unlabeled:").replace(",Rigid Body,", ",Bone,");
    let unlabelled = unlabelled.replace(",Rigid Body,", ",Bone,");
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
    let needed = "needed 3D data with MARKER_NAMES or 6D data with BODY_NAMES; export the labelled trajectories as 3D \
                  data or the rigid bodies as 6D data, with the header";
    let text = QUALISYS.qualisys(&[], true);
    for (from, to, found) in [
        ("INCLUDED\t3D", "INCLUDED\t2D", "Qualisys TSV with 2D data"),
        ("DATA_INCLUDED\t3D", "NO_OF_BODIES\t3", "Qualisys TSV without bodies"),
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

/// Checks the pose of a body at rest that is turned by 90 degrees about the vertical axis and then by 0.1 rad about the
/// x axis of its frame.
fn assert_quarter_turned(text: &str, name: &str) {
    let file = read(text.as_bytes()).unwrap();
    assert_eq!(file.bodies(), [0], "{text}");
    assert_eq!(file.labels[0], format!("{name}@1"));
    let (origin_mm, axes) = file.pose(0, 0);
    let (sin, cos) = 0.1_f64.sin_cos();
    let expected = [[0.0, 1.0, 0.0], [-cos, 0.0, sin], [sin, 0.0, cos]];
    for (found, expected) in axes.as_flattened().iter().zip(expected.as_flattened()) {
        assert!((found - expected).abs() < 2e-5, "{axes:?}\n{text}");
    }
    for (found, expected) in origin_mm.iter().zip([1.0, 2.0, 3.0]) {
        assert!((found - expected).abs() < 1e-9, "{origin_mm:?}\n{text}");
    }
}

#[test]
fn rotations_of_rigid_bodies_are_read_in_every_representation() {
    // Motive with y up: the vertical axis y is the body's z, its x is z, its y is x.
    let head = "Format Version,1.23,Rotation Type,ROTATION,Length Units,Millimeters,Export Frame Rate,120\n\n";
    let motive = |rotation: &str, axes: &str, numbers: &str| {
        let count = axes.split(',').count();
        let cells = |cell: &str| format!(",,{}\n", vec![cell; count + 3].join(","));
        let kinds = [vec!["Rotation"; count], vec!["Position"; 3]].concat().join(",");
        let rows = format!("Frame,Time (Seconds),{axes},X,Y,Z\n1,0,{numbers},2,3,1\n");
        // A long way along x and z shows that y points up.
        let ways = format!("2,0.008333,{numbers},900,3,900\n");
        let names = [cells("Rigid Body"), cells("body"), cells("7")].concat();
        format!("{}{names},,{kinds}\n{rows}{ways}", head.replace("ROTATION", rotation))
    };
    let (s, c) = (0.05_f64.sin(), 0.05_f64.cos());
    let h = 0.5_f64.sqrt();
    // Product of the quaternions of a quarter of a turn about y and of 0.1 rad about the new z.
    let [w, x, y, z] = [h * c, h * s, h * c, h * s];
    let quaternion = format!("{x:.6},{y:.6},{z:.6},{w:.6}");
    assert_quarter_turned(&motive("Quaternion", "X,Y,Z,W", &quaternion), "body");
    let degrees = 0.1_f64.to_degrees();
    assert_quarter_turned(&motive("YXZ", "X,Y,Z", &format!("0,90,{degrees:.6}")), "body");
    assert_quarter_turned(&motive("YZX", "X,Y,Z", &format!("0,90,{degrees:.6}")), "body");
    // The same rotation with z first is one of 0.1 rad about the camera system's axis that becomes x.
    assert_quarter_turned(&motive("XYZ", "X,Y,Z", &format!("{degrees:.6},90,0")), "body");

    let [w, x, y, z] = [h * c, h * s, h * s, h * c];
    let angle = 2.0 * w.acos();
    let [rx, ry, rz] = [x, y, z].map(|component| angle * component / (0.5 * angle).sin());
    let tracker = |unit: &str, scale: f64| {
        let [rx, ry, rz] = [rx, ry, rz].map(|x| scale * x);
        format!(
            "Objects\n120\n,,body:body,,,,,\nFrame,Sub Frame,RX,RY,RZ,TX,TY,TZ\n,,{unit},{unit},{unit},mm,mm,mm\n\
             1,0,{rx:.6},{ry:.6},{rz:.6},1,2,3\n"
        )
    };
    assert_quarter_turned(&tracker("rad", 1.0), "body:body");
    assert_quarter_turned(&tracker("deg", 1_f64.to_degrees()), "body:body");
    assert_quarter_turned(
        &format!(
            "Objects\n120\n,,body:body,,,,,,\nFrame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ\n,,,,,,mm,mm,mm\n\
             1,0,{x:.6},{y:.6},{z:.6},{w:.6},1,2,3\n"
        ),
        "body:body",
    );
    let unknown = tracker("turns", 1.0);
    assert!(message(&unknown).contains("found unit `turns` of a rotation, needed `rad` or `deg`"));

    let (sin, cos) = 0.1_f64.sin_cos();
    let qualisys = |matrix: [f64; 9]| {
        let matrix = matrix.map(|x| format!("{x:.5}")).join("\t");
        format!(
            "NO_OF_FRAMES\t1\nNO_OF_BODIES\t1\nFREQUENCY\t120\nDATA_INCLUDED\t6D\nBODY_NAMES\tbody\n\
             1\t0.0\t1\t2\t3\t5.7\t0\t90\t0.4\t{matrix}\n"
        )
    };
    let matrix = [0.0, 1.0, 0.0, -cos, 0.0, sin, sin, 0.0, cos];
    assert_quarter_turned(&qualisys(matrix), "body");
    let text = qualisys([0.5; 9]);
    assert!(message(&text).contains("line 6: found matrix elements of `body` that are not those"));
    let lost = qualisys(matrix).replace("\t1\t2\t3\t", "\t0\t0\t0\t");
    let zeros = "1,0,0,0,0,0,0,0\n";
    let tracker = tracker("rad", 1.0);
    let head: String = tracker.split_inclusive('\n').take(5).collect();
    let rows = ["1,0,,,,,,\n", "1,0,0.1,,0.1,1,2,3\n", "1,0,0.1,0.1,0.1,1,,3\n"]
        .map(|row| head.clone() + row);
    let untracked = [lost, head + zeros].into_iter().chain(rows);
    for (text, incomplete) in untracked.zip([0, 0, 0, 1, 1]) {
        let file = read(text.as_bytes()).unwrap();
        assert!(file.row_mm(0).as_flattened().iter().all(|x| x.is_nan()));
        assert_eq!(file.incomplete, [incomplete, 0, 0, 0], "{text}");
    }
}

#[test]
fn tables_of_other_programs_are_read_by_the_names_of_their_columns() {
    let text = "note,time_s,tag_yaw_deg,tag_pitch_deg,tag_roll_deg,tag_x_m,tag_y_m,tag_z_m,frame,tag_error_px\n\
                a,0.5,90,0,5.729578,0.001,0.002,0.003,7,0.2\n\
                b,0.5083333,90,0,5.729578,0.001,0.002,0.003,8,0.2\n\
                c,0.525,,,,,,,10,\n";
    assert_quarter_turned(text, "tag");
    let file = read(text.as_bytes()).unwrap();
    assert_eq!((file.rate_hz, &file.frames[..]), (Some(120.0), &[7, 8, 10][..]));
    assert!(file.pose(2, 0).0[0].is_nan());
    assert_quarter_turned(&text.replace(',', ";").replace('.', ","), "tag");
    let listed = sections(Path::new("a.csv"), text.as_bytes()).unwrap();
    assert_eq!((&listed[0].name[..], listed[0].rows), ("Rigid bodies (table)", 3));

    // Without frame numbers, the times show that a frame is missing.
    let markers = "time_s,M1_x_cm,M1_y_cm,M1_z_cm\n0.00,1,2,3\n0.04,1,2,3\n0.121,1,2,3\n0.16,1,2,3\n0.20,1,2,3\n";
    let file = read(markers.as_bytes()).unwrap();
    assert_eq!((file.rate_hz, &file.frames[..]), (Some(25.0), &[1, 2, 4, 5, 6][..]));
    assert_eq!(
        (&file.labels[..], file.position_mm(0, 0)),
        (&["M1".to_owned()][..], [10.0, 20.0, 30.0])
    );

    // Times rounded to milliseconds at 120 Hz, with a gap of 23 frames.
    let rows = (0..200).filter(|frame| !(60..83).contains(frame));
    let rounded = rows.map(|frame| format!("{:.3},1,2,3\n", f64::from(frame) / 120.0));
    let rounded = "time_s,M1_x_cm,M1_y_cm,M1_z_cm\n".to_owned() + &rounded.collect::<String>();
    let file = read(rounded.as_bytes()).unwrap();
    assert_eq!((file.frames[59], file.frames[60], file.frames[176]), (60, 84, 200));
    assert!((file.rate_hz.unwrap() - 120.0).abs() < 0.1, "{:?}", file.rate_hz);

    for (text, found) in [
        (
            markers.replace("0.121", "0.14"),
            "found 0.1 s from the time before in row 3 below the header",
        ),
        (
            markers.replace("0.121", "0.03"),
            "found time 0.03 s after 0.04 s in row 3 below the header",
        ),
        (markers.replace("0.121", ""), "found time NaN s after 0.04 s in row 3"),
        (markers.replace("M1_z_cm", "M2_z_cm"), ", line 1: found a table without positions"),
        (
            text.replace("tag_roll_deg", "tag_roll"),
            ", line 1: found only a part of the rotation of `tag`",
        ),
        (
            text.replace("note", "tag_x_m"),
            ", line 1: found more than one column for the same as `tag_x_m`",
        ),
        (
            text.replace("tag_error_px", "M1_x_mm,M1_y_mm,M1_z_mm"),
            ", line 1: found positions of `M1` in mm beside others in m, needed one unit",
        ),
        (text.replacen("0.001", "x", 1), ", line 2, column 6 (tag X): found `x`"),
        (text.replacen("90", "x", 1), ", line 2, column 3 (rotation of tag): found `x`"),
    ] {
        assert!(message(&text).contains(found), "{}", message(&text));
    }
}

#[test]
fn a_damaged_parquet_file_is_an_error() {
    let labels = (0..4).map(|i| trilink_base::body::point_label("tag", i)).collect();
    let axes = trilink_base::body::turned([(2, 0.3), (1, 0.0), (0, 0.0)]);
    let points = trilink_base::body::points([1.0, 2.0, 3.0], &axes);
    let positions = (0..50).flat_map(|_| points).collect();
    let file = Recording::new(Some(120.0), (1..51).collect(), labels, positions);
    let bytes = crate::Format::PosesParquet.encode("a", &file);
    let path = Path::new("a.parquet");
    let whole = parse_markers(path, &bytes, LengthUnit::Mm).unwrap();
    assert_eq!((whole.frames, whole.labels), (file.frames, file.labels));
    for cut in (4..bytes.len()).step_by(97) {
        let error = parse_markers(path, &bytes[..cut], LengthUnit::Mm).unwrap_err().to_string();
        assert!(error.starts_with("a.parquet: found a damaged Parquet file"), "{error}");
    }
}
