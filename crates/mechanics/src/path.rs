//! Where a solution goes: the robot's velocities and its way over the plane.

use trilink_robot::{Lanes, Number, Pose, Trig};

use super::element::integrals;
use super::mesh::{Mesh, in_turn};
use super::radau::STAGES;
use super::reduced::{KinematicState, Reduced};

/// The way of the elements of a mesh from the origin.
#[derive(Debug, Clone, Default)]
pub(super) struct Path {
    /// One for each pack.
    pub legs: Vec<Leg>,
    /// After the last element.
    pub end: Pose,
}

/// The way of the elements of a pack, one in each lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leg {
    /// At the stages.
    pub states: [KinematicState<Lanes>; STAGES],
    pub trig: [Trig<Lanes>; STAGES],
    /// Sine and cosine of the heading at the stages.
    pub directions: [(Lanes, Lanes); STAGES],
    /// Velocities of link 0 along the world's axes at the stages, m/s.
    pub rates: [[Lanes; STAGES]; 2],
    /// Where the elements end, m.
    pub ends: [Lanes; 2],
}

impl Path {
    /// Follows the solution on a mesh.
    pub(crate) fn follow<const N: usize, R: Reduced<N>>(&mut self, model: &R, mesh: &Mesh<N, R>) {
        let Self { legs, end } = self;
        (*end, _) = (Pose::default(), legs.clear());
        for pack in 0..mesh.packs() {
            let count = mesh.elements_of(pack).len();
            let (nodes, stages) = (mesh.nodes(pack), &mesh.states.packs[pack]);
            let zero = Lanes::default();
            let mut states = [KinematicState::default(); STAGES];
            let mut trig = [Trig { s: [zero; 2], c: [zero; 2] }; STAGES];
            let mut turning = [zero; STAGES];
            for j in 0..STAGES {
                states[j] = model.kinematics(&nodes[j], &stages[j]);
                trig[j] = model.trig(&nodes[j], &stages[j]);
                turning[j] = states[j].velocity[2];
            }
            let turned = integrals(&turning, mesh.durations_s[pack]);
            let added = turned[STAGES - 1];
            let start = in_turn(&mut end.theta_rad, count, |at, lane| at + added.lane(lane));
            let (mut directions, mut rates) = ([(zero, zero); STAGES], [[zero; STAGES]; 2]);
            for j in 0..STAGES {
                let (sin, cos) = Number::sin_cos(start + turned[j]);
                let [u, v, ..] = states[j].velocity;
                (rates[0][j], rates[1][j]) = (cos * u - sin * v, sin * u + cos * v);
                directions[j] = (sin, cos);
            }
            let mut ends = [&mut end.x_m, &mut end.y_m];
            let ends = std::array::from_fn(|i| {
                let added = integrals(&rates[i], mesh.durations_s[pack])[STAGES - 1];
                added + in_turn(ends[i], count, |at, lane| at + added.lane(lane))
            });
            legs.push(Leg { states, trig, directions, rates, ends });
        }
    }
}
