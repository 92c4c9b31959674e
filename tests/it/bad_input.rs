//! Tests with bad input: the program reports the cause, processes the rest, does not panic, and leaves no partial
//! files.

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

use tempfile::TempDir;
use trilink_tables::{Columns as _, FitRow, Provenance, Reader, Table};

use crate::common::temporary;

const BAD: &str = "kinematic-symmetric-3.50-r1";
const GOOD: &str = "kinematic-symmetric-3.90-r1";
const BAD_FILE: &str = "raw/x/kinematic-symmetric-3.50-r1.csv";
const TRIALS: &str = "raw/x/trials.toml";
const CONFIG: &str = r#"[paths]
raw = "raw/x"
[fit]
starts = 1
[campaign.kinematic-symmetric]
robot = "kinematic"
gait = "symmetric"
models = ["no-skid", "skid-roll"]
weights = { d = 10.0, v = 1.0, sigma = 0.2, alpha = 0.0 }
"#;

/// Folder with two valid trials that tests damage.
struct Folder(TempDir);

/// Outcome of a command.
struct Ended {
    status: Option<i32>,
    errors: String,
}

impl Folder {
    fn new() -> Self {
        static SOUND: OnceLock<Folder> = OnceLock::new();
        let sound = SOUND.get_or_init(|| {
            let folder = Self(temporary());
            folder.write("pipeline.toml", CONFIG.as_bytes());
            let ended = folder.trilink(&["synth", "raw/x", "--omega", "3.5,3.9", "--seed", "1"]);
            assert_eq!(ended.status, Some(0), "{}", ended.errors);
            // The coast-down is not one of the two trials.
            let list = fs::read_to_string(folder.path(TRIALS)).unwrap();
            let third = list.match_indices("[[trial]]").nth(2).unwrap().0;
            folder.write(TRIALS, &list.as_bytes()[..third]);
            fs::remove_file(folder.path("raw/x/kinematic-coast-down-r1.csv")).unwrap();
            folder
        });
        let folder = Self(temporary());
        fs::create_dir_all(folder.path("raw/x")).unwrap();
        fs::copy(sound.path("pipeline.toml"), folder.path("pipeline.toml")).unwrap();
        for entry in fs::read_dir(sound.path("raw/x")).unwrap() {
            let entry = entry.unwrap();
            fs::copy(entry.path(), folder.path("raw/x").join(entry.file_name())).unwrap();
        }
        folder
    }

    fn path(&self, name: &str) -> std::path::PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        fs::write(self.path(name), bytes).unwrap();
    }

    fn replace(&self, name: &str, old: &str, new: &str) {
        let text = fs::read_to_string(self.path(name)).unwrap();
        assert!(text.contains(old), "{name} has no {old:?}");
        self.write(name, text.replacen(old, new, 1).as_bytes());
    }

    /// Runs the program in the folder, and asserts that it neither panics nor leaves a partial file.
    fn trilink(&self, arguments: &[&str]) -> Ended {
        let output = Command::new(env!("CARGO_BIN_EXE_trilink"))
            .args(["-q", "-c", "pipeline.toml"])
            .args(arguments)
            .current_dir(self.0.path())
            .output()
            .unwrap();
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!errors.contains("panicked"), "{errors}");
        assert_nothing_half_written(self.0.path());
        Ended { status: output.status.code(), errors }
    }

    /// Asserts that the damaged trial failed with a message that contains all strings in `named`, and that the tables
    /// of the sound trial exist.
    fn assert_other_trial_done(&self, named: &[&str]) {
        let trials = Table::read(&self.path("derived/trials.parquet")).unwrap();
        assert_eq!(trials.values::<String>("trial").unwrap(), [BAD, GOOD]);
        assert_eq!(trials.values::<String>("status").unwrap()[0], "failed");
        assert!(
            ["ok", "flagged"].contains(&trials.values::<String>("status").unwrap()[1].as_str())
        );
        assert_names(&trials.values::<String>("message").unwrap()[0], named);
        for kind in ["poses", "wheels", "cycles"] {
            assert!(self.path(&format!("derived/{kind}/{GOOD}.parquet")).is_file());
            assert!(!self.path(&format!("derived/{kind}/{BAD}.parquet")).exists());
        }
    }
}

fn assert_nothing_half_written(folder: &Path) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        assert!(!name.starts_with(".writing-"), "{name} was left");
        if path.is_dir() {
            assert_nothing_half_written(&path);
        }
    }
}

