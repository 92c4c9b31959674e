//! The short form of `[robot.NAME]`: the parameters of a robot of three links, each with or without a standard deviation.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::LazyLock;

use serde::de::value::SeqAccessDeserializer;
use serde::de::{DeserializeSeed, Error, MapAccess, SeqAccess, Unexpected, Visitor};
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use trilink_base::Named;
use trilink_robot::{Gait, Laws, Parameter, Per, Quantity, Robot, Unit};

use super::strict::Strict;

/// Key for the wheel loads, N; if they are given, dry friction is given as coefficients of friction.
const LOAD: &str = "load_n";
/// Key for the table of standard deviations, which can be used instead of an `sd` beside each value.
const DEVIATIONS: &str = "standard_deviation";
/// Key for the table of names of common errors, which can be used instead of a `same` beside each value.
const SAME: &str = "same";

/// Robot of three links as configured, with the standard deviations of its values (see Tables I and II of the paper).
/// Values are in the units stated by their keys; dry friction is in N, or a coefficient of friction if wheel loads
/// are given.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ThreeLinkRobot {
    values: Numbers,
    /// Standard deviations of the values; a value without one, or with 0, is exact.
    deviations: Numbers,
    /// Names of the common errors, such as that of a ruler, with which values were measured. The errors of all values
    /// with the same name are fully correlated.
    same: BTreeMap<Quantity, String>,
    load_n: Option<[f64; Robot::LINKS]>,
}

type Numbers = BTreeMap<Quantity, Vec<f64>>;

impl ThreeLinkRobot {
    /// Returns the configured values of a quantity; `None` if the quantity is not configured.
    pub fn get(&self, quantity: Quantity) -> Option<&[f64]> {
        self.values.get(&quantity).map(Vec::as_slice)
    }

    /// Sets the values of a quantity: one value, or one for each link, wheel or joint.
    pub fn set(&mut self, quantity: Quantity, numbers: impl Into<Vec<f64>>) {
        self.values.insert(quantity, numbers.into());
    }

    /// Removes the configured values of a quantity.
    pub fn clear(&mut self, quantity: Quantity) {
        self.values.remove(&quantity);
    }

    /// Sets the standard deviations of a quantity's values, in the unit in which the values are configured; 0
    /// for an exact value.
    pub fn set_deviation(&mut self, quantity: Quantity, numbers: impl Into<Vec<f64>>) {
        self.deviations.insert(quantity, numbers.into());
    }

    /// Converts the standard deviations of a quantity's values to the unit of the values. A single percentage applies
    /// to each of the values.
    fn in_units(&self, quantity: Quantity, deviations: &[Deviation]) -> Vec<f64> {
        let default = [quantity.definition().default.unwrap_or(f64::NAN)];
        let values = self.get(quantity).unwrap_or(&default);
        let count = match (deviations, quantity.definition().per) {
            ([Deviation::Relative(_)], Per::Joint) => values.len(),
            ([Deviation::Relative(_)], _) => quantity.count(),
            _ => deviations.len(),
        };
        let all = (0..count).map(|i| {
            let deviation = deviations[i.min(deviations.len() - 1)];
            deviation.of(number_at(values, i))
        });
        all.collect()
    }

    /// Sets the name of the common error of a quantity's values.
    pub fn set_same(&mut self, quantity: Quantity, name: &str) {
        self.same.insert(quantity, name.to_owned());
    }

    /// Removes all standard deviations, so that all values are exact.
    pub fn clear_deviations(&mut self) {
        self.deviations.clear();
        self.same.clear();
    }

    /// Sets the wheel loads, N. Dry friction is then configured as coefficients of friction relative to these
    /// loads.
    pub fn set_load_n(&mut self, load_n: [f64; Robot::LINKS]) {
        self.load_n = Some(load_n);
    }

    /// Returns the factor that converts a configured value to SI units. If wheel loads are configured, the factor for
    /// the friction force of a wheel is the load on `wheel`; in all other cases, it does not depend on `wheel`.
    fn in_si(&self, quantity: Quantity, wheel: usize) -> f64 {
        let definition = quantity.definition();
        match (definition.unit, definition.per, self.load_n) {
            (Unit::Newton, Per::Wheel, Some(load_n)) => load_n[wheel],
            _ => definition.unit.in_si(),
        }
    }

    /// Returns all configured standard deviations in SI units; 0 for an exact value.
    fn all_deviations(&self) -> impl Iterator<Item = (Parameter, f64)> {
        self.deviations.iter().flat_map(move |(&quantity, numbers)| {
            let is_of_both = quantity.definition().per == Per::Joint && numbers.len() == 1;
            numbers.iter().enumerate().map(move |(i, number)| {
                let parameter = if is_of_both { quantity.of_both() } else { quantity.parameter(i) };
                (parameter, number * self.in_si(quantity, i))
            })
        })
    }

