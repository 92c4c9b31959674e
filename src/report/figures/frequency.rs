//! Figs. 10, 13 and 15 to 20: measurements and models against the frequency.

use super::BARS;
use super::common::FREQUENCY;
use crate::config::SigmaKind;
use crate::csv::field as csv_field;
use crate::motion::Model;
use crate::report::drawing::{Figure, Layout, Panel, Range, Scale};
use crate::report::plotted;
use crate::report::series::{Quantity, Series, Source};

/// A model further above the measurements than this would flatten them.
const FARTHEST_MODEL: f64 = 1.5;
/// The model of the figures of two campaigns.
const SHARED_MODEL: Model = Model::SkidRoll;

/// Figs. 10, 13 and 15: what was measured of one quantity.
pub fn measured(stem: &str, campaign: &str, quantity: Quantity, source: Source<'_>) -> Figure {
    let title = match quantity {
        Quantity::Displacement => format!("Displacement per cycle d of campaign {campaign}"),
        _ => format!("Mean speed v of campaign {campaign}"),
    };
    let series = source.measured(campaign, quantity, 0).into_iter().collect();
    figure(stem, title, BARS.to_owned(), &[campaign], vec![Plot::new(quantity, series)])
}

/// Figs. 16, 17 and 18: displacement and speed, measured and by all models of the campaign.
pub fn models(stem: &str, campaign: &str, source: Source<'_>) -> Figure {
    let models = source.models(campaign);
    let plot = |quantity| {
        let predicted =
            models.iter().filter_map(|model| source.model(campaign, *model, quantity, 0));
        let measured = source.measured(campaign, quantity, 0);
        Plot::new(quantity, measured.into_iter().chain(predicted).collect())
    };
    let plots = vec![plot(Quantity::Displacement), plot(Quantity::Speed)];
    let mut caption = format!("{BARS} Lines: the fitted models under the commanded gait.");
    let shown = plots.iter().flat_map(|plot| &plot.series);
    if shown.into_iter().any(|series| series.name == Model::NoSkidMeasured.name()) {
        caption.push_str(" Open circles: no-skid under each trial's measured gait.");
    }
    let title = format!("Measurements and models of campaign {campaign}");
    figure(stem, title, caption, &[campaign], plots)
}

/// Figs. 19 and 20: the wheels' skid ratios of campaigns, measured and by `skid-roll`.
pub fn skid(stem: &str, campaigns: &[&str], source: Source<'_>) -> Figure {
    let plot = |wheel| {
        let quantity = Quantity::Skid(wheel);
        let series = campaigns.iter().enumerate().flat_map(|(nth, campaign)| {
            let both = [
                source.measured(campaign, quantity, nth),
                source.model(campaign, SHARED_MODEL, quantity, nth),
            ];
            both.into_iter().flatten()
        });
        Plot { names_campaigns: true, ..Plot::new(quantity, series.collect()) }
    };
    let title = match campaigns {
        [one] => format!("Skid ratios of campaign {one}"),
        several => format!("Skid ratios of campaigns {}", several.join(" and ")),
    };
    let caption = format!(
        "Skid ratio σ (eq. 20): RMS skid speed of a wheel over lω{}. {BARS} Lines: the fitted \
         model {SHARED_MODEL}.",
        match source.sigma {
            SigmaKind::Raw => ", the markers' noise included",
            SigmaKind::Debiased => ", without the noise power",
        }
    );
    figure(stem, title, caption, campaigns, [0, 1, 2].map(plot).into())
}

/// One quantity against the frequency.
struct Plot {
    quantity: Quantity,
    series: Vec<Series>,
    /// Whether the legend names each series' campaign.
    names_campaigns: bool,
}

