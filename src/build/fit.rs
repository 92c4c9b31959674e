//! The second stage: tables to fitted models, a target for each model of each campaign.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use trilink_fit::{
    FitData, FitEvent, FitInput, FitInputs, FitKey, Fitted, Replicates, SharedInput, fit_except,
    input_paths,
};
use trilink_tables::config::{Config, GaitInput, ParameterSource};
use trilink_tables::{BootstrapRow, FitRow, Provenance, Reader, SharedFitRow};

use super::plan::{Stage, Touched, Wanted, Work, hash_of};
use super::record::{Inputs, Made, Record, StageState};
use super::target::{Fingerprint, SETTINGS, Target};
use super::{RunError, Watch};

/// Part of every fit of a campaign, and of what campaigns share if its robot has measured parameters.
const ROBOTS: &str = "robot_parameters.parquet";
/// Part of every fit of a campaign.
const WITHOUT_METRICS: &str = "the number of trials without metrics";

pub(super) struct FitStage {
    derived: PathBuf,
    inputs: FitInputs,
    pub replicates: Replicates,
}

impl FitStage {
    pub(super) fn new(config: &Config) -> Self {
        let (derived, inputs) = (config.paths.derived.clone(), FitInputs::new(config));
        Self { derived, inputs, replicates: Replicates::default() }
    }

    /// The same without what campaigns share.
    pub(super) fn without_shared(mut self) -> Self {
        self.inputs.shared.clear();
        self
    }

    /// How many models are fitted.
    pub(super) fn models(&self) -> usize {
        self.inputs.own.len() + self.inputs.shared.len()
    }

    /// Hashes of what each is fitted with, but for measurements.
    pub(super) fn settings(&self) -> Vec<Fingerprint> {
        let of = self.all_wanted(|_| Fingerprint::new(), |_| Fingerprint::new());
        of.into_iter().map(|wanted| wanted.parts).collect()
    }

    /// All targets with their settings and these other parts.
    fn all_wanted(
        &self,
        own: impl Fn(&FitInput) -> Fingerprint,
        shared: impl Fn(&SharedInput) -> Fingerprint,
    ) -> Vec<Wanted> {
        let FitInputs { own: own_inputs, shared: shared_inputs } = &self.inputs;
        let of_own = own_inputs.iter().map(|of| Wanted::new(of.key().into(), of, own(of)));
        let of_shared =
            shared_inputs.iter().map(|of| Wanted::new(of.key().into(), &of.settings(), shared(of)));
        of_own.chain(of_shared).collect()
    }

    /// What a target is that campaigns share.
    fn shared(&self, target: &Target) -> Option<&SharedInput> {
        self.inputs.shared.iter().find(|input| Target::from(input.key()) == *target)
    }

    /// Fits the models that are not kept.
    ///
    /// # Errors
    /// The work was cancelled.
    pub(super) fn fit(
        &self,
        data: &FitData,
        kept: BTreeMap<FitKey, Fitted>,
        replicates: &Replicates,
        watch: &dyn Watch,
        on_replicate: &(dyn Fn(GaitInput, &BootstrapRow) + Sync),
    ) -> Result<Fitted, RunError> {
        let FitInputs { own, shared } = &self.inputs;
        let (fits, models) = (AtomicUsize::new(0), own.len() + shared.len() - kept.len());
        let on_event = |event: FitEvent| match event {
            FitEvent::Fitted(FitRow { campaign, model, status, j, notes, .. }) => {
                watch.step(&format!("{campaign} {model}"));
                let status = status.to_string();
                tracing::debug!(campaign, model = model.name(), j, status, "fit");
                if !notes.is_empty() {
                    tracing::warn!(campaign, model = model.name(), notes, "fit");
                }
                fits.fetch_add(1, Ordering::Relaxed);
            }
            FitEvent::Shared(SharedFitRow { robot, fit, .. }) => {
                watch.step(&format!("{robot} {}", fit.model));
                let (model, status) = (fit.model.name(), fit.status.to_string());
                tracing::debug!(robot, model, j = fit.j, status, "shared fit");
                fits.fetch_add(1, Ordering::Relaxed);
            }
            FitEvent::Replicate { driven_by, row, done, total } => {
                watch.part(&format!("{} {} replicate", row.campaign, row.model), done, total);
                on_replicate(driven_by, row);
            }
        };
        let fitted =
            fit_except(&self.inputs, data, kept, replicates, &on_event, &watch.cancel_token());
        fitted.map_err(|_| {
            let done = format!("{} of {models} fits", fits.load(Ordering::Relaxed));
            RunError::Interrupted { stage: Self::NAME, done }
        })
    }
}

/// What a fit is made of beside its settings: trials, and what was measured of the robot if it reads
/// that.
fn parts_of(trials: BTreeMap<String, String>, of_robot: &FitInput, data: &FitData) -> Fingerprint {
    let mut parts: Fingerprint =
        trials.into_iter().map(|(trial, hash)| (part_of_trial(&trial), hash)).collect();
    if of_robot.fit.robot_parameters == ParameterSource::Measured {
        parts.insert(ROBOTS.to_owned(), of_robot.robots(data));
    }
    parts
}

