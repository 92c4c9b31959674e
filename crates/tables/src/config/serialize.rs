//! Serialization of the configuration, with the tables of chains among those of the other robots.

use std::collections::BTreeMap;

use serde::ser::SerializeStruct as _;
use serde::{Serialize, Serializer};

use super::Config;

/// Entry of a table that holds those of chains, too.
#[derive(Serialize)]
#[serde(untagged)]
enum Entry<'c, A, B> {
    ThreeLinks(&'c A),
    Chain(&'c B),
}

/// Returns the table of both kinds of entries.
fn joined<'c, A, B>(
    others: &'c BTreeMap<String, A>,
    chains: &'c BTreeMap<String, B>,
) -> BTreeMap<&'c String, Entry<'c, A, B>> {
    let others = others.iter().map(|(name, entry)| (name, Entry::ThreeLinks(entry)));
    others.chain(chains.iter().map(|(name, entry)| (name, Entry::Chain(entry)))).collect()
}

impl Serialize for Config {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self {
            paths,
            vicon,
            ingest,
            fit,
            robot,
            gait,
            model,
            campaign,
            markers,
            layout,
            report,
            compare,
            optimise,
            chains,
        } = self;
        let mut config = serializer.serialize_struct("Config", 13)?;
        config.serialize_field("paths", paths)?;
        config.serialize_field("vicon", vicon)?;
        config.serialize_field("ingest", ingest)?;
        config.serialize_field("fit", fit)?;
        config.serialize_field("robot", &joined(robot, &chains.robot))?;
        config.serialize_field("gait", &joined(gait, &chains.gait))?;
        config.serialize_field("model", model)?;
        config.serialize_field("campaign", &joined(campaign, &chains.campaign))?;
        config.serialize_field("markers", markers)?;
        let layout = joined(layout, &chains.layout);
        if !layout.is_empty() {
            config.serialize_field("layout", &layout)?;
        }
        config.serialize_field("report", report)?;
        config.serialize_field("compare", compare)?;
        config.serialize_field("optimise", optimise)?;
        config.end()
    }
}
