//! `trilink demo` and `trilink run`.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::json;
use trilink_base::text::known;
use trilink_fit::Fitted;
use trilink_ingest::Ingested;
use trilink_mocap::marker_files;
use trilink_report::{Reported, shared_fit_sentence};
use trilink_robot::{Parameter, Quantity};
use trilink_synth::{Recipe, planted_models};
use trilink_tables::clock::utc_now;
use trilink_tables::config::{Campaign, Config, RobotConfig, toml_key};
use trilink_tables::trial::{TRIALS_FILE, TRUTH_FILE};
use trilink_tables::{
    CommonCause, Comparison, FitRow, RobotParameterRow, RobotQuantity, SharedFitRow, TrialRow,
    TrialStatus, is_there,
};

use super::output::{note, print, print_note, say, to_caller};
use super::synth::write_trials;
use super::table::Table;
use super::terminal::{Text, Tone, stderr_width};
use super::{Context, Exclusive, Failure, Folders, Outcome};
use crate::build::{
    DryRun, Finished, Kind, PlannedTarget, RerunOptions, RunResults, Target, TrialCounts,
    check_unconfigured, count, dry_run, run,
};

/// Maximum number of findings of each kind listed on the terminal; the report page lists all of them.
const MAX_LINES: usize = 20;
/// Maximum number of lines for findings of each kind with `--quiet`, so that the output stays below 25 lines.
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
        // A failed trial needs attention. A model without a periodic solution is a result, not a failure.
        let is_whole = history_problem.is_none() && reported.damaged.is_empty();
        let outcome = Outcome::well_if(is_whole && !ingested.needs_a_person());
        let results = json!({
            "was_up_to_date": finished.was_up_to_date,
            "results": RunResults::new(&finished),
            "stages": finished.stages,
            "history_problem": history_problem,
            "damaged": reported.damaged,
            "derived": context.config.paths.derived,
        });
        if to_caller(|returned| returned.json = results.to_string()) {
            return Ok(outcome);
        }
        if finished.was_up_to_date {
            let mut verdicts = verdicts(fitted);
            let more = verdicts.len().saturating_sub(MAX_QUIET);
            if context.is_quiet() && more > 0 {
                verdicts.truncate(MAX_QUIET);
                verdicts.push(format!("and {more} more").into());
            }
            let verdicts = verdicts.into_iter().reduce(|all, next| all + ", " + next);
            let verdicts = verdicts.map(|verdicts| Text::from("; ") + verdicts);
            let page = format!("; page: {}", reported.page.display());
            let up_to_date = Text::from(format!("everything was up to date at {}: ", utc_now()));
            print(up_to_date + in_words(&ingested.trials) + verdicts.unwrap_or_default() + page);
        } else {
            print_fitted(context, fitted);
            print_parameters(context, &ingested.parameters);
        }
        say_missing(context, reported, finished.was_up_to_date);
        note_together(context, ingested);
        say_attention(
            context,
            &ingested.trials,
            history_problem.as_deref(),
            finished.was_up_to_date,
        );
        if !finished.was_up_to_date {
            print(in_words(&ingested.trials));
            say!("page: {}", reported.page.display());
        }
        Ok(outcome)
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
pub(super) fn verdicts(Fitted { fits, comparison, .. }: &Fitted) -> Vec<Text> {
    let by_campaign = comparison.chunk_by(|a, b| a.campaign == b.campaign);
    let verdicts = by_campaign.filter_map(|models| {
        let compared = Comparison::new(models, fits)?;
        Some(Text::from(&models[0].campaign) + ": " + short_verdict(&compared))
    });
    verdicts.collect()
}

/// Returns the preferred model and whether it fits, in colour.
fn short_verdict(compared: &Comparison) -> Text {
    let tone = match compared.adequate() {
        Some(true) => Tone::Good,
        Some(false) => Tone::Bad,
        None => Tone::Doubtful,
    };
    tone.paint(compared.short())
}

/// Prints at most [`MAX_LINES`] of the lines; with `--quiet`, only those that take at most [`MAX_QUIET`] lines on the
/// terminal. The number of the others follows.
fn say_limited(context: &Context, indent: &str, lines: Vec<Text>, say: impl Fn(Text)) {
    let width = stderr_width();
    let mut free = if context.is_quiet() { MAX_QUIET } else { usize::MAX };
    let mut shown = 0;
    for line in lines.iter().take(MAX_LINES) {
        if free == 0 {
            break;
        }
        let line = (Text::from(indent) + line.clone()).cut(width, free);
        free = free.saturating_sub(line.height(width));
        say(line);
        shown += 1;
    }
    if lines.len() > shown {
        say(format!("{indent}and {} more, in checks.parquet", lines.len() - shown).into());
    }
}

