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
mod init;
mod inspect;
mod log;
mod merge;
mod optimise;
mod output;
mod parse;
mod pipeline;
mod progress;
mod results;
mod setup;
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
pub use progress::watch;
use progress::{Progress, Watcher};
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

/// The program's commands, each an entry with its type, whose documentation and examples are its help. Help, completions
/// and manual follow; what `run` asks for says what is begun before it.
macro_rules! commands {
    ($($name:ident($command:ty),)*) => {
        #[derive(Subcommand)]
        enum Command {
            $($name($command),)*
        }

        impl Command {
            fn run(self, options: &Options, line: &[OsString]) -> Result<Outcome, Failure> {
                match self {
                    $(Self::$name(command) => command.run(Begin::begin(options, line)?),)*
                }
            }
        }
    };
}

commands! {
    Demo(pipeline::Demo),
    Init(init::Init),
    Run(pipeline::Run),
    Ingest(stages::Ingest),
    Merge(merge::Merge),
    Fit(stages::Fit),
    Report(stages::Report),
    Check(check::Check),
    Config(config::ConfigCommand),
    Explain(explain::Explain),
    Compare(compare::Compare),
    Inspect(inspect::Inspect),
    Export(export::Export),
    Simulate(simulate::Simulate),
    Branches(branches::Branches),
    Optimise(optimise::Optimise),
    Design(design::Design),
    Synth(synth::Synth),
    Completions(shell::Completions),
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

impl Outcome {
    fn well_if(is_well: bool) -> Self {
        if is_well { Self::Well } else { Self::NeedsAttention }
    }
}

/// Nothing could be done: exit status 2.
type Failure = Box<dyn std::error::Error>;

/// What a command starts from.
trait Begin: Sized {
    fn begin(options: &Options, line: &[OsString]) -> Result<Self, Failure>;
}

/// What needs neither a configuration nor time.
impl Begin for () {
    fn begin(_: &Options, _: &[OsString]) -> Result<Self, Failure> {
        Ok(())
    }
}

/// Listens to signals, opens the log and starts the threads.
impl Begin for Progress {
    fn begin(options: &Options, line: &[OsString]) -> Result<Self, Failure> {
        interrupt::listen()?;
        log::begin(options.log.as_deref(), options.verbose)?;
        if let Some(threads) = options.threads {
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
            config = %options.config.as_deref().unwrap_or(Path::new(CONFIG_FILE)).display(),
            "begin"
        );
        Ok(Self::new(options.quiet, options.verbose > 0))
    }
}

/// The same with the configuration.
struct Context {
    config: Config,
    /// The file that the command line names, or the one that is looked for.
    file: PathBuf,
    /// Whether the configuration is a file's. Else nobody has said that the robots are the paper's.
    is_configured: bool,
    progress: Progress,
}

impl Begin for Context {
    fn begin(options: &Options, line: &[OsString]) -> Result<Self, Failure> {
        let progress = Progress::begin(options, line)?;
        let file = options.config.as_deref();
        let (config, is_configured) =
            (Config::load_or_default(file)?, Config::file(file).is_some());
        let file = file.unwrap_or(Path::new(CONFIG_FILE)).to_owned();
        Ok(Self { config, file, is_configured, progress })
    }
}

impl Context {
    /// Without a configuration file: says what is assumed, if `check` finds that it may be so.
    fn check_assumed(
        &self,
        check: impl Fn(&Config) -> Result<(), RunError>,
    ) -> Result<(), RunError> {
        if !self.is_configured {
            check(&self.config)?;
            let assumed = "the paper's robots, gaits, campaigns and markers are assumed";
            self.say(&format!("no {CONFIG_FILE} here: {assumed}"));
        }
        Ok(())
    }

    /// A message beside the results.
    fn say(&self, message: &str) {
        self.progress.say(message);
    }

    /// What long work gives, with its stages shown meanwhile.
    fn watched<T>(&self, work: impl FnOnce(&Watcher) -> T) -> T {
        work(&self.progress.watch(false))
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
    let status = match arguments.command.run(&arguments.options, &line) {
        Ok(Outcome::Well) => 0,
        Ok(Outcome::NeedsAttention) => 1,
        Err(failure) => {
            // A cancelled command is no error.
            let is_cancelled = is_cancelled(&failure);
            note!("{}{failure}", if is_cancelled { "" } else { "error: " });
            tracing::error!("{failure}");
            // An interrupted command has the signal's status.
            let is_run = matches!(failure.downcast_ref(), Some(RunError::Interrupted { .. }));
            interrupt::exit_status().filter(|_| is_run || is_cancelled).unwrap_or(2)
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
