//! First pipeline stage: ingests marker files into tables. Each trial is a separate build target.

use std::collections::{BTreeMap, HashSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Instant;

use rayon::prelude::*;
use serde_json::{Value, json};
use trilink_base::files::name_in;
use trilink_ingest::{
    Entry, FolderInput, IngestInput, Ingested, MarkerStamp, ingest_trials, outdated_tables,
    without_diagnosis,
};
use trilink_tables::config::Config;
use trilink_tables::trial::{ListedTrial, TrialError, TrialFolder, TrialFolders};
use trilink_tables::{Provenance, Reader, StoreError, TrialRow, TrialStatus};

use super::RunError;
use super::missing::MissingFolders;
use super::plan::{ANY_ROBOT, Stage, TargetSpec, Work, hash_of};
use super::record::{Inputs, Record, StageState, TargetRecord};
use super::steps::Steps;
use super::target::{Key, Kind, Target};

const ENTRY: &str = "the entry in trials.toml";
pub(super) const FOLDER: &str = "the folder";
pub(super) const MARKER_FILE: &str = "the marker file";

/// Ingest stage of the pipeline.
pub(super) struct IngestStage {
    derived: PathBuf,
    folders: Vec<TrialFolder>,
    trials: Vec<(ListedTrial, Result<IngestInput, TrialError>)>,
    /// Notes about ignored trials and renamed folders.
    notes: Vec<String>,
    /// Input of the checks across trials; `None` in a shard, which skips these checks.
    together: Option<FolderInput>,
}

impl IngestStage {
    /// Reads the lists of trials.
    ///
    /// # Errors
    /// Returns an error if a list of trials is unreadable or invalid.
    pub(super) fn new(config: &Config) -> Result<Self, RunError> {
        let all = TrialFolders::load(&config.paths)?;
        let together = Some(FolderInput::new(config, &all));
        let notes = all.ignored_sentence().into_iter().collect();
        let TrialFolders { folders, trials, .. } = all;
        let trials = trials.into_par_iter().map(|listed| {
            // The error concerns an entry of the list, which has the id and not the name.
            let input = IngestInput::new(config, &listed.trial)
                .map_err(|error| TrialError { trial: listed.id.clone(), ..error });
            (listed, input)
        });
        let trials = trials.collect();
        Ok(Self { derived: config.paths.derived.clone(), folders, trials, notes, together })
    }

    /// Adds what is known about trial folders that no longer exist.
    pub(super) fn without(mut self, MissingFolders { gone, renamed }: MissingFolders) -> Self {
        self.notes.extend(renamed);
        self.together = self.together.map(|together| together.with_gone(gone));
        self
    }

    /// Restricts the stage to the trials whose ids satisfy `keep`, and makes `derived` the folder for their tables.
    pub(super) fn restrict(mut self, keep: impl Fn(&str) -> bool, derived: &Path) -> Self {
        self.retain(keep);
        Self { derived: derived.to_owned(), together: None, ..self }
    }

    /// Removes the trials whose ids do not satisfy `keep`.
    pub(super) fn retain(&mut self, keep: impl Fn(&str) -> bool) {
        self.trials.retain(|(listed, _)| keep(&listed.trial.id));
    }

    /// Returns the trial ids, in the order of the stage's targets.
    pub(super) fn trials(&self) -> impl Iterator<Item = &str> {
        self.trials.iter().map(|(listed, _)| listed.trial.id.as_str())
    }

    /// Returns the names of the trial folders in order.
    pub(super) fn folders(&self) -> impl Iterator<Item = &String> {
        self.folders.iter().map(|folder| &folder.name)
    }

    fn entry(&self, index: usize) -> Entry<'_> {
        let (listed, input) = &self.trials[index];
        Entry { folder: &self.folders[listed.folder], listed, input }
    }

    fn entries(&self) -> impl Iterator<Item = Entry<'_>> {
        (0..self.trials.len()).map(|index| self.entry(index))
    }

    /// Returns the paths of those tables of single trials that belong to none of `targets`.
    fn outdated(&self, targets: &[TargetRecord]) -> Result<Vec<PathBuf>, StoreError> {
        let current = targets.iter().flat_map(|made| made.outputs.keys().map(String::as_str));
        outdated_tables(&self.derived, &current.collect())
    }

    /// Returns the specification of a trial as a build target. Its key lacks the entry for the marker file.
    fn spec_without_file(Entry { folder, listed, input }: Entry) -> TargetSpec {
        let trial = &listed.trial;
        let key = Key::from([
            (ENTRY.to_owned(), hash_of(trial)),
            (FOLDER.to_owned(), folder.name.clone()),
        ]);
        let mut subjects = vec![format!("trial {}", trial.id)];
        subjects.extend(trial.campaign.iter().map(|campaign| format!("campaign {campaign}")));
        if let Some(robot) = &trial.robot {
            subjects.extend([format!("robot {robot}"), ANY_ROBOT.to_owned()]);
        }
        let target = Target::new(Kind::Trial, &trial.id);
        match input {
            Ok(input) => TargetSpec::new(target, input, key, subjects),
            // The message depends on names in the configuration.
            Err(error) => {
                TargetSpec::new(target, &json!({ "entry": error.to_string() }), key, subjects)
            }
        }
    }

    /// Returns the specification of a trial as a build target. Its key contains the hash of the marker file, or the
    /// information that the file is unreadable or has not been read.
    fn spec(entry: Entry, file: Option<&MarkerStamp>) -> TargetSpec {
        let mut spec = Self::spec_without_file(entry);
        let file = match file {
            Some(Ok(stamp)) => stamp.blake3.clone(),
            Some(Err(kind)) => format!("unreadable: {kind}"),
            None => "not read".to_owned(),
        };
        spec.key.insert(MARKER_FILE.to_owned(), file);
        spec
    }
}

