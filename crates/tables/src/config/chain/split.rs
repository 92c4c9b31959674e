//! Separation of the tables of chains from those of robots with three links, before either are parsed.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Deserializer};
use toml::Spanned;
use toml::de::{DeTable, DeValue, Error};
use trilink_base::Named;
use trilink_robot::Quantity;

use super::super::strict::Strict;
use super::Chains;
use super::deviation::spread;

/// Key of a robot that makes it a chain.
const LINKS: &str = "links";
/// Quantities of a robot with three links that are also keys of a chain.
const SHARED: [Quantity; 2] = [Quantity::Transition, Quantity::Stribeck];

/// Key of a robot with three links in a chain.
struct Misplaced;

impl<'de> Deserialize<'de> for Misplaced {
    fn deserialize<D: Deserializer<'de>>(_: D) -> Result<Self, D::Error> {
        Err(serde::de::Error::custom(
            "invalid key beside `links`, which makes the robot a chain: give the values of each link in `links` and of \
             each joint in `joints` and remove this key, or remove `links` for a robot described by h_m, l_m and b_m",
        ))
    }
}

/// Keys of the links in the marker layout of a robot with three links.
const LINK_KEYS: [&str; 3] = ["link0", "link1", "link2"];

/// Removes the robots with links, the campaigns and marker layouts of these robots and the gaits that only chains can
/// have from a configuration, and parses them. A gait that has no key of chains belongs to them if only their campaigns
/// use it. A layout of an unknown robot belongs to them if it has none of the keys of the robot with three links.
pub(in super::super) fn take_chains(config: &mut DeTable) -> Result<Chains, Error> {
    let mut robots = take(config, "robot", |_, robot| robot.contains_key(LINKS));
    for (_, robot) in robots.iter_mut() {
        if let DeValue::Table(robot) = robot.get_mut() {
            spread(robot)?;
        }
    }
    let campaigns = take(config, "campaign", |_, campaign| {
        text_at(campaign, "robot").is_some_and(|robot| robots.contains_key(robot))
    });
    let used = |campaigns: &DeTable| -> BTreeSet<String> {
        let tables = campaigns.values().filter_map(|campaign| campaign.get_ref().as_table());
        tables.filter_map(|campaign| Some(text_at(campaign, "gait")?.to_owned())).collect()
    };
    let by_chains = used(&campaigns);
    let by_others = config.get("campaign").and_then(|all| all.get_ref().as_table()).map(used);
    let gaits = take(config, "gait", |name, gait| {
        let is_used_by_others = by_others.as_ref().is_some_and(|others| others.contains(name));
        by_chains.contains(name) && !is_used_by_others
            || gait.iter().any(|(key, value)| is_of_chains(key.get_ref(), value.get_ref()))
    });
    let others = config.get("robot").and_then(|all| all.get_ref().as_table());
    let others: BTreeSet<String> =
        others.into_iter().flatten().map(|(name, _)| name.get_ref().to_string()).collect();
    let layouts = take(config, "layout", |name, layout| {
        let is_unknown = !robots.is_empty() && !others.contains(name);
        robots.contains_key(name)
            || is_unknown && !LINK_KEYS.iter().any(|link| layout.contains_key(*link))
    });
    for robot in robots.values().filter_map(|robot| robot.get_ref().as_table()) {
        let is_misplaced =
            |key: &str| Quantity::of_name(key).is_some_and(|quantity| !SHARED.contains(&quantity));
        let misplaced = robot.clone().into_iter().filter(|(key, _)| is_misplaced(key.get_ref()));
        parse::<BTreeMap<String, Misplaced>>(misplaced.collect())?;
    }
    let tables = [("robot", robots), ("campaign", campaigns), ("gait", gaits), ("layout", layouts)];
    let tables =
        tables.map(|(name, table)| (unplaced(name.into()), unplaced(DeValue::Table(table))));
    parse(tables.into_iter().collect())
}

/// Whether only a gait of a chain can have an entry.
fn is_of_chains(key: &str, command: &DeValue) -> bool {
    let number = key.strip_prefix("joint").and_then(|number| number.parse::<usize>().ok());
    let is_torque = |command: &DeTable| {
        ["torque_nm", "mean_nm"].iter().any(|torque| command.contains_key(*torque))
    };
    key == "rotor"
        || number.is_some_and(|number| number > 2)
        || command.as_table().is_some_and(is_torque)
}

/// Removes the entries of a table that `is_taken`, and returns them.
fn take<'t>(
    config: &mut DeTable<'t>,
    table: &str,
    is_taken: impl Fn(&str, &DeTable<'t>) -> bool,
) -> DeTable<'t> {
    let Some(DeValue::Table(entries)) = config.get_mut(table).map(Spanned::get_mut) else {
        return DeTable::new();
    };
    let (taken, others) = std::mem::take(entries).into_iter().partition(|(name, entry)| {
        entry.get_ref().as_table().is_some_and(|entry| is_taken(name.get_ref(), entry))
    });
    *entries = others;
    taken
}

fn text_at<'t>(table: &'t DeTable, key: &str) -> Option<&'t str> {
    table.get(key).and_then(|value| value.get_ref().as_str())
}

fn unplaced<T>(value: T) -> Spanned<T> {
    Spanned::new(0..0, value)
}

fn parse<T: for<'de> Deserialize<'de>>(table: DeTable) -> Result<T, Error> {
    T::deserialize(Strict(toml::Deserializer::from(unplaced(table))))
}
