//! `trilink optimise`.

mod certainty;
mod front;

use std::path::Path;

use trilink_fit::optimise::{
    Bounds, Command, Drive, MapOverlay, OptimaTables, Optimum, Search, SearchResult, Uncertainty,
    exceeded_bounds,
};
use trilink_fit::simulate::Setup;
use trilink_report::optimum_drawing;
use trilink_robot::SecondHarmonic;
use trilink_robot::metrics::FromRest;
use trilink_tables::config::{Config, did_you_mean};
use trilink_tables::{Extrapolation, NoInterval, Objective, OptimumRow};

use super::output::{note, say, write_data};
use super::parse::{finite, low_high, positive};
use super::results::{Files, Format, write_rows};
use super::setup::{Numbers, note_caution, note_extrapolation, note_starting_values};
use super::table::{Table, short};
use super::{Context, Exclusive, Failure, Outcome, candidates};
use crate::build::hold;

/// Optimise a gait for distance, speed or work, as predicted by a model.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/optimise.txt").trim_end())]
#[command(mut_arg("figure", |arg| arg.help("Draw the objective around the optimum as a function of the two commands to which it is most sensitive; the file extension selects SVG, PNG or PDF")))]
pub(super) struct Optimise {
    /// Name of a `[campaign.*]` table, whose robot and gait are the starting point.
    #[arg(add = candidates::campaigns())]
    campaign: String,
    /// Name of a `[model.*]` table: skid-roll, coulomb or your own [default with --fitted: the preferred
    /// model of the comparison].
    #[arg(long, required_unless_present = "fitted", add = candidates::models())]
    model: Option<String>,
    #[command(flatten)]
    numbers: Numbers,
    /// Number of bootstrap replicates of the fit for which the search is repeated, for confidence
    /// intervals of the optimum; 0 for none [default: all, up to 200].
    #[arg(long, value_name = "N", requires = "fitted")]
    replicates: Option<usize>,
    /// Objective to maximise: d, v, d-per-work or v-per-power.
    #[arg(long, value_name = "WHAT", value_parser = parse_objective, required_unless_present_any = ["minimise", "pareto"])]
    maximise: Option<Objective>,
    /// Objective to minimise: work-per-metre, which is the reciprocal of d-per-work.
    #[arg(long, value_name = "WHAT", value_parser = parse_minimised, conflicts_with = "maximise")]
    minimise: Option<Objective>,
    /// Compute the Pareto front of two objectives: that of --maximise or --minimise and the one named here, or two
    /// named here, such as `--pareto v,work-per-metre`.
    #[arg(long, value_name = "WHAT", value_delimiter = ',', value_parser = parse_any, conflicts_with_all = ["gait_toml", "replicates"])]
    pareto: Vec<Objective>,
    /// Commands to vary, one or several: omega, amplitude1, offset2, phase2, ...; amplitudes or offsets (of all
    /// commanded joints); second1 (second harmonic of joint 1); seconds (all second harmonics); of a chain also torque3,
    /// mean3 (torque of joint 3) and rotor.NAME.amplitude [default: all but the second harmonics].
    #[arg(long, num_args = 1.., value_name = "COMMAND")]
    free: Vec<String>,
    /// Number of harmonics of the commands: 2 also varies the second harmonics of each joint of which another command
    /// is varied.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    harmonics: u8,
    /// Bounds of the frequency, rad/s: `0.5..6`, or one number to fix it [default: optimise.omega_rad_s, and with
    /// --fitted within the range of the trials widened by a fifth].
    #[arg(long, value_name = "RAD_S", value_parser = parse_range)]
    omega: Option<[f64; 2]>,
    /// Bounds of the amplitudes of the commanded joints, degrees: `5..60` [default: optimise.amplitude_deg, and with
    /// --fitted within the range of the trials widened by a fifth].
    #[arg(long, value_name = "DEG", value_parser = parse_range)]
    amplitude_deg: Option<[f64; 2]>,
    /// Bounds of the amplitudes of the rotors of a chain, degrees: `5..720` [default: optimise.rotor_amplitude_deg].
    #[arg(long, value_name = "DEG", value_parser = parse_range)]
    rotor_amplitude_deg: Option<[f64; 2]>,
    /// Maximum joint angle (|offset| + amplitude), degrees [default: optimise.angle_deg].
    #[arg(long, value_name = "DEG")]
    angle_deg: Option<f64>,
    /// Maximum rate of joints and rotors (amplitude times omega), degrees/s [default: optimise.rate_deg_s].
    #[arg(long, value_name = "DEG_S")]
    rate_deg_s: Option<f64>,
    /// Maximum mean power of the actuators, W [default: optimise.power_w].
    #[arg(long, value_name = "W")]
    power_w: Option<f64>,
    /// Maximum torque of each actuator of a joint, N m [default: optimise.torque_nm].
    #[arg(long, value_name = "NM")]
    torque_nm: Option<f64>,
    /// Constrain another objective to be at least as good as a value, in the unit of that objective: `v=0.05`,
    /// `work-per-metre=2`.
    #[arg(long, value_name = "WHAT=VALUE", value_parser = parse_least, conflicts_with = "pareto")]
    least: Option<(Objective, f64)>,
    /// Number of starts of the search [default: optimise.starts].
    #[arg(long, value_name = "N")]
    starts: Option<usize>,
    /// Print the optimal gait as an entry of pipeline.toml.
    #[arg(long, conflicts_with_all = ["json", "csv"])]
    gait_toml: bool,
    #[command(flatten)]
    files: Files,
    /// Save the optima to `derived/optima.parquet`, and the objective around the best one to
    /// `optimum_maps.parquet`; the report page shows them after the next `trilink report` or `trilink run`.
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
        let starts = settings.starts;
        let mut bounds = Bounds {
            omega_rad_s: settings.omega_rad_s,
            amplitude_rad: settings.amplitude_deg.map(f64::to_radians),
            rotor_amplitude_rad: settings.rotor_amplitude_deg.map(f64::to_radians),
            angle_rad: settings.angle_deg.to_radians(),
            rate_rad_s: settings.rate_deg_s.to_radians(),
            power_w: settings.power_w,
            torque_nm: settings.torque_nm,
            least: self.least,
        };
        let (objective, other) = self.objectives()?;
        let fits = self.numbers.fits(&context, self.replicates != Some(0))?;
        let setup = self.numbers.setup(config, campaign, self.model.as_deref(), fits.as_ref())?;
        note_caution(campaign, setup.model, setup.fit());
        if fits.is_none() {
            note_starting_values(&context.config, campaign, &[(setup.model, setup.robot.clone())]);
        }
        self.stay_near_trials(&setup, &mut bounds);
        let problem = setup
            .problem(self.fixed_rad_s().unwrap_or(0.5 * bounds.omega_rad_s.iter().sum::<f64>()));
        let free = if self.free.is_empty() {
            Command::all(&problem)
        } else {
            Command::parse(&self.free, &problem)?
        };
        let free = self.varying(free)?;
        let free = match self.harmonics {
            2 => Command::with_second_harmonics(free, &problem),
            _ => free,
        };
        bounds.check(&free, &problem)?;
        for message in exceeded_bounds(&problem, &bounds) {
            note!(
                "the current gait is outside the bounds: {message}; the search starts from the nearest gait within them"
            );
        }
        let search = Search { problem, objective, free, bounds, starts };
        if let Some(other) = other {
            return self.print_front(&context, &setup, &search, other);
        }
        let cancel = context.cancel();
        let found = search.run(cancel)?;
        // For comparison: the current gait at its best frequency.
        let by_omega = search.by_omega();
        let is_more = search.free.len() > by_omega.free.len();
        let present = if is_more { by_omega.present(cancel)? } else { None };
        let certainty =
            certainty::estimate(&setup, fits.as_ref(), self.replicates, (&search, &found), cancel)?;
        let mut optima: Vec<OptimumRow> = (1..)
            .zip(&found.optima)
            .map(|(number, optimum)| {
                optimum.row(number, campaign, &setup, &search, present.as_ref())
            })
            .collect();
        let problems = found.optima.iter().map(|optimum| optimum.problem.clone());
        note_extrapolation(campaign, setup.model, setup.measured_range(), problems);
        certainty::fill_in(&mut optima, &certainty, &search);
        let best = found.best().filter(|_| self.files.figure.is_some() || self.keep);
        let maps = best.map(|best| {
            let replicates =
                certainty.as_ref().map_or(&[][..], |certainty| &certainty.replicate_commands);
            let range = setup.measured_range().and_then(Result::ok);
            let shown = MapOverlay { present: present.as_ref(), replicates, range };
            search.map((campaign, setup.model), best, shown, cancel)
        });
        let maps = maps.transpose()?.unwrap_or_default();
        if !maps.is_empty() {
            self.files.draw(&context, self.numbers.fitted, |file| optimum_drawing(&maps, file))?;
        }
        let outcome = self.print(&setup, &search, &found, present.as_ref(), &certainty, &optima)?;
        if self.keep {
            let kept = OptimaTables { optima, maps };
            let derived = &context.config.paths.derived;
            let _lock =
                context.watched(|watch| hold(&context.config, self.exclusive.wait, watch))?;
            if let Some(problem) = kept.merge_into(derived)? {
                note!("{problem}; the earlier optima are dropped");
            }
            context.say(&format!("saved to {}", derived.join("optima.parquet").display()));
        }
        Ok(outcome)
    }

    /// Restricts the frequency and the amplitudes to the range of the fitted trials, widened by a fifth, unless their
    /// bounds are given as options or exclude that range.
    fn stay_near_trials(&self, setup: &Setup, bounds: &mut Bounds) {
        let Some(Ok(range)) = setup.measured_range() else { return };
        let common = |[a, b]: [f64; 2], [c, d]: [f64; 2]| {
            Some([a.max(c), b.min(d)]).filter(|[low, high]| low < high)
        };
        if self.omega.is_none()
            && let Some(omega_rad_s) = common(bounds.omega_rad_s, range.searched_omega_rad_s())
        {
            note!(
                "the search stays within {:.3} to {:.3} rad/s, the range of the trials widened by a fifth; set another \
                 range with --omega",
                omega_rad_s[0],
                omega_rad_s[1]
            );
            bounds.omega_rad_s = omega_rad_s;
        }
        let amplitude_rad = range.searched_amplitude_rad();
        if self.amplitude_deg.is_none()
            && let Some(amplitude_rad) =
                amplitude_rad.and_then(|range| common(bounds.amplitude_rad, range))
        {
            let [low, high] = amplitude_rad.map(f64::to_degrees);
            note!(
                "the search stays within amplitudes of {low:.1} to {high:.1} degrees, the range of the trials widened \
                 by a fifth; set another range with --amplitude-deg"
            );
            bounds.amplitude_rad = amplitude_rad;
        }
    }

    /// Returns the fixed frequency, rad/s, if `--omega` is a single number, and otherwise `None`.
    fn fixed_rad_s(&self) -> Option<f64> {
        self.omega.filter(|[low, high]| low == high).map(|[omega_rad_s, _]| omega_rad_s)
    }

    /// Returns the configuration, in which options given on the command line replace the settings of the search, except
    /// that a fixed frequency does not replace the bounds of the frequency.
    fn configured(&self, mut config: Config) -> Result<Config, Failure> {
        let settings = &mut config.optimise;
        if !self.fixed_rad_s().is_some_and(|omega_rad_s| omega_rad_s > 0.0) {
            settings.omega_rad_s = self.omega.unwrap_or(settings.omega_rad_s);
        }
        settings.amplitude_deg = self.amplitude_deg.unwrap_or(settings.amplitude_deg);
        settings.rotor_amplitude_deg =
            self.rotor_amplitude_deg.unwrap_or(settings.rotor_amplitude_deg);
        settings.angle_deg = self.angle_deg.unwrap_or(settings.angle_deg);
        settings.rate_deg_s = self.rate_deg_s.unwrap_or(settings.rate_deg_s);
        settings.power_w = self.power_w.or(settings.power_w);
        settings.torque_nm = self.torque_nm.or(settings.torque_nm);
        settings.starts = self.starts.unwrap_or(settings.starts);
        config.check(Path::new("the options"))?;
        Ok(config)
    }

    /// Returns the commands to vary: all of `free`, or all except the frequency if `--omega` fixes it and `--free` is
    /// not given. Returns an error if the frequency is both fixed and free, or neither, or if no command is free.
    fn varying(&self, mut free: Vec<Command>) -> Result<Vec<Command>, Failure> {
        let is_fixed = self.fixed_rad_s().is_some();
        if is_fixed && self.free.is_empty() {
            free.retain(|command| *command != Command::Omega);
        }
        match (free.contains(&Command::Omega), is_fixed) {
            (true, true) => {
                Err("--omega: found one frequency, needed LOW..HIGH, because `omega` is free"
                    .into())
            }
            (false, false) => {
                Err("--omega: found a range, needed one frequency, because `omega` is not \
                     free"
                    .into())
            }
            _ if free.is_empty() => {
                Err("--free: found no gait parameter to vary, needed at least one".into())
            }
            _ => Ok(free),
        }
    }

    /// Prints the results in the requested format, and writes the table if a file for it is given.
    fn print(
        &self,
        setup: &Setup,
        search: &Search,
        found: &SearchResult,
        present: Option<&Optimum>,
        certainty: &Result<Uncertainty, NoInterval>,
        rows: &[OptimumRow],
    ) -> Result<Outcome, Failure> {
        let objective = search.objective;
        let SearchResult { optima, failed } = found;
        let Some(first) = optima.first() else {
            let motion = if objective.depends_on_work() {
                "motion that is within the bounds and in which the actuators do work"
            } else {
                "steady motion within the bounds"
            };
            return Err(format!("no search found a {motion}").into());
        };
        if let Some(path) = &self.files.table {
            write_rows(path, rows, &format!("{search:?}"))?;
        }
        if self.gait_toml {
            if let Some(best) = found.best() {
                write_data(gait_toml(&self.campaign, objective, best, setup).trim_end());
            }
        } else if !self.format.rows(rows) {
            print_table(setup, objective, optima, present);
            match certainty {
                Ok(certainty) => certainty::print(search, certainty)?,
                Err(why) if self.numbers.fitted => say!("no intervals: {why}"),
                Err(_) => {}
            }
            if *failed > 0 {
                say!("{failed} searches ended in motions that the robot does not reach from rest");
            }
        }
        if found.best().is_none() {
            note!("no optimum is usable: {}", why_unusable(first));
            return Ok(Outcome::NeedsAttention);
        }
        Ok(Outcome::Well)
    }
}

