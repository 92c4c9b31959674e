//! Parts that were made elsewhere, joined into the tables of an undivided stage.

use std::collections::BTreeMap;
use std::path::Path;

use rayon::prelude::*;
use trilink_base::cancel::CancelToken;
use trilink_fit::{Fitted, Replicates};
use trilink_ingest::Ingested;
use trilink_tables::config::Config;
use trilink_tables::{StoreError, write_if_changed};

use super::found::{PartStatus, Refits, Shard, Shards, ShardsStatus, look};
use super::ingest::IngestStage;
use super::plan::{RerunOptions, Stage, join};
use super::record::Made;
use super::shard::{Manifest, fit_of_any_number};
use super::target::Target;
use super::{RunError, Sequence, Watch, interruptible, take_over};

/// Files that are copied at a time: most of that is waiting for the disk.
const COPIES: usize = 16;

/// What parts were joined into.
#[derive(Debug)]
pub enum Merged {
    Trials(Ingested),
    Fits(Fitted),
}

/// Joins all parts into the tables that an undivided stage leaves. If parts of the trials may be
/// missing, the tables are of the other trials.
///
/// # Errors
/// A part is missing or cannot be joined, then nothing is written; or a file cannot be written, or
/// another process is busy.
pub fn merge(
    config: &Config,
    shards: &Path,
    allow_missing: bool,
    wait: bool,
    watch: &dyn Watch,
) -> Result<(Merged, ShardsStatus), RunError> {
    let (found, status) = look(config, shards)?;
    // Fewer replicates are no bootstrap of this number.
    let is_some = matches!(&found, Shards::Trials(_, whole) if !whole.is_empty());
    let is_refused = |status: &PartStatus| match status {
        PartStatus::Whole(_) => false,
        PartStatus::Missing | PartStatus::Unfinished => !(allow_missing && is_some),
        PartStatus::Refused(_) => true,
    };
    let refused = status.parts.iter().filter(|(.., status)| is_refused(status));
    let problems = refused.map(|(folder, _, status)| format!("\n  {}: {status}", folder.display()));
    let problems: String = problems.collect();
    if !problems.is_empty() {
        return Err(RunError::Shards { problems, again: status.again() });
    }
    let merged = match found {
        Shards::Trials(stage, shards) => {
            Merged::Trials(merge_trials(config, stage, shards, wait, watch)?)
        }
        Shards::Replicates(project, shards) => {
            Merged::Fits(merge_replicates(config, &project, shards, wait, watch)?)
        }
    };
    Ok((merged, status))
}

fn merge_trials(
    config: &Config,
    mut stage: IngestStage,
    shards: Vec<Shard<Ingested>>,
    wait: bool,
    watch: &dyn Watch,
) -> Result<Ingested, RunError> {
    let derived = &config.paths.derived;
    let of: Vec<String> = stage.folders().cloned().collect();
    let is_other = |folder: &String| !of.contains(folder);
    let known = Sequence::new(config, RerunOptions::FORCE, watch).0.known_folders();
    if let Some(folder) = known.into_iter().find(is_other) {
        return Err(RunError::OtherFolder { derived: derived.clone(), folder, of });
    }
    let _lock = take_over(config, wait, watch)?;
    let mut record = Sequence::new(config, RerunOptions::FORCE, watch).0.record;
    let (ingested, _, state) = interruptible(IngestStage::NAME, || {
        watch.begin("merge", shards.len());
        let cancel = watch.cancel_token();
        let joined = |shard: Shard<Ingested>| {
            let part = shard.manifest.part;
            let copied = copy(&stage, shard, derived, &cancel)?;
            watch.step(&part.to_string());
            tracing::info!(%part, "merged");
            Ok(copied)
        };
        let join_all = || shards.into_iter().map(joined).collect::<Result<Vec<_>, StoreError>>();
        let kept = match rayon::ThreadPoolBuilder::new().num_threads(COPIES).build() {
            Ok(pool) => pool.install(join_all),
            Err(_) => join_all(),
        };
        let kept: BTreeMap<Target, _> = kept?.into_iter().flatten().collect();
        stage.retain(|trial| kept.contains_key(&Target::Trial(trial.to_owned())));
        join(&stage, &record, kept).carry_out(&stage, watch)
    })?;
    (record.ingest, record.run) = (state, None);
    record.save(derived)?;
    Ok(ingested)
}

/// Fits all models with the replicates of the parts.
fn merge_replicates(
    config: &Config,
    project: &str,
    shards: Vec<Shard<Refits>>,
    wait: bool,
    watch: &dyn Watch,
) -> Result<Fitted, RunError> {
    let _lock = take_over(config, wait, watch)?;
    let (mut stage, _, now) = fit_of_any_number(config)?;
    if now != project {
        return Err(StoreError::Changed { path: config.paths.derived.clone() }.into());
    }
    let mut given = Refits::new();
    for (driven_by, rows) in shards.into_iter().flat_map(|shard| shard.rows) {
        given.entry(driven_by).or_default().extend(rows);
    }
    stage.replicates = Replicates { numbers: 0..0, given };
    let mut sequence = Sequence::new(config, RerunOptions::FORCE, watch).0;
    sequence.record.run = None;
    sequence.advance(&stage)
}

/// A trial that was made, with its rows.
type Kept = (Target, (Made, Ingested));

/// Copies the tables of a part's trials; gives the trials as made here.
fn copy(
    stage: &IngestStage,
    shard: Shard<Ingested>,
    derived: &Path,
    cancel: &CancelToken,
) -> Result<Vec<Kept>, StoreError> {
    let Shard { folder, manifest: Manifest { mut state, .. }, rows, reader } = shard;
    let targets = std::mem::take(&mut state.targets);
    let mut rows = stage.kept(&state, rows);
    let trials: Vec<_> =
        targets.into_iter().filter_map(|made| Some((rows.remove(&made.target)?, made))).collect();
    let copied = trials.into_par_iter().map(|(rows, mut made)| {
        cancel.check()?;
        for (name, stamp) in &mut made.outputs {
            let bytes = reader.bytes(&folder.join(name))?;
            *stamp = write_if_changed(&derived.join(name), &bytes)?;
        }
        Ok((made.target.clone(), (made, rows)))
    });
    copied.collect()
}
