//! A robot as the configuration writes it: each number alone, or with its standard deviation.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::LazyLock;

use serde::de::value::SeqAccessDeserializer;
use serde::de::{DeserializeSeed, Error, MapAccess, SeqAccess, Visitor};
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use trilink_base::Named;
use trilink_robot::{Gait, Laws, Parameter, Per, Quantity, Robot, Unit};

use super::strict::Strict;

/// What the wheels bear, N: then dry friction is in coefficients.
const LOAD: &str = "load_n";
/// The table of the standard deviations of what has none beside its value.
const DEVIATIONS: &str = "standard_deviation";

/// A robot (Tables I and II) and how well it is known: the numbers of every quantity that it gives, in the
/// unit of the quantity's key. Dry friction is in N, or a part of the wheels' load where that is given.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RobotConfig {
    values: Numbers,
    /// Of what is not here or 0 the values are taken as exact.
    deviations: Numbers,
    load_n: Option<[f64; Robot::LINKS]>,
}

type Numbers = BTreeMap<Quantity, Vec<f64>>;

impl RobotConfig {
    /// The numbers of a quantity that the robot gives.
    pub fn get(&self, quantity: Quantity) -> Option<&[f64]> {
        self.values.get(&quantity).map(Vec::as_slice)
    }

    /// Gives a quantity its numbers: one, or one a link or wheel.
    pub fn set(&mut self, quantity: Quantity, numbers: impl Into<Vec<f64>>) {
        self.values.insert(quantity, numbers.into());
    }

    /// Takes a quantity's numbers away.
    pub fn clear(&mut self, quantity: Quantity) {
        self.values.remove(&quantity);
    }

    /// Gives a quantity its standard deviations, in the unit of its numbers; 0 of what is exact.
    pub fn set_deviation(&mut self, quantity: Quantity, numbers: impl Into<Vec<f64>>) {
        self.deviations.insert(quantity, numbers.into());
    }

    /// Takes all numbers as exact.
    pub fn forget_deviations(&mut self) {
        self.deviations.clear();
    }

    /// Gives the load of the wheels, N: dry friction is in parts of it.
    pub fn set_load_n(&mut self, load_n: [f64; Robot::LINKS]) {
        self.load_n = Some(load_n);
    }

    /// Factor from the unit in which a number of a quantity is written to the SI unit.
    fn in_si(&self, quantity: Quantity, wheel: usize) -> f64 {
        let of = quantity.definition();
        match (of.unit, of.per, self.load_n) {
            (Unit::Newton, Per::Wheel, Some(load_n)) => load_n[wheel],
            _ => of.unit.in_si(),
        }
    }

    /// Every standard deviation, in SI units; 0 of what is exact.
    fn all_deviations(&self) -> impl Iterator<Item = (Parameter, f64)> {
        self.deviations.iter().flat_map(move |(&quantity, numbers)| {
            let of = move |(i, number): (usize, &f64)| {
                (quantity.of(i), number * self.in_si(quantity, i))
            };
            numbers.iter().enumerate().map(of)
        })
    }

    /// Keys of standard deviations that are larger than what they are of, and how many times as large.
    pub(super) fn large_deviations(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let robot = self.to_robot();
        let times = self.all_deviations();
        let times = times.map(move |(of, sd)| (of.quantity().name(), sd / of.of(&robot)));
        times.filter(|(_, times)| *times > 1.0 && times.is_finite())
    }

    /// Standard deviations of what a motion depends on and is not exact, in SI units.
    pub fn deviations(&self, laws: Laws, gait: &Gait) -> Vec<(Parameter, f64)> {
        let is_known = |(of, sd): &(Parameter, f64)| *sd > 0.0 && laws.know(*of, gait);
        self.all_deviations().filter(is_known).collect()
    }

    /// The quantities that are taken as exact.
    pub fn exact(&self) -> impl Iterator<Item = Quantity> {
        let has_none = |of: &Quantity| {
            self.deviations.get(of).is_none_or(|sd| sd.iter().all(|number| *number == 0.0))
        };
        let can_have = |of: &Quantity| of.definition().has_deviation;
        Quantity::ALL.into_iter().filter(can_have).filter(has_none)
    }

