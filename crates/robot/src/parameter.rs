//! Single scalar parameters of a robot.

use std::fmt;
use std::ops::{Index, IndexMut};
use std::sync::LazyLock;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use trilink_base::Named;

use super::{Definition, MAX_JOINTS, MAX_LINKS, Per, Quantity, Robot, Unit};

/// Scalar parameter of a robot: a [`Quantity`] of one wheel, link or joint or of the whole robot, the sum of
/// a quantity over the wheels, or its mean over both joints. The name of a parameter is that of its table
/// column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Parameter {
    quantity: Quantity,
    /// Index of the wheel, link or joint; the number of the joint from the front (1, 2, ..) for a joint of a chain that
    /// is not driven, and 0 for the passive joint of a robot of three links; or [`Parameter::WHOLE`].
    index: u8,
}

/// Names of a parameter.
struct Names {
    column: String,
    key: String,
    label: String,
}

/// Fills an array with all parameters of a set that can be free in a fit: those of a robot of three links, then, if
/// there is space, those that only chains have.
const fn fitted<const N: usize>() -> [Parameter; N] {
    let mut all = [Parameter::new(Quantity::H, 0); N];
    let mut count = 0;
    let mut is_of_chains = false;
    loop {
        let mut i = 0;
        while i < Quantity::ALL.len() {
            let quantity = Quantity::ALL[i];
            let mut index = 0;
            while quantity.definition().is_fitted && index <= Parameter::WHOLE && count < N {
                let parameter = Parameter::new(quantity, index);
                if if is_of_chains {
                    parameter.is_of_chains()
                } else {
                    parameter.is_of_three_links()
                } {
                    all[count] = parameter;
                    count += 1;
                }
                index += 1;
            }
            i += 1;
        }
        if is_of_chains {
            return all;
        }
        is_of_chains = true;
    }
}

/// Counts the parameters that can be free in a fit.
const fn count(is_of_chains: bool) -> usize {
    let mut count = 0;
    let mut i = 0;
    while i < Quantity::ALL.len() {
        let mut index = 0;
        while Quantity::ALL[i].definition().is_fitted && index <= Parameter::WHOLE {
            let parameter = Parameter::new(Quantity::ALL[i], index);
            let is_counted =
                if is_of_chains { parameter.is_of_chains() } else { parameter.is_of_three_links() };
            count += is_counted as usize;
            index += 1;
        }
        i += 1;
    }
    count
}

impl Parameter {
    /// Index of the sum over the wheels or of the mean over both joints.
    pub(super) const WHOLE: usize = MAX_LINKS;

    /// Parameters of a robot of three links that can be free in a fit, in the order of their table columns.
    pub const ALL: [Self; count(false)] = fitted();

    /// Parameters of all robots that can be free in a fit: [`Parameter::ALL`], then those that only chains have.
    pub const OF_ANY_ROBOT: [Self; count(false) + count(true)] = fitted();

    pub(super) const fn new(quantity: Quantity, index: usize) -> Self {
        Self { quantity, index: index as u8 }
    }

    /// Returns whether a robot of three links has the parameter.
    pub const fn is_of_three_links(self) -> bool {
        let Definition { per, sum_label, .. } = self.quantity.definition();
        let has_whole = sum_label.is_some() || matches!(per, Per::Joint);
        (self.index as usize) < self.quantity.count() || self.is_aggregate() && has_whole
    }

    /// Returns whether only chains have the parameter.
    const fn is_of_chains(self) -> bool {
        let index = self.index as usize;
        match self.quantity.definition().per {
            Per::Wheel | Per::Link => index >= self.quantity.count() && index < MAX_LINKS,
            Per::FreeJoint => index > 0 && index <= MAX_JOINTS,
            Per::Robot | Per::Joint => false,
        }
    }

    /// Returns the quantity to which the parameter belongs.
    #[inline]
    pub const fn quantity(self) -> Quantity {
        self.quantity
    }

    /// Returns the position of the parameter in [`Parameter::OF_ANY_ROBOT`].
    #[inline]
    const fn position(self) -> usize {
        debug_assert!(
            self.quantity.definition().is_fitted,
            "this quantity cannot be a free parameter of a fit"
        );
        Self::POSITIONS[self.quantity as usize][self.index as usize] as usize
    }

