//! Motions of chains of two to eight links.
//!
//! In reading order: `plane`, vectors and moving points; `cluster`, the links between which all joints are driven;
//! `balance`, the equations of motion; `skid` and `no_skid`, their minimal states; `forces`.

mod balance;
mod cluster;
mod forces;
mod no_skid;
mod plane;
mod skid;

use std::f64::consts::TAU;

use trilink_robot::metrics::MotionStatus;
use trilink_robot::{Chain, Joint, Laws};

pub use forces::ChainSample;

use self::balance::Posture;
use self::cluster::Clusters;
use self::forces::Motion;
use self::no_skid::{MAX_SPEEDS, NoSkid};
use self::skid::Skid;
use crate::cycle::Cycle;
use crate::method::Collocation;
use crate::orbit::PeriodicOrbit;
use crate::reduced::Reduced;
use crate::{MotionError, Result, trajectory};

/// Chain with given friction laws at one frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainProblem {
    pub chain: Chain,
    pub laws: Laws,
    pub omega_rad_s: f64,
}

/// Steady-state periodic motion of a chain.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainMotion {
    /// Displacement of the reference link per cycle, m.
    pub d_m: f64,
    /// Mean speed `d omega / (2 pi)`, m/s.
    pub v_m_s: f64,
    /// Rotation per cycle, rad.
    pub dtheta_rad: f64,
    /// Skid ratios (eq. 20 of the paper), by link from front to rear; NaN for a link without a wheel.
    pub sigma: Vec<f64>,
    /// Half the range of each joint's angle, from front to rear, rad.
    pub alpha_rad: Vec<f64>,
    /// Modulus of the largest Floquet multiplier; `None` if the constraints and commands alone determine the motion.
    pub floquet: Option<f64>,
    /// Work of the actuators of all joints and rotors over a cycle, J.
    pub work_j: f64,
    /// Energy dissipated over a cycle, J; equal to the work up to the accuracy of the solution.
    pub loss_j: f64,
    /// Whether the motion lacks the half-period symmetry of the commands and is therefore one of a mirror-image pair.
    pub is_symmetry_broken: bool,
}

impl ChainMotion {
    /// Returns whether the motion is stable, and whether it is one of a mirror-image pair.
    pub fn status(&self) -> MotionStatus {
        MotionStatus::new(self.floquet, self.is_symmetry_broken)
    }
}

/// Motion of a chain that is reached from rest.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainAttractor {
    pub motion: ChainMotion,
    /// Number of cycles after which the state at the end of each cycle stays within 1 % of its steady-state value.
    pub cycles: usize,
    /// Whether the attractor is the solution that [`ChainProblem::solve`] finds.
    pub is_found_by_solve: bool,
}

/// Equations of motion of a chain of `C` clusters.
trait OfChain<const N: usize, const C: usize>: Reduced<N, Sample = ChainSample> {
    fn problem(&self) -> &ChainProblem;

    fn clusters(&self) -> &Clusters;

    /// Returns the time derivatives of the velocities of the reference link and of its turning rate, and the
    /// accelerations of the free joints.
    fn accelerations(
        &self,
        node: &Self::Node<f64>,
        y: &[f64; N],
        dy: &[f64; N],
    ) -> ([f64; 3], [f64; C]);

    /// Returns the motion of the chain at one time, given its posture.
    fn motion(
        &self,
        phase_rad: f64,
        posture: &Posture<f64, C>,
        (dbody, accelerations): ([f64; 3], [f64; C]),
    ) -> Motion {
        let ChainProblem { chain, omega_rad_s, .. } = self.problem();
        let mut joints: Vec<[f64; 3]> = chain
            .joints
            .iter()
            .map(|joint| match joint {
                Joint::Driven(command) => std::array::from_fn(|k| {
                    omega_rad_s.powi(k as i32) * command.derivative(k as i32, phase_rad)
                }),
                Joint::Free(_) => [0.0; 3],
            })
            .collect();
        for c in 1..C {
            joints[self.clusters().all[c].joint] =
                [posture.phi_rad[c], posture.joint_rate[c], accelerations[c]];
        }
        let [u, v] = posture.velocity[0];
        Motion { phase_rad, body: [u, v, posture.rate[0]], dbody, joints }
    }

