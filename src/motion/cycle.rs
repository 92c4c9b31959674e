//! The metrics of one steady cycle (eq. 17 and 20).

use super::element::Linearised;
use super::extreme::Extremes;
use super::path::advance;
use super::radau::{RADAU, STAGES};
use super::reduced::{Driven, Moment, Reduced};
use super::ring::Ring;
use crate::metrics::GaitMetrics;
use crate::robot::{Pose, Trig, dot, skid_rows};

/// A steady cycle measured by the elements' own quadrature.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cycle {
    pub metrics: GaitMetrics,
    /// Pose after the elements' span.
    pub end: Pose,
    /// Of joint 1, where it is passive.
    pub extremes: Option<Extremes>,
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
    let pose = if ring.is_half() { end * end.mirrored() } else { end };
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

/// The characteristic speed `l omega` of eq. 20.
pub(super) fn skid_scale(driven: &Driven) -> f64 {
    driven.robot.l_m * driven.omega_rad_s
}

pub(super) fn moments<const N: usize, R: Reduced<N>>(
    model: &R,
    ring: &Ring<N, R>,
    k: usize,
) -> [Moment; STAGES] {
    let (nodes, _, stages) = ring.element(k);
    std::array::from_fn(|j| model.moment(&nodes[j], &stages[j]))
}
