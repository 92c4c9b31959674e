//! Robots of any number of links behind one interface.

use super::metrics::Metric;
use super::{
    Chain, ChainNumber, CommandNumber, FreeJoint, Gait, Joint, JointCommand, JointNumber, Laws,
    Link, LinkNumber, MAX_JOINTS, Parameter, Per, Pose, Quantity, Robot, SecondHarmonic,
};

/// Robot of three links, or a chain of two to eight.
#[expect(
    clippy::large_enum_variant,
    reason = "a robot of three links is copied without allocation"
)]
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub enum AnyRobot {
    ThreeLinks(Robot),
    /// Chain, with the commands of its elastic joints, torques and rotors. The gait of a problem replaces the commands of
    /// its driven joints.
    Chain(Chain),
}

/// Commands of the driven joints, from front to rear.
pub type AnyGait = Gait<MAX_JOINTS>;

impl From<Robot> for AnyRobot {
    fn from(robot: Robot) -> Self {
        Self::ThreeLinks(robot)
    }
}

impl From<Chain> for AnyRobot {
    fn from(chain: Chain) -> Self {
        Self::Chain(chain)
    }
}

impl From<Gait> for AnyGait {
    fn from(gait: Gait) -> Self {
        let mut joints = [None; MAX_JOINTS];
        joints[..Robot::JOINTS].copy_from_slice(&gait.joints);
        Self { joints }
    }
}

impl From<AnyGait> for Gait {
    /// Returns the commands of the first two joints.
    fn from(gait: AnyGait) -> Self {
        Self { joints: [gait.joints[0], gait.joints[1]] }
    }
}

impl AnyRobot {
    /// Returns the robot of three links; `None` for a chain.
    pub fn three_links(&self) -> Option<&Robot> {
        match self {
            Self::ThreeLinks(robot) => Some(robot),
            Self::Chain(_) => None,
        }
    }

    /// Returns the chain; `None` for a robot of three links.
    pub fn chain(self) -> Option<Chain> {
        match self {
            Self::ThreeLinks(_) => None,
            Self::Chain(chain) => Some(chain),
        }
    }

    /// Returns the chain; `None` for a robot of three links.
    pub fn as_chain(&self) -> Option<&Chain> {
        match self {
            Self::ThreeLinks(_) => None,
            Self::Chain(chain) => Some(chain),
        }
    }

    /// Returns the robot as a chain with the given gait.
    pub fn to_chain(&self, gait: &AnyGait) -> Chain {
        match self {
            Self::ThreeLinks(robot) => robot.chain(&Gait::from(*gait)),
            Self::Chain(chain) => chain.with_gait(gait),
        }
    }

    /// Returns the number of joints.
    pub fn joints(&self) -> usize {
        match self {
            Self::ThreeLinks(_) => Robot::JOINTS,
            Self::Chain(chain) => chain.joints.len(),
        }
    }

    /// Returns whether the angle of a joint, given its index, follows from the motion if the robot has the given gait.
    pub fn is_free(&self, joint: usize, gait: &AnyGait) -> bool {
        match self {
            Self::ThreeLinks(_) => joint < Robot::JOINTS && gait.joints[joint].is_none(),
            Self::Chain(chain) => matches!(chain.joints.get(joint), Some(Joint::Free(_))),
        }
    }

    /// Returns whether the mirror image of each motion under a given gait is also a motion, under the mirrored gait.
    pub fn has_mirror_images(&self, gait: &AnyGait) -> bool {
        match self {
            Self::ThreeLinks(robot) => {
                Gait::from(*gait).passive_joint().is_none() || robot.rest_angle_rad == 0.0
            }
            Self::Chain(chain) => {
                let is_odd = |command: &JointCommand| command.second() == SecondHarmonic::default();
                let is_straight =
                    |link: &Link| link.wheel.is_none_or(|wheel| wheel.steer_rad == 0.0);
                let is_centred = |joint: &Joint| match joint {
                    Joint::Driven(_) => true,
                    Joint::Free(FreeJoint { target, torque, .. }) => {
                        target.offset_rad == 0.0 && is_odd(target) && torque.mean_nm == 0.0
                    }
                };
                chain.links.iter().all(is_straight) && chain.joints.iter().all(is_centred)
            }
        }
    }

