//! `trilink branches`.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::omegas::low_high;
use super::output::say;
use super::rows_file::{RowsFile, print_rows, write_figure};
use super::table::{self, short};
use super::{Context, Failure, Outcome};
use crate::config::{Config, RobotConfig, did_you_mean};
use crate::motion::{Branch, Problem, branches};
use crate::report::branches_drawing;
use crate::robot::{Gait, Laws};
use crate::simulate::{laws_of, with_settings};
use crate::store::BranchRow;

/// The name of the frequency among what branches can be followed over.
const OMEGA: &str = "omega_rad_s";

#[derive(clap::Args)]
pub(super) struct Branches {
    /// Name of a `[campaign.*]`.
    campaign: String,
    /// What to vary, from where the first motion is solved for: `omega_rad_s=0.5..12`, or a number of
    /// the robot such as `damping_nm_s_rad=0.0002..0.01`; of one wheel or link with its number, as
    /// columns have it: `skid1_kg_s=20..400`.
    #[arg(long, value_name = "KEY=LOW..HIGH", value_parser = parse_over)]
    over: Over,
    /// Name of a `[model.*]`: no-skid, no-skid-damped, no-skid-roll, skid, skid-roll or your own.
    #[arg(long, default_value = "skid-roll")]
    model: String,
    /// The frequency, rad/s, where another parameter varies.
    #[arg(long, value_name = "RAD_S")]
    omega: Option<f64>,
    /// Parameters of the robot: `skid_kg_s=104,34,45`, one or several.
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
    pub fn run(self, context: Context) -> Result<Outcome, Failure> {
        let config = with_settings(context.config, &self.campaign, &self.set)?;
        let (key, [low, high]) = (&self.over.key, self.over.range);
        let gait = config.campaign_setup(&self.campaign).ok_or("no such campaign")?.1;
        let vary = Vary::new(config, &self, gait)?;
        let file = self.table.as_deref().map(|path| RowsFile::new(path, "--table")).transpose()?;
        let found = branches(&|value| vary.problem(value), [low, high])
            .map_err(|error| format!("--over: at {key}={low}: {error}"))?;
        let rows = rows(&found, key);
        if let Some(file) = file {
            let input =
                blake3::hash(format!("{:?} {key} {low} {high}", vary.problem(low)).as_bytes());
            file.write(&rows, &input)?;
            context.progress.say(&format!("{}: {} points", file.path.display(), rows.len()));
        }
        if let Some(path) = &self.figure {
            let names = [&self.campaign, &self.model, key].map(String::as_str);
            let drawn = |ending: &str| branches_drawing(names, &rows, ending);
            write_figure(path, &context.progress, drawn)?;
        }
        if !print_rows(&rows, self.csv, self.json) {
            print(&found, &rows);
        }
        Ok(Outcome::Well)
    }
}

/// The problems along a range.
struct Vary {
    robot: RobotConfig,
    gait: Gait,
    laws: Laws,
    key: String,
    /// Where it is not the one that varies.
    omega_rad_s: f64,
}

impl Vary {
    fn new(mut config: Config, of: &Branches, gait: Gait) -> Result<Self, Failure> {
        let Over { key, range } = of.over.clone();
        let name = config.campaign[&of.campaign].robot.clone();
        let robot = config.robot[&name].clone();
        let laws = laws_of(&config, &of.campaign, &of.model)?;
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
            let varied = with_value(&robot, &key, value).ok_or_else(|| {
                let known = keys(&robot);
                let hint = did_you_mean(&key, known.iter().map(String::as_str));
                let known = known.join("`, `");
                format!("--over: found `{key}`, needed `{OMEGA}` or one of `{known}`{hint}")
            })?;
            config.robot.insert(name.clone(), varied);
            config.check(Path::new("--over"))?;
        }
        Ok(Self { robot, gait, laws, key, omega_rad_s })
    }

    fn problem(&self, value: f64) -> Problem {
        let is_omega = self.key == OMEGA;
        let varied = if is_omega { None } else { with_value(&self.robot, &self.key, value) };
        Problem {
            robot: varied.as_ref().unwrap_or(&self.robot).to_robot(),
            gait: self.gait,
            laws: self.laws,
            omega_rad_s: if is_omega { value } else { self.omega_rad_s },
        }
    }
}

/// Numbers of a robot, those of single wheels and links with their number.
fn keys(robot: &RobotConfig) -> Vec<String> {
    let fields = serde_json::to_value(robot).ok();
    let fields = fields.as_ref().and_then(Value::as_object).into_iter().flatten();
    let keys = fields.flat_map(|(key, value)| match value {
        Value::Number(_) => vec![key.clone()],
        Value::Array(_) => (0..3).map(|of| numbered(key, of)).collect(),
        _ => Vec::new(),
    });
    keys.collect()
}

/// `skid1_kg_s` of `skid_kg_s`.
fn numbered(key: &str, number: usize) -> String {
    const UNITS: [&str; 4] = ["_kg_m2", "_kg_s", "_kg", "_n"];
    let unit = UNITS.into_iter().find(|unit| key.ends_with(unit)).unwrap_or_default();
    let name = key.strip_suffix(unit).unwrap_or(key);
    format!("{name}{number}{unit}")
}

/// A robot with one of these numbers changed.
fn with_value(robot: &RobotConfig, key: &str, value: f64) -> Option<RobotConfig> {
    let mut fields = serde_json::to_value(robot).ok()?;
    let found = fields.as_object_mut()?.iter_mut().find_map(|(name, field)| match field {
        Value::Number(_) => (name == key).then_some(field),
        Value::Array(all) => (0..3).find(|&of| numbered(name, of) == key).map(|of| &mut all[of]),
        _ => None,
    })?;
    *found = value.into();
    serde_json::from_value(fields).ok()
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

fn rows(found: &[Branch], parameter: &str) -> Vec<BranchRow> {
    let number = |index: usize| index as i64 + 1;
    let of_branch = |(index, branch): (usize, &Branch)| {
        let (kind, parent) = (branch.kind, branch.parent.map(number));
        let row = |point: &crate::motion::BranchPoint| BranchRow {
            branch: number(index),
            kind,
            parent,
            periods: kind.periods(),
            parameter: parameter.to_owned(),
            value: point.value,
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

    #[test]
    fn every_number_of_a_robot_can_vary_and_nothing_else() {
        let config = Config::default();
        let robot = &config.robot["semi-passive"];
        let known = keys(robot);
        for key in ["h_m", "damping_nm_s_rad", "rest_angle_deg", "skid1_kg_s", "inertia2_kg_m2"] {
            assert!(known.iter().any(|known| known == key), "{key}: {known:?}");
        }
        for key in &known {
            let varied = with_value(robot, key, 0.1234).unwrap();
            assert_ne!(varied, *robot, "{key}");
            assert_eq!(with_value(robot, key, 0.1234), Some(varied));
        }
        assert_eq!(with_value(robot, "skid_kg_s", 1.0), None);
    }
}
