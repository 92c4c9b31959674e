//! Tests of exported trials, opened by libraries that read the formats of other viewers.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

use crate::common::{Small, succeed, text, trilink};

const TRIAL: &str = "kinematic-symmetric-5.00-r1";

/// Returns a shared folder with ingested trials, which no test changes.
fn ingested() -> &'static Small {
    static FOLDER: OnceLock<Small> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = Small::raw();
        succeed(folder.path(), &["-q", "ingest"]);
        folder
    })
}

fn exported(format: &str) -> Vec<u8> {
    let arguments = ["export", TRIAL, "--format", format, "--output", "-"];
    let output = trilink(ingested().path(), &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    output.stdout
}

/// Returns the columns of the exported CSV file, indexed by name, with NaN for empty cells.
fn columns() -> BTreeMap<String, Vec<f64>> {
    let table = text(&exported("csv"));
    let mut rows = table.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let names = rows.next().unwrap();
    let mut columns: BTreeMap<String, Vec<f64>> =
        names.iter().map(|name| (name.clone(), Vec::new())).collect();
    for row in rows {
        assert_eq!(row.len(), names.len());
        for (name, cell) in names.iter().zip(row) {
            columns.get_mut(name).unwrap().push(cell.parse().unwrap_or(f64::NAN));
        }
    }
    columns
}

fn labels(columns: &BTreeMap<String, Vec<f64>>) -> Vec<String> {
    let names = columns.keys().filter_map(|name| name.strip_suffix("_x_mm"));
    names.map(str::to_owned).collect()
}

#[test]
fn a_table_has_poses_and_markers_by_name_and_unit() {
    let columns = columns();
    let frames = columns["frame"].len();
    assert!(frames > 1000 && labels(&columns).len() == 10, "{:?}", columns.keys());
    let last = frames - 1;
    let elapsed_s = (columns["frame"][last] - columns["frame"][0]) / 120.0;
    assert!((columns["time_s"][last] - elapsed_s).abs() < 1e-9);
    // Joint 1 is a distance h in front of link 0 and a distance l behind link 1.
    let of = |name: &str| columns[name][frames / 2];
    let theta = [of("link0_theta_rad"), of("link1_theta_rad")];
    let x_m = of("link0_x_m") + 0.144 * theta[0].cos() + 0.112 * theta[1].cos();
    assert!((x_m - of("link1_x_m")).abs() < 1e-9, "{x_m} {}", of("link1_x_m"));
    let missing = columns.values().flatten().filter(|value| value.is_nan()).count();
    assert!(missing > 10, "{missing}");
}

#[test]
fn a_trc_file_is_laid_out_as_opensim_reads_it() {
    let (trc, columns) = (text(&exported("trc")), columns());
    let lines: Vec<Vec<&str>> = trc.lines().map(|line| line.split('\t').collect()).collect();
    let frames = columns["frame"].len();
    assert_eq!(lines[0], ["PathFileType", "4", "(X/Y/Z)", &format!("{TRIAL}.trc")]);
    assert_eq!(
        lines[1].join(" "),
        "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame OrigNumFrames"
    );
    let first = columns["frame"][0];
    assert_eq!(lines[2].join(" "), format!("120 120 {frames} 15 mm 120 {first} {frames}"));
    assert_eq!(lines[3][..2], ["Frame#", "Time"]);
    assert_eq!(lines[4][..6], ["", "", "X1", "Y1", "Z1", "X2"]);
    assert_eq!(lines[5], [""]);
    assert_eq!(lines.len(), 6 + frames);
    let names: Vec<&str> = lines[3][2..].iter().copied().filter(|name| !name.is_empty()).collect();
    assert_eq!(names[10..], ["link0", "link1", "link2", "joint1", "joint2"]);
    let mut empty = 0;
    for (row, line) in lines[6..].iter().enumerate() {
        // Every line ends with a tab.
        assert_eq!(line.len(), 2 + 3 * 15 + 1, "row {row}");
        for (nth, name) in names[..10].iter().enumerate() {
            for (axis, cell) in ["x", "y", "z"].iter().zip(&line[2 + 3 * nth..]) {
                let value = columns[&format!("{name}_{axis}_mm")][row];
                empty += usize::from(cell.is_empty());
                match cell.parse::<f64>() {
                    Ok(found) => assert!((found - value).abs() < 1e-4, "{row} {name}"),
                    Err(_) => assert!(cell.is_empty() && value.is_nan(), "{row} {name} {cell}"),
                }
            }
        }
    }
    assert!(empty > 10, "{empty}");
}

/// Returns the records in a section of an MCAP file, each with its opcode and content.
fn records(mut bytes: &[u8]) -> Vec<(u8, &[u8])> {
    let mut records = Vec::new();
    while let [kind, rest @ ..] = bytes {
        let (length, rest) = rest.split_first_chunk().unwrap();
        let (content, rest) = rest.split_at(u64::from_le_bytes(*length) as usize);
        records.push((*kind, content));
        bytes = rest;
    }
    records
}

fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte))
}