    /// The robot in SI units; a robot without a spring has none, nor one without dry friction any.
    pub fn to_robot(&self) -> Robot {
        let mut robot = Robot::kinematic();
        for quantity in Quantity::ALL {
            let default = quantity.definition().default.unwrap_or(f64::NAN);
            let given = self.get(quantity);
            for (i, number) in quantity.numbers_mut(&mut robot).iter_mut().enumerate() {
                let given = given.map_or(default, |given| given[i]);
                *number = given * self.in_si(quantity, i);
            }
        }
        robot
    }

    /// Takes over the coefficients of a robot, and leaves what is not given and is nothing there.
    pub fn set_coefficients(&mut self, robot: &Robot) {
        let coefficients = Quantity::ALL.into_iter().filter(|of| of.definition().is_fitted);
        coefficients.for_each(|quantity| self.take_over(quantity, robot));
    }

    /// Takes over what a robot has of a quantity; what is the same there stays as it was given.
    fn take_over(&mut self, quantity: Quantity, robot: &Robot) {
        let own = self.to_robot();
        let (own, other) = (quantity.numbers(&own), quantity.numbers(robot));
        if own == other {
            return;
        }
        let given = self.get(quantity);
        let number = |i: usize| match given {
            Some(given) if own[i] == other[i] => given[i],
            _ => other[i] / self.in_si(quantity, i),
        };
        let numbers: Vec<f64> = (0..quantity.count()).map(number).collect();
        self.set(quantity, numbers);
    }

    /// The same with one number changed, which is in the unit of its name: dry friction in N, also where the
    /// robot gives it as a part of the load. `None` if a robot has no number of this name.
    pub fn with(&self, name: &str, value: f64) -> Option<Self> {
        let mut changed = self.clone();
        if let Some(wheel) = (0..Robot::LINKS).find(|i| name == load_name(*i)) {
            changed.load_n.as_mut()?[wheel] = value;
            return Some(changed);
        }
        let mut all = Quantity::ALL.into_iter().flat_map(Quantity::parameters);
        let parameter = all.find(|of| [of.key(), of.name()].contains(&name))?;
        let (quantity, mut robot) = (parameter.quantity(), self.to_robot());
        if quantity.count() == 1 {
            changed.set(quantity, [value]);
        } else {
            parameter.set(&mut robot, value);
            changed.take_over(quantity, &robot);
        }
        Some(changed)
    }

    /// The names of its numbers, as [`RobotConfig::with`] takes them.
    pub fn names(&self) -> Vec<String> {
        let given = self.values.keys().flat_map(|quantity| quantity.parameters());
        let loads = (0..Robot::LINKS).filter(|_| self.load_n.is_some()).map(load_name);
        given.map(|parameter| parameter.name().to_owned()).chain(loads).collect()
    }
}

fn load_name(wheel: usize) -> String {
    format!("load{wheel}_n")
}

/// A quantity's numbers as the configuration has them: a number or a list.
struct Given<'n>(Quantity, &'n [f64]);

impl Serialize for Given<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0.definition().per {
            Per::Robot => self.1[0].serialize(serializer),
            Per::Link | Per::Wheel => self.1.serialize(serializer),
        }
    }
}

struct AllGiven<'n>(&'n Numbers);

impl Serialize for AllGiven<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(of, numbers)| (of.name(), Given(*of, numbers))))
    }
}

impl Serialize for RobotConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for (of, numbers) in &self.values {
            map.serialize_entry(of.name(), &Given(*of, numbers))?;
        }
        if let Some(load_n) = &self.load_n {
            map.serialize_entry(LOAD, load_n)?;
        }
        if !self.deviations.is_empty() {
            map.serialize_entry(DEVIATIONS, &AllGiven(&self.deviations))?;
        }
        map.end()
    }
}

/// Reads the numbers of a quantity: a number, or a list as long as the robot asks for.
#[derive(Clone, Copy)]
struct NumbersOf(Quantity);

impl<'de> DeserializeSeed<'de> for NumbersOf {
    type Value = Vec<f64>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Vec<f64>, D::Error> {
        match self.0.definition().per {
            Per::Robot => f64::deserialize(deserializer).map(|number| vec![number]),
            Per::Link | Per::Wheel => {
                <[f64; Robot::LINKS]>::deserialize(deserializer).map(Vec::from)
            }
        }
    }
}

