//! Shared code for the fuzz targets: a small project, damage to one of its files, and the commands that read that file.
//! `tests/it/hostile.rs` uses the code with a few hundred inputs of its own.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use polars::prelude::{Column, DataFrame, DataType, PolarsResult, Series, StringChunked};
use trilink_ingest::IngestInput;
use trilink_mechanics::{FIT_ACCURACY, Problem};
use trilink_mocap::LengthUnit;
use trilink_mocap::{parse_markers, sections};
use trilink_report::ReportInput;
use trilink_tables::config::Config;
use trilink_tables::trial::TrialList;
use trilink_tables::{Provenance, Table};

/// Separator between the contents of `pipeline.toml` and `trials.toml` in the input of [`settings`].
const BETWEEN: &[u8] = b"\n%%\n";

const CONFIG: &str = "pipeline.toml";
const RECORD: &str = "derived/up-to-date.json";
/// Configuration of the fuzz tests' project: two campaigns that share coefficients. The figures are small, because
/// painting their pixels, which is not tested, would take more than half of the time.
const PIPELINE: &str = r#"[paths]
raw = "raw"
baseline = "baseline.json"
[report]
width_mm = 28.0
font_pt = 4.0
trial_pages = 2
[fit]
starts = 1
bootstrap = 4
shared = { robot = "kinematic" }
[campaign.kinematic-symmetric]
robot = "kinematic"
gait = "symmetric"
models = ["skid", "skid-roll"]
weights = { d = 10.0, v = 1.0, sigma = 1.0, alpha = 0.0 }
[campaign.kinematic-skewed]
robot = "kinematic"
gait = "skewed"
models = ["skid-roll"]
weights = { d = 10.0, v = 1.0, sigma = 1.0, alpha = 0.0 }
"#;
const TRIAL: &str = "kinematic-skewed-4.00-r1";

/// Commands that create the fuzz tests' project in the folder `{}`.
const MAKERS: [&str; 4] = [
    "synth {}/raw --omega 3,4,5",
    "run",
    "compare --accept as-it-is",
    "optimise kinematic-skewed --model skid-roll --fitted --keep --maximise v --starts 2 --free omega amplitudes",
];

/// Names of the tables that exist once per trial.
const OF_TRIALS: [&str; 3] = ["poses", "wheels", "cycles"];
/// Commands, each with the tables that it reads.
const READERS: [(&str, &[&str]); 7] = [
    (
        "report",
        &[
            "trials",
            "checks",
            "fits",
            "alternative_fits",
            "shared_fits",
            "predictions",
            "comparison",
            "starts",
            "profiles",
            "bootstrap",
            "robot_parameters",
            "optima",
            "optimum_maps",
            "precision",
            "poses",
            "wheels",
            "cycles",
        ],
    ),
    ("compare", &["trials", "fits", "robot_parameters", "predictions", "precision", "residuals"]),
    (
        "simulate kinematic-skewed --model skid-roll --omega 4 --fitted --bands --csv",
        &["trials", "cycles", "robot_parameters", "fits", "alternative_fits", "bootstrap"],
    ),
    (
        "design kinematic-symmetric --omega 3,5 --add 1 --csv",
        &["trials", "cycles", "fits", "alternative_fits", "bootstrap", "comparison"],
    ),
    (
        "optimise kinematic-skewed --fitted --maximise v --starts 1 --free amplitudes --omega 4 --replicates 2 --csv",
        &["trials", "cycles", "fits", "alternative_fits", "bootstrap", "comparison"],
    ),
    ("export kinematic-skewed-4.00-r1 --format csv --output -", &["trials", "poses"]),
    ("fit", &["trials", "cycles", "robot_parameters"]),
];

/// Function that runs the program on a configuration with a line of arguments and returns the exit status.
pub type Program = fn(&Path, &str) -> i32;

