//! Steady-state motions of robots of any number of links behind one interface.

mod sample;

use trilink_robot::metrics::{ByMetric, GaitMetrics};
use trilink_robot::{
    AnyGait, AnyRobot, ChainError, ChainNumber, CommandNumber, FreeJoint, Gait, Joint,
    JointCommand, Laws, MAX_JOINTS, Parameter, Robot,
};

use super::chain::{ChainAttractor, ChainMotion, ChainProblem, ChainSlopes, ChainSolver};
use super::reduced::COMMAND_SIZE;
use super::transient::{Frames, Posture};
use super::{
    Attractor, FromRest, MotionStatus, Problem, REFERENCE_ACCURACY, Result, Solver, SteadyMotion,
};

pub use sample::AnySample;

/// Robot of any number of links with given friction laws and a gait at one frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct AnyProblem {
    pub robot: AnyRobot,
    /// Commands of the driven joints.
    pub gait: AnyGait,
    pub laws: Laws,
    pub omega_rad_s: f64,
}

/// Problem of a robot of one kind.
#[expect(clippy::large_enum_variant, reason = "it lives for one call")]
pub(super) enum Kind {
    ThreeLinks(Problem),
    Chain(ChainProblem),
}

impl From<Problem> for AnyProblem {
    fn from(Problem { robot, gait, laws, omega_rad_s }: Problem) -> Self {
        Self { robot: robot.into(), gait: gait.into(), laws, omega_rad_s }
    }
}

impl From<ChainProblem> for AnyProblem {
    fn from(ChainProblem { chain, laws, omega_rad_s }: ChainProblem) -> Self {
        Self { gait: chain.gait(), robot: chain.into(), laws, omega_rad_s }
    }
}

impl AnyProblem {
    /// Returns whether the equations have half-period symmetry: the mirror image of a motion, shifted by half a period,
    /// is also a motion.
    pub fn is_mirrored(&self) -> bool {
        match self.kind() {
            Kind::ThreeLinks(problem) => problem.is_mirrored(),
            Kind::Chain(problem) => problem.chain.is_mirrored(),
        }
    }

    /// Returns the motion sampled at `rate_hz` over `duration_s` from rest at phase 0, with a relative error per time step
    /// near `tolerance`. All friction of the wheels in cycle i is scaled by `friction[i]`; cycles beyond the slice are
    /// unscaled.
    ///
    /// # Errors
    /// Returns an error if the required time step is shorter than the minimum, or if no motion exists.
    pub fn varied_transient(
        &self,
        friction: &[f64],
        duration_s: f64,
        rate_hz: f64,
        tolerance: f64,
    ) -> Result<Vec<Posture>> {
        let frames = Frames { friction, duration_s, rate_hz };
        match self.kind() {
            Kind::ThreeLinks(problem) => {
                Solver::default().with(&problem, |method| method.transient(&frames, tolerance))
            }
            Kind::Chain(problem) => problem.transient(&frames, tolerance),
        }
    }

    /// Integrates the transient from rest and solves for the steady-state motion that it reaches.
    ///
    /// # Errors
    /// Returns an error if the problem has no steady-state motion, or if the transient does not settle.
    pub fn settle(&self, accuracy: f64) -> Result<Attractor> {
        let mut solver = AnySolver::default();
        let first = solver.solve(self, accuracy);
        solver.attractor(self, first, accuracy)
    }

    pub(super) fn kind(&self) -> Kind {
        let Self { robot, gait, laws, omega_rad_s } = self;
        let (laws, omega_rad_s) = (*laws, *omega_rad_s);
        match robot {
            AnyRobot::ThreeLinks(robot) => {
                let (robot, gait) = (robot.clone(), Gait::from(*gait));
                Kind::ThreeLinks(Problem { robot, gait, laws, omega_rad_s })
            }
            AnyRobot::Chain(chain) => {
                Kind::Chain(ChainProblem { chain: chain.with_gait(gait), laws, omega_rad_s })
            }
        }
    }

