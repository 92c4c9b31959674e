//! Tests of mistakes that laboratories make in the configuration, in the list of trials and in recordings: the program
//! names the cause of each, and none passes for a success anywhere from the marker files to the report page.

use rayon::prelude::*;
use trilink_robot::rotated;
use trilink_tables::{Columns as _, Table, TrialRow, TrialStatus};

use crate::common::{Small, text, trilink};

/// Configuration at the root of the repository.
const CONFIGURATION: &str = include_str!("../../pipeline.toml");
const LIST: &str = "raw/trials.toml";
const SYMMETRIC: [&str; 3] =
    ["kinematic-symmetric-4.00-r1", "kinematic-symmetric-5.00-r1", "kinematic-symmetric-6.00-r1"];
const SKEWED: [&str; 3] =
    ["kinematic-skewed-4.00-r1", "kinematic-skewed-5.00-r1", "kinematic-skewed-6.00-r1"];
const COAST: &str = "kinematic-coast-down-r1";

/// Mistake in a project, and the strings that the program's output must contain.
struct Mistake {
    name: &'static str,
    make: fn(&Small),
    words: &'static [&'static str],
}

const fn mistake(name: &'static str, make: fn(&Small), words: &'static [&'static str]) -> Mistake {
    Mistake { name, make, words }
}

/// Names of mistakes for which the report page is also checked: one for each way in which the program can end.
const ON_THE_PAGE: [&str; 3] = ["the sign of a phase", "a file that the list lacks", TURNED];
const TURNED: &str = "links turned by five degrees";
const NO_FIT: &str = "No model could be fitted to this campaign.";

/// Creates trials of all of the paper's campaigns at three frequencies, their coast-downs and joint releases, and a
/// configuration for quick fits.
fn all_campaigns() -> Small {
    let night = Small(tempfile::tempdir().expect("a temporary folder"));
    let small = [
        ("raw = ", "\"raw\""),
        ("starts = ", "1"),
        ("bootstrap = ", "0"),
        ("profiles = ", "false"),
        ("models = ", "[\"no-skid\", \"skid-roll\"]"),
    ];
    let lines = CONFIGURATION.lines().map(|line| {
        let key = small.iter().find(|(key, _)| line.starts_with(key));
        key.map_or(line.to_owned(), |(key, value)| format!("{key}{value}")) + "\n"
    });
    night.write("pipeline.toml", lines.collect::<String>());
    crate::common::succeed(night.path(), &["-q", "synth", "raw", "--omega", "4,5,6"]);
    night
}

/// Creates the trials of a small laboratory: three frequencies in each of two campaigns, and a coast-down.
fn night() -> Small {
    let night = all_campaigns();
    let list = text(&night.read(LIST));
    for trial in list.split("[[trial]]").filter(|trial| trial.contains("\"semi-passive")) {
        night.replace(LIST, &format!("[[trial]]{trial}"), "");
        let file = trial.lines().find_map(|line| line.strip_prefix("file = ")).expect("a file");
        std::fs::remove_file(night.place("raw").join(file.trim_matches('"'))).expect("the file");
    }
    night
}

fn entry(trial: &str) -> String {
    format!("raw/{trial}.csv")
}

fn every() -> impl Iterator<Item = &'static str> {
    SYMMETRIC.into_iter().chain(SKEWED).chain([COAST])
}

/// Replaces the first occurrence of `old` in the configuration with `new`.
fn configure(night: &Small, old: &str, new: &str) {
    night.replace("pipeline.toml", old, new);
}

/// Replaces every occurrence of `old` in the list of trials with `new`.
fn list(night: &Small, old: &str, new: &str) {
    let content = text(&night.read(LIST));
    assert!(content.contains(old), "{content}");
    night.write(LIST, content.replace(old, new));
}

/// Changes the lines of a marker file by `change`, which receives the index and the text of each line.
fn record(night: &Small, trial: &str, change: impl Fn(usize, &str) -> String) {
    let content = text(&night.read(&entry(trial)));
    let lines = content.lines().enumerate().map(|(i, line)| change(i, line) + "\n");
    night.write(&entry(trial), lines.collect::<String>());
}

/// Changes the rows of a marker file, which are passed without their frame numbers; the new rows are numbered
/// consecutively.
fn rows(night: &Small, trial: &str, change: fn(Vec<&str>) -> Vec<&str>) {
    let content = text(&night.read(&entry(trial)));
    let is_row =
        |line: &&str| line.split(',').next().is_some_and(|cell| cell.parse::<u64>().is_ok());
    let (rows, header): (Vec<&str>, Vec<&str>) =
        content.lines().partition(|line| is_row(line) && line.contains(",0,"));
    let rows = rows.iter().filter_map(|row| Some(row.split_once(',')?.1)).collect();
    let numbered =
        change(rows).into_iter().enumerate().map(|(i, row)| format!("{},{row}\n", i + 1));
    let header: String = header.iter().map(|line| format!("{line}\n")).collect();
    night.write(&entry(trial), header + &numbered.collect::<String>());
}