/// Checks that reading a marker file with arbitrary bytes gives markers or an error.
pub fn markers(name: &str, file: &[u8]) {
    let path = Path::new(name);
    let _ = sections(path, file);
    let Ok(markers) = parse_markers(path, file, LengthUnit::Mm) else { return };
    assert!(!markers.frames.is_empty() && !markers.labels.is_empty());
    assert!(markers.frames.windows(2).all(|pair| pair[0] < pair[1]));
    for row in 0..markers.frames.len() {
        for position in markers.row_mm(row) {
            let missing = position.iter().filter(|x| x.is_nan()).count();
            assert!(missing == 0 || missing == 3);
        }
    }
}

/// Checks that `pipeline.toml` and `trials.toml` are either rejected or usable by every stage, and that solving any
/// model terminates.
pub fn settings(text: &[u8]) {
    let at = text.windows(BETWEEN.len()).position(|bytes| bytes == BETWEEN);
    let (pipeline, trials) = match at {
        Some(at) => (&text[..at], &text[at + BETWEEN.len()..]),
        None => (text, &b""[..]),
    };
    let folder = scratch().join("settings");
    fs::create_dir_all(&folder).expect("a folder");
    fs::write(folder.join("pipeline.toml"), pipeline).expect("written");
    fs::write(folder.join("trials.toml"), trials).expect("written");
    let (config, list) = (Config::load(&folder.join("pipeline.toml")), TrialList::load(&folder));
    let Ok(config) = config else { return };
    for trial in list.iter().flat_map(|list| &list.trial) {
        let _ = trial.check(&config);
        let _ = IngestInput::new(&config, trial);
    }
    let report = ReportInput::new(&config, Default::default());
    let _ = report.configuration();
    for (name, campaign) in &config.campaign {
        let Some((robot, gait)) = config.campaign_setup(name) else { continue };
        for model in &campaign.models {
            let laws = config.model[model].laws();
            let robot = robot.clone();
            let _ = Problem::new(robot, gait, laws, 3.9).solve(FIT_ACCURACY);
        }
    }
}

/// Creates the fuzz tests' project before the first input, because creating it takes longer than the time limit for an
/// input.
pub fn begin(program: Program) {
    Project::get(program);
}

/// Returns the names of all tables that commands read; a table that exists once per trial is listed once.
pub fn tables() -> Vec<&'static str> {
    let mut all: Vec<&str> = READERS.iter().flat_map(|(_, tables)| *tables).copied().collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// Returns the names of the tables in the fuzz tests' project, which `program` creates at the first call; a table that
/// exists once per trial is listed once.
pub fn tables_there(program: Program) -> Vec<String> {
    let project = Project::get(program);
    let derived = project.folder.join("derived");
    let names = project.files.keys().filter_map(|path| path.strip_prefix(&derived).ok());
    let tables = names.filter(|name| name.extension().is_some_and(|ending| ending == "parquet"));
    let kind = |name: &Path| match name.parent().and_then(Path::to_str) {
        Some(folder) if !folder.is_empty() => folder.to_owned(),
        _ => name.with_extension("").to_string_lossy().into_owned(),
    };
    let mut kinds: Vec<String> = tables.map(kind).collect();
    kinds.sort_unstable();
    kinds.dedup();
    kinds
}

/// Returns the commands that read a table.
pub fn readers(table: &str) -> Vec<&'static str> {
    let reads = |(line, tables): &(&'static str, &[&str])| tables.contains(&table).then_some(*line);
    READERS.iter().filter_map(reads).collect()
}

/// Checks that all commands that read tables succeed on the undamaged project of the fuzz tests.
pub fn undamaged(program: Program) {
    let project = Project::get(program);
    for (line, _) in READERS {
        project.restore();
        assert_eq!(project.does(program, line), 0, "{line}");
    }
}

/// Checks that the command `reader` ends with results or an error if the table `name`, which it reads, is damaged by
/// `data`.
pub fn table(program: Program, name: &str, reader: &str, data: &[u8]) {
    let project = Project::get(program);
    project.restore();
    let of_trial = format!("{name}/{TRIAL}");
    let file = if OF_TRIALS.contains(&name) { &of_trial } else { name };
    project.damage(&format!("derived/{file}.parquet"), data);
    project.does(program, reader);
}

/// Checks that `compare` ends with results or an error if `history.parquet` is damaged.
pub fn history(program: Program, data: &[u8]) {
    let project = Project::get(program);
    project.restore();
    project.damage("history.parquet", data);
    project.does(program, "compare");
}

