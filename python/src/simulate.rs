//! Simulation of a model, with the robot and the gait given by name or as a table of values.

use std::collections::BTreeMap;
use std::path::PathBuf;

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use rayon::prelude::*;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_fit::simulate::{Answer, FitSummary, KnownFits, Setup, campaign_of, trajectories};
use trilink_tables::config::Campaign;

use crate::error::Failure;
use crate::interrupt::interruptible;
use crate::table::accessor;

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
    /// Name of the model; `None` for the preferred model of the comparison, with `fitted`.
    model: Option<String>,
    fitted: bool,
    bands: bool,
    omegas_rad_s: Vec<f64>,
    /// Values that replace configured parameters, each as `key=value`.
    settings: Vec<String>,
    from_rest: bool,
    samples: Option<usize>,
}

/// Solves for the motion at every requested frequency. Returns the results as JSON, a table for the trajectory of each
/// motion (`None` if it does not exist; an empty list if `samples` is not given), and warnings about the fit.
pub fn simulate<'py>(py: Python<'py>, request: &str) -> PyResult<Bound<'py, PyTuple>> {
    let request: Request = serde_json::from_str(request).map_err(Failure::from)?;
    let Request { omegas_rad_s, from_rest, samples, .. } = &request;
    let (setup, fits) = setup(&request)?;
    let solve = |&omega_rad_s: &f64| {
        let answer = setup.answer(omega_rad_s, *from_rest);
        let cycle = samples.map(|samples| setup.trajectory(&answer, *from_rest, samples).ok());
        (answer, cycle.flatten())
    };
    let solved: Vec<(Answer, Option<Vec<_>>)> = match &omegas_rad_s[..] {
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
    let (mut answers, cycles): (Vec<Answer>, Vec<_>) = solved.into_iter().unzip();
    if let Some(fits) = fits.as_ref().filter(|_| request.bands) {
        py.detach(|| {
            setup.add_bands(&mut answers, *from_rest, fits);
        });
    }
    let caution = setup.fit().map(FitSummary::caution).unwrap_or_default();
    let tables = answers.iter().zip(cycles).map(|(answer, cycle)| {
        let table = cycle.map(|cycle| trajectories(&setup.robot, &[(answer, cycle)]).frame);
        table.map(|frame| accessor(py, frame)).transpose()
    });
    let tables = tables.take(if samples.is_some() { usize::MAX } else { 0 });
    let tables = tables.collect::<PyResult<Vec<_>>>()?;
    let answers = serde_json::to_string(&answers).map_err(Failure::from)?;
    (answers, tables, caution).into_pyobject(py)
}

/// Returns the setup (robot, gait and model) of a requested simulation, and the fits if it has fitted coefficients.
fn setup(request: &Request) -> Result<(Setup, Option<KnownFits>), Failure> {
    let Request { config, campaign, robot, gait, model, settings, .. } = request;
    for omega_rad_s in &request.omegas_rad_s {
        if !(*omega_rad_s > 0.0 && omega_rad_s.is_finite()) {
            let needed = "needed a frequency above 0";
            return Err(argument(&format!("omega_rad_s: found {omega_rad_s}, {needed}")));
        }
    }
    if request.bands && !request.fitted {
        return Err(argument("bands: found no fit, needed fitted=True"));
    }
    let mut config = crate::config::load(config.as_deref())?;
    let mut name = campaign.clone().unwrap_or_default();
    if robot.is_some() || gait.is_some() {
        let known = config.campaign.get(&name).or(config.campaign.values().next());
        let known = known.cloned().ok_or_else(|| argument("no campaign is configured"))?;
        let robot = match (robot, campaign) {
            (Some(robot), _) => named_or_given("robot", robot, &mut config.robot)?,
            (None, Some(_)) => known.robot,
            (None, None) => {
                return Err(argument(
                    "found a gait without a robot; pass a robot as well, or a campaign",
                ));
            }
        };
        let gait = match (gait, campaign) {
            (Some(gait), _) => named_or_given("gait", gait, &mut config.gait)?,
            (None, Some(_)) => known.gait,
            (None, None) => {
                return Err(argument(
                    "found a robot without a gait; pass a gait as well, or a campaign",
                ));
            }
        };
        let campaign = Campaign { robot, gait, free: BTreeMap::new(), ..known };
        name = GIVEN.to_owned();
        config.campaign = BTreeMap::from([(name.clone(), campaign)]);
    } else if campaign.is_none() {
        return Err(argument("found no campaign; pass a campaign, or a robot and a gait"));
    }
    if !request.fitted {
        let none = "model: found none, needed the name of a model or fitted=True";
        let model = model.as_deref().ok_or_else(|| argument(none))?;
        return Ok((Setup::new(config, &name, model, settings, None)?, None));
    }
    if name == GIVEN {
        return Err(argument("fitted: found another robot or gait, needed the campaign's own"));
    }
    let fits = KnownFits::read(&config, request.bands)?;
    let model = match model {
        Some(model) => model.clone(),
        None => {
            campaign_of(&config, &name)?;
            fits.preferred(&name)?.to_string()
        }
    };
    Ok((Setup::new(config, &name, &model, settings, Some(&fits))?, Some(fits)))
}

/// Returns the error for an invalid argument.
fn argument(message: &str) -> Failure {
    Failure::from_argument(message.to_owned())
}

/// Returns the name of an entry of `known`, the configured robots or gaits. If `given` is a table of values instead of
/// a name, it is first added to `known` under the name [`GIVEN`]. Errors call the entry `what`, such as "robot".
fn named_or_given<T: DeserializeOwned>(
    what: &str,
    given: &Value,
    known: &mut BTreeMap<String, T>,
) -> Result<String, Failure> {
    let wrong = |message: String| argument(&format!("{what}: {message}"));
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
