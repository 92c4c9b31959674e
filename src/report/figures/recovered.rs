//! Planted truth against what the program made of the trials that were computed from it.

use super::common::OMEGA;
use crate::metrics::Estimate;
use crate::report::drawing::{Figure, Layer, Layout, Look, Panel, Range, Scale};
use crate::report::looks;
use crate::report::series::{BAR_STANDARD_ERRORS, Quantity, Source};
use crate::report::tables::Tables;
use crate::report::truth::{self, Known, Truth};
use crate::store::TrialRow;

/// The figure; empty without trials and coefficients of which the truth is known.
pub fn figure(stem: &str, truth: &Truth, tables: &Tables, source: Source<'_>) -> Figure {
    use Quantity::{Amplitude, Displacement, Skid};
    let missed = [Displacement, Amplitude, Skid(0), Skid(1), Skid(2)]
        .map(|quantity| missed(truth, source, quantity));
    let all = [coefficients(truth, tables)].into_iter().chain(missed);
    Figure::new(
        stem,
        "Planted and recovered",
        "Coefficients: fitted skid-roll model against what was planted, with 95 % intervals, thick \
         what scatter alone gives; a point on the line is right. The others: measured less planted, in parts of the latter, \
         with bars of 1.96 standard errors.",
        &super::campaigns_of(source),
        Layout::Grid,
        all.filter(|panel| !panel.is_empty()).collect(),
    )
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
    let mut layers = vec![planted];
    for (nth, campaign) in campaigns.iter().enumerate() {
        let of_campaign = known.iter().filter(|known| known.campaign == *campaign);
        let point = |known: &&Known, half| (known.planted, known.parameter.value, half);
        let parts = of_campaign.clone().filter(|known| known.scatter > 0.0);
        let parts: Vec<_> = parts.map(|known| point(&known, known.scatter)).collect();
        if !parts.is_empty() {
            let look = Look::Bars(looks::component_colour(nth));
            layers.push(Layer::with_errors(&format!("{campaign}, scatter"), parts, look));
        }
        let points = of_campaign.map(|known| {
            let [low, high] = known.parameter.limits;
            point(&known, 0.5 * (high - low))
        });
        layers.push(Layer::with_errors(campaign, points, looks::campaign(nth)));
    }
    Panel {
        x_scale: Scale::Decades,
        y_scale: Scale::Decades,
        ..Panel::new("Coefficients", "Planted", "Recovered", layers)
    }
}

fn missed(truth: &Truth, source: Source<'_>, quantity: Quantity) -> Panel {
    let layer = |(nth, campaign): (usize, &str)| {
        let point = |trial: &TrialRow| {
            let planted = quantity.of(&truth.trials.get(&trial.trial)?.metrics());
            let Estimate { value, se } = quantity.of_trial(trial, source.sigma);
            let half = 100.0 * BAR_STANDARD_ERRORS * se / planted;
            let difference = 100.0 * (value / planted - 1.0);
            let is_known = planted > 0.0 && value.is_finite();
            is_known.then_some((trial.omega_rad_s, difference, half))
        };
        let points = source.measured_trials(campaign).filter_map(point);
        Layer::with_errors(campaign, points, looks::campaign(nth))
    };
    let mut layers = vec![Layer::new("planted", [(f64::NAN, 0.0)], Look::Guides)];
    layers.extend(super::campaigns_of(source).into_iter().enumerate().map(layer));
    Panel::new(quantity.description().symbol, OMEGA, "Difference (%)", layers)
}
