//! Planted truth against what the program made of the trials that were computed from it.

use super::common::OMEGA;
use crate::metrics::Estimate;
use crate::report::drawing::{Figure, Layer, Look, Panel, Range, Scale};
use crate::report::looks;
use crate::report::series::{BAR_STANDARD_ERRORS, Source};
use crate::report::tables::Tables;
use crate::report::truth::{self, PlantedTrial, Truth};
use crate::store::TrialRow;

/// The figure; empty without trials and coefficients of which the truth is known.
pub fn figure(stem: &str, truth: &Truth, tables: &Tables, source: Source<'_>) -> Figure {
    let coefficients = coefficients(truth, tables);
    let d = missed(
        truth,
        source,
        "d",
        |trial| Estimate::new(trial.metrics.d_m, trial.metrics_se.d_m),
        |planted| planted.d_m,
    );
    let alpha = missed(
        truth,
        source,
        "α₁",
        |trial| Estimate::new(trial.metrics.alpha1_rad, trial.metrics_se.alpha1_rad),
        |planted| planted.alpha1_rad,
    );
    let skid = [0, 1, 2].map(|wheel| {
        missed(
            truth,
            source,
            ["σ₀", "σ₁", "σ₂"][wheel],
            move |trial| trial.sigma(source.sigma)[wheel],
            move |planted| planted.sigma.map(|sigma| sigma[wheel]),
        )
    });
    let all = [coefficients, d, alpha].into_iter().chain(skid);
    let panels = all.filter(|panel| !panel.is_empty()).collect();
    let campaigns = super::campaigns_of(source);
    Figure {
        caption: "Coefficients: fitted skid-roll model against what was planted, with 95 % \
                  intervals; a point on the line is right. The others: measured less planted, in \
                  parts of the latter, with bars of 1.96 standard errors."
            .to_owned(),
        ..Figure::new(stem, "Planted and recovered".to_owned(), &campaigns, panels)
    }
}

fn coefficients(truth: &Truth, tables: &Tables) -> Panel {
    let known: Vec<_> = truth::planted(truth, tables)
        .into_iter()
        .filter(|known| known.parameter.free && known.planted > 0.0)
        .collect();
    let mut campaigns: Vec<&str> = known.iter().map(|known| known.campaign).collect();
    campaigns.dedup();
    let Some(Range { low, high }) =
        Range::of(known.iter().flat_map(|known| [known.planted, known.parameter.value]))
    else {
        return Panel::default();
    };
    let planted = Layer::new("planted", [(low, low), (high, high)], looks::COMMANDED);
    let layers = campaigns.iter().enumerate().map(|(nth, campaign)| {
        let of_campaign = known.iter().filter(|known| known.campaign == *campaign);
        let points = of_campaign.map(|known| {
            let half = 0.5 * (known.parameter.limits[1] - known.parameter.limits[0]);
            (known.planted, known.parameter.value, half)
        });
        Layer::with_errors(campaign, points, looks::campaign(nth))
    });
    Panel {
        x_scale: Scale::Decades,
        y_scale: Scale::Decades,
        ..Panel::new(
            "Coefficients",
            "Planted",
            "Recovered",
            [planted].into_iter().chain(layers).collect(),
        )
    }
}

fn missed(
    truth: &Truth,
    source: Source<'_>,
    name: &str,
    measured: impl Fn(&TrialRow) -> Estimate,
    planted: impl Fn(&PlantedTrial) -> Option<f64>,
) -> Panel {
    let layer = |(nth, campaign): (usize, &str)| {
        let point = |trial: &TrialRow| {
            let planted = planted(truth.trials.get(&trial.trial)?).filter(|value| *value > 0.0)?;
            let Estimate { value, se } = measured(trial);
            let half = 100.0 * BAR_STANDARD_ERRORS * se / planted;
            let difference = 100.0 * (value / planted - 1.0);
            value.is_finite().then_some((trial.omega_rad_s, difference, half))
        };
        let points = source.measured_trials(campaign).filter_map(point);
        Layer::with_errors(campaign, points, looks::campaign(nth))
    };
    let level = Layer::new("planted", [(f64::NAN, 0.0)], Look::Guides);
    let campaigns = super::campaigns_of(source);
    let layers = [level].into_iter().chain(campaigns.into_iter().enumerate().map(layer)).collect();
    Panel::new(name, OMEGA, "Difference (%)", layers)
}