    /// Returns the keys of the quantities whose standard deviations exceed their values, with the ratio of
    /// the standard deviation to the value.
    pub(super) fn large_deviations(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let robot = self.to_robot();
        self.all_deviations()
            .map(move |(parameter, sd)| {
                (parameter.quantity().name(), sd / parameter.value_in(&robot))
            })
            .filter(|(_, ratio)| *ratio > 1.0 && ratio.is_finite())
    }

    /// Returns the independent errors of those uncertain parameters on which the motion under the given friction laws
    /// and gait depends: for each error, the parameters that share it with their standard deviations in SI units.
    pub fn errors(&self, laws: Laws, gait: &Gait) -> Vec<Vec<(Parameter, f64)>> {
        self.errors_of(|parameter| laws.is_relevant(parameter, gait))
    }

    /// Returns a copy whose values are off by their errors: `draw` returns the next error in standard deviations.
    pub fn with_errors(&self, mut draw: impl FnMut() -> f64) -> Self {
        let mut robot = self.to_robot();
        for error in self.errors_of(|_| true) {
            let in_deviations = draw();
            for (parameter, sd) in error {
                let value = parameter.value_in(&robot) + in_deviations * sd;
                parameter.set(&mut robot, value);
            }
        }
        let mut changed = self.clone();
        Quantity::ALL.into_iter().for_each(|quantity| changed.copy_quantity(quantity, &robot));
        changed
    }

    /// Returns the independent errors of the uncertain parameters for which `is_wanted`, as [`Self::errors`] does.
    fn errors_of(&self, is_wanted: impl Fn(Parameter) -> bool) -> Vec<Vec<(Parameter, f64)>> {
        let wanted = self.all_deviations().filter(|(of, _)| is_wanted(*of));
        independent_errors(wanted.map(|(of, sd)| (of, sd, self.same.get(&of.quantity()))))
    }

    /// Checks that every value with a common error has a standard deviation, and that at least two values share each of
    /// these errors.
    fn check_same<E: Error>(&self) -> Result<(), E> {
        for (quantity, name) in &self.same {
            let key = quantity.name();
            if !self.deviations.contains_key(quantity) {
                return Err(E::custom(format!(
                    "key `{key}`: found `same = \"{name}\"` without a standard deviation: add `sd`, or remove `same`"
                )));
            }
            let sharing = self.same.iter().filter(|(_, other)| *other == name);
            let values = sharing.filter_map(|(of, _)| self.deviations.get(of)).map(Vec::len);
            if values.sum::<usize>() < 2 {
                return Err(E::custom(format!(
                    "key `{key}`: found `same = \"{name}\"` for one value alone, needed a name that at least two \
                     values share"
                )));
            }
        }
        Ok(())
    }

    /// Returns whether no value has a standard deviation, so that all values are taken as exact.
    pub fn is_exact(&self) -> bool {
        self.all_deviations().all(|(_, sd)| sd == 0.0)
    }

    /// Returns the quantities that can have a standard deviation but are exact: they have none, or it is
    /// zero.
    pub fn exact(&self) -> impl Iterator<Item = Quantity> {
        Quantity::ALL.into_iter().filter(|quantity| {
            let deviations = self.deviations.get(quantity);
            quantity.definition().has_deviation
                && deviations.is_none_or(|sd| sd.iter().all(|number| *number == 0.0))
        })
    }

    /// Converts the configured robot to SI units. Values that are not configured get their defaults, such as
    /// no spring and no dry friction.
    pub fn to_robot(&self) -> Robot {
        let mut robot = Robot::kinematic();
        for quantity in Quantity::ALL {
            let default = quantity.definition().default.unwrap_or(f64::NAN);
            let given = self.get(quantity);
            for (i, number) in quantity.numbers_mut(&mut robot).iter_mut().enumerate() {
                let given = given.map_or(default, |given| number_at(given, i));
                *number = given * self.in_si(quantity, i);
            }
        }
        robot
    }

    /// Copies the coefficients of `robot` into the configuration. Coefficients that already have these values
    /// in SI units, configured or by default, are left unchanged.
    pub fn set_coefficients(&mut self, robot: &Robot) {
        let coefficients = Quantity::ALL.into_iter().filter(|one| one.definition().is_fitted);
        coefficients.for_each(|quantity| self.copy_quantity(quantity, robot));
    }

