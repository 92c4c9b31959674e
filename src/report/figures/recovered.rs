//! Planted truth against what the program made of the trials that were computed from it.

use super::parts::OMEGA;
use crate::report::chart::{Axes, Chart, Layer, Layout};
use crate::report::figure::Figure;
use crate::report::series::{BAR_STANDARD_ERRORS, Source};
use crate::report::style::{self, Shape};
use crate::report::tables::Tables;
use crate::report::truth::{self, PlantedTrial, Truth};
use crate::store::TrialRow;

/// The figure; empty without trials and coefficients of which the truth is known.
pub fn figure(stem: &str, truth: &Truth, tables: &Tables, source: Source<'_>) -> Figure {
    let coefficients = coefficients(truth, tables);
    let d = missed(truth, source, "d", |trial| (trial.d_m, trial.d_m_se), |planted| planted.d_m);
    let alpha = missed(
        truth,
        source,
        "α₁",
        |trial| (trial.alpha1_rad, trial.alpha1_rad_se),
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
    let charts: Vec<Chart> = [coefficients, d, alpha]
        .into_iter()
        .chain(skid)
        .filter(|chart| !chart.is_empty())
        .collect();
    let campaigns = super::campaigns_of(source);
    Figure {
        caption: "Coefficients: fitted skid-roll model against what was planted, with 95 % \
                  intervals; a point on the line is right. The others: measured less planted, in \
                  parts of the latter, with bars of 1.96 standard errors."
            .to_owned(),
        layout: Layout::Grid,
        ..Figure::of_charts(stem, "Planted and recovered".to_owned(), &campaigns, charts)
    }
}

fn coefficients(truth: &Truth, tables: &Tables) -> Chart {
    let known: Vec<_> = truth::planted(truth, tables)
        .into_iter()
        .filter(|known| known.parameter.free && known.planted > 0.0)
        .collect();
    let mut campaigns: Vec<&str> = known.iter().map(|known| known.campaign).collect();
    campaigns.dedup();
    let mut layers = Vec::new();
    let ends = known.iter().flat_map(|known| [known.planted, known.parameter.value]);
    let low = ends.clone().fold(f64::NAN, f64::min);
    let high = ends.fold(f64::NAN, f64::max);
    layers.push(Layer::Curve {
        name: "planted".to_owned(),
        points: vec![(low, low), (high, high)],
        look: style::COMMANDED,
    });
    for (nth, campaign) in campaigns.iter().enumerate() {
        let of_campaign = known.iter().filter(|known| known.campaign == *campaign);
        layers.push(Layer::Bars {
            name: (*campaign).to_owned(),
            points: of_campaign
                .map(|known| {
                    let half = 0.5 * (known.parameter.limits[1] - known.parameter.limits[0]);
                    (
                        known.planted,
                        known.parameter.value,
                        Some(half).filter(|half| half.is_finite()),
                    )
                })
                .collect(),
            look: campaign_look(nth),
        });
    }
    if known.is_empty() {
        layers.clear();
    }
    Chart {
        title: "Coefficients".to_owned(),
        x_label: "Planted".to_owned(),
        y_label: "Recovered".to_owned(),
        layers,
        ..Chart::default()
    }
}

fn missed(
    truth: &Truth,
    source: Source<'_>,
    name: &str,
    measured: impl Fn(&TrialRow) -> (f64, f64),
    planted: impl Fn(&PlantedTrial) -> Option<f64>,
) -> Chart {
    let layer = |(nth, campaign): (usize, &str)| {
        let point = |trial: &TrialRow| {
            let planted = planted(truth.trials.get(&trial.trial)?).filter(|value| *value > 0.0)?;
            let (value, error) = measured(trial);
            let half = 100.0 * BAR_STANDARD_ERRORS * error / planted;
            value.is_finite().then_some((
                trial.omega_rad_s,
                100.0 * (value / planted - 1.0),
                Some(half).filter(|half| half.is_finite()),
            ))
        };
        Layer::Bars {
            name: campaign.to_owned(),
            points: source.measured_trials(campaign).filter_map(point).collect(),
            look: campaign_look(nth),
        }
    };
    let level = Layer::Level { name: "planted".to_owned(), y: 0.0 };
    let campaigns = super::campaigns_of(source);
    Chart {
        title: name.to_owned(),
        x_label: OMEGA.to_owned(),
        y_label: "Difference (%)".to_owned(),
        layers: [level].into_iter().chain(campaigns.into_iter().enumerate().map(layer)).collect(),
        axes: Axes::Linear,
        ..Chart::default()
    }
}

/// Markers of the `nth` campaign.
fn campaign_look(nth: usize) -> style::Look {
    let (shape, filled) =
        [(Shape::Circle, true), (Shape::Square, false), (Shape::Circle, false)][nth % 3];
    style::Look::Marker { colour: style::component(nth).colour(), shape, filled }
}