fn assert_names(message: &str, named: &[&str]) {
    for name in named {
        assert!(message.contains(name), "{message:?} does not name {name:?}");
    }
}

/// Asserts that, after `damage` to one of two trials, `ingest` exits with status 1, prints all strings in `named`, and
/// processes the other trial.
fn assert_one_fails(damage: impl FnOnce(&Folder), named: &[&str]) {
    let folder = Folder::new();
    damage(&folder);
    let ended = folder.trilink(&["ingest"]);
    assert_eq!(ended.status, Some(1), "{named:?}: {}", ended.errors);
    assert_names(&ended.errors, named);
    assert_names(&ended.errors, &[BAD]);
    folder.assert_other_trial_done(named);
}

/// Asserts that, after `damage` to the folder, a command exits with status 2 and prints all strings in `named`.
fn assert_nothing_done(damage: impl FnOnce(&Folder), command: &str, named: &[&str]) {
    let folder = Folder::new();
    damage(&folder);
    let ended = folder.trilink(&[command]);
    assert_eq!(ended.status, Some(2), "{named:?}: {}", ended.errors);
    assert_names(&ended.errors, named);
}

#[test]
fn a_marker_file_that_cannot_be_used_is_named_and_the_other_trial_is_done() {
    let contents: [(&[u8], &[&str]); 5] = [
        (b"", &["3.50-r1.csv", "found an empty file", "needed a `Trajectories` section"]),
        (b"\0\x01\xff\xfe\0\0garbage", &["3.50-r1.csv", "needed a `Trajectories` section"]),
        (b"\x1f\x8bgarbage", &["3.50-r1.csv", "cannot be unpacked"]),
        (
            b"Format Version,1.23,Take Name,a\n\n",
            &["OptiTrack Motive", "enable it in the export settings"],
        ),
        (b"Trajectories\r\n", &["3.50-r1.csv, line 1", "needed a row that starts with `Frame"]),
    ];
    for (bytes, named) in contents {
        assert_one_fails(|folder| folder.write(BAD_FILE, bytes), named);
    }
    let gone = |folder: &Folder| fs::remove_file(folder.path(BAD_FILE)).unwrap();
    assert_one_fails(gone, &["3.50-r1.csv", "no such file"]);
    let a_folder = |folder: &Folder| {
        gone(folder);
        fs::create_dir(folder.path(BAD_FILE)).unwrap();
    };
    assert_one_fails(a_folder, &["3.50-r1.csv", "cannot be read"]);
}

#[test]
fn what_is_wrong_inside_a_marker_file_is_named_with_line_and_label() {
    let cases: [(&str, &str, &[&str]); 5] = [
        ("-276.639", "oops", &["line 7, column 3 (Snake:M1 X)", "`oops`", "a number (in mm)"]),
        ("-276.639", "nan", &["line 7, column 3 (Snake:M1 X)", "`nan`", "a number (in mm)"]),
        ("\n120\r", "\n100\r", &["100 Hz", "120 Hz", "vicon.rate_hz", "rate_from_file"]),
        ("Snake:F2", "Snake:F9", &["no marker `F2`", "markers.link1", "Snake:F9"]),
        ("Snake:M4", "Other:M1", &["`Snake:M1`, `Other:M1`", "`Subject:Marker`"]),
    ];
    for (old, new, named) in cases {
        assert_one_fails(|folder| folder.replace(BAD_FILE, old, new), named);
    }
}

#[test]
fn a_damaged_c3d_file_is_named_and_the_other_trial_is_done() {
    let whole = fs::read("tests/fixtures/nexus.c3d").unwrap();
    let cases: [(&[u8], &[&str]); 4] = [
        (b"", &["a.c3d", "found no C3D header"]),
        (&whole[..600], &["a.c3d", "a truncated or damaged parameter section"]),
        (&whole[..1100], &["a.c3d", "found 1 of 2 frames", "is the copy of the file complete?"]),
        (
            &whole,
            &[
                "a.c3d",
                "8 of the 10 markers of pipeline.toml's [markers] are not in the file",
                "`Snake:M1`",
            ],
        ),
    ];
    for (bytes, named) in cases {
        let damage = |folder: &Folder| {
            folder.write("raw/x/a.c3d", bytes);
            folder.replace(TRIALS, &format!("{BAD}.csv"), "a.c3d");
        };
        assert_one_fails(damage, named);
    }
}