    /// Returns the angles of the free joints, in the order of the clusters, before the motion begins, rad.
    fn rest_angles(&self) -> Vec<f64> {
        let clusters = self.clusters();
        let joints = clusters.all[1..].iter().map(|cluster| cluster.joint);
        joints.map(|joint| clusters.chain.rest_angle_rad(joint)).collect()
    }
}

/// Implements what the equations of motion of chains have in common.
macro_rules! of_chain {
    () => {
        type State<T: Number> = Posture<T, C>;
        type Sample = ChainSample;

        fn omega_rad_s(&self) -> f64 {
            self.problem.omega_rad_s
        }

        fn skid_scale_m_s(&self) -> f64 {
            self.problem.chain.skid_length_m * self.problem.omega_rad_s
        }

        fn transition_m_s(&self) -> f64 {
            let wheels = self.system.wheels.iter().map(|(_, friction)| friction.transition_m_s);
            wheels.fold(f64::INFINITY, f64::min)
        }

        #[inline(always)]
        fn body<T: Number>(state: &Posture<T, C>) -> [T; 3] {
            let [u, v] = state.velocity[0];
            [u, v, state.rate[0]]
        }

        #[inline(always)]
        fn tracked<T: Number>(
            &self,
            state: &Posture<T, C>,
            [x_rate, y_rate]: [T; 2],
        ) -> [T; MAX_TRACKED] {
            let mut tracked = [T::splat(0.0); MAX_TRACKED];
            tracked[..3].copy_from_slice(&[x_rate, y_rate, state.rate[0]]);
            for c in 1..C {
                tracked[2 + c] = state.joint_rate[c];
                tracked[1 + C + c] = state.phi_rad[c];
            }
            tracked
        }

        fn wheels(&self) -> usize {
            self.system.wheels.len()
        }

        fn skid_m_s<T: Number>(&self, phase_rad: T, state: &Posture<T, C>) -> [T; MAX_LINKS] {
            let mut skid_m_s = [T::splat(0.0); MAX_LINKS];
            let nodes = self.system.clusters.wheels(phase_rad);
            for (i, (cluster, _)) in self.system.wheels.iter().enumerate() {
                skid_m_s[i] = self.system.wheel(state, &nodes[i], *cluster).skid_m_s;
            }
            skid_m_s
        }

        fn measured_joints(&self) -> usize {
            C - 1
        }

        #[inline(always)]
        fn free_joint<T: Number>(state: &Posture<T, C>, index: usize) -> [T; 2] {
            [state.phi_rad[1 + index], state.joint_rate[1 + index]]
        }

        fn power_and_loss_w(
            &self,
            phase_rad: f64,
            node: &Self::Node<f64>,
            y: &[f64; N],
            dy: &[f64; N],
        ) -> [f64; 2] {
            let accelerations = self.accelerations(node, y, dy);
            let motion = self.motion(phase_rad, &self.kinematics(node, y), accelerations);
            let sample = motion.sample(&self.problem, 0.0, Pose::default());
            [sample.power_w, sample.loss_w]
        }

        fn sample(
            &self,
            time_s: f64,
            pose: Pose,
            node: &Self::Node<f64>,
            y: &[f64; N],
            dy: &[f64; N],
        ) -> ChainSample {
            let accelerations = self.accelerations(node, y, dy);
            let phase_rad = self.problem.omega_rad_s * time_s;
            let motion = self.motion(phase_rad, &self.kinematics(node, y), accelerations);
            motion.sample(&self.problem, time_s, pose)
        }
    };
}
use of_chain;

