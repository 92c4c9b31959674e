//! The first stage: marker files to tables, a target for each trial.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use rayon::prelude::*;
use serde_json::json;
use trilink_base::files::name_in;
use trilink_ingest::{
    Entry, FolderInput, IngestInput, Ingested, MarkerStamp, ingest_trials, outdated, undiagnosed,
};
use trilink_tables::config::Config;
use trilink_tables::trial::{ListedTrial, TrialError, TrialFolder, TrialFolders};
use trilink_tables::{Provenance, Reader, StoreError, TrialRow, TrialStatus};

use super::plan::{PlannedTarget, Stage, StagePlan, Touched, Wanted, Work, hash_of};
use super::record::{Inputs, Made, Record, StageState};
use super::target::{Fingerprint, Target};
use super::{RunError, Watch};

const ENTRY: &str = "the entry in trials.toml";
const FOLDER: &str = "the folder";
const MARKER_FILE: &str = "the marker file";

pub(super) struct IngestStage {
    derived: PathBuf,
    folders: Vec<TrialFolder>,
    trials: Vec<(ListedTrial, Result<IngestInput, TrialError>)>,
    /// What is to be said of the lists: of ignored trials and of ids that several folders have.
    notes: Vec<String>,
    /// Missing for some of the trials, of which nothing is said together.
    together: Option<FolderInput>,
}

impl IngestStage {
    /// # Errors
    /// A list of trials cannot be used.
    pub(super) fn new(config: &Config) -> Result<Self, RunError> {
        let all = TrialFolders::load(&config.paths)?;
        let together = Some(FolderInput::new(config, &all.folders));
        let notes = all.ignored().into_iter().chain(all.told_apart()).collect();
        let TrialFolders { folders, trials } = all;
        let with_input = |listed: ListedTrial| {
            let input = IngestInput::new(config, &listed.trial);
            (listed, input)
        };
        let trials = trials.into_par_iter().map(with_input).collect();
        Ok(Self { derived: config.paths.derived.clone(), folders, trials, notes, together })
    }

    /// The stage of some of the trials, with tables elsewhere.
    pub(super) fn of_some(mut self, keep: impl Fn(&str) -> bool, derived: &Path) -> Self {
        self.retain(keep);
        Self { derived: derived.to_owned(), together: None, ..self }
    }

    /// Leaves out trials.
    pub(super) fn retain(&mut self, keep: impl Fn(&str) -> bool) {
        self.trials.retain(|(listed, _)| keep(&listed.trial.id));
    }

    /// Names of the trials, in order.
    pub(super) fn trials(&self) -> impl Iterator<Item = &str> {
        self.trials.iter().map(|(listed, _)| listed.trial.id.as_str())
    }

    /// Names of the folders, in order.
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

    /// What later stages may find changed by what is planned.
    pub(super) fn touched(&self, plan: &StagePlan) -> Touched {
        let mut touched = Touched::default();
        let redone = plan.targets.iter().map(|PlannedTarget { target, .. }| target);
        touched.trials.extend(redone.chain(&plan.removed).map(Target::name));
        let trials = self.trials.iter().map(|(listed, _)| &listed.trial);
        for trial in trials.filter(|trial| touched.trials.contains(&trial.id)) {
            touched.campaigns.extend(trial.campaign.clone());
            touched.robots.extend(trial.robot.clone());
        }
        touched
    }

    /// Tables of trials that are of none of the targets.
    fn outdated(&self, targets: &[Made]) -> Result<Vec<PathBuf>, StoreError> {
        let current = targets.iter().flat_map(|made| made.outputs.keys().map(String::as_str));
        outdated(&self.derived, &current.collect())
    }

    /// What a trial is made of but for its marker file.
    fn without_file(Entry { folder, listed, input }: Entry) -> Wanted {
        let trial = &listed.trial;
        let parts = Fingerprint::from([
            (ENTRY.to_owned(), hash_of(trial)),
            (FOLDER.to_owned(), folder.name.clone()),
        ]);
        let target = Target::Trial(trial.id.clone());
        match input {
            Ok(input) => Wanted::new(target, input, parts),
            // What is wrong is said with names of the configuration.
            Err(error) => Wanted::new(target, &json!({ "entry": error.to_string() }), parts),
        }
    }

    /// [`Self::without_file`] with the marker file.
    fn trial(entry: Entry, file: Option<&MarkerStamp>) -> Wanted {
        let mut wanted = Self::without_file(entry);
        wanted.parts.insert(MARKER_FILE.to_owned(), of_file(file));
        wanted
    }
}

/// Of a marker file: its content, or why there is none.
fn of_file(file: Option<&MarkerStamp>) -> String {
    match file {
        Some(Ok(stamp)) => stamp.blake3.clone(),
        Some(Err(kind)) => format!("unreadable: {kind}"),
        None => "not read".to_owned(),
    }
}

impl Stage for IngestStage {
    type Sources = ();
    type Kept = Ingested;
    type Output = Ingested;

    const NAME: &'static str = "ingest";
    const SOURCE: &'static str = env!("TRILINK_INGEST_SOURCE");
    const ROWS_OF_TARGETS: bool = true;
    const OTHER_ORDER: &'static str = "trials.toml has another order";
    const NOT_KEPT: &'static str = "trials.parquet does not have it";

    fn state(record: &Record) -> &StageState {
        &record.ingest
    }

