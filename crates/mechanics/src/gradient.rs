//! Gradients of the metrics that are integrals over a cycle with respect to the motion.

use std::ops::Range;

use trilink_robot::{Lanes, Pose, Trig, dot, dskid_rows_dphi, skid_rows};

use super::cycle::{Cycle, skid_scale};
use super::element::{Element, Stages};
use super::mesh::Mesh;
use super::path::Leg;
use super::radau::{RADAU, STAGES};
use super::reduced::{KinematicState, MOST_PARAMETERS, NUMBERS, Reduced, Variable};

/// Number of the distance.
pub(super) const DISTANCE: usize = 3;
/// Numbers of the quantities that change their sign with the mirror image.
pub(super) const ODD: Range<usize> = 4..6;
/// Number of the distance where the second half of the period changes by the opposite.
pub(super) const ODD_DISTANCE: usize = 5;
/// Number of the work of friction over the period.
pub(super) const WORK: usize = 6;

/// What is integrated over the elements, by number: 0 to 2 sigma of the wheels, where they skid, 3 d,
/// 4 Delta theta, 5 d where the second half of the period changes by the opposite of the first half's
/// mirror image, 6 the work of friction.
pub(super) struct MetricGradient {
    /// Of d with respect to the pose at the end of the elements' span: x, y, theta.
    dd_dend: [f64; 3],
    /// The same of what is odd.
    odd_dd_dend: [f64; 3],
    end: Pose,
    /// How many times the span turns the robot over a period.
    turns: f64,
    /// Of sigma_i with respect to the integral of its wheel's skid velocity squared, doubled;
    /// zero where the wheel does not skid.
    dsigma_dskid: [f64; 3],
}

impl MetricGradient {
    pub(crate) fn new<const N: usize, R: Reduced<N>>(
        model: &R,
        mesh: &Mesh<N, R>,
        cycle: &Cycle<N>,
    ) -> Self {
        let Pose { x_m: x, y_m: y, theta_rad } = cycle.end;
        // Of the half period and its mirror image.
        let whole = cycle.end * cycle.end.mirrored();
        let (sin, cos) = theta_rad.sin_cos();
        let turned = whole.x_m * (cos * y - sin * x) + whole.y_m * (cos * x + sin * y);
        let halves = |sign: f64| {
            let (sin, cos) = (sign * sin, sign * cos);
            [
                whole.x_m * (1.0 + cos) + whole.y_m * sin,
                whole.x_m * sin + whole.y_m * (1.0 - cos),
                turned,
            ]
        };
        let dd_dend = if mesh.is_half { halves(1.0) } else { [x, y, 0.0] };
        let odd_dd_dend = halves(-1.0);
        let scale = skid_scale(model.problem()).powi(2);
        let dsigma_dskid = cycle.metrics.sigma.map(|sigma| match sigma {
            0.0 => 0.0,
            sigma => 1.0 / (scale * sigma),
        });
        // A distance of nothing has no gradient.
        let d_m = cycle.metrics.d_m;
        let scaled = |dd_dend: [f64; 3]| {
            if d_m > 0.0 { dd_dend.map(|slope| slope / d_m) } else { [0.0; 3] }
        };
        let (dd_dend, odd_dd_dend) = (scaled(dd_dend), scaled(odd_dd_dend));
        let turns = mesh.spans() as f64;
        Self { dd_dend, odd_dd_dend, end: cycle.end, turns, dsigma_dskid }
    }

    /// Gradients of a quantity with respect to the robot's angles and velocities at the stages of a
    /// leg; see [`Mesh::weights`].
    #[inline(always)]
    pub(crate) fn at_stages<const N: usize, R: Reduced<N>>(
        &self,
        model: &R,
        quantity: usize,
        leg: &Leg,
        [part, duration_s]: [Lanes; 2],
    ) -> [KinematicState<Lanes>; STAGES] {
        let mut gradients = [KinematicState::default(); STAGES];
        let weights = RADAU.integrate[STAGES - 1];
        let robot = &model.problem().robot;
        match quantity {
            wheel @ 0..3 => {
                for j in 0..STAGES {
                    let (trig, velocity) = (&leg.trig[j], &leg.states[j].velocity);
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
                    gradients[j].velocity[2] = Lanes::splat(self.turns * weights[j]) * duration_s;
                }
            }
            WORK => {
                for j in 0..STAGES {
                    let power = model.friction_power_gradient(&leg.states[j], &leg.trig[j]);
                    let weight = Lanes::splat(self.turns * weights[j]) * duration_s;
                    gradients[j].velocity = power.velocity.map(|by| weight * by);
                    gradients[j].phi_rad = power.phi_rad.map(|by| weight * by);
                }
            }
            _ => self.path(self.odd_dd_dend, leg, duration_s, &mut gradients),
        }
        gradients
    }

