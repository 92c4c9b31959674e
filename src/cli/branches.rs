//! `trilink branches`.

use trilink_fit::simulate::Setup;
use trilink_mechanics::{Branch, Problem, branches};
use trilink_report::branches_drawing;
use trilink_tables::BranchRow;
use trilink_tables::config::{Config, did_you_mean};

use super::output::say;
use super::parse::low_high;
use super::results::{Files, Format};
use super::setup::{Numbers, note_caution, note_extrapolation, note_starting_values};
use super::table::{Table, short};
use super::terminal::Text;
use super::{Context, Failure, Outcome, candidates};

/// Name of the frequency as a parameter of a continuation.
const OMEGA: &str = "omega_rad_s";

/// Continue a model's steady-state motions as a parameter varies, and find folds, symmetry breaking and
/// period doubling.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/branches.txt").trim_end())]
pub(super) struct Branches {
    /// Name of a `[campaign.*]` table.
    #[arg(add = candidates::campaigns())]
    campaign: String,
    /// Parameter to vary and its range, in which branches are followed from the lower limit upwards: the frequency
    /// (`omega_rad_s=0.5..12`), or a parameter of the robot or the gait such as `damping_nm_s_rad=0.0002..0.01`. The
    /// name of a parameter of one wheel, link or joint includes the number of that wheel, link or joint, as in the
    /// columns of tables: `skid1_kg_s=20..400`, `amplitude2_deg=5..60`. The parameters of a chain have the names that
    /// `simulate --sensitivities` prints: `front.mass_kg=0.2..0.5`.
    #[arg(long, value_name = "KEY=LOW..HIGH", value_parser = parse_over)]
    over: Over,
    /// Name of a `[model.*]` table: no-skid, no-skid-damped, no-skid-roll, skid, skid-roll or your own
    /// [default: skid-roll, with --fitted the preferred model of the comparison].
    #[arg(long, add = candidates::models())]
    model: Option<String>,
    #[command(flatten)]
    numbers: Numbers,
    /// Frequency, rad/s; required if `--over` varies another parameter.
    #[arg(long, value_name = "RAD_S")]
    omega: Option<f64>,
    #[command(flatten)]
    files: Files,
    #[command(flatten)]
    format: Format,
}

/// Parameter that a continuation varies, and its range.
#[derive(Debug, Clone, PartialEq)]
struct Over {
    key: String,
    range: [f64; 2],
}

impl Branches {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        let campaign = &self.campaign;
        let config = &context.config;
        let key = &self.over.key;
        let [low, high] = self.over.range;
        let fits = self.numbers.fits(&context, false)?;
        let model = self.model.as_deref();
        let setup = self.numbers.setup(config.clone(), campaign, model, fits.as_ref())?;
        let vary = Vary::new(config, &self, &setup)?;
        note_caution(campaign, setup.model, setup.fit());
        self.files.check()?;
        let cancel = context.cancel();
        let found = branches(&|value| vary.problem(value), [low, high], &|| cancel.is_cancelled());
        cancel.check()?;
        let found = found.map_err(|error| format!("--over: at {key}={low}: {error}"))?;
        let rows =
            rows(&found, key, |value| setup.extrapolation(&vary.problem(value)).extrapolated);
        let problems = rows.iter().map(|row| vary.problem(row.value));
        note_extrapolation(campaign, setup.model, setup.measured_range(), problems);
        if fits.is_none() {
            note_starting_values(config, campaign, &[(setup.model, setup.robot.clone())]);
        }
        let input = format!("{:?} {key} {low} {high}", vary.problem(low));
        self.files.write(&context, &rows, &input, "points")?;
        let names = [campaign.as_str(), setup.model.name(), key];
        self.files
            .draw(&context, self.numbers.fitted, |file| branches_drawing(names, &rows, file))?;
        if !self.format.rows(&rows) {
            print(&found, &rows);
        }
        Ok(Outcome::Well)
    }
}

/// Steady-state problems along the range of a parameter.
struct Vary<'s> {
    setup: &'s Setup,
    key: String,
    /// Frequency, rad/s, at which another parameter is varied; unused if the frequency itself is varied.
    omega_rad_s: f64,
}

impl<'s> Vary<'s> {
    /// Checks the parameter and its range, and combines them with the robot, gait and friction laws of `setup`.
    fn new(config: &Config, arguments: &Branches, setup: &'s Setup) -> Result<Self, Failure> {
        let Over { key, range } = arguments.over.clone();
        let omega_rad_s = match (key == OMEGA, arguments.omega) {
            (true, None) => range[0],
            (true, Some(_)) => {
                return Err(
                    "--omega: the frequency cannot be fixed, because `--over omega_rad_s` varies \
                     it"
                    .into(),
                );
            }
            (false, Some(omega)) if omega > 0.0 && omega.is_finite() => omega,
            (false, Some(omega)) => {
                return Err(format!("--omega: found {omega}, needed a frequency above 0").into());
            }
            (false, None) => {
                return Err(format!(
                    "--omega: this option is required, because `--over` varies `{key}` instead of \
                     the frequency"
                )
                .into());
            }
        };
        if key == OMEGA && range[0] <= 0.0 {
            return Err(format!("--over: found {}, needed a frequency above 0", range[0]).into());
        }
        for value in range.into_iter().filter(|_| key != OMEGA) {
            check(setup, config, &arguments.campaign, &key, value)?;
        }
        let vary = Self { setup, key, omega_rad_s };
        let [low, high] = range.map(|value| vary.problem(value).is_mirrored());
        if low && !high {
            return Err(format!(
                "--over: the motion at {}={} is symmetric, but the motions next to it are not; \
                 start the range at another value",
                vary.key, range[0]
            )
            .into());
        }
        Ok(vary)
    }