/// Prints the failures found by the checks that examine the trials of a campaign or folder together.
pub(super) fn note_together(context: &Context, ingested: &Ingested) {
    let found = ingested.together();
    let found = found.map(|found| Tone::Bad.paint(&found.trial) + ": " + &found.message);
    say_limited(context, "", found.collect(), print_note);
}

/// Formats the numbers of trials by status, in colour unless they are zero.
pub(super) fn in_words(trials: &[TrialRow]) -> Text {
    let TrialCounts { total, ok, flagged, failed, ignored } = count(trials);
    let numbers =
        [(ok, TrialStatus::Ok), (flagged, TrialStatus::Flagged), (failed, TrialStatus::Failed)];
    let ignored = Some((ignored, TrialStatus::Ignored)).filter(|(number, _)| *number > 0);
    let numbers = numbers.into_iter().chain(ignored).map(|(number, status)| {
        let text = format!("{number} {status}");
        match Tone::of(status.name()).filter(|_| number > 0) {
            Some(tone) => tone.paint(text),
            None => text.into(),
        }
    });
    let numbers = numbers.reduce(|all, next| all + ", " + next).unwrap_or_default();
    Text::from(format!("{total} trial{}: ", if total == 1 { "" } else { "s" })) + numbers
}

/// Prints the failed trials, by folder and cause, and the message `other`, if there is one, and then, unless the run had
/// nothing to do, the flagged trials as a separate block.
pub(super) fn say_attention(
    context: &Context,
    trials: &[TrialRow],
    other: Option<&str>,
    was_up_to_date: bool,
) {
    let mut failed: Vec<Text> = other.map(Text::from).into_iter().collect();
    failed.extend(lines(trials, TrialStatus::Failed));
    note_block(context, "needs attention:", failed);
    if !was_up_to_date && !context.is_quiet() {
        note_block(context, "used, but flagged:", lines(trials, TrialStatus::Flagged));
    }
}

/// Returns a line for each group of trials with this status and a common cause.
fn lines(trials: &[TrialRow], status: TrialStatus) -> Vec<Text> {
    let causes = CommonCause::find(trials, status);
    causes.iter().map(|cause| Text::status(status) + ": " + cause.to_string()).collect()
}

/// Prints a heading and indented lines below it, or nothing if there are no lines.
fn note_block(context: &Context, heading: &str, lines: Vec<Text>) {
    if !lines.is_empty() {
        print_note(Tone::Heading.paint(heading));
        say_limited(context, "  ", lines, print_note);
    }
}

/// Prints which figures could not be drawn, unless the run had nothing to do, and which tables are damaged or
/// inconsistent.
pub(super) fn say_missing(context: &Context, reported: &Reported, was_up_to_date: bool) {
    if !was_up_to_date {
        reported.missing.iter().for_each(|figure| context.say(&format!("not drawn: {figure}")));
    }
    let damaged = reported.damaged.iter();
    let damaged = damaged.map(|damaged| Tone::Bad.paint("damaged") + ": " + damaged.to_string());
    say_limited(context, "", damaged.collect(), print_note);
}

/// Prints any robot parameters measured by joint releases and coast-downs, next to the configured values; with
/// `--quiet`, prints nothing.
pub(super) fn print_parameters(context: &Context, rows: &[RobotParameterRow]) {
    if context.is_quiet() {
        return;
    }
    for row in rows.iter().take(MAX_LINES) {
        let law = match row.law {
            Some(law) if row.status.is_ok() => law.name().into(),
            _ => Tone::Doubtful.paint(row.status.name()),
        };
        print(Tone::Heading.paint(&row.trial) + ": " + law + "; " + row.basis());
        let quantities: Vec<RobotQuantity> = row.quantities().collect();
        Table::new(&quantities)
            .indented(2)
            .left("", |of| format!("{} {}", of.name, of.unit))
            .right("", |of| format!("{:.5}", of.measured.value))
            .left("", |of| format!("+- {:.5}", of.measured.se))
            .left("", |of| match of.configured {
                configured if configured.is_nan() => String::new(),
                configured => format!("configured {configured:.5}"),
            })
            .print();
    }
    if rows.len() > MAX_LINES {
        say!("and {} more trials, in robot_parameters.parquet", rows.len() - MAX_LINES);
    }
}

