//! The command line, one file per subcommand. Results go to standard output, progress and
//! messages to standard error.

mod branches;
mod calibrate;
mod check;
mod compare;
mod config;
mod design;
mod explain;
mod export;
mod fitted;
mod init;
mod inspect;
mod log;
mod merge;
mod omegas;
mod optimise;
mod output;
mod pipeline;
mod progress;
mod rows_file;
mod shell;
mod simulate;
mod stages;
mod synth;
mod table;
#[cfg(test)]
mod tests;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::build::RunError;
use crate::interrupt;
use output::note;
use progress::Progress;
pub use progress::watch;
use trilink_base::cancel::Cancelled;
use trilink_fit::design::AdviceError;
use trilink_tables::config::{CONFIG_FILE, Config, Paths};

/// More threads than this take longer to start than they could save.
const MOST_THREADS: usize = 1024;

/// From marker files of a wheeled three-link robot to fitted dissipation models and figures.
#[derive(Parser)]
#[command(name = "trilink", version, propagate_version = true, max_term_width = 100)]
#[command(after_help = include_str!("examples/trilink.txt").trim_end())]
struct Arguments {
    #[command(flatten)]
    options: Options,
    #[command(subcommand)]
    command: Command,
}

/// What every command takes.
#[derive(clap::Args)]
struct Options {
    /// Configuration file [default: pipeline.toml here, else the paper's values].
    #[arg(short, long, global = true, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Say nothing but results and errors.
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Threads to work with [default: all processors].
    #[arg(long, global = true, value_name = "N")]
    threads: Option<usize>,
    /// Add what happens, with the time, to the end of a file.
    #[arg(long, global = true, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Say what happens: stages with their times; -vv also every trial and fit.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
}

#[derive(Subcommand)]
enum Command {
    /// Make the demo's trials if they are not there, then run them.
    #[command(after_help = include_str!("examples/demo.txt").trim_end())]
    Demo(pipeline::Demo),
    /// Write a first pipeline.toml and trials.toml from marker files alone.
    #[command(after_help = include_str!("examples/init.txt").trim_end())]
    Init(init::Init),
    /// Ingest, fit and report trial folders.
    #[command(after_help = include_str!("examples/run.txt").trim_end())]
    Run(pipeline::Run),
    /// Marker files to tables of poses, wheel velocities, cycles and trials.
    #[command(after_help = include_str!("examples/ingest.txt").trim_end())]
    Ingest(stages::Ingest),
    /// Join the parts of an ingest or bootstrap into the tables that an undivided one leaves.
    #[command(after_help = include_str!("examples/merge.txt").trim_end())]
    Merge(merge::Merge),
    /// Fit every model of every campaign to the trials.
    #[command(after_help = include_str!("examples/fit.txt").trim_end())]
    Fit(stages::Fit),
    /// Draw the figures and write the page.
    #[command(after_help = include_str!("examples/report.txt").trim_end())]
    Report(stages::Report),
    /// Read trial folders or marker files, write nothing, say what is there and what is wrong.
    #[command(after_help = include_str!("examples/check.txt").trim_end())]
    Check(check::Check),
    /// Look into the configuration: its values and where they come from, and what is wrong.
    #[command(after_help = include_str!("examples/config.txt").trim_end())]
    Config(config::ConfigCommand),
    /// Say what a check looks at, why that matters and what to do.
    #[command(after_help = include_str!("examples/explain.txt").trim_end())]
    Explain(explain::Explain),
    /// Compare the tables with those of an earlier run: what differs by more than noise.
    #[command(after_help = include_str!("examples/compare.txt").trim_end())]
    Compare(compare::Compare),
    /// Look into a table of `derived`, or into any Parquet file.
    #[command(after_help = include_str!("examples/inspect.txt").trim_end())]
    Inspect(inspect::Inspect),
    /// Write a trial's markers and poses for OpenSim, for Foxglove or Rerun, or as a table; or the fits as
    /// PEtab.
    #[command(after_help = include_str!("examples/export.txt").trim_end())]
    Export(export::Export),
    /// Solve for a model's steady motion.
    #[command(after_help = include_str!("examples/simulate.txt").trim_end())]
    Simulate(simulate::Simulate),
    /// Follow a model's steady motions over a parameter: folds, lost symmetry, doubled periods.
    #[command(after_help = include_str!("examples/branches.txt").trim_end())]
    Branches(branches::Branches),
    /// Search for the gait with which a model's robot goes farthest, fastest or with least work.
    #[command(after_help = include_str!("examples/optimise.txt").trim_end())]
    Optimise(optimise::Optimise),
    /// Advise which trials to make next: for the coefficients, for a prediction, or to tell two models apart.
    #[command(after_help = include_str!("examples/design.txt").trim_end())]
    Design(design::Design),
    /// Write trials with a known truth, as the camera system would.
    #[command(after_help = include_str!("examples/synth.txt").trim_end())]
    Synth(synth::Synth),
    /// Print what makes a shell complete commands and options.
    #[command(after_help = include_str!("examples/completions.txt").trim_end())]
    Completions(shell::Completions),
    /// Print the manual's page.
    #[command(after_help = include_str!("examples/man.txt").trim_end())]
    Man(shell::Man),
}

/// What to do when another run is busy with the same folder of results.
#[derive(clap::Args)]
struct Exclusive {
    /// Wait for another run on the same folder of results, instead of giving up.
    #[arg(long)]
    wait: bool,
}

/// Trial folders instead of the configured ones.
#[derive(clap::Args)]
struct Folders {
    /// Trial folders, or patterns of them in quotes [default: `paths.raw` of the configuration].
    #[arg(value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// Remove the trials of all other folders, which otherwise stay.
    #[arg(long)]
    only: bool,
}

