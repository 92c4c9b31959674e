//! Which trials of a folder have to be ingested again, and why.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::fingerprint::{self, MARKER_FILE};
use super::tables;
use super::{INGEST_VERSION, IngestError, IngestInput, Ingested};
use crate::config::Config;
use crate::store::{
    CheckRow, Columns, How, Redo, RobotParameterRow, StageState, Stamp, StoreError, Table, Thing,
    TrialRow, VERSION, changed_outputs, changed_settings, flatten, reasons,
};
use crate::trial::{Trial, TrialList};

/// The tables of all trials.
pub(super) const TABLES: [&str; 3] =
    ["trials.parquet", "checks.parquet", "robot_parameters.parquet"];

/// What an ingest has to do.
pub struct IngestPlan<'s> {
    pub redo: Redo,
    /// Campaigns and robots that trials which are redone or removed belong to.
    pub touched: Touched,
    pub(super) list: TrialList,
    pub(super) known: &'s StageState,
    /// Trials that stay as they are, by id.
    pub(super) kept: BTreeMap<String, KeptTrial>,
}

/// What later stages may find changed.
#[derive(Debug, Default)]
pub struct Touched {
    pub trials: Vec<String>,
    pub campaigns: Vec<String>,
    pub robots: Vec<String>,
}

/// A trial that is up to date: its rows of the tables, and what the record has of it.
pub(super) struct KeptTrial {
    pub row: TrialRow,
    pub checks: Vec<CheckRow>,
    pub parameters: Option<RobotParameterRow>,
    pub thing: Thing,
    /// Of the marker file.
    pub input: Option<(String, Stamp)>,
}

/// Compares a trial folder with what the record knows of its last ingest.
///
/// # Errors
/// The list of trials cannot be used.
pub fn plan<'s>(
    config: &Config,
    folder: &Path,
    derived: &Path,
    known: &'s StageState,
    how: How,
) -> Result<IngestPlan<'s>, IngestError> {
    let list = TrialList::load(folder)?;
    let (mut rows, whole) = match earlier_rows(derived, known, how) {
        Ok(rows) => (rows, Vec::new()),
        Err(why) => (BTreeMap::new(), why),
    };
    let settings = flatten(config);
    let mut redo = Redo::new("trial");
    let mut touched = Touched::default();
    let mut kept = BTreeMap::new();
    for trial in &list.trial {
        let look = Look { config, folder, derived, known, how, settings: &settings };
        let (mut why, input) = look.at(trial, &whole);
        match (rows.remove(&trial.id), known.things.get(&trial.id)) {
            (Some(RowsOfTrial { row, checks, parameters }), Some(thing)) if why.is_empty() => {
                let thing = thing.clone();
                kept.insert(trial.id.clone(), KeptTrial { row, checks, parameters, thing, input });
            }
            _ => {
                touched.add(trial);
                if why.is_empty() {
                    why.push(format!("{} does not have it", TABLES[0]));
                }
            }
        }
        redo.add(&trial.id, why);
    }
    let listed = |id: &String| list.trial.iter().any(|trial| trial.id == *id);
    redo.removed = known.things.keys().filter(|id| !listed(id)).cloned().collect();
    touched.trials.extend(redo.removed.iter().cloned());
    if redo.things.is_empty() && redo.removed.is_empty() {
        let order: Vec<&String> = list.trial.iter().map(|trial| &trial.id).collect();
        if known.order.iter().collect::<Vec<_>>() != order {
            redo.whole.push("trials.toml has another order".to_owned());
        }
        // What a run left that was killed before it recorded them.
        let outdated = tables::outdated(derived, known, &tables::recorded(derived, known))?;
        let names = outdated.iter().map(|path| path.display());
        redo.whole.extend(names.map(|name| format!("{name} is of no trial")));
    }
    Ok(IngestPlan { redo, touched, list, known, kept })
}

impl Touched {
    fn add(&mut self, trial: &Trial) {
        self.trials.push(trial.id.clone());
        self.campaigns.extend(trial.campaign.clone());
        self.robots.extend(trial.robot.clone());
    }
}

struct RowsOfTrial {
    row: TrialRow,
    checks: Vec<CheckRow>,
    parameters: Option<RobotParameterRow>,
}

