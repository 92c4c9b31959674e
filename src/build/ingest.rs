//! The first stage: marker files to tables, a target for each trial.

use std::collections::{BTreeMap, HashSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Instant;

use rayon::prelude::*;
use serde_json::{Value, json};
use trilink_base::files::name_in;
use trilink_ingest::{
    Entry, FolderInput, IngestInput, Ingested, MarkerStamp, ingest_trials, outdated, undiagnosed,
};
use trilink_tables::config::Config;
use trilink_tables::trial::{ListedTrial, TrialError, TrialFolder, TrialFolders};
use trilink_tables::{Provenance, Reader, StoreError, TrialRow, TrialStatus};

use super::RunError;
use super::plan::{ANY_ROBOT, Stage, Wanted, Work, hash_of};
use super::record::{Inputs, Made, Record, StageState};
use super::steps::Steps;
use super::target::{Key, Kind, Target};

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

    /// Tables of trials that are of none of the targets.
    fn outdated(&self, targets: &[Made]) -> Result<Vec<PathBuf>, StoreError> {
        let current = targets.iter().flat_map(|made| made.outputs.keys().map(String::as_str));
        outdated(&self.derived, &current.collect())
    }

    /// What a trial is made of but for its marker file.
    fn without_file(Entry { folder, listed, input }: Entry) -> Wanted {
        let trial = &listed.trial;
        let parts = Key::from([
            (ENTRY.to_owned(), hash_of(trial)),
            (FOLDER.to_owned(), folder.name.clone()),
        ]);
        let mut of = vec![format!("trial {}", trial.id)];
        of.extend(trial.campaign.iter().map(|campaign| format!("campaign {campaign}")));
        of.extend(
            trial.robot.iter().flat_map(|name| [format!("robot {name}"), ANY_ROBOT.to_owned()]),
        );
        let target = Target::new(Kind::Trial, &trial.id);
        match input {
            Ok(input) => Wanted::new(target, input, parts, of),
            // What is wrong is said with names of the configuration.
            Err(error) => Wanted::new(target, &json!({ "entry": error.to_string() }), parts, of),
        }
    }

    /// [`Self::without_file`] with the marker file.
    fn trial(entry: Entry, file: Option<&MarkerStamp>) -> Wanted {
        let mut wanted = Self::without_file(entry);
        let file = match file {
            Some(Ok(stamp)) => stamp.blake3.clone(),
            Some(Err(kind)) => format!("unreadable: {kind}"),
            None => "not read".to_owned(),
        };
        wanted.parts.insert(MARKER_FILE.to_owned(), file);
        wanted
    }
}

impl Stage for IngestStage {
    /// The marker files of the trials that were made before.
    type Sources = Vec<Option<MarkerStamp>>;
    type Output = Ingested;
    type Rows = Ingested;

    const NAME: &'static str = "ingest";
    const SOURCE: &'static str = env!("TRILINK_INGEST_SOURCE");
    const STEPS: &'static str = "trials";
    const ROWS_OF_TARGETS: bool = true;
    const OTHER_ORDER: &'static str = "trials.toml has another order";

    fn state(record: &Record) -> &StageState {
        &record.ingest
    }

    fn home(&self) -> &Path {
        &self.derived
    }

    fn whole(&self) -> Value {
        json!(self.together)
    }

    fn input_paths(&self, known: &StageState) -> Result<Vec<(PathBuf, bool)>, RunError> {
        let made: HashSet<&str> = known.targets.iter().map(|made| &*made.target.name).collect();
        let is_made = |entry: &Entry| entry.input.is_ok() && made.contains(&*entry.listed.trial.id);
        Ok(self.entries().filter(is_made).map(|entry| (entry.marker_file(), false)).collect())
    }

    fn foreseen(&self, _known: &StageState) -> Vec<Wanted> {
        let wanted = |index| Self::without_file(self.entry(index));
        (0..self.trials.len()).into_par_iter().map(wanted).collect()
    }

