//! Robots of two to eight links: a planar chain with joints of several kinds, and wheels where they are.
//!
//! Links are listed from front to rear, and joint `j` connects links `j` and `j + 1`. Its angle is the heading of link
//! `j + 1` minus that of link `j`, as for both joints of the paper's robot. Places along a link are measured from the
//! link's origin, positive ahead.

use std::fmt;

use serde::Serialize;
use trilink_base::named;

use super::{Gait, JointCommand, Laws, Pose, Robot, SkidLaw};

/// Maximum number of links of a chain.
pub const MAX_LINKS: usize = 8;
/// Maximum number of joints of a chain.
pub const MAX_JOINTS: usize = MAX_LINKS - 1;

/// Robot whose links form a planar chain, with the commands of its joints and rotors.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Chain {
    /// Links from front to rear; two to [`MAX_LINKS`].
    pub links: Vec<Link>,
    /// Joints from front to rear, one fewer than links.
    pub joints: Vec<Joint>,
    /// Index of the reference link: displacement, heading and velocities of the robot are those of its origin.
    pub reference: usize,
    /// Length that normalises skid velocities (eq. 20 of the paper), m; see [`Chain::outer_length_m`].
    pub skid_length_m: f64,
}

/// Link of a chain.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Link {
    pub name: String,
    /// Distance from the origin forwards to the joint with the link ahead, m; unused in the first link.
    pub front_joint_m: f64,
    /// Distance from the origin backwards to the joint with the link behind, m; unused in the last link.
    pub rear_joint_m: f64,
    /// Place of the centre of mass, m.
    pub com_m: f64,
    /// Mass, including that of a rotor, kg.
    pub mass_kg: f64,
    /// Moment of inertia about the centre of mass, without that of a rotor about its own axis, kg m^2.
    pub inertia_kg_m2: f64,
    /// Wheel, or `None` if the link has none.
    pub wheel: Option<Wheel>,
    pub drag: Drag,
    pub rotor: Option<Rotor>,
}

/// Wheel (or pair of wheels on one axle) of a link.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Wheel {
    /// Place along the link, m.
    pub place_m: f64,
    /// Angle of the rolling direction relative to the link, counterclockwise, rad.
    pub steer_rad: f64,
    pub friction: WheelFriction,
}

/// Friction coefficients of one wheel; see [`Friction`](super::Friction) for the laws.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WheelFriction {
    /// Viscous skid resistance (eq. 15 of the paper), kg/s.
    pub skid_kg_s: f64,
    /// Viscous rolling resistance (eq. 14 of the paper), kg/s.
    pub roll_kg_s: f64,
    /// Dry friction across the rolling direction, N.
    pub skid_dry_n: f64,
    /// Static friction across the rolling direction, N.
    pub skid_static_n: f64,
    /// Stribeck speed, m/s; zero if dry friction does not depend on speed.
    pub stribeck_m_s: f64,
    /// Power-law resistance to skidding at the transition speed, N.
    pub skid_power_n: f64,
    /// Exponent of the power-law resistance to skidding.
    pub skid_exponent: f64,
    /// Dry friction along the rolling direction, N.
    pub roll_dry_n: f64,
    /// Transition speed, over which dry friction changes its sign smoothly (regularisation), m/s.
    pub transition_m_s: f64,
}

/// Viscous drag on a link as a whole, at its centre of mass.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Drag {
    /// Drag coefficient along the link, kg/s.
    pub along_kg_s: f64,
    /// Drag coefficient across the link, kg/s.
    pub across_kg_s: f64,
    /// Drag coefficient of the link's rotation, N m s/rad.
    pub turning_nm_s_rad: f64,
}

/// Balanced rotor on a link, turned relative to it by a motor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rotor {
    /// Moment of inertia about the rotor's axis, kg m^2.
    pub inertia_kg_m2: f64,
    /// Angle of the rotor relative to its link.
    pub angle: JointCommand,
}

/// Joint between two links.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub enum Joint {
    /// Joint whose angle is prescribed.
    Driven(JointCommand),
    /// Joint whose angle follows from the motion.
    Free(FreeJoint),
}