    /// Returns the steady-state problem at a value of the parameter.
    fn problem(&self, value: f64) -> Problem {
        if self.key == OMEGA {
            return self.setup.problem(value);
        }
        let varied = self.setup.with_number(&self.key, value);
        varied.as_ref().unwrap_or(self.setup).problem(self.omega_rad_s)
    }
}

/// Checks that a parameter exists and can have a value.
fn check(
    setup: &Setup,
    config: &Config,
    campaign: &str,
    key: &str,
    value: f64,
) -> Result<(), Failure> {
    if let Some(changed) = setup.with_number(key, value) {
        return Ok(changed.check(config, campaign, "--over")?);
    }
    let known = setup.number_names();
    let hint = did_you_mean(key, known.iter().map(String::as_str));
    let known = known.join("`, `");
    Err(format!("--over: found `{key}`, needed `{OMEGA}` or one of `{known}`{hint}").into())
}

/// Parses a parameter and its range, `KEY=LOW..HIGH`.
fn parse_over(text: &str) -> Result<Over, String> {
    let needed = || format!("found `{text}`, needed KEY=LOW..HIGH, such as omega_rad_s=0.5..12");
    let (key, range) = text.split_once('=').ok_or_else(needed)?;
    let [low, high] = low_high(range).ok_or_else(needed)?;
    if low >= high {
        return Err(format!("found {low}..{high}, needed the lower number first"));
    }
    Ok(Over { key: key.trim().to_owned(), range: [low, high] })
}

/// Returns a row for each point of the branches; `extrapolated` returns whether a parameter value lies outside the
/// range of the fitted trials, or `None` if there is no such range or it is unknown.
fn rows(
    found: &[Branch],
    parameter: &str,
    extrapolated: impl Fn(f64) -> Option<bool>,
) -> Vec<BranchRow> {
    let points = found.iter().zip(1_i64..).flat_map(|(branch, number)| {
        branch.points.iter().map(move |point| (branch, number, point))
    });
    let rows = points.map(|(branch, number, point)| BranchRow {
        branch: number,
        kind: branch.kind,
        parent: branch.parent.map(|index| index as i64 + 1),
        periods: branch.kind.periods(),
        parameter: parameter.to_owned(),
        value: point.value,
        extrapolated: extrapolated(point.value),
        metrics: point.metrics,
        floquet: point.floquet,
        status: point.status,
        bifurcation: point.bifurcation,
    });
    rows.collect()
}

/// Prints the end points and the bifurcations of each branch.
fn print(found: &[Branch], rows: &[BranchRow]) {
    let Some(first) = rows.first() else { return };
    let mut lines: Vec<(&BranchRow, String)> = Vec::new();
    for (branch, index) in found.iter().zip(1_i64..) {
        let of_branch: Vec<&BranchRow> = rows.iter().filter(|row| row.branch == index).collect();
        let last = of_branch.len().saturating_sub(1);
        for (nth, row) in of_branch.into_iter().enumerate() {
            let what = match (row.bifurcation, nth) {
                (Some(bifurcation), n) if n < last => bifurcation.name().to_owned(),
                (_, n) if n == last => branch.end.clone(),
                (_, 0) => {
                    row.parent.map_or("first motion".to_owned(), |parent| format!("from {parent}"))
                }
                _ => continue,
            };
            lines.push((row, what));
        }
    }
    Table::new(&lines)
        .right("branch", |(row, _)| row.branch.to_string())
        .left("kind", |(row, _)| row.kind.to_string())
        .right(&first.parameter, |(row, _)| format!("{:.7}", row.value))
        .right("d mm", |(row, _)| short(1e3 * row.metrics.d_m))
        .right("v mm/s", |(row, _)| short(1e3 * row.metrics.v_m_s))
        .right("dtheta deg", |(row, _)| short(row.metrics.dtheta_rad.to_degrees()))
        .right("floquet", |(row, _)| format!("{:.6}", row.floquet))
        .left("status", |(row, _)| Text::status(row.status))
        .prose("", |(_, what)| what.clone())
        .print();
    say!("{} points on {} branches", rows.len(), found.len());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_has_a_key_and_two_numbers_in_order() {
        let over = Over { key: "omega_rad_s".to_owned(), range: [0.5, 12.0] };
        assert_eq!(parse_over("omega_rad_s=0.5..12"), Ok(over));
        for (text, named) in [
            ("0.5..12", "needed KEY=LOW..HIGH"),
            ("omega_rad_s=3", "needed KEY=LOW..HIGH"),
            ("omega_rad_s=a..3", "needed KEY=LOW..HIGH"),
            ("omega_rad_s=3..1", "found 3..1, needed the lower number first"),
        ] {
            let message = parse_over(text).err().unwrap();
            assert!(message.contains(named), "{message}");
        }
    }
}
