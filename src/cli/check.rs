//! `trilink check`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use rayon::prelude::*;
use serde::Serialize;
use trilink_ingest::{FileSurvey, FolderInput, IngestSettings, Ingested, RecordingSurvey, survey};
use trilink_tables::config::is_pattern;
use trilink_tables::trial::{ListedTrial, TrialFolders};
use trilink_tables::{CheckRow, Severity, TrialRow, TrialStatus, hash};

use super::output::{say, write_data};
use super::{Context, Failure, Interrupted, Outcome};

#[derive(clap::Args)]
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
        context.say_assumed();
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
    all.ignored().iter().for_each(|sentence| context.progress.say(sentence));
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
    let failed = checked.iter().filter(|trial| trial.status == TrialStatus::Failed).count();
    if json {
        write_data(&serde_json::to_string_pretty(&checked)?);
    } else {
        checked.iter().for_each(say_trial);
        say_counts(&checked);
        rows.together().for_each(|found| say!("{}: {}", found.trial, found.message));
        say!("{} trials, {failed} that cannot be ingested", checked.len());
    }
    Ok(if rows.needs_a_person() { Outcome::NeedsAttention } else { Outcome::Well })
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

/// A trial, and below it what its checks found by code.
fn say_trial(checked: &CheckedTrial) {
    let CheckedTrial { trial, status, cycles, checks, .. } = checked;
    say!("{trial}: {status}, {cycles} cycles");
    for CheckLine { check, severity, message, .. } in checks {
        if *severity != Severity::Ok {
            // The code of what ends a trial says how bad it is.
            match check.starts_with('E') {
                true => say!("  {check}: {message}"),
                false => say!("  {check}: {severity}: {message}"),
            }
        }
    }
}

/// How the trials fared in every check.
fn say_counts(trials: &[CheckedTrial]) {
    let mut counts: BTreeMap<&str, BTreeMap<Severity, usize>> = BTreeMap::new();
    for line in trials.iter().flat_map(|trial| &trial.checks) {
        *counts.entry(&line.check).or_default().entry(line.severity).or_default() += 1;
    }
    for (check, count) in counts {
        let counts: Vec<String> =
            count.iter().map(|(severity, count)| format!("{count} {severity}")).collect();
        say!("{check:<24} {}", counts.join(", "));
    }
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
    let stopped = surveys.iter().filter(|survey| !survey.stops.is_empty()).count();
    if json {
        write_data(&serde_json::to_string_pretty(&surveys)?);
    } else {
        surveys.iter().for_each(say_survey);
        say!("{} files, {stopped} that cannot be ingested", surveys.len());
    }
    Ok(if stopped == 0 { Outcome::Well } else { Outcome::NeedsAttention })
}

fn say_survey(survey: &FileSurvey) {
    let verdict = if survey.stops.is_empty() { "can be ingested" } else { "cannot be ingested" };
    say!("{}: {verdict}", survey.file.display());
    for section in &survey.sections {
        let name = if section.name.is_empty() { "(no title)" } else { &section.name };
        say!("  section {name}: {}, {} rows", hertz(section.rate_hz), section.rows);
    }
    if let Some(recording) = &survey.recording {
        say_recording(recording);
    }
    // The file stands above.
    let file = format!("{}: ", survey.file.display());
    let stops = survey.stops.iter().map(|stop| stop.strip_prefix(&file).unwrap_or(stop));
    stops.for_each(|stop| say!("  stops it: {stop}"));
    survey.warnings.iter().for_each(|warning| say!("  flags it: {warning}"));
}

fn say_recording(recording: &RecordingSurvey) {
    let RecordingSurvey { first_frame, last_frame, rows, markers, gaps, .. } = recording;
    say!("  rate: {}", hertz(recording.rate_hz));
    say!(
        "  frames: {first_frame} to {last_frame} in {rows} rows, {} left out; \
         {} rows without a frame number",
        recording.frames_left_out,
        recording.rows_without_frame
    );
    say!("  markers: {}, seen in {:.1} % of the frames", markers.len(), 100.0 * recording.coverage);
    let width = markers.iter().map(|marker| marker.label.chars().count()).max().unwrap_or(0);
    for marker in markers {
        let part = match (marker.link, marker.ignored) {
            (_, true) => "ignored".to_owned(),
            (Some(link), false) => format!("link {link}"),
            (None, false) => "not in the layout".to_owned(),
        };
        let (label, percent, gaps) = (&marker.label, 100.0 * marker.coverage, marker.gaps);
        say!("    {label:width$}  {percent:5.1} %  {gaps:4} gaps  {part}");
    }
    match (gaps.median_frames, gaps.longest_frames) {
        (Some(median), Some(longest)) => say!(
            "  gaps: {}, median {median} frames{}, longest {longest} frames{}",
            gaps.count,
            seconds(gaps.median_s),
            seconds(gaps.longest_s)
        ),
        _ => say!("  gaps: none"),
    }
}

fn hertz(rate_hz: Option<f64>) -> String {
    rate_hz.map_or("no rate".to_owned(), |rate_hz| format!("{rate_hz} Hz"))
}

fn seconds(seconds: Option<f64>) -> String {
    seconds.map_or(String::new(), |seconds| format!(" ({seconds:.3} s)"))
}
