//! `trilink branches`.

use std::path::Path;

use trilink_fit::simulate::{Setup, number_names, with_number};
use trilink_mechanics::{Branch, Problem, branches};
use trilink_report::{FigureFile, branches_drawing};
use trilink_robot::Laws;
use trilink_tables::BranchRow;
use trilink_tables::config::{Config, GaitConfig, RobotConfig, did_you_mean};

use super::output::say;
use super::parse::low_high;
use super::results::{Files, Format};
use super::setup::{Numbers, note_caution, note_extrapolation, note_starting_values};
use super::table::{Table, short};
use super::{Context, Failure, Outcome};
use crate::interrupt;

/// The name of the frequency among what branches can be followed over.
const OMEGA: &str = "omega_rad_s";

/// Follow a model's steady motions over a parameter: folds, lost symmetry, doubled periods.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/branches.txt").trim_end())]
pub(super) struct Branches {
    /// Name of a `[campaign.*]`.
    campaign: String,
    /// What to vary, from where the first motion is solved for: `omega_rad_s=0.5..12`, or a number of
    /// the robot or the gait such as `damping_nm_s_rad=0.0002..0.01`; of one wheel, link or joint with
    /// its number, as columns have it: `skid1_kg_s=20..400`, `amplitude2_deg=5..60`.
    #[arg(long, value_name = "KEY=LOW..HIGH", value_parser = parse_over)]
    over: Over,
    /// Name of a `[model.*]`: no-skid, no-skid-damped, no-skid-roll, skid, skid-roll or your own [default: skid-roll, with
    /// --fitted the one that the comparison prefers].
    #[arg(long)]
    model: Option<String>,
    #[command(flatten)]
    numbers: Numbers,
    /// The frequency, rad/s, where another parameter varies.
    #[arg(long, value_name = "RAD_S")]
    omega: Option<f64>,
    #[command(flatten)]
    files: Files,
    #[command(flatten)]
    format: Format,
}

/// A parameter and its range.
#[derive(Debug, Clone, PartialEq)]
struct Over {
    key: String,
    range: [f64; 2],
}

impl Branches {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        let (campaign, config) = (&self.campaign, &context.config);
        let (key, [low, high]) = (&self.over.key, self.over.range);
        let fits = self.numbers.fits(config, false)?;
        let setup =
            self.numbers.setup(config.clone(), campaign, self.model.as_deref(), fits.as_ref())?;
        let vary = Vary::new(config, &self, &setup)?;
        note_caution(campaign, &setup);
        self.files.check()?;
        let cancel = interrupt::token();
        let found = branches(&|value| vary.problem(value), [low, high], &|| cancel.is_cancelled());
        cancel.check()?;
        let found = found.map_err(|error| format!("--over: at {key}={low}: {error}"))?;
        let rows =
            rows(&found, key, |value| setup.extrapolation(&vary.problem(value)).extrapolated);
        note_extrapolation(campaign, &setup, rows.iter().map(|row| vary.problem(row.value)));
        note_starting_values(config, campaign, std::slice::from_ref(&setup));
        let input = format!("{:?} {key} {low} {high}", vary.problem(low));
        self.files.write(&context, &rows, &input, "points")?;
        let names = [campaign.as_str(), setup.model.name(), key];
        let drawn = |file: FigureFile| branches_drawing(names, &rows, file);
        self.files.draw(&context, self.numbers.fitted, drawn)?;
        if !self.format.rows(&rows) {
            print(&found, &rows);
        }
        Ok(Outcome::Well)
    }
}

/// The problems along a range.
struct Vary {
    robot: RobotConfig,
    gait: GaitConfig,
    laws: Laws,
    key: String,
    /// Where it is not the one that varies.
    omega_rad_s: f64,
}