    /// Returns the problem of a robot of three links; `None` for a chain.
    pub fn three_links(&self) -> Option<Problem> {
        match self.kind() {
            Kind::ThreeLinks(problem) => Some(problem),
            Kind::Chain(_) => None,
        }
    }

    /// Returns the command of a joint's angle, or that of the angle at which its spring is relaxed; `None` for the passive
    /// joint of a robot of three links.
    pub fn command(&self, joint: usize) -> Option<&JointCommand> {
        match (self.gait.joints.get(joint)?, &self.robot) {
            (Some(command), _) => Some(command),
            (None, AnyRobot::ThreeLinks(_)) => None,
            (None, AnyRobot::Chain(chain)) => Some(chain.joints.get(joint)?.command()),
        }
    }

    /// Returns access to the command of [`AnyProblem::command`].
    pub fn command_mut(&mut self, joint: usize) -> Option<&mut JointCommand> {
        match (self.gait.joints.get_mut(joint)?, &mut self.robot) {
            (Some(command), _) => Some(command),
            (None, AnyRobot::ThreeLinks(_)) => None,
            (None, AnyRobot::Chain(chain)) => Some(chain.joints.get_mut(joint)?.command_mut()),
        }
    }

    /// Returns the value of a number of the gait or of a chain, in SI units; `None` if there is no such number.
    pub fn number(&self, number: ChainNumber) -> Option<f64> {
        match number {
            ChainNumber::Command(joint, number) => {
                number.of(&mut self.command(joint)?.clone()).copied()
            }
            _ => self.robot.as_chain()?.number(number),
        }
    }

    /// Returns access to a number of the gait or of a chain, in SI units; `None` if there is no such number.
    pub fn number_mut(&mut self, number: ChainNumber) -> Option<&mut f64> {
        if let ChainNumber::Command(joint, number) = number {
            return number.of(self.command_mut(joint)?);
        }
        match &mut self.robot {
            AnyRobot::ThreeLinks(_) => None,
            AnyRobot::Chain(chain) => chain.number_mut(number),
        }
    }
}

/// Derivatives of metrics with respect to the frequency, per rad/s, and to the offset, amplitude and phase of each
/// joint's command, per radian; zero for a joint that is not driven, NaN if no motion exists for neighbouring gaits.
#[derive(Debug, Clone, PartialEq)]
pub struct InputDerivatives {
    pub omega: GaitMetrics,
    pub gait: [[GaitMetrics; COMMAND_SIZE]; MAX_JOINTS],
}

/// Derivatives of the displacement d, m per unit, and of the work over a cycle, J per unit.
pub type DistanceAndWork = [f64; 2];

/// Warm-started solver of steady-state motions of robots of any number of links, as [`Solver`] is for three links.
#[derive(Debug, Clone, Default)]
pub struct AnySolver {
    three_links: Solver,
    chain: ChainSolver,
}

impl AnySolver {
    /// Solves for the steady-state periodic motion to a relative `accuracy` of its metrics.
    ///
    /// # Errors
    /// Returns an error if the problem has no steady-state motion, or if the motion could not be found or resolved.
    pub fn solve(&mut self, problem: &AnyProblem, accuracy: f64) -> Result<GaitMetrics> {
        match problem.kind() {
            Kind::ThreeLinks(problem) => {
                self.chain.forget();
                self.three_links.solve(&problem, accuracy)
            }
            Kind::Chain(problem) => {
                self.three_links.forget();
                let metrics = self.chain.solve(&problem, accuracy)?;
                Ok(metrics.by_number(&problem.chain))
            }
        }
    }

    /// Solves as [`AnySolver::solve`] does, but only near the last solution, as [`Solver::solve_near`] does.
    ///
    /// # Errors
    /// Returns an error as [`AnySolver::solve`] does, or if the motion is too far from the last solution.
    pub fn solve_near(&mut self, problem: &AnyProblem, accuracy: f64) -> Result<GaitMetrics> {
        match problem.kind() {
            Kind::ThreeLinks(problem) => {
                self.chain.forget();
                self.three_links.solve_near(&problem, accuracy)
            }
            Kind::Chain(problem) => {
                self.three_links.forget();
                let metrics = self.chain.solve_near(&problem, accuracy)?;
                Ok(metrics.by_number(&problem.chain))
            }
        }
    }

