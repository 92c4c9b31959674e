//! Marker layouts of robots of any number of links.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize, Serializer};

use super::{Config, GaitConfig, Markers, RobotConfig, link_layout, toml_key};

/// Markers of a link: positions by label, mm, in the frame of the link (see [`Markers`]).
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct LinkMarkers(#[serde(with = "link_layout")] pub BTreeMap<String, [f64; 3]>);

/// Marker layout of a robot.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkerLayout {
    /// Table of the configuration that holds the layout.
    table: String,
    /// Links by their numbers.
    links: Vec<Link>,
}

#[derive(Debug, Clone, PartialEq)]
struct Link {
    name: String,
    /// Key of the link in the table.
    key: String,
    markers: LinkMarkers,
}

/// Serializes the layout as in the configuration: a table of the links.
impl Serialize for MarkerLayout {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.links.iter().map(|link| (&link.key, &link.markers)))
    }
}

impl From<&Markers> for MarkerLayout {
    fn from(markers: &Markers) -> Self {
        let names = RobotConfig::THREE_LINKS.into_iter().zip(Markers::KEYS).zip(markers.links());
        let link = |((name, key), markers): ((&str, &str), &BTreeMap<_, _>)| Link {
            name: name.to_owned(),
            key: key.to_owned(),
            markers: LinkMarkers(markers.clone()),
        };
        Self { table: "markers".to_owned(), links: names.map(link).collect() }
    }
}

impl MarkerLayout {
    /// Returns the markers of each link by number.
    pub fn links(&self) -> Vec<&BTreeMap<String, [f64; 3]>> {
        self.links.iter().map(|link| &link.markers.0).collect()
    }

    /// Returns the name of a link, given its number.
    pub fn name(&self, link: usize) -> &str {
        &self.links[link].name
    }

    /// Returns the table of the configuration that holds the markers of a link, given its number.
    pub fn table_of(&self, link: usize) -> String {
        format!("{}.{}", self.table, toml_key(&self.links[link].key))
    }

    /// Returns the table of the configuration that holds the markers of all links.
    pub fn table(&self) -> String {
        format!("[{}]", self.table)
    }
}

impl RobotConfig {
    /// Returns the keys of the links in a marker layout, from front to rear for a chain.
    pub(super) fn layout_keys(&self) -> Vec<String> {
        match self {
            Self::ThreeLinks(_) => Markers::KEYS.map(str::to_owned).into(),
            Self::Chain(chain) => chain.names(),
        }
    }
}

impl Config {
    /// Returns the marker layout of a robot; `None` for a chain without a layout and for a robot that is not configured.
    pub fn marker_layout(&self, robot: &str) -> Option<MarkerLayout> {
        let config = self.robot.get(robot)?;
        let Some(layout) = self.layout.get(robot) else {
            return config.three_links().map(|_| (&self.markers).into());
        };
        let of = |key: &str| layout.get(key).cloned().unwrap_or_default();
        let links = match config {
            RobotConfig::ThreeLinks(_) => {
                let [link0, link1, link2] = Markers::KEYS.map(|key| of(key).0);
                MarkerLayout::from(&Markers { link0, link1, link2 }).links
            }
            RobotConfig::Chain(chain) => {
                let names = chain.to_chain(&GaitConfig::default()).names_by_number();
                let link = |name: String| Link { markers: of(&name), key: name.clone(), name };
                names.into_iter().map(link).collect()
            }
        };
        Some(MarkerLayout { table: layout_table(robot), links })
    }

    /// Returns what a chain without a marker layout needs, for messages.
    pub fn needed_layout(&self, robot: &str) -> String {
        let links = self.robot.get(robot).map_or(Vec::new(), RobotConfig::layout_keys);
        let table = layout_table(robot);
        let tables = links.iter().map(|key| format!("[{table}.{}]", toml_key(key)));
        format!(
            "a robot whose marker layout is configured: the positions of the markers of robot `{robot}` in {}",
            tables.collect::<Vec<_>>().join(", ")
        )
    }
}

/// Returns the table of the configuration that holds the marker layout of a robot.
pub(super) fn layout_table(robot: &str) -> String {
    format!("layout.{}", toml_key(robot))
}