impl Folders {
    fn configure(self, paths: &mut Paths) {
        if !self.folders.is_empty() {
            paths.raw = self.folders;
        }
    }
}

/// How a command ended, as its exit status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    /// All well: 0.
    Well,
    /// Finished, but something needs a person: 1.
    NeedsAttention,
}

/// Nothing could be done: exit status 2.
type Failure = Box<dyn std::error::Error>;

/// What every subcommand starts from.
struct Context {
    config: Config,
    /// Whether the configuration is a file's. Else nobody has said that the robots are the paper's.
    is_configured: bool,
    progress: Progress,
}

impl Context {
    /// Without a configuration file: says what is assumed, if `check` finds that it may be so.
    fn check_assumed(
        &self,
        check: impl Fn(&Config) -> Result<(), RunError>,
    ) -> Result<(), RunError> {
        if !self.is_configured {
            check(&self.config)?;
            self.say_assumed();
        }
        Ok(())
    }

    fn say_assumed(&self) {
        if !self.is_configured {
            let assumed = "the paper's robots, gaits, campaigns and markers are assumed";
            self.progress.say(&format!("no {CONFIG_FILE} here: {assumed}"));
        }
    }
}

/// Runs the program and gives its exit status.
pub fn main() -> ExitCode {
    main_with(std::env::args_os().collect()).into()
}

/// Runs the program with a command line, the first of which is its name, and gives its exit status.
pub fn main_with(line: Vec<OsString>) -> u8 {
    if let Some(argument) = line.iter().find(|argument| argument.to_str().is_none()) {
        let needed = "needed UTF-8, as tables and pages have it";
        note!("error: argument `{}`: found bytes that are no UTF-8, {needed}", argument.display());
        return 2;
    }
    let arguments = Arguments::try_parse_from(&line).unwrap_or_else(|error| error.exit());
    trilink_tables::hush_damaged_tables();
    let status = match run(arguments, &line) {
        Ok(Outcome::Well) => 0,
        Ok(Outcome::NeedsAttention) => 1,
        Err(failure) => {
            let is_run = matches!(failure.downcast_ref(), Some(RunError::Interrupted { .. }));
            // A cancelled command is no error.
            match is_cancelled(&failure) {
                true => note!("{failure}"),
                false => note!("error: {failure}"),
            }
            tracing::error!("{failure}");
            // An interrupted command has the signal's status.
            let is_interrupted = is_run || is_cancelled(&failure);
            interrupt::exit_status().filter(|_| is_interrupted).unwrap_or(2)
        }
    };
    tracing::info!(status, "end");
    status
}

/// A command was cancelled after some of its steps.
#[derive(Debug, thiserror::Error)]
#[error("interrupted after {done}")]
struct Interrupted {
    /// Such as `12 of 42 trials`.
    done: String,
}

fn is_cancelled(failure: &Failure) -> bool {
    failure.is::<Interrupted>()
        || failure.is::<Cancelled>()
        || matches!(failure.downcast_ref(), Some(RunError::Stopped(_)))
        || matches!(failure.downcast_ref(), Some(AdviceError::Cancelled(_)))
}

fn run(arguments: Arguments, line: &[OsString]) -> Result<Outcome, Failure> {
    let Arguments { options, command } = arguments;
    let context = || options.begin(line);
    match command {
        Command::Demo(command) => command.run(context()?),
        // What it writes is the configuration.
        Command::Init(command) => command.run(options.listen(line)?),
        Command::Run(command) => command.run(context()?),
        Command::Ingest(command) => command.run(context()?),
        Command::Merge(command) => command.run(context()?),
        Command::Fit(command) => command.run(&context()?),
        Command::Report(command) => command.run(&context()?),
        Command::Check(command) => command.run(context()?),
        Command::Config(command) => command.run(&context()?, options.config.as_deref()),
        Command::Compare(command) => command.run(context()?),
        Command::Inspect(command) => command.run(context()?),
        Command::Export(command) => command.run(&context()?),
        Command::Simulate(command) => command.run(context()?),
        Command::Branches(command) => command.run(context()?),
        Command::Optimise(command) => command.run(context()?),
        Command::Design(command) => command.run(&context()?),
        Command::Synth(command) => command.run(context()?),
        // These need no configuration.
        Command::Explain(command) => command.run(),
        Command::Completions(command) => command.run(),
        Command::Man(command) => command.run(),
    }
}

impl Options {
    /// [`Options::listen`], and reads the configuration.
    fn begin(&self, line: &[OsString]) -> Result<Context, Failure> {
        let progress = self.listen(line)?;
        let config = Config::load_or_default(self.config.as_deref())?;
        let is_configured = Config::file(self.config.as_deref()).is_some();
        Ok(Context { config, is_configured, progress })
    }

    /// Listens to signals, opens the log and starts the threads.
    fn listen(&self, line: &[OsString]) -> Result<Progress, Failure> {
        interrupt::listen()?;
        log::begin(self.log.as_deref(), self.verbose)?;
        if let Some(threads) = self.threads {
            if !(1..=MOST_THREADS).contains(&threads) {
                let needed = format!("needed 1 to {MOST_THREADS}");
                return Err(format!("--threads: found {threads}, {needed}").into());
            }
            rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
        }
        let line: Vec<&str> =
            line.iter().skip(1).filter_map(|argument| argument.to_str()).collect();
        tracing::info!(
            version = env!("CARGO_PKG_VERSION"),
            arguments = line.join(" "),
            config = %self.config.as_deref().unwrap_or(Path::new(CONFIG_FILE)).display(),
            "begin"
        );
        Ok(Progress::new(self.quiet, self.verbose > 0))
    }
}
