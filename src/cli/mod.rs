//! Command line, with one file per subcommand. Results go to standard output, progress and messages to standard error.

mod branches;
mod calibrate;
mod call;
mod candidates;
mod check;
mod clean;
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
mod status;
mod synth;
mod table;
mod terminal;
#[cfg(test)]
mod tests;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
use clap_complete::CompleteEnv;

use crate::build::{RunError, check_results};
use crate::interrupt;
pub use call::{CallError, Caller, ErrorKind, call};
pub use output::Returned;
use output::{note, note_error};
pub use progress::Shown;
use progress::{Progress, Watcher};
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_fit::design::AdviceError;
use trilink_tables::config::{CONFIG_FILE, Config, Paths};

/// Maximum number of threads; more would take longer to start than they would save.
const MAX_THREADS: usize = 1024;

/// Fit dissipation models to motion-capture trials of a wheeled three-link robot, and draw figures.
#[derive(Parser)]
#[command(name = "trilink", version, propagate_version = true, max_term_width = 100)]
#[command(after_help = concat!(
    include_str!("examples/trilink.txt"),
    "\nReport problems: ",
    env!("CARGO_PKG_REPOSITORY")
))]
struct Arguments {
    #[command(flatten)]
    options: Options,
    #[command(subcommand)]
    command: Command,
}

/// Options that every command accepts.
#[derive(clap::Args)]
struct Options {
    /// Configuration file [default: pipeline.toml in the current folder; without it, the paper's values].
    #[arg(short, long, global = true, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Print only results and errors.
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Number of threads [default: all processors].
    #[arg(long, global = true, value_name = "N")]
    threads: Option<usize>,
    /// Colours in the output and in messages; the variables NO_COLOR and CLICOLOR_FORCE are respected.
    #[arg(long, global = true, value_name = "WHEN", default_value = "auto")]
    color: clap::ColorChoice,
    /// Append a log with times to a file.
    #[arg(long, global = true, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Log stages and their times to standard error; -vv also logs every trial and fit.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
    /// Program that calls the command as a function; `None` on the command line.
    #[arg(skip)]
    caller: Option<Caller>,
}

/// Declares the commands of the program, each with the type that holds its arguments; the documentation of that type is
/// the help text of the command. The type of the second argument of `run` selects the setup that precedes it (see
/// [`Begin`]).
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
    Status(status::Status),
    Clean(clean::Clean),
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

/// Behaviour if another run uses the same folder of results.
#[derive(clap::Args)]
struct Exclusive {
    /// Wait if another run uses the same folder of results, instead of failing.
    #[arg(long)]
    wait: bool,
}

/// Trial folders given on the command line.
#[derive(clap::Args)]
struct Folders {
    /// Trial folders, or quoted patterns that match trial folders [default: `paths.raw` of the configuration].
    #[arg(value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// Remove the results of trial folders that are not given; without this option, they are retained.
    #[arg(long)]
    only: bool,
}

impl Folders {
    /// Replaces the configured trial folders by those given on the command line, if there are any.
    fn configure(self, paths: &mut Paths) {
        if !self.folders.is_empty() {
            paths.replace_raw(self.folders);
        }
    }
}

/// Outcome of a command, as an exit status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    /// Success: exit status 0.
    Well,
    /// Completed, but something needs attention: exit status 1.
    NeedsAttention,
}

impl Outcome {
    fn well_if(is_well: bool) -> Self {
        if is_well { Self::Well } else { Self::NeedsAttention }
    }
}

/// Error that ends a command: exit status 2.
type Failure = Box<dyn std::error::Error>;

/// Setup needed by a command before it runs.
trait Begin: Sized {
    fn begin(options: &Options, line: &[OsString]) -> Result<Self, Failure>;
}

/// No setup, for commands that need no configuration and finish at once.
impl Begin for () {
    fn begin(_: &Options, _: &[OsString]) -> Result<Self, Failure> {
        Ok(())
    }
}