    /// Returns the poses of the links by number and those of the joints from front to rear, given the pose of link 0 and
    /// the joint angles (rad). A joint has the heading of a link that it connects.
    pub fn poses(&self, reference: Pose, phi_rad: &[f64]) -> [Vec<Pose>; 2] {
        match self {
            Self::ThreeLinks(robot) => {
                let links = robot.link_poses(reference, [phi_rad[0], phi_rad[1]]);
                [links.into(), robot.joints(reference).into()]
            }
            Self::Chain(chain) => chain.poses(reference, phi_rad),
        }
    }

    /// Returns whether the robot has the wheel or joint to which a metric belongs. Of the joints of a robot of three
    /// links, only joint 1 has a metric.
    pub fn has_metric(&self, metric: Metric) -> bool {
        let Self::Chain(chain) = self else { return metric.is_of_three_links() };
        let number_in = |all: &[Metric]| all.iter().position(|one| *one == metric);
        match (number_in(&Metric::SIGMA), number_in(&Metric::ALPHA)) {
            (Some(wheel), _) => {
                let link = chain.link_numbered(wheel).map(|link| &chain.links[link]);
                link.is_some_and(|link| link.wheel.is_some())
            }
            (_, Some(joint)) => joint < chain.joints.len(),
            _ => true,
        }
    }

    /// Returns the value of a parameter, in SI units; NaN if the robot does not have it.
    pub fn value(&self, parameter: Parameter) -> f64 {
        match self {
            Self::ThreeLinks(robot) => parameter.value_in(robot),
            Self::Chain(chain) => chain.value(parameter),
        }
    }

    /// Sets the value of a parameter, in SI units, as [`Parameter::set`] does; ignored if the robot does not have it.
    pub fn set(&mut self, parameter: Parameter, value: f64) {
        match self {
            Self::ThreeLinks(robot) => parameter.set(robot, value),
            Self::Chain(chain) => chain.set(parameter, value),
        }
    }

    /// Returns the parameter that a quantity of a free joint is, given the index of the joint: the same for each joint of
    /// a robot of three links.
    pub fn of_free_joint(&self, quantity: Quantity, joint: usize) -> Parameter {
        match self {
            Self::ThreeLinks(_) => quantity.one(),
            Self::Chain(_) => quantity.parameter(joint + 1),
        }
    }

    /// Returns, for each parameter, the numbers of the robot as a chain ([`Robot::chain`]) with which it changes if the
    /// robot has the given gait, each with its change per unit of the parameter: for a sum over wheels its fraction of the
    /// sum. Empty if the robot does not have the parameter.
    pub fn shares_of(
        &self,
        parameters: &[Parameter],
        gait: &AnyGait,
    ) -> Vec<Vec<(ChainNumber, f64)>> {
        let of_each = |share: &dyn Fn(Parameter) -> Vec<(ChainNumber, f64)>| {
            parameters.iter().map(|parameter| share(*parameter)).collect()
        };
        match self {
            Self::ThreeLinks(robot) => {
                let gait = Gait::from(*gait);
                let chain = robot.chain(&gait);
                let passive = gait.passive_joint();
                of_each(&|parameter| Robot::shares_of(parameter, passive, &chain))
            }
            Self::Chain(chain) => of_each(&|parameter| chain.shares_of(parameter)),
        }
    }

    /// Returns the angle at which the spring of a free joint is relaxed on average, rad.
    pub fn rest_angle_rad(&self, joint: usize) -> f64 {
        match self {
            Self::ThreeLinks(robot) => robot.rest_angle_rad,
            Self::Chain(chain) => chain.mean_angle_rad(joint),
        }
    }