impl Joint {
    /// Returns the command of the angle, or that of the angle at which the spring is relaxed.
    pub fn command(&self) -> &JointCommand {
        match self {
            Self::Driven(command) | Self::Free(FreeJoint { target: command, .. }) => command,
        }
    }

    /// Returns mutable access to [`Joint::command`].
    pub fn command_mut(&mut self) -> &mut JointCommand {
        match self {
            Self::Driven(command) | Self::Free(FreeJoint { target: command, .. }) => command,
        }
    }
}

/// Joint with the torque `-k (phi - target) - c phi' + torque`: on a spring if the target is constant, elastically
/// driven if it is a command.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct FreeJoint {
    /// Stiffness k, N m/rad.
    pub stiffness_nm_rad: f64,
    /// Damping c, N m s/rad.
    pub damping_nm_s_rad: f64,
    /// Angle at which the spring is relaxed.
    pub target: JointCommand,
    /// Prescribed torque, which tends to increase the angle.
    pub torque: TorqueCommand,
}

/// Torque `mean + amplitude cos(omega t + phase)`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct TorqueCommand {
    pub mean_nm: f64,
    pub amplitude_nm: f64,
    pub phase_rad: f64,
}

impl TorqueCommand {
    /// Returns the torque at a phase `omega t`, N m.
    pub fn at(&self, phase_rad: f64) -> f64 {
        self.mean_nm + self.amplitude_nm * (phase_rad + self.phase_rad).cos()
    }
}

/// Number in the description of a chain, with respect to which its motion can be differentiated. Links and joints are
/// given by their indices from front to rear.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ChainNumber {
    Link(usize, LinkNumber),
    /// Number of the command of a link's rotor.
    Rotor(usize, CommandNumber),
    Joint(usize, JointNumber),
    /// Number of the command of a joint, or of the angle at which its spring is relaxed.
    Command(usize, CommandNumber),
}

named! {
    /// Number of a [`Link`]. Its name is its key in the configuration (of the robot for the transition and Stribeck
    /// speeds), where angles are in degrees.
    pub enum LinkNumber {
        FrontJoint = "front_joint_m",
        RearJoint = "rear_joint_m",
        Com = "com_m",
        Mass = "mass_kg",
        Inertia = "inertia_kg_m2",
        DragAlong = "drag_along_kg_s",
        DragAcross = "drag_across_kg_s",
        DragTurning = "drag_turning_nm_s_rad",
        RotorInertia = "rotor_inertia_kg_m2",
        WheelPlace = "wheel_m",
        WheelSteer = "steer_deg",
        Skid = "skid_kg_s",
        Roll = "roll_kg_s",
        SkidDry = "skid_dry_n",
        SkidStatic = "skid_static_n",
        Stribeck = "stribeck_m_s",
        SkidPower = "skid_power_n",
        SkidExponent = "skid_exponent",
        RollDry = "roll_dry_n",
        Transition = "transition_m_s",
    }
}

named! {
    /// Number of a [`FreeJoint`]. Its name is like its key in the configuration, where angles are in degrees.
    pub enum JointNumber {
        Stiffness = "stiffness_nm_rad",
        Damping = "damping_nm_s_rad",
        TorqueMean = "mean_nm",
        TorqueAmplitude = "torque_nm",
        TorquePhase = "torque_phase_deg",
    }
}

named! {
    /// Number of a [`JointCommand`]. Its name is like its key in the configuration, where angles are in degrees; but
    /// the second harmonic is given by its components in phase and in quadrature.
    pub enum CommandNumber {
        Offset = "offset_deg",
        Amplitude = "amplitude_deg",
        Phase = "phase_deg",
        SecondInPhase = "second_in_phase_deg",
        SecondQuadrature = "second_quadrature_deg",
    }
}

