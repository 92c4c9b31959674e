//! Warm-started solver of steady-state motions.

use std::f64::consts::TAU;

use trilink_robot::metrics::{ByMetric, GaitMetrics};
use trilink_robot::{
    AnyRobot, ChainNumber, CommandNumber, Dry, FreeJoint, Friction, Joint, MAX_JOINTS, Parameter,
    Quantity,
};

use super::chain::{ChainProblem, Slopes, Steady};
use super::{
    Effort, FromRest, MotionError, MotionStatus, Problem, REFERENCE_ACCURACY, Result, Sample,
    SteadyMotion,
};

/// Warm-started solver of steady-state motions, which reuses its workspace. A solution starts from the last one if both
/// motions are of the same kind: with as many free joints, with or without skid, and with or without dry friction.
/// Otherwise it starts from the model's initial guess.
#[derive(Debug, Clone)]
pub struct Solver {
    /// Creates the equations of motion of a problem under the solver's friction law.
    steady: fn(ChainProblem) -> Result<Box<dyn Steady>>,
    kept: Option<Box<dyn Steady>>,
    /// Kind of the motion from which the next solution starts; `None` if it starts from the initial guess. It is kept after
    /// a failed [`Solver::solve_near`], but not after a failed [`Solver::solve`].
    start: Option<StartKind>,
    /// Last problem that was solved.
    last: Option<Problem>,
    effort: Effort,
}

/// What two motions must have in common for one to be the start of the search for the other.
#[derive(Debug, Clone, Copy, PartialEq)]
struct StartKind {
    free_joints: usize,
    skids: bool,
    is_linear: bool,
}

impl StartKind {
    fn of(problem: &ChainProblem) -> Self {
        Self {
            free_joints: problem.chain.free_joints(),
            skids: problem.laws.skids(),
            is_linear: problem.laws.are_linear(),
        }
    }
}

/// Attractor reached from rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attractor {
    pub motion: SteadyMotion,
    /// Number of cycles after which the state at the end of each cycle stays within 1 % of its steady-state
    /// value.
    pub cycles: usize,
    /// Whether the attractor is the solution that [`Solver::solve`] finds.
    pub is_found_by_solve: bool,
}

impl Attractor {
    /// Classifies the result of the search for the attractor reached from rest.
    pub fn from_rest(attractor: &Result<Self>) -> FromRest {
        match attractor {
            Ok(attractor) if attractor.is_found_by_solve => FromRest::Reached,
            Ok(_) => FromRest::Another,
            Err(_) => FromRest::Unsettled,
        }
    }
}

/// Derivatives of the metrics, and of the work of the actuators over a cycle (J), per SI unit of a number. Those with
/// respect to a length are at constant [`skid_length_m`](trilink_robot::Chain::skid_length_m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NumberDerivatives {
    pub metrics: GaitMetrics,
    pub work_j: f64,
}

/// Derivatives of metrics with respect to the frequency, per rad/s, and to the offset, amplitude and phase of each
/// joint's command (`gait[joint][number]`), per radian; zero for a joint that is not driven, NaN if no motion exists for
/// neighbouring gaits.
#[derive(Debug, Clone, PartialEq)]
pub struct InputDerivatives {
    pub omega: GaitMetrics,
    pub gait: [[GaitMetrics; COMMAND.len()]; MAX_JOINTS],
}

/// Numbers of a command in [`InputDerivatives`].
const COMMAND: [CommandNumber; 3] =
    [CommandNumber::Offset, CommandNumber::Amplitude, CommandNumber::Phase];

impl Default for Solver {
    fn default() -> Self {
        Self::with_friction::<Dry>()
    }
}

impl Solver {
    /// Creates a solver that uses friction law `F` in place of the friction laws in the problems. The laws in a problem then
    /// determine only whether the wheels can skid, which coefficients are zero, and with respect to which numbers
    /// derivatives are computed. The example `own_friction` defines such a law.
    ///
    /// Derivatives with respect to the frequency require that a law scales as [`Dry`] does: if all velocities are multiplied
    /// by c, and all coefficients by c to [`ChainNumber::power_of_omega`], the forces are multiplied by the square of c.
    pub fn with_friction<F: Friction>() -> Self {
        Self {
            steady: ChainProblem::steady_with::<F>,
            kept: None,
            start: None,
            last: None,
            effort: Effort::default(),
        }
    }

