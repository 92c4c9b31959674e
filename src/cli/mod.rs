//! The command line, one file per subcommand. Results go to standard output, progress and
//! messages to standard error.

mod calibrate;
mod check;
mod compare;
mod inspect;
mod omegas;
mod output;
mod parameters;
mod pipeline;
mod progress;
mod simulate;
mod stages;
mod synth;
mod table;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::config::{Config, ConfigError};
use output::note;
use progress::Progress;

/// The configuration file that is used when none is named.
const CONFIG_FILE: &str = "pipeline.toml";
/// More threads than this take longer to start than they could save.
const MOST_THREADS: usize = 1024;

/// From marker files of a wheeled three-link robot to fitted dissipation models and figures.
#[derive(Parser)]
#[command(version, propagate_version = true, max_term_width = 100)]
struct Arguments {
    /// Configuration file [default: pipeline.toml here, else the paper's values].
    #[arg(short, long, global = true, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Say nothing but results and errors.
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Threads to work with [default: all processors].
    #[arg(long, global = true, value_name = "N")]
    threads: Option<usize>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Make the demo's trials if they are not there, then run them.
    Demo(pipeline::Demo),
    /// Ingest, fit and report a trial folder.
    Run(pipeline::Run),
    /// Marker files to tables of poses, wheel velocities, cycles and trials.
    Ingest(stages::Ingest),
    /// Fit every model of every campaign to the trials.
    Fit(stages::Fit),
    /// Draw the figures and write the page.
    Report(stages::Report),
    /// Read a trial folder or marker files, write nothing, say what is there and what is wrong.
    Check(check::Check),
    /// Compare the tables with those of an earlier run: what differs by more than noise.
    Compare(compare::Compare),
    /// Look into a table of `derived`, or into any Parquet file.
    Inspect(inspect::Inspect),
    /// Solve for a model's steady motion.
    Simulate(simulate::Simulate),
    /// Write trials with a known truth, as the camera system would.
    Synth(synth::Synth),
}

/// How a command ended: what its exit status says.
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
    progress: Progress,
}

/// Runs the program and gives its exit status.
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let default_hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        // A damaged table is reported as an error of its file.
        if !crate::store::is_reading() {
            default_hook(panic);
        }
    }));
    match run(arguments) {
        Ok(Outcome::Well) => ExitCode::SUCCESS,
        Ok(Outcome::NeedsAttention) => ExitCode::from(1),
        Err(failure) => {
            note!("error: {failure}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: Arguments) -> Result<Outcome, Failure> {
    if let Some(threads) = arguments.threads {
        if !(1..=MOST_THREADS).contains(&threads) {
            return Err(format!("--threads: found {threads}, needed 1 to {MOST_THREADS}").into());
        }
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
    }
    let config = load(arguments.config.as_deref())?;
    let context = Context { config, progress: Progress::new(arguments.quiet) };
    match arguments.command {
        Command::Demo(command) => command.run(context),
        Command::Run(command) => command.run(context),
        Command::Ingest(command) => command.run(context),
        Command::Fit(command) => command.run(context),
        Command::Report(command) => command.run(context),
        Command::Check(command) => command.run(context),
        Command::Compare(command) => command.run(context),
        Command::Inspect(command) => command.run(context),
        Command::Simulate(command) => command.run(context),
        Command::Synth(command) => command.run(context),
    }
}

fn load(path: Option<&Path>) -> Result<Config, ConfigError> {
    match path {
        Some(path) => Config::load(path),
        None if Path::new(CONFIG_FILE).exists() => Config::load(Path::new(CONFIG_FILE)),
        None => Ok(Config::default()),
    }
}
