//! `trilink config`.

use std::collections::BTreeMap;
use std::path::Path;

use trilink_tables::config::{CONFIG_FILE, Config};
use trilink_tables::trial::{ListedTrial, TrialFolders};

use super::output::{say, write_json};
use super::{Context, Failure, Outcome};

/// Keys and values of at most so many characters stand beside where they come from in one column.
const COLUMN: usize = 60;

/// Look into the configuration: its values and where they come from, and what is wrong.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/config.txt").trim_end())]
pub(super) struct ConfigCommand {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Print the value of every key and where it comes from, as TOML.
    Show(Show),
    /// Say what the configuration amounts to, and what is wrong with it and the lists of trials.
    Check,
}

#[derive(clap::Args)]
struct Show {
    /// Keys or the tables that they stand in, such as fit or robot.kinematic [default: all].
    #[arg(value_name = "KEY")]
    keys: Vec<String>,
    /// Those alone that the configuration file says.
    #[arg(long)]
    own: bool,
    /// Print one JSON array: an object per key; `line` is null where the default counts.
    #[arg(long)]
    json: bool,
}

impl ConfigCommand {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        match self.command {
            Command::Show(show) => show.run(&context.file),
            Command::Check => check(&context, &context.file),
        }
    }
}

/// The text of the file, if there is one.
fn text_of(file: &Path) -> Result<String, Failure> {
    match file.exists() {
        true => Ok(trilink_base::files::read_text(file)?),
        false => Ok(String::new()),
    }
}

impl Show {
    fn run(self, file: &Path) -> Result<Outcome, Failure> {
        let settings = Config::settings(&text_of(file)?)?;
        let is_below = |key: &str, table: &str| {
            key.strip_prefix(table).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        let unknown = |key: &&String| !settings.iter().any(|of| is_below(&of.key, key));
        if let Some(key) = self.keys.iter().find(unknown) {
            let known = settings.iter().map(|of| of.key.as_str());
            let hint = trilink_tables::config::did_you_mean(key, known);
            return Err(format!("found `{key}`, needed a key of the configuration{hint}").into());
        }
        let mut shown = settings;
        let is_asked = |of: &str| self.keys.iter().any(|key| is_below(of, key));
        shown.retain(|of| self.keys.is_empty() || is_asked(&of.key));
        shown.retain(|of| !self.own || of.line.is_some());
        if self.json {
            write_json(&shown)?;
            return Ok(Outcome::Well);
        }
        for of in &shown {
            let from = match of.line {
                Some(line) => format!("{}, line {line}", file.display()),
                None => "default".to_owned(),
            };
            say!("{:COLUMN$}  # {from}", format!("{} = {}", of.key, of.value));
        }
        Ok(Outcome::Well)
    }
}

fn check(context: &Context, file: &Path) -> Result<Outcome, Failure> {
    let config = &context.config;
    let settings = Config::settings(&text_of(file)?)?;
    let own = settings.iter().filter(|of| of.line.is_some()).count();
    match file.exists() {
        true => say!("{}: valid, with {own} keys of its own", file.display()),
        false => say!("no {CONFIG_FILE} here: every key has its default"),
    }
    let found = TrialFolders::load(&config.paths);
    let mut by_campaign: BTreeMap<&str, usize> = BTreeMap::new();
    for ListedTrial { trial, .. } in found.iter().flat_map(|found| &found.trials) {
        let name = trial.campaign.as_deref().unwrap_or_default();
        *by_campaign.entry(name).or_default() += 1;
    }
    for (name, campaign) in &config.campaign {
        let models: Vec<&str> = campaign.models.iter().map(|model| model.name()).collect();
        let trials = by_campaign.get(name.as_str()).copied().unwrap_or(0);
        say!(
            "campaign {name}: robot {}, gait {}, {trials} trials; models {}",
            campaign.robot,
            campaign.gait,
            models.join(", ")
        );
    }
    let found = found?;
    found.ignored().iter().for_each(|sentence| say!("{sentence}"));
    let TrialFolders { folders, trials } = found;
    let mut wrong = 0;
    for ListedTrial { folder, trial, .. } in &trials {
        let path = &folders[*folder].path;
        let missing = || format!("trial `{}`: {} is not there", trial.id, trial.file);
        let is_missing = !path.join(&trial.file).exists();
        let problem = trial.check(config).err().map(|error| error.to_string());
        if let Some(problem) = problem.or_else(|| is_missing.then(missing)) {
            say!("{}: {problem}", path.display());
            wrong += 1;
        }
    }
    say!("{} folders, {} trials, {wrong} that cannot be processed", folders.len(), trials.len());
    Ok(Outcome::well_if(wrong == 0))
}
