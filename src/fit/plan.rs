//! Which models have to be fitted again, and why.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::folder::{TABLES, read_data, read_fitted};
use super::{FIT_VERSION, FitData, FitInput, Fitted, Kept, Measurement, measurements};
use crate::config::{Campaign, Config, ParameterSource};
use crate::ingest::Touched;
use crate::store::{
    CONFIGURATION, CycleRow, How, Parts, Provenance, Redo, StageState, Stamp, StoreError, Thing,
    VERSION, changed_outputs, changed_settings, flatten, hash, reasons,
};

/// Part of every fit whose robot has measured parameters.
const ROBOTS: &str = "robot_parameters.parquet";

/// What a fit has to do.
pub struct FitPlan<'s> {
    pub redo: Redo,
    pub(super) known: &'s StageState,
    /// Missing where nothing has to be read.
    pub(super) data: Option<FitData>,
    pub(super) inputs: BTreeMap<String, Stamp>,
    pub(super) parts: BTreeMap<String, Parts>,
    pub(super) order: Vec<String>,
    pub(super) kept: Kept,
    /// The tables, where nothing is to be done.
    fitted: Fitted,
}

/// Compares the tables of the ingest with what the record knows of the last fit.
///
/// # Errors
/// The tables of the ingest cannot be read.
pub fn plan<'s>(
    config: &Config,
    derived: &Path,
    known: &'s StageState,
    how: How,
) -> Result<FitPlan<'s>, StoreError> {
    let things = things(config);
    let order: Vec<String> = things.iter().map(|thing| thing.name.clone()).collect();
    let read = super::folder::input_paths(derived)?;
    let (earlier, whole) = match earlier(derived, known, how) {
        Ok(fitted) => (fitted, Vec::new()),
        Err(why) => (None, why),
    };
    let mut redo = Redo::new("fit");
    // Where the tables are as they were, so is what is made of them.
    let same_input = !how.force && known.has_read(read.iter().map(PathBuf::as_path), how.verify);
    let of_configuration = |thing: &FitThing| {
        known.things.get(&thing.name).is_some_and(|earlier| {
            let parts = thing.own_parts();
            parts.iter().all(|(name, part)| earlier.parts.get(name) == Some(part))
        })
    };
    if let Some(fitted) = &earlier
        && same_input
        && known.order == order
        && things.iter().all(of_configuration)
    {
        redo.up_to_date = order.len();
        let inputs = known.inputs.clone();
        let (parts, kept) = (BTreeMap::new(), Kept::new());
        let fitted = fitted.clone();
        return Ok(FitPlan { redo, known, data: None, inputs, parts, order, kept, fitted });
    }
    let data = read_data(derived)?;
    let inputs = read
        .iter()
        .map(|path| {
            let stamp = known.renew_own(path, how.verify);
            let error = |source| StoreError::Read { path: path.clone(), source };
            Ok((crate::store::absolute(path), stamp.map_err(error)?))
        })
        .collect::<Result<_, StoreError>>()?;
    let settings = flatten(config);
    let mut parts = BTreeMap::new();
    let fitted = earlier.clone().unwrap_or_default();
    let mut earlier = earlier.map(by_model).unwrap_or_default();
    let mut kept = Kept::new();
    for thing in &things {
        let of_thing = thing.parts(config, &data);
        let mut why = whole.clone();
        match known.things.get(&thing.name) {
            _ if how.force => why = vec!["--force".to_owned()],
            None => why = vec!["new".to_owned()],
            Some(earlier) => why.extend(reasons(&earlier.parts, &of_thing, || {
                changed_settings(&known.settings, &settings, &thing.prefixes())
            })),
        }
        let key = (thing.input.campaign.name.clone(), thing.input.model);
        match earlier.remove(&key) {
            Some(rows) if why.is_empty() => {
                kept.insert(key, rows);
            }
            None if why.is_empty() => why.push(format!("{} does not have it", TABLES[0])),
            _ => {}
        }
        redo.add(&thing.name, why);
        parts.insert(thing.name.clone(), of_thing);
    }
    redo.removed = removed(known, &order);
    if redo.things.is_empty() && redo.removed.is_empty() && known.order != order {
        redo.whole.push("the configuration has another order of models".to_owned());
    }
    Ok(FitPlan { redo, known, data: Some(data), inputs, parts, order, kept, fitted })
}

/// What there will be to do once the trials are ingested that are `touched`: more than that only
/// if other tables than the record knows lie about.
pub fn plan_after(config: &Config, known: &StageState, how: How, touched: &Touched) -> Redo {
    let things = things(config);
    let settings = flatten(config);
    let mut redo = Redo::new("fit");
    for thing in &things {
        let mut why = Vec::new();
        match known.things.get(&thing.name) {
            _ if how.force => why.push("--force".to_owned()),
            None => why.push("new".to_owned()),
            Some(earlier) => {
                let own = thing.own_parts();
                let earlier_own: Parts = earlier
                    .parts
                    .iter()
                    .filter(|(name, _)| own.contains_key(*name))
                    .map(|(name, part)| (name.clone(), part.clone()))
                    .collect();
                why.extend(reasons(&earlier_own, &own, || {
                    changed_settings(&known.settings, &settings, &thing.prefixes())
                }));
                let has = |trial: &&String| earlier.parts.contains_key(&part_of_trial(trial));
                let trials = touched.trials.iter().filter(has);
                why.extend(trials.map(|trial| format!("if {} changes", part_of_trial(trial))));
                let measured = config.fit.robot_parameters == ParameterSource::Measured;
                if measured && touched.robots.contains(&thing.of.robot) {
                    why.push(format!("if {ROBOTS} changes"));
                }
                if why.is_empty()
                    && touched.campaigns.iter().any(|name| *name == thing.input.campaign.name)
                {
                    why.push("if its trials change".to_owned());
                }
            }
        }
        redo.add(&thing.name, why);
    }
    let order: Vec<String> = things.into_iter().map(|thing| thing.name).collect();
    redo.removed = removed(known, &order);
    redo
}