impl Stage for IngestStage {
    /// Stamp of each trial's marker file, or the error if the file does not exist. `None` if the file has not been
    /// checked, because the trial is new or its entry invalid, or if the file exists but cannot be read.
    type Sources = Vec<Option<MarkerStamp>>;
    type Output = Ingested;
    type Rows = Ingested;

    const NAME: &'static str = "ingest";
    const SOURCE: &'static str = env!("TRILINK_INGEST_SOURCE");
    const STEPS: &'static str = "trials";
    const HAS_TARGET_ROWS: bool = true;
    const ORDER_CHANGED: &'static str = "the order of the trials in trials.toml has changed";

    fn state(record: &Record) -> &StageState {
        &record.ingest
    }

    fn output_folder(&self) -> &Path {
        &self.derived
    }

    fn stage_settings(&self) -> Value {
        json!(self.together)
    }

    fn input_paths(&self, known: &StageState) -> Result<Vec<(PathBuf, bool)>, RunError> {
        let made: HashSet<&str> = known.targets.iter().map(|made| &*made.target.name).collect();
        let entries = self
            .entries()
            .filter(|entry| entry.input.is_ok() && made.contains(&*entry.listed.trial.id));
        Ok(entries.map(|entry| (entry.marker_file(), false)).collect())
    }

    fn expected_specs(&self, _known: &StageState) -> Vec<TargetSpec> {
        let indices = (0..self.trials.len()).into_par_iter();
        indices.map(|index| Self::spec_without_file(self.entry(index))).collect()
    }

    fn read(&self, inputs: Inputs) -> Result<Self::Sources, RunError> {
        // A missing file is a valid finding; a file that cannot be read is tried again.
        let files = self.entries().map(|entry| {
            let file = inputs.get(&entry.marker_file());
            file.filter(|file| !matches!(file, Err(kind) if *kind != ErrorKind::NotFound))
        });
        Ok(files.collect())
    }

