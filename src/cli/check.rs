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

/// Read trial folders or marker files, write nothing, say what is there and what is wrong.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/check.txt").trim_end())]
pub(super) struct Check {
    /// Trial folders or patterns of them, or marker files [default: `paths.raw` of the
    /// configuration].
    #[arg(value_name = "FOLDER | FILE")]
    paths: Vec<PathBuf>,
    /// Print one JSON array: an object per trial, or per file.
    #[arg(long)]
    json: bool,
}

/// What would come of a trial.
#[derive(Serialize)]
struct CheckedTrial {
    trial: String,
    status: TrialStatus,
    message: String,
    cycles: i64,
    checks: Vec<CheckLine>,
}

/// A row of `checks.parquet`; numbers that are missing are null.
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
        context.check_assumed(|_| Ok(()))?;
        let is_folder = |path: &PathBuf| path.is_dir() || is_pattern(path) && !path.exists();
        let folders = self.paths.iter().filter(|path| is_folder(path)).count();
        match self.paths.len() {
            0 => {}
            all if all == folders => context.config.paths.raw = self.paths,
            _ if folders == 0 => return check_files(&context, &self.paths, self.json),
            _ => {
                return Err(
                    "found folders among files, needed trial folders or marker files".into()
                );
            }
        }
        check_folders(&context, self.json)
    }
}

fn check_folders(context: &Context, json: bool) -> Result<Outcome, Failure> {
    let all = TrialFolders::load(&context.config.paths)?;
    all.ignored().iter().for_each(|sentence| context.say(sentence));
    let TrialFolders { folders, trials: listed } = all;
    let stage = context.progress.stage("check", listed.len());
    let found: Vec<(TrialRow, Vec<CheckRow>)> = listed
        .par_iter()
        .with_max_len(1)
        .map(|ListedTrial { folder, trial, .. }| {
            stage.check("trials")?;
            let found = trilink_ingest::check_trial(&folders[*folder].path, trial, &context.config);
            stage.step(&trial.id);
            Ok(found)
        })
        .collect::<Result<_, Interrupted>>()?;
    drop(stage);
    let (trials, checks): (Vec<_>, Vec<_>) = found.into_iter().unzip();
    let mut rows = Ingested { trials, checks: checks.concat(), ..Ingested::default() };
    // The file's name might point out of the folder.
    let content = |ListedTrial { folder, trial, .. }: &ListedTrial| {
        trial.check(&context.config).ok()?;
        let bytes = trilink_mocap::read_file(&folders[*folder].path.join(&trial.file)).ok()?.0;
        Some((trial.id.clone(), hash(&bytes)))
    };
    let contents = listed.iter().filter_map(content).collect();
    FolderInput::new(&context.config, &folders).diagnose(&mut rows, &contents);
    let of_trial = |row: &TrialRow| CheckedTrial::new(row, &rows.checks);
    let checked: Vec<CheckedTrial> = rows.trials.iter().map(of_trial).collect();
    if json {
        write_json(&checked)?;
    } else {
        let together: Vec<_> = rows.together().map(|of| [&of.trial, &of.message]).collect();
        let text = json!({ "trials": checked, "counts": counts(&checked), "together": together });
        write_text(include_str!("text/check-trials.txt"), &text)?;
    }
    Ok(Outcome::well_if(!rows.needs_a_person()))
}

impl CheckedTrial {
    fn new(row: &TrialRow, checks: &[CheckRow]) -> Self {
        let TrialRow { trial, status, message, cycles, .. } = row.clone();
        let own = checks.iter().filter(|check| check.trial == trial).cloned();
        let line = |CheckRow { check, severity, value, limit, message, .. }| CheckLine {
            check,
            severity,
            value,
            limit,
            message,
        };
        Self { checks: own.map(line).collect(), trial, status, message, cycles }
    }
}

/// How the trials fared in every check.
fn counts(trials: &[CheckedTrial]) -> BTreeMap<&str, Vec<String>> {
    let mut counts: BTreeMap<&str, BTreeMap<Severity, usize>> = BTreeMap::new();
    for line in trials.iter().flat_map(|trial| &trial.checks) {
        *counts.entry(&line.check).or_default().entry(line.severity).or_default() += 1;
    }
    let in_words = |of: BTreeMap<Severity, usize>| {
        of.into_iter().map(|(severity, count)| format!("{count} {severity}")).collect()
    };
    counts.into_iter().map(|(check, of)| (check, in_words(of))).collect()
}

fn check_files(context: &Context, files: &[PathBuf], json: bool) -> Result<Outcome, Failure> {
    let settings = IngestSettings::new(&context.config);
    let stage = context.progress.stage("check", files.len());
    let surveys: Vec<FileSurvey> = files
        .par_iter()
        .with_max_len(1)
        .map(|file| {
            let survey = survey(file, &settings);
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
