//! Table of the quantities that describe a robot, with their names, units and use. Configuration keys, table
//! columns, labels and symbols follow from this table.

use trilink_base::named;

use super::{Gait, Laws, MAX_LINKS, Parameter, Robot, SkidLaw};

named! {
    /// Physical quantity that describes a robot. Each variant is named by its key in the configuration; the
    /// order of the variants is that of the columns in tables.
    pub enum Quantity {
        /// Distance of the middle link's wheel from a joint.
        H = "h_m",
        /// Distance of a side link's wheel from its joint.
        L = "l_m",
        /// Distance of a side link's centre of mass from its joint.
        B = "b_m",
        /// Mass of a link.
        Mass = "mass_kg",
        /// Moment of inertia of a link about its centre of mass.
        Inertia = "inertia_kg_m2",
        /// Coefficient of a wheel's viscous resistance to skidding, kg/s (eq. 15 of the paper).
        Skid = "skid_kg_s",
        /// Coefficient of a wheel's viscous resistance to rolling, kg/s (eq. 14 of the paper).
        Roll = "roll_kg_s",
        /// Dry friction across a wheel's rolling direction.
        SkidDry = "skid_dry_n",
        /// Static friction: dry friction across a wheel's rolling direction at low speeds.
        SkidStatic = "skid_static_n",
        /// Stribeck speed, at which the excess of static over Coulomb friction has fallen to 1/e of its value at
        /// rest.
        Stribeck = "stribeck_m_s",
        /// Force `F_p` of the power law `F_p |v / v_t|^p` of resistance to skidding, N, where `v_t` is the
        /// transition speed.
        SkidPower = "skid_power_n",
        /// Exponent `p` of the power law `F_p |v / v_t|^p` of resistance to skidding.
        SkidExponent = "skid_exponent",
        /// Dry friction along a wheel's rolling direction.
        RollDry = "roll_dry_n",
        /// Transition speed: speed below which dry friction is regularised so that it changes sign smoothly.
        Transition = "transition_m_s",
        /// Stiffness of the passive joint's torsion spring (eq. 11 of the paper).
        Stiffness = "stiffness_nm_rad",
        /// Damping coefficient of the passive joint (eq. 11 of the paper).
        Damping = "damping_nm_s_rad",
        /// Angle of the passive joint at which its spring exerts no torque (eq. 11 of the paper).
        RestAngle = "rest_angle_deg",
    }
}

/// Kind of part of a robot, such as a wheel or a joint, that has its own value of a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Per {
    Robot,
    /// One value for each joint that is not driven; a robot of three links has at most one.
    FreeJoint,
    Link,
    Wheel,
    /// One value for each joint; the configuration may state a single value for both joints.
    Joint,
}

named! {
    /// Unit of a quantity. Each variant is named by the suffix, such as `kg_s`, that the unit has in keys and
    /// column names.
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
        /// Dimensionless ratio.
        One = "",
    }
}

impl Unit {
    /// Returns the symbol of the unit for display.
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

    /// Returns the factor that converts a value in this unit to the SI unit.
    pub fn in_si(self) -> f64 {
        if self == Self::Degree { 1_f64.to_radians() } else { 1.0 }
    }
}

/// Definition of a quantity: a row in the table of quantities.
#[derive(Debug, Clone, Copy)]
pub struct Definition {
    pub unit: Unit,
    pub per: Per,
    /// Label on the axis of a figure.
    pub label: &'static str,
    /// Description of a table column that contains the quantity; empty if the quantity cannot be free in a
    /// fit.
    pub meaning: &'static str,
    /// LaTeX symbol, without the index of a wheel, link or joint.
    pub latex: &'static str,
    /// Label of the sum of the quantity over the wheels; `None` if fits cannot estimate the sum in place of
    /// the wheels' values. Fits of the sum keep the proportions between the wheels fixed, because measured
    /// distances and speeds determine barely more than the sum.
    pub sum_label: Option<&'static str>,
    /// Minimum and maximum permitted value, in the quantity's unit.
    pub range: [f64; 2],
    /// Default value, in the quantity's unit; `None` if the configuration must specify the quantity.
    pub default: Option<f64>,
    /// Whether the configuration can specify a standard deviation for the quantity.
    pub has_deviation: bool,
    /// Whether the quantity can be free in a fit.
    pub is_fitted: bool,
    /// Whether the quantity is free in fits unless the campaign or the model lists the free parameters.
    pub is_free_by_default: bool,
    /// Whether zero means that the resistance to which the quantity belongs is absent. Friction laws that do
    /// not use the quantity set it to zero.
    pub is_resistance: bool,
    /// Function that returns whether the motion of a robot with the given friction laws and gait depends on
    /// the quantity.
    pub is_relevant: fn(Laws, &Gait) -> bool,
    field: Field,
}

