//! Path of the robot in the plane, integrated from its velocities.

use trilink_robot::{Lanes, Number, Pose, Trig};

use super::element::integrals;
use super::mesh::{Mesh, accumulate_lanes};
use super::radau::STAGES;
use super::reduced::{KinematicState, Reduced};

/// Path of the robot over the elements of a mesh, starting at the origin.
#[derive(Debug, Clone, Default)]
pub(super) struct Path {
    /// Path segments, one per pack of elements.
    pub legs: Vec<Leg>,
    /// Pose after the last element.
    pub end: Pose,
}

/// Path over the elements in a pack, one element per lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leg {
    /// Velocities and joint angles at the stages.
    pub states: [KinematicState<Lanes>; STAGES],
    pub trig: [Trig<Lanes>; STAGES],
    /// Sine and cosine of the heading of link 0 at the stages.
    pub directions: [(Lanes, Lanes); STAGES],
    /// Velocities of link 0 along the world axes at the stages, m/s.
    pub rates: [[Lanes; STAGES]; 2],
    /// Positions (x, y) of link 0 at the ends of the elements, m.
    pub ends: [Lanes; 2],
}

impl Path {
    /// Computes the path, which starts at the origin, from the velocities of the solution on a mesh.
    pub(crate) fn follow<const N: usize, R: Reduced<N>>(&mut self, model: &R, mesh: &Mesh<N, R>) {
        let Self { legs, end } = self;
        *end = Pose::default();
        legs.clear();
        for pack in 0..mesh.packs() {
            let count = mesh.elements_of(pack).len();
            let nodes = mesh.nodes(pack);
            let stages = &mesh.states.packs[pack];
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
            let start =
                accumulate_lanes(&mut end.theta_rad, count, |at, lane| at + added.lane(lane));
            let mut directions = [(zero, zero); STAGES];
            let mut rates = [[zero; STAGES]; 2];
            for j in 0..STAGES {
                let (sin, cos) = Number::sin_cos(start + turned[j]);
                let [u, v, ..] = states[j].velocity;
                rates[0][j] = cos * u - sin * v;
                rates[1][j] = sin * u + cos * v;
                directions[j] = (sin, cos);
            }
            let mut ends = [&mut end.x_m, &mut end.y_m];
            let ends = std::array::from_fn(|i| {
                let added = integrals(&rates[i], mesh.durations_s[pack])[STAGES - 1];
                added + accumulate_lanes(ends[i], count, |at, lane| at + added.lane(lane))
            });
            legs.push(Leg { states, trig, directions, rates, ends });
        }
    }
}
