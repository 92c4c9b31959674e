//! The metrics of one steady cycle (eq. 17 and 20).

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Lanes, Number, Pose, dot, skid_rows};

use super::Problem;
use super::element::Linearisation;
use super::extreme::Extremes;
use super::mesh::Mesh;
use super::path::Path;
use super::radau::{RADAU, STAGES};
use super::reduced::Reduced;

/// A steady cycle measured by the elements' own quadrature.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cycle<const N: usize> {
    pub metrics: GaitMetrics,
    /// Pose after the elements' span.
    pub end: Pose,
    /// Of joint 1, where it is passive.
    pub extremes: Option<Extremes<N>>,
}

/// Measures a periodic solution.
pub(super) fn measure<const N: usize, R: Reduced<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    path: &Path,
    workspace: &mut Linearisation,
) -> Cycle<N> {
    let problem = model.problem();
    let weights = RADAU.integrate[STAGES - 1];
    let end = path.end;
    let mut skid_squared = [0.0; 3];
    for (pack, leg) in path.legs.iter().enumerate().filter(|_| R::SKIDS) {
        let mut sums = [Lanes::default(); 3];
        for j in 0..STAGES {
            for (sum, row) in sums.iter_mut().zip(&skid_rows(&problem.robot, &leg.trig[j])) {
                let skid_m_s = dot(row, &leg.states[j].velocity);
                *sum += mesh.parts[pack] * Lanes::splat(weights[j]) * skid_m_s * skid_m_s;
            }
        }
        for lane in 0..mesh.elements_of(pack).len() {
            skid_squared.iter_mut().zip(&sums).for_each(|(sum, of)| *sum += of.lane(lane));
        }
    }
    let pose = if mesh.is_half { end * end.mirrored() } else { end };
    let periods = mesh.periods as f64;
    let (alpha1_rad, extremes) = match problem.gait.joints[0] {
        Some(command) => (command.half_range_rad(), None),
        None => {
            let extremes = Extremes::find(model, mesh, path, workspace);
            (extremes.half_range(), Some(extremes))
        }
    };
    let d_m = pose.x_m.hypot(pose.y_m) / periods;
    let metrics = GaitMetrics {
        d_m,
        v_m_s: d_m * problem.omega_rad_s / std::f64::consts::TAU,
        sigma: skid_squared.map(|sum| sum.sqrt() / skid_scale(problem)),
        alpha1_rad,
        dtheta_rad: pose.theta_rad / periods,
    };
    Cycle { metrics, end, extremes }
}

/// The characteristic speed `l omega` of eq. 20.
pub(super) fn skid_scale(problem: &Problem) -> f64 {
    problem.robot.l_m * problem.omega_rad_s
}
