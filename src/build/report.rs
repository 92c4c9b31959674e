//! Third pipeline stage: report. Each figure and each trial page is a separate build target.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde_json::Value;
use trilink_report::{Content, ReportInput, Reported, input_paths};
use trilink_tables::config::Config;
use trilink_tables::{Reader, StoreError};

use super::RunError;
use super::plan::{ANY_ROBOT, Stage, TargetSpec, Work};
use super::record::{Inputs, Record, StageState};
use super::steps::Steps;
use super::target::{Key, Kind, Target};
use crate::compare::changes;

/// Report stage of the pipeline.
pub(super) struct ReportStage(ReportInput);

impl ReportStage {
    /// Creates the stage. It writes pages for the trials in `asked` and for those requested in earlier runs.
    pub(super) fn new(config: &Config, known: &StageState, asked: &[String]) -> Self {
        let before = known.whole.get("asked_pages").and_then(Value::as_array);
        let before = before.into_iter().flatten().filter_map(Value::as_str).map(str::to_owned);
        Self(ReportInput::new(config, before.chain(asked.iter().cloned()).collect()))
    }
}

impl Stage for ReportStage {
    type Sources = Content;
    type Output = Reported;
    /// No rows: figures and pages consist of files only.
    type Rows = ();

    const NAME: &'static str = "report";
    const SOURCE: &'static str = env!("TRILINK_REPORT_SOURCE");
    const STEPS: &'static str = "";
    const HAS_TARGET_ROWS: bool = false;
    const ORDER_CHANGED: &'static str = "the order of the figures has changed";

    fn state(record: &Record) -> &StageState {
        &record.report
    }

    fn output_folder(&self) -> &Path {
        &self.0.paths.reports
    }

    fn stage_settings(&self) -> Value {
        serde_json::to_value(&self.0).expect("a configuration can be serialised")
    }

    fn input_paths(&self, _known: &StageState) -> Result<Vec<(PathBuf, bool)>, RunError> {
        Ok(input_paths(&self.0.paths)?)
    }

    /// Returns the specifications of the figures and pages in the last report; new ones are known only once the tables
    /// are read.
    fn expected_specs(&self, known: &StageState) -> Vec<TargetSpec> {
        let targets = known.targets.iter().map(|made| (made.target.clone(), made.subjects.clone()));
        targets
            .map(|(target, subjects)| TargetSpec::new(target, &(), Key::new(), subjects))
            .collect()
    }

    fn read(&self, inputs: Inputs) -> Result<Content, RunError> {
        let reader = inputs.into_reader()?;
        let changes = changes(self.0.tolerances(), &self.0.paths, &reader)?;
        Ok(Content::read(&self.0, reader)?.with_changes(changes))
    }

    fn specs(&self, content: &Content) -> Vec<TargetSpec> {
        let figures = content.figures().map(|(stem, campaigns, hash)| {
            let subjects = match campaigns {
                [] => vec![ANY_ROBOT.to_owned()],
                campaigns => {
                    campaigns.iter().map(|campaign| format!("campaign {campaign}")).collect()
                }
            };
            let key = Key::from([("what it shows".to_owned(), hash)]);
            TargetSpec::new(Target::new(Kind::Figure, stem), &(), key, subjects)
        });
        let pages = content.page_parts().iter().map(|(name, (campaign, key))| {
            let mut subjects = Vec::new();
            if !campaign.is_empty() {
                subjects.push(format!("campaign {campaign}"));
            }
            TargetSpec::new(Target::new(Kind::Page, name), &(), key.clone(), subjects)
        });
        figures.chain(pages).collect()
    }

    fn load_previous(&self, known: &StageState, _written: &Reader) -> Result<Reported, StoreError> {
        let targets = known.targets.iter().map(|made| &made.target);
        let figures = targets.filter(|target| target.kind == Kind::Figure);
        let figures = figures.map(|target| target.name.clone()).collect();
        Ok(Reported::new(&self.0, figures, known.missing.clone(), known.damaged.clone()))
    }

    fn rows_by_target(&self, known: &StageState, _earlier: Reported) -> BTreeMap<Target, ()> {
        known.targets.iter().map(|made| (made.target.clone(), ())).collect()
    }

    fn make(
        &self,
        Work { sources, specs, mut retained }: Work<Self>,
        steps: &Steps,
    ) -> Result<(Reported, StageState), RunError> {
        let [figures, pages] = [Kind::Figure, Kind::Page].map(|kind| -> BTreeSet<String> {
            let targets = retained.keys().filter(|target| target.kind == kind);
            targets.map(|target| target.name.clone()).collect()
        });
        let made = sources.write(&self.0, &figures, &pages, &steps.watch.cancel_token())?;
        made.reported.missing.iter().for_each(|missing| tracing::warn!(missing, "not drawn"));
        steps.step(&format!("{} figures and pages", specs.len() - retained.len()));
        let mut written = made.targets;
        let targets = specs.into_iter().map(|spec| match retained.remove(&spec.target) {
            Some((made, ())) => made,
            None => {
                let outputs = written.remove(&spec.target.name).unwrap_or_default();
                spec.into_record(outputs)
            }
        });
        let targets = targets.collect();
        let Reported { missing, damaged, .. } = made.reported.clone();
        let state = StageState {
            targets,
            outputs: made.outputs,
            missing,
            damaged,
            ..StageState::default()
        };
        Ok((made.reported, state))
    }
}
