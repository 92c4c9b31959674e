//! Standard deviations of the values of a chain.

use std::collections::BTreeMap;

use serde::Serialize;
use serde::de::{DeserializeOwned, Error as _};
use toml::Spanned;
use toml::de::{DeTable, DeValue, Error};
use trilink_robot::{ChainNumber, LinkNumber};

use super::super::check::{Checker, table_of};
use super::super::three_links::{Deviation, independent_errors};
use super::super::{ConfigError, GaitConfig};
use super::ChainRobot;
use super::check::{link_table, plain_table_of};

/// Link or joint, given by its index from front to rear.
#[derive(Debug, Clone, Copy)]
enum Part {
    Link(usize),
    Joint(usize),
}

impl Part {
    /// Returns whether a value with this key can have a standard deviation.
    fn has_deviation(self, robot: &ChainRobot, key: &str) -> bool {
        let of_link = |number: LinkNumber| {
            // These speeds are keys of the robot.
            !matches!(number, LinkNumber::Stribeck | LinkNumber::Transition) && number.name() == key
        };
        match self {
            Self::Link(_) => key == "load_n" || LinkNumber::ALL.into_iter().any(of_link),
            Self::Joint(joint) => robot.joints[joint].kind.keys().contains(&key),
        }
    }
}

/// Value in the configuration, given by its key.
type Value<'c> = (Part, &'c str);

/// Values that share an error, with their standard deviations in the units of the configuration.
type SharedError<'c> = Vec<(Value<'c>, f64)>;

/// Standard deviations and names of common errors of a link or joint, by keys.
type Uncertain<'c> = (&'c BTreeMap<String, Deviation>, &'c BTreeMap<String, String>);

impl ChainRobot {
    /// Returns the independent errors of the uncertain values: for each error, the numbers of the chain that depend on
    /// these values with their standard deviations in SI units. The error of a load is shared by all dry friction of its
    /// wheel.
    pub fn errors(&self) -> Vec<Vec<(ChainNumber, f64)>> {
        let chain = |robot: &Self| robot.to_chain(&GaitConfig::default());
        let own = chain(self);
        let numbers = own.numbers();
        let of_numbers = |error: SharedError| -> Vec<(ChainNumber, f64)> {
            let mut off = self.clone();
            off.shift(&error, 1.0);
            let off = chain(&off);
            let change = |of: &ChainNumber| Some((*of, off.number(*of)? - own.number(*of)?));
            numbers.iter().filter_map(change).filter(|(_, change)| *change != 0.0).collect()
        };
        let errors = self.value_errors().into_iter().map(of_numbers);
        errors.filter(|numbers| !numbers.is_empty()).collect()
    }

    /// Returns a copy whose values are off by their errors: `draw` returns the next error in standard deviations.
    #[must_use]
    pub fn with_errors(&self, mut draw: impl FnMut() -> f64) -> Self {
        let mut changed = self.clone();
        for error in self.value_errors() {
            changed.shift(&error, draw());
        }
        changed
    }

    /// Adds an error to the values that share it.
    fn shift(&mut self, error: &SharedError, in_deviations: f64) {
        for ((part, key), sd) in error {
            match *part {
                Part::Link(link) => add(&mut self.links[link], key, in_deviations * sd),
                Part::Joint(joint) => add(&mut self.joints[joint], key, in_deviations * sd),
            }
        }
    }

