//! The first stage: marker files to tables, a target for each trial.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use serde_json::json;

use super::plan::{PlannedTarget, Stage, StagePlan, Touched, Wanted, Work, hash_of};
use super::record::{Inputs, Made, Record, StageState, name_in};
use super::target::{Fingerprint, Target};
use super::{RunError, Watch};
use crate::config::{Config, Paths};
use crate::ingest::{
    Entry, FolderInput, IngestInput, Ingested, MarkerStamp, ingest_trials, outdated, undiagnosed,
};
use crate::interrupt::stop_if_asked;
use crate::store::{Provenance, Reader, StoreError, TrialRow, TrialStatus};
use crate::trial::{Trial, TrialError, TrialList};

const ENTRY: &str = "the entry in trials.toml";
const MARKER_FILE: &str = "the marker file";
/// Part of trials that failed: their messages name the file.
const PLACE: &str = "the place of the marker file";

pub struct IngestStage {
    paths: Paths,
    trials: Vec<(Trial, Result<IngestInput, TrialError>)>,
    folder: FolderInput,
}

impl IngestStage {
    /// # Errors
    /// The list of trials cannot be used.
    pub fn new(config: &Config) -> Result<Self, RunError> {
        let list = TrialList::load(&config.paths.raw)?;
        let folder = FolderInput::new(config, &config.paths.raw, &list);
        let with_input = |trial: Trial| {
            let input = IngestInput::new(config, &trial);
            (trial, input)
        };
        let trials = list.trial.into_iter().map(with_input).collect();
        Ok(Self { paths: config.paths.clone(), trials, folder })
    }

    /// What later stages may find changed by what is planned.
    pub fn touched(&self, plan: &StagePlan) -> Touched {
        let mut touched = Touched::default();
        let redone = plan.targets.iter().map(|PlannedTarget { target, .. }| target);
        touched.trials.extend(redone.chain(&plan.removed).map(Target::name));
        for (trial, _) in self.trials.iter().filter(|(trial, _)| touched.trials.contains(&trial.id))
        {
            touched.campaigns.extend(trial.campaign.clone());
            touched.robots.extend(trial.robot.clone());
        }
        touched
    }

    fn marker_file(&self, trial: &Trial) -> PathBuf {
        self.paths.raw.join(&trial.file)
    }