impl CommandNumber {
    /// Returns access to the number; `None` if it belongs to a second harmonic that the command does not have.
    pub fn of(self, command: &mut JointCommand) -> Option<&mut f64> {
        let second = command.second.as_mut();
        Some(match self {
            Self::Offset => &mut command.offset_rad,
            Self::Amplitude => &mut command.amplitude_rad,
            Self::Phase => &mut command.phase_rad,
            Self::SecondInPhase => &mut second?.in_phase_rad,
            Self::SecondQuadrature => &mut second?.quadrature_rad,
        })
    }
}

impl LinkNumber {
    /// Returns whether a motion can depend on the number under the given laws.
    pub fn is_used(self, laws: Laws) -> bool {
        let Laws { skid, roll } = laws;
        match self {
            Self::Skid => skid.is_viscous(),
            Self::Roll => roll.is_viscous(),
            Self::SkidDry => skid.is_dry(),
            Self::SkidStatic | Self::Stribeck => skid.has_static(),
            Self::SkidPower | Self::SkidExponent => skid == SkidLaw::Power,
            Self::RollDry => roll.is_dry(),
            Self::Transition => skid.is_dry() || skid == SkidLaw::Power || roll.is_dry(),
            _ => true,
        }
    }

    /// Returns whether the number is one of the friction of a wheel.
    pub fn is_of_friction(self) -> bool {
        use LinkNumber::{
            Roll, RollDry, Skid, SkidDry, SkidExponent, SkidPower, SkidStatic, Stribeck, Transition,
        };
        matches!(
            self,
            Roll | RollDry
                | Skid
                | SkidDry
                | SkidExponent
                | SkidPower
                | SkidStatic
                | Stribeck
                | Transition
        )
    }

    fn of(self, link: &mut Link) -> Option<&mut f64> {
        let wheel = link.wheel.as_mut();
        Some(match self {
            Self::FrontJoint => &mut link.front_joint_m,
            Self::RearJoint => &mut link.rear_joint_m,
            Self::Com => &mut link.com_m,
            Self::Mass => &mut link.mass_kg,
            Self::Inertia => &mut link.inertia_kg_m2,
            Self::DragAlong => &mut link.drag.along_kg_s,
            Self::DragAcross => &mut link.drag.across_kg_s,
            Self::DragTurning => &mut link.drag.turning_nm_s_rad,
            Self::RotorInertia => &mut link.rotor.as_mut()?.inertia_kg_m2,
            Self::WheelPlace => &mut wheel?.place_m,
            Self::WheelSteer => &mut wheel?.steer_rad,
            Self::Skid => &mut wheel?.friction.skid_kg_s,
            Self::Roll => &mut wheel?.friction.roll_kg_s,
            Self::SkidDry => &mut wheel?.friction.skid_dry_n,
            Self::SkidStatic => &mut wheel?.friction.skid_static_n,
            Self::Stribeck => &mut wheel?.friction.stribeck_m_s,
            Self::SkidPower => &mut wheel?.friction.skid_power_n,
            Self::SkidExponent => &mut wheel?.friction.skid_exponent,
            Self::RollDry => &mut wheel?.friction.roll_dry_n,
            Self::Transition => &mut wheel?.friction.transition_m_s,
        })
    }
}

impl JointNumber {
    fn of(self, joint: &mut Joint) -> Option<&mut f64> {
        let Joint::Free(FreeJoint { stiffness_nm_rad, damping_nm_s_rad, torque, .. }) = joint
        else {
            return None;
        };
        Some(match self {
            Self::Stiffness => stiffness_nm_rad,
            Self::Damping => damping_nm_s_rad,
            Self::TorqueMean => &mut torque.mean_nm,
            Self::TorqueAmplitude => &mut torque.amplitude_nm,
            Self::TorquePhase => &mut torque.phase_rad,
        })
    }
}

