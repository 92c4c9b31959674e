//! What the report reads of the configuration.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use serde::Serialize;

use crate::config::{Campaign, Config, Paths, SigmaKind};
use crate::robot::{Gait, Robot};

/// What a report is made with. Serialised it is the configuration that the page prints, which
/// decides all else.
#[derive(Debug, Clone, Serialize)]
pub struct ReportInput {
    #[serde(skip)]
    pub paths: Paths,
    #[serde(skip)]
    pub sigma: SigmaKind,
    /// With paths as seen from the page.
    #[serde(flatten)]
    shown: Config,
}

impl ReportInput {
    pub fn new(config: &Config) -> Self {
        let mut shown = config.clone();
        let Paths { raw, derived, reports } = &mut shown.paths;
        for path in [raw, derived, reports] {
            *path = relative(&config.paths.reports, path).into();
        }
        Self { paths: config.paths.clone(), sigma: config.fit.sigma, shown }
    }

    pub fn campaigns(&self) -> &BTreeMap<String, Campaign> {
        &self.shown.campaign
    }

    /// The robot and gait of a campaign, in SI units; `None` where an entry is missing.
    pub fn campaign_setup(&self, campaign: &str) -> Option<(Robot, Gait)> {
        self.shown.campaign_setup(campaign)
    }

    /// The configuration as TOML, defaults too.
    pub fn configuration(&self) -> String {
        toml::to_string(&self.shown).unwrap_or_default()
    }
}

/// `to` as seen from the folder `from`; as it is where one of them is absolute and the other
/// not, or where `from` climbs.
pub fn relative(from: &Path, to: &Path) -> String {
    let plain = |path: &Path| -> PathBuf {
        path.components().filter(|part| *part != Component::CurDir).collect()
    };
    let (from, to) = (plain(from), plain(to));
    let common = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let rest: Vec<_> = from.components().skip(common).collect();
    let climbs = rest.iter().any(|part| !matches!(part, Component::Normal(_)));
    let path = if climbs || from.is_absolute() != to.is_absolute() {
        to
    } else {
        rest.iter().map(|_| Component::ParentDir).chain(to.components().skip(common)).collect()
    };
    path.to_string_lossy().replace('\\', "/")
}

#[cfg(test)]
mod tests {
    use super::relative;
    use std::path::Path;

    #[test]
    fn paths_are_as_seen_from_the_page() {
        let from_to = |from, to| relative(Path::new(from), Path::new(to));
        assert_eq!(from_to("reports", "derived"), "../derived");
        assert_eq!(from_to("./a/reports", "a/raw/demo"), "../raw/demo");
        assert_eq!(from_to("/data/x/reports", "/data/x/derived"), "../derived");
        assert_eq!(from_to("../reports", "derived"), "derived");
    }
}
