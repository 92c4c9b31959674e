//! `trilink demo` and `trilink run`.

use std::collections::BTreeSet;
use std::path::Path;

use trilink_fit::Fitted;
use trilink_ingest::Ingested;
use trilink_mocap::marker_files;
use trilink_report::{Reported, shared_fit_sentence};
use trilink_robot::decay::DecayLaw;
use trilink_robot::{Parameter, Quantity};
use trilink_statistics::Estimate;
use trilink_synth::{Recipe, planted_models};
use trilink_tables::clock::utc_now;
use trilink_tables::config::{Campaign, Config, RobotConfig, toml_key};
use trilink_tables::trial::{TRIALS_FILE, TRUTH_FILE};
use trilink_tables::{
    CommonCause, Comparison, FitRow, RobotParameterRow, RobotQuantity, SharedFitRow, TrialRow,
    TrialStatus, is_there,
};

use super::output::{note, say};
use super::synth::write_trials;
use super::{Context, Exclusive, Failure, Folders, Outcome};
use crate::build::{
    DryRun, Finished, Kind, PlannedTarget, RerunOptions, Target, TrialCounts, check_unconfigured,
    count, dry_run, run,
};

/// Maximum number of groups of trials listed on the terminal; the report page lists all of them.
const MAX_LINES: usize = 20;
/// Maximum number of lines of each kind with `--quiet`, so that the output stays below 25 lines.
const MAX_QUIET: usize = 4;
/// Maximum number of targets with the same reason that a dry run names.
const MAX_NAMED: usize = 3;
/// Seed for the synthesis of the demo's trials.
const DEMO_SEED: u64 = 1;
/// Seed for the noise of the demo's trials: the lowest for which at most half of a campaign's trials are flagged, and
/// no model with which the trials were generated fails the lack-of-fit test (one in ten seeds has such a failure).
const DEMO_NOISE_SEED: u64 = 3;

/// Synthesise the demo's trials if they do not exist, then run all stages on them.
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

/// Options of an incremental run.
#[derive(clap::Args)]
pub(super) struct Update {
    /// Recompute every trial, fit and figure, not only what has changed.
    #[arg(long)]
    force: bool,
    /// Write nothing; list what would be recomputed.
    #[arg(long)]
    dry_run: bool,
    /// Explain why each trial, fit and figure is recomputed.
    #[arg(long)]
    explain: bool,
    /// Read every file again, even if its size and modification time have not changed.
    #[arg(long)]
    verify: bool,
    #[command(flatten)]
    exclusive: Exclusive,
}

impl Demo {
    pub(super) fn run(self, mut context: Context) -> Result<Outcome, Failure> {
        let [raw] = &context.config.paths.raw[..] else {
            return Err(
                "key `paths.raw`: found several folders, but the demo needs exactly one".into()
            );
        };
        let list = raw.join(TRIALS_FILE);
        let has_list = is_there(&list)?;
        if has_list && !is_there(&raw.join(TRUTH_FILE))? {
            let problem = "found trials that are not the demo's; `trilink run` processes them";
            return Err(format!("{}: {problem}", list.display()).into());
        }
        if !has_list {
            if !context.is_configured
                && !marker_files(Path::new(".")).unwrap_or_default().is_empty()
            {
                return Err("the current folder contains marker files: run the demo in an empty folder, or draft the \
                            configuration of these files with `trilink init .`"
                    .into());
            }
            if self.update.dry_run {
                say!("everything would be computed, because {} does not exist", list.display());
                return Ok(Outcome::Well);
            }
            context.say(&format!("writing the demo's synthetic trials to {}", raw.display()));
            let recipe = Recipe::demo(&context.config, DEMO_SEED);
            let recipe = Recipe { noise_seed: Some(DEMO_NOISE_SEED), ..recipe };
            write_trials(&context, raw, &recipe)?;
        }
        // The true models are fitted, too, even if the campaigns do not list them.
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
        if finished.was_up_to_date {
            let counts = in_words(&ingested.trials);
            let verdicts = verdicts(fitted).join(", ");
            let page = reported.page.display();
            say!("everything was up to date at {}: {counts}; {verdicts}; page: {page}", utc_now());
        } else {
            print_fitted(context, fitted);
            print_parameters(context, &ingested.parameters);
            say!("{}", in_words(&ingested.trials));
            say!("page: {}", reported.page.display());
        }
        note_together(context, ingested);
        say_attention(
            context,
            &ingested.trials,
            history_problem.as_deref(),
            finished.was_up_to_date,
        );
        say_missing(context, reported, finished.was_up_to_date);
        // A failed trial needs attention. A model without a periodic solution is a result, not a failure.
        let is_whole = history_problem.is_none() && reported.damaged.is_empty();
        Ok(Outcome::well_if(is_whole && !ingested.needs_a_person()))
    }

