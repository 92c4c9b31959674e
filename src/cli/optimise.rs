//! `trilink optimise`.

mod certainty;
mod front;

use std::path::Path;

use trilink_fit::optimise::{
    Bounds, Certainty, Command, Found, Kept, Optimum, Search, Shown, outside,
};
use trilink_fit::simulate::Setup;
use trilink_report::{FigureFile, optimum_drawing};
use trilink_robot::metrics::FromRest;
use trilink_robot::{Gait, JointCommand};
use trilink_tables::config::{Config, did_you_mean};
use trilink_tables::{Extrapolation, NoInterval, Objective, OptimumRow};

use super::output::{note, say};
use super::parse::{finite, low_high, positive};
use super::results::{Files, Format, write_rows};
use super::setup::{Numbers, note_caution, note_extrapolation, note_starting_values};
use super::table::{Table, short};
use super::{Context, Exclusive, Failure, Outcome};
use crate::build::hold;
use crate::interrupt;

/// Search for the gait with which a model's robot goes farthest, fastest or with least work.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/optimise.txt").trim_end())]
#[command(mut_arg("figure", |of| of.help("Draw the objective about the optimum, over the two commands that it answers to most: SVG, PNG or PDF, by the file's ending")))]
pub(super) struct Optimise {
    /// Name of a `[campaign.*]`, whose robot and gait are the present ones.
    campaign: String,
    /// Name of a `[model.*]`: skid-roll, coulomb or your own [default with --fitted: the one that the comparison prefers].
    #[arg(long, required_unless_present = "fitted")]
    model: Option<String>,
    #[command(flatten)]
    numbers: Numbers,
    /// Replicates of the fit with which the searches are done again, for intervals of the optimum; 0 for none [default: all, up to
    /// 200].
    #[arg(long, value_name = "N", requires = "fitted")]
    replicates: Option<usize>,
    /// What is to be as large as possible: d, v, d-per-work or v-per-power, which have one optimum.
    #[arg(long, value_name = "WHAT", value_parser = parse_objective, required_unless_present_any = ["minimise", "pareto"])]
    maximise: Option<Objective>,
    /// What is to be as small as possible: work-per-metre, which is smallest where d-per-work is largest.
    #[arg(long, value_name = "WHAT", value_parser = parse_minimised, conflicts_with = "maximise")]
    minimise: Option<Objective>,
    /// What can be had of another objective for it, or of two: `--pareto v,work-per-metre`.
    #[arg(long, value_name = "WHAT", value_delimiter = ',', value_parser = parse_any, conflicts_with_all = ["gait_toml", "replicates"])]
    pareto: Vec<Objective>,
    /// What may vary: omega, amplitude1, offset2, phase2, ..., amplitudes, offsets, second1, seconds (second harmonics); one or several [default: all but second harmonics].
    #[arg(long, num_args = 1.., value_name = "COMMAND")]
    free: Vec<String>,
    /// Harmonics of the commands that vary: 1, or 2 with the second ones of the joints of which something varies.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    harmonics: u8,
    /// Frequencies, rad/s: `0.5..6`, or one where it does not vary [default: optimise.omega_rad_s].
    #[arg(long, value_name = "RAD_S", value_parser = parse_range)]
    omega: Option<[f64; 2]>,
    /// Amplitudes of the commanded joints, degrees: `5..60` [default: optimise.amplitude_deg].
    #[arg(long, value_name = "DEG", value_parser = parse_range)]
    amplitude_deg: Option<[f64; 2]>,
    /// Most of |offset| + amplitude, degrees [default: optimise.angle_deg].
    #[arg(long, value_name = "DEG")]
    angle_deg: Option<f64>,
    /// Most of amplitude times omega, degrees/s [default: optimise.rate_deg_s].
    #[arg(long, value_name = "DEG_S")]
    rate_deg_s: Option<f64>,
    /// Most of the actuators' mean power, W [default: optimise.power_w].
    #[arg(long, value_name = "W")]
    power_w: Option<f64>,
    /// Most of every actuator's torque, N m [default: optimise.torque_nm].
    #[arg(long, value_name = "NM")]
    torque_nm: Option<f64>,
    /// Another objective that must not be worse than a value, in its unit: `v=0.05`, `work-per-metre=2`.
    #[arg(long, value_name = "WHAT=VALUE", value_parser = parse_least, conflicts_with = "pareto")]
    least: Option<(Objective, f64)>,
    /// Places where searches begin [default: optimise.starts].
    #[arg(long, value_name = "N")]
    starts: Option<usize>,
    /// Print the optimal gait as an entry of pipeline.toml.
    #[arg(long, conflicts_with_all = ["json", "csv"])]
    gait_toml: bool,
    #[command(flatten)]
    files: Files,
    /// Keep the optima in `derived/optima.parquet`, and the objective about the best in `optimum_maps.parquet`: the page
    /// shows them from the next `trilink report` or `trilink run` on.
    #[arg(long, requires = "fitted", conflicts_with_all = ["set", "pareto"])]
    keep: bool,
    #[command(flatten)]
    exclusive: Exclusive,
    #[command(flatten)]
    format: Format,
}

