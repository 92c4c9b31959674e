//! Motion of a chain by harmonic balance with one harmonic: the initial guess for Newton's method.
//!
//! About a steady speed at the mean shape, all other states respond linearly to the first harmonic of the forcing by
//! the commands. The speed is that at which the mean of the forward equation of motion vanishes along this response.

use std::f64::consts::TAU;

use nalgebra::{Complex, DMatrix, DVector};

use super::model::Model;
use crate::radau::bisect;
use crate::reduced::Reduced;

/// Number of phases at which the equations are evaluated.
const PHASES: usize = 6;

/// States `mean + Re(wave exp(i phase))`.
pub(super) struct Response<const N: usize> {
    mean: [f64; N],
    wave: [Complex<f64>; N],
}

impl<const N: usize> Response<N> {
    /// Searches for the motion in the direction in which the chain starts; `None` if no such speed is found.
    pub(super) fn find<const C: usize, const D: usize>(model: &Model<N, C, D>) -> Option<Self> {
        const DOUBLINGS: i32 = 6;
        const BISECTIONS: usize = 6;
        let row = model.forward_row()?;
        let nodes: [_; PHASES] = std::array::from_fn(|k| (phase_rad(k), model.node(phase_rad(k))));
        let force = |speed_m_s| Self::at_speed(model, &nodes, row, speed_m_s).map(|found| found.1);
        let at_rest = force(0.0)?;
        let direction = -at_rest.signum();
        let mut speed_m_s = direction * model.skid_scale_m_s() / 4.0;
        for _ in 0..DOUBLINGS {
            if force(speed_m_s)? * at_rest <= 0.0 {
                let force = |speed_m_s| force(speed_m_s).unwrap_or(f64::NAN);
                let speed_m_s = bisect(force, 0.0, speed_m_s, BISECTIONS);
                return Self::at_speed(model, &nodes, row, speed_m_s).map(|found| found.0);
            }
            speed_m_s *= 2.0;
        }
        None
    }

    pub(super) fn at(&self, phase_rad: f64) -> [f64; N] {
        let turn = Complex::cis(phase_rad);
        std::array::from_fn(|i| self.mean[i] + (self.wave[i] * turn).re)
    }

    /// Returns the response at a speed, and the mean of the forward equation of motion along it.
    fn at_speed<const C: usize, const D: usize>(
        model: &Model<N, C, D>,
        nodes: &[(f64, <Model<N, C, D> as Reduced<N>>::Node<f64>); PHASES],
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
        let mut matrix = DMatrix::<Complex<f64>>::zeros(D, D);
        let mut forcing = DVector::<Complex<f64>>::zeros(D);
        for (phase_rad, node) in nodes {
            let residual = model.residual(node, &mean, &[0.0; N]);
            let turn = Complex::cis(-phase_rad);
            for i in 0..D {
                forcing[i] -= turn * (2.0 * residual.value[i]);
                for j in 0..D {
                    matrix[(i, j)] +=
                        omega * residual.rate_jacobian[i][j] + residual.state_jacobian[i][j];
                }
                for angle in D..N {
                    let rate = angle + 1 - C;
                    matrix[(i, rate)] += residual.state_jacobian[i][angle] / omega;
                }
            }
        }
        let response = matrix.lu().solve(&forcing)?;
        let wave: [Complex<f64>; N] = std::array::from_fn(|i| match i {
            // The speed has only even harmonics if the motion is symmetric.
            0 => Complex::default(),
            _ if i < D => response[i],
            _ => response[i + 1 - C] / omega,
        });
        let found = Self { mean, wave };
        let forces = nodes.iter().map(|(phase_rad, node)| {
            let turn = Complex::cis(*phase_rad);
            let rates = std::array::from_fn(|i| (omega * wave[i] * turn).re);
            model.residual(node, &found.at(*phase_rad), &rates).value[row]
        });
        let force = forces.sum::<f64>();
        force.is_finite().then_some((found, force))
    }
}

fn phase_rad(k: usize) -> f64 {
    TAU * k as f64 / PHASES as f64
}