    /// Returns the mass, kg.
    pub fn mass_kg(&self) -> f64 {
        match self {
            Self::ThreeLinks(robot) => robot.mass_kg.iter().sum(),
            Self::Chain(chain) => chain.links.iter().map(|link| link.mass_kg).sum(),
        }
    }

    /// Returns the viscous rolling resistances of the wheels, kg/s, by link; NaN for a link without a wheel.
    pub fn roll_kg_s(&self) -> Vec<f64> {
        let wheels = 0..=self.joints();
        wheels.map(|wheel| self.value(Quantity::Roll.parameter(wheel))).collect()
    }

    /// Returns the moment of inertia about a joint, given its index, of all links that it separates from link 0, kg m^2.
    /// The other joints have the angles `phi_rad`.
    pub fn inertia_about_joint_kg_m2(&self, joint: usize, phi_rad: &[f64]) -> f64 {
        match self {
            Self::ThreeLinks(robot) => robot.inertia_about_joint_kg_m2(joint + 1),
            Self::Chain(chain) => chain.inertia_about_joint_kg_m2(joint, phi_rad),
        }
    }

    /// Returns whether, under the given laws, the motion of the robot with the given gait depends on a parameter; for a
    /// chain, whether it does with some gait.
    pub fn depends_on(&self, parameter: Parameter, laws: Laws, gait: &AnyGait) -> bool {
        match self {
            Self::ThreeLinks(_) => laws.is_relevant(parameter, &Gait::from(*gait)),
            Self::Chain(chain) => {
                laws.is_used(parameter.quantity()) && !chain.numbers_of(parameter).is_empty()
            }
        }
    }
}

impl Robot {
    /// Returns what [`AnyRobot::shares_of`] does, given the index of the passive joint and the robot as a chain.
    fn shares_of(
        parameter: Parameter,
        passive: Option<usize>,
        chain: &Chain,
    ) -> Vec<(ChainNumber, f64)> {
        const FRONT: usize = 0;
        const MIDDLE: usize = 1;
        const REAR: usize = 2;
        let of_joint = |joint: usize| match (parameter.quantity(), joint) {
            (Quantity::H, 1) => vec![(ChainNumber::Link(MIDDLE, LinkNumber::FrontJoint), 1.0)],
            (Quantity::H, _) => vec![(ChainNumber::Link(MIDDLE, LinkNumber::RearJoint), 1.0)],
            // A side link's origin is its wheel.
            (Quantity::L, 1) => vec![
                (ChainNumber::Link(FRONT, LinkNumber::RearJoint), 1.0),
                (ChainNumber::Link(FRONT, LinkNumber::Com), -1.0),
            ],
            (Quantity::L, _) => vec![
                (ChainNumber::Link(REAR, LinkNumber::FrontJoint), 1.0),
                (ChainNumber::Link(REAR, LinkNumber::Com), 1.0),
            ],
            (Quantity::B, 1) => vec![(ChainNumber::Link(FRONT, LinkNumber::Com), 1.0)],
            _ => vec![(ChainNumber::Link(REAR, LinkNumber::Com), -1.0)],
        };
        match (parameter.quantity().definition().per, parameter.number()) {
            (Per::Joint, Some(joint)) => of_joint(joint),
            (Per::Joint, None) => [of_joint(1), of_joint(2)].concat(),
            (Per::FreeJoint, None) => {
                let number = |joint| match parameter.quantity() {
                    Quantity::Stiffness => ChainNumber::Joint(joint, JointNumber::Stiffness),
                    Quantity::Damping => ChainNumber::Joint(joint, JointNumber::Damping),
                    _ => ChainNumber::Command(joint, CommandNumber::Offset),
                };
                passive.map(|joint| (number(joint), 1.0)).into_iter().collect()
            }
            _ => chain.shares_of(parameter),
        }
    }
}

impl Chain {
    /// Returns what [`AnyRobot::poses`] does.
    pub fn poses(&self, reference: Pose, phi_rad: &[f64]) -> [Vec<Pose>; 2] {
        let links = self.link_poses(reference, phi_rad);
        let pairs = links.iter().zip(&self.links).take(self.joints.len());
        let joints = pairs.map(|(pose, link)| pose.ahead(-link.rear_joint_m)).collect();
        [self.numbering().into_iter().map(|link| links[link]).collect(), joints]
    }

