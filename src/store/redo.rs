//! What a stage has to do again, and why.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Parts;

/// Part of what things are made of: the version of the stage.
pub const VERSION: &str = "version";
/// The same: the keys of the configuration that are read.
pub const CONFIGURATION: &str = "the configuration";

/// How a plan is made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct How {
    /// Redo all.
    pub force: bool,
    /// Read files again whose size and time have not changed.
    pub verify: bool,
}

impl How {
    /// Redo all, as who asks for a single stage means it.
    pub const FORCE: Self = Self { force: true, verify: false };
}

/// What a stage has to do again.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Redo {
    /// `trial`, `fit` or `figure`.
    kind: &'static str,
    pub things: Vec<Planned>,
    pub up_to_date: usize,
    /// Things that are there and should no longer be.
    pub removed: Vec<String>,
    /// Why files of the stage as a whole are looked at again, if no thing says so.
    pub whole: Vec<String>,
}

/// A thing to do again.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Planned {
    pub name: String,
    pub why: Vec<String>,
}

impl Redo {
    /// Nothing planned of things of this kind.
    pub fn new(kind: &'static str) -> Self {
        Self { kind, ..Self::default() }
    }

    /// Adds a thing; without a reason it is up to date.
    pub fn add(&mut self, name: &str, why: Vec<String>) {
        match why.is_empty() {
            true => self.up_to_date += 1,
            false => self.things.push(Planned { name: name.to_owned(), why }),
        }
    }

    /// What a thing of that name is; pages have their folder in their names.
    pub fn kind(&self, name: &str) -> &'static str {
        if self.kind == "figure" && name.contains('/') { "page" } else { self.kind }
    }

    /// Whether all is up to date.
    pub fn is_empty(&self) -> bool {
        self.things.is_empty() && self.removed.is_empty() && self.whole.is_empty()
    }

    /// Names of the things.
    pub fn names(&self) -> Vec<String> {
        self.things.iter().map(|planned| planned.name.clone()).collect()
    }
}

/// Why a thing made of `old` parts is not one made of `new`; `settings` says what has changed in
/// the configuration.
pub fn reasons(old: &Parts, new: &Parts, settings: impl FnOnce() -> Vec<String>) -> Vec<String> {
    let mut why = Vec::new();
    let mut settings = Some(settings);
    let names: std::collections::BTreeSet<&String> = old.keys().chain(new.keys()).collect();
    for name in names {
        match (old.get(name), new.get(name)) {
            (old, new) if old == new => {}
            _ if name == CONFIGURATION => {
                let changed = settings.take().map_or(Vec::new(), |settings| settings());
                match changed.is_empty() {
                    true => why.push(format!("{name} changed")),
                    false => why.extend(changed),
                }
            }
            (Some(old), Some(new)) if name == VERSION => {
                why.push(format!("the stage is of version {new}, was {old}"));
            }
            (Some(_), Some(_)) => why.push(format!("{name} changed")),
            (None, _) => why.push(format!("{name} is new")),
            (_, None) => why.push(format!("{name} is gone")),
        }
    }
    why
}

/// Keys and values of anything that can be serialised, by dotted names.
pub fn flatten(value: &impl Serialize) -> BTreeMap<String, String> {
    let mut flat = BTreeMap::new();
    let value = serde_json::to_value(value).unwrap_or_default();
    add_flat(String::new(), &value, &mut flat);
    flat
}

fn add_flat(key: String, value: &serde_json::Value, flat: &mut BTreeMap<String, String>) {
    match value {
        serde_json::Value::Object(fields) => {
            for (name, field) in fields {
                let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
                add_flat(key, field, flat);
            }
        }
        other => {
            flat.insert(key, other.to_string());
        }
    }
}

/// What has changed in the configuration under any of `prefixes`: `fit.starts: 8 -> 4`.
pub fn changed_settings(
    old: &BTreeMap<String, String>,
    new: &BTreeMap<String, String>,
    prefixes: &[String],
) -> Vec<String> {
    let keys: std::collections::BTreeSet<&String> = old.keys().chain(new.keys()).collect();
    let read = keys.into_iter().filter(|key| prefixes.iter().any(|prefix| key.starts_with(prefix)));
    let value = |from: &BTreeMap<String, String>, key: &str| {
        from.get(key).cloned().unwrap_or_else(|| "not there".to_owned())
    };
    read.filter(|key| old.get(*key) != new.get(*key))
        .map(|key| format!("{key}: {} -> {}", value(old, key), value(new, key)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(parts: &[(&str, &str)]) -> Parts {
        parts.iter().map(|(name, part)| ((*name).to_owned(), (*part).to_owned())).collect()
    }

    #[test]
    fn every_part_that_differs_is_a_reason() {
        let old = parts(&[(VERSION, "1"), ("trial a", "0"), ("trial b", "0"), ("the file", "0")]);
        let new = parts(&[(VERSION, "2"), ("trial b", "0"), ("trial c", "0"), ("the file", "1")]);
        assert_eq!(
            reasons(&old, &new, Vec::new),
            [
                "the file changed",
                "trial a is gone",
                "trial c is new",
                "the stage is of version 2, was 1",
            ]
        );
        assert!(reasons(&old, &old, || panic!("nothing has changed")).is_empty());
    }

    #[test]
    fn a_change_of_the_configuration_is_told_by_the_keys_that_are_read() {
        let config = |starts: usize, seed: usize| serde_json::json!({ "fit": { "starts": starts, "seed": seed }, "vicon": { "x": [1] } });
        let (old, new) = (flatten(&config(8, 1)), flatten(&config(4, 2)));
        let changed = |prefix: &str| changed_settings(&old, &new, &[prefix.to_owned()]);
        assert_eq!(changed("fit."), ["fit.seed: 1 -> 2", "fit.starts: 8 -> 4"]);
        assert_eq!(changed("fit.s"), changed("fit."));
        assert!(changed("vicon.").is_empty());
        let [old, new] = ["0", "1"].map(|hash| parts(&[(CONFIGURATION, hash)]));
        assert_eq!(reasons(&old, &new, || changed("fit.starts")), ["fit.starts: 8 -> 4"]);
        assert_eq!(reasons(&old, &new, Vec::new), ["the configuration changed"]);
    }
}
