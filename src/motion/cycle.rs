//! The metrics of one steady cycle (eq. 17 and 20) and their derivatives.

use super::element::Linearised;
use super::extreme::Extremes;
use super::path::{Pose, PoseRate, advance, advance_by};
use super::radau::{RADAU, STAGES};
use super::reduced::{Driven, Moment, Parameter, Reduced};
use super::ring::Ring;
use crate::metrics::GaitMetrics;
use crate::robot::{Trig, dot, skid_rows, skid_turns};

/// A steady cycle measured by the elements' own quadrature.
pub(super) struct Cycle {
    pub metrics: GaitMetrics,
    /// Pose after the elements' span.
    end: Pose,
    /// Of joint 1, where it is passive.
    extremes: Option<Extremes>,
}

/// Measures a periodic solution.
pub(super) fn measure<const N: usize, R: Reduced<N>>(
    model: &R,
    driven: &Driven,
    ring: &Ring<N, R>,
    room: &mut Linearised,
) -> Cycle {
    let weights = RADAU.integrate[STAGES - 1];
    let mut end = Pose::default();
    let mut skid_squared = [0.0; 3];
    for k in 0..ring.len() {
        let moments = moments(model, ring, k);
        end = advance(end, &moments, ring.element_s())[STAGES - 1];
        if driven.model_skids {
            for (moment, weight) in moments.iter().zip(weights) {
                let rows = skid_rows(&driven.robot, &Trig::new(moment.phi_rad));
                for (sum, row) in skid_squared.iter_mut().zip(&rows) {
                    *sum += weight * dot(row, &moment.velocity).powi(2);
                }
            }
        }
    }
    let pose = if ring.is_half() { with_mirror_image(end) } else { end };
    let (alpha1_rad, extremes) = match driven.gait.joints[0] {
        Some(command) => (command.amplitude_rad.abs(), None),
        None => {
            let extremes = Extremes::find(model, driven, ring, room);
            (extremes.half_range(), Some(extremes))
        }
    };
    let count = ring.len() as f64;
    let d_m = pose.x_m.hypot(pose.y_m);
    let metrics = GaitMetrics {
        d_m,
        v_m_s: d_m * driven.omega_rad_s / std::f64::consts::TAU,
        sigma: skid_squared.map(|sum| (sum / count).sqrt() / skid_scale(driven)),
        alpha1_rad,
        dtheta_rad: pose.theta_rad,
    };
    Cycle { metrics, end, extremes }
}

/// Derivative of the metrics by a parameter, the ring's `step` being that of its states.
pub(super) fn differentiate<const N: usize, R: Reduced<N>>(
    model: &R,
    driven: &Driven,
    ring: &Ring<N, R>,
    cycle: &Cycle,
    parameter: Parameter,
    room: &mut Linearised,
) -> GaitMetrics {
    let weights = RADAU.integrate[STAGES - 1];
    let (mut pose, mut rate) = (Pose::default(), PoseRate::default());
    let mut products = [0.0; 3];
    for k in 0..ring.len() {
        let moments = moments(model, ring, k);
        let changes = changes(model, ring, k, parameter);
        (pose, rate) = advance_by((pose, rate), &moments, &changes, ring.element_s());
        if driven.model_skids {
            for ((moment, change), weight) in moments.iter().zip(&changes).zip(weights) {
                let trig = Trig::new(moment.phi_rad);
                let rows = skid_rows(&driven.robot, &trig);
                let turns = skid_turns(&driven.robot, &trig);
                for (wheel, row) in rows.iter().enumerate() {
                    let mut skid = dot(row, &change.velocity);
                    if wheel > 0 {
                        let turned = dot(&turns[wheel - 1], &moment.velocity);
                        skid += turned * change.phi_rad[wheel - 1];
                    }
                    products[wheel] += weight * dot(row, &moment.velocity) * skid;
                }
            }
        }
    }
    let (whole, rate) = match ring.is_half() {
        true => (with_mirror_image(cycle.end), mirror_image_by(cycle.end, rate)),
        false => (cycle.end, rate),
    };
    let d_rate = (whole.x_m * rate.x + whole.y_m * rate.y) / cycle.metrics.d_m;
    let count = ring.len() as f64;
    let scale = skid_scale(driven).powi(2) * count;
    let sigma = std::array::from_fn(|wheel| match cycle.metrics.sigma[wheel] {
        0.0 => 0.0,
        sigma => products[wheel] / (scale * sigma),
    });
    let alpha1_rad = match (cycle.extremes, parameter) {
        (Some(extremes), _) => extremes.half_range_by(model, driven, ring, parameter, room),
        (None, Parameter::Amplitude(0)) => 1.0,
        (None, _) => 0.0,
    };
    GaitMetrics {
        d_m: d_rate,
        v_m_s: d_rate * driven.omega_rad_s / std::f64::consts::TAU,
        sigma,
        alpha1_rad,
        dtheta_rad: rate.theta,
    }
}

/// The characteristic speed `l omega` of eq. 20.
fn skid_scale(driven: &Driven) -> f64 {
    driven.robot.l_m * driven.omega_rad_s
}

fn moments<const N: usize, R: Reduced<N>>(
    model: &R,
    ring: &Ring<N, R>,
    k: usize,
) -> [Moment; STAGES] {
    let (nodes, _, stages) = ring.element(k);
    std::array::from_fn(|j| model.moment(&nodes[j], &stages[j]))
}

fn changes<const N: usize, R: Reduced<N>>(
    model: &R,
    ring: &Ring<N, R>,
    k: usize,
    parameter: Parameter,
) -> [Moment; STAGES] {
    let ((nodes, _, stages), steps) = (ring.element(k), ring.step(k));
    std::array::from_fn(|j| model.moment_by(&nodes[j], &stages[j], &steps[j], parameter))
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

fn mirror_image_by(half: Pose, rate: PoseRate) -> PoseRate {
    let (sin, cos) = half.theta_rad.sin_cos();
    let Pose { x_m: x, y_m: y, .. } = half;
    PoseRate {
        x: rate.x + cos * rate.x + sin * rate.y + (cos * y - sin * x) * rate.theta,
        y: rate.y + sin * rate.x - cos * rate.y + (cos * x + sin * y) * rate.theta,
        theta: 0.0,
    }
}
