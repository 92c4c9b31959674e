//! What a metre costs: the actuators' work by the fitted models.

use std::collections::BTreeSet;

use minijinja::context;
use rayon::prelude::*;

use super::common::FREQUENCY;
use super::texts::texts;
use crate::motion::{Model, Solver};
use crate::report::ReportInput;
use crate::report::drawing::{Figure, Layer, Layout, Panel};
use crate::report::looks;
use crate::report::simulated;
use crate::report::tables::Tables;
use crate::store::{FitRow, PredictionSource};

/// Every so many of the curves' frequencies, and of very many so many.
const STRIDE: usize = 2;
const MOST: usize = 100;

/// One panel for each campaign that has a fitted model.
pub fn figure(stem: &str, tables: &Tables, config: &ReportInput) -> Figure {
    let campaigns: BTreeSet<&str> = tables.fits.iter().map(|fit| fit.campaign.as_str()).collect();
    let panel = |campaign: &&str| {
        let fits = tables.fits.iter().filter(|fit| fit.campaign == *campaign);
        // Each trial's own gait has no curve.
        let fits = fits.filter(|fit| fit.model != Model::NoSkidMeasured);
        let layers = fits.map(|fit| {
            let look = looks::model_line(fit.model);
            Layer::new(fit.model.name(), curve(fit, tables, config), look)
        });
        Panel::new(*campaign, FREQUENCY, "Work per metre (J/m)", layers.collect())
    };
    let panels = campaigns.iter().map(|campaign| (*campaign, panel(campaign)));
    let (campaigns, panels): (Vec<&str>, Vec<Panel>) =
        panels.filter(|(_, panel)| !panel.is_empty()).unzip();
    Figure::new(stem, texts("work", context! {}), &campaigns, Layout::Stack, panels)
}

/// Frequency and work of a fitted model, broken where it has no stable motion.
fn curve(fit: &FitRow, tables: &Tables, config: &ReportInput) -> Vec<(f64, f64)> {
    let curve = tables.source(config).predicted(&fit.campaign, fit.model, PredictionSource::Curve);
    let omegas = curve.map(|row| row.omega_rad_s);
    let mut omegas: Vec<f64> =
        omegas.filter(|omega| simulated::OMEGAS_RAD_S.contains(omega)).collect();
    omegas.sort_by(f64::total_cmp);
    let point = |omega_rad_s: f64| {
        let work_j_m = simulated::fitted(config, fit, omega_rad_s)
            .and_then(|problem| simulated::work_j_m(&mut Solver::default(), &problem));
        (omega_rad_s, work_j_m.unwrap_or(f64::NAN))
    };
    let stride = STRIDE.max(omegas.len().div_ceil(MOST));
    omegas.into_par_iter().step_by(stride).map(point).collect()
}
