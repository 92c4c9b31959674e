//! Build targets of a run and the keys that identify their content.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use trilink_fit::FitKey;

/// Kind of a [`Target`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Tables of a trial, named by the trial's id.
    Trial,
    /// Fit of a model to one campaign.
    Fit,
    /// Fit of a model to all campaigns of a robot, or of robots with common wheels.
    SharedFit,
    /// Figure, named after its files without their extension.
    Figure,
    /// Report page of a trial, named by its path in `reports/`.
    Page,
}

/// Unit of an incremental run: a result that a stage can recompute independently of its other results.
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

    /// Returns the target of a fit.
    pub(super) fn from_fit(key: &FitKey) -> Self {
        match key {
            FitKey::Own { campaign, model } => Self::new(Kind::Fit, &format!("{campaign} {model}")),
            FitKey::Shared { robot, model } => {
                Self::new(Kind::SharedFit, &format!("{robot} {model}"))
            }
        }
    }
}

impl Kind {
    /// Returns the noun for a target of this kind.
    pub fn noun(self) -> &'static str {
        match self {
            Self::Trial => "trial",
            Self::Fit => "fit",
            Self::SharedFit => "shared fit",
            Self::Figure => "figure",
            Self::Page => "page",
        }
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{} {}", self.kind.noun(), self.name)
    }
}

/// Key of a target's content: for each input, by name, a short text that identifies its content, usually a hash. The
/// source hash of the stage is stored once per stage, outside the key.
pub(super) type Key = BTreeMap<String, String>;

/// Name of the entry in a [`Key`] that holds the hash of the settings used.
pub(super) const SETTINGS: &str = "the configuration";

/// Returns the reasons why a target made with the key `old` is stale if its key is now `new`; `settings` lists the
/// changes to the configuration.
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
        if settings.is_empty() {
            why.push(format!("{name} {changed}"));
        } else {
            why.extend(settings);
        }
    }
    why
}

/// Lists the changes between two versions of the settings by their dotted keys: `fit.starts changed: 8 to 4`. A table
/// that has no key in common with its earlier version is named as a whole: `robot changed: kinematic to semi-passive`.
pub(super) fn changed_settings(old: &Value, new: &Value) -> Vec<String> {
    let mut changed = Vec::new();
    add_changed("", old, new, &mut changed);
    changed
}

/// Appends to `changed` the differences between `old` and `new`, two versions of the settings below `key`.
fn add_changed(key: &str, old: &Value, new: &Value, changed: &mut Vec<String>) {
    match (old, new) {
        (old, new) if old == new => {}
        (Value::Object(a), Value::Object(b)) if a.keys().any(|name| b.contains_key(name)) => {
            for name in a.keys().chain(b.keys()).collect::<BTreeSet<_>>() {
                let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
                let [old, new] = [a, b].map(|fields| fields.get(name).unwrap_or(&Value::Null));
                add_changed(&key, old, new, changed);
            }
        }
        _ => changed.push(format!("{key} changed: {} to {}", summary(old), summary(new))),
    }
}

/// Formats a setting: a table by its keys, a missing value as "not set".
fn summary(value: &Value) -> String {
    match value {
        Value::Null => "not set".to_owned(),
        Value::Object(fields) => fields.keys().cloned().collect::<Vec<_>>().join(", "),
        other => other.to_string(),
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
    fn every_changed_entry_of_a_key_is_a_reason() {
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
        assert_eq!(
            changed_settings(&old, &new),
            ["fit.starts changed: 8 to 4", "robot changed: a to b"]
        );
        assert!(changed_settings(&old, &old).is_empty());
        let [old, new] = ["0", "1"].map(|hash| parts(&[(SETTINGS, hash)]));
        assert_eq!(reasons(&old, &new, || vec!["fit.seed".to_owned()]), ["fit.seed"]);
        assert_eq!(reasons(&old, &new, Vec::new), ["the configuration changed"]);
    }
}
