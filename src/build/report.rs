//! The third stage: figures and pages, a target for each.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde_json::Value;
use trilink_report::{Content, ReportInput, Reported, input_paths};
use trilink_tables::config::Config;
use trilink_tables::{Reader, StoreError};

use super::RunError;
use super::plan::{ANY_ROBOT, Stage, Wanted, Work};
use super::record::{Inputs, Record, StageState};
use super::steps::Steps;
use super::target::{Key, Kind, Target};
use crate::compare::changes;

pub(super) struct ReportStage(ReportInput);

impl ReportStage {
    /// With the pages of the trials that are `asked` for now or were before.
    pub(super) fn new(config: &Config, known: &StageState, asked: &[String]) -> Self {
        let before = known.whole.get("asked_pages").and_then(Value::as_array);
        let before = before.into_iter().flatten().filter_map(Value::as_str).map(str::to_owned);
        Self(ReportInput::new(config, before.chain(asked.iter().cloned()).collect()))
    }
}

impl Stage for ReportStage {
    type Sources = Content;
    type Output = Reported;
    /// Of pages and figures there are only files.
    type Rows = ();

    const NAME: &'static str = "report";
    const SOURCE: &'static str = env!("TRILINK_REPORT_SOURCE");
    const STEPS: &'static str = "";
    const ROWS_OF_TARGETS: bool = false;
    const OTHER_ORDER: &'static str = "figures have another order";

    fn state(record: &Record) -> &StageState {
        &record.report
    }

    fn home(&self) -> &Path {
        &self.0.paths.reports
    }

    fn whole(&self) -> Value {
        serde_json::to_value(&self.0).expect("a configuration is plain data")
    }

    fn input_paths(&self, _known: &StageState) -> Result<Vec<(PathBuf, bool)>, RunError> {
        Ok(input_paths(&self.0.paths)?)
    }

    /// What it has drawn: what else there is to draw only the tables tell.
    fn foreseen(&self, known: &StageState) -> Vec<Wanted> {
        let targets = known.targets.iter().map(|made| (made.target.clone(), made.of.clone()));
        targets.map(|(target, of)| Wanted::new(target, &(), Key::new(), of)).collect()
    }

    fn read(&self, inputs: Inputs) -> Result<Content, RunError> {
        let reader = inputs.into_reader()?;
        let changes = changes(self.0.tolerances(), &self.0.paths, &reader)?;
        Ok(Content::read(&self.0, reader)?.with_changes(changes))
    }

    fn wanted(&self, content: &Content) -> Vec<Wanted> {
        let of = |campaign: &String| format!("campaign {campaign}");
        let figures = content.figures().map(|(stem, campaigns, hash)| {
            let of = match campaigns {
                [] => vec![ANY_ROBOT.to_owned()],
                campaigns => campaigns.iter().map(of).collect(),
            };
            let parts = Key::from([("what it shows".to_owned(), hash)]);
            Wanted::new(Target::new(Kind::Figure, stem), &(), parts, of)
        });
        let pages = content.page_parts().iter().map(|(name, (campaign, parts))| {
            let of = Some(campaign).filter(|campaign| !campaign.is_empty()).map(of);
            let of = of.into_iter().collect();
            Wanted::new(Target::new(Kind::Page, name), &(), parts.clone(), of)
        });
        figures.chain(pages).collect()
    }

    fn earlier(&self, known: &StageState, _written: &Reader) -> Result<Reported, StoreError> {
        let targets = known.targets.iter().map(|made| &made.target);
        let figures = targets.filter(|target| target.kind == Kind::Figure);
        let figures = figures.map(|target| target.name.clone()).collect();
        Ok(Reported::new(&self.0, figures, known.missing.clone(), known.damaged.clone()))
    }

    fn by_target(&self, known: &StageState, _earlier: Reported) -> BTreeMap<Target, ()> {
        known.targets.iter().map(|made| (made.target.clone(), ())).collect()
    }

    fn make(
        &self,
        Work { sources, wanted, mut kept }: Work<Self>,
        steps: &Steps,
    ) -> Result<(Reported, StageState), RunError> {
        let of_kind = |kind: Kind| -> BTreeSet<String> {
            let targets = kept.keys().filter(|target| target.kind == kind);
            targets.map(|target| target.name.clone()).collect()
        };
        let (figures, pages) = (of_kind(Kind::Figure), of_kind(Kind::Page));
        let made = sources.write(&self.0, &figures, &pages, &steps.watch.cancel_token())?;
        made.reported.missing.iter().for_each(|missing| tracing::warn!(missing, "not drawn"));
        steps.step(&format!("{} figures and pages", wanted.len() - kept.len()));
        let mut written = made.targets;
        let targets = wanted.into_iter().map(|wanted| match kept.remove(&wanted.target) {
            Some((made, ())) => made,
            None => {
                let outputs = written.remove(&wanted.target.name).unwrap_or_default();
                wanted.made(outputs)
            }
        });
        let Reported { missing, damaged, .. } = made.reported.clone();
        let (targets, outputs) = (targets.collect(), made.outputs);
        let state = StageState { targets, outputs, missing, damaged, ..StageState::default() };
        Ok((made.reported, state))
    }
}