/// Prints the optima, and the current gait at its best frequency.
fn print_table(setup: &Setup, objective: Objective, optima: &[Optimum], present: Option<&Optimum>) {
    let (name, scale) = match objective {
        Objective::Distance => ("d mm".to_owned(), 1e3),
        Objective::Speed => ("v mm/s".to_owned(), 1e3),
        other => (format!("{} {}", other.name(), other.unit()), 1.0),
    };
    let Some(first) = optima.first() else { return };
    let numbers = (1..).map(|i: usize| i.to_string()).zip(optima);
    let present_line = present.map(|present| ("current".to_owned(), present));
    let lines: Vec<(String, &Optimum)> = numbers.chain(present_line).collect();
    let mut table = Table::new(&lines)
        .left("", |(name, _)| name.clone())
        .right(&name, |(_, optimum)| short(scale * optimum.value))
        .right("omega rad/s", |(_, optimum)| short(optimum.problem.omega_rad_s));
    let has_second = optima.iter().any(|optimum| {
        let mut drives = Drive::all(&optimum.problem).into_iter();
        drives.any(|of| of.angle(&optimum.problem).is_some_and(|angle| angle.second.is_some()))
    });
    let robot = &first.problem.robot;
    for drive in Drive::all(&first.problem) {
        for command in drive.commands().filter(|command| !command.is_second()) {
            let (unit, scale) = command.unit().shown();
            let unit = if unit == "degrees" { "deg" } else { unit };
            table = table.right(&format!("{} {unit}", command.name(robot)), |(_, optimum)| {
                format!("{:.3}", scale * command.value(&optimum.problem) + 0.0)
            });
        }
        if drive.angle(&first.problem).is_none() || !has_second {
            continue;
        }
        type Second = (&'static str, fn(SecondHarmonic) -> f64);
        let seconds: [Second; 2] = [
            ("second amplitude", SecondHarmonic::amplitude_rad),
            ("second phase", SecondHarmonic::phase_rad),
        ];
        for (kind, angle_rad) in seconds {
            table = table.right(&format!("{} deg", drive.name(kind, robot)), |(_, optimum)| {
                let second = drive.angle(&optimum.problem).map(|command| command.second());
                let angle_rad = second.map_or(f64::NAN, angle_rad);
                format!("{:.3}", angle_rad.to_degrees() + 0.0)
            });
        }
    }
    table
        .right("d mm", |(_, optimum)| short(1e3 * optimum.motion.metrics.d_m))
        .right("v mm/s", |(_, optimum)| short(1e3 * optimum.motion.metrics.v_m_s))
        .right("work J/m", |(_, optimum)| short(optimum.motion.work_j / optimum.motion.metrics.d_m))
        .right("power W", |(_, optimum)| short(optimum.power_w()))
        .right("starts", |(_, optimum)| optimum.starts.to_string())
        .prose("remark", |(_, optimum)| remark(setup, optimum))
        .print();
    if let (Some(best), Some(present)) =
        (optima.first().filter(|best| best.is_reachable()), present)
    {
        let percent = 100.0 * (best.value / present.value - 1.0);
        say!("best gait: {percent:+.1} % compared with the current gait at its best frequency");
    }
}

/// Describes an optimum: its active bounds, any extrapolation beyond the fitted trials, and the reason if it is
/// unusable.
fn remark(setup: &Setup, optimum: &Optimum) -> String {
    let at_bound = if optimum.at_bound.is_empty() {
        String::new()
    } else {
        format!("at its bound: {}", optimum.at_bound.join(", "))
    };
    let extrapolated = match setup.extrapolation(&optimum.problem) {
        Extrapolation { extrapolated: Some(true), beyond_trials } => {
            format!("extrapolated: {beyond_trials}")
        }
        _ => String::new(),
    };
    let parts = [at_bound, extrapolated, why_unusable(optimum)];
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("; ")
}

/// Explains why an optimum is unusable; empty if it is usable.
fn why_unusable(optimum: &Optimum) -> String {
    match (optimum.status.is_stable(), optimum.from_rest) {
        (false, _) => format!("the motion is {}", optimum.status),
        (_, FromRest::Another) => {
            "starting from rest, the robot settles into a different motion".to_owned()
        }
        (_, FromRest::Unsettled) => "starting from rest, the robot does not settle".to_owned(),
        _ => String::new(),
    }
}

/// Formats a gait as an entry of `pipeline.toml`. A command that does not move its joint (a torque of zero) is as
/// configured.
fn gait_toml(campaign: &str, objective: Objective, best: &Optimum, setup: &Setup) -> String {
    let extrapolation = setup.extrapolation(&best.problem);
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
    let drives = Drive::all(&best.problem);
    for drive in &drives {
        let keys = drive.configured(&best.problem).into_iter();
        let keys: Vec<String> = keys.map(|(key, value)| format!("{key} = {value:?}")).collect();
        text += &format!("{} = {{ {} }}\n", drive.key(&best.problem.robot), keys.join(", "));
    }
    let moved: Vec<String> = drives.iter().map(|drive| drive.key(&best.problem.robot)).collect();
    for (key, command) in setup.configured_gait() {
        if key.starts_with("joint")
            && !moved.contains(key)
            && let Ok(command) = toml::Value::try_from(command)
        {
            text += &format!("{key} = {command}\n");
        }
    }
    text
}

/// Parses the name of an objective that can be maximised.
fn parse_objective(text: &str) -> Result<Objective, String> {
    parse_among(text, |objective| !objective.is_minimised())
}

/// Parses the name of an objective that can be minimised.
fn parse_minimised(text: &str) -> Result<Objective, String> {
    parse_among(text, Objective::is_minimised)
}

/// Parses the name of any objective.
fn parse_any(text: &str) -> Result<Objective, String> {
    parse_among(text, |_| true)
}

/// Parses an objective and its worst permitted value, such as `v=0.05`.
fn parse_least(text: &str) -> Result<(Objective, f64), String> {
    let needed = || format!("found `{text}`, needed WHAT=VALUE, such as v=0.05");
    let (what, value) = text.split_once('=').ok_or_else(needed)?;
    value.trim().parse::<f64>().map_err(|_| needed())?;
    let value = positive(value).ok_or_else(|| needed() + ", with a value above 0")?;
    Ok((parse_any(what.trim())?, value))
}

/// Parses the name of an objective for which `is_allowed` returns true.
fn parse_among(text: &str, is_allowed: impl Fn(Objective) -> bool) -> Result<Objective, String> {
    let known: Vec<Objective> =
        Objective::ALL.into_iter().filter(|objective| is_allowed(*objective)).collect();
    let found = known.iter().copied().find(|objective| objective.name() == text);
    found.ok_or_else(|| {
        let names: Vec<&str> = known.iter().map(|objective| objective.name()).collect();
        let hint = did_you_mean(text, names.iter().copied());
        format!("found `{text}`, needed `{}`{hint}", names.join("`, `"))
    })
}

/// Parses `LOW..HIGH`, or a single number, which becomes both limits.
fn parse_range(text: &str) -> Result<[f64; 2], String> {
    let needed = || format!("found `{text}`, needed LOW..HIGH or a number");
    let range = low_high(text).or_else(|| finite(text).map(|value| [value; 2]));
    let range = range.ok_or_else(needed)?;
    if text.contains("..") && range[0] >= range[1] {
        return Err(needed() + ", with the lower number first");
    }
    Ok(range)
}
