//! Second pipeline stage: fits models to the ingested tables. Each model of each campaign is a separate build target.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use trilink_fit::{
    FitData, FitEvent, FitInput, FitInputs, FitKey, Fitted, Replicates, SharedInput, fit_except,
    input_paths,
};
use trilink_tables::config::{Config, GaitInput, ParameterSource};
use trilink_tables::{BootstrapRow, FitRow, Provenance, Reader, SharedFitRow, StoreError};

use super::RunError;
use super::plan::{ROBOTS, Stage, TargetSpec, Work, hash_of};
use super::record::{Files, Inputs, Record, StageState};
use super::steps::Steps;
use super::target::{Key, Target};

/// Name, in the [`Key`] of a fit to one campaign, of the entry that holds the campaign's number of trials without
/// metrics.
const WITHOUT_METRICS: &str = "the number of trials without metrics";

/// Fit stage of the pipeline.
pub(super) struct FitStage {
    derived: PathBuf,
    inputs: FitInputs,
    pub replicates: Replicates,
}

impl FitStage {
    pub(super) fn new(config: &Config) -> Self {
        let derived = config.paths.derived.clone();
        Self { derived, inputs: FitInputs::new(config), replicates: Replicates::default() }
    }

    /// Removes from this stage the fits of a model to several campaigns.
    pub(super) fn without_shared(mut self) -> Self {
        self.inputs.shared.clear();
        self
    }

    /// Returns the specification of each fit as a build target. Without `data`, the keys identify only the settings of
    /// the fits, not the data.
    pub(super) fn specs_with(&self, data: Option<&FitData>) -> Vec<TargetSpec> {
        let FitInputs { own, shared } = &self.inputs;
        let own = own.iter().map(|input| {
            let key = data.map_or(Key::new(), |data| own_key(input, data));
            let subjects = subjects(std::slice::from_ref(input));
            TargetSpec::new(Target::from_fit(&input.key()), input, key, subjects)
        });
        let shared = shared.iter().map(|input| {
            let key = data.map_or(Key::new(), |data| {
                let robots = input.robots(data);
                data_key(input.trials(data), &input.campaigns[0], robots)
            });
            let subjects = subjects(&input.campaigns);
            TargetSpec::new(Target::from_fit(&input.key()), &input.settings(), key, subjects)
        });
        own.chain(shared).collect()
    }

    /// Fits the models that are not among the `retained` fits, and returns new and retained fits together. Calls
    /// `on_replicate` after each bootstrap replicate.
    ///
    /// # Errors
    /// Returns an error if the work was cancelled.
    pub(super) fn fit(
        &self,
        data: &FitData,
        retained: BTreeMap<FitKey, Fitted>,
        steps: &Steps,
        on_replicate: &(dyn Fn(GaitInput, &BootstrapRow) + Sync),
    ) -> Result<Fitted, RunError> {
        let on_event = |event: FitEvent| match event {
            FitEvent::Fitted(FitRow { campaign, model, status, j, notes, .. }) => {
                steps.step(&format!("{campaign} {model}"));
                let status = status.to_string();
                tracing::debug!(campaign, model = model.name(), j, status, "fit");
                if !notes.is_empty() {
                    tracing::warn!(campaign, model = model.name(), %notes, "fit");
                }
            }
            FitEvent::Shared(SharedFitRow { robot, fit, .. }) => {
                steps.step(&format!("{robot} {}", fit.model));
                let model = fit.model.name();
                let status = fit.status.name();
                tracing::debug!(robot, model, j = fit.j, status, "shared fit");
            }
            FitEvent::Replicate { driven_by, row, done, total } => {
                steps.part(&format!("{} {} replicate", row.campaign, row.model), done, total);
                on_replicate(driven_by, row);
            }
        };
        let cancel = steps.watch.cancel_token();
        Ok(fit_except(&self.inputs, data, retained, &self.replicates, &on_event, &cancel)?)
    }
}

