//! Checks of marker layouts.

use std::collections::BTreeMap;

use trilink_base::pattern::matches_label;

use super::super::marker_layout::layout_table;
use super::super::{Config, ConfigError, LinkMarkers, Markers, toml_key};
use super::Checker;

/// Maximum number of markers on a link: a set of markers is stored as the bits of an integer.
const MAX_MARKERS: usize = u64::BITS as usize;
/// Minimum distance in the plane, mm, between the two markers of a link that are farthest apart; closer markers do not
/// determine the link's heading.
const MIN_SPREAD_MM: f64 = 5.0;

impl Config {
    pub(in super::super) fn check_markers(&self, check: &Checker) -> Result<(), ConfigError> {
        let links = Markers::KEYS.into_iter().zip(self.markers.links());
        let links: Vec<_> = links.map(|(key, link)| (format!("markers.{key}"), link)).collect();
        self.check_links(check, &links)?;
        for (robot, layout) in &self.layout {
            let table = layout_table(robot);
            let config = check.entry(&self.robot, robot, &table)?;
            let keys = config.layout_keys();
            let known: BTreeMap<&String, ()> = keys.iter().map(|key| (key, ())).collect();
            layout.keys().try_for_each(|link| check.entry(&known, &link, &table).map(drop))?;
            let none = LinkMarkers::default();
            let markers = keys.iter().map(|key| &layout.get(key).unwrap_or(&none).0);
            let markers: Vec<&BTreeMap<String, [f64; 3]>> = markers.collect();
            // There are no markers beyond the last link.
            let is_bare = |place: usize| markers.get(place).is_none_or(|link| link.is_empty());
            let mut with_markers = Vec::new();
            for (place, (key, link)) in keys.iter().zip(&markers).enumerate() {
                let table = format!("{table}.{}", toml_key(key));
                if is_bare(place) && config.chain().is_some() {
                    let is_bridged = place > 0 && !is_bare(place - 1) && !is_bare(place + 1);
                    let needed = "2 to 64 markers, because only a link between two links with markers can have none";
                    check.that(is_bridged, &table, &format_args!("none"), needed)?;
                } else {
                    with_markers.push((table, *link));
                }
            }
            self.check_links(check, &with_markers)?;
        }
        Ok(())
    }

    /// Checks the markers of the links of a layout, given the key of each link.
    fn check_links(
        &self,
        check: &Checker,
        links: &[(String, &BTreeMap<String, [f64; 3]>)],
    ) -> Result<(), ConfigError> {
        let mut owners = BTreeMap::new();
        for (key, layout) in links {
            let is_valid_count = (2..=MAX_MARKERS).contains(&layout.len());
            check.that(is_valid_count, key, &layout.len(), "2 to 64 markers")?;
            for label in layout.keys() {
                let ignored = self.vicon.ignore.iter().find(|name| matches_label(name, label));
                let needed = format!("patterns that do not match `{label}` of {key}");
                check.that(
                    ignored.is_none(),
                    "vicon.ignore",
                    &ignored.map_or("", |s| s),
                    &needed,
                )?;
                let earlier = owners.insert(label, key);
                check.that(earlier.is_none(), key, label, "labels that no other link has")?;
            }
            let mut pairs = layout.values().flat_map(|a| layout.values().map(move |b| (a, b)));
            let is_spread = pairs.any(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]) >= MIN_SPREAD_MM);
            let in_metres = layout.values().flatten().all(|x| x.abs() < 1.0);
            let hint = if in_metres { " (are the positions in metres?)" } else { "" };
            let needed =
                format!("two markers at least 5 mm apart in the plane, in millimetres{hint}");
            check.that(is_spread, key, layout, &needed)?;
        }
        Ok(())
    }
}