impl Optimise {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        let campaign = &self.campaign;
        self.files.check()?;
        let config = self.configured(context.config.clone())?;
        let settings = &config.optimise;
        let radians = |[low, high]: [f64; 2]| [low.to_radians(), high.to_radians()];
        let (omega_rad_s, starts) = (settings.omega_rad_s, settings.starts);
        let bounds = Bounds {
            omega_rad_s,
            amplitude_rad: radians(settings.amplitude_deg),
            angle_rad: settings.angle_deg.to_radians(),
            rate_rad_s: settings.rate_deg_s.to_radians(),
            power_w: settings.power_w,
            torque_nm: settings.torque_nm,
            least: self.least,
        };
        let (objective, other) = self.objectives()?;
        let fits = self.numbers.fits(&config, self.replicates != Some(0))?;
        let setup = self.numbers.setup(config, campaign, self.model.as_deref(), fits.as_ref())?;
        note_caution(campaign, &setup);
        note_starting_values(&context.config, campaign, std::slice::from_ref(&setup));
        let free = match self.free.is_empty() {
            true => Command::all(&setup.gait),
            false => Command::parse(&self.free, &setup.gait)?,
        };
        let free = self.varying(free)?;
        let free = match self.harmonics {
            2 => Command::with_seconds(free, &setup.gait),
            _ => free,
        };
        for message in outside(&setup.gait, &bounds) {
            note!(
                "the present gait is outside the bounds: {message}; the search begins at the nearest within"
            );
        }
        let problem =
            setup.problem(self.fixed_rad_s().unwrap_or(0.5 * omega_rad_s.iter().sum::<f64>()));
        let search = Search { problem, objective, free, bounds, starts };
        if let Some(other) = other {
            return self.print_front(&context, &setup, &search, other);
        }
        let cancel = interrupt::token();
        let found = search.run(cancel)?;
        // What the present gait comes to at its own best frequency.
        let mut by_omega = Search { free: search.free.clone(), ..search.clone() };
        by_omega.free.retain(|of| *of == Command::Omega);
        let is_more = search.free.len() > by_omega.free.len();
        let present = if is_more { by_omega.present(cancel)? } else { None };
        let certainty = certainty::of(&setup, fits.as_ref(), self.replicates, (&search, &found))?;
        let row = |(nth, of): (usize, &Optimum)| {
            of.row(nth + 1, campaign, &setup, &search, present.as_ref())
        };
        let mut optima: Vec<OptimumRow> = found.optima.iter().enumerate().map(row).collect();
        note_extrapolation(campaign, &setup, found.optima.iter().map(|of| of.problem.clone()));
        certainty::fill_in(&mut optima, &certainty);
        let best = found.best().filter(|_| self.files.figure.is_some() || self.keep);
        let maps = best.map(|best| {
            let replicates = certainty.as_ref().map_or(&[][..], |of| &of.places);
            let range = setup.measured_range().and_then(Result::ok);
            let shown = Shown { present: present.as_ref(), replicates, range };
            search.map((campaign, setup.model), best, shown, cancel)
        });
        let maps = maps.transpose()?.unwrap_or_default();
        if !maps.is_empty() {
            let drawn = |file: FigureFile| optimum_drawing(&maps, file);
            self.files.draw(&context, self.numbers.fitted, drawn)?;
        }
        let outcome = self.print(&setup, &search, &found, present.as_ref(), &certainty, &optima)?;
        if self.keep {
            let kept = Kept { optima, maps };
            let derived = &context.config.paths.derived;
            let _lock =
                context.watched(|watch| hold(&context.config, self.exclusive.wait, watch))?;
            if let Some(problem) = kept.keep(derived)? {
                note!("{problem}; the optima that were there are left out");
            }
            context.say(&format!("kept in {}", derived.join("optima.parquet").display()));
        }
        Ok(outcome)
    }

    /// The one frequency where it does not vary.
    fn fixed_rad_s(&self) -> Option<f64> {
        self.omega.filter(|[low, high]| low == high).map(|[omega_rad_s, _]| omega_rad_s)
    }

    /// The configuration with what the options say.
    fn configured(&self, mut config: Config) -> Result<Config, Failure> {
        let settings = &mut config.optimise;
        if !self.fixed_rad_s().is_some_and(|omega_rad_s| omega_rad_s > 0.0) {
            settings.omega_rad_s = self.omega.unwrap_or(settings.omega_rad_s);
        }
        settings.amplitude_deg = self.amplitude_deg.unwrap_or(settings.amplitude_deg);
        settings.angle_deg = self.angle_deg.unwrap_or(settings.angle_deg);
        settings.rate_deg_s = self.rate_deg_s.unwrap_or(settings.rate_deg_s);
        settings.power_w = self.power_w.or(settings.power_w);
        settings.torque_nm = self.torque_nm.or(settings.torque_nm);
        settings.starts = self.starts.unwrap_or(settings.starts);
        config.check(Path::new("the options"))?;
        Ok(config)
    }

    /// The commands that vary where one frequency may be given.
    fn varying(&self, mut free: Vec<Command>) -> Result<Vec<Command>, Failure> {
        let is_fixed = self.fixed_rad_s().is_some();
        if is_fixed && self.free.is_empty() {
            free.retain(|of| *of != Command::Omega);
        }
        match (free.contains(&Command::Omega), is_fixed) {
            (true, true) => Err("--omega: found one frequency, needed LOW..HIGH: it varies".into()),
            (false, false) => {
                Err("--omega: needed one frequency: `omega` is not among what varies".into())
            }
            _ if free.is_empty() => Err("--free: nothing varies".into()),
            _ => Ok(free),
        }
    }

    fn print(
        &self,
        setup: &Setup,
        search: &Search,
        found: &Found,
        present: Option<&Optimum>,
        certainty: &Result<Certainty, NoInterval>,
        rows: &[OptimumRow],
    ) -> Result<Outcome, Failure> {
        let objective = search.objective;
        let Found { optima, failed } = found;
        let Some(first) = optima.first() else {
            let motion = match objective.knows_work() {
                true => "motion within the bounds on which the actuators do work",
                false => "steady motion within the bounds",
            };
            return Err(format!("no search found a {motion}").into());
        };
        if let Some(path) = &self.files.table {
            write_rows(path, rows, &format!("{search:?}"))?;
        }
        if self.gait_toml {
            if let Some(best) = found.best() {
                let beyond = setup.extrapolation(&best.problem);
                say!("{}", gait_toml(&self.campaign, objective, best, &beyond).trim_end());
            }
        } else if !self.format.rows(rows) {
            print_table(setup, objective, optima, present);
            match certainty {
                Ok(certainty) => certainty::print(objective, certainty)?,
                Err(why) if self.numbers.fitted => say!("no intervals: {why}"),
                Err(_) => {}
            }
            if *failed > 0 {
                say!("{failed} searches found no motion within the bounds that is found from rest");
            }
        }
        if found.best().is_none() {
            note!("no optimum counts: {}", why_not(first));
            return Ok(Outcome::NeedsAttention);
        }
        Ok(Outcome::Well)
    }
}

