//! `trilink demo` and `trilink run`.

use std::collections::BTreeSet;

use trilink_fit::Fitted;
use trilink_ingest::Ingested;
use trilink_report::{Reported, shared_fit_sentence};
use trilink_robot::decay::DecayLaw;
use trilink_robot::{Parameter, Quantity};
use trilink_statistics::Estimate;
use trilink_synth::{Recipe, planted_models};
use trilink_tables::config::Campaign;
use trilink_tables::trial::{TRIALS_FILE, TRUTH_FILE};
use trilink_tables::{
    Comparison, FitRow, RobotParameterRow, RobotQuantity, SharedFitRow, TrialRow, TrialStatus,
    is_there,
};

use super::output::{note, say};
use super::synth::write_trials;
use super::{Context, Exclusive, Failure, Folders, Outcome};
use crate::build::{
    DryRun, Finished, PlannedTarget, RerunOptions, StagePlan, TrialCounts, check_unconfigured,
    count, dry_run, run,
};

/// More trials than this are on the page.
const MOST_LINES: usize = 20;
/// Seed of the demo's trials.
const DEMO_SEED: u64 = 1;
/// Seed of their noise: the first with which chance refuses no model that is true, as in one of ten nights, and
/// flags no more than half of a campaign's trials.
const DEMO_NOISE_SEED: u64 = 3;

/// Make the demo's trials if they are not there, then run them.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/demo.txt").trim_end())]
pub(super) struct Demo {
    #[command(flatten)]
    update: Update,
}

/// Ingest, fit and report trial folders.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/run.txt").trim_end())]
pub(super) struct Run {
    #[command(flatten)]
    folders: Folders,
    #[command(flatten)]
    update: Update,
}

/// What is done again.
#[derive(clap::Args)]
pub(super) struct Update {
    /// Redo every trial, fit and figure, not only what changed.
    #[arg(long)]
    force: bool,
    /// Write nothing: list what would be redone.
    #[arg(long)]
    dry_run: bool,
    /// Say why each trial, fit and figure is redone.
    #[arg(long)]
    explain: bool,
    /// Read every file again, also those whose size and time have not changed.
    #[arg(long)]
    verify: bool,
    #[command(flatten)]
    exclusive: Exclusive,
}

impl Demo {
    pub(super) fn run(self, mut context: Context) -> Result<Outcome, Failure> {
        let [raw] = &context.config.paths.raw[..] else {
            return Err("key `paths.raw`: found several folders, needed one for the demo".into());
        };
        let list = raw.join(TRIALS_FILE);
        let has_list = is_there(&list)?;
        if has_list && !is_there(&raw.join(TRUTH_FILE))? {
            let others = "trials that are not the demo's; `trilink run` runs them";
            return Err(format!("{}: found {others}", list.display()).into());
        }
        if !has_list {
            if self.update.dry_run {
                say!("everything: {} is not there", list.display());
                return Ok(Outcome::Well);
            }
            context.say(&format!("the demo's trials, synthetic, in {}", raw.display()));
            let recipe = Recipe::demo(&context.config, DEMO_SEED);
            let recipe = Recipe { noise_seed: Some(DEMO_NOISE_SEED), ..recipe };
            write_trials(&context, raw, &recipe)?;
        }
        // What made the trials competes, whatever the campaigns list.
        for (name, model) in planted_models(raw) {
            let is_known = context.config.model.contains_key(&model);
            let campaign = context.config.campaign.get_mut(&name).filter(|_| is_known);
            if let Some(Campaign { models, .. }) = campaign
                && !models.contains(&model)
            {
                models.push(model);
            }
        }
        self.update.run(&context, false)
    }
}

impl Run {
    pub(super) fn run(self, mut context: Context) -> Result<Outcome, Failure> {
        let only = self.folders.only;
        self.folders.configure(&mut context.config.paths);
        context.check_assumed(check_unconfigured)?;
        self.update.run(&context, only)
    }
}