/// Accessors to the values of a quantity in a [`Robot`].
#[derive(Debug, Clone, Copy)]
struct Field {
    get: fn(&Robot) -> &[f64],
    get_mut: fn(&mut Robot) -> &mut [f64],
}

macro_rules! field {
    ($name:ident) => {
        Field { get: |robot| robot.$name.as_slice(), get_mut: |robot| robot.$name.as_mut_slice() }
    };
}

/// View of a scalar or an array as a slice.
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

/// Template for the definitions of quantities that describe the robot's body (lengths, masses, moments of
/// inertia).
const BODY: Definition = Definition {
    unit: Unit::Metre,
    per: Per::Joint,
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
    is_relevant: |_, _| true,
    field: Field { get: |_| &[], get_mut: |_| &mut [] },
};
/// Template for the definitions of friction quantities.
const FRICTION: Definition = Definition {
    unit: Unit::Newton,
    per: Per::Wheel,
    range: [0.0, 1e6],
    default: Some(0.0),
    is_fitted: true,
    is_resistance: true,
    ..BODY
};
/// Template for the definitions of the passive joint's quantities.
const JOINT: Definition = Definition {
    per: Per::FreeJoint,
    is_resistance: false,
    is_relevant: |_, gait| gait.passive_joint().is_some(),
    ..FRICTION
};

impl Quantity {
    /// Returns the definition of the quantity.
    #[inline]
    pub const fn definition(self) -> &'static Definition {
        const TABLE: &[Definition; Quantity::ALL.len()] = &{
            let mut table = [BODY; Quantity::ALL.len()];
            let mut i = 0;
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
                label: "Middle wheel to joint",
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
                is_relevant: |laws, _| laws.skid.is_viscous(),
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
                is_relevant: |laws, _| laws.roll.is_viscous(),
                field: field!(roll_kg_s),
                ..FRICTION
            },
            Self::SkidDry => Definition {
                label: "Dry skid",
                meaning: "dry friction of the wheel across its rolling direction",
                latex: "F^S",
                is_free_by_default: true,
                is_relevant: |laws, _| laws.skid.is_dry(),
                field: field!(skid_dry_n),
                ..FRICTION
            },
            Self::SkidStatic => Definition {
                label: "Static skid",
                meaning: "static friction of the wheel across its rolling direction, at low speeds (Stribeck)",
                latex: "F^s",
                is_relevant: |laws, _| laws.skid.has_static(),
                field: field!(skid_static_n),
                ..FRICTION
            },
            Self::Stribeck => Definition {
                unit: Unit::MetrePerSecond,
                per: Per::Robot,
                label: "Stribeck speed",
                meaning: "Stribeck speed v_s, at which the excess of static over Coulomb friction has fallen to 1/e",
                latex: "v_s",
                range: [1e-6, 100.0],
                is_relevant: |laws, _| laws.skid.has_static(),
                field: field!(stribeck_m_s),
                ..FRICTION
            },
            Self::SkidPower => Definition {
                label: "Power-law skid",
                meaning: "power-law resistance F_p to skidding, at the transition speed",
                latex: "F^p",
                is_free_by_default: true,
                is_relevant: |laws, _| laws.skid == SkidLaw::Power,
                field: field!(skid_power_n),
                ..FRICTION
            },
            Self::SkidExponent => Definition {
                unit: Unit::One,
                label: "Exponent of skid",
                meaning: "exponent p of the power-law resistance to skidding",
                latex: "p",
                range: [0.05, 4.0],
                default: Some(1.0),
                is_free_by_default: true,
                is_resistance: false,
                is_relevant: |laws, _| laws.skid == SkidLaw::Power,
                field: field!(skid_exponent),
                ..FRICTION
            },
            Self::RollDry => Definition {
                label: "Dry roll",
                meaning: "dry friction of the wheel along its rolling direction",
                latex: "F^R",
                sum_label: Some("Sum of dry roll"),
                is_relevant: |laws, _| laws.roll.is_dry(),
                field: field!(roll_dry_n),
                ..FRICTION
            },
            Self::Transition => Definition {
                unit: Unit::MetrePerSecond,
                per: Per::Robot,
                label: "Transition speed",
                meaning: "transition speed v_t, below which dry friction is smoothed (regularisation)",
                latex: "v_t",
                range: [1e-6, 100.0],
                default: Some(0.005),
                is_resistance: false,
                is_relevant: |laws, _| !laws.are_linear(),
                field: field!(transition_m_s),
                ..FRICTION
            },
            Self::Stiffness => Definition {
                unit: Unit::NewtonMetrePerRadian,
                label: "Stiffness",
                meaning: "spring stiffness k_tau of the passive joint (eq. 11)",
                latex: "k_\\tau",
                field: field!(stiffness_nm_rad),
                ..JOINT
            },
            Self::Damping => Definition {
                unit: Unit::NewtonMetreSecondPerRadian,
                label: "Damping",
                meaning: "damping coefficient c_tau of the passive joint (eq. 11)",
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

    /// Returns the name of the quantity without its unit.
    pub fn stem(self) -> &'static str {
        let end = self.definition().unit.name();
        self.name().strip_suffix(end).map_or(self.name(), |stem| stem.trim_end_matches('_'))
    }