impl ChainNumber {
    /// Returns the name of the number within its link, joint or command, with the unit in which it is shown.
    pub fn key(self) -> &'static str {
        match self {
            Self::Link(_, number) => number.name(),
            Self::Joint(_, number) => number.name(),
            Self::Rotor(_, number) | Self::Command(_, number) => number.name(),
        }
    }

    /// Returns the factor that converts a value in the unit of [`ChainNumber::key`] to the SI unit.
    pub fn in_si(self) -> f64 {
        if self.key().ends_with("_deg") { 1_f64.to_radians() } else { 1.0 }
    }

    /// Returns whether a change in the number breaks the half-period symmetry of a motion that has it, so that the
    /// effects in the two halves of the period are opposite.
    pub fn is_odd(self) -> bool {
        use CommandNumber::{Offset, SecondInPhase, SecondQuadrature};
        match self {
            Self::Link(_, LinkNumber::WheelSteer) | Self::Joint(_, JointNumber::TorqueMean) => true,
            Self::Command(_, number) | Self::Rotor(_, number) => {
                matches!(number, Offset | SecondInPhase | SecondQuadrature)
            }
            _ => false,
        }
    }

    /// Returns the exponent with which the number scales with frequency: if every number is multiplied by the ratio of
    /// two frequencies raised to its own exponent, the motion as a function of phase is the same at both.
    pub fn power_of_omega(self) -> i32 {
        use LinkNumber as L;
        match self {
            Self::Link(_, L::DragAlong | L::DragAcross | L::DragTurning | L::Skid | L::Roll)
            | Self::Link(_, L::Stribeck | L::Transition)
            | Self::Joint(_, JointNumber::Damping) => 1,
            Self::Link(_, L::SkidDry | L::SkidStatic | L::SkidPower | L::RollDry)
            | Self::Joint(
                _,
                JointNumber::Stiffness | JointNumber::TorqueMean | JointNumber::TorqueAmplitude,
            ) => 2,
            _ => 0,
        }
    }
}

/// Reason why a chain cannot be simulated.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ChainError {
    #[error("a chain has 2 to {MAX_LINKS} links, not {0}")]
    Links(usize),
    #[error("{links} links have {} joints, not {joints}", links - 1)]
    Joints { links: usize, joints: usize },
    #[error("there is no link {reference} (counted from 0) that could be the reference link")]
    Reference { reference: usize },
    #[error("the frequency must be a positive number, not {0} rad/s")]
    Frequency(String),
    #[error("the chain has no number `{0}` there")]
    NoNumber(&'static str),
    #[error("{name} must be a {}number, not {value}", kind.adjective())]
    Number { name: String, value: String, kind: NumberKind },
}

/// Numbers that a value of a chain may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NumberKind {
    Finite,
    NotNegative,
    Positive,
}

impl NumberKind {
    fn adjective(self) -> &'static str {
        match self {
            Self::Finite => "finite ",
            Self::NotNegative => "nonnegative ",
            Self::Positive => "positive ",
        }
    }
}

