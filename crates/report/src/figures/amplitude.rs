//! How far the passive joint of a campaign swings.

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

/// Measurements and models of a campaign of which a joint is passive.
pub(super) fn figure(
    stem: &str,
    campaign: &str,
    tables: &Tables,
    config: &ReportInput,
) -> Option<Figure> {
    let joint = config.campaign_setup(campaign)?.1.passive_joint()?;
    let (quantity, source) = ([AMPLITUDE, AMPLITUDE2][joint], tables.source(config));
    let series: Vec<Series> = if joint == 0 {
        let models = source.models(campaign);
        let models = models.iter().filter_map(|of| source.model(campaign, *of, &quantity, 0));
        let measured = source.measured(campaign, &quantity, 0);
        measured.into_iter().chain(models).collect()
    } else {
        // Of this joint the tables have the first harmonic alone, and nothing of models.
        let with_its_own = |trial: &TrialRow| {
            let mut trial = trial.clone();
            trial.metrics.alpha1_rad = trial.gait[joint].amplitude_rad;
            trial.metrics_se.alpha1_rad = trial.gait[joint].amplitude_rad_se;
            trial
        };
        let trials: Vec<TrialRow> = source.measured_trials(campaign).map(with_its_own).collect();
        let fits = tables.fits.iter().filter(|fit| fit.campaign == campaign);
        // Each trial's own gait has no curve.
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
    // The curves of joint 2 are solved for under the command, whatever drove the fits.
    let input = if joint == 0 || input.is_empty() { input } else { "commanded gait".to_owned() };
    let values = context! { campaign, bars => BARS, input, of_trials };
    Some(frequency::figure(stem, texts("alpha", values), &[campaign], &plots))
}
