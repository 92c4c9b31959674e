//! The second stage: tables to fitted models, a target for each model of each campaign.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use trilink_fit::{
    FitData, FitEvent, FitInput, FitInputs, FitKey, Fitted, Replicates, SharedInput, fit_except,
    input_paths,
};
use trilink_tables::config::{Config, GaitInput, ParameterSource};
use trilink_tables::{BootstrapRow, FitRow, Provenance, Reader, SharedFitRow, StoreError};

use super::RunError;
use super::plan::{ROBOTS, Stage, Wanted, Work, hash_of};
use super::record::{Files, Inputs, Record, StageState};
use super::steps::Steps;
use super::target::{Key, Target};

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

    /// All targets, made of their settings and of what the tables have, if they are read.
    pub(super) fn targets(&self, data: Option<&FitData>) -> Vec<Wanted> {
        let FitInputs { own, shared } = &self.inputs;
        let of = |campaigns: &[FitInput]| -> Vec<String> {
            let names = campaigns.iter().map(|input| format!("campaign {}", input.campaign.name));
            names.chain([format!("robot {}", campaigns[0].robot.name)]).collect()
        };
        let of_own = own.iter().map(|input| {
            let parts = data.map_or(Key::new(), |data| parts_of_own(input, data));
            let of = of(std::slice::from_ref(input));
            Wanted::new(Target::of_fit(&input.key()), input, parts, of)
        });
        let of_shared = shared.iter().map(|input| {
            let parts = |data| parts_of(input.trials(data), &input.campaigns[0], data);
            let (parts, of) = (data.map_or(Key::new(), parts), of(&input.campaigns));
            Wanted::new(Target::of_fit(&input.key()), &input.settings(), parts, of)
        });
        of_own.chain(of_shared).collect()
    }

    /// Fits the models that are not kept.
    ///
    /// # Errors
    /// The work was cancelled.
    pub(super) fn fit(
        &self,
        data: &FitData,
        kept: BTreeMap<FitKey, Fitted>,
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
                let (model, status) = (fit.model.name(), fit.status.to_string());
                tracing::debug!(robot, model, j = fit.j, status, "shared fit");
            }
            FitEvent::Replicate { driven_by, row, done, total } => {
                steps.part(&format!("{} {} replicate", row.campaign, row.model), done, total);
                on_replicate(driven_by, row);
            }
        };
        let cancel = steps.watch.cancel_token();
        Ok(fit_except(&self.inputs, data, kept, &self.replicates, &on_event, &cancel)?)
    }
}

/// What a fit is made of beside its settings: trials, and what was measured of the robot if it reads
/// that.
fn parts_of(trials: BTreeMap<String, String>, of_robot: &FitInput, data: &FitData) -> Key {
    let trials = trials.into_iter().map(|(trial, hash)| (format!("trial {trial}"), hash));
    let is_measured = of_robot.fit.robot_parameters == ParameterSource::Measured;
    let robots = is_measured.then(|| (ROBOTS.to_owned(), of_robot.robots(data)));
    trials.chain(robots).collect()
}

/// What a fit of a campaign is made of, and what is said beside it in the comparison.
fn parts_of_own(input: &FitInput, data: &FitData) -> Key {
    let mut parts = parts_of(input.trials(data), input, data);
    let robots = hash_of(&(parts.remove(ROBOTS), input.contradiction(data)));
    parts.insert(ROBOTS.to_owned(), robots);
    parts.insert(WITHOUT_METRICS.to_owned(), input.trials_without_metrics(data).to_string());
    parts
}

impl Stage for FitStage {
    type Sources = FitData;
    type Output = Fitted;
    type Rows = Fitted;

    const NAME: &'static str = "fit";
    const SOURCE: &'static str = env!("TRILINK_FIT_SOURCE");
    const STEPS: &'static str = "fits";
    const ROWS_OF_TARGETS: bool = true;
    const OTHER_ORDER: &'static str = "the configuration has another order of models";

    fn state(record: &Record) -> &StageState {
        &record.fit
    }

    fn home(&self) -> &Path {
        &self.derived
    }

    fn input_paths(&self, _known: &StageState) -> Result<Vec<(PathBuf, bool)>, RunError> {
        Ok(input_paths(&self.derived)?)
    }

    fn foreseen(&self, _known: &StageState) -> Vec<Wanted> {
        self.targets(None)
    }

    fn read(&self, inputs: Inputs) -> Result<FitData, RunError> {
        Ok(FitData::read(&self.derived, &inputs.into_reader()?)?)
    }

    fn wanted(&self, data: &FitData) -> Vec<Wanted> {
        self.targets(Some(data))
    }

    fn earlier(&self, _known: &StageState, written: &Reader) -> Result<Fitted, StoreError> {
        Fitted::read(&self.derived, written)
    }

    fn by_target(&self, _known: &StageState, earlier: Fitted) -> BTreeMap<Target, Fitted> {
        let rows = earlier.by_target().into_iter();
        rows.map(|(key, rows)| (Target::of_fit(&key), rows)).collect()
    }

    fn make(
        &self,
        Work { sources, wanted, mut kept }: Work<Self>,
        steps: &Steps,
    ) -> Result<(Fitted, StageState), RunError> {
        let FitInputs { own, shared } = &self.inputs;
        let keys = own.iter().map(FitInput::key).chain(shared.iter().map(SharedInput::key));
        let kept = keys.filter_map(|key| Some((kept.remove(&Target::of_fit(&key))?.1, key)));
        let kept = kept.map(|(rows, key)| (key, rows)).collect();
        let output = self.fit(&sources, kept, steps, &|_, _| {})?;
        let parts: Vec<&Key> = wanted.iter().map(|wanted| &wanted.parts).collect();
        let outputs = output.write(&self.derived, &Provenance { input: hash_of(&parts) })?;
        let targets = wanted.into_iter().map(|wanted| wanted.made(Files::new())).collect();
        Ok((output, StageState { targets, outputs, ..StageState::default() }))
    }
}
