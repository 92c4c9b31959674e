//! Path of the robot in the plane, integrated from its velocities.

use trilink_robot::{Lanes, Number, Pose};

use super::element::integrals;
use super::mesh::{Mesh, accumulate_lanes, renew};
use super::radau::STAGES;
use super::reduced::Reduced;

/// Path of the robot over the elements of a mesh, starting at the origin.
#[derive(Debug, Clone)]
pub(super) struct Path<const N: usize, R: Reduced<N>> {
    /// Path segments, one per pack of elements.
    pub legs: Vec<Leg<N, R>>,
    /// Pose after the last element.
    pub end: Pose,
}

/// Path over the elements in a pack, one element per lane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leg<const N: usize, R: Reduced<N>> {
    /// Velocities and joint angles at the stages.
    pub states: [R::State<Lanes>; STAGES],
    /// Sine and cosine of the heading of link 0 at the stages.
    pub directions: [(Lanes, Lanes); STAGES],
    /// Velocities of link 0 along the world axes at the stages, m/s.
    pub rates: [[Lanes; STAGES]; 2],
    /// Positions (x, y) of link 0 at the ends of the elements, m.
    pub ends: [Lanes; 2],
}

impl<const N: usize, R: Reduced<N>> Default for Path<N, R> {
    fn default() -> Self {
        Self { legs: Vec::new(), end: Pose::default() }
    }
}

impl<const N: usize, R: Reduced<N>> Path<N, R> {
    /// Computes the path, which starts at the origin, from the velocities of the solution on a mesh.
    pub(crate) fn follow(&mut self, model: &R, mesh: &Mesh<N, R>) {
        let Self { legs, end } = self;
        *end = Pose::default();
        renew(legs, mesh.packs());
        for pack in 0..mesh.packs() {
            let count = mesh.elements_of(pack).len();
            let nodes = mesh.nodes(pack);
            let stages = &mesh.states.packs[pack];
            let zero = Lanes::default();
            let states: [R::State<Lanes>; STAGES] =
                std::array::from_fn(|j| model.kinematics(&nodes[j], &stages[j]));
            let bodies = states.each_ref().map(R::body);
            let turning = bodies.map(|[_, _, turning]| turning);
            let turned = integrals(&turning, mesh.durations_s[pack]);
            let added = turned[STAGES - 1];
            let start =
                accumulate_lanes(&mut end.theta_rad, count, |at, lane| at + added.lane(lane));
            let mut directions = [(zero, zero); STAGES];
            let mut rates = [[zero; STAGES]; 2];
            for j in 0..STAGES {
                let (sin, cos) = Number::sin_cos(start + turned[j]);
                let [u, v, _] = bodies[j];
                rates[0][j] = cos * u - sin * v;
                rates[1][j] = sin * u + cos * v;
                directions[j] = (sin, cos);
            }
            let mut ends = [&mut end.x_m, &mut end.y_m];
            let ends = std::array::from_fn(|i| {
                let added = integrals(&rates[i], mesh.durations_s[pack])[STAGES - 1];
                added + accumulate_lanes(ends[i], count, |at, lane| at + added.lane(lane))
            });
            legs.push(Leg { states, directions, rates, ends });
        }
    }
}
