//! `trilink compare`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::builder::NonEmptyStringValueParser;
use serde_json::Value;
use trilink_tables::clock::utc_now;
use trilink_tables::config::{Config, Paths, Tolerances};
use trilink_tables::{is_there, write_bytes};

use super::output::{note, print, say, write_data};
use super::table::{Table, rounded};
use super::terminal::{Text, Tone};
use super::{Context, Exclusive, Failure, Outcome};
use crate::build::{Lock, check_finished, hold, share, sweep};
use crate::compare::{
    Acceptance, ComparisonResult, Difference, RunTime, Snapshot, Verdict, by_table, compare, junit,
    note_acceptances, page, record_run, tables_folder, to_json,
};

/// Maximum number of differences listed on the terminal; the comparison page lists all of them.
const MAX_ROWS: usize = 10;
/// Significant digits of printed values.
const DIGITS: usize = 4;

/// Compare the tables with those of an earlier run and list differences beyond tolerance.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/compare.txt").trim_end())]
pub(super) struct Compare {
    /// Baseline: a file that `--accept` or `--save` wrote, or a folder of tables [default:
    /// `paths.baseline` of the configuration].
    baseline: Option<PathBuf>,
    /// Tables to compare with the baseline [default: `paths.derived` of the configuration].
    #[arg(long, value_name = "FOLDER")]
    against: Option<PathBuf>,
    /// Override a tolerance of the configuration, such as "trials.d_m = { absolute = 0.001 }"; the
    /// option may be given more than once.
    #[arg(long, value_name = "TABLE.COLUMN = {..}")]
    tolerance: Vec<String>,
    /// Save a summary of the tables to a file for later comparisons.
    #[arg(long, value_name = "FILE")]
    save: Option<PathBuf>,
    /// Make the tables the new (or first) baseline, and record the reason.
    #[arg(long, value_name = "WHY", value_parser = NonEmptyStringValueParser::new())]
    accept: Option<String>,
    /// Maximum time since a run last made the tables or confirmed that they are up to date, such as 20h, 90min, 2d.
    #[arg(long, value_name = "TIME", value_parser = parse_age, conflicts_with = "against")]
    max_age: Option<Duration>,
    /// Print the comparison as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    exclusive: Exclusive,
}

impl Compare {
    pub(super) fn run(self, mut context: Context) -> Result<Outcome, Failure> {
        // The history uses the configured tolerances, not the ones given on the command line.
        let configured = context.config.clone();
        for line in &self.tolerance {
            set_tolerance(&mut context.config, line)?;
        }
        let config = &context.config;
        let paths = &config.paths;
        let watch = context.progress.watch(false);
        let mut outcome = Outcome::Well;
        // The lock is held until everything is written.
        let (lock, candidate) = match &self.against {
            Some(folder) => (None, load(paths, existing_folder(folder)?)?),
            None => {
                context.check_results()?;
                let lock = hold(config, self.exclusive.wait, &watch)?;
                check_finished(&lock, config, self.max_age)?;
                if let Some(problem) = record_run(&configured)? {
                    note!("{problem}");
                    outcome = Outcome::NeedsAttention;
                }
                (Some(lock), Snapshot::from_run(&paths.derived, &paths.reports)?)
            }
        };
        if let Some(file) = &self.save {
            save(&candidate, file, lock.as_ref())?;
            context.say(&format!("saved {}", file.display()));
        }
        let path = match &self.baseline {
            Some(path) => path,
            None if self.save.is_some() && self.accept.is_none() => return Ok(outcome),
            None => &paths.baseline,
        };
        if self.accept.is_some() && tables_folder(path)?.is_some() {
            let problem = "is a folder; name a file that `--save` wrote";
            return Err(format!("--accept: {} {problem}", path.display()).into());
        }
        // The first baseline is compared with itself.
        let mut baseline = if self.accept.is_some() && !is_there(path)? {
            candidate.clone()
        } else {
            load(paths, path)?
        };
        baseline.match_trials(&candidate).iter().for_each(|renamed| note!("{renamed}"));
        let compared = compare(&config.compare, &baseline, &candidate);

        let reports = &paths.reports;
        let html = reports.join("compare.html");
        let json = serde_json::to_string_pretty(&to_json(&compared))?;
        write_bytes(&html, page(&compared, &baseline, &candidate, paths)?.as_bytes())?;
        write_bytes(&reports.join("compare.xml"), junit(&compared)?.as_bytes())?;
        write_bytes(&reports.join("compare.json"), (json.clone() + "\n").as_bytes())?;
        if self.json {
            write_data(&json);
        } else {
            print_comparison(&compared, &html);
        }
        let mut accepted = baseline.accepted;
        if let Some(reason) = self.accept {
            let differences = compared.out().count() + compared.vanished.len();
            accepted.push(Acceptance { time: utc_now(), reason, differences });
            let candidate = Snapshot { accepted: accepted.clone(), ..candidate };
            save(&candidate, path, lock.as_ref())?;
            let path = path.display();
            context
                .say(&format!("baseline saved to {path}; the report shows it after the next run"));
        } else if !compared.passes() {
            outcome = Outcome::NeedsAttention;
        }
        // This includes the acceptances of an earlier comparison that was killed before this point.
        if lock.is_some() {
            note_acceptances(&configured, &accepted)?;
        }
        Ok(outcome)
    }
}