#[test]
fn a_c3d_file_that_contradicts_itself_is_flagged_or_refused_with_all_numbers() {
    let folder = Folder::new();
    let synth = ["synth", "raw/y", "--omega", "3.5", "--seed", "1", "--format", "c3d"];
    assert_eq!(folder.trilink(&synth).status, Some(0));
    let sound = fs::read(folder.path(&format!("raw/y/{BAD}.c3d"))).unwrap();
    fs::remove_file(folder.path(BAD_FILE)).unwrap();
    folder.replace(TRIALS, &format!("{BAD}.csv"), "a.c3d");
    let of = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut file = sound.clone();
        change(&mut file);
        folder.write("raw/x/a.c3d", &file);
        let ended = folder.trilink(&["ingest"]);
        let checks = Table::read(&folder.path("derived/checks.parquet")).unwrap();
        let column = |name: &str| checks.values::<String>(name).unwrap();
        let rows = column("trial").into_iter().zip(column("check")).zip(column("message"));
        let own = rows.filter(|((trial, check), _)| trial == BAD && check.starts_with("W027"));
        (ended, own.map(|(_, message)| message).collect::<Vec<_>>())
    };
    // Values that replace the name or the number of parameters.
    let edited = |name: &'static [u8], at: usize, bytes: &'static [u8]| {
        move |file: &mut Vec<u8>| {
            let found = file.windows(name.len()).position(|window| window == name).unwrap();
            file[found + at..found + at + bytes.len()].copy_from_slice(bytes);
        }
    };
    let distance = || {
        let trials = Table::read(&folder.path("derived/trials.parquet")).unwrap();
        trials.values::<f64>("d_m").unwrap()[0]
    };
    let (ended, told) = of(&|_| {});
    assert_eq!((ended.status, told.len()), (Some(0), 0), "{}", ended.errors);
    let right = distance();

    type Change<'c> = &'c dyn Fn(&mut Vec<u8>);
    let flagged: [(Change, &[&str]); 3] = [
        (&|file| file[2] = 9, &["10 (POINT:USED) and 9 (header word 2), used 10"]),
        (&|file| file[4] = 7, &["0 (ANALOG:USED x", "7 (header word 3), used 0"]),
        (
            &edited(b"\x05\x01UNITS", 6, b"X"),
            &["unit: found none (POINT:UNITS), used mm (vicon.unit)"],
        ),
    ];
    for (change, named) in flagged {
        let (ended, told) = of(change);
        assert_eq!((ended.status, told.len()), (Some(0), 1), "{named:?}: {}", ended.errors);
        assert_names(&told[0], named);
        assert_eq!(distance(), right, "{named:?}");
    }
    let (ended, _) = of(&|file| file[20..24].copy_from_slice(&100.0_f32.to_le_bytes()));
    assert_eq!(ended.status, Some(1));
    let named = "contradictory frame rates, Hz: 120 (POINT:RATE) and 100 (header words 11 and 12)";
    assert_names(&ended.errors, &[named]);
    // Two contradictory scales that say integers, in a file of floating-point numbers.
    let (ended, _) = of(&|file| {
        file[12..16].copy_from_slice(&0.05_f32.to_le_bytes());
        edited(b"\x05\x01SCALE", 11, &[0x0a, 0xd7, 0xa3, 0x3c])(file);
    });
    assert_eq!(ended.status, Some(1));
    assert_names(&ended.errors, &[BAD, "integers) and 198640 bytes of data after them"]);

    folder.replace("pipeline.toml", "[fit]", "[vicon]\nunit = \"cm\"\n[fit]");
    let (ended, _) = of(&edited(b"\x05\x01UNITS", 6, b"X"));
    assert_eq!(ended.status, Some(1));
    assert_names(&ended.errors, &[BAD, "times as far apart as in [markers]"]);
}

#[test]
fn a_file_that_a_spreadsheet_took_the_decimal_points_of_is_refused_by_its_cause() {
    let lose = |folder: &Folder| {
        let text = fs::read_to_string(folder.path(BAD_FILE)).unwrap();
        // Simulates a spreadsheet that takes -276.716 for an integer with a thousands separator, but not 603.46.
        let cell = |cell: &str| match cell.split_once('.') {
            Some((whole, part)) if part.len() == 3 && whole.len() <= 4 => format!("{whole}{part}"),
            _ => cell.to_owned(),
        };
        let line = |line: &str| line.split(',').map(cell).collect::<Vec<_>>().join(";");
        let text: Vec<String> = text.lines().map(line).collect();
        folder.write(BAD_FILE, text.join("\r\n").as_bytes());
    };
    let named =
        ["3.50-r1.csv", "numbers that lost their decimal point: Snake:M1 X is", "export the"];
    assert_one_fails(lose, &named);
}

