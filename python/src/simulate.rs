//! Simulation of a model, with the robot and the gait given by name or as a table of values.

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

/// Name under which a robot, gait or campaign that is given as a table is added to the configuration.
const GIVEN: &str = "given";

/// Arguments of [`simulate`], passed from Python as JSON.
#[derive(Deserialize)]
struct Request {
    config: Option<PathBuf>,
    campaign: Option<String>,
    /// Name of a configured robot, or the contents of a table `[robot.*]`; `None` for the campaign's robot.
    robot: Option<Value>,
    /// Name of a configured gait, or the contents of a table `[gait.*]`; `None` for the campaign's gait.
    gait: Option<Value>,
    model: String,
    omegas_rad_s: Vec<f64>,
    /// Values that replace configured parameters, each as `key=value`.
    settings: Vec<String>,
    from_rest: bool,
    samples: Option<usize>,
}

/// Trajectory of a motion: column names and values (64-bit floats in native byte order, one column after another);
/// `None` if the motion does not exist.
type Trajectory<'py> = Option<(Vec<String>, Bound<'py, PyByteArray>)>;

/// Solves for the motion at every requested frequency. Returns the results as JSON and, if `samples` is given, one
/// trajectory per frequency; otherwise, the list of trajectories is empty.
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
        // Starting another thread would add significantly to the time for a single solution.
        [omega_rad_s] => vec![py.detach(|| solve(omega_rad_s))],
        all => {
            let cancel = CancelToken::default();
            let solved = interruptible(
                py,
                &cancel,
                || {
                    all.par_iter()
                        .with_max_len(1)
                        .map(|omega_rad_s| {
                            cancel.check()?;
                            Ok(solve(omega_rad_s))
                        })
                        .collect::<Result<_, Cancelled>>()
                },
                |_| false,
            )?;
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

/// Returns the setup (robot, gait and model) of a requested simulation.
fn setup(request: &Request) -> Result<Setup, Failure> {
    let Request { config, campaign, robot, gait, model, settings, .. } = request;
    let mut config = crate::config::load(config.as_deref())?;
    let mut name = campaign.clone().unwrap_or_default();
    if robot.is_some() || gait.is_some() {
        let known = config.campaign.get(&name).or(config.campaign.values().next());
        let known =
            known.cloned().ok_or_else(|| Failure::from_argument("no campaign is configured"))?;
        let robot = match (robot, campaign) {
            (Some(robot), _) => named_or_given("robot", robot, &mut config.robot)?,
            (None, Some(_)) => known.robot,
            (None, None) => {
                return Err(Failure::from_argument(
                    "found a gait without a robot; pass a robot as well, or a campaign",
                ));
            }
        };
        let gait = match (gait, campaign) {
            (Some(gait), _) => named_or_given("gait", gait, &mut config.gait)?,
            (None, Some(_)) => known.gait,
            (None, None) => {
                return Err(Failure::from_argument(
                    "found a robot without a gait; pass a gait as well, or a campaign",
                ));
            }
        };
        let campaign = Campaign { robot, gait, free: BTreeMap::new(), ..known };
        name = GIVEN.to_owned();
        config.campaign = BTreeMap::from([(name.clone(), campaign)]);
    } else if campaign.is_none() {
        return Err(Failure::from_argument(
            "found no campaign; pass a campaign, or a robot and a gait",
        ));
    }
    Ok(Setup::new(config, &name, model, settings)?)
}

/// Returns the name of an entry of `known`, the configured robots or gaits. If `given` is a table of values instead of
/// a name, it is first added to `known` under the name [`GIVEN`]. Errors call the entry `what`, such as "robot".
fn named_or_given<T: DeserializeOwned>(
    what: &str,
    given: &Value,
    known: &mut BTreeMap<String, T>,
) -> Result<String, Failure> {
    let wrong = |message: String| Failure::from_argument(&format!("{what}: {message}"));
    if let Value::String(name) = given {
        let names = || known.keys().cloned().collect::<Vec<_>>().join("`, `");
        return if known.contains_key(name) {
            Ok(name.clone())
        } else {
            Err(wrong(format!("found `{name}`, needed one of `{}`", names())))
        };
    }
    let keys = T::deserialize(given).map_err(|error| wrong(error.to_string()))?;
    known.insert(GIVEN.to_owned(), keys);
    Ok(GIVEN.to_owned())
}

/// Returns the names of the numeric columns, and their values as 64-bit floats, one column after another; missing
/// values are NaN.
fn columns<'py>(
    py: Python<'py>,
    rows: &[TrajectoryRow],
) -> PyResult<(Vec<String>, Bound<'py, PyByteArray>)> {
    // All columns are numeric except those with the model's name and the remark on extrapolation.
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
