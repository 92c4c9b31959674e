//! What a run makes, and what each of it is made of.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use trilink_fit::FitKey;
use trilink_robot::Model;

/// Something that a stage makes and that can be made again alone.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Target {
    /// The tables of a trial, by its id.
    Trial(String),
    /// A model of a campaign.
    Fit { campaign: String, model: Model },
    /// A model of all campaigns of a robot.
    SharedFit { robot: String, model: Model },
    /// By the name of its files without extension.
    Figure(String),
    /// The page of a trial, by its path inside of `reports/`.
    Page(String),
}

impl Target {
    /// What it is, in a word.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Trial(_) => "trial",
            Self::Fit { .. } => "fit",
            Self::SharedFit { .. } => "shared fit",
            Self::Figure(_) => "figure",
            Self::Page(_) => "page",
        }
    }

    /// Which one it is.
    pub fn name(&self) -> String {
        match self {
            Self::Trial(name) | Self::Figure(name) | Self::Page(name) => name.clone(),
            Self::Fit { campaign, model } => format!("{campaign} {model}"),
            Self::SharedFit { robot, model } => format!("{robot} {model}"),
        }
    }
}

impl From<FitKey> for Target {
    fn from(key: FitKey) -> Self {
        match key {
            FitKey::Own { campaign, model } => Self::Fit { campaign, model },
            FitKey::Shared { robot, model } => Self::SharedFit { robot, model },
        }
    }
}

impl Target {
    /// The campaign of a fit.
    pub fn campaign(&self) -> Option<&String> {
        match self {
            Self::Fit { campaign, .. } => Some(campaign),
            _ => None,
        }
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{} {}", self.kind(), self.name())
    }
}

/// What a target is made of: a short text, mostly a hash, by what it is of.
pub(super) type Fingerprint = BTreeMap<String, String>;

/// The part of a fingerprint that stands for the keys of the configuration that are read.
pub(super) const SETTINGS: &str = "the configuration";

/// Why what was made of `old` is not what would be made of `new`; `settings` says what has changed
/// in the configuration.
pub(super) fn reasons(
    old: &Fingerprint,
    new: &Fingerprint,
    settings: impl FnOnce() -> Vec<String>,
) -> Vec<String> {
    let mut why = Vec::new();
    let mut settings = Some(settings);
    for name in old.keys().chain(new.keys()).collect::<BTreeSet<_>>() {
        match (old.get(name), new.get(name)) {
            (old, new) if old == new => {}
            _ if name == SETTINGS => {
                let changed = settings.take().map_or(Vec::new(), |settings| settings());
                match changed.is_empty() {
                    true => why.push(format!("{name} changed")),
                    false => why.extend(changed),
                }
            }
            (Some(_), Some(_)) => why.push(format!("{name} changed")),
            (None, _) => why.push(format!("{name} is new")),
            (_, None) => why.push(format!("{name} is gone")),
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

    fn parts(parts: &[(&str, &str)]) -> Fingerprint {
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