    /// Creates a solver whose next solution starts from the same motion as the next solution of this solver. The new
    /// solver has no last solution that could be queried.
    pub fn successor(&self) -> Self {
        Self { three_links: self.three_links.successor(), chain: self.chain.successor() }
    }

    /// Makes the next solution start from the model's initial guess; the workspace is retained.
    pub fn forget(&mut self) {
        self.three_links.forget();
        self.chain.forget();
    }

    /// Returns whether the last solution is stable, and whether it is one of a mirror-image pair.
    ///
    /// # Errors
    /// Returns an error if there is no last solution, or if its linearisation is singular.
    pub fn status(&mut self) -> Result<MotionStatus> {
        match self.chain.last() {
            None => self.three_links.status(),
            Some(_) => Ok(self.chain.motion()?.status()),
        }
    }

    /// Returns the modulus of the largest Floquet multiplier of the last solution; `None` if constraints and commands
    /// alone determine the motion.
    ///
    /// # Errors
    /// Returns an error as [`AnySolver::status`] does.
    pub fn floquet(&mut self) -> Result<Option<f64>> {
        match self.chain.last() {
            None => self.three_links.floquet(),
            Some(_) => Ok(self.chain.motion()?.floquet),
        }
    }

    /// Returns the energy dissipated over a cycle of the last solution, J.
    ///
    /// # Errors
    /// Returns an error as [`AnySolver::status`] does.
    pub fn loss_j(&mut self) -> Result<f64> {
        match self.chain.last() {
            None => self.three_links.loss_j(),
            Some(_) => self.chain.loss_j(),
        }
    }

    /// Returns the steady-state motion of the last solution, given its metrics.
    ///
    /// # Errors
    /// Returns an error as [`AnySolver::status`] does.
    pub fn steady_motion(&mut self, metrics: GaitMetrics) -> Result<SteadyMotion> {
        match self.chain.last().cloned() {
            None => self.three_links.steady_motion(metrics),
            Some(problem) => Ok(self.chain.motion()?.by_number(&problem.chain)),
        }
    }

    /// Integrates the transient from rest and solves for the steady-state motion that it reaches, given `first`, the result
    /// of [`AnySolver::solve`] for this problem. The next solution starts from that motion.
    ///
    /// # Errors
    /// Returns an error if the transient cannot be integrated or does not settle.
    pub fn attractor(
        &mut self,
        problem: &AnyProblem,
        first: Result<GaitMetrics>,
        accuracy: f64,
    ) -> Result<Attractor> {
        match problem.kind() {
            Kind::ThreeLinks(problem) => self.three_links.attractor(&problem, first, accuracy),
            Kind::Chain(problem) => {
                let ChainAttractor { motion, cycles, is_found_by_solve } =
                    self.chain.attractor(&problem, first.is_ok(), accuracy)?;
                let motion = motion.by_number(&problem.chain);
                Ok(Attractor { motion, cycles, is_found_by_solve })
            }
        }
    }

    /// Returns whether the last solution, that of `problem` with the given metrics, is reached from rest. The motion that
    /// is reached becomes the last solution.
    pub fn from_rest(&mut self, problem: &AnyProblem, metrics: GaitMetrics) -> FromRest {
        Attractor::from_rest(&self.attractor(problem, Ok(metrics), REFERENCE_ACCURACY))
    }