fn removed(known: &StageState, order: &[String]) -> Vec<String> {
    known.things.keys().filter(|name| !order.contains(name)).cloned().collect()
}

/// The tables that the last fit left; nothing if there was none.
///
/// # Errors
/// Why they cannot be used.
fn earlier(derived: &Path, known: &StageState, how: How) -> Result<Option<Fitted>, Vec<String>> {
    if known.outputs.is_empty() || how.force {
        return Ok(None);
    }
    let changed = changed_outputs(derived, &known.outputs, how.verify);
    if !changed.is_empty() {
        return Err(changed);
    }
    read_fitted(derived).map(Some).map_err(|error| vec![error.to_string()])
}

/// Rows of tables by campaign and model.
fn by_model(fitted: Fitted) -> Kept {
    let mut kept = Kept::new();
    macro_rules! sort {
        ($($table:ident),+) => {$(
            for row in fitted.$table {
                let rows = kept.entry((row.campaign.clone(), row.model)).or_default();
                rows.$table.push(row);
            }
        )+};
    }
    sort!(fits, starts, profiles, bootstrap, comparison, predictions);
    kept.retain(|_, rows| rows.fits.len() == 1 && rows.comparison.len() == 1);
    kept
}

/// One model of one campaign.
struct FitThing<'c> {
    name: String,
    input: FitInput,
    of: &'c Campaign,
    configuration: String,
}

/// All fits of a configuration, in order.
fn things(config: &Config) -> Vec<FitThing<'_>> {
    let inputs = FitInput::all(config).into_iter();
    inputs
        .map(|input| FitThing {
            name: format!("{} {}", input.campaign.name, input.model.name()),
            of: &config.campaign[&input.campaign.name],
            configuration: hash_of(&input),
            input,
        })
        .collect()
}

impl FitThing<'_> {
    /// The parts that no table has to be read for.
    fn own_parts(&self) -> Parts {
        Parts::from([
            (VERSION.to_owned(), FIT_VERSION.to_string()),
            (CONFIGURATION.to_owned(), self.configuration.clone()),
        ])
    }

    fn parts(&self, config: &Config, data: &FitData) -> Parts {
        let mut parts = self.own_parts();
        for measurement in measurements(&self.input, data) {
            let cycles = data.cycles.get(&measurement.trial).map_or(&[][..], Vec::as_slice);
            let part = part_of_trial(&measurement.trial);
            parts.insert(part, hash_of_trial(&measurement, cycles));
        }
        if config.fit.robot_parameters == ParameterSource::Measured {
            let rows: Vec<[f64; 3]> = data
                .robots
                .iter()
                .filter(|row| row.robot == self.of.robot)
                .map(|row| {
                    [row.stiffness_nm_rad, row.damping_nm_s_rad, row.roll_sum_kg_s]
                        .map(|of| of.value)
                })
                .collect();
            parts.insert(ROBOTS.to_owned(), hash(format!("{rows:?}").as_bytes()));
        }
        parts
    }

    /// Beginnings of the keys that the fit reads.
    fn prefixes(&self) -> Vec<String> {
        let Campaign { robot, gait, .. } = self.of;
        let campaign = ["robot", "gait", "weights", "free"]
            .map(|key| format!("campaign.{}.{key}", self.input.campaign.name));
        let mut prefixes = vec!["fit.".into(), format!("robot.{robot}."), format!("gait.{gait}.")];
        prefixes.extend(campaign);
        prefixes
    }
}

fn part_of_trial(trial: &str) -> String {
    format!("trial {trial}")
}

/// Of what a fit reads of a trial. Numbers are printed such that they can be told apart.
fn hash_of_trial(measurement: &Measurement, cycles: &[CycleRow]) -> String {
    let used: Vec<&CycleRow> = cycles.iter().filter(|row| row.used).collect();
    hash(format!("{measurement:?} {used:?}").as_bytes())
}

fn hash_of(value: &impl Serialize) -> String {
    hash(&serde_json::to_vec(value).expect("a configuration is plain data"))
}

impl FitPlan<'_> {
    /// The tables, where nothing is to be done.
    pub fn into_fitted(self) -> Fitted {
        self.fitted
    }

    /// The record's part, where nothing is to be done: with files' times as they are now.
    pub fn state(&self) -> StageState {
        StageState { inputs: self.inputs.clone(), ..self.known.clone() }
    }

    /// How many models there are to fit.
    pub fn total(&self) -> usize {
        self.redo.things.len()
    }

    pub(super) fn provenance(&self) -> Provenance {
        let all: Vec<(&String, Option<&Parts>)> =
            self.order.iter().map(|name| (name, self.parts.get(name))).collect();
        Provenance { input: hash_of(&all) }
    }

    pub(super) fn things(&self) -> BTreeMap<String, Thing> {
        let parts = self.parts.iter();
        let thing = |parts: &Parts| Thing { parts: parts.clone(), ..Thing::default() };
        parts.map(|(name, parts)| (name.clone(), thing(parts))).collect()
    }
}
