//! A figure before it is drawn.

use super::chart::{Chart, Layout};
use super::legend::Sample;
use super::series::{Kind, Quantity, Series};
use crate::csv::field as csv_field;

/// One quantity against the frequency.
#[derive(Debug, Clone)]
pub struct Panel {
    pub quantity: Quantity,
    /// Whether the axis has to start at zero whatever the values.
    pub from_zero: bool,
    pub series: Vec<Series>,
}

/// Panels above one another that share the frequency axis and the legend.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Name of its files without extension, such as `fig16`.
    pub stem: String,
    /// `Fig. 16` or empty for figures that the paper does not have.
    pub number: String,
    /// What is plotted, in a line.
    pub title: String,
    /// What a reader has to know beyond the title.
    pub caption: String,
    /// Campaigns that are in it.
    pub campaigns: Vec<String>,
    pub panels: Vec<Panel>,
    /// What is drawn instead of panels, if it is not against the frequency.
    pub charts: Vec<Chart>,
    /// How these are put together.
    pub layout: Layout,
}

impl Figure {
    /// A figure of charts, without a caption.
    pub fn of_charts(stem: &str, title: String, campaigns: &[&str], charts: Vec<Chart>) -> Self {
        Self {
            stem: stem.to_owned(),
            number: super::figures::number(stem),
            title,
            caption: String::new(),
            campaigns: campaigns.iter().map(|&campaign| campaign.to_owned()).collect(),
            panels: Vec::new(),
            charts,
            layout: Layout::default(),
        }
    }

    /// Whether there is anything to draw.
    pub fn is_empty(&self) -> bool {
        self.panels.iter().all(|panel| panel.series.is_empty())
            && self.charts.iter().all(Chart::is_empty)
    }

    /// What the legend says of everything that is in it.
    pub fn samples(&self) -> Vec<Sample> {
        let series = self.panels.iter().flat_map(|panel| &panel.series);
        let of_series = series.map(|series| Sample {
            label: series.label.clone(),
            look: series.look,
            bar: series.kind == Kind::Measured,
        });
        of_series.chain(self.charts.iter().flat_map(Chart::samples)).collect()
    }

    /// What the figure shows for those who cannot see it: panels, series and their extent.
    pub fn text_alternative(&self) -> String {
        if !self.charts.is_empty() {
            let titles = self.charts.iter().zip('a'..).map(|(chart, letter)| {
                format!(" ({letter}) {}: {} against {}.", chart.title, chart.y_label, chart.x_label)
            });
            return format!("{}.{}", self.title, titles.collect::<String>());
        }
        let mut text = format!("{}, plotted against the actuation frequency.", self.title);
        for (panel, letter) in self.panels.iter().zip('a'..) {
            text.push_str(&format!(" ({letter}) {}:", panel.quantity.title()));
            let parts: Vec<String> =
                panel.series.iter().map(|series| extent(series, panel.quantity)).collect();
            text.push_str(&format!(" {}.", parts.join("; ")));
        }
        text
    }

    /// The plotted numbers, one row per point; `error_95` is the half-width of the error bar.
    pub fn csv(&self) -> String {
        if !self.charts.is_empty() {
            let rows = self.charts.iter().zip('a'..);
            let rows = rows.map(|(chart, letter)| chart.csv(letter, csv_field));
            return "panel,title,layer,x,y,error_95\n".to_owned() + &rows.collect::<String>();
        }
        let mut csv = "panel,quantity,campaign,series,kind,omega_rad_s,value,error_95\n".to_owned();
        for (panel, letter) in self.panels.iter().zip('a'..) {
            for series in &panel.series {
                let kind = match series.kind {
                    Kind::Measured => "measured",
                    Kind::Model => "model",
                };
                for point in series.points() {
                    csv.push_str(&format!(
                        "{letter},{},{},{},{kind},{},{},{}\n",
                        panel.quantity.csv_name(),
                        csv_field(&series.campaign),
                        csv_field(&series.name),
                        csv_number(point.omega_rad_s),
                        csv_number(point.value),
                        point.error.map_or(String::new(), csv_number),
                    ));
                }
            }
        }
        csv
    }
}

fn extent(series: &Series, quantity: Quantity) -> String {
    let values = || series.points().map(|point| point.value);
    let low = values().fold(f64::NAN, f64::min);
    let high = values().fold(f64::NAN, f64::max);
    let digits = match quantity {
        Quantity::Displacement | Quantity::Speed | Quantity::Amplitude => 1,
        Quantity::Skid(_) => 4,
    };
    let points = match series.kind {
        Kind::Measured => format!(" ({} trials)", values().count()),
        Kind::Model => String::new(),
    };
    let unit = quantity.unit();
    format!("{}{points} from {low:.digits$} to {high:.digits$}{unit}", series.label)
}

/// Ten digits: what the tables are good for, without the noise of a change of units.
pub fn csv_number(value: f64) -> String {
    let rounded: f64 = format!("{value:.9e}").parse().unwrap_or(value);
    rounded.to_string()
}
