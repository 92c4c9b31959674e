//! The value of every key, and where it comes from.

use std::ops::Range;

use serde::{Deserialize, Serialize};
use toml::Value;
use toml::de::{DeTable, DeValue, Error};

use super::{Config, with_defaults};

/// A key of the configuration.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Setting {
    /// As TOML has it from the top, such as `robot.kinematic.h_m`.
    pub key: String,
    pub value: Value,
    /// The line of the file that says so; `None` of a default.
    pub line: Option<usize>,
}

impl Config {
    /// Every key that the text of a configuration file makes count, in the order of their names;
    /// lists are one value.
    ///
    /// # Errors
    /// The text is not TOML.
    pub fn settings(text: &str) -> Result<Vec<Setting>, Error> {
        let mut own = Vec::new();
        places(DeTable::parse(text)?.get_ref(), "", &mut own);
        let all = toml::Table::deserialize(toml::Deserializer::from(with_defaults(text)?))?;
        let mut settings = Vec::new();
        flatten(Value::Table(all), String::new(), &mut settings);
        for setting in &mut settings {
            let found = own.iter().find(|(key, _)| *key == setting.key);
            setting.line = found.map(|(_, place)| line_at(text, place.start));
        }
        Ok(settings)
    }
}

/// A key below another one.
pub(super) fn below(above: &str, key: &str) -> String {
    let is_bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    let key = match !key.is_empty() && key.chars().all(is_bare) {
        true => key.to_owned(),
        false => Value::String(key.to_owned()).to_string(),
    };
    if above.is_empty() { key } else { format!("{above}.{key}") }
}

/// The number of the line where something stands.
pub(super) fn line_at(text: &str, start: usize) -> usize {
    1 + text.as_bytes()[..start].iter().filter(|&&byte| byte == b'\n').count()
}

/// The key in whose line or value something stands.
pub(super) fn key_at(text: &str, at: usize) -> Option<String> {
    let mut found = Vec::new();
    places(DeTable::parse(text).ok()?.get_ref(), "", &mut found);
    found.into_iter().rfind(|(_, place)| place.contains(&at)).map(|(key, _)| key)
}

/// The keys of a table, and where they stand with their values; those inside of a list after it.
fn places(table: &DeTable, above: &str, found: &mut Vec<(String, Range<usize>)>) {
    for (key, value) in table {
        let name = below(above, key.get_ref());
        let place = key.span().start..value.span().end;
        match value.get_ref() {
            DeValue::Table(inner) if !inner.is_empty() => places(inner, &name, found),
            DeValue::Array(list) => {
                found.push((name.clone(), place));
                for (i, value) in list.iter().enumerate() {
                    if let DeValue::Table(inner) = value.get_ref() {
                        places(inner, &format!("{name}[{i}]"), found);
                    }
                }
            }
            _ => found.push((name, place)),
        }
    }
}

fn flatten(value: Value, key: String, settings: &mut Vec<Setting>) {
    match value {
        Value::Table(table) if !table.is_empty() => {
            table
                .into_iter()
                .for_each(|(name, value)| flatten(value, below(&key, &name), settings));
        }
        value => settings.push(Setting { key, value, line: None }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_has_its_value_and_its_line_and_all_of_them_are_the_same_configuration() {
        let text = "[fit]\nstarts = 3\n[compare.trials]\n\"d_m\" = { absolute = 0.1 }\n\
                    [robot.\"a b\"]\nh_m = 0.1\nl_m = 0.1\nb_m = 0.05\nmass_kg = [1.0, 0.2, 0.2]\n\
                    inertia_kg_m2 = [0.01, 0.001, 0.001]\nroll_kg_s = [0.6, 0.3, 0.3]\n\
                    skid_kg_s = [1.0, 1.0, 1.0]\n[campaign]\n";
        let settings = Config::settings(text).expect("is TOML");
        let of = |key: &str| settings.iter().find(|setting| setting.key == key);
        let line = |key: &str| of(key).expect("is there").line;
        assert_eq!(line("fit.starts"), Some(2));
        assert_eq!(line("fit.bootstrap"), None);
        assert_eq!(line("compare.trials.d_m.absolute"), Some(4));
        assert!(of("compare.trials.d_m.relative").is_none());
        assert_eq!(line("compare.trials.v_m_s.relative"), None);
        assert_eq!(line("robot.\"a b\".mass_kg"), Some(9));
        // Naming one robot replaces all.
        assert!(of("robot.kinematic.h_m").is_none());
        let written: String =
            settings.iter().map(|of| format!("{} = {}\n", of.key, of.value)).collect();
        assert_eq!(Config::parse(&written).expect("is one"), Config::parse(text).expect("is one"));
    }
}