    fn specs(&self, files: &Self::Sources) -> Vec<TargetSpec> {
        let indices = (0..self.trials.len()).into_par_iter();
        indices.map(|index| Self::spec(self.entry(index), files[index].as_ref())).collect()
    }

    fn load_previous(&self, _known: &StageState, written: &Reader) -> Result<Ingested, StoreError> {
        Ingested::read(&self.derived, written)
    }

    fn rows_by_target(&self, _known: &StageState, earlier: Ingested) -> BTreeMap<Target, Ingested> {
        let rows = earlier.by_target().into_iter();
        rows.map(|(id, rows)| (Target::new(Kind::Trial, &id), without_diagnosis(rows))).collect()
    }

    /// Returns a sentence for each table that belongs to no trial because a run was killed before it saved the record.
    fn leftovers(&self, known: &StageState) -> Result<Vec<String>, RunError> {
        let outdated = self.outdated(&known.targets)?;
        Ok(outdated.iter().map(|path| format!("{} belongs to no trial", path.display())).collect())
    }

    fn make(
        &self,
        Work { mut retained, .. }: Work<Self>,
        steps: &Steps,
    ) -> Result<(Ingested, StageState), RunError> {
        self.notes.iter().for_each(|sentence| steps.watch.note(sentence));
        let derived = &self.derived;
        let stale: Vec<Entry> =
            self.entries().filter(|entry| !retained.contains_key(&target_of(entry))).collect();
        let begin = Instant::now();
        let on_trial = |TrialRow { trial, status, message, .. }: &TrialRow| {
            steps.step(&format!("{trial} {status}"));
            let after_s = begin.elapsed().as_secs_f64();
            let name = status.name();
            if *status == TrialStatus::Ok {
                tracing::debug!(trial, status = name, after_s, "trial");
            } else {
                tracing::warn!(trial, status = name, message, "trial");
            }
        };
        let provenance = |entry: Entry, file: Option<&MarkerStamp>| Provenance {
            input: hash_of(&Self::spec(entry, file).key),
        };
        let cancel = steps.watch.cancel_token();
        let mut ingested =
            ingest_trials(derived, &stale, &provenance, &on_trial, &cancel)?.into_iter();
        let mut output = Ingested::default();
        let mut state = StageState::default();
        for entry in self.entries() {
            if let Some((made, rows)) = retained.remove(&target_of(&entry)) {
                output.extend(rows);
                state.targets.push(made);
            } else if let Some(new) = ingested.next() {
                let spec = Self::spec(entry, new.marker_file.as_ref());
                if let Some(Ok(stamp)) = new.marker_file {
                    state.inputs.insert(name_in(derived, &entry.marker_file()), stamp);
                }
                output.extend(new.rows);
                let written = new.written.into_iter();
                let outputs = written.map(|(path, stamp)| (name_in(derived, &path), stamp));
                state.targets.push(spec.into_record(outputs.collect()));
            }
        }
        // For a file that was not read, the key holds a text instead of a hash.
        let contents = state.targets.iter().filter_map(|made| {
            let content = made.key.get(MARKER_FILE).filter(|content| !content.contains(' '))?;
            Some((made.target.name.clone(), content.clone()))
        });
        if let Some(together) = &self.together {
            together.diagnose(&mut output, &contents.collect());
        }
        for path in self.outdated(&state.targets)? {
            std::fs::remove_file(&path).map_err(|source| StoreError::Remove { path, source })?;
        }
        let keys: Vec<&Key> = state.targets.iter().map(|made| &made.key).collect();
        let provenance = Provenance { input: hash_of(&(keys, &self.together)) };
        state.outputs = output.write(derived, &provenance)?;
        Ok((output, state))
    }
}

/// Returns the build target for a trial.
fn target_of(entry: &Entry) -> Target {
    Target::new(Kind::Trial, &entry.listed.trial.id)
}