    /// Positions in [`Parameter::OF_ANY_ROBOT`] by quantity and index.
    const POSITIONS: [[u8; Self::WHOLE + 1]; Quantity::ALL.len()] = {
        let mut positions = [[u8::MAX; Self::WHOLE + 1]; Quantity::ALL.len()];
        let mut i = 0;
        while i < Self::OF_ANY_ROBOT.len() {
            let Self { quantity, index } = Self::OF_ANY_ROBOT[i];
            positions[quantity as usize][index as usize] = i as u8;
            i += 1;
        }
        positions
    };

    /// Returns the number of the wheel or link (0, 1, ..) or of the joint (1, 2, ..) to which the parameter belongs;
    /// `None` for a parameter of the whole robot or of its only passive joint, a sum over the wheels, or a mean over
    /// both joints.
    pub fn number(self) -> Option<usize> {
        let index = usize::from(self.index);
        match self.quantity.definition().per {
            _ if self.is_aggregate() => None,
            Per::Robot => None,
            Per::FreeJoint => (index > 0).then_some(index),
            Per::Joint => Some(index + 1),
            Per::Wheel | Per::Link => Some(index),
        }
    }

    fn names(self) -> &'static Names {
        static NAMES: LazyLock<Vec<Vec<Names>>> = LazyLock::new(|| {
            let of = |quantity| {
                let all = (0..=Parameter::WHOLE).map(move |index| Parameter::new(quantity, index));
                all.map(Parameter::new_names).collect()
            };
            Quantity::ALL.into_iter().map(of).collect()
        });
        &NAMES[self.quantity as usize][usize::from(self.index)]
    }

    fn new_names(self) -> Names {
        let stem = self.quantity.stem();
        let definition = self.quantity.definition();
        let unit = match definition.unit {
            Unit::One => String::new(),
            unit => format!("_{}", unit.name()),
        };
        match (self.number(), definition.sum_label) {
            (Some(i), _) => Names {
                column: format!("{stem}{i}{unit}"),
                key: format!("{stem}{i}"),
                label: format!("{} {i}", definition.label),
            },
            (None, Some(label)) => Names {
                column: format!("{stem}_sum{unit}"),
                key: stem.to_owned(),
                label: label.to_owned(),
            },
            (None, None) => Names {
                column: self.quantity.name().to_owned(),
                key: stem.to_owned(),
                label: definition.label.to_owned(),
            },
        }
    }

    /// Returns the name of the parameter's column in tables.
    pub fn name(self) -> &'static str {
        &self.names().column
    }

    /// Returns the name of the parameter in configuration lists.
    pub fn key(self) -> &'static str {
        &self.names().key
    }

    /// Returns the label of the parameter on a figure's axis.
    pub fn label(self) -> &'static str {
        &self.names().label
    }

    /// Returns the LaTeX symbol of the parameter; that of a sum is over the given numbers of wheels.
    pub fn latex(self, wheels: impl IntoIterator<Item = usize>) -> String {
        let symbol = self.quantity.definition().latex;
        match self.number() {
            Some(i) => format!("{symbol}_{i}"),
            None if self.is_sum() => {
                let each = wheels.into_iter().map(|i| format!("{symbol}_{i}"));
                each.collect::<Vec<_>>().join(" + ")
            }
            None => symbol.to_owned(),
        }
    }

    /// Returns the unit of the parameter's values for display.
    pub const fn unit(self) -> &'static str {
        self.quantity.definition().unit.symbol()
    }

    /// Returns the exponent with which the parameter scales with frequency. If every parameter that can be
    /// free in a fit is multiplied by the ratio of two frequencies raised to the parameter's own exponent,
    /// the motion as a function of phase is the same at both frequencies.
    pub fn power_of_omega(self) -> f64 {
        match self.quantity.definition().unit {
            Unit::Newton | Unit::NewtonMetrePerRadian => 2.0,
            Unit::One => 0.0,
            _ => 1.0,
        }
    }

    /// Returns whether the parameter equals `other` or is one of the terms of the sum `other`.
    pub fn is_part_of(self, other: Self) -> bool {
        self == other || other.is_sum() && self.quantity == other.quantity
    }

    /// Returns the sum over the wheels, or the mean over both joints, to which the parameter contributes;
    /// `None` if there is none.
    pub fn whole(self) -> Option<Self> {
        let whole = Self::new(self.quantity, Self::WHOLE);
        self.quantity.parameters().find(|other| *other == whole).filter(|_| !self.is_aggregate())
    }

    /// Returns whether the parameter is a sum over the wheels.
    #[inline]
    pub fn is_sum(self) -> bool {
        self.is_aggregate() && self.quantity.definition().sum_label.is_some()
    }

    /// Returns whether the parameter is a sum over the wheels or a mean over both joints.
    #[inline]
    const fn is_aggregate(self) -> bool {
        self.index as usize == Self::WHOLE
    }

    /// Returns the value of the parameter in a robot of three links, in SI units; NaN if only chains have the parameter.
    pub fn value_in(self, robot: &Robot) -> f64 {
        let numbers = self.quantity.numbers(robot);
        if !self.is_aggregate() {
            numbers.get(usize::from(self.index)).copied().unwrap_or(f64::NAN)
        } else if self.is_sum() {
            numbers.iter().sum()
        } else {
            numbers.iter().sum::<f64>() / numbers.len() as f64
        }
    }

    /// Sets the value of the parameter in a robot of three links, in SI units; a parameter that only chains have is
    /// ignored. Setting a sum keeps the proportions between
    /// the wheels' values, or divides the sum equally among the wheels if all values are zero; setting a mean
    /// over both joints keeps the difference between the joints' values.
    pub fn set(self, robot: &mut Robot, value: f64) {
        let before = self.value_in(robot);
        if !self.is_aggregate() {
            if let Some(number) = self.quantity.numbers_mut(robot).get_mut(usize::from(self.index))
            {
                *number = value;
            }
        } else if self.is_sum() {
            let shares = self.quantity.shares(robot).map(|share| share * value);
            self.quantity.numbers_mut(robot).copy_from_slice(&shares);
        } else {
            let numbers = self.quantity.numbers_mut(robot);
            numbers.iter_mut().for_each(|number| *number = value + (*number - before));
        }
    }
}

