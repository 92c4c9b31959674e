//! The extremes of joint 1 where it is passive.
//!
//! The ends of elements are far more accurate than the stages inside, so an extreme is made the
//! end of a shorter element from the same start.

use trilink_robot::{LANES, Number};

use super::element::{Element, Linearisation, Stages, interpolate, rate, solve_element};
use super::mesh::Mesh;
use super::path::Path;
use super::radau::{RADAU, STAGES, bisect};
use super::reduced::{KinematicState, Reduced};

/// Highest and lowest angle of joint 1 over a whole period.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extremes<const N: usize> {
    pub highest: TurningPoint<N>,
    pub lowest: TurningPoint<N>,
}

/// Where joint 1 turns round.
#[derive(Debug, Clone, Copy)]
pub(super) struct TurningPoint<const N: usize> {
    phi_rad: f64,
    pub element: usize,
    /// Fraction of the element.
    pub fraction: f64,
    /// -1 in the mirror image that follows half a period later.
    pub sign: f64,
    /// The stages of the shorter element that ends there, where they are known.
    stages: Option<Stages<N>>,
}

/// Error, as a fraction of an element, of a turning point; the angle's is its third power.
const TOLERANCE: f64 = 1e-5;
/// The same of one that need not be corrected once more.
const THERE: f64 = 1e-8;
const MOST_CORRECTIONS: usize = 4;

impl<const N: usize> Extremes<N> {
    /// Finds the extremes of a periodic solution.
    pub(crate) fn find<R: Reduced<N>>(
        model: &R,
        mesh: &Mesh<N, R>,
        path: &Path,
        workspace: &mut Linearisation,
    ) -> Self {
        let mut found: Option<Self> = None;
        let signs: &[f64] = if mesh.is_half { &[1.0, -1.0] } else { &[1.0] };
        let start = model.kinematics(&mesh.node_at(model, 0, 0.0), &mesh.states.start);
        let (mut angles, mut rates) =
            ([start.phi_rad[0]; STAGES + 1], [start.velocity[3]; STAGES + 1]);
        for k in 0..mesh.count {
            (angles[0], rates[0]) = (angles[STAGES], rates[STAGES]);
            for (j, KinematicState { phi_rad, velocity }) in
                path.legs[k / LANES].states.iter().enumerate()
            {
                let lane = k % LANES;
                (angles[j + 1], rates[j + 1]) = (phi_rad[0].lane(lane), velocity[3].lane(lane));
            }
            for l in 0..STAGES {
                let from = if l == 0 { 0.0 } else { RADAU.nodes[l - 1] };
                let fraction = match rates[l] * rates[l + 1] < 0.0 {
                    true => bisect(|x| RADAU.interpolate(&rates, x), from, RADAU.nodes[l], 12),
                    false => RADAU.nodes[l],
                };
                for &sign in signs {
                    let phi_rad = sign * RADAU.interpolate(&angles, fraction);
                    let point = TurningPoint { phi_rad, element: k, fraction, sign, stages: None };
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

    /// Half the distance between the extremes, rad.
    pub(crate) fn half_range(&self) -> f64 {
        0.5 * (self.highest.phi_rad - self.lowest.phi_rad)
    }
}

impl<const N: usize> TurningPoint<N> {
    /// The shorter element that ends at the turning point: its nodes and stages.
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
        let (start, whole) =
            (mesh.states.start_of(self.element), mesh.states.stages_of(self.element));
        let stages = RADAU.nodes.map(|c| interpolate(&start, &whole, self.fraction * c));
        workspace.resize::<N, R>(1);
        let duration_s = self.fraction * mesh.duration_s(self.element);
        let guess = Element { nodes: &nodes, start: &start, stages: &stages, duration_s };
        let stages = solve_element(model, &guess, 1e-12, workspace)?;
        Some((nodes, stages))
    }

    /// Moves the turning point to where the rate is zero.
    fn correct<R: Reduced<N>>(
        &mut self,
        model: &R,
        mesh: &Mesh<N, R>,
        workspace: &mut Linearisation,
    ) {
        let (start, duration_s) =
            (mesh.states.start_of(self.element), mesh.duration_s(self.element));
        let start_rate =
            model.kinematics(&mesh.node_at(model, self.element, 0.0), &start).velocity[3];
        for _ in 0..MOST_CORRECTIONS {
            let Some((nodes, stages)) = self.shorter_element(model, mesh, workspace) else {
                return;
            };
            let states: [KinematicState; STAGES] =
                std::array::from_fn(|j| model.kinematics(&nodes[j], &stages[j]));
            let last = STAGES - 1;
            let (phi, w) = (states[last].phi_rad[0], states[last].velocity[3]);
            let rates = states.map(|state| [state.velocity[3]]);
            let per_s = 1.0 / (self.fraction * duration_s);
            let [acceleration] = rate(&RADAU, &[start_rate], &rates, last, per_s);
            let correction = -w / acceleration / duration_s;
            if !correction.is_finite() || correction.abs() > 0.5 {
                return;
            }
            // The parabola's vertex: the error of the angle is of third order.
            self.phi_rad = self.sign * (phi - 0.5 * w * w / acceleration);
            if correction.abs() < THERE {
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