/// Checks that runs end with results or an error if `up-to-date.json` is damaged.
pub fn record(program: Program, data: &[u8]) {
    let project = Project::get(program);
    project.restore();
    fs::write(project.folder.join(RECORD), data).expect("written");
    project.does(program, "run --dry-run");
    project.does(program, "run");
}

/// Returns the record `up-to-date.json` of the fuzz tests' project, to seed the fuzzer.
pub fn recorded(program: Program) -> Vec<u8> {
    let project = Project::get(program);
    project.files[&project.folder.join(RECORD)].clone()
}

/// Returns a folder for this process, in memory if possible.
fn scratch() -> &'static Path {
    let shm = Path::new("/dev/shm");
    let root = if shm.is_dir() { shm.to_owned() } else { std::env::temp_dir() };
    super::temporary::of_process(&root)
}

/// Project of the fuzz tests, with the original content of its files.
struct Project {
    folder: PathBuf,
    files: BTreeMap<PathBuf, Vec<u8>>,
}

impl Project {
    fn get(program: Program) -> &'static Self {
        static PROJECT: OnceLock<Project> = OnceLock::new();
        PROJECT.get_or_init(|| {
            let mut project = Self { folder: scratch().join("project"), files: BTreeMap::new() };
            fs::create_dir_all(&project.folder).expect("a folder");
            fs::write(project.folder.join(CONFIG), PIPELINE).expect("written");
            for line in MAKERS {
                assert_eq!(project.does(program, line), 0, "{line}");
            }
            for folder in ["derived", "reports"] {
                collect(&project.folder.join(folder), &mut project.files);
            }
            project
        })
    }

    /// Runs a command in the project and returns its exit status; asserts that it is 0, 1 or 2.
    fn does(&self, program: Program, line: &str) -> i32 {
        let line = line.replace("{}", &self.folder.display().to_string());
        let status = program(&self.folder.join(CONFIG), &line);
        assert!((0..=2).contains(&status), "{line}: exit status {status}");
        status
    }

    /// Restores the original files of the project.
    fn restore(&self) {
        for (path, bytes) in &self.files {
            if fs::read(path).ok().as_ref() != Some(bytes) {
                let _ = fs::remove_dir_all(path);
                fs::write(path, bytes).expect("written");
            }
        }
    }

    /// Damages a table: `data` either replaces its bytes or determines edits of its cells.
    fn damage(&self, name: &str, data: &[u8]) {
        let path = self.folder.join(name);
        match data.split_first() {
            Some((0xff, bytes)) => fs::write(path, bytes).expect("written"),
            _ => {
                let mut table = Table::read(&path).expect("the table of a run");
                let input = table.input.clone().unwrap_or_default();
                edit(&mut table.frame, &mut Data(data));
                table.write(&path, &Provenance { input }).expect("written");
            }
        }
    }
}

fn collect(folder: &Path, files: &mut BTreeMap<PathBuf, Vec<u8>>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            collect(&path, files);
        } else {
            files.insert(path.clone(), fs::read(&path).expect("a file"));
        }
    }
}

/// Stream of input bytes, followed by endless zeros.
struct Data<'d>(&'d [u8]);

impl Data<'_> {
    fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    fn below(&mut self, count: usize) -> usize {
        let wide = usize::from(self.byte()) << 8 | usize::from(self.byte());
        wide % count.max(1)
    }

    fn number(&mut self) -> f64 {
        const ODD: [f64; 12] = [
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            0.0,
            -0.0,
            -1.0,
            1e308,
            -1e308,
            5e-324,
            1e6,
            9e18,
            1.5,
        ];
        match self.below(ODD.len() + 1) {
            i if i < ODD.len() => ODD[i],
            _ => f64::from_le_bytes(std::array::from_fn(|_| self.byte())),
        }
    }

    fn text(&mut self) -> String {
        const ODD: [&str; 10] = [
            "",
            "ok",
            "failed",
            "skid-roll",
            "gait",
            "../../outside",
            "<script>alert(1)</script>",
            "\u{1b}[31m\u{202e}\n\r\0",
            "no such",
            "trial,curve",
        ];
        match self.below(ODD.len() + 2) {
            i if i < ODD.len() => ODD[i].to_owned(),
            i if i == ODD.len() => "long".repeat(5_000),
            _ => String::from_utf8_lossy(&[self.byte(), self.byte(), self.byte()]).into_owned(),
        }
    }
}