    /// Returns the number of values that the quantity has in a robot.
    #[inline]
    pub const fn count(self) -> usize {
        match self.definition().per {
            Per::Robot | Per::FreeJoint => 1,
            Per::Link | Per::Wheel => Robot::LINKS,
            Per::Joint => Robot::JOINTS,
        }
    }

    /// Returns the values of the quantity in a robot, in SI units.
    pub fn numbers(self, robot: &Robot) -> &[f64] {
        (self.definition().field.get)(robot)
    }

    /// Returns mutable access to the values of the quantity in a robot, in SI units.
    pub fn numbers_mut(self, robot: &mut Robot) -> &mut [f64] {
        (self.definition().field.get_mut)(robot)
    }

    /// Returns each wheel's fraction of the quantity's sum over the wheels; equal fractions if the sum is
    /// zero.
    pub fn shares(self, robot: &Robot) -> [f64; Robot::LINKS] {
        let numbers = self.numbers(robot);
        let sum: f64 = numbers.iter().sum();
        let equal = 1.0 / Robot::LINKS as f64;
        std::array::from_fn(|i| if sum > 0.0 { numbers[i] / sum } else { equal })
    }

    /// Returns the parameter of a quantity that has a single value for the whole robot.
    ///
    /// # Panics
    /// Panics if the quantity has one value per link, wheel or joint.
    pub const fn one(self) -> Parameter {
        assert!(self.count() == 1, "the quantity has a value for each link, wheel or joint");
        Parameter::new(self, 0)
    }

    /// Returns the parameter for the wheel, link or joint with the given index; indices 0 and 1 denote joints
    /// 1 and 2.
    pub const fn parameter(self, index: usize) -> Parameter {
        Parameter::new(self, index)
    }

    /// Returns the quantity's parameters for as many wheels as a robot can have; none if it is not one of wheels.
    pub fn of_any_wheel(self) -> impl Iterator<Item = Parameter> {
        let count = if self.definition().per == Per::Wheel { MAX_LINKS } else { 0 };
        (0..count).map(move |index| Parameter::new(self, index))
    }

    /// Returns the quantity's parameters for all wheels or links.
    pub const fn of_each(self) -> [Parameter; Robot::LINKS] {
        [self.parameter(0), self.parameter(1), self.parameter(2)]
    }

    /// Returns the parameter that is the quantity's mean over both joints.
    ///
    /// # Panics
    /// Panics if the quantity has no values for joints.
    pub const fn of_both(self) -> Parameter {
        assert!(
            matches!(self.definition().per, Per::Joint),
            "the quantity has no values for joints"
        );
        Parameter::new(self, Parameter::WHOLE)
    }

    /// Returns the parameter that is the quantity's sum over the wheels.
    ///
    /// # Panics
    /// Panics if the sum cannot be free in a fit.
    pub const fn sum(self) -> Parameter {
        assert!(
            self.definition().sum_label.is_some(),
            "the sum of this quantity over the wheels cannot be a free parameter of a fit"
        );
        Parameter::new(self, Parameter::WHOLE)
    }

    /// Returns the parameters that describe the quantity in a robot. For a joint quantity, that is one
    /// parameter if both joints have the same value, otherwise one for each joint.
    pub fn parameters_of(self, robot: &Robot) -> impl Iterator<Item = Parameter> {
        let numbers = self.numbers(robot);
        let is_one = self.definition().per == Per::Joint && numbers[0] == numbers[1];
        let indices =
            if is_one { Parameter::WHOLE..Parameter::WHOLE + 1 } else { 0..numbers.len() };
        indices.map(move |index| Parameter::new(self, index))
    }

    /// Returns all parameters of the quantity in a robot of three links: one for each of its values, followed by the mean over both
    /// joints of a joint quantity, or by the sum over the wheels if it can be free in a fit.
    pub fn parameters(self) -> impl Iterator<Item = Parameter> {
        let all = (0..=Parameter::WHOLE).map(move |index| Parameter::new(self, index));
        all.filter(|parameter| parameter.is_of_three_links())
    }
}