/// What a fit of a campaign is made of, and what is said beside it in the comparison.
fn parts_of_own(input: &FitInput, data: &FitData) -> Fingerprint {
    let mut parts = parts_of(input.trials(data), input, data);
    let robots = hash_of(&(parts.remove(ROBOTS), input.contradiction(data)));
    parts.insert(ROBOTS.to_owned(), robots);
    parts.insert(WITHOUT_METRICS.to_owned(), input.trials_without_metrics(data).to_string());
    parts
}

fn part_of_trial(trial: &str) -> String {
    format!("trial {trial}")
}

impl Stage for FitStage {
    type Sources = FitData;
    type Kept = Fitted;
    type Output = Fitted;

    const NAME: &'static str = "fit";
    const SOURCE: &'static str = env!("TRILINK_FIT_SOURCE");
    const ROWS_OF_TARGETS: bool = true;
    const OTHER_ORDER: &'static str = "the configuration has another order of models";
    const NOT_KEPT: &'static str = "fits.parquet does not have it";

    fn state(record: &Record) -> &StageState {
        &record.fit
    }

    fn home(&self) -> &Path {
        &self.derived
    }

    /// Where the tables are as they were, so is what is made of them.
    fn reads_the_same(&self, known: &StageState, inputs: &Inputs) -> Result<bool, RunError> {
        let foreseen = self.foreseen(known);
        let settings = foreseen.iter().map(|wanted| (&wanted.target, wanted.parts.get(SETTINGS)));
        let known_settings =
            known.targets.iter().map(|made| (&made.target, made.parts.get(SETTINGS)));
        let paths = input_paths(&self.derived)?;
        Ok(settings.eq(known_settings) && inputs.are_read(&paths))
    }

    fn read(&self, inputs: &Inputs) -> Result<FitData, RunError> {
        inputs.stamp_all(&input_paths(&self.derived)?)?;
        Ok(FitData::read(&self.derived, &inputs.reader())?)
    }

    fn wanted(&self, data: &FitData) -> Vec<Wanted> {
        let own = |input: &FitInput| parts_of_own(input, data);
        let shared = |input: &SharedInput| parts_of(input.trials(data), &input.campaigns[0], data);
        self.all_wanted(own, shared)
    }

    fn earlier(&self, _known: &StageState, written: &Reader) -> Result<Fitted, String> {
        Fitted::read(&self.derived, written).map_err(|error| error.to_string())
    }

    fn kept(&self, _known: &StageState, earlier: Fitted) -> BTreeMap<Target, Fitted> {
        let is_whole = |key: &FitKey, rows: &Fitted| match key {
            FitKey::Own { .. } => rows.fits.len() == 1 && rows.comparison.len() == 1,
            FitKey::Shared { .. } => rows.shared.len() == 1,
        };
        let whole = earlier.by_target().into_iter().filter(|(key, rows)| is_whole(key, rows));
        whole.map(|(key, rows)| (key.into(), rows)).collect()
    }

    fn make(&self, work: Work<Self>, watch: &dyn Watch) -> Result<(Fitted, StageState), RunError> {
        let Work { sources, wanted, kept } = work;
        let kept = kept.into_iter().filter_map(|(target, (_, rows))| match target {
            Target::Fit { campaign, model } => Some((FitKey::Own { campaign, model }, rows)),
            Target::SharedFit { robot, model } => Some((FitKey::Shared { robot, model }, rows)),
            _ => None,
        });
        let output = self.fit(&sources, kept.collect(), &self.replicates, watch, &|_, _| {})?;
        let parts: Vec<&Fingerprint> = wanted.iter().map(|wanted| &wanted.parts).collect();
        let outputs = output.write(&self.derived, &Provenance { input: hash_of(&parts) })?;
        let targets = wanted.into_iter().map(|wanted| wanted.made(BTreeMap::new())).collect();
        Ok((output, StageState { targets, outputs, ..StageState::default() }))
    }

    fn foreseen(&self, _known: &StageState) -> Vec<Wanted> {
        self.all_wanted(|_| Fingerprint::new(), |_| Fingerprint::new())
    }

    fn perhaps(&self, made: &Made, touched: &Touched) -> Vec<String> {
        let parts = touched.trials.iter().map(|trial| part_of_trial(trial));
        let parts = parts.filter(|part| made.parts.contains_key(part));
        let mut why: Vec<String> = parts.map(|part| format!("if {part} changes")).collect();
        let shared = self.shared(&made.target);
        let own = self.inputs.own.iter().find(|input| Target::from(input.key()) == made.target);
        let robot = own.map(|input| &input.robot.name).or(shared.map(|input| &input.robot));
        if made.parts.contains_key(ROBOTS)
            && robot.is_some_and(|name| touched.robots.contains(name))
        {
            why.push(format!("if {ROBOTS} changes"));
        }
        let shares = |campaign: &String| {
            shared.is_some_and(|of| of.campaigns.iter().any(|of| of.campaign.name == *campaign))
        };
        let is_of =
            |campaign: &String| made.target.campaign() == Some(campaign) || shares(campaign);
        if why.is_empty() && touched.campaigns.iter().any(is_of) {
            why.push("if its trials change".to_owned());
        }
        why
    }
}