    /// Solves for the steady-state periodic motion to a relative `accuracy` of its metrics. Under commands
    /// with half-period symmetry, the motion has this symmetry, too; but if the symmetric motion is unstable
    /// to symmetry breaking, the solution is the motion reached from rest, one of a mirror-image pair.
    ///
    /// # Errors
    /// Returns an error if the description of the robot is wrong, if the problem has no steady-state motion, or if the
    /// motion could not be found or resolved.
    pub fn solve(&mut self, problem: &Problem, accuracy: f64) -> Result<GaitMetrics> {
        let chain = problem.as_chain();
        let kind = StartKind::of(&chain);
        let is_warm = self.start.take() == Some(kind);
        let metrics = self.set_problem(chain)?.solve(is_warm, accuracy)?;
        self.record(problem, kind);
        Ok(problem.own_metrics(metrics))
    }

    /// Solves as [`Solver::solve`] does, except if a solution of the same kind exists: then Newton's method starts only
    /// from that solution and from the model's initial guess, not from a transient, and after a failure the next
    /// solution starts from the existing one. Meant for searches, which solve many similar problems.
    ///
    /// # Errors
    /// Returns an error as [`Solver::solve`] does, or if the motion is too far from the existing solution.
    pub fn solve_near(&mut self, problem: &Problem, accuracy: f64) -> Result<GaitMetrics> {
        let chain = problem.as_chain();
        let kind = StartKind::of(&chain);
        if self.start != Some(kind) {
            return self.solve(problem, accuracy);
        }
        let metrics = self.set_problem(chain)?.solve_near(accuracy)?;
        self.record(problem, kind);
        Ok(problem.own_metrics(metrics))
    }

    /// Integrates the transient from rest and solves for the steady-state motion that it reaches. The next
    /// solution starts from that motion.
    ///
    /// # Errors
    /// Returns an error if the description of the robot is wrong, if the transient cannot be integrated or does not settle,
    /// or, where constraints and commands determine the motion, as [`Solver::solve`] does.
    pub fn settle(&mut self, problem: &Problem, accuracy: f64) -> Result<Attractor> {
        let first = self.solve(problem, accuracy);
        self.attractor(problem, first, accuracy)
    }

    /// Finds the attractor as [`Solver::settle`] does, given `first`, the result of [`Solver::solve`] for
    /// this problem.
    ///
    /// # Errors
    /// Returns an error as [`Solver::settle`] does.
    pub fn attractor(
        &mut self,
        problem: &Problem,
        first: Result<GaitMetrics>,
        accuracy: f64,
    ) -> Result<Attractor> {
        let chain = problem.as_chain();
        let kind = StartKind::of(&chain);
        if chain.is_determined() {
            let motion = self.steady_motion(first?)?;
            return Ok(Attractor { motion, cycles: 0, is_found_by_solve: true });
        }
        self.start = None;
        let (metrics, cycles, is_found_by_solve) =
            self.set_problem(chain)?.reach(first.is_ok(), accuracy)?;
        self.record(problem, kind);
        let motion = self.steady_motion(problem.own_metrics(metrics))?;
        Ok(Attractor { motion, cycles, is_found_by_solve })
    }

    /// Returns whether the last solution, that of `problem` with the given metrics, is reached from rest. The motion that
    /// is reached becomes the last solution.
    pub fn from_rest(&mut self, problem: &Problem, metrics: GaitMetrics) -> FromRest {
        Attractor::from_rest(&self.attractor(problem, Ok(metrics), REFERENCE_ACCURACY))
    }

    /// Creates a solver whose next solution starts from the same motion as the next solution of this solver.
    /// The new solver has no last solution that could be queried.
    pub fn successor(&self) -> Self {
        let kept = self.kept.as_ref().map(|kept| kept.successor());
        Self { kept, last: None, effort: Effort::default(), ..*self }
    }

    /// Makes the next solution start from the model's initial guess, and drops the last solution; the workspace is retained.
    pub fn forget(&mut self) {
        (self.start, self.last) = (None, None);
    }

