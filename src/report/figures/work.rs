//! What a metre costs: the actuators' work by the fitted models.

use std::collections::BTreeSet;

use rayon::prelude::*;

use super::common::FREQUENCY;
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
    let panels: Vec<Panel> =
        campaigns.iter().map(panel).filter(|panel| !panel.is_empty()).collect();
    let names: Vec<String> = panels.iter().map(|panel| panel.title.clone()).collect();
    Figure::new(
        stem,
        "Actuators' work per metre of travel",
        "Work of the actuators over a cycle of the steady motion per metre of d, by the fitted \
         models under the commanded gait. Where nothing resists, the actuators give nothing over a \
         cycle; friction of the joints' gears is not in any model.",
        &names.iter().map(String::as_str).collect::<Vec<_>>(),
        Layout::Stack,
        panels,
    )
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