impl Chain {
    /// Checks that the numbers of links and joints agree and that every value has a physical meaning.
    ///
    /// # Errors
    /// Returns an error that names the first value that is wrong.
    pub fn check(&self) -> Result<(), ChainError> {
        use NumberKind::{Finite, NotNegative, Positive};
        let links = self.links.len();
        if !(2..=MAX_LINKS).contains(&links) {
            return Err(ChainError::Links(links));
        }
        if self.joints.len() != links - 1 {
            return Err(ChainError::Joints { links, joints: self.joints.len() });
        }
        if self.reference >= links {
            return Err(ChainError::Reference { reference: self.reference });
        }
        let check = |kind: NumberKind, value: f64, name: &dyn fmt::Display| {
            let is_right = value.is_finite()
                && match kind {
                    Finite => true,
                    NotNegative => value >= 0.0,
                    Positive => value > 0.0,
                };
            let error =
                || ChainError::Number { name: name.to_string(), value: value.to_string(), kind };
            is_right.then_some(()).ok_or_else(error)
        };
        check(Positive, self.skid_length_m, &"`skid_length_m`")?;
        for link in &self.links {
            let of = |kind, value, name: &str| {
                check(kind, value, &format_args!("`{name}` of link `{}`", link.name))
            };
            of(Finite, link.front_joint_m, "front_joint_m")?;
            of(Finite, link.rear_joint_m, "rear_joint_m")?;
            of(Finite, link.com_m, "com_m")?;
            of(Positive, link.mass_kg, "mass_kg")?;
            of(Positive, link.inertia_kg_m2, "inertia_kg_m2")?;
            of(NotNegative, link.drag.along_kg_s, "drag_along_kg_s")?;
            of(NotNegative, link.drag.across_kg_s, "drag_across_kg_s")?;
            of(NotNegative, link.drag.turning_nm_s_rad, "drag_turning_nm_s_rad")?;
            if let Some(Rotor { inertia_kg_m2, angle }) = link.rotor {
                of(Positive, inertia_kg_m2, "rotor_inertia_kg_m2")?;
                angle.to_array().into_iter().try_for_each(|number| of(Finite, number, "rotor"))?;
            }
            let Some(wheel) = link.wheel else { continue };
            of(Finite, wheel.place_m, "wheel_m")?;
            of(Finite, wheel.steer_rad, "steer")?;
            let friction = wheel.friction;
            of(NotNegative, friction.skid_kg_s, "skid_kg_s")?;
            of(NotNegative, friction.roll_kg_s, "roll_kg_s")?;
            of(NotNegative, friction.skid_dry_n, "skid_dry_n")?;
            of(NotNegative, friction.skid_static_n, "skid_static_n")?;
            of(NotNegative, friction.stribeck_m_s, "stribeck_m_s")?;
            of(NotNegative, friction.skid_power_n, "skid_power_n")?;
            of(Positive, friction.skid_exponent, "skid_exponent")?;
            of(NotNegative, friction.roll_dry_n, "roll_dry_n")?;
            of(Positive, friction.transition_m_s, "transition_m_s")?;
        }
        for (number, joint) in (1..).zip(&self.joints) {
            let of = |kind, value, name: &str| {
                check(kind, value, &format_args!("`{name}` of joint {number}"))
            };
            let command = match joint {
                Joint::Driven(command) => command,
                Joint::Free(FreeJoint { stiffness_nm_rad, damping_nm_s_rad, target, torque }) => {
                    of(NotNegative, *stiffness_nm_rad, "stiffness_nm_rad")?;
                    of(NotNegative, *damping_nm_s_rad, "damping_nm_s_rad")?;
                    let TorqueCommand { mean_nm, amplitude_nm, phase_rad } = *torque;
                    [mean_nm, amplitude_nm, phase_rad]
                        .into_iter()
                        .try_for_each(|number| of(Finite, number, "torque"))?;
                    target
                }
            };
            command.to_array().into_iter().try_for_each(|number| of(Finite, number, "angle"))?;
        }
        Ok(())
    }

    /// Returns the value of a number, in SI units; `None` if the chain does not have it.
    pub fn number(&self, number: ChainNumber) -> Option<f64> {
        match number {
            ChainNumber::Link(link, number) => {
                // A copy without the name, which would have to be allocated.
                let mut link = Link { name: String::new(), ..*self.links.get(link)? };
                number.of(&mut link).copied()
            }
            ChainNumber::Rotor(link, number) => {
                number.of(&mut self.links.get(link)?.rotor?.angle).copied()
            }
            ChainNumber::Joint(joint, number) => {
                number.of(&mut self.joints.get(joint)?.clone()).copied()
            }
            ChainNumber::Command(joint, number) => {
                number.of(&mut self.joints.get(joint)?.command().clone()).copied()
            }
        }
    }

    /// Returns access to a number, in SI units; `None` if the chain does not have it.
    pub fn number_mut(&mut self, number: ChainNumber) -> Option<&mut f64> {
        match number {
            ChainNumber::Link(link, number) => number.of(self.links.get_mut(link)?),
            ChainNumber::Rotor(link, number) => {
                number.of(&mut self.links.get_mut(link)?.rotor.as_mut()?.angle)
            }
            ChainNumber::Joint(joint, number) => number.of(self.joints.get_mut(joint)?),
            ChainNumber::Command(joint, number) => {
                number.of(self.joints.get_mut(joint)?.command_mut())
            }
        }
    }

