//! What a run makes, and what each of it is made of.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use trilink_fit::FitKey;

/// What a target is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The tables of a trial, by its id.
    Trial,
    /// A model of a campaign.
    Fit,
    /// A model of all campaigns of a robot.
    SharedFit,
    /// By the name of its files without extension.
    Figure,
    /// The page of a trial, by its path inside of `reports/`.
    Page,
}

/// Something that a stage makes and that can be made again alone.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Target {
    pub kind: Kind,
    pub name: String,
}

impl Target {
    pub(super) fn new(kind: Kind, name: &str) -> Self {
        Self { kind, name: name.to_owned() }
    }

    pub(super) fn of_fit(key: &FitKey) -> Self {
        match key {
            FitKey::Own { campaign, model } => Self::new(Kind::Fit, &format!("{campaign} {model}")),
            FitKey::Shared { robot, model } => {
                Self::new(Kind::SharedFit, &format!("{robot} {model}"))
            }
        }
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let kind = match self.kind {
            Kind::Trial => "trial",
            Kind::Fit => "fit",
            Kind::SharedFit => "shared fit",
            Kind::Figure => "figure",
            Kind::Page => "page",
        };
        write!(f, "{kind} {}", self.name)
    }
}

/// The key of a target's content: a short text, mostly a hash, by what it is of. The source of its
/// stage is beside it in the record.
pub(super) type Key = BTreeMap<String, String>;

/// The part of a key that stands for the keys of the configuration that are read.
pub(super) const SETTINGS: &str = "the configuration";

/// Why what was made by the key `old` is not what would be made by `new`; `settings` says what has
/// changed in the configuration.
pub(super) fn reasons(old: &Key, new: &Key, settings: impl Fn() -> Vec<String>) -> Vec<String> {
    let mut why = Vec::new();
    for name in old.keys().chain(new.keys()).collect::<BTreeSet<_>>() {
        let changed = match (old.get(name), new.get(name)) {
            (old, new) if old == new => continue,
            (Some(_), Some(_)) => "changed",
            (None, _) => "is new",
            (_, None) => "is gone",
        };
        let settings = if name == SETTINGS { settings() } else { Vec::new() };
        match settings.is_empty() {
            true => why.push(format!("{name} {changed}")),
            false => why.extend(settings),
        }
    }
    why
}

/// What has changed in settings, by the dotted names of their keys: `fit.starts: 8 -> 4`. A table
/// of which no key stays is named as a whole: `robot: kinematic -> semi-passive`.
pub(super) fn changed_settings(old: &Value, new: &Value) -> Vec<String> {
    let mut changed = Vec::new();
    add_changed("", old, new, &mut changed);
    changed
}

fn add_changed(key: &str, old: &Value, new: &Value, changed: &mut Vec<String>) {
    let text = |value: &Value| match value {
        Value::Null => "not there".to_owned(),
        Value::Object(fields) => fields.keys().cloned().collect::<Vec<_>>().join(", "),
        other => other.to_string(),
    };
    match (old, new) {
        (old, new) if old == new => {}
        (Value::Object(a), Value::Object(b)) if a.keys().any(|name| b.contains_key(name)) => {
            for name in a.keys().chain(b.keys()).collect::<BTreeSet<_>>() {
                let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
                let [old, new] = [a, b].map(|fields| fields.get(name).unwrap_or(&Value::Null));
                add_changed(&key, old, new, changed);
            }
        }
        _ => changed.push(format!("{key}: {} -> {}", text(old), text(new))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn parts(parts: &[(&str, &str)]) -> Key {
        parts.iter().map(|(name, part)| ((*name).to_owned(), (*part).to_owned())).collect()
    }

    #[test]
    fn every_part_that_differs_is_a_reason() {
        let old = parts(&[("trial a", "0"), ("trial b", "0"), ("the file", "0")]);
        let new = parts(&[("trial b", "0"), ("trial c", "0"), ("the file", "1")]);
        assert_eq!(
            reasons(&old, &new, Vec::new),
            ["the file changed", "trial a is gone", "trial c is new"]
        );
        assert!(reasons(&old, &old, || panic!("nothing has changed")).is_empty());
    }

    #[test]
    fn changed_settings_are_named_by_their_keys() {
        let old = json!({ "fit": { "starts": 8, "seed": 1 }, "robot": { "a": { "h_m": 1.0 } } });
        let new = json!({ "fit": { "starts": 4, "seed": 1 }, "robot": { "b": { "h_m": 1.0 } } });
        assert_eq!(changed_settings(&old, &new), ["fit.starts: 8 -> 4", "robot: a -> b"]);
        assert!(changed_settings(&old, &old).is_empty());
        let [old, new] = ["0", "1"].map(|hash| parts(&[(SETTINGS, hash)]));
        assert_eq!(reasons(&old, &new, || vec!["fit.seed".to_owned()]), ["fit.seed"]);
        assert_eq!(reasons(&old, &new, Vec::new), ["the configuration changed"]);
    }
}
