//! Derivatives of a chain's steady motion with respect to the numbers that describe it.
//!
//! A change in a number changes the steady motion by the solution of the linearised periodic problem, whose matrix is
//! that of Newton's method. Its right-hand side is the derivative of the residuals with respect to the number at
//! constant states; the derivative of the metrics follows along the change in the motion. Both are central differences
//! of explicit expressions at fixed states, good to about ten digits, or seven where dry friction changes its sign;
//! nothing is solved again. Where a change in the number leaves the half-period symmetry of the motion as it is, half a
//! period suffices.

use trilink_robot::{ChainError, ChainNumber};

use super::model::Model;
use super::{ChainMetrics, ChainProblem, metrics_of};
use crate::Result;
use crate::cycle::measure;
use crate::mesh::Mesh;
use crate::method::loss_j;
use crate::orbit::PeriodicOrbit;
use crate::path::Path;
use crate::reduced::Reduced;

/// Derivatives of a chain's motion, per unit of a number.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainSlopes {
    /// Of the metrics.
    pub metrics: ChainMetrics,
    /// Of the work of the actuators over a cycle, J: that of the loss, which is equal.
    pub work_j: f64,
}

impl ChainSlopes {
    fn between([low, high]: &[(ChainMetrics, f64); 2], step: f64) -> Self {
        let slope = |low: f64, high: f64| (high - low) / (2.0 * step);
        let each = |low: &[f64], high: &[f64]| {
            low.iter().zip(high).map(|(low, high)| slope(*low, *high)).collect()
        };
        let ((low, low_j), (high, high_j)) = (low, high);
        Self {
            metrics: ChainMetrics {
                d_m: slope(low.d_m, high.d_m),
                v_m_s: slope(low.v_m_s, high.v_m_s),
                dtheta_rad: slope(low.dtheta_rad, high.dtheta_rad),
                sigma: each(&low.sigma, &high.sigma),
                alpha_rad: each(&low.alpha_rad, &high.alpha_rad),
            },
            work_j: slope(*low_j, *high_j),
        }
    }
}

/// Returns the derivatives of the solution `orbit` with respect to numbers of the chain of `problem`.
pub(super) fn slopes<const N: usize, const C: usize, const D: usize>(
    problem: &ChainProblem,
    model: &Model<N, C, D>,
    orbit: &mut PeriodicOrbit<N, Model<N, C, D>>,
    numbers: &[ChainNumber],
) -> Result<Vec<ChainSlopes>> {
    orbit.linearise(model)?;
    // First those with respect to numbers whose change preserves the half-period symmetry, if the motion has it.
    let mut slopes = slopes_on(problem, model, orbit, numbers)?;
    if slopes.iter().any(Option::is_none) {
        let mut whole = orbit.clone();
        whole.cover_whole_periods(model)?;
        let (at, others): (Vec<usize>, Vec<ChainNumber>) =
            std::iter::zip(0.., numbers).filter(|(i, _): &(usize, _)| slopes[*i].is_none()).unzip();
        for (i, slope) in at.into_iter().zip(slopes_on(problem, model, &mut whole, &others)?) {
            slopes[i] = slope;
        }
    }
    Ok(slopes.into_iter().flatten().collect())
}

/// Returns the derivatives with respect to each number; `None` as [`slope`] does.
fn slopes_on<const N: usize, const C: usize, const D: usize>(
    problem: &ChainProblem,
    model: &Model<N, C, D>,
    orbit: &mut PeriodicOrbit<N, Model<N, C, D>>,
    numbers: &[ChainNumber],
) -> Result<Vec<Option<ChainSlopes>>> {
    let mut varied = [(); 2].map(|()| (orbit.mesh.clone(), Path::default()));
    numbers.iter().map(|number| slope(problem, model, orbit, &mut varied, *number)).collect()
}

/// Returns the derivatives with respect to a number, given two meshes and paths as buffers; `None` if the mesh of the
/// orbit covers half a period, and a change in the number breaks the half-period symmetry.
fn slope<const N: usize, const C: usize, const D: usize>(
    problem: &ChainProblem,
    model: &Model<N, C, D>,
    orbit: &mut PeriodicOrbit<N, Model<N, C, D>>,
    varied: &mut [(Mesh<N, Model<N, C, D>>, Path<N, Model<N, C, D>>); 2],
    number: ChainNumber,
) -> Result<Option<ChainSlopes>> {
    let mut problem = problem.clone();
    let Some(value) = problem.chain.number_mut(number).copied() else {
        return Err(ChainError::NoNumber(number.key()).into());
    };
    let step = step_of(value, &problem, number);
    let mut at = |value: f64| {
        if let Some(number) = problem.chain.number_mut(number) {
            *number = value;
        }
        model.with_problem(problem.effective())
    };
    let models = [at(value - step), at(value + step)];
    if orbit.mesh.is_half && models.iter().any(|model| model.half_period_signs().is_none()) {
        return Ok(None);
    }
    for (model, (mesh, _)) in models.iter().zip(&mut *varied) {
        mesh.lay_out(model);
    }
    orbit.change([0, 1].map(|i| (&models[i], &varied[i].0)), 2.0 * step)?;
    let motions = [0, 1].map(|i| {
        let model = &models[i];
        let (mesh, path) = &mut varied[i];
        mesh.states.set_moved(&orbit.mesh.states, [-step, step][i], orbit.last_change());
        path.follow(model, mesh);
        let cycle = measure(model, mesh, path, &mut orbit.workspace);
        (metrics_of(model, &cycle), loss_j(model, mesh, path))
    });
    Ok(Some(ChainSlopes::between(&motions, step)))
}

/// Returns the step of the central differences for a number with the given value: relative to the robot's size for
/// places, to at least a tenth of a radian for angles, and to the number itself or, if it is zero, to the natural unit
/// formed from the chain's mass and length and the frequency.
fn step_of(value: f64, problem: &ChainProblem, number: ChainNumber) -> f64 {
    use trilink_robot::LinkNumber as L;
    const RELATIVE: f64 = 2e-5;
    let ChainProblem { chain, omega_rad_s, .. } = problem;
    let length_m = chain.skid_length_m;
    let mass_kg: f64 = chain.links.iter().map(|link| link.mass_kg).sum();
    let frequency = omega_rad_s.powi(number.power_of_omega());
    let scale = match number {
        ChainNumber::Link(_, L::FrontJoint | L::RearJoint | L::Com | L::WheelPlace) => length_m,
        _ if number.key().ends_with("_deg") => value.abs().max(0.1),
        _ if value != 0.0 => value.abs(),
        ChainNumber::Joint(..) | ChainNumber::Link(_, L::DragTurning | L::RotorInertia) => {
            mass_kg * length_m.powi(2) * frequency
        }
        ChainNumber::Link(_, L::Transition | L::Stribeck) => length_m * frequency,
        _ if number.power_of_omega() == 2 => mass_kg * length_m * frequency,
        _ => mass_kg * frequency,
    };
    RELATIVE * scale
}