/// Returns the names of the campaigns and robots on which a fit depends, each preceded by its kind: `campaign a`,
/// `robot b`.
fn subjects(campaigns: &[FitInput]) -> Vec<String> {
    let names = campaigns.iter().map(|input| format!("campaign {}", input.campaign.name));
    let robots: BTreeSet<&String> = campaigns.iter().map(|input| &input.robot.name).collect();
    names.chain(robots.into_iter().map(|robot| format!("robot {robot}"))).collect()
}

/// Returns the part of a fit's key that depends on data, not on settings: hashes of the trials and, if the fit uses the
/// measured parameters of the robots, their hash.
fn data_key(trials: BTreeMap<String, String>, input: &FitInput, robots: String) -> Key {
    let trials = trials.into_iter().map(|(trial, hash)| (format!("trial {trial}"), hash));
    let is_measured = input.fit.robot_parameters == ParameterSource::Measured;
    let robots = is_measured.then(|| (ROBOTS.to_owned(), robots));
    trials.chain(robots).collect()
}

/// Returns the part of the key of a fit to one campaign that depends on data: the same as [`data_key`], extended by the
/// data that the table of model comparisons reports for the campaign.
fn own_key(input: &FitInput, data: &FitData) -> Key {
    let mut key = data_key(input.trials(data), input, input.robots(data));
    let robots = hash_of(&(key.remove(ROBOTS), input.contradiction(data)));
    key.insert(ROBOTS.to_owned(), robots);
    key.insert(WITHOUT_METRICS.to_owned(), input.trials_without_metrics(data).to_string());
    key
}

impl Stage for FitStage {
    type Sources = FitData;
    type Output = Fitted;
    type Rows = Fitted;

    const NAME: &'static str = "fit";
    const SOURCE: &'static str = env!("TRILINK_FIT_SOURCE");
    const STEPS: &'static str = "fits";
    const HAS_TARGET_ROWS: bool = true;
    const ORDER_CHANGED: &'static str = "the order of the models in the configuration has changed";

    fn state(record: &Record) -> &StageState {
        &record.fit
    }

    fn output_folder(&self) -> &Path {
        &self.derived
    }

    fn input_paths(&self, _known: &StageState) -> Result<Vec<(PathBuf, bool)>, RunError> {
        Ok(input_paths(&self.derived)?)
    }

    fn expected_specs(&self, _known: &StageState) -> Vec<TargetSpec> {
        self.specs_with(None)
    }

    fn read(&self, inputs: Inputs) -> Result<FitData, RunError> {
        Ok(FitData::read(&self.derived, &inputs.into_reader()?)?)
    }

    fn specs(&self, data: &FitData) -> Vec<TargetSpec> {
        self.specs_with(Some(data))
    }

    fn load_previous(&self, _known: &StageState, written: &Reader) -> Result<Fitted, StoreError> {
        Fitted::read(&self.derived, written)
    }

    fn rows_by_target(&self, _known: &StageState, earlier: Fitted) -> BTreeMap<Target, Fitted> {
        let rows = earlier.by_target().into_iter();
        rows.map(|(key, rows)| (Target::from_fit(&key), rows)).collect()
    }

    fn make(
        &self,
        Work { sources, specs, mut retained }: Work<Self>,
        steps: &Steps,
    ) -> Result<(Fitted, StageState), RunError> {
        let FitInputs { own, shared } = &self.inputs;
        let keys = own.iter().map(FitInput::key).chain(shared.iter().map(SharedInput::key));
        let retained = keys.filter_map(|key| {
            let (_, rows) = retained.remove(&Target::from_fit(&key))?;
            Some((key, rows))
        });
        let output = self.fit(&sources, retained.collect(), steps, &|_, _| {})?;
        let keys: Vec<&Key> = specs.iter().map(|spec| &spec.key).collect();
        let outputs = output.write(&self.derived, &Provenance { input: hash_of(&keys) })?;
        let targets = specs.into_iter().map(|spec| spec.into_record(Files::new())).collect();
        Ok((output, StageState { targets, outputs, ..StageState::default() }))
    }
}