impl Vary {
    fn new(config: &Config, of: &Branches, setup: &Setup) -> Result<Self, Failure> {
        let Over { key, range } = of.over.clone();
        let (robot, gait) = (setup.robot_config.clone(), setup.gait_config.clone());
        let omega_rad_s = match (key == OMEGA, of.omega) {
            (true, None) => range[0],
            (true, Some(_)) => return Err("--omega: `--over omega_rad_s` varies it already".into()),
            (false, Some(omega)) if omega > 0.0 && omega.is_finite() => omega,
            (false, Some(omega)) => {
                return Err(format!("--omega: found {omega}, needed a frequency above 0").into());
            }
            (false, None) => return Err(format!("--omega: needed, `{key}` varies").into()),
        };
        if key == OMEGA && range[0] <= 0.0 {
            return Err(format!("--over: found {}, needed a frequency above 0", range[0]).into());
        }
        for value in range.into_iter().filter(|_| key != OMEGA) {
            let varied = with_number(&robot, &gait, &key, value).ok_or_else(|| {
                let known = number_names(&robot, &gait);
                let hint = did_you_mean(&key, known.iter().map(String::as_str));
                let known = known.join("`, `");
                format!("--over: found `{key}`, needed `{OMEGA}` or one of `{known}`{hint}")
            })?;
            let mut config = config.clone();
            let campaign = config.campaign[&of.campaign].clone();
            config.robot.insert(campaign.robot, varied.0);
            config.gait.insert(campaign.gait, varied.1);
            config.check(Path::new("--over"))?;
        }
        let vary = Self { robot, gait, laws: setup.laws, key, omega_rad_s };
        let [low, high] = range.map(|value| vary.problem(value).is_mirrored());
        if low && !high {
            return Err(format!(
                "--over: at {}={} the motion is its own mirror image and beside it none is: needed a range \
                 that does not begin there",
                vary.key, range[0]
            )
            .into());
        }
        Ok(vary)
    }

    fn problem(&self, value: f64) -> Problem {
        let mut problem = Problem {
            robot: self.robot.to_robot(),
            gait: self.gait.to_gait(),
            laws: self.laws,
            omega_rad_s: self.omega_rad_s,
        };
        if self.key == OMEGA {
            problem.omega_rad_s = value;
        } else if let Some((robot, gait)) = with_number(&self.robot, &self.gait, &self.key, value) {
            (problem.robot, problem.gait) = (robot.to_robot(), gait.to_gait());
        }
        problem
    }
}

fn parse_over(text: &str) -> Result<Over, String> {
    let needed = || format!("found `{text}`, needed KEY=LOW..HIGH, such as omega_rad_s=0.5..12");
    let (key, range) = text.split_once('=').ok_or_else(needed)?;
    let [low, high] = low_high(range).ok_or_else(needed)?;
    if low >= high {
        return Err(format!("found {low}..{high}, needed the lower number first"));
    }
    Ok(Over { key: key.trim().to_owned(), range: [low, high] })
}

/// A row for each point; `extrapolated` says of a value whether it is beyond the trials of the fit.
fn rows(
    found: &[Branch],
    parameter: &str,
    extrapolated: impl Fn(f64) -> Option<bool>,
) -> Vec<BranchRow> {
    let number = |index: usize| index as i64 + 1;
    let of_branch = |(index, branch): (usize, &Branch)| {
        let (kind, parent) = (branch.kind, branch.parent.map(number));
        let row = |point: &trilink_mechanics::BranchPoint| BranchRow {
            branch: number(index),
            kind,
            parent,
            periods: kind.periods(),
            parameter: parameter.to_owned(),
            value: point.value,
            extrapolated: extrapolated(point.value),
            metrics: point.metrics,
            floquet: point.floquet,
            status: point.status,
            bifurcation: point.bifurcation,
        };
        branch.points.iter().map(row).collect::<Vec<_>>()
    };
    found.iter().enumerate().flat_map(of_branch).collect()
}

/// Where each branch begins and ends, and what happens on it.
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
                    row.parent.map_or("the first motion".to_owned(), |of| format!("from {of}"))
                }
                _ => continue,
            };
            lines.push((row, what));
        }
    }
    Table::of(&lines)
        .right("branch", |(row, _)| row.branch.to_string())
        .left("kind", |(row, _)| row.kind.to_string())
        .right(&first.parameter, |(row, _)| format!("{:.7}", row.value))
        .right("d mm", |(row, _)| short(1e3 * row.metrics.d_m))
        .right("v mm/s", |(row, _)| short(1e3 * row.metrics.v_m_s))
        .right("dtheta deg", |(row, _)| short(row.metrics.dtheta_rad.to_degrees()))
        .right("floquet", |(row, _)| format!("{:.6}", row.floquet))
        .left("status", |(row, _)| row.status.to_string())
        .left("", |(_, what)| what.clone())
        .print();
    say!("{} points of {} branches", rows.len(), found.len());
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