/// Reads `h_m = 0.144`, or `h_m = { value = 0.144, sd = 0.0005 }`; lists in the same way.
struct WithDeviation(NumbersOf);

impl<'de> DeserializeSeed<'de> for WithDeviation {
    type Value = (Vec<f64>, Option<Vec<f64>>);

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        match self.0.0.definition().has_deviation {
            true => deserializer.deserialize_any(self),
            false => self.0.deserialize(deserializer).map(|numbers| (numbers, None)),
        }
    }
}

impl<'de> Visitor<'de> for WithDeviation {
    type Value = (Vec<f64>, Option<Vec<f64>>);

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a value, or { value = .., sd = .. }")
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<Self::Value, E> {
        let number = serde::de::value::F64Deserializer::new(number);
        self.0.deserialize(number).map(|numbers| (numbers, None))
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<Self::Value, E> {
        self.visit_f64(number as f64)
    }

    // What is no number has serde's own words.
    fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
        let text = serde::de::value::StrDeserializer::new(text);
        self.0.deserialize(text).map(|numbers| (numbers, None))
    }

    fn visit_bool<E: Error>(self, boolean: bool) -> Result<Self::Value, E> {
        let boolean = serde::de::value::BoolDeserializer::new(boolean);
        self.0.deserialize(boolean).map(|numbers| (numbers, None))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Self::Value, A::Error> {
        let list = Strict(SeqAccessDeserializer::new(list));
        self.0.deserialize(list).map(|numbers| (numbers, None))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut table: A) -> Result<Self::Value, A::Error> {
        let (mut value, mut sd) = (None, None);
        while let Some(key) = table.next_key()? {
            let found = match key {
                ValueKey::Value => &mut value,
                ValueKey::Sd => &mut sd,
            };
            *found = Some(table.next_value_seed(self.0)?);
        }
        let value = value.ok_or_else(|| A::Error::missing_field("value"))?;
        Ok((value, Some(sd.ok_or_else(|| A::Error::missing_field("sd"))?)))
    }
}

#[derive(Deserialize)]
#[serde(field_identifier, rename_all = "lowercase")]
enum ValueKey {
    Value,
    Sd,
}

/// Reads the table of standard deviations.
#[derive(Default)]
struct Deviations(Numbers);

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
            self.0.insert(quantity, table.next_value_seed(NumbersOf(quantity))?);
        }
        Ok(self)
    }
}

/// A key of a robot.
enum Key {
    Quantity(Quantity),
    Load,
    Deviations,
}

static KEYS: LazyLock<Vec<&str>> = LazyLock::new(|| {
    Quantity::ALL.map(Quantity::name).into_iter().chain([LOAD, DEVIATIONS]).collect()
});

impl<'de> Deserialize<'de> for Key {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let key = String::deserialize(deserializer)?;
        match (key.as_str(), Quantity::of_name(&key)) {
            (_, Some(quantity)) => Ok(Self::Quantity(quantity)),
            (LOAD, _) => Ok(Self::Load),
            (DEVIATIONS, _) => Ok(Self::Deviations),
            _ => Err(D::Error::unknown_field(&key, &KEYS)),
        }
    }
}

/// A key of the table of standard deviations.
struct DeviationKey(Quantity);

static DEVIATION_KEYS: LazyLock<Vec<&str>> = LazyLock::new(|| {
    let can_have = Quantity::ALL.into_iter().filter(|of| of.definition().has_deviation);
    can_have.map(Quantity::name).collect()
});

impl<'de> Deserialize<'de> for DeviationKey {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let key = String::deserialize(deserializer)?;
        let quantity = Quantity::of_name(&key).filter(|of| of.definition().has_deviation);
        quantity.map(Self).ok_or_else(|| D::Error::unknown_field(&key, &DEVIATION_KEYS))
    }
}

struct RobotVisitor;

impl<'de> Deserialize<'de> for RobotConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_struct("Robot", &KEYS, RobotVisitor)
    }
}