#[test]
fn a_robot_that_never_moves_is_said_not_to_swing() {
    let freeze = |folder: &Folder| {
        let text = fs::read_to_string(folder.path(BAD_FILE)).unwrap();
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        let pose = lines[5].split_once(',').unwrap().1.to_owned();
        for line in lines.iter_mut().skip(5) {
            *line = format!("{},{pose}", line.split(',').next().unwrap());
        }
        folder.write(BAD_FILE, (lines.join("\r\n") + "\r\n").as_bytes());
    };
    assert_one_fails(
        freeze,
        &["3.50-r1.csv", "the joints swing by at most 0.", "is `kind` correct in trials.toml"],
    );
}

#[test]
fn a_wrong_value_of_one_trial_is_named_with_its_key_and_fails_only_that_trial() {
    let file = format!("file = \"{BAD}.csv\"");
    let campaign = "campaign = \"kinematic-symmetric\"";
    let window = "omega_rad_s = 3.5\nsmoothing_window = 3";
    let cases: [(&str, &str, &[&str]); 8] = [
        (campaign, "campaign = \"kinematic-symetric\"", &["`campaign`", "`kinematic-symmetric`?"]),
        (&file, "file = \"../x.csv\"", &["`file`", "../x.csv", "inside the trial folder"]),
        ("omega_rad_s = 3.5", "omega_rad_s = 0", &["`omega_rad_s`", "found 0", "0.01 to 1000"]),
        ("omega_rad_s = 3.5", "omega_rad_s = nan", &["`omega_rad_s`", "found NaN"]),
        ("omega_rad_s = 3.5", "", &["`omega_rad_s`", "found nothing", "0.01 to 1000"]),
        ("omega_rad_s = 3.5", "omega_rad_s = 1e300", &["`omega_rad_s`", "0.01 to 1000"]),
        ("omega_rad_s = 3.5", "omega_rad_s = 900.0", &["3.50-r1.csv", "is omega_rad_s correct?"]),
        ("omega_rad_s = 3.5", window, &["`smoothing_window`", "found 3", "5 to 30"]),
    ];
    for (old, new, named) in cases {
        assert_one_fails(|folder| folder.replace(TRIALS, old, new), named);
    }
}

#[test]
fn a_list_of_trials_that_makes_no_sense_ends_everything() {
    let cases: [(&str, &str, &[&str]); 4] = [
        (GOOD, BAD, &["trials.toml", "trial[1].id", BAD, "no other trial"]),
        ("id = \"kin", "id = \"a/b", &["trials.toml", "trial[0].id", "a/b", "needed 1 to 64"]),
        ("omega_rad_s", "omega_rads", &["trials.toml, line 8", "`omega_rads`", "`omega_rad_s`?"]),
        ("\"gait\"", "\"giat\"", &["trials.toml, line 6", "`giat`", "did you mean `gait`?"]),
    ];
    for (old, new, named) in cases {
        assert_nothing_done(|folder| folder.replace(TRIALS, old, new), "ingest", named);
    }
    let gone = |folder: &Folder| fs::remove_file(folder.path(TRIALS)).unwrap();
    assert_nothing_done(gone, "ingest", &["trials.toml"]);
    let all_gone = |folder: &Folder| fs::remove_dir_all(folder.path("raw")).unwrap();
    assert_nothing_done(all_gone, "run", &["trials.toml"]);
}

