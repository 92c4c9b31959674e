//! The motion of a model by names or by numbers.

use std::collections::BTreeMap;
use std::path::PathBuf;

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyByteArray;
use rayon::prelude::*;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_fit::simulate::{Answer, Setup};
use trilink_tables::config::Campaign;
use trilink_tables::{Columns, TrajectoryRow};

use crate::error::Failure;
use crate::interrupt::interruptible;

/// Name of the robot, gait and campaign that stand for given ones.
const GIVEN: &str = "given";

/// What to simulate: JSON of this.
#[derive(Deserialize)]
struct Request {
    config: Option<PathBuf>,
    campaign: Option<String>,
    /// A name of the configuration, or the keys of the table that it would name.
    robot: Option<Value>,
    gait: Option<Value>,
    model: String,
    omegas_rad_s: Vec<f64>,
    /// `key=value` each.
    settings: Vec<String>,
    from_rest: bool,
    samples: Option<usize>,
}

/// The columns of motions over time by their names, and their values in the machine's order, column
/// after column; `None` of a motion that does not exist.
type Trajectory<'py> = Option<(Vec<String>, Bound<'py, PyByteArray>)>;

/// Solves for the motion at every frequency. Gives JSON of the answers, and their trajectories if
/// `samples` are asked for.
pub fn simulate<'py>(py: Python<'py>, request: &str) -> PyResult<(String, Vec<Trajectory<'py>>)> {
    let request: Request = serde_json::from_str(request).map_err(Failure::from)?;
    let Request { omegas_rad_s, from_rest, samples, .. } = &request;
    let setup = setup(&request)?;
    let solve = |&omega_rad_s: &f64| {
        let answer = setup.answer(omega_rad_s, *from_rest);
        let rows = samples.map(|samples| setup.trajectory(&answer, *from_rest, samples).ok());
        (answer, rows.flatten())
    };
    let solved: Vec<(Answer, Option<Vec<TrajectoryRow>>)> = match &omegas_rad_s[..] {
        // Another thread would take a part of the time of one solution.
        [omega_rad_s] => vec![py.detach(|| solve(omega_rad_s))],
        all => {
            let cancel = CancelToken::default();
            let solve = |omega_rad_s| {
                cancel.check()?;
                Ok(solve(omega_rad_s))
            };
            let work =
                || all.par_iter().with_max_len(1).map(solve).collect::<Result<_, Cancelled>>();
            let solved = interruptible(py, &cancel, work, |_| false)?;
            solved.map_err(|Cancelled| PyKeyboardInterrupt::new_err(()))?
        }
    };
    let (answers, rows): (Vec<Answer>, Vec<_>) = solved.into_iter().unzip();
    let rows = if samples.is_some() { rows } else { Vec::new() };
    let trajectories =
        rows.iter().map(|rows| rows.as_ref().map(|rows| columns(py, rows)).transpose());
    let answers = serde_json::to_string(&answers).map_err(Failure::from)?;
    Ok((answers, trajectories.collect::<PyResult<_>>()?))
}

/// What a request is about.
fn setup(request: &Request) -> Result<Setup, Failure> {
    let Request { config, campaign, robot, gait, model, settings, .. } = request;
    let mut config = crate::config::load(config.as_deref())?;
    let mut name = campaign.clone().unwrap_or_default();
    if robot.is_some() || gait.is_some() {
        let known = config.campaign.get(&name).or(config.campaign.values().next());
        let known =
            known.cloned().ok_or_else(|| Failure::of_argument("no campaign is configured"))?;
        let robot = match (robot, campaign) {
            (Some(robot), _) => named_or_given("robot", robot, &mut config.robot)?,
            (None, Some(_)) => known.robot,
            (None, None) => {
                return Err(Failure::of_argument("found a gait alone, needed a robot, too"));
            }
        };
        let gait = match (gait, campaign) {
            (Some(gait), _) => named_or_given("gait", gait, &mut config.gait)?,
            (None, Some(_)) => known.gait,
            (None, None) => {
                return Err(Failure::of_argument("found a robot alone, needed a gait, too"));
            }
        };
        let campaign = Campaign { robot, gait, free: BTreeMap::new(), ..known };
        name = GIVEN.to_owned();
        config.campaign = BTreeMap::from([(name.clone(), campaign)]);
    } else if campaign.is_none() {
        return Err(Failure::of_argument("found no campaign, needed one, or a robot and a gait"));
    }
    Ok(Setup::new(config, &name, model, settings)?)
}

/// The name of an entry; a table of keys becomes one.
fn named_or_given<T: DeserializeOwned>(
    what: &str,
    given: &Value,
    known: &mut BTreeMap<String, T>,
) -> Result<String, Failure> {
    let wrong = |message: String| Failure::of_argument(&format!("{what}: {message}"));
    if let Value::String(name) = given {
        let names = || known.keys().cloned().collect::<Vec<_>>().join("`, `");
        return match known.contains_key(name) {
            true => Ok(name.clone()),
            false => Err(wrong(format!("found `{name}`, needed one of `{}`", names()))),
        };
    }
    let keys = T::deserialize(given).map_err(|error| wrong(error.to_string()))?;
    known.insert(GIVEN.to_owned(), keys);
    Ok(GIVEN.to_owned())
}

/// Numbers that are missing are NaN.
fn columns<'py>(
    py: Python<'py>,
    rows: &[TrajectoryRow],
) -> PyResult<(Vec<String>, Bound<'py, PyByteArray>)> {
    // All but the model's name, and what is said of fits, are numbers.
    let frame = TrajectoryRow::to_table(rows).frame.drop_many(["model", "extrapolated"]);
    let names = frame.get_column_names_owned().iter().map(ToString::to_string).collect();
    let numbers = frame.columns().iter().map(|column| column.f64());
    let numbers = numbers.collect::<Result<Vec<_>, _>>().map_err(Failure::from)?;
    let bytes: Vec<u8> = numbers
        .into_iter()
        .flat_map(|column| column.iter())
        .flat_map(|number| number.unwrap_or(f64::NAN).to_ne_bytes())
        .collect();
    Ok((names, PyByteArray::new(py, &bytes)))
}
