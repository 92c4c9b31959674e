//! `trilink status`.

use std::path::Path;

use serde::Serialize;
use trilink_fit::Fitted;
use trilink_tables::trial::TrialFolders;
use trilink_tables::{Reader, is_there};

use super::output::write_json;
use super::pipeline::{in_words, planned, verdicts};
use super::table::Table;
use super::terminal::{Text, Tone};
use super::{Context, Failure, Outcome};
use crate::build::{LastRun, RerunOptions, dry_run, ingested, load_unconfigured};

/// Maximum number of lines about stale results.
const MAX_STALE: usize = 10;

/// Summarise the project: trial folders, the last run, its verdicts, what is out of date, and disk use.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/status.txt").trim_end())]
pub(super) struct Status {
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Summary {
    configuration: String,
    folders: Vec<FolderSummary>,
    last_run: Option<LastRun>,
    /// Numbers of trials in the tables by status.
    trials: Option<Text>,
    /// Preferred model of each campaign and whether it fits.
    verdicts: Vec<Text>,
    /// What a run would recompute and why; empty if everything is up to date.
    stale: Vec<String>,
    /// Path of the baseline; null if there is none.
    baseline: Option<String>,
    /// Sizes of the folders of results, bytes.
    derived_bytes: u64,
    reports_bytes: u64,
    /// Path of the report; null if there is none.
    page: Option<String>,
}

#[derive(Serialize)]
struct FolderSummary {
    folder: String,
    trials: usize,
    /// Total size of the marker files, bytes.
    bytes: u64,
}

impl Status {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        context.check_assumed(|config| load_unconfigured(config).map(drop))?;
        let summary = Summary::new(&context)?;
        if self.json {
            write_json(&summary)?;
        } else {
            summary.print();
        }
        Ok(Outcome::Well)
    }
}

impl Summary {
    fn new(context: &Context) -> Result<Self, Failure> {
        let config = &context.config;
        let paths = &config.paths;
        let TrialFolders { folders, trials, .. } = TrialFolders::load(paths)?;
        let folders = folders.iter().enumerate().map(|(index, folder)| {
            let own = trials.iter().filter(|listed| listed.folder == index);
            let files = own.clone().map(|listed| folder.path.join(&listed.trial.file));
            FolderSummary {
                folder: folder.path.display().to_string(),
                trials: own.count(),
                bytes: files.filter_map(|file| Some(file.metadata().ok()?.len())).sum(),
            }
        });
        let rows = ingested(config)?.trials;
        let reader = Reader::default();
        let table = |name: &str| paths.derived.join(name);
        let fits = reader.rows_if_there(&table("fits.parquet"))?.unwrap_or_default();
        let comparison = reader.rows_if_there(&table("comparison.parquet"))?.unwrap_or_default();
        let known = |path: &Path| -> Result<_, Failure> {
            Ok(is_there(path)?.then(|| path.display().to_string()))
        };
        Ok(Self {
            configuration: if context.is_configured {
                context.file.display().to_string()
            } else {
                "the paper's values".to_owned()
            },
            folders: folders.collect(),
            last_run: LastRun::load(config),
            trials: (!rows.is_empty()).then(|| in_words(&rows)),
            verdicts: verdicts(&Fitted { fits, comparison, ..Fitted::default() }),
            stale: planned(&dry_run(config, RerunOptions::default())?, true),
            baseline: known(&paths.baseline)?,
            derived_bytes: size(&paths.derived),
            reports_bytes: size(&paths.reports),
            page: known(&paths.reports.join("index.html"))?,
        })
    }

    fn print(&self) {
        let mut lines: Vec<(&str, Text)> = vec![("configuration", (&self.configuration).into())];
        for FolderSummary { folder, trials, bytes } in &self.folders {
            let text = format!("{folder}: {trials} trials, {}", megabytes(*bytes));
            lines.push(("trial folder", text.into()));
        }
        let last_run = match &self.last_run {
            Some(LastRun { status, started, error, .. }) => {
                let error = error.as_ref().map_or(String::new(), |error| format!(": {error}"));
                Text::from(started) + ": " + Text::status(status) + error
            }
            None => "none: `trilink run` processes the trials".into(),
        };
        lines.push(("last run", last_run));
        lines.extend(self.trials.iter().map(|trials| ("tables", trials.clone())));
        lines.extend(self.verdicts.iter().map(|verdict| ("verdict", verdict.clone())));
        if self.stale.is_empty() {
            lines.push(("to do", "nothing: everything is up to date".into()));
        }
        lines.extend(self.stale.iter().take(MAX_STALE).map(|line| ("to do", line.into())));
        if self.stale.len() > MAX_STALE {
            let more = self.stale.len() - MAX_STALE;
            let more = format!("and {more} more: `trilink run --dry-run --explain` lists them");
            lines.push(("to do", more.into()));
        }
        let none = "none: `trilink compare --accept WHY` saves one";
        lines.push(("baseline", self.baseline.as_deref().unwrap_or(none).into()));
        let [derived, reports] = [self.derived_bytes, self.reports_bytes].map(megabytes);
        lines.push(("size", format!("tables {derived}, reports {reports}").into()));
        lines.extend(self.page.iter().map(|page| ("page", page.into())));
        Table::new(&lines)
            .left("", |(name, _)| Tone::Heading.paint(name))
            .prose("", |(_, text)| text.clone())
            .print();
    }
}

/// Formats a size in megabytes.
pub(super) fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 / 1e6)
}

/// Returns the total size of the files in a folder and its subfolders, bytes; links are not followed.
fn size(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let sizes = entries.map(|entry| match entry.metadata() {
        Ok(metadata) if metadata.is_dir() => size(&entry.path()),
        Ok(metadata) => metadata.len(),
        Err(_) => 0,
    });
    sizes.sum()
}