/// Maximum number of rows in an edited table, to limit the memory used.
const MAX_ROWS: usize = 100_000;
const MAX_BYTES: usize = 30_000_000;
/// Maximum length of a string that is written to all rows, characters.
const MAX_TEXT: usize = 100;

/// Edits a table until the input data are used up.
fn edit(frame: &mut DataFrame, data: &mut Data) {
    while !data.0.is_empty() && frame.width() > 0 {
        let names: Vec<String> = frame.get_column_names().iter().map(|n| n.to_string()).collect();
        let name = names[data.below(names.len())].as_str();
        let height = frame.height();
        let edited = match data.byte() % 8 {
            // Edit one cell, or a whole column.
            0..=2 => set(frame, name, Some(data.below(height)), data),
            3 => set(frame, name, None, data),
            4 => frame.drop(name),
            5 => {
                let types = [DataType::Float64, DataType::Int64, DataType::String];
                let to = &types[data.below(3)];
                // Polars panics on the text of an invalid time.
                let number = |of: &Column| match of.dtype().is_temporal() {
                    true => of.cast(&DataType::Int64),
                    false => Ok(of.clone()),
                };
                let column = frame.column(name).and_then(number).and_then(|of| of.cast(to));
                column.map(|column| with(frame, column))
            }
            // Remove, duplicate or multiply rows.
            6 => Ok(frame.slice(data.below(height + 1) as i64, data.below(height + 1))),
            _ => {
                let most = MAX_ROWS.min(MAX_BYTES * height / frame.estimated_size().max(1));
                many(frame, [2 * height, 1_000, MAX_ROWS][data.below(3)].min(most))
            }
        };
        if let Ok(edited) = edited {
            *frame = edited;
        }
    }
    frame.rechunk_mut();
}

/// Repeats the rows of a table by doubling, up to at most `rows` rows.
fn many(frame: &DataFrame, rows: usize) -> PolarsResult<DataFrame> {
    let mut all = frame.clone();
    while (1..=rows / 2).contains(&all.height()) {
        let again = all.clone();
        all.vstack_mut(&again)?;
    }
    // Polars is slow to compute the size of a table in many chunks.
    all.rechunk_mut();
    Ok(all)
}

/// Returns a copy of a table in which the column `name` has another value in one row, or in all rows if `row` is
/// `None`.
fn set(
    frame: &DataFrame,
    name: &str,
    row: Option<usize>,
    data: &mut Data,
) -> PolarsResult<DataFrame> {
    let column = frame.column(name)?;
    let is_here = |i: usize| row.is_none_or(|row| row == i);
    let is_missing = data.byte().is_multiple_of(8);
    let series: Series = if column.dtype() == &DataType::String {
        let most = if row.is_none() { MAX_TEXT } else { usize::MAX };
        let text = data.text().chars().take(most).collect::<String>();
        let text = Some(text).filter(|_| !is_missing);
        let old = column.str()?.iter().enumerate();
        let new = old.map(|(i, old)| if is_here(i) { text.clone() } else { old.map(Into::into) });
        let mut texts: StringChunked = new.collect();
        texts.rename(name.into());
        texts.into()
    } else {
        let value = Some(data.number()).filter(|_| !is_missing);
        let numbers = column.cast(&DataType::Float64)?;
        let old = numbers.f64()?.iter().enumerate();
        let new: Vec<Option<f64>> =
            old.map(|(i, old)| if is_here(i) { value } else { old }).collect();
        Series::from_iter(new).with_name(name.into()).cast(column.dtype())?
    };
    Ok(with(frame, series.into()))
}

fn with(frame: &DataFrame, column: Column) -> DataFrame {
    let mut frame = frame.clone();
    let _ = frame.with_column(column);
    frame
}
