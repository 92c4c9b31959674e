//! Deserializer that checks the length of every list, and rejects a list in place of a table or a number.
//! (The visitors that serde derives ignore surplus elements in a list, and accept a list in place of a
//! table.)

use std::fmt;

use serde::Deserializer;
use serde::de::{DeserializeSeed, EnumAccess, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};

/// Wrapper around a deserializer that rejects, at any depth, lists of the wrong length and lists where none
/// is expected.
pub(super) struct Strict<D>(pub D);

/// Kind of value that is required in a place where the visitors that serde derives would also accept other kinds.
#[derive(Clone, Copy)]
enum Needed {
    Anything,
    Number,
    List { length: usize },
    Table { keys: &'static [&'static str] },
}

macro_rules! forward {
    ($needed:expr; $($method:ident)*) => {
        $(fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, D::Error> {
            self.0.$method(StrictVisitor { visitor, needed: $needed })
        })*
    };
}

impl<'de, D: Deserializer<'de>> Deserializer<'de> for Strict<D> {
    type Error = D::Error;

    forward! { Needed::Anything;
        deserialize_any deserialize_bool deserialize_char deserialize_str deserialize_string
        deserialize_bytes deserialize_byte_buf deserialize_option deserialize_unit deserialize_seq
        deserialize_map deserialize_identifier deserialize_ignored_any
    }

    forward! { Needed::Number;
        deserialize_i8 deserialize_i16 deserialize_i32 deserialize_i64 deserialize_i128
        deserialize_u8 deserialize_u16 deserialize_u32 deserialize_u64 deserialize_u128
        deserialize_f32 deserialize_f64
    }

    fn deserialize_unit_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        visitor: V,
    ) -> Result<V::Value, D::Error> {
        let visitor = StrictVisitor { visitor, needed: Needed::Anything };
        self.0.deserialize_unit_struct(name, visitor)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        visitor: V,
    ) -> Result<V::Value, D::Error> {
        let visitor = StrictVisitor { visitor, needed: Needed::Anything };
        self.0.deserialize_newtype_struct(name, visitor)
    }

    fn deserialize_tuple<V: Visitor<'de>>(
        self,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, D::Error> {
        let visitor = StrictVisitor { visitor, needed: Needed::List { length } };
        self.0.deserialize_tuple(length, visitor)
    }

    fn deserialize_tuple_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, D::Error> {
        let visitor = StrictVisitor { visitor, needed: Needed::List { length } };
        self.0.deserialize_tuple_struct(name, length, visitor)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        keys: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, D::Error> {
        let visitor = StrictVisitor { visitor, needed: Needed::Table { keys } };
        self.0.deserialize_struct(name, keys, visitor)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, D::Error> {
        let visitor = StrictVisitor { visitor, needed: Needed::Anything };
        self.0.deserialize_enum(name, variants, visitor)
    }
}

struct StrictVisitor<V> {
    visitor: V,
    needed: Needed,
}

macro_rules! pass {
    ($($method:ident: $value:ty,)*) => {
        $(fn $method<E: Error>(self, value: $value) -> Result<V::Value, E> {
            self.visitor.$method(value)
        })*
    };
}

impl<'de, V: Visitor<'de>> Visitor<'de> for StrictVisitor<V> {
    type Value = V::Value;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        self.visitor.expecting(f)
    }

    // The types of TOML values; smaller number types arrive as one of these.
    pass! {
        visit_bool: bool,
        visit_i64: i64,
        visit_i128: i128,
        visit_u64: u64,
        visit_u128: u128,
        visit_f64: f64,
        visit_str: &str,
        visit_borrowed_str: &'de str,
        visit_string: String,
    }

    fn visit_none<E: Error>(self) -> Result<V::Value, E> {
        self.visitor.visit_none()
    }

    fn visit_unit<E: Error>(self) -> Result<V::Value, E> {
        self.visitor.visit_unit()
    }

    fn visit_some<D: Deserializer<'de>>(self, value: D) -> Result<V::Value, D::Error> {
        self.visitor.visit_some(Strict(value))
    }

    fn visit_newtype_struct<D: Deserializer<'de>>(self, value: D) -> Result<V::Value, D::Error> {
        self.visitor.visit_newtype_struct(Strict(value))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<V::Value, A::Error> {
        let mut list = Elements { list, taken: 0, has_ended: false };
        let needed = match self.needed {
            Needed::Anything => return self.visitor.visit_seq(list),
            Needed::Number => "a number".to_owned(),
            Needed::Table { keys } => format!("a table with the keys {}", keys.join(", ")),
            Needed::List { length } => {
                let value = self.visitor.visit_seq(&mut list);
                // The error about a wrong element names that element; a missing element is reported as a
                // wrong length of the list.
                if value.is_err() && !list.has_ended || list.count()? == length {
                    return value;
                }
                format!("a list of length {length}")
            }
        };
        let found = list.count()?;
        Err(A::Error::custom(format!("found a list of length {found}, needed {needed}")))
    }

    fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<V::Value, A::Error> {
        self.visitor.visit_map(Entries(table))
    }

    // Variants have no values: each occurs only as a name.
    fn visit_enum<A: EnumAccess<'de>>(self, name: A) -> Result<V::Value, A::Error> {
        self.visitor.visit_enum(name)
    }
}

