//! Metrics of one steady-state cycle (eq. 17 and 20).

use trilink_robot::{Lanes, MAX_JOINTS, MAX_LINKS, Number, Pose};

use super::element::Linearisation;
use super::extreme::Extremes;
use super::mesh::Mesh;
use super::path::Path;
use super::radau::{RADAU, STAGES};
use super::reduced::Reduced;

/// Measurements on a steady-state cycle, by the quadrature rule of the collocation elements.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cycle {
    /// Displacement per cycle, m.
    pub d_m: f64,
    /// Rotation per cycle, rad.
    pub dtheta_rad: f64,
    /// Skid ratios of the wheels, followed by zeros.
    pub sigma: [f64; MAX_LINKS],
    /// Half the range of the angle of each free joint, rad.
    pub alpha_rad: [f64; MAX_JOINTS],
    /// Pose at the end of the time span of the mesh (one or more periods, or half of one).
    pub end: Pose,
}

/// Computes the metrics of a periodic solution, and the extremes of the angles of its free joints.
pub(super) fn measure<const N: usize, R: Reduced<N>>(
    model: &R,
    mesh: &Mesh<N, R>,
    path: &Path<N, R>,
    workspace: &mut Linearisation,
    extremes: &mut Vec<Extremes<N>>,
) -> Cycle {
    let weights = RADAU.integrate[STAGES - 1];
    let end = path.end;
    let wheels = model.wheels();
    let mut skid_squared = [0.0; MAX_LINKS];
    for (pack, leg) in path.legs.iter().enumerate().filter(|_| model.skids()) {
        let mut sums = [Lanes::default(); MAX_LINKS];
        for j in 0..STAGES {
            let node = &mesh.nodes(pack)[j];
            let skid_m_s = model.skid_m_s(node, &leg.states[j]);
            for (sum, skid_m_s) in sums.iter_mut().zip(skid_m_s).take(wheels) {
                *sum += mesh.fractions[pack] * Lanes::splat(weights[j]) * skid_m_s * skid_m_s;
            }
        }
        for lane in 0..mesh.elements_of(pack).len() {
            skid_squared.iter_mut().zip(&sums).for_each(|(total, sum)| *total += sum.lane(lane));
        }
    }
    let pose = if mesh.is_half { end * end.mirrored() } else { end };
    let periods = mesh.periods as f64;
    let mut alpha_rad = [0.0; MAX_JOINTS];
    extremes.clear();
    for joint in 0..R::ANGLES {
        let found = Extremes::find(joint, model, mesh, path, workspace);
        alpha_rad[joint] = found.half_range();
        extremes.push(found);
    }
    Cycle {
        d_m: pose.x_m.hypot(pose.y_m) / periods,
        dtheta_rad: pose.theta_rad / periods,
        sigma: skid_squared.map(|sum| sum.sqrt() / model.skid_scale_m_s()),
        alpha_rad,
        end,
    }
}
