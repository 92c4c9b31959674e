//! Figure of a coast-down: the speed of the robot after a push, with the fitted resistance law.

use minijinja::context;
use trilink_plot::{Figure, Layer, Layout, Panel};
use trilink_tables::RobotParameterRow;

use super::texts::texts;
use crate::looks;
use crate::recording::Recording;

/// Speeds between which the fitted law is drawn, as fractions of the highest speed.
const FITTED: [f64; 2] = [0.95, 0.1];
const POINTS: usize = 200;

/// Returns the figure of a coast-down; `None` if no law was identified.
pub(super) fn figure(stem: &str, row: &RobotParameterRow, recording: &Recording) -> Option<Figure> {
    let law = row.law?;
    let (_, fit) = row.laws().into_iter().find(|(of, _)| *of == law)?;
    let term = |value: f64| if value.is_finite() { value / row.mass_kg } else { 0.0 };
    let [viscous_1_s, dry_m_s2] = [fit.roll_sum_kg_s.value, fit.roll_dry_sum_n.value].map(term);
    let speed = recording.roll_m_s[0].iter().map(|of| of.abs());
    let measured: Vec<(f64, f64)> = recording.time_s.iter().copied().zip(speed).collect();
    let known = measured.iter().filter(|(_, speed)| speed.is_finite());
    let (fastest_s, highest) = *known.clone().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let coasting = known.filter(|(time_s, _)| *time_s > fastest_s);
    let coasting: Vec<(f64, f64)> = coasting
        .copied()
        .skip_while(|(_, speed)| *speed > FITTED[0] * highest)
        .take_while(|(_, speed)| *speed > FITTED[1] * highest)
        .collect();
    let (start_s, end_s) = (coasting.first()?.0, coasting.last()?.0);
    // The speed is `remaining v_0 - lost`, where v_0 is the speed at the start.
    let parts = |time_s: f64| {
        let after_s = time_s - start_s;
        let remaining = (-viscous_1_s * after_s).exp();
        let lost = if viscous_1_s > 0.0 {
            dry_m_s2 / viscous_1_s * (1.0 - remaining)
        } else {
            dry_m_s2 * after_s
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
    let panel = Panel::new("Speed of the middle wheel", "Time (s)", "Speed (mm/s)", layers);
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
        let roll_m_s = [roll, Vec::new(), Vec::new()];
        let recording = Recording { time_s, roll_m_s, ..Recording::default() };
        let figure = figure("coast", &row, &recording).expect("it coasts");
        let curve = &figure.panels[0].layers[1].points;
        assert!(curve.len() > 100 && curve[0].x > 1.0);
        for point in curve {
            assert!((point.y - 1e3 * speed(point.x)).abs() < 1e-6, "{point:?}");
        }
        let none = RobotParameterRow { law: None, ..row };
        assert!(super::figure("coast", &none, &recording).is_none());
    }
}