/// What is computed with the equations of motion of a chain.
trait Task {
    type Output;

    fn run<const N: usize, const C: usize, R: OfChain<N, C>>(
        self,
        model: R,
    ) -> Result<Self::Output>;
}

struct Solve {
    accuracy: f64,
}

struct Settle {
    accuracy: f64,
}

struct Sampled {
    accuracy: f64,
    samples: usize,
}

impl Task for Solve {
    type Output = ChainMotion;

    fn run<const N: usize, const C: usize, R: OfChain<N, C>>(
        self,
        model: R,
    ) -> Result<ChainMotion> {
        let mut orbit = PeriodicOrbit::default();
        let mut method = Collocation { model, orbit: &mut orbit };
        let (cycle, _) = method.find(false, self.accuracy)?;
        motion(&mut method, &cycle)
    }
}

impl Task for Settle {
    type Output = ChainAttractor;

    fn run<const N: usize, const C: usize, R: OfChain<N, C>>(
        self,
        model: R,
    ) -> Result<ChainAttractor> {
        let mut orbit = PeriodicOrbit::default();
        let mut method = Collocation { model, orbit: &mut orbit };
        let is_solved = method.find(false, self.accuracy).is_ok();
        let (cycle, cycles, is_found_by_solve) = method.reach(is_solved, self.accuracy)?;
        Ok(ChainAttractor { motion: motion(&mut method, &cycle)?, cycles, is_found_by_solve })
    }
}

impl Task for Sampled {
    type Output = Vec<ChainSample>;

    fn run<const N: usize, const C: usize, R: OfChain<N, C>>(
        self,
        model: R,
    ) -> Result<Vec<ChainSample>> {
        let mut orbit = PeriodicOrbit::default();
        let mut method = Collocation { model, orbit: &mut orbit };
        method.find(false, self.accuracy)?;
        trajectory::cycle(&method.model, &method.orbit.mesh, self.samples)
    }
}

/// Returns the motion of the last solution, given its measurements.
fn motion<const N: usize, const C: usize, R: OfChain<N, C>>(
    method: &mut Collocation<'_, N, R>,
    cycle: &Cycle<N>,
) -> Result<ChainMotion> {
    let [work_j, loss_j] = method.work_and_loss_j();
    let Collocation { model, orbit } = method;
    let ChainProblem { chain, omega_rad_s, .. } = model.problem();
    let clusters = &model.clusters().all;
    let mut wheels = cycle.sigma.iter();
    let sigma = chain.links.iter().map(|link| match link.wheel {
        Some(_) => wheels.next().copied().unwrap_or(f64::NAN),
        None => f64::NAN,
    });
    let alpha_rad = chain.joints.iter().enumerate().map(|(j, joint)| match joint {
        Joint::Driven(command) => command.half_range_rad(),
        Joint::Free(_) => {
            let free = clusters[1..].iter().position(|cluster| cluster.joint == j);
            free.map_or(f64::NAN, |index| cycle.alpha_rad[index])
        }
    });
    Ok(ChainMotion {
        d_m: cycle.d_m,
        v_m_s: cycle.d_m * omega_rad_s / TAU,
        dtheta_rad: cycle.dtheta_rad,
        sigma: sigma.collect(),
        alpha_rad: alpha_rad.collect(),
        floquet: if model.problem().is_determined() { None } else { Some(orbit.floquet(model)?) },
        work_j,
        loss_j,
        is_symmetry_broken: orbit.is_symmetry_broken,
    })
}

impl ChainProblem {
    /// Solves for the steady-state periodic motion to a relative `accuracy` of its metrics, and for its stability.
    ///
    /// # Errors
    /// Returns an error if the description of the chain is wrong, if no such motion exists, or if it could not be found
    /// or resolved.
    pub fn solve(&self, accuracy: f64) -> Result<ChainMotion> {
        self.with(Solve { accuracy })
    }