    /// Copies the values of a quantity from `robot` into the configuration. Values that already are the same
    /// in SI units, configured or by default, are left unchanged.
    fn copy_quantity(&mut self, quantity: Quantity, robot: &Robot) {
        let own_robot = self.to_robot();
        let own = quantity.numbers(&own_robot);
        let other = quantity.numbers(robot);
        if own == other {
            return;
        }
        let mut numbers = Vec::new();
        for i in 0..quantity.count() {
            numbers.push(match self.get(quantity) {
                Some(given) if own[i] == other[i] => number_at(given, i),
                _ => other[i] / self.in_si(quantity, i),
            });
        }
        if quantity.definition().per == Per::Joint {
            numbers.dedup();
        }
        self.set(quantity, numbers);
    }

    /// Returns a copy with one value changed. `value` is in the unit stated by `name`: dry friction is in N,
    /// even if it is configured as a coefficient of friction. Returns `None` if no value of the robot has
    /// this name.
    pub fn with(&self, name: &str, value: f64) -> Option<Self> {
        let mut changed = self.clone();
        if let Some(wheel) = (0..Robot::LINKS).find(|i| name == load_name(*i)) {
            changed.load_n.as_mut()?[wheel] = value;
            return Some(changed);
        }
        let mut all = Quantity::ALL.into_iter().flat_map(Quantity::parameters);
        let parameter = all.find(|one| [one.key(), one.name()].contains(&name))?;
        let quantity = parameter.quantity();
        if quantity.count() == 1 {
            changed.set(quantity, [value]);
        } else {
            let mut robot = self.to_robot();
            parameter.set(&mut robot, value);
            changed.copy_quantity(quantity, &robot);
        }
        Some(changed)
    }

    /// Returns the names of the configured values, which [`ThreeLinkRobot::with`] accepts.
    pub fn names(&self) -> Vec<String> {
        let given = self.values.keys().flat_map(|quantity| quantity.parameters());
        let loads = (0..Robot::LINKS).filter(|_| self.load_n.is_some()).map(load_name);
        given.map(|parameter| parameter.name().to_owned()).chain(loads).collect()
    }
}

/// Returns the independent errors of uncertain numbers, given with their standard deviations and the names of their common
/// errors: for each error, the numbers that share it with their standard deviations.
pub(super) fn independent_errors<'n, T>(
    uncertain: impl Iterator<Item = (T, f64, Option<&'n String>)>,
) -> Vec<Vec<(T, f64)>> {
    let mut names: Vec<Option<&String>> = Vec::new();
    let mut errors: Vec<Vec<(T, f64)>> = Vec::new();
    for (of, sd, name) in uncertain.filter(|(_, sd, _)| *sd > 0.0) {
        match names.iter().position(|other| name.is_some() && *other == name) {
            Some(known) => errors[known].push((of, sd)),
            None => {
                names.push(name);
                errors.push(vec![(of, sd)]);
            }
        }
    }
    errors
}

/// Returns the value for the link, wheel or joint `index`; a single value in `given` applies to both joints.
fn number_at(given: &[f64], index: usize) -> f64 {
    given[index.min(given.len() - 1)]
}

fn load_name(wheel: usize) -> String {
    format!("load{wheel}_n")
}

/// Values of a quantity, which are serialized as a number or a list.
struct Given<'n>(Quantity, &'n [f64]);

impl Serialize for Given<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match (self.0.definition().per, self.1) {
            (Per::Robot | Per::FreeJoint | Per::Joint, [number]) => number.serialize(serializer),
            (_, numbers) => numbers.serialize(serializer),
        }
    }
}

struct AllGiven<'n>(&'n Numbers);

impl Serialize for AllGiven<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let entries = self.0.iter();
        serializer.collect_map(entries.map(|(one, numbers)| (one.name(), Given(*one, numbers))))
    }
}

impl Serialize for ThreeLinkRobot {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for (quantity, numbers) in &self.values {
            map.serialize_entry(quantity.name(), &Given(*quantity, numbers))?;
        }
        if let Some(load_n) = &self.load_n {
            map.serialize_entry(LOAD, load_n)?;
        }
        if !self.deviations.is_empty() {
            map.serialize_entry(DEVIATIONS, &AllGiven(&self.deviations))?;
        }
        if !self.same.is_empty() {
            let names = self.same.iter().map(|(quantity, name)| (quantity.name(), name));
            map.serialize_entry(SAME, &names.collect::<BTreeMap<_, _>>())?;
        }
        map.end()
    }
}

/// Deserializer seed for the values of a quantity: a number, or a list with the length that the quantity
/// requires.
#[derive(Clone, Copy)]
struct NumbersOf(Quantity);

