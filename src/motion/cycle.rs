//! The metrics of one steady cycle (eq. 17 and 20).

use super::path::{Pose, advance};
use super::periodic::Orbit;
use super::radau::{RADAU, STAGES};
use super::reduced::{Driven, Moment, Reduced};
use crate::metrics::GaitMetrics;
use crate::robot::{Trig, dot, skid_rows};

/// Metrics of a periodic solution, by the elements' own quadrature.
pub(super) fn metrics<const N: usize, R: Reduced<N>>(
    model: &R,
    driven: &Driven,
    orbit: &Orbit<N>,
) -> GaitMetrics {
    let span_s = orbit.element_s * orbit.elements.len() as f64;
    let period_s = if orbit.is_half { 2.0 * span_s } else { span_s };
    let weights = RADAU.integrate[STAGES - 1];
    let mut pose = Pose::default();
    let mut skid_squared = [0.0; 3];
    let mut joint1 = Range::default();
    for (k, stages) in orbit.elements.iter().enumerate() {
        let begin_s = k as f64 * orbit.element_s;
        let moment = |part: f64, y: &[f64; N]| {
            model.moment(&model.node(driven.omega_rad_s * (begin_s + part * orbit.element_s)), y)
        };
        let moments: [Moment; STAGES] = std::array::from_fn(|j| moment(RADAU.nodes[j], &stages[j]));
        pose = advance(pose, &moments, orbit.element_s)[STAGES - 1];
        for (moment, weight) in moments.iter().zip(weights) {
            let rows = skid_rows(&driven.robot, &Trig::new(moment.phi_rad));
            for (sum, row) in skid_squared.iter_mut().zip(&rows) {
                *sum += weight * dot(row, &moment.velocity).powi(2);
            }
        }
        joint1.take_in(&moment(0.0, &orbit.start(k)), &moments);
    }
    if orbit.is_half {
        pose = with_mirror_image(pose);
        joint1.low = joint1.low.min(-joint1.high);
        joint1.high = joint1.high.max(-joint1.low);
    }
    let speed = driven.robot.l_m * driven.omega_rad_s;
    let d_m = pose.x_m.hypot(pose.y_m);
    let count = orbit.elements.len() as f64;
    GaitMetrics {
        d_m,
        v_m_s: d_m / period_s,
        sigma: match driven.model_skids {
            true => skid_squared.map(|sum| (sum / count).sqrt() / speed),
            false => [0.0; 3],
        },
        alpha1_rad: match driven.gait.joints[0] {
            Some(command) => command.amplitude_rad.abs(),
            None => 0.5 * (joint1.high - joint1.low),
        },
        dtheta_rad: pose.theta_rad,
    }
}

/// The pose after a half period and its mirror image.
fn with_mirror_image(half: Pose) -> Pose {
    let (sin, cos) = half.theta_rad.sin_cos();
    Pose {
        x_m: half.x_m + cos * half.x_m + sin * half.y_m,
        y_m: half.y_m + sin * half.x_m - cos * half.y_m,
        theta_rad: 0.0,
    }
}

/// Range of an angle over a motion, extremes between the stages included.
struct Range {
    low: f64,
    high: f64,
}

impl Default for Range {
    fn default() -> Self {
        Self { low: f64::INFINITY, high: f64::NEG_INFINITY }
    }
}

impl Range {
    fn take_in(&mut self, start: &Moment, moments: &[Moment; STAGES]) {
        let all: [&Moment; STAGES + 1] =
            std::array::from_fn(|l| if l == 0 { start } else { &moments[l - 1] });
        let angles = all.map(|moment| moment.phi_rad[0]);
        let rates = all.map(|moment| moment.velocity[3]);
        self.include(angles[STAGES]);
        for l in 0..STAGES {
            if rates[l] * rates[l + 1] < 0.0 {
                let from = if l == 0 { 0.0 } else { RADAU.nodes[l - 1] };
                self.include(RADAU.interpolate(&angles, zero(&rates, from, RADAU.nodes[l])));
            }
        }
    }

    fn include(&mut self, angle: f64) {
        self.low = self.low.min(angle);
        self.high = self.high.max(angle);
    }
}

/// Where the polynomial through `values` changes its sign, by bisection. An extreme is flat:
/// this many halvings put its value right to the last digit.
fn zero(values: &[f64; STAGES + 1], mut low: f64, mut high: f64) -> f64 {
    let rising = RADAU.interpolate(values, high) > 0.0;
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if (RADAU.interpolate(values, middle) > 0.0) == rising {
            high = middle;
        } else {
            low = middle;
        }
    }
    0.5 * (low + high)
}
