//! The second stage: tables to fitted models, a target for each model of each campaign.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use super::plan::{Stage, Touched, Wanted, Work, hash_of};
use super::record::{Inputs, Made, Record, StageState};
use super::target::{Fingerprint, SETTINGS, Target};
use super::{RunError, Watch};
use crate::config::{Config, GaitInput, ParameterSource};
use crate::fit::{FitData, FitEvent, FitInput, Fitted, Replicates, fit_except, input_paths};
use crate::interrupt::stop_if_asked;
use crate::robot::Model;
use crate::store::{BootstrapRow, FitRow, Provenance, Reader};

/// Part of every fit whose robot has measured parameters.
const ROBOTS: &str = "robot_parameters.parquet";

pub struct FitStage {
    derived: PathBuf,
    inputs: Vec<FitInput>,
    pub replicates: Replicates,
}

impl FitStage {
    pub fn new(config: &Config) -> Self {
        let (derived, inputs) = (config.paths.derived.clone(), FitInput::all(config));
        Self { derived, inputs, replicates: Replicates::default() }
    }

    /// Fits the models that are not kept.
    pub fn fit(
        &self,
        data: &FitData,
        kept: BTreeMap<(String, Model), Fitted>,
        replicates: &Replicates,
        watch: &dyn Watch,
        on_replicate: &(dyn Fn(GaitInput, &BootstrapRow) + Sync),
    ) -> Fitted {
        let (fits, models) = (AtomicUsize::new(0), self.inputs.len() - kept.len());
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
            FitEvent::Replicate { driven_by, row, done, total } => {
                stop_if_asked(|| format!("{} of {models} fits", fits.load(Ordering::Relaxed)));
                watch.part(&format!("{} {} replicate", row.campaign, row.model), done, total);
                on_replicate(driven_by, row);
            }
        };
        fit_except(&self.inputs, data, kept, replicates, &on_event)
    }
}

fn target(input: &FitInput) -> Target {
    Target::Fit { campaign: input.campaign.name.clone(), model: input.model.name }
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
        let of_model = |input: &FitInput| {
            let trials = input.trials(data).into_iter();
            let mut parts: Fingerprint =
                trials.map(|(trial, hash)| (part_of_trial(&trial), hash)).collect();
            if input.fit.robot_parameters == ParameterSource::Measured {
                parts.insert(ROBOTS.to_owned(), input.robots(data));
            }
            Wanted::new(target(input), input, parts)
        };
        self.inputs.iter().map(of_model).collect()
    }

    fn earlier(&self, _known: &StageState, written: &Reader) -> Result<Fitted, String> {
        Fitted::read(&self.derived, written).map_err(|error| error.to_string())
    }

    fn kept(&self, _known: &StageState, earlier: Fitted) -> BTreeMap<Target, Fitted> {
        let is_whole = |rows: &Fitted| rows.fits.len() == 1 && rows.comparison.len() == 1;
        let whole = earlier.by_target().into_iter().filter(|(_, rows)| is_whole(rows));
        whole.map(|((campaign, model), rows)| (Target::Fit { campaign, model }, rows)).collect()
    }

    fn make(&self, work: Work<Self>, watch: &dyn Watch) -> Result<(Fitted, StageState), RunError> {
        let Work { sources, wanted, kept } = work;
        let kept = kept.into_iter().filter_map(|(target, (_, rows))| match target {
            Target::Fit { campaign, model } => Some(((campaign, model), rows)),
            _ => None,
        });
        let output = self.fit(&sources, kept.collect(), &self.replicates, watch, &|_, _| {});
        let parts: Vec<&Fingerprint> = wanted.iter().map(|wanted| &wanted.parts).collect();
        let outputs = output.write(&self.derived, &Provenance { input: hash_of(&parts) })?;
        let targets = wanted.into_iter().map(|wanted| wanted.made(BTreeMap::new())).collect();
        Ok((output, StageState { targets, outputs, ..StageState::default() }))
    }

    fn foreseen(&self, _known: &StageState) -> Vec<Wanted> {
        let of_model = |input| Wanted::new(target(input), input, Fingerprint::new());
        self.inputs.iter().map(of_model).collect()
    }

    fn perhaps(&self, made: &Made, touched: &Touched) -> Vec<String> {
        let parts = touched.trials.iter().map(|trial| part_of_trial(trial));
        let parts = parts.filter(|part| made.parts.contains_key(part));
        let mut why: Vec<String> = parts.map(|part| format!("if {part} changes")).collect();
        let input = self.inputs.iter().find(|input| target(input) == made.target);
        let robot = input.map(|input| &input.robot.name);
        if made.parts.contains_key(ROBOTS)
            && robot.is_some_and(|name| touched.robots.contains(name))
        {
            why.push(format!("if {ROBOTS} changes"));
        }
        let is_of =
            |campaign| matches!(&made.target, Target::Fit { campaign: c, .. } if c == campaign);
        if why.is_empty() && touched.campaigns.iter().any(is_of) {
            why.push("if its trials change".to_owned());
        }
        why
    }
}