    /// Returns all numbers of the chain: of its links, then of its joints.
    pub fn numbers(&self) -> Vec<ChainNumber> {
        let links = (0..self.links.len()).flat_map(|link| {
            let of_link = LinkNumber::ALL.map(|number| ChainNumber::Link(link, number));
            let of_rotor = CommandNumber::ALL.map(|number| ChainNumber::Rotor(link, number));
            of_link.into_iter().chain(of_rotor)
        });
        let joints = (0..self.joints.len()).flat_map(|joint| {
            let own = JointNumber::ALL.map(|number| ChainNumber::Joint(joint, number));
            let of_command = CommandNumber::ALL.map(|number| ChainNumber::Command(joint, number));
            own.into_iter().chain(of_command)
        });
        let mut chain = self.clone();
        links.chain(joints).filter(|number| chain.number_mut(*number).is_some()).collect()
    }

    /// Returns the name of a number: the name of its link, or `joint1` and so on, then the key in the configuration,
    /// such as `front.mass_kg`, `front.rotor.amplitude_deg` or `joint2.stiffness_nm_rad`.
    pub fn number_name(&self, number: ChainNumber) -> String {
        let key = number.key();
        match number {
            ChainNumber::Link(link, _) => format!("{}.{key}", self.links[link].name),
            ChainNumber::Rotor(link, _) => format!("{}.rotor.{key}", self.links[link].name),
            ChainNumber::Joint(joint, _) | ChainNumber::Command(joint, _) => {
                format!("joint{}.{key}", joint + 1)
            }
        }
    }

    /// Returns the indices of the links in the order in which their columns are numbered: the reference link is 0, and
    /// the others follow from front to rear. For the paper's robot: middle, front, rear.
    pub fn numbering(&self) -> Vec<usize> {
        (0..self.links.len()).filter_map(|number| self.link_numbered(number)).collect()
    }

    /// Returns the index of the link with a number (see [`Chain::numbering`]); `None` if there is none.
    pub fn link_numbered(&self, number: usize) -> Option<usize> {
        let link = match number {
            0 => self.reference,
            _ if number <= self.reference => number - 1,
            _ => number,
        };
        (number < self.links.len()).then_some(link)
    }

    /// Returns the names of the links by number (see [`Chain::numbering`]).
    pub fn names_by_number(&self) -> Vec<String> {
        self.numbering().into_iter().map(|link| self.links[link].name.clone()).collect()
    }

    /// Returns the poses of the links' origins from front to rear, given the pose of the reference link and the joint
    /// angles (rad).
    pub fn link_poses(&self, reference: Pose, phi_rad: &[f64]) -> Vec<Pose> {
        let mut poses = vec![reference; self.links.len()];
        for i in (0..self.reference).rev() {
            let joint = poses[i + 1].ahead(self.links[i + 1].front_joint_m);
            poses[i] = joint.turned(-phi_rad[i]).ahead(self.links[i].rear_joint_m);
        }
        for i in self.reference + 1..self.links.len() {
            let joint = poses[i - 1].ahead(-self.links[i - 1].rear_joint_m);
            poses[i] = joint.turned(phi_rad[i - 1]).ahead(-self.links[i].front_joint_m);
        }
        poses
    }

    /// Returns the mean distance of the first and of the last link's wheel (or, without a wheel, centre of mass) from
    /// that link's joint, m: the side link length l of the paper's robot, by which skid velocities are normalised.
    pub fn outer_length_m(links: &[Link]) -> f64 {
        let place_m = Self::outer_place_m;
        let front = links.first().map_or(0.0, |link| link.rear_joint_m + place_m(link));
        let rear = links.last().map_or(0.0, |link| link.front_joint_m - place_m(link));
        0.5 * (front.abs() + rear.abs())
    }

    /// Returns the place that stands for the end of the first or last link, m: that of its wheel or, without a wheel, of
    /// its centre of mass.
    pub fn outer_place_m(link: &Link) -> f64 {
        link.wheel.map_or(link.com_m, |wheel| wheel.place_m)
    }

