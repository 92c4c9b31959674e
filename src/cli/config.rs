//! `trilink config`.

use std::collections::BTreeMap;
use std::path::Path;

use trilink_tables::config::{CONFIG_FILE, Campaign, Config, RobotConfig};
use trilink_tables::trial::{ListedTrial, TrialFolders};

use super::output::{say, write_json};
use super::{Context, Failure, Outcome};

/// Width, in characters, of the printed column with keys and values; the next column says where a value is set.
const COLUMN: usize = 60;

/// Show the configuration and where its values are set, or check it.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/config.txt").trim_end())]
pub(super) struct ConfigCommand {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    /// Print the value of every key and where it is set, as TOML.
    Show(Show),
    /// Summarise the configuration, and check it and the lists of trials.
    Check,
}

#[derive(clap::Args)]
struct Show {
    /// Keys or tables, such as fit or robot.kinematic [default: all].
    #[arg(value_name = "KEY")]
    keys: Vec<String>,
    /// Show only the keys that the configuration file sets.
    #[arg(long)]
    own: bool,
    /// Print one JSON array: an object per key; `line` is null for defaults.
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

/// Reads a file; a missing file counts as empty.
fn read_if_there(file: &Path) -> Result<String, Failure> {
    if file.exists() { Ok(trilink_base::files::read_text(file)?) } else { Ok(String::new()) }
}

/// Whether a key is the given table or lies in it.
fn is_below(key: &str, table: &str) -> bool {
    key.strip_prefix(table).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

impl Show {
    fn run(self, file: &Path) -> Result<Outcome, Failure> {
        let settings = Config::settings(&read_if_there(file)?)?;
        let mut keys = self.keys.iter();
        if let Some(key) = keys.find(|key| !settings.iter().any(|set| is_below(&set.key, key))) {
            let known = settings.iter().map(|set| set.key.as_str());
            let hint = trilink_tables::config::did_you_mean(key, known);
            return Err(format!("found `{key}`, needed a key of the configuration{hint}").into());
        }
        let mut shown = settings;
        shown.retain(|set| {
            self.keys.is_empty() || self.keys.iter().any(|key| is_below(&set.key, key))
        });
        shown.retain(|set| !self.own || set.line.is_some());
        if self.json {
            write_json(&shown)?;
            return Ok(Outcome::Well);
        }
        for set in &shown {
            let source = match set.line {
                Some(line) => format!("line {line}"),
                None => "default".to_owned(),
            };
            say!("{:COLUMN$}  # {source}", format!("{} = {}", set.key, set.value));
        }
        Ok(Outcome::Well)
    }
}

/// Prints a summary of the configuration, and any problems in the lists of trials.
fn check(context: &Context, file: &Path) -> Result<Outcome, Failure> {
    let config = &context.config;
    let settings = Config::settings(&read_if_there(file)?)?;
    if file.exists() {
        let own = settings.iter().filter(|set| set.line.is_some()).count();
        say!("{}: valid; sets {own} keys", file.display());
    } else {
        say!("no {CONFIG_FILE} in the current folder: every key has its default");
    }
    let found = TrialFolders::load(&config.paths);
    let mut by_campaign: BTreeMap<&str, usize> = BTreeMap::new();
    for ListedTrial { trial, .. } in found.iter().flat_map(|found| &found.trials) {
        let name = trial.campaign.as_deref().unwrap_or_default();
        *by_campaign.entry(name).or_default() += 1;
    }
    for (name, Campaign { robot, gait, models, .. }) in &config.campaign {
        let chain = config.robot.get(robot).and_then(RobotConfig::chain);
        let links = chain
            .map_or(String::new(), |chain| format!(" (a chain of {} links)", chain.links.len()));
        let trials = by_campaign.get(name.as_str()).copied().unwrap_or(0);
        let models: Vec<&str> = models.iter().map(|model| model.name()).collect();
        let models = models.join(", ");
        say!(
            "campaign {name}: robot {robot}{links}, gait {gait}, {trials} trials; models {models}"
        );
    }
    let found = found?;
    found.ignored_sentence().iter().for_each(|sentence| say!("{sentence}"));
    let TrialFolders { folders, trials, .. } = found;
    let mut wrong = 0;
    for ListedTrial { folder, trial, .. } in &trials {
        let path = &folders[*folder].path;
        let mut problem = trial.check(config).err().map(|error| error.to_string());
        if problem.is_none() && !path.join(&trial.file).exists() {
            problem = Some(format!("trial `{}`: {} does not exist", trial.id, trial.file));
        }
        if let Some(problem) = problem {
            say!("{}: {problem}", path.display());
            wrong += 1;
        }
    }
    let in_folders = match folders.len() {
        1 => "1 folder".to_owned(),
        count => format!("{count} folders"),
    };
    match wrong {
        0 => say!("{} trials in {in_folders}, all readable", trials.len()),
        _ => say!("{} trials in {in_folders}, of which {wrong} cannot be processed", trials.len()),
    }
    Ok(Outcome::well_if(wrong == 0))
}
