//! Fig. 8: the passive joint let go, and the decay that its parameters give.

use nalgebra::{Matrix2, Vector2};

use super::common::DEG;
use crate::metrics::Estimate;
use crate::report::drawing::{Figure, Layer, Layout, Panel, style};
use crate::report::numbers::{significant, with_error};
use crate::report::recording::Recording;
use crate::store::RobotParameterRow;

/// The joint swings freely from where it is this part of its largest angle from its rest.
const FREE: f64 = 0.8;
/// What is left of the swing at the end of what is drawn.
const REST: f64 = 0.005;
/// Time before the release that is drawn, s.
const BEFORE_S: f64 = 0.2;
const POINTS: usize = 400;

/// The figure of one release; `None` where the tables do not tell of a swing.
pub fn figure(row: &RobotParameterRow, recording: &Recording) -> Option<Figure> {
    let joint = usize::try_from(row.joint - 1).ok().filter(|joint| *joint < 2)?;
    let phi = &recording.phi_rad[joint];
    let decay = Decay::fit(row, &recording.time_s, phi)?;
    let released_s = decay.released_s;
    let shown = recording.between(released_s - BEFORE_S, decay.end_s);
    let seen = shown.map(|i| (recording.time_s[i] - released_s, DEG * phi[i]));
    let fitted = (0..=POINTS).map(|i| {
        let time_s = (decay.end_s - released_s) * i as f64 / POINTS as f64;
        (time_s, DEG * decay.at(time_s))
    });
    let of = |estimate: Estimate| with_error(estimate.value, estimate.se);
    let [natural, ratio] = [of(row.natural_rad_s), of(row.damping_ratio)];
    let panel = Panel {
        notes: vec![
            format!("natural frequency {natural} rad/s"),
            format!("damping ratio {ratio}"),
            format!("by logarithmic decrement {}", of(row.damping_ratio_decrement)),
        ],
        ..Panel::new(
            format!("Joint {} of robot {}", row.joint, row.robot),
            "Time after release (s)",
            format!("φ{} (deg)", ["₁", "₂"][joint]),
            vec![
                Layer::new("measured", seen, style::RECORDED),
                Layer::new("fitted decay", fitted, style::FITTED),
                Layer::level("rest", DEG * row.rest_angle_rad.value),
            ],
        )
    };
    Some(Figure {
        caption: format!(
            "Trial {}: the joint is let go with the other links held and the wheels off the floor. \
             With the link's configured moment of inertia about the joint, {} kg m², k_τ = {} N \
             m/rad and c_τ = {} N m s/rad. Dashed: angle of rest.",
            row.trial,
            significant(row.inertia_kg_m2, 4),
            of(row.stiffness_nm_rad),
            of(row.damping_nm_s_rad),
        ),
        layout: Layout::Stack,
        ..Figure::new(
            "fig08",
            format!("Release of the passive joint of robot {}", row.robot),
            &[],
            vec![panel],
        )
    })
}

/// `rest + exp(-decay t) (a cos + b sin)(damped t)` with `t` from the release.
struct Decay {
    rest_rad: f64,
    decay_1_s: f64,
    damped_rad_s: f64,
    amplitudes_rad: [f64; 2],
    released_s: f64,
    end_s: f64,
}

impl Decay {
    /// The decay of the trial's frequency and damping that is nearest to what was seen.
    fn fit(row: &RobotParameterRow, time_s: &[f64], phi_rad: &[f64]) -> Option<Self> {
        let [rest_rad, ratio, natural_rad_s] =
            [row.rest_angle_rad, row.damping_ratio, row.natural_rad_s].map(|of| of.value);
        let decay_1_s = ratio * natural_rad_s;
        let damped_rad_s = natural_rad_s * (1.0 - ratio.powi(2)).sqrt();
        let swing = |i: &usize| (phi_rad[*i] - rest_rad).abs();
        let seen = (0..phi_rad.len().min(time_s.len())).filter(|i| phi_rad[*i].is_finite());
        let largest = seen.clone().max_by(|a, b| swing(a).total_cmp(&swing(b)))?;
        let free = seen.clone().filter(|i| *i > largest);
        let first = free.clone().find(|i| swing(i) < FREE * swing(&largest))?;
        let released_s = time_s[first];
        let end_s = released_s - REST.ln() / decay_1_s;
        if !(damped_rad_s > 0.0 && end_s > released_s) {
            return None;
        }
        let mut decay =
            Self { rest_rad, decay_1_s, damped_rad_s, amplitudes_rad: [0.0; 2], released_s, end_s };
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for i in free.filter(|i| *i >= first && time_s[*i] <= end_s) {
            let waves = Vector2::from(decay.waves(time_s[i] - released_s));
            normal += waves * waves.transpose();
            right += waves * (phi_rad[i] - rest_rad);
        }
        decay.amplitudes_rad = (normal.try_inverse()? * right).into();
        Some(decay)
    }

    fn waves(&self, time_s: f64) -> [f64; 2] {
        let left = (-self.decay_1_s * time_s).exp();
        let (sin, cos) = (self.damped_rad_s * time_s).sin_cos();
        [left * cos, left * sin]
    }

    fn at(&self, time_s: f64) -> f64 {
        let [cos, sin] = self.waves(time_s);
        self.rest_rad + self.amplitudes_rad[0] * cos + self.amplitudes_rad[1] * sin
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Rows as _;

    #[test]
    fn the_decay_drawn_is_the_one_seen() {
        let row = RobotParameterRow {
            joint: 1,
            natural_rad_s: Estimate::new(10.0, f64::NAN),
            damping_ratio: Estimate::new(0.2, f64::NAN),
            rest_angle_rad: Estimate::new(0.05, f64::NAN),
            ..RobotParameterRow::blank()
        };
        let damped = 10.0 * (1.0_f64 - 0.04).sqrt();
        let swing = |time_s: f64| {
            0.05 + 0.4
                * (-2.0 * time_s).exp()
                * ((damped * time_s).cos() + 0.2 * (damped * time_s).sin())
        };
        let time_s: Vec<f64> = (0..480).map(|i| i as f64 / 120.0).collect();
        let held = |t: f64| if t < 1.0 { swing(0.0) } else { swing(t - 1.0) };
        let mut phi: Vec<f64> = time_s.iter().map(|t| held(*t)).collect();
        phi[150] = f64::NAN;
        let decay = Decay::fit(&row, &time_s, &phi).expect("it swings");
        for t in [0.0, 0.3, 1.1] {
            let seen = swing(decay.released_s - 1.0 + t);
            assert!((decay.at(t) - seen).abs() < 1e-9, "{t}: {} {seen}", decay.at(t));
        }
        assert!(Decay::fit(&row, &time_s, &vec![0.05; 480]).is_none());
    }
}