    /// Returns the derivatives of the last solution's metrics with respect to the given parameters, in their order.
    ///
    /// # Errors
    /// Returns an error as [`AnySolver::status`] does.
    pub fn derivatives_of(&mut self, parameters: &[Parameter]) -> Result<Vec<GaitMetrics>> {
        let Some(problem) = self.chain.last().cloned() else {
            let derivatives = self.three_links.derivatives_of(parameters)?.parameters;
            return Ok(parameters.iter().map(|parameter| derivatives[*parameter]).collect());
        };
        let numbers: Vec<(usize, ChainNumber, f64)> = parameters
            .iter()
            .enumerate()
            .flat_map(|(i, parameter)| {
                let shares = problem.chain.shares_of(*parameter).into_iter();
                shares.map(move |(number, share)| (i, number, share))
            })
            .collect();
        let wanted: Vec<ChainNumber> = numbers.iter().map(|(_, number, _)| *number).collect();
        let slopes = self.chain.slopes(&wanted)?;
        let mut derivatives = vec![ByMetric::<f64>::splat(0.0); parameters.len()];
        for ((i, _, share), slope) in numbers.iter().zip(&slopes) {
            add(&mut derivatives[*i], *share, &problem, slope);
        }
        Ok(derivatives.into_iter().map(GaitMetrics::from).collect())
    }

    /// Returns the derivatives of the last solution's metrics with respect to the frequency and the gait.
    ///
    /// # Errors
    /// Returns an error as [`AnySolver::status`] does.
    pub fn input_derivatives(&mut self) -> Result<InputDerivatives> {
        let none = [GaitMetrics::NONE; COMMAND_SIZE];
        let Some(problem) = self.chain.last().cloned() else {
            let derivatives = self.three_links.derivatives()?;
            let of_joint = |joint: usize| derivatives.gait.get(joint).copied().unwrap_or(none);
            let gait = std::array::from_fn(of_joint);
            return Ok(InputDerivatives { omega: derivatives.omega, gait });
        };
        const COMMAND: [CommandNumber; COMMAND_SIZE] =
            [CommandNumber::Offset, CommandNumber::Amplitude, CommandNumber::Phase];
        let gait = problem.chain.gait();
        let commands = gait.joints.iter().enumerate().filter(|(_, command)| command.is_some());
        let numbers: Vec<ChainNumber> = commands
            .flat_map(|(joint, _)| COMMAND.map(|number| ChainNumber::Command(joint, number)))
            .collect();
        let InputSlopes { motion, numbers: slopes, scaled } =
            input_slopes(&mut self.chain, &problem, &numbers)?;
        let mut derivatives =
            InputDerivatives { omega: GaitMetrics::NONE, gait: [none; MAX_JOINTS] };
        for (number, slope) in numbers.iter().zip(&slopes) {
            let ChainNumber::Command(joint, command) = number else { continue };
            let mut own = ByMetric::<f64>::splat(0.0);
            add(&mut own, 1.0, &problem, slope);
            let index = COMMAND.iter().position(|one| one == command).unwrap_or(0);
            derivatives.gait[*joint][index] = own.into();
        }
        let mut omega = ByMetric::<f64>::splat(0.0);
        scaled.iter().for_each(|(factor, slope)| add(&mut omega, *factor, &problem, slope));
        derivatives.omega = omega.into();
        // At constant displacement per cycle, the speed is proportional to the frequency.
        derivatives.omega.v_m_s = (motion.metrics.d_m
            + derivatives.omega.d_m * problem.omega_rad_s)
            / std::f64::consts::TAU;
        Ok(derivatives)
    }