/// Prints a block for each campaign: the fitted parameters and the comparison of its models; then whether one set of
/// coefficients describes all campaigns of each robot, or of robots with common wheels. With `--quiet`, prints only the
/// preferred models.
pub(super) fn print_fitted(context: &Context, fitted: &Fitted) {
    if context.is_quiet() {
        return say_limited(context, "", verdicts(fitted), print);
    }
    let Fitted { fits, comparison, shared, .. } = fitted;
    for fits in fits.chunk_by(|a, b| a.campaign == b.campaign) {
        let campaign = &fits[0].campaign;
        let models = comparison.iter().filter(|row| row.campaign == *campaign);
        let compared = Comparison::new(models, fits);
        let verdict = compared.as_ref().map(|compared| Text::from(": ") + short_verdict(compared));
        print(Tone::Heading.paint(campaign) + verdict.unwrap_or_default());
        print_fits(fits);
        compared.iter().for_each(|compared| say!("  {compared}"));
    }
    print_remarks(fits);
    print_exact(&context.config, fits);
    for row in shared {
        let SharedFitRow { robot, fit, .. } = row;
        let values = fit.free.iter().map(|parameter| {
            let part = row.part(*parameter).map_or(String::new(), |part| format!(" ({part})"));
            format!(" {}{part} {}", parameter.name(), cell(fit, *parameter))
        });
        say!(
            "{robot} {}: {}{}",
            fit.model,
            shared_fit_sentence(row),
            values.collect::<Vec<_>>().join(",")
        );
    }
}

/// Prints a table of the models that were fitted to a campaign, with their coefficients of skidding and any other fitted
/// parameters.
fn print_fits(fits: &[FitRow]) {
    let mut table = Table::new(fits)
        .indented(2)
        .left("model", |fit| fit.model.to_string())
        .right("J", |fit| if fit.status.is_ok() { format!("{:.5}", fit.j) } else { "-".to_owned() })
        .right("misfit ratio", |fit| known([fit.lack_of_fit], |[ratio]| format!("{ratio:.2}")))
        .left("fits", fits_in_words);
    let is_skid = |parameter: Parameter| parameter.quantity() == Quantity::Skid;
    let has_value =
        |parameter: Parameter| fits.iter().any(|fit| fit.parameters[parameter].is_finite());
    let skids = Parameter::ALL.into_iter().any(|one| is_skid(one) && has_value(one));
    for parameter in Parameter::OF_ANY_ROBOT {
        let is_free = |fit: &FitRow| fit.free.contains(&parameter);
        let of_wheel = has_value(parameter) || !skids && parameter.is_of_three_links();
        if is_skid(parameter) && of_wheel || fits.iter().any(is_free) {
            let name = match parameter.number() {
                Some(wheel) if is_skid(parameter) => format!("c_S{wheel}"),
                _ => parameter.name().to_owned(),
            };
            table = table.right(&name, |fit| {
                if is_skid(parameter) || is_free(fit) {
                    cell(fit, parameter)
                } else {
                    "-".to_owned()
                }
            });
        }
    }
    table.prose("", |fit| fit.failure.clone()).print();
}

/// Returns whether a model fits, or the status of its fit if there is none.
fn fits_in_words(fit: &FitRow) -> Text {
    match (fit.status.is_ok(), fit.adequate) {
        (false, _) => Text::status(fit.status),
        (true, Some(true)) => Tone::Good.paint("yes"),
        (true, Some(false)) => Tone::Bad.paint("no"),
        (true, None) => Tone::Doubtful.paint("not known"),
    }
}

/// Prints the meaning of the marks in the tables of fits, and notes on the fits.
fn print_remarks(fits: &[FitRow]) {
    let cells: String =
        fits.iter().flat_map(|fit| Parameter::OF_ANY_ROBOT.map(|of| cell(fit, of))).collect();
    let marks = [('~', "not identifiable"), ('|', "at a bound"), ('?', "the model does not fit")];
    let marks = marks.iter().filter(|(mark, _)| cells.contains(*mark));
    let marks: String = marks.map(|(mark, meaning)| format!("; {mark}: {meaning}")).collect();
    say!("c_S in kg/s{marks}");
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
            "{name}: confidence limits treat the robot's declared parameters as exact; state their uncertainty in \
             [robot.{}.standard_deviation]",
            toml_key(name)
        );
    }
}

/// Formats a fitted parameter, with marks if it is at a bound, not identifiable, or from an inadequate fit.
fn cell(fit: &FitRow, parameter: Parameter) -> String {
    let value = fit.parameters[parameter];
    if value.is_nan() || !fit.status.is_ok() {
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
    let decimals = if value.abs() < 1.0 { 5 } else { 2 };
    let is_doubtful = fit.adequate == Some(false) && fit.free.contains(&parameter);
    format!("{mark}{value:.decimals$}{}", if is_doubtful { "?" } else { "" })
}
