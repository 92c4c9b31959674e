//! Figure of the passive joint's motion after release, with the fitted decay (Fig. 8 of the paper).

use minijinja::context;
use trilink_base::numbers::{significant, with_error};
use trilink_plot::{Figure, Layer, Layout, Look, Panel};
use trilink_statistics::Estimate;
use trilink_tables::RobotParameterRow;

use super::common::{DEG, angle};
use super::texts::texts;
use crate::looks;
use crate::recording::Recording;

/// Fraction of the initial amplitude that remains at the end of the time span shown.
const REMAINDER: f64 = 0.005;
/// Time shown before the release, s.
const BEFORE_S: f64 = 0.2;
const POINTS: usize = 400;

/// Returns the figure of a joint release; `None` if the tables contain no fitted decay.
pub(super) fn figure(stem: &str, row: &RobotParameterRow, recording: &Recording) -> Option<Figure> {
    let joint = usize::try_from(row.joint - 1).ok()?;
    let phi = recording.phi_rad.get(joint)?;
    let released_s = row.released_s;
    let swing = row.swing();
    let decays_s = (-REMAINDER.ln() / swing.viscous_1_s).min(swing.stops_s() + BEFORE_S);
    let end_s = released_s + decays_s;
    if !(row.decay_rad(0.0) + end_s).is_finite() || end_s <= released_s {
        return None;
    }
    let shown = recording.between(released_s - BEFORE_S, end_s);
    let seen = shown.map(|i| (recording.time_s[i] - released_s, DEG * phi[i]));
    let fitted = (0..=POINTS).map(|i| {
        let after_s = (end_s - released_s) * i as f64 / POINTS as f64;
        (after_s, DEG * row.decay_rad(after_s))
    });
    let damping = [
        known(row.damping_ratio).map(|text| format!("damping ratio {text}")),
        known(row.damping_ratio_decrement).map(|text| format!("by logarithmic decrement {text}")),
    ];
    let damping = damping.into_iter().flatten();
    let dry = known(row.joint_dry_nm).map(|text| format!("dry friction {text} N m"));
    let panel = Panel {
        notes: vec![format!("natural frequency {} rad/s", text(row.natural_rad_s))]
            .into_iter()
            .chain(damping)
            .chain(dry)
            .collect(),
        ..Panel::new(
            format!("Joint {} of robot {}", row.joint, row.robot),
            "Time after release (s)",
            format!("{} (deg)", angle(joint)),
            vec![
                Layer::new("measured", seen, looks::RECORDED),
                Layer::new("fitted decay", fitted, looks::FITTED),
                Layer::new("rest", [(f64::NAN, DEG * row.rest_angle_rad.value)], Look::Guides),
            ],
        )
    };
    let values = context! {
        robot => &row.robot,
        joint => row.joint,
        trial => &row.trial,
        inertia => significant(row.inertia_kg_m2, 4),
        stiffness => text(row.stiffness_nm_rad),
        damping => known(row.damping_nm_s_rad),
        dry => known(row.joint_dry_nm),
    };
    Some(Figure::new(stem, texts("release", values), &[], Layout::Stack, vec![panel]))
}

/// Formats an estimate with its standard error.
fn text(estimate: Estimate) -> String {
    with_error(estimate.value, estimate.se)
}

/// Formats an estimate with its standard error; `None` if the estimate has no value.
pub(super) fn known(estimate: Estimate) -> Option<String> {
    estimate.value.is_finite().then(|| text(estimate))
}

#[cfg(test)]
mod tests {
    use trilink_tables::Columns as _;

    use super::*;

    #[test]
    fn the_plotted_decay_is_the_fitted_one() {
        let row = RobotParameterRow {
            joint: 1,
            natural_rad_s: Estimate::new(10.0, f64::NAN),
            damping_ratio: Estimate::new(0.2, f64::NAN),
            rest_angle_rad: Estimate::new(0.05, f64::NAN),
            released_s: 1.0,
            decay_cosine_rad: 0.4,
            decay_sine_rad: 0.08,
            ..RobotParameterRow::blank()
        };
        let time_s: Vec<f64> = (0..480).map(|i| f64::from(i) / 120.0).collect();
        let phi: Vec<f64> = time_s.iter().map(|t| row.decay_rad((t - 1.0).max(0.0))).collect();
        let recording =
            Recording { time_s, phi_rad: vec![phi, Vec::new()], ..Recording::default() };
        let figure = figure("release", &row, &recording).expect("it swings");
        let [seen, fitted, ..] = figure.panels[0].layers.as_slice() else {
            panic!("two curves are drawn");
        };
        let swing = |t: f64| {
            let damped = 10.0 * (1.0_f64 - 0.04).sqrt();
            0.05 + 0.4 * (-2.0 * t).exp() * ((damped * t).cos() + 0.2 * (damped * t).sin())
        };
        assert!(seen.points[0].x < -0.19 && fitted.points[0].x == 0.0);
        let free = seen.points.iter().filter(|point| point.x > 0.0);
        for point in fitted.points.iter().chain(free) {
            assert!((point.y - DEG * swing(point.x)).abs() < 1e-9, "{point:?}");
        }
        // The oscillation decays by dry friction alone, until the joint sticks.
        let dry = RobotParameterRow {
            damping_ratio: Estimate::MISSING,
            stiffness_nm_rad: Estimate::new(0.1, f64::NAN),
            joint_dry_nm: Estimate::new(0.003, f64::NAN),
            ..row.clone()
        };
        let figure = super::figure("release", &dry, &recording).expect("it swings, too");
        let notes = figure.panels[0].notes.concat();
        assert!(notes.contains("dry friction 0.003") && !notes.contains("damping"), "{notes}");
        let end = figure.panels[0].layers[1].points.last().expect("points");
        assert!((end.x - dry.swing().stops_s() - 0.2).abs() < 1e-9, "{end:?}");
        assert!((end.y - DEG * dry.decay_rad(9.0)).abs() < 1e-9, "{end:?}");
        let unknown = RobotParameterRow { released_s: f64::NAN, ..row };
        assert!(super::figure("release", &unknown, &recording).is_none());
    }
}