    /// Returns the moment of inertia about a joint of all links that it separates from the reference link, kg m^2, with
    /// the other joints held at the angles `phi_rad` and the rotors at rest on their links.
    pub fn inertia_about_joint_kg_m2(&self, joint: usize, phi_rad: &[f64]) -> f64 {
        let poses = self.link_poses(Pose::default(), phi_rad);
        let pivot = poses[joint].ahead(-self.links[joint].rear_joint_m);
        let outer = if joint < self.reference { 0..joint + 1 } else { joint + 1..self.links.len() };
        let inertia = outer.map(|i| {
            let Link { com_m, mass_kg, inertia_kg_m2, rotor, .. } = &self.links[i];
            let com = poses[i].ahead(*com_m);
            let square_m2 = (com.x_m - pivot.x_m).powi(2) + (com.y_m - pivot.y_m).powi(2);
            let of_rotor = rotor.map_or(0.0, |rotor| rotor.inertia_kg_m2);
            inertia_kg_m2 + of_rotor + mass_kg * square_m2
        });
        inertia.sum()
    }

    /// Returns the angle of a joint before the motion begins, rad: that of its command at phase 0, or that at which its
    /// spring is then relaxed.
    pub fn rest_angle_rad(&self, joint: usize) -> f64 {
        self.joints[joint].command().derivative(0, 0.0)
    }

    /// Returns the mean angle of a joint's command, or of that at which its spring is relaxed, rad.
    pub fn mean_angle_rad(&self, joint: usize) -> f64 {
        self.joints[joint].command().offset_rad
    }

    /// Returns the chain with all joint commands at their means.
    #[must_use]
    pub fn at_mean_shape(&self) -> Self {
        let mut chain = self.clone();
        for command in chain.joints.iter_mut().map(Joint::command_mut) {
            *command = JointCommand::new(command.offset_rad, 0.0, 0.0);
        }
        chain
    }

    /// Returns whether anything drives the chain periodically: a joint's command, a torque, or a rotor.
    pub fn is_driven(&self) -> bool {
        let moves = |command: &JointCommand| command.half_range_rad() > 0.0;
        let of_joints = self.joints.iter().any(|joint| match joint {
            Joint::Driven(command) => moves(command),
            Joint::Free(FreeJoint { stiffness_nm_rad, target, torque, .. }) => {
                torque.amplitude_nm != 0.0 || *stiffness_nm_rad > 0.0 && moves(target)
            }
        });
        let of_rotors = self.links.iter().filter_map(|link| link.rotor.as_ref());
        of_joints || of_rotors.map(|rotor| &rotor.angle).any(moves)
    }

    /// Returns whether anything resists the chain's motion over the ground.
    pub fn is_resisted(&self) -> bool {
        self.links.iter().any(|link| {
            let Drag { along_kg_s, across_kg_s, turning_nm_s_rad } = link.drag;
            let of_wheel = link.wheel.is_some_and(|Wheel { friction, .. }| {
                let viscous = friction.skid_kg_s + friction.roll_kg_s;
                let dry = friction.skid_dry_n + friction.skid_static_n + friction.roll_dry_n;
                viscous + dry + friction.skid_power_n > 0.0
            });
            of_wheel || along_kg_s + across_kg_s + turning_nm_s_rad > 0.0
        })
    }

    /// Returns whether the equations have half-period symmetry: the mirror image of a motion, shifted by half a period,
    /// is also a motion.
    pub fn is_mirrored(&self) -> bool {
        let turns = |command: &JointCommand| {
            command.offset_rad == 0.0 && command.second() == super::SecondHarmonic::default()
        };
        let of_joints = self.joints.iter().all(|joint| match joint {
            Joint::Driven(command) => turns(command),
            Joint::Free(free) => turns(&free.target) && free.torque.mean_nm == 0.0,
        });
        let of_links = self.links.iter().all(|link| {
            let rolls_ahead = link.wheel.is_none_or(|wheel| wheel.steer_rad == 0.0);
            let second = link.rotor.map(|rotor| rotor.angle.second());
            rolls_ahead && second.is_none_or(|second| second == super::SecondHarmonic::default())
        });
        of_joints && of_links
    }

