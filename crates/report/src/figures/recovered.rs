//! Figure of fitted and measured values against the true values of synthetic trials.

use std::collections::BTreeSet;

use minijinja::context;
use trilink_base::text::interned;
use trilink_plot::{Figure, Layer, Layout, Look, Panel, Range, Scale};
use trilink_robot::metrics::Metric;
use trilink_statistics::Estimate;
use trilink_statistics::HALF_WIDTH_95;

use super::common::{OMEGA, scaled};
use super::texts::texts;
use crate::ReportInput;
use crate::looks;
use crate::series::{AMPLITUDE, DISPLACEMENT, Quantity, Source};
use crate::tables::Tables;
use crate::truth::{self, Known, Truth};

/// Returns the figure of fitted and measured values against the true values of synthetic trials; empty if no true
/// values are known.
pub(super) fn figure(stem: &str, truth: &Truth, tables: &Tables, source: Source<'_>) -> Figure {
    // Wheels have the names of the links only if all robots have the same.
    let campaigns = super::campaigns_of(source).into_iter();
    let links: BTreeSet<Vec<String>> = campaigns.map(|campaign| source.links(campaign)).collect();
    let names = links.first().filter(|_| links.len() == 1);
    let wheels = Metric::SIGMA.into_iter().enumerate().map(|(wheel, metric)| match names {
        Some(names) => Quantity::of_links(metric, names),
        _ => Quantity { title: interned(&format!("Wheel {wheel}")), ..Quantity::new(metric) },
    });
    let joints = Metric::ALPHA[1..].iter().map(|metric| Quantity::new(*metric));
    let quantities = [DISPLACEMENT, AMPLITUDE].into_iter().chain(wheels).chain(joints);
    let deviations = quantities.map(|quantity| deviations(truth, source, &quantity));
    let all = std::iter::once(coefficients(truth, tables, source.input)).chain(deviations);
    let panels = all.filter(|panel| !panel.is_empty()).collect();
    let texts = texts("truth", context! {});
    Figure::new(stem, texts, &super::campaigns_of(source), Layout::Grid, panels)
}

/// Returns the panel in which fitted coefficients are plotted against their true values.
fn coefficients(truth: &Truth, tables: &Tables, input: &ReportInput) -> Panel {
    let known: Vec<_> = truth::planted(truth, tables, input)
        .into_iter()
        .filter(|known| known.parameter.free && known.planted > 0.0)
        .collect();
    let mut campaigns: Vec<&str> = known.iter().map(|known| known.campaign).collect();
    campaigns.dedup();
    let Some(Range { low, high }) =
        Range::enclosing(known.iter().flat_map(|known| [known.planted, known.parameter.value]))
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
    scaled(
        Scale::Decades,
        Panel::new("Coefficients", "Planted (SI units)", "Recovered (SI units)", layers),
    )
}

/// Returns the panel of the relative deviations of a measured quantity from its true values.
fn deviations(truth: &Truth, source: Source<'_>, quantity: &Quantity) -> Panel {
    let mut layers = vec![Layer::new("planted", [(f64::NAN, 0.0)], Look::Guides)];
    layers.extend(super::campaigns_of(source).into_iter().enumerate().map(|(nth, campaign)| {
        let points = source.measured_trials(campaign).filter_map(|trial| {
            let planted = quantity.of(&truth.trials.get(&trial.trial)?.metrics());
            let Estimate { value, se } = quantity.of_trial(trial, source.sigma);
            let half = 100.0 * HALF_WIDTH_95 * se / planted;
            let difference = 100.0 * (value / planted - 1.0);
            let is_known = planted > 0.0 && value.is_finite();
            is_known.then(|| ((trial.omega_rad_s, difference, half), trial.trial.clone()))
        });
        let (points, trials): (Vec<_>, _) = points.unzip();
        Layer { trials, ..Layer::with_errors(campaign, points, looks::campaign(nth)) }
    }));
    Panel::new(quantity.symbol, OMEGA, "Difference (%)", layers)
}
