//! Motion of a chain by harmonic balance with one harmonic: the initial guess for Newton's method.
//!
//! About a steady speed at the mean shape, all other states respond linearly to the first harmonic of the forcing by
//! the commands. The speed is that at which the mean of the forward equation of motion vanishes along this response.

use std::f64::consts::TAU;

use nalgebra::{Complex, SMatrix, SVector};
use trilink_robot::{Friction, LANES, Lanes, Number};

use super::balance::Node;
use super::model::Model;
use crate::orbit::sum_of_lanes;
use crate::reduced::Reduced;

/// Number of packs of phases, one per lane, at which the equations are evaluated.
const PACKS: usize = 3;

/// States `mean + Re(wave exp(i phase))`.
pub(super) struct Response<const N: usize> {
    mean: [f64; N],
    wave: [Complex<f64>; N],
}

impl<const N: usize> Response<N> {
    /// Searches for the motion in the direction in which the chain starts. If the force does not vanish at any speed, but
    /// becomes small, the motion is that where it does so; otherwise it is `None`.
    pub(super) fn find<const C: usize, const D: usize, F: Friction>(
        model: &Model<N, C, D, F>,
    ) -> Option<Self> {
        const DOUBLINGS: i32 = 9;
        const STEPS: usize = 4;
        const SMALL: f64 = 0.1;
        let row = model.forward_row()?;
        let packs: [Pack<C>; PACKS] = std::array::from_fn(|pack| {
            let phase = |lane| TAU * (pack * LANES + lane) as f64 / (PACKS * LANES) as f64;
            let phase_rad = Lanes::new(std::array::from_fn(phase));
            let (sin, cos) = Number::sin_cos(phase_rad);
            Pack { sin, cos, node: model.node(phase_rad) }
        });
        let at = |speed_m_s| Self::at_speed(model, &packs, row, speed_m_s);
        let (_, at_rest) = at(0.0)?;
        // Ends of an interval with a zero of the force: speed and force.
        let mut near = [0.0, at_rest];
        let mut speed_m_s = -at_rest.signum() * model.skid_scale_m_s();
        let mut fast = None;
        for _ in 0..DOUBLINGS {
            let (mut found, force) = at(speed_m_s)?;
            if force * at_rest <= 0.0 {
                let mut far = [speed_m_s, force];
                for _ in 0..STEPS {
                    // False position; an end that stays counts half (Illinois method).
                    let share = near[1] / (near[1] - far[1]);
                    let speed_m_s = near[0] + share * (far[0] - near[0]);
                    let force;
                    (found, force) = at(speed_m_s)?;
                    if force * far[1] > 0.0 {
                        near[1] *= 0.5;
                    } else {
                        near = far;
                    }
                    far = [speed_m_s, force];
                }
                return Some(found);
            }
            if force.abs() < SMALL * at_rest.abs() {
                fast.get_or_insert(found);
            }
            near = [speed_m_s, force];
            speed_m_s *= 2.0;
        }
        fast
    }

    pub(super) fn at(&self, phase_rad: f64) -> [f64; N] {
        let turn = Complex::cis(phase_rad);
        std::array::from_fn(|i| self.mean[i] + (self.wave[i] * turn).re)
    }

    /// Returns the response at a speed, and the mean of the forward equation of motion along it.
    fn at_speed<const C: usize, const D: usize, F: Friction>(
        model: &Model<N, C, D, F>,
        packs: &[Pack<C>; PACKS],
        row: usize,
        speed_m_s: f64,
    ) -> Option<(Self, f64)> {
        let omega = Complex::new(0.0, model.omega_rad_s());
        let mut mean = [0.0; N];
        mean[0] = speed_m_s;
        for c in 1..C {
            let joint = model.system.clusters.all[c].joint;
            mean[D + c - 1] = model.problem.chain.mean_angle_rad(joint);
        }
        let zero = Lanes::default();
        let at_mean = mean.map(Lanes::splat);
        let mut forcing = [[zero; 2]; D];
        let mut state_jacobian = [[zero; N]; D];
        let mut rate_jacobian = [[zero; D]; D];
        for Pack { sin, cos, node } in packs {
            let residual = model.residual(node, &at_mean, &[zero; N]);
            for i in 0..D {
                forcing[i][0] -= *cos * residual.value[i];
                forcing[i][1] += *sin * residual.value[i];
                (0..N).for_each(|j| state_jacobian[i][j] += residual.state_jacobian[i][j]);
                (0..D).for_each(|j| rate_jacobian[i][j] += residual.rate_jacobian[i][j]);
            }
        }
        let forcing = SVector::<_, D>::from_fn(|i, _| {
            let [re, im] = forcing[i].map(sum_of_lanes);
            Complex::new(2.0 * re, 2.0 * im)
        });
        let mut matrix = SMatrix::<_, D, D>::from_fn(|i, j| {
            omega * sum_of_lanes(rate_jacobian[i][j]) + sum_of_lanes(state_jacobian[i][j])
        });
        for i in 0..D {
            for angle in D..N {
                matrix[(i, angle + 1 - C)] += sum_of_lanes(state_jacobian[i][angle]) / omega;
            }
        }
        let response = matrix.try_inverse()? * forcing;
        let wave: [Complex<f64>; N] = std::array::from_fn(|i| match i {
            // The speed has only even harmonics if the motion is symmetric.
            0 => Complex::default(),
            _ if i < D => response[i],
            _ => response[i + 1 - C] / omega,
        });
        let rates = wave.map(|wave| omega * wave);
        let mut force = zero;
        for Pack { sin, cos, node } in packs {
            let along =
                |wave: &Complex<f64>| *cos * Lanes::splat(wave.re) - *sin * Lanes::splat(wave.im);
            let y = std::array::from_fn(|i| at_mean[i] + along(&wave[i]));
            force += model.value(node, &y, &rates.each_ref().map(along))[row];
        }
        let force = sum_of_lanes(force);
        force.is_finite().then_some((Self { mean, wave }, force))
    }
}

/// Phases, one per lane, with their joint commands.
struct Pack<const C: usize> {
    sin: Lanes,
    cos: Lanes,
    node: Node<Lanes, C>,
}