    /// Lists what a run would recompute: one target per line or, with reasons, one line for all targets that are
    /// recomputed for the same reason.
    fn list(&self, dry_run: &DryRun) -> Result<Outcome, Failure> {
        if let Some(problem) = &dry_run.problem {
            note!("{problem}");
        }
        let planned = planned(dry_run, self.explain);
        planned.iter().for_each(|line| say!("{line}"));
        if planned.is_empty() {
            note!("everything is up to date");
        }
        Ok(Outcome::Well)
    }
}

/// Lists what a run would recompute. With `explain`, each line has its reason, and more than [`MAX_NAMED`] targets of
/// the same kind and reason are only counted.
pub(super) fn planned(dry_run: &DryRun, explain: bool) -> Vec<String> {
    let mut lines = Vec::new();
    for (number, plan) in dry_run.stages.iter().enumerate() {
        let perhaps = if number >= dry_run.uncertain_from { "perhaps " } else { "" };
        if explain {
            let mut groups: Vec<(Kind, String, Vec<&Target>)> = Vec::new();
            for PlannedTarget { target, why } in &plan.targets {
                let why = why.join("; ");
                let same = |(kind, reason, _): &&mut (Kind, String, _)| {
                    *kind == target.kind && *reason == why
                };
                match groups.iter_mut().find(same) {
                    Some((_, _, targets)) => targets.push(target),
                    None => groups.push((target.kind, why, vec![target])),
                }
            }
            for (kind, why, targets) in groups {
                if targets.len() > MAX_NAMED {
                    let count = targets.len();
                    let because = match why.as_str() {
                        "new" => "that are ",
                        "--force" => "because of ",
                        why if why.starts_with("if ") => "",
                        _ => "because ",
                    };
                    let separator = if because == "that are " { "" } else { "," };
                    lines.push(format!(
                        "{perhaps}{count} {}s{separator} {because}{why}",
                        kind.noun()
                    ));
                } else {
                    lines.extend(targets.iter().map(|target| format!("{perhaps}{target}: {why}")));
                }
            }
        } else {
            lines.extend(plan.targets.iter().map(|of| format!("{perhaps}{}", of.target)));
        }
        let reason = if explain { ": no longer listed" } else { "" };
        lines.extend(plan.removed.iter().map(|target| format!("remove {target}{reason}")));
        let whole = ["tables of trials", "tables of fits", "page"][number];
        lines.extend(plan.whole.iter().map(|why| format!("{perhaps}{whole}: {why}")));
    }
    lines.extend(dry_run.others.iter().map(|other| (*other).to_owned()));
    lines
}

/// Returns the preferred model of each campaign and whether it fits.
pub(super) fn verdicts(Fitted { fits, comparison, .. }: &Fitted) -> Vec<String> {
    let by_campaign = comparison.chunk_by(|a, b| a.campaign == b.campaign);
    let verdicts = by_campaign.filter_map(|models| {
        Some(format!("{}: {}", models[0].campaign, Comparison::new(models, fits)?.short()))
    });
    verdicts.collect()
}

/// Prints at most [`MAX_QUIET`] of the lines with `--quiet`, and otherwise all.
fn say_limited(context: &Context, lines: &[String], say: impl Fn(&str)) {
    let limit = if context.is_quiet() { MAX_QUIET } else { lines.len() };
    lines.iter().take(limit).for_each(|line| say(line));
    if lines.len() > limit {
        say(&format!("and {} more, on the report page", lines.len() - limit));
    }
}

