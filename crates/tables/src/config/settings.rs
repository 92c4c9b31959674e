//! Effective value of each configuration key, and the line that sets it.

use std::ops::Range;

use serde::{Deserialize, Serialize};
use toml::Value;
use toml::de::{DeTable, DeValue, Error};

use super::{Config, parse_with_defaults, toml_key};

/// Configuration key with its value in effect, whether configured or by default.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Setting {
    /// Dotted TOML key, such as `robot.kinematic.h_m`.
    pub key: String,
    pub value: Value,
    /// Line of the file that sets the value; `None` for a default.
    pub line: Option<usize>,
}

impl Config {
    /// Returns all keys with their values in effect for a configuration file with this text, sorted by key; a
    /// list counts as one value.
    ///
    /// # Errors
    /// Returns an error if the text is not TOML.
    pub fn settings(text: &str) -> Result<Vec<Setting>, Error> {
        let mut spans = Vec::new();
        collect_spans(DeTable::parse(text)?.get_ref(), "", &mut spans);
        let all = toml::Table::deserialize(toml::Deserializer::from(parse_with_defaults(text)?))?;
        let mut settings = Vec::new();
        flatten(Value::Table(all), String::new(), &mut settings);
        for setting in &mut settings {
            let span = spans.iter().find(|(key, _)| *key == setting.key);
            setting.line = span.map(|(_, span)| line_at(text, span.start));
        }
        Ok(settings)
    }
}

/// Returns the keys that a configuration file sets to nan, or to a list with a nan, with their lines, in the order of
/// the file.
pub(super) fn unfilled(text: &str) -> Vec<String> {
    let mut settings = Config::settings(text).unwrap_or_default();
    settings.retain(|setting| match &setting.value {
        Value::Array(list) => list.iter().any(is_nan),
        value => is_nan(value),
    });
    settings.sort_by_key(|setting| setting.line);
    let keys = settings.into_iter().filter_map(|Setting { key, line, .. }| Some((key, line?)));
    keys.map(|(key, line)| format!("{key} (line {line})")).collect()
}

fn is_nan(value: &Value) -> bool {
    value.as_float().is_some_and(f64::is_nan)
}

/// Returns the dotted key of `key` inside `table`.
pub(super) fn join_key(table: &str, key: &str) -> String {
    let key = toml_key(key);
    if table.is_empty() { key } else { format!("{table}.{key}") }
}

/// Returns the number of the line that contains a byte offset.
pub(super) fn line_at(text: &str, offset: usize) -> usize {
    1 + text.as_bytes()[..offset].iter().filter(|&&byte| byte == b'\n').count()
}

/// Returns the dotted key whose name or value contains a byte offset; `None` if there is none.
pub(super) fn key_at(text: &str, offset: usize) -> Option<String> {
    let mut spans = Vec::new();
    collect_spans(DeTable::parse(text).ok()?.get_ref(), "", &mut spans);
    spans.into_iter().rfind(|(_, span)| span.contains(&offset)).map(|(key, _)| key)
}

/// Collects the dotted keys in a table, each with the byte range from its name to the end of its value. The key of a
/// list comes before the keys inside the list.
fn collect_spans(table: &DeTable, prefix: &str, spans: &mut Vec<(String, Range<usize>)>) {
    for (key, value) in table {
        let name = join_key(prefix, key.get_ref());
        let span = key.span().start..value.span().end;
        match value.get_ref() {
            DeValue::Table(inner) if !inner.is_empty() => collect_spans(inner, &name, spans),
            DeValue::Array(list) => {
                spans.push((name.clone(), span));
                for (i, value) in list.iter().enumerate() {
                    if let DeValue::Table(inner) = value.get_ref() {
                        collect_spans(inner, &format!("{name}[{i}]"), spans);
                    }
                }
            }
            _ => spans.push((name, span)),
        }
    }
}

/// Appends the settings in a table, sorted by key; their keys begin with `key`, the table's own. A value that is not a
/// table is a single setting.
fn flatten(value: Value, key: String, settings: &mut Vec<Setting>) {
    match value {
        Value::Table(table) if !table.is_empty() => {
            for (name, value) in table {
                flatten(value, join_key(&key, &name), settings);
            }
        }
        value => settings.push(Setting { key, value, line: None }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_that_is_nan_is_named_at_once_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.toml");
        let text = "[fit]\nstarts = 3\n[robot.a]\nh_m = 0.1\nl_m = nan\nb_m = 0.05\nmass_kg = [1.0, nan, 0.2]\n\
                    inertia_kg_m2 = [0.01, 0.001, 0.001]\nroll_kg_s = [0.6, 0.3, 0.3]\n\
                    skid_kg_s = [1.0, 1.0, 1.0]\n[campaign]\n";
        std::fs::write(&path, text).unwrap();
        let message = Config::load(&path).unwrap_err().to_string();
        let expected =
            "found nan for 2 keys, needed numbers: robot.a.l_m (line 5), robot.a.mass_kg (line 7)";
        assert!(message.ends_with(expected), "{message}");
        std::fs::write(&path, text.replace("nan, 0.2", "0.2, 0.2")).unwrap();
        let message = Config::load(&path).unwrap_err().to_string();
        assert!(message.contains("key `robot.a.l_m`: found NaN"), "{message}");
    }

    #[test]
    fn settings_have_values_and_lines_and_reproduce_the_configuration() {
        let text = "[fit]\nstarts = 3\n[compare.trials]\n\"d_m\" = { absolute = 0.1 }\n\
                    [robot.\"a b\"]\nh_m = 0.1\nl_m = 0.1\nb_m = 0.05\nmass_kg = [1.0, 0.2, 0.2]\n\
                    inertia_kg_m2 = [0.01, 0.001, 0.001]\nroll_kg_s = [0.6, 0.3, 0.3]\n\
                    skid_kg_s = [1.0, 1.0, 1.0]\n[campaign]\n";
        let settings = Config::settings(text).expect("is TOML");
        let find = |key: &str| settings.iter().find(|setting| setting.key == key);
        let line = |key: &str| find(key).expect("is there").line;
        assert_eq!(line("fit.starts"), Some(2));
        assert_eq!(line("fit.bootstrap"), None);
        assert_eq!(line("compare.trials.d_m.absolute"), Some(4));
        assert!(find("compare.trials.d_m.relative").is_none());
        assert_eq!(line("compare.trials.v_m_s.relative"), None);
        assert_eq!(line("robot.\"a b\".mass_kg"), Some(9));
        // One robot in the configuration replaces all default ones.
        assert!(find("robot.kinematic.h_m").is_none());
        let written: String =
            settings.iter().map(|one| format!("{} = {}\n", one.key, one.value)).collect();
        assert_eq!(Config::parse(&written).expect("is one"), Config::parse(text).expect("is one"));
    }
}