/// Reads a file that `--save` wrote, or the tables of a folder, which is locked while they are read.
fn load(paths: &Paths, path: &Path) -> Result<Snapshot, Failure> {
    let own = std::fs::canonicalize(&paths.derived).ok();
    let _lock = match tables_folder(path)? {
        // The caller holds the lock of the configured folder.
        Some(derived) if std::fs::canonicalize(&derived).ok() != own => share(&derived)?,
        _ => None,
    };
    Ok(Snapshot::load(path)?)
}

/// Writes a snapshot to `file`. If a lock on the results is given, first removes the unfinished files that killed
/// processes have left in the folder of `file`.
fn save(snapshot: &Snapshot, file: &Path, lock: Option<&Lock>) -> Result<(), Failure> {
    if let Some((lock, folder)) = lock.zip(std::path::absolute(file)?.parent()) {
        sweep(lock, &[folder.to_owned()])?;
    }
    Ok(snapshot.save(file)?)
}

/// Parses a maximum age such as `20h`, `90min` or `2d`.
fn parse_age(text: &str) -> Result<Duration, String> {
    let needed = || format!("found `{text}`, needed a time such as 20h, 90min or 2d");
    let (number, unit) =
        text.split_at(text.find(|c: char| c.is_alphabetic()).unwrap_or(text.len()));
    let unit_s = match unit {
        "min" => 60.0,
        "h" => 3600.0,
        "d" => 86_400.0,
        _ => return Err(needed()),
    };
    let number = number.trim().parse::<f64>().ok().filter(|number| *number > 0.0);
    let age = number.and_then(|number| Duration::try_from_secs_f64(number * unit_s).ok());
    age.ok_or_else(needed)
}

/// Checks that a folder of tables exists, and returns its path.
fn existing_folder(folder: &Path) -> Result<&Path, Failure> {
    match tables_folder(folder)? {
        Some(_) => Ok(folder),
        None => Err(format!("--against: {} is not a folder", folder.display()).into()),
    }
}

/// Overrides tolerances of the configuration with those in a line of TOML.
fn set_tolerance(config: &mut Config, line: &str) -> Result<(), Failure> {
    let option = Path::new("--tolerance");
    let named: BTreeMap<String, Tolerances> = trilink_tables::config::parse_toml(option, line)?;
    let mut all = toml::Table::try_from(&config.compare)?;
    for (name, tolerances) in named {
        let Some(toml::Value::Table(table)) = all.get_mut(&name) else {
            let known = config.compare.tables().map(|(known, _)| known).join("`, `");
            return Err(
                format!("--tolerance: found table `{name}`, needed one of `{known}`").into()
            );
        };
        table.extend(toml::Table::try_from(tolerances)?);
    }
    config.compare = all.try_into()?;
    config.check(option)?;
    Ok(())
}

/// Prints the causes of the differences out of tolerance, the largest of these differences, a summary of the comparison,
/// and the path of the comparison page.
fn print_comparison(compared: &ComparisonResult, page: &Path) {
    let ComparisonResult { causes, appeared, run_times, cells, .. } = compared;
    for (cause, nth) in causes.iter().zip(0..) {
        print(if nth == 0 { Tone::Bad.paint(&cause.sentence) } else { (&cause.sentence).into() });
    }
    let out = compared.out().count();
    let largest: Vec<&Difference> = compared.out().take(MAX_ROWS).collect();
    if out > MAX_ROWS {
        say!("the {MAX_ROWS} largest of {out} differences out of tolerance:");
    }
    let table = || {
        Table::new(&largest)
            .left("row", |of| &of.row)
            .left("value", |of| &of.column)
            .right("baseline", |of| cell(&of.baseline))
            .right("now", |of| cell(&of.candidate))
    };
    let with_tolerance = table().right("x limit", |of| match of.severity() {
        severity if severity.is_finite() => format!("{severity:.1}"),
        _ => "-".to_owned(),
    });
    if with_tolerance.fits() { with_tolerance } else { table() }.print();
    by_table(appeared).iter().for_each(|rows| say!("new in {rows}"));
    for RunTime { stage, baseline_s, candidate_s, .. } in run_times.iter().filter(|of| of.is_longer)
    {
        say!("longer: {stage}: {candidate_s:.1} s, baseline {baseline_s:.1} s");
    }
    let [within, not_judged] = [Verdict::Within, Verdict::NotJudged].map(|of| compared.count(of));
    let tone = if compared.passes() { Tone::Good } else { Tone::Bad };
    print(
        Text::from(format!("{cells} values compared: "))
            + tone.paint(format!("{out} out of tolerance"))
            + format!(", {within} differ within tolerance, {not_judged} differ and are not judged"),
    );
    say!("page: {}", page.display());
}

/// Formats a value of a table.
fn cell(value: &Value) -> String {
    match (value.as_f64(), value.as_str()) {
        (Some(number), _) => rounded(number, DIGITS),
        (None, Some(text)) => text.to_owned(),
        (None, None) => "-".to_owned(),
    }
}