    fn value_errors(&self) -> Vec<SharedError<'_>> {
        independent_errors(self.deviations().map(|((part, key), deviation, name)| {
            let table = match part {
                Part::Link(link) => plain_table_of(&self.links[link]),
                Part::Joint(joint) => plain_table_of(&self.joints[joint]),
            };
            let value = table.get(key).and_then(toml::Value::as_float).unwrap_or_default();
            ((part, key), deviation.of(value), name)
        }))
    }

    /// Returns all standard deviations with the names of their common errors, those of the links first.
    fn deviations<'c>(
        &'c self,
    ) -> impl Iterator<Item = (Value<'c>, Deviation, Option<&'c String>)> {
        let links = self.links.iter().map(|link| (&link.standard_deviation, &link.same));
        let joints = self.joints.iter().map(|joint| (&joint.standard_deviation, &joint.same));
        let links = links.enumerate().map(|(i, uncertain)| (Part::Link(i), uncertain));
        let joints = joints.enumerate().map(|(i, uncertain)| (Part::Joint(i), uncertain));
        links.chain(joints).flat_map(|(part, (deviations, same)): (Part, Uncertain)| {
            let of_key = move |(key, deviation): (&'c String, &'c Deviation)| {
                ((part, key.as_str()), *deviation, same.get(key))
            };
            deviations.iter().map(of_key)
        })
    }

    /// Checks the standard deviations of a link or joint: `part` is its key, and `value` returns the value with a key
    /// if it is configured.
    pub(super) fn check_deviations(
        check: &Checker,
        part: &str,
        (deviations, same): Uncertain,
        is_known: impl Fn(&str) -> bool,
        value: impl Fn(&str) -> Option<f64>,
    ) -> Result<(), ConfigError> {
        for (key, deviation) in deviations {
            // A place or an angle may be smaller than its standard deviation.
            let is_size = !key.ends_with("_m") && !key.ends_with("_deg");
            let full = format!("{part}.standard_deviation.{key}");
            let needed = "the key of a value that can have a standard deviation";
            check.that(is_known(key), &full, &format_args!("`{key}`"), needed)?;
            let needed = format!("{key} as well, the value itself");
            let value = value(key);
            check.that(value.is_some(), &full, &format_args!("a standard deviation"), &needed)?;
            let value = value.unwrap_or_default();
            let sd = deviation.of(value);
            let most = if is_size { value } else { 1e6 };
            let needed = format!("a number from 0 to {most}, or a percentage");
            check.that((0.0..=most).contains(&sd), &full, &sd, &needed)?;
        }
        for key in same.keys() {
            let full = format!("{part}.same.{key}");
            let needed = "a standard deviation of this value as well";
            check.that(deviations.contains_key(key), &full, &format_args!("a name"), needed)?;
        }
        Ok(())
    }

    /// Checks the standard deviations of the links and joints of a robot, and that each common error has several values.
    pub(super) fn check_all_deviations(
        &self,
        check: &Checker,
        robot: &str,
    ) -> Result<(), ConfigError> {
        for (i, (name, link)) in self.names().iter().zip(&self.links).enumerate() {
            let uncertain = (&link.standard_deviation, &link.same);
            let is_known = |key: &str| Part::Link(i).has_deviation(self, key);
            let table = plain_table_of(link);
            let value = |key: &str| table.get(key)?.as_float();
            let part = link_table(robot, name);
            Self::check_deviations(check, &part, uncertain, is_known, value)?;
        }
        for (i, joint) in self.joints.iter().enumerate() {
            let uncertain = (&joint.standard_deviation, &joint.same);
            let is_known = |key: &str| Part::Joint(i).has_deviation(self, key);
            let table = plain_table_of(joint);
            let value = |key: &str| table.get(key)?.as_float();
            let part = format!("robot.{robot}.joint{}", i + 1);
            Self::check_deviations(check, &part, uncertain, is_known, value)?;
        }
        let names = self.deviations().filter_map(|(.., name)| name);
        let mut counts: BTreeMap<&String, usize> = BTreeMap::new();
        names.for_each(|name| *counts.entry(name).or_default() += 1);
        for (name, count) in counts {
            let needed = "a name that at least two values share";
            let found = format!("same = \"{name}\" for one value alone");
            check.that(count > 1, &format!("robot.{robot}"), &format_args!("{found}"), needed)?;
        }
        Ok(())
    }
}

/// Adds a number to the value of a link or joint with a key.
fn add<P: Serialize + DeserializeOwned>(part: &mut P, key: &str, change: f64) {
    let mut table = table_of(part);
    if let Some(toml::Value::Float(value)) = table.get_mut(key) {
        *value += change;
    }
    *part = table.try_into().expect("a part of a chain with another number");
}

/// Moves the standard deviations and the names of common errors of the links and joints of a robot from beside their
/// values, `{ value = .., sd = .., same = .. }`, to the tables `standard_deviation` and `same`.
///
/// # Errors
/// Returns an error if a value has one in both places.
pub(in super::super) fn spread(robot: &mut DeTable) -> Result<(), Error> {
    for parts in ["links", "joints"] {
        let Some(DeValue::Array(parts)) = robot.get_mut(parts).map(Spanned::get_mut) else {
            continue;
        };
        for part in parts.iter_mut() {
            if let DeValue::Table(part) = part.get_mut() {
                spread_part(part)?;
            }
        }
    }
    Ok(())
}

fn spread_part(part: &mut DeTable) -> Result<(), Error> {
    const TABLES: [(&str, &str); 2] = [("sd", "standard_deviation"), ("same", "same")];
    let keys: Vec<_> = part.keys().cloned().collect();
    for key in keys {
        if TABLES.iter().any(|(_, table)| key.get_ref() == table) {
            continue;
        }
        let Some(DeValue::Table(beside)) = part.get_mut(&key).map(Spanned::get_mut) else {
            continue;
        };
        let is_known = |own: &str| ["value", "sd", "same"].contains(&own);
        // Other tables are left for the error about the type of the value.
        if !["value", "sd"].iter().all(|own| beside.contains_key(*own))
            || !beside.keys().all(|own| is_known(own.get_ref()))
        {
            continue;
        }
        let Some(value) = beside.remove("value") else { continue };
        let moved = TABLES.map(|(own, table)| (table, beside.remove(own)));
        part.insert(key.clone(), value);
        for (table, moved) in moved {
            let Some(moved) = moved else { continue };
            let name = Spanned::new(key.span(), table.into());
            let all = part
                .entry(name)
                .or_insert_with(|| Spanned::new(key.span(), DeValue::Table(DeTable::new())));
            if let DeValue::Table(all) = all.get_mut()
                && all.insert(key.clone(), moved).is_some()
            {
                let key = key.get_ref();
                return Err(Error::custom(format!(
                    "key `{key}`: found an entry both in `{key}` and in the table `{table}`, but only one of them is \
                     allowed"
                )));
            }
        }
    }
    Ok(())
}