    /// Returns the modulus of the last solution's largest Floquet multiplier; `None` if the motion has no
    /// dynamic states.
    ///
    /// # Errors
    /// Returns an error if there is no last solution, or if its linearisation is singular.
    pub fn floquet(&mut self) -> Result<Option<f64>> {
        self.solved()?.1.floquet()
    }

    /// Returns whether the last solution is one of two motions that mirror each other with a shift of half a
    /// period, although the commands have half-period symmetry.
    ///
    /// # Errors
    /// Returns an error if there is no last solution.
    pub fn is_symmetry_broken(&mut self) -> Result<bool> {
        Ok(self.solved()?.1.is_symmetry_broken())
    }

    /// Returns whether the last solution is stable, and whether it is one of a mirror-image pair.
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does.
    pub fn status(&mut self) -> Result<MotionStatus> {
        Ok(MotionStatus::new(self.floquet()?, self.is_symmetry_broken()?))
    }

    /// Returns the work of the actuators and the energy dissipated over a cycle of the last solution, J. The two are
    /// equal up to the accuracy of the solution.
    ///
    /// # Errors
    /// Returns an error if there is no last solution.
    pub fn work_and_loss_j(&mut self) -> Result<[f64; 2]> {
        Ok(self.solved()?.1.work_and_loss_j())
    }

    /// Returns the energy dissipated over a cycle of the last solution, J.
    ///
    /// # Errors
    /// Returns an error if there is no last solution.
    pub fn loss_j(&mut self) -> Result<f64> {
        Ok(self.solved()?.1.loss_j())
    }

    /// Returns the steady-state motion of the last solution, given its metrics.
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does.
    pub fn steady_motion(&mut self, metrics: GaitMetrics) -> Result<SteadyMotion> {
        let floquet = self.floquet()?;
        // In a periodic motion, the actuators supply what is dissipated, which is known more accurately.
        let work_j = self.loss_j()?;
        let is_symmetry_broken = self.is_symmetry_broken()?;
        Ok(SteadyMotion { metrics, floquet, work_j, is_symmetry_broken })
    }

    /// Takes one more Newton step, with a fresh Jacobian, from the last solution. Returns the size of the
    /// step relative to the states, which estimates the remaining error.
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does.
    pub fn polish(&mut self) -> Result<f64> {
        self.solved()?.1.polish()
    }

    /// Samples one cycle of the last solution at `samples + 1` equally spaced times, the first at phase 0.
    ///
    /// # Errors
    /// Returns an error if there is no last solution, or if its equations cannot be solved at a sample.
    pub fn cycle(&mut self, samples: usize) -> Result<Vec<Sample>> {
        self.solved()?.1.cycle(samples)
    }

    /// Returns the computational effort of the last search for a motion.
    pub fn effort(&self) -> Effort {
        self.effort
    }

    /// Returns the derivatives of the last solution with respect to numbers of the robot, in SI units and in their order.
    /// The numbers of a robot of three links are those of [`Robot::chain`](trilink_robot::Robot::chain).
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does, or if the robot does not have one of the numbers.
    pub fn derivatives(&mut self, numbers: &[ChainNumber]) -> Result<Vec<NumberDerivatives>> {
        let slopes = self.slopes(numbers, Slopes::All)?;
        Ok(slopes
            .into_iter()
            .map(|(metrics, work_j)| NumberDerivatives { metrics, work_j })
            .collect())
    }

    /// Returns the derivatives of the last solution's metrics with respect to the given parameters, in their order.
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does.
    pub fn derivatives_of(&mut self, parameters: &[Parameter]) -> Result<Vec<GaitMetrics>> {
        let derivatives = self.of_parameters(parameters, Slopes::Metrics)?;
        Ok(derivatives.into_iter().map(|derivatives| derivatives.metrics).collect())
    }

    /// Returns the derivatives of the last solution with respect to the given parameters, in their order.
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does.
    pub fn parameter_derivatives(
        &mut self,
        parameters: &[Parameter],
    ) -> Result<Vec<NumberDerivatives>> {
        self.of_parameters(parameters, Slopes::All)
    }

