//! `trilink compare`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::output::say;
use super::{Context, Failure, Outcome, table};
use crate::clock::utc_now;
use crate::compare::{
    Acceptance, Compared, Difference, Lone, Snapshot, Verdict, compare, junit, note_acceptance,
    page, remember, to_json,
};
use crate::config::{Config, Tolerances};
use crate::store::write_bytes;

/// More differences than this are on the page.
const MOST_ROWS: usize = 40;

#[derive(clap::Args)]
pub(super) struct Compare {
    /// A file that `--save` wrote, or a folder of tables.
    #[arg(required_unless_present = "save")]
    baseline: Option<PathBuf>,
    /// Tables to compare with it [default: `paths.derived` of the configuration].
    #[arg(long, value_name = "FOLDER")]
    against: Option<PathBuf>,
    /// Another tolerance than the configuration's, such as "trials.d_m = { absolute = 0.001 }";
    /// may be given again.
    #[arg(long, value_name = "TABLE.COLUMN = {..}")]
    tolerance: Vec<String>,
    /// Write what the tables come to into one file, for later comparisons.
    #[arg(long, value_name = "FILE")]
    save: Option<PathBuf>,
    /// Make the tables the new baseline and keep the reason.
    #[arg(long, value_name = "WHY", requires = "baseline")]
    accept: Option<String>,
    /// Print the comparison as JSON.
    #[arg(long)]
    json: bool,
}

impl Compare {
    pub fn run(self, mut context: Context) -> Result<Outcome, Failure> {
        for line in &self.tolerance {
            set_tolerance(&mut context.config, line)?;
        }
        let paths = &context.config.paths;
        let candidate = match &self.against {
            Some(folder) => Snapshot::load(existing_folder(folder)?)?,
            None => {
                remember(paths)?;
                Snapshot::of_run(&paths.derived, &paths.reports)?
            }
        };
        if let Some(file) = &self.save {
            candidate.save(file)?;
            context.progress.say(&format!("saved {}", file.display()));
        }
        let Some(path) = &self.baseline else { return Ok(Outcome::Well) };
        if self.accept.is_some() && path.is_dir() {
            let found = "is a folder, needed a file that `--save` wrote";
            return Err(format!("--accept: {} {found}", path.display()).into());
        }
        let baseline = Snapshot::load(path)?;
        let compared = compare(&context.config.compare, &baseline, &candidate);

        let reports = &paths.reports;
        let html = reports.join("compare.html");
        let json = serde_json::to_string_pretty(&to_json(&compared))?;
        write_bytes(&html, page(&compared, &baseline, &candidate)?.as_bytes())?;
        write_bytes(&reports.join("compare.xml"), junit(&compared)?.as_bytes())?;
        write_bytes(&reports.join("compare.json"), (json.clone() + "\n").as_bytes())?;
        if self.json {
            say!("{json}");
        } else {
            print(&compared, &html);
        }
        let Some(reason) = self.accept else {
            return Ok(if compared.is_well() { Outcome::Well } else { Outcome::NeedsAttention });
        };
        let differences = compared.out().count() + compared.vanished.len();
        let acceptance = Acceptance { time: utc_now(), reason, differences };
        let mut accepted = baseline.accepted;
        accepted.push(acceptance.clone());
        Snapshot { accepted, ..candidate }.save(path)?;
        note_acceptance(paths, &acceptance)?;
        context.progress.say(&format!("{} is the new baseline", path.display()));
        Ok(Outcome::Well)
    }
}

fn existing_folder(folder: &Path) -> Result<&Path, Failure> {
    match folder.is_dir() {
        true => Ok(folder),
        false => Err(format!("--against: {} is no folder", folder.display()).into()),
    }
}

/// A line of TOML over the configuration's tolerances.
fn set_tolerance(config: &mut Config, line: &str) -> Result<(), Failure> {
    let option = Path::new("--tolerance");
    let named: BTreeMap<String, Tolerances> = crate::config::parse_toml(option, line)?;
    let mut all = toml::Table::try_from(&config.compare)?;
    for (name, tolerances) in named {
        let Some(toml::Value::Table(table)) = all.get_mut(&name) else {
            let known = config.compare.tables().map(|(known, _)| known).join("`, `");
            return Err(format!("--tolerance: table `{name}`: needed one of `{known}`").into());
        };
        table.extend(toml::Table::try_from(tolerances)?);
    }
    config.compare = all.try_into()?;
    config.check(option)?;
    Ok(())
}

fn print(compared: &Compared, page: &Path) {
    let out: Vec<&Difference> = compared.out().collect();
    if !out.is_empty() {
        let row = |of: &&Difference| vec![of.table.to_owned(), of.of.clone(), of.sentence()];
        let rows: Vec<_> = out.iter().take(MOST_ROWS).map(row).collect();
        table::print(&["table", "row", "out of tolerance"].map(|name| (name, false)), &rows, None);
        if out.len() > MOST_ROWS {
            say!("and {} more", out.len() - MOST_ROWS);
        }
    }
    let lone = |what: &str, all: &[Lone]| {
        all.iter().take(MOST_ROWS).for_each(|lone| say!("{what}: {}", lone.name()));
        if all.len() > MOST_ROWS {
            say!("{what}: {} more", all.len() - MOST_ROWS);
        }
    };
    lone("vanished", &compared.vanished);
    lone("appeared", &compared.appeared);
    for time in compared.run_times.iter().filter(|time| time.is_longer) {
        let (stage, now, then) = (&time.stage, time.candidate_s, time.baseline_s);
        say!("longer: {stage}: {now:.1} s, baseline {then:.1} s");
    }
    let (within, not_judged) =
        (compared.count(Verdict::Within), compared.count(Verdict::NotJudged));
    say!(
        "{} values compared: {} out of tolerance, {within} differ within it, {not_judged} differ \
         and are not judged",
        compared.cells,
        out.len()
    );
    say!("page: {}", page.display());
}
