//! The third stage: figures and pages, a target for each.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::Value;
use trilink_report::{Content, ReportInput, Reported, input_paths, page_of};
use trilink_tables::Reader;
use trilink_tables::config::Config;

use super::plan::{Stage, Touched, Wanted, Work};
use super::record::{Inputs, Made, Record, StageState};
use super::target::{Fingerprint, Target};
use super::{RunError, Watch};
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

/// Stems of the figures that were made.
fn figures(known: &StageState) -> impl Iterator<Item = &str> {
    known.targets.iter().filter_map(|made| match &made.target {
        Target::Figure(stem) => Some(stem.as_str()),
        _ => None,
    })
}

impl Stage for ReportStage {
    type Sources = Content;
    /// The SVG of a figure, nothing of a page.
    type Kept = Option<String>;
    type Output = Reported;

    const NAME: &'static str = "report";
    const SOURCE: &'static str = env!("TRILINK_REPORT_SOURCE");
    const ROWS_OF_TARGETS: bool = false;
    const OTHER_ORDER: &'static str = "figures have another order";
    const NOT_KEPT: &'static str = "its SVG cannot be read";

    fn state(record: &Record) -> &StageState {
        &record.report
    }

    fn home(&self) -> &Path {
        &self.0.paths.reports
    }

    fn whole(&self) -> Value {
        serde_json::to_value(&self.0).expect("a configuration is plain data")
    }

    fn reads_the_same(&self, _known: &StageState, inputs: &Inputs) -> Result<bool, RunError> {
        let paths = input_paths(&self.0.paths)?;
        Ok(inputs.are_read(&paths))
    }

    fn read(&self, inputs: &Inputs) -> Result<Content, RunError> {
        inputs.stamp_all(&input_paths(&self.0.paths)?)?;
        let reader = inputs.reader();
        let changes = changes(self.0.tolerances(), &self.0.paths, &reader)?;
        Ok(Content::read(&self.0, reader)?.with_changes(changes))
    }

    fn wanted(&self, content: &Content) -> Vec<Wanted> {
        let figures = content.figures().map(|(stem, campaigns, hash)| {
            let parts = Fingerprint::from([("what it shows".to_owned(), hash)]);
            let target = Target::Figure(stem.to_owned());
            Wanted { campaigns: campaigns.to_vec(), ..Wanted::new(target, &(), parts) }
        });
        let pages = content.page_parts().iter().map(|(name, (campaign, parts))| {
            let campaigns = Some(campaign.clone()).filter(|campaign| !campaign.is_empty());
            let page = Wanted::new(Target::Page(name.clone()), &(), parts.clone());
            Wanted { campaigns: campaigns.into_iter().collect(), ..page }
        });
        figures.chain(pages).collect()
    }

    fn earlier(&self, known: &StageState, _written: &Reader) -> Result<Reported, String> {
        let figures = figures(known).map(str::to_owned).collect();
        Ok(Reported::new(&self.0, figures, known.missing.clone(), known.damaged.clone()))
    }

    fn kept(&self, known: &StageState, _earlier: Reported) -> BTreeMap<Target, Self::Kept> {
        let kept = |made: &Made| {
            let svg = match &made.target {
                Target::Page(_) => None,
                _ => {
                    let svg = made.outputs.iter().find(|(name, _)| name.ends_with(".svg"));
                    Some(
                        svg.and_then(|(name, stamp)| stamp.content_of(&self.home().join(name)))
                            .and_then(|svg| String::from_utf8(svg).ok())?,
                    )
                }
            };
            Some((made.target.clone(), svg))
        };
        known.targets.iter().filter_map(kept).collect()
    }

    fn steps(&self, _targets: usize) -> usize {
        1
    }

    fn make(
        &self,
        work: Work<Self>,
        watch: &dyn Watch,
    ) -> Result<(Reported, StageState), RunError> {
        let Work { sources, wanted, mut kept } = work;
        let (mut svgs, mut pages) = (BTreeMap::new(), BTreeSet::new());
        for (target, (_, svg)) in &mut kept {
            match target {
                Target::Figure(stem) => svgs.extend(svg.take().map(|svg| (stem.clone(), svg))),
                target => drop(pages.insert(target.name())),
            }
        }
        let made = sources.write(&self.0, svgs, &pages, &watch.cancel_token())?;
        made.reported.missing.iter().for_each(|missing| tracing::warn!(missing, "not drawn"));
        watch.step(&format!("{} figures and pages", wanted.len() - kept.len()));
        let mut written = made.targets;
        let targets = wanted.into_iter().map(|wanted| match kept.remove(&wanted.target) {
            Some((made, _)) => made,
            None => {
                let outputs = written.remove(&wanted.target.name()).unwrap_or_default();
                wanted.made(outputs)
            }
        });
        let Reported { missing, damaged, .. } = made.reported.clone();
        let (targets, outputs) = (targets.collect(), made.outputs);
        let state = StageState { targets, outputs, missing, damaged, ..StageState::default() };
        Ok((made.reported, state))
    }

    fn perhaps(&self, made: &Made, touched: &Touched) -> Vec<String> {
        let is_of_robot = matches!(made.target, Target::Figure(_)) && made.campaigns.is_empty();
        let shows = made.campaigns.iter().any(|campaign| touched.campaigns.contains(campaign))
            || is_of_robot && !touched.robots.is_empty();
        let is_own = |trial: &String| made.target == Target::Page(page_of(trial));
        let why = match touched.trials.iter().any(is_own) {
            true => Some("if its trial changes"),
            false => shows.then_some("if what it shows changes"),
        };
        why.map(str::to_owned).into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::record::Outputs;

    #[test]
    fn a_figure_of_a_robot_may_change_with_the_robot_s_trials() {
        let stage = ReportStage::new(&Config::default(), &StageState::default(), &[]);
        let target = Target::Figure("fig08".to_owned());
        let made = Wanted::new(target, &(), Fingerprint::new()).made(Outputs::new());
        let mut touched = Touched::default();
        touched.campaigns.insert("semi-passive-symmetric".to_owned());
        assert!(stage.perhaps(&made, &touched).is_empty());
        touched.robots.insert("semi-passive".to_owned());
        assert_eq!(stage.perhaps(&made, &touched), ["if what it shows changes"]);
    }
}