impl Named for Parameter {
    fn first() -> Self {
        Self::ALL[0]
    }

    fn as_name(&self) -> &str {
        self.name()
    }

    fn of_name(name: &str) -> Option<Self> {
        let of_three_links = Quantity::ALL.into_iter().flat_map(Quantity::parameters);
        of_three_links.chain(Self::OF_ANY_ROBOT).find(|parameter| parameter.name() == name)
    }
}

impl fmt::Display for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Serializes a parameter as its column name.
impl Serialize for Parameter {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for Parameter {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        Self::of_name(&name)
            .ok_or_else(|| serde::de::Error::custom(format!("unknown parameter `{name}`")))
    }
}

/// One value for each of the first `N` parameters of [`Parameter::OF_ANY_ROBOT`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ByParameter<T, const N: usize = { Parameter::OF_ANY_ROBOT.len() }>([T; N]);

impl ByParameter<f64> {
    /// All values missing (NaN).
    pub const MISSING: Self = Self::splat(f64::NAN);
}

impl<T: Copy, const N: usize> ByParameter<T, N> {
    /// Creates a collection that has the same value for every parameter.
    pub const fn splat(value: T) -> Self {
        Self([value; N])
    }
}

impl<T, const N: usize> ByParameter<T, N> {
    /// Creates a collection by calling `value` for each parameter.
    pub fn from_fn(mut value: impl FnMut(Parameter) -> T) -> Self {
        Self(std::array::from_fn(|i| value(Parameter::OF_ANY_ROBOT[i])))
    }

    /// Iterates over the values in the order of [`Parameter::OF_ANY_ROBOT`].
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.0.iter_mut()
    }

    /// Iterates over the parameters and their values.
    pub fn iter(&self) -> impl Iterator<Item = (Parameter, &T)> {
        Parameter::OF_ANY_ROBOT.into_iter().zip(&self.0)
    }
}

