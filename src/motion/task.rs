//! What can be done with a motion, whatever its kind.

use std::f64::consts::TAU;

use super::MotionError;
use super::element::rate;
use super::forces::actions;
use super::kinematic;
use super::radau::{RADAU, STAGES};
use super::reduced::{Derivatives, Driven, Reduced};
use super::ring::{Ring, Start};
use super::sensitivity::differentiate;
use super::settle::settle;
use super::trajectory::{self, Sample};
use super::transient::{self, Follower, Transient};
use crate::metrics::GaitMetrics;
use crate::robot::{JointCommand, Parameter};

/// Cycles after which a robot that started from rest is near its steady motion.
const SETTLING_CYCLES: f64 = 40.0;
const SETTLING_TOLERANCE: f64 = 1e-4;

/// Something to do with a motion, of whatever kind it is.
pub(super) trait Task {
    type Output;

    /// For motions that are solutions of differential equations.
    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<Self::Output, MotionError>;

    /// For motions that eq. 3 gives.
    fn quadrature(
        self,
        driven: &Driven,
        joints: [JointCommand; 2],
    ) -> Result<Self::Output, MotionError>;
}

/// Solves for the steady motion and gives its metrics.
pub(super) struct Solve {
    /// Whether the ring's last solution is a start.
    pub goes_on: bool,
    pub accuracy: f64,
}

impl Task for Solve {
    type Output = GaitMetrics;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<GaitMetrics, MotionError> {
        let (omega_rad_s, accuracy) = (driven.omega_rad_s, self.accuracy);
        let near = self.goes_on && ring.solve(model, omega_rad_s, Start::Last, accuracy).is_ok();
        if !near && let Err(error) = ring.solve(model, omega_rad_s, Start::Rest, accuracy) {
            let mut room = ring.take_room();
            let mut follower = Follower::new(model, driven, SETTLING_TOLERANCE);
            let duration_s = SETTLING_CYCLES * TAU / omega_rad_s;
            let followed = follower.advance_to(duration_s, &mut room, |_| {});
            ring.give_room(room);
            followed.map_err(|_| error)?;
            ring.solve(model, omega_rad_s, Start::State(follower.state), accuracy)?;
        }
        Ok(ring.measure(model, driven).metrics)
    }

    fn quadrature(
        self,
        driven: &Driven,
        joints: [JointCommand; 2],
    ) -> Result<GaitMetrics, MotionError> {
        kinematic::solve(&driven.robot, joints, driven.omega_rad_s)
    }
}

/// Modulus of the largest Floquet multiplier.
pub(super) struct Floquet;

impl Task for Floquet {
    type Output = Option<f64>;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        _driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<Option<f64>, MotionError> {
        ring.floquet(model).map(Some)
    }

    fn quadrature(
        self,
        _driven: &Driven,
        _joints: [JointCommand; 2],
    ) -> Result<Option<f64>, MotionError> {
        Ok(None)
    }
}

/// Derivatives of the metrics by the parameters that are wanted, or by everything; others may be
/// missing.
pub(super) struct Differentiate<'w> {
    pub wanted: Option<&'w [Parameter]>,
}

impl Task for Differentiate<'_> {
    type Output = Derivatives;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<Derivatives, MotionError> {
        let cycle = ring.measure(model, driven);
        let mut room = ring.take_room();
        let derivatives = differentiate(model, driven, ring, &cycle, &mut room, self.wanted);
        ring.give_room(room);
        derivatives
    }

    fn quadrature(
        self,
        driven: &Driven,
        joints: [JointCommand; 2],
    ) -> Result<Derivatives, MotionError> {
        let mut derivatives = Derivatives::NONE;
        if self.wanted.is_none() {
            for (joint, derivative) in derivatives.amplitudes.iter_mut().enumerate() {
                *derivative =
                    kinematic::by_amplitude(&driven.robot, joints, driven.omega_rad_s, joint)?;
            }
        }
        Ok(derivatives)
    }
}

/// Work of the actuators and what friction takes over a cycle, J.
pub(super) struct WorkAndLoss;

