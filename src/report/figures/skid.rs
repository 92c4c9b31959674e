//! Figs. 19 and 20: the wheels' skid ratios of two campaigns, measured and by `skid-roll`.

use super::BARS;
use crate::config::SigmaKind;
use crate::report::chart::Layout;
use crate::report::figure::{Figure, Panel};
use crate::report::series::{Quantity, Series, Source};

const MODEL: &str = "skid-roll";

pub fn figure(stem: &str, campaigns: &[&str], source: Source<'_>) -> Figure {
    let panel = |wheel| {
        let quantity = Quantity::Skid(wheel);
        let series = campaigns.iter().enumerate().flat_map(|(nth, campaign)| {
            let both = [
                source.measured(campaign, quantity, nth),
                source.model(campaign, MODEL, quantity, nth),
            ];
            both.into_iter().flatten()
        });
        let label = |series: Series| Series {
            label: format!("{}, {}", series.campaign, series.name),
            ..series
        };
        Panel { quantity, from_zero: true, series: series.map(label).collect() }
    };
    Figure {
        stem: stem.to_owned(),
        number: super::number(stem),
        title: match campaigns {
            [one] => format!("Skid ratios of campaign {one}"),
            several => format!("Skid ratios of campaigns {}", several.join(" and ")),
        },
        caption: format!(
            "Skid ratio σ (eq. 20): RMS skid speed of a wheel over lω{}. {BARS} Lines: the fitted model {MODEL}.",
            match source.sigma {
                SigmaKind::Raw => ", the markers' noise included",
                SigmaKind::Debiased => ", without the noise power",
            }
        ),
        campaigns: campaigns.iter().map(|&campaign| campaign.to_owned()).collect(),
        panels: [0, 1, 2].map(panel).into(),
        charts: Vec::new(),
        layout: Layout::Grid,
    }
}
