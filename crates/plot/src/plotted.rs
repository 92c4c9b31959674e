//! Plotted data as CSV, and text alternatives for figures.

use trilink_base::csv::field;

use super::{Figure, Panel, Point};

/// Formats the plotted data as CSV, with a row for each point and a column for each quantity, named by
/// quantity and unit. A column `*_error_95` has the half-widths of error bars. For synthetic trials, a last
/// column `origin` marks every row as `synthetic`.
pub(crate) fn csv(figure: &Figure) -> String {
    let csv = figure.csv.clone().unwrap_or_else(|| csv_of_panels(figure));
    if figure.is_synthetic { add_origin(&csv) } else { csv }
}

/// Adds the column `origin`, which marks every row as synthetic, to a CSV table.
fn add_origin(csv: &str) -> String {
    let mut with_origin = String::with_capacity(2 * csv.len());
    let mut is_quoted = false;
    let mut origin = ",origin";
    for c in csv.chars() {
        is_quoted ^= c == '"';
        if c == '\n' && !is_quoted {
            with_origin.push_str(std::mem::replace(&mut origin, ",synthetic"));
        }
        with_origin.push(c);
    }
    with_origin
}

fn csv_of_panels(figure: &Figure) -> String {
    let by_panel: Vec<Vec<String>> = figure.panels.iter().map(columns).collect();
    let mut all: Vec<&String> = Vec::new();
    for name in by_panel.iter().flatten() {
        if !all.contains(&name) {
            all.push(name);
        }
    }
    let layers = figure.panels.iter().flat_map(|panel| &panel.layers);
    let have_trials = layers.clone().any(|layer| !layer.trials.is_empty());
    let trial = if have_trials { "trial," } else { "" };
    let names: String = all.iter().map(|name| format!(",{name}")).collect();
    let mut csv = format!("panel,title,{trial}layer{names}\n");
    for ((letter, panel), own) in figure.lettered().zip(&by_panel) {
        let title = field(&panel.title);
        let indices: Vec<Option<usize>> =
            own.iter().map(|name| all.iter().position(|other| *other == name)).collect();
        for layer in &panel.layers {
            let name = field(&layer.name);
            for (i, Point { x, y, error }) in layer.points.iter().enumerate() {
                let trial = layer.trials.get(i).map_or("", String::as_str);
                let trial = if have_trials { field(trial) + "," } else { String::new() };
                let mut values = vec![String::new(); all.len()];
                for (index, value) in indices.iter().zip([x, y, error]) {
                    if let Some(index) = index {
                        values[*index] = number(*value);
                    }
                }
                csv.push_str(&format!("{letter},{title},{trial}{name},{}\n", values.join(",")));
            }
        }
    }
    csv
}

/// Returns the names of the CSV columns for a panel's axes and, if it has any, its error bars.
fn columns(panel: &Panel) -> Vec<String> {
    let [x, y] = [&panel.x_label, &panel.y_label].map(|label| column(label));
    let mut errors = panel.layers.iter().flat_map(|layer| &layer.points).map(|point| point.error);
    let error = errors.any(f64::is_finite).then(|| format!("{y}_error_95"));
    [x, y].into_iter().chain(error).collect()
}

/// Converts an axis label to a CSV column name: `Actuation frequency ω (rad/s)` to `omega_rad_s`.
fn column(label: &str) -> String {
    let with_unit = label.strip_suffix(')').and_then(|label| label.split_once(" ("));
    let (words, unit) = with_unit.unwrap_or((label, ""));
    // A symbol at the end makes the words before it redundant.
    let words = symbol(words).unwrap_or(words);
    let mut name = String::new();
    for c in format!("{words} {}", unit.replace("N m", "Nm")).chars() {
        match c {
            'Δ' => name.push_str("delta_"),
            'α' => name.push_str("alpha"),
            'θ' => name.push_str("theta"),
            'σ' => name.push_str("sigma"),
            'φ' => name.push_str("phi"),
            'ω' => name.push_str("omega"),
            '%' => name.push_str("percent"),
            '₀'..='₉' => name.extend(char::from_digit(c as u32 - '₀' as u32, 10)),
            // Digits follow directly, without `_`, as in `skid0`.
            '0'..='9' => name = name.trim_end_matches('_').to_owned() + &c.to_string(),
            c if c.is_alphanumeric() => name.extend(c.to_lowercase()),
            _ if name.ends_with('_') => {}
            _ => name.push('_'),
        }
    }
    name.trim_end_matches('_').to_owned()
}

/// Returns the symbol with which the words of an axis label end; `None` if they end with a word or a number.
pub(crate) fn symbol(words: &str) -> Option<&str> {
    let last = words.rsplit(' ').next()?;
    let mut letters = last.chars().filter(|c| !('₀'..='₉').contains(c));
    let is_symbol = letters.next().is_some_and(char::is_lowercase) && letters.next().is_none();
    is_symbol.then_some(last)
}

/// Returns the text alternative of a figure, for readers who cannot see it.
pub fn text_alternative(figure: &Figure) -> String {
    if let Some(alternative) = &figure.alternative {
        return alternative.clone();
    }
    let titles = figure.lettered().map(|(letter, panel)| {
        format!(" ({letter}) {}: {} against {}.", panel.title, panel.y_label, panel.x_label)
    });
    format!("{}.{}", figure.title, titles.collect::<String>())
}

/// Formats a number with ten significant digits, which removes rounding noise from unit conversions; empty if
/// the number is not finite.
pub fn number(value: f64) -> String {
    if !value.is_finite() {
        return String::new();
    }
    let rounded: f64 = format!("{value:.9e}").parse().unwrap_or(value);
    rounded.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_trials_are_quoted_if_necessary() {
        use crate::{Layer, Layout};
        let layer = Layer::new("a", [(1.0, 2.0)], crate::Look::Guides);
        let layer = Layer { trials: vec!["one, \"two\"".to_owned()], ..layer };
        let panels = vec![Panel::new("", "Time (s)", "d (m)", vec![layer])];
        let csv = csv(&Figure::new("any", Default::default(), &[], Layout::Grid, panels));
        assert!(csv.ends_with("a,,\"one, \"\"two\"\"\",a,1,2\n"), "{csv}");
    }

    #[test]
    fn columns_are_named_by_quantity_and_unit() {
        for (label, name) in [
            ("Actuation frequency ω (rad/s)", "omega_rad_s"),
            ("Mean speed v (mm/s)", "v_mm_s"),
            ("Skid ratio σ₁", "sigma1"),
            ("φ₁ (deg)", "phi1_deg"),
            ("Time (s)", "time_s"),
            ("Residual (%)", "residual_percent"),
            ("Skid 0 (kg/s)", "skid0_kg_s"),
            ("Damping (N m s/rad)", "damping_nm_s_rad"),
            ("ΔJ (% of J)", "delta_j_percent_of_j"),
            ("Start, by rank", "start_by_rank"),
        ] {
            assert_eq!(column(label), name);
        }
    }
}