impl Update {
    fn run(&self, context: &Context, only: bool) -> Result<Outcome, Failure> {
        let options = RerunOptions { force: self.force, verify: self.verify, only };
        if self.dry_run {
            return self.list(&dry_run(&context.config, options)?);
        }
        let watch = context.progress.watch(self.explain);
        let finished = run(&context.config, options, self.exclusive.wait, &watch)?;
        drop(watch);
        let Finished { ingested, fitted, reported, history_problem, .. } = &finished;
        print_fitted(fitted);
        print_parameters(&ingested.parameters);
        say!("{}", in_words(&ingested.trials));
        say!("page: {}", reported.page.display());
        note_together(ingested);
        say_attention(context, &ingested.trials, history_problem.as_deref());
        say_missing(context, reported, finished.was_up_to_date);
        // A failed trial needs a person. A model that has no motion is a result, not a failure.
        let is_whole = history_problem.is_none() && reported.damaged.is_empty();
        Ok(Outcome::well_if(is_whole && !ingested.needs_a_person()))
    }

    /// What a run would do, a line each.
    fn list(&self, ahead: &DryRun) -> Result<Outcome, Failure> {
        if let Some(problem) = &ahead.problem {
            note!("{problem}");
        }
        for (number, plan) in ahead.stages.iter().enumerate() {
            let perhaps = if number >= ahead.uncertain_from { "perhaps " } else { "" };
            let why = |why: &str| if self.explain { format!(": {why}") } else { String::new() };
            for PlannedTarget { target, why: reasons } in &plan.targets {
                say!("{perhaps}{target}{}", why(&reasons.join("; ")));
            }
            plan.removed.iter().for_each(|target| say!("remove {target}{}", why("is no more")));
            for why in &plan.whole {
                say!("{perhaps}{}: {why}", ["tables of trials", "tables of fits", "page"][number]);
            }
        }
        ahead.others.iter().for_each(|other| say!("{other}"));
        if ahead.stages.iter().all(StagePlan::is_empty) && ahead.others.is_empty() {
            note!("everything is up to date");
        }
        Ok(Outcome::Well)
    }
}

/// What is wrong with a campaign or a folder as a whole.
pub(super) fn note_together(ingested: &Ingested) {
    ingested.together().for_each(|found| note!("{}: {}", found.trial, found.message));
}

/// How many trials ended how.
pub(super) fn in_words(trials: &[TrialRow]) -> String {
    let TrialCounts { total, ok, flagged, failed } = count(trials);
    format!("{total} trials: {ok} ok, {flagged} flagged, {failed} failed")
}

/// In one block what needs a person, and in another one the trials that are used but flagged.
pub(super) fn say_attention(context: &Context, trials: &[TrialRow], other: Option<&str>) {
    let of = |status| trials.iter().filter(move |trial| trial.status == status);
    let line = |trial: &TrialRow| format!("{}: {}: {}", trial.status, trial.trial, trial.message);
    let block = |heading: &str, lines: Vec<String>| {
        let shown = lines.iter().take(MOST_LINES).map(|line| format!("\n  {line}"));
        let more = match lines.len().saturating_sub(MOST_LINES) {
            0 => String::new(),
            more => format!("\n  and {more} more, on the page and in checks.parquet"),
        };
        (!lines.is_empty()).then(|| format!("{heading}:{}{more}", shown.collect::<String>()))
    };
    let failed = of(TrialStatus::Failed).map(line).chain(other.map(str::to_owned)).collect();
    block("needs a person", failed).iter().for_each(|block| note!("{block}"));
    let flagged = block("used, but look at", of(TrialStatus::Flagged).map(line).collect());
    flagged.iter().for_each(|block| context.say(block));
}

/// Figures that could not be drawn and tables that could not be read, and why.
pub(super) fn say_missing(context: &Context, reported: &Reported, was_up_to_date: bool) {
    match was_up_to_date {
        true => context.say("everything was up to date"),
        false => {
            reported.missing.iter().for_each(|figure| context.say(&format!("not drawn: {figure}")));
        }
    }
    reported.damaged.iter().for_each(|damaged| note!("damaged: {damaged}"));
}

