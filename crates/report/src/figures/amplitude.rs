//! Figure of the amplitudes of passive joints against frequency.

use minijinja::context;
use trilink_plot::{Figure, Layer};
use trilink_robot::metrics::Metric;
use trilink_tables::TrialRow;

use super::common::DEG;
use super::frequency::{self, BARS, Plot};
use super::texts::texts;
use crate::ReportInput;
use crate::series::{Quantity, Series, Source};
use crate::simulated;
use crate::tables::Tables;

/// Returns the figure of the measured and modelled amplitude of a campaign's passive joint, or of each joint of a chain
/// whose angle is not commanded; `None` if there is no such joint.
pub(super) fn figure(
    stem: &str,
    campaign: &str,
    tables: &Tables,
    config: &ReportInput,
) -> Option<Figure> {
    let source = tables.source(config);
    let joints = config.free_joints(campaign);
    let is_chain = config.is_chain(campaign);
    let is_second = joints == [1] && !is_chain;
    let plots: Vec<Plot> = joints
        .iter()
        .map(|joint| {
            let quantity = Quantity::new(Metric::ALPHA[*joint]);
            let series = if is_second {
                of_second_joint(campaign, &quantity, tables, config)
            } else {
                let models = source.models(campaign).into_iter();
                let models = models.filter_map(|of| source.model(campaign, of, &quantity, 0));
                source.measured(campaign, &quantity, 0).into_iter().chain(models).collect()
            };
            (quantity, series)
        })
        .collect();
    let (input, of_trials) = frequency::drivers(&plots, source);
    // The curves for joint 2 of three links are solved under the commanded gait, whatever the gait input of the fits.
    let is_commanded = is_second && !input.is_empty();
    let input = if is_commanded { "commanded gait".to_owned() } else { input };
    let values = context! { campaign, bars => BARS, input, of_trials, is_chain };
    let figure = frequency::figure(stem, texts("alpha", values), &[campaign], &plots);
    (!joints.is_empty()).then_some(figure)
}

/// Returns the series of the amplitude of joint 2 of a robot of three links, of which the tables contain only the
/// measured first harmonic and no predictions.
fn of_second_joint(
    campaign: &str,
    quantity: &Quantity,
    tables: &Tables,
    config: &ReportInput,
) -> Vec<Series> {
    const JOINT: usize = 1;
    let source = tables.source(config);
    let trials: Vec<TrialRow> = source
        .measured_trials(campaign)
        .map(|trial| {
            let mut trial = trial.clone();
            trial.metrics.alpha_rad[JOINT] = trial.gait[JOINT].amplitude_rad;
            trial.metrics_se.alpha_rad[JOINT] = trial.gait[JOINT].amplitude_rad_se;
            trial
        })
        .collect();
    let fits = tables.fits.iter().filter(|fit| fit.campaign == campaign);
    // Models that are driven by the measured gait of each trial have no prediction curve.
    let fits = fits.filter(|fit| !source.is_of_trials(fit.model));
    let models = fits.map(|fit| {
        let curve = simulated::curve(tables, config, fit, |problem| {
            simulated::amplitude_rad(problem, JOINT).map(|rad| DEG * rad)
        });
        let layer = Layer::new(fit.model.name(), curve, source.look(fit.model).line());
        Series { campaign: campaign.to_owned(), model: Some(fit.model), flagged: false, layer }
    });
    let measured = Source { trials: &trials, ..source }.measured(campaign, quantity, 0);
    measured.into_iter().chain(models).collect()
}
