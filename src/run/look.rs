//! What a run would do, without doing it.

use super::stages::folders;
use super::summary::StageRecord;
use super::{Results, RunError, record_path};
use crate::config::Config;
use crate::fit;
use crate::ingest;
use crate::report::{self, ReportInput, report_planned};
use crate::store::{How, Record, Redo, unfinished};

/// What a run would do: certainly if the stages before have nothing to do, else perhaps.
#[derive(Debug)]
pub struct Ahead {
    pub stages: [Redo; 3],
    /// The first stage of which only the worst is known.
    pub uncertain_from: usize,
    /// What else would be written.
    pub others: Vec<String>,
    /// Why the record cannot be used.
    pub problem: Option<String>,
}

/// Says what a run would redo. Writes nothing.
///
/// # Errors
/// The list of trials or a table cannot be used.
pub fn look(config: &Config, how: How) -> Result<Ahead, RunError> {
    let derived = &config.paths.derived;
    let (known, problem) = Record::load(derived);
    let ahead = |stages, uncertain_from, others| {
        let problem = problem.clone();
        Ok(Ahead { stages, uncertain_from, others, problem })
    };
    let ingest = ingest::plan(config, &config.paths.raw, derived, &known.ingest, how)?;
    let report_after = |fits: &Redo, campaigns: &[String], trials: &[String]| {
        let of_fits = fits.things.iter().map(|fit| &fit.name).chain(&fits.removed);
        let of_fits = of_fits.filter_map(|name| name.rsplit_once(' '));
        let of_fits = of_fits.map(|(campaign, _)| campaign.to_owned());
        let campaigns = of_fits.chain(campaigns.iter().cloned()).collect();
        report::plan_after(&known.report, how, &campaigns, trials)
    };
    if !ingest.redo.is_empty() {
        let fits = fit::plan_after(config, &known.fit, how, &ingest.touched);
        let figures = report_after(&fits, &ingest.touched.campaigns, &ingest.redo.names());
        return ahead([ingest.redo, fits, figures], 1, Vec::new());
    }
    let fit = fit::plan(config, derived, &known.fit, how)?;
    if !fit.redo.is_empty() {
        let figures = report_after(&fit.redo, &[], &[]);
        return ahead([ingest.redo, fit.redo, figures], 2, Vec::new());
    }
    let report = report::plan(&ReportInput::new(config), &known.report, how)?;
    let mut others = Vec::new();
    if !unfinished(&folders(config)).is_empty() {
        others.push("a killed run left unfinished files".to_owned());
    }
    if !is_recorded(config, &known, how) {
        others.push("run.json is not as it was written".to_owned());
    }
    ahead([ingest.redo, fit.redo, report.redo], 3, others)
}

/// The results, if nothing at all has changed and nothing is worth to be recorded.
pub(super) fn up_to_date(
    config: &Config,
    known: &Record,
    how: How,
) -> Result<Option<Results>, RunError> {
    let derived = &config.paths.derived;
    let ingest = ingest::plan(config, &config.paths.raw, derived, &known.ingest, how)?;
    if !ingest.redo.is_empty() || !ingest.state().confirms(&known.ingest) {
        return Ok(None);
    }
    let fit = fit::plan(config, derived, &known.fit, how)?;
    if !fit.redo.is_empty() || !fit.state().confirms(&known.fit) {
        return Ok(None);
    }
    let report = report::plan(&ReportInput::new(config), &known.report, how)?;
    let is_whole = is_recorded(config, known, how) && unfinished(&folders(config)).is_empty();
    if !report.redo.is_empty() || !is_whole {
        return Ok(None);
    }
    let redo = [ingest.redo.clone(), fit.redo.clone(), report.redo.clone()];
    let stages = ["ingest", "fit", "report"].into_iter().zip(redo);
    let stages = stages.map(|(stage, redo)| StageRecord::new(stage, 0.0, redo)).collect();
    let (reported, state) = report_planned(&ReportInput::new(config), report)?;
    let (ingested, fitted) = (ingest.into_rows(), fit.into_fitted());
    let results = Results { ingested, fitted, reported, stages };
    Ok(Some(results).filter(|_| state.confirms(&known.report)))
}

/// Whether `run.json` is as it was written.
pub(super) fn is_recorded(config: &Config, known: &Record, how: How) -> bool {
    let path = record_path(config);
    known.run.as_ref().is_some_and(|stamp| stamp.is_intact(&path, how.verify))
}