    fn table_paths<'m>(&self, made: impl IntoIterator<Item = &'m Made>) -> Vec<PathBuf> {
        let names = made.into_iter().flat_map(|made| made.outputs.keys());
        names.map(|name| self.paths.derived.join(name)).collect()
    }

    /// What a trial is made of but for its marker file.
    fn entry((trial, input): Entry) -> Wanted {
        let parts = Fingerprint::from([(ENTRY.to_owned(), hash_of(trial))]);
        let target = Target::Trial(trial.id.clone());
        match input {
            Ok(input) => Wanted::new(target, input, parts),
            // What is wrong is said with names of the configuration.
            Err(error) => Wanted::new(target, &json!({ "entry": error.to_string() }), parts),
        }
    }

    /// [`Self::entry`] with the marker file.
    fn trial(entry: Entry, file: Option<&MarkerStamp>) -> Wanted {
        let mut wanted = Self::entry(entry);
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
        &self.paths.derived
    }

    fn whole(&self) -> serde_json::Value {
        json!(self.folder)
    }

    fn read(&self, _inputs: &mut Inputs) -> Result<(), RunError> {
        Ok(())
    }

    fn wanted(&self, _sources: &()) -> Vec<Wanted> {
        self.trials.iter().map(|(trial, input)| Self::entry((trial, input))).collect()
    }

    fn complete(
        &self,
        index: usize,
        wanted: &mut Wanted,
        made: &Made,
        inputs: &mut Inputs,
    ) -> Option<String> {
        let (trial, input) = &self.trials[index];
        let path = self.marker_file(trial);
        let stamp = input.is_ok().then(|| inputs.stamp(&path, false).map_err(|e| e.kind()));
        wanted.parts.insert(MARKER_FILE.to_owned(), of_file(stamp.as_ref()));
        if made.parts.contains_key(PLACE) {
            wanted.parts.insert(PLACE.to_owned(), path.display().to_string());
        }
        // A file that is not there is known; what cannot be read may be there the next time.
        let is_unreadable = |stamp| matches!(stamp, Some(Err(kind)) if kind != ErrorKind::NotFound);
        is_unreadable(stamp).then(|| format!("{MARKER_FILE} cannot be read"))
    }

    fn earlier(&self, _known: &StageState, written: &Reader) -> Result<Ingested, String> {
        Ingested::read(&self.paths.derived, written).map_err(|error| error.to_string())
    }

    fn kept(&self, _known: &StageState, earlier: Ingested) -> BTreeMap<Target, Ingested> {
        let whole = earlier.by_target().into_iter().filter(|(_, rows)| rows.trials.len() == 1);
        whole.map(|(id, rows)| (Target::Trial(id), undiagnosed(rows))).collect()
    }

    /// What a run left that was killed before it recorded them.
    fn leftovers(&self, known: &StageState) -> Result<Vec<String>, RunError> {
        let recorded = self.table_paths(&known.targets).into_iter().collect();
        let outdated = outdated(&self.paths.derived, &recorded)?;
        Ok(outdated.iter().map(|path| format!("{} is of no trial", path.display())).collect())
    }

    fn make(
        &self,
        mut work: Work<Self>,
        watch: &dyn Watch,
    ) -> Result<(Ingested, StageState), RunError> {
        let Paths { raw, derived, .. } = &self.paths;
        let entries = self.trials.iter().map(|(trial, input)| (trial, input));
        let is_kept = |(trial, _): &Entry| work.kept.contains_key(&Target::Trial(trial.id.clone()));
        let redone: Vec<Entry> = entries.filter(|entry| !is_kept(entry)).collect();
        let (begin, done, total) = (Instant::now(), AtomicUsize::new(0), redone.len());
        let on_trial = |TrialRow { trial, status, message, .. }: &TrialRow| {
            watch.step(&format!("{trial} {status}"));
            let after_s = begin.elapsed().as_secs_f64();
            let (is_ok, status) = (*status == TrialStatus::Ok, status.name());
            match is_ok {
                true => tracing::debug!(trial, status, after_s, "trial"),
                false => tracing::warn!(trial, status, message, "trial"),
            }
            let done = 1 + done.fetch_add(1, Ordering::Relaxed);
            stop_if_asked(|| format!("{done} of {total} trials"));
        };
        let provenance = |entry: Entry, file: Option<&MarkerStamp>| Provenance {
            input: hash_of(&Self::trial(entry, file).parts),
        };
        let mut ingested =
            ingest_trials(raw, derived, &redone, &provenance, &on_trial)?.into_iter();
        let (mut output, mut targets, mut inputs) =
            (Ingested::default(), Vec::new(), BTreeMap::new());
        for (trial, input) in &self.trials {
            if let Some((made, rows)) = work.kept.remove(&Target::Trial(trial.id.clone())) {
                output.extend(rows);
                targets.push(made);
            } else if let Some(new) = ingested.next() {
                let mut wanted = Self::trial((trial, input), new.marker_file.as_ref());
                let path = self.marker_file(trial);
                if new.written.is_empty() {
                    wanted.parts.insert(PLACE.to_owned(), path.display().to_string());
                }
                if let Some(Ok(stamp)) = new.marker_file {
                    inputs.insert(name_in(derived, &path), stamp);
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
        self.folder.diagnose(&mut output, &contents.collect());
        for path in outdated(derived, &self.table_paths(&targets).into_iter().collect())? {
            std::fs::remove_file(&path).map_err(|source| StoreError::Remove { path, source })?;
        }
        let parts: Vec<&Fingerprint> = targets.iter().map(|made| &made.parts).collect();
        let outputs =
            output.write(derived, &Provenance { input: hash_of(&(parts, &self.folder)) })?;
        Ok((output, StageState { inputs, targets, outputs, ..StageState::default() }))
    }
}
