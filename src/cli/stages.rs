//! `trilink ingest`, `fit` and `report`: single stages.

use std::path::{Path, PathBuf};

use serde_json::json;
use trilink_fit::Fitted;
use trilink_ingest::Ingested;
use trilink_report::Reported;
use trilink_tables::FitRow;

use super::output::{note, print, say, to_caller};
use super::{Context, Exclusive, Failure, Folders, Outcome, calibrate, candidates, pipeline};
use crate::build::{self, Shard};

/// Process marker files into tables of poses, wheel velocities, cycles and trials.
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
        help = "Write nothing; estimate the marker layout from this trial, in which all joints must move, and \
                print it"
    )]
    calibrate: Option<String>,
    /// Ingest one shard of the trials: 3/8 is the third of eight.
    #[arg(long, value_name = "SHARD", value_parser = Shard::parse_trials)]
    #[arg(requires = "into", conflicts_with_all = ["calibrate", "only"])]
    shard: Option<Shard>,
    /// Parent folder of the shards: this shard is written to a subfolder such as 3-of-8; `merge` joins the shards.
    #[arg(long, value_name = "FOLDER", requires = "shard")]
    into: Option<PathBuf>,
}

impl Ingest {
    pub(super) fn run(self, mut context: Context) -> Result<Outcome, Failure> {
        let only = self.folders.only;
        let wait = self.exclusive.wait;
        self.folders.configure(&mut context.config.paths);
        context.check_assumed(build::check_unconfigured)?;
        if let Some(trial) = self.calibrate {
            return calibrate::run(&context, &trial);
        }
        if let Some((shard, shards)) = self.shard.zip(self.into) {
            let (ingested, home) = context.watched(|watch| {
                build::ingest_shard(&context.config, shard, &shards, wait, watch)
            })?;
            let outcome = judge(&context, &ingested);
            let tables = format!("; {shard} in {}", home.display());
            print(pipeline::in_words(&ingested.trials) + tables);
            return Ok(outcome);
        }
        let ingested =
            context.watched(|watch| build::ingest(&context.config, only, wait, watch))?;
        pipeline::print_parameters(&context, &ingested.parameters);
        Ok(say_ingested(&context, &ingested))
    }
}

/// Prints a summary of the ingested trials.
pub(super) fn say_ingested(context: &Context, ingested: &Ingested) -> Outcome {
    let outcome = judge(context, ingested);
    let tables = format!("; tables in {}", context.config.paths.derived.display());
    print(pipeline::in_words(&ingested.trials) + tables);
    outcome
}

/// Prints which trials need attention; returns [`Outcome::NeedsAttention`] if there are any.
pub(super) fn judge(context: &Context, ingested: &Ingested) -> Outcome {
    pipeline::note_together(context, ingested);
    pipeline::say_attention(context, &ingested.trials, None, false);
    Outcome::well_if(!ingested.needs_a_person())
}

/// Fit every model of every campaign to the trials.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/fit.txt").trim_end())]
pub(super) struct Fit {
    #[command(flatten)]
    exclusive: Exclusive,
    /// Compute only some bootstrap replicates: 0..500 are the first 500.
    #[arg(long, value_name = "FROM..TO", value_parser = Shard::parse_replicates, requires = "into")]
    #[arg(group = "elsewhere")]
    replicates: Option<Shard>,
    /// Fit the trials of a CSV or Parquet table from another program instead of the ingested trials. The table must
    /// have the columns campaign, omega_rad_s and d_m or v_m_s, and may have any other column of trials.parquet.
    #[arg(long, value_name = "TABLE", requires = "into", group = "elsewhere")]
    trials: Option<PathBuf>,
    /// Folder for the tables: with `--trials`, any folder except that of the ingested trials; with `--replicates`, the
    /// parent folder of the shards, whose subfolders (such as replicates-0-500) `merge` joins.
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
            return Ok(say_fitted_own(&context, &fitted, home));
        }
        context.check_assumed(build::check_unconfigured_tables)?;
        if let Some((shard, shards)) = self.replicates.zip(self.into) {
            let (count, home) = context
                .watched(|watch| build::fit_shard(&context.config, shard, &shards, wait, watch))?;
            say!("{count} replicates of all models; {shard} in {}", home.display());
            return Ok(Outcome::Well);
        }
        let fitted = context.watched(|watch| build::fit(&context.config, wait, watch))?;
        say_fitted(&context, &fitted)
    }
}

/// Prints the results of the fits to trials from another program, and why some fits have no confidence limits.
fn say_fitted_own(context: &Context, fitted: &Fitted, home: &Path) -> Outcome {
    pipeline::print_fitted(context, fitted);
    for FitRow { campaign, model, no_interval, .. } in &fitted.fits {
        if let Some(why) = no_interval {
            note!("{campaign} {model}: no confidence limits, because {why}");
        }
    }
    say!("tables in {}", home.display());
    Outcome::well_if(fitted.fits.iter().all(|fit| fit.status.is_ok()))
}

/// Prints the results of the fits, and which trials need attention.
pub(super) fn say_fitted(context: &Context, fitted: &Fitted) -> Result<Outcome, Failure> {
    let ingested = build::ingested(&context.config)?;
    pipeline::print_fitted(context, fitted);
    Ok(judge(context, &ingested))
}

/// Draw the figures and write the report page.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/report.txt").trim_end())]
pub(super) struct Report {
    #[arg(
        long,
        value_name = "NAME",
        num_args = 1..,
        add = candidates::trials(),
        help = "Also make pages for these trials if there are more trials than the configuration's `trial_pages`; \
                later runs keep these pages up to date"
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
        let Reported { page, figures, missing, .. } = &reported;
        let results = json!({ "page": page, "figures": figures, "missing": missing });
        to_caller(|returned| returned.json = results.to_string());
        pipeline::say_missing(&context, &reported, false);
        say!("page: {}", reported.page.display());
        Ok(Outcome::well_if(reported.damaged.is_empty()))
    }
}
