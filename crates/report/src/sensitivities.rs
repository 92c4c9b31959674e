//! Figure of sensitivities: heat map of the elasticities of each metric with respect to the parameters.

use trilink_base::Named as _;
use trilink_base::numbers::fixed;
use trilink_plot::{Figure, Layer, Layout, Look, Panel, Scale};
use trilink_robot::metrics::Metric;
use trilink_robot::{Parameter, Robot};
use trilink_tables::SensitivityRow;

use super::ReportError;
use super::ending::{FigureFile, drawn};
use super::looks;

/// Maximum number of parameters shown; those with the largest elasticities are chosen.
const SHOWN: usize = 7;

/// Magnitude from which an elasticity has the full colour.
const SATURATED: f64 = 2.0;

/// Draws the elasticities of a simulated motion of a campaign, in the format that `file` specifies.
///
/// # Errors
/// Returns an error if the file's extension is not `svg`, `png` or `pdf`, or if the figure cannot be drawn.
pub fn sensitivities_drawing(
    campaign: &str,
    rows: &[SensitivityRow],
    file: FigureFile<'_>,
) -> Result<Vec<u8>, ReportError> {
    drawn(&figure(campaign, rows), file)
}

fn figure(campaign: &str, rows: &[SensitivityRow]) -> Figure {
    let mut parameters: Vec<(&str, f64)> = Vec::new();
    for row in rows.iter().filter(|row| row.elasticity.is_finite()) {
        match parameters.iter_mut().find(|(name, _)| *name == row.parameter) {
            Some((_, size)) => *size = size.max(row.elasticity.abs()),
            None => parameters.push((&row.parameter, row.elasticity.abs())),
        }
    }
    parameters.sort_by(|a, b| b.1.total_cmp(&a.1));
    parameters.truncate(SHOWN);
    let metrics: Vec<&str> = rows
        .chunk_by(|a, b| a.metric == b.metric)
        .filter(|rows| rows.iter().any(|row| row.elasticity.is_finite()))
        .map(|rows| rows[0].metric.as_str())
        .collect();
    // The first metric is at the top.
    let heights = || metrics.iter().rev().zip(0_u8..).map(|(name, nth)| (f64::from(nth), *name));
    let places = || parameters.iter().zip(0_u8..).map(|((name, _), nth)| (f64::from(nth), *name));
    let cells = heights().flat_map(|(y, metric)| {
        places().filter_map(move |(x, parameter)| {
            let is_of = |row: &&SensitivityRow| row.metric == metric && row.parameter == parameter;
            let elasticity = rows.iter().find(is_of)?.elasticity;
            let look = Look::Cells(looks::signed(elasticity / SATURATED));
            elasticity.is_finite().then(|| Layer::new(&fixed(elasticity, 2), [(x, y)], look))
        })
    });
    let panel = Panel {
        x_scale: Scale::Whole,
        y_scale: Scale::Whole,
        x_names: places().map(|(x, name)| (x, symbol(name))).collect(),
        y_names: heights().map(|(y, name)| (y, metric_symbol(name))).collect(),
        ..Panel::new("", "Parameter", "Metric", cells.collect())
    };
    let motion = rows.first().map_or(String::new(), |row| {
        format!("{campaign}, {} at {} rad/s", row.model, row.omega_rad_s)
    });
    let title = format!("Elasticities of {motion}");
    let mut caption =
        "Relative change of each metric per relative change of a parameter: positive values orange, \
         negative ones blue.".to_owned();
    let extrapolation = rows.first().map(|row| &row.extrapolation);
    if let Some(of) = extrapolation.filter(|of| of.extrapolated == Some(true)) {
        caption += &format!(" Extrapolated: {}.", of.beyond_trials);
    }
    Figure::new("sensitivities", [title, caption], &[campaign], Layout::Stack, vec![panel])
}

/// Returns the symbol of a parameter of the robot or of the gait, or its name if it has no symbol.
fn symbol(name: &str) -> String {
    if let Some(parameter) = Parameter::of_name(name) {
        return plain(&parameter.latex(0..Robot::LINKS));
    }
    const OF_GAIT: [(&str, &str); 4] =
        [("amplitude", "α"), ("offset", "γ"), ("phase", "ψ"), ("omega_rad_s", "ω")];
    let stem = name.strip_suffix("_deg").unwrap_or(name);
    let found = OF_GAIT.into_iter().find_map(|(of, sign)| Some((sign, stem.strip_prefix(of)?)));
    found.map_or_else(|| stem.to_owned(), |(sign, joint)| plain(&format!("{sign}_{joint}")))
}

/// Returns the symbol of a metric or of the work.
fn metric_symbol(column: &str) -> String {
    let metric = Metric::ALL.into_iter().find(|metric| metric.column() == column);
    metric.map_or("work", |metric| metric.definition().symbol).to_owned()
}

/// Returns a LaTeX symbol as plain text, with digits as subscripts.
fn plain(latex: &str) -> String {
    let text = latex.replace("\\tau", "τ").replace("\\phi", "φ").replace('^', "_");
    let mut plain = String::new();
    for c in text.chars() {
        match c {
            '0'..='9' => {
                plain.truncate(plain.trim_end_matches('_').len());
                plain.extend(char::from_u32('₀' as u32 + c as u32 - '0' as u32));
            }
            '$' | '{' | '}' | ' ' | ',' => {}
            c => plain.push(c),
        }
    }
    plain.trim_end_matches('_').to_owned()
}

#[cfg(test)]
mod tests {
    use trilink_tables::Columns as _;

    use super::*;

    #[test]
    fn parameters_have_the_symbols_of_the_field() {
        for (name, expected) in [
            ("skid0_kg_s", "c_S₀"),
            ("stiffness_nm_rad", "k_τ"),
            ("mass2_kg", "m₂"),
            ("l_m", "l"),
            ("amplitude2_deg", "α₂"),
            ("omega_rad_s", "ω"),
            ("second_in_phase1_deg", "second_in_phase1"),
        ] {
            assert_eq!(symbol(name), expected);
        }
    }

    #[test]
    fn every_cell_contains_its_elasticity() {
        let row = |metric: &str, parameter: &str, elasticity| SensitivityRow {
            metric: metric.to_owned(),
            parameter: parameter.to_owned(),
            elasticity,
            ..SensitivityRow::blank()
        };
        let rows = [
            row("d_m", "l_m", -0.5),
            row("d_m", "mass0_kg", f64::NAN),
            row("v_m_s", "l_m", 0.25),
            row("v_m_s", "mass0_kg", 0.1),
        ];
        let figure = figure("any", &rows);
        let [panel] = &figure.panels[..] else { panic!("{figure:?}") };
        let cells: Vec<(&str, f64, f64)> = panel
            .layers
            .iter()
            .map(|layer| (&*layer.name, layer.points[0].x, layer.points[0].y))
            .collect();
        assert_eq!(cells, [("0.25", 0.0, 0.0), ("0.10", 1.0, 0.0), ("\u{2212}0.50", 0.0, 1.0)]);
        assert_eq!(panel.y_names[1], (1.0, "d".to_owned()));
    }
}