impl Task for WorkAndLoss {
    type Output = [f64; 2];

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<[f64; 2], MotionError> {
        let weights = RADAU.integrate[STAGES - 1];
        let parts = ring.parts() as f64;
        let (mut work, mut loss) = (0.0, 0.0);
        for k in 0..ring.len() {
            let (nodes, start, stages) = ring.element(k);
            for j in 0..STAGES {
                let dy = rate(&RADAU, start, stages, j, 1.0 / ring.element_s());
                let moment = model.moment(&nodes[j], &stages[j]);
                let acceleration = model.acceleration(&nodes[j], &stages[j], &dy);
                let actions = actions(driven, &moment, &acceleration);
                let weight = parts * ring.element_s() * weights[j];
                work += weight * actions.power_w;
                loss += weight * actions.loss_w;
            }
        }
        Ok([work, loss])
    }

    fn quadrature(
        self,
        driven: &Driven,
        joints: [JointCommand; 2],
    ) -> Result<[f64; 2], MotionError> {
        kinematic::work_and_loss_j(driven, joints)
    }
}

/// One more Newton step; gives its relative size.
pub(super) struct Polish;

impl Task for Polish {
    type Output = f64;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        _driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<f64, MotionError> {
        ring.polish(model)
    }

    fn quadrature(self, _driven: &Driven, _joints: [JointCommand; 2]) -> Result<f64, MotionError> {
        Ok(0.0)
    }
}

/// Gives the metrics, the cycles that it took, and whether it is the ring's solution.
pub(super) struct Settle {
    /// What was solved for; the ring holds it.
    pub solved: Result<GaitMetrics, MotionError>,
    pub accuracy: f64,
}

impl Task for Settle {
    type Output = (GaitMetrics, usize, bool);

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<Self::Output, MotionError> {
        let mut room = ring.take_room();
        let arrival = settle(model, driven, ring, self.solved.is_ok(), self.accuracy, &mut room);
        ring.give_room(room);
        let arrival = arrival?;
        let metrics = ring.measure(model, driven).metrics;
        Ok((metrics, arrival.cycles, arrival.is_known))
    }

    fn quadrature(
        self,
        _driven: &Driven,
        _joints: [JointCommand; 2],
    ) -> Result<Self::Output, MotionError> {
        Ok((self.solved?, 0, true))
    }
}

/// Samples of one steady cycle, see [`Solver::cycle`](super::Solver::cycle).
pub(super) struct SampleCycle {
    pub samples: usize,
}

impl Task for SampleCycle {
    type Output = Vec<Sample>;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        ring: &mut Ring<N, R>,
    ) -> Result<Vec<Sample>, MotionError> {
        trajectory::cycle(model, driven, ring, self.samples)
    }

    fn quadrature(
        self,
        driven: &Driven,
        joints: [JointCommand; 2],
    ) -> Result<Vec<Sample>, MotionError> {
        kinematic::samples(driven, joints, 1, self.samples)
    }
}

/// Samples from rest, see [`Problem::cycles_from_rest`](super::Problem::cycles_from_rest).
pub(super) struct SampleFromRest {
    pub cycles: usize,
    pub samples: usize,
}

impl Task for SampleFromRest {
    type Output = Vec<Sample>;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        _ring: &mut Ring<N, R>,
    ) -> Result<Vec<Sample>, MotionError> {
        trajectory::from_rest(model, driven, self.cycles, self.samples)
    }

    fn quadrature(
        self,
        driven: &Driven,
        joints: [JointCommand; 2],
    ) -> Result<Vec<Sample>, MotionError> {
        kinematic::samples(driven, joints, self.cycles, self.samples)
    }
}

/// The path from rest, see [`Problem::follow`](super::Problem::follow).
pub(super) struct Follow {
    pub duration_s: f64,
    pub tolerance: f64,
}

impl Task for Follow {
    type Output = Transient;

    fn ring<const N: usize, R: Reduced<N>>(
        self,
        model: &R,
        driven: &Driven,
        _ring: &mut Ring<N, R>,
    ) -> Result<Transient, MotionError> {
        transient::follow(model, driven, self.duration_s, self.tolerance)
    }

    fn quadrature(
        self,
        _driven: &Driven,
        _joints: [JointCommand; 2],
    ) -> Result<Transient, MotionError> {
        Err(MotionError::Determined)
    }
}
