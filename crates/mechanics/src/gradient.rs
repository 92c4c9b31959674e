//! Gradients, with respect to the motion, of the metrics that are integrals over a cycle.

use std::ops::Range;

use trilink_robot::{Lanes, Pose, dot, dskid_rows_dphi, skid_rows};

use super::cycle::Cycle;
use super::element::{Element, Stages};
use super::mesh::Mesh;
use super::path::Leg;
use super::radau::{RADAU, STAGES};
use super::reduced::{COMMAND_SIZE, Gradient, KinematicState, MAX_PARAMETERS, ThreeLink, Variable};

/// Index of the displacement d among the quantities of [`MetricGradient`].
pub(super) const DISTANCE: usize = 3;
/// Indices of the quantities of [`MetricGradient`] that change sign under the half-period symmetry.
pub(super) const ODD: Range<usize> = 4..6;
/// Index, among the quantities of [`MetricGradient`], of the displacement d under an odd variation, which has
/// the opposite sign in the mirror-image half period.
pub(super) const ODD_DISTANCE: usize = 5;
/// Index, among the quantities of [`MetricGradient`], of the work of friction over the period.
pub(super) const WORK: usize = 6;

/// Gradients of the quantities that are integrated over the elements, by index. 0 to 2: sigma of the wheels,
/// if they skid; 3: d; 4: Delta theta; 5: d under an odd variation, which has the opposite sign in the
/// mirror-image half period; 6: the work of friction.
pub(super) struct MetricGradient {
    /// Derivatives of d with respect to the pose (x, y, theta) at the end of the time span of the mesh.
    dd_dend: [f64; 3],
    /// Derivatives of d with respect to the pose (x, y, theta) at the end of the time span of the mesh, for
    /// an odd variation, which has the opposite sign in the mirror-image half period.
    odd_dd_dend: [f64; 3],
    end: Pose,
    /// Number of time spans of the mesh after which the motion repeats: 2 if the mesh covers half a period,
    /// otherwise 1.
    spans: f64,
    /// Twice the derivative of each skid ratio sigma_i with respect to the mean squared skid velocity of
    /// wheel i; zero if the wheel does not skid.
    dsigma_dskid: [f64; 3],
}

impl MetricGradient {
    pub(crate) fn new<const N: usize, R: ThreeLink<N>>(
        model: &R,
        mesh: &Mesh<N, R>,
        cycle: &Cycle<N>,
    ) -> Self {
        let Pose { x_m: x, y_m: y, theta_rad } = cycle.end;
        // Pose after the half period and its mirror image.
        let whole = cycle.end * cycle.end.mirrored();
        let (sin, cos) = theta_rad.sin_cos();
        let turned = whole.x_m * (cos * y - sin * x) + whole.y_m * (cos * x + sin * y);
        let halves = |sign: f64| {
            let sin = sign * sin;
            let cos = sign * cos;
            [
                whole.x_m * (1.0 + cos) + whole.y_m * sin,
                whole.x_m * sin + whole.y_m * (1.0 - cos),
                turned,
            ]
        };
        let dd_dend = if mesh.is_half { halves(1.0) } else { [x, y, 0.0] };
        let odd_dd_dend = halves(-1.0);
        let scale = model.skid_scale_m_s().powi(2);
        let dsigma_dskid = std::array::from_fn(|wheel| match cycle.sigma[wheel] {
            0.0 => 0.0,
            sigma => 1.0 / (scale * sigma),
        });
        // The gradient of a zero distance is undefined and taken as zero.
        let d_m = cycle.d_m;
        let [dd_dend, odd_dd_dend] = [dd_dend, odd_dd_dend]
            .map(|slopes| if d_m > 0.0 { slopes.map(|slope| slope / d_m) } else { [0.0; 3] });
        let spans = mesh.spans() as f64;
        Self { dd_dend, odd_dd_dend, end: cycle.end, spans, dsigma_dskid }
    }

    /// Returns the gradients of a quantity, given by its index, with respect to the joint angles and
    /// velocities of the robot at the stages of a path segment. The last argument, lengths and durations of
    /// elements, must come from [`Mesh::weights`].
    #[inline(always)]
    pub(crate) fn at_stages<const N: usize, R: ThreeLink<N>>(
        &self,
        model: &R,
        quantity: usize,
        leg: &Leg<N, R>,
        [part, duration_s]: [Lanes; 2],
    ) -> [Gradient<Lanes>; STAGES] {
        let mut gradients = [Gradient::default(); STAGES];
        let weights = RADAU.integrate[STAGES - 1];
        let robot = &model.problem().robot;
        match quantity {
            wheel @ 0..3 => {
                for j in 0..STAGES {
                    let KinematicState { trig, velocity, .. } = R::of(&leg.states[j]);
                    let row = skid_rows(robot, trig)[wheel];
                    let factor = Lanes::splat(weights[j] * self.dsigma_dskid[wheel]) * part;
                    let factor = factor * dot(&row, velocity);
                    for i in 0..5 {
                        gradients[j].velocity[i] = factor * row[i];
                    }
                    if let Some(joint) = wheel.checked_sub(1) {
                        let slope = &dskid_rows_dphi(robot, trig)[joint];
                        gradients[j].phi_rad[joint] = factor * dot(slope, velocity);
                    }
                }
            }
            3 => self.path(self.dd_dend, leg, duration_s, &mut gradients),
            4 => {
                for j in 0..STAGES {
                    gradients[j].velocity[2] = Lanes::splat(self.spans * weights[j]) * duration_s;
                }
            }
            WORK => {
                for j in 0..STAGES {
                    let power = model.friction_power_gradient(R::of(&leg.states[j]));
                    let weight = Lanes::splat(self.spans * weights[j]) * duration_s;
                    gradients[j].velocity = power.velocity.map(|by| weight * by);
                    gradients[j].phi_rad = power.phi_rad.map(|by| weight * by);
                }
            }
            _ => self.path(self.odd_dd_dend, leg, duration_s, &mut gradients),
        }
        gradients
    }

