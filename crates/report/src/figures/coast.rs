//! Figure of a coast-down: the speed of the robot after a push, with the fitted resistance law.

use minijinja::context;
use trilink_plot::{Figure, Layer, Layout, Panel};
use trilink_robot::decay::coasting;
use trilink_tables::RobotParameterRow;

use super::texts::texts;
use crate::looks;
use crate::recording::Recording;

/// Number of intervals into which the fitted curve is divided.
const POINTS: usize = 200;

/// Returns the figure of a coast-down; `None` if no law was identified. `transition_m_s` is the transition speed of the
/// robot's dry friction; `links` are the names of the links by number.
pub(super) fn figure(
    stem: &str,
    row: &RobotParameterRow,
    recording: &Recording,
    transition_m_s: f64,
    links: &[String],
) -> Option<Figure> {
    let law = row.law?;
    let (_, fit) = row.laws().into_iter().find(|(of, _)| *of == law)?;
    let term = |value: f64| if value.is_finite() { value / row.mass_kg } else { 0.0 };
    let [viscous_1_s, dry_m_s2] = [fit.roll_sum_kg_s.value, fit.roll_dry_sum_n.value].map(term);
    let rolls = |roll_m_s: &Vec<f64>| roll_m_s.iter().any(|v| v.is_finite());
    let link = recording.roll_m_s.iter().position(rolls)?;
    let roll_m_s = &recording.roll_m_s[link];
    let speed = roll_m_s.iter().map(|of| of.abs());
    let measured: Vec<(f64, f64)> = recording.time_s.iter().copied().zip(speed).collect();
    let coasting = &measured[coasting(roll_m_s, transition_m_s)];
    let known = coasting.iter().copied().filter(|(_, speed)| speed.is_finite());
    let coasting: Vec<(f64, f64)> = known.collect();
    let (start_s, end_s) = (coasting.first()?.0, coasting.last()?.0);
    // The speed is `remaining v_0 - lost`, where v_0 is the speed at the start.
    let parts = |time_s: f64| {
        let after_s = time_s - start_s;
        let remaining = (-viscous_1_s * after_s).exp();
        let lost = match viscous_1_s * after_s {
            0.0 => dry_m_s2 * after_s,
            decay => dry_m_s2 * after_s * -(-decay).exp_m1() / decay,
        };
        (remaining, lost)
    };
    // Least squares for v_0, the only number of the curve that the tables do not contain.
    let sums = coasting.iter().fold([0.0; 2], |[above, below], (time_s, speed)| {
        let (remaining, lost) = parts(*time_s);
        [above + remaining * (speed + lost), below + remaining * remaining]
    });
    let start_m_s = sums[0] / sums[1];
    let fitted = (0..=POINTS).map(|i| {
        let time_s = start_s + (end_s - start_s) * i as f64 / POINTS as f64;
        let (remaining, lost) = parts(time_s);
        (time_s, 1e3 * (remaining * start_m_s - lost))
    });
    let measured = measured.iter().map(|(time_s, speed)| (*time_s, 1e3 * speed));
    let layers = vec![
        Layer::new("measured", measured, looks::RECORDED),
        Layer::new("fitted law", fitted, looks::FITTED),
    ];
    let title =
        format!("Speed of the {} wheel", links.get(link).map_or("measured", String::as_str));
    let panel = Panel::new(title, "Time (s)", "Speed (mm/s)", layers);
    let values = context! {
        trial => &row.trial,
        law => law.name(),
        roll => super::release::known(fit.roll_sum_kg_s),
        dry => super::release::known(fit.roll_dry_sum_n),
    };
    Some(Figure::new(stem, texts("coast", values), &[], Layout::Stack, vec![panel]))
}

#[cfg(test)]
mod tests {
    use trilink_robot::decay::DecayLaw;
    use trilink_statistics::Estimate;
    use trilink_tables::{Columns as _, DecayFit};

    use super::*;

    #[test]
    fn the_plotted_law_is_the_fitted_one() {
        let fit = DecayFit {
            roll_sum_kg_s: Estimate::new(1.2, 0.1),
            roll_dry_sum_n: Estimate::new(0.3, 0.1),
            ..DecayFit::blank()
        };
        let row = RobotParameterRow {
            law: Some(DecayLaw::CoulombViscous),
            mass_kg: 3.0,
            coulomb_viscous: fit,
            ..RobotParameterRow::blank()
        };
        let speed = |t: f64| if t < 1.0 { 0.5 * t } else { 0.75 * (-0.4 * (t - 1.0)).exp() - 0.25 };
        let time_s: Vec<f64> = (0..300).map(|i| 0.01 * f64::from(i)).collect();
        // The robot was pushed backwards.
        let roll = time_s.iter().map(|t| -speed(*t)).collect();
        let roll_m_s = vec![roll];
        let recording = Recording { time_s, roll_m_s, ..Recording::default() };
        let figure = figure("coast", &row, &recording, 0.0, &[]).expect("it coasts");
        let curve = &figure.panels[0].layers[1].points;
        assert!(curve.len() > 100 && curve[0].x > 1.0);
        for point in curve {
            assert!((point.y - 1e3 * speed(point.x)).abs() < 1e-6, "{point:?}");
        }
        let none = RobotParameterRow { law: None, ..row };
        assert!(super::figure("coast", &none, &recording, 0.0, &[]).is_none());
    }
}
