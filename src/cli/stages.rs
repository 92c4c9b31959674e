//! `trilink ingest`, `fit` and `report`: one stage alone.

use std::path::PathBuf;

use super::output::{note, say};
use super::parameters::print_parameters;
use super::{Context, Exclusive, Failure, Outcome, calibrate, pipeline};
use crate::build;
use crate::store::TrialStatus;

#[derive(clap::Args)]
pub(super) struct Ingest {
    /// Trial folder [default: `paths.raw` of the configuration].
    folder: Option<PathBuf>,
    #[command(flatten)]
    exclusive: Exclusive,
    #[arg(
        long,
        value_name = "TRIAL",
        help = "Write nothing: print the [markers] tables that this trial shows, in which both \
                joints move"
    )]
    calibrate: Option<String>,
}

#[derive(clap::Args)]
pub(super) struct Fit {
    #[command(flatten)]
    exclusive: Exclusive,
}

#[derive(clap::Args)]
pub(super) struct Report {
    #[command(flatten)]
    exclusive: Exclusive,
}

impl Ingest {
    pub fn run(self, mut context: Context) -> Result<Outcome, Failure> {
        if let Some(folder) = self.folder {
            context.config.paths.raw = folder;
        }
        if let Some(trial) = self.calibrate {
            return calibrate::run(&context, &context.config.paths.raw, &trial);
        }
        let ingested =
            build::ingest(&context.config, self.exclusive.wait, &context.progress.watch())?;
        for trial in build::attention(&ingested.trials) {
            let line = format!("{}: {}: {}", trial.status, trial.trial, trial.message);
            match trial.status {
                TrialStatus::Failed => note!("{line}"),
                _ => context.progress.say(&line),
            }
        }
        print_parameters(&ingested.parameters);
        let counts = build::count(&ingested.trials);
        say!(
            "{} trials: {} ok, {} flagged, {} failed; tables in {}",
            counts.total,
            counts.ok,
            counts.flagged,
            counts.failed,
            context.config.paths.derived.display()
        );
        Ok(if counts.failed == 0 { Outcome::Well } else { Outcome::NeedsAttention })
    }
}

impl Fit {
    pub fn run(self, context: Context) -> Result<Outcome, Failure> {
        let fitted = build::fit(&context.config, self.exclusive.wait, &context.progress.watch())?;
        pipeline::print_fits(&fitted.fits);
        pipeline::print_comparison(&fitted.comparison);
        Ok(Outcome::Well)
    }
}

impl Report {
    pub fn run(self, context: Context) -> Result<Outcome, Failure> {
        let reported =
            build::report(&context.config, self.exclusive.wait, &context.progress.watch())?;
        for missing in &reported.missing {
            context.progress.say(&format!("not drawn: {missing}"));
        }
        say!("page: {}", reported.page.display());
        Ok(Outcome::Well)
    }
}
