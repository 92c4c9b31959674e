//! Figure of the passive joint's amplitude against frequency.

use minijinja::context;
use trilink_plot::{Figure, Layer};
use trilink_tables::TrialRow;

use super::common::DEG;
use super::frequency::{self, BARS};
use super::texts::texts;
use crate::ReportInput;
use crate::series::{AMPLITUDE, AMPLITUDE2, Series, Source};
use crate::simulated;
use crate::tables::Tables;

/// Returns the figure of the measured and modelled amplitude of a campaign's passive joint; `None` if no joint is
/// passive.
pub(super) fn figure(
    stem: &str,
    campaign: &str,
    tables: &Tables,
    config: &ReportInput,
) -> Option<Figure> {
    let joint = config.campaign_setup(campaign)?.1.passive_joint()?;
    let quantity = [AMPLITUDE, AMPLITUDE2][joint];
    let source = tables.source(config);
    let series: Vec<Series> = if joint == 0 {
        let models = source.models(campaign);
        let models = models.iter().filter_map(|of| source.model(campaign, *of, &quantity, 0));
        let measured = source.measured(campaign, &quantity, 0);
        measured.into_iter().chain(models).collect()
    } else {
        // For joint 2, the tables contain only the measured first harmonic; they contain no predictions.
        let trials: Vec<TrialRow> = source
            .measured_trials(campaign)
            .map(|trial| {
                let mut trial = trial.clone();
                trial.metrics.alpha_rad[joint] = trial.gait[joint].amplitude_rad;
                trial.metrics_se.alpha_rad[joint] = trial.gait[joint].amplitude_rad_se;
                trial
            })
            .collect();
        let fits = tables.fits.iter().filter(|fit| fit.campaign == campaign);
        // Models that are driven by the measured gait of each trial have no prediction curve.
        let fits = fits.filter(|fit| !source.is_of_trials(fit.model));
        let models = fits.map(|fit| {
            let curve = simulated::curve(tables, config, fit, |solver, problem| {
                simulated::amplitude_rad(solver, problem, joint).map(|rad| DEG * rad)
            });
            let layer = Layer::new(fit.model.name(), curve, source.look(fit.model).line());
            Series { campaign: campaign.to_owned(), model: Some(fit.model), flagged: false, layer }
        });
        let measured = Source { trials: &trials, ..source }.measured(campaign, &quantity, 0);
        measured.into_iter().chain(models).collect()
    };
    let plots = [(quantity, series)];
    let (input, of_trials) = frequency::drivers(&plots, source);
    // The curves for joint 2 are solved under the commanded gait, whatever the gait input of the fits.
    let input = if joint == 0 || input.is_empty() { input } else { "commanded gait".to_owned() };
    let values = context! { campaign, bars => BARS, input, of_trials };
    Some(frequency::figure(stem, texts("alpha", values), &[campaign], &plots))
}
