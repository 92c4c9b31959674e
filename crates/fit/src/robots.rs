//! Robots of the campaigns to which a model is fitted.

use trilink_robot::metrics::Metric;
use trilink_robot::{AnyRobot, Parameter};

use super::input::FreeParameter;
use super::{FitData, FitInput};

/// Robot of each campaign to which a model is fitted, indexed by [`Measurement::campaign`](super::Measurement::campaign).
/// Campaigns of one robot differ in the commands of its elastic joints, torques and rotors.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Robots(Vec<AnyRobot>);

impl From<AnyRobot> for Robots {
    fn from(robot: AnyRobot) -> Self {
        Self(vec![robot])
    }
}

impl FromIterator<AnyRobot> for Robots {
    fn from_iter<I: IntoIterator<Item = AnyRobot>>(robots: I) -> Self {
        Self(robots.into_iter().collect())
    }
}

impl Robots {
    /// Returns the robot of the first campaign, the only one unless several are fitted together.
    pub(crate) fn first(&self) -> &AnyRobot {
        self.of(0)
    }

    pub(crate) fn of(&self, campaign: usize) -> &AnyRobot {
        &self.0[campaign]
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// Returns the value of a parameter; NaN if the robot does not have it.
    pub(crate) fn value(&self, parameter: Parameter) -> f64 {
        self.first().value(parameter)
    }

    /// Returns the robots with the free parameters set to `values`.
    pub(crate) fn with_values(&self, free: &[FreeParameter], values: &[f64]) -> Self {
        let mut robots = self.clone();
        for (free, value) in free.iter().zip(values) {
            robots.0.iter_mut().for_each(|robot| robot.set(free.parameter, *value));
        }
        robots
    }

    pub(crate) fn has_metric(&self, metric: Metric) -> bool {
        self.0.iter().any(|robot| robot.has_metric(metric))
    }

    /// Returns, for each independent error of the robots' parameters, the robots with the parameters that have this error
    /// increased by their standard deviations: those of all campaigns of one robot. `inputs` are those of the campaigns.
    pub(crate) fn perturbed(&self, inputs: &[FitInput], data: &FitData) -> Vec<Self> {
        let campaigns = 0..self.len();
        let is_same = |a: usize, b: usize| inputs[a].robot.name == inputs[b].robot.name;
        let firsts = campaigns.clone().filter(|first| (0..*first).all(|of| !is_same(of, *first)));
        let perturbed = firsts.flat_map(|first| {
            let own: Vec<usize> = campaigns.clone().filter(|of| is_same(*of, first)).collect();
            let of_each: Vec<Vec<AnyRobot>> = own
                .iter()
                .map(|campaign| inputs[first].perturbed_robots(self.of(*campaign), data))
                .collect();
            let with_error = |error: usize| {
                let mut robots = self.clone();
                for (campaign, perturbed) in own.iter().zip(&of_each) {
                    robots.0[*campaign] = perturbed[error].clone();
                }
                robots
            };
            (0..of_each[0].len()).map(with_error).collect::<Vec<_>>()
        });
        perturbed.collect()
    }
}