impl<'de> DeserializeSeed<'de> for NumbersOf {
    type Value = Vec<f64>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Vec<f64>, D::Error> {
        match self.0.definition().per {
            Per::Robot | Per::FreeJoint => {
                f64::deserialize(deserializer).map(|number| vec![number])
            }
            Per::Link | Per::Wheel => {
                <[f64; Robot::LINKS]>::deserialize(deserializer).map(Vec::from)
            }
            Per::Joint => deserializer.deserialize_any(OneOrEach),
        }
    }
}

/// Visitor that accepts one number for both joints, or a list with one number for each joint.
struct OneOrEach;

impl<'de> Visitor<'de> for OneOrEach {
    type Value = Vec<f64>;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a number, or a list of two numbers, front and rear")
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<Self::Value, E> {
        Ok(vec![number])
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<Self::Value, E> {
        Ok(vec![number as f64])
    }

    fn visit_u64<E: Error>(self, number: u64) -> Result<Self::Value, E> {
        Ok(vec![number as f64])
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
        let mut numbers = Vec::new();
        while let Some(number) = list.next_element()? {
            numbers.push(number);
        }
        match numbers.len() {
            Robot::JOINTS => Ok(numbers),
            length => Err(A::Error::custom(format!(
                "found a list of length {length}, needed a number or a list of length {}",
                Robot::JOINTS
            ))),
        }
    }
}

/// Standard deviation as configured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Deviation {
    /// Standard deviation in the unit of the value.
    Absolute(f64),
    /// Standard deviation as a fraction of the value, configured as a percentage.
    Relative(f64),
}

impl Deviation {
    /// Parses a percentage such as `1 %`.
    fn parse<E: Error>(text: &str) -> Result<Self, E> {
        let percent = text.trim().strip_suffix('%').and_then(|number| number.trim().parse().ok());
        match percent {
            Some(percent) if (0.0..=100.0).contains(&percent) => {
                Ok(Self::Relative(percent / 100.0))
            }
            _ => {
                let expected = "a number in the unit of the value, or a percentage of the value from \"0 %\" to \
                                \"100 %\"";
                Err(E::invalid_value(Unexpected::Str(text), &expected))
            }
        }
    }

    /// Returns the standard deviation of a value, in the unit of the value.
    pub(super) fn of(self, value: f64) -> f64 {
        match self {
            Self::Absolute(sd) => sd,
            Self::Relative(fraction) => fraction * value.abs(),
        }
    }

    fn is_zero(self) -> bool {
        matches!(self, Self::Absolute(0.0) | Self::Relative(0.0))
    }
}

impl Serialize for Deviation {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Absolute(sd) => sd.serialize(serializer),
            Self::Relative(fraction) => format!("{} %", 100.0 * fraction).serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Deviation {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(DeviationVisitor)
    }
}

struct DeviationVisitor;