    fn of_parameters(
        &mut self,
        parameters: &[Parameter],
        wanted: Slopes,
    ) -> Result<Vec<NumberDerivatives>> {
        let Problem { robot, gait, .. } = self.last.as_ref().ok_or(MotionError::Unsolved)?;
        let shares = robot.shares_of(parameters, gait).into_iter().enumerate();
        let numbers: Vec<(usize, ChainNumber, f64)> = shares
            .flat_map(|(i, shares)| {
                shares.into_iter().map(move |(number, share)| (i, number, share))
            })
            .collect();
        // The skid ratios of three links refer to the mean length of the side links.
        let length_m = match robot {
            AnyRobot::ThreeLinks(robot) => robot.skid_length_m(),
            AnyRobot::Chain(_) => f64::INFINITY,
        };
        let all: Vec<ChainNumber> = numbers.iter().map(|(_, number, _)| *number).collect();
        let slopes = self.slopes(&all, wanted)?;
        let sigma = self.solved()?.1.metrics().sigma;
        let none = (ByMetric::<f64>::splat(0.0), 0.0);
        let mut sums = vec![none; parameters.len()];
        for ((i, _, share), (slope, slope_j)) in numbers.iter().zip(&slopes) {
            add(&mut sums[*i].0, *share, slope);
            sums[*i].1 += share * slope_j;
        }
        let derivative = |parameter: &Parameter, (metrics, work_j): (ByMetric<f64>, f64)| {
            let mut metrics = GaitMetrics::from(metrics);
            if parameter.quantity() == Quantity::L {
                let share = if parameter.number().is_some() { 0.5 } else { 1.0 };
                for (slope, sigma) in metrics.sigma.iter_mut().zip(sigma) {
                    *slope -= share * sigma / length_m;
                }
            }
            NumberDerivatives { metrics, work_j }
        };
        Ok(std::iter::zip(parameters, sums).map(|(of, sum)| derivative(of, sum)).collect())
    }

    /// Returns the derivatives of the last solution's metrics with respect to the frequency and the gait.
    ///
    /// # Errors
    /// Returns an error as [`Solver::floquet`] does.
    pub fn input_derivatives(&mut self) -> Result<InputDerivatives> {
        let problem = self.last.as_ref().ok_or(MotionError::Unsolved)?;
        let commands = problem.gait.joints.iter().enumerate().filter(|(_, one)| one.is_some());
        let numbers: Vec<ChainNumber> = commands
            .flat_map(|(joint, _)| COMMAND.map(|number| ChainNumber::Command(joint, number)))
            .collect();
        let (omega, slopes) = self.with_omega(&numbers, Slopes::Metrics)?;
        let none = [GaitMetrics::NONE; COMMAND.len()];
        let mut derivatives = InputDerivatives { omega: omega.metrics, gait: [none; MAX_JOINTS] };
        for (number, slope) in numbers.iter().zip(&slopes) {
            let ChainNumber::Command(joint, command) = number else { continue };
            let index = COMMAND.iter().position(|one| one == command).unwrap_or(0);
            derivatives.gait[*joint][index] = slope.metrics;
        }
        Ok(derivatives)
    }

    /// Returns the derivatives of the last solution with respect to the frequency, per rad/s, and to numbers of the
    /// robot, in SI units and in their order.
    ///
    /// # Errors
    /// Returns an error as [`Solver::derivatives`] does.
    pub fn derivatives_with_omega(
        &mut self,
        numbers: &[ChainNumber],
    ) -> Result<(NumberDerivatives, Vec<NumberDerivatives>)> {
        self.with_omega(numbers, Slopes::All)
    }