impl<'de> Visitor<'de> for RobotVisitor {
    type Value = RobotConfig;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a robot")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut table: A) -> Result<RobotConfig, A::Error> {
        let (mut robot, mut beside) = (RobotConfig::default(), Numbers::new());
        while let Some(key) = table.next_key()? {
            match key {
                Key::Quantity(quantity) => {
                    let (values, sd) = table.next_value_seed(WithDeviation(NumbersOf(quantity)))?;
                    robot.values.insert(quantity, values);
                    beside.extend(sd.map(|sd| (quantity, sd)));
                }
                Key::Load => robot.load_n = Some(table.next_value()?),
                Key::Deviations => robot.deviations = table.next_value::<Deviations>()?.0,
            }
        }
        for (quantity, sd) in beside {
            let key = quantity.name();
            if robot.deviations.insert(quantity, sd).is_some_and(|of| of.iter().any(|n| *n != 0.0))
            {
                return Err(A::Error::custom(format!(
                    "key `{key}`: found a standard deviation in `{key}.sd` and in `standard_deviation.{key}`, \
                     needed one of them"
                )));
            }
        }
        let is_missing =
            |of: &Quantity| of.definition().default.is_none() && robot.get(*of).is_none();
        match Quantity::ALL.into_iter().find(is_missing) {
            Some(missing) => Err(A::Error::missing_field(missing.name())),
            None => Ok(robot),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use trilink_robot::Quantity;

    use crate::config::{Config, ConfigError};

    /// A robot with these lines instead of its own.
    fn parsed(lines: &str) -> Result<Config, String> {
        let own = toml::to_string(&Config::default().robot["semi-passive"]).unwrap();
        let of_robot = lines.lines().take_while(|line| !line.starts_with('['));
        let keys: Vec<&str> = of_robot.filter_map(|line| line.split(' ').next()).collect();
        let kept = own.lines().filter(|line| {
            keys.iter().all(|key| line.split(' ').next() != Some(key)) && !line.is_empty()
        });
        let own: String = kept.map(|line| format!("{line}\n")).collect();
        let text = format!("[campaign]\n[robot.ours]\n{own}{lines}\n");
        Config::parse(&text)
            .map_err(|error| ConfigError::toml(Path::new("p.toml"), &text, &error).to_string())
    }

    #[test]
    fn a_standard_deviation_beside_its_value_is_the_one_of_the_table() {
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
        let robot = &beside.unwrap().robot["ours"];
        let of = |deviations: &super::Numbers, key| deviations.get(&key).cloned();
        let deviation = of(&robot.deviations, Quantity::H);
        assert_eq!((robot.to_robot().h_m, deviation), (0.2, Some(vec![0.001])));
        assert_eq!(of(&robot.deviations, Quantity::L), None);
        let mixed =
            "b_m = { value = 0.05, sd = 0.002 }\n[robot.ours.standard_deviation]\nh_m = 0.001";
        let deviations = &parsed(mixed).unwrap().robot["ours"].deviations;
        let found = [Quantity::H, Quantity::B].map(|key| of(deviations, key));
        assert_eq!(found, [Some(vec![0.001]), Some(vec![0.002])]);
    }

    #[test]
    fn what_is_wrong_with_it_is_named() {
        for (lines, named) in [
            (
                "h_m = { value = 0.2, sd = 0.001 }\n[robot.ours.standard_deviation]\nh_m = 0.002",
                "key `h_m`: found a standard deviation in `h_m.sd` and in `standard_deviation.h_m`",
            ),
            ("h_m = { value = 0.2, sdd = 0.001 }", "did you mean `sd`?"),
            ("h_m = { value = 0.2 }", "missing field `sd`"),
            ("h_m = \"long\"", "expected a number"),
            ("mass_kg = [1.0, 0.2]", "found a list of length 2, needed a list of length 3"),
            (
                "mass_kg = [1.2, 0.3, 0.3, 0.3, \"x\"]",
                "key `robot.ours.mass_kg`: found a list of length 5, needed a list of length 3",
            ),
            ("h_m = [0.2]", "key `robot.ours.h_m`: found a list of length 1, needed a number"),
            ("skid_kg_s = { value = [1.0, 1.0, 1.0], sd = [0.1, 0.1, 0.1] }", "invalid type: map"),
            ("h_mm = 0.2", "did you mean `h_m`?"),
        ] {
            let message = parsed(lines).unwrap_err();
            assert!(message.contains(named), "{lines}: {message}");
        }
    }
}