#[test]
fn a_wrong_configuration_ends_everything_with_line_or_key_named() {
    let cases: [(&str, &str, &[&str]); 9] = [
        ("starts", "strats", &["pipeline.toml, line 4", "`strats`", "did you mean `starts`?"]),
        ("[fit]", "[fitt]", &["pipeline.toml, line 3", "`fitt`", "did you mean `fit`?"]),
        ("= 1", "= = 1", &["pipeline.toml, line 4"]),
        ("starts = 1", "starts = 0", &["fit.starts", "found 0", "needed 1 to"]),
        ("starts = 1", "starts = 9223372036854775807", &["fit.starts", "needed 1 to"]),
        ("[fit]", "[vicon]\nrate_hz = nan\n[fit]", &["vicon.rate_hz", "found NaN"]),
        ("[fit]", "[vicon]\nrate_hz = inf\n[fit]", &["vicon.rate_hz", "found inf", "1 to 10000"]),
        ("\"kinematic\"", "\"kinemtic\"", &["robot", "`kinemtic`", "`kinematic`?"]),
        (
            "skid-roll",
            "skid-rol",
            &["campaign.kinematic-symmetric.models", "`skid-rol`", "`skid-roll`?"],
        ),
    ];
    for (old, new, named) in cases {
        assert_nothing_done(|folder| folder.replace("pipeline.toml", old, new), "run", named);
    }
    for mass in ["-1.0", "nan", "inf", "0.0"] {
        let robot = format!(
            "[robot.kinematic]\nh_m = 0.144\nl_m = 0.112\nb_m = 0.0685\nmass_kg = [{mass}, 0.2, \
             0.2]\ninertia_kg_m2 = [86e-4, 5e-4, 5e-4]\nroll_kg_s = [0.6, 0.3, 0.3]\nskid_kg_s = \
             [100.0, 50.0, 50.0]\n[fit]"
        );
        let named = ["robot.kinematic.mass_kg", "needed 0.000001 to"];
        assert_nothing_done(|f| f.replace("pipeline.toml", "[fit]", &robot), "run", &named);
    }
    let gone = |folder: &Folder| fs::remove_file(folder.path("pipeline.toml")).unwrap();
    assert_nothing_done(gone, "run", &["pipeline.toml"]);
}

#[test]
fn a_model_that_is_not_configured_or_wrongly_so_is_named() {
    let line = "models = [\"no-skid\", \"skid-roll\"]";
    let cases: [(&str, &str, &[&str]); 5] = [
        (
            line,
            "models = [\"skid-rol\"]",
            &[
                "pipeline.toml: key `campaign.kinematic-symmetric.models`: found `skid-rol`",
                "needed one of `coulomb`, ",
                "did you mean `skid-roll`?",
            ],
        ),
        ("[fit]", "[model.mine]\nskid = \"viscous\"\n[fit]", &["line 3", "missing field `roll`"]),
        ("[fit]", "[model.skid]\nskid = \"viscos\"\n[fit]", &["line 4", "did you mean `viscous`?"]),
        ("[fit]", "[model.skid]\nskids = \"none\"\n[fit]", &["line 4", "did you mean `skid`?"]),
        (
            "[fit]",
            "[model.\"../skid\"]\nskid = \"none\"\nroll = \"none\"\nfree = []\n[fit]",
            &["key `model`: found \"../skid\"", "needed 1 to 64 visible characters"],
        ),
    ];
    for (old, new, named) in cases {
        let change = |folder: &Folder| folder.replace("pipeline.toml", old, new);
        assert_nothing_done(change, "run", named);
    }
    // Robot parameters that the campaign's models need.
    let own = "models = [\"ours\"]";
    let model = "[model.ours]\nskid = \"coulomb\"\nroll = \"coulomb\"\n[fit]";
    let change = |folder: &Folder| {
        folder.replace("pipeline.toml", line, own);
        folder.replace("pipeline.toml", "[fit]", model);
    };
    let named = ["`robot.kinematic.roll_dry_n`: found nothing", "`ours` (skid = \"coulomb\""];
    assert_nothing_done(change, "run", &named);
}

