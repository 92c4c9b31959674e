//! `trilink merge`.

use std::path::PathBuf;

use super::output::{note, say};
use super::{Context, Exclusive, Failure, Outcome, stages};
use crate::build::{self, Merged, ShardsStatus};

/// Merge the shards of an ingest or bootstrap into the tables that an undivided ingest or bootstrap writes.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/merge.txt").trim_end())]
pub(super) struct Merge {
    /// Folder with the shards.
    #[arg(value_name = "FOLDER")]
    shards: PathBuf,
    /// Merge the existing shards even if some are missing; the exit status is then 1.
    #[arg(long)]
    allow_missing: bool,
    /// Write nothing; list which shards are complete, missing or failed, and what to submit again.
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
        let (merged, status) = context.watched(|watch| {
            build::merge(&context.config, &shards, allow_missing, exclusive.wait, watch)
        })?;
        let outcome = match merged {
            Merged::Trials(ingested) => stages::say_ingested(&context, &ingested),
            Merged::Fits(fitted) => stages::say_fitted(&context, &fitted)?,
        };
        if status.is_whole() {
            return Ok(outcome);
        }
        note!("shards are missing; make them again with {}", status.again());
        Ok(Outcome::NeedsAttention)
    }
}

/// Prints the status of every shard, one per line, and what to submit again.
fn say_status(status: &ShardsStatus) -> Outcome {
    for (folder, _, shard_status) in &status.shards {
        say!("{}: {shard_status}", folder.display());
    }
    if !status.is_whole() {
        say!("{}", status.again());
    }
    Outcome::well_if(status.is_whole())
}
