//! `trilink check`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use rayon::prelude::*;
use serde::Serialize;
use trilink_ingest::{FileSurvey, FolderInput, IngestSettings, Ingested, survey};
use trilink_tables::config::is_pattern;
use trilink_tables::trial::{ListedTrial, TrialFolders};
use trilink_tables::{CheckRow, CommonCause, Severity, TrialRow, TrialStatus, hash};

use super::output::{print, say, write_json, write_text};
use super::pipeline::in_words;
use super::table::Table;
use super::terminal::{Text, Tone};
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
        print_findings(&rows);
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

/// Prints the errors, then the warnings, each for all trials of a folder that have it; then the number of findings of
/// each check, and the number of trials of each status.
fn print_findings(rows: &Ingested) {
    let mut by_check: BTreeMap<&str, Vec<&CheckRow>> = BTreeMap::new();
    let found = rows.checks.iter().filter(|row| row.severity != Severity::Ok);
    found.for_each(|row| by_check.entry(&row.check).or_default().push(row));
    for row in rows.together() {
        print(Tone::Bad.paint(&row.check) + ": " + &row.trial + ": " + &row.message);
    }
    for severity in [Severity::Error, Severity::Warning] {
        for (check, rows_of_check) in &by_check {
            let found = rows_of_check.iter().copied().filter(|row| row.severity == severity);
            for cause in CommonCause::of_check(&rows.trials, found) {
                let tone = Tone::of(severity.name()).unwrap_or(Tone::Bad);
                print(tone.paint(check) + ": " + cause.to_string());
            }
        }
    }
    let counts: Vec<(&str, String)> = by_check
        .iter()
        .map(|(check, rows)| {
            let counts = [
                (Severity::Error, "error"),
                (Severity::Warning, "warning"),
                (Severity::Info, "note"),
            ];
            let counts = counts.iter().filter_map(|(severity, noun)| {
                match rows.iter().filter(|row| row.severity == *severity).count() {
                    0 => None,
                    1 => Some(format!("1 {noun}")),
                    count => Some(format!("{count} {noun}s")),
                }
            });
            (*check, counts.collect::<Vec<_>>().join(", "))
        })
        .collect();
    Table::new(&counts).left("", |(check, _)| *check).left("", |(_, counts)| counts).print();
    print(in_words(&rows.trials));
}

/// Checks each marker file on its own; no list of trials (`trials.toml`) is needed.
fn check_files(context: &Context, files: &[PathBuf], json: bool) -> Result<Outcome, Failure> {
    let config = &context.config;
    let of_robots = config
        .layout
        .keys()
        .filter_map(|robot| config.marker_layout(robot))
        .map(|markers| IngestSettings { markers, ..IngestSettings::new(config) });
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
    if json {
        write_json(&surveys)?;
    } else {
        surveys.iter().try_for_each(print_survey)?;
        let stopped = surveys.iter().filter(|survey| !survey.stops.is_empty()).count();
        let files = surveys.len();
        say!("{files} files, of which {stopped} cannot be ingested");
    }
    Ok(Outcome::well_if(surveys.iter().all(|survey| survey.stops.is_empty())))
}

/// Prints the problems of a marker file, and then its contents.
fn print_survey(survey: &FileSurvey) -> Result<(), Failure> {
    let FileSurvey { file, stops, warnings, .. } = survey;
    let can = if stops.is_empty() { Tone::Good.paint("can") } else { Tone::Bad.paint("cannot") };
    let file = file.display().to_string();
    print(Tone::Heading.paint(&file) + ": " + can + " be ingested");
    for stop in stops {
        let stop = stop.strip_prefix(&format!("{file}: ")).unwrap_or(stop);
        print(Text::from("  ") + Tone::Bad.paint("error") + ": " + stop);
    }
    for warning in warnings {
        print(Text::from("  ") + Tone::Doubtful.paint("warning") + ": " + warning);
    }
    write_text(include_str!("text/check-file.txt"), &BTreeMap::from([("survey", survey)]))
}