/// Smooths every coordinate in a marker file twice with a nine-frame moving average; gaps are retained.
fn smooth(night: &Small, trial: &str) {
    const REACH: usize = 4;
    let content = text(&night.read(&entry(trial)));
    let is_row = |line: &&str| line.contains(",0,") && !line.starts_with("Frame");
    let (rows, header): (Vec<&str>, Vec<&str>) = content.lines().partition(is_row);
    let mut cells: Vec<Vec<String>> =
        rows.iter().map(|row| row.split(',').map(str::to_owned).collect()).collect();
    for column in 2..cells[0].len() {
        let seen = |row: &Vec<String>| row.get(column).and_then(|cell| cell.parse::<f64>().ok());
        let seen: Vec<Option<f64>> = cells.iter().map(seen).collect();
        let known: Vec<usize> = (0..seen.len()).filter(|&i| seen[i].is_some()).collect();
        let at = |i: usize| {
            let next = known.partition_point(|&other| other < i).min(known.len() - 1);
            let (a, b) = (known[next.saturating_sub(1)], known[next]);
            let part = if b > a { (i as f64 - a as f64) / (b - a) as f64 } else { 0.0 };
            let [from, to] = [a, b].map(|i| seen[i].expect("is known"));
            if i >= b { to } else { from + part.max(0.0) * (to - from) }
        };
        let mut series: Vec<f64> = (0..seen.len()).map(at).collect();
        for _ in 0..2 {
            let averaged = (0..series.len()).map(|i| {
                let reach = REACH.min(i).min(series.len() - 1 - i);
                series[i - reach..=i + reach].iter().sum::<f64>() / (2 * reach + 1) as f64
            });
            series = averaged.collect();
        }
        for i in known {
            cells[i][column] = format!("{:.3}", series[i]);
        }
    }
    let rows = cells.iter().map(|row| row.join(",") + "\n");
    let header = header.iter().map(|line| format!("{line}\n"));
    night.write(&entry(trial), header.chain(rows).collect::<String>());
}

/// Changes all marker positions in the marker file of a trial by `change`.
fn positions(night: &Small, trial: &str, change: fn([f64; 3]) -> [f64; 3]) {
    record(night, trial, |_, line| {
        let cells: Vec<&str> = line.split(',').collect();
        if cells[0].parse::<u64>().is_err() || cells.len() < 5 {
            return line.to_owned();
        }
        let mut changed: Vec<String> = cells[..2].iter().map(|&cell| cell.to_owned()).collect();
        for position in cells[2..].chunks(3) {
            let read: Vec<f64> = position.iter().filter_map(|cell| cell.parse().ok()).collect();
            match <[f64; 3]>::try_from(read) {
                Ok(read) => changed.extend(change(read).map(|x| format!("{x:.6}"))),
                Err(_) => changed.extend(position.iter().map(|&cell| cell.to_owned())),
            }
        }
        changed.join(",")
    });
}

/// Changes all marker positions in the tables `[markers.*]` of the configuration by `change`, which receives the index
/// of the link, the label and the position (mm) of each marker.
fn layout(night: &Small, change: impl Fn(usize, &str, [f64; 3]) -> [f64; 3]) {
    let content = text(&night.read("pipeline.toml"));
    let mut link = None;
    let lines = content.lines().map(|line| {
        if line.starts_with('[') {
            link =
                line.strip_prefix("[markers.link").map(|rest| rest[..1].parse().expect("a link"));
        }
        let Some((link, (label, place))) = link.zip(line.split_once(" = [")) else {
            return line.to_owned() + "\n";
        };
        let place = place.split(']').next().expect("numbers");
        let place: Vec<f64> =
            place.split(',').map(|x| x.trim().parse().expect("a number")).collect();
        let [x, y, z] = change(link, label, place.try_into().expect("three numbers"));
        format!("{label} = [{x:?}, {y:?}, {z:?}]\n")
    });
    let changed: String = lines.collect();
    night.write("pipeline.toml", changed);
}

/// Swaps the names of two tables in the configuration.
fn exchange(night: &Small, a: &str, b: &str) {
    configure(night, a, "[exchanged]");
    configure(night, b, a);
    configure(night, "[exchanged]", b);
}

const SKEWED_1: &str = "joint1 = { offset_deg = 45.0, amplitude_deg = 30.0, phase_deg = 0.0 }";
const SKEWED_2: &str = "joint2 = { offset_deg = -45.0, amplitude_deg = 30.0, phase_deg = -90.0 }";
const SYMMETRIC_1: &str = "joint1 = { offset_deg = 0.0, amplitude_deg = 30.0, phase_deg = 0.0 }";
const SYMMETRIC_2: &str = "joint2 = { offset_deg = 0.0, amplitude_deg = 30.0, phase_deg = -90.0 }";

