//! A folder's trials, side by side, and their tables.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, SyncSender};
use std::thread;

use rayon::prelude::*;

use super::checks::Finding;
use super::cycles::summary;
use super::fingerprint::{self, MARKER_FILE, PLACE};
use super::plan::{IngestPlan, KeptTrial, TABLES, plan};
use super::{
    IngestError, IngestInput, Ingested, ProcessedTrial, TrialFailure, failed_checks, process,
    tables,
};
use crate::config::Config;
use crate::store::{
    Beside, CheckRow, Columns, CycleRow, How, Parts, Provenance, RobotParameterRow, StageState,
    Stamp, StoreError, Table, Thing, TrialRow, absolute, cycles_path, flatten, poses_path,
    wheels_path,
};
use crate::trial::{Trial, TrialKind};
use crate::vicon;

/// Files that may wait for the disk.
const MOST_BESIDE: usize = 32;

/// Somebody who hears of each trial as it is done, in any order and from any thread.
pub type OnTrial<'t> = &'t (dyn Fn(&TrialRow) + Sync);

/// Ingests every trial of a folder, in parallel, and writes `derived/`: the tables of each
/// trial, then those of all. Tables of trials that are no longer listed or now fail are removed.
///
/// # Errors
/// The list of trials cannot be used, or a table cannot be written or removed. What is wrong
/// with one trial is in its row instead.
pub fn ingest_folder(
    config: &Config,
    folder: &Path,
    derived: &Path,
    on_trial: OnTrial,
) -> Result<Ingested, IngestError> {
    let known = StageState::default();
    let plan = plan(config, folder, derived, &known, How::FORCE)?;
    Ok(ingest_planned(config, folder, derived, plan, on_trial)?.0)
}

