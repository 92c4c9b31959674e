//! Metrics of one steady-state cycle (eq. 17 and 20).

use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Lanes, Number, Pose, dot, skid_rows};

use super::Problem;
use super::element::Linearisation;
use super::extreme::Extremes;
use super::mesh::Mesh;
use super::path::Path;
use super::radau::{RADAU, STAGES};
use super::reduced::Reduced;

/// Measurements on a steady-state cycle, by the quadrature rule of the collocation elements.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cycle<const N: usize> {
    pub metrics: GaitMetrics,
    /// Pose at the end of the time span of the mesh (one or more periods, or half of one).
    pub end: Pose,
    /// Extremes of the angle of joint 1; `None` unless the joint is passive.
    pub extremes: Option<Extremes<N>>,
}

/// Computes the metrics of a periodic solution.
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
                *sum += mesh.fractions[pack] * Lanes::splat(weights[j]) * skid_m_s * skid_m_s;
            }
        }
        for lane in 0..mesh.elements_of(pack).len() {
            skid_squared.iter_mut().zip(&sums).for_each(|(total, sum)| *total += sum.lane(lane));
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

/// Returns the speed `l omega` by which skid velocities are divided in the skid ratio (eq. 20 of the paper),
/// m/s.
pub(super) fn skid_scale(problem: &Problem) -> f64 {
    problem.robot.skid_length_m() * problem.omega_rad_s
}