/// Replaces `old` by `new` in the configuration's lines for both joints of a gait.
fn gait(night: &Small, lines: [&str; 2], old: &str, new: &str) {
    assert!(lines.iter().any(|line| line.contains(old)), "{old}");
    let both = lines.join("\n");
    configure(night, &both, &both.replace(old, new));
}

const MISTAKES: &[Mistake] = &[
    // Mistakes in the gait.
    mistake(
        "the sign of a phase",
        |night| gait(night, [SYMMETRIC_1, SYMMETRIC_2], "phase_deg = -90.0", "phase_deg = 90.0"),
        &[
            "joint 2: measured phase -9",
            "configured 90",
            "is the sign of the phase wrong?",
            "phase_deg = -90",
        ],
    ),
    mistake(
        "the sign of a phase of bent links",
        |night| gait(night, [SKEWED_1, SKEWED_2], "phase_deg = -90.0", "phase_deg = 90.0"),
        &[
            "campaign kinematic-skewed: 3 of 3 trials",
            "joint 2: measured phase -",
            "phase_deg = -90",
        ],
    ),
    mistake(
        "joints swapped",
        |night| {
            gait(night, [SKEWED_1, SKEWED_2], "joint1", "joint3");
            configure(night, SKEWED_2, &SKEWED_2.replace("joint2", "joint1"));
            configure(night, "joint3", "joint2");
        },
        &["joints 1 and 2 are swapped", "swap joint1 and joint2"],
    ),
    mistake(
        "the sign of an offset",
        |night| gait(night, [SKEWED_1, SKEWED_2], "offset_deg = -45.0", "offset_deg = 45.0"),
        &[
            "joint 2: measured offset -4",
            "configured 45",
            "is the sign of the offset wrong?",
            "offset_deg = -45",
        ],
    ),
    mistake(
        "a joint that turns the other way",
        |night| {
            gait(night, [SKEWED_1, SKEWED_2], "offset_deg = -45.0", "offset_deg = 45.0");
            configure(
                night,
                "offset_deg = 45.0, amplitude_deg = 30.0, phase_deg = -90.0",
                "offset_deg = 45.0, amplitude_deg = 30.0, phase_deg = 90.0",
            );
        },
        &["joint 2: measured offset -4", "does the joint turn in the opposite direction?"],
    ),
    mistake(
        "an amplitude in radians",
        |night| gait(night, [SKEWED_1, SKEWED_2], "amplitude_deg = 30.0", "amplitude_deg = 0.5236"),
        &[
            "measured amplitude +3",
            "configured 0.5236",
            "is the amplitude in radians?",
            "amplitude_deg = 30",
        ],
    ),
    mistake(
        "a phase in radians",
        |night| gait(night, [SYMMETRIC_1, SYMMETRIC_2], "-90.0", "-1.5708"),
        &["joint 2: measured phase -9", "configured -1.5708", "is the phase in radians?"],
    ),
    mistake(
        "a gait in radians",
        |night| {
            gait(night, [SKEWED_1, SKEWED_2], "45.0", "0.7854");
            let lines = [SKEWED_1.replace("45.0", "0.7854"), SKEWED_2.replace("45.0", "0.7854")];
            let lines = [lines[0].as_str(), lines[1].as_str()];
            gait(night, lines, "30.0", "0.5236");
            configure(night, "0.5236, phase_deg = -90.0", "0.5236, phase_deg = -1.5708");
        },
        &[
            "are all angles in radians?",
            "configured 0.7854",
            "offset_deg = 45",
            "amplitude_deg = 30",
        ],
    ),
    mistake(
        "an amplitude from peak to peak",
        |night| {
            gait(night, [SYMMETRIC_1, SYMMETRIC_2], "amplitude_deg = 30.0", "amplitude_deg = 60.0")
        },
        &[
            "measured amplitude +",
            "configured 60",
            "is the amplitude a peak-to-peak value?",
            "amplitude_deg = 30",
        ],
    ),
    mistake(
        "an amplitude of another gait",
        |night| {
            gait(night, [SYMMETRIC_1, SYMMETRIC_2], "amplitude_deg = 30.0", "amplitude_deg = 18.0")
        },
        &["campaign kinematic-symmetric: 3 of 3", "joint 1: measured offset", "amplitude 18.0"],
    ),
    mistake(
        "an amplitude below zero",
        |night| {
            gait(night, [SYMMETRIC_1, SYMMETRIC_2], "amplitude_deg = 30.0", "amplitude_deg = -30.0")
        },
        &[
            "gait.symmetric.joint1.amplitude_deg",
            "found -30.0, needed 0.1 to 179 degrees (is the amplitude 30, with the phase shifted by 180 degrees?)",
        ],
    ),
    mistake(
        "a gait without a first harmonic",
        |night| {
            gait(
                night,
                [SYMMETRIC_1, SYMMETRIC_2],
                "amplitude_deg = 30.0",
                "amplitude_deg = 0.0, amplitude2_deg = 30.0",
            )
        },
        &[
            "gait.symmetric.joint1.amplitude_deg",
            "needed 0.1 to 179 degrees, because the first harmonic determines the phase of the cycle",
        ],
    ),
    // Mistakes in the list.
    mistake(
        "frequencies in Hz",
        |night| {
            list(night, "omega_rad_s = 4.0", "omega_rad_s = 0.6366");
            list(night, "omega_rad_s = 5.0", "omega_rad_s = 0.7958");
            list(night, "omega_rad_s = 6.0", "omega_rad_s = 0.9549");
        },
        &["commanded 0.6366 rad/s", "is omega_rad_s in Hz?", "set omega_rad_s = 4.0", "3 of 3"],
    ),
    mistake(
        "frequencies in revolutions per minute",
        |night| {
            list(night, "omega_rad_s = 4.0", "omega_rad_s = 38.2");
            list(night, "omega_rad_s = 5.0", "omega_rad_s = 47.7");
            list(night, "omega_rad_s = 6.0", "omega_rad_s = 57.3");
        },
        &["commanded 38.2 rad/s", "in revolutions per minute?", "set omega_rad_s = 4.0"],
    ),
    mistake(
        "a slow frequency in Hz",
        |night| list(night, "omega_rad_s = 4.0", "omega_rad_s = 0.006"),
        &[
            "found 0.006, needed a frequency from 0.01 to 1000 rad/s (if the value is in Hz, write 0.0377",
        ],
    ),
    mistake(
        "a frequency in degrees per second",
        |night| list(night, "omega_rad_s = 4.0", "omega_rad_s = 2291.83"),
        &["found 2291.83", "(if the value is in degrees per second, write 40.0000)"],
    ),
    mistake(
        "the rate in kHz",
        |night| configure(night, "rate_hz = 120.0", "rate_hz = 0.12"),
        &["vicon.rate_hz", "needed 1 to 10000 Hz (if the value is in kHz, write 120"],
    ),
    mistake(
        "a gap in milliseconds",
        |night| configure(night, "max_gap_s = 0.1", "max_gap_s = 100"),
        &["ingest.max_gap_s", "needed 0 to 60 seconds (if the value is in milliseconds, write 0.1"],
    ),
    mistake(
        "the frequency of one trial",
        |night| list(night, "omega_rad_s = 4.0", "omega_rad_s = 4.7"),
        &["measured 4.0", "commanded 4.7 rad/s", "otherwise set omega_rad_s = 4.0"],
    ),
    mistake(
        "the rate",
        |night| {
            for trial in every() {
                record(night, trial, |i, line| if i == 1 { "60".into() } else { line.into() });
            }
            configure(night, "rate_hz = 120.0", "rate_hz = 60.0");
        },
        &["factor 0.500", "the frame rate is wrong: set vicon.rate_hz = 12", "3 of 3 trials"],
    ),
    mistake(
        "the rate in the configuration alone",
        |night| configure(night, "rate_hz = 120.0", "rate_hz = 100.0"),
        &["the file's frame rate is 120 Hz, but vicon.rate_hz is 100", "3 of 3 trials"],
    ),
    mistake(
        "another campaign's trials",
        |night| {
            list(night, "campaign = \"kinematic-symmetric\"", "campaign = \"kinematic-skewed\"")
        },
        &["follow the command of campaign `kinematic-symmetric`, not of `kinematic-skewed`"],
    ),
    mistake(
        "trials of a commanded joint in a campaign in which it is passive",
        |night| {
            let new = "campaign = \"semi-passive-symmetric\"";
            list(night, "campaign = \"kinematic-symmetric\"", new);
        },
        &[
            "follow the command of campaign `kinematic-symmetric`, not of `semi-passive-symmetric`",
            "3 of 3",
        ],
    ),
    mistake(
        "the same file twice",
        |night| {
            list(
                night,
                "file = \"kinematic-skewed-5.00-r1.csv\"",
                "file = \"kinematic-skewed-4.00-r1.csv\"",
            )
        },
        &["`kinematic-skewed-4.00-r1` has the same marker file"],
    ),
    mistake(
        "a copy of another trial's file",
        |night| night.write(&entry(SYMMETRIC[1]), night.read(&entry(SYMMETRIC[0]))),
        &["`kinematic-symmetric-4.00-r1` has the same marker file"],
    ),
    mistake(
        "a file that the list lacks",
        |night| night.write("raw/forgotten.csv", night.read(&entry(SYMMETRIC[0]))),
        &["folder raw: 1 marker file is not listed in trials.toml: `forgotten.csv`"],
    ),
    mistake(
        "[trial] for [[trial]]",
        |night| list(night, "[[trial]]", "[trial]"),
        &["trials.toml", "found `[trial]`", "needed `[[trial]]`"],
    ),
    mistake(
        "a campaign's name",
        |night| list(night, "campaign = \"kinematic-skewed\"", "campaign = \"kinematic-skew\""),
        &["found `kinematic-skew`", "did you mean `kinematic-skewed`?"],
    ),
    mistake(
        "a file's name",
        |night| list(night, "file = \"kinematic-skewed-4.00", "file = \"kinematic-skewed-4,00"),
        &[
            "no such file",
            "1 marker file is not listed in trials.toml: `kinematic-skewed-4.00-r1.csv`",
        ],
    ),
    mistake(
        "a coast-down among the trials of a gait",
        |night| {
            let old = "kind = \"coast-down\"\nrobot = \"kinematic\"";
            let new = "kind = \"gait\"\ncampaign = \"kinematic-symmetric\"\nomega_rad_s = 4.0";
            list(night, old, new);
        },
        &[
            "kinematic-coast-down-r1",
            "joints swing by at most 0.",
            "is `kind` correct in trials.toml",
        ],
    ),
    mistake(
        "a gait among the coast-downs",
        |night| {
            let old = "kind = \"gait\"\ncampaign = \"kinematic-skewed\"\nomega_rad_s = 4.0";
            list(night, old, "kind = \"coast-down\"\nrobot = \"kinematic\"");
        },
        &[
            "kinematic-skewed-4.00-r1",
            "the largest mean joint angle while the robot coasts is 5",
            "is `kind` correct in trials.toml",
        ],
    ),
    // Mistakes in the marker layout.
    mistake(
        "a mirrored layout",
        |night| layout(night, |_, _, [x, y, z]| [x, -y, z]),
        &["the markers of every link are mirrored", "reverse the sign of every y"],
    ),
    mistake(
        "one mirrored link",
        |night| layout(night, |link, _, [x, y, z]| if link == 1 { [x, -y, z] } else { [x, y, z] }),
        &["the markers of link 1 are mirrored", "markers.link1"],
    ),
    mistake(
        "tables of front and rear exchanged",
        |night| exchange(night, "[markers.link1]", "[markers.link2]"),
        &[
            "markers.link2 lists the markers of link 1",
            "rename each of these tables after the link whose markers it lists",
            "3 of 3",
        ],
    ),
    mistake(
        "tables of middle and front exchanged",
        |night| exchange(night, "[markers.link0]", "[markers.link1]"),
        &[
            "markers.link1 lists the markers of link 0",
            "rename each of these tables after the link whose markers it lists",
        ],
    ),
    mistake(
        "positions of front and rear exchanged",
        |night| {
            layout(night, |link, label, place| match (link, label) {
                (1, "F1") => [-50.0, 26.0, 55.0],
                (1, "F2") => [-30.0, -36.0, 55.0],
                (1, "F3") => [58.0, -10.0, 70.0],
                (2, "R1") => [45.0, 30.0, 55.0],
                (2, "R2") => [38.0, -34.0, 55.0],
                (2, "R3") => [-62.0, 8.0, 70.0],
                _ => place,
            });
        },
        &["the positions in markers.link1 and markers.link2 are swapped"],
    ),
    mistake(
        "a link's x to the rear",
        |night| layout(night, |link, _, [x, y, z]| if link == 2 { [-x, -y, z] } else { [x, y, z] }),
        &["link 2 points backwards", "reverse the signs of x and y in markers.link2"],
    ),
    mistake(
        "two labels exchanged",
        |night| {
            configure(night, "F1 = [", "F9 = [");
            configure(night, "F3 = [", "F1 = [");
            configure(night, "F9 = [", "F3 = [");
        },
        &[
            "labels of link 1 are swapped",
            "F3 is at the configured position of",
            "F1 is at the configured position of",
        ],
    ),
    mistake(
        "labels of two links exchanged",
        |night| {
            configure(night, "F1 = [", "F9 = [");
            configure(night, "R1 = [", "F1 = [");
            configure(night, "F9 = [", "R1 = [");
        },
        &["the labels `", "R1` of link 1 and `", "F1` of link 2 are swapped", "`aliases`"],
    ),
    mistake(
        "a digit of a place",
        |night| configure(night, "M2 = [95.0", "M2 = [59.0"),
        &[
            "M2` of link 0 is configured at x = 59, y = -40 mm",
            "measured at x = 9",
            "markers.link0",
        ],
    ),
    mistake(
        "a layout in metres",
        |night| layout(night, |_, _, place| place.map(|mm| 1e-3 * mm)),
        &[
            "key `markers.link0`",
            "needed two markers at least 5 mm apart in the plane, in millimetres (are the positions in metres?)",
        ],
    ),
    mistake(
        "a layout in centimetres",
        |night| layout(night, |_, _, place| place.map(|mm| 0.1 * mm)),
        &["as far apart as in [markers]", "the positions in [markers] are in centimetres"],
    ),
    mistake(
        "one table in centimetres",
        |night| layout(night, |link, _, mm| if link == 2 { mm.map(|mm| 0.1 * mm) } else { mm }),
        &["the markers of link 2 are", "as far apart as in markers.link2"],
    ),
    mistake(
        TURNED,
        |night| {
            layout(night, |link, _, [x, y, z]| {
                let (joint, turn) = [(0.0, 0.0), (-112.0, 5.0), (112.0, 5.0)][link];
                let (sin, cos) = f64::to_radians(turn).sin_cos();
                let x = x - joint;
                [joint + cos * x - sin * y, sin * x + cos * y, z]
            });
        },
        &[
            "campaign kinematic-symmetric: 3 of 3 trials: joint 1: measured offset",
            "the positions in markers.link0 or markers.link1 are rotated",
        ],
    ),
    mistake(
        "a label that the files do not have",
        |night| configure(night, "F1 = [", "front1 = ["),
        &[
            "the file has no marker `front1`, which markers.link1 of pipeline.toml requires",
            "3 of 3",
        ],
    ),
    mistake(
        "a label with a colon without quotes",
        |night| configure(night, "F1 = [", "Snake:F1 = ["),
        &["pipeline.toml, line ", "a key such as `\"Snake:M1\"` needs quotes"],
    ),
    // Mistakes in the robot.
    mistake(
        "h and l exchanged",
        |night| {
            configure(night, "l_m = 0.112", "l_m = 0.144");
            configure(night, "h_m = 0.144", "h_m = 0.112");
        },
        &["h_m and l_m are swapped", "set h_m = 0.144"],
    ),
    mistake(
        "a wrong length",
        |night| configure(night, "l_m = 0.112", "l_m = 0.132"),
        &["l_m of the robot: measured 11", "configured 132.0 mm", "set l_m = 0.11"],
    ),
    mistake(
        "a length 3 mm off",
        |night| configure(night, "l_m = 0.112", "l_m = 0.115"),
        // Both joints are equally far from their configured positions; noise decides which of them is named.
        &["115.0, y = 0.0 mm: set l_m = 0.112", "to every x in markers.link"],
    ),
    mistake(
        "a layout turned by two degrees",
        |night| {
            layout(night, |link, _, [x, y, z]| {
                let [x, y] = rotated(if link == 1 { 2_f64.to_radians() } else { 0.0 }, [x, y]);
                [x, y, z]
            });
        },
        &[
            "joint 1 is measured at x = -11",
            "in the frame of link 1, but configured at x = -112.0, y = 0.0 mm",
            "rotate the positions by -1.9",
        ],
    ),
    mistake(
        "a length in millimetres",
        |night| configure(night, "h_m = 0.144", "h_m = 144"),
        &[
            "robot.kinematic.h_m",
            "found 144.0, needed 0.001 to 100 metres (if the value is in millimetres, write 0.144",
        ],
    ),
    mistake(
        "a length in centimetres",
        |night| configure(night, "l_m = 0.112", "l_m = 11.2"),
        &["l_m of the robot: measured 11", "(is this value in centimetres?)", "set l_m = 0.112"],
    ),
    mistake(
        "masses in grams",
        |night| configure(night, "mass_kg = [1.04, 0.2, 0.2]", "mass_kg = [1040, 200, 200]"),
        &[
            "robot.kinematic.inertia_kg_m2",
            "found 0.0086 with a mass_kg of 1040 for link 0, that is, a radius of gyration of 0.0200 times h_m",
            "needed a radius of gyration of 0.05 to 3 times h_m (is mass_kg in grams?)",
        ],
    ),
    mistake(
        "masses and moments of inertia in grams",
        |night| {
            configure(night, "mass_kg = [1.04, 0.2, 0.2]", "mass_kg = [1040, 200, 200]");
            let grams = "inertia_kg_m2 = [8.6, 0.5, 0.5]";
            configure(night, "inertia_kg_m2 = [86e-4, 5e-4, 5e-4]", grams);
        },
        &[
            "kinematic-coast-down-r1.csv: W022 robot-parameters: sum c_R is measured",
            "times the configured one: probably mass_kg is in grams",
        ],
    ),
    mistake(
        "moments of inertia in kg cm^2",
        |night| {
            let centimetres = "inertia_kg_m2 = [86.0, 5.0, 5.0]";
            configure(night, "inertia_kg_m2 = [86e-4, 5e-4, 5e-4]", centimetres);
        },
        &["(if the value is in kg cm^2, write 0.0086", "robot.kinematic.inertia_kg_m2"],
    ),
    mistake(
        "a standard deviation in millimetres",
        |night| {
            let content = text(&night.read("pipeline.toml"));
            let deviation = "\n[robot.kinematic.standard_deviation]\nl_m = 0.5\n";
            night.write("pipeline.toml", content + deviation);
        },
        &[
            "robot.kinematic.standard_deviation.l_m",
            "found 4.4643 times l_m, needed a standard deviation that is not larger than the value of l_m, in the \
             same unit",
        ],
    ),
    // Mistakes in recordings.
    mistake(
        "a mirrored recording",
        |night| every().for_each(|trial| positions(night, trial, |[x, y, z]| [x, -y, z])),
        &["the markers of every link are mirrored", "the sign of one of its axes"],
    ),
    mistake(
        "metres that are called millimetres",
        |night| every().for_each(|trial| positions(night, trial, |mm| mm.map(|mm| 1e-3 * mm))),
        &["the file's positions are in metres, not in millimetres", "3 of 3"],
    ),
    mistake(
        "y up",
        |night| every().for_each(|trial| positions(night, trial, |[x, y, z]| [y, z, x])),
        &["the file's y axis points up instead of its z axis", "export with z up", "3 of 3"],
    ),
    mistake(
        "z down",
        |night| every().for_each(|trial| positions(night, trial, |[x, y, z]| [x, -y, -z])),
        &["z axis points down", "export with z up"],
    ),
    mistake(
        "rows that were deleted, and the others renumbered",
        |night| {
            for trial in SYMMETRIC {
                rows(night, trial, |mut rows| {
                    rows.drain(400..406);
                    rows
                });
            }
        },
        &[
            "3 of 3 trials: the robot jumps by ",
            "frames may be missing: were rows deleted and the others renumbered?",
        ],
    ),
    mistake(
        "a camera that was knocked",
        |night| {
            for trial in SYMMETRIC {
                record(night, trial, |i, line| {
                    let moved = |(k, cell): (usize, &str)| match cell.parse::<f64>() {
                        Ok(x_mm) if i > 400 && k % 3 == 2 => format!("{:.3}", x_mm + 5.0),
                        _ => cell.to_owned(),
                    };
                    line.split(',').enumerate().map(moved).collect::<Vec<_>>().join(",")
                });
            }
        },
        &[
            "3 of 3 trials: the robot jumps by ",
            "was the robot or a camera knocked? Cycles with a jump are not used",
        ],
    ),
    mistake(
        "a recording of half the rate, resampled to the whole",
        |night| {
            for trial in SYMMETRIC {
                rows(night, trial, |rows| (0..rows.len()).map(|i| rows[i - i % 2]).collect());
            }
        },
        &["3 of 3 trials: 50.0 % of the rows repeat the preceding row to the last digit"],
    ),
    mistake(
        "coordinates that were smoothed before the export",
        |night| SYMMETRIC.into_iter().for_each(|trial| smooth(night, trial)),
        &["3 of 3 trials: the markers' noise over a tenth of a second is ", "export unfiltered"],
    ),
    mistake(
        "an export that is cut off",
        |night| {
            let content = night.read(&entry(SYMMETRIC[1]));
            night.write(&entry(SYMMETRIC[1]), &content[..content.len() / 2 - 7]);
        },
        &["kinematic-symmetric-5.00-r1.csv, line ", "is the copy of the file complete?"],
    ),
    mistake(
        "a row with a cell too many",
        |night| {
            for trial in SYMMETRIC {
                record(night, trial, |i, line| match i {
                    100 => line.replacen(",0,", ",0,0.5,", 1),
                    _ => line.to_owned(),
                });
            }
        },
        &["3 of 3 trials: 1 row has more cells than the header has columns"],
    ),
    mistake(
        "a file of another robot",
        |night| {
            for trial in SYMMETRIC {
                record(night, trial, |i, line| match i {
                    2 => line.replace(":F", ":front").replace(":R", ":rear"),
                    _ => line.to_owned(),
                });
            }
        },
        &["6 of the 10 markers of pipeline.toml's [markers] are not in the file", "3 of 3 trials"],
    ),
    mistake(
        "an export of devices",
        |night| night.write(&entry(SYMMETRIC[1]), "Devices\n1000\nFrame,Sub Frame,Fx\n1,0,2\n"),
        &["found only the section `Devices`, needed a `Trajectories` section"],
    ),
    mistake(
        "a recording that begins too late",
        |night| {
            record(night, SYMMETRIC[2], |i, line| if i > 150 { String::new() } else { line.into() })
        },
        &["kinematic-symmetric-6.00-r1", "periods of motion, but at least 2 are needed"],
    ),
];