    fn with_omega(
        &mut self,
        numbers: &[ChainNumber],
        wanted: Slopes,
    ) -> Result<(NumberDerivatives, Vec<NumberDerivatives>)> {
        let problem = self.last.as_ref().ok_or(MotionError::Unsolved)?.as_chain().effective();
        let omega_rad_s = problem.omega_rad_s;
        // The motion as a function of phase is the same at another frequency if each number is scaled by a power of it.
        let scaled: Vec<(ChainNumber, f64)> = problem
            .chain
            .numbers()
            .into_iter()
            .filter_map(|number| {
                let value = problem.chain.number(number)?;
                let factor = -f64::from(number.power_of_omega()) * value / omega_rad_s;
                (factor != 0.0).then_some((number, factor))
            })
            .collect();
        let all: Vec<ChainNumber> =
            numbers.iter().copied().chain(scaled.iter().map(|(number, _)| *number)).collect();
        let mut slopes = self.slopes(&all, wanted)?;
        let of_scaled = slopes.split_off(numbers.len());
        let d_m = self.solved()?.1.metrics().d_m;
        // At constant displacement per cycle, the speed is proportional to the frequency; forces, and therefore the work,
        // scale with its square.
        let mut metrics = ByMetric::<f64>::splat(0.0);
        let mut work_j = match wanted {
            Slopes::All => 2.0 * self.loss_j()? / omega_rad_s,
            Slopes::Metrics => 0.0,
        };
        for ((_, factor), (slope, slope_j)) in scaled.iter().zip(&of_scaled) {
            add(&mut metrics, *factor, slope);
            work_j += factor * slope_j;
        }
        let mut metrics = GaitMetrics::from(metrics);
        metrics.v_m_s = (d_m + metrics.d_m * omega_rad_s) / TAU;
        let number = |(metrics, work_j)| NumberDerivatives { metrics, work_j };
        Ok((NumberDerivatives { metrics, work_j }, slopes.into_iter().map(number).collect()))
    }

    /// Returns the derivatives of the metrics and of the work; that of the work is zero if it is not wanted.
    fn slopes(
        &mut self,
        numbers: &[ChainNumber],
        wanted: Slopes,
    ) -> Result<Vec<(GaitMetrics, f64)>> {
        let (problem, kept) = self.solved()?;
        let mut slopes = kept.slopes(numbers, wanted)?;
        slopes.iter_mut().for_each(|(metrics, _)| *metrics = problem.own_metrics(*metrics));
        Ok(slopes)
    }

    /// Returns the largest absolute torque of the actuators of joints at `samples + 1` times of a cycle of the last
    /// solution, N m: the whole torque at driven joints and at free joints whose spring is commanded, the prescribed torque
    /// at the other free joints. Torques that are not finite, at a singular shape, are left out; zero if there are no
    /// others.
    ///
    /// # Errors
    /// Returns an error as [`Solver::cycle`] does.
    pub fn largest_torque_nm(&mut self, samples: usize) -> Result<f64> {
        let ChainProblem { chain, omega_rad_s, .. } =
            self.last.as_ref().ok_or(MotionError::Unsolved)?.as_chain();
        let cycle = self.cycle(samples)?;
        let torques_nm = cycle.iter().flat_map(|sample| {
            let joints = chain.joints.iter().zip(&sample.torque_nm);
            joints.map(|(joint, torque_nm)| match joint {
                Joint::Free(FreeJoint { target, torque, .. }) if target.half_range_rad() == 0.0 => {
                    torque.at(omega_rad_s * sample.time_s)
                }
                Joint::Driven(_) | Joint::Free(_) => *torque_nm,
            })
        });
        let finite = torques_nm.map(f64::abs).filter(|torque| torque.is_finite());
        Ok(finite.fold(0.0, f64::max))
    }

    /// Records the problem of the current solution.
    fn record(&mut self, problem: &Problem, kind: StartKind) {
        (self.start, self.last) = (Some(kind), Some(problem.clone()));
        self.effort = self.kept.as_ref().map_or(Effort::default(), |kept| kept.effort());
    }

    fn solved(&mut self) -> Result<(&Problem, &mut Box<dyn Steady>)> {
        self.last.as_ref().zip(self.kept.as_mut()).ok_or(MotionError::Unsolved)
    }

    fn set_problem(&mut self, problem: ChainProblem) -> Result<&mut Box<dyn Steady>> {
        self.last = None;
        let problem = problem.checked()?;
        let free_joints = problem.chain.free_joints();
        // If the equations of a problem cannot be set up, the last solution can still be the start of the next.
        match self.kept.take_if(|kept| kept.free_joints() == free_joints) {
            Some(mut kept) => {
                let result = kept.set_problem(problem);
                let kept = self.kept.insert(kept);
                result.map(|()| kept)
            }
            None => Ok(self.kept.insert((self.steady)(problem)?)),
        }
    }
}

/// Adds derivatives of metrics, multiplied by a factor.
fn add(sum: &mut ByMetric<f64>, factor: f64, slopes: &GaitMetrics) {
    sum.iter_mut().for_each(|(metric, sum)| *sum += factor * slopes[metric]);
}