    fn home(&self) -> &Path {
        &self.derived
    }

    fn whole(&self) -> serde_json::Value {
        json!(self.together)
    }

    fn read(&self, _inputs: &Inputs) -> Result<(), RunError> {
        Ok(())
    }

    fn wanted(&self, _sources: &()) -> Vec<Wanted> {
        let wanted = |index| Self::without_file(self.entry(index));
        (0..self.trials.len()).into_par_iter().map(wanted).collect()
    }

    fn complete(
        &self,
        index: usize,
        wanted: &mut Wanted,
        _made: &Made,
        inputs: &Inputs,
    ) -> Option<String> {
        let entry = self.entry(index);
        let stamp = || inputs.stamp(&entry.marker_file(), false).map_err(|e| e.kind());
        let stamp = entry.input.is_ok().then(stamp);
        wanted.parts.insert(MARKER_FILE.to_owned(), of_file(stamp.as_ref()));
        // A file that is not there is known; what cannot be read may be there the next time.
        let is_unreadable = |stamp| matches!(stamp, Some(Err(kind)) if kind != ErrorKind::NotFound);
        is_unreadable(stamp).then(|| format!("{MARKER_FILE} cannot be read"))
    }

    fn earlier(&self, _known: &StageState, written: &Reader) -> Result<Ingested, String> {
        Ingested::read(&self.derived, written).map_err(|error| error.to_string())
    }

    fn kept(&self, _known: &StageState, earlier: Ingested) -> BTreeMap<Target, Ingested> {
        let whole = earlier.by_target().into_iter().filter(|(_, rows)| rows.trials.len() == 1);
        whole.map(|(id, rows)| (Target::Trial(id), undiagnosed(rows))).collect()
    }

    /// What a run left that was killed before it recorded them.
    fn leftovers(&self, known: &StageState) -> Result<Vec<String>, RunError> {
        let outdated = self.outdated(&known.targets)?;
        Ok(outdated.iter().map(|path| format!("{} is of no trial", path.display())).collect())
    }

    fn make(
        &self,
        mut work: Work<Self>,
        watch: &dyn Watch,
    ) -> Result<(Ingested, StageState), RunError> {
        self.notes.iter().for_each(|sentence| watch.note(sentence));
        let derived = &self.derived;
        let target = |entry: &Entry| Target::Trial(entry.listed.trial.id.clone());
        let is_kept = |entry: &Entry| work.kept.contains_key(&target(entry));
        let redone: Vec<Entry> = self.entries().filter(|entry| !is_kept(entry)).collect();
        let (begin, done, total) = (Instant::now(), AtomicUsize::new(0), redone.len());
        let on_trial = |TrialRow { trial, status, message, .. }: &TrialRow| {
            watch.step(&format!("{trial} {status}"));
            let after_s = begin.elapsed().as_secs_f64();
            let (is_ok, status) = (*status == TrialStatus::Ok, status.name());
            match is_ok {
                true => tracing::debug!(trial, status, after_s, "trial"),
                false => tracing::warn!(trial, status, message, "trial"),
            }
            done.fetch_add(1, Ordering::Relaxed);
        };
        let provenance = |entry: Entry, file: Option<&MarkerStamp>| Provenance {
            input: hash_of(&Self::trial(entry, file).parts),
        };
        let stopped = |error| match error {
            StoreError::Cancelled(_) => {
                let done = format!("{} of {total} trials", done.load(Ordering::Relaxed));
                RunError::Interrupted { stage: Self::NAME, done }
            }
            other => other.into(),
        };
        let cancel = watch.cancel_token();
        let ingested = ingest_trials(derived, &redone, &provenance, &on_trial, &cancel);
        let mut ingested = ingested.map_err(stopped)?.into_iter();
        let (mut output, mut targets, mut inputs) =
            (Ingested::default(), Vec::new(), BTreeMap::new());
        for entry in self.entries() {
            if let Some((made, rows)) = work.kept.remove(&target(&entry)) {
                output.extend(rows);
                targets.push(made);
            } else if let Some(new) = ingested.next() {
                let wanted = Self::trial(entry, new.marker_file.as_ref());
                if let Some(Ok(stamp)) = new.marker_file {
                    inputs.insert(name_in(derived, &entry.marker_file()), stamp);
                }
                output.extend(new.rows);
                let names = new.written.into_iter().filter_map(|(path, stamp)| {
                    let name = path.strip_prefix(derived).ok()?;
                    Some((name.to_string_lossy().replace('\\', "/"), stamp))
                });
                targets.push(wanted.made(names.collect()));
            }
        }
        // What was not read has words instead of a hash.
        let contents = targets.iter().filter_map(|made| {
            let content = made.parts.get(MARKER_FILE).filter(|content| !content.contains(' '))?;
            Some((made.target.name(), content.clone()))
        });
        if let Some(together) = &self.together {
            together.diagnose(&mut output, &contents.collect());
        }
        for path in self.outdated(&targets)? {
            std::fs::remove_file(&path).map_err(|source| StoreError::Remove { path, source })?;
        }
        let parts: Vec<&Fingerprint> = targets.iter().map(|made| &made.parts).collect();
        let outputs =
            output.write(derived, &Provenance { input: hash_of(&(parts, &self.together)) })?;
        Ok((output, StageState { inputs, targets, outputs, ..StageState::default() }))
    }
}