/// Lists how the outcome of the program with a mistake differs from the expected outcome.
fn shortcomings(sound: &Small, Mistake { name, make, words }: &Mistake) -> Vec<String> {
    let night = sound.copy();
    make(&night);
    let said = |command: &str| {
        let output = trilink(night.path(), &[command, "--threads", "1"]);
        (output.status.code(), text(&output.stdout) + &text(&output.stderr))
    };
    let mut wrong = Vec::new();
    let mut must = |holds: bool, what: &str, said: &str| {
        if !holds {
            wrong.push(format!("{name}: {what} in\n{said}"));
        }
    };
    let (status, ingest) = said("ingest");
    must(matches!(status, Some(1 | 2)), &format!("{status:?}"), &ingest);
    for word in words.iter().filter(|word| !ingest.contains(**word)) {
        must(false, &format!("not said {word:?}"), &ingest);
    }
    // Trials that fail `check` fail `run`, too.
    if status == Some(2) {
        must(said("run") == (status, ingest), "`run` says something else", "");
        return wrong;
    }
    let named = ingest.lines().filter(|line| line.starts_with("campaign "));
    let named: Vec<&str> = named.collect();
    // None of these trials has results.
    let trials = Table::read(&night.place("derived/trials.parquet")).unwrap();
    let trials = TrialRow::from_table(&trials).unwrap();
    let is_lost = |campaign: &&str| {
        let mut own = trials.iter().filter(|row| row.campaign == campaign.trim_end_matches(": "));
        own.all(|row| row.status == TrialStatus::Failed)
    };
    let lost = ["kinematic-skewed: ", "kinematic-symmetric: "].into_iter().filter(is_lost);
    let lost: Vec<&str> = lost.collect();
    let page = ON_THE_PAGE.contains(name);
    for command in ["fit", "run"].into_iter().take(if page { 2 } else { 1 }) {
        let (status, fitted) = said(command);
        must(status == Some(1), &format!("`{command}` {status:?}"), &fitted);
        for line in &named {
            must(fitted.contains(line), &format!("`{command}` lacks {line:?}"), &fitted);
        }
        for campaign in &lost {
            let mut sentences = fitted.lines().filter_map(|line| line.strip_prefix(campaign));
            let has_none = sentences.all(|sentence| sentence == "no fit");
            must(has_none, &format!("`{command}` has a fit of {campaign}"), &fitted);
        }
    }
    if page {
        let html = text(&night.read("reports/index.html"));
        let parts = html.split('<').filter_map(|part| Some(part.split_once('>')?.1));
        let page = parts.collect::<String>().replace("&#x2f;", "/").replace("&#x27;", "'");
        for (word, least) in words.iter().map(|word| (*word, 1)).chain([(NO_FIT, lost.len())]) {
            let found = page.matches(word).count();
            must(found >= least, &format!("{found} times {word:?} on the page"), &page);
        }
    }
    wrong
}