    /// Adds to `sum` the derivatives, with respect to the robot's parameters, of the work of friction along a
    /// path segment, with the states held fixed.
    #[inline(always)]
    pub(crate) fn add_work_slopes<const N: usize, R: ThreeLink<N>>(
        &self,
        model: &R,
        leg: &Leg<N, R>,
        [_, duration_s]: [Lanes; 2],
        sum: &mut [Lanes; MAX_PARAMETERS],
    ) {
        for j in 0..STAGES {
            let weight = Lanes::splat(self.spans * RADAU.integrate[STAGES - 1][j]) * duration_s;
            model.add_friction_power_slopes(R::of(&leg.states[j]), weight, sum);
        }
    }

    /// Adds to `d` the gradients of the displacement d with respect to the velocities at the stages of a path
    /// segment, given its gradient with respect to the end pose.
    #[inline(always)]
    fn path<const N: usize, R: ThreeLink<N>>(
        &self,
        dd_dend: [f64; 3],
        leg: &Leg<N, R>,
        duration_s: Lanes,
        d: &mut [Gradient<Lanes>; STAGES],
    ) {
        let [dd_dx, dd_dy, dd_dtheta] = dd_dend.map(Lanes::splat);
        // Effect of a rotation on the remaining path.
        let [whole_x, whole_y] = [self.end.x_m, self.end.y_m].map(Lanes::splat);
        let [end_x, end_y] = leg.ends;
        let later = dd_dtheta + dd_dy * (whole_x - end_x) - dd_dx * (whole_y - end_y);
        for j in 0..STAGES {
            let weight = Lanes::splat(RADAU.integrate[STAGES - 1][j]) * duration_s;
            let (sin, cos) = leg.directions[j];
            let [u, v, ..] = R::of(&leg.states[j]).velocity;
            let along = dd_dx * cos + dd_dy * sin;
            let across = dd_dy * cos - dd_dx * sin;
            d[j].velocity[0] = weight * along;
            d[j].velocity[1] = weight * across;
            d[j].velocity[2] += weight * later;
            let turned = weight * (u * across - v * along);
            for l in 0..STAGES {
                d[l].velocity[2] += turned * Lanes::splat(RADAU.integrate[j][l]) * duration_s;
            }
        }
    }
}

/// Returns the derivatives of a quantity with respect to an element's unknowns, given its gradients at the
/// stages. Also returns its derivative with respect to the last state variable at the element's start; zero
/// if that variable is not an integral of the preceding one.
#[inline(always)]
pub(super) fn weights_of_unknowns<const N: usize, R: ThreeLink<N>>(
    model: &R,
    element: &Element<N, R, Lanes>,
    leg: &Leg<N, R>,
    gradients: &[Gradient<Lanes>; STAGES],
) -> (Stages<N, Lanes>, Lanes) {
    let mut weights = [[Lanes::default(); N]; STAGES];
    let mut last_start_gradient = Lanes::default();
    for j in 0..STAGES {
        let node = &element.nodes[j];
        let y = &element.stages[j];
        weights[j] = model.state_gradient(node, y, &R::of(&leg.states[j]).trig, &gradients[j]);
    }
    if R::INTEGRATED {
        // The last state is its start plus the integral of the state before it.
        for j in 0..STAGES {
            last_start_gradient += weights[j][N - 1];
            for l in 0..STAGES {
                let weight = Lanes::splat(RADAU.integrate[j][l]) * element.duration_s;
                weights[l][N - 2] += weight * weights[j][N - 1];
            }
        }
    }
    (weights, last_start_gradient)
}

/// Adds to `sum` the derivatives of a quantity, given its gradients at the stages of an element, with respect
/// to the gait variables among the first `parameters` variables of the model, with the states held fixed.
#[inline(always)]
pub(super) fn add_gait_gradient<const N: usize, R: ThreeLink<N>>(
    model: &R,
    element: &Element<N, R, Lanes>,
    leg: &Leg<N, R>,
    gradients: &[Gradient<Lanes>; STAGES],
    parameters: usize,
    sum: &mut [Lanes; MAX_PARAMETERS],
) {
    for j in 0..STAGES {
        let node = &element.nodes[j];
        let y = &element.stages[j];
        let slopes = model.gait_gradient(node, y, &R::of(&leg.states[j]).trig, &gradients[j]);
        for column in R::ROBOT_VARIABLES..parameters {
            match model.variable(column) {
                Variable::Gait(joint, number) => sum[column] += slopes[joint][number],
                Variable::Second(joint, part) => sum[column] += slopes[joint][COMMAND_SIZE + part],
                Variable::Parameter(_) => {}
            }
        }
    }
}