#[test]
fn an_mcap_file_has_every_frame_s_transforms_and_points_and_an_index() {
    const MAGIC: &[u8] = b"\x89MCAP0\r\n";
    let (bytes, columns) = (exported("mcap"), columns());
    let inner = bytes.strip_prefix(MAGIC).unwrap().strip_suffix(MAGIC).unwrap();
    let all = records(inner);
    let kinds: Vec<u8> = all.iter().map(|(kind, _)| *kind).collect();
    // Opcodes: header, chunk, message indices, end of data; schemas, channels, statistics, chunk index, footer.
    assert_eq!(kinds, [1, 6, 7, 7, 15, 3, 4, 3, 4, 11, 8, 2]);
    let labels = labels(&columns);
    let (mut links, mut markers) = (0, 0);
    // In a chunk, the fields before the records take 40 bytes.
    for (_, message) in records(&all[1].1[40..]).into_iter().filter(|(kind, _)| *kind == 5) {
        let (row, time_ns) = (number(&message[2..6]) as usize, number(&message[6..14]));
        assert_eq!(time_ns, (1e9 * columns["time_s"][row]).round() as u64);
        if number(&message[..2]) == 1 {
            links += 1;
            continue;
        }
        markers += 1;
        // The points are the last field of the message.
        let of = |label: &String| {
            ["x", "y", "z"].map(|axis| columns[&format!("{label}_{axis}_mm")][row])
        };
        let seen = labels.iter().map(of).filter(|at| at[0].is_finite());
        let mut expected: Vec<f32> = seen.flatten().map(|value| (1e-3 * value) as f32).collect();
        let points = message[message.len() - 4 * expected.len()..].as_chunks::<4>().0;
        let mut found: Vec<f32> = points.iter().map(|b| f32::from_le_bytes(*b)).collect();
        found.sort_by(f32::total_cmp);
        expected.sort_by(f32::total_cmp);
        assert_eq!(found, expected, "row {row}");
    }
    let with_poses = columns["link0_x_m"].iter().filter(|x| x.is_finite()).count();
    assert_eq!((links, markers), (with_poses, columns["frame"].len()));
    assert_eq!(number(&all[9].1[..8]) as usize, links + markers);
}