/// Prints the failures found by the checks that examine the trials of a campaign or folder together.
pub(super) fn note_together(context: &Context, ingested: &Ingested) {
    let found = ingested.together().map(|found| format!("{}: {}", found.trial, found.message));
    say_limited(context, &found.collect::<Vec<_>>(), |line| note!("{line}"));
}

/// Formats the numbers of trials by status.
pub(super) fn in_words(trials: &[TrialRow]) -> String {
    let TrialCounts { total, ok, flagged, failed, ignored } = count(trials);
    let counts = format!("{total} trials: {ok} ok, {flagged} flagged, {failed} failed");
    if ignored == 0 { counts } else { format!("{counts}, {ignored} ignored") }
}

/// Prints the failed trials, by folder and cause, and the message `other`, if there is one, and then, unless the run had
/// nothing to do, the flagged trials as a separate block.
pub(super) fn say_attention(
    context: &Context,
    trials: &[TrialRow],
    other: Option<&str>,
    was_up_to_date: bool,
) {
    let mut failed: Vec<String> = other.map(str::to_owned).into_iter().collect();
    failed.extend(lines(trials, TrialStatus::Failed));
    let max = if context.is_quiet() { MAX_QUIET } else { MAX_LINES };
    if !failed.is_empty() {
        note!("needs attention:{}", block(&failed, max));
    }
    let flagged = lines(trials, TrialStatus::Flagged);
    if !flagged.is_empty() && !was_up_to_date {
        context.say(&format!("used, but flagged:{}", block(&flagged, max)));
    }
}

/// Returns a line for each group of trials with this status and a common cause.
fn lines(trials: &[TrialRow], status: TrialStatus) -> Vec<String> {
    CommonCause::find(trials, status).iter().map(CommonCause::to_string).collect()
}

/// Indents at most `max` lines, and states how many lines were left out.
fn block(lines: &[String], max: usize) -> String {
    let mut block: String = lines.iter().take(max).map(|line| format!("\n  {line}")).collect();
    if lines.len() > max {
        let more = lines.len() - max;
        block += &format!("\n  and {more} more, on the report page and in checks.parquet");
    }
    block
}

/// Prints which figures could not be drawn, unless the run had nothing to do, and which tables are damaged or
/// inconsistent.
pub(super) fn say_missing(context: &Context, reported: &Reported, was_up_to_date: bool) {
    if !was_up_to_date {
        reported.missing.iter().for_each(|figure| context.say(&format!("not drawn: {figure}")));
    }
    let damaged = reported.damaged.iter().map(|damaged| format!("damaged: {damaged}"));
    say_limited(context, &damaged.collect::<Vec<_>>(), |line| note!("{line}"));
}

/// Prints any robot parameters measured by joint releases and coast-downs, next to the configured values; with
/// `--quiet`, prints nothing.
pub(super) fn print_parameters(context: &Context, rows: &[RobotParameterRow]) {
    if rows.is_empty() || context.is_quiet() {
        return;
    }
    let head = format!("{:<32} {:<15} {:<15}", "trial", "law", "parameter");
    say!("{head} {:>10} {:>9} {:>10}  basis", "measured", "+-", "configured");
    for row in rows {
        if !row.status.is_ok() {
            say!("{:<32} {}", row.trial, row.status);
        }
        for RobotQuantity { name, unit, measured, configured } in row.quantities() {
            let Estimate { value, se } = measured;
            let name = format!("{name} {unit}");
            let configured =
                if configured.is_nan() { "-".to_owned() } else { format!("{configured:.5}") };
            let law = row.law.map_or("", DecayLaw::name);
            let head = format!("{:<32} {law:<15} {name:<15}", row.trial);
            say!("{head} {value:>10.5} {se:>9.5} {configured:>10}  {}", row.basis());
        }
    }
}