    /// Adds what the robot's variables change of the work of friction when the states stay.
    #[inline(always)]
    pub(crate) fn add_work_slopes<const N: usize, R: Reduced<N>>(
        &self,
        model: &R,
        leg: &Leg,
        [_, duration_s]: [Lanes; 2],
        sum: &mut [Lanes; MOST_PARAMETERS],
    ) {
        for j in 0..STAGES {
            let weight = Lanes::splat(self.turns * RADAU.integrate[STAGES - 1][j]) * duration_s;
            model.add_friction_power_slopes(&leg.states[j], &leg.trig[j], weight, sum);
        }
    }

    /// Gradients of d, given that with respect to the end.
    #[inline(always)]
    fn path(
        &self,
        dd_dend: [f64; 3],
        leg: &Leg,
        duration_s: Lanes,
        d: &mut [KinematicState<Lanes>; STAGES],
    ) {
        let [dd_dx, dd_dy, dd_dtheta] = dd_dend.map(Lanes::splat);
        // Turning the rest of the path.
        let [whole_x, whole_y] = [self.end.x_m, self.end.y_m].map(Lanes::splat);
        let [end_x, end_y] = leg.ends;
        let later = dd_dtheta + dd_dy * (whole_x - end_x) - dd_dx * (whole_y - end_y);
        for j in 0..STAGES {
            let weight = Lanes::splat(RADAU.integrate[STAGES - 1][j]) * duration_s;
            let (sin, cos) = leg.directions[j];
            let [u, v, ..] = leg.states[j].velocity;
            let (along, across) = (dd_dx * cos + dd_dy * sin, dd_dy * cos - dd_dx * sin);
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

/// Weights that the unknowns of an element have in a quantity with these gradients at the stages, and
/// its derivative with respect to the start of an integrated state.
#[inline(always)]
pub(super) fn weights_of_unknowns<const N: usize, R: Reduced<N>>(
    model: &R,
    element: &Element<N, R, Lanes>,
    trig: &[Trig<Lanes>; STAGES],
    gradients: &[KinematicState<Lanes>; STAGES],
) -> (Stages<N, Lanes>, Lanes) {
    let (mut weights, mut by_last) = ([[Lanes::default(); N]; STAGES], Lanes::default());
    for j in 0..STAGES {
        let (node, y) = (&element.nodes[j], &element.stages[j]);
        weights[j] = model.state_gradient(node, y, &trig[j], &gradients[j]);
    }
    if R::INTEGRATED {
        // The last state is its start plus the integral of the one before it.
        for j in 0..STAGES {
            by_last += weights[j][N - 1];
            for l in 0..STAGES {
                let weight = Lanes::splat(RADAU.integrate[j][l]) * element.duration_s;
                weights[l][N - 2] += weight * weights[j][N - 1];
            }
        }
    }
    (weights, by_last)
}

/// Adds what the numbers of the gait, as far as the first `parameters` have them, change of such a
/// quantity when the states stay.
#[inline(always)]
pub(super) fn add_by_gait<const N: usize, R: Reduced<N>>(
    model: &R,
    element: &Element<N, R, Lanes>,
    trig: &[Trig<Lanes>; STAGES],
    gradients: &[KinematicState<Lanes>; STAGES],
    parameters: usize,
    sum: &mut [Lanes; MOST_PARAMETERS],
) {
    for j in 0..STAGES {
        let (node, y) = (&element.nodes[j], &element.stages[j]);
        let slopes = model.gait_gradient(node, y, &trig[j], &gradients[j]);
        for column in R::OF_ROBOT..parameters {
            match model.variable(column) {
                Variable::Gait(joint, number) => sum[column] += slopes[joint][number],
                Variable::Second(joint, part) => sum[column] += slopes[joint][NUMBERS + part],
                Variable::Parameter(_) => {}
            }
        }
    }
}