#[test]
fn a_trial_is_found_by_its_name_or_folder_and_a_file_is_not_replaced_unasked() {
    let folder = ingested().copy();
    let run = |arguments: &[&str]| trilink(folder.path(), &[&["export"], arguments].concat());
    let said = |arguments: &[&str]| {
        let output = run(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        text(&output.stderr)
    };
    let name = format!("{TRIAL}.trc");
    assert_eq!(succeed(folder.path(), &["export", TRIAL, "--format", "trc"]), format!("{name}\n"));
    assert_eq!(folder.read(&name), exported("trc"));
    let there = said(&[TRIAL, "--format", "trc"]);
    assert!(there.contains(&name) && there.contains("--force"), "{there}");
    folder.write(&name, "of before");
    succeed(folder.path(), &["export", TRIAL, "--format", "trc", "--force"]);
    assert_eq!(folder.read(&name), exported("trc"));
    let by_folder = run(&[&format!("raw/{TRIAL}"), "--format", "csv", "-o", "-"]);
    assert_eq!(by_folder.stdout, exported("csv"));
    let unknown = said(&["kinematic-symetric-5.00-r1", "--format", "csv"]);
    assert!(unknown.contains(&format!("did you mean `{TRIAL}`?")), "{unknown}");
    let format = said(&[TRIAL, "--format", "bvh"]);
    assert!(format.contains("trc") && format.contains("mcap"), "{format}");
    let absent = said(&[TRIAL, "--format", "trc", "--output", "pipeline.toml/a.trc"]);
    assert!(absent.contains("cannot be written"), "{absent}");
}

#[test]
fn a_trial_of_two_folders_is_named_by_its_folder() {
    let folder = Small::raw();
    for (path, bytes) in crate::common::files(&folder.place("raw")) {
        folder.write(&format!("other/{}", path.display()), bytes);
    }
    folder.replace("pipeline.toml", "raw = \"raw\"", "raw = [\"raw\", \"other\"]");
    let export = |name: &str| {
        let output = trilink(folder.path(), &["export", name, "--format", "csv", "-o", "-"]);
        (output.status.code(), text(&output.stderr))
    };
    let (status, said) = export(TRIAL);
    assert_eq!(status, Some(2));
    assert!(said.contains("several folders") && said.contains(&format!("raw_{TRIAL}")), "{said}");
    // The trial is not ingested.
    for name in [format!("other/{TRIAL}"), format!("other_{TRIAL}")] {
        let (status, said) = export(&name);
        assert_eq!(status, Some(1), "{said}");
        assert!(said.contains("without poses") && said.contains("not been ingested"), "{said}");
    }
}

#[test]
fn a_failed_trial_has_markers_and_the_reason() {
    let folder = Small::raw();
    let list = text(&folder.read("raw/trials.toml"));
    let changed = list.split("[[trial]]").map(|entry| match entry.contains(TRIAL) {
        true => entry.replace("omega_rad_s = 5.0", "omega_rad_s = 900.0"),
        false => entry.to_owned(),
    });
    folder.write("raw/trials.toml", changed.collect::<Vec<_>>().join("[[trial]]"));
    assert_eq!(trilink(folder.path(), &["-q", "ingest"]).status.code(), Some(1));
    let output = trilink(folder.path(), &["export", TRIAL, "--format", "trc"]);
    assert_eq!(output.status.code(), Some(1));
    let said = text(&output.stderr);
    assert!(said.contains("without poses, because the trial has the status `failed`: "), "{said}");
    let trc = text(&folder.read(&format!("{TRIAL}.trc")));
    assert_eq!(trc.lines().nth(2).unwrap().split('\t').nth(3), Some("10"));
}

#[test]
fn the_viewers_own_libraries_open_the_files() {
    let python = std::env::var("TRILINK_PYTHON").unwrap_or("python3".to_owned());
    let folder = tempfile::tempdir().unwrap();
    for format in ["trc", "mcap", "csv"] {
        std::fs::write(folder.path().join(format!("trial.{format}")), exported(format)).unwrap();
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/open_exports.py");
    let Ok(opened) = Command::new(&python).arg(script).arg(folder.path()).output() else {
        eprintln!("left out: {python} does not start");
        return;
    };
    let said = text(&opened.stdout) + &text(&opened.stderr);
    eprintln!("{said}");
    match opened.status.code() {
        Some(77) => eprintln!("left out: nothing to open the files with"),
        status => assert_eq!(status, Some(0), "{said}"),
    }
}
