//! The table of a robot's quantities: what each is called, measured in and used by. Keys of the
//! configuration, columns of tables, labels and symbols follow from it.

use trilink_base::named;

use super::{Gait, Laws, Parameter, Robot, SkidLaw};

named! {
    /// A quantity of a robot, by its key in the configuration; in the order of the tables.
    pub enum Quantity {
        /// Half the length of the middle link.
        H = "h_m",
        /// Distance of a side link's wheel from its joint.
        L = "l_m",
        /// Distance of a side link's centre of mass from its joint.
        B = "b_m",
        /// Mass of a link.
        Mass = "mass_kg",
        /// Moment of inertia of a link about its centre of mass.
        Inertia = "inertia_kg_m2",
        /// Viscous resistance to skidding (eq. 15).
        Skid = "skid_kg_s",
        /// Viscous resistance to rolling (eq. 14).
        Roll = "roll_kg_s",
        /// Dry friction across a wheel.
        SkidDry = "skid_dry_n",
        /// Dry friction across a wheel at low speeds.
        SkidStatic = "skid_static_n",
        /// Stribeck speed: at it 1/e of the excess of static over dry friction is left.
        Stribeck = "stribeck_m_s",
        /// Resistance to skidding by a power of the velocity: the force of the power law at the transition speed.
        SkidPower = "skid_power_n",
        /// The exponent of that.
        SkidExponent = "skid_exponent",
        /// Dry friction along a wheel.
        RollDry = "roll_dry_n",
        /// Speed within which dry friction changes its sign.
        Transition = "transition_m_s",
        /// Stiffness of the passive joint (eq. 11).
        Stiffness = "stiffness_nm_rad",
        /// Damping of the passive joint (eq. 11).
        Damping = "damping_nm_s_rad",
        /// Angle at which the passive joint's spring is unloaded (eq. 11).
        RestAngle = "rest_angle_deg",
    }
}

/// What a quantity has one number each for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Per {
    Robot,
    Link,
    Wheel,
}

named! {
    /// The unit of a quantity, as keys and columns end.
    pub enum Unit {
        Metre = "m",
        Kilogram = "kg",
        KilogramSquareMetre = "kg_m2",
        KilogramPerSecond = "kg_s",
        Newton = "n",
        MetrePerSecond = "m_s",
        NewtonMetrePerRadian = "nm_rad",
        NewtonMetreSecondPerRadian = "nm_s_rad",
        Degree = "deg",
        /// A ratio.
        One = "",
    }
}

impl Unit {
    /// As people write it.
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Kilogram => "kg",
            Self::KilogramSquareMetre => "kg m\u{b2}",
            Self::KilogramPerSecond => "kg/s",
            Self::Newton => "N",
            Self::MetrePerSecond => "m/s",
            Self::NewtonMetrePerRadian => "N m/rad",
            Self::NewtonMetreSecondPerRadian => "N m s/rad",
            Self::Degree => "\u{b0}",
            Self::One => "",
        }
    }

    /// The unit in SI units.
    pub fn in_si(self) -> f64 {
        if self == Self::Degree { 1_f64.to_radians() } else { 1.0 }
    }
}

/// A row of the table of quantities.
#[derive(Debug, Clone, Copy)]
pub struct Definition {
    pub unit: Unit,
    pub per: Per,
    /// Name on a figure's axis.
    pub label: &'static str,
    /// What a column of it holds; empty where no fit frees it.
    pub meaning: &'static str,
    /// Symbol in LaTeX, without the index of a wheel or link.
    pub latex: &'static str,
    /// Label of the sum over the wheels, where fits can free that in place of each wheel's: distances and
    /// speeds hardly tell more. The wheels' proportions stay.
    pub sum_label: Option<&'static str>,
    /// Least and greatest value, in its unit.
    pub range: [f64; 2],
    /// Value in robots that do not give it, in its unit; `None` where they must.
    pub default: Option<f64>,
    /// Whether its standard deviation can be given.
    pub has_deviation: bool,
    /// Whether a fit can free it.
    pub is_fitted: bool,
    /// Whether fits free it where neither campaign nor model says what is free.
    pub is_free_by_default: bool,
    /// Whether 0 switches off what it stands for; laws that do not use it set it to 0.
    pub is_resistance: bool,
    /// Whether the motion of a robot with these laws and this gait depends on it.
    pub matters: fn(Laws, &Gait) -> bool,
    field: Field,
}

/// Where a robot has the numbers of a quantity.
#[derive(Debug, Clone, Copy)]
struct Field {
    of: fn(&Robot) -> &[f64],
    of_mut: fn(&mut Robot) -> &mut [f64],
}

