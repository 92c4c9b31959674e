//! What figures show without drawing it: the numbers as CSV, and a description.

use super::drawing::{Figure, Point};
use crate::csv::field;

/// The plotted numbers, one row per point; `error_95` is the half-width of the error bar.
pub fn csv(figure: &Figure) -> String {
    if let Some(csv) = &figure.csv {
        return csv.clone();
    }
    let mut csv = "panel,title,layer,x,y,error_95\n".to_owned();
    for (letter, panel) in figure.lettered() {
        let title = field(&panel.title);
        for layer in &panel.layers {
            let name = field(&layer.name);
            for Point { x, y, error } in &layer.points {
                let [x, y, error] = [x, y, error].map(|value| number(*value));
                csv.push_str(&format!("{letter},{title},{name},{x},{y},{error}\n"));
            }
        }
    }
    csv
}

/// What a figure shows for those who cannot see it.
pub fn text_alternative(figure: &Figure) -> String {
    let of_panels = || {
        let titles = figure.lettered().map(|(letter, panel)| {
            format!(" ({letter}) {}: {} against {}.", panel.title, panel.y_label, panel.x_label)
        });
        format!("{}.{}", figure.title, titles.collect::<String>())
    };
    figure.alternative.clone().unwrap_or_else(of_panels)
}

/// Ten digits: what the tables are good for, without the noise of a change of units. Nothing for
/// what is not a number.
pub fn number(value: f64) -> String {
    if !value.is_finite() {
        return String::new();
    }
    let rounded: f64 = format!("{value:.9e}").parse().unwrap_or(value);
    rounded.to_string()
}