    /// Returns the numbers of the chain that a parameter comprises: one for a wheel, link or joint, and one for each
    /// wheel for a sum or for a characteristic speed. Empty if the chain does not have the parameter.
    pub fn numbers_of(&self, parameter: Parameter) -> Vec<ChainNumber> {
        let quantity = parameter.quantity();
        let of_link = LinkNumber::ALL.into_iter().find(|number| number.name() == quantity.name());
        let known = |numbers: Vec<ChainNumber>| -> Vec<ChainNumber> {
            numbers.into_iter().filter(|number| self.number(*number).is_some()).collect()
        };
        match (quantity.definition().per, of_link) {
            (Per::Wheel | Per::Link | Per::Robot, Some(number)) => {
                let links = match parameter.number() {
                    Some(i) => self.link_numbered(i).into_iter().collect(),
                    None => self.numbering(),
                };
                known(links.into_iter().map(|link| ChainNumber::Link(link, number)).collect())
            }
            (Per::FreeJoint, _) => {
                let own = match quantity {
                    Quantity::Stiffness => JointNumber::Stiffness,
                    Quantity::Damping => JointNumber::Damping,
                    _ => return Vec::new(),
                };
                let joint = parameter.number().map(|number| ChainNumber::Joint(number - 1, own));
                known(joint.into_iter().collect())
            }
            _ => Vec::new(),
        }
    }

    /// Returns the numbers that a parameter comprises, each with its factor per unit of the parameter: its fraction of a
    /// sum (equal fractions if the sum is zero), otherwise 1.
    pub fn shares_of(&self, parameter: Parameter) -> Vec<(ChainNumber, f64)> {
        let numbers = self.numbers_of(parameter);
        let (sum, count) = (self.value(parameter), numbers.len() as f64);
        let share = |number: ChainNumber| match (parameter.is_sum(), self.number(number)) {
            (true, Some(own)) if sum > 0.0 => own / sum,
            (true, _) => 1.0 / count,
            (false, _) => 1.0,
        };
        numbers.into_iter().map(|number| (number, share(number))).collect()
    }

    fn value(&self, parameter: Parameter) -> f64 {
        let numbers = self.numbers_of(parameter);
        let mut values = numbers.iter().filter_map(|number| self.number(*number));
        match values.next() {
            Some(first) if parameter.is_sum() => first + values.sum::<f64>(),
            first => first.unwrap_or(f64::NAN),
        }
    }

    /// Sets the value of a parameter, in SI units, as [`Parameter::set`] does; ignored if the chain does not have it.
    pub fn set(&mut self, parameter: Parameter, value: f64) {
        for (number, share) in self.shares_of(parameter) {
            if let Some(own) = self.number_mut(number) {
                *own = share * value;
            }
        }
    }

    /// Returns the commands of the driven joints.
    pub fn gait(&self) -> AnyGait {
        let mut joints = [None; MAX_JOINTS];
        for (own, joint) in joints.iter_mut().zip(&self.joints) {
            if let Joint::Driven(command) = joint {
                *own = Some(*command);
            }
        }
        AnyGait { joints }
    }