    /// Integrates the transient from rest and solves for the steady-state motion that it reaches.
    ///
    /// # Errors
    /// Returns an error as [`ChainProblem::solve`] does, or if the transient does not settle.
    pub fn settle(&self, accuracy: f64) -> Result<ChainAttractor> {
        self.with(Settle { accuracy })
    }

    /// Samples one cycle of the steady-state motion at `samples + 1` equally spaced times, the first at phase 0.
    ///
    /// # Errors
    /// Returns an error as [`ChainProblem::solve`] does.
    pub fn cycle(&self, accuracy: f64, samples: usize) -> Result<Vec<ChainSample>> {
        self.with(Sampled { accuracy, samples })
    }

    /// Returns whether constraints and commands alone determine the motion: it has no state of its own.
    fn is_determined(&self) -> bool {
        !self.laws.skids() && self.chain.free_joints() == 0 && self.chain.wheels() >= 3
    }

    fn with_transition_scaled(&self, factor: f64) -> Self {
        let mut problem = self.clone();
        let wheels = problem.chain.links.iter_mut().filter_map(|link| link.wheel.as_mut());
        wheels.for_each(|wheel| wheel.friction.transition_m_s *= factor);
        problem
    }

    fn with_friction_scaled(&self, factor: f64) -> Self {
        let mut problem = self.clone();
        let wheels = problem.chain.links.iter_mut().filter_map(|link| link.wheel.as_mut());
        wheels.for_each(|wheel| wheel.friction = wheel.friction.scaled(factor));
        problem
    }

    /// Returns the problem with the coefficients that its friction laws do not use set to zero.
    fn effective(&self) -> Self {
        let mut problem = self.clone();
        let wheels = problem.chain.links.iter_mut().filter_map(|link| link.wheel.as_mut());
        wheels.for_each(|wheel| wheel.friction = wheel.friction.effective(self.laws));
        problem
    }

    /// Runs a task with the equations of motion for the numbers of free joints and wheels.
    fn with<T: Task>(&self, task: T) -> Result<T::Output> {
        self.chain.check().map_err(MotionError::Chain)?;
        if !self.chain.is_driven() {
            return Err(MotionError::NotDriven);
        }
        let problem = self.effective();
        let free = problem.chain.free_joints();
        let is_linear = problem.laws.are_linear();
        macro_rules! skidding {
            ($n:literal, $c:literal, $d:literal) => {
                if is_linear {
                    task.run::<$n, $c, _>(Skid::<$n, $c, $d, 0>::new(problem))
                } else {
                    task.run::<$n, $c, _>(Skid::<$n, $c, $d, 8>::new(problem))
                }
            };
        }
        macro_rules! rolling {
            ($n:literal, $c:literal) => {
                match NoSkid::<$n, $c>::new(problem) {
                    Some(model) => task.run::<$n, $c, _>(model),
                    None => Err(MotionError::Underconstrained { speeds: MAX_SPEEDS }),
                }
            };
        }
        if self.laws.skids() {
            return match free {
                0 => skidding!(3, 1, 3),
                1 => skidding!(5, 2, 4),
                2 => skidding!(7, 3, 5),
                3 => skidding!(9, 4, 6),
                4 => skidding!(11, 5, 7),
                5 => skidding!(13, 6, 8),
                6 => skidding!(15, 7, 9),
                _ => skidding!(17, 8, 10),
            };
        }
        let wheels = self.chain.wheels();
        let velocities = 3 + free;
        if wheels > velocities {
            return Err(MotionError::Overconstrained { wheels, velocities });
        }
        match free {
            0 => rolling!(3, 1),
            1 => rolling!(4, 2),
            2 => rolling!(5, 3),
            3 => rolling!(6, 4),
            4 => rolling!(7, 5),
            5 => rolling!(8, 6),
            6 => rolling!(9, 7),
            _ => rolling!(10, 8),
        }
    }
}
