//! Marker layouts of robots of any number of links.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize, Serializer};

use super::{Config, Markers, link_layout, toml_key};

/// Markers of a link: positions by label, mm, in the frame of the link (see [`Markers`]).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct LinkMarkers(#[serde(with = "link_layout")] pub BTreeMap<String, [f64; 3]>);

/// Marker layout of a robot.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum MarkerLayout {
    ThreeLinks(Markers),
    Chain(ChainMarkers),
}

/// Marker layout of a chain.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainMarkers {
    robot: String,
    /// Names of the links with their markers, by the number of the link.
    links: Vec<(String, LinkMarkers)>,
}

/// Serializes the layout as in the configuration: a table of the links by name.
impl Serialize for ChainMarkers {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.links.iter().map(|(name, markers)| (name, markers)))
    }
}

impl From<Markers> for MarkerLayout {
    fn from(markers: Markers) -> Self {
        Self::ThreeLinks(markers)
    }
}

impl MarkerLayout {
    /// Returns the markers of each link by number.
    pub fn links(&self) -> Vec<&BTreeMap<String, [f64; 3]>> {
        match self {
            Self::ThreeLinks(markers) => markers.links().into(),
            Self::Chain(ChainMarkers { links, .. }) => {
                links.iter().map(|(_, LinkMarkers(markers))| markers).collect()
            }
        }
    }

    /// Returns the name of a link, given its number.
    pub fn name(&self, link: usize) -> &str {
        match self {
            Self::ThreeLinks(_) => ["middle", "front", "rear"][link],
            Self::Chain(ChainMarkers { links, .. }) => &links[link].0,
        }
    }

    /// Returns the table of the configuration that holds the markers of a link, given its number.
    pub fn table_of(&self, link: usize) -> String {
        match self {
            Self::ThreeLinks(_) => format!("markers.link{link}"),
            Self::Chain(ChainMarkers { robot, links }) => link_table(robot, &links[link].0),
        }
    }

    /// Returns the table of the configuration that holds the markers of all links.
    pub fn table(&self) -> String {
        match self {
            Self::ThreeLinks(_) => "[markers]".to_owned(),
            Self::Chain(ChainMarkers { robot, .. }) => format!("[layout.{}]", toml_key(robot)),
        }
    }
}

/// Returns the table of the configuration that holds the markers of a link of a chain.
pub(super) fn link_table(robot: &str, link: &str) -> String {
    format!("layout.{}.{}", toml_key(robot), toml_key(link))
}

impl Config {
    /// Returns the marker layout of a robot; `None` for a chain without a layout and for a robot that is not configured.
    pub fn marker_layout(&self, robot: &str) -> Option<MarkerLayout> {
        let Some(chain) = self.chains.robot.get(robot) else {
            return self.robot.contains_key(robot).then(|| self.markers_of(robot).clone().into());
        };
        let layout = self.chains.layout.get(robot)?;
        let numbering = chain.to_chain(&Default::default()).numbering();
        let names = chain.names();
        let links = numbering.into_iter().map(|place| {
            let name = names[place].clone();
            let markers = layout.get(&name).cloned().unwrap_or_default();
            (name, markers)
        });
        Some(MarkerLayout::Chain(ChainMarkers { robot: robot.to_owned(), links: links.collect() }))
    }

    /// Returns what a chain without a marker layout needs, for messages.
    pub fn needed_layout(&self, robot: &str) -> String {
        let names = self.chains.robot.get(robot).map_or(Vec::new(), |chain| chain.names());
        let tables = names.iter().map(|name| format!("[{}]", link_table(robot, name)));
        format!(
            "a robot whose marker layout is configured: the positions of the markers of robot `{robot}` in {}",
            tables.collect::<Vec<_>>().join(", ")
        )
    }
}