    /// Returns the derivatives of displacement and work of the last solution with respect to the frequency, per rad/s,
    /// and to numbers of the commands, in SI units and in their order. Of a robot of three links, these are numbers of the
    /// commands of its joints.
    ///
    /// # Errors
    /// Returns an error as [`AnySolver::status`] does, or if the robot does not have one of the numbers.
    pub fn distance_and_work_derivatives(
        &mut self,
        numbers: &[ChainNumber],
    ) -> Result<(DistanceAndWork, Vec<DistanceAndWork>)> {
        let Some(problem) = self.chain.last().cloned() else {
            let both = self.three_links.distance_and_work_derivatives()?;
            let of = |number: &ChainNumber| match *number {
                ChainNumber::Command(joint, number) if joint < Robot::JOINTS => {
                    Ok(both.each_ref().map(|of| match number {
                        CommandNumber::Offset => of.gait[joint][0],
                        CommandNumber::Amplitude => of.gait[joint][1],
                        CommandNumber::Phase => of.gait[joint][2],
                        CommandNumber::SecondInPhase => of.second[joint][0],
                        CommandNumber::SecondQuadrature => of.second[joint][1],
                    }))
                }
                number => Err(ChainError::NoNumber(number.key()).into()),
            };
            let numbers = numbers.iter().map(of).collect::<Result<_>>()?;
            return Ok((both.each_ref().map(|of| of.omega), numbers));
        };
        let InputSlopes { motion, numbers, scaled } =
            input_slopes(&mut self.chain, &problem, numbers)?;
        let both = |slopes: &ChainSlopes| [slopes.metrics.d_m, slopes.work_j];
        // Forces, and therefore the work, scale with the square of the frequency.
        let mut omega = [0.0, 2.0 * motion.loss_j / problem.omega_rad_s];
        for (factor, slopes) in &scaled {
            omega.iter_mut().zip(both(slopes)).for_each(|(sum, slope)| *sum += factor * slope);
        }
        Ok((omega, numbers.iter().map(both).collect()))
    }

    /// Returns the largest absolute torque of the actuators of joints at `samples + 1` times of a cycle of the last
    /// solution, N m: the torque at driven and elastic joints, and the commanded torque. Torques that are not finite, at
    /// a singular shape, are left out; zero if there are no others.
    ///
    /// # Errors
    /// Returns an error as [`AnySolver::status`] does.
    pub fn largest_torque_nm(&mut self, gait: &AnyGait, samples: usize) -> Result<f64> {
        let cycle = self.cycle(samples)?;
        let chain = self.chain.last();
        let torques_nm = cycle.iter().flat_map(|sample| {
            sample.torque_nm.iter().enumerate().filter_map(move |(joint, torque_nm)| {
                let Some(problem) = chain else {
                    return gait.joints[joint].map(|_| *torque_nm);
                };
                match problem.chain.joints[joint] {
                    Joint::Free(FreeJoint { target, torque, .. })
                        if target.half_range_rad() == 0.0 =>
                    {
                        Some(torque.at(problem.omega_rad_s * sample.time_s))
                    }
                    Joint::Driven(_) | Joint::Free(_) => Some(*torque_nm),
                }
            })
        });
        let finite = torques_nm.map(f64::abs).filter(|torque| torque.is_finite());
        Ok(finite.fold(0.0, f64::max))
    }
}

impl From<Solver> for AnySolver {
    fn from(three_links: Solver) -> Self {
        Self { three_links, chain: ChainSolver::default() }
    }
}

/// Derivatives of a chain's motion from which those with respect to the frequency follow as well.
struct InputSlopes {
    motion: ChainMotion,
    /// With respect to the given numbers.
    numbers: Vec<ChainSlopes>,
    /// With respect to the numbers that scale with the frequency, each with the negative of the rate, per rad/s, at which
    /// it would have to change with the frequency to keep the motion as a function of phase.
    scaled: Vec<(f64, ChainSlopes)>,
}

/// Returns the last solution, that of `problem`, and its derivatives with respect to the given numbers and to those that
/// scale with the frequency.
fn input_slopes(
    solver: &mut ChainSolver,
    problem: &ChainProblem,
    numbers: &[ChainNumber],
) -> Result<InputSlopes> {
    // The motion as a function of phase is the same at another frequency if each number is scaled by a power of it.
    let effective = problem.effective();
    let scaled: Vec<ChainNumber> = problem
        .chain
        .numbers()
        .into_iter()
        .filter(|number| {
            number.power_of_omega() != 0 && effective.chain.number(*number) != Some(0.0)
        })
        .collect();
    let all = [numbers, &scaled].concat();
    let mut slopes = solver.slopes(&all)?;
    let motion = solver.motion()?;
    let of_scaled = slopes.split_off(numbers.len());
    let factor = |number: &ChainNumber| {
        let value = problem.chain.number(*number).unwrap_or(0.0);
        -f64::from(number.power_of_omega()) * value / problem.omega_rad_s
    };
    let scaled = scaled.iter().map(factor).zip(of_scaled).collect();
    Ok(InputSlopes { motion, numbers: slopes, scaled })
}

