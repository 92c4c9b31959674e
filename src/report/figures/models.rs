//! Figs. 16, 17 and 18: displacement and speed, measured and by all models of the campaign.

use super::BARS;
use crate::report::chart::Layout;
use crate::report::figure::{Figure, Panel};
use crate::report::series::{Quantity, Source};

pub fn figure(stem: &str, campaign: &str, source: Source<'_>) -> Figure {
    let models = source.models(campaign);
    let panel = |quantity| {
        let predicted =
            models.iter().filter_map(|model| source.model(campaign, model, quantity, 0));
        let measured = source.measured(campaign, quantity, 0);
        let series = measured.into_iter().chain(predicted).collect();
        Panel { quantity, from_zero: quantity == Quantity::Speed, series }
    };
    let panels = vec![panel(Quantity::Displacement), panel(Quantity::Speed)];
    let shows =
        |model| panels.iter().flat_map(|panel| &panel.series).any(|series| series.name == model);
    let mut caption = format!("{BARS} Lines: the fitted models under the commanded gait.");
    if shows("no-skid-measured") {
        caption.push_str(" Open circles: no-skid under each trial's measured gait.");
    }
    Figure {
        stem: stem.to_owned(),
        number: super::number(stem),
        title: format!("Measurements and models of campaign {campaign}"),
        caption,
        campaigns: vec![campaign.to_owned()],
        panels,
        charts: Vec::new(),
        layout: Layout::Grid,
    }
}
