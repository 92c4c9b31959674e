//! `trilink branches`.

use std::path::{Path, PathBuf};

use trilink_fit::simulate::{KnownFits, Setup, number_names, with_number};
use trilink_mechanics::{Branch, Problem, branches};
use trilink_report::{FigureFile, branches_drawing};
use trilink_robot::Laws;
use trilink_tables::BranchRow;
use trilink_tables::config::{Config, GaitConfig, RobotConfig, did_you_mean};

use super::fitted::{note_caution, note_extrapolation, note_starting_values, preferred};
use super::omegas::low_high;
use super::output::say;
use super::rows_file::{RowsFile, print_rows, write_figure};
use super::table::{self, short};
use super::{Context, Failure, Outcome};
use crate::interrupt;

/// The model that is taken where none is named, without fits.
const MODEL: &str = "skid-roll";
/// The name of the frequency among what branches can be followed over.
const OMEGA: &str = "omega_rad_s";

#[derive(clap::Args)]
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
    /// Take the coefficients that were fitted to the campaign's trials, by `trilink fit`, for those of the configuration.
    #[arg(long)]
    fitted: bool,
    /// The frequency, rad/s, where another parameter varies.
    #[arg(long, value_name = "RAD_S")]
    omega: Option<f64>,
    /// Numbers of the robot and the gait, as `simulate` takes them.
    #[arg(long, num_args = 1.., value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Write all points: Parquet, CSV or JSON, by the file's ending.
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
    /// Draw the branches: SVG, PNG or PDF, by the file's ending.
    #[arg(long, value_name = "FILE")]
    figure: Option<PathBuf>,
    /// Print all points as CSV.
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// Print all points as JSON.
    #[arg(long)]
    json: bool,
}

/// A parameter and its range.
#[derive(Debug, Clone, PartialEq)]
struct Over {
    key: String,
    range: [f64; 2],
}

impl Branches {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        let (key, [low, high]) = (&self.over.key, self.over.range);
        let setup = self.setup(&context.config)?;
        let vary = Vary::new(&context.config, &self, &setup)?;
        note_caution(&self.campaign, &setup);
        let file = self.table.as_deref().map(|path| RowsFile::new(path, "--table")).transpose()?;
        let cancel = interrupt::token();
        let found = branches(&|value| vary.problem(value), [low, high], &|| cancel.is_cancelled());
        cancel.check()?;
        let found = found.map_err(|error| format!("--over: at {key}={low}: {error}"))?;
        let rows =
            rows(&found, key, |value| setup.extrapolation(&vary.problem(value)).extrapolated);
        let values: Vec<f64> = rows.iter().map(|row| row.value).collect();
        note_extrapolation(&self.campaign, &setup, values.iter().map(|of| vary.problem(*of)));
        if !self.fitted {
            note_starting_values(&context.config, &self.campaign, std::slice::from_ref(&setup));
        }
        if let Some(file) = file {
            let input =
                blake3::hash(format!("{:?} {key} {low} {high}", vary.problem(low)).as_bytes());
            file.write(&rows, &input)?;
            context.progress.say(&format!("{}: {} points", file.path.display(), rows.len()));
        }
        if let Some(path) = &self.figure {
            let names = [self.campaign.as_str(), setup.model.name(), key];
            let fitted_to = self.fitted.then_some(&context.config.paths);
            let drawn = |file: FigureFile| branches_drawing(names, &rows, file);
            write_figure(path, &context.progress, fitted_to, drawn)?;
        }
        if !print_rows(&rows, self.csv, self.json) {
            print(&found, &rows);
        }
        Ok(Outcome::Well)
    }

    /// The model, with configured or fitted coefficients.
    fn setup(&self, config: &Config) -> Result<Setup, Failure> {
        let (campaign, settings) = (&self.campaign, &self.set);
        let named = self.model.as_deref();
        if !self.fitted {
            let model = named.unwrap_or(MODEL);
            return Ok(Setup::new(config.clone(), campaign, model, settings)?);
        }
        let fits = KnownFits::read(config, false)?;
        let model = match named {
            Some(model) => model.to_owned(),
            None => preferred(config, &fits, campaign)?.name().to_owned(),
        };
        Ok(Setup::fitted(config.clone(), campaign, &model, settings, &fits)?)
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
        match low && !high {
            true => Err(format!(
                "--over: at {}={} the motion is its own mirror image and beside it none is: needed a range \
                 that does not begin there",
                vary.key, range[0]
            )
            .into()),
            false => Ok(vary),
        }
    }

    fn problem(&self, value: f64) -> Problem {
        let is_omega = self.key == OMEGA;
        let varied = match is_omega {
            true => None,
            false => with_number(&self.robot, &self.gait, &self.key, value),
        };
        let (robot, gait) = match &varied {
            Some((robot, gait)) => (robot, gait),
            None => (&self.robot, &self.gait),
        };
        Problem {
            robot: robot.to_robot(),
            gait: gait.to_gait(),
            laws: self.laws,
            omega_rad_s: if is_omega { value } else { self.omega_rad_s },
        }
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
    let headings = [
        ("branch", true),
        ("kind", false),
        (first.parameter.as_str(), true),
        ("d mm", true),
        ("v mm/s", true),
        ("dtheta deg", true),
        ("floquet", true),
        ("status", false),
        ("", false),
    ];
    let mut lines = Vec::new();
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
            let metrics = &row.metrics;
            lines.push(vec![
                index.to_string(),
                row.kind.to_string(),
                format!("{:.7}", row.value),
                short(1e3 * metrics.d_m),
                short(1e3 * metrics.v_m_s),
                short(metrics.dtheta_rad.to_degrees()),
                format!("{:.6}", row.floquet),
                row.status.to_string(),
                what,
            ]);
        }
    }
    table::print(&headings, &lines, None);
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