/// The optima, and the present gait at its best frequency.
fn print_table(setup: &Setup, objective: Objective, optima: &[Optimum], present: Option<&Optimum>) {
    let (name, scale) = match objective {
        Objective::Distance => ("d mm".to_owned(), 1e3),
        Objective::Speed => ("v mm/s".to_owned(), 1e3),
        other => (format!("{} {}", other.name(), other.unit()), 1.0),
    };
    let Some(first) = optima.first() else { return };
    let numbers = (1..).map(|i: usize| i.to_string()).zip(optima);
    let lines: Vec<(String, &Optimum)> =
        numbers.chain(present.map(|of| ("present".to_owned(), of))).collect();
    let mut table = Table::of(&lines)
        .left("", |(name, _)| name.clone())
        .right(&name, |(_, of)| short(scale * of.value))
        .right("omega rad/s", |(_, of)| short(of.problem.omega_rad_s));
    let has_second = optima.iter().any(|of| of.problem.gait.has_second());
    type Angle = (&'static str, fn(&JointCommand) -> f64);
    let angles: [Angle; 5] = [
        ("amplitude", |of| of.amplitude_rad),
        ("offset", |of| of.offset_rad),
        ("phase", |of| of.phase_rad),
        ("second amplitude", |of| of.second().amplitude_rad()),
        ("second phase", |of| of.second().phase_rad()),
    ];
    for joint in (0..2).filter(|joint| first.problem.gait.joints[*joint].is_some()) {
        for (name, angle_rad) in &angles[..if has_second { 5 } else { 3 }] {
            table = table.right(&format!("{name}{} deg", joint + 1), |(_, of)| {
                let command = of.problem.gait.joints[joint];
                let angle_rad = command.map_or(f64::NAN, |command| angle_rad(&command));
                format!("{:.3}", angle_rad.to_degrees() + 0.0)
            });
        }
    }
    table
        .right("d mm", |(_, of)| short(1e3 * of.motion.metrics.d_m))
        .right("v mm/s", |(_, of)| short(1e3 * of.motion.metrics.v_m_s))
        .right("work J/m", |(_, of)| short(of.motion.work_j / of.motion.metrics.d_m))
        .right("power W", |(_, of)| short(of.power_w()))
        .right("starts", |(_, of)| of.starts.to_string())
        .left("remark", |(_, of)| remark(setup, of))
        .print();
    if let (Some(best), Some(present)) = (optima.first().filter(|of| of.counts()), present) {
        let percent = 100.0 * (best.value / present.value - 1.0);
        say!("the best is {percent:+.1} % of the present gait at its best frequency");
    }
}

/// What keeps it from being better, in what it is beyond the trials of the fit, and why it does not count.
fn remark(setup: &Setup, of: &Optimum) -> String {
    let at_bound = match of.at_bound.is_empty() {
        true => String::new(),
        false => format!("at its bound: {}", of.at_bound.join(", ")),
    };
    let extrapolated = match setup.extrapolation(&of.problem) {
        Extrapolation { extrapolated: Some(true), beyond_trials } => {
            format!("extrapolated: {beyond_trials}")
        }
        _ => String::new(),
    };
    let parts = [at_bound, extrapolated, why_not(of)];
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("; ")
}

/// Why an optimum does not count; empty if it does.
fn why_not(of: &Optimum) -> String {
    match (of.status.is_stable(), of.from_rest) {
        (false, _) => format!("the motion is {}", of.status),
        (_, FromRest::Another) => "from rest the robot gets into another motion".to_owned(),
        (_, FromRest::Unsettled) => "from rest the robot does not settle".to_owned(),
        _ => String::new(),
    }
}

/// The gait as an entry of `pipeline.toml`.
fn gait_toml(
    campaign: &str,
    objective: Objective,
    best: &Optimum,
    extrapolation: &Extrapolation,
) -> String {
    let Gait { joints } = best.problem.gait;
    let mut text = format!(
        "# {} = {} {} at {} rad/s\n",
        objective.name(),
        short(best.value),
        objective.unit(),
        best.problem.omega_rad_s
    );
    if extrapolation.extrapolated == Some(true) {
        text += &format!("# extrapolated: {}\n", extrapolation.beyond_trials);
    }
    text += &format!("[gait.{campaign}-best-{}]\n", objective.name());
    for (joint, command) in joints.iter().enumerate() {
        let Some(command) = command else { continue };
        let numbers = command.to_array().map(f64::to_degrees);
        let mut keys: Vec<(&str, f64)> =
            ["offset_deg", "amplitude_deg", "phase_deg"].into_iter().zip(numbers).collect();
        if let Some(second) = command.second {
            keys.push(("amplitude2_deg", second.amplitude_rad().to_degrees()));
            keys.push(("phase2_deg", second.phase_rad().to_degrees()));
        }
        let keys: Vec<String> =
            keys.iter().map(|(key, value)| format!("{key} = {value:?}")).collect();
        text += &format!("joint{} = {{ {} }}\n", joint + 1, keys.join(", "));
    }
    text
}

fn parse_objective(text: &str) -> Result<Objective, String> {
    of_names(text, |of| !of.is_minimised())
}

fn parse_minimised(text: &str) -> Result<Objective, String> {
    of_names(text, Objective::is_minimised)
}

fn parse_any(text: &str) -> Result<Objective, String> {
    of_names(text, |_| true)
}

/// An objective and a value of it.
fn parse_least(text: &str) -> Result<(Objective, f64), String> {
    let needed = || format!("found `{text}`, needed WHAT=VALUE, such as v=0.05");
    let (what, value) = text.split_once('=').ok_or_else(needed)?;
    value.trim().parse::<f64>().map_err(|_| needed())?;
    let value = positive(value).ok_or_else(|| needed() + ", above 0")?;
    Ok((parse_any(what.trim())?, value))
}

/// The objective with a name, of those for which `is_one` holds.
fn of_names(text: &str, is_one: impl Fn(Objective) -> bool) -> Result<Objective, String> {
    let known: Vec<Objective> = Objective::ALL.into_iter().filter(|of| is_one(*of)).collect();
    let found = known.iter().copied().find(|of| of.name() == text);
    found.ok_or_else(|| {
        let names: Vec<&str> = known.iter().map(|of| of.name()).collect();
        let hint = did_you_mean(text, names.iter().copied());
        format!("found `{text}`, needed `{}`{hint}", names.join("`, `"))
    })
}

/// `LOW..HIGH`, or one number as both.
fn parse_range(text: &str) -> Result<[f64; 2], String> {
    let needed = || format!("found `{text}`, needed LOW..HIGH or a number");
    let range = low_high(text).or_else(|| finite(text).map(|value| [value; 2]));
    let range = range.ok_or_else(needed)?;
    match text.contains("..") && range[0] >= range[1] {
        true => Err(needed() + ", the lower number first"),
        false => Ok(range),
    }
}
