//! Robots of the campaigns to which a model is fitted.

use trilink_robot::metrics::Metric;
use trilink_robot::{AnyGait, AnyRobot, Laws, Parameter};
use trilink_tables::config::GroupNumbers;

use super::input::FreeParameter;
use super::{FitData, FitInput};

/// Robot of each campaign to which a model is fitted, indexed by [`Measurement::campaign`](super::Measurement::campaign).
/// Campaigns of one robot differ in the commands of its elastic joints, torques and rotors. Parameters have the numbers
/// that they have in the fit.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Robots(Vec<CampaignRobot>);

#[derive(Debug, Clone, PartialEq)]
struct CampaignRobot {
    robot: AnyRobot,
    numbers: GroupNumbers,
}

impl From<AnyRobot> for Robots {
    fn from(robot: AnyRobot) -> Self {
        let numbers = GroupNumbers::of_single_robot();
        [(robot, numbers)].into_iter().collect()
    }
}

impl FromIterator<(AnyRobot, GroupNumbers)> for Robots {
    fn from_iter<I: IntoIterator<Item = (AnyRobot, GroupNumbers)>>(robots: I) -> Self {
        let robots = robots.into_iter();
        Self(robots.map(|(robot, numbers)| CampaignRobot { robot, numbers }).collect())
    }
}

impl Robots {
    /// Returns the robot of the first campaign, the only one unless several are fitted together.
    pub(crate) fn first(&self) -> &AnyRobot {
        self.of(0)
    }

    pub(crate) fn of(&self, campaign: usize) -> &AnyRobot {
        &self.0[campaign].robot
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// Returns the parameter of a campaign's robot that a parameter of the fit is; `None` if the robot does not have it.
    pub(crate) fn own(&self, campaign: usize, parameter: Parameter) -> Option<Parameter> {
        Some(self.0[campaign].numbers.own(parameter)?.0)
    }

    /// Returns the value of a parameter; NaN if no robot has it.
    pub(crate) fn value(&self, parameter: Parameter) -> f64 {
        let mut robots = self.0.iter();
        let value = robots.find_map(|CampaignRobot { robot, numbers }| {
            let (own, ratio) = numbers.own(parameter)?;
            Some(robot.value(own) / ratio)
        });
        value.unwrap_or(f64::NAN)
    }

    /// Returns the robots with the free parameters set to `values`.
    pub(crate) fn with_values(&self, free: &[FreeParameter], values: &[f64]) -> Self {
        let mut robots = self.clone();
        for CampaignRobot { robot, numbers } in &mut robots.0 {
            for (free, value) in free.iter().zip(values) {
                if let Some((own, ratio)) = numbers.own(free.parameter) {
                    robot.set(own, ratio * value);
                }
            }
        }
        robots
    }

    /// Returns whether the motion of a campaign's robot with the given gait depends on a parameter.
    pub(crate) fn depends_on(
        &self,
        campaign: usize,
        parameter: Parameter,
        laws: Laws,
        gait: &AnyGait,
    ) -> bool {
        let own = self.own(campaign, parameter);
        own.is_some_and(|own| self.of(campaign).depends_on(own, laws, gait))
    }

    pub(crate) fn has_metric(&self, metric: Metric) -> bool {
        self.0.iter().any(|of| of.robot.has_metric(metric))
    }

    /// Returns, for each independent error of the robots' parameters, the robots with the parameters that have this error
    /// increased by their standard deviations: those of all campaigns of one robot. `inputs` are those of the campaigns.
    pub(crate) fn perturbed(&self, inputs: &[FitInput], data: &FitData) -> Vec<Self> {
        let campaigns = 0..self.len();
        let is_same = |a: usize, b: usize| inputs[a].robot.name == inputs[b].robot.name;
        let firsts = campaigns.clone().filter(|first| (0..*first).all(|of| !is_same(of, *first)));
        let perturbed = firsts.flat_map(|first| {
            let own: Vec<usize> = campaigns.clone().filter(|of| is_same(*of, first)).collect();
            // Which errors matter depends on the gait: the stiffness of a joint that another campaign drives does not.
            let with_errors_of = |input: &usize| -> Vec<Vec<AnyRobot>> {
                let robots = own.iter().map(|campaign| self.of(*campaign));
                robots.map(|robot| inputs[*input].perturbed_robots(robot, data)).collect()
            };
            let of_inputs = own.iter().map(with_errors_of);
            let of_each = of_inputs.max_by_key(|of_each| of_each[0].len()).unwrap_or_default();
            let with_error = |error: usize| {
                let mut robots = self.clone();
                for (campaign, perturbed) in own.iter().zip(&of_each) {
                    robots.0[*campaign].robot = perturbed[error].clone();
                }
                robots
            };
            (0..of_each.first().map_or(0, Vec::len)).map(with_error).collect::<Vec<_>>()
        });
        perturbed.collect()
    }
}
