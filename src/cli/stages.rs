//! `trilink ingest`, `fit` and `report`: one stage alone.

use std::path::{Path, PathBuf};

use trilink_fit::Fitted;
use trilink_ingest::Ingested;
use trilink_tables::FitRow;

use super::output::{note, say};
use super::{Context, Exclusive, Failure, Folders, Outcome, calibrate, pipeline};
use crate::build::{self, Part};

/// Marker files to tables of poses, wheel velocities, cycles and trials.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/ingest.txt").trim_end())]
pub(super) struct Ingest {
    #[command(flatten)]
    folders: Folders,
    #[command(flatten)]
    exclusive: Exclusive,
    #[arg(
        long,
        value_name = "TRIAL",
        help = "Write nothing: print the [markers] tables that this trial shows, in which both \
                joints move"
    )]
    calibrate: Option<String>,
    /// Ingest one part of the trials: 3/8 is the third of eight.
    #[arg(long, value_name = "PART", value_parser = Part::of_trials)]
    #[arg(requires = "into", conflicts_with_all = ["calibrate", "only"])]
    shard: Option<Part>,
    /// Folder for the tables of a part, 3-of-8 inside of it; `merge` joins them.
    #[arg(long, value_name = "FOLDER", requires = "shard")]
    into: Option<PathBuf>,
}

impl Ingest {
    pub(super) fn run(self, mut context: Context) -> Result<Outcome, Failure> {
        let (only, wait) = (self.folders.only, self.exclusive.wait);
        self.folders.configure(&mut context.config.paths);
        context.check_assumed(build::check_unconfigured)?;
        if let Some(trial) = self.calibrate {
            return calibrate::run(&context, &trial);
        }
        if let Some((part, shards)) = self.shard.zip(self.into) {
            let (ingested, home) = context.watched(|watch| {
                build::ingest_shard(&context.config, part, &shards, wait, watch)
            })?;
            say!("{}; {part} in {}", pipeline::in_words(&ingested.trials), home.display());
            return Ok(judge(&context, &ingested));
        }
        let ingested =
            context.watched(|watch| build::ingest(&context.config, only, wait, watch))?;
        pipeline::print_parameters(&ingested.parameters);
        Ok(say_ingested(&context, &ingested))
    }
}

/// Says what was ingested.
pub(super) fn say_ingested(context: &Context, ingested: &Ingested) -> Outcome {
    let derived = context.config.paths.derived.display();
    say!("{}; tables in {derived}", pipeline::in_words(&ingested.trials));
    judge(context, ingested)
}

/// Says which trials need a person, and whether any does.
pub(super) fn judge(context: &Context, ingested: &Ingested) -> Outcome {
    pipeline::note_together(ingested);
    pipeline::say_attention(context, &ingested.trials, None);
    Outcome::well_if(!ingested.needs_a_person())
}

/// Fit every model of every campaign to the trials.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/fit.txt").trim_end())]
pub(super) struct Fit {
    #[command(flatten)]
    exclusive: Exclusive,
    /// Fit only some replicates of the bootstrap: 0..500 are the first 500.
    #[arg(long, value_name = "FROM..TO", value_parser = Part::of_replicates, requires = "into")]
    #[arg(group = "elsewhere")]
    replicates: Option<Part>,
    /// Fit the trials of a table that was made elsewhere, CSV or Parquet, instead of the ingested
    /// ones: it needs campaign, omega_rad_s and d_m or v_m_s, and may have any other column of
    /// trials.parquet.
    #[arg(long, value_name = "TABLE", requires = "into", group = "elsewhere")]
    trials: Option<PathBuf>,
    /// Folder for the tables: of a table made elsewhere, any but the one of ingested trials; of
    /// replicates, replicates-0-500 inside of it, which `merge` joins.
    #[arg(long, value_name = "FOLDER", requires = "elsewhere")]
    into: Option<PathBuf>,
}

impl Fit {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        let wait = self.exclusive.wait;
        if let Some((table, home)) = self.trials.zip(self.into.as_ref()) {
            let (_, fitted) = context.watched(|watch| {
                build::fit_own_table(&context.config, &table, home, wait, watch)
            })?;
            return Ok(say_fitted_own(&fitted, home));
        }
        context.check_assumed(build::check_unconfigured_tables)?;
        if let Some((part, shards)) = self.replicates.zip(self.into) {
            let (count, home) = context
                .watched(|watch| build::fit_shard(&context.config, part, &shards, wait, watch))?;
            say!("{count} replicates of all models; {part} in {}", home.display());
            return Ok(Outcome::Well);
        }
        let fitted = context.watched(|watch| build::fit(&context.config, wait, watch))?;
        say_fitted(&context, &fitted)
    }
}

/// Says what was fitted to a table that was made elsewhere, and where there are no intervals.
fn say_fitted_own(fitted: &Fitted, home: &Path) -> Outcome {
    pipeline::print_fitted(fitted);
    for FitRow { campaign, model, no_interval, .. } in &fitted.fits {
        if let Some(why) = no_interval {
            note!("{campaign} {model}: no confidence limits, because {why}");
        }
    }
    say!("tables in {}", home.display());
    Outcome::well_if(fitted.fits.iter().all(|fit| fit.status.is_ok()))
}

/// Says what was fitted.
pub(super) fn say_fitted(context: &Context, fitted: &Fitted) -> Result<Outcome, Failure> {
    let ingested = build::ingested(&context.config)?;
    pipeline::print_fitted(fitted);
    Ok(judge(context, &ingested))
}

/// Draw the figures and write the page.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/report.txt").trim_end())]
pub(super) struct Report {
    #[arg(
        long,
        value_name = "NAME",
        num_args = 1..,
        help = "Make the pages of these trials, too, where there are more than `trial_pages` of \
                the configuration; later runs keep them up to date"
    )]
    trial: Vec<String>,
    #[command(flatten)]
    exclusive: Exclusive,
}

impl Report {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        context.check_assumed(build::check_unconfigured_tables)?;
        let wait = self.exclusive.wait;
        let reported =
            context.watched(|watch| build::report(&context.config, &self.trial, wait, watch))?;
        pipeline::say_missing(&context, &reported, false);
        say!("page: {}", reported.page.display());
        Ok(Outcome::well_if(reported.damaged.is_empty()))
    }
}
