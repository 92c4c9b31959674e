//! `trilink clean`.

use super::output::{note, say};
use super::status::megabytes;
use super::{Context, Exclusive, Failure, Outcome};
use crate::build::{Cleaned, clean};

/// Remove the tables, figures and pages, which a run can make again. The history, the baseline, optima stored by
/// `optimise --keep` and raw data are retained.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/clean.txt").trim_end())]
pub(super) struct Clean {
    /// Remove nothing; print what would be removed.
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    exclusive: Exclusive,
}

impl Clean {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        context.check_results()?;
        let Self { dry_run, exclusive } = self;
        let paths = &context.config.paths;
        let Cleaned { files, bytes, changed } =
            context.watched(|watch| clean(&context.config, dry_run, exclusive.wait, watch))?;
        let removed = if dry_run { "would remove" } else { "removed" };
        let [derived, reports] = [&paths.derived, &paths.reports].map(|folder| folder.display());
        say!(
            "{removed} {files} files ({}) from {derived} and {reports}; `trilink run` makes them again",
            megabytes(bytes)
        );
        for path in changed {
            note!("not removed, because it has changed since trilink wrote it: {}", path.display());
        }
        Ok(Outcome::Well)
    }
}