/// [`ingest_folder`] of those trials only that the plan does not keep. The tables are those that
/// an ingest of all would have left. Gives what to record, too.
///
/// # Errors
/// A table cannot be written or removed.
pub fn ingest_planned(
    config: &Config,
    folder: &Path,
    derived: &Path,
    plan: IngestPlan,
    on_trial: OnTrial,
) -> Result<(Ingested, StageState), IngestError> {
    if plan.redo.is_empty() {
        let state = plan.state();
        return Ok((plan.into_rows(), state));
    }
    let IngestPlan { list, known, mut kept, .. } = plan;
    let (to_disk, written) = mpsc::sync_channel::<Beside>(MOST_BESIDE);
    let redone: Vec<&Trial> =
        list.trial.iter().filter(|trial| !kept.contains_key(&trial.id)).collect();
    let (redone, settled) = thread::scope(|scope| {
        // The disk is waited for while the next trials are computed.
        let settling = scope.spawn(move || settle(written));
        let redone: Result<Vec<Outcome>, IngestError> = redone
            .par_iter()
            .with_max_len(1)
            .map_with(to_disk, |to_disk, trial| {
                let outcome = ingest_trial(config, folder, derived, trial, to_disk)?;
                on_trial(&outcome.row);
                Ok(outcome)
            })
            .collect();
        (redone, settling.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    });
    let mut stamps = settled?;
    let mut redone = redone?.into_iter();
    let outcomes = list.trial.iter().filter_map(|trial| match kept.remove(&trial.id) {
        Some(kept) => Some(Outcome::from(kept)),
        None => redone.next().map(|outcome| outcome.with_stamps(derived, &mut stamps)),
    });
    let mut state = StageState { settings: flatten(config), ..StageState::default() };
    let mut ingested = Ingested::default();
    for outcome in outcomes {
        state.order.push(outcome.row.trial.clone());
        state.inputs.extend(outcome.input);
        state.things.insert(outcome.row.trial.clone(), outcome.thing);
        ingested.trials.push(outcome.row);
        ingested.checks.extend(outcome.checks);
        ingested.parameters.extend(outcome.parameters);
    }
    let current = tables::recorded(derived, &state);
    tables::remove_outdated(derived, known, &current)?;
    let parts = state.order.iter().filter_map(|id| state.things.get(id)).map(|thing| &thing.parts);
    let provenance = Provenance { input: fingerprint::of_all(parts) };
    let all = [
        TrialRow::to_table(&ingested.trials),
        CheckRow::to_table(&ingested.checks),
        RobotParameterRow::to_table(&ingested.parameters),
    ];
    for (name, table) in TABLES.into_iter().zip(all) {
        let stamp = table.write_if_changed(&derived.join(name), &provenance)?;
        state.outputs.insert(name.to_owned(), stamp);
    }
    state.input = provenance.input;
    Ok((ingested, state))
}

/// Puts files in their places; gives their stamps.
fn settle(files: mpsc::Receiver<Beside>) -> Result<BTreeMap<PathBuf, Stamp>, StoreError> {
    files
        .into_iter()
        .map(|file| {
            let path = file.path().to_owned();
            Ok((path, file.settle()?))
        })
        .collect()
}

/// What remains of a trial when its tables are written.
struct Outcome {
    row: TrialRow,
    checks: Vec<CheckRow>,
    parameters: Option<RobotParameterRow>,
    thing: Thing,
    /// Of the marker file, if it could be read.
    input: Option<(String, Stamp)>,
    written: Vec<PathBuf>,
}

impl Outcome {
    fn with_stamps(mut self, derived: &Path, stamps: &mut BTreeMap<PathBuf, Stamp>) -> Self {
        for path in std::mem::take(&mut self.written) {
            if let (Some(stamp), Ok(name)) = (stamps.remove(&path), path.strip_prefix(derived)) {
                let name = name.to_string_lossy().replace('\\', "/");
                self.thing.outputs.insert(name, stamp);
            }
        }
        self
    }
}

impl From<KeptTrial> for Outcome {
    fn from(kept: KeptTrial) -> Self {
        let KeptTrial { row, checks, parameters, thing, input } = kept;
        Self { row, checks, parameters, thing, input, written: Vec::new() }
    }
}

fn ingest_trial(
    config: &Config,
    folder: &Path,
    derived: &Path,
    trial: &Trial,
    to_disk: &SyncSender<Beside>,
) -> Result<Outcome, IngestError> {
    let path = folder.join(&trial.file);
    // The entry is checked first: its file name might point out of the folder.
    let input = IngestInput::new(config, trial);
    let mut parts = fingerprint::parts(trial, &input, folder);
    let (file, stamp) = match input {
        Err(error) => (Err(TrialFailure::from(error)), None),
        Ok(input) => {
            // What is read may be newer than its time, never older.
            let metadata = std::fs::metadata(&path);
            let file = vicon::read_file(&path);
            let stamp = match (&file, metadata) {
                (Ok(file), Ok(metadata)) => Ok(Stamp::of_input(&metadata, file)),
                (Ok(file), Err(_)) => Ok(Stamp::of_content(file)),
                (Err(_), _) => Stamp::read(&path),
            };
            (file.map(|file| (file, input)).map_err(TrialFailure::from), Some(stamp))
        }
    };
    parts.insert(MARKER_FILE.to_owned(), fingerprint::of_file(stamp.as_ref()));
    let input_file = stamp.and_then(Result::ok).map(|stamp| (absolute(&path), stamp));
    let mut findings = Vec::new();
    let processed =
        file.and_then(|(file, input)| process(&path, &file, trial, &input, &mut findings));
    let processed = match processed {
        Ok(processed) => processed,
        Err(failure) => return Ok(failed(trial, &failure, &findings, parts, input_file)),
    };
    parts.remove(PLACE);
    let provenance = Provenance { input: fingerprint::of_parts(&parts) };
    let mut written = Vec::new();
    let mut write = |table: &Table, path: PathBuf| -> Result<(), StoreError> {
        let beside = table.write_beside(&path, &provenance)?;
        // If nobody takes it any more, whoever did has the reason.
        let _ = to_disk.send(beside);
        written.push(path);
        Ok(())
    };
    write(&processed.poses, poses_path(derived, &trial.id))?;
    write(&processed.wheels, wheels_path(derived, &trial.id))?;
    if trial.kind == TrialKind::Gait {
        write(&CycleRow::to_table(&processed.cycles), cycles_path(derived, &trial.id))?;
    }
    let ProcessedTrial { row, checks, parameters, .. } = processed;
    let thing = Thing { parts, ..Thing::default() };
    Ok(Outcome { row, checks, parameters, thing, input: input_file, written })
}

fn failed(
    trial: &Trial,
    failure: &TrialFailure,
    findings: &[Finding],
    parts: Parts,
    input: Option<(String, Stamp)>,
) -> Outcome {
    let row = TrialRow { message: failure.to_string(), ..summary::blank_row(trial) };
    let checks = failed_checks(trial, failure, findings);
    let thing = Thing { parts, ..Thing::default() };
    Outcome { row, checks, parameters: None, thing, input, written: Vec::new() }
}
