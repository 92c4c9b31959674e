//! The figures: which there are, and which of them the tables at hand allow.

mod displacement;
mod fits;
mod models;
mod skid;
mod speed;

use std::collections::BTreeSet;

use super::figure::Figure;
use super::series::Source;
use super::tables::Tables;
use crate::config::Config;

pub const SKEWED: &str = "kinematic-skewed";
pub const SYMMETRIC: &str = "kinematic-symmetric";
pub const SEMI_PASSIVE: &str = "semi-passive-symmetric";
/// The campaigns of the paper, in its order.
pub const PAPER_CAMPAIGNS: [&str; 3] = [SKEWED, SYMMETRIC, SEMI_PASSIVE];

/// Names that the files of the paper's figures can have.
pub const PAPER_STEMS: [&str; 8] =
    ["fig10", "fig13", "fig15", "fig16", "fig17", "fig18", "fig19", "fig20"];

/// Names that the files of all figures of the paper's campaigns can have.
pub fn known_stems() -> Vec<String> {
    let own = PAPER_CAMPAIGNS.iter().flat_map(|campaign| fits::stems(campaign));
    PAPER_STEMS.into_iter().map(str::to_owned).chain(own).collect()
}

const BARS: &str = "Markers: means over the cycles of each trial, flagged trials included; bars: \
                    95 % (1.96 standard errors), where longer than the marker.";

/// Figures to draw and sentences on what is missing.
#[derive(Debug, Default)]
pub struct Figures {
    pub figures: Vec<Figure>,
    pub missing: Vec<String>,
}

/// The paper's figures for its campaigns, and for every other campaign one with what the
/// models predict and one with the wheels' skid; then of every campaign how its fits came about.
pub fn figures(tables: &Tables, config: &Config) -> Figures {
    let (source, configured) = (tables.source(config), &tables.campaigns(config));
    let mut found = Figures::default();
    if PAPER_CAMPAIGNS.iter().any(|campaign| configured.contains(campaign)) {
        found.missing = missing_of_the_paper(source, configured);
        found.figures = vec![
            speed::figure("fig10", SKEWED, source),
            displacement::figure("fig13", SYMMETRIC, source),
            speed::figure("fig15", SEMI_PASSIVE, source),
            models::figure("fig16", SKEWED, source),
            models::figure("fig17", SYMMETRIC, source),
            models::figure("fig18", SEMI_PASSIVE, source),
            skid::figure("fig19", &[SYMMETRIC, SKEWED], source),
            skid::figure("fig20", &[SYMMETRIC, SEMI_PASSIVE], source),
        ];
    }
    let mut stems = BTreeSet::new();
    for campaign in configured.iter().filter(|name| !PAPER_CAMPAIGNS.contains(name)) {
        let name = file_name(campaign, &mut stems);
        let own = [
            models::figure(&format!("{name}-d-v"), campaign, source),
            skid::figure(&format!("{name}-sigma"), &[campaign], source),
        ];
        if own.iter().all(Figure::is_empty) {
            found.missing.push(format!("Campaign {campaign}: nothing to draw, {NOTHING}"));
        }
        found.figures.extend(own);
        found.figures.extend(fits::figures(&name, campaign, tables));
    }
    for campaign in PAPER_CAMPAIGNS.iter().filter(|campaign| configured.contains(*campaign)) {
        found.figures.extend(fits::figures(campaign, campaign, tables));
    }
    found.figures.retain(|figure| !figure.is_empty());
    found
}

const NOTHING: &str = "because it has no trial with results and no prediction.";

fn missing_of_the_paper(source: Source<'_>, configured: &BTreeSet<&str>) -> Vec<String> {
    let absent =
        |campaign: &str| !source.has_measurements(campaign) && source.models(campaign).is_empty();
    let figures = [(SKEWED, "10, 16"), (SYMMETRIC, "13, 17"), (SEMI_PASSIVE, "15, 18")];
    let skid = [(SKEWED, "19"), (SYMMETRIC, "19, 20"), (SEMI_PASSIVE, "20")];
    let mut missing = Vec::new();
    for ((campaign, own), (_, shared)) in figures.into_iter().zip(skid) {
        if absent(campaign) {
            let why = if configured.contains(campaign) {
                NOTHING
            } else {
                "because the configuration does not have it."
            };
            missing.push(format!(
                "Campaign {campaign}: Figs. {own} are not drawn and Fig. {shared} does not show it, {why}"
            ));
        } else if !source.has_measurements(campaign) {
            missing.push(format!(
                "Campaign {campaign}: Figs. {own} show no measurements, because no trial has results."
            ));
        } else if source.models(campaign).is_empty() {
            missing.push(format!(
                "Campaign {campaign}: no model in Figs. {own} and {shared}, because nothing was fitted."
            ));
        }
    }
    missing
}

/// The campaign's name as a file name; a number keeps two that look alike apart.
fn file_name(campaign: &str, taken: &mut BTreeSet<String>) -> String {
    let safe = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '_' };
    let base: String = campaign.chars().map(safe).collect();
    let base = if base.starts_with('.') { format!("_{base}") } else { base };
    let mut name = base.clone();
    let mut number = 2;
    while !taken.insert(name.to_lowercase()) {
        name = format!("{base}-{number}");
        number += 1;
    }
    name
}

/// `Fig. 16` for `fig16`, nothing for figures that the paper does not have.
fn number(stem: &str) -> String {
    let digits = stem.strip_prefix("fig").filter(|_| PAPER_STEMS.contains(&stem));
    digits.map_or(String::new(), |digits| format!("Fig. {digits}"))
}
