//! Samples of motions of robots of any number of links.

use trilink_robot::{Chain, Pose, rotated};

use super::{AnyProblem, AnySolver, Kind};
use crate::chain::ChainSample;
use crate::{Attractor, Result, Sample, SteadyMotion};

/// State of a robot of any number of links and the forces on it at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct AnySample {
    pub time_s: f64,
    /// Pose of link 0; the motion starts at the origin, heading along x.
    pub pose: Pose,
    /// Rates `(x', y', theta')` of that pose, m/s and rad/s.
    pub pose_rates: [f64; 3],
    /// Joint angles from front to rear, rad.
    pub phi_rad: Vec<f64>,
    /// Roll velocities of the wheels by number, m/s; NaN for a link without a wheel.
    pub roll_m_s: Vec<f64>,
    /// Skid velocities of the wheels by number, m/s; NaN for a link without a wheel.
    pub skid_m_s: Vec<f64>,
    /// Lateral contact forces on the wheels by number, N: the constraint forces where the wheels cannot skid, otherwise
    /// friction. NaN for a link without a wheel or where they are unbounded.
    pub lateral_n: Vec<f64>,
    /// Rolling friction forces on the wheels by number, N; NaN for a link without a wheel.
    pub roll_n: Vec<f64>,
    /// Torques at the joints from front to rear, N m: of the actuator, or of the spring, the damper and the command.
    pub torque_nm: Vec<f64>,
    /// Power of the actuators, W.
    pub power_w: f64,
    /// Power dissipated at the wheels, by drag and in the joints, W.
    pub loss_w: f64,
}

impl From<Sample> for AnySample {
    fn from(sample: Sample) -> Self {
        let Sample { time_s, pose, phi_rad, rates, roll_m_s, skid_m_s, forces } = sample;
        let [x_rate_m_s, y_rate_m_s, turning_rad_s, ..] = rates;
        Self {
            time_s,
            pose,
            pose_rates: [x_rate_m_s, y_rate_m_s, turning_rad_s],
            phi_rad: phi_rad.into(),
            roll_m_s: roll_m_s.into(),
            skid_m_s: skid_m_s.into(),
            lateral_n: forces.lateral_n.into(),
            roll_n: forces.roll_n.into(),
            torque_nm: forces.torque_nm.into(),
            power_w: forces.power_w,
            loss_w: forces.loss_w,
        }
    }
}

impl ChainSample {
    /// Returns the sample with the wheels by the numbers of their links.
    fn by_number(self, chain: &Chain) -> AnySample {
        let order = chain.numbering();
        let [roll_m_s, skid_m_s, lateral_n, roll_n] =
            [&self.roll_m_s, &self.skid_m_s, &self.lateral_n, &self.roll_n]
                .map(|of| order.iter().map(|link| of[*link]).collect());
        let Self { time_s, pose, phi_rad, body: [u, v, turning_rad_s], .. } = self;
        let [x_rate_m_s, y_rate_m_s] = rotated(pose.theta_rad, [u, v]);
        let Self { torque_nm, power_w, loss_w, .. } = self;
        AnySample {
            time_s,
            pose,
            pose_rates: [x_rate_m_s, y_rate_m_s, turning_rad_s],
            phi_rad,
            roll_m_s,
            skid_m_s,
            lateral_n,
            roll_n,
            torque_nm,
            power_w,
            loss_w,
        }
    }
}

fn of_three_links(samples: Vec<Sample>) -> Vec<AnySample> {
    samples.into_iter().map(AnySample::from).collect()
}

fn of_chain(samples: Vec<ChainSample>, chain: &Chain) -> Vec<AnySample> {
    samples.into_iter().map(|sample| sample.by_number(chain)).collect()
}

impl AnySolver {
    /// Samples one cycle of the last solution at `samples + 1` equally spaced times, the first at phase 0.
    ///
    /// # Errors
    /// Returns an error if there is no last solution, or if its equations cannot be solved at a sample.
    pub fn cycle(&mut self, samples: usize) -> Result<Vec<AnySample>> {
        match self.chain.last().cloned() {
            None => Ok(of_three_links(self.three_links.cycle(samples)?)),
            Some(problem) => Ok(of_chain(self.chain.cycle(samples)?, &problem.chain)),
        }
    }
}