fn assert_all_are_named(sound: &Small, mistakes: &[Mistake]) {
    let wrong = mistakes.par_iter().with_max_len(1).flat_map(|of| shortcomings(sound, of));
    let wrong: Vec<String> = wrong.collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

#[test]
fn every_mistake_is_named_by_its_cause_and_none_ends_well() {
    let night = night();
    let output = trilink(night.path(), &["-q", "ingest"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let fitted = crate::common::succeed(night.path(), &["fit"]);
    assert!(fitted.starts_with("kinematic-skewed: skid-roll fits\n"), "{fitted}");
    assert_all_are_named(&night, MISTAKES);
}

#[test]
fn mistakes_about_a_passive_joint_are_named() {
    let night = all_campaigns();
    crate::common::succeed(night.path(), &["-q", "ingest"]);
    fn put(night: &Small, from: &str, to: &str) {
        let of = |campaign: &str| format!("campaign = \"{campaign}\"\nomega_rad_s = 5.0");
        list(night, &of(from), &of(to));
    }
    let mistakes = [
        mistake(
            "a commanded joint among passive ones",
            |night| put(night, "kinematic-symmetric", "semi-passive-symmetric"),
            &[
                "kinematic-symmetric-5.00-r1: ",
                "follow the command of campaign `kinematic-symmetric`, not of `semi-passive-symmetric`",
            ],
        ),
        mistake(
            "a passive joint among commanded ones",
            |night| put(night, "semi-passive-symmetric", "kinematic-symmetric"),
            &[
                "semi-passive-symmetric-5.00-r1: ",
                "follow the command of campaign `semi-passive-symmetric`, not of `kinematic-symmetric`",
            ],
        ),
        mistake(
            "a spring and a damper in N mm",
            |night| {
                configure(night, "stiffness_nm_rad = 0.137", "stiffness_nm_rad = 137.0");
                configure(night, "damping_nm_s_rad = 0.006", "damping_nm_s_rad = 6.0");
            },
            &[
                "semi-passive-joint-release-r1",
                "0.001",
                ": probably the configured value is in N mm",
            ],
        ),
        mistake(
            "a spring and a damper per degree",
            |night| {
                configure(night, "stiffness_nm_rad = 0.137", "stiffness_nm_rad = 2.39e-3");
                configure(night, "damping_nm_s_rad = 0.006", "damping_nm_s_rad = 1.05e-4");
            },
            &["semi-passive-joint-release-r1", ": probably the configured value is per degree"],
        ),
    ];
    assert_all_are_named(&night, &mistakes);
}