/// Prints the fitted parameters, the comparison of each campaign's models, and whether one set of coefficients
/// describes all campaigns of each robot. With `--quiet`, prints only the preferred models.
pub(super) fn print_fitted(context: &Context, fitted: &Fitted) {
    if context.is_quiet() {
        return say_limited(context, &verdicts(fitted), |line| say!("{line}"));
    }
    let Fitted { fits, comparison, shared, .. } = fitted;
    print_fits(fits);
    print_exact(&context.config, fits);
    for models in comparison.chunk_by(|a, b| a.campaign == b.campaign) {
        if let Some(compared) = Comparison::new(models, fits) {
            say!("{}: {compared}", models[0].campaign);
        }
    }
    for row in shared {
        let SharedFitRow { robot, fit, .. } = row;
        let values = fit
            .free
            .iter()
            .map(|parameter| format!(" {} {}", parameter.name(), cell(fit, *parameter)));
        say!(
            "{robot} {}: {}{}",
            fit.model,
            shared_fit_sentence(row),
            values.collect::<Vec<_>>().join(",")
        );
    }
}

/// Prints a short table of fitted parameters.
fn print_fits(fits: &[FitRow]) {
    let [c_s0, c_s1, c_s2] = ["c_S0", "c_S1", "c_S2"].map(|name| format!("{name:>10}"));
    let marks = "c_S in kg/s; ~: not identifiable, |: at a bound, ?: the model does not fit";
    let head = format!("{:<24} {:<17} {:>9} {:>14}", "campaign", "model", "J", "misfit ratio");
    say!("{head} {c_s0} {c_s1} {c_s2}   {marks}");
    for fit in fits {
        let FitRow { campaign, model, status, failure, j, .. } = fit;
        if !status.is_ok() {
            say!("{campaign:<24} {model:<17} {status}: {failure}");
            continue;
        }
        let (skid, others): (Vec<Parameter>, _) = Parameter::ALL
            .into_iter()
            .partition(|parameter| parameter.quantity() == Quantity::Skid);
        let skid: String =
            skid.iter().map(|parameter| format!(" {:>10}", cell(fit, *parameter))).collect();
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
    let of_one_day: BTreeSet<&str> =
        fits.iter().filter(|fit| fit.single_day).map(|fit| fit.campaign.as_str()).collect();
    if !of_one_day.is_empty() {
        let campaigns: Vec<&str> = of_one_day.into_iter().collect();
        say!("confidence limits hold for the floor of a single day: {}", campaigns.join(", "));
    }
    let notes = fits.iter().map(|fit| (&fit.campaign, &fit.notes));
    let notes: BTreeSet<_> = notes.filter(|(_, note)| !note.is_empty()).collect();
    notes.iter().for_each(|(campaign, note)| note!("{campaign}: {note}"));
}

/// Prints which robots have no parameter with a standard deviation, although fits with confidence limits use them.
fn print_exact(config: &Config, fits: &[FitRow]) {
    let with_limits = fits.iter().filter(|fit| !fit.free.is_empty() && fit.no_interval.is_none());
    let robots = with_limits.filter_map(|fit| Some(&config.campaign.get(&fit.campaign)?.robot));
    let is_exact = |name: &&String| config.robot.get(*name).is_some_and(RobotConfig::is_exact);
    let exact: BTreeSet<&String> = robots.filter(is_exact).collect();
    for name in exact {
        say!(
            "{name}: limits take the robot's declared parameters as exact; state their uncertainty in \
             [robot.{}.standard_deviation]",
            toml_key(name)
        );
    }
}

/// Formats a fitted parameter, with marks if it is at a bound, not identifiable, or from an inadequate fit.
fn cell(fit: &FitRow, parameter: Parameter) -> String {
    let value = fit.parameters[parameter];
    if value.is_nan() {
        return "-".to_owned();
    }
    let mark = if fit.at_bound.contains(&parameter) {
        "|"
    } else if fit.practically_not.contains(&parameter) || fit.structurally_not.contains(&parameter)
    {
        "~"
    } else {
        ""
    };
    // Two decimals suffice for coefficients in kg/s; small values need more.
    let decimals = if value < 1.0 { 5 } else { 2 };
    let is_doubtful = fit.adequate == Some(false) && fit.free.contains(&parameter);
    format!("{mark}{value:.decimals$}{}", if is_doubtful { "?" } else { "" })
}