impl AnyProblem {
    /// Solves for the steady-state periodic motion to a relative `accuracy` of its metrics, and for its stability.
    ///
    /// # Errors
    /// Returns an error if no such motion exists, or if it could not be found or resolved.
    pub fn solve(&self, accuracy: f64) -> Result<SteadyMotion> {
        let mut solver = AnySolver::default();
        let metrics = solver.solve(self, accuracy)?;
        solver.steady_motion(metrics)
    }

    /// Samples one cycle of the motion that [`AnyProblem::solve`] finds at `samples + 1` equally spaced times, the first
    /// at phase 0.
    ///
    /// # Errors
    /// Returns an error as [`AnyProblem::solve`] does.
    pub fn cycle(&self, accuracy: f64, samples: usize) -> Result<Vec<AnySample>> {
        let mut solver = AnySolver::default();
        solver.solve(self, accuracy)?;
        solver.cycle(samples)
    }

    /// Returns the result of [`AnyProblem::settle`], and one cycle of this motion as [`AnyProblem::cycle`] samples it.
    ///
    /// # Errors
    /// Returns an error as [`AnyProblem::settle`] does.
    pub fn settled_cycle(
        &self,
        accuracy: f64,
        samples: usize,
    ) -> Result<(Attractor, Vec<AnySample>)> {
        let mut solver = AnySolver::default();
        let first = solver.solve(self, accuracy);
        let attractor = solver.attractor(self, first, accuracy)?;
        Ok((attractor, solver.cycle(samples)?))
    }

    /// Returns samples of the first `cycles` cycles from rest at phase 0: `samples` per cycle and one at the end.
    ///
    /// # Errors
    /// Returns an error if no motion exists or if it cannot be integrated.
    pub fn cycles_from_rest(&self, cycles: usize, samples: usize) -> Result<Vec<AnySample>> {
        match self.kind() {
            Kind::ThreeLinks(problem) => {
                Ok(of_three_links(problem.cycles_from_rest(cycles, samples)?))
            }
            Kind::Chain(problem) => {
                Ok(of_chain(problem.cycles_from_rest(cycles, samples)?, &problem.chain))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use trilink_robot::{Gait, Laws, Robot};

    use super::*;
    use crate::FIT_ACCURACY;

    /// Asserts that samples agree to 1e-4 in SI units.
    fn assert_alike(found: &[AnySample], known: &[AnySample]) {
        assert_eq!(found.len(), known.len());
        for (found, known) in found.iter().zip(known) {
            let pairs = [
                (&found.phi_rad, &known.phi_rad),
                (&found.roll_m_s, &known.roll_m_s),
                (&found.skid_m_s, &known.skid_m_s),
                (&found.lateral_n, &known.lateral_n),
                (&found.roll_n, &known.roll_n),
                (&found.torque_nm, &known.torque_nm),
                (&found.pose_rates.to_vec(), &known.pose_rates.to_vec()),
                (&vec![found.power_w, found.loss_w], &vec![known.power_w, known.loss_w]),
            ];
            for (nth, (found, known)) in pairs.into_iter().enumerate() {
                assert_eq!(found.len(), known.len());
                for (found, known) in found.iter().zip(known) {
                    assert!((found - known).abs() < 1e-4, "{nth}: {found} {known}");
                }
            }
            assert!((found.pose.x_m - known.pose.x_m).abs() < 1e-6);
        }
    }

    #[test]
    fn a_chain_of_three_links_has_the_samples_of_a_robot_of_three_links() {
        let (robot, gait) = (Robot::semi_passive(), Gait::passive_symmetric());
        let problem = AnyProblem {
            robot: robot.clone().into(),
            gait: gait.into(),
            laws: Laws::SKID_ROLL,
            omega_rad_s: 3.0,
        };
        let chain = AnyProblem { robot: robot.chain(&gait).into(), ..problem.clone() };
        let both = [&chain, &problem];
        let [found, known] = both.map(|of| of.cycle(1e-9, 24).unwrap());
        assert_alike(&found, &known);
        let [found, known] = both.map(|of| of.cycles_from_rest(2, 24).unwrap());
        assert_alike(&found, &known);
        let [(found, found_cycle), (known, known_cycle)] =
            both.map(|of| of.settled_cycle(1e-9, 24).unwrap());
        assert_alike(&found_cycle, &known_cycle);
        assert_eq!(
            (found.cycles, found.is_found_by_solve),
            (known.cycles, known.is_found_by_solve)
        );
        let [found, known] = both.map(|of| of.solve(FIT_ACCURACY).unwrap());
        assert!((found.work_j - known.work_j).abs() < 1e-5 * known.work_j);
        assert_eq!(found.status(), known.status());
    }
}
