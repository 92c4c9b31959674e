//! The page of one trial: `trials/<trial>.html`.

use serde::Serialize;

use super::{Drawn, FigureView, engine, figure_view};
use crate::config::SigmaKind;
use crate::metrics::Estimate;
use crate::report::ReportError;
use crate::report::numbers::{fixed, significant, with_error};
use crate::report::recording::Recording;
use crate::report::tables::Tables;
use crate::store::{CheckRow, CycleRow, Severity, TrialRow, TrialStatus};
use crate::trial::TrialKind;

pub const TEMPLATE: &str = include_str!("trial.html");

#[derive(Serialize)]
struct Page<'p> {
    version: &'static str,
    trial: &'p str,
    kind: TrialKind,
    campaign: &'p str,
    status: TrialStatus,
    messages: Vec<&'p str>,
    quantities: Vec<QuantityView>,
    figures: Vec<FigureView<'p>>,
    gaps: Vec<GapView>,
    cycles: Vec<CycleView>,
    checks: Vec<CheckView<'p>>,
}

#[derive(Serialize)]
struct QuantityView {
    name: &'static str,
    value: String,
    unit: &'static str,
}

/// How the frames of one link came about.
#[derive(Serialize)]
struct GapView {
    /// Measured, from other markers, interpolated, missing.
    parts: [String; 4],
    longest_s: String,
}

#[derive(Serialize)]
struct CycleView {
    cycle: i64,
    start_s: String,
    d_mm: String,
    v_mm_s: String,
    sigma: [String; 3],
    dtheta_deg: String,
    used: bool,
}

#[derive(Serialize)]
struct CheckView<'p> {
    check: &'p str,
    severity: Severity,
    value: String,
    limit: String,
    message: &'p str,
}

/// The page as HTML; without a recording it says what the trial's row and checks say.
///
/// # Errors
/// The template cannot be filled in.
pub fn html(
    trial: &TrialRow,
    tables: &Tables,
    recording: Option<&Recording>,
    drawn: &[Drawn<'_>],
) -> Result<String, ReportError> {
    let checks = tables.checks.iter().filter(|check| check.trial == trial.trial);
    let page = Page {
        version: env!("CARGO_PKG_VERSION"),
        trial: &trial.trial,
        kind: trial.kind,
        campaign: &trial.campaign,
        status: trial.status,
        messages: [trial.message.as_str()].into_iter().filter(|text| !text.is_empty()).collect(),
        quantities: quantities(trial, tables),
        figures: drawn.iter().map(|drawn| figure_view(drawn, false)).collect(),
        gaps: recording
            .map_or(Vec::new(), |recording| (0..3).map(|link| gaps(recording, link)).collect()),
        cycles: recording
            .map_or(Vec::new(), |recording| recording.cycles.iter().map(cycle_view).collect()),
        checks: checks.map(check_view).collect(),
    };
    engine::fill("trial.html", TEMPLATE, &page).map_err(ReportError::Page)
}

fn quantities(trial: &TrialRow, tables: &Tables) -> Vec<QuantityView> {
    let deg = f64::to_degrees;
    let quantity = |name, value: f64, error: f64, unit| QuantityView {
        name,
        value: if value.is_finite() { with_error(value, error) } else { String::new() },
        unit,
    };
    let TrialRow { metrics, metrics_se, .. } = trial;
    let sigma = |name, of: Estimate| quantity(name, of.value, of.se, "");
    let [raw0, raw1, raw2] = trial.sigma(SigmaKind::Raw);
    let [debiased0, debiased1, debiased2] = trial.sigma_debiased;
    let [phi1, phi2] = trial.gait;
    let plain = [
        quantity("ω, set", trial.omega_commanded_rad_s, f64::NAN, "rad/s"),
        quantity("ω", trial.omega_rad_s, trial.omega_rad_s_se, "rad/s"),
        quantity("d", 1e3 * metrics.d_m, 1e3 * metrics_se.d_m, "mm"),
        quantity("v", 1e3 * metrics.v_m_s, 1e3 * metrics_se.v_m_s, "mm/s"),
        sigma("σ₀", raw0),
        sigma("σ₁", raw1),
        sigma("σ₂", raw2),
        sigma("σ₀ without noise", debiased0),
        sigma("σ₁ without noise", debiased1),
        sigma("σ₂ without noise", debiased2),
        quantity("α₁", deg(metrics.alpha1_rad), deg(metrics_se.alpha1_rad), "deg"),
        quantity("Rotation per cycle", deg(metrics.dtheta_rad), deg(metrics_se.dtheta_rad), "deg"),
        quantity("Offset of φ₁", deg(phi1.offset_rad), f64::NAN, "deg"),
        quantity("Amplitude of φ₁", deg(phi1.amplitude_rad), f64::NAN, "deg"),
        quantity("Offset of φ₂", deg(phi2.offset_rad), f64::NAN, "deg"),
        quantity("Amplitude of φ₂", deg(phi2.amplitude_rad), f64::NAN, "deg"),
        quantity("Coverage", 100.0 * trial.coverage, f64::NAN, "%"),
        quantity("Mean residual", trial.residual_mm, f64::NAN, "mm"),
    ];
    let robots = tables.robots.iter().filter(|row| row.trial == trial.trial);
    let of_robot = robots.flat_map(|row| row.quantities()).map(|found| QuantityView {
        name: found.name,
        value: with_error(found.measured.value, found.measured.se),
        unit: found.unit,
    });
    plain.into_iter().chain(of_robot).filter(|row| !row.value.is_empty()).collect()
}

fn gaps(recording: &Recording, link: usize) -> GapView {
    let fill = &recording.fill[link];
    let part = |name: &str| {
        let count = fill.iter().filter(|fill| *fill == name).count();
        format!("{} %", fixed(100.0 * count as f64 / fill.len().max(1) as f64, 1))
    };
    let missing = fill.chunk_by(|a, b| a == b).filter(|run| run[0] == "missing");
    let longest = missing.map(<[String]>::len).max().unwrap_or(0);
    let step_s = match recording.time_s.as_slice() {
        [first, second, ..] => second - first,
        _ => f64::NAN,
    };
    GapView {
        parts: ["measured", "rigid", "interpolated", "missing"].map(part),
        longest_s: if longest == 0 { String::new() } else { fixed(longest as f64 * step_s, 3) },
    }
}

fn cycle_view(row: &CycleRow) -> CycleView {
    CycleView {
        cycle: row.cycle,
        start_s: fixed(row.start_s, 3),
        d_mm: fixed(1e3 * row.metrics.d_m, 2),
        v_mm_s: fixed(1e3 * row.metrics.v_m_s, 2),
        sigma: row.metrics.sigma.map(|sigma| fixed(sigma, 4)),
        dtheta_deg: fixed(row.metrics.dtheta_rad.to_degrees(), 2),
        used: row.used,
    }
}

fn check_view(check: &CheckRow) -> CheckView<'_> {
    CheckView {
        check: &check.check,
        severity: check.severity,
        value: significant(check.value, 3),
        limit: significant(check.limit, 3),
        message: &check.message,
    }
}