/// Setup of signal handlers, log and threads.
impl Begin for Progress {
    fn begin(options: &Options, line: &[OsString]) -> Result<Self, Failure> {
        if let Some(Caller { shown, line, cancel }) = options.caller.clone() {
            return Ok(Self { shown, line, cancel });
        }
        interrupt::listen()?;
        log::begin(options.log.as_deref(), options.verbose)?;
        if let Some(threads) = options.threads {
            if !(1..=MAX_THREADS).contains(&threads) {
                return Err(format!("--threads: found {threads}, needed 1 to {MAX_THREADS}").into());
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

/// Configuration of a command, and the output for its progress and messages. [`Begin::begin`] creates a value of this
/// type after setting up signal handlers, the log and the threads.
struct Context {
    config: Config,
    /// Configuration file: the one named on the command line, or `pipeline.toml`.
    file: PathBuf,
    /// Whether a configuration file exists; otherwise the paper's robots are assumed.
    is_configured: bool,
    progress: Progress,
}

impl Begin for Context {
    fn begin(options: &Options, line: &[OsString]) -> Result<Self, Failure> {
        check_not_below_project(options.config.as_deref())?;
        Ok(Anywhere::begin(options, line)?.0)
    }
}

/// Context of a command that can do without the configuration file of a folder above the current one.
struct Anywhere(Context);

impl Begin for Anywhere {
    fn begin(options: &Options, line: &[OsString]) -> Result<Self, Failure> {
        let progress = Progress::begin(options, line)?;
        let file = options.config.as_deref();
        let config = Config::load_or_default(file)?;
        let is_configured = Config::file(file).is_some();
        let file = file.unwrap_or(Path::new(CONFIG_FILE)).to_owned();
        Ok(Self(Context { config, file, is_configured, progress }))
    }
}

/// Checks that the command does not ignore a configuration file that is in a folder above the current one.
fn check_not_below_project(config: Option<&Path>) -> Result<(), Failure> {
    if Config::file(config).is_some() {
        return Ok(());
    }
    let current = std::env::current_dir()?;
    let mut above = PathBuf::new();
    for folder in current.ancestors().skip(1) {
        above.push("..");
        if folder.join(CONFIG_FILE).is_file() {
            let file = above.join(CONFIG_FILE);
            return Err(format!(
                "no {CONFIG_FILE} in the current folder, but one in {}: run the command there, or add -c {}",
                folder.display(),
                file.display()
            )
            .into());
        }
    }
    Ok(())
}

impl Context {
    /// Handles the lack of a configuration file: runs `check` on the default configuration and tells the user what is
    /// assumed. Does nothing if there is a configuration file.
    fn check_assumed(
        &self,
        check: impl Fn(&Config) -> Result<(), RunError>,
    ) -> Result<(), RunError> {
        if !self.is_configured {
            check(&self.config)?;
            let assumed = "the paper's robots, gaits, campaigns and markers are assumed";
            self.say(&format!("no {CONFIG_FILE} in the current folder: {assumed}"));
        }
        Ok(())
    }

    /// Checks that there are results if there is no configuration file.
    fn check_results(&self) -> Result<(), RunError> {
        if self.is_configured { Ok(()) } else { check_results(&self.config) }
    }

    /// Whether `--quiet` is given.
    fn is_quiet(&self) -> bool {
        self.progress.is_quiet()
    }

    /// Prints a message to standard error unless `--quiet` is given.
    fn say(&self, message: &str) {
        self.progress.say(message);
    }

    /// Returns the token that cancels the command.
    fn cancel(&self) -> &CancelToken {
        &self.progress.cancel
    }

    /// Runs long work and shows its progress.
    fn watched<T>(&self, work: impl FnOnce(&Watcher) -> T) -> T {
        work(&self.progress.watch(false))
    }
}

/// Runs the program with the command line of this process; returns its exit status.
pub fn main() -> ExitCode {
    // Prints candidates and exits if a script of `trilink completions` has called the program.
    CompleteEnv::with_factory(Arguments::command).var(candidates::VARIABLE).complete();
    main_with(std::env::args_os().collect()).into()
}

/// Runs the program with a command line, whose first word is the program's name; returns its exit status.
pub fn main_with(line: Vec<OsString>) -> u8 {
    if let Some(argument) = line.iter().find(|argument| argument.to_str().is_none()) {
        let found = "found bytes that are not UTF-8, needed UTF-8";
        note_error(&format!("argument `{}`: {found}", argument.display()));
        return 2;
    }
    terminal::choose_colors(&line);
    let arguments = Arguments::try_parse_from(&line).unwrap_or_else(|error| error.exit());
    trilink_tables::hush_damaged_tables();
    let status = match arguments.command.run(&arguments.options, &line) {
        Ok(Outcome::Well) => 0,
        Ok(Outcome::NeedsAttention) => 1,
        Err(failure) => {
            // Cancellation is not an error.
            let is_cancelled = is_cancelled(&failure);
            if is_cancelled {
                note!("{failure}");
            } else {
                note_error(&failure.to_string());
            }
            tracing::error!("{failure}");
            // An interrupted command exits with the status of its signal.
            let is_run = matches!(failure.downcast_ref(), Some(RunError::Interrupted { .. }));
            interrupt::exit_status().filter(|_| is_run || is_cancelled).unwrap_or(2)
        }
    };
    tracing::info!(status, "end");
    status
}

/// Cancellation of a command after some of its steps.
#[derive(Debug, thiserror::Error)]
#[error("interrupted after {done}")]
struct Interrupted {
    /// Completed steps, such as `12 of 42 trials`.
    done: String,
}

/// Whether a command failed only because it was cancelled.
fn is_cancelled(failure: &Failure) -> bool {
    failure.is::<Interrupted>()
        || failure.is::<Cancelled>()
        || matches!(failure.downcast_ref(), Some(RunError::Stopped(_)))
        || matches!(failure.downcast_ref(), Some(AdviceError::Cancelled(_)))
}
