//! `trilink check`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use rayon::prelude::*;
use serde::Serialize;
use serde_json::json;
use trilink_ingest::{FileSurvey, FolderInput, IngestSettings, Ingested, survey};
use trilink_tables::config::is_pattern;
use trilink_tables::trial::{ListedTrial, TrialFolders};
use trilink_tables::{CheckRow, Severity, TrialRow, TrialStatus, hash};

use super::output::{self, write_json, write_text};
use super::{Context, Failure, Interrupted, Outcome};
use crate::build::load_unconfigured;

/// Check trial folders or marker files without writing anything: list the contents of the
/// files and the problems found.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/check.txt").trim_end())]
pub(super) struct Check {
    /// Trial folders, patterns that match trial folders, or marker files [default: `paths.raw` of the
    /// configuration].
    #[arg(value_name = "FOLDER | FILE")]
    paths: Vec<PathBuf>,
    /// Print one JSON array: an object per trial, or per file.
    #[arg(long)]
    json: bool,
}

/// Result that `trilink ingest` would give for a trial.
#[derive(Serialize)]
struct CheckedTrial {
    trial: String,
    status: TrialStatus,
    message: String,
    cycles: i64,
    checks: Vec<CheckLine>,
}

/// Finding on a trial, as in `checks.parquet`. In JSON, missing numbers (NaN) are null.
#[derive(Serialize)]
struct CheckLine {
    check: String,
    severity: Severity,
    value: f64,
    limit: f64,
    message: String,
}

impl Check {
    pub(super) fn run(self, mut context: Context) -> Result<Outcome, Failure> {
        let folders = self.paths.iter();
        let folders =
            folders.filter(|path| path.is_dir() || is_pattern(path) && !path.exists()).count();
        match self.paths.len() {
            0 => {}
            all if all == folders => context.config.paths.replace_raw(self.paths),
            _ if folders == 0 => {
                context.check_assumed(|_| Ok(()))?;
                return check_files(&context, &self.paths, self.json);
            }
            _ => {
                return Err("found both folders and files, needed either trial folders or marker \
                            files"
                    .into());
            }
        }
        context.check_assumed(|config| load_unconfigured(config).map(drop))?;
        check_folders(&context, self.json)
    }
}

/// Checks all trials of the configured folders.
fn check_folders(context: &Context, json: bool) -> Result<Outcome, Failure> {
    let all = TrialFolders::load(&context.config.paths)?;
    all.ignored_sentence().iter().for_each(|sentence| context.say(sentence));
    let TrialFolders { folders, trials: listed, .. } = &all;
    let stage = context.progress.stage("check", listed.len());
    let found: Vec<Ingested> = listed
        .par_iter()
        .with_max_len(1)
        .map(|ListedTrial { folder, trial, .. }| {
            stage.check("trials")?;
            let folder = &folders[*folder];
            let mut found = trilink_ingest::check_trial(&folder.path, trial, &context.config);
            // Trials of the same folder share the slope of the floor.
            found.trials.iter_mut().for_each(|row| row.folder.clone_from(&folder.name));
            stage.step(&trial.id);
            Ok(found)
        })
        .collect::<Result<_, Interrupted>>()?;
    drop(stage);
    let mut rows = Ingested::default();
    found.into_iter().for_each(|of_trial| rows.extend(of_trial));
    let contents = listed.iter().filter_map(|ListedTrial { folder, trial, .. }| {
        // The check of the entry comes first, because the file's name might point out of the folder.
        trial.check(&context.config).ok()?;
        let bytes = trilink_mocap::read_file(&folders[*folder].path.join(&trial.file)).ok()?.0;
        Some((trial.id.clone(), hash(&bytes)))
    });
    FolderInput::new(&context.config, &all).diagnose(&mut rows, &contents.collect());
    let checked: Vec<CheckedTrial> =
        rows.trials.iter().map(|row| CheckedTrial::new(row, &rows.checks)).collect();
    if json {
        write_json(&checked)?;
    } else {
        let together: Vec<_> = rows.together().map(|row| [&row.trial, &row.message]).collect();
        let text = json!({ "trials": checked, "counts": counts(&checked), "together": together });
        write_text(include_str!("text/check-trials.txt"), &text)?;
    }
    Ok(Outcome::well_if(!rows.needs_a_person()))
}

impl CheckedTrial {
    fn new(row: &TrialRow, checks: &[CheckRow]) -> Self {
        let TrialRow { trial, status, message, cycles, .. } = row.clone();
        let own = checks.iter().filter(|check| check.trial == trial).cloned();
        let checks = own.map(|CheckRow { check, severity, value, limit, message, .. }| CheckLine {
            check,
            severity,
            value,
            limit,
            message,
        });
        Self { checks: checks.collect(), trial, status, message, cycles }
    }
}

/// Returns, for every check, the number of findings of each severity, such as `2 warning`.
fn counts(trials: &[CheckedTrial]) -> BTreeMap<&str, Vec<String>> {
    let mut counts: BTreeMap<&str, BTreeMap<Severity, usize>> = BTreeMap::new();
    for line in trials.iter().flat_map(|trial| &trial.checks) {
        *counts.entry(&line.check).or_default().entry(line.severity).or_default() += 1;
    }
    let in_words = counts.into_iter().map(|(check, counts)| {
        let counts = counts.into_iter().map(|(severity, count)| format!("{count} {severity}"));
        (check, counts.collect())
    });
    in_words.collect()
}

/// Checks each marker file on its own; no list of trials (`trials.toml`) is needed.
fn check_files(context: &Context, files: &[PathBuf], json: bool) -> Result<Outcome, Failure> {
    let config = &context.config;
    let of_robots = config.layout.values();
    let of_robots = of_robots
        .map(|markers| IngestSettings { markers: markers.clone(), ..IngestSettings::new(config) });
    let settings: Vec<IngestSettings> =
        std::iter::once(IngestSettings::new(config)).chain(of_robots).collect();
    let stage = context.progress.stage("check", files.len());
    let surveys: Vec<FileSurvey> = files
        .par_iter()
        .with_max_len(1)
        .map(|file| {
            // The robot of the file is not known: its layout is the one with the fewest problems.
            let surveys = settings.iter().map(|settings| survey(file, settings));
            let survey =
                surveys.min_by_key(|survey| survey.stops.len()).expect("one layout at least");
            stage.step(&file.display().to_string());
            survey
        })
        .collect();
    drop(stage);
    if surveys.iter().all(|survey| !survey.readable) {
        let reasons: Vec<&str> =
            surveys.iter().flat_map(|survey| &survey.stops).map(String::as_str).collect();
        return Err(reasons.join("\n").into());
    }
    output::write(&surveys, json, include_str!("text/check-files.txt"))?;
    Ok(Outcome::well_if(surveys.iter().all(|survey| survey.stops.is_empty())))
}