    /// Returns the chain with other commands of its driven joints.
    #[must_use]
    pub fn with_gait(&self, gait: &AnyGait) -> Self {
        let mut chain = self.clone();
        for (joint, command) in chain.joints.iter_mut().zip(gait.joints) {
            if let (Joint::Driven(own), Some(command)) = (joint, command) {
                *own = command;
            }
        }
        chain
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The paper's semi-passive robot as a chain: its links 1, 0 and 2 from front to rear.
    fn chain() -> Chain {
        Robot::semi_passive().chain(&Gait::passive_symmetric())
    }

    #[test]
    fn parameters_of_a_chain_are_numbered_like_those_of_three_links() {
        let (robot, chain) = (Robot::semi_passive(), AnyRobot::from(chain()));
        let gait = Gait::passive_symmetric();
        for parameter in Parameter::ALL {
            let of_chain = match parameter.quantity().definition().per {
                Per::FreeJoint => parameter.quantity().parameter(1),
                _ => parameter,
            };
            assert_eq!(parameter.value_in(&robot), chain.value(of_chain), "{parameter}");
            for laws in [Laws::NO_SKID, Laws::SKID_ROLL, Laws::COULOMB] {
                let depends =
                    AnyRobot::from(robot.clone()).depends_on(parameter, laws, &gait.into());
                assert_eq!(chain.depends_on(of_chain, laws, &gait.into()), depends, "{parameter}");
            }
        }
        assert!(chain.value(Quantity::Skid.parameter(3)).is_nan());
        assert!(chain.value(Quantity::Stiffness.parameter(2)).is_nan());
        assert!(chain.is_free(0, &gait.into()) && !chain.is_free(1, &gait.into()));
        let metrics = Metric::ALL.into_iter().filter(|metric| chain.has_metric(*metric));
        assert_eq!(
            metrics.map(Metric::name).collect::<Vec<_>>().join(" "),
            "d v sigma0 sigma1 sigma2 alpha1 alpha2 dtheta"
        );
    }

    #[test]
    fn setting_a_parameter_of_a_chain_changes_that_of_its_link_alone() {
        let mut robot = AnyRobot::from(chain());
        robot.set(Quantity::Skid.parameter(0), 7.0);
        robot.set(Quantity::Roll.sum(), 2.4);
        robot.set(Quantity::Stiffness.parameter(1), 0.3);
        robot.set(Quantity::Stiffness.parameter(2), 0.4);
        let AnyRobot::Chain(changed) = &robot else { panic!("a chain") };
        let of = |link: usize| changed.links[link].wheel.expect("a wheel").friction;
        assert_eq!([0, 1, 2].map(|link| of(link).skid_kg_s), [200.0, 7.0, 200.0]);
        assert_eq!([0, 1, 2].map(|link| of(link).roll_kg_s), [0.6, 1.2, 0.6]);
        let Joint::Free(spring) = changed.joints[0] else { panic!("free") };
        assert_eq!(spring.stiffness_nm_rad, 0.3);
        let command = JointCommand::new(0.1, 0.2, 0.3);
        let gait = AnyGait { joints: [Some(command); MAX_JOINTS] };
        assert_eq!(changed.with_gait(&gait).gait().joints[..2], [None, Some(command)]);
    }

    #[test]
    fn the_links_beyond_a_joint_swing_about_it_together() {
        let robot = Robot::semi_passive();
        let mut chain = chain();
        let of = |chain: &Chain, joint: usize, phi_rad: &[f64]| {
            AnyRobot::from(chain.clone()).inertia_about_joint_kg_m2(joint, phi_rad)
        };
        for joint in [0, 1] {
            let known = robot.inertia_about_joint_kg_m2(joint + 1);
            assert!((of(&chain, joint, &[0.4, -0.2]) - known).abs() < 1e-15);
        }
        // With the front link as reference, the middle and the rear link swing about joint 1, here at a right angle.
        chain.reference = 0;
        let [h_m, b_m] = [robot.h_m, robot.b_m];
        let square_m2 = (h_m[0] + h_m[1]).powi(2) + b_m[1].powi(2);
        let known = robot.inertia_kg_m2[0]
            + robot.mass_kg[0] * h_m[0].powi(2)
            + robot.inertia_kg_m2[2]
            + robot.mass_kg[2] * square_m2;
        let right_rad = std::f64::consts::FRAC_PI_2;
        assert!((of(&chain, 0, &[0.3, right_rad]) - known).abs() < 1e-12);
        let angle = JointCommand::new(0.0, 0.0, 0.0);
        chain.links[2].rotor = Some(crate::Rotor { inertia_kg_m2: 0.01, angle });
        assert!((of(&chain, 0, &[0.3, -right_rad]) - known - 0.01).abs() < 1e-12);
    }
}
