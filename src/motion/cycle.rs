//! The metrics of one steady cycle (eq. 17 and 20).

use super::Problem;
use super::element::{Linearisation, integrate_poses};
use super::extreme::Extremes;
use super::mesh::Mesh;
use super::radau::{RADAU, STAGES};
use super::reduced::Reduced;
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
    mesh: &Mesh<N, R>,
    workspace: &mut Linearisation,
) -> Cycle {
    let problem = model.problem();
    let weights = RADAU.integrate[STAGES - 1];
    let mut end = Pose::default();
    let mut skid_squared = [0.0; 3];
    for element in mesh.elements() {
        let states = element.kinematics(model);
        [.., end] = integrate_poses(end, &states, element.duration_s);
        if R::SKIDS {
            for (state, weight) in states.iter().zip(weights) {
                let rows = skid_rows(&problem.robot, &Trig::new(state.phi_rad));
                for (sum, row) in skid_squared.iter_mut().zip(&rows) {
                    *sum += weight * dot(row, &state.velocity).powi(2);
                }
            }
        }
    }
    let pose = if mesh.is_half { end * end.mirrored() } else { end };
    let (alpha1_rad, extremes) = match problem.gait.joints[0] {
        Some(command) => (command.amplitude_rad.abs(), None),
        None => {
            let extremes = Extremes::find(model, mesh, workspace);
            (extremes.half_range(), Some(extremes))
        }
    };
    let count = mesh.len() as f64;
    let d_m = pose.x_m.hypot(pose.y_m);
    let metrics = GaitMetrics {
        d_m,
        v_m_s: d_m * problem.omega_rad_s / std::f64::consts::TAU,
        sigma: skid_squared.map(|sum| (sum / count).sqrt() / skid_scale(problem)),
        alpha1_rad,
        dtheta_rad: pose.theta_rad,
    };
    Cycle { metrics, end, extremes }
}

/// The characteristic speed `l omega` of eq. 20.
pub(super) fn skid_scale(problem: &Problem) -> f64 {
    problem.robot.l_m * problem.omega_rad_s
}
