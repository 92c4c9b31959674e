//! Steady-state motions of robots of any number of links behind one interface.

mod sample;

use trilink_robot::metrics::{ByMetric, GaitMetrics};
use trilink_robot::{
    AnyGait, AnyRobot, ChainNumber, CommandNumber, Gait, Laws, MAX_JOINTS, Parameter,
};

use super::chain::{ChainProblem, ChainSlopes};
use super::reduced::COMMAND_SIZE;
use super::{
    Attractor, FORCES_ACCURACY, FromRest, MotionStatus, Problem, REFERENCE_ACCURACY, Result, Solver,
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
enum Kind {
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
    fn kind(&self) -> Kind {
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
}

/// Derivatives of metrics with respect to the frequency, per rad/s, and to the offset, amplitude and phase of each
/// joint's command, per radian; zero for a joint that is not driven, NaN if no motion exists for neighbouring gaits.
#[derive(Debug, Clone, PartialEq)]
pub struct InputDerivatives {
    pub omega: GaitMetrics,
    pub gait: [[GaitMetrics; COMMAND_SIZE]; MAX_JOINTS],
}

/// Solver of steady-state motions of robots of any number of links. For a robot of three links, a solution starts from
/// the last one, as that of a [`Solver`]; for a chain, every solution starts from its initial guess.
#[derive(Debug, Clone, Default)]
pub struct AnySolver {
    three_links: Solver,
    /// Problem of the last solution if its robot is a chain.
    last_chain: Option<ChainProblem>,
}

impl AnySolver {
    /// Solves for the steady-state periodic motion to a relative `accuracy` of its metrics.
    ///
    /// # Errors
    /// Returns an error if the problem has no steady-state motion, or if the motion could not be found or resolved.
    pub fn solve(&mut self, problem: &AnyProblem, accuracy: f64) -> Result<GaitMetrics> {
        self.last_chain = None;
        match problem.kind() {
            Kind::ThreeLinks(problem) => self.three_links.solve(&problem, accuracy),
            Kind::Chain(problem) => {
                // Without a solution for the chain, there must not be an older one that could be queried.
                self.three_links.forget();
                let metrics = problem.metrics(accuracy)?;
                let metrics = metrics.by_number(&problem.chain);
                self.last_chain = Some(problem);
                Ok(metrics)
            }
        }
    }

    /// Creates a solver whose next solution starts from the same motion as the next solution of this solver. The new
    /// solver has no last solution that could be queried.
    pub fn successor(&self) -> Self {
        Self { three_links: self.three_links.successor(), last_chain: None }
    }

    /// Makes the next solution start from the model's initial guess; the workspace is retained.
    pub fn forget(&mut self) {
        self.three_links.forget();
        self.last_chain = None;
    }

    /// Returns whether the last solution is stable, and whether it is one of a mirror-image pair.
    ///
    /// # Errors
    /// Returns an error if there is no last solution, or if its linearisation is singular.
    pub fn status(&mut self) -> Result<MotionStatus> {
        match &self.last_chain {
            None => self.three_links.status(),
            Some(problem) => Ok(problem.solve(REFERENCE_ACCURACY)?.status()),
        }
    }

    /// Returns whether the motion that the solver finds, whose metrics are given, is reached from rest.
    pub fn from_rest(&mut self, problem: &AnyProblem, metrics: GaitMetrics) -> FromRest {
        match problem.kind() {
            Kind::ThreeLinks(problem) => {
                let solver = &mut self.three_links;
                Attractor::from_rest(&solver.attractor(&problem, Ok(metrics), REFERENCE_ACCURACY))
            }
            Kind::Chain(problem) => match problem.settle(REFERENCE_ACCURACY) {
                Ok(attractor) if attractor.is_found_by_solve => FromRest::Reached,
                Ok(_) => FromRest::Another,
                Err(_) => FromRest::Unsettled,
            },
        }
    }

    /// Returns the derivatives of the last solution's metrics with respect to the given parameters, in their order.
    ///
    /// # Errors
    /// Returns an error as [`AnySolver::status`] does.
    pub fn derivatives_of(&mut self, parameters: &[Parameter]) -> Result<Vec<GaitMetrics>> {
        let Some(problem) = &self.last_chain else {
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
        let (_, slopes) = problem.derivatives(REFERENCE_ACCURACY, &wanted)?;
        let mut derivatives = vec![ByMetric::<f64>::splat(0.0); parameters.len()];
        for ((i, _, share), slope) in numbers.iter().zip(&slopes) {
            add(&mut derivatives[*i], *share, problem, slope);
        }
        Ok(derivatives.into_iter().map(GaitMetrics::from).collect())
    }

    /// Returns the derivatives of the last solution's metrics with respect to the frequency and the gait.
    ///
    /// # Errors
    /// Returns an error as [`AnySolver::status`] does.
    pub fn input_derivatives(&mut self) -> Result<InputDerivatives> {
        let none = [GaitMetrics::NONE; COMMAND_SIZE];
        let Some(problem) = &self.last_chain else {
            let derivatives = self.three_links.derivatives()?;
            let of_joint = |joint: usize| derivatives.gait.get(joint).copied().unwrap_or(none);
            let gait = std::array::from_fn(of_joint);
            return Ok(InputDerivatives { omega: derivatives.omega, gait });
        };
        const COMMAND: [CommandNumber; COMMAND_SIZE] =
            [CommandNumber::Offset, CommandNumber::Amplitude, CommandNumber::Phase];
        let gait = problem.chain.gait();
        let commands = gait.joints.iter().enumerate().filter(|(_, command)| command.is_some());
        let mut numbers: Vec<ChainNumber> = commands
            .flat_map(|(joint, _)| COMMAND.map(|number| ChainNumber::Command(joint, number)))
            .collect();
        let of_gait = numbers.len();
        // The motion as a function of phase is the same at another frequency if each number is scaled by a power of it.
        let effective = problem.effective();
        numbers.extend(problem.chain.numbers().into_iter().filter(|number| {
            number.power_of_omega() != 0 && effective.chain.number(*number) != Some(0.0)
        }));
        let (motion, slopes) = problem.derivatives(REFERENCE_ACCURACY, &numbers)?;
        let mut derivatives =
            InputDerivatives { omega: GaitMetrics::NONE, gait: [none; MAX_JOINTS] };
        let mut omega = ByMetric::<f64>::splat(0.0);
        for (i, (number, slope)) in numbers.iter().zip(&slopes).enumerate() {
            let mut own = ByMetric::<f64>::splat(0.0);
            match number {
                ChainNumber::Command(joint, command) if i < of_gait => {
                    add(&mut own, 1.0, problem, slope);
                    let index = COMMAND.iter().position(|one| one == command).unwrap_or(0);
                    derivatives.gait[*joint][index] = own.into();
                }
                number => {
                    let value = problem.chain.number(*number).unwrap_or(0.0);
                    let factor = -f64::from(number.power_of_omega()) * value / problem.omega_rad_s;
                    add(&mut omega, factor, problem, slope);
                }
            }
        }
        derivatives.omega = omega.into();
        // At constant displacement per cycle, the speed is proportional to the frequency.
        derivatives.omega.v_m_s = motion.metrics.v_m_s / problem.omega_rad_s
            + derivatives.omega.d_m * problem.omega_rad_s / std::f64::consts::TAU;
        Ok(derivatives)
    }

    /// Returns the skid velocities of all wheels at `samples + 1` times of a cycle of the last solution, m/s.
    ///
    /// # Errors
    /// Returns an error as [`AnySolver::status`] does.
    pub fn skid_m_s(&mut self, samples: usize) -> Result<Vec<f64>> {
        Ok(match &self.last_chain {
            None => {
                let cycle = self.three_links.cycle(samples)?;
                cycle.iter().flat_map(|sample| sample.skid_m_s).collect()
            }
            Some(problem) => {
                let cycle = problem.cycle(FORCES_ACCURACY, samples)?;
                cycle
                    .iter()
                    .flat_map(|sample| sample.skid_m_s.clone())
                    .filter(|of| !of.is_nan())
                    .collect()
            }
        })
    }
}

impl From<Solver> for AnySolver {
    fn from(three_links: Solver) -> Self {
        Self { three_links, last_chain: None }
    }
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
