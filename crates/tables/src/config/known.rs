//! A robot as the configuration writes it: each number alone, or with its standard deviation.

use std::fmt;
use std::marker::PhantomData;

use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Error, IntoDeserializer, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::strict::Strict;
use super::{RobotConfig, RobotDeviation};

/// `h_m = 0.144`, or `h_m = { value = 0.144, sd = 0.0005 }`; lists in the same way.
struct Known<T> {
    value: T,
    sd: Option<T>,
}

/// The same of the configuration.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WithDeviation<T> {
    value: T,
    sd: T,
}

struct KnownVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for KnownVisitor<T> {
    type Value = Known<T>;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a value, or { value = .., sd = .. }")
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<Known<T>, E> {
        alone(T::deserialize(number.into_deserializer()))
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<Known<T>, E> {
        alone(T::deserialize(number.into_deserializer()))
    }

    fn visit_u64<E: Error>(self, number: u64) -> Result<Known<T>, E> {
        alone(T::deserialize(number.into_deserializer()))
    }

    // What is no number has serde's own words.
    fn visit_str<E: Error>(self, text: &str) -> Result<Known<T>, E> {
        alone(T::deserialize(text.into_deserializer()))
    }

    fn visit_bool<E: Error>(self, boolean: bool) -> Result<Known<T>, E> {
        alone(T::deserialize(boolean.into_deserializer()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Known<T>, A::Error> {
        alone(T::deserialize(Strict(SeqAccessDeserializer::new(list))))
    }

    fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<Known<T>, A::Error> {
        let WithDeviation { value, sd } =
            WithDeviation::deserialize(MapAccessDeserializer::new(table))?;
        Ok(Known { value, sd: Some(sd) })
    }
}

fn alone<T, E>(value: Result<T, E>) -> Result<Known<T>, E> {
    value.map(|value| Known { value, sd: None })
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Known<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(KnownVisitor(PhantomData))
    }
}

/// Defines the keys of a robot of which how well they are known can be said beside them, and how they
/// become the two tables that all else reads.
macro_rules! robot_keys {
    (
        $($needed:ident: $needed_type:ty,)* ;
        $($optional:ident: $optional_type:ty,)* ;
        $($plain:ident: $plain_type:ty,)*
    ) => {
        /// A robot as it is written.
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        pub(super) struct RobotKeys {
            $($needed: Known<$needed_type>,)*
            $($optional: Option<Known<$optional_type>>,)*
            $($plain: $plain_type,)*
            standard_deviation: Option<RobotDeviation>,
        }

        impl TryFrom<RobotKeys> for RobotConfig {
            type Error = String;

            fn try_from(keys: RobotKeys) -> Result<Self, String> {
                let mut deviation = keys.standard_deviation;
                $(if let Some(sd) = keys.$needed.sd {
                    let all = deviation.get_or_insert_default();
                    all.$needed = said_once(stringify!($needed), sd, all.$needed)?;
                })*
                $(if let Some(sd) = keys.$optional.as_ref().and_then(|of| of.sd) {
                    let all = deviation.get_or_insert_default();
                    all.$optional = said_once(stringify!($optional), sd, all.$optional)?;
                })*
                Ok(Self {
                    $($needed: keys.$needed.value,)*
                    $($optional: keys.$optional.map(|of| of.value),)*
                    $($plain: keys.$plain,)*
                    standard_deviation: deviation,
                })
            }
        }
    };
}

robot_keys! {
    h_m: f64,
    l_m: f64,
    b_m: f64,
    mass_kg: [f64; 3],
    inertia_kg_m2: [f64; 3],
    roll_kg_s: [f64; 3],
    ;
    skid_dry_n: [f64; 3],
    skid_static_n: [f64; 3],
    stribeck_m_s: f64,
    roll_dry_n: [f64; 3],
    transition_m_s: f64,
    stiffness_nm_rad: f64,
    damping_nm_s_rad: f64,
    ;
    skid_kg_s: [f64; 3],
    load_n: Option<[f64; 3]>,
    rest_angle_deg: Option<f64>,
}

/// A standard deviation that stands beside its key, and so not in the table of them.
fn said_once<T: PartialEq + Default>(key: &str, sd: T, other: T) -> Result<T, String> {
    match other == T::default() {
        true => Ok(sd),
        false => Err(format!(
            "key `{key}`: found a standard deviation in `{key}.sd` and in `standard_deviation.{key}`, \
             needed one of them"
        )),
    }
}

#[cfg(test)]
mod tests {
    use crate::config::{Config, ConfigError};
    use std::path::Path;

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
        let deviation = robot.standard_deviation.unwrap();
        assert_eq!((robot.h_m, deviation.h_m, deviation.l_m), (0.2, 0.001, 0.0));
        let mixed =
            "b_m = { value = 0.05, sd = 0.002 }\n[robot.ours.standard_deviation]\nh_m = 0.001";
        let deviation = parsed(mixed).unwrap().robot["ours"].standard_deviation.unwrap();
        assert_eq!((deviation.h_m, deviation.b_m), (0.001, 0.002));
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