macro_rules! field {
    ($name:ident) => {
        Field { of: |robot| robot.$name.as_slice(), of_mut: |robot| robot.$name.as_mut_slice() }
    };
}

/// One number, or several.
trait Numbers {
    fn as_slice(&self) -> &[f64];
    fn as_mut_slice(&mut self) -> &mut [f64];
}

impl Numbers for f64 {
    fn as_slice(&self) -> &[f64] {
        std::slice::from_ref(self)
    }

    fn as_mut_slice(&mut self) -> &mut [f64] {
        std::slice::from_mut(self)
    }
}

/// What most rows of the robot's body have alike.
const BODY: Definition = Definition {
    unit: Unit::Metre,
    per: Per::Robot,
    label: "",
    meaning: "",
    latex: "",
    sum_label: None,
    range: [1e-3, 100.0],
    default: None,
    has_deviation: true,
    is_fitted: false,
    is_free_by_default: false,
    is_resistance: false,
    matters: |_, _| true,
    field: Field { of: |_| &[], of_mut: |_| &mut [] },
};
/// What most rows of friction have alike.
const FRICTION: Definition = Definition {
    unit: Unit::Newton,
    per: Per::Wheel,
    range: [0.0, 1e6],
    default: Some(0.0),
    is_fitted: true,
    is_resistance: true,
    ..BODY
};
/// What most rows of the passive joint have alike.
const JOINT: Definition = Definition {
    per: Per::Robot,
    is_resistance: false,
    matters: |_, gait| gait.passive_joint().is_some(),
    ..FRICTION
};