impl<'de> Visitor<'de> for DeviationVisitor {
    type Value = Deviation;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a number, or a percentage such as \"1 %\"")
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<Deviation, E> {
        Ok(Deviation::Absolute(number))
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<Deviation, E> {
        Ok(Deviation::Absolute(number as f64))
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Deviation, E> {
        Deviation::parse(text)
    }

    // The error states the length of the list.
    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Deviation, A::Error> {
        f64::deserialize(Strict(SeqAccessDeserializer::new(list))).map(Deviation::Absolute)
    }
}

/// Deserializer seed for the standard deviations of a quantity: a percentage of all its values, or one number or
/// percentage for each value. For quantities of the joints, one number stands for a common error of both.
#[derive(Clone, Copy)]
struct DeviationsOf(Quantity);

impl<'de> DeserializeSeed<'de> for DeviationsOf {
    type Value = Vec<Deviation>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for DeviationsOf {
    type Value = Vec<Deviation>;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let number = match self.0.definition().per {
            Per::Robot | Per::FreeJoint => "a number".to_owned(),
            Per::Joint => "a number, or a list of two numbers, front and rear".to_owned(),
            Per::Link | Per::Wheel => format!("a list of length {}", Robot::LINKS),
        };
        write!(f, "{number}, or a percentage such as \"1 %\"")
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<Self::Value, E> {
        match self.0.definition().per {
            Per::Robot | Per::FreeJoint | Per::Joint => Ok(vec![Deviation::Absolute(number)]),
            Per::Link | Per::Wheel => Err(E::invalid_type(Unexpected::Float(number), &self)),
        }
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<Self::Value, E> {
        self.visit_f64(number as f64)
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
        Deviation::parse(text).map(|deviation| vec![deviation])
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Self::Value, A::Error> {
        let list = Strict(SeqAccessDeserializer::new(list));
        match self.0.definition().per {
            Per::Robot | Per::FreeJoint => {
                f64::deserialize(list).map(|number| vec![Deviation::Absolute(number)])
            }
            Per::Link | Per::Wheel => <[Deviation; Robot::LINKS]>::deserialize(list).map(Vec::from),
            Per::Joint => <[Deviation; Robot::JOINTS]>::deserialize(list).map(Vec::from),
        }
    }
}

/// Values of a quantity, with their standard deviations and the name of their common error if these are given beside
/// the values.
struct ValuesWithDeviation {
    values: Vec<f64>,
    sd: Option<Vec<Deviation>>,
    same: Option<String>,
}

impl From<Vec<f64>> for ValuesWithDeviation {
    fn from(values: Vec<f64>) -> Self {
        Self { values, sd: None, same: None }
    }
}

/// Deserializer seed for the values of a quantity with or without standard deviations: `h_m = 0.144` or
/// `h_m = { value = 0.144, sd = 0.0005, same = "ruler" }`, with a list in place of each number if the quantity has
/// several values.
struct WithDeviation(NumbersOf);

impl<'de> DeserializeSeed<'de> for WithDeviation {
    type Value = ValuesWithDeviation;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        if self.0.0.definition().has_deviation {
            deserializer.deserialize_any(self)
        } else {
            self.0.deserialize(deserializer).map(Into::into)
        }
    }
}

impl<'de> Visitor<'de> for WithDeviation {
    type Value = ValuesWithDeviation;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a value, or { value = .., sd = .. }")
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<Self::Value, E> {
        let number = serde::de::value::F64Deserializer::new(number);
        self.0.deserialize(number).map(Into::into)
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<Self::Value, E> {
        self.visit_f64(number as f64)
    }

    // For values of other types, serde's own error message is used.
    fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
        let text = serde::de::value::StrDeserializer::new(text);
        self.0.deserialize(text).map(Into::into)
    }

    fn visit_bool<E: Error>(self, boolean: bool) -> Result<Self::Value, E> {
        let boolean = serde::de::value::BoolDeserializer::new(boolean);
        self.0.deserialize(boolean).map(Into::into)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Self::Value, A::Error> {
        let list = Strict(SeqAccessDeserializer::new(list));
        self.0.deserialize(list).map(Into::into)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut table: A) -> Result<Self::Value, A::Error> {
        let mut value = None;
        let mut sd = None;
        let mut same = None;
        while let Some(key) = table.next_key()? {
            match key {
                ValueKey::Value => value = Some(table.next_value_seed(self.0)?),
                ValueKey::Sd => sd = Some(table.next_value_seed(DeviationsOf(self.0.0))?),
                ValueKey::Same => same = Some(table.next_value()?),
            }
        }
        let values = value.ok_or_else(|| A::Error::missing_field("value"))?;
        let sd = Some(sd.ok_or_else(|| A::Error::missing_field("sd"))?);
        Ok(ValuesWithDeviation { values, sd, same })
    }
}

#[derive(Deserialize)]
#[serde(field_identifier, rename_all = "lowercase")]
enum ValueKey {
    Value,
    Sd,
    Same,
}

/// Deserialized table of standard deviations.
#[derive(Default)]
struct Deviations(BTreeMap<Quantity, Vec<Deviation>>);

impl<'de> Deserialize<'de> for Deviations {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_struct("Deviations", &DEVIATION_KEYS, Self::default())
    }
}

impl<'de> Visitor<'de> for Deviations {
    type Value = Self;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("standard deviations of a robot's numbers")
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut table: A) -> Result<Self, A::Error> {
        while let Some(DeviationKey(quantity)) = table.next_key()? {
            self.0.insert(quantity, table.next_value_seed(DeviationsOf(quantity))?);
        }
        Ok(self)
    }
}

/// Key in the tables of standard deviations and of common errors.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct DeviationKey(Quantity);

static DEVIATION_KEYS: LazyLock<Vec<&str>> = LazyLock::new(|| {
    let quantities = Quantity::ALL.into_iter().filter(|one| one.definition().has_deviation);
    quantities.map(Quantity::name).collect()
});

impl<'de> Deserialize<'de> for DeviationKey {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let key = String::deserialize(deserializer)?;
        let quantity = Quantity::of_name(&key).filter(|one| one.definition().has_deviation);
        quantity.map(Self).ok_or_else(|| D::Error::unknown_field(&key, &DEVIATION_KEYS))
    }
}

/// Key of a robot in the short form of three links.
pub(super) enum Key {
    Quantity(Quantity),
    Load,
    Deviations,
    Same,
}

impl Key {
    /// Returns the names of all keys.
    pub(super) fn names() -> impl Iterator<Item = &'static str> {
        Quantity::ALL.map(Quantity::name).into_iter().chain([LOAD, DEVIATIONS, SAME])
    }

    pub(super) fn of_name(name: &str) -> Option<Self> {
        match name {
            LOAD => Some(Self::Load),
            DEVIATIONS => Some(Self::Deviations),
            SAME => Some(Self::Same),
            _ => Quantity::of_name(name).map(Self::Quantity),
        }
    }
}