    /// Returns the number of wheels.
    pub fn wheels(&self) -> usize {
        self.links.iter().filter(|link| link.wheel.is_some()).count()
    }

    /// Returns the number of joints that are not driven.
    pub fn free_joints(&self) -> usize {
        self.joints.iter().filter(|joint| matches!(joint, Joint::Free(_))).count()
    }
}

impl WheelFriction {
    /// Returns the coefficients multiplied by a factor, except characteristic speeds and exponents.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self {
            skid_kg_s: factor * self.skid_kg_s,
            roll_kg_s: factor * self.roll_kg_s,
            skid_dry_n: factor * self.skid_dry_n,
            skid_static_n: factor * self.skid_static_n,
            skid_power_n: factor * self.skid_power_n,
            roll_dry_n: factor * self.roll_dry_n,
            ..self
        }
    }

    /// Returns the coefficients with those that the laws do not use set to zero.
    #[must_use]
    pub fn effective(self, laws: Laws) -> Self {
        let used = |number: LinkNumber, value: f64| if number.is_used(laws) { value } else { 0.0 };
        Self {
            skid_kg_s: used(LinkNumber::Skid, self.skid_kg_s),
            roll_kg_s: used(LinkNumber::Roll, self.roll_kg_s),
            skid_dry_n: used(LinkNumber::SkidDry, self.skid_dry_n),
            skid_static_n: used(LinkNumber::SkidStatic, self.skid_static_n),
            stribeck_m_s: used(LinkNumber::Stribeck, self.stribeck_m_s),
            skid_power_n: used(LinkNumber::SkidPower, self.skid_power_n),
            roll_dry_n: used(LinkNumber::RollDry, self.roll_dry_n),
            ..self
        }
    }
}

impl Robot {
    /// Returns the friction coefficients of wheel 0, 1 or 2.
    #[inline(always)]
    pub fn wheel_friction(&self, wheel: usize) -> WheelFriction {
        WheelFriction {
            skid_kg_s: self.skid_kg_s[wheel],
            roll_kg_s: self.roll_kg_s[wheel],
            skid_dry_n: self.skid_dry_n[wheel],
            skid_static_n: self.skid_static_n[wheel],
            stribeck_m_s: self.stribeck_m_s,
            skid_power_n: self.skid_power_n[wheel],
            skid_exponent: self.skid_exponent[wheel],
            roll_dry_n: self.roll_dry_n[wheel],
            transition_m_s: self.transition_m_s,
        }
    }

    /// Returns the robot as a chain of three links with the given gait.
    pub fn chain(&self, gait: &Gait) -> Chain {
        let link =
            |name: &str, number: usize, [front_joint_m, rear_joint_m, com_m]: [f64; 3]| Link {
                name: name.to_owned(),
                front_joint_m,
                rear_joint_m,
                com_m,
                mass_kg: self.mass_kg[number],
                inertia_kg_m2: self.inertia_kg_m2[number],
                wheel: Some(Wheel {
                    place_m: 0.0,
                    steer_rad: 0.0,
                    friction: self.wheel_friction(number),
                }),
                drag: Drag::default(),
                rotor: None,
            };
        let passive = FreeJoint {
            stiffness_nm_rad: self.stiffness_nm_rad,
            damping_nm_s_rad: self.damping_nm_s_rad,
            target: JointCommand::new(self.rest_angle_rad, 0.0, 0.0),
            torque: TorqueCommand::default(),
        };
        Chain {
            links: vec![
                link("front", 1, [0.0, self.l_m[0], self.b_m[0] - self.l_m[0]]),
                link("middle", 0, [self.h_m[0], self.h_m[1], 0.0]),
                link("rear", 2, [self.l_m[1], 0.0, self.l_m[1] - self.b_m[1]]),
            ],
            joints: gait
                .joints
                .map(|command| command.map_or(Joint::Free(passive), Joint::Driven))
                .to_vec(),
            reference: 1,
            skid_length_m: self.skid_length_m(),
        }
    }
}
