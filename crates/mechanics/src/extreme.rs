//! Extremes of the angle of a free joint.
//!
//! The solution is far more accurate at the end of an element than at its stages. Each extreme is therefore
//! computed as the end of a shorter element with the same start.

use trilink_robot::{LANES, Number};

use super::element::{Element, Linearisation, Stages, interpolate, rate, solve_element};
use super::mesh::Mesh;
use super::path::Path;
use super::radau::{RADAU, STAGES, bisect};
use super::reduced::Reduced;

/// Maximum and minimum angle of a joint over a whole period.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extremes<const N: usize> {
    pub highest: TurningPoint<N>,
    pub lowest: TurningPoint<N>,
}

/// Turning point of a joint's angle.
#[derive(Debug, Clone, Copy)]
pub(super) struct TurningPoint<const N: usize> {
    phi_rad: f64,
    /// Index of the joint among the free joints.
    joint: usize,
    pub element: usize,
    /// Position within the collocation element, as a fraction of its length.
    pub fraction: f64,
    /// Sign of the angle: -1 if the turning point lies in the mirror-image half of the period.
    pub sign: f64,
    /// States at the stages of a shorter element, with the same start, that ends at the turning point; `None`
    /// until it is solved.
    stages: Option<Stages<N>>,
}

/// Correction to the position of a turning point, as a fraction of the element's length, after which the position is
/// accepted; the error in the angle is of third order in this fraction, and that in the position of second order.
const TOLERANCE: f64 = 3e-4;
/// Correction to the position, as a fraction of the element's length, below which a turning point has
/// converged.
const CONVERGED: f64 = 1e-8;
const MAX_CORRECTIONS: usize = 4;

impl<const N: usize> Extremes<N> {
    /// Finds the extremes of the angle of a free joint, given its index among the free joints, in a periodic solution.
    pub(crate) fn find<R: Reduced<N>>(
        joint: usize,
        model: &R,
        mesh: &Mesh<N, R>,
        path: &Path<N, R>,
        workspace: &mut Linearisation,
    ) -> Self {
        let mut found: Option<Self> = None;
        let signs: &[f64] = if mesh.is_half { &[1.0, -1.0] } else { &[1.0] };
        let start = model.kinematics(&mesh.node_at(model, 0, 0.0), &mesh.states.start);
        let [angle, joint_rate] = R::free_joint(&start, joint);
        let mut angles = [angle; STAGES + 1];
        let mut rates = [joint_rate; STAGES + 1];
        for k in 0..mesh.count {
            angles[0] = angles[STAGES];
            rates[0] = rates[STAGES];
            for (j, state) in path.legs[k / LANES].states.iter().enumerate() {
                let [angle, joint_rate] =
                    R::free_joint(state, joint).map(|value| value.lane(k % LANES));
                angles[j + 1] = angle;
                rates[j + 1] = joint_rate;
            }
            for l in 0..STAGES {
                let from = if l == 0 { 0.0 } else { RADAU.nodes[l - 1] };
                let fraction = if rates[l] * rates[l + 1] < 0.0 {
                    bisect(|x| RADAU.interpolate(&rates, x), from, RADAU.nodes[l], 12)
                } else {
                    RADAU.nodes[l]
                };
                for &sign in signs {
                    let phi_rad = sign * RADAU.interpolate(&angles, fraction);
                    let stages = None;
                    let point = TurningPoint { phi_rad, joint, element: k, fraction, sign, stages };
                    let extremes = found.get_or_insert(Self { highest: point, lowest: point });
                    if point.phi_rad > extremes.highest.phi_rad {
                        extremes.highest = point;
                    }
                    if point.phi_rad < extremes.lowest.phi_rad {
                        extremes.lowest = point;
                    }
                }
            }
        }
        let mut extremes = found.expect("a mesh has elements");
        extremes.highest.correct(model, mesh, workspace);
        if mesh.is_half {
            let TurningPoint { phi_rad, sign, .. } = extremes.highest;
            extremes.lowest = TurningPoint { phi_rad: -phi_rad, sign: -sign, ..extremes.highest };
        } else {
            extremes.lowest.correct(model, mesh, workspace);
        }
        extremes
    }

    /// Returns half the range between the maximum and the minimum angle, rad.
    pub(crate) fn half_range(&self) -> f64 {
        0.5 * (self.highest.phi_rad - self.lowest.phi_rad)
    }
}

impl<const N: usize> TurningPoint<N> {
    /// Returns the joint commands and the states at the stages of a shorter element, with the same start,
    /// that ends at the turning point; `None` if its states cannot be solved for.
    pub(crate) fn shorter_element<R: Reduced<N>>(
        &self,
        model: &R,
        mesh: &Mesh<N, R>,
        workspace: &mut Linearisation,
    ) -> Option<([R::Node<f64>; STAGES], Stages<N>)> {
        let nodes = RADAU.nodes.map(|c| mesh.node_at(model, self.element, self.fraction * c));
        if let Some(stages) = self.stages {
            return Some((nodes, stages));
        }
        let start = mesh.states.start_of(self.element);
        let whole = mesh.states.stages_of(self.element);
        let stages = RADAU.nodes.map(|c| interpolate(&start, &whole, self.fraction * c));
        workspace.resize::<N, R>(1);
        let duration_s = self.fraction * mesh.duration_s(self.element);
        let guess = Element { nodes: &nodes, start: &start, stages: &stages, duration_s };
        let stages = solve_element(model, &guess, 1e-12, workspace)?;
        Some((nodes, stages))
    }

    /// Moves the turning point to the zero of the joint's rate by Newton's method.
    fn correct<R: Reduced<N>>(
        &mut self,
        model: &R,
        mesh: &Mesh<N, R>,
        workspace: &mut Linearisation,
    ) {
        let start = mesh.states.start_of(self.element);
        let duration_s = mesh.duration_s(self.element);
        let [_, start_rate] = R::free_joint(
            &model.kinematics(&mesh.node_at(model, self.element, 0.0), &start),
            self.joint,
        );
        for _ in 0..MAX_CORRECTIONS {
            let Some((nodes, stages)) = self.shorter_element(model, mesh, workspace) else {
                return;
            };
            let values: [[f64; 2]; STAGES] = std::array::from_fn(|j| {
                R::free_joint(&model.kinematics(&nodes[j], &stages[j]), self.joint)
            });
            let last = STAGES - 1;
            let [phi, w] = values[last];
            let rates = values.map(|[_, w]| [w]);
            let per_s = 1.0 / (self.fraction * duration_s);
            let [acceleration] = rate(&RADAU, &[start_rate], &rates, last, per_s);
            let correction = -w / acceleration / duration_s;
            if !correction.is_finite() || correction.abs() > 0.5 {
                return;
            }
            // Vertex of the parabola: the error of the angle is of third order.
            self.phi_rad = self.sign * (phi - 0.5 * w * w / acceleration);
            if correction.abs() < CONVERGED {
                self.stages = Some(stages);
                return;
            }
            self.fraction += correction;
            if correction.abs() < TOLERANCE || self.fraction <= 0.0 {
                return;
            }
        }
    }
}