/// The rows of the tables that the last ingest left, by trial.
///
/// # Errors
/// Why they cannot be used.
fn earlier_rows(
    derived: &Path,
    known: &StageState,
    how: How,
) -> Result<BTreeMap<String, RowsOfTrial>, Vec<String>> {
    if known.outputs.is_empty() || how.force {
        return Ok(BTreeMap::new());
    }
    let changed = changed_outputs(derived, &known.outputs, how.verify);
    if !changed.is_empty() {
        return Err(changed);
    }
    let unusable = |error: StoreError| vec![error.to_string()];
    let [trials, checks, parameters] = TABLES.map(|name| Table::read(&derived.join(name)));
    let trials = TrialRow::from_table(&trials.map_err(unusable)?).map_err(unusable)?;
    let checks = CheckRow::from_table(&checks.map_err(unusable)?).map_err(unusable)?;
    let parameters =
        RobotParameterRow::from_table(&parameters.map_err(unusable)?).map_err(unusable)?;
    let mut rows: BTreeMap<String, RowsOfTrial> = trials
        .into_iter()
        .map(|row| {
            let id = row.trial.clone();
            (id, RowsOfTrial { row, checks: Vec::new(), parameters: None })
        })
        .collect();
    for check in checks {
        if let Some(of_trial) = rows.get_mut(&check.trial) {
            of_trial.checks.push(check);
        }
    }
    for row in parameters {
        if let Some(of_trial) = rows.get_mut(&row.trial) {
            of_trial.parameters = Some(row);
        }
    }
    Ok(rows)
}

/// What a trial is compared with.
struct Look<'l> {
    config: &'l Config,
    folder: &'l Path,
    derived: &'l Path,
    known: &'l StageState,
    how: How,
    settings: &'l BTreeMap<String, String>,
}

impl Look<'_> {
    /// Why a trial has to be redone, and the stamp of its marker file if that was looked at.
    fn at(&self, trial: &Trial, whole: &[String]) -> (Vec<String>, Option<(String, Stamp)>) {
        if self.how.force {
            return (vec!["--force".to_owned()], None);
        }
        let Some(thing) = self.known.things.get(&trial.id) else {
            return (vec!["new".to_owned()], None);
        };
        let mut why = whole.to_vec();
        let path = self.folder.join(&trial.file);
        let input = IngestInput::new(self.config, trial);
        let stamp = match input {
            Ok(_) => Some(self.known.renew(&path, self.how.verify)),
            Err(_) => None,
        };
        let mut parts = fingerprint::parts(trial, &input, self.folder);
        parts.insert(MARKER_FILE.to_owned(), fingerprint::of_file(stamp.as_ref()));
        // Only a trial that failed says where its file is.
        if !thing.parts.contains_key(fingerprint::PLACE) {
            parts.remove(fingerprint::PLACE);
        }
        why.extend(reasons(&thing.parts, &parts, || {
            let prefixes = self.prefixes(trial);
            changed_settings(&self.known.settings, self.settings, &prefixes)
        }));
        why.extend(changed_outputs(self.derived, &thing.outputs, self.how.verify));
        let input = stamp.and_then(Result::ok).map(|stamp| (crate::store::absolute(&path), stamp));
        (why, input)
    }

    /// Beginnings of the keys that the trial's ingest reads.
    fn prefixes(&self, trial: &Trial) -> Vec<String> {
        let mut prefixes = ["vicon.", "ingest.", "markers."].map(str::to_owned).to_vec();
        let mut robot = trial.robot.as_ref();
        if let Some(name) = &trial.campaign {
            prefixes.extend(["robot", "gait"].map(|key| format!("campaign.{name}.{key}")));
            if let Some(campaign) = self.config.campaign.get(name) {
                robot = Some(&campaign.robot);
                prefixes.push(format!("gait.{}.", campaign.gait));
            }
        }
        prefixes.extend(robot.map(|name| format!("robot.{name}.")));
        prefixes
    }
}

impl IngestPlan<'_> {
    /// How many trials the list has.
    pub fn trials(&self) -> usize {
        self.list.trial.len()
    }

    /// The rows, where nothing is to be done.
    pub fn into_rows(mut self) -> Ingested {
        let mut ingested = Ingested::default();
        for trial in &self.list.trial {
            if let Some(kept) = self.kept.remove(&trial.id) {
                ingested.trials.push(kept.row);
                ingested.checks.extend(kept.checks);
                ingested.parameters.extend(kept.parameters);
            }
        }
        ingested
    }

    /// The record's part, where nothing is to be done: with files' times as they are now.
    pub fn state(&self) -> StageState {
        let inputs = self.kept.values().filter_map(|kept| kept.input.clone()).collect();
        StageState { inputs, ..self.known.clone() }
    }
}

/// Files that an ingest writes for the folder as a whole.
pub fn table_paths(derived: &Path) -> Vec<PathBuf> {
    TABLES.map(|name| derived.join(name)).into()
}

/// Part of every trial.
pub(super) fn version() -> (String, String) {
    (VERSION.to_owned(), INGEST_VERSION.to_string())
}