/// Adds derivatives of a chain's metrics, multiplied by a factor.
fn add(sum: &mut ByMetric<f64>, factor: f64, problem: &ChainProblem, slopes: &ChainSlopes) {
    let slopes = slopes.metrics.by_number(&problem.chain);
    sum.iter_mut().for_each(|(metric, sum)| *sum += factor * slopes[metric]);
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::Metric;
    use trilink_robot::{Quantity, Robot};

    use super::*;

    /// Asserts that derivatives of the metrics of three links agree.
    fn assert_alike(found: &GaitMetrics, known: &GaitMetrics, of: &str) {
        for metric in Metric::OF_THREE_LINKS {
            let scale =
                known.to_array().into_iter().fold(1e-3, |most: f64, one| most.max(one.abs()));
            assert!(
                (found[metric] - known[metric]).abs() < 1e-6 * scale,
                "{of}, {metric}: {} {}",
                found[metric],
                known[metric]
            );
        }
    }

    #[test]
    fn a_chain_of_three_links_has_the_derivatives_of_a_robot_of_three_links() {
        for (robot, gait, laws) in [
            (Robot::kinematic(), Gait::skewed(), Laws::SKID_ROLL),
            (Robot::semi_passive(), Gait::passive_symmetric(), Laws::COULOMB_VISCOUS),
        ] {
            let problem = AnyProblem {
                robot: robot.clone().into(),
                gait: gait.into(),
                laws,
                omega_rad_s: 3.0,
            };
            let as_chain = AnyProblem { robot: robot.chain(&gait).into(), ..problem.clone() };
            let mut solvers = [AnySolver::default(), AnySolver::default()];
            let [known, found] = &mut solvers;
            let metrics = known.solve(&problem, REFERENCE_ACCURACY).unwrap();
            assert_alike(&found.solve(&as_chain, REFERENCE_ACCURACY).unwrap(), &metrics, "motion");
            assert_eq!(found.status(), known.status());
            assert_eq!(found.from_rest(&as_chain, metrics), known.from_rest(&problem, metrics));
            let [known, found] =
                solvers.each_mut().map(|solver| solver.input_derivatives().unwrap());
            assert_alike(&found.omega, &known.omega, "omega");
            let pairs = found.gait.as_flattened().iter().zip(known.gait.as_flattened());
            for (i, (found, known)) in pairs.enumerate() {
                assert_alike(found, known, &format!("gait {i}"));
            }
            let joints = (0..Robot::JOINTS).filter(|joint| gait.joints[*joint].is_some());
            let numbers: Vec<ChainNumber> = joints
                .flat_map(|joint| {
                    let numbers =
                        [CommandNumber::Offset, CommandNumber::Amplitude, CommandNumber::Phase];
                    numbers.map(|number| ChainNumber::Command(joint, number))
                })
                .collect();
            let [known, found] = solvers.each_mut().map(|solver| {
                let (omega, others) = solver.distance_and_work_derivatives(&numbers).unwrap();
                [vec![omega], others].concat().concat()
            });
            let scale = known.iter().fold(0.0, |most: f64, one| most.max(one.abs()));
            for (found, known) in found.iter().zip(&known) {
                assert!((found - known).abs() < 1e-6 * scale, "{found} {known}");
            }
            let [known, found] = &mut solvers;
            let wheels = [Quantity::Skid.parameter(0), Quantity::Roll.sum()];
            let joint = [0, 1].map(|joint| Quantity::Stiffness.parameter(joint));
            let parameters = |joint| [wheels[0], wheels[1], joint];
            let known = known.derivatives_of(&parameters(joint[0])).unwrap();
            let found = found.derivatives_of(&parameters(joint[1])).unwrap();
            for (parameter, (found, known)) in
                parameters(joint[0]).iter().zip(found.iter().zip(&known))
            {
                assert_alike(found, known, parameter.name());
            }
        }
    }
}