    fn read(&self, inputs: Inputs) -> Result<Self::Sources, RunError> {
        // A file that is not there is known; what cannot be read may be there the next time.
        let is_known =
            |file: &MarkerStamp| !matches!(file, Err(kind) if *kind != ErrorKind::NotFound);
        let file = |entry: Entry| inputs.get(&entry.marker_file()).filter(is_known);
        Ok(self.entries().map(file).collect())
    }

    fn wanted(&self, files: &Self::Sources) -> Vec<Wanted> {
        let wanted = |index: usize| Self::trial(self.entry(index), files[index].as_ref());
        (0..self.trials.len()).into_par_iter().map(wanted).collect()
    }

    fn earlier(&self, _known: &StageState, written: &Reader) -> Result<Ingested, StoreError> {
        Ingested::read(&self.derived, written)
    }

    fn by_target(&self, _known: &StageState, earlier: Ingested) -> BTreeMap<Target, Ingested> {
        let rows = earlier.by_target().into_iter();
        rows.map(|(id, rows)| (Target::new(Kind::Trial, &id), undiagnosed(rows))).collect()
    }

    /// What a run left that was killed before it recorded them.
    fn leftovers(&self, known: &StageState) -> Result<Vec<String>, RunError> {
        let outdated = self.outdated(&known.targets)?;
        Ok(outdated.iter().map(|path| format!("{} is of no trial", path.display())).collect())
    }

    fn make(
        &self,
        Work { mut kept, .. }: Work<Self>,
        steps: &Steps,
    ) -> Result<(Ingested, StageState), RunError> {
        self.notes.iter().for_each(|sentence| steps.watch.note(sentence));
        let derived = &self.derived;
        let target = |entry: &Entry| Target::new(Kind::Trial, &entry.listed.trial.id);
        let redone: Vec<Entry> =
            self.entries().filter(|entry| !kept.contains_key(&target(entry))).collect();
        let begin = Instant::now();
        let on_trial = |TrialRow { trial, status, message, .. }: &TrialRow| {
            steps.step(&format!("{trial} {status}"));
            let after_s = begin.elapsed().as_secs_f64();
            let (is_ok, status) = (*status == TrialStatus::Ok, status.name());
            match is_ok {
                true => tracing::debug!(trial, status, after_s, "trial"),
                false => tracing::warn!(trial, status, message, "trial"),
            }
        };
        let provenance = |entry: Entry, file: Option<&MarkerStamp>| Provenance {
            input: hash_of(&Self::trial(entry, file).parts),
        };
        let cancel = steps.watch.cancel_token();
        let mut ingested =
            ingest_trials(derived, &redone, &provenance, &on_trial, &cancel)?.into_iter();
        let (mut output, mut state) = (Ingested::default(), StageState::default());
        for entry in self.entries() {
            if let Some((made, rows)) = kept.remove(&target(&entry)) {
                output.extend(rows);
                state.targets.push(made);
            } else if let Some(new) = ingested.next() {
                let wanted = Self::trial(entry, new.marker_file.as_ref());
                if let Some(Ok(stamp)) = new.marker_file {
                    state.inputs.insert(name_in(derived, &entry.marker_file()), stamp);
                }
                output.extend(new.rows);
                let written = new.written.into_iter();
                let outputs = written.map(|(path, stamp)| (name_in(derived, &path), stamp));
                state.targets.push(wanted.made(outputs.collect()));
            }
        }
        // What was not read has words instead of a hash.
        let contents = state.targets.iter().filter_map(|made| {
            let content = made.parts.get(MARKER_FILE).filter(|content| !content.contains(' '))?;
            Some((made.target.name.clone(), content.clone()))
        });
        if let Some(together) = &self.together {
            together.diagnose(&mut output, &contents.collect());
        }
        for path in self.outdated(&state.targets)? {
            std::fs::remove_file(&path).map_err(|source| StoreError::Remove { path, source })?;
        }
        let parts: Vec<&Key> = state.targets.iter().map(|made| &made.parts).collect();
        let provenance = Provenance { input: hash_of(&(parts, &self.together)) };
        state.outputs = output.write(derived, &provenance)?;
        Ok((output, state))
    }
}
