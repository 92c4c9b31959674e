//! Figure of the actuators' work per metre of travel, as predicted by the fitted models.

use std::collections::BTreeSet;

use minijinja::context;
use trilink_plot::{Figure, Layer, Layout, Panel};

use super::common::FREQUENCY;
use super::texts::texts;
use crate::ReportInput;
use crate::simulated;
use crate::tables::Tables;

/// Returns the figure of the work per metre of travel that the fitted models predict, with one panel per campaign.
pub(super) fn figure(stem: &str, tables: &Tables, config: &ReportInput) -> Figure {
    let source = tables.source(config);
    let campaigns: BTreeSet<&str> = tables.fits.iter().map(|fit| fit.campaign.as_str()).collect();
    let panel = |campaign: &&str| {
        let fits = tables.fits.iter().filter(|fit| fit.campaign == *campaign);
        // Models that are driven by the measured gait of each trial have no prediction curve.
        let fits = fits.filter(|fit| !source.is_of_trials(fit.model));
        let layers = fits.map(|fit| {
            let look = source.look(fit.model).line();
            let curve = simulated::curve(tables, config, fit, simulated::work_j_m);
            Layer::new(fit.model.name(), curve, look)
        });
        Panel::new(*campaign, FREQUENCY, "Work per metre (J/m)", layers.collect())
    };
    let panels = campaigns.iter().map(|campaign| (*campaign, panel(campaign)));
    let (campaigns, panels): (Vec<&str>, Vec<Panel>) =
        panels.filter(|(_, panel)| !panel.is_empty()).unzip();
    Figure::new(stem, texts("work", context! {}), &campaigns, Layout::Stack, panels)
}
