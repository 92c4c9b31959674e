//! Figs. 10 and 15: the measured mean speed.

use super::BARS;
use crate::report::chart::Layout;
use crate::report::figure::{Figure, Panel};
use crate::report::series::{Quantity, Source};

pub fn figure(stem: &str, campaign: &str, source: Source<'_>) -> Figure {
    let quantity = Quantity::Speed;
    Figure {
        stem: stem.to_owned(),
        number: super::number(stem),
        title: format!("Mean speed v of campaign {campaign}"),
        caption: BARS.to_owned(),
        campaigns: vec![campaign.to_owned()],
        panels: vec![Panel {
            quantity,
            from_zero: true,
            series: source.measured(campaign, quantity, 0).into_iter().collect(),
        }],
        charts: Vec::new(),
        layout: Layout::Grid,
    }
}
