//! `trilink merge`.

use std::path::PathBuf;

use super::output::{note, say};
use super::{Context, Exclusive, Failure, Outcome, stages};
use crate::build::{self, Merged, ShardsStatus};

/// Join the parts of an ingest or bootstrap into the tables that an undivided one leaves.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/merge.txt").trim_end())]
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
        note!("parts are missing, to do again: {}", status.again());
        Ok(Outcome::NeedsAttention)
    }
}

/// Every part, a line each, and what to submit again.
fn say_status(status: &ShardsStatus) -> Outcome {
    for (folder, _, part) in &status.parts {
        say!("{}: {part}", folder.display());
    }
    if !status.is_whole() {
        say!("{}", status.again());
    }
    Outcome::well_if(status.is_whole())
}
