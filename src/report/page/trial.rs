//! The page of one trial: `trials/<trial>.html`.

use serde::Serialize;

use super::{Image, fill};
use crate::config::SigmaKind;
use crate::metrics::Estimate;
use crate::report::ReportError;
use crate::report::recording::Recording;
use crate::report::tables::Tables;
use crate::store::{CheckRow, CycleRow, RobotQuantity, TrialRow};

pub const TEMPLATE: &str = include_str!("trial.html");

#[derive(Serialize)]
struct Page<'p> {
    version: &'static str,
    trial: &'p TrialRow,
    quantities: Vec<RobotQuantity>,
    figures: &'p [Image],
    gaps: Vec<Gaps>,
    cycles: &'p [CycleRow],
    checks: Vec<&'p CheckRow>,
}

/// How the frames of one link came about.
#[derive(Serialize)]
struct Gaps {
    /// Measured, from other markers, interpolated, missing.
    parts: [f64; 4],
    longest_s: Option<f64>,
}

/// The page as HTML; without a recording it shows the trial's row and checks.
///
/// # Errors
/// The template cannot be filled in.
pub fn html(
    trial: &TrialRow,
    tables: &Tables,
    recording: Option<&Recording>,
    figures: &[Image],
) -> Result<String, ReportError> {
    let links = |recording| (0..3).map(|link| gaps(recording, link)).collect();
    let page = Page {
        version: env!("CARGO_PKG_VERSION"),
        trial,
        quantities: quantities(trial, tables),
        figures,
        gaps: recording.map_or(Vec::new(), links),
        cycles: recording.map_or(&[], |recording| &recording.cycles),
        checks: tables.checks.iter().filter(|check| check.trial == trial.trial).collect(),
    };
    fill("trial.html", TEMPLATE, &page).map_err(ReportError::Page)
}

/// What is known of the trial, and what it measured of its robot.
fn quantities(trial: &TrialRow, tables: &Tables) -> Vec<RobotQuantity> {
    let deg = f64::to_degrees;
    let quantity = |(name, measured, se, unit)| RobotQuantity {
        name,
        unit,
        measured: Estimate::new(measured, se),
        configured: f64::NAN,
    };
    let none = f64::NAN;
    let TrialRow { metrics, metrics_se, .. } = trial;
    let [raw0, raw1, raw2] = trial.sigma(SigmaKind::Raw);
    let [debiased0, debiased1, debiased2] = trial.sigma_debiased;
    let [phi1, phi2] = trial.gait;
    let own = [
        ("ω, set", trial.omega_commanded_rad_s, none, "rad/s"),
        ("ω", trial.omega_rad_s, trial.omega_rad_s_se, "rad/s"),
        ("d", 1e3 * metrics.d_m, 1e3 * metrics_se.d_m, "mm"),
        ("v", 1e3 * metrics.v_m_s, 1e3 * metrics_se.v_m_s, "mm/s"),
        ("σ₀", raw0.value, raw0.se, ""),
        ("σ₁", raw1.value, raw1.se, ""),
        ("σ₂", raw2.value, raw2.se, ""),
        ("σ₀ without noise", debiased0.value, debiased0.se, ""),
        ("σ₁ without noise", debiased1.value, debiased1.se, ""),
        ("σ₂ without noise", debiased2.value, debiased2.se, ""),
        ("α₁", deg(metrics.alpha1_rad), deg(metrics_se.alpha1_rad), "deg"),
        ("Rotation per cycle", deg(metrics.dtheta_rad), deg(metrics_se.dtheta_rad), "deg"),
        ("Offset of φ₁", deg(phi1.offset_rad), none, "deg"),
        ("Amplitude of φ₁", deg(phi1.amplitude_rad), none, "deg"),
        ("Offset of φ₂", deg(phi2.offset_rad), none, "deg"),
        ("Amplitude of φ₂", deg(phi2.amplitude_rad), none, "deg"),
        ("Coverage", 100.0 * trial.coverage, none, "%"),
        ("Mean residual", trial.residual_mm, none, "mm"),
    ];
    let robots = tables.robots.iter().filter(|row| row.trial == trial.trial);
    let of_robot = robots.flat_map(|row| row.quantities());
    let known =
        own.map(quantity).into_iter().filter(|quantity| quantity.measured.value.is_finite());
    known.chain(of_robot).collect()
}

fn gaps(recording: &Recording, link: usize) -> Gaps {
    let fill = &recording.fill[link];
    let part = |name: &str| {
        let count = fill.iter().filter(|fill| *fill == name).count();
        count as f64 / fill.len().max(1) as f64
    };
    let missing = fill.chunk_by(|a, b| a == b).filter(|run| run[0] == "missing");
    let step_s = match recording.time_s.as_slice() {
        [first, second, ..] => second - first,
        _ => f64::NAN,
    };
    Gaps {
        parts: ["measured", "rigid", "interpolated", "missing"].map(part),
        longest_s: missing.map(|run| run.len() as f64 * step_s).max_by(f64::total_cmp),
    }
}