#[test]
fn what_a_model_cannot_leave_free_is_named() {
    let cases: [(&str, &[&str]); 7] = [
        ("skid-roll = [\"skd\"]", &["pipeline.toml, line 11", "`skd`", "did you mean `skid`?"]),
        (
            "skid-rol = [\"skid\"]",
            &["free.skid-rol`", "found \"skid-rol\"", "did you mean `skid-roll`?"],
        ),
        (
            "skid = [\"skid\"]",
            &["free.skid", "one of the campaign's models `no-skid`, `skid-roll`"],
        ),
        (
            "no-skid = [\"skid0\"]",
            &[
                "free.no-skid",
                "found \"skid0\"",
                "`no-skid` (skid = \"constrained\", roll = \"none\")",
            ],
        ),
        (
            "no-skid = [\"roll\"]",
            &["free.no-skid", "found \"roll\"", "roll = \"none\"", "passive joint: none"],
        ),
        (
            "skid-roll = [\"stiffness\"]",
            &["free.skid-roll", "found \"stiffness\"", "no passive joint: skid0, "],
        ),
        ("skid-roll = [\"skid\", \"skid1\"]", &["free.skid-roll", "each coefficient once"]),
    ];
    for (line, named) in cases {
        let free = format!("alpha = 0.0 }}\n[campaign.kinematic-symmetric.free]\n{line}");
        let add = |folder: &Folder| folder.replace("pipeline.toml", "alpha = 0.0 }", &free);
        assert_nothing_done(add, "run", named);
    }
    let own =
        "[model.mine]\nskid = \"none\"\nroll = \"viscous\"\nfree = [\"roll\", \"skid2\"]\n[fit]";
    let add = |folder: &Folder| folder.replace("pipeline.toml", "[fit]", own);
    let named = [
        "`model.mine.free`",
        "found \"skid2\"",
        "`mine` (skid = \"none\"",
        "passive joint: roll0, ",
    ];
    assert_nothing_done(add, "run", &named);
    let weigh = |folder: &Folder| {
        let nothing = "d = 0.0, v = 0.0, sigma = 0.0, alpha = 0.0";
        let weights = "d = 10.0, v = 1.0, sigma = 0.2, alpha = 0.0";
        folder.replace("pipeline.toml", weights, nothing);
    };
    assert_nothing_done(weigh, "run", &["campaign.kinematic-symmetric.weights", "above 0"]);
}

#[test]
fn a_number_of_threads_that_cannot_be_is_refused() {
    for threads in ["0", "1000000000"] {
        let ended = Folder::new().trilink(&["--threads", threads, "ingest"]);
        assert_eq!(ended.status, Some(2), "{}", ended.errors);
        assert_names(&ended.errors, &["--threads", threads, "needed 1 to"]);
    }
}

#[test]
fn a_run_with_a_failed_trial_fits_and_draws_the_rest_and_records_the_failure() {
    for failing in [vec![BAD], vec![BAD, GOOD]] {
        let folder = Folder::new();
        for trial in &failing {
            fs::remove_file(folder.path(&format!("raw/x/{trial}.csv"))).unwrap();
        }
        let ended = folder.trilink(&["run"]);
        assert_eq!(ended.status, Some(1), "{}", ended.errors);
        assert!(folder.path("reports/index.html").is_file());
        let record = fs::read_to_string(folder.path("reports/run.json")).unwrap();
        let record: serde_json::Value = serde_json::from_str(&record).unwrap();
        assert_eq!(record["trials"]["failed"], failing.len());
        for (i, trial) in failing.iter().enumerate() {
            assert_eq!(record["attention"][i]["trial"], *trial);
            assert_names(record["attention"][i]["message"].as_str().unwrap(), &["no such file"]);
        }
    }
}

#[test]
fn an_empty_list_of_trials_ends_everything() {
    for list in [&b"trial = []\n"[..], b"# nothing yet\n"] {
        let named = ["trials.toml", "found an empty list", "at least one [[trial]]"];
        assert_nothing_done(|folder| folder.write(TRIALS, list), "run", &named);
    }
}

#[test]
fn a_marker_file_that_was_copied_in_part_fails() {
    let cut = |folder: &Folder| {
        let whole = fs::read(folder.path(BAD_FILE)).unwrap();
        let row = whole.len() * 3 / 4;
        let end = row + whole[row..].iter().position(|&byte| byte == b'\n').unwrap();
        // Cut the file within the next row.
        folder.write(BAD_FILE, &whole[..end + 40]);
    };
    assert_one_fails(
        cut,
        &["3.50-r1.csv, line ", "the end of the file", "is the copy of the file complete?"],
    );
}

#[test]
fn a_file_in_the_place_of_a_folder_of_results_is_named_and_stays() {
    for place in ["derived", "reports"] {
        let folder = Folder::new();
        folder.write(place, b"precious");
        let ended = folder.trilink(&["run"]);
        assert_eq!(ended.status, Some(2), "{}", ended.errors);
        assert_names(&ended.errors, &[place]);
        assert_eq!(fs::read(folder.path(place)).unwrap(), b"precious");
    }
}

