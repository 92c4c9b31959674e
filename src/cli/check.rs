//! `trilink check`.

use std::path::PathBuf;

use rayon::prelude::*;

use super::output::say;
use super::{Context, Failure, Outcome};
use crate::ingest::process_trial;
use crate::trial::TrialList;

#[derive(clap::Args)]
pub(super) struct Check {
    /// Trial folder [default: `paths.raw` of the configuration].
    folder: Option<PathBuf>,
}

impl Check {
    pub fn run(self, context: Context) -> Result<Outcome, Failure> {
        let folder = self.folder.as_ref().unwrap_or(&context.config.paths.raw);
        let list = TrialList::load(folder)?;
        let stage = context.progress.stage("check", list.trial.len());
        let checked: Vec<(bool, String)> = list
            .trial
            .par_iter()
            .with_max_len(1)
            .map(|trial| {
                let (failed, line) = match process_trial(folder, trial, &context.config) {
                    Ok(processed) if processed.row.message.is_empty() => {
                        (false, format!("{}: ok, {} cycles", trial.id, processed.row.cycles))
                    }
                    Ok(processed) => {
                        let row = processed.row;
                        (false, format!("{}: {}: {}", trial.id, row.status, row.message))
                    }
                    Err(failure) => (true, format!("{}: failed: {failure}", trial.id)),
                };
                stage.step(&trial.id);
                (failed, line)
            })
            .collect();
        drop(stage);
        for (_, line) in &checked {
            say!("{line}");
        }
        let failed = checked.iter().filter(|(failed, _)| *failed).count();
        say!("{} trials, {failed} that cannot be ingested", checked.len());
        Ok(if failed == 0 { Outcome::Well } else { Outcome::NeedsAttention })
    }
}