/// Values of a robot of three links while they are read.
#[derive(Default)]
pub(super) struct Reader {
    robot: ThreeLinkRobot,
    /// Standard deviations given in a table of their own.
    deviations: BTreeMap<Quantity, Vec<Deviation>>,
    /// Standard deviations given beside the values.
    inline_deviations: Vec<(Quantity, Vec<Deviation>)>,
}

impl Reader {
    /// Reads the value of a key.
    pub(super) fn read<'de, A: MapAccess<'de>>(
        &mut self,
        key: Key,
        table: &mut A,
    ) -> Result<(), A::Error> {
        let Self { robot, deviations, inline_deviations } = self;
        match key {
            Key::Quantity(quantity) => {
                let seed = WithDeviation(NumbersOf(quantity));
                let ValuesWithDeviation { values, sd, same } = table.next_value_seed(seed)?;
                robot.values.insert(quantity, values);
                inline_deviations.extend(sd.map(|sd| (quantity, sd)));
                robot.same.extend(same.map(|name| (quantity, name)));
            }
            Key::Load => robot.load_n = Some(table.next_value()?),
            Key::Same => {
                let names = table.next_value::<BTreeMap<DeviationKey, String>>()?;
                robot.same.extend(names.into_iter().map(|(DeviationKey(of), name)| (of, name)));
            }
            Key::Deviations => *deviations = table.next_value::<Deviations>()?.0,
        }
        Ok(())
    }

    /// Returns the single value of a quantity; `None` if it was not read.
    pub(super) fn one(&self, quantity: Quantity) -> Option<f64> {
        self.robot.get(quantity).map(|values| values[0])
    }

    /// Returns the first quantity of `among` that is given as a value with its standard deviation, `{ value = .., sd = .. }`;
    /// `None` if all are given as plain values.
    pub(super) fn inline_deviation(&self, among: &[Quantity]) -> Option<Quantity> {
        let mut quantities = self.inline_deviations.iter().map(|(quantity, _)| *quantity);
        quantities.find(|quantity| among.contains(quantity))
    }

