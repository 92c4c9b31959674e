//! Helpers to run the program and to inspect its results.

// Not every test file uses all helpers.
#![allow(dead_code)]

pub mod fitted;
pub mod fuzz;
mod temporary;
mod trials;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

pub use temporary::temporary;
pub use trials::noisy_trial;

use trilink_mechanics::Model;
use trilink_tables::config::{Config, GaitInput};

/// Runs the program in `folder`.
pub fn trilink(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trilink"))
        .args(arguments)
        .current_dir(folder)
        .env_remove("COLUMNS")
        .env_remove("CLICOLOR_FORCE")
        .output()
        .expect("the program starts")
}

/// Runs the program, asserts exit status 0, and returns its standard output.
pub fn succeed(folder: &Path, arguments: &[&str]) -> String {
    let output = trilink(folder, arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// Whether a run found that everything was up to date, and says so in a single line.
pub fn was_up_to_date(run: &Output) -> bool {
    let said = text(&run.stdout);
    said.starts_with("everything was up to date at ") && said.lines().count() == 1
}

/// Converts bytes to text.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("the text is UTF-8")
}

/// Names of files that are not results: the lock, and the record with times and hashes.
const BESIDE: [&str; 2] = [".lock", "up-to-date.json"];

/// Returns all result files below a folder, indexed by their relative path.
pub fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(inner) = open.pop() {
        for entry in std::fs::read_dir(&inner).expect("the folder is there") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                open.push(path);
            } else if !BESIDE.iter().any(|name| path.ends_with(name)) {
                let bytes = std::fs::read(&path).expect("the file is readable");
                let name = path.strip_prefix(folder).expect("the file is inside");
                found.insert(name.to_owned(), bytes);
            }
        }
    }
    found
}

/// Configuration of two campaigns with quick fits; a run of their trials takes a second.
pub const SMALL: &str = r#"[paths]
raw = "raw"
[fit]
starts = 2
bootstrap = 3
profiles = false
[campaign.kinematic-symmetric]
robot = "kinematic"
gait = "symmetric"
models = ["no-skid", "skid-roll"]
weights = { d = 10.0, v = 1.0, sigma = 0.2, alpha = 0.0 }
[campaign.kinematic-skewed]
robot = "kinematic"
gait = "skewed"
models = ["skid"]
weights = { d = 10.0, v = 1.0, sigma = 0.2, alpha = 0.0 }
"#;

/// Project with the trials of [`SMALL`] and their results.
pub struct Small(pub tempfile::TempDir);

impl Small {
    /// Creates a project with the configuration [`SMALL`] and synthetic trials that the program has not processed yet.
    pub fn raw() -> Self {
        static MADE: OnceLock<Small> = OnceLock::new();
        let made = MADE.get_or_init(|| {
            let folder = Self(temporary());
            folder.write("pipeline.toml", SMALL);
            succeed(folder.path(), &["-q", "synth", "raw", "--omega", "5,6", "--seed", "1"]);
            // Some tests remove trials from the list and leave their files.
            let list = text(&folder.read("raw/trials.toml"));
            folder.write("raw/trials.toml", format!("ignore = [\"*\"]\n{list}"));
            folder
        });
        made.copy()
    }

    /// Creates a project whose trials have been run.
    pub fn done() -> Self {
        static DONE: OnceLock<Small> = OnceLock::new();
        let done = DONE.get_or_init(|| {
            let folder = Self::raw();
            folder.run();
            folder
        });
        done.copy()
    }

    /// Copies the project and keeps all modification times.
    pub fn copy(&self) -> Self {
        let copy = Self(temporary());
        let mut open = vec![PathBuf::new()];
        while let Some(inner) = open.pop() {
            std::fs::create_dir_all(copy.path().join(&inner)).expect("a folder");
            for entry in std::fs::read_dir(self.path().join(&inner)).expect("a folder") {
                let entry = entry.expect("an entry");
                let name = inner.join(entry.file_name());
                if entry.path().is_dir() {
                    open.push(name);
                    continue;
                }
                let place = copy.path().join(name);
                std::fs::copy(entry.path(), &place).expect("a copy");
                let time = entry.metadata().and_then(|data| data.modified()).expect("a time");
                let file = std::fs::File::options().write(true).open(place).expect("a file");
                file.set_modified(time).expect("a time");
            }
        }
        copy
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn place(&self, name: &str) -> PathBuf {
        self.path().join(name)
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        let place = self.place(name);
        std::fs::create_dir_all(place.parent().expect("a parent")).expect("a folder");
        std::fs::write(place, bytes).expect("a file");
    }

    pub fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.place(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Replaces the first occurrence of `old` in a file by `new`.
    pub fn replace(&self, name: &str, old: &str, new: &str) {
        let content = text(&self.read(name));
        assert!(content.contains(old), "{name} has no {old:?}");
        self.write(name, content.replacen(old, new, 1));
    }

    /// Runs the program, which recomputes what has changed, and returns its standard output.
    pub fn run(&self) -> String {
        succeed(self.path(), &["run"])
    }

    /// Returns the results of a run, without times and durations.
    pub fn results(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut results = files(self.path());
        results.retain(|name, _| name.starts_with("derived") || name.starts_with("reports"));
        for told_by_the_clock in ["run.json", "history.html"] {
            results.remove(&Path::new("reports").join(told_by_the_clock));
        }
        results
    }

    /// Returns the results of a run from scratch with the same trials and configuration.
    pub fn scratch(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let copy = self.copy();
        for made in ["derived", "reports"] {
            let _ = std::fs::remove_dir_all(copy.place(made));
        }
        let output = trilink(copy.path(), &["run"]);
        assert!(output.status.code() < Some(2), "{}", text(&output.stderr));
        copy.results()
    }
}

/// Asserts that two sets of results have the same files with the same bytes.
pub fn assert_same(
    found: &BTreeMap<PathBuf, Vec<u8>>,
    expected: &BTreeMap<PathBuf, Vec<u8>>,
    what: &str,
) {
    let names = |files: &BTreeMap<PathBuf, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(found), names(expected), "{what}");
    for (name, bytes) in found {
        assert!(bytes == &expected[name], "{what}: {} differs", name.display());
    }
}

/// Returns a configuration with one campaign, to which two models are fitted quickly.
pub fn small_settings() -> Config {
    let mut config = Config::default();
    config.campaign.retain(|name, _| name == "kinematic-symmetric");
    for campaign in config.campaign.values_mut() {
        campaign.models = vec![Model::NO_SKID, Model::SKID_ROLL];
    }
    config.fit.starts = 2;
    config.fit.bootstrap = 40;
    // The measured gait crosses a singular shape, so that no motion without skid exists.
    config.fit.gait_input = GaitInput::Commanded;
    config
}

/// Creates a folder with synthetic trials at two frequencies and runs all stages on them with a configuration.
pub fn small_run(config: &Config, seed: &str) -> tempfile::TempDir {
    let folder = temporary();
    let text = toml::to_string(config).expect("a configuration is TOML");
    std::fs::write(folder.path().join("pipeline.toml"), text).expect("the file can be written");
    let synth = ["synth", "raw/demo", "--omega", "2,3.9", "--seed", seed, "--quiet"];
    succeed(folder.path(), &synth);
    succeed(folder.path(), &["run", "--quiet"]);
    folder
}
