//! Names of trials in a baseline, matched with those of the run that is compared with it.

use std::collections::{BTreeMap, BTreeSet};

use super::snapshot::{Records, Snapshot, number, text};

/// Tables whose rows are named by trials.
const TABLES: [&str; 2] = ["trials", "robot_parameters"];
/// Maximum relative difference of the residual between two evaluations of one recording.
const SAME_RECORDING: f64 = 1e-6;

impl Snapshot {
    /// Names the trials of this baseline as in the `candidate` run: trials are matched by folder and id, and the trials
    /// of a folder that only the baseline has with those of a folder that only the candidate has if these are the same
    /// recordings. Returns a sentence for each such folder.
    pub fn match_trials(&mut self, candidate: &Self) -> Vec<String> {
        let [then, now] = [&*self, candidate].map(|run| by_folder(run.records("trials")));
        let mut unmatched: BTreeSet<&str> =
            now.keys().copied().filter(|folder| !then.contains_key(folder)).collect();
        let mut names: BTreeMap<String, String> = BTreeMap::new();
        let mut sentences = Vec::new();
        for (folder, trials) in &then {
            let counterpart = match now.get(folder) {
                Some(_) => Some(*folder),
                None => unmatched.iter().copied().find(|other| are_same(trials, &now[other])),
            };
            let Some(counterpart) = counterpart else { continue };
            if unmatched.remove(counterpart) {
                sentences
                    .push(format!("folder {folder} of the baseline is now called {counterpart}"));
            }
            for (id, (name, _)) in trials {
                if let Some((new, _)) = now[counterpart].get(id) {
                    names.insert((*name).to_owned(), (*new).to_owned());
                }
            }
        }
        for table in TABLES {
            let Some(records) = self.tables.get_mut(table) else { continue };
            let renamed = std::mem::take(records).into_iter();
            *records = renamed
                .map(|(name, record)| (names.get(&name).cloned().unwrap_or(name), record))
                .collect();
        }
        sentences
    }
}

/// Name and residual of each trial, by folder and id.
type Folders<'r> = BTreeMap<&'r str, BTreeMap<&'r str, (&'r str, Option<f64>)>>;

fn by_folder(trials: &Records) -> Folders<'_> {
    let mut folders = Folders::new();
    for (name, record) in trials {
        let trials = folders.entry(text(record, "folder")).or_default();
        trials.insert(text(record, "id"), (name, number(record, "residual_mm")));
    }
    folders
}

/// Returns whether all trials of a folder are in another one and evaluations of the same recordings.
fn are_same(
    then: &BTreeMap<&str, (&str, Option<f64>)>,
    now: &BTreeMap<&str, (&str, Option<f64>)>,
) -> bool {
    let mut is_known = false;
    then.iter().all(|(id, (_, then_mm))| match (then_mm, now.get(id)) {
        (Some(then_mm), Some((_, Some(now_mm)))) => {
            is_known = true;
            (then_mm - now_mm).abs() <= SAME_RECORDING * then_mm.abs()
        }
        (None, Some((_, None))) => true,
        _ => false,
    }) && is_known
}