/// Robot parameters measured by releases and coast-downs, beside the configured ones; nothing if
/// nothing was measured.
pub(super) fn print_parameters(rows: &[RobotParameterRow]) {
    if rows.is_empty() {
        return;
    }
    let head = format!("{:<32} {:<15} {:<15}", "trial", "law", "parameter");
    say!("{head} {:>10} {:>9} {:>10}", "measured", "+-", "configured");
    for row in rows {
        for RobotQuantity { name, unit, measured, configured } in row.quantities() {
            let Estimate { value, se } = measured;
            let name = format!("{name} {unit}");
            let configured = match configured.is_nan() {
                true => "-".to_owned(),
                false => format!("{configured:.5}"),
            };
            let law = row.law.map_or("", DecayLaw::name);
            let head = format!("{:<32} {law:<15} {name:<15}", row.trial);
            say!("{head} {value:>10.5} {se:>9.5} {configured:>10}");
        }
    }
}

/// The fitted parameters, what the measurements say of each campaign's models, and whether one set of coefficients
/// describes all campaigns of each robot.
pub(super) fn print_fitted(Fitted { fits, comparison, shared, .. }: &Fitted) {
    print_fits(fits);
    for models in comparison.chunk_by(|a, b| a.campaign == b.campaign) {
        if let Some(compared) = Comparison::new(models, fits) {
            say!("{}: {compared}", models[0].campaign);
        }
    }
    for row in shared {
        let SharedFitRow { robot, fit, .. } = row;
        let values = fit.free.iter().map(|of| format!(" {} {}", of.name(), cell(fit, *of)));
        say!(
            "{robot} {}: {}{}",
            fit.model,
            shared_fit_sentence(row),
            values.collect::<Vec<_>>().join(",")
        );
    }
}

/// A short table of the fitted parameters.
fn print_fits(fits: &[FitRow]) {
    let [c_s0, c_s1, c_s2] = ["c_S0", "c_S1", "c_S2"].map(|name| format!("{name:>10}"));
    let marks = "c_S in kg/s; ~ not identifiable, | at its bound, ? of a model that does not fit";
    let head = format!("{:<24} {:<17} {:>9} {:>14}", "campaign", "model", "J", "over noise's");
    say!("{head} {c_s0} {c_s1} {c_s2}   {marks}");
    for fit in fits {
        let FitRow { campaign, model, status, j, .. } = fit;
        if !status.is_ok() {
            say!("{campaign:<24} {model:<17} {status}");
            continue;
        }
        let (skid, others): (Vec<Parameter>, _) =
            Parameter::ALL.into_iter().partition(|of| of.quantity() == Quantity::Skid);
        let skid: String = skid.iter().map(|of| format!(" {:>10}", cell(fit, *of))).collect();
        let others: String = others
            .iter()
            .filter(|parameter| fit.free.contains(parameter))
            .map(|parameter| format!("   {} {}", parameter.name(), cell(fit, *parameter)))
            .collect();
        let fits = match fit.adequate {
            Some(true) => format!("{:.2} fits", fit.lack_of_fit),
            Some(false) => format!("{:.2} not", fit.lack_of_fit),
            None => "not known".to_owned(),
        };
        say!("{campaign:<24} {model:<17} {j:>9.5} {fits:>14}{skid}{others}");
    }
    let notes = fits.iter().map(|fit| (&fit.campaign, &fit.notes));
    let notes: BTreeSet<_> = notes.filter(|(_, note)| !note.is_empty()).collect();
    notes.iter().for_each(|(campaign, note)| note!("{campaign}: {note}"));
}

fn cell(fit: &FitRow, parameter: Parameter) -> String {
    let value = fit.parameters[parameter];
    if value.is_nan() {
        return "-".to_owned();
    }
    let has = |list: &[Parameter]| list.contains(&parameter);
    let mark = match has(&fit.practically_not) || has(&fit.structurally_not) {
        _ if has(&fit.at_bound) => "|",
        true => "~",
        false => "",
    };
    // Two decimals for kg/s, more for what is small.
    let decimals = if value < 1.0 { 5 } else { 2 };
    let is_doubtful = fit.adequate == Some(false) && has(&fit.free);
    format!("{mark}{value:.decimals$}{}", if is_doubtful { "?" } else { "" })
}