#[test]
fn damaged_tables_are_named_and_earlier_results_stay() {
    let folder = Folder::new();
    assert_eq!(folder.trilink(&["run"]).status, Some(0));
    let page = fs::read(folder.path("reports/index.html")).unwrap();
    let fits = fs::read(folder.path("derived/fits.parquet")).unwrap();
    let sound = fs::read(folder.path("derived/trials.parquet")).unwrap();
    for damaged in [&b""[..], b"garbage", &sound[..sound.len() / 2], b"PAR1garbagePAR1", &fits] {
        folder.write("derived/trials.parquet", damaged);
        for command in ["fit", "report"] {
            let ended = folder.trilink(&[command]);
            assert_eq!(ended.status, Some(2), "{command}: {}", ended.errors);
            assert_names(&ended.errors, &["trials.parquet"]);
        }
    }
    assert_eq!(fs::read(folder.path("reports/index.html")).unwrap(), page);
    assert_eq!(fs::read(folder.path("derived/fits.parquet")).unwrap(), fits);
}

#[test]
fn packed_files_and_other_frame_rates_are_taken_where_allowed() {
    let folder = Folder::new();
    let text = fs::read(folder.path(BAD_FILE)).unwrap();
    let packed = fs::File::create(folder.path(&format!("{BAD_FILE}.gz"))).unwrap();
    let mut packer = flate2::write::GzEncoder::new(packed, flate2::Compression::fast());
    packer.write_all(&text).unwrap();
    packer.finish().unwrap();
    fs::remove_file(folder.path(BAD_FILE)).unwrap();
    folder.replace(TRIALS, &format!("{BAD}.csv"), &format!("{BAD}.csv.gz"));
    assert_eq!(folder.trilink(&["ingest"]).status, Some(0));

    // Lines that end with CR alone, and labels in Windows-1252.
    let folder = Folder::new();
    let text = fs::read_to_string(folder.path(BAD_FILE)).unwrap();
    let text = text.replace("\r\n", "\r").replace("Snake:", "Schl\u{e4}nge:");
    let windows: Vec<u8> = text.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
    folder.write(BAD_FILE, &windows);
    assert_eq!(folder.trilink(&["ingest"]).status, Some(0));

    let folder = Folder::new();
    folder.replace(BAD_FILE, "\n120\r", "\n100\r");
    folder.replace(TRIALS, "omega_rad_s = 3.5", "omega_rad_s = 2.9167");
    folder.replace("pipeline.toml", "[fit]", "[vicon]\nrate_from_file = true\n[fit]");
    let ended = folder.trilink(&["ingest"]);
    assert_eq!(ended.status, Some(0), "{}", ended.errors);
}

/// Writes a table of fits to campaigns whose names are numbers.
fn write_fits(path: &Path, campaigns: impl Iterator<Item = usize>) {
    let fit = |campaign: usize| FitRow { campaign: campaign.to_string(), ..FitRow::blank() };
    let made = Provenance { input: String::new() };
    FitRow::to_table(&campaigns.map(fit).collect::<Vec<_>>()).write(path, &made).unwrap();
}

#[test]
fn a_fit_that_stands_twice_in_a_table_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fits.parquet");
    write_fits(&path, [1, 2, 3, 2].into_iter());
    let reader = Reader::default();
    let model = FitRow::blank().model;
    let twice =
        format!("column `campaign, model`: found `2 {model}` twice, needed each value once");
    let message = reader.rows::<FitRow>(&path).unwrap_err().to_string();
    assert!(message.ends_with(&twice), "{message}");
    let message = reader.bounded_table(&path).unwrap_err().to_string();
    assert!(message.ends_with(&twice), "{message}");
    // Inspection shows all rows.
    assert_eq!(reader.table(&path).unwrap().len(), 4);
}

#[test]
fn a_table_with_more_rows_than_it_may_have_is_refused_before_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fits.parquet");
    let read = |rows: usize| {
        write_fits(&path, 0..rows);
        Reader::default().bounded_table(&path)
    };
    assert_eq!(read(1_000).unwrap().len(), 1_000);
    let message = read(1_001).unwrap_err().to_string();
    assert!(message.ends_with("found 1001 rows, but at most 1000 are allowed"), "{message}");
    // A file of another name is not taken for one of the program's tables.
    let own = path.with_file_name("own.parquet");
    fs::rename(&path, &own).unwrap();
    assert_eq!(Reader::default().bounded_table(&own).unwrap().len(), 1_001);
}