    /// Returns the first key that was read, other than those of the quantities in `except`.
    pub(super) fn key_except(&self, except: &[Quantity]) -> Option<&'static str> {
        let mut quantities = self.robot.values.keys();
        let other = quantities.find(|quantity| !except.contains(quantity));
        let tables = [
            (LOAD, self.robot.load_n.is_some()),
            (DEVIATIONS, !self.deviations.is_empty()),
            (SAME, !self.robot.same.is_empty()),
        ];
        let table = tables.into_iter().find_map(|(key, is_there)| is_there.then_some(key));
        other.map(|quantity| quantity.name()).or(table)
    }

    /// Returns the robot.
    ///
    /// # Errors
    /// Returns an error if a required key is missing, or if standard deviations or names of common errors contradict
    /// each other.
    pub(super) fn finish<E: Error>(self) -> Result<ThreeLinkRobot, E> {
        let Self { mut robot, mut deviations, inline_deviations } = self;
        for (quantity, sd) in inline_deviations {
            let key = quantity.name();
            let in_table = deviations.insert(quantity, sd);
            if in_table.is_some_and(|sd| !sd.into_iter().all(Deviation::is_zero)) {
                return Err(E::custom(format!(
                    "key `{key}`: found a standard deviation both in `{key}.sd` and in `standard_deviation.{key}`, \
                     but only one of them is allowed"
                )));
            }
        }
        robot.deviations =
            deviations.into_iter().map(|(of, sd)| (of, robot.in_units(of, &sd))).collect();
        robot.check_same()?;
        for quantity in Quantity::ALL {
            if quantity.definition().default.is_none() && robot.get(quantity).is_none() {
                return Err(E::missing_field(quantity.name()));
            }
        }
        Ok(robot)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use trilink_robot::{Model, Quantity};

    use crate::config::{Config, ConfigError, ThreeLinkRobot};

    /// Parses a configuration with one robot: the default semi-passive one, in which the given lines replace
    /// those with the same keys.
    fn parsed(lines: &str) -> Result<Config, String> {
        let own = toml::to_string(&Config::default().robot["semi-passive"]).unwrap();
        let of_robot = lines.lines().take_while(|line| !line.starts_with('['));
        let keys: Vec<&str> = of_robot.filter_map(|line| line.split(' ').next()).collect();
        let others = own.lines().filter(|line| {
            keys.iter().all(|key| line.split(' ').next() != Some(key)) && !line.is_empty()
        });
        let others: String = others.map(|line| format!("{line}\n")).collect();
        let text = format!("[campaign]\n[robot.ours]\n{others}{lines}\n");
        Config::parse(&text)
            .map_err(|error| ConfigError::toml(Path::new("p.toml"), &text, &error).to_string())
    }

    fn ours(config: &Config) -> &ThreeLinkRobot {
        config.robot["ours"].three_links().unwrap()
    }

    #[test]
    fn standard_deviations_beside_values_equal_those_in_the_table() {
        let beside = parsed(
            "h_m = { value = 0.2, sd = 0.001 }\nmass_kg = { value = [1, 0.3, 0.3], sd = [0.1, 0, 0] }\n\
             stiffness_nm_rad = { value = 0.2, sd = 0.01 }\ntransition_m_s = 0.004",
        );
        let together = parsed(
            "h_m = 0.2\nmass_kg = [1, 0.3, 0.3]\nstiffness_nm_rad = 0.2\ntransition_m_s = 0.004\n\
             [robot.ours.standard_deviation]\nh_m = 0.001\nmass_kg = [0.1, 0, 0]\n\
             stiffness_nm_rad = 0.01",
        );
        assert_eq!(beside, together);
        let beside = beside.unwrap();
        let robot = ours(&beside);
        assert_eq!(robot.to_robot().h_m, [0.2; 2]);
        assert_eq!(robot.deviations.get(&Quantity::H), Some(&vec![0.001]));
        assert_eq!(robot.deviations.get(&Quantity::L), None);
        let mixed =
            "b_m = { value = 0.05, sd = 0.002 }\n[robot.ours.standard_deviation]\nh_m = 0.001";
        let mixed = parsed(mixed).unwrap();
        let deviations = &ours(&mixed).deviations;
        assert_eq!(deviations.get(&Quantity::H), Some(&vec![0.001]));
        assert_eq!(deviations.get(&Quantity::B), Some(&vec![0.002]));
    }

    #[test]
    fn percentages_are_converted_to_the_unit_of_each_value() {
        let robot = |lines: &str| ours(&parsed(lines).unwrap()).clone();
        let of = |lines: &str, quantity| robot(lines).deviations.get(&quantity).cloned().unwrap();
        // The table comes after the values in one case and before them in the other.
        let beside = "mass_kg = { value = [1, 0.3, 0.4], sd = \"1 %\" }";
        let together = "mass_kg = [1, 0.3, 0.4]\n[robot.ours.standard_deviation]\nmass_kg = \"1%\"";
        for lines in [
            beside,
            together,
            "standard_deviation.mass_kg = \" 1.0 % \"\n\
             mass_kg = [1, 0.3, 0.4]",
        ] {
            let found = of(lines, Quantity::Mass);
            for (found, expected) in found.iter().zip([0.01, 0.003, 0.004]) {
                assert!((found - expected).abs() < 1e-15, "{lines}: {found}");
            }
            assert_eq!(found.len(), 3);
        }
        let mixed = "mass_kg = { value = [1, 0.5, 0.4], sd = [\"2 %\", 0.004, 0] }";
        assert_eq!(of(mixed, Quantity::Mass), [0.02, 0.004, 0.0]);
        // A common length has a common error, and separate lengths have separate errors.
        assert_eq!(of("h_m = { value = 0.2, sd = \"1 %\" }", Quantity::H), [0.002]);
        assert_eq!(of("h_m = { value = [0.2, 0.1], sd = \"1 %\" }", Quantity::H), [0.002, 0.001]);
        assert_eq!(of("h_m = { value = [0.2, 0.1], sd = 0.001 }", Quantity::H), [0.001]);
        let stiffness = "stiffness_nm_rad = { value = 0.2, sd = \"5 %\" }";
        assert!((of(stiffness, Quantity::Stiffness)[0] - 0.01).abs() < 1e-15);
        assert!(!robot(stiffness).is_exact());
        assert!(robot("h_m = { value = 0.2, sd = \"0 %\" }").is_exact());
        // Defaults have relative errors, too.
        let default = "[robot.ours.standard_deviation]\nskid_dry_n = \"10 %\"";
        assert_eq!(of(default, Quantity::SkidDry).len(), 3);
    }

    #[test]
    fn values_measured_with_one_instrument_share_an_error() {
        let beside = parsed(
            "h_m = { value = 0.2, sd = 0.001, same = \"ruler\" }\n\
             l_m = { value = [0.1, 0.11], sd = \"1 %\", same = \"ruler\" }\n\
             b_m = { value = 0.05, sd = 0.002 }\n\
             mass_kg = { value = [1, 0.3, 0.3], sd = [0.01, 0, 0.003], same = \"scale\" }",
        );
        let beside = beside.unwrap();
        let together = parsed(
            "h_m = 0.2\nl_m = [0.1, 0.11]\nb_m = 0.05\nmass_kg = [1, 0.3, 0.3]\n\
             [robot.ours.standard_deviation]\nh_m = 0.001\nl_m = \"1 %\"\nb_m = 0.002\n\
             mass_kg = [0.01, 0, 0.003]\n[robot.ours.same]\nh_m = \"ruler\"\nl_m = \"ruler\"\n\
             mass_kg = \"scale\"",
        );
        assert_eq!(beside, together.unwrap());
        // The configuration that the report prints has the same meaning.
        let printed = Config::parse(&toml::to_string(&beside).unwrap()).unwrap();
        assert_eq!(printed.robot["ours"], beside.robot["ours"]);

        let gait = beside.gait["passive-symmetric"].to_gait();
        let laws = beside.model[&Model::SKID_ROLL].laws();
        let errors = ours(&beside).errors(laws, &gait);
        let names: Vec<Vec<&str>> =
            errors.iter().map(|of| of.iter().map(|(of, _)| of.name()).collect()).collect();
        let expected = [vec!["h_m", "l1_m", "l2_m"], vec!["b_m"], vec!["mass0_kg", "mass2_kg"]];
        assert_eq!(names, expected);
    }

    #[test]
    fn errors_in_a_robot_name_the_key_and_the_mistake() {
        for (lines, expected) in [
            (
                "h_m = { value = 0.2, sd = 0.001 }\n[robot.ours.standard_deviation]\nh_m = 0.002",
                "key `h_m`: found a standard deviation both in `h_m.sd` and in `standard_deviation.h_m`",
            ),
            ("h_m = { value = 0.2, sdd = 0.001 }", "did you mean `sd`?"),
            ("h_m = { value = 0.2 }", "missing field `sd`"),
            ("h_m = \"long\"", "expected a number"),
            ("mass_kg = [1.0, 0.2]", "found a list of length 2, needed a list of length 3"),
            (
                "mass_kg = [1.2, 0.3, 0.3, 0.3, \"x\"]",
                "key `robot.ours.mass_kg`: found a list of length 5, needed a list of length 3",
            ),
            (
                "h_m = [0.2]",
                "key `robot.ours.h_m`: found a list of length 1, needed a number or a list of length 2",
            ),
            ("skid_kg_s = { value = [1.0, 1.0, 1.0], sd = [0.1, 0.1, 0.1] }", "invalid type: map"),
            ("h_mm = 0.2", "did you mean `h_m`?"),
            (
                "[robot.ours.same]\nh_m = \"ruler\"",
                "key `h_m`: found `same = \"ruler\"` without a standard deviation: add `sd`",
            ),
            (
                "h_m = { value = 0.2, sd = 0.001, same = \"rular\" }\n\
                 l_m = { value = 0.1, sd = 0.001, same = \"ruler\" }",
                "key `h_m`: found `same = \"rular\"` for one value alone, needed a name that at least two",
            ),
            ("[robot.ours.same]\nskid_kg_s = \"ruler\"", "unknown field `skid_kg_s`"),
            (
                "mass_kg = { value = [1, 0.3, 0.4], sd = \"1\" }",
                "key `robot.ours.mass_kg.sd`: invalid value: string \"1\", expected a number in the unit of the value, \
                 or a percentage of the value from \"0 %\" to \"100 %\"",
            ),
            (
                "h_m = { value = 0.2, sd = \"-1 %\" }",
                "invalid value: string \"-1 %\", expected a number",
            ),
            (
                "h_m = { value = 0.2, sd = [\"1 %\"] }",
                "found a list of length 1, needed a list of length 2",
            ),
            (
                "[robot.ours.standard_deviation]\nmass_kg = \"one %\"",
                "key `robot.ours.standard_deviation.mass_kg`: invalid value: string \"one %\"",
            ),
            (
                "[robot.ours.standard_deviation]\nmass_kg = 0.01",
                "expected a list of length 3, or a percentage such as \"1 %\"",
            ),
            (
                "h_m = { value = 0.2, sd = \"1 %\" }\n[robot.ours.standard_deviation]\nh_m = \"1 %\"",
                "found a standard deviation both in",
            ),
        ] {
            let message = parsed(lines).unwrap_err();
            assert!(message.contains(expected), "{lines}: {message}");
        }
    }
}
