//! `trilink merge`.

use std::path::PathBuf;

use super::output::{note, say};
use super::{Context, Exclusive, Failure, Outcome, pipeline, stages};
use crate::build::{self, Merged, ShardsStatus};

#[derive(clap::Args)]
pub(super) struct Merge {
    /// Folder with the parts.
    #[arg(value_name = "FOLDER")]
    shards: PathBuf,
    /// Join the parts that are there; ends with 1 if one is missing.
    #[arg(long)]
    allow_missing: bool,
    /// Write nothing: say which parts are there, missing or failed, and what to submit again.
    #[arg(long, conflicts_with = "allow_missing")]
    status: bool,
    #[command(flatten)]
    exclusive: Exclusive,
}

impl Merge {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        let Self { shards, allow_missing, status, exclusive } = self;
        if status {
            return Ok(say_status(&build::shards_status(&context.config, &shards)?));
        }
        let watch = context.progress.watch(false);
        let (merged, status) =
            build::merge(&context.config, &shards, allow_missing, exclusive.wait, &watch)?;
        drop(watch);
        let outcome = match merged {
            Merged::Trials(ingested) => {
                let counts = build::count(&ingested.trials);
                let derived = context.config.paths.derived.display();
                say!("{}; tables in {derived}", pipeline::in_words(&counts));
                stages::judge(&context, &ingested)
            }
            Merged::Fits(fitted) => stages::say_fitted(&context, &fitted)?,
        };
        if status.is_whole() {
            return Ok(outcome);
        }
        note!("parts are missing, to do again: {}", status.again());
        Ok(Outcome::NeedsAttention)
    }
}

/// Every part, a line each, and what to submit again.
fn say_status(status: &ShardsStatus) -> Outcome {
    for (folder, _, part) in &status.parts {
        say!("{}: {part}", folder.display());
    }
    if status.is_whole() {
        return Outcome::Well;
    }
    say!("{}", status.again());
    Outcome::NeedsAttention
}