struct StrictSeed<S>(S);

impl<'de, S: DeserializeSeed<'de>> DeserializeSeed<'de> for StrictSeed<S> {
    type Value = S::Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<S::Value, D::Error> {
        self.0.deserialize(Strict(deserializer))
    }
}

/// Access to the elements of a list; counts the elements that have been read.
struct Elements<A> {
    list: A,
    taken: usize,
    has_ended: bool,
}

impl<'de, A: SeqAccess<'de>> Elements<A> {
    /// Reads the remaining elements of the list, and returns the total number of elements.
    fn count(&mut self) -> Result<usize, A::Error> {
        while self.next_element::<IgnoredAny>()?.is_some() {}
        Ok(self.taken)
    }
}

impl<'de, A: SeqAccess<'de>> SeqAccess<'de> for Elements<A> {
    type Error = A::Error;

    fn next_element_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, A::Error> {
        if self.has_ended {
            return Ok(None);
        }
        let element = self.list.next_element_seed(StrictSeed(seed))?;
        self.has_ended = element.is_none();
        self.taken += usize::from(element.is_some());
        Ok(element)
    }

    fn size_hint(&self) -> Option<usize> {
        self.list.size_hint()
    }
}

/// Access to the entries of a table.
struct Entries<A>(A);

impl<'de, A: MapAccess<'de>> MapAccess<'de> for Entries<A> {
    type Error = A::Error;

    fn next_key_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, A::Error> {
        self.0.next_key_seed(seed)
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, A::Error> {
        self.0.next_value_seed(StrictSeed(seed))
    }

    fn size_hint(&self) -> Option<usize> {
        self.0.size_hint()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use toml::{Table, Value};

    use super::super::settings::join_key;
    use trilink_base::Named;
    use trilink_robot::{Per, Quantity, Robot};

    use super::super::{Config, ConfigError, FigureWidth, SharedFits, SmoothingWindow};
    use crate::config::Robots;

    /// Returns a configuration with all keys, including the optional ones.
    fn every_key() -> Value {
        let mut config = Config::default();
        config.ingest.smoothing_window = SmoothingWindow::Window(9);
        config.report.width_mm = FigureWidth::Mm(90.0);
        config.fit.shared = Some(SharedFits { robot: Robots(vec!["kinematic".to_owned()]) });
        config.optimise.power_w = Some(2.0);
        config.optimise.torque_nm = Some(0.5);
        let robot = config.robot.get_mut("semi-passive").unwrap().three_links_mut().unwrap();
        for quantity in Quantity::ALL.into_iter().filter(|one| one.definition().has_deviation) {
            let is_per_joint = quantity.definition().per == Per::Joint;
            let count = if is_per_joint { 1 } else { quantity.count() };
            robot.set_deviation(quantity, vec![0.0; count]);
        }
        robot.set_load_n([7.2, 3.6, 3.6]);
        robot.set(Quantity::SkidStatic, [1.0; 3]);
        robot.set(Quantity::RollDry, [1.0; 3]);
        robot.set(Quantity::Stribeck, [0.1]);
        let joint = config.gait.get_mut("skewed").unwrap().joint1.as_mut().unwrap();
        joint.amplitude2_deg = Some(5.0);
        joint.phase2_deg = Some(0.0);
        Value::try_from(config).unwrap()
    }

    /// Collects invalid replacements, of the wrong length or type, for `value` and for each value in it,
    /// together with the replaced key and the text that the error must contain.
    fn collect_wrong(value: &Value, key: &str, wrong: &mut Vec<(String, Value, String)>) {
        let mut add = |value: Value, error: String| wrong.push((key.to_owned(), value, error));
        let a_list = |length: usize, needed: &str| {
            format!("key `{key}`: found a list of length {length}, needed {needed}")
        };
        match value {
            Value::Array(list) if list.first().is_some_and(Value::is_float) => {
                let length = list.len();
                let number = list[0].clone();
                let needed = format!("a list of length {length}");
                for other in (0..2 * length).filter(|other| *other != length) {
                    let numbers = vec![number.clone(); other];
                    add(numbers.into(), a_list(other, &needed));
                }
                let with_text = [&list[..], &["x".into()]].concat();
                add(with_text.into(), a_list(length + 1, &needed));
                let nested = vec![Value::from(vec![number.clone()]); length];
                add(nested.into(), a_list(1, "a number"));
                add(number, format!("key `{key}`: invalid type: floating point"));
            }
            // These keys take a word or a number.
            Value::Integer(_) | Value::Float(_)
                if ["ingest.smoothing_window", "report.width_mm"].contains(&key) =>
            {
                add(vec![value.clone()].into(), format!("key `{key}`: invalid value: ["));
            }
            Value::Integer(_) | Value::Float(_) => {
                let name = key.rsplit('.').next().unwrap();
                let is_per_joint = Quantity::of_name(name)
                    .is_some_and(|quantity| quantity.definition().per == Per::Joint);
                // A quantity of both joints may be a list: front, rear.
                for length in (1..=3).filter(|length| !is_per_joint || *length != Robot::JOINTS) {
                    add(vec![value.clone(); length].into(), a_list(length, "a"));
                }
            }
            Value::String(_) | Value::Boolean(_) => {
                add(vec![value.clone(); 2].into(), format!("key `{key}`: "));
            }
            Value::Table(table) => {
                let numbers: Vec<Value> =
                    table.values().filter(|value| value.is_float()).cloned().collect();
                if !key.is_empty() && !numbers.is_empty() {
                    add(numbers.into(), format!("key `{key}`: "));
                }
                for (name, value) in table {
                    collect_wrong(value, &join_key(key, name), wrong);
                }
            }
            _ => {}
        }
    }

    /// Returns the TOML text of a table in which the value of a dotted key is replaced by `other`.
    fn with(value: &Value, key: &str, other: &Value) -> String {
        let path = Value::Table(format!("{key} = 0").parse::<Table>().unwrap());
        let mut rest = &path;
        let mut changed = value.clone();
        let mut inner = &mut changed;
        while let Value::Table(table) = rest {
            let (name, deeper) = table.iter().next().unwrap();
            inner = &mut inner[name.as_str()];
            rest = deeper;
        }
        *inner = other.clone();
        toml::to_string(&changed).unwrap()
    }

    fn error(text: &str) -> Option<String> {
        let error = Config::parse(text).err()?;
        Some(ConfigError::toml(Path::new("p.toml"), text, &error).to_string())
    }

    #[test]
    fn every_value_of_another_length_is_rejected_by_its_key() {
        let all = every_key();
        assert_eq!(error(&toml::to_string(&all).unwrap()), None);
        let mut wrong = Vec::new();
        collect_wrong(&all, "", &mut wrong);
        assert!(wrong.len() > 500, "{}", wrong.len());
        // These keys take a list or a single value, or lists of two lengths (`link_layout`).
        wrong.retain(|(key, ..)| !["fit.shared.robot", "paths.raw"].contains(&key.as_str()));
        wrong.retain(|(key, ..)| !key.starts_with("markers."));
        for (key, other, expected) in wrong {
            let message = error(&with(&all, &key, &other));
            let is_named = message.as_ref().is_some_and(|message| message.contains(&expected));
            assert!(is_named, "{key} = {other}: {expected}: {message:?}");
        }
    }

    #[test]
    fn lists_with_standard_deviations_have_the_same_length_as_without() {
        let all = every_key();
        for (value, needed) in [
            (
                "{ value = [1, 1, 1, 1], sd = [0, 0, 0] }",
                "key `robot.kinematic.mass_kg.value`: found a list of length 4, needed a list of \
                 length 3",
            ),
            (
                "{ value = [1, 1, 1], sd = [0, 0] }",
                "key `robot.kinematic.mass_kg.sd`: found a list of length 2, needed a list of length 3",
            ),
            (
                "{ value = [1, 1, 1], sd = 0.1 }",
                "key `robot.kinematic.mass_kg.sd`: invalid type: floating point `0.1`, expected a \
                 list of length 3",
            ),
        ] {
            let value = format!("v = {value}").parse::<Table>().unwrap().remove("v").unwrap();
            let message = error(&with(&all, "robot.kinematic.mass_kg", &value)).unwrap();
            assert!(message.contains(needed), "{message}");
        }
    }

    #[test]
    fn a_list_is_rejected_in_place_of_a_table() {
        let all = every_key();
        let weights = vec![Value::Float(10.0); 4].into();
        let message = error(&with(&all, "campaign.kinematic-skewed.weights", &weights)).unwrap();
        let expected = "key `campaign.kinematic-skewed.weights`: found a list of length 4, needed \
                        a table with the keys d, v, sigma, alpha";
        assert!(message.ends_with(expected), "{message}");
    }
}
