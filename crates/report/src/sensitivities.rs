//! Figure of sensitivities: bar chart of the elasticities of each metric with respect to the parameters.

use trilink_plot::Look;
use trilink_plot::{Figure, Layer, Layout, Panel, Scale};
use trilink_tables::{SENSITIVE_METRICS, SensitivityRow};

use super::ReportError;
use super::ending::{FigureFile, drawn};
use super::looks::colours;

/// Maximum number of parameters shown; those with the largest elasticities are chosen.
const SHOWN: usize = 7;

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
    let places =
        || parameters.iter().zip(0_u8..).map(|((name, _), place)| (f64::from(place), *name));
    let names: Vec<(f64, String)> = places().map(|(place, name)| (place, in_short(name))).collect();
    let panels = SENSITIVE_METRICS
        .iter()
        .filter(|metric| {
            rows.iter().any(|row| row.metric == ***metric && row.elasticity.is_finite())
        })
        .map(|metric| {
            let bars = places().map(|(place, name)| {
                let elasticity = rows
                    .iter()
                    .find(|row| row.metric == **metric && row.parameter == name)
                    .map_or(f64::NAN, |row| row.elasticity);
                (place, 0.5 * elasticity, 0.5 * elasticity.abs())
            });
            // Leaves room on either side for half the label of a bar.
            let room = [-0.6, parameters.len() as f64 - 0.4].map(|x| (x, 0.0, f64::NAN));
            let bars = Layer::with_errors("", bars.chain(room), Look::Bars(colours::TREND));
            let zero = Layer::new("", [(f64::NAN, 0.0)], Look::Guides);
            let label = format!("Elasticity of {}", in_short(metric));
            Panel {
                x_scale: Scale::Whole,
                x_names: names.clone(),
                ..Panel::new("", "", &label, vec![zero, bars])
            }
        })
        .collect();
    let motion = rows.first().map_or(String::new(), |row| {
        format!("{campaign}, {} at {} rad/s", row.model, row.omega_rad_s)
    });
    let title = format!("Elasticities of {motion}");
    let mut caption =
        "Relative change of each metric per relative change of a parameter.".to_owned();
    let extrapolation = rows.first().map(|row| &row.extrapolation);
    if let Some(of) = extrapolation.filter(|of| of.extrapolated == Some(true)) {
        caption += &format!(" Extrapolated: {}.", of.beyond_trials);
    }
    Figure::new("sensitivities", [title, caption], &[campaign], Layout::Stack, panels)
}

/// Returns the name of a column without its unit, abbreviated if it is long.
fn in_short(name: &str) -> String {
    const UNITS: [&str; 12] = [
        "_nm_s_rad",
        "_nm_rad",
        "_rad_s",
        "_kg_m2",
        "_kg_s",
        "_m_s",
        "_deg",
        "_rad",
        "_kg",
        "_n",
        "_m",
        "_j",
    ];
    const SHORT: [(&str, &str); 12] = [
        ("amplitude", "ampl"),
        ("inertia", "J"),
        ("mass", "m"),
        ("stiffness", "k"),
        ("damping", "c"),
        ("transition", "v_t"),
        ("stribeck", "v_s"),
        ("skid_static", "stat"),
        ("skid_dry", "dry"),
        ("roll_dry", "rdry"),
        ("offset", "off"),
        ("phase", "ph"),
    ];
    let plain = UNITS.iter().find_map(|end| name.strip_suffix(end)).unwrap_or(name);
    let found = SHORT.iter().find_map(|(long, short)| Some((short, plain.strip_prefix(long)?)));
    found.map_or_else(|| plain.to_owned(), |(short, number)| format!("{short}{number}"))
}