impl Quantity {
    /// Its row of the table.
    #[inline]
    pub const fn definition(self) -> &'static Definition {
        const TABLE: &[Definition; Quantity::ALL.len()] = &{
            let (mut table, mut i) = ([BODY; Quantity::ALL.len()], 0);
            while i < table.len() {
                table[i] = Quantity::ALL[i].row();
                i += 1;
            }
            table
        };
        &TABLE[self as usize]
    }

    const fn row(self) -> Definition {
        match self {
            Self::H => Definition {
                label: "Half length of the middle link",
                latex: "h",
                field: field!(h_m),
                ..BODY
            },
            Self::L => {
                Definition { label: "Joint to wheel", latex: "l", field: field!(l_m), ..BODY }
            }
            Self::B => Definition {
                label: "Joint to centre of mass",
                latex: "b",
                field: field!(b_m),
                ..BODY
            },
            Self::Mass => Definition {
                unit: Unit::Kilogram,
                per: Per::Link,
                label: "Mass",
                latex: "m",
                range: [1e-6, 1e5],
                field: field!(mass_kg),
                ..BODY
            },
            Self::Inertia => Definition {
                unit: Unit::KilogramSquareMetre,
                per: Per::Link,
                label: "Moment of inertia",
                latex: "J",
                range: [1e-9, 1e6],
                field: field!(inertia_kg_m2),
                ..BODY
            },
            Self::Skid => Definition {
                unit: Unit::KilogramPerSecond,
                label: "Skid",
                meaning: "skid resistance c^S of the wheel (eq. 15)",
                latex: "c^S",
                default: None,
                has_deviation: false,
                is_free_by_default: true,
                matters: |laws, _| laws.skid.is_viscous(),
                field: field!(skid_kg_s),
                ..FRICTION
            },
            Self::Roll => Definition {
                unit: Unit::KilogramPerSecond,
                label: "Roll",
                meaning: "roll resistance c^R of the wheel (eq. 14)",
                latex: "c^R",
                sum_label: Some("Sum of roll"),
                default: None,
                matters: |laws, _| laws.roll.is_viscous(),
                field: field!(roll_kg_s),
                ..FRICTION
            },
            Self::SkidDry => Definition {
                label: "Dry skid",
                meaning: "dry friction of the wheel across it",
                latex: "F^S",
                is_free_by_default: true,
                matters: |laws, _| laws.skid.is_dry(),
                field: field!(skid_dry_n),
                ..FRICTION
            },
            Self::SkidStatic => Definition {
                label: "Static skid",
                meaning: "dry friction of the wheel across it at low speeds, where it is larger (Stribeck)",
                latex: "F^s",
                matters: |laws, _| laws.skid.has_static(),
                field: field!(skid_static_n),
                ..FRICTION
            },
            Self::Stribeck => Definition {
                unit: Unit::MetrePerSecond,
                per: Per::Robot,
                label: "Stribeck speed",
                meaning: "speed v_s over which static friction falls to dry friction; at it 1/e of the excess is left",
                latex: "v_s",
                range: [1e-6, 100.0],
                matters: |laws, _| laws.skid.has_static(),
                field: field!(stribeck_m_s),
                ..FRICTION
            },
            Self::SkidPower => Definition {
                label: "Power-law skid",
                meaning: "resistance F_p to skidding by a power of the velocity, at the transition speed",
                latex: "F^p",
                is_free_by_default: true,
                matters: |laws, _| laws.skid == SkidLaw::Power,
                field: field!(skid_power_n),
                ..FRICTION
            },
            Self::SkidExponent => Definition {
                unit: Unit::One,
                label: "Exponent of skid",
                meaning: "exponent p of the power law of skidding",
                latex: "p",
                range: [0.05, 4.0],
                default: Some(1.0),
                is_free_by_default: true,
                is_resistance: false,
                matters: |laws, _| laws.skid == SkidLaw::Power,
                field: field!(skid_exponent),
                ..FRICTION
            },
            Self::RollDry => Definition {
                label: "Dry roll",
                meaning: "dry friction of the wheel along it",
                latex: "F^R",
                sum_label: Some("Sum of dry roll"),
                matters: |laws, _| laws.roll.is_dry(),
                field: field!(roll_dry_n),
                ..FRICTION
            },
            Self::Transition => Definition {
                unit: Unit::MetrePerSecond,
                per: Per::Robot,
                label: "Transition speed",
                meaning: "speed v_t within which dry friction changes its sign",
                latex: "v_t",
                range: [1e-6, 100.0],
                default: Some(0.005),
                is_resistance: false,
                matters: |laws, _| !laws.are_linear(),
                field: field!(transition_m_s),
                ..FRICTION
            },
            Self::Stiffness => Definition {
                unit: Unit::NewtonMetrePerRadian,
                label: "Stiffness",
                meaning: "spring k_tau of the passive joint (eq. 11)",
                latex: "k_\\tau",
                field: field!(stiffness_nm_rad),
                ..JOINT
            },
            Self::Damping => Definition {
                unit: Unit::NewtonMetreSecondPerRadian,
                label: "Damping",
                meaning: "damper c_tau of the passive joint (eq. 11)",
                latex: "c_\\tau",
                field: field!(damping_nm_s_rad),
                ..JOINT
            },
            Self::RestAngle => Definition {
                unit: Unit::Degree,
                label: "Rest angle",
                latex: "\\phi_0",
                range: [-180.0, 180.0],
                has_deviation: false,
                is_fitted: false,
                field: field!(rest_angle_rad),
                ..JOINT
            },
        }
    }

    /// Its name without the unit.
    pub fn stem(self) -> &'static str {
        let end = self.definition().unit.name();
        self.name().strip_suffix(end).map_or(self.name(), |stem| stem.trim_end_matches('_'))
    }

    /// How many numbers a robot has of it.
    #[inline]
    pub const fn count(self) -> usize {
        match self.definition().per {
            Per::Robot => 1,
            Per::Link | Per::Wheel => Robot::LINKS,
        }
    }

    /// Its numbers in a robot, in SI units.
    pub fn numbers(self, robot: &Robot) -> &[f64] {
        (self.definition().field.of)(robot)
    }

    /// Its numbers in a robot, in SI units.
    pub fn numbers_mut(self, robot: &mut Robot) -> &mut [f64] {
        (self.definition().field.of_mut)(robot)
    }

    /// Each wheel's part of the sum over the wheels; equal parts where that is zero.
    pub fn shares(self, robot: &Robot) -> [f64; Robot::LINKS] {
        let numbers = self.numbers(robot);
        let sum: f64 = numbers.iter().sum();
        let equal = 1.0 / Robot::LINKS as f64;
        std::array::from_fn(|i| if sum > 0.0 { numbers[i] / sum } else { equal })
    }

    /// The number of a quantity that has one for all of the robot.
    ///
    /// # Panics
    /// It has one a link or wheel.
    pub const fn one(self) -> Parameter {
        assert!(self.count() == 1, "has one a link or wheel");
        Parameter::new(self, 0)
    }

    /// The number of a wheel or link.
    pub const fn of(self, wheel_or_link: usize) -> Parameter {
        Parameter::new(self, wheel_or_link)
    }

    /// The numbers of all wheels or links.
    pub const fn of_each(self) -> [Parameter; Robot::LINKS] {
        [self.of(0), self.of(1), self.of(2)]
    }

    /// Their sum.
    ///
    /// # Panics
    /// A fit cannot free it.
    pub const fn sum(self) -> Parameter {
        assert!(self.definition().sum_label.is_some(), "has no sum");
        Parameter::new(self, Robot::LINKS)
    }

    /// All its numbers, and their sum where fits can free that.
    pub fn parameters(self) -> impl Iterator<Item = Parameter> {
        let sums = usize::from(self.definition().sum_label.is_some());
        (0..self.count() + sums).map(move |place| Parameter::new(self, place))
    }
}