fn figure(
    stem: &str,
    title: String,
    caption: String,
    campaigns: &[&str],
    plots: Vec<Plot>,
) -> Figure {
    let mut csv = "panel,quantity,campaign,series,kind,omega_rad_s,value,error_95\n".to_owned();
    let mut alternative = format!("{title}, plotted against the actuation frequency.");
    for (plot, letter) in plots.iter().zip('a'..) {
        csv.push_str(&plot.csv(letter));
        let extents: Vec<String> = plot.series.iter().map(|series| plot.extent(series)).collect();
        let title = plot.quantity.description().title;
        alternative.push_str(&format!(" ({letter}) {title}: {}.", extents.join("; ")));
    }
    Figure {
        caption,
        layout: Layout::Stack,
        csv: Some(csv),
        alternative: Some(alternative),
        ..Figure::new(stem, title, campaigns, plots.iter().map(Plot::panel).collect())
    }
}

impl Plot {
    fn new(quantity: Quantity, series: Vec<Series>) -> Self {
        Self { quantity, series, names_campaigns: false }
    }

    fn label(&self, series: &Series) -> String {
        match self.names_campaigns {
            true => format!("{}, {}", series.campaign, series.name),
            false => series.name.clone(),
        }
    }

    /// All measurements, and the models as far as they leave these readable.
    fn panel(&self) -> Panel {
        let measured = self.series.iter().filter(|series| series.is_measured);
        let tops = measured.flat_map(Series::points).map(|point| point.y + point.error.max(0.0));
        let most = Range::of(tops).map(|range| range.high).filter(|most| *most > 0.0);
        let ceiling = most.map(|most| FARTHEST_MODEL * most);
        let beyond: Vec<String> = self
            .series
            .iter()
            .filter(|series| !series.is_measured)
            .filter_map(|series| self.beyond(series, ceiling?))
            .collect();
        let description = self.quantity.description();
        // Measurements lie on top.
        let (measured, modelled): (Vec<&Series>, Vec<_>) =
            self.series.iter().partition(|series| series.is_measured);
        let layers = modelled.into_iter().chain(measured);
        let layers = layers.map(|series| series.layer(self.label(series)));
        Panel {
            y_scale: match self.quantity {
                Quantity::Speed | Quantity::Skid(_) => Scale::FromZero,
                Quantity::Displacement | Quantity::Amplitude => Scale::Linear,
            },
            shown: ceiling.map(|high| Range { low: f64::NEG_INFINITY, high }),
            beyond: match beyond.as_slice() {
                [] => String::new(),
                [one] => one.clone(),
                several => format!("{} models lie above", several.len()),
            },
            ..Panel::new(description.title, FREQUENCY, description.axis_label, layers.collect())
        }
    }

    /// How far a series goes above the panel, if it does.
    fn beyond(&self, series: &Series, ceiling: f64) -> Option<String> {
        let above = series.points().map(|point| point.y).filter(|value| *value > ceiling);
        let highest = above.reduce(f64::max)?;
        let (label, unit) = (self.label(series), self.quantity.description().unit);
        let digits = usize::from(highest < 100.0) + 2 * usize::from(highest < 1.0);
        Some(format!("{label} above, up to {highest:.digits$}{unit}"))
    }

    /// What a series shows for those who cannot see it.
    fn extent(&self, series: &Series) -> String {
        let Range { low, high } = Range::of(series.points().map(|point| point.y))
            .unwrap_or(Range { low: f64::NAN, high: f64::NAN });
        let digits = match self.quantity {
            Quantity::Displacement | Quantity::Speed | Quantity::Amplitude => 1,
            Quantity::Skid(_) => 4,
        };
        let trials = match series.is_measured {
            true => format!(" ({} trials)", series.points().count()),
            false => String::new(),
        };
        let (label, unit) = (self.label(series), self.quantity.description().unit);
        format!("{label}{trials} from {low:.digits$} to {high:.digits$}{unit}")
    }

    fn csv(&self, letter: char) -> String {
        let mut csv = String::new();
        for series in &self.series {
            let quantity = self.quantity.description().csv_name;
            let kind = if series.is_measured { "measured" } else { "model" };
            let [campaign, name] = [&series.campaign, &series.name].map(|name| csv_field(name));
            for point in series.points() {
                let [x, y, error] = [point.x, point.y, point.error].map(plotted::number);
                csv.push_str(&format!(
                    "{letter},{quantity},{campaign},{name},{kind},{x},{y},{error}\n"
                ));
            }
        }
        csv
    }
}