impl<T, const N: usize> Index<Parameter> for ByParameter<T, N> {
    type Output = T;
    fn index(&self, parameter: Parameter) -> &T {
        &self.0[parameter.position()]
    }
}

impl<T, const N: usize> IndexMut<Parameter> for ByParameter<T, N> {
    fn index_mut(&mut self, parameter: Parameter) -> &mut T {
        &mut self.0[parameter.position()]
    }
}

/// Serializes the values as a map keyed by column; values of parameters that only chains have are left out if missing.
impl Serialize for ByParameter<f64> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let is_listed =
            |parameter: Parameter, value: &f64| parameter.is_of_three_links() || !value.is_nan();
        serializer
            .collect_map(self.iter().filter(|(parameter, value)| is_listed(*parameter, value)))
    }
}

#[cfg(test)]
mod tests {
    use trilink_base::Named;

    use super::*;

    #[test]
    fn setting_a_parameter_changes_that_parameter_alone() {
        for parameter in Parameter::ALL {
            let mut robot = Robot::semi_passive();
            parameter.set(&mut robot, 2.5);
            assert_eq!(parameter.value_in(&robot), 2.5, "{parameter:?}");
            assert_eq!(Parameter::of_name(parameter.name()), Some(parameter));
            let others = Parameter::ALL.into_iter().filter(|other| {
                let related = [other.is_part_of(parameter), parameter.is_part_of(*other)];
                !related.contains(&true)
            });
            for other in others {
                assert_eq!(
                    other.value_in(&robot),
                    other.value_in(&Robot::semi_passive()),
                    "{other:?}"
                );
            }
        }
    }

    #[test]
    fn parameters_of_chains_follow_and_have_names_of_their_own() {
        let names: Vec<&str> =
            Parameter::OF_ANY_ROBOT.iter().map(|parameter| parameter.name()).collect();
        assert_eq!(names[..Parameter::ALL.len()], Parameter::ALL.map(Parameter::name));
        let distinct: std::collections::BTreeSet<&str> = names.iter().copied().collect();
        assert_eq!(distinct.len(), names.len());
        assert!(["skid7_kg_s", "stiffness3_nm_rad"].iter().all(|name| distinct.contains(name)));
        let values = ByParameter::<usize>::from_fn(Parameter::position);
        assert!(values.iter().enumerate().all(|(i, (_, position))| *position == i));
        assert_eq!(Quantity::Stiffness.parameter(2).number(), Some(2));
        assert!(Quantity::Skid.parameter(3).value_in(&Robot::kinematic()).is_nan());
    }

    #[test]
    fn the_mean_of_both_joints_keeps_their_difference() {
        let mut robot = Robot { l_m: [0.11, 0.13], ..Robot::kinematic() };
        let both = Quantity::L.of_both();
        assert!((both.value_in(&robot) - 0.12).abs() < 1e-15);
        both.set(&mut robot, 0.125);
        assert!((robot.l_m[0] - 0.115).abs() < 1e-15 && (robot.l_m[1] - 0.135).abs() < 1e-15);
        let names = |robot: &Robot| {
            Quantity::L.parameters_of(robot).map(Parameter::name).collect::<Vec<_>>()
        };
        assert_eq!(names(&robot), ["l1_m", "l2_m"]);
        assert_eq!(names(&Robot::kinematic()), ["l_m"]);
        assert_eq!(Quantity::L.parameter(1).whole(), Some(both));
        assert_eq!([both.whole(), Quantity::Mass.parameter(0).whole()], [None; 2]);
    }

    #[test]
    fn a_sum_of_roll_resistances_keeps_their_proportions() {
        let mut robot = Robot::kinematic();
        Quantity::Roll.sum().set(&mut robot, 2.4);
        assert_eq!(robot.roll_kg_s, [1.2, 0.6, 0.6]);
        robot.roll_kg_s = [0.0; 3];
        Quantity::Roll.sum().set(&mut robot, 2.4);
        assert_eq!(robot.roll_kg_s.map(|roll| (roll * 10.0).round()), [8.0; 3]);
    }
}
